"""The proof of a regular workspace: given for a body a little smaller than the largest, never for one larger."""

import math

import numpy as np
import pytest

import jaxkin as jk
from jaxkin.design.enclosed import proved_free
from jaxkin.design.growing import Growth
from jaxkin.design.walls import walls_of


def random_robots(make, numbers, count, share=0.08):
    rng = np.random.default_rng(11)
    return [make(*(np.asarray(numbers) * rng.uniform(1 - share, 1 + share, len(numbers)))) for _ in range(count)]


def assert_proofs(robots, place, limits=False):
    """The largest body is measured; 0.999 of it is proved free, 1.001 of it is not, nor is half as large again."""
    first = robots[0]
    objective = jk.design.regular_size(first, place, limits=limits)
    growth = Growth(
        place, walls_of("a test", first, place.center, None, limits), tuple(place.axes[k] for k in place.free), 10.0
    )
    unit = place.half[growth.growing[0]]
    for robot in robots:
        found = objective.measured(robot)
        assert found.proved, found
        size = found.value / unit
        assert 0.01 < size < 9.9
        assert proved_free(growth, robot, place.center, 0.999 * size)
        for larger in (1.001, 1.5):
            assert not proved_free(growth, robot, place.center, larger * size)


@pytest.mark.slow
def test_discs_of_the_general_3_rpr_with_thirty_degrees():
    robots = random_robots(jk.mechanisms.rpr3.general, (2.1, 0.8, 1.7, 0.9, 0.75, 1.1), 3)
    thirty = math.radians(30.0)
    place = jk.design.ball(robots[0], {"x": -1.0, "y": 2.0}, 0.5, phi=(1.5 - thirty, 1.5 + thirty))
    assert_proofs(robots, place)


@pytest.mark.slow
def test_boxes_of_the_analytic_3_rpr():
    robots = random_robots(jk.mechanisms.rpr3.analytic, (1.0, 0.3, 0.9), 3)
    assert_proofs(robots, jk.design.box(robots[0], x=(0.7, 1.1), y=(0.4, 0.8), phi=(0.1, 0.5)))


@pytest.mark.parametrize("side", [0.7, 1.0, 1.9])
def test_the_orientation_cube_of_the_3_ppps(side):
    robot = jk.mechanisms.ppps3.create(side)
    place = jk.design.box(robot, x=0.0, y=0.0, z=0.0, phi=(-1.0, 1.0), theta=(-1.0, 1.0), sigma=(-1.0, 1.0))
    growth = Growth(place, walls_of("a test", robot, place.center, None, False), ("phi", "theta", "sigma"), 10.0)
    # sin t is the inverse of the plastic number (see test_objectives_known).
    size = 0.8554675768878
    for smaller in (0.999, 1 - 1e-6):
        assert proved_free(growth, robot, place.center, smaller * size)
    for larger in (1 + 1e-6, 1.001):
        assert not proved_free(growth, robot, place.center, larger * size)
