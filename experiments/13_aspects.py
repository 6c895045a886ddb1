"""Aspects of a five-bar in its four working modes, and of the reference 3-RPR in slices of the workspace."""

import csv
import math
from pathlib import Path

from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("13", __doc__)
    five_bar = jk.mechanisms.five_bar.create(base=9.0, proximal=(8.0, 8.0), distal=(5.0, 5.0))
    poses = jk.Grid(x=(-4.5, 13.5, 256), y=(-12.5, 12.5, 256))
    found = jk.aspects(five_bar, poses)
    curves = jk.singular_curves(five_bar, poses, kind="both")
    write(found, folder / "five_bar_aspects.csv")
    save(jk.plot.aspects(found, curves=curves)[0].figure, folder, "five_bar_aspects")

    robot = jk.mechanisms.rpr3.reference()
    box = jk.Grid(x=(-30.0, 30.0, 64), y=(-30.0, 30.0, 64), phi=(-math.pi, math.pi, 64))
    found = jk.aspects(robot, box)
    write(found, folder / "rpr3_aspects.csv")
    save(jk.plot.aspects(found)[0].figure, folder, "rpr3_aspects")


def write(found: jk.Aspects, path: Path) -> None:
    """Writes a line for every aspect."""
    print(found)
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["aspect", "sign", "volume", "error", "clearance", *found.pose_names])
        for aspect in found:
            row = [aspect.volume, aspect.error, aspect.clearance, *aspect.pose]
            writer.writerow([aspect.name, aspect.sign, *(f"{float(value):.9g}" for value in row)])
    print(path)


if __name__ == "__main__":
    main()
