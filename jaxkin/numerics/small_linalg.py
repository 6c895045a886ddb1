"""Unrolled algebra of small matrices, so that it fuses and broadcasts.

3x3 matrices are nested tuples of arrays, for the hot kernels; the last functions take ``(n, n)`` arrays of any small n.
"""

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
