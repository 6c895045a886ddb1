"""The six assembly modes of the field's reference 3-RPR at legs (14.98, 15.38, 12).

Geometry of Innocenti and Parenti-Castelli (1998). The modes are solved from it here; values quoted in the
literature come from rounded inputs and agree to about 0.01.
"""

import csv

import numpy as np
from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("02", __doc__)
    robot = jk.mechanisms.rpr3.reference()
    joints = np.array([14.98, 15.38, 12.0])
    modes = jk.forward(robot, joints)
    print(modes)
    with open(folder / "six_modes.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["x", "y", "phi", "determinant", "clearance", "residual"])
        for pose, residual in zip(modes.values, modes.residual, strict=True):
            measures = jk.conditioning(robot, pose, joints)
            row = [*pose, measures.determinant, measures.smallest_singular_value, residual]
            writer.writerow([f"{float(v):.17g}" for v in row])
    print(folder / "six_modes.csv")
    save(jk.plot.mechanism(robot, joints, modes).flat[0].figure, folder, "rpr3_six_modes")


if __name__ == "__main__":
    main()
