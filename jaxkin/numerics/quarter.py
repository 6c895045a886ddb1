"""Angles in [-pi, pi) as quarter tangents u = tan(phi / 4) in [-1, 1): one finite number, no seam inside."""

import math

import jax.numpy as jnp
from jax import Array

#: Larger than any quarter tangent, so that it sorts last: there is no angle here.
NO_ANGLE = 2.0

_BELOW_PI = math.nextafter(math.pi, 0)


def from_half_angle(s: Array, c: Array) -> Array:
    """Returns u for the direction (s : c) = (sin phi/2 : cos phi/2), which need not be of unit length."""
    u = jnp.where(c < 0, -s, s) / (jnp.sqrt(s * s + c * c) + jnp.abs(c))
    return jnp.where(u >= 1, -1.0, u)


def half_angle(u: Array) -> tuple[Array, Array]:
    """Returns sin phi/2 and cos phi/2 >= 0."""
    weight = 1 / (1 + u * u)
    return 2 * u * weight, (1 - u) * (1 + u) * weight


def angle(u: Array) -> Array:
    """Returns phi in [-pi, pi); 4 atan(u) could round to pi where u is just under 1."""
    return jnp.minimum(4 * jnp.arctan(u), _BELOW_PI)
