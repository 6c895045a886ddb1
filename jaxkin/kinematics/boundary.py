"""What every public entry point checks before a kernel sees its arguments."""

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError, PrecisionError
from jaxkin.core.mechanism import Axis, Mechanism, as_reals
from jaxkin.core.precision import require_x64
from jaxkin.core.tracing import is_traced


def checked_mechanism(who: str, robot: Mechanism) -> None:
    """Raises unless float64 is on and ``robot`` is a mechanism."""
    require_x64(who)
    if not isinstance(robot, Mechanism):
        raise InputError(
            f"{who} got a {type(robot).__name__} as its mechanism: pass a jaxkin.Mechanism first, for instance "
            "jk.mechanisms.rpr3.reference()."
        )
    if any(getattr(leaf, "dtype", None) == jnp.float32 for leaf in jax.tree_util.tree_leaves(robot)):
        raise PrecisionError(
            f"{who} got a mechanism with float32 geometry, made before float64 was enabled: call "
            "`jaxkin.enable_x64()` first and make the mechanism again."
        )


def checked_single(who: str, robot: Mechanism) -> None:
    """Raises unless float64 is on and ``robot`` is one mechanism with plain numbers, for what no kernel can do."""
    checked_mechanism(who, robot)
    if any(map(is_traced, jax.tree_util.tree_leaves(robot))):
        raise InputError(f"{who} cannot be traced: call it outside jax.jit, jax.vmap and jax.grad.")
    if jnp.ndim(robot.characteristic_length()) != 0:
        raise InputError(f"{who} got a batch of robots: pass one robot at a time.")


def checked_vector(who: str, what: str, value: ArrayLike, axes: tuple[Axis, ...]) -> Array:
    """Returns one configuration as a float64 vector.

    Raises:
        InputError: Not real numbers, or not of shape ``(len(axes),)``; a batch is told of ``jax.vmap``.
    """
    names = ", ".join(axis.name for axis in axes)
    array = as_reals(value)
    if array is None:
        raise InputError(f"{who}: {what} is {value!r}; it must be {len(axes)} numbers ({names}), real ones.")
    if array.shape != (len(axes),):
        remedy = ""
        if array.ndim > 1 and array.shape[-1] == len(axes):
            remedy = f" For a batch use jax.vmap({who}, in_axes=(None, 0))."
        raise InputError(f"{who}: {what} has shape {array.shape}; it must be ({len(axes)},) for ({names}).{remedy}")
    return array


def checked_configuration(who: str, robot: Mechanism, pose: ArrayLike, joints: ArrayLike) -> tuple[Array, Array]:
    """Returns pose and joints as float64 vectors, after all checks."""
    checked_mechanism(who, robot)
    return (
        checked_vector(who, "the pose", pose, robot.pose_axes),
        checked_vector(who, "the joints", joints, robot.joint_axes),
    )


def as_tuple(vector: Array) -> tuple[Array, ...]:
    """Returns the entries of a vector as scalars, the form that hot kernels take."""
    return tuple(vector[k] for k in range(vector.shape[0]))
