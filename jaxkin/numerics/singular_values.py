"""Smallest and largest singular value of small matrices, elementwise over arrays: rows are tuples of arrays or numbers.

Nothing is stacked and nothing is called for each sample, so that all of it runs in vector instructions. Both values are
right to a few units in the last place of the largest one, also where singular values coincide; of a 3x3 matrix with two
small values the smallest is not, see ``singular_values_of_three.of_three``.

References:
    Parlett, B. N., 1964, "Laguerre's method applied to the matrix eigenvalue problem"; Fernando, K. V. and Parlett,
    B. N., 1994, "Accurate singular values and differential qd algorithms" (the stationary transformation).
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.numerics import small_linalg
from jaxkin.numerics.fusion import materialise, waist
from jaxkin.numerics.singular_values_of_three import ALIKE, Rows, of_three

#: Matrices with less in them are zero; its inverse is finite, in float32 as well.
_LEAST = 1e-37
#: Beyond this size the program would be long, and LAPACK is no longer slow.
_LARGEST_UNROLLED = 8
#: A simple extreme takes five or six steps, one that coincides with two others 40: every step takes 0.6 of the way.
_MOST_STEPS = 48


def extremes(rows: Sequence[Sequence[Array]]) -> tuple[Array, Array]:
    """Returns the smallest and the largest singular value of a square matrix.

    Differentiable where the value is simple and not zero; at a multiple one it is the mean over the value's vectors,
    an element of Clarke's generalised gradient that belongs to no basis and keeps the symmetry of the matrix.
    """
    n = len(rows)
    if n == 1:
        return jnp.abs(rows[0][0]), jnp.abs(rows[0][0])
    if n == 2:
        return _of_two(rows)
    if n == 3:
        least, most = waist(*of_three(tuple(tuple(jnp.asarray(entry, float) for entry in row) for row in rows)))
        return least, most
    shape = jnp.broadcast_shapes(*(jnp.shape(entry) for row in rows for entry in row))
    full = tuple(tuple(jnp.broadcast_to(jnp.asarray(entry, float), shape) for entry in row) for row in rows)
    return _of_many(full)


def _of_two(rows: Sequence[Sequence[Array]]) -> tuple[Array, Array]:
    """Half the sum of two lengths, exact where both values coincide; and the determinant over it."""
    (a, b), (c, d) = rows
    scale = jnp.maximum(jnp.abs(a) + jnp.abs(b) + jnp.abs(c) + jnp.abs(d), _LEAST)
    inverse = 1 / scale
    a, b, c, d = a * inverse, b * inverse, c * inverse, d * inverse
    largest = 0.5 * (small_linalg.length((a + d, c - b)) + small_linalg.length((a - d, b + c)))
    there = largest > 0
    smallest = jnp.where(there, jnp.abs(a * d - b * c) / jnp.where(there, largest, 1.0), 0.0)
    return scale * smallest, scale * largest


@jax.custom_jvp
def _of_many(rows: Rows) -> tuple[Array, Array]:
    if len(rows) > _LARGEST_UNROLLED:
        values = jnp.linalg.svd(small_linalg.stacked(rows), compute_uv=False)
        return values[..., -1], values[..., 0]
    scale = jnp.maximum(sum(jnp.abs(entry) for row in rows for entry in row), _LEAST)
    inverse = 1 / scale
    squares, couplings = _bidiagonal([[entry * inverse for entry in row] for row in rows])
    low, high = _extreme_eigenvalues(squares, couplings)
    return scale * jnp.sqrt(low), scale * jnp.sqrt(high)


def _slopes_of_many(rows: Rows, changes: Rows) -> tuple[Array, Array]:
    """By LAPACK: derivatives may cost what it costs, and compile at once."""
    entries = [entry for row in (*rows, *changes) for entry in row]
    shape = jnp.broadcast_shapes(*(jnp.shape(entry) for entry in entries))
    matrix, change = (
        small_linalg.stacked(tuple(tuple(jnp.broadcast_to(entry, shape) for entry in row) for row in part))
        for part in (rows, changes)
    )
    left, values, right = jnp.linalg.svd(matrix, full_matrices=False)
    slopes = jnp.einsum("...ik,...ij,...kj->...k", left, change, right)
    least, most = (_mean_near(values, slopes, values[..., k : k + 1]) for k in (len(rows) - 1, 0))
    return least, most


def _mean_near(values: Array, slopes: Array, extreme: Array) -> Array:
    near = jnp.where(jnp.abs(values - extreme) <= ALIKE * values[..., :1], 1.0, 0.0)
    return jnp.sum(near * slopes, axis=-1) / jnp.sum(near, axis=-1)


@_of_many.defjvp
def _of_many_jvp(primals: tuple[Rows], tangents: tuple[Rows]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return _of_many(*primals), _slopes_of_many(*primals, *tangents)


def _bidiagonal(a: list[list[Array]]) -> tuple[list[Array], list[Array]]:
    """Returns the squares of both diagonals of the bidiagonal matrix that reflections from both sides make."""
    n = len(a)
    squares, couplings = [], []
    for k in range(n - 1):
        square, first, inverse = _reflection([a[i][k] for i in range(k, n)])
        squares.append(square)
        v = [first] + [a[i][k] for i in range(k + 1, n)]
        for j in range(k + 1, n):
            w = sum(v[i] * a[k + i][j] for i in range(n - k)) * inverse
            for i in range(n - k):
                a[k + i][j] = a[k + i][j] - v[i] * w
        if k == n - 2:
            couplings.append(a[k][n - 1] * a[k][n - 1])
            break
        square, first, inverse = _reflection(a[k][k + 1 :])
        couplings.append(square)
        v = [first, *a[k][k + 2 :]]
        for i in range(k + 1, n):
            w = sum(v[j] * a[i][k + 1 + j] for j in range(n - k - 1)) * inverse
            for j in range(n - k - 1):
                a[i][k + 1 + j] = a[i][k + 1 + j] - v[j] * w
        # Each later entry would otherwise go through all reflections again.
        kept = iter(materialise(*(a[i][j] for i in range(k + 1, n) for j in range(k + 1, n))))
        for i in range(k + 1, n):
            a[i][k + 1 :] = [next(kept) for _ in range(k + 1, n)]
    return [*squares, a[n - 1][n - 1] * a[n - 1][n - 1]], couplings


def _reflection(x: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Returns |x|^2, and the reflection 1 - v v^T / c that makes x a multiple of the first axis: v[0] and 1 / c."""
    square = jnp.asarray(sum(entry * entry for entry in x))
    length = jnp.sqrt(square)
    half = square + length * jnp.abs(x[0])
    inverse = 1 / jnp.where(half > 0, half, 1.0)
    return square, x[0] + jnp.where(x[0] < 0, -length, length), inverse


