"""Kernels of the analytic 3-RPR: all assembly modes by a cubic and a square root, and their number by signs.

Notation: r_i = rho_i^2, S = sin(phi/2), C = cos(phi/2), A = r1 - r2, B = r1 - r3, g = c3 S - d3 C. In the coordinates
p = x C + y S, h = y C - x S of the platform point, leg 2 minus leg 1 and leg 3 minus leg 1 are

    4 c2 S h + 4 c2^2 S^2 + A = 0        4 g h + 4 g^2 + B = 0

two equations in h alone; eliminating h leaves the binary cubic
4 c2 S g (c2 S - g) + (A g - c2 S B)(S^2 + C^2) in S : C, and leg 1 is the circle p^2 + h^2 = r1. Every real root with
h^2 < r1 carries two assembly modes, +p and -p.

References:
    Wenger and Chablat 2009, Eqs. (4)-(7). The cubic (7) is correct as printed. The print solves "(4) or
    (5)", but (4) vanishes at t = 0 and (5) at c3 t = d3: here both are used, in least squares. The print
    counts 6, 4 or 2 solutions by the number of real roots; 0 is as possible, and one real root may carry
    0 or 2, three may carry 0, 2, 4 or 6.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxkin.core.branches import Lane
from jaxkin.core.errors import Status
from jaxkin.core.mechanism import Count
from jaxkin.core.precision import TOLERANCES
from jaxkin.numerics import cubic as cubics
from jaxkin.numerics import quarter
from jaxkin.numerics.fusion import materialise

Geometry = tuple[Array, Array, Array]


def characteristic_cubic(geometry: Geometry, a: Array, b: Array) -> cubics.Cubic:
    """Returns the coefficients of Eq. (7), from S^3 to C^3, for a = r1 - r2 and b = r1 - r3."""
    c2, c3, d3 = geometry
    leg = c3 * a - c2 * b
    return (
        leg + 4 * c2 * c3 * (c2 - c3),
        d3 * (4 * c2 * (2 * c3 - c2) - a),
        leg - 4 * c2 * d3 * d3,
        -d3 * a,
    )


def forward(geometry: Geometry, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
    """Solves the forward kinematics in closed form, without trigonometric functions but for phi itself.

    Lanes 2k and 2k + 1 hold the pair (+p, -p) of the k-th angle; pairs of real poses come first, by
    ascending phi in [-pi, pi); a double pose p = 0 fills the first lane of its pair.
    """
    rho1, rho2, rho3 = joints
    a, b = (rho1 - rho2) * (rho1 + rho2), (rho1 - rho3) * (rho1 + rho3)
    roots = cubics.real_roots(characteristic_cubic(geometry, a, b), TOLERANCES.double_angle, TOLERANCES.triple_angle)
    excess = [_excess(geometry, rho1, a, b, u, _sharpness(u, roots)) for u in roots.quarters]
    doubt = roots.doubtful
    for share in excess:
        # A p^2 that is not zero, but within ten times its rounding of it.
        doubt = doubt | (jnp.abs(share) > 1) & (jnp.abs(share) <= 10)
    keys = [jnp.where(share >= -1, u, quarter.NO_ANGLE) for u, share in zip(roots.quarters, excess, strict=True)]
    low, high = jnp.minimum(keys[0], keys[1]), jnp.maximum(keys[0], keys[1])
    middle, last = jnp.minimum(high, keys[2]), jnp.maximum(high, keys[2])
    *ordered, doubt = materialise(jnp.minimum(low, middle), jnp.maximum(low, middle), last, jnp.where(doubt, 1.0, 0.0))
    lanes: list[Lane] = []
    for u in ordered:
        times = jnp.where(u == roots.repeated, roots.times, jnp.int8(1))
        share = jnp.where(u == roots.quarters[0], excess[0], jnp.where(u == roots.quarters[1], *excess[1:]))
        lanes += _lanes(geometry, joints, _pair(geometry, rho1, a, b, u, jnp.abs(share) <= 1), u, times, doubt > 0)
    return tuple(lanes)


def _sharpness(u: Array, roots: cubics.CubicRoots) -> Array:
    """Returns a weight <= 1: an angle is known the worse, and with it p^2, the closer the other roots are."""
    weight = jnp.ones_like(u)
    for other in roots.quarters:
        weight = weight * jnp.where(u == other, 1.0, jnp.abs(u - other))
    return jnp.minimum(weight, 1.0)


def _excess(geometry: Geometry, rho1: Array, a: Array, b: Array, u: Array, sharpness: Array) -> Array:
    """Returns p^2 of a root as a multiple of what rounding makes of a zero; minus infinity where there is no root.

    With h = top / bottom from both lines in least squares, as in ``_pair`` but in u itself, so that one division does.
    """
    c2, c3, d3 = geometry
    s, c, w = 2 * u, (1 - u) * (1 + u), 1 + u * u
    k, g = c2 * s, c3 * s - d3 * c
    top = k * (4 * k * k + a * w * w) + g * (4 * g * g + b * w * w)
    bottom = 4 * (k * k + g * g) * w
    # h is known to rounding times the geometry's size, so p^2 is known to this:
    slack = TOLERANCES.double_length**2
    length = jnp.sqrt(c2 * c2 + c3 * c3 + d3 * d3)
    blur = slack * (rho1 * rho1 + jnp.abs(rho1) * length + slack * length * length)
    square = (rho1 * bottom - top) * (rho1 * bottom + top)
    return jnp.where(u < 1, square * sharpness / (blur * bottom * bottom), -jnp.inf)


class _Pair(NamedTuple):
    """The poses (+p, -p) of one root: sine and cosine of phi / 2, the length h, and p^2 (NaN: no root)."""

    s: Array
    c: Array
    h: Array
    square: Array


def _pair(geometry: Geometry, rho1: Array, a: Array, b: Array, u: Array, double: Array) -> _Pair:
    """Solves both lines for h in least squares, and the circle for p^2, which is zero where the pose is double."""
    c2, c3, d3 = geometry
    s, c = quarter.half_angle(u)
    g, k = c3 * s - d3 * c, c2 * s
    h = -(k * (4 * k * k + a) + g * (4 * g * g + b)) / (4 * (k * k + g * g))
    square = jnp.where(double, 0.0, (rho1 - h) * (rho1 + h))
    return _Pair(s, c, h, jnp.where(u < 1, square, jnp.nan))


def _lanes(
    geometry: Geometry, joints: tuple[Array, ...], pair: _Pair, u: Array, times: Array, doubtful: Array
) -> tuple[Lane, Lane]:
    """Turns one root into the lanes of +p and -p; they hold NaN exactly where p^2 is negative or NaN."""
    s, c, h, square = pair
    plain = jnp.where(doubtful, jnp.int8(Status.UNDECIDED), jnp.int8(Status.OK))
    empty = jnp.where(doubtful, jnp.int8(Status.UNDECIDED), jnp.int8(Status.NO_REAL_SOLUTION))
    p = jnp.sqrt(square)
    phi = quarter.angle(u)
    residual = _residual(geometry, joints, pair)
    lanes = []
    for sign in (1.0, -1.0):
        here = p >= 0 if sign > 0 else p > 0
        number = jnp.where(here, jnp.where(p > 0, times, 2 * times), jnp.int8(0)).astype(jnp.int8)
        status = jnp.where(number > 1, jnp.int8(Status.SINGULAR), plain)
        q = jnp.where(here, sign * p, jnp.nan)
        lanes.append(
            Lane(
                values=(q * c - h * s, q * s + h * c, jnp.where(here, phi, jnp.nan)),
                status=jnp.where(here, status, empty),
                multiplicity=number,
                residual=jnp.where(here, residual, jnp.nan),
            )
        )
    return lanes[0], lanes[1]


def _residual(geometry: Geometry, joints: tuple[Array, ...], pair: _Pair) -> Array:
    """Returns the largest dimensionless residual of the three constraints; the same for +p and -p."""
    c2, c3, d3 = geometry
    rho1, rho2, rho3 = joints
    s, c, h, square = pair
    g, k = c3 * s - d3 * c, c2 * s
    size = c2 * c2 + c3 * c3 + d3 * d3
    first = jnp.where(square == 0, jnp.abs((rho1 - h) * (rho1 + h)), 0.0) / (rho1 * rho1 + size)
    second = jnp.abs(4 * k * (h + k) + (rho1 - rho2) * (rho1 + rho2)) / (rho2 * rho2 + size)
    third = jnp.abs(4 * g * (h + g) + (rho1 - rho3) * (rho1 + rho3)) / (rho3 * rho3 + size)
    return jnp.maximum(first, jnp.maximum(second, third))


def count(geometry: Geometry, joints: tuple[Array, ...]) -> Count:
    """Counts the assembly modes without finding one.

    B2 - A2 = (B1 - A1) + c2 (cos phi - 1, sin phi), so by the triangle inequality a root of the cubic carries
    real poses exactly if |rho1 - rho2| <= 2 |c2 S| <= rho1 + rho2. Sturm's chain counts the roots on these two arcs
    from its signs at their four ends. There h = +-rho1, so the cubic is c2 S (rho3^2 - (2 g + h)^2): a form without
    cancellation, which vanishes exactly on the surfaces Q1..Q4 of Wenger and Chablat 2009.
    """
    c2, c3, d3 = geometry
    rho1, rho2, rho3 = joints
    chain = cubics.sturm_chain(
        characteristic_cubic(geometry, (rho1 - rho2) * (rho1 + rho2), (rho1 - rho3) * (rho1 + rho3)),
        TOLERANCES.undecided,
    )
    half = 0.5 / jnp.abs(c2)
    near, far = jnp.abs(rho1 - rho2) * half, (rho1 + rho2) * half
    turn = jnp.where(c2 < 0, -1.0, 1.0)
    inner = jnp.where(rho2 >= rho1, rho1, -rho1) * turn
    undecided = chain.undecided | (jnp.abs(near - 1) <= TOLERANCES.undecided)
    variations = []
    for sine, h in ((near, inner), (far, -rho1 * turn)):
        s = jnp.minimum(sine, 1.0)
        c = jnp.sqrt((1 - s) * (1 + s))
        # A rounding of s moves c by as much divided by c.
        slope = jnp.where(c < 1e-4, 3e-8 * jnp.abs(d3), 0.0)
        for side in (1.0, -1.0):
            reach = 2 * (side * c3 * s - d3 * c) + side * h
            value = side * turn * (rho3 - reach) * (rho3 + reach)
            scale = rho3 + rho1 + jnp.abs(c3) + jnp.abs(d3)
            close = jnp.abs(jnp.abs(reach) - rho3) <= TOLERANCES.undecided * scale + slope
            undecided = undecided | close & (sine <= 1)
            variations.append(cubics.sign_variations(chain, value, side * s, c))
    near_plus, near_minus, far_plus, far_minus = variations
    between = (near_plus - far_plus) + (far_minus - near_minus)
    through_infinity = jnp.where(chain.discriminant > 0, jnp.int8(3), jnp.int8(1)) - (near_minus - near_plus)
    number = 2 * jnp.where(far >= 1, through_infinity, between)
    return Count(jnp.where(near > 1, jnp.int8(0), number).astype(jnp.int8), undecided)
