"""A field at scattered samples, as tests of float32 and adaptive sweeps ask for it."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep.designs import design_values
from jaxkin.sweep.fields import Field


def values_at(robot: Mechanism, coordinates: tuple[Any, ...], field: Field, count: int) -> tuple[Any, ...]:
    """Evaluates a field at so many samples, compiled where it can be; coordinates as in ``scattered_values``."""
    if not field.traced:
        return design_values(field, robot, coordinates, (count,))
    return scattered_values(robot, coordinates, field, count)


@partial(jax.jit, static_argnames=("field", "count"))
def scattered_values(robot: Mechanism, coordinates: tuple[Array, ...], field: Field, count: int) -> tuple[Array, ...]:
    """Evaluates a field at so many samples; coordinates are vectors, or scalars on fixed axes."""
    values = field.values(robot, coordinates)
    return tuple(jnp.broadcast_to(value, (*value.shape[: max(0, value.ndim - 1)], count)) for value in values)
