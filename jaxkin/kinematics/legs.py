"""Working modes, leg by leg, from the constraints alone.

In most parallel robots every equation holds one joint (B = dF/djoints is diagonal, up to the order of the equations),
and holds it in one of three ways: linearly, as a quadratic polynomial, or through its sine and cosine. The joint of a
pose then follows in closed form, up to one sign a leg, and that sign is the sign of the leg's entry of B: the working
mode is the vector of these signs, and two sheets of the inverse kinematics meet only where det B = 0.
"""

import itertools
from dataclasses import dataclass
from enum import IntEnum

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.numerics.newton import lattice

#: Relative misses of a form that are rounding, and differences of constants.
_FITS, _SAME = 1e-9, 1e-12


class LegKind(IntEnum):
    """How an equation holds its joint."""

    LINEAR = 0
    QUADRATIC = 1
    TRIGONOMETRIC = 2


@dataclass(frozen=True)
class Legs:
    """How the equations hold the joints; hashable, so that one compilation serves all numbers.

    Attributes:
        rows: The equation that holds each joint.
        kinds: How it does.
        signs: Which signs the entry of B of each joint can have within the joint's limits: of a leg of length rho,
            |B - A|^2 - rho^2, only -1, as rho >= 0. Both where the poses decide it.
    """

    rows: tuple[int, ...]
    kinds: tuple[LegKind, ...]
    signs: tuple[tuple[int, ...], ...]

    @property
    def modes(self) -> tuple[tuple[int, ...], ...]:
        """All working modes: one sign a leg."""
        return tuple(itertools.product(*self.signs))


def legs_of(robot: Mechanism) -> Legs | None:
    """Finds how a mechanism's equations hold its joints, from values and derivatives at a few points.

    The constraints are polynomial in lengths, sines and cosines: what holds at points in general position holds
    everywhere.

    Returns:
        The legs; None where an equation holds several joints, a joint stands in several equations, or in none of the
        three ways: working modes are then no sign vectors.
    """
    slopes, misses, bends, vertices = (np.asarray(part) for part in _probed(robot))
    size = np.max(np.abs(slopes), axis=(0, 2))
    involved = np.max(np.abs(slopes), axis=0) > 1e-13 * size[:, None]
    if not (np.all(involved.sum(axis=0) == 1) and np.all(involved.sum(axis=1) == 1)):
        return None
    rows = tuple(int(row) for row in np.argmax(involved, axis=0))
    kinds, signs = [], []
    limits = robot.limit_values()
    for k, row in enumerate(rows):
        fits = misses[:, :, row, k].max(axis=0) <= _FITS
        if not fits.any():
            return None
        kind = LegKind(int(np.argmax(fits)))
        kinds.append(kind)
        signs.append(_signs(kind, bends[:, row, k], vertices[:, row, k], slopes[:, row, k], limits, robot, k))
    return Legs(rows, tuple(kinds), tuple(signs))


def _signs(kind, bends, vertices, slopes, limits, robot, k) -> tuple[int, ...]:  # type: ignore[no-untyped-def]
    """Returns the signs that a leg's entry of B can have within the limits, as far as all poses agree on it."""
    if kind == LegKind.LINEAR:
        return (int(np.sign(slopes[0])),) if _constant(slopes) else (1, -1)
    unit = 1.0 if robot.joint_axes[k].is_angle else float(robot.characteristic_length())
    if kind == LegKind.QUADRATIC and _constant(bends) and np.ptp(vertices) <= _SAME * unit:
        axis = robot.joint_axes[k]
        low, high = max(float(limits.low[k]), axis.low), min(float(limits.high[k]), axis.high)
        slack = _SAME * unit
        if low >= vertices[0] - slack:
            return (int(np.sign(bends[0])),)
        if high <= vertices[0] + slack:
            return (-int(np.sign(bends[0])),)
    return (1, -1)


def _constant(values: np.ndarray) -> bool:
    return bool(np.ptp(values) <= _SAME * np.max(np.abs(values)))


@jax.jit
def _probed(robot: Mechanism) -> tuple[Array, Array, Array, Array]:
    """Probes the equations at three points.

    Returns:
        dF/dq ``(3, n, n)``; by how much each of the three forms misses, ``(3, 3, n, n)`` with the form second,
        relative; second derivatives in each joint ``(3, n, n)``; and the joint values at which a quadratic form has
        its vertex ``(3, n, n)``.
    """
    n, length = len(robot.pose_axes), robot.characteristic_length()
    points = jnp.asarray(lattice(3, 2 * n) + 0.5)
    poses = points[:, :n] * scale_vector(robot.pose_axes, length)
    unit = scale_vector(robot.joint_axes, length)
    joints = points[:, n:] * unit

    def one(pose: Array, q: Array) -> tuple[Array, Array, Array, Array]:
        slope = jax.jacfwd(robot.constraints, argnums=1)(pose, q)
        columns = [_column(robot, pose, k, unit[k]) for k in range(n)]
        misses, bends, vertices = (jnp.stack(part, axis=-1) for part in zip(*columns, strict=True))
        return slope, misses, bends, vertices

    return jax.vmap(one)(poses, joints)


