"""Hard constraints by SciPy, with derivatives from JAX; then Newton's method on the conditions of Karush, Kuhn, Tucker.

References:
    Kraft, D., 1988, "A software package for sequential quadratic programming" (SLSQP); Nocedal, J. and Wright, S. J.,
    2006, "Numerical Optimization", chapter 12 (conditions of Karush, Kuhn and Tucker).
"""

import warnings
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jax import Array

from jaxkin.design.functions import Functions

METHODS = ("slsqp", "trust-constr")
#: Scaled slacks below this are active; Newton's steps on the conditions.
ACTIVE = 1e-6
_STEPS = 12
#: Conditions that hold so well need no Newton's steps.
_GOOD = 1e-10
#: How far a multiplier may be negative, or a slack, by rounding.
_ROUNDING = 1e-9


class Solved(NamedTuple):
    """Where a hard method ended.

    Attributes:
        y: ``(p,)`` or with the level ``(p + 1,)``.
        message: What the method says.
        evaluations: Of the functions.
        gradients: Of them.
    """

    y: np.ndarray
    message: str
    evaluations: int
    gradients: int


class Stationary(NamedTuple):
    """How well the conditions of an optimum hold.

    Attributes:
        y: The point.
        residual: Largest miss of the conditions, scaled.
        active: Places of the active constraints among ``Functions.hard``.
        multipliers: Theirs.
        at_bound: ``(p,)`` -1 at the lower bound, 1 at the upper one, 0 between.
    """

    y: np.ndarray
    residual: float
    active: np.ndarray
    multipliers: np.ndarray
    at_bound: np.ndarray


