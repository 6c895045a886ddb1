"""Smallest and largest singular value of small matrices, elementwise over arrays: rows are tuples of arrays or numbers.

Nothing is stacked and nothing is called for each sample, so that all of it runs in vector instructions. Both values are
right to a few units in the last place of the largest one, also where singular values coincide.

References:
    Parlett, B. N., 1964, "Laguerre's method applied to the matrix eigenvalue problem"; Fernando, K. V. and Parlett,
    B. N., 1994, "Accurate singular values and differential qd algorithms" (the stationary transformation).
"""

import math
from collections.abc import Sequence
from functools import reduce
from typing import TypeAlias

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.numerics import small_linalg
from jaxkin.numerics.fusion import inverse_root, materialise, power_of_two, reciprocal
from jaxkin.numerics.small_linalg import Vector3, dot

Rows: TypeAlias = tuple[tuple[Array, ...], ...]

#: Matrices with less in them are zero; its inverse is finite, in float32 as well.
_LEAST = 1e-37
#: Beyond this size the program would be long, and LAPACK is no longer slow.
_LARGEST_UNROLLED = 8
#: A simple extreme takes five or six steps, one that coincides with two others 40: every step takes 0.6 of the way.
_MOST_STEPS = 48
#: Sweeps of Jacobi's rotations of a 3x3 matrix: they end quadratically.
_SWEEPS = 6
#: Values closer than this share of the largest are one value: their vectors are not told apart.
_ALIKE = 1e-9


def extremes(rows: Sequence[Sequence[Array]]) -> tuple[Array, Array]:
    """Returns the smallest and the largest singular value of a square matrix.

    Differentiable where the value is simple and not zero; at a multiple one see ``_slopes``.
    """
    n = len(rows)
    if n == 1:
        return jnp.abs(rows[0][0]), jnp.abs(rows[0][0])
    if n == 2:
        return _of_two(rows)
    if n == 3:
        return _of_three(tuple(tuple(jnp.asarray(entry, float) for entry in row) for row in rows))
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
def _of_three(rows: Rows) -> tuple[Array, Array]:
    """The roots of the two largest eigenvalues of g = m m^T; sigma_3 is |det| over both.

    So it keeps its digits near a singularity, where the root of the smallest eigenvalue would lose half of them. With
    the deviator d = g - mean, |d|^2 = 6 p^2, the eigenvalues are mean + 2 p cos(t) and mean + 2 p cos(t - 2 pi / 3),
    and cos 3t = det(d) / 2 p^3. Where two eigenvalues meet the cosine says nothing; the sine serves,
    |d^2 - 2 p^2 - p cos(3t) d| = sqrt6 p^2 sin 3t.
    """
    scale = jnp.maximum(sum(jnp.abs(entry) for row in rows for entry in row), _LEAST)
    scale, shrink = power_of_two(scale)
    x, y, z = ((row[0] * shrink, row[1] * shrink, row[2] * shrink) for row in rows)
    g00, g11, g22, g01, g02, g12 = dot(x, x), dot(y, y), dot(z, z), dot(x, y), dot(x, z), dot(y, z)
    mean = (g00 + g11 + g22) * (1 / 3)
    d0, d1, d2 = g00 - mean, g11 - mean, g22 - mean
    square = (d0 * d0 + d1 * d1 + d2 * d2 + 2 * (g01 * g01 + g02 * g02 + g12 * g12)) * (1 / 6)
    apart = square > 0
    safe = jnp.where(apart, square, 1.0)
    inverse = inverse_root(safe)
    spread = jnp.where(apart, safe * inverse, 0.0)
    diagonal, off = (d0 * inverse, d1 * inverse, d2 * inverse), (g01 * inverse, g02 * inverse, g12 * inverse)
    first, second = _two_roots(*_three_times(diagonal, off))
    first, second = mean + spread * first, jnp.maximum(mean + spread * second, 0.0)
    det = jnp.abs(small_linalg.determinant((x, y, z)))
    return scale * det * _inverse_length(first * second), scale * first * _inverse_length(first)


def _inverse_length(square: Array) -> Array:
    """Returns 1 / sqrt, and 0 where there is none."""
    there = square > 0
    return jnp.where(there, inverse_root(jnp.where(there, square, 1.0)), 0.0)


