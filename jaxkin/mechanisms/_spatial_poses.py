"""Poses (x, y, z, phi, theta, sigma) of spatial robots as position with rotation matrix, or with quaternion.

R = Rx(phi) Ry(theta) Rz(sigma). Conversions are safe at gimbal lock, where the 3-PPPS is singular.
"""

import math

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import as_reals
from jaxkin.core.tracing import is_traced
from jaxkin.numerics import rotations


def checked_pose_vector(what: str, value: ArrayLike) -> Array:
    """Returns six numbers as an array, or says what is wrong with them."""
    array = as_reals(value)
    if array is None:
        raise InputError(f"The {what} is {value!r}: it must be six real numbers, shape (6,); for a batch use jax.vmap.")
    if array.shape != (6,):
        raise InputError(f"The shape of the {what} is {array.shape}: it must be (6,); for a batch use jax.vmap.")
    return array


def _reals(what: str, value: ArrayLike) -> Array:
    array = as_reals(value)
    if array is None:
        raise InputError(f"The {what} is {value!r}: it must be real numbers, without text, None or gaps.")
    return array


def position_and_rotation(pose: ArrayLike) -> tuple[Array, Array]:
    """Returns the position ``(3,)`` and the rotation matrix ``(3, 3)`` of a pose; ``jax.vmap`` for many."""
    pose = checked_pose_vector("pose", pose)
    return pose[:3], rotations.as_array(rotations.matrix_from_xyz(pose[3], pose[4], pose[5]))


def position_and_quaternion(pose: ArrayLike) -> tuple[Array, Array]:
    """Returns the position ``(3,)`` and the unit quaternion ``(4,)`` (w, x, y, z), w >= 0, of a pose."""
    position, matrix = position_and_rotation(pose)
    return position, jnp.stack(rotations.quaternion_from_matrix(rotations.from_array(matrix)))


#: How far R^T R may be from the identity, or a quaternion from unit length, to be taken for rounding.
_ROTATION_TOLERANCE = 1e-9


def pose_from_rotation(position: ArrayLike, rotation: ArrayLike) -> Array:
    """Returns the pose ``(6,)`` of a position and a rotation matrix ``(3, 3)``.

    Safe at gimbal lock, where sigma = 0 (the 3-PPPS is singular there).

    Raises:
        InputError: No numbers, wrong shapes, or not a rotation: R^T R is not the identity, or it is a reflection
            (not checked under tracing).
    """
    position, matrix = _reals("position", position), _reals("rotation", rotation)
    if position.shape != (3,) or matrix.shape != (3, 3):
        raise InputError(
            f"The position has shape {position.shape} and the rotation {matrix.shape}: they must be (3,) and (3, 3); "
            "for a batch use jax.vmap."
        )
    if not is_traced(matrix):
        off = float(jnp.max(jnp.abs(matrix.T @ matrix - jnp.eye(3))))
        if not off <= _ROTATION_TOLERANCE or float(jnp.linalg.det(matrix)) < 0:
            what = "it is a reflection (det = -1)" if off <= _ROTATION_TOLERANCE else f"R^T R is off by {off:.2g}"
            raise InputError(f"The matrix is no rotation: {what}; orthonormalise it, or give a quaternion.")
    return jnp.concatenate([position, jnp.stack(rotations.xyz_from_matrix(rotations.from_array(matrix)))])


def pose_from_quaternion(position: ArrayLike, quaternion: ArrayLike) -> Array:
    """Returns the pose ``(6,)`` of a position and a quaternion ``(4,)`` (w, x, y, z), which is normalised.

    Raises:
        InputError: No numbers, wrong shapes, or a quaternion that is not finite or zero (not checked under tracing).
    """
    position, q = _reals("position", position), _reals("quaternion", quaternion)
    if position.shape != (3,) or q.shape != (4,):
        raise InputError(
            f"The position has shape {position.shape} and the quaternion {q.shape}: they must be (3,) and (4,), "
            "(w, x, y, z); for a batch use jax.vmap."
        )
    largest = jnp.max(jnp.abs(q))
    if not is_traced(q) and not 0 < float(largest) < math.inf:
        raise InputError(f"The quaternion is {q.tolist()}: it must be finite and not zero.")
    # The squares of a quaternion of any length must neither overflow nor vanish.
    q = q / largest
    matrix = rotations.matrix_from_quaternion((q[0], q[1], q[2], q[3]))
    return jnp.concatenate([position, jnp.stack(rotations.xyz_from_matrix(matrix))])
