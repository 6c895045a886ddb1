"""Cosine and sine, reciprocals and inverse roots by multiplications, against NumPy to the last place."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.numerics import fusion
from jaxkin.numerics.trigonometry import cos_sin


@pytest.mark.parametrize("reach", [1.0, 7.0, 1e3, 1e6])
def test_cosine_and_sine(reach):
    rng = np.random.default_rng(0)
    quarters = np.pi / 2 * rng.integers(-50, 50, 500) * (1 + 1e-15 * rng.normal(size=500))
    angles = np.concatenate([rng.uniform(-reach, reach, 5000), quarters, [0.0, np.pi, -np.pi, np.pi / 4]])
    cosine, sine = jax.jit(cos_sin)(angles)
    assert np.max(np.abs(cosine - np.cos(angles))) < 3e-16
    assert np.max(np.abs(sine - np.sin(angles))) < 3e-16


def test_cosine_and_sine_of_what_is_no_angle_and_their_derivatives():
    assert np.isnan(cos_sin(jnp.array([np.nan, np.inf]))).all()
    _, slopes = jax.jvp(cos_sin, (jnp.asarray(0.7),), (jnp.asarray(2.0),))
    np.testing.assert_allclose(slopes, [-2 * np.sin(0.7), 2 * np.cos(0.7)], rtol=1e-15)


def test_reciprocals_and_inverse_roots():
    x = 10.0 ** np.random.default_rng(1).uniform(-100, 100, 20000)
    np.testing.assert_allclose(jax.jit(fusion.reciprocal)(x) * x, 1, rtol=5e-16)
    np.testing.assert_allclose(jax.jit(fusion.reciprocal)(-x) * x, -1, rtol=5e-16)
    np.testing.assert_allclose(jax.jit(fusion.inverse_root)(x) * np.sqrt(x), 1, rtol=8e-16)
    assert np.isnan(fusion.reciprocal(jnp.asarray(np.nan)))
    assert jax.grad(fusion.reciprocal)(2.0) == pytest.approx(-0.25, rel=1e-15)
    assert jax.grad(fusion.inverse_root)(4.0) == pytest.approx(-0.0625, rel=1e-15)


def test_powers_of_two():
    x = 10.0 ** np.random.default_rng(2).uniform(-30, 30, 1000)
    scale, inverse = fusion.power_of_two(jnp.asarray(x))
    assert np.all(np.frexp(scale)[0] == 0.5)
    assert np.all(scale * inverse == 1)
    assert np.all((x / scale >= 1) & (x / scale < 2))
