"""Cusp curves of the reference 3-RPR, and the number of cusps of its sections against rho1."""

import csv

from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("15", __doc__)
    robot = jk.mechanisms.rpr3.reference()
    box = jk.Grid(rho1=(0.0, 40.0, 12), rho2=(0.0, 60.0, 12), rho3=(0.0, 60.0, 12))
    found = jk.cusp_curves(robot, box)
    print(found)
    transitions = found.transitions("rho1")
    print(transitions)
    with open(folder / "transitions.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["rho1", "cusps below", "cusps above", "kind"])
        for value, counts, kind in zip(transitions.values, transitions.counts, transitions.kinds, strict=True):
            writer.writerow([f"{float(value):.12g}", *map(int, counts), kind])
    print(folder / "transitions.csv")
    save(jk.plot.cusp_curves(found, axis="rho1")[0].figure, folder, "rpr3_number_of_cusps")


if __name__ == "__main__":
    main()
