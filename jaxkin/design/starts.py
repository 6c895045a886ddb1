"""Where an optimisation starts, and what is said at once of problems that cannot work."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.design.functions import Functions
from jaxkin.design.problem import Problem
from jaxkin.numerics.newton import lattice

#: Designs among which one must reach every prescribed pose.
_PROBED = 1024


def checked_starts(functions: Functions, number: int, seed: int) -> np.ndarray:
    """Returns starts in the unit cube at which everything is a number, ``(k, p)``, and takes the sizes of things there.

    The first is the mechanism as it is; the others fill the cube, shifted by the seed.

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
    return starts[fine]


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
    first = ", ".join(f"{name}={float(v):.6g}" for name, v in problem.values(jnp.asarray(starts[0])).items())
    where = f"at any of the {len(starts)} starts, {first} for one"
    if not np.isfinite(values).any():
        return f"The {problem.objective.name} is not a finite number {where}: change the bounds, or the place."
    for one, column in zip(problem.subject_to, slacks.T, strict=True):
        if not np.isfinite(column).any():
            return f"The requirement {one} is not a finite number {where}: change the bounds, or the place."
    return f"The geometry is degenerate, or a requirement is not a finite number, {where}: change the bounds."
