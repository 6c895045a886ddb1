"""Distance between two line segments p + s u and q + t v in space, s and t in [0, 1].

Elementwise over tuples of arrays, without a branch. Parallel and crossing segments and points (u = 0) need no care of
the caller. Meant for lengths up to 1e35; details of less than 1e-37 are not resolved.
"""

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.numerics.fusion import materialise, waist
from jaxkin.numerics.small_linalg import Vector3, cross, dot

#: Denominators below are taken for zero, so that their inverse squares, in second derivatives, remain finite.
_TINY = 1e-150

#: Squared sine of an angle that may be rounding, which is not to choose among the closest points of parallel segments.
#: Taking segments at such an angle for parallel changes the distance by less than 1e-15 of the lengths.
_PARALLEL = 1e-30


def squared_distance(p: Vector3, u: Vector3, q: Vector3, v: Vector3) -> Array:
    """Returns the square of a distance that is right to 1e-15 of the lengths |u|, |v|, |p - q|.

    The gradient is finite everywhere. Where the closest points are not unique (parallel segments that overlap) it is
    that of one pair of closest points.
    """
    return _squared_distance((p[0] - q[0], p[1] - q[1], p[2] - q[2]), u, v)


def distance(p: Vector3, u: Vector3, q: Vector3, v: Vector3) -> Array:
    """Returns the distance, to 1e-15 of the lengths |u|, |v|, |p - q|; the gradient is zero where it is zero.

    Where touching segments are a rounding error apart, the gradient is that of this small distance: finite, and of no
    meaningful direction.
    """
    (squared,) = waist(squared_distance(p, u, q, v))
    apart = squared > _TINY
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, squared, 1.0)), 0.0)


def closest(p: Vector3, u: Vector3, q: Vector3, v: Vector3) -> tuple[Array, Array]:
    """Returns s and t of the closest points p + s u and q + t v; for parallel segments those with the least s."""
    return _closest((p[0] - q[0], p[1] - q[1], p[2] - q[2]), u, v)


def _clipped_ratio(numerator: Array, denominator: Array, floor: Array | float) -> Array:
    """Returns the ratio within [0, 1], and 0 where the denominator is not above the floor."""
    positive = denominator > floor
    ratio = numerator / jnp.where(positive, denominator, 1.0)
    return jnp.clip(jnp.where(positive, ratio, 0.0), 0.0, 1.0)


def _closest(w: Vector3, u: Vector3, v: Vector3) -> tuple[Array, Array]:
    """Returns s and t that minimise |w + s u - t v|: s of the lines, cut to [0, 1]; t for this s; s for this t.

    The last step changes nothing unless t was cut (Ericson, Real-Time Collision Detection, 2005, section 5.1.9), where
    rounding is left aside. The determinant of the lines' equations is |u x v|^2: uu vv - (uv)^2 has lost all digits at
    an angle of 1e-8, and the distance of crossing lines half of them. What error is left in the first s, where the
    lines are nearly parallel, the next two steps turn into one along the common direction: it costs nothing.
    """
    uu, uv, vv = dot(u, u), dot(u, v), dot(v, v)
    uw, vw = dot(u, w), dot(v, w)
    normal = cross(u, v)
    floor = jnp.maximum(_PARALLEL * uu * vv, _TINY)
    s = _clipped_ratio(dot(cross(v, w), normal), dot(normal, normal), floor)
    t = _clipped_ratio(vw + s * uv, vv, _TINY)
    s = _clipped_ratio(t * uv - uw, uu, _TINY)
    return s, t


@jax.custom_jvp
def _squared_distance(w: Vector3, u: Vector3, v: Vector3) -> Array:
    d = _between(w, u, v, *_closest(w, u, v))
    return dot(d, d)


@_squared_distance.defjvp
def _squared_distance_jvp(
    primals: tuple[Vector3, Vector3, Vector3], tangents: tuple[Vector3, Vector3, Vector3]
) -> tuple[Array, Array]:
    """The derivative at fixed s and t, exact as they minimise; the next derivative takes in how they move.

    Derivatives of s and t would multiply zeros, which are rounding errors, by up to 1 / angle^2.
    """
    dw, du, dv = tangents
    w, u, v = primals
    s, t = materialise(*_closest(w, u, v))
    d = _between(w, u, v, s, t)
    moved = (dw[0] + s * du[0] - t * dv[0], dw[1] + s * du[1] - t * dv[1], dw[2] + s * du[2] - t * dv[2])
    return _squared_distance(*primals), 2 * dot(d, moved)


def _between(w: Vector3, u: Vector3, v: Vector3, s: Array, t: Array) -> Vector3:
    """Returns the vector between two points of the segments."""
    return (w[0] + s * u[0] - t * v[0], w[1] + s * u[1] - t * v[1], w[2] + s * u[2] - t * v[2])
