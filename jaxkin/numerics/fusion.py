"""Waists of a hot kernel, and divisions that make none."""

import jax
import jax.numpy as jnp
from jax import Array


def materialise(*arrays: Array) -> tuple[Array, ...]:
    """Returns the floating-point arrays unchanged, and makes XLA compute each of them once.

    XLA on a CPU writes one loop for every output and computes shared inputs again in each; only results
    of an operation that it holds for expensive, such as a division, are kept. ``optimization_barrier``
    is dropped before that happens (jaxlib 0.10). So this divides by a one that the compiler cannot see
    through: 0 * x is no constant, as x might be NaN. Use it where few arrays carry all that follows.
    """
    kept = []
    for array in arrays:
        one = array * 0 + 1
        kept.append(array / one)
    return tuple(kept)


def waist(*arrays: Array) -> tuple[Array, ...]:
    """Returns the arrays unchanged; in derivatives they are computed once, and so are their cotangents.

    Values alone, without derivatives, are left as they are: a kernel of few outputs is best in few loops. In a gradient
    every number that it is taken by would compute anew all that lies between itself and the output; a waist between
    them is computed once, as by ``materialise``.
    """
    return tuple(_waist(x) if jnp.issubdtype(jnp.result_type(x), jnp.floating) else x for x in arrays)


def spread(like: Array, *numbers: Array) -> tuple[Array, ...]:
    """Returns numbers in the shape of an array, each with a waist: in a gradient each is summed once over all samples.

    A number that is read at ten places of a loop would be ten sums, each a loop of its own.
    """
    shape = jnp.shape(like)
    return waist(*(jnp.broadcast_to(x, jnp.broadcast_shapes(shape, jnp.shape(x))) for x in numbers))


@jax.custom_jvp
def _waist(x: Array) -> Array:
    return x


@_waist.defjvp
def _waist_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (x,), (change,) = primals, tangents
    # One for infinity too, as a limit may be. No minimum, which jaxlib 0.12 compiles for minutes where x is deep.
    one = jnp.where(jnp.abs(x) > 1, 1, x) * 0 + 1
    return _waist(x) / one, change / one


def reciprocal(x: Array) -> Array:
    """Returns 1 / x to a unit in the last place, by multiplications that XLA fuses; nonsense at 0 and infinity.

    XLA on a CPU ends a loop at every division and every root that is used twice. This is no slower than either in
    vector instructions, and lets a kernel of one output run in one loop.
    """
    if x.dtype != jnp.float64:
        return 1 / x
    return _reciprocal(x)


@jax.custom_jvp
def _reciprocal(x: Array) -> Array:
    # The exponent changed in sign, the mantissa roughly inverted: wrong by an eighth at most.
    guess = jax.lax.bitcast_convert_type(
        jnp.int64(0x7FDE623822FC16E6) - jax.lax.bitcast_convert_type(x, jnp.int64), x.dtype
    )
    for _ in range(2):
        off = 1 - x * guess
        guess = guess * ((1 + off) * (1 + off * off))
    return guess + guess * (1 - x * guess)


@_reciprocal.defjvp
def _reciprocal_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    inverse = reciprocal(*primals)
    return inverse, -inverse * inverse * tangents[0]


def inverse_root(x: Array) -> Array:
    """Returns 1 / sqrt(x), likewise, for x > 0."""
    if x.dtype != jnp.float64:
        return jax.lax.rsqrt(x)
    return _inverse_root(x)


@jax.custom_jvp
def _inverse_root(x: Array) -> Array:
    half = jax.lax.shift_right_logical(jax.lax.bitcast_convert_type(x, jnp.int64), jnp.int64(1))
    guess = jax.lax.bitcast_convert_type(jnp.int64(0x5FE6EB50C7B537A9) - half, x.dtype)
    for _ in range(2):
        off = 1 - (x * guess) * guess
        guess = guess + guess * (off * (0.5 + 0.375 * off))
    return guess + guess * (0.5 - 0.5 * (x * guess) * guess)


@_inverse_root.defjvp
def _inverse_root_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    root = inverse_root(*primals)
    return root, -0.5 * root * root * root * tangents[0]


def power_of_two(x: Array) -> tuple[Array, Array]:
    """Returns the power of two below x > 0 and its inverse, exact: a scale that costs no division."""
    if x.dtype != jnp.float64:
        scale = jax.lax.stop_gradient(jnp.exp2(jnp.floor(jnp.log2(x))))
        return scale, 1 / scale
    exponent = jax.lax.bitcast_convert_type(jax.lax.stop_gradient(x), jnp.int64) & jnp.int64(0x7FF0000000000000)
    opposite = jnp.int64(0x7FE0000000000000) - exponent
    return jax.lax.bitcast_convert_type(exponent, x.dtype), jax.lax.bitcast_convert_type(opposite, x.dtype)
