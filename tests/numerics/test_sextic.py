"""Roots of trigonometric polynomials of degree 3 against planted roots and sign scans."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.numerics import sextic

SIZE = 4000


def planted(*factors):
    """Returns Fourier coefficients ``(7, n)`` of a product of factors m - cos(phi - psi), given as (m, psi)."""
    phi = 2 * np.pi * np.arange(7) / 7
    values = np.ones((7, np.size(factors[0][0])))
    for m, psi in factors:
        values *= m - np.cos(phi[:, None] - psi)
    return sextic.fourier_matrix() @ values


def pair(first, second):
    """Returns (m, psi) of the factor with these two roots."""
    return np.cos((first - second) / 2), (first + second) / 2


@jax.jit
def fast(fourier):
    return sextic.real_roots(fourier, jnp.sum(jnp.abs(fourier), axis=0), sextic.FAST)


@jax.jit
def careful(fourier):
    return sextic.real_roots(fourier, jnp.sum(jnp.abs(fourier), axis=0), sextic.CAREFUL)


SOLVERS = pytest.mark.parametrize("solve", [fast, careful], ids=["fast", "careful"])


def angles_of(quarters):
    quarters = np.asarray(quarters)
    return np.where(quarters < 1, 4 * np.arctan(np.minimum(quarters, 1.0)), np.nan)


def circle_distance(a, b):
    gap = np.abs(a - b) % (2 * np.pi)
    return np.minimum(gap, 2 * np.pi - gap)


def evaluate(fourier, phi):
    value = fourier[0] + 0 * phi
    for k in (1, 2, 3):
        value = value + fourier[2 * k - 1] * np.cos(k * phi) + fourier[2 * k] * np.sin(k * phi)
    return value


def test_fourier_matrix_recovers_coefficients():
    fourier = np.random.default_rng(0).normal(size=(7, 50))
    phi = 2 * np.pi * np.arange(7)[:, None] / 7
    np.testing.assert_allclose(sextic.fourier_matrix() @ evaluate(fourier, phi), fourier, atol=1e-14)


@SOLVERS
@pytest.mark.parametrize("pairs", [0, 1, 2, 3])
def test_planted_roots(solve, pairs):
    rng = np.random.default_rng(pairs)
    angles = np.sort(rng.uniform(-np.pi, np.pi, (2 * pairs, SIZE)), axis=0)
    real = [pair(*angles[2 * k : 2 * k + 2]) for k in range(pairs)]
    other = [(rng.uniform(1.02, 3, SIZE), rng.uniform(-np.pi, np.pi, SIZE)) for _ in range(3 - pairs)]
    gaps = np.diff(np.concatenate([angles, angles[:1] + 2 * np.pi]), axis=0) if pairs else np.ones((1, SIZE))
    clear = gaps.min(axis=0) > 0.05
    found = angles_of(solve(planted(*real, *other)).quarters)
    assert clear.sum() > 0.1 * SIZE
    assert np.all(np.isfinite(found).sum(axis=0)[clear] == 2 * pairs)
    if pairs:
        # The fast pass leaves the last digits to Newton's iteration on the mechanism's own equations.
        error = np.nanmax(circle_distance(found[: 2 * pairs], angles)[:, clear])
        assert error < (1e-5 if solve is fast else 1e-8)


@SOLVERS
def test_counts_equal_a_sign_scan(solve):
    fourier = np.random.default_rng(4).normal(size=(7, SIZE)) * np.array([1, 1, 1, 2, 2, 2, 2])[:, None]
    grid = np.linspace(-np.pi, np.pi, 2048, endpoint=False)
    negative = evaluate(fourier[:, :, None], grid) < 0
    scan = np.sum(negative != np.roll(negative, 1, axis=1), axis=1)
    roots = solve(fourier)
    found = np.sort(angles_of(roots.quarters), axis=0)
    number = np.isfinite(found).sum(axis=0)
    assert set(number) == {0, 2, 4, 6}
    # A scan can only miss pairs that lie within one cell.
    closest = np.nanmin(np.diff(found, axis=0), axis=0, initial=9)
    assert np.all(number >= scan)
    assert np.all((number == scan) | (closest < 2 * np.pi / 2048))
    assert np.mean(number == scan) > 0.99


@SOLVERS
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_degree_drop(solve, degree):
    rng = np.random.default_rng(5)
    angles = rng.uniform(-np.pi, np.pi, (2, degree, SIZE))
    clear = np.ones(SIZE, bool)
    for a in angles.reshape(2 * degree, SIZE):
        others = circle_distance(a, angles.reshape(2 * degree, SIZE))
        clear &= np.sort(others, axis=0)[1] > 0.05
    fourier = planted((np.full(SIZE, 2.0), 0.0)) * 0 + np.eye(7)[0][:, None]
    if degree:
        fourier = planted(*(pair(*angles[:, k]) for k in range(degree)))
    assert np.abs(fourier[2 * degree + 1 :]).max(initial=0) < 1e-15
    found = angles_of(solve(fourier).quarters)
    assert np.all(np.isfinite(found).sum(axis=0)[clear] == 2 * degree)
    if degree:
        gaps = circle_distance(found[: 2 * degree, None], angles.reshape(1, 2 * degree, SIZE))
        assert np.nanmin(gaps, axis=0).max(axis=0)[clear].max() < 1e-5


@SOLVERS
def test_a_double_root_is_doubtful_and_a_critical_point(solve):
    rng = np.random.default_rng(6)
    psi, other = rng.uniform(-np.pi, np.pi, (2, SIZE))
    fourier = planted((np.ones(SIZE), psi), (np.full(SIZE, 1.5), other), (np.full(SIZE, 2.0), other + 1))
    roots = solve(fourier)
    assert np.asarray(roots.doubtful).all()
    if solve is fast:
        return
    gaps = circle_distance(4 * np.arctan(np.asarray(roots.critical)), psi)
    assert gaps.min(axis=0).max() < 1e-6
    nearest = np.take_along_axis(np.asarray(roots.closeness), gaps.argmin(axis=0)[None], axis=0)
    assert nearest.max() < 1e-12


def test_most_polynomials_are_not_doubtful():
    roots = fast(np.random.default_rng(7).normal(size=(7, SIZE)))
    assert np.mean(roots.doubtful) < 0.01
    assert not np.asarray(roots.vanishes).any()


@SOLVERS
def test_the_zero_polynomial_vanishes(solve):
    roots = solve(np.zeros((7, 3)))
    assert np.asarray(roots.vanishes).all()
    assert np.all(np.asarray(roots.quarters) >= 1)
    noise = 1e-16 * np.random.default_rng(8).normal(size=(7, 3))
    assert np.asarray(jax.jit(sextic.real_roots)(jnp.asarray(noise), jnp.ones(3)).vanishes).all()


@SOLVERS
def test_scale_does_not_matter(solve):
    fourier = np.random.default_rng(9).normal(size=(7, 200))
    for factor in (2.0**-300, 2.0**300):
        np.testing.assert_array_equal(solve(factor * fourier).quarters, solve(fourier).quarters)
