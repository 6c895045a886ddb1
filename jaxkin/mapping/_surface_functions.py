"""What vanishes on singular surfaces: factors of the determinant, or itself in every working mode, or a leg's reach."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.branches import stack_lanes
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.kinematics.jacobian import raw_jacobians
from jaxkin.kinematics.legs import LegKind, Legs, leg_discriminants, leg_joints
from jaxkin.kinematics.solve import inside_limits, inverse_lanes
from jaxkin.mapping.batch import in_blocks
from jaxkin.mapping.chart import factor_names
from jaxkin.numerics import bracket
from jaxkin.numerics.small_linalg import expanded_determinant

#: Poses that one compiled call takes; shorter calls are padded, so that nothing is compiled twice.
_BLOCK = 1 << 13

#: Factors of det A; det A along the closed inverse kinematics; det A leg by leg; squares of the legs' entries of B.
FACTORS, LANES, LEGS, SERIAL = "factors", "lanes", "legs", "serial"


class Functions(NamedTuple):
    """Which functions of the pose vanish on the surfaces; hashable, compiled for.

    Attributes:
        source: FACTORS, LANES, LEGS or SERIAL.
        legs: How the equations hold the joints, None where working modes are no sign vectors.
    """

    source: str
    legs: Legs | None

    @property
    def smooth(self) -> bool:
        """True for functions that are polynomials of the pose, everywhere."""
        return self.source in (FACTORS, SERIAL)

    @property
    def folding(self) -> tuple[int, ...]:
        """The legs that can be stretched or folded."""
        assert self.legs is not None
        return tuple(
            k
            for k, (kind, signs) in enumerate(zip(self.legs.kinds, self.legs.signs, strict=True))
            if kind != LegKind.LINEAR and len(signs) > 1
        )

    def names(self, robot: Mechanism, count: int) -> list[str]:
        """Returns the surfaces' names."""
        if self.source == FACTORS:
            return list(factor_names(robot))
        if self.source == SERIAL:
            return [f"det B, leg {k + 1}" for k in self.folding]
        if count == 1:
            return ["det"]
        if self.source == LEGS and self.legs is not None:
            return [f"det, working mode {''.join('+' if s > 0 else '-' for s in mode)}" for mode in self.legs.modes]
        return [f"det, working mode {k}" for k in range(count)]


def rows_in_blocks(function: Callable[..., Array], *columns: np.ndarray) -> np.ndarray:
    """Calls a compiled function on blocks of rows; results have the rows last."""
    return in_blocks(function, *columns, block=_BLOCK, axis=-1)


class _Determinant(NamedTuple):
    value: Array
    residual: Array
    volume: Array


def _modes(robot: Mechanism, functions: Functions, poses: Array) -> tuple[Array, Array]:
    """Returns the joints of every working mode ``(n, modes, n_joint)``, and which of them are there."""
    if functions.source == LANES:
        branches = stack_lanes(inverse_lanes(robot, tuple(poses[:, k] for k in range(poses.shape[1]))))
        return branches.values, branches.valid
    legs = functions.legs
    assert legs is not None

    def one(pose: Array) -> tuple[Array, Array]:
        signs = jnp.asarray(legs.modes, float)
        joints = jax.vmap(lambda mode: leg_joints(robot, legs, mode, pose))(signs)
        inside = inside_limits(robot, tuple(joints[:, k] for k in range(joints.shape[1])))
        return joints, inside & jnp.all(leg_discriminants(robot, legs, pose) >= 0)

    return jax.vmap(one)(poses)


def _determinants(robot: Mechanism, functions: Functions, poses: Array) -> _Determinant:
    """Measures det dF/dpose in every working mode, ``(modes, n)``: as it is, over its scale, over its rows' lengths."""
    unit = scale_vector(robot.pose_axes, robot.characteristic_length())

    def one(pose: Array, joints: Array, here: Array) -> _Determinant:
        direct = raw_jacobians(robot, pose, joints).direct * unit
        value = expanded_determinant(direct)
        scale = jnp.prod(robot.constraint_scales(pose, joints))
        lengths = jnp.prod(jnp.linalg.norm(direct, axis=1))
        volume = jnp.where(lengths > 0, value / jnp.where(lengths > 0, lengths, 1.0), 0.0)
        return _Determinant(*(jnp.where(here, x, jnp.nan) for x in (value, jnp.abs(value) / scale, jnp.abs(volume))))

    per_mode = jax.vmap(one, in_axes=(None, 0, 0))
    return jax.vmap(per_mode, out_axes=1)(poses, *_modes(robot, functions, poses))


