"""How far from singular: determinant, smallest singular value, condition number."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.kinematics.boundary import checked_configuration
from jaxkin.kinematics.jacobian import raw_jacobians
from jaxkin.numerics import small_linalg
from jaxkin.numerics.implicit import solve_linear


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
    direct, inverse = raw_jacobians(robot, pose, joints)
    length = robot.characteristic_length()
    rates = jax.vmap(lambda column: solve_linear(inverse, column), in_axes=1, out_axes=1)(-direct)
    rates = rates * scale_vector(robot.pose_axes, length)[None] / scale_vector(robot.joint_axes, length)[:, None]
    if rates.shape == (3, 3):
        rows = tuple(tuple(rates[i, j] for j in range(3)) for i in range(3))
        smallest, largest = small_linalg.singular_extremes(rows)  # type: ignore[arg-type]
        matrix = tuple(tuple(direct[i, j] for j in range(3)) for i in range(3))
        determinant = small_linalg.determinant(matrix)  # type: ignore[arg-type]
    else:
        singular_values = jnp.linalg.svd(rates, compute_uv=False)
        smallest, largest = singular_values[-1], singular_values[0]
        determinant = small_linalg.any_determinant(direct)
    return Conditioning(determinant, smallest, smallest / largest)
