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

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.bodies import Body
from jaxkin.core.errors import GeometryError
from jaxkin.core.mechanism import Axis, Limits, Mechanism, angle, mechanism, plain
from jaxkin.core.tracing import is_traced
from jaxkin.mechanisms._geometry import batch_limits, leaves, vector_leaf
from jaxkin.numerics.spheres import Shells

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

    def reach_rings(self, phi: ArrayLike = 0.0) -> Shells:
        """Returns the rings that the legs reach, each of |l1 - l3| to l1 + l3 about its pivot; the third holds all.

        Limits of the crank angles do not count; there is no angle ``phi``.
        """
        del phi
        zero, far = jnp.zeros_like(self.base), jnp.sum(self.proximal) + jnp.sum(self.distal) + self.base
        centres = jnp.stack([jnp.stack([zero, zero]), jnp.stack([self.base, zero]), jnp.stack([zero, far])])
        apart, along = jnp.abs(self.proximal - self.distal), self.proximal + self.distal
        return Shells(centres, jnp.append(apart, zero), jnp.append(along, 4 * far))

    def linkage(self, pose: ArrayLike, joints: ArrayLike) -> tuple[Body, ...]:
        """Returns base line, cranks, rods, joints and the point P of one configuration, for drawing."""
        tip, angles = np.asarray(pose, float), np.asarray(joints, float)
        pivots = np.array([[0.0, 0.0], [float(self.base), 0.0]])
        arms = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        elbows = pivots + np.asarray(self.proximal)[:, None] * arms
        bodies = [Body("base", pivots, "base")]
        for k in range(2):
            bodies.append(Body(f"l{k + 1}", np.stack([pivots[k], elbows[k]]), "actuated", limb=k + 1))
            bodies.append(Body(f"l{k + 3}", np.stack([elbows[k], tip]), "link", limb=k + 1))
            bodies.append(Body(f"A{k + 1}", pivots[k : k + 1], "joint", limb=k + 1))
            bodies.append(Body(f"C{k + 1}", elbows[k : k + 1], "joint", limb=k + 1))
        return (*bodies, Body("P", tip[None], "platform"))


def create(base: ArrayLike, proximal: Numbers, distal: Numbers, limits: Limits | None = None) -> FiveBar:
    """Builds a five-bar.

    Args:
        base: Distance of the crank pivots, not negative.
        proximal: Lengths (l1, l2) of the cranks.
        distal: Lengths (l3, l4) of the rods.
        limits: Ranges of the crank angles, rad, within [-pi, pi]; none by default.

    Raises:
        GeometryError: A length is not positive, the base distance is negative, one length is not less than the others
            together (the chain does not close), or a limit lies beyond [-pi, pi].
    """
    (distance,) = leaves(base=base).values()
    robot = FiveBar(
        base=distance,
        proximal=vector_leaf("proximal", proximal, 2, distance),
        distal=vector_leaf("distal", distal, 2, distance),
        limits=batch_limits("limits", limits or Limits.none(2), 2, distance, ("theta1", "theta2")),
    )
    if not any(map(is_traced, jax.tree_util.tree_leaves(robot))):
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
    links = np.concatenate([base[..., None], robot.proximal, robot.distal], axis=-1)
    longest, number = np.max(links, axis=-1), np.argmax(links, axis=-1)
    open_ = np.atleast_1d(2 * longest >= np.sum(links, axis=-1))
    if open_.any():
        place = int(np.flatnonzero(open_)[0])
        name = ("base", "proximal[0]", "proximal[1]", "distal[0]", "distal[1]")[np.atleast_1d(number)[place]]
        size = float(np.atleast_1d(longest)[place])
        rest = float(np.atleast_1d(np.sum(links, axis=-1))[place]) - size
        raise GeometryError(
            f"{name} is {size:g}, and the other four lengths together are only {rest:g}: the chain does not close; "
            "shorten it, or lengthen the others."
        )
    ends = np.stack([robot.limits.low, robot.limits.high])
    if np.any(np.isfinite(ends) & (np.abs(ends) > np.pi)):
        raise GeometryError(
            f"limits has an end of {np.max(np.abs(ends[np.isfinite(ends)])):g} rad: crank angles are in [-pi, pi); "
            "give limits between -pi and pi, or -inf and inf where there are none."
        )