def _column(robot: Mechanism, pose: Array, k: int, unit: Array) -> tuple[Array, Array, Array]:
    """Returns misses of the three forms ``(3, n)``, bends and vertices ``(n,)`` of all equations along joint k."""
    f, first, second = _expansion(robot, pose, k)
    values = jnp.array([0.7, -1.3, 2.1]) * unit
    exact = jax.vmap(lambda v: _along(robot, pose, k, v))(values)
    v = values[:, None]
    linear = f + first * v
    forms = jnp.stack([linear, linear + 0.5 * second * v**2, f + first * jnp.sin(v) + second * (1 - jnp.cos(v))])
    # Against the change along the joint, not the constant, beside which a small quadratic term would not show; the
    # constant's rounding is no miss.
    rounding = 64 * jnp.finfo(float).eps * (jnp.max(jnp.abs(exact), axis=0) + jnp.abs(f))
    change = jnp.max(jnp.abs(exact - f), axis=0) + 1e-300
    return (
        jnp.maximum(jnp.max(jnp.abs(forms - exact), axis=1) - rounding, 0.0) / change,
        second,
        -first / jnp.where(second == 0, 1.0, second),
    )


def _along(robot: Mechanism, pose: Array, k: int, value: Array) -> Array:
    """Returns all equations with one joint at a value and the others at zero."""
    return robot.constraints(pose, jnp.zeros(len(robot.joint_axes)).at[k].set(value))


def _expansion(robot: Mechanism, pose: Array, k: int) -> tuple[Array, Array, Array]:
    """Returns value, first and second derivative of all equations in joint k, at zero."""

    def slope(v: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda v: _along(robot, pose, k, v), (v,), (jnp.ones(()),))

    (f, first), (_, second) = jax.jvp(slope, (jnp.zeros(()),), (jnp.ones(()),))
    return f, first, second


def leg_discriminants(robot: Mechanism, legs: Legs, pose: Array) -> Array:
    """Returns the squares of the entries of B at a pose, ``(n_joint,)``: polynomials in pose, sines and cosines.

    A leg reaches the pose where its discriminant is not negative, and is stretched or folded (det B = 0) where it is
    zero. In the units of the equation over the joint, squared.
    """
    return jnp.stack([_solved(robot, legs, k, pose)[0] for k in range(len(legs.rows))])


def leg_joints(robot: Mechanism, legs: Legs, signs: Array, pose: Array) -> Array:
    """Returns the joints of a pose in one working mode, ``(n_joint,)``, angles in [-pi, pi).

    Args:
        robot: The mechanism.
        legs: Its legs.
        signs: ``(n_joint,)`` the working mode.
        pose: ``(n_pose,)``.

    Where a leg does not reach, its discriminant is taken as zero: test ``leg_discriminants``. A linear leg has one
    joint value, whatever the sign. Differentiable where all discriminants are positive.
    """
    return jnp.stack([_solved(robot, legs, k, pose)[1](signs[k]) for k in range(len(legs.rows))])


def _solved(robot: Mechanism, legs: Legs, k: int, pose: Array):  # type: ignore[no-untyped-def]
    """Returns the discriminant of leg k and a function from its sign to its joint."""
    row, kind = legs.rows[k], legs.kinds[k]
    f, first, second = (part[row] for part in _expansion(robot, pose, k))
    if kind == LegKind.LINEAR:
        return first * first, lambda sign: -f / first
    if kind == LegKind.QUADRATIC:
        discriminant = first * first - 2 * second * f

        def root(sign: Array) -> Array:
            size = _root_or_zero(discriminant)
            # The sum that does not cancel: q = (s sqrt(D) - b) / 2a, or -2c / (s sqrt(D) + b).
            away = (sign * first <= 0) | ~(discriminant > 0)
            denominator = jnp.where(away, second, sign * size + first)
            safe = jnp.where(denominator == 0, 1.0, denominator)
            return jnp.where(away, sign * size - first, -2 * f) / safe

        return discriminant, root
    constant, cosine, sine = f + second, -second, first
    radius = cosine * cosine + sine * sine
    discriminant = radius - constant * constant

    def angle(sign: Array) -> Array:
        size = sign * _root_or_zero(discriminant)
        turn = jnp.arctan2(-constant * sine - size * cosine, -constant * cosine + size * sine)
        return jnp.where(turn >= jnp.pi, -jnp.pi, turn)

    return discriminant, angle


def _root_or_zero(square: Array) -> Array:
    """Returns the square root, 0 where there is none, there with the derivative 0: of sqrt(0) it would be NaN."""
    there = square > 0
    return jnp.where(there, jnp.sqrt(jnp.where(there, square, 1.0)), 0.0)


def working_mode(robot: Mechanism, legs: Legs, pose: Array, joints: Array) -> Array:
    """Returns the signs of the entries of B at a configuration, ``(n_joint,)``; 0 where det B = 0."""
    inverse = jax.jacfwd(robot.constraints, argnums=1)(pose, joints)
    return jnp.sign(jnp.stack([inverse[row, k] for k, row in enumerate(legs.rows)]))
