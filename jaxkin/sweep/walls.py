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
from jaxkin.kinematics.solve import inverse_lanes
from jaxkin.numerics.newton import lattice
from jaxkin.numerics.small_linalg import any_determinant


@dataclass(frozen=True, eq=False)
class Walls:
    """What bounds the labels of a field.

    Attributes:
        function: ``(mechanism, coordinates (n,)) -> (m,)``: on any connected set within the limits on which none of
            them vanishes, the label is one. Walls too many cost proofs, never their truth.
        always: So many of the first walls count everywhere.
        inner: So many of the last walls are positive inside: where one of them is negative the label is one
            (a joint is beyond its limit), whatever the others do but for the first ones.
        low: ``(n,)`` lower limits of the coordinates, inclusive; None where there are none.
        high: ``(n,)`` upper ones. Outside of them the label is one as well.
    """

    function: Callable[[Mechanism, Array], Array]
    always: int = 0
    inner: int = 0
    low: np.ndarray | None = None
    high: np.ndarray | None = None


def count_walls(robot: Mechanism) -> Walls | None:
    """Returns the walls of the number of assembly modes, None where the mechanism declares none."""
    if robot.count_walls is None:
        return None
    limits = robot.limit_values()
    low, high = np.asarray(limits.low, float), np.asarray(limits.high, float)
    return Walls(lambda own, joints: own.count_walls(joints), low=low, high=high)  # type: ignore[misc]


def inverse_walls(robot: Mechanism) -> Walls | None:
    """Returns the walls of the statuses of the working modes: reach of the legs, and joint limits."""
    legs = _closed_legs(robot)
    return None if legs is None else _sheet(robot, legs, lambda own, pose: [])


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
        return _sheet(robot, legs, lambda own, pose: _declared(own, pose, names))
    if _hangs_on_joints(robot):
        return None
    return _sheet(robot, legs, _determinant)


def _closed_legs(robot: Mechanism) -> Legs | None:
    """Returns how the equations hold the joints, where a closed form gives the one working mode.

    None where a search finds working modes, which may fail, and where there are several: what orders them may change
    where no wall is.
    """
    if robot.inverse_kernel is None:
        return None
    pose = tuple(jax.ShapeDtypeStruct((), float) for _ in robot.pose_axes)
    return legs_of(robot) if len(jax.eval_shape(inverse_lanes, robot, pose)) == 1 else None


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


def _sheet(robot: Mechanism, legs: Legs, singular: Callable[[Mechanism, Array], list[Array]]) -> Walls:
    """Returns where a leg ceases to reach, then singular walls, then where a joint meets a finite limit.

    The equation of a leg holds one joint: with that joint at its limit it vanishes where the working mode meets the
    limit. Of a leg of one sign the equation rises or falls with the joint, which says on which side it is.
    """
    limits = robot.limit_values()
    ends = [(name, np.isfinite(np.asarray(getattr(limits, name)))) for name in ("low", "high")]
    at = [(k, name) for name, finite in ends for k in np.flatnonzero(finite).tolist()]
    # An angle jumps over its limit where its turn ends as well; and it may lie on either side of both.
    turning = [k for k in dict(at) if legs.kinds[k] == LegKind.TRIGONOMETRIC]
    sided = [which for which in at if which[0] not in turning and len(legs.signs[which[0]]) == 1]
    free = [which for which in at if which not in sided]

    def function(own: Mechanism, pose: Array) -> Array:
        limits, zeros = own.limit_values(), jnp.zeros(len(legs.rows))

        def equation(k: int, value: Array | float) -> Array:
            return own.constraints(pose, zeros.at[k].set(value))[legs.rows[k]]

        walls = [_reach(own, legs, pose, k) for k in range(len(legs.rows))]
        walls += singular(own, pose)
        walls += [equation(k, np.pi) for k in turning]
        walls += [equation(k, getattr(limits, name)[k]) for k, name in free]
        walls += [
            (-1 if name == "low" else 1) * legs.signs[k][0] * equation(k, getattr(limits, name)[k]) for k, name in sided
        ]
        return jnp.stack(walls)

    return Walls(function, always=len(legs.rows), inner=len(sided))


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
