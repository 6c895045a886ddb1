"""Rotations: matrices, quaternions and two triples of angles, elementwise and safe at every rotation.

A matrix is a nested tuple of nine arrays (``small_linalg.Matrix3``), a quaternion a tuple ``(w, x, y, z)``, so that all
of this fuses in hot kernels. A rotation at which a triple of angles is not unique (gimbal lock) gets the triple with
one angle zero: the matrix comes back, and derivatives stay finite, although there the angles have none.
"""

import math

import jax.numpy as jnp
from jax import Array

from jaxkin.numerics import quarter
from jaxkin.numerics.small_linalg import Matrix3, Vector3

Quaternion = tuple[Array, Array, Array, Array]


def direction_angle(sine: Array, cosine: Array) -> Array:
    """Returns the angle in [-pi, pi) of a direction, which need not be of unit length; 0 for the null vector.

    An arctangent of two arguments at a third of the cost of XLA's, with a finite derivative at the null vector.
    """
    null = (sine == 0) & (cosine == 0)
    y, x = jnp.where(null, 0.0, sine), jnp.where(null, 1.0, cosine)
    length = jnp.sqrt(x * x + y * y)
    # The half angle, from whichever of its two forms does not cancel.
    behind = x < 0
    return quarter.angle(quarter.from_half_angle(jnp.where(behind, length - x, y), jnp.where(behind, y, length + x)))


def matrix_from_xyz(phi: Array, theta: Array, sigma: Array) -> Matrix3:
    """Returns Rx(phi) Ry(theta) Rz(sigma)."""
    return xyz_product(*(turn(angle) for angle in (phi, theta, sigma) for turn in (jnp.cos, jnp.sin)))


def xyz_product(cp: Array, sp: Array, ct: Array, st: Array, cs: Array, ss: Array) -> Matrix3:
    """Returns Rx(phi) Ry(theta) Rz(sigma) from the cosine and the sine of each angle."""
    return (
        (ct * cs, -ct * ss, st),
        (sp * st * cs + cp * ss, cp * cs - sp * st * ss, -sp * ct),
        (sp * ss - cp * st * cs, cp * st * ss + sp * cs, cp * ct),
    )


def xyz_from_matrix(m: Matrix3) -> Vector3:
    """Returns phi and sigma in [-pi, pi) and theta in [-pi/2, pi/2] with R = Rx(phi) Ry(theta) Rz(sigma).

    At theta = +-pi/2 only phi +- sigma is determined: there sigma = 0. Close to it, sigma is taken from the matrix that
    remains when phi is undone, so that the three angles together give the matrix back to rounding.
    """
    (_, _, r13), (r21, r22, r23), (r31, r32, r33) = m
    horizontal = r23 * r23 + r33 * r33
    locked = horizontal <= 0
    level = jnp.where(locked, 0.0, jnp.sqrt(jnp.where(locked, 1.0, horizontal)))
    sine, cosine = jnp.where(locked, r32, -r23), jnp.where(locked, r22, r33)
    phi = direction_angle(sine, cosine)
    sigma = direction_angle(cosine * r21 + sine * r31, cosine * r22 + sine * r32)
    return phi, direction_angle(r13, level), jnp.where(locked, 0.0, sigma)


def matrix_from_zxy(alpha: Array, beta: Array, gamma: Array) -> Matrix3:
    """Returns Rz(alpha) Rx(beta) Ry(gamma)."""
    ca, sa = jnp.cos(alpha), jnp.sin(alpha)
    cb, sb = jnp.cos(beta), jnp.sin(beta)
    cg, sg = jnp.cos(gamma), jnp.sin(gamma)
    return (
        (ca * cg - sa * sb * sg, -sa * cb, ca * sg + sa * sb * cg),
        (sa * cg + ca * sb * sg, ca * cb, sa * sg - ca * sb * cg),
        (-cb * sg, sb, cb * cg),
    )


