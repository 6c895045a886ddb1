"""Enclosures enclose: values, gradients and second derivatives at points of random boxes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxkin.numerics.enclosure import UnsupportedOperation, enclosure_of, pairs, taylor_remainder

#: Everything that constraints are written with, roots of what may vanish and angles over the cut included.
FUNCTIONS = {
    "polynomial": lambda p, x: jnp.stack([x[0] ** 3 - p * x[1] * x[0], (x[0] - x[1]) * (x[0] + x[1])]),
    "trigonometric": lambda p, x: jnp.stack([jnp.sin(x[0] * x[1]) + p, jnp.cos(x[0]) ** 2 - jnp.sin(x[1])]),
    "quotient": lambda p, x: jnp.stack([x[0] / (x[1] - p), 1.0 / (1.0 + x[0] * x[0])]),
    "root": lambda p, x: jnp.stack([jnp.sqrt(x[0] + x[1] * x[1] + p), jnp.sqrt(2.0 + jnp.sin(x[0])) * x[1]]),
    "angle": lambda p, x: jnp.stack([jnp.cos(jnp.arctan2(x[0] + p, x[1])), jnp.arctan2(x[0], 4.0 + x[1])]),
    "kink": lambda p, x: jnp.stack([x[0] * jnp.abs(x[0]), jnp.where(x[1] > p, x[1] ** 2, -x[1])]),
    "arrays": lambda p, x: (jnp.stack([x, p * x[::-1]]) @ jnp.array([[1.0, -2.0], [x[0], 3.0]])).ravel()[1:],
}


@pytest.mark.parametrize("name", FUNCTIONS)
@settings(max_examples=6, deadline=None)
@given(st.integers(0, 10_000), st.floats(-3, 0.5))
def test_it_encloses(name, seed, size):
    rng = np.random.default_rng(seed)
    function, parameter, boxes = FUNCTIONS[name], rng.normal(), 24
    low = rng.normal(0, 1.5, (2, boxes))
    high = low + 10**size * rng.random((2, boxes))
    jet = enclosure_of(function, parameter, 2)(parameter, low, high)
    share = rng.choice([0.0, 1.0, 0.5, rng.random()], (2, boxes))
    points = (low + (high - low) * share).T
    value, first, second = (
        np.asarray(jax.vmap(f)(points))
        for f in (
            lambda x: function(parameter, x),
            jax.jacfwd(lambda x: function(parameter, x)),
            jax.hessian(lambda x: function(parameter, x)),
        )
    )
    assert jet.first is not None
    assert jet.second is not None
    assert _inside(value.T, *jet.value)
    for k in range(2):
        assert _inside(first[:, :, k].T, jet.first[0][k], jet.first[1][k])
    for k, (i, j) in enumerate(pairs(2)):
        assert _inside(second[:, :, i, j].T, jet.second[0][k], jet.second[1][k])


def _inside(value, low, high):
    slack = 1e-10 * (1 + np.abs(value))
    return bool(np.all((value >= low - slack) & (value <= high + slack) | ~np.isfinite(value)))


@pytest.mark.parametrize("name", ["polynomial", "trigonometric", "quotient", "root", "angle"])
def test_the_taylor_form_bounds_the_remainder(name):
    rng = np.random.default_rng(1)
    function = FUNCTIONS[name]
    centre, half = rng.normal(0, 1, (2, 400)), 0.1 * rng.random((2, 400))
    jet = enclosure_of(function, 0.3, 2)(0.3, centre - half, centre + half)
    bound = taylor_remainder(jet, half)
    step = half * rng.uniform(-1, 1, half.shape)
    linear = jax.vmap(lambda c, s: jax.jvp(lambda x: function(0.3, x), (c,), (s,)))(centre.T, step.T)
    value = jax.vmap(lambda x: function(0.3, x))((centre + step).T)
    gap = np.abs(np.asarray(value) - np.asarray(linear[0]) - np.asarray(linear[1])).T
    assert np.mean(np.isfinite(bound)) > 0.7
    assert np.all((gap <= bound + 1e-12) | np.isnan(gap))


def test_bounds_shrink_with_the_square_of_the_box():
    function = FUNCTIONS["trigonometric"]
    enclosure, centre, sizes = enclosure_of(function, 0.0, 2), np.full((2, 1), 0.7), []
    for half in (1e-1, 1e-2, 1e-3):
        jet = enclosure(0.0, centre - half, centre + half)
        sizes.append(float(taylor_remainder(jet, np.full((2, 1), half))[0, 0]))
        assert jet.value[1][0, 0] - jet.value[0][0, 0] < 4 * half
    assert sizes[0] / sizes[1] > 80
    assert sizes[1] / sizes[2] > 95


def test_roots_and_kinks_that_are_not_smooth_over_a_box_have_no_bound():
    low, high = np.array([[-0.1], [-0.1]]), np.array([[0.1], [0.1]])
    root = enclosure_of(lambda p, x: jnp.sqrt(x[:1] + p), 0.0, 2)(0.0, low, high)
    assert np.isinf(taylor_remainder(root, high)).all()
    kink = enclosure_of(lambda p, x: jnp.abs(x[:1] + p), 0.0, 2)(0.0, low, high)
    assert np.isinf(taylor_remainder(kink, high)).all()


def test_what_moves_entries_and_what_vanishes_costs_nothing():
    """Products of derivatives with ones and zeros are not computed, nor anything twice."""

    def plain(p, x):
        return jnp.stack([jnp.sin(x[0]) * x[1] + p])

    def roundabout(p, x):
        value, slope = jax.jvp(lambda v: v + 0.0 * jnp.sin(v) + p, (jnp.sin(x[0]) * x[1],), (jnp.ones(()),))
        padded = jnp.concatenate([jnp.zeros(2), jnp.stack([value, jnp.sin(x[0])])])[::-1]
        return padded[1:2] * slope

    low = np.array([[0.1, -2.0], [0.3, 1.0]])
    first, second = (enclosure_of(function, 0.7, 2) for function in (plain, roundabout))
    assert len(second.program.steps) == len(first.program.steps) == 3
    a, b = first(0.7, low, low + 0.2), second(0.7, low, low + 0.2)
    for order in ("value", "first", "second"):
        np.testing.assert_array_equal(getattr(a, order), getattr(b, order))


def test_an_unknown_operation_is_named():
    enclosure = enclosure_of(lambda p, x: jnp.tanh(x + p), 0.0, 2)
    with pytest.raises(UnsupportedOperation, match="tanh"):
        enclosure(0.0, np.zeros((2, 1)), np.ones((2, 1)))
