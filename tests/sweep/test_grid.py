import math

import numpy as np
import pytest

import jaxkin as jk
from jaxkin.core.mechanism import Axis, angle

JOINTS = jk.mechanisms.rpr3.AnalyticRPR3.joint_axes


def test_open_axis_includes_both_ends_and_periodic_axis_leaves_out_the_upper():
    bound = jk.Grid(a=(0.0, 4.0, 5), phi=(-math.pi, math.pi, 4)).bind((Axis("a", "length"), angle("phi")), "pose")
    np.testing.assert_array_equal(bound.coordinate(0), [0, 1, 2, 3, 4])
    np.testing.assert_allclose(bound.coordinate(1), [-math.pi, -math.pi / 2, 0, math.pi / 2])


def test_order_is_the_mechanisms_and_numbers_fix():
    bound = jk.Grid(rho3=(0.0, 1.0, 3), rho2=2, rho1=(0.0, 1.0, 2)).bind(JOINTS, "joint")
    assert bound.shape == (2, 3)
    assert bound.free == (0, 2)
    assert bound.content() == {"rho1": [0.0, 1.0, 2], "rho2": 2.0, "rho3": [0.0, 1.0, 3]}


def test_repr_makes_the_grid_again():
    grid = jk.Grid(rho1=(0.0, 4.0, 2000), rho2=1.0)
    assert eval(repr(grid), {"Grid": jk.Grid}).axes == grid.axes


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ({}, ["no axis"]),
        ({"rho1": (0, 4, 0)}, ["rho1", "n = 0", "at least 2", "one number"]),
        ({"rho1": (0, 4, 1)}, ["rho1", "n = 1", "at least 2"]),
        ({"rho1": (4, 0, 10)}, ["rho1", "4", "0", "swap"]),
        ({"rho1": (1, 1, 10)}, ["rho1", "less than"]),
        ({"rho1": (0, 4, 2.5)}, ["rho1", "2.5", "integer"]),
        ({"rho1": (0, math.nan, 5)}, ["rho1", "nan", "finite"]),
        ({"rho1": math.inf}, ["rho1", "inf", "finite"]),
        ({"rho1": (0, 4)}, ["rho1", "(low, high, n)"]),
        ({"rho1": "0:4:5"}, ["rho1", "(low, high, n)"]),
        ({"rho1": True}, ["rho1"]),
    ],
)
def test_a_bad_axis_is_named_with_value_and_rule(axes, words):
    with pytest.raises(jk.InputError) as caught:
        jk.Grid(**axes)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ({"rho1": (0, 4, 5), "rho2": 1.0}, ["rho3", "lacks"]),
        ({"rho1": (0, 4, 5), "rho2": 1.0, "rho3": 1.0, "rho4": 1.0}, ["rho4", "rho1, rho2, rho3"]),
        ({"rho1": 1.0, "rho2": 1.0, "rho3": 1.0}, ["no free axis"]),
    ],
)
def test_a_grid_that_does_not_fit_the_mechanism_is_refused(axes, words):
    with pytest.raises(jk.InputError) as caught:
        jk.Grid(**axes).bind(JOINTS, "joint")
    for word in words:
        assert word in str(caught.value)
