"""What a mechanism looks like: lines, plates and points in space or in the plane, for drawings."""

from typing import Literal, NamedTuple

import numpy as np

#: The roles that drawings tell apart; an ``"axis"`` is a line of the geometry and no part of the machine.
Kind = Literal["base", "platform", "actuated", "passive", "link", "joint", "axis"]


class Body(NamedTuple):
    """One part of a mechanism in one pose.

    ``bodies(pose) -> tuple[Body, ...]`` makes a mechanism drawable in space, and ``linkage(pose, joints)``, the same
    with points ``(k, 2)``, in the plane.

    Attributes:
        name: The paper's name of the part, such as ``"rho1y"`` or ``"L12"``.
        points: ``(k, 3)`` or ``(k, 2)`` corners of a line or a plate; a joint has one.
        kind: Its role.
        closed: True for a plate, whose last point is joined to the first.
        limb: Number of its limb, from 1, or None.
        width: Side of the square cross-section of a bar, in the unit of the points; 0 for what has no thickness.
    """

    name: str
    points: np.ndarray
    kind: Kind
    closed: bool = False
    limb: int | None = None
    width: float = 0.0
