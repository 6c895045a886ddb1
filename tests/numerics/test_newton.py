"""The search from many starts on systems whose solutions are known."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.numerics import newton

OPEN = jnp.array([jnp.inf, jnp.inf])


def search(function, low, high, period=OPEN, lanes=6):
    return newton.search(function, jnp.asarray(low, float), jnp.asarray(high, float), period, lanes)


def test_four_solutions():
    found = search(lambda x: jnp.stack([x[0] ** 2 - 1, x[1] ** 2 - 0.25]), [-2, -2], [2, 2])
    assert list(np.asarray(found.exists)) == [True] * 4 + [False] * 2
    solutions = sorted(map(tuple, np.round(np.asarray(found.x)[:4], 12)))
    assert solutions == [(-1, -0.5), (-1, 0.5), (1, -0.5), (1, 0.5)]
    assert np.asarray(found.residual)[:4].max() < 1e-14
    assert not np.asarray(found.singular)[:4].any()


def test_solutions_are_ordered_by_the_last_coordinate():
    found = search(lambda x: jnp.stack([x[0] + x[1], (x[1] - 1) * (x[1] + 1) * x[1]]), [-2, -2], [2, 2])
    np.testing.assert_allclose(np.asarray(found.x)[:3], [[1, -1], [0, 0], [-1, 1]], atol=1e-14)


def test_a_solution_on_the_seam_is_one_solution():
    period = jnp.array([jnp.inf, 2 * jnp.pi])
    found = search(lambda x: jnp.stack([x[0] - 0.3, jnp.sin(x[1])]), [-1, -np.pi], [1, np.pi], period)
    angles = np.asarray(found.x)[np.asarray(found.exists), 1]
    assert len(angles) == 2
    np.testing.assert_allclose(np.cos(angles), [-1, 1] if angles[0] < -3 else [1, -1], atol=1e-14)
    assert np.all((angles >= -np.pi) & (angles < np.pi))


def test_no_solution_and_a_singular_one():
    assert not np.asarray(search(lambda x: jnp.stack([x[0] ** 2 + 1, x[1]]), [-2, -2], [2, 2]).exists).any()
    double = search(lambda x: jnp.stack([x[0] ** 2 - x[1], x[1]]), [-1, -1], [1, 1])
    assert np.asarray(double.singular)[np.asarray(double.exists)].all()
    assert np.asarray(double.exists).any()


@pytest.mark.parametrize("dimension", [1, 2, 3, 6])
def test_the_lattice_fills_the_cube(dimension):
    points = newton.lattice(256, dimension)
    assert points.shape == (256, dimension)
    assert points.min() >= 0
    assert points.max() < 1
    # Each axis alone is nearly equidistributed.
    share = (np.sort(points, axis=0) - (np.arange(256)[:, None] + 0.5) / 256).__abs__().max()
    assert share < 0.04
