"""All assembly modes as positions and rotation matrices: no angles, no gimbal lock."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.branches import stack_lanes
from jaxkin.core.errors import InputError, Status
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.boundary import as_tuple, checked_mechanism, checked_vector
from jaxkin.kinematics.solve import frame_lanes
from jaxkin.numerics import rotations
from jaxkin.numerics.implicit import attach_derivatives


class Frames(NamedTuple):
    """All assembly modes of one set of joints as positions and rotation matrices.

    Attributes:
        position: ``(n_branch, 3)``.
        rotation: ``(n_branch, 3, 3)``.
        valid: ``(n_branch,)``.
        status: ``(n_branch,)`` codes of ``Status``.
        multiplicity: ``(n_branch,)``.
    """

    position: Array
    rotation: Array
    valid: Array
    status: Array
    multiplicity: Array


def forward_frames(robot: Mechanism, joints: ArrayLike) -> Frames:
    """Finds all assembly modes of a spatial robot as positions and rotation matrices.

    Lanes, statuses, limits and derivatives are those of ``jk.forward``: a regular mode can be differentiated to any
    order; a singular one has the derivative NaN in forward mode, zero in reverse mode, and spoils no other.

    Args:
        robot: A mechanism with ``frame_kernel`` and ``closure``, as the 3-PPPS.
        joints: ``(n_joint,)``; use ``jax.vmap`` for many.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The joints are not ``n_joint`` numbers, or the mechanism gives no frames.
    """
    checked_mechanism("jk.forward_frames", robot)
    if robot.frame_kernel is None:
        raise InputError(
            f"jk.forward_frames: {type(robot).__name__} has no frame_kernel, which gives poses as position and "
            "rotation matrix (the 3-PPPS has): use jk.forward."
        )
    return _frames(robot, checked_vector("jk.forward_frames", "the joints", joints, robot.joint_axes))


@jax.jit
def _frames(robot: Mechanism, joints: Array) -> Frames:
    still, q = jax.lax.stop_gradient((robot, joints))
    found = stack_lanes(frame_lanes(still, as_tuple(q)))
    lanes = found.valid.shape[0]
    regular = found.valid & (found.status != Status.SINGULAR)
    known = jnp.where(found.valid[:, None, None], found.values[:, 3:].reshape(lanes, 3, 3), jnp.eye(3))
    solved = jnp.concatenate([found.values[:, :3], jnp.zeros((lanes, 3))], axis=1)
    given = jnp.where(jnp.isfinite(joints), joints, 1.0)
    moved = jax.vmap(lambda u, m, ok, here: attach_derivatives(_residual, u, (robot, given, m), ok, here))(
        solved, known, regular, found.valid
    )
    matrix = jax.vmap(lambda u, m: _turned(u[3:], m))(moved, known)
    matrix = jnp.where(found.valid[:, None, None], matrix, jnp.nan)
    return Frames(moved[:, :3], matrix, found.valid, found.status, found.multiplicity)


def _turned(vector: Array, matrix: Array) -> Array:
    """Returns a rotation turned about ``vector`` by the angle 2 atan(|vector| / 2): smooth coordinates around it."""
    one = jnp.ones(())
    small = rotations.matrix_from_quaternion((one, vector[0] / 2, vector[1] / 2, vector[2] / 2))
    return rotations.as_array(small) @ matrix


def _residual(moved: Array, theta: tuple[Any, Array, Array]) -> Array:
    robot, joints, matrix = theta
    return robot.closure(moved[:3], rotations.from_array(_turned(moved[3:], matrix)), joints)