def _three_times(d: Vector3, g: Vector3) -> tuple[Array, Array]:
    """Returns cos 3t and sin 3t of a deviator with p = 1, its diagonal d and its entries g01, g02, g12."""
    (d0, d1, d2), (g01, g02, g12) = d, g
    cosine = (d0 * (d1 * d2 - g12 * g12) - g01 * (g01 * d2 - g12 * g02) + g02 * (g01 * g12 - d1 * g02)) / 2
    e0 = d0 * d0 + g01 * g01 + g02 * g02 - 2 - cosine * d0
    e1 = g01 * g01 + d1 * d1 + g12 * g12 - 2 - cosine * d1
    e2 = g02 * g02 + g12 * g12 + d2 * d2 - 2 - cosine * d2
    e01 = (d0 + d1 - cosine) * g01 + g02 * g12
    e02 = (d0 + d2 - cosine) * g02 + g01 * g12
    e12 = (d1 + d2 - cosine) * g12 + g01 * g02
    square = (e0 * e0 + e1 * e1 + e2 * e2 + 2 * (e01 * e01 + e02 * e02 + e12 * e12)) * (1 / 6)
    return cosine, square * _inverse_length(square)


#: With k = cos(3t / 2): cos(t) = p(k) / q(k) and sin(t) = sin(3t / 2) p(k) / q(k), to 7e-17 on [0, 1], interpolated at
#: Chebyshev nodes in 60 digits. One division for an arccosine, a cosine and a sine.
_COSINE = (
    (
        0.5,
        1.7830573000711942,
        2.3297414624942157,
        1.3950793910416177,
        0.38687826597833,
        0.04361518468802272,
        0.0013366250926112862,
    ),
    (
        1.0,
        2.41141406176318,
        2.0972440318348915,
        0.797423044457054,
        0.12704908948738775,
        0.006541037985850415,
        3.6963837628258704e-05,
    ),
)
_SINE = (
    (
        0.8660254037844386,
        2.178267763980038,
        2.0031317177691976,
        0.8230888428011572,
        0.14743157483386207,
        0.009352988492802717,
        0.0001044467326175935,
    ),
    (
        1.0,
        2.900147139261648,
        3.1515066495375663,
        1.5859291725257552,
        0.36869160810855334,
        0.034039603675727254,
        0.0007899344819197407,
    ),
)


def _two_roots(cosine: Array, sine: Array) -> tuple[Array, Array]:
    """Returns 2 cos(t) and 2 cos(t - 2 pi / 3), t in [0, pi/3], from the cosine and the sine of 3t."""
    # Cosine and sine of 3t / 2, either without cancellation.
    double = 2 + 2 * jnp.abs(cosine)
    inverse = inverse_root(double)
    large, small = 0.5 * double * inverse, sine * inverse
    behind = cosine < 0
    k, side = jnp.where(behind, small, large), jnp.where(behind, large, small)
    (a, b), (c, d) = ([_polynomial(part, k) for part in both] for both in (_COSINE, _SINE))
    inverse = reciprocal(b * d)
    cos, sin = a * d * inverse, side * c * b * inverse
    return 2 * cos, math.sqrt(3.0) * sin - cos


