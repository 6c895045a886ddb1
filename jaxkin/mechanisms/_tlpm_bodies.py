"""What the TLPM looks like in a pose."""

import math
from typing import TYPE_CHECKING

import numpy as np
from jax.typing import ArrayLike

from jaxkin.core.bodies import Body
from jaxkin.core.errors import InputError
from jaxkin.mechanisms import _tlpm_wrist

if TYPE_CHECKING:
    from jaxkin.mechanisms.tlpm import TLPM

#: Corners of the polygon that stands for the circle of q1, q2, q3.
_CIRCLE = 96
#: Length of a limb's tube, the rest being its rod, as a share of its shortest length (without limits: its initial one).
_TUBE = 0.6


def bodies(robot: "TLPM", pose: ArrayLike) -> tuple[Body, ...]:
    """Returns the base, the limbs, the links of the wrists, and the platform, mm.

    A limb is a tube and a rod on the line from q_i to p; its rod ends where link L_i2 begins. The platform is a plate
    over the ends of the links L_i3, on the R2 axes. All but the lines q_i p is [ours], as the sizes are not printed.
    """
    p = np.asarray(pose, float)
    if p.shape != (3,):
        raise InputError(f"The pose has shape {p.shape}: it must be one pose (x, y, z), mm.")
    q = np.array([[float(x), float(y), -float(robot.height)] for x, y in robot.base_points()])
    turn = np.linspace(0.0, 2 * math.pi, _CIRCLE, endpoint=False)
    circle = float(robot.base_radius) * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1) + [0, 0, q[0, 2]]
    found = [Body("base", circle, "base", closed=True)]
    links = np.asarray(_tlpm_wrist.links(robot, p))
    for k in range(3):
        found += _limb(robot, k, q[k], p)
        found.append(Body(f"q{k + 1}", q[k][None], "joint", limb=k + 1))
        for number, ends in ((2, links[k]), (3, links[k + 3])):
            if np.isfinite(ends).all():
                found.append(Body(f"L{k + 1}{number}", ends, "link", limb=k + 1, width=float(robot.a)))
        found.append(Body(f"R2 axis {k + 1}", np.stack([p, links[k + 3, 1]]), "axis", limb=k + 1))
    found.append(Body("platform", links[3:, 1], "platform", closed=True))
    found.append(Body("p", p[None], "joint"))
    return tuple(body for body in found if np.isfinite(body.points).all())


def _limb(robot: "TLPM", k: int, q: np.ndarray, p: np.ndarray) -> list[Body]:
    """Returns tube, rod and axis of a limb; none if it has no length."""
    length = float(np.linalg.norm(p - q))
    if length == 0:
        return []
    initial, low = float(robot.initial_lengths[k]), float(robot.limits.low[k])
    tube = min(_TUBE * (initial + low if math.isfinite(low) else initial), 0.9 * length)
    rod = max(length - float(robot.b), tube)
    at = [q + share / length * (p - q) for share in (0.0, tube, rod)]
    return [
        Body(f"limb {k + 1} axis", np.stack([at[2], p]), "axis", limb=k + 1),
        Body(f"limb {k + 1} rod", np.stack([at[1], at[2]]), "link", limb=k + 1),
        Body(f"l{k + 1}", np.stack([at[0], at[1]]), "actuated", limb=k + 1),
    ]