def zxy_from_matrix(m: Matrix3) -> Vector3:
    """Returns alpha and gamma in [-pi, pi) and beta in [-pi/2, pi/2] with R = Rz(alpha) Rx(beta) Ry(gamma).

    At beta = +-pi/2 only alpha +- gamma is determined: there gamma = 0.
    """
    # Rz Rx Ry is Rx Ry Rz with the axes renamed z, x, y -> x, y, z.
    order = (2, 0, 1)
    renamed = tuple(tuple(m[i][j] for j in order) for i in order)
    alpha, beta, gamma = xyz_from_matrix(renamed)  # type: ignore[arg-type]
    return alpha, beta, gamma


def matrix_from_quaternion(q: Quaternion) -> Matrix3:
    """Returns the rotation of a quaternion (w, x, y, z) of any length but zero."""
    w, x, y, z = q
    scale = 2 / (w * w + x * x + y * y + z * z)
    return (
        (1 - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)),
        (scale * (x * y + w * z), 1 - scale * (x * x + z * z), scale * (y * z - w * x)),
        (scale * (x * z - w * y), scale * (y * z + w * x), 1 - scale * (x * x + y * y)),
    )


def quaternion_from_matrix(m: Matrix3) -> Quaternion:
    """Returns the unit quaternion (w, x, y, z) with w >= 0 of a rotation.

    Four times the outer product q q^T is linear in the matrix; its row with the largest diagonal entry gives q without
    cancellation and without a root near zero, at every rotation.
    """
    (a, b, c), (d, e, f), (g, h, i) = m
    rows = (
        (1 + a + e + i, h - f, c - g, d - b),
        (h - f, 1 + a - e - i, b + d, c + g),
        (c - g, b + d, 1 - a + e - i, f + h),
        (d - b, c + g, f + h, 1 - a - e + i),
    )
    best, size = rows[0], rows[0][0]
    for k in (1, 2, 3):
        larger = rows[k][k] > size
        best = tuple(jnp.where(larger, new, old) for new, old in zip(rows[k], best, strict=True))
        size = jnp.where(larger, rows[k][k], size)
    sign = jnp.where(best[0] < 0, -1.0, 1.0)
    length = jnp.sqrt(sum(entry * entry for entry in best))  # type: ignore[arg-type]
    return tuple(sign * entry / length for entry in best)  # type: ignore[return-value]


def rotation_angle(m: Matrix3) -> Array:
    """Returns the angle in [0, pi] of a rotation: its geodesic distance from the identity on SO(3)."""
    w, x, y, z = quaternion_from_matrix(m)
    square = x * x + y * y + z * z
    sine = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    angle = 2 * direction_angle(sine, w)
    return jnp.where(angle < 0, math.pi, angle)


def multiply(m: Matrix3, n: Matrix3) -> Matrix3:
    """Returns the product of two matrices."""
    return tuple(tuple(m[i][0] * n[0][j] + m[i][1] * n[1][j] + m[i][2] * n[2][j] for j in range(3)) for i in range(3))  # type: ignore[return-value]


def apply(m: Matrix3, v: Vector3) -> Vector3:
    """Returns the product of a matrix and a vector."""
    return tuple(row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in m)  # type: ignore[return-value]


def transpose(m: Matrix3) -> Matrix3:
    """Returns the transpose, the inverse of a rotation."""
    return tuple(zip(*m, strict=True))  # type: ignore[return-value]


def as_array(m: Matrix3) -> Array:
    """Returns a matrix of tuples as one array ``(..., 3, 3)``."""
    flat = jnp.stack(jnp.broadcast_arrays(*(entry for row in m for entry in row)), axis=-1)
    return flat.reshape(*flat.shape[:-1], 3, 3)


def from_array(array: Array) -> Matrix3:
    """Returns an array ``(..., 3, 3)`` as a matrix of tuples."""
    return tuple(tuple(array[..., i, j] for j in range(3)) for i in range(3))  # type: ignore[return-value]
