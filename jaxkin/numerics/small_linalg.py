"""Unrolled algebra of small matrices, so that it fuses and broadcasts.

3x3 matrices are nested tuples of arrays, for the hot kernels; the last functions take ``(n, n)`` arrays of any small n.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

import jax.numpy as jnp
from jax import Array

Vector3: TypeAlias = tuple[Array, Array, Array]
Matrix3: TypeAlias = tuple[Vector3, Vector3, Vector3]


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Returns a + b rounded, and the rounding error: together the exact sum (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def cross(a: Vector3, b: Vector3) -> Vector3:
    """Returns the cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a: Vector3, b: Vector3) -> Array:
    """Returns the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cofactors(m: Matrix3) -> Matrix3:
    """Returns the cofactor matrix: rows r2 x r3, r3 x r1, r1 x r2."""
    return (cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1]))


def determinant(m: Matrix3) -> Array:
    """Returns the determinant."""
    return dot(m[0], cross(m[1], m[2]))


def solve(m: Matrix3, b: Vector3) -> Vector3:
    """Solves m x = b by the adjugate; a singular matrix gives inf or NaN.

    The rows are divided by their lengths first, so that rows of different units do not lose digits.
    """
    rows, right = [], []
    for row, value in zip(m, b, strict=True):
        scale = 1.0 / jnp.sqrt(dot(row, row))
        rows.append((row[0] * scale, row[1] * scale, row[2] * scale))
        right.append(value * scale)
    c = cofactors((rows[0], rows[1], rows[2]))
    inverse = 1.0 / dot(rows[0], c[0])
    x = [(right[0] * c[0][k] + right[1] * c[1][k] + right[2] * c[2][k]) * inverse for k in range(3)]
    return (x[0], x[1], x[2])


def length(v: tuple[Array, ...]) -> Array:
    """Returns the length of a vector; its derivative at the null vector is zero."""
    square = sum(entry * entry for entry in v)
    there = square > 0
    return jnp.where(there, jnp.sqrt(jnp.where(there, square, 1.0)), 0.0)


def stacked(rows: tuple[tuple[Array, ...], ...]) -> Array:
    """Returns a matrix of arrays of one shape as one array ``(..., n, n)``."""
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


#: cos(2 arccos(k) / 3) = p(k) / q(k) to 7e-17 on [0, 1], interpolated at Chebyshev nodes in 60 digits: one division
#: for the arccosine and the cosine of the trigonometric formula.
_TOP_NUMERATOR = (
    0.5,
    1.7830573000711942,
    2.3297414624942157,
    1.3950793910416177,
    0.38687826597833,
    0.04361518468802272,
    0.0013366250926112862,
)
_TOP_DENOMINATOR = (
    1.0,
    2.41141406176318,
    2.0972440318348915,
    0.797423044457054,
    0.12704908948738775,
    0.006541037985850415,
    3.6963837628258704e-05,
)


def largest_singular_value(m: Matrix3) -> Array:
    """Returns the largest singular value, to a few units in the last place.

    The largest eigenvalue of g = m m^T is mean + 2 p cos(t), with cos 3t = det(d) / 2 p^3 of the deviator d = g - mean
    and |d|^2 = 6 p^2. Where the two largest meet, 3t = pi, the cosine says nothing; then the sine serves,
    |d^2 - 2 p^2 - p cos(3t) d| = sqrt6 p^2 sin 3t.
    """
    scale = jnp.maximum(sum(jnp.abs(entry) for row in m for entry in row), jnp.finfo(float).tiny)
    shrink = 1 / scale
    n = tuple(tuple(entry * shrink for entry in row) for row in m)
    g00, g11, g22 = dot(n[0], n[0]), dot(n[1], n[1]), dot(n[2], n[2])  # type: ignore[arg-type]
    g01, g02, g12 = dot(n[0], n[1]), dot(n[0], n[2]), dot(n[1], n[2])  # type: ignore[arg-type]
    mean = (g00 + g11 + g22) / 3
    d0, d1, d2 = g00 - mean, g11 - mean, g22 - mean
    off = g01 * g01 + g02 * g02 + g12 * g12
    square = (d0 * d0 + d1 * d1 + d2 * d2 + 2 * off) / 6
    apart = square > 0
    spread = jnp.sqrt(jnp.where(apart, square, 1.0))
    inverse = 1 / spread
    d0, d1, d2 = d0 * inverse, d1 * inverse, d2 * inverse
    g01, g02, g12 = g01 * inverse, g02 * inverse, g12 * inverse
    cosine = (d0 * (d1 * d2 - g12 * g12) - g01 * (g01 * d2 - g12 * g02) + g02 * (g01 * g12 - d1 * g02)) / 2
    top = _top_root(cosine, _sine_of_three(cosine, (d0, d1, d2), (g01, g02, g12)))
    return scale * jnp.sqrt(jnp.maximum(mean + jnp.where(apart, 2 * spread * top, 0.0), 0.0))


def _sine_of_three(cosine: Array, d: Vector3, g: Vector3) -> Array:
    """Returns sin 3t, of a deviator with p = 1, its diagonal d and its entries g01, g02, g12."""
    (d0, d1, d2), (g01, g02, g12) = d, g
    e0 = d0 * d0 + g01 * g01 + g02 * g02 - 2 - cosine * d0
    e1 = g01 * g01 + d1 * d1 + g12 * g12 - 2 - cosine * d1
    e2 = g02 * g02 + g12 * g12 + d2 * d2 - 2 - cosine * d2
    e01 = (d0 + d1 - cosine) * g01 + g02 * g12
    e02 = (d0 + d2 - cosine) * g02 + g01 * g12
    e12 = (d1 + d2 - cosine) * g12 + g01 * g02
    return length((e0, e1, e2, e01, e01, e02, e02, e12, e12)) / math.sqrt(6.0)


def _top_root(cosine: Array, sine: Array) -> Array:
    """Returns cos(t), t in [0, pi/3], from the cosine and the sine of 3t."""
    behind = cosine < 0
    # k = cos(3t / 2), in each half without cancellation.
    root = jnp.sqrt(2 + 2 * jnp.abs(cosine))
    k = jnp.where(behind, sine / root, 0.5 * root)
    above, below = jnp.full_like(k, _TOP_NUMERATOR[-1]), jnp.full_like(k, _TOP_DENOMINATOR[-1])
    for p, q in zip(_TOP_NUMERATOR[-2::-1], _TOP_DENOMINATOR[-2::-1], strict=True):
        above, below = above * k + p, below * k + q
    return above / below


def singular_extremes(m: Matrix3) -> tuple[Array, Array]:
    """Returns the smallest and the largest singular value, both to relative accuracy of their scale.

    sigma_min = |det| / (sigma_1 sigma_2), and sigma_1 sigma_2 is the largest singular value of the cofactor matrix:
    the smallest one keeps its digits near a singularity, where the root of an eigenvalue loses half of them.
    """
    middle = largest_singular_value(cofactors(m))
    det = jnp.abs(determinant(m))
    smallest = jnp.where(middle > 0, det / jnp.where(middle > 0, middle, 1.0), 0.0)
    return smallest, largest_singular_value(m)


#: An expansion of more rows would take longer than a factorisation.
LARGEST_EXPANDED = 8


def expanded_determinant(matrix: Array) -> Array:
    """Returns the determinant of an ``(n, n)`` matrix by expansion, n 2^(n-1) products without a division.

    A polynomial of the entries: its derivatives of every order are right at singular matrices of any rank, where
    those of a factorisation are not. Meant for n <= 8.
    """
    n = matrix.shape[0]
    return expanded_rows([[matrix[i, j] for j in range(n)] for i in range(n)])


def expanded_rows(rows: Sequence[Sequence[Array]]) -> Array:
    """Returns the determinant of rows of arrays by expansion, elementwise; a number 0 among them costs nothing."""
    n = len(rows)
    minors: dict[int, Array] = {0: jnp.ones(())}
    for row in rows:
        wider: dict[int, Array] = {}
        for columns, minor in minors.items():
            for column, entry in enumerate(row):
                if not columns >> column & 1 and not (isinstance(entry, float) and entry == 0):
                    # Columns to the right that are taken already: the transpositions to sort this one in.
                    sign = -1.0 if (columns >> (column + 1)).bit_count() % 2 else 1.0
                    key = columns | 1 << column
                    wider[key] = wider.get(key, 0.0) + sign * entry * minor  # type: ignore[operator]
        minors = wider
    return minors.get((1 << n) - 1, jnp.zeros(()))


def any_determinant(matrix: Array) -> Array:
    """Returns the determinant of an ``(n, n)`` matrix: by expansion up to n = 8, by factorisation beyond."""
    return expanded_determinant(matrix) if matrix.shape[0] <= LARGEST_EXPANDED else jnp.linalg.det(matrix)


def null_vector(matrix: Array) -> Array:
    """Returns the generalised cross product of the n - 1 rows of an ``(n - 1, n)`` matrix.

    It is orthogonal to the rows, and the matrix with it as last row has a positive determinant, its squared length; it
    vanishes where the rows are dependent.
    """
    n = matrix.shape[1]
    parts = []
    for column in range(n):
        rest = jnp.concatenate([matrix[:, :column], matrix[:, column + 1 :]], axis=1)
        parts.append(expanded_determinant(rest) * (1.0 if (n - 1 + column) % 2 == 0 else -1.0))
    return jnp.stack(parts)


def pivoted_solve(matrix: Array, right: Array) -> Array:
    """Solves an ``(n, n)`` system by elimination with partial pivoting, unrolled; a singular one gives inf or NaN."""
    n = matrix.shape[0]
    rows = [[matrix[i, j] for j in range(n)] + [right[i]] for i in range(n)]
    for k in range(n):
        for i in range(k + 1, n):
            # Compare and swap until the largest pivot stands in row k: no gather, so that it vectorises.
            swap = jnp.abs(rows[i][k]) > jnp.abs(rows[k][k])
            upper = [jnp.where(swap, b, a) for a, b in zip(rows[k], rows[i], strict=True)]
            rows[i] = [jnp.where(swap, a, b) for a, b in zip(rows[k], rows[i], strict=True)]
            rows[k] = upper
        inverse = 1.0 / rows[k][k]
        for i in range(k + 1, n):
            factor = rows[i][k] * inverse
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    x: list[Array] = [right[0]] * n
    for k in reversed(range(n)):
        x[k] = (rows[k][n] - sum(rows[k][j] * x[j] for j in range(k + 1, n))) / rows[k][k]
    return jnp.stack(x)
