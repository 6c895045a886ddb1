"""Real roots of a binary cubic a3 S^3 + a2 S^2 C + a1 S C^2 + a0 C^3 on the circle, without trigonometry."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxkin.numerics.fusion import materialise
from jaxkin.numerics.quarter import NO_ANGLE, from_half_angle

Cubic = tuple[Array, Array, Array, Array]

#: Matches no quarter tangent, and not the mark of a missing root either.
NO_REPETITION = 3.0


class CubicRoots(NamedTuple):
    """The real roots (S : C) = (sin phi/2 : cos phi/2) of a binary cubic, as quarter tangents of phi.

    Attributes:
        quarters: tan(phi/4) of each root, in no particular order; ``NO_ANGLE`` where there is none.
        repeated: tan(phi/4) of the double or triple root; ``NO_REPETITION`` where there is none.
        times: Its multiplicity, 2 or 3, int8.
        doubtful: True where a pair of roots meets, or misses, outside the tolerance but within ten times.
    """

    quarters: tuple[Array, Array, Array]
    repeated: Array
    times: Array
    doubtful: Array


def evaluate(cubic: Cubic, s: Array, c: Array) -> Array:
    """Returns the value of the form at (s, c)."""
    a3, a2, a1, a0 = cubic
    return ((a3 * s + a2 * c) * s + a1 * c * c) * s + a0 * c * c * c


def _chart(cubic: Cubic) -> tuple[Cubic, Array, Array]:
    """Chooses, of four charts 45 degrees apart, the one whose infinity is farthest from a root.

    With (s0, c0) at infinity, S = t s0 - c0 and C = t c0 + s0. Three roots cannot lie near all four.
    """
    a3, a2, a1, a0 = cubic
    up, down = a3 + a1, a2 + a0
    sizes = (jnp.abs(a3), jnp.abs(a0), jnp.abs(up + down) * 8**-0.5, jnp.abs(up - down) * 8**-0.5)
    straight, oblique = jnp.maximum(sizes[0], sizes[1]), jnp.maximum(sizes[2], sizes[3])
    index = jnp.where(
        straight >= oblique,
        jnp.where(sizes[0] >= sizes[1], 0.0, 1.0),
        jnp.where(sizes[2] >= sizes[3], 2.0, 3.0),
    )
    (index,) = materialise(index)
    wide, skew = 3 * (a3 + a0) - a2 - a1, 3 * (a0 - a3) + a1 - a2

    def pick(*choices: ArrayLike) -> Array:
        return jnp.where(
            index < 1.5,
            jnp.where(index < 0.5, choices[0], choices[1]),
            jnp.where(index < 2.5, choices[2], choices[3]),
        )

    chart = (
        pick(a3, a0, up + down, up - down),
        pick(a2, -a1, skew, wide),
        pick(a1, a2, wide, -skew),
        pick(a0, -a3, down - up, up + down),
    )
    return chart, pick(1.0, 0.0, 1.0, 1.0), pick(0.0, 1.0, 1.0, -1.0)


def _rough_cbrt(x: Array) -> Array:
    """Returns the cube root of x >= 0 within 5 %: a third of the exponent, in integer arithmetic."""
    bits = jax.lax.bitcast_convert_type(x.astype(jnp.float32), jnp.int32)
    return jax.lax.bitcast_convert_type(bits // 3 + 709921077, jnp.float32).astype(x.dtype)


def _isolated_root(p: Array, q: Array) -> Array:
    """Returns the root of y^3 + p y + q farthest from the other two, by two steps of Halley's and one of Newton's.

    It has the sign of -q; with Q = |q| it is the only positive root of Y^3 + p Y - Q if p > 0, and the
    largest one (in [sqrt 3, 2] m, m^2 = -p/3, where there are three) if p < 0. The start is within 12 %, then the
    relative error is under 3e-4, 1e-11, and rounding.
    """
    big = jnp.abs(q)
    k = _rough_cbrt(big)
    square = jnp.maximum(-p, 0.0) / 3
    m = jnp.sqrt(square)
    shallow = big <= 2 * square * m
    # A division takes as long as a dozen multiplications: one for the three cases. For p > 0 the fraction
    # has the right limits and fits between.
    above, kk = jnp.maximum(p, 0.0), k * k
    base = jnp.where(p > 0, 0.0, jnp.where(shallow, m * 3**0.5, k))
    numerator = jnp.where(p > 0, big * (kk + 0.25 * above), jnp.where(shallow, 0.134 * big, square))
    denominator = jnp.where(p > 0, (kk + 0.583 * above) * kk + 0.25 * above * above, jnp.where(shallow, square, k))
    y = base + numerator / jnp.maximum(denominator, 1e-200)
    tiny = jnp.finfo(p.dtype).tiny
    for _ in range(2):
        value, slope = (y * y + p) * y - big, 3 * y * y + p
        y = jnp.maximum(y - 2 * value * slope / (2 * slope * slope - 6 * value * y + tiny), 0.0)
    # The slope is positive here, and zero only where p = q = 0.
    y = y - ((y * y + p) * y - big) / (3 * y * y + p + tiny)
    return jnp.where(q > 0, -y, y)


def real_roots(cubic: Cubic, double_angle: float, triple_angle: float) -> CubicRoots:
    """Finds the real roots of a binary cubic; none of its coefficients needs to be non-zero.

    A root at infinity (C = 0) is as good as any. The isolated root by Halley's iteration, the other two from
    the deflated quadratic.

    Args:
        cubic: (a3, a2, a1, a0), arrays of one shape; not all zero.
        double_angle: Two roots closer than this (or than rounding can resolve), measured as the angle
            2 atan(S/C), are one double root.
        triple_angle: Three roots within this angle are one triple root, placed at their mean, which
            rounding moves least.

    Returns:
        Up to three roots, in no particular order; a pair of complex roots as close to the real circle as
        ``double_angle`` counts as a double root.
    """
    (b3, b2, b1, b0), s0, c0 = _chart(cubic)
    safe = jnp.where(b3 == 0, 1.0, b3)
    b2, b1, b0 = b2 / safe, b1 / safe, b0 / safe
    mean = -b2 / 3
    p = b1 - b2 * b2 / 3
    q = ((mean + b2) * mean + b1) * mean + b0
    (y,) = materialise(_isolated_root(p, q))
    gap = -3 * y * y - 4 * p

    # An angle d at t is a length d (1 + t^2) / 2 on the chart's line.
    pair_mean = mean - y / 2
    pair_scale = (1 + pair_mean * pair_mean) / 2
    spread = triple_angle * (1 + mean * mean) / 2
    # The nearer the third root, the less rounding lets a pair be resolved.
    nearest = jnp.maximum(jnp.abs(y), spread)
    remoteness = 1 / nearest
    crowding = jnp.maximum(1.0, 0.05 * pair_scale * remoteness)
    # Rounding of p and q moves the gap by this, where the coefficients are large.
    size = jnp.abs(b1) + b2 * b2
    blur = 8 * jnp.finfo(p.dtype).eps * (4 * size + 3 * (jnp.abs(b0) + jnp.abs(b2) * size) * remoteness)
    tolerance = jnp.maximum((double_angle * pair_scale) ** 2 * crowding, blur)
    double = jnp.abs(gap) <= tolerance
    triple = (jnp.abs(y) <= spread) & (jnp.abs(gap) <= spread * spread)
    half = jnp.where(double, 0.0, jnp.sqrt(jnp.maximum(gap, 0.0)) / 2)

    def quarter(t: Array) -> Array:
        return from_half_angle(t * s0 - c0, t * c0 + s0)

    alone = quarter(jnp.where(triple, mean, mean + y))
    first, second = quarter(pair_mean - half), quarter(pair_mean + half)
    pair = (double | (gap > 0)) & ~triple
    return CubicRoots(
        quarters=(alone, jnp.where(pair, first, NO_ANGLE), jnp.where(pair & ~double, second, NO_ANGLE)),
        repeated=jnp.where(triple, alone, jnp.where(double, first, NO_REPETITION)),
        times=jnp.where(triple, jnp.int8(3), jnp.int8(2)),
        doubtful=(jnp.abs(gap) <= 10 * tolerance) & ~double & ~triple,
    )


class SturmChain(NamedTuple):
    """Sturm's chain of a binary cubic in the chart t = S/C, made for signs alone.

    Attributes:
        slope: Coefficients of the derivative, times the sign of a3.
        remainder: Coefficients of the linear remainder, made positive with a3.
        discriminant: Its sign decides between one and three real roots.
        undecided: True where rounding could have turned that sign.
        sign: The sign of a3, by which values of the form must be multiplied.
    """

    slope: Cubic
    remainder: tuple[Array, Array]
    discriminant: Array
    undecided: Array
    sign: Array


def sturm_chain(cubic: Cubic, undecided: float) -> SturmChain:
    """Builds Sturm's chain of a binary cubic; a vanishing a3 is the limit of a small positive one.

    Args:
        cubic: (a3, a2, a1, a0).
        undecided: Share of the sum of its terms' magnitudes under which the discriminant's sign is
            flagged.
    """
    a3, a2, a1, a0 = cubic
    sign = jnp.where(a3 < 0, -1.0, 1.0)
    # The discriminant by the Hessian form H = h2 S^2 + h1 S C + h0 C^2: disc = -(h1^2 - 4 h2 h0) / 3.
    h2, h1, h0 = a2 * a2 - 3 * a3 * a1, a2 * a1 - 9 * a3 * a0, a1 * a1 - 3 * a2 * a0
    disc = (4 * h2 * h0 - h1 * h1) / 3
    # Each coefficient is known to the rounding of the largest, small ones too: that counts for a root near infinity.
    n3, n2, n1, n0 = (jnp.abs(value) for value in cubic)
    blur = 1e-4 * (n3 + n2 + n1 + n0)
    m2 = n2 * n2 + 3 * n3 * n1 + (2 * n2 + 3 * (n3 + n1)) * blur
    m1 = n2 * n1 + 9 * n3 * n0 + (n2 + n1 + 9 * (n3 + n0)) * blur
    m0 = n1 * n1 + 3 * n2 * n0 + (2 * n1 + 3 * (n2 + n0)) * blur
    noise = undecided * (4 * m2 * m0 + m1 * m1)
    slope = (sign * a3, sign * a2, sign * a1, jnp.zeros_like(a0))
    return SturmChain(slope, (2 * h2, h1), disc, jnp.abs(disc) <= noise, sign)


def sign_variations(chain: SturmChain, value: Array, s: Array, c: Array) -> Array:
    """Counts the sign variations of the chain at (s : c), c >= 0, given the value of the form there.

    The value is an argument because the caller may know it by a formula that loses no digits.
    """
    first = chain.sign * value < 0
    second = (3 * chain.slope[0] * s + 2 * chain.slope[1] * c) * s + chain.slope[2] * c * c < 0
    third = chain.remainder[0] * s + chain.remainder[1] * c < 0
    fourth = chain.discriminant <= 0
    return (first != second).astype(jnp.int8) + (second != third).astype(jnp.int8) + (third != fourth).astype(jnp.int8)
