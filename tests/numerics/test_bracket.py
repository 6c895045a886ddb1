import jax.numpy as jnp
import numpy as np

from jaxkin.numerics import bracket


def test_zeros_of_every_shape_to_the_last_digits():
    roots = jnp.asarray(np.linspace(0.01, 0.99, 99))
    for function in (
        lambda t: t - roots,
        lambda t: (t - roots) ** 3,
        lambda t: jnp.expm1(40 * (t - roots)),
        lambda t: jnp.cbrt(t - roots),
    ):
        found = bracket.zero(function, function(jnp.zeros(99)), function(jnp.ones(99)))
        np.testing.assert_allclose(found, roots, atol=1e-15)


def test_zeros_at_the_ends_and_a_forced_sign():
    # The value at 0 is a rounding of zero with the wrong sign; the caller says that it counts as positive.
    function = lambda t: jnp.where(t == 0, -1e-18, -t)  # noqa: E731
    assert float(bracket.zero(function, jnp.array([1e-18]), jnp.array([-1.0]))[0]) <= 1e-15
    end = bracket.zero(lambda t: t - 1, jnp.array([-1.0]), jnp.array([1e-300]))
    np.testing.assert_allclose(end, 1.0, atol=1e-15)


def test_a_jump_is_located_and_nan_stays_nan():
    jump = bracket.zero(lambda t: jnp.where(t < 0.3, -1.0, 2.0), jnp.array([-1.0]), jnp.array([2.0]))
    np.testing.assert_allclose(jump, 0.3, atol=1e-15)
    nothing = bracket.zero(
        lambda t: jnp.where(jnp.abs(t - 0.5) < 0.1, jnp.nan, t - 0.5), jnp.array([-1.0]), jnp.ones(1)
    )
    assert np.isnan(nothing[0])
