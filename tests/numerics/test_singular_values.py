"""Extreme singular values of small matrices: made to measure, and where they coincide or vanish."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.numerics import singular_values

SIZE = 300


def rotations(rng, n):
    return np.linalg.qr(rng.normal(size=(SIZE, n, n)))[0]


def rows(matrices):
    n = matrices.shape[-1]
    return [[matrices[..., i, j] for j in range(n)] for i in range(n)]


extremes = jax.jit(lambda matrices: singular_values.extremes(rows(matrices)))


def made_to_measure(rng, n, kind):
    values = np.sort(rng.uniform(0.1, 1.0, (SIZE, n)), axis=1)[:, ::-1].copy()
    if kind == "largest double":
        values[:, 1] = values[:, 0]
    if kind == "largest nearly double":
        values[:, 1] = values[:, 0] * (1 - 10 ** rng.uniform(-16, -2, SIZE))
    if kind == "smallest double":
        values[:, -2] = values[:, -1]
    if kind == "nearly singular":
        values[:, -1] = 10 ** rng.uniform(-15, -3, SIZE)
    if kind == "isotropic":
        values[:] = 1.0
    return np.sort(values, axis=1)[:, ::-1]


@pytest.mark.parametrize("n", [2, 3, 4, 6])
def test_matrices_made_to_measure(n):
    kinds = ("generic", "largest double", "largest nearly double", "smallest double", "nearly singular", "isotropic")
    for kind in kinds:
        rng = np.random.default_rng(n)
        values = made_to_measure(rng, n, kind)
        smallest, largest = extremes(rotations(rng, n) @ (values[..., None] * rotations(rng, n)))
        assert np.max(np.abs(largest / values[:, 0] - 1)) < 5e-15, kind
        assert np.max(np.abs(smallest - values[:, -1]) / values[:, 0]) < 5e-15, kind


@pytest.mark.parametrize("n", [2, 3, 6])
def test_special_matrices(n):
    one = np.ones((n, n))
    matrices = np.stack([np.zeros((n, n)), np.eye(n), one, -3 * np.eye(n)[::-1], np.full((n, n), np.nan)])
    smallest, largest = extremes(matrices)
    np.testing.assert_allclose(smallest, [0, 1, 0, 3, np.nan], atol=5e-15)
    np.testing.assert_allclose(largest, [0, 1, n, 3, np.nan], rtol=5e-15, atol=1e-36)


@pytest.mark.parametrize("n", [2, 3, 6])
def test_derivatives_are_finite_differences(n):
    matrix = jnp.asarray(np.random.default_rng(3).normal(size=(n, n)))
    step = np.random.default_rng(4).normal(size=(n, n))
    _, slopes = jax.jvp(extremes, (matrix,), (jnp.asarray(step),))
    ahead, behind = (np.asarray(extremes(matrix + h * step)) for h in (1e-6, -1e-6))
    np.testing.assert_allclose(slopes, (ahead - behind) / 2e-6, rtol=1e-6)


def slopes_of_lapack(matrices, changes, alike=1e-9):
    """Slopes of the extremes, means over the vectors of values that are alike."""
    left, values, right = np.linalg.svd(matrices)
    each = np.einsum("kia,kij,kaj->ka", left, changes, right)
    near = [np.abs(values - values[:, [k]]) <= alike * values[:, :1] for k in (-1, 0)]
    return [np.sum(n * each, axis=1) / np.sum(n, axis=1) for n in near]


@pytest.mark.parametrize(
    ("kind", "tolerance"),
    [
        ("generic", 1e-11),
        ("largest double", 1e-14),
        ("smallest double", 1e-13),
        ("nearly singular", 1e-11),
        ("isotropic", 1e-14),
        ("two small", 1e-12),
    ],
)
def test_derivatives_are_those_of_lapack(kind, tolerance):
    rng = np.random.default_rng(5)
    values = made_to_measure(rng, 3, kind)
    if kind == "two small":
        values[:, 1:] *= 1e-6
    matrices = rotations(rng, 3) @ (values[..., None] * rotations(rng, 3))
    changes = rng.normal(size=matrices.shape)
    _, found = jax.jit(lambda m, d: jax.jvp(extremes, (m,), (d,)))(matrices, changes)
    gaps = -np.diff(values, axis=1) / values[:, :1]
    # Vectors are as good as the gap to the next value; whether values this close are alike is for rounding to say.
    told = np.all((gaps < 3e-10) | (gaps > 3e-9), axis=1)
    room = np.where(gaps > 1e-9, gaps, 1.0).min(axis=1)
    for mine, theirs in zip(found, slopes_of_lapack(matrices, changes), strict=True):
        assert np.max((np.abs(mine - theirs) * room)[told]) < tolerance
    assert np.mean(told) > 0.99


def test_second_derivatives_are_finite_differences():
    rng = np.random.default_rng(6)
    matrix, step = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    for k in range(2):
        slope = jax.jit(jax.grad(lambda m, k=k: extremes(m)[k]))
        second = jax.jvp(slope, (jnp.asarray(matrix),), (jnp.asarray(step),))[1]
        ahead, behind = (slope(matrix + h * step) for h in (1e-6, -1e-6))
        np.testing.assert_allclose(second, (ahead - behind) / 2e-6, rtol=1e-6)


@pytest.mark.parametrize("n", [3, 6])
def test_derivatives_of_special_matrices_are_numbers(n):
    matrices = np.stack([np.zeros((n, n)), np.eye(n), np.ones((n, n)), -3 * np.eye(n)[::-1]])
    for order in (jax.jacfwd, jax.jacrev):
        slopes = order(lambda m: jnp.stack(extremes(m)).sum(axis=1))(matrices)
        assert np.all(np.isfinite(slopes))


# Cofactors of a matrix of nearly rank 1 are small, and alike by the size of the largest value alone.
@pytest.mark.parametrize("size", [1.0, 1e-100, 1e100])
@pytest.mark.parametrize(
    ("values", "smallest"),
    [((1, 1.5e-9, 1e-10), (0, 0, 1)), ((1, 1e-10, 1e-10), (0, 0.5, 0.5)), ((1, 1, 1e-12), (0, 0, 1))],
)
def test_derivatives_where_values_are_small(values, smallest, size):
    matrix = size * jnp.diag(jnp.array(values, float))
    slope = jax.grad(lambda m: extremes(m)[0])(matrix)
    np.testing.assert_allclose(slope, np.diag(smallest), atol=1e-9)
    second = jax.jacfwd(jax.grad(lambda m: extremes(m)[1]))(size * jnp.diag(jnp.array([3.0, 2.0, 1.0])))
    assert np.all(np.isfinite(second))
