"""Cosine and sine of one angle together, elementwise, at a third of the cost of XLA's on a CPU."""

import math

import jax
import jax.numpy as jnp
from jax import Array

#: pi / 2 in three parts of 33 bits, whose products with numbers below 2^20 are exact (fdlibm, e_rem_pio2.c).
_PARTS = (1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624871116645580e-21)
#: Minimax coefficients on [-pi/4, pi/4] (fdlibm, k_sin.c and k_cos.c).
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


@jax.custom_jvp
def cos_sin(angle: Array) -> tuple[Array, Array]:
    """Returns cosine and sine, right to 2e-16 for angles up to 1e6, beyond to a rounding of the angle."""
    if jnp.result_type(angle) != jnp.float64:
        return jnp.cos(angle), jnp.sin(angle)
    quarters = jnp.round(angle * (2 / math.pi))
    rest = angle
    for part in _PARTS:
        rest = rest - quarters * part
    square = rest * rest
    sine = rest + rest * square * _polynomial(_SINE, square)
    half = 0.5 * square
    # What 1 - square / 2 loses by rounding comes back.
    near = 1 - half
    cosine = near + (((1 - near) - half) + square * square * _polynomial(_COSINE, square))
    place = quarters - 4 * jnp.floor(0.25 * quarters)
    odd = (place == 1) | (place == 3)
    cosine, sine = jnp.where(odd, sine, cosine), jnp.where(odd, cosine, sine)
    return jnp.where((place == 1) | (place == 2), -cosine, cosine), jnp.where(place >= 2, -sine, sine)


@cos_sin.defjvp
def _cos_sin_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    cosine, sine = cos_sin(*primals)
    return (cosine, sine), (-sine * tangents[0], cosine * tangents[0])


def _polynomial(coefficients: tuple[float, ...], square: Array) -> Array:
    value = jnp.full_like(square, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        value = value * square + coefficient
    return value
