"""A search for all solutions of a small square system from many starts."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.numerics.small_linalg import pivoted_solve


class Found(NamedTuple):
    """Distinct solutions, those that exist first.

    Attributes:
        x: ``(lanes, n)``.
        exists: ``(lanes,)``.
        residual: ``(lanes,)``.
        singular: ``(lanes,)`` True where the Jacobian is nearly singular.
        continuum: True where there are more solutions than lanes, and singular: points of a curve.
    """

    x: Array
    exists: Array
    residual: Array
    singular: Array
    continuum: Array


def lattice(starts: int, dimension: int) -> np.ndarray:
    """Returns points of an additive-recurrence lattice in the unit cube, ``(starts, dimension)``.

    The generator is the positive root of g^(dimension + 1) = g + 1, whose powers are far from rational.
    """
    g = 1.5
    for _ in range(60):
        g = (1 + g) ** (1 / (dimension + 1))
    return (0.5 + np.outer(np.arange(1, starts + 1), g ** -np.arange(1.0, dimension + 1))) % 1.0


def value_and_slope(function: Callable[[Array], Array]) -> Callable[[Array], tuple[Array, Array]]:
    """Returns a function that gives value ``(k,)`` and Jacobian ``(k, n)`` at once, compiled once."""
    slope = jax.jacfwd(lambda x: (function(x),) * 2, has_aux=True)
    return lambda x: slope(x)[::-1]


def descend(function: Callable[[Array], Array], x: Array, steps: int) -> Array:
    """Returns x after Levenberg-Marquardt steps towards function(x) = 0, ``(n,) -> (k,)``, of order one.

    There may be more or fewer equations than unknowns: it then ends at a point of least squares, or near the start.
    """
    both, eye = value_and_slope(function), jnp.eye(len(x))

    def step(k: Array, carry: tuple[Array, Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array, Array]:
        # The function stands here once only: it is what takes long to compile.
        x, f, j, trial, damping = carry
        f_trial, j_trial = both(trial)
        better = (jnp.sum(f_trial**2) < jnp.sum(f**2)) | (k == 0)
        damping = jnp.clip(jnp.where(better, damping * 0.2, damping * 5), 1e-14, 1e6)
        x, f, j = jnp.where(better, trial, x), jnp.where(better, f_trial, f), jnp.where(better, j_trial, j)
        return x, f, j, x - pivoted_solve(j.T @ j + damping * eye, j.T @ f), damping

    shapes = jax.eval_shape(both, x)
    f, j = (jnp.zeros(shape.shape) for shape in shapes)
    return jax.lax.fori_loop(0, steps, step, (x, f, j, x, jnp.asarray(5e-2)))[0]


def polish(function: Callable[[Array], Array], x: Array, steps: int = 3, trust: float = 1e-2) -> Array:
    """Returns x after Newton's steps, the shortest ones where equations are fewer than unknowns.

    A step longer than ``trust`` is shortened to it.
    """
    both = value_and_slope(function)

    def step(_: Array, x: Array) -> Array:
        f, j = both(x)
        move = pivoted_solve(j, f) if j.shape[0] == j.shape[1] else j.T @ pivoted_solve(j @ j.T, f)
        return x - move * jnp.minimum(1.0, trust / (jnp.max(jnp.abs(move)) + 1e-300))

    return jax.lax.fori_loop(0, steps, step, x)


def search(
    function: Callable[[Array], Array],
    low: Array,
    high: Array,
    period: Array,
    lanes: int,
    *,
    starts: int = 256,
    steps: int = 60,
    residual_tolerance: float = 1e-12,
    distance: float = 1e-6,
) -> Found:
    """Searches the solutions of function(x) = 0, ``(n,) -> (n,)``, with residuals and unknowns of order one.

    Levenberg-Marquardt steps from a lattice of starts, then Newton steps; what agrees within ``distance``
    (glued by ``period``, inf where there is none) is one solution. Nothing proves that all were found.
    """
    n = len(low)
    x = low + (high - low) * jnp.asarray(lattice(starts, n))
    jacobian = jax.jacfwd(function)

    x = jax.vmap(lambda x: polish(function, descend(function, x, steps), steps=2, trust=1e-3))(x)
    wraps = jnp.isfinite(period)
    turn = jnp.where(wraps, period, 1.0)
    x = jnp.where(wraps, (x - low) % turn + low, x)
    residual = jax.vmap(lambda x: jnp.max(jnp.abs(function(x))))(x)
    good = residual <= residual_tolerance
    gap = jnp.abs(x[:, None] - x[None])
    gap = jnp.max(jnp.where(wraps, jnp.minimum(gap, turn - gap), gap), axis=-1)
    earlier = jnp.arange(starts)[None, :] < jnp.arange(starts)[:, None]
    # The first good start of each cluster stands for it; clusters are far wider apart than `distance`.
    first = good & ~jnp.any(earlier & good[None, :] & (gap < distance), axis=1)
    keys = jnp.where(first, 0, 1)
    order = jnp.lexsort((*(x[:, k] for k in range(n - 1)), x[:, n - 1], keys))[:lanes]
    x, exists, residual = x[order], first[order], residual[order]
    smallest = jax.vmap(lambda x: jnp.linalg.svd(jacobian(x), compute_uv=False)[-1])(x)
    singular = smallest < 1e-6
    crowded = (jnp.sum(first) > lanes) & (jnp.mean(singular) > 0.5)
    return Found(x, exists, residual, singular, crowded)
