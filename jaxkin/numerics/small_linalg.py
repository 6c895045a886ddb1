"""Unrolled algebra of 3x3 matrices, as nested tuples of arrays so that it fuses and broadcasts."""

from typing import TypeAlias

import jax.numpy as jnp
from jax import Array

Vector3: TypeAlias = tuple[Array, Array, Array]
Matrix3: TypeAlias = tuple[Vector3, Vector3, Vector3]


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


def largest_singular_value(m: Matrix3) -> Array:
    """Returns the largest singular value, to 1e-15, and to 1e-8 of itself where it is nearly double.

    The largest eigenvalue of m m^T by the trigonometric formula, whose arccosine loses half of its digits where two
    eigenvalues meet.
    """
    scale = jnp.maximum(sum(jnp.abs(entry) for row in m for entry in row), jnp.finfo(float).tiny)
    n = tuple(tuple(entry / scale for entry in row) for row in m)
    g00, g11, g22 = dot(n[0], n[0]), dot(n[1], n[1]), dot(n[2], n[2])  # type: ignore[arg-type]
    g01, g02, g12 = dot(n[0], n[1]), dot(n[0], n[2]), dot(n[1], n[2])  # type: ignore[arg-type]
    mean = (g00 + g11 + g22) / 3
    d0, d1, d2 = g00 - mean, g11 - mean, g22 - mean
    spread = jnp.sqrt((d0 * d0 + d1 * d1 + d2 * d2 + 2 * (g01 * g01 + g02 * g02 + g12 * g12)) / 6)
    safe = jnp.where(spread > 0, spread, 1.0)
    half_det = (d0 * (d1 * d2 - g12 * g12) - g01 * (g01 * d2 - g12 * g02) + g02 * (g01 * g12 - d1 * g02)) / (
        2 * safe**3
    )
    angle = jnp.arccos(jnp.clip(half_det, -1.0, 1.0)) / 3
    return scale * jnp.sqrt(jnp.maximum(mean + 2 * spread * jnp.cos(angle), 0.0))


def singular_extremes(m: Matrix3) -> tuple[Array, Array]:
    """Returns the smallest and the largest singular value, both to relative accuracy of their scale.

    sigma_min = |det| / (sigma_1 sigma_2), and sigma_1 sigma_2 is the largest singular value of the cofactor matrix:
    the smallest one keeps its digits near a singularity, where the root of an eigenvalue loses half of them.
    """
    middle = largest_singular_value(cofactors(m))
    det = jnp.abs(determinant(m))
    smallest = jnp.where(middle > 0, det / jnp.where(middle > 0, middle, 1.0), 0.0)
    return smallest, largest_singular_value(m)
