"""Constraints and their Jacobians, by autodiff from the equations alone."""

from typing import NamedTuple

import jax
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.boundary import checked_configuration


class Jacobians(NamedTuple):
    """The two Jacobians of the constraints: direct dx + inverse dq = 0.

    Attributes:
        direct: A = dF/dpose, ``(n, n)``; singular at type-2 (parallel) singularities.
        inverse: B = dF/djoints, ``(n, n)``; singular at type-1 (serial) singularities.
    """

    direct: Array
    inverse: Array


def constraints(robot: Mechanism, pose: ArrayLike, joints: ArrayLike) -> Array:
    """Returns the residuals F(pose, joints) of the mechanism's equations, ``(n,)``, in their own units.

    Args:
        robot: The mechanism.
        pose: ``(n_pose,)``.
        joints: ``(n_joint,)``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Wrong shapes.
    """
    return _constraints(robot, *checked_configuration("jk.constraints", robot, pose, joints))


def jacobians(robot: Mechanism, pose: ArrayLike, joints: ArrayLike) -> Jacobians:
    """Returns the direct and the inverse Jacobian of the constraints.

    Args:
        robot: The mechanism.
        pose: ``(n_pose,)``.
        joints: ``(n_joint,)``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Wrong shapes.

    References:
        Gosselin, C. and Angeles, J., 1990, "Singularity analysis of closed-loop kinematic chains".
    """
    return _jacobians(robot, *checked_configuration("jk.jacobians", robot, pose, joints))


def margins(robot: Mechanism, pose: ArrayLike, joints: ArrayLike) -> dict[str, Array]:
    """Returns the signed distance to every limit, one named entry each; negative is a violation."""
    configuration = checked_configuration("jk.margins", robot, pose, joints)
    # Not compiled: a dict that comes out of jit has its keys sorted.
    return robot.margins(*configuration)


@jax.jit
def _constraints(robot: Mechanism, pose: Array, joints: Array) -> Array:
    return robot.constraints(pose, joints)


@jax.jit
def _jacobians(robot: Mechanism, pose: Array, joints: Array) -> Jacobians:
    return raw_jacobians(robot, pose, joints)


def raw_jacobians(robot: Mechanism, pose: Array, joints: Array) -> Jacobians:
    """Returns the Jacobians without checks, for use inside other kernels."""
    direct, inverse = jax.jacfwd(robot.constraints, argnums=(0, 1))(pose, joints)
    return Jacobians(direct, inverse)
