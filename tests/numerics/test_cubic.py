"""Roots of binary cubics against planted roots, numpy.roots and Sturm's theorem."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.core.precision import TOLERANCES
from jaxkin.numerics import cubic as cubics
from jaxkin.numerics import quarter

RNG_SIZE = 5000


@jax.jit
def solve(coefficients):
    roots = cubics.real_roots(tuple(coefficients), TOLERANCES.double_angle, TOLERANCES.triple_angle)
    return jnp.stack(roots.quarters), roots.repeated, roots.times


def product(forms):
    """Multiplies binary forms given by their coefficients from the highest power of S, ``(k, n)`` each."""
    result = forms[0]
    for form in forms[1:]:
        terms = np.zeros((len(result) + len(form) - 1, result.shape[1]))
        for i, left in enumerate(result):
            for j, right in enumerate(form):
                terms[i + j] += left * right
        result = terms
    return result


def planted(*angles):
    """Returns the cubics, ``(4, n)``, with the given roots phi; one array of n angles each."""
    return product([np.stack([np.cos(a / 2), -np.sin(a / 2)]) for a in map(np.asarray, angles)])


def angles_of(quarters):
    quarters = np.asarray(quarters)
    return np.where(quarters < 1, np.asarray(quarter.angle(jnp.asarray(quarters))), np.nan)


def circle_distance(a, b):
    gap = np.abs(a - b) % (2 * np.pi)
    return np.minimum(gap, 2 * np.pi - gap)


def matched(found, wanted):
    """Returns for each sample the largest distance from a wanted angle ``(m, n)`` to the nearest found one."""
    return np.nanmin(circle_distance(found[:, None], np.asarray(wanted)[None]), axis=0).max(axis=0)


def separation(*angles):
    pairs = [(0, 1), (0, 2), (1, 2)]
    return np.min([circle_distance(angles[i], angles[j]) for i, j in pairs], axis=0)


def test_three_planted_roots_are_found():
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (3, RNG_SIZE))
    quarters, _, _ = solve(planted(*angles))
    apart = separation(*angles)
    clear = apart > 1e-2
    assert clear.sum() > 0.9 * RNG_SIZE
    found = angles_of(quarters)
    assert np.all(np.isfinite(found[:, clear]))
    # A root moves by the coefficients' rounding divided by the product of its distances to the others.
    assert np.all(matched(found, angles)[clear] <= 1e-14 / apart[clear] ** 2)


def test_one_real_root_beside_a_complex_pair():
    rng = np.random.default_rng(1)
    phi, psi, depth = (
        rng.uniform(-np.pi, np.pi, RNG_SIZE),
        rng.uniform(0, np.pi, RNG_SIZE),
        rng.uniform(0.05, 2, RNG_SIZE),
    )
    cos, sin = np.cos(psi), np.sin(psi)
    pair = np.stack([cos**2 + depth * sin**2, 2 * cos * sin * (1 - depth), sin**2 + depth * cos**2])
    cubic = product([np.stack([np.cos(phi / 2), -np.sin(phi / 2)]), pair])
    quarters, repeated, _ = solve(cubic)
    assert np.all(np.sum(np.asarray(quarters) < 1, axis=0) == 1)
    assert np.all(np.asarray(repeated) == cubics.NO_REPETITION)
    assert matched(angles_of(quarters), phi[None]).max() < 1e-12


def test_agrees_with_numpy_roots():
    coefficients = np.random.default_rng(2).normal(size=(4, 2000))
    found = np.sort(angles_of(solve(coefficients)[0]), axis=0)
    for column, angles in zip(coefficients.T, found.T, strict=True):
        roots = np.roots(column)
        real = np.sort(2 * np.arctan(roots[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots.real))].real))
        np.testing.assert_allclose(angles[: len(real)], real, atol=1e-8)
        assert np.all(np.isnan(angles[len(real) :]))


def test_residuals_are_rounding():
    coefficients = np.random.default_rng(3).normal(size=(4, RNG_SIZE))
    quarters = np.asarray(solve(coefficients)[0])
    real = quarters < 1
    s, c = quarter.half_angle(jnp.asarray(np.where(real, quarters, 0.0)))
    rows = tuple(np.broadcast_to(row, (3, RNG_SIZE)) for row in coefficients)
    values = np.abs(np.asarray(cubics.evaluate(rows, s, c))) / np.linalg.norm(coefficients, axis=0)
    assert real.any(axis=0).all()
    assert values[real].max() < 1e-14


@pytest.mark.parametrize(
    ("coefficients", "angles"),
    [
        ((0, 1, -3, 2), (-np.pi, np.pi / 2, 2 * np.arctan(2.0))),
        ((0, 1, -1, 0), (-np.pi, 0, np.pi / 2)),
        ((1, 0, -1, 0), (-np.pi / 2, 0, np.pi / 2)),
        ((0, 1, 0, -1), (-np.pi, -np.pi / 2, np.pi / 2)),
        ((1, -6, 11, -6), 2 * np.arctan([1, 2, 3])),
        ((1, 0, 0, 1), (-np.pi / 2,)),
        ((1, 0, 1, 0), (0,)),
        ((0, 1, 0, 1), (-np.pi,)),
    ],
    ids=["a3=0", "a3=a0=0", "a0=a2=0", "a3=a1=0", "plain", "one root", "root 0 alone", "root pi alone"],
)
def test_vanishing_coefficients(coefficients, angles):
    column = np.array(coefficients, float)[:, None]
    found = np.sort(angles_of(solve(column)[0])[:, 0])
    np.testing.assert_allclose(found[: len(angles)], np.sort(angles), atol=1e-15)
    assert np.all(np.isnan(found[len(angles) :]))
    scaled = np.sort(angles_of(solve(-(2.0**-200) * column)[0])[:, 0])
    np.testing.assert_allclose(scaled, found, atol=1e-15)


def test_no_chart_has_a_blind_spot():
    # The four charts have their infinity at 0, pi and +-pi/2: put roots there and just beside, two or three at a time.
    spots = np.array([0, np.pi, np.pi / 2, -np.pi / 2])
    near = (spots[:, None] + np.array([0, 1e-15, -1e-12, 1e-8, 1e-3])).ravel()
    grid = np.stack(np.meshgrid(near, near, np.linspace(-3, 3, 7), indexing="ij")).reshape(3, -1)
    grid = grid[:, separation(*grid) > 1e-2]
    found = angles_of(solve(planted(*grid))[0])
    assert np.isfinite(found).all()
    assert matched(found, grid).max() < 1e-10
    assert found.min() >= -np.pi
    assert found.max() < np.pi


def test_double_roots():
    rng = np.random.default_rng(4)
    twice, once = rng.uniform(-np.pi, np.pi, (2, RNG_SIZE))
    keep = circle_distance(twice, once) > 0.1
    quarters, repeated, times = (np.asarray(a) for a in solve(planted(twice, twice, once)[:, keep]))
    assert np.all(times == 2)
    assert np.all(np.sum(quarters < 1, axis=0) == 2)
    assert np.all(np.any(quarters == repeated, axis=0))
    assert circle_distance(4 * np.arctan(repeated), twice[keep]).max() < 1e-6
    assert matched(angles_of(quarters), once[None, keep]).max() < 1e-10


def test_triple_roots():
    angles = np.concatenate(
        [np.random.default_rng(5).uniform(-np.pi, np.pi, RNG_SIZE), [0, np.pi, np.pi / 2, -np.pi / 2]]
    )
    quarters, repeated, times = (np.asarray(a) for a in solve(planted(angles, angles, angles)))
    assert np.all(times == 3)
    assert np.all(np.sum(quarters < 1, axis=0) == 1)
    assert np.all(quarters.min(axis=0) == repeated)
    # The mean of three roots is a coefficient: it keeps nearly all digits.
    assert circle_distance(4 * np.arctan(repeated), angles).max() < 1e-13


@pytest.mark.parametrize(("gap", "distinct"), [(1e-8, 2), (1e-7, 2), (3e-6, 3), (1e-5, 3)])
def test_the_tolerance_separates_double_from_two(gap, distinct):
    rng = np.random.default_rng(6)
    middle = rng.uniform(-np.pi, np.pi, RNG_SIZE)
    third = middle + rng.choice([-1, 1], RNG_SIZE) * rng.uniform(0.7, np.pi, RNG_SIZE)
    quarters = np.asarray(solve(planted(middle - gap / 2, middle + gap / 2, third))[0])
    assert np.all(np.sum(quarters < 1, axis=0) == distinct)


def test_sturm_counts_roots_between_two_angles():
    rng = np.random.default_rng(7)
    roots = rng.uniform(-np.pi, np.pi, (3, RNG_SIZE))
    ends = np.sort(rng.uniform(-np.pi, np.pi, (2, RNG_SIZE)), axis=0)
    clear = (separation(*roots) > 1e-2) & (np.abs(roots[:, None] - ends).min(axis=(0, 1)) > 1e-4)
    wanted = np.sum((roots > ends[0]) & (roots < ends[1]), axis=0)
    for sign in (1.0, -1.0):
        cubic = tuple(sign * planted(*roots))
        chain = cubics.sturm_chain(cubic, TOLERANCES.undecided)
        variations = []
        for end in ends:
            s, c = jnp.sin(end / 2), jnp.cos(end / 2)
            variations.append(np.asarray(cubics.sign_variations(chain, cubics.evaluate(cubic, s, c), s, c)))
        assert clear.sum() > 0.9 * RNG_SIZE
        assert not np.asarray(chain.undecided)[clear].any()
        np.testing.assert_array_equal((variations[0] - variations[1])[clear], wanted[clear])


def test_discriminant_tells_one_root_from_three_and_flags_doubles():
    coefficients = np.random.default_rng(8).normal(size=(4, 2000))
    chain = cubics.sturm_chain(tuple(jnp.asarray(coefficients)), TOLERANCES.undecided)
    number = [np.sum(np.abs(np.roots(column).imag) < 1e-9) for column in coefficients.T]
    np.testing.assert_array_equal(np.where(np.asarray(chain.discriminant) > 0, 3, 1), number)
    twice, once = np.random.default_rng(9).uniform(-np.pi, np.pi, (2, 2000))
    assert np.all(cubics.sturm_chain(tuple(planted(twice, twice, once)), TOLERANCES.undecided).undecided)
