"""Where an optimisation starts, and what is said at once of problems that cannot work."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize

from jaxkin.core.errors import InfeasibleWarning, InputError
from jaxkin.design.functions import Functions
from jaxkin.design.gradient_steps import FEASIBLE
from jaxkin.design.problem import Problem
from jaxkin.design.proof import keeps
from jaxkin.numerics.newton import lattice

#: Designs among which one must reach every prescribed pose.
_PROBED = 1024
#: Searches for a design that keeps all requirements, where no start does, and iterations of each.
_SEARCHES, _ITERATIONS = 4, 60


def checked_starts(
    functions: Functions, number: int, seed: int, known: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Returns starts in the unit cube at which everything is a number, ``(k, p)``, and takes the sizes of things there.

    The first is the mechanism as it is; the others fill the cube, shifted by the seed. Where none of them keeps all
    requirements a search for a design that does runs first: what it finds is returned as well, ``(0 or 1, p)``, and if
    it finds none, a warning names what is missed. ``known`` is what such a search has found before.

    Raises:
        InputError: The objective or a requirement is not a number at any of them, or a prescribed pose is out of the
            reach of all of a thousand designs between the bounds.
    """
    problem = functions.problem
    starts = _spread(problem, number, seed)
    judged = functions.judge_many(starts)
    fine = np.asarray(judged.fine)
    _check_reach(problem, seed)
    if not fine.any():
        raise InputError(_why_not(functions, starts, np.asarray(judged.value), np.asarray(judged.slack)))
    functions.sized(judged)
    return starts[fine], _feasible(functions, starts[fine]) if known is None else known


def _feasible(functions: Functions, starts: np.ndarray) -> np.ndarray:
    """Returns a design that keeps all requirements where none of the starts does, ``(0 or 1, p)``; warns of none."""
    nothing = starts[:0]
    if not functions.problem.subject_to:
        return nothing
    hard = np.asarray(functions.judge_many(starts).hard)
    if np.max(hard) >= -FEASIBLE:
        return nothing
    best = starts[np.argsort(-hard)[:_SEARCHES]]
    ends = np.array([_least_violated(functions, z) for z in best])
    judged = functions.judge_many(ends)
    hard = np.where(np.asarray(judged.fine), np.asarray(judged.hard), -np.inf)
    k = int(np.argmax(hard))
    if hard[k] >= -FEASIBLE:
        return ends[k : k + 1]
    if told := _missed(functions, ends[k], len(ends)):
        # The caller of jk.design.optimise.
        warnings.warn(told, InfeasibleWarning, stacklevel=5)
    return nothing


def _least_violated(functions: Functions, start: np.ndarray) -> np.ndarray:
    """Returns where a bounded quasi-Newton method from a start ends that makes the sum of squared violations small.

    It ends where that is zero, as its slope is.
    """

    def both(z: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = functions.violation_slope(jnp.asarray(z))
        return (float(value), np.nan_to_num(np.asarray(gradient))) if np.isfinite(value) else (1e30, np.zeros_like(z))

    options = {"maxiter": _ITERATIONS, "ftol": 0.0, "gtol": 1e-13}
    bounds = [(0.0, 1.0)] * len(start)
    found = scipy.optimize.minimize(both, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return np.clip(found.x, 0.0, 1.0)


def _missed(functions: Functions, z: np.ndarray, searches: int) -> str:
    """Says which requirements a design misses, by how much and where; "" where it misses none that the proof would."""
    problem = functions.problem
    robot, center = problem.design(jnp.asarray(z))
    told = []
    for one, scale in zip(problem.subject_to, functions.scales, strict=True):
        measured = one.objective.measured(robot, center)
        if not keeps(one, measured, float(scale)):
            told.append(f"{one}, by {-one.slack(measured):.4g}{measured.where}")
    if not told:
        return ""
    return (
        f"No design was found that keeps all requirements: the best of {searches} searches, {_named(problem, z)}, "
        f"misses {'; and '.join(told)}. If there is none, the result is the design that violates least."
    )


def _spread(problem: Problem, number: int, seed: int) -> np.ndarray:
    p = len(problem.names)
    shift = np.random.default_rng(seed).uniform(size=p)
    filled = (lattice(max(number - 1, 1), p) + shift) % 1.0
    return np.concatenate([problem.start()[None], filled])[:number]


def _check_reach(problem: Problem, seed: int) -> None:
    """Refuses a prescribed pose that no design reaches, and names it."""
    designs = _spread(problem, _PROBED, seed + 1)
    for one in (problem.objective, *(r.objective for r in problem.subject_to)):
        reach = one.reach
        if reach is None or one.place is None:
            continue
        inside = np.asarray(jax.jit(jax.vmap(lambda z, reach=reach: reach(*problem.design(z))))(jnp.asarray(designs)))
        hopeless = np.flatnonzero(np.all(~(inside > 0), axis=0))
        if len(hopeless):
            k = int(hopeless[0])
            robot, center = problem.design(jnp.asarray(designs[0]))
            pose = np.asarray(one.place.sampled(robot, center, one.place.samples()))[k]
            told = ", ".join(f"{name}={value:.6g}" for name, value in zip(one.place.axes, pose, strict=True))
            raise InputError(
                f"The pose ({told}) of the place prescribed for the {one.name} is out of reach of all of {_PROBED} "
                "designs between the bounds: move the place, or widen the bounds."
            )


def _why_not(functions: Functions, starts: np.ndarray, values: np.ndarray, slacks: np.ndarray) -> str:
    problem = functions.problem
    where = f"at any of the {len(starts)} starts, {_named(problem, starts[0])} for one"
    if not np.isfinite(values).any():
        return f"The {problem.objective.name} is not a finite number {where}: change the bounds, or the place."
    for one, column in zip(problem.subject_to, slacks.T, strict=True):
        if not np.isfinite(column).any():
            return f"The requirement {one} is not a finite number {where}: change the bounds, or the place."
    return f"The geometry is degenerate, or a requirement is not a finite number, {where}: change the bounds."


def _named(problem: Problem, z: np.ndarray) -> str:
    """Returns the parameters of a design as text."""
    return ", ".join(f"{name}={float(value):.6g}" for name, value in problem.values(jnp.asarray(z)).items())