def smooth_values(robot: Mechanism, functions: Functions, pose: Array) -> Array:
    """Returns the functions of a pose, ``(n_surface,)``, where they are smooth."""
    if functions.source == FACTORS:
        return jnp.stack(list(robot.factors(pose).values()))  # type: ignore[attr-defined]
    assert functions.legs is not None
    return leg_discriminants(robot, functions.legs, pose)[jnp.array(functions.folding)]


def _value_rows(robot: Mechanism, functions: Functions, poses: Array) -> Array:
    if not functions.smooth:
        return _determinants(robot, functions, poses).value
    rows = jax.vmap(lambda pose: smooth_values(robot, functions, pose), out_axes=1)(poses)
    if functions.source == FACTORS:
        return rows
    # Where another leg does not reach there is no pose.
    short = (rows < 0).astype(int)
    return jnp.where(jnp.sum(short, axis=0) - short > 0, jnp.nan, rows)


@partial(jax.jit, static_argnames="functions")
def values(robot: Mechanism, functions: Functions, poses: Array) -> Array:
    """Returns every function at many poses, ``(n_surface, n)``; NaN where there is none."""
    return _value_rows(robot, functions, poses)


@partial(jax.jit, static_argnames="functions")
def volumes(robot: Mechanism, functions: Functions, poses: Array) -> Array:
    """Returns |det dF/dpose| over the product of its rows' lengths in every working mode, ``(modes, n)``."""
    return _determinants(robot, functions, poses).volume


@partial(jax.jit, static_argnames="functions")
def edge_zeros(robot: Mechanism, functions: Functions, number: Array, start: Array, end: Array, sign: Array) -> Array:
    """Returns the poses ``(n_pose, n)`` at which the surface meets the segments from start to end.

    Args:
        robot: The mechanism.
        functions: What vanishes.
        number: ``(n,)`` which surface.
        start: ``(n, n_pose)``.
        end: ``(n, n_pose)``.
        sign: ``(n,)`` sign of the value at the start; a value lost in rounding may show another one.
    """
    rows = jnp.arange(len(start))

    def along(t: Array) -> Array:
        return _value_rows(robot, functions, start + t[:, None] * (end - start))[number, rows]

    def size(t: float) -> Array:
        return jnp.maximum(jnp.abs(along(jnp.full(len(start), t))), jnp.finfo(float).tiny)

    t = bracket.zero(along, sign * size(0.0), -sign * size(1.0))
    return (start + t[:, None] * (end - start)).T


@partial(jax.jit, static_argnames="functions")
def residuals(robot: Mechanism, functions: Functions, poses: Array) -> Array:
    """Returns the dimensionless residuals ``(n_surface, n)`` that ``singular_surfaces`` defines."""
    if not functions.smooth:
        return _determinants(robot, functions, poses).residual
    unit = scale_vector(robot.pose_axes, robot.characteristic_length())
    is_length = jnp.array([not axis.is_angle for axis in robot.pose_axes])

    def one(pose: Array) -> Array:
        step = jnp.where(is_length, unit + jnp.abs(pose), 1.0)
        function = partial(smooth_values, robot, functions)
        first = jax.jacfwd(function)(pose) * step
        second = jnp.diagonal(jax.jacfwd(jax.jacfwd(function))(pose), axis1=1, axis2=2) * step**2
        scale = jnp.sum(jnp.abs(first) + jnp.abs(second), axis=1)
        value = jnp.abs(function(pose))
        return jnp.where(value == 0, 0.0, value / scale)

    return jax.vmap(one, out_axes=1)(poses)


@partial(jax.jit, static_argnames="functions")
def joints_of(robot: Mechanism, functions: Functions, number: Array, poses: Array) -> Array:
    """Returns the joints of poses of one surface, ``(n_joint, n)``: in its working mode, else in the first one.

    Joint limits cut no surface of a factor; NaN where a leg does not reach.
    """
    if functions.source in (LANES, LEGS):
        return _modes(robot, functions, poses)[0][jnp.arange(len(poses)), number].T
    if functions.legs is None:
        return _first_joints(robot, poses)
    legs = functions.legs

    def one(pose: Array) -> Array:
        discriminants = leg_discriminants(robot, legs, pose)
        joints = leg_joints(robot, legs, jnp.asarray(legs.modes[0], float), pose)
        # Of a stretched leg rounding may say that it does not reach.
        short = discriminants < -1e-9 * jnp.max(jnp.abs(discriminants))
        return jnp.where(jnp.any(short), jnp.nan, joints)

    return jax.vmap(one, out_axes=1)(poses)


def _first_joints(robot: Mechanism, poses: Array) -> Array:
    if robot.inverse_kernel is None:
        return jnp.full((len(robot.joint_axes), len(poses)), jnp.nan)
    lanes = robot.inverse_kernel(tuple(poses[:, k] for k in range(poses.shape[1])))
    return jnp.stack(lanes[0].values)
