"""Real roots of a binary cubic a3 S^3 + a2 S^2 C + a1 S C^2 + a0 C^3 on the circle, without trigonometry."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.numerics.fusion import materialise

Cubic = tuple[Array, Array, Array, Array]


class CubicRoots(NamedTuple):
    """The real roots (S : C) of a binary cubic as unit vectors with C >= 0, up to three.

    Attributes:
        sine: S of each root.
        cosine: C of each root.
        multiplicity: 0 where there is no root, else how many roots coincide within the tolerance.
    """

    sine: tuple[Array, Array, Array]
    cosine: tuple[Array, Array, Array]
    multiplicity: tuple[Array, Array, Array]


def evaluate(cubic: Cubic, s: Array, c: Array) -> Array:
    """Returns the value of the form at (s, c)."""
    a3, a2, a1, a0 = cubic
    return ((a3 * s + a2 * c) * s + a1 * c * c) * s + a0 * c * c * c


def _chart(cubic: Cubic) -> tuple[Cubic, Array, Array]:
    """Chooses, of four charts 45 degrees apart, the one whose infinity is farthest from a root.

    With (s0, c0) at infinity, S = t s0 - c0 and C = t c0 + s0. Three roots cannot lie near all four.
    """
    a3, a2, a1, a0 = cubic
    diagonal = (a3 + a2 + a1 + a0, 3 * (a0 - a3) + a1 - a2, 3 * (a3 + a0) - a2 - a1, a0 - a3 + a2 - a1)
    antidiagonal = (a3 - a2 + a1 - a0, 3 * (a3 + a0) - a2 - a1, 3 * (a3 - a0) + a2 - a1, diagonal[0])
    one, zero = jnp.ones_like(a3), jnp.zeros_like(a3)
    charts = (
        (cubic, one, zero, 1.0),
        ((a0, -a1, a2, -a3), zero, one, 1.0),
        (diagonal, one, one, 8**-0.5),
        (antidiagonal, one, -one, 8**-0.5),
    )
    best, s0, c0, weight = charts[0]
    size = jnp.abs(best[0]) * weight
    for candidate, s1, c1, weight in charts[1:]:
        other = jnp.abs(candidate[0]) * weight
        take = other > size
        size = jnp.where(take, other, size)
        best = tuple(jnp.where(take, new, old) for new, old in zip(candidate, best, strict=True))
        s0, c0 = jnp.where(take, s1, s0), jnp.where(take, c1, c0)
    return best, s0, c0  # type: ignore[return-value]


def _rough_cbrt(x: Array) -> Array:
    """Returns the cube root of x >= 0 within 5 %: a third of the exponent, in integer arithmetic."""
    bits = jax.lax.bitcast_convert_type(x.astype(jnp.float32), jnp.int32)
    return jax.lax.bitcast_convert_type(bits // 3 + 709921077, jnp.float32).astype(x.dtype)


def _isolated_root(p: Array, q: Array) -> Array:
    """Returns the root of y^3 + p y + q farthest from the other two, by Halley's iteration.

    It has the sign of -q; with Q = |q| it is the only positive root of Y^3 + p Y - Q if p > 0, and the
    largest one (in [sqrt 3, 2] m, m^2 = -p/3, where there are three) if p < 0. The starts are within 30 %.
    """
    big = jnp.abs(q)
    k = _rough_cbrt(big)
    m = jnp.sqrt(jnp.maximum(-p, 0.0) / 3)
    tiny = jnp.finfo(p.dtype).tiny
    shallow = big <= 2 * m**3
    safe_k, safe_m = jnp.maximum(k, 1e-100), jnp.maximum(m, 1e-100)
    three = m * 3**0.5 + 0.134 * big / (safe_m * safe_m)
    single = k + m * m / safe_k
    start = jnp.where(p > 0, big / (jnp.maximum(p, 0.0) + k * k + tiny), jnp.where(shallow, three, single))
    y = start
    for _ in range(4):
        value = (y * y + p) * y - big
        slope = 3 * y * y + p
        step = 2 * value * slope / (2 * slope * slope - 6 * value * y + tiny)
        y = jnp.maximum(y - step, 0.0)
    return jnp.where(q > 0, -y, y)


def real_roots(cubic: Cubic, double_angle: float, triple_angle: float) -> CubicRoots:
    """Finds the real roots of a binary cubic; none of its coefficients needs to be non-zero.

    A root at infinity (C = 0) is as good as any. The isolated root by Halley's iteration from a start
    within 30 %, the other two from the deflated quadratic.

    Args:
        cubic: (a3, a2, a1, a0), arrays of one shape; not all zero.
        double_angle: Two roots closer than this, measured as the angle 2 atan(S/C), are one double root.
        triple_angle: Three roots within this angle are one triple root, placed at their mean, which
            rounding moves least.

    Returns:
        Up to three roots, in no particular order; a pair of complex roots as close to the real circle as
        ``double_angle`` counts as a double root.
    """
    (b3, b2, b1, b0), s0, c0 = _chart(cubic)
    b3, b2, b1, b0, s0, c0 = materialise(b3, b2, b1, b0, s0, c0)
    inverse = 1.0 / jnp.where(b3 == 0, 1.0, b3)
    b2, b1, b0 = b2 * inverse, b1 * inverse, b0 * inverse
    mean = -b2 / 3
    p = b1 - b2 * b2 / 3
    q = ((mean + b2) * mean + b1) * mean + b0
    mean, p, q, s0, c0 = materialise(mean, p, q, s0, c0)
    y = _isolated_root(p, q)
    mean, p, y, s0, c0 = materialise(mean, p, y, s0, c0)
    gap = -3 * y * y - 4 * p

    # An angle d at t is a length d (1 + t^2) / 2 on the chart's line.
    pair_mean = mean - y / 2
    pair_scale = (1 + pair_mean * pair_mean) / 2
    # The nearer the third root, the less rounding lets a pair be resolved.
    crowding = jnp.maximum(1.0, 0.05 * pair_scale / jnp.maximum(jnp.abs(y), 1e-30))
    double = jnp.abs(gap) <= (double_angle * pair_scale) ** 2 * crowding
    spread = triple_angle * (1 + mean * mean) / 2
    triple = (jnp.abs(y) <= spread) & (jnp.abs(gap) <= spread * spread)
    three = gap > 0
    half = jnp.where(double, 0.0, jnp.sqrt(jnp.maximum(gap, 0.0)) / 2)

    ts = (jnp.where(triple, mean, mean + y), pair_mean - half, pair_mean + half)
    sine, cosine = [], []
    for t in ts:
        s, c = t * s0 - c0, t * c0 + s0
        norm = jax.lax.rsqrt(s * s + c * c)
        norm = jnp.where((c < 0) | ((c == 0) & (s > 0)), -norm, norm)
        sine.append(s * norm)
        cosine.append(c * norm)
    one, zero = jnp.int8(1), jnp.int8(0)
    multiplicity = (
        jnp.where(triple, jnp.int8(3), one),
        jnp.where(triple, zero, jnp.where(double, jnp.int8(2), jnp.where(three, one, zero))),
        jnp.where(triple | double, zero, jnp.where(three, one, zero)),
    )
    flat = materialise(*sine, *cosine, *multiplicity)
    sine, cosine, multiplicity = flat[:3], flat[3:6], flat[6:]
    return CubicRoots(tuple(sine), tuple(cosine), multiplicity)  # type: ignore[arg-type]


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
    m2, m1, m0 = a2 * a2 + 3 * jnp.abs(a3 * a1), jnp.abs(a2 * a1) + 9 * jnp.abs(a3 * a0), a1 * a1 + 3 * jnp.abs(a2 * a0)
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
    return (
        (first != second).astype(jnp.int8) + (second != third).astype(jnp.int8) + (third != fourth).astype(jnp.int8)
    )