def _polynomial(coefficients: tuple[float, ...], k: Array) -> Array:
    value = jnp.full_like(k, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        value = value * k + coefficient
    return value


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


def _slopes(primals: tuple[Rows], tangents: tuple[Rows]) -> tuple[Array, Array]:
    """D sigma = u . dM v, from all singular vectors.

    Where the extreme is a multiple value it has no derivative; the mean over its vectors is an element of Clarke's
    generalised gradient, belongs to no basis, and keeps the symmetry of the matrix.
    """
    (rows,), (changes,) = primals, tangents
    if len(rows) == 3:
        values, slopes = _slopes_of_three(rows, changes)
    else:
        values, slopes = _slopes_of_many(rows, changes)
    least, most = (reduce(pick, values) for pick in (jnp.minimum, jnp.maximum))
    return _mean_near(values, slopes, least, most), _mean_near(values, slopes, most, most)


def _mean_near(values: Sequence[Array], slopes: Sequence[Array], extreme: Array, size: Array) -> Array:
    near = [jnp.where(jnp.abs(value - extreme) <= _ALIKE * size, 1.0, 0.0) for value in values]
    return sum(n * slope for n, slope in zip(near, slopes, strict=True)) / sum(near)  # type: ignore[return-value]


def _slopes_of_many(rows: Rows, changes: Rows) -> tuple[list[Array], list[Array]]:
    """By LAPACK: derivatives may cost what it costs, and compile at once."""
    entries = [entry for row in (*rows, *changes) for entry in row]
    shape = jnp.broadcast_shapes(*(jnp.shape(entry) for entry in entries))
    matrix, change = (
        small_linalg.stacked(tuple(tuple(jnp.broadcast_to(entry, shape) for entry in row) for row in part))
        for part in (rows, changes)
    )
    left, values, right = jnp.linalg.svd(matrix, full_matrices=False)
    slopes = jnp.einsum("...ik,...ij,...kj->...k", left, change, right)
    return [values[..., k] for k in range(len(rows))], [slopes[..., k] for k in range(len(rows))]


def _slopes_of_three(rows: Rows, changes: Rows) -> tuple[list[Array], list[Array]]:
    """By one-sided Jacobi rotations (Hestenes), elementwise: LAPACK takes many times as long for so small a matrix.

    Columns of M V become orthogonal; they are sigma u. Rotations keep the relative accuracy of small values.
    """
    shape = jnp.broadcast_shapes(*(jnp.shape(entry) for row in rows for entry in row))
    scale = jnp.maximum(sum(jnp.abs(entry) for row in rows for entry in row), _LEAST)
    m = [[jnp.broadcast_to(rows[i][k] / scale, shape) for i in range(3)] for k in range(3)]
    one, zero = jnp.ones(shape, m[0][0].dtype), jnp.zeros(shape, m[0][0].dtype)
    start = (m, [[one if i == k else zero for i in range(3)] for k in range(3)])

    def sweep(_: Array, state: tuple[list[list[Array]], list[list[Array]]]) -> tuple[list, list]:
        columns, turns = ([list(column) for column in part] for part in state)
        for a, b in ((0, 1), (0, 2), (1, 2)):
            cos, sin = _rotation(columns[a], columns[b])
            for part in (columns, turns):
                part[a], part[b] = (
                    [cos * x - sin * y for x, y in zip(part[a], part[b], strict=True)],
                    [sin * x + cos * y for x, y in zip(part[a], part[b], strict=True)],
                )
        return columns, turns

    columns, turns = jax.lax.fori_loop(0, _SWEEPS, sweep, start)
    lengths = [small_linalg.length(tuple(column)) for column in columns]
    slopes = []
    for k, (column, turn) in enumerate(zip(columns, turns, strict=True)):
        there = lengths[k] > 0
        # A zero column: its direction is that which the other two leave.
        across = small_linalg.cross(tuple(columns[k - 2]), tuple(columns[k - 1]))  # type: ignore[arg-type]
        rest = small_linalg.length(across)
        size = jnp.where(there, lengths[k], jnp.where(rest > 0, rest, 1.0))
        left = [jnp.where(there, x, y) / size for x, y in zip(column, across, strict=True)]
        slopes.append(sum(left[i] * dot(tuple(changes[i]), tuple(turn)) for i in range(3)))  # type: ignore[arg-type]
    return [scale * length for length in lengths], slopes  # type: ignore[return-value]


def _rotation(x: Sequence[Array], y: Sequence[Array]) -> tuple[Array, Array]:
    """Returns cosine and sine of the smaller turn that makes two columns orthogonal."""
    skew = sum(a * b for a, b in zip(x, y, strict=True))
    apart = sum((b - a) * (b + a) for a, b in zip(x, y, strict=True))
    turned = skew != 0
    ratio = apart / jnp.where(turned, 2 * skew, 1.0)
    tangent = jnp.where(ratio < 0, -1.0, 1.0) / (jnp.abs(ratio) + jnp.sqrt(1 + ratio * ratio))
    tangent = jnp.where(turned, tangent, 0.0)
    cos = 1 / jnp.sqrt(1 + tangent * tangent)
    return cos, cos * tangent


@_of_three.defjvp
def _of_three_jvp(primals: tuple[Rows], tangents: tuple[Rows]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return _of_three(*primals), _slopes(primals, tangents)


@_of_many.defjvp
def _of_many_jvp(primals: tuple[Rows], tangents: tuple[Rows]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return _of_many(*primals), _slopes(primals, tangents)


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
