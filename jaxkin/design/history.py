"""The history of an optimisation: what every start met, step by step."""

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from jaxkin.design.checkpoint import Checkpoint
from jaxkin.design.functions import Functions
from jaxkin.design.gradient_steps import CHUNK, FEASIBLE, Trail
from jaxkin.design.problem import Problem

if TYPE_CHECKING:
    import xarray


class History:
    """Values, violations and parameters of every step of every start, and of the refinements' iterates."""

    def __init__(self, problem: Problem):
        self._problem = problem
        self._trails: list[Trail] = []
        self._refined: list[tuple[int, float, float, np.ndarray]] = []

    @property
    def steps(self) -> int:
        """Number of gradient steps taken."""
        return sum(len(trail.value) for trail in self._trails)

    def add(self, trail: Trail) -> None:
        """Adds a chunk of steps."""
        self._trails.append(trail)

    def add_refined(self, functions: Functions, start: int, iterates: list[np.ndarray]) -> None:
        """Adds the iterates of a refinement."""
        if not iterates:
            return
        p = len(self._problem.names)
        z = np.clip(np.array([y[:p] for y in iterates]), 0.0, 1.0)
        judged = functions.judge_many(z)
        for k, one in enumerate(z):
            self._refined.append((start, float(judged.value[k]), max(-float(judged.hard[k]), 0.0), one))

    def best(self) -> np.ndarray:
        """Returns the best feasible value so far after every step, times the sense; -inf before there is one."""
        if not self._trails:
            return np.zeros(0)
        value = self._problem.sign * np.concatenate([trail.value for trail in self._trails])
        violation = np.concatenate([trail.violation for trail in self._trails])
        feasible = np.where(violation <= FEASIBLE, np.nan_to_num(value, nan=-np.inf), -np.inf)
        return np.maximum.accumulate(feasible.max(axis=1))

    def stalled(self, patience: int, tolerance: float) -> bool:
        """True where so many chunks brought nothing to the best feasible design."""
        best = self.best()
        back = patience * CHUNK
        if len(best) <= back or not np.isfinite(best[-1 - back]):
            return False
        return bool(best[-1] - best[-1 - back] <= tolerance * max(abs(best[-1]), 1e-300))

    def arrays(self) -> dict[str, np.ndarray]:
        """Returns what a checkpoint keeps of it."""
        if not self._trails:
            return {}
        joined = Trail(*(np.concatenate(part) for part in zip(*self._trails, strict=True)))
        return {f"history.{name}": value for name, value in joined._asdict().items()}

    def resume(self, checkpoint: Checkpoint) -> None:
        """Takes up the history of a checkpoint."""
        arrays = [checkpoint.array(f"history.{name}") for name in Trail._fields]
        if all(array is not None for array in arrays):
            self._trails = [Trail(*arrays)]  # type: ignore[arg-type]

    def dataset(self) -> "xarray.Dataset":
        """Returns it as a dataset.

        ``objective``, ``violation`` and the parameters over (step, start), and the same of the refinements' iterates,
        ``refined_...`` over (iterate).
        """
        import xarray

        problem = self._problem
        unit = {"units": problem.objective.unit}
        variables: dict = {}
        if self._trails:
            joined = Trail(*(np.concatenate(part) for part in zip(*self._trails, strict=True)))
            variables["objective"] = (("step", "start"), joined.value, unit)
            variables["violation"] = (("step", "start"), joined.violation, {"long_name": "largest scaled violation"})
            variables.update(self._parameters("", ("step", "start"), joined.z))
            variables["best"] = (("step",), problem.sign * self.best(), unit)
        if self._refined:
            start, value, violation, z = (np.array(part) for part in zip(*self._refined, strict=True))
            variables["refined_start"] = (("iterate",), start)
            variables["refined_objective"] = (("iterate",), value, unit)
            variables["refined_violation"] = (("iterate",), violation)
            variables.update(self._parameters("refined_", ("iterate",), z))
        return xarray.Dataset(variables, attrs={"objective": problem.objective.name, "smoothed": 1})

    def _parameters(self, prefix: str, dims: tuple[str, ...], z: np.ndarray) -> dict:
        values = self._problem.values(jnp.moveaxis(jnp.asarray(z), -1, 0))
        return {
            f"{prefix}{name}": (dims, np.asarray(value), {"units": self._problem.unit_of(name)})
            for name, value in values.items()
        }
