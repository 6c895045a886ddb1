"""Zeros between two points of opposite sign, many at once."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array

#: Bisection alone needs 53 steps to the last digit; interpolation typically needs 8.
_MOST_STEPS = 80


def zero(function: Callable[[Array], Array], at_zero: Array, at_one: Array) -> Array:
    """Finds a zero of an elementwise function between 0 and 1, to the last digits.

    Args:
        function: Takes ``(n,)`` arguments in [0, 1] and returns ``(n,)`` values, without effect on each other.
        at_zero: ``(n,)`` values at 0.
        at_one: ``(n,)`` values at 1, of the opposite sign; otherwise what is returned is no zero.

    Returns:
        ``(n,)`` arguments. Where the function jumps over zero, the place of the jump; where it is NaN, NaN.

    References:
        Chandrupatla, T. R., 1997, "A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear
        function without using derivatives".
    """
    tolerance = 2 * jnp.finfo(float).eps

    def step(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        k, a, b, fa, fb, t, done, best = carry
        x = a + t * (b - a)
        f = function(x)
        same = jnp.sign(f) == jnp.sign(fa)
        # b and c hold the other end of the bracket and the point that was dropped.
        c, fc = jnp.where(same, a, b), jnp.where(same, fa, fb)
        b, fb = jnp.where(same, b, a), jnp.where(same, fb, fa)
        a, fa = x, f
        least = jnp.where(jnp.abs(fa) < jnp.abs(fb), a, b)
        limit = tolerance / jnp.maximum(jnp.abs(b - a), tolerance)
        finished = (limit > 0.5) | (f == 0) | jnp.isnan(f)
        best = jnp.where(done, best, jnp.where(jnp.isnan(f), jnp.nan, jnp.where(f == 0, a, least)))
        t = jnp.clip(_interpolated(a, b, c, fa, fb, fc), limit, 1 - limit)
        return k + 1, a, b, fa, fb, t, done | finished, best

    def goes_on(carry: tuple[Array, ...]) -> Array:
        return (carry[0] < _MOST_STEPS) & ~jnp.all(carry[6])

    a, b = jnp.zeros_like(at_zero), jnp.ones_like(at_zero)
    half, none = jnp.full_like(at_zero, 0.5), jnp.zeros(at_zero.shape, bool)
    start = (jnp.asarray(0), a, b, at_zero, at_one, half, none, half)
    return jax.lax.while_loop(goes_on, step, start)[7]


def _interpolated(a: Array, b: Array, c: Array, fa: Array, fb: Array, fc: Array) -> Array:
    """Returns the next point's share of the way from a to b: by inverse quadratic interpolation where it is safe."""
    xi = (a - b) / (c - b)
    ratio = (fa - fb) / (fc - fb)
    safe = (ratio**2 < xi) & ((1 - ratio) ** 2 < 1 - xi)
    share = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    return jnp.where(safe & jnp.isfinite(share), share, 0.5)
