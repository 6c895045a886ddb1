"""What the 3-PPPS looks like in a pose."""

import math
from typing import TYPE_CHECKING

import numpy as np
from jax.typing import ArrayLike

from jaxkin.core.bodies import Body
from jaxkin.core.errors import InputError
from jaxkin.numerics import rotations

if TYPE_CHECKING:
    from jaxkin.mechanisms.ppps3 import PPPS3


def corners(robot: "PPPS3", pose: ArrayLike) -> np.ndarray:
    """Returns the corners W1, W2, W3 of the platform, ``(3, 3)``.

    References:
        Chablat et al. 2018, Eq. (5); V2 and V3 of Eq. (4) are exchanged, see ``jaxkin.mechanisms.ppps3``.
    """
    values = np.asarray(pose, float)
    if values.shape != (6,):
        raise InputError(f"The pose has shape {values.shape}: it must be one pose (x, y, z, phi, theta, sigma).")
    rotation = np.array(rotations.matrix_from_xyz(values[3], values[4], values[5]))  # type: ignore[arg-type]
    side = float(robot.side)
    long, short = side * math.sqrt(3.0) / 2, side * robot.mirror / 2
    own = np.array([[0.0, 0.0, 0.0], [-long, -short, 0.0], [-long, short, 0.0]])
    return values[:3] + own @ rotation.T


def bodies(robot: "PPPS3", pose: ArrayLike) -> tuple[Body, ...]:
    """Returns the base, the three joints of every leg, and the platform.

    A leg stands at A_i on the base and reaches its corner of the platform along three perpendicular axes: its two
    actuated joints, along the base and upright, then the passive one. The paper leaves their order open; that of its
    Fig. 1, and the ends of the U, are ours.
    """
    ends = corners(robot, pose)
    r = float(robot.base_radius)
    back = min(-r, *ends[1:, 0])
    found = [Body("base", np.array([[back, r, 0.0], [r, r, 0.0], [r, -r, 0.0], [back, -r, 0.0]]), "base")]
    feet = np.array([[r, 0.0, 0.0], [0.0, r, 0.0], [0.0, -r, 0.0]])
    for limb, (foot, end, along) in enumerate(zip(feet, ends, (1, 0, 0), strict=True), 1):
        path = [foot]
        for axis in (along, 2, 1 - along):
            path.append(path[-1].copy())
            path[-1][axis] = end[axis]
        for name, k in (("y", 0), ("z", 1), ("x", 2)):
            points = np.array(path[k : k + 2])
            found.append(Body(f"rho{limb}{name}", points, "passive" if name == "x" else "actuated", limb=limb))
        found.append(Body(f"A{limb}", foot[None], "joint", limb=limb))
    found.append(Body("platform", ends, "platform", closed=True))
    found += [Body(f"C{limb}", end[None], "joint", limb=limb) for limb, end in enumerate(ends, 1)]
    return tuple(found)
