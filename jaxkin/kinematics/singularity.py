"""How far from singular: determinant, smallest singular value, condition number."""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.kinematics.boundary import checked_configuration
from jaxkin.kinematics.jacobian import raw_jacobians
from jaxkin.numerics import singular_values, small_linalg
from jaxkin.numerics.fusion import reciprocal
from jaxkin.numerics.implicit import solve_linear

Coordinates: TypeAlias = tuple[Array, ...]
#: Rows of a matrix of which each entry is an array, or a number.
Entries: TypeAlias = Sequence[Sequence[Array]]


class Conditioning(NamedTuple):
    """Measures of one configuration.

    Attributes:
        determinant: det dF/dpose, in the units of the equations.
        smallest_singular_value: Of dq/dx = -B^-1 A after scaling by the characteristic length; this is
            the *clearance*: 0 at a parallel singularity, infinite at a serial one.
        inverse_condition_number: Smallest over largest singular value, 1 where isotropic.
    """

    determinant: Array
    smallest_singular_value: Array
    inverse_condition_number: Array


def conditioning(robot: Mechanism, pose: ArrayLike, joints: ArrayLike) -> Conditioning:
    """Measures the distance from singularities at one configuration.

    Rates are made comparable by ``robot.characteristic_length()``: poses and joints are measured in that
    length and in radians, and refer to the mechanism's own operation point.

    Args:
        robot: The mechanism.
        pose: ``(n_pose,)``.
        joints: ``(n_joint,)``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Wrong shapes.
    """
    return _conditioning(robot, *checked_configuration("jk.conditioning", robot, pose, joints))


@jax.jit
def _conditioning(robot: Mechanism, pose: Array, joints: Array) -> Conditioning:
    return raw_conditioning(robot, pose, joints)


def raw_conditioning(robot: Mechanism, pose: Array, joints: Array) -> Conditioning:
    """Returns the measures without checks, for use inside other kernels."""
    return elementwise_conditioning(robot, tuple(pose), tuple(joints))


def elementwise_conditioning(robot: Mechanism, pose: Coordinates, joints: Coordinates) -> Conditioning:
    """Returns the measures for coordinates that are arrays of broadcastable shapes."""
    direct, rates = _direct_and_rates(robot, pose, joints)
    length = robot.characteristic_length()
    pose_units, joint_units = (scale_vector(axes, length) for axes in (robot.pose_axes, robot.joint_axes))
    scaled = [[r * (pose_units[j] / joint_units[i]) for j, r in enumerate(row)] for i, row in enumerate(rates)]
    smallest, largest = singular_values.extremes(scaled)
    return Conditioning(_determinant(direct), smallest, smallest / largest)


def elementwise_determinant(robot: Mechanism, pose: Coordinates, joints: Coordinates) -> Array:
    """Returns det dF/dpose alone, likewise."""
    return _determinant(_direct_and_rates(robot, pose, joints)[0])


def _direct_and_rates(robot: Mechanism, pose: Coordinates, joints: Coordinates) -> tuple[Entries, Entries]:
    """Returns the rows of dF/dpose, and those of dq/dx = -B^-1 A."""
    if robot.jacobian_kernel is not None:
        direct, diagonal = robot.jacobian_kernel(pose, joints)
        slower = [-reciprocal(jnp.asarray(entry, float)) for entry in diagonal]
        return direct, [[entry * factor for entry in row] for row, factor in zip(direct, slower, strict=True)]
    shape = jnp.broadcast_shapes(*(jnp.shape(a) for a in (*pose, *joints)))
    vectors = [jnp.stack([jnp.broadcast_to(a, shape).reshape(-1) for a in group]) for group in (pose, joints)]
    matrices = jax.vmap(lambda x, q: _matrices(robot, x, q), in_axes=1)(*vectors)
    n = len(pose)
    direct, rates = ([[m[:, i, j].reshape(shape) for j in range(n)] for i in range(n)] for m in matrices)
    return direct, rates


def _matrices(robot: Mechanism, pose: Array, joints: Array) -> tuple[Array, Array]:
    direct, inverse = raw_jacobians(robot, pose, joints)
    return direct, jax.vmap(lambda column: solve_linear(inverse, column), in_axes=1, out_axes=1)(-direct)


def _determinant(rows: Entries) -> Array:
    if len(rows) <= small_linalg.LARGEST_EXPANDED:
        return small_linalg.expanded_rows(rows)
    shape = jnp.broadcast_shapes(*(jnp.shape(entry) for row in rows for entry in row))
    full = tuple(tuple(jnp.broadcast_to(entry, shape) for entry in row) for row in rows)
    return jnp.linalg.det(small_linalg.stacked(full))
