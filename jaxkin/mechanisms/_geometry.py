"""What the constructors of all mechanisms check and convert."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import GeometryError
from jaxkin.core.mechanism import Limits
from jaxkin.core.tracing import is_traced


def leaves(**values: Any) -> dict[str, Array]:
    """Converts geometry to float arrays of one shape, and names one that is not a number or not finite."""
    result = {}
    for name, value in values.items():
        try:
            array = jnp.asarray(value, dtype=float)
        except (TypeError, ValueError) as error:
            raise GeometryError(f"{name} is {value!r}: geometry must be a number or an array of numbers.") from error
        if not is_traced(array) and not np.all(np.isfinite(array)):
            raise GeometryError(f"{name} is {value}: geometry must be finite; replace NaN and infinite values.")
        result[name] = array
    try:
        return dict(zip(result, jnp.broadcast_arrays(*result.values()), strict=True))
    except ValueError as error:
        shapes = ", ".join(f"{name} {jnp.shape(value)}" for name, value in result.items())
        raise GeometryError(
            f"The shapes of the geometry differ ({shapes}): give numbers, or arrays of one shape."
        ) from error


def vector_leaf(name: str, value: Any, size: int, like: Array) -> Array:
    """Converts a vector of the geometry, and gives it the batch shape of a scalar leaf before its own axis."""
    array = leaves(**{name: value})[name]
    if array.shape[-1:] != (size,):
        raise GeometryError(f"{name} has shape {array.shape}: it must be {size} numbers.")
    return jnp.broadcast_to(array, (*jnp.shape(like), size))


def batch_limits(name: str, limits: Limits, size: int, like: Array) -> Limits:
    """Gives limits the batch shape of the geometry, so that a batch of robots maps over every leaf."""
    if not isinstance(limits, Limits) or {jnp.shape(limits.low)[-1:], jnp.shape(limits.high)[-1:]} != {(size,)}:
        raise GeometryError(f"{name} is {limits!r}: it must be a jaxkin.Limits with {size} low and {size} high values.")
    if not is_traced(limits.low) and not is_traced(limits.high) and not np.all(limits.low <= limits.high):
        raise GeometryError(f"{name} is {limits!r}: every low limit must be a number not greater than the high one.")
    shape = (*jnp.shape(like), size)
    return Limits(jnp.broadcast_to(limits.low, shape), jnp.broadcast_to(limits.high, shape))
