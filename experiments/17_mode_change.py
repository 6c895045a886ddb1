"""The reference 3-RPR goes from one assembly mode to another without a singularity, around a cusp curve.

Joints (14.98, 15.38, 12): a figure with five places of the path, and a moving picture.
"""

import numpy as np
from _common import save, start

import jaxkin as jk

#: The picture shows cusp curves this far around the loop.
_AROUND = 2.0


def main() -> None:
    folder = start("17", __doc__)
    robot = jk.mechanisms.rpr3.reference()
    joints = np.array([14.98, 15.38, 12.0])
    modes = jk.forward(robot, joints)
    # Both have det dF/dpose < 0.
    found = jk.mode_change(robot, joints, modes.values[0], modes.values[4], encircle=True)
    print(found)
    low, high = found.joints.min(axis=0) - _AROUND, found.joints.max(axis=0) + _AROUND
    ends = zip(found.joint_names, np.maximum(low, 0.0), high, strict=True)
    curves = jk.cusp_curves(robot, jk.Grid(**{name: (float(a), float(b), 8) for name, a, b in ends}))
    print(curves)
    save(jk.plot.mode_change(found, robot, curves)[0].figure, folder, "rpr3_mode_change")
    print(jk.plot.animate_mode_change(found, folder / "rpr3_mode_change.gif", robot, curves, overwrite=True))


if __name__ == "__main__":
    main()
