"""Walls: smooth functions of the coordinates between whose zeros a field's label cannot change.

An adaptive sweep proves cells constant by bounding them. A mechanism whose number of assembly modes follows from signs
declares ``count_walls``; on the sheets of the inverse kinematics walls follow from how the equations hold the joints.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.legs import LegKind, Legs, legs_of
from jaxkin.numerics.newton import lattice
from jaxkin.numerics.small_linalg import any_determinant


@dataclass(frozen=True, eq=False)
class Walls:
    """What bounds the labels of a field.

    Attributes:
        function: ``(mechanism, coordinates (n,)) -> (m,)``: on any connected set within the limits on which none of them
            vanishes, the label is one. Walls too many cost proofs, never their truth.
        low: ``(n,)`` lower limits of the coordinates, inclusive; None where there are none.
        high: ``(n,)`` upper ones. Outside of them the label is one as well.
    """

    function: Callable[[Mechanism, Array], Array]
    low: np.ndarray | None = None
    high: np.ndarray | None = None


def count_walls(robot: Mechanism) -> Walls | None:
    """Returns the walls of the number of assembly modes, None where the mechanism declares none."""
    if robot.count_walls is None:
        return None
    limits = robot.limit_values()
    low, high = np.asarray(limits.low, float), np.asarray(limits.high, float)
    return Walls(lambda own, joints: own.count_walls(joints), low, high)  # type: ignore[misc]


def inverse_walls(robot: Mechanism) -> Walls | None:
    """Returns the walls of the statuses of the working modes: reach of the legs, and joint limits."""
    legs = _closed_legs(robot)
    return None if legs is None else Walls(_sheet_function(robot, legs, None))


def determinant_walls(robot: Mechanism) -> Walls | None:
    """Returns the walls of the sign of det A, and of where there is one.

    None where det A hangs on the working mode and the mechanism declares no factors of it.
    """
    legs = _closed_legs(robot)
    if legs is None:
        return None
    factors = [getattr(robot, name) for name in ("factors", "chart_factors") if getattr(robot, name, None)]
    if factors:
        names = tuple(factor.__name__ for factor in factors)
        return Walls(_sheet_function(robot, legs, lambda own, pose: _declared(own, pose, names)))
    if _hangs_on_joints(robot):
        return None
    return Walls(_sheet_function(robot, legs, _determinant))


def _closed_legs(robot: Mechanism) -> Legs | None:
    """Returns how the equations hold the joints; None where a search, not a closed form, finds working modes."""
    return None if robot.inverse_kernel is None else legs_of(robot)


def _declared(robot: Mechanism, pose: Array, names: tuple[str, ...]) -> list[Array]:
    return [value for name in names for value in getattr(robot, name)(pose).values()]


def _determinant(robot: Mechanism, pose: Array) -> list[Array]:
    joints = jnp.zeros(len(robot.joint_axes))
    return [any_determinant(jax.jacfwd(robot.constraints)(pose, joints))]


@jax.jit
def _mixed_derivatives(robot: Mechanism, points: Array) -> tuple[Array, Array]:
    n = len(robot.pose_axes)

    def one(point: Array) -> tuple[Array, Array]:
        slope = jax.jacfwd(robot.constraints, argnums=0)
        return slope(point[:n], point[n:]), jax.jacfwd(slope, argnums=1)(point[:n], point[n:])

    return jax.vmap(one)(points)


def _hangs_on_joints(robot: Mechanism) -> bool:
    """True where dF/dpose is not a function of the pose alone, seen at points in general position."""
    length = robot.characteristic_length()
    points = jnp.asarray(lattice(3, 2 * len(robot.pose_axes)) + 0.5) * length
    slope, mixed = (np.asarray(part) for part in _mixed_derivatives(robot, points))
    return bool(np.max(np.abs(mixed)) * float(length) > 1e-12 * np.max(np.abs(slope)))


def _sheet_function(
    robot: Mechanism, legs: Legs, singular: Callable[[Mechanism, Array], list[Array]] | None
) -> Callable[[Mechanism, Array], Array]:
    """Returns singular walls, then where a leg ceases to reach, then its equation with the joint at a finite limit.

    The equation of a leg holds one joint: with that joint at its limit it vanishes where a working mode meets the limit.
    """
    limits = robot.limit_values()
    at = [
        (k, name) for name in ("low", "high") for k, end in enumerate(np.asarray(getattr(limits, name))) if _finite(end)
    ]

    def function(own: Mechanism, pose: Array) -> Array:
        walls = [] if singular is None else list(singular(own, pose))
        walls += [_reach(own, legs, pose, k) for k in range(len(legs.rows))]
        zeros, ends = jnp.zeros(len(legs.rows)), own.limit_values()
        for k, name in at:
            joints = zeros.at[k].set(getattr(ends, name)[k])
            walls.append(own.constraints(pose, joints)[legs.rows[k]])
        return jnp.stack(walls)

    return function


def _finite(end: float) -> bool:
    return bool(np.isfinite(end))


def _reach(robot: Mechanism, legs: Legs, pose: Array, k: int) -> Array:
    """Returns a leg's discriminant, or its coefficient where its joint enters linearly: positive where it reaches."""
    zeros = jnp.zeros(len(legs.rows))

    def along(value: Array) -> Array:
        return robot.constraints(pose, zeros.at[k].set(value))[legs.rows[k]]

    def slope(value: Array) -> tuple[Array, Array]:
        return jax.jvp(along, (value,), (jnp.ones(()),))

    (f, first), (_, second) = jax.jvp(slope, (jnp.zeros(()),), (jnp.ones(()),))
    if legs.kinds[k] == LegKind.LINEAR:
        return first
    return first * first - (2 * second * f if legs.kinds[k] == LegKind.QUADRATIC else f * (f + 2 * second))
