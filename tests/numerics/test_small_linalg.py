"""Unrolled 3x3 algebra against numpy.linalg."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.numerics import small_linalg


def rows(matrices):
    return tuple(tuple(jnp.asarray(matrices[:, i, j]) for j in range(3)) for i in range(3))


def rotations(rng, n):
    return np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]


extremes = jax.jit(small_linalg.singular_extremes)


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
