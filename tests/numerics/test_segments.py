"""Distances of segments against exact rational minimisation, derivatives against exact difference quotients."""

import itertools
import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from jaxkin.numerics import segments


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def along(p, s, u):
    return [x + s * y for x, y in zip(p, u, strict=True)]


def exact(p, u, q, v):
    """The least squared distance, s and t, exactly: the least one over all points where the minimum can be."""
    p, u, q, v = ([Fraction(float(x)) if not isinstance(x, Fraction) else x for x in a] for a in (p, u, q, v))
    w = along(p, -1, q)
    uu, uv, vv, uw, vw = dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w)

    def cut(numerator, denominator):
        return min(max(numerator / denominator, Fraction(0)), Fraction(1)) if denominator else Fraction(0)

    candidates = [(Fraction(s), cut(vw + s * uv, vv)) for s in (0, 1)]
    candidates += [(cut(t * uv - uw, uu), Fraction(t)) for t in (0, 1)]
    determinant = uu * vv - uv * uv
    if determinant:
        s, t = (uv * vw - vv * uw) / determinant, (uu * vw - uv * uw) / determinant
        if 0 <= s <= 1 and 0 <= t <= 1:
            candidates.append((s, t))
    return min((gap_squared(w, s, u, t, v), s, t) for s, t in candidates)


def gap_squared(w, s, u, t, v):
    gap = along(along(w, s, u), -t, v)
    return dot(gap, gap)


def size(p, u, q, v):
    """The lengths to which errors are proportional, and what makes 1e-35 of no account."""
    return 1e-20 + sum(float(np.linalg.norm(a)) for a in (u, v, np.subtract(p, q)))


def tuples(pair):
    return tuple(tuple(jnp.asarray(x, float) for x in a) for a in pair)


def flat(function):
    """The function of all 12 coordinates, as one array."""
    return lambda x: function(*(tuple(x[3 * k : 3 * k + 3]) for k in range(4)))


squared_distance = jax.jit(segments.squared_distance)
distance = jax.jit(segments.distance)
closest = jax.jit(segments.closest)
MODES = {"fwd": jax.jacfwd, "rev": jax.jacrev}
FUNCTIONS = {"squared": segments.squared_distance, "distance": segments.distance}
gradients = {(f, m): jax.jit(MODES[m](flat(FUNCTIONS[f]))) for f in FUNCTIONS for m in MODES}
hessians = {(f, a, b): jax.jit(MODES[b](MODES[a](flat(FUNCTIONS[f])))) for f in FUNCTIONS for a in MODES for b in MODES}


def vectors(coordinates):
    return st.tuples(coordinates, coordinates, coordinates).map(lambda a: np.array(a, float))


# Small whole numbers: most are parallel, touching, collinear, points, or more than one of these.
lattice = st.tuples(*[vectors(st.integers(-2, 2))] * 4)
generic = st.tuples(*[vectors(st.floats(-1, 1))] * 4)


@st.composite
def constructed(draw):
    """Segments at a small angle with a small gap, of unlike lengths, which meet inside, outside or at the ends."""
    p, u, other, gap = (draw(vectors(st.floats(-1, 1))) for _ in range(4))
    angle, width = (draw(st.sampled_from([0.0] + [10.0**-k for k in range(17)])) for _ in range(2))
    factor = draw(st.sampled_from([1.0, -1.0, 0.3, -7.0, 1e-5, -1e5]))
    v = factor * (u + angle * other)
    s, t = (draw(st.sampled_from([-1.0, 0.0, 0.3, 0.5, 1.0, 1.7])) for _ in range(2))
    return p, u, p + s * u - t * v + width * gap, v


pairs = st.one_of(lattice, generic, constructed())


def check(pair):
    wanted, _, _ = exact(*pair)
    tolerance, root = 1e-15 * size(*pair), math.sqrt(wanted)
    assert abs(float(distance(*tuples(pair))) - root) <= tolerance
    assert abs(float(squared_distance(*tuples(pair))) - float(wanted)) <= tolerance * (2 * root + tolerance)
    return root


@given(pairs)
def test_against_exact_minimisation(pair):
    check(pair)


@given(pairs)
def test_the_closest_points_lie_on_the_segments_and_are_closest(pair):
    s, t = (Fraction(float(a)) for a in closest(*tuples(pair)))
    assert 0 <= s <= 1
    assert 0 <= t <= 1
    p, u, q, v = ([Fraction(float(x)) for x in a] for a in pair)
    wanted, _, _ = exact(*pair)
    found = gap_squared(along(p, -1, q), s, u, t, v)
    assert math.sqrt(found) - math.sqrt(wanted) <= 1e-15 * size(*pair)