class Hard:
    """A problem with hard constraints; compiled once."""

    def __init__(self, functions: Functions):
        self._functions = functions
        self._cost = jax.jit(jax.value_and_grad(functions.cost))
        self._hard = jax.jit(functions.hard)
        self._slope = jax.jit(jax.jacfwd(functions.hard))
        self._conditions = jax.jit(self._missed)
        self._newton = jax.jit(jax.jacfwd(self._missed))

    def solve(
        self, z: np.ndarray, method: str, iterations: int, seen: Callable[[np.ndarray], None] = lambda y: None
    ) -> Solved:
        """Runs a method of SciPy from a point of the unit cube; ``seen`` is told of every iterate."""
        y = self._functions.with_level(z)
        p = len(self._functions.problem.names)
        free = [np.inf] * (len(y) - p)
        low, high = np.append(np.zeros(p), np.negative(free)), np.append(np.ones(p), free)
        bounds = scipy.optimize.Bounds(low, high)  # type: ignore[arg-type]
        count = [0, 0]

        def cost(y: np.ndarray) -> tuple[float, np.ndarray]:
            count[0] += 1
            count[1] += 1
            value, slope = self._cost(jnp.asarray(y))
            return (float(value), np.asarray(slope)) if np.isfinite(value) else (1e30, np.zeros_like(y))

        def slacks(y: np.ndarray) -> np.ndarray:
            return np.nan_to_num(np.asarray(self._hard(jnp.asarray(y))), nan=-1e3)

        def slopes(y: np.ndarray) -> np.ndarray:
            return np.nan_to_num(np.asarray(self._slope(jnp.asarray(y))))

        kept = []
        if len(slacks(y)):
            kept = (
                [{"type": "ineq", "fun": slacks, "jac": slopes}]
                if method == "slsqp"
                else [scipy.optimize.NonlinearConstraint(slacks, 0.0, np.inf, jac=slopes)]  # type: ignore[arg-type]
            )
        options = (
            {"maxiter": iterations, "ftol": 1e-14}
            if method == "slsqp"
            else {"maxiter": iterations, "gtol": 1e-12, "xtol": 1e-12}
        )
        with np.errstate(all="ignore"), warnings.catch_warnings():
            # trust-constr warns where a step does not change the gradient, as at an optimum.
            warnings.simplefilter("ignore", UserWarning)
            found = scipy.optimize.minimize(
                cost,
                y,
                jac=True,
                method="SLSQP" if method == "slsqp" else "trust-constr",
                bounds=bounds,
                constraints=kept,
                options=options,
                callback=(lambda y, *rest: seen(np.asarray(y))) if method == "slsqp" else (lambda y, s: seen(y)),
            )
        end = np.asarray(found.x, float)
        end[:p] = np.clip(end[:p], 0.0, 1.0)
        return Solved(end, str(found.message), count[0], count[1])

    def polished(self, y: np.ndarray) -> Stationary:
        """Returns the point after Newton's steps on the conditions, if they make them hold better, with its residual.

        Which constraints and bounds are active is taken from where it starts.
        """
        p = len(self._functions.problem.names)
        slack = np.asarray(self._hard(jnp.asarray(y)))
        active = np.flatnonzero(slack <= ACTIVE)
        at_bound = np.where(y[:p] <= ACTIVE, -1, np.where(y[:p] >= 1 - ACTIVE, 1, 0))
        free = np.append(at_bound == 0, np.ones(len(y) - p, bool))
        start = y.copy()
        start[:p] = np.where(at_bound < 0, 0.0, np.where(at_bound > 0, 1.0, y[:p]))
        first = self._measured(start, active, free, at_bound)
        if first.residual <= _GOOD:
            # Second derivatives take long to compile.
            return first
        best, point, multipliers = first, start.copy(), first.multipliers
        rows = np.zeros(len(slack))
        for _ in range(_STEPS):
            rows[active] = multipliers
            missed = np.asarray(self._conditions(jnp.asarray(np.concatenate([point, rows]))))
            slope = np.asarray(self._newton(jnp.asarray(np.concatenate([point, rows]))))
            keep = np.concatenate([np.flatnonzero(free), len(point) + active])
            if not (np.all(np.isfinite(missed)) and np.all(np.isfinite(slope))):
                break
            step = np.linalg.lstsq(slope[np.ix_(keep, keep)], -missed[keep], rcond=1e-12)[0]
            point[free] += step[: free.sum()]
            point[:p] = np.clip(point[:p], 0.0, 1.0)
            multipliers = multipliers + step[free.sum() :]
            here = self._measured(point, active, free, at_bound)
            if here.residual < best.residual and np.min(here.multipliers, initial=0.0) > -_ROUNDING:
                best = here
        return best

    def _missed(self, both: Array) -> Array:
        """Returns the conditions' misses at a point with multipliers: the Lagrangian's slope, then the slacks."""
        n = len(self._functions.problem.names) + int(self._functions.has_level)
        y, multipliers = both[:n], both[n:]

        def lagrangian(y: Array) -> Array:
            return self._functions.cost(y) - jnp.sum(multipliers * self._functions.hard(y))

        return jnp.concatenate([jax.grad(lagrangian)(y), self._functions.hard(y)])

    def _measured(self, y: np.ndarray, active: np.ndarray, free: np.ndarray, at_bound: np.ndarray) -> Stationary:
        """Returns how well the conditions hold, with the multipliers that fit best."""
        slack, slope = np.asarray(self._hard(jnp.asarray(y))), np.asarray(self._slope(jnp.asarray(y)))
        cost = np.asarray(self._cost(jnp.asarray(y))[1])
        if not (np.all(np.isfinite(slack)) and np.all(np.isfinite(slope)) and np.all(np.isfinite(cost))):
            return Stationary(y.copy(), np.inf, active, np.zeros(len(active)), at_bound)
        multipliers = np.zeros(len(active))
        if len(active):
            multipliers = scipy.optimize.nnls(slope[active][:, free].T, cost[free])[0]
        rest = cost - slope[active].T @ multipliers
        # At a bound the slope may point outwards.
        p = len(at_bound)
        outward = np.where(at_bound < 0, np.maximum(-rest[:p], 0), np.where(at_bound > 0, np.maximum(rest[:p], 0), 0))
        misses = [
            np.abs(rest[free]),
            np.abs(outward),
            np.maximum(-slack, 0.0),
            np.abs(slack[active]) * (multipliers > 0),
        ]
        return Stationary(y.copy(), float(max(np.max(m, initial=0.0) for m in misses)), active, multipliers, at_bound)
