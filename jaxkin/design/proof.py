"""Proof after the fact: a design judged on the problem without smoothing, and its neighbourhood."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.design.functions import Functions
from jaxkin.design.objective import Measured, Requirement
from jaxkin.design.outcome import Kept, Neighbourhood
from jaxkin.design.problem import Problem

#: Scaled slack within which a requirement is kept, or active.
_KEPT, _ACTIVE = 1e-7, 1e-5
#: A neighbour is better only by more than this share of the objective.
_BETTER = 1e-7
#: An objective below this share of its size at the starts is judged by that: a distance of zero has no other size.
_SMALL = 1e-6
#: A smoothed objective that is better than the measured one by more than this share was led astray by its samples.
_OPTIMISTIC = 0.01


class Verdict(NamedTuple):
    """What was found: the objective, the requirements, the neighbourhood, and what does not hold."""

    objective: Measured
    requirements: tuple[Kept, ...]
    neighbourhood: Neighbourhood | None
    failures: tuple[str, ...]


def verified(functions: Functions, z: np.ndarray, neighbours: int, radius: float, seed: int) -> Verdict:
    """Judges a design without smoothing.

    Args:
        functions: The problem's.
        z: ``(p,)`` the design in the unit cube.
        neighbours: How many designs around it are judged; 0 for none.
        radius: How far they are, as a share of each range.
        seed: Of their places.
    """
    problem = functions.problem
    robot, center = problem.design(jnp.asarray(z))
    failures = []
    objective = problem.objective.measured(robot, center)
    if not np.isfinite(objective.value):
        failures.append(f"The {problem.objective.name} is {objective.value} without smoothing.")
    elif (short := _flattered(problem, robot, center, objective)) > 0:
        failures.append(f"The smoothed {problem.objective.name} is better by {short:.3g} than what was measured.")
    kept = []
    for one, scale in zip(problem.subject_to, functions.scales, strict=True):
        measured = one.objective.measured(robot, center)
        slack = one.slack(measured)
        holds = keeps(one, measured, scale)
        kept.append(Kept(str(one), measured, slack, holds, holds and bool(slack <= _ACTIVE * scale + measured.error)))
        if not holds:
            failures.append(f"{one} is missed by {-slack:.3g}{measured.where}.")
    if not bool(robot.geometry_ok()):
        failures.append("The geometry is degenerate.")
    near = _neighbourhood(functions, z, neighbours, radius, seed) if neighbours else None
    if near is not None and near.better and not failures:
        failures.append(f"{near.better} of {near.samples} designs around it are better, by up to {near.gain:.3g}.")
    return Verdict(objective, tuple(kept), near, tuple(failures))


def keeps(one: Requirement, measured: Measured, scale: float) -> bool:
    """Returns whether a measured quantity keeps a requirement, up to rounding and its own error."""
    return bool(one.slack(measured) >= -(_KEPT * scale + measured.error))


def _flattered(problem: Problem, robot: Mechanism, center: Array | None, measured: Measured) -> float:
    """Returns by how much the smoothed objective is better than what was measured; 0 where smoothing explains it."""
    parts = problem.objective.parts(robot, center)
    truth = measured.value if measured.smoothed is None else measured.smoothed
    short = problem.sign * (float(problem.objective.together(parts)) - truth)
    room = problem.objective.flattery(len(parts), problem.sign) + measured.error
    return short if short > room + _OPTIMISTIC * abs(truth) else 0.0


def _neighbourhood(functions: Functions, z: np.ndarray, neighbours: int, radius: float, seed: int) -> Neighbourhood:
    rng = np.random.default_rng(seed)
    # Half of them at a hundredth of the distance: a ridge is narrower than its neighbourhood.
    reach = np.where(np.arange(neighbours) % 2, radius, radius / 100)[:, None]
    around = np.clip(z + reach * rng.uniform(-1.0, 1.0, (neighbours, len(z))), 0.0, 1.0)
    judged = functions.judge_many(np.concatenate([z[None], around]))
    values = functions.problem.sign * np.asarray(judged.level)
    feasible = np.asarray(judged.fine & (judged.hard >= -1e-9))[1:]
    gain = np.where(feasible, values[1:] - values[0], -np.inf)
    better = gain > _BETTER * max(abs(values[0]), _SMALL * functions.scale)
    most = float(np.max(gain, initial=0.0))
    return Neighbourhood(neighbours, radius, int(feasible.sum()), int(better.sum()), most if better.any() else 0.0)
