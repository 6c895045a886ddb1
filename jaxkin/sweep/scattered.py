"""A field at scattered samples, as tests of float32 and adaptive sweeps ask for it."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep.fields import Field


@partial(jax.jit, static_argnames=("field", "count"))
def scattered_values(robot: Mechanism, coordinates: tuple[Array, ...], field: Field, count: int) -> tuple[Array, ...]:
    """Evaluates a field at so many samples; coordinates are vectors, or scalars on fixed axes."""
    values = field.kernel(robot, coordinates)
    return tuple(jnp.broadcast_to(value, (*value.shape[: max(0, value.ndim - 1)], count)) for value in values)
