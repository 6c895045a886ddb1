"""The reference 3-RPR goes from one assembly mode to another without a singularity, around a cusp curve.

Joints (14.98, 15.38, 12): a figure with five places of the path, and a moving picture.
"""

import numpy as np
from _common import save, start

import jaxkin as jk


def main() -> None:
    folder = start("17", __doc__)
    robot = jk.mechanisms.rpr3.reference()
    joints = np.array([14.98, 15.38, 12.0])
    modes = jk.forward(robot, joints)
    # Both have det dF/dpose < 0.
    found = jk.mode_change(robot, joints, modes.values[0], modes.values[4])
    print(found)
    save(jk.plot.mode_change(found, robot)[0].figure, folder, "rpr3_mode_change")
    print(jk.plot.animate_mode_change(found, folder / "rpr3_mode_change.gif", robot, overwrite=True))


if __name__ == "__main__":
    main()