@given(generic)
def test_the_parameters_of_generic_segments(pair):
    _, u, _, v = pair
    assume(np.linalg.norm(np.cross(u, v)) > 0.01)
    _, s, t = exact(*pair)
    np.testing.assert_allclose(closest(*tuples(pair)), [float(s), float(t)], atol=1e-10)


@pytest.mark.parametrize("exponent", range(17))
def test_small_angles_and_gaps(exponent):
    # The determinant uu vv - (uv)^2 would lose all digits at 1e-8, and half of those of the distance before.
    rng, angle = np.random.default_rng(exponent), 10.0**-exponent
    for gap in (0.0, 1e-12, 1e-8, 1e-4, 1.0):
        for _ in range(40):
            p, u, other, apart = rng.normal(size=(4, 3))
            v = rng.uniform(-2, 2) * u + angle * other
            s, t = rng.uniform(-0.3, 1.3, 2)
            check((p, u, p + s * u - t * v + gap * apart, v))


def test_the_crossing_of_nearly_parallel_segments():
    for angle in (1e-4, 1e-8, 1e-12):
        found = distance(*tuples([(-0.5, -angle / 2, 0), (1, angle, 0), (-0.5, angle / 2, 0), (1, -angle, 0)]))
        assert float(found) <= 1e-16


Y, ORIGIN = (0, 1, 0), (0, 0, 0)
SPECIAL = {
    "crossing": ((-1, 0, 0), (2, 0, 0), (0, -1, 0), (0, 2, 0), 0),
    "skew": ((-1, 0, 0), (2, 0, 0), (0, -1, 3), (0, 2, 0), 3),
    "lines meet beyond an end": (ORIGIN, (1, 0, 0), (4, -4, 0), (0, 8, 0), 3),
    "lines meet beyond two ends": (ORIGIN, (1, 0, 0), (4, 4, 0), (0, 8, 0), 5),
    "equal": (ORIGIN, (1, 2, 2), ORIGIN, (1, 2, 2), 0),
    "equal and reversed": (ORIGIN, (1, 2, 2), (1, 2, 2), (-1, -2, -2), 0),
    "parallel, facing": (ORIGIN, (1, 0, 0), Y, (1, 0, 0), 1),
    "parallel, one within the other": (ORIGIN, (9, 0, 0), (3, 1, 0), (2, 0, 0), 1),
    "parallel, one around the other": ((3, 0, 0), (2, 0, 0), Y, (9, 0, 0), 1),
    "parallel, overlapping": (ORIGIN, (2, 0, 0), (1, 1, 0), (3, 0, 0), 1),
    "parallel, apart": (ORIGIN, (1, 0, 0), (4, 4, 0), (2, 0, 0), 5),
    "parallel, apart, the other way": ((4, 4, 0), (2, 0, 0), ORIGIN, (1, 0, 0), 5),
    "antiparallel, facing": (ORIGIN, (1, 0, 0), (1, 1, 0), (-1, 0, 0), 1),
    "antiparallel, overlapping": (ORIGIN, (2, 0, 0), (4, 1, 0), (-3, 0, 0), 1),
    "antiparallel, apart": (ORIGIN, (1, 0, 0), (6, 4, 0), (-2, 0, 0), 5),
    "collinear, overlapping": (ORIGIN, (2, 0, 0), (1, 0, 0), (3, 0, 0), 0),
    "collinear, touching": (ORIGIN, (2, 0, 0), (2, 0, 0), (3, 0, 0), 0),
    "collinear, apart": (ORIGIN, (2, 0, 0), (5, 0, 0), (3, 0, 0), 3),
    "collinear and reversed, apart": (ORIGIN, (2, 0, 0), (8, 0, 0), (-3, 0, 0), 3),
    "ends touch": (ORIGIN, (2, 0, 0), (2, 0, 0), (0, 1, 5), 0),
    "an end touches": (ORIGIN, (2, 0, 0), (1, 0, 0), (0, 1, 5), 0),
    "a point beside": (ORIGIN, ORIGIN, (-1, 1, 0), (2, 0, 0), 1),
    "a point before": (ORIGIN, ORIGIN, (3, 4, 0), (2, 0, 0), 5),
    "a point upon": ((1, 0, 0), ORIGIN, ORIGIN, (2, 0, 0), 0),
    "two points": (ORIGIN, ORIGIN, (3, 4, 0), ORIGIN, 5),
    "one point twice": (Y, ORIGIN, Y, ORIGIN, 0),
    "nearly a point": (ORIGIN, (1e-200, 0, 0), (-1, 1, 0), (2, 0, 0), 1),
}


