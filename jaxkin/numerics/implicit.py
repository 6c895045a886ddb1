"""Derivatives of solutions by the implicit function theorem, to every order, without touching the solver."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.numerics import small_linalg


def solve_linear(matrix: Array, right: Array) -> Array:
    """Solves one small linear system; 3x3 by an unrolled adjugate."""
    if matrix.shape == (3, 3):
        rows = tuple(tuple(matrix[i, j] for j in range(3)) for i in range(3))
        return jnp.stack(small_linalg.solve(rows, tuple(right)))  # type: ignore[arg-type]
    return jnp.linalg.solve(matrix, right)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def attach_derivatives(
    residual: Callable[[Array, Any], Array], solution: Array, theta: Any, regular: Array, valid: Array
) -> Array:
    """Returns a solution of residual(x, theta) = 0 unchanged, with derivatives with respect to theta.

    dx = -(dF/dx)^-1 dF/dtheta dtheta. The rule calls itself, so second derivatives are right as well (a
    Newton step with a stopped gradient has a wrong second derivative).

    Args:
        residual: F(x, theta), square in x.
        solution: ``(n,)``; compute it from ``jax.lax.stop_gradient`` of the inputs.
        theta: Any pytree.
        regular: True where the solution is simple. Elsewhere the linear system is replaced by the
            identity *before* it is solved, so that no NaN enters a reverse pass.
        valid: True where there is a solution. Where it is valid but not regular the forward-mode derivative
            is NaN; reverse mode gives zero, because a NaN there would spoil the gradients of the other
            solutions.
    """
    del residual, theta, regular, valid
    return solution


@attach_derivatives.defjvp
def _attach_derivatives_jvp(residual, primals, tangents):
    solution, theta, regular, valid = primals
    theta_dot = tangents[1]
    x = attach_derivatives(residual, solution, theta, regular, valid)
    safe = jnp.where(regular, x, 1.0)
    matrix = jax.jacfwd(residual)(safe, theta)
    matrix = jnp.where(regular, matrix, jnp.eye(len(safe), dtype=safe.dtype))
    _, change = jax.jvp(lambda t: residual(safe, t), (theta,), (theta_dot,))
    x_dot = -solve_linear(matrix, jnp.where(regular, change, 0.0))
    return x, jnp.where(regular, x_dot, jnp.where(valid, jnp.nan, 0.0))
