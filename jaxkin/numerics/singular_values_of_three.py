"""Extreme singular values of 3x3 matrices with their derivatives, in closed form, elementwise over arrays."""

import math
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.numerics.fusion import inverse_root, materialise, power_of_two, reciprocal
from jaxkin.numerics.small_linalg import Matrix3, Vector3, cofactors, determinant, dot

Rows: TypeAlias = tuple[tuple[Array, ...], ...]
#: Entries 00, 11, 22, 01, 02, 12.
Symmetric3: TypeAlias = tuple[Array, Array, Array, Array, Array, Array]

#: Values closer than this share of the largest are one value: their vectors are not told apart.
ALIKE = 1e-9


@jax.custom_jvp
def of_three(rows: Rows) -> tuple[Array, Array]:
    """Returns the extremes: the root of the largest eigenvalue of m m^T, and |det| over both large singular values.

    So the smallest keeps its digits near a singularity, where the root of the smallest eigenvalue would lose half of
    them. Where two values are small it is right to eps sigma_1^2 / sigma_2, which is at worst 1e-8 of the largest.
    """
    scale, shrink = _shrink(rows)
    matrix = _times(rows, shrink)
    return _values(scale, matrix, _spectrum(matrix))


@of_three.defjvp
def _of_three_jvp(primals: tuple[Rows], tangents: tuple[Rows]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return _slopes(*primals, *tangents)


def _slopes(rows: Rows, changes: Rows) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Returns the extremes and their slopes u . dM v.

    u v^T is taken of the largest value of M, and of the smallest, which is the largest of M's cofactors: so the
    smallest value's vectors keep their digits near a singularity, as cof M is the sum of (det / sigma) u v^T.
    """
    # In a gradient everything has many readers: what carries it is computed once.
    scale, shrink = materialise(*_shrink(rows))
    matrix = _times(rows, shrink)
    minors = cofactors(matrix)
    still = [jax.lax.stop_gradient(m) for m in (matrix, minors)]
    whole, other = (_carried(m) for m in still)
    smallest, largest = materialise(*_values(scale, still[0], whole))
    size = largest * shrink
    most = _along(_pair(matrix, whole, size), changes)
    least = _along(_pair(minors, other, size * size), changes)
    side = jnp.where(determinant(matrix) < 0, -1.0, 1.0)
    return _known(rows, smallest, largest), (side * least, most)


@jax.custom_jvp
def _known(rows: Rows, smallest: Array, largest: Array) -> tuple[Array, Array]:
    """Returns the extremes of a matrix that are known already, with their derivatives."""
    del rows
    return smallest, largest


@_known.defjvp
def _known_jvp(
    primals: tuple[Rows, Array, Array], tangents: tuple[Rows, Array, Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return _slopes(primals[0], tangents[0])


def _along(pair: Matrix3, changes: Rows) -> Array:
    return sum(dot(row, change) for row, change in zip(pair, changes, strict=True))  # type: ignore[arg-type, return-value]


def _pair(m: Matrix3, spectrum: "_Spectrum", size: Array) -> Matrix3:
    """Returns u v^T of the largest singular value of a matrix; the mean where values are alike, as a share of a size.

    With P the projector on the eigenvectors of g = m m^T, u v^T = P m / sigma; P = adj(g - lambda) over its trace.
    """
    (x, y, z), g = m, _gram(m)
    first, second, (square, other) = spectrum.first, spectrum.second, spectrum.squares
    # Of singular values s1, s2: s1 - s2 = (s1^2 - s2^2) / (s1 + s2).
    double = spectrum.spread * (first - second) <= ALIKE * size * (jnp.sqrt(square) + jnp.sqrt(other))
    # All three are alike only by their own size: of cofactors the third value is far below where M is nearly of rank 1.
    triple = spectrum.spread * (2 * first + second) <= 2 * ALIKE * square
    # Of two that are alike: what the third leaves.
    own = _projector(
        _scaled(g, spectrum.mean, spectrum.inverse), materialise(jnp.where(double, -first - second, first))[0]
    )
    share, unit = jnp.where(double, -0.5, 1.0), jnp.where(double, 0.5, 0.0)
    p00, p11, p22, p01, p02, p12 = (
        jnp.where(triple, 1 / 3 if k < 3 else 0.0, share * entry + (unit if k < 3 else 0.0))
        for k, entry in enumerate(own)
    )
    (inverse,) = materialise(_inverse_length(_tied(g, square)))
    return tuple(  # type: ignore[return-value]
        tuple((row[0] * x[j] + row[1] * y[j] + row[2] * z[j]) * inverse for j in range(3))
        for row in ((p00, p01, p02), (p01, p11, p12), (p02, p12, p22))
    )


def _projector(g: Symmetric3, value: Array) -> Symmetric3:
    """Returns the projector on the eigenvector of a simple eigenvalue."""
    value = _tied(g, value)
    g00, g11, g22, g01, g02, g12 = (entry - value if k < 3 else entry for k, entry in enumerate(g))
    adjoint = (
        g11 * g22 - g12 * g12,
        g00 * g22 - g02 * g02,
        g00 * g11 - g01 * g01,
        g02 * g12 - g01 * g22,
        g01 * g12 - g02 * g11,
        g01 * g02 - g12 * g00,
    )
    trace = adjoint[0] + adjoint[1] + adjoint[2]
    inverse = 1 / jnp.where(trace == 0, 1.0, trace)
    return tuple(entry * inverse for entry in adjoint)  # type: ignore[return-value]


@jax.custom_jvp
def _tied(g: Symmetric3, value: Array) -> Array:
    """Returns an eigenvalue of a matrix that is known already, with its derivatives."""
    del g
    return value


@_tied.defjvp
def _tied_jvp(primals: tuple[Symmetric3, Array], tangents: tuple[Symmetric3, Array]) -> tuple[Array, Array]:
    (g, value), (change, _) = primals, tangents
    p = _projector(g, value)
    slope = sum((1 if k < 3 else 2) * a * b for k, (a, b) in enumerate(zip(p, change, strict=True)))
    return _tied(g, value), slope  # type: ignore[return-value]


class _Spectrum(NamedTuple):
    """Of g = m m^T: mean eigenvalue, p and 1 / p, and (lambda - mean) / p of the two largest eigenvalues lambda.

    With the deviator d = g - mean, |d|^2 = 6 p^2, the eigenvalues are mean + 2 p cos(t), mean + 2 p cos(t - 2 pi / 3)
    and the rest, and cos 3t = det(d) / 2 p^3. Where two eigenvalues meet the cosine says nothing; the sine serves,
    |d^2 - 2 p^2 - p cos(3t) d| = sqrt6 p^2 sin 3t. p = 0 for a multiple of the unit matrix.
    """

    mean: Array
    spread: Array
    inverse: Array
    first: Array
    second: Array

    @property
    def squares(self) -> tuple[Array, Array]:
        """The squares of the two largest singular values."""
        return self.mean + self.spread * self.first, jnp.maximum(self.mean + self.spread * self.second, 0.0)


def _spectrum(m: Matrix3) -> _Spectrum:
    """Returns the spectrum of a matrix, for a kernel of few outputs."""
    g = _gram(m)
    mean, square, inverse = _deviator(g)
    deviator = _scaled(g, mean, inverse)
    spread = jnp.where(square > 0, square * inverse, 0.0)
    return _Spectrum(mean, spread, inverse, *_two_roots(*_three_times(deviator[:3], deviator[3:])))


def _carried(m: Matrix3) -> _Spectrum:
    """Returns the spectrum of a matrix for many readers, its parts computed once."""
    g = _gram(m)
    mean, square, inverse = materialise(*_deviator(g))
    deviator = _scaled(g, mean, inverse)
    roots = materialise(*_two_roots(*materialise(*_three_times(deviator[:3], deviator[3:]))))
    return _Spectrum(mean, jnp.where(square > 0, square * inverse, 0.0), inverse, *roots)


def _values(scale: Array, matrix: Matrix3, spectrum: _Spectrum) -> tuple[Array, Array]:
    first, second = spectrum.squares
    det = jnp.abs(determinant(matrix))
    return scale * det * _inverse_length(first * second), scale * first * _inverse_length(first)


def _shrink(rows: Rows) -> tuple[Array, Array]:
    """Returns a power of two near the size of a matrix, and its inverse."""
    size = jnp.asarray(sum(jnp.abs(entry) for row in rows for entry in row))
    return power_of_two(jnp.maximum(size, 4 * float(jnp.finfo(size.dtype).tiny)))


def _times(rows: Rows, factor: Array) -> Matrix3:
    return tuple((row[0] * factor, row[1] * factor, row[2] * factor) for row in rows)  # type: ignore[return-value]


def _gram(m: Matrix3) -> Symmetric3:
    """Returns m m^T."""
    x, y, z = m
    return dot(x, x), dot(y, y), dot(z, z), dot(x, y), dot(x, z), dot(y, z)


def _deviator(g: Symmetric3) -> tuple[Array, Array, Array]:
    """Returns mean, p^2 and 1 / p (1 where p = 0)."""
    g00, g11, g22, g01, g02, g12 = g
    mean = (g00 + g11 + g22) * (1 / 3)
    d0, d1, d2 = g00 - mean, g11 - mean, g22 - mean
    square = (d0 * d0 + d1 * d1 + d2 * d2 + 2 * (g01 * g01 + g02 * g02 + g12 * g12)) * (1 / 6)
    return mean, square, inverse_root(jnp.where(square > 0, square, 1.0))


def _scaled(g: Symmetric3, mean: Array, inverse: Array) -> Symmetric3:
    """Returns (g - mean) / p."""
    return tuple((entry - mean if k < 3 else entry) * inverse for k, entry in enumerate(g))  # type: ignore[return-value]


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
