"""Real roots of a trigonometric polynomial of degree 3 by the chain of its derivatives, none missed.

On the circle such a polynomial has at most six roots. In the chart t = tan((phi - phi0) / 2) it is a sextic; with
phi0 an angle at which it is large, no root lies near t = infinity. Between two neighbouring critical points
a polynomial is monotone, so each of its roots is bracketed by roots of its derivative, and so on down to
the quadratic.
"""

import functools
import itertools
import math
import operator
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.numerics.fusion import materialise
from jaxkin.numerics.quarter import NO_ANGLE, from_half_angle

Carry = TypeVar("Carry")

#: Angles at which a chart may have its infinity; of these, one has a value of at least cos(pi/4) of the maximum.
CHARTS = 12
#: |P| >= M cos(pi/4) at phi0 and |P| <= M keep roots pi/12 away from phi0 (compare with M cos 3 phi).
RANGE = 1.0 / math.tan(math.pi / 24) + 0.1

_ANGLES = 2 * np.pi * np.arange(CHARTS) / CHARTS


def _basis() -> np.ndarray:
    """Coefficients in t (from t^0) of (1 + t^2)^3 times 1, cos k phi, sin k phi (k = 1, 2, 3)."""
    one, z = np.polynomial.Polynomial([1, 0, 1]), np.polynomial.Polynomial([1, 1j])
    rows = [one**3]
    for k in (1, 2, 3):
        # e^{i phi} = (1 + i t)^2 / (1 + t^2)
        power = z ** (2 * k) * one ** (3 - k)
        rows += [np.polynomial.Polynomial(power.coef.real), np.polynomial.Polynomial(power.coef.imag)]
    return np.array([np.pad(np.real(row.coef), (0, 7 - len(row.coef))) for row in rows])


_BASIS = _basis()


class SexticRoots(NamedTuple):
    """Roots and critical points of a trigonometric polynomial of degree 3, on a leading axis.

    Attributes:
        quarters: ``(6, n)`` tan(phi/4) of the roots, ascending; ``NO_ANGLE`` where there is none.
        critical: ``(5, n)`` tan(phi/4) of the critical points, ascending from an angle of the solver's
            choice; a place where nothing happens if there are fewer.
        closeness: ``(5, n)`` size of the polynomial there, as a share of its maximum.
        gap: ``(5, n)`` angle between the two roots that the parabola there has, real or complex.
        doubtful: ``(n,)`` True where roots nearly meet, so that the signs that bracket them could be misjudged.
        vanishes: ``(n,)`` True where the polynomial is zero to rounding everywhere.
    """

    quarters: Array
    critical: Array
    closeness: Array
    gap: Array
    doubtful: Array
    vanishes: Array


def fourier_matrix() -> np.ndarray:
    """Returns the (7, 7) matrix that takes values at 7 equal angles to (mean, cos 1, sin 1, ..., sin 3)."""
    angles = 2 * np.pi * np.arange(7) / 7
    rows = [np.ones(7) / 7]
    for k in (1, 2, 3):
        rows += [np.cos(k * angles) * 2 / 7, np.sin(k * angles) * 2 / 7]
    return np.array(rows)


def _turned(fourier: Array, cos: Array, sin: Array) -> Array:
    """Returns the Fourier coefficients in psi = phi - phi1, given cos phi1 and sin phi1."""
    rows, c, s = [fourier[0]], cos, sin
    for k in (1, 2, 3):
        a, b = fourier[2 * k - 1], fourier[2 * k]
        rows += [a * c + b * s, b * c - a * s]
        c, s = c * cos - s * sin, s * cos + c * sin
    return jnp.stack(materialise(*rows))


def _chart(fourier: Array) -> tuple[Array, Array, Array]:
    """Returns the largest of the sampled magnitudes, and cos and sin of half the angle where it is."""
    scale = jnp.zeros_like(fourier[0])
    cos, sin = jnp.ones_like(scale), jnp.zeros_like(scale)
    for phi0 in _ANGLES:
        value = fourier[0]
        for k in (1, 2, 3):
            value = value + math.cos(k * phi0) * fourier[2 * k - 1] + math.sin(k * phi0) * fourier[2 * k]
        better = jnp.abs(value) > scale
        scale = jnp.where(better, jnp.abs(value), scale)
        cos = jnp.where(better, math.cos(phi0 / 2), cos)
        sin = jnp.where(better, math.sin(phi0 / 2), sin)
    scale, cos, sin = materialise(scale, cos, sin)
    return scale, cos, sin


