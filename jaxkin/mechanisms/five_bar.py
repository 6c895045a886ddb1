"""The five-bar RR-RRR: two driven cranks on a base carry a point by two rods.

Pose ``(x, y)``: the point P; joints ``(theta1, theta2)``: angles of the cranks against the base line. The crank pivots
are (0, 0) and (base, 0). Crank k of length l1, l2 ends in C_k; rod k of length l3, l4 joins C_k to P. Each leg reaches
a pose in two ways: four working modes, named by the signs of dF_k/dtheta_k; each pair of angles has two assembly modes.

The mechanism is written in the plainest way, by its constraints alone: whatever jaxkin answers about it, it would
answer about a mechanism of yours.

References:
    Chablat, D. and Wenger, P., 1998, "Working modes and aspects in fully parallel manipulators" (working modes, aspects
    of the five-bar).
"""

from collections.abc import Sequence
from typing import Any, ClassVar, TypeAlias

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import GeometryError
from jaxkin.core.mechanism import Axis, Limits, Mechanism, angle, mechanism, plain
from jaxkin.core.tracing import is_traced
from jaxkin.mechanisms._geometry import batch_limits, leaves, vector_leaf

Numbers: TypeAlias = ArrayLike | Sequence[Any]


@mechanism
class FiveBar(Mechanism):
    """The five-bar RR-RRR; use ``create`` to build one.

    Attributes:
        base: Distance of the crank pivots.
        proximal: ``(2,)`` lengths l1, l2 of the cranks.
        distal: ``(2,)`` lengths l3, l4 of the rods.
        limits: Ranges of the crank angles, rad.
    """

    id: ClassVar[str] = "five-bar"
    pose_axes = (Axis("x", "length"), Axis("y", "length"))
    joint_axes = (angle("theta1"), angle("theta2"))
    max_branches = 4

    base: Array
    proximal: Array
    distal: Array
    limits: Limits

    def constraints(self, pose: Array, joints: Array) -> Array:
        """Returns |P - C_k|^2 minus the square of rod k's length, ``(2,)``."""
        x, y = pose
        elbow = self.proximal * jnp.stack([jnp.cos(joints), jnp.sin(joints)])
        pivot = jnp.stack([jnp.zeros_like(self.base), self.base])
        return (x - pivot - elbow[0]) ** 2 + (y - elbow[1]) ** 2 - self.distal**2

    def characteristic_length(self) -> Array:
        """Returns the mean length of cranks and rods."""
        return 0.25 * (jnp.sum(self.proximal, axis=-1) + jnp.sum(self.distal, axis=-1))


def create(base: ArrayLike, proximal: Numbers, distal: Numbers, limits: Limits | None = None) -> FiveBar:
    """Builds a five-bar.

    Args:
        base: Distance of the crank pivots, not negative.
        proximal: Lengths (l1, l2) of the cranks.
        distal: Lengths (l3, l4) of the rods.
        limits: Ranges of the crank angles, rad, within [-pi, pi]; none by default.

    Raises:
        GeometryError: A length is not positive, the base distance is negative, or no pose closes the chain.
    """
    (distance,) = leaves(base=base).values()
    robot = FiveBar(
        base=distance,
        proximal=vector_leaf("proximal", proximal, 2, distance),
        distal=vector_leaf("distal", distal, 2, distance),
        limits=batch_limits("limits", limits or Limits.none(2), 2, distance, ("theta1", "theta2")),
    )
    if not is_traced(distance) and not is_traced(robot.proximal) and not is_traced(robot.distal):
        _check(robot)
    return robot


def _check(robot: FiveBar) -> None:
    for name in ("proximal", "distal"):
        value = np.asarray(getattr(robot, name))
        if not np.all(value > 0):
            raise GeometryError(f"{name} is {plain(value)}: the lengths of cranks and rods must be positive.")
    base = np.asarray(robot.base)
    if not np.all(base >= 0):
        raise GeometryError(f"base is {plain(base)}: the distance of the pivots must not be negative; give its size.")
    reach = np.sum(robot.proximal, axis=-1) + np.sum(robot.distal, axis=-1)
    if not np.all(base < reach):
        raise GeometryError(
            f"base is {plain(base)}, and cranks and rods together are only {plain(reach)} long: the chain does not "
            "close; move the pivots together."
        )
