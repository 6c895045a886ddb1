"""The result of an optimisation: the design, what proves it, how it was found."""

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxkin.core.errors import JaxkinError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import jsonable
from jaxkin.design.objective import Measured
from jaxkin.design.problem import Problem

if TYPE_CHECKING:
    import xarray


class OptimisationInterrupted(JaxkinError, KeyboardInterrupt):
    """An optimisation stopped by the user.

    Attributes:
        design: The best so far, not verified.
    """

    def __init__(self, message: str, design: "Design"):
        super().__init__(message)
        self.design = design


@dataclass(frozen=True)
class Kept:
    """A requirement at the design, without smoothing.

    Attributes:
        text: The requirement.
        measured: Its quantity.
        slack: By how much it is kept, in its unit; negative is a violation.
        kept: True where it is, within the error.
        active: True where it holds with equality.
    """

    text: str
    measured: Measured
    slack: float
    kept: bool
    active: bool


@dataclass(frozen=True)
class Neighbourhood:
    """Designs sampled around the optimum.

    Attributes:
        samples: How many.
        radius: How far, as a share of each parameter's range.
        feasible: How many keep all requirements (at the samples of their places).
        better: How many of these are better by more than rounding; 0 at a local optimum.
        gain: By how much the best of them is better, in the objective's unit.
    """

    samples: int
    radius: float
    feasible: int
    better: int
    gain: float


@dataclass(frozen=True)
class Design:
    """A design, with what proves that it does what was asked.

    Attributes:
        problem: The problem.
        values: The parameters by name.
        robot: The mechanism.
        center: ``(n_pose,)`` the middle of the prescribed places where it varied, else None.
        objective: The objective without smoothing.
        smooth: The smoothed objective.
        requirements: The requirements without smoothing.
        verified: True where everything that was asked for was found to hold.
        failures: What does not hold, a sentence each.
        bounds: Parameters at a bound, ``{"c3": "low"}``.
        stationarity: Largest miss of the conditions of an optimum, scaled; NaN where they were not looked at.
        neighbourhood: Designs around it, or None.
        start: The parameters of the start that led there, and its number.
        history: Values, violations and parameters step by step.
        counts: Starts, evaluations, gradients, refinements and seconds.
        request: What determines the numbers: problem, method, seed.
    """

    problem: Problem
    values: dict[str, float]
    robot: Mechanism
    center: np.ndarray | None
    objective: Measured
    smooth: float
    requirements: tuple[Kept, ...]
    verified: bool
    failures: tuple[str, ...]
    bounds: dict[str, str]
    stationarity: float
    neighbourhood: Neighbourhood | None
    start: dict[str, float]
    history: "xarray.Dataset"
    counts: dict[str, Any] = field(default_factory=dict)
    request: dict[str, Any] = field(default_factory=dict)

    @property
    def feasible(self) -> bool:
        """True where every requirement is kept."""
        return all(one.kept for one in self.requirements)

    @property
    def active(self) -> tuple[str, ...]:
        """What holds with equality: requirements, and bounds of parameters."""
        texts = [one.text for one in self.requirements if one.active]
        for name, end in self.bounds.items():
            bound = getattr(self.problem.parameters[name], end)
            texts.append(f"{name} {'>=' if end == 'low' else '<='} {bound:g}")
        return tuple(texts)

    def __str__(self) -> str:
        """A summary of a few lines."""
        unit = "" if self.problem.objective.unit == "1" else f" {self.problem.objective.unit}"
        lines = [f"{self.problem.objective.name}: {self.objective}{unit}, smoothed {self.smooth:.10g}"]
        for name, value in self.values.items():
            lines.append(f"  {name} = {value:.12g} {self.problem.unit_of(name)}".rstrip())
        for one in self.requirements:
            state = "active" if one.active else "kept" if one.kept else "VIOLATED"
            lines.append(f"  {one.text}: {state}, {one.measured}")
        if self.active:
            lines.append(f"  active: {', '.join(self.active)}")
        if np.isfinite(self.stationarity):
            lines.append(f"  conditions of an optimum hold to {self.stationarity:.1e}")
        if self.neighbourhood is not None:
            near = self.neighbourhood
            lines.append(
                f"  of {near.samples} designs within {near.radius:g} of the ranges {near.feasible} are feasible, "
                f"{near.better} of these better"
            )
        lines.append("verified" if self.verified else "NOT VERIFIED: " + " ".join(self.failures))
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """Returns everything but the history, as what ``json.dumps`` takes."""
        content = {
            "objective": {"name": self.problem.objective.name, "unit": self.problem.objective.unit}
            | _told(self.objective)
            | {"smoothed": self.smooth, "smoothing": self.problem.objective.smoothing},
            "sense": "maximise" if self.problem.sign > 0 else "minimise",
            "values": self.values,
            "center": None if self.center is None else self.center.tolist(),
            "geometry": self.robot.geometry(),
            "requirements": [
                {"text": one.text, "slack": one.slack, "kept": one.kept, "active": one.active} | _told(one.measured)
                for one in self.requirements
            ],
            "active": list(self.active),
            "verified": self.verified,
            "failures": list(self.failures),
            "stationarity": self.stationarity,
            "neighbourhood": None if self.neighbourhood is None else vars(self.neighbourhood),
            "start": self.start,
            "counts": self.counts,
            "request": self.request,
        }
        return json.loads(json.dumps(jsonable(content)))

    def to_dataset(self) -> "xarray.Dataset":
        """Returns the history."""
        return self.history


def _told(measured: Measured) -> dict[str, Any]:
    return {
        "value": measured.value,
        "error": measured.error,
        "pose": None if measured.pose is None else np.asarray(measured.pose).tolist(),
        "part": measured.part,
        "evidence": measured.evidence,
        "proved": measured.proved,
    }
