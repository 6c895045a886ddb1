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


def circle_and_line(x):
    return jnp.stack([jnp.sum(x**2) - 1, x[0] - x[1]])


@pytest.mark.parametrize("start", [(3.0, -2.0), (0.1, 0.2), (-5.0, 4.0), (20.0, 1.0)])
def test_descend_reaches_a_root_from_afar(start):
    x = np.asarray(newton.descend(circle_and_line, jnp.array(start), 40))
    np.testing.assert_allclose(np.abs(x), np.sqrt(0.5), atol=1e-10)


def test_descend_ends_at_least_squares_where_there_is_no_root():
    x = newton.descend(lambda x: jnp.stack([x[0] - 1, x[0] + 1, x[1], x[1] + 3]), jnp.array([7.0, 7.0]), 60)
    np.testing.assert_allclose(x, [0, -1.5], atol=1e-6)


def test_descend_stays_near_its_start_with_fewer_equations_than_unknowns():
    x = np.asarray(newton.descend(lambda x: jnp.stack([x @ x - 1]), jnp.array([0.0, 1.1, 0.0]), 40))
    np.testing.assert_allclose(x, [0, 1, 0], atol=1e-8)


def test_descend_never_goes_up():
    def valley(x):
        return jnp.stack([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    start = jnp.array([-1.2, 1.0])
    sizes = [float(jnp.sum(valley(newton.descend(valley, start, n)) ** 2)) for n in (0, 3, 8, 15, 40)]
    assert np.all(np.diff(sizes) <= 0)
    assert sizes[-1] < 1e-20


def test_polish_doubles_the_digits_and_shortens_long_steps():
    near = jnp.array([0.705, 0.713])
    gaps = [np.max(np.abs(newton.polish(circle_and_line, near, n) - np.sqrt(0.5))) for n in (1, 2, 3)]
    assert gaps[0] < 1e-4
    assert gaps[1] < 1e-8
    assert gaps[2] < 1e-15
    moved = newton.polish(circle_and_line, jnp.array([3.0, 3.5]), steps=1, trust=1e-2) - jnp.array([3.0, 3.5])
    assert np.max(np.abs(moved)) <= 1e-2 * (1 + 1e-12)


def test_polish_takes_the_shortest_way_onto_a_curve():
    x = np.asarray(newton.polish(lambda x: jnp.stack([x @ x - 1]), jnp.array([0.6, 0.8, 0.0]) * 1.001, steps=4))
    np.testing.assert_allclose(x, [0.6, 0.8, 0.0], atol=1e-15)


def test_polish_at_a_root_stays():
    np.testing.assert_array_equal(newton.polish(lambda x: x**2 - 1, jnp.array([1.0, -1.0])), [1, -1])