def _horner(coefficients: list[Array], t: Array) -> Array:
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * t + coefficient
    return value


def _root_between(chain: list[list[Array]], low: Array, high: Array, halvings: int, steps: int) -> Array:
    """Finds the root of chain[0] between two points, or a point between them where there is none.

    First a few bisections, whose only state is the lower end; then Cauchy's iteration, which follows the
    parabola through value, slope and curvature: exact for the two roots of a near-double pair, where
    Newton's would creep.
    """
    rising = _horner(chain[0], low) < 0
    turn = jnp.where(rising, 1.0, -1.0)

    def halve(_: object, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, width = bracket[0], bracket[1] * 0.5
        return jnp.where((_horner(chain[0], low + width) < 0) == rising, low + width, low), width

    low, width = materialise(*_repeat(halvings, halve, (low, high - low)))

    def cauchy(_: object, t: Array) -> Array:
        value, slope, curvature = (turn * _horner(c, t) for c in chain[:3])
        # On the bracket the slope has one sign; where rounding says otherwise it is nearly zero.
        slope = jnp.maximum(slope, 0.0)
        root = jnp.sqrt(jnp.maximum(slope * slope - 2 * value * curvature, 0.0))
        return jnp.clip(t - 2 * value / (slope + root + _TINY), low, low + width)

    return materialise(_repeat(steps, cauchy, low + 0.5 * width))[0]


def _repeat(times: int, step: Callable[[object, Carry], Carry], start: Carry) -> Carry:
    """Repeats a step: a few times written out, which runs faster; many in a loop, which compiles faster."""
    if times > 6:
        return jax.lax.fori_loop(0, times, step, start)
    for _ in range(times):
        start = step(None, start)
    return start


_TINY = float(np.finfo(float).tiny)


#: Roots nearer than this angle, or a critical value under this share of the maximum, are doubtful,
_NEAR_ANGLE = 1e-3
_NEAR_VALUE = 1e-11
#: or a critical value that the inexactness of its place could change by this share,
_BLUR = 0.1
#: or two critical points nearer than this angle where the value is under this share of the maximum.
_CROWDED_ANGLE = 0.02
_CROWDED_VALUE = 1e-4

#: (halvings, Cauchy steps) for the critical points of each level and for the roots.
FAST = ((5, 2), (6, 3))
CAREFUL = ((8, 12), (8, 12))


def real_roots(fourier: Array, magnitude: Array, effort: tuple[tuple[int, int], tuple[int, int]] = FAST) -> SexticRoots:
    """Finds every real root of P(phi) = f0 + sum_k f_{2k-1} cos k phi + f_{2k} sin k phi, k <= 3.

    Args:
        fourier: ``(7, n)``.
        magnitude: ``(n,)`` sum of the magnitudes of the terms that P was summed from; rounding is
            measured against it.
        effort: ``FAST``, or ``CAREFUL`` where two roots nearly meet.

    Returns:
        All roots, simple ones to about 1e-14 times their condition; double ones show as a critical
        point of small ``closeness``.
    """
    scale, cos0, sin0 = _chart(fourier)
    # The chart's origin lies opposite to its infinity: half of its angle is a quarter turn further.
    cos1, sin1 = -sin0, cos0
    turned = _turned(fourier, cos1 * cos1 - sin1 * sin1, 2 * sin1 * cos1)
    vanishes = scale <= 1e-14 * magnitude
    p = jnp.tensordot(jnp.asarray(_BASIS.T), turned / jnp.where(vanishes, 1.0, scale), axes=1)

    chain = [[p[k] for k in range(7)]]
    while len(chain[-1]) > 1:
        chain.append([k * c for k, c in enumerate(chain[-1])][1:])
    borders: tuple[Array, ...] = ()
    inflections: list[Array] = []
    ends = jnp.full_like(scale, -RANGE), jnp.full_like(scale, RANGE)
    points = _quadratic_roots(*chain[4])
    for level in (3, 2, 1, 0):
        halvings, steps = effort[level == 0]
        inflections = points if level == 1 else inflections
        borders = (ends[0], *points, ends[1])
        low, high = jnp.stack(borders[:-1]), jnp.stack(borders[1:])
        points = list(_root_between(chain[level:], low, high, halvings, steps))

    def quarter(t: Array) -> Array:
        return from_half_angle(sin1 + t * cos1, cos1 - t * sin1)

    negative = [_horner(chain[0], t) < 0 for t in borders]
    quarters = [
        jnp.where((left != right) & ~vanishes, quarter(t), NO_ANGLE)
        for t, (left, right) in zip(points, itertools.pairwise(negative), strict=True)
    ]
    critical = jnp.stack(borders[1:-1])
    closeness, gap, blur = _meeting(chain, critical)
    crossing = [_horner(chain[1], t) < 0 for t in (ends[0], *inflections, ends[1])]
    turning = jnp.stack([left != right for left, right in itertools.pairwise(crossing)])
    doubtful = turning & ((gap < _NEAR_ANGLE) | (closeness < _NEAR_VALUE) | (blur > _BLUR * closeness))
    # Two critical points that meet could both be missed; it matters where the value is small as well.
    flat = jnp.stack(inflections)
    _, flat_gap, _ = _meeting(chain[1:], flat)
    crowded = (flat_gap < _CROWDED_ANGLE) & (_meeting(chain, flat)[0] < _CROWDED_VALUE)
    quarters = _sorted(quarters)
    # The ends have one sign, so the roots are even in number. The test also gives every root a second reader: with
    # one alone XLA would make the whole sorting network again for every row of the stack.
    odd = functools.reduce(operator.xor, (u < 1 for u in quarters))
    doubtful = any_row(doubtful) | any_row(crowded) | vanishes | odd
    return SexticRoots(jnp.stack(quarters), quarter(critical), closeness, gap, doubtful, vanishes)


def any_row(flags: Array) -> Array:
    """Returns ``jnp.any(flags, axis=0)``, written out: the reduction takes XLA nearly three times as long."""
    return functools.reduce(operator.or_, flags)


def _meeting(chain: list[list[Array]], t: Array) -> tuple[Array, Array, Array]:
    """Tells how nearly two roots of chain[0] meet at its critical point t.

    Returns:
        The value as a share of the maximum, the angle between the roots of the parabola there, and the
        error of the value that the inexactness of t leaves.
    """
    value, slope, curvature = (_horner(c, t) for c in chain[:3])
    width = 1 + t * t
    inverse = 1 / (jnp.abs(curvature) + _TINY)
    gap = 4 * jnp.sqrt(2 * jnp.abs(value) * inverse) / width
    return jnp.abs(value) / width**3, gap, 0.5 * slope * slope * inverse / width**3


def _sorted(unsorted: list[Array]) -> list[Array]:
    """Sorts six arrays elementwise by a network of twelve comparisons."""
    values = list(materialise(*unsorted))
    for i, j in (
        (0, 5),
        (1, 3),
        (2, 4),
        (1, 2),
        (3, 4),
        (0, 3),
        (2, 5),
        (0, 1),
        (2, 3),
        (4, 5),
        (1, 2),
        (3, 4),
    ):
        values[i], values[j] = jnp.minimum(values[i], values[j]), jnp.maximum(values[i], values[j])
    return list(materialise(*values))


def _quadratic_roots(c0: Array, c1: Array, c2: Array) -> list[Array]:
    """Returns the real roots of c0 + c1 t + c2 t^2 (or its vertex twice) in order, kept within RANGE."""
    root = jnp.sqrt(jnp.maximum(c1 * c1 - 4 * c2 * c0, 0.0))
    large = -(c1 + jnp.where(c1 < 0, -root, root)) / 2
    first = large / jnp.where(jnp.abs(c2) < _TINY, _TINY, c2)
    second = c0 / jnp.where(jnp.abs(large) < _TINY, _TINY, large)
    first, second = (jnp.clip(t, -RANGE, RANGE) for t in (first, second))
    return [jnp.minimum(first, second), jnp.maximum(first, second)]
