"""What the constructors of all mechanisms check and convert."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Limits, as_reals, plain
from jaxkin.core.tracing import is_traced


def leaves(**values: Any) -> dict[str, Array]:
    """Converts geometry to float arrays of one shape, and names one that is not a number or not finite."""
    result = {}
    for name, value in values.items():
        array = as_reals(value)
        if array is None:
            raise GeometryError(f"{name} is {value!r}: geometry must be a number or an array of numbers.")
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


def batch_limits(name: str, limits: Limits, size: int, like: Array, joints: tuple[str, ...] = ()) -> Limits:
    """Gives limits the batch shape of the geometry, so that a batch of robots maps over every leaf."""
    ends = [as_reals(limits.low), as_reals(limits.high)] if isinstance(limits, Limits) else [None, None]
    low, high = ends
    if low is None or high is None or {low.shape[-1:], high.shape[-1:]} != {(size,)}:
        raise GeometryError(
            f"{name} is {_told(limits)}: it must be a jaxkin.Limits with {size} low and {size} high values."
        )
    if not is_traced(low) and not is_traced(high):
        _check_order(name, np.asarray(low), np.asarray(high), joints)
    shape = (*jnp.shape(like), size)
    return Limits(jnp.broadcast_to(low, shape), jnp.broadcast_to(high, shape))


def _told(limits: Any) -> str:
    """Returns limits as plain numbers, and anything else as it is."""
    if not isinstance(limits, Limits) or any(map(is_traced, (limits.low, limits.high))):
        return repr(limits)
    low, high = (repr(end) if as_reals(end) is None else plain(end) for end in (limits.low, limits.high))
    return f"Limits(low={low}, high={high})"


def _check_order(name: str, low: np.ndarray, high: np.ndarray, joints: tuple[str, ...]) -> None:
    """Names the first joint whose interval is the wrong way round, or no number."""
    low, high = np.broadcast_arrays(low, high)
    wrong = ~(low <= high)
    if not wrong.any():
        return
    place = tuple(int(k) for k in np.argwhere(wrong)[0])
    joint = joints[place[-1]] if joints else f"joint {place[-1] + 1}"
    batch = f" (robot {', '.join(map(str, place[:-1]))} of the batch)" if len(place) > 1 else ""
    raise GeometryError(
        f"{name}: {joint}{batch} is from {low[place]:g} to {high[place]:g}: every low limit must be a number not "
        "greater than the high one; exchange them."
    )


def checked_kind(who: str, robot: Any, kind: type, make: str) -> None:
    """Raises unless the robot is of a kind, whose formulas are no other robot's."""
    if not isinstance(robot, kind):
        raise InputError(f"{who} got a {type(robot).__name__}: it needs a {make}.")


def checked_numbers(what: str, value: Any, shape: tuple[int, ...], meaning: str) -> Array:
    """Returns real numbers of a shape as a float array.

    Raises:
        InputError: Text, complex or no numbers, or another shape.
    """
    array = as_reals(value)
    if array is None:
        raise InputError(f"The {what} is {value!r}: it must be real numbers of shape {shape}, {meaning}.")
    if array.shape != shape:
        raise InputError(
            f"The {what} has shape {array.shape}: it must be {shape}, {meaning}; for a batch use jax.vmap."
        )
    return array