@pytest.mark.parametrize("name", SPECIAL)
def test_special_positions_and_their_derivatives(name):
    *pair, wanted = SPECIAL[name]
    for p, u, q, v in (pair, [pair[2], pair[3], pair[0], pair[1]]):
        assert float(distance(*tuples((p, u, q, v)))) == wanted
        assert float(squared_distance(*tuples((p, u, q, v)))) == wanted**2
        x = np.concatenate([p, u, q, v]).astype(float)
        for mode in MODES:
            slope = np.asarray(gradients["distance", mode](x))
            if wanted == 0:
                np.testing.assert_array_equal(slope, 0.0)
            else:
                np.testing.assert_allclose(np.linalg.norm(slope[:3]), 1, rtol=1e-15)
        for found in hessians.values():
            assert np.all(np.isfinite(found(x)))


@pytest.mark.parametrize("scale", [1e-30, 1e-15, 1e15, 1e35])
@pytest.mark.parametrize("name", SPECIAL)
def test_any_unit_of_length(name, scale):
    *pair, wanted = SPECIAL[name]
    x = scale * np.concatenate(pair)
    np.testing.assert_allclose(distance(*tuples(x.reshape(4, 3))), scale * wanted, rtol=1e-14, atol=1e-15 * scale)
    for function in (*gradients.values(), *hessians.values()):
        assert np.all(np.isfinite(function(x)))


def turn(u):
    """The same segment from its other end."""
    p, u = u
    return np.add(p, u), np.negative(u)


@given(pairs)
def test_the_order_and_the_directions_do_not_matter(pair):
    p, u, q, v = pair
    wanted, tolerance = float(distance(*tuples(pair))), 1e-15 * (size(*pair) + np.linalg.norm(p) + np.linalg.norm(q))
    for first, second in itertools.product([(p, u), turn((p, u))], [(q, v), turn((q, v))]):
        for one, other in ((first, second), (second, first)):
            assert abs(float(distance(*tuples((*one, *other)))) - wanted) <= 4 * tolerance


@given(pairs, st.integers(0, 10_000))
def test_rigid_motions_do_not_matter(pair, seed):
    rng = np.random.default_rng(seed)
    rotation, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
    p, u, q, v = (rotation @ a for a in pair)
    moved = (p + shift, u, q + shift, v)
    tolerance = 1e-14 * (size(*pair) + np.linalg.norm(p) + np.linalg.norm(q) + 1)
    assert abs(float(distance(*tuples(moved))) - float(distance(*tuples(pair)))) <= tolerance


@given(pairs)
def test_derivatives_are_finite_everywhere_and_bounded(pair):
    x = np.concatenate(pair)
    for mode in MODES:
        slope = np.asarray(gradients["distance", mode](x))
        assert np.all(np.abs(slope) <= 1 + 1e-12)  # Also where they touch but for rounding.
    for found in hessians.values():
        assert np.all(np.isfinite(found(x)))


@given(lattice)
def test_the_gradient_is_that_of_a_pair_of_closest_points(pair):
    # The vector between closest points is unique, also where they are not; the squared distance is smooth in p and q.
    x = np.concatenate(pair)
    _, s, t = exact(*pair)
    p, u, q, v = pair
    vector = p - q + float(s) * u - float(t) * v
    s, t = (float(a) for a in closest(*tuples(pair)))
    wanted = 2 * np.concatenate([vector, s * vector, -vector, -t * vector])
    for mode in MODES:
        np.testing.assert_allclose(gradients["squared", mode](x), wanted, atol=1e-14)


def test_rounding_does_not_choose_among_the_closest_points_of_parallel_segments():
    rng = np.random.default_rng(3)
    for _ in range(300):
        p, u, other = rng.normal(size=(3, 3))
        gap = np.cross(u, other)
        np.testing.assert_allclose(closest(*tuples((p, u, p - u + gap, 3 * u))), [0, 1 / 3], atol=1e-13)
        np.testing.assert_allclose(closest(*tuples((p, u, p + 0.4 * u + gap, 3 * u))), [0.4, 0], atol=1e-13)
        np.testing.assert_allclose(closest(*tuples((p, u, p + 3.4 * u + gap, -3 * u))), [0.4, 1], atol=1e-13)


def regime(s, t):
    return tuple((a > 0) + (a >= 1) for a in (s, t))


