"""Waists: nothing changes but how often things are computed."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.numerics.fusion import spread, waist

NUMBERS = jnp.array([1.5, -0.0, 0.0, -3e200, 1e-300, jnp.inf, -jnp.inf])


def held(x):
    return waist(x)[0]


def test_waists_change_no_bit():
    for function in (held, jax.jit(held)):
        assert np.asarray(function(NUMBERS)).tobytes() == np.asarray(NUMBERS).tobytes()
    value, change = jax.jit(lambda x: jax.jvp(held, (x,), (2 * jnp.ones_like(x),)))(NUMBERS)
    np.testing.assert_array_equal(value, NUMBERS)
    np.testing.assert_array_equal(change, 2.0)
    slope = jax.jit(jax.grad(lambda x: jnp.sum(jnp.exp(-jnp.abs(held(x))))))(NUMBERS)
    np.testing.assert_array_equal(slope[5:], 0.0)
    assert np.all(np.isfinite(slope))
    assert np.isnan(held(jnp.nan))


def test_derivatives_pass_waists_to_any_order():
    def function(x):
        (y,) = waist(x * x)
        return jnp.sin(held(y)) * held(x)

    plain = lambda x: jnp.sin(x * x) * x  # noqa: E731
    for k in range(3):
        np.testing.assert_allclose(function(0.7), plain(0.7), rtol=1e-14, err_msg=str(k))
        function, plain = jax.jacrev(function) if k % 2 else jax.jacfwd(function), jax.grad(plain)
    assert held(jnp.arange(3)).dtype == jnp.arange(3).dtype


def test_spread_numbers_are_summed_once():
    samples = jnp.arange(5.0)

    def total(a, b):
        one, two = spread(samples, a, b)
        return jnp.sum(one * one * two + samples * one)

    a, b = jnp.array(0.3), jnp.array([2.0])
    slopes = jax.grad(total, argnums=(0, 1))(a, b)
    np.testing.assert_allclose(slopes[0], 5 * 2 * 0.3 * 2.0 + 10.0, rtol=1e-14)
    np.testing.assert_allclose(slopes[1], [5 * 0.09], rtol=1e-14)
    text = jax.jit(jax.grad(total)).lower(a, b).as_text()
    assert text.count("stablehlo.reduce(") == 1
