"""Derivatives of implicit solutions against closed forms, to the third order."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.numerics.implicit import attach_derivatives, solve_linear


def residual(x, theta):
    """x0^2 + x1^2 = a and x0 = b x1, so that x1 = sqrt(a / (1 + b^2))."""
    a, b = theta[0], theta[1]
    return jnp.stack([x[0] ** 2 + x[1] ** 2 - a, x[0] - b * x[1]])


def closed_form(theta):
    x1 = jnp.sqrt(theta[0] / (1 + theta[1] ** 2))
    return jnp.stack([theta[1] * x1, x1])


def implicit(theta, regular=True, valid=True):
    solution = closed_form(jax.lax.stop_gradient(theta))
    return attach_derivatives(residual, solution, theta, jnp.asarray(regular), jnp.asarray(valid))


THETA = np.array([2.0, 0.7])
MODES = {"fwd": jax.jacfwd, "rev": jax.jacrev}


@pytest.mark.parametrize("outer", MODES)
@pytest.mark.parametrize("inner", MODES)
def test_first_and_second_derivatives(inner, outer):
    np.testing.assert_allclose(jax.jit(MODES[inner](implicit))(THETA), jax.jacfwd(closed_form)(THETA), rtol=1e-14)
    found = jax.jit(MODES[outer](MODES[inner](implicit)))(THETA)
    np.testing.assert_allclose(found, jax.jit(jax.hessian(closed_form))(THETA), rtol=1e-13, atol=1e-15)


def test_third_derivative():
    third = jax.jit(jax.jacfwd(jax.jacfwd(jax.jacrev(implicit))))(THETA)
    np.testing.assert_allclose(third, jax.jit(jax.jacfwd(jax.hessian(closed_form)))(THETA), rtol=1e-12, atol=1e-14)


def test_the_solution_itself_is_untouched():
    np.testing.assert_array_equal(implicit(THETA), closed_form(THETA))


@pytest.mark.parametrize(("valid", "forward"), [(True, np.nan), (False, 0.0)])
def test_where_no_derivative_exists(valid, forward):
    found = jax.jacfwd(lambda theta: implicit(theta, False, valid))(THETA)
    np.testing.assert_array_equal(found, np.full((2, 2), forward))
    np.testing.assert_array_equal(jax.jacrev(lambda theta: implicit(theta, False, valid))(THETA), np.zeros((2, 2)))


def test_a_bad_lane_does_not_spoil_its_neighbour():
    def total(theta):
        x = jnp.stack([closed_form(jax.lax.stop_gradient(theta)), jnp.full(2, jnp.nan), jnp.zeros(2)])
        regular, valid = jnp.array([True, False, False]), jnp.array([True, False, True])
        lanes = jax.vmap(lambda x, r, v: attach_derivatives(residual, x, theta, r, v))(x, regular, valid)
        return jnp.sum(jnp.where(regular[:, None], lanes, 0.0))

    wanted = jax.grad(lambda theta: jnp.sum(closed_form(theta)))(THETA)
    np.testing.assert_allclose(jax.grad(total)(THETA), wanted, rtol=1e-14)
    hessian = jax.jit(jax.jacrev(jax.grad(total)))(THETA)
    np.testing.assert_allclose(hessian, jax.hessian(lambda t: jnp.sum(closed_form(t)))(THETA), rtol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_solve_linear(n):
    rng = np.random.default_rng(n)
    matrix, x = rng.normal(size=(n, n)) + 2 * np.eye(n), rng.normal(size=n)
    np.testing.assert_allclose(solve_linear(jnp.asarray(matrix), jnp.asarray(matrix @ x)), x, rtol=1e-12)