def _extreme_eigenvalues(squares: list[Array], couplings: list[Array]) -> tuple[Array, Array]:
    """Returns the extreme eigenvalues of B^T B by Laguerre's steps, from 0 up and from a bound down.

    The steps never pass the extreme, and treble its digits where it is simple. Pivots by the stationary qd
    transformation keep the relative accuracy of the smallest.
    """
    n = len(squares)
    diagonal = [squares[0], *(q + e for q, e in zip(squares[1:], couplings, strict=True))]
    mean = sum(diagonal) / n
    spread = sum((d - mean) * (d - mean) for d in diagonal)
    spread = spread + 2 * sum(q * e for q, e in zip(squares[:-1], couplings, strict=True))
    # Laguerre's own bound: his step from infinity.
    bound = mean + jnp.sqrt(spread * ((n - 1) / n))

    # In two loops: one of the extremes may not be asked for.
    low = _limit_of_steps(jnp.zeros_like(bound), squares, couplings)
    return jnp.maximum(low, 0.0), _limit_of_steps(bound, squares, couplings)


def _limit_of_steps(start: Array, squares: list[Array], couplings: list[Array]) -> Array:
    eps = float(jnp.finfo(start.dtype).eps)

    def one(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, _, count = state
        step = _laguerre(x, squares, couplings)
        return x + step, jnp.any(jnp.abs(step) > 4 * eps * x), count + 1

    def going(state: tuple[Array, Array, Array]) -> Array:
        return state[1] & (state[2] < _MOST_STEPS)

    return jax.lax.while_loop(going, one, (start, jnp.asarray(True), jnp.asarray(0)))[0]


def _laguerre(x: Array, squares: list[Array], couplings: list[Array]) -> Array:
    """Returns Laguerre's step at x for the characteristic polynomial of B^T B; 0 where a pivot vanishes."""
    n = len(squares)
    # Auxiliary quantity t of the transformation, with its derivatives; pivots are q + t.
    t, slope, bend = -x, -jnp.ones_like(x), jnp.zeros_like(x)
    first, second = jnp.zeros_like(x), jnp.zeros_like(x)
    for q, e in zip(squares, [*couplings, jnp.zeros_like(x)], strict=True):
        r = 1 / (q + t)
        ratio = slope * r
        first, second = first - ratio, second + (ratio * ratio - bend * r)
        factor = e * q * r * r
        t, slope, bend = e * t * r - x, factor * slope - 1, factor * (bend - 2 * slope * ratio)
    root = jnp.sqrt(jnp.maximum((n - 1) * (n * second - first * first), 0.0))
    step = n / (first + jnp.where(first < 0, -root, root))
    return jnp.where(jnp.isfinite(step), step, 0.0)
