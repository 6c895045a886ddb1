"""What optimisers see of a problem: smooth functions of points of the unit cube, scaled to order one, compiled once."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.design.problem import Problem

#: Designs that one compiled call judges.
_BLOCK = 32
#: How far inside its requirements a search for a design that keeps them aims, scaled.
_INWARD = 1e-8


class Judged(NamedTuple):
    """How a design does.

    Attributes:
        value: The smoothed objective, in its unit.
        level: The objective by its worst part, in its unit.
        slack: ``(r,)`` by how much the smoothed requirements are kept, in their units; negative is a violation.
        hard: By how much the least kept part of any requirement is kept, scaled; infinite without requirements.
        fine: True where every number is one.
    """

    value: Array
    level: Array
    slack: Array
    hard: Array
    fine: Array


class Functions:
    """A problem's functions of a point z ``(p,)`` of the unit cube; jitted, hashable by identity.

    Attributes:
        problem: The problem.
        scale: Size of the objective.
        scales: ``(r,)`` sizes of the requirements.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        self.scale, self.scales = 1.0, np.ones(len(problem.subject_to))
        self._judge = jax.jit(jax.vmap(self._judged, in_axes=(0, None)))
        #: Sum of squares of a design's scaled violations, and its slope.
        self.violation_slope = jax.jit(jax.value_and_grad(self._violation))
        self._parts = jax.jit(lambda z: problem.objective.parts(*problem.design(z)))

    def sized(self, judged: Judged) -> None:
        """Takes the sizes of things from designs that were judged, before what has them in it is compiled."""
        good = np.asarray(judged.fine)
        values, slack = np.asarray(judged.value)[good], np.asarray(judged.slack)[good]
        self.scale = float(np.median(np.abs(values))) or 1.0
        bounds = np.array([abs(one.bound) for one in self.problem.subject_to])
        spread = np.median(np.abs(slack), axis=0) if len(slack) else np.ones(len(bounds))
        self.scales = np.where((sizes := np.maximum(bounds, spread)) > 0, sizes, 1.0)

    def judge_many(self, z: np.ndarray) -> Judged:
        """Judges designs ``(k, p)``, as NumPy arrays; in blocks of one size, for which it is compiled once."""
        rows, parts = np.atleast_2d(np.asarray(z)), []
        for start in range(0, len(rows), _BLOCK):
            some = rows[start : start + _BLOCK]
            padded = np.concatenate([some, np.repeat(some[-1:], _BLOCK - len(some), axis=0)])
            judged = self._judge(jnp.asarray(padded), jnp.asarray(self.scales))
            parts.append([np.asarray(part)[: len(some)] for part in judged])
        return Judged(*(np.concatenate(part) for part in zip(*parts, strict=True)))  # type: ignore[arg-type]

    def parts(self, z: Array) -> tuple[Array, list[Array]]:
        """Returns the objective's parts, and the slacks of the parts of each requirement, in their units."""
        robot, center = self.problem.design(z)
        values = self.problem.objective.parts(robot, center)
        return values, [one.slacks(one.objective.parts(robot, center)) for one in self.problem.subject_to]

    def judged(self, z: Array) -> Judged:
        """Judges one design; traceable."""
        return self._judged(z, jnp.asarray(self.scales))

    def _judged(self, z: Array, scales: Array) -> Judged:
        robot, center = self.problem.design(z)
        own = self.problem.objective.parts(robot, center)
        value = self.problem.objective.together(own)
        level = self.problem.sign * jnp.min(self.problem.sign * own) if self.has_level else value
        slack, hard = [], [jnp.asarray(jnp.inf)]
        for k, one in enumerate(self.problem.subject_to):
            parts = one.objective.parts(robot, center)
            slack.append(one.smooth_slack(parts))
            hard.append(jnp.min(one.slacks(parts)) / scales[k])
        slacks = jnp.stack(slack) if slack else jnp.zeros(0)
        fine = jnp.isfinite(value) & jnp.all(jnp.isfinite(slacks)) & robot.geometry_ok()
        return Judged(value, level, slacks, jnp.min(jnp.stack(hard)), fine)

    def _violation(self, z: Array) -> Array:
        # Beyond the border, which a search comes to from outside and never reaches.
        short = [
            jnp.minimum(rows / scale - _INWARD, 0.0) for rows, scale in zip(self.parts(z)[1], self.scales, strict=True)
        ]
        return sum(jnp.sum(part * part) for part in short)  # type: ignore[return-value]

    def loss(self, z: Array, weight: Array) -> tuple[Array, Judged]:
        """Returns what gradient methods make small: the scaled objective, and squares of violations by their weight."""
        judged = self.judged(z)
        short = jnp.minimum(judged.slack / jnp.asarray(self.scales), 0.0)
        return -self.problem.sign * judged.value / self.scale + weight * jnp.sum(short * short), judged

    def hard(self, y: Array) -> Array:
        """Returns what has to be positive for hard methods, scaled: parts of requirements, and of the worst case.

        ``y`` is z, with a last entry where the worst case is improved: the level that no part may fall short of.
        """
        z = y[: len(self.problem.names)]
        values, slacks = self.parts(z)
        rows = [slack / scale for slack, scale in zip(slacks, self.scales, strict=True)]
        if self.has_level:
            rows.insert(0, self.problem.sign * values / self.scale - y[-1])
        return jnp.concatenate(rows) if rows else jnp.zeros(0)

    def cost(self, y: Array) -> Array:
        """Returns what hard methods make small: the level's negative, or the scaled objective."""
        if self.has_level:
            return -y[-1]
        robot, center = self.problem.design(y)
        return -self.problem.sign * self.problem.objective(robot, center) / self.scale

    @property
    def has_level(self) -> bool:
        """True where the worst of several smooth parts is improved by a level of its own."""
        return self.problem.is_worst_case

    def with_level(self, z: np.ndarray) -> np.ndarray:
        """Returns z, with the level of its worst part where there is one."""
        return np.append(z, self.level(z)) if self.has_level else np.asarray(z)

    def level(self, z: np.ndarray) -> float:
        """Returns the scaled objective by its worst part, times the sense."""
        values = self._parts(jnp.asarray(z))
        if self.has_level:
            return float(jnp.min(self.problem.sign * values)) / self.scale
        return self.problem.sign * float(self.problem.objective.together(values)) / self.scale