def far_from_a_switch(x, step):
    """Whether the same ends of the segments are closest at all points of a coarse star around x."""
    found = {regime(*exact(*(x + sign * step * e).reshape(4, 3))[1:]) for e in np.eye(12) for sign in (1, -1)}
    return len(found) == 1


def samples():
    """Two generic positions of each of the nine regimes: s and t at 0, inside, at 1."""
    rng, kept = np.random.default_rng(0), {}
    while len(kept) < 9 or min(map(len, kept.values())) < 2:
        x = rng.uniform(-1, 1, 12)
        which = kept.setdefault(regime(*exact(*x.reshape(4, 3))[1:]), [])
        p, u, q, v = x.reshape(4, 3)
        apart = np.linalg.norm(np.cross(u, v)) > 0.3 and float(distance(*tuples((p, u, q, v)))) > 0.1
        if len(which) < 2 and apart and far_from_a_switch(x, 0.02):
            which.append(x)
    return [(key, x) for key in sorted(kept) for x in kept[key]]


def squared_along(x, direction, step):
    moved = [Fraction(float(a)) + step * Fraction(float(b)) for a, b in zip(x, direction, strict=True)]
    return exact(*(moved[3 * k : 3 * k + 3] for k in range(4)))[0]


@pytest.mark.parametrize(("which", "x"), samples())
def test_first_and_second_derivatives_against_exact_difference_quotients(which, x):
    # In rational numbers a step of 1e-6 costs no digits: the quotients are right to 1e-11.
    del which
    rng, h = np.random.default_rng(1), Fraction(1, 2**20)
    root = float(distance(*tuples(x.reshape(4, 3))))
    for _ in range(8):
        e = rng.normal(size=12)
        before, here, after = (squared_along(x, e, k * h) for k in (-1, 0, 1))
        first, second = float((after - before) / (2 * h)), float((after - 2 * here + before) / h**2)
        # d = sqrt(D): d' = D' / 2d, d'' = D'' / 2d - D'^2 / 4d^3.
        slopes = {"squared": first, "distance": first / (2 * root)}
        bends = {"squared": second, "distance": second / (2 * root) - first**2 / (4 * root**3)}
        for (name, _), found in gradients.items():
            np.testing.assert_allclose(found(x) @ e, slopes[name], rtol=1e-8, atol=1e-9)
        for (name, _, _), found in hessians.items():
            np.testing.assert_allclose(e @ found(x) @ e, bends[name], rtol=1e-7, atol=1e-8)
            np.testing.assert_allclose(found(x), found(x).T, atol=1e-11)


def test_third_derivatives_follow_the_second_ones():
    third = jax.jit(jax.jacfwd(jax.hessian(flat(segments.squared_distance))))
    hessian, h = hessians["squared", "rev", "fwd"], 1e-6
    for _, x in samples():
        e = np.random.default_rng(2).normal(size=12)
        wanted = (hessian(x + h * e) - hessian(x - h * e)) / (2 * h)
        np.testing.assert_allclose(third(x) @ e, wanted, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("angle", [1e-4, 1e-8, 1e-12, 1e-16])
def test_gradients_of_nearly_parallel_segments_are_bounded_and_agree_with_the_closest_points(angle):
    rng = np.random.default_rng(5)
    for _ in range(50):
        p, u, other, q = rng.normal(size=(4, 3))
        pair = (p, u, q, u + angle * other)
        s, t = (float(a) for a in closest(*tuples(pair)))
        vector = p - q + s * u - t * pair[3]
        wanted = 2 * np.concatenate([vector, s * vector, -vector, -t * vector])
        np.testing.assert_allclose(gradients["squared", "rev"](np.concatenate(pair)), wanted, atol=1e-13)


def test_elementwise_and_broadcasting():
    rng, n = np.random.default_rng(6), 7
    p, u, q, v = (tuple(jnp.asarray(a) for a in rng.normal(size=(3, n))) for _ in range(4))
    fixed = tuple(a[0] for a in q)
    for function in (segments.squared_distance, segments.distance):
        np.testing.assert_allclose(function(p, u, q, v), jax.vmap(function)(p, u, q, v), rtol=1e-12)
        column = tuple(a[:, None] for a in p)
        assert function(column, u, fixed, v).shape == (n, n)
        slope = jax.grad(lambda r, f=function: f(p, u, r, v).sum())(fixed)
        each = jax.vmap(jax.grad(function, argnums=2), in_axes=(0, 0, None, 0))(p, u, fixed, v)
        np.testing.assert_allclose(slope, [a.sum() for a in each], rtol=1e-12, atol=1e-12)
