"""Unrolled algebra of small matrices against numpy.linalg, and laws that hold for singular ones too."""

import flint
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxkin.numerics import singular_values, small_linalg


def rows(matrices):
    return tuple(tuple(jnp.asarray(matrices[:, i, j]) for j in range(3)) for i in range(3))


def rotations(rng, n):
    return np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]


extremes = jax.jit(singular_values.extremes)


def test_solve_and_determinant():
    rng = np.random.default_rng(0)
    matrices, right = rng.normal(size=(3000, 3, 3)), rng.normal(size=(3000, 3))
    x = np.stack(small_linalg.solve(rows(matrices), tuple(right.T)), axis=1)
    wanted = np.linalg.solve(matrices, right[..., None])[..., 0]
    condition = np.linalg.cond(matrices)
    error = np.linalg.norm(x - wanted, axis=1) / np.linalg.norm(wanted, axis=1)
    assert np.all(error < 1e-14 * condition)
    np.testing.assert_allclose(small_linalg.determinant(rows(matrices)), np.linalg.det(matrices), atol=1e-13)


def test_solve_keeps_digits_when_rows_have_different_units():
    rng = np.random.default_rng(1)
    units = 10.0 ** rng.uniform(-100, 100, (500, 3, 1))
    matrices, x = rng.uniform(1, 2, (500, 3, 3)) + 3 * np.eye(3), rng.normal(size=(500, 3))
    right = np.einsum("nij,nj->ni", matrices, x) * units[..., 0]
    found = np.stack(small_linalg.solve(rows(matrices * units), tuple(right.T)), axis=1)
    np.testing.assert_allclose(found, x, rtol=1e-12, atol=1e-13)


def test_cofactors_times_transpose_is_the_determinant():
    matrices = np.random.default_rng(2).normal(size=(100, 3, 3))
    cofactors = np.array(small_linalg.cofactors(rows(matrices))).transpose(2, 0, 1)
    product = np.einsum("nij,nkj->nik", matrices, cofactors)
    np.testing.assert_allclose(product, np.linalg.det(matrices)[:, None, None] * np.eye(3), atol=1e-13)


def test_singular_extremes_of_random_matrices():
    matrices = np.random.default_rng(3).normal(size=(5000, 3, 3)) * 10.0 ** np.arange(-50, 50, 0.02)[:, None, None]
    wanted = np.linalg.svd(matrices, compute_uv=False)
    smallest, largest = map(np.asarray, extremes(rows(matrices)))
    assert np.max(np.abs(largest / wanted[:, 0] - 1)) < 1e-14
    assert np.max(np.abs(smallest - wanted[:, 2]) / wanted[:, 0]) < 1e-14


@pytest.mark.parametrize("middle", [1.0, 0.3, 1e-3])
@pytest.mark.parametrize("tiny", [1e-6, 1e-9, 1e-12])
def test_singular_extremes_of_nearly_singular_matrices(middle, tiny):
    # The root of an eigenvalue of m^T m would be off by 1e-8.
    rng = np.random.default_rng(4)
    matrices = rotations(rng, 1000) @ np.diag([1.0, middle, tiny]) @ rotations(rng, 1000)
    smallest, largest = map(np.asarray, extremes(rows(matrices)))
    # Where the two largest coincide, the arccosine loses half of its digits.
    assert np.max(np.abs(largest - 1)) < (1e-8 if middle == 1.0 else 1e-14)
    assert np.max(np.abs(smallest - tiny)) < 2e-15 / middle + (1e-8 * tiny if middle == 1.0 else 0)


def test_singular_extremes_of_special_matrices():
    special = np.array(
        [
            np.zeros((3, 3)),
            np.eye(3),
            np.diag([2.0, 2.0, 1.0]),
            np.diag([3.0, 0.0, 0.0]),
            np.ones((3, 3)),
            [[0, -1, 0], [1, 0, 0], [0, 0, -1]],
        ]
    )
    smallest, largest = extremes(rows(special))
    np.testing.assert_allclose(smallest, [0, 1, 1, 0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(largest, [0, 1, 2, 3, 3, 1], rtol=1e-14)


sizes = st.integers(1, 5)
seeds = st.integers(0, 10_000)


def of_rank(rng, n, rank):
    """A random matrix of a rank, with singular values of order one."""
    left, right = (np.linalg.qr(rng.normal(size=(n, n)))[0] for _ in range(2))
    return left @ np.diag(np.where(np.arange(n) < rank, rng.uniform(0.5, 2, n), 0.0)) @ right


null_vector = jax.jit(small_linalg.null_vector)
solved = jax.jit(small_linalg.pivoted_solve)
determinant_by_size = jax.jit(small_linalg.expanded_determinant)
determinant_slope = jax.jit(jax.grad(small_linalg.expanded_determinant))


@given(sizes, seeds)
def test_expanded_determinant(n, seed):
    matrix = np.random.default_rng(seed).normal(size=(n, n))
    bound = np.prod(np.linalg.norm(matrix, axis=1))
    assert abs(float(determinant_by_size(matrix)) - np.linalg.det(matrix)) < 1e-13 * bound


def test_expanded_determinant_of_whole_numbers_is_exact():
    matrix = np.random.default_rng(0).integers(-9, 10, (8, 8))
    exact = int(flint.fmpz_mat(matrix.tolist()).det())
    assert float(small_linalg.expanded_determinant(jnp.asarray(matrix, float))) == exact


@given(st.integers(2, 5), seeds, st.data())
def test_the_derivative_of_the_determinant_is_the_cofactors_at_any_rank(n, seed, data):
    rng, rank = np.random.default_rng(seed), data.draw(st.integers(0, n))
    matrix = of_rank(rng, n, rank)
    slope = np.asarray(determinant_slope(matrix))
    cofactors = np.array(
        [
            [(-1) ** (i + j) * np.linalg.det(np.delete(np.delete(matrix, i, 0), j, 1)) for j in range(n)]
            for i in range(n)
        ]
    )
    np.testing.assert_allclose(slope, cofactors, atol=1e-12)
    np.testing.assert_allclose(matrix @ slope.T, np.linalg.det(matrix) * np.eye(n), atol=1e-12)
    if rank < n - 1:
        assert np.max(np.abs(slope)) < 1e-12
    elif rank == n - 1:  # The adjugate then spans the kernel.
        assert np.max(np.abs(slope)) > 1e-3


@given(st.integers(2, 5), seeds)
def test_null_vector(n, seed):
    rows_ = np.random.default_rng(seed).normal(size=(n - 1, n))
    vector = np.asarray(null_vector(rows_))
    np.testing.assert_allclose(rows_ @ vector, 0, atol=1e-12)
    whole = np.linalg.det(np.vstack([rows_, vector]))
    np.testing.assert_allclose(whole, vector @ vector, rtol=1e-9)
    assert vector @ vector > 0


def test_null_vector_in_three_dimensions_is_the_cross_product_and_vanishes_for_dependent_rows():
    a, b = np.array([1.0, 2.0, 3.0]), np.array([-4.0, 0.5, 2.0])
    np.testing.assert_allclose(small_linalg.null_vector(jnp.stack([a, b])), np.cross(a, b), rtol=1e-15)
    np.testing.assert_array_equal(small_linalg.null_vector(jnp.stack([a, 2 * a])), 0.0)
    np.testing.assert_array_equal(small_linalg.null_vector(jnp.zeros((0, 1))), [1.0])


@given(sizes, seeds)
def test_pivoted_solve(n, seed):
    rng = np.random.default_rng(seed)
    matrix, x = of_rank(rng, n, n), rng.normal(size=n)
    found = solved(matrix, matrix @ x)
    np.testing.assert_allclose(found, x, atol=1e-12)


def test_pivoted_solve_needs_its_pivots():
    matrix = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 2.0], [4.0, 0.0, 0.0]])
    np.testing.assert_array_equal(small_linalg.pivoted_solve(matrix, jnp.array([1.0, 2.0, 4.0])), [1, 1, 1])
    tiny = np.array([[1e-20, 1.0], [1.0, 1.0]])
    np.testing.assert_allclose(small_linalg.pivoted_solve(tiny, jnp.array([1.0, 2.0])), [1, 1], rtol=1e-15)


def test_pivoted_solve_of_a_singular_system_is_not_finite():
    matrix = jnp.array([[1.0, 2.0], [2.0, 4.0]])
    assert not np.all(np.isfinite(small_linalg.pivoted_solve(matrix, jnp.array([1.0, 0.0]))))
