"""``jk.design.optimise``: many starts by gradients, the best of them with hard constraints, then the proof."""

import dataclasses
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.provenance import Request
from jaxkin.design import gradient_steps
from jaxkin.design.checkpoint import Checkpoint
from jaxkin.design.constrained import METHODS as HARD_METHODS
from jaxkin.design.constrained import Hard, Stationary
from jaxkin.design.functions import Functions
from jaxkin.design.gradient_steps import FEASIBLE, Best, Steps, Trail, Walk
from jaxkin.design.history import History
from jaxkin.design.objective import LEAST, Measured, Objective
from jaxkin.design.outcome import Design, OptimisationInterrupted
from jaxkin.design.problem import Problem
from jaxkin.design.proof import Verdict, verified
from jaxkin.design.starts import checked_starts
from jaxkin.kinematics.boundary import checked_mechanism
from jaxkin.sweep.progress import Progress

METHODS = ("auto", "adam", "lbfgs", *HARD_METHODS)
#: Refinements begin farther apart than this in the unit cube.
_APART = 1e-2
#: A parameter so close to an end of the unit cube is at its bound: methods behind a smooth map come near it only.
_AT_BOUND = 1e-12
#: How often samples are added where the worst pose lies between them.
_SHARPENED = 3


@dataclasses.dataclass(frozen=True)
class Options:
    """How an optimisation goes; see ``optimise``."""

    method: str = "auto"
    starts: int = 32
    steps: int = 200
    refine: int = 4
    rate: float = 0.05
    iterations: int = 200
    seed: int = 0
    patience: int = 3
    tolerance: float = 1e-8
    neighbours: int = 200
    radius: float = 0.02

    def __post_init__(self) -> None:
        """Checks everything."""
        who = "jk.design.optimise"
        if self.method not in METHODS:
            raise InputError(f"{who}: method is {self.method!r}: choose among {', '.join(METHODS)}.")
        least = {"starts": 1, "steps": 1, "refine": 0, "iterations": 1, "seed": 0, "patience": 1, "neighbours": 0}
        for name, low in least.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                raise InputError(f"{who}: {name} is {value!r}: it must be a whole number, at least {low}.")
        for name in ("rate", "tolerance", "radius"):
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and math.isfinite(value) and value > 0):
                raise InputError(f"{who}: {name} is {value!r}: it must be a positive number.")

    @property
    def hard(self) -> str | None:
        """The hard method that refines, or None."""
        return "slsqp" if self.method == "auto" else self.method if self.method in HARD_METHODS else None


class _Candidate(NamedTuple):
    """A design that may be the answer.

    Attributes:
        z: ``(p,)`` in the unit cube.
        start: Number of the start that led there.
        stationary: What the conditions of an optimum say, or None.
        functions: The functions that it was found with; they may have further samples.
    """

    z: np.ndarray
    start: int
    stationary: Stationary | None
    functions: Functions


def optimise(
    problem: Problem,
    *,
    method: str = "auto",
    starts: int = 32,
    steps: int = 200,
    refine: int = 4,
    rate: float = 0.05,
    iterations: int = 200,
    seed: int = 0,
    patience: int = 3,
    tolerance: float = 1e-8,
    neighbours: int = 200,
    radius: float = 0.02,
    checkpoint: str | Path | None = None,
    overwrite: bool = False,
    progress: bool | None = None,
) -> Design:
    """Finds a design by gradients through the kinematics, and proves after the fact that it does what was asked.

    All starts walk at once (``vmap``), with penalties for violated requirements; the best of them are refined with
    hard constraints: a worst case is improved by a level that no sample may fall short of, and samples are added where
    the worst pose lies between them; Newton's method on the conditions of an optimum gives the last digits. The design
    is then measured without smoothing, and designs around it are judged.

    Args:
        problem: What is wanted.
        method: ``"auto"`` (Adam, then SLSQP), ``"adam"`` or ``"lbfgs"`` (optax) alone, ``"slsqp"`` or
            ``"trust-constr"`` (SciPy) from the best starts.
        starts: Number of starts, spread over the bounds; the first is the mechanism as it is.
        steps: Steps of the gradient method, taken 20 at a time: rounded up to a multiple of 20.
        refine: How many of the best are refined.
        rate: Adam's rate, a share of each range a step.
        iterations: Of the hard method.
        seed: Of the starts and of the neighbourhood; it stands in the result.
        patience: Stop after so many times 20 steps without progress.
        tolerance: What is progress, as a share of the objective.
        neighbours: Designs around the optimum that are judged.
        radius: How far they are, as a share of each range.
        checkpoint: File that keeps what was done; the same request goes on there.
        overwrite: True to begin anew over a file of another request.
        progress: True or False to force or forbid the progress bar; by default it shows on a terminal.

    Where no start keeps all requirements, a search for a design that does comes first; what it finds is one start more,
    and if it finds none, ``jk.InfeasibleWarning`` names what is missed, by how much and where.

    Returns:
        The design. ``.verified`` is False where something that was asked for does not hold, and ``.failures`` says
        what: a problem without solution gives the design that violates least.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: An option is out of range, the objective or a requirement is not a number at any start, or a
            prescribed pose is out of reach of all.
        StoreError: The checkpoint is of another request.
        OptimisationInterrupted: Ctrl-C; ``.design`` is the best so far.
    """
    if not isinstance(problem, Problem):
        raise InputError(f"jk.design.optimise got a {type(problem).__name__}: it must be a jk.design.Problem.")
    checked_mechanism("jk.design.optimise", problem.robot)
    options = Options(method, starts, steps, refine, rate, iterations, seed, patience, tolerance, neighbours, radius)
    request = request_of(problem, **dataclasses.asdict(options))
    return _Run(problem, options, request, Checkpoint(checkpoint, request, overwrite), progress).design()


def request_of(problem: Problem, **options: Any) -> Request:
    """Returns what determines the numbers of an optimisation: the problem, and the options of ``Options``."""
    return Request({**problem.request().content, "options": dataclasses.asdict(Options(**options))})


class _Run:
    """One optimisation: its stages in order, and what they leave behind."""

    def __init__(
        self, problem: Problem, options: Options, request: Request, checkpoint: Checkpoint, progress: bool | None
    ):
        self._problem, self._options, self._request = problem, options, request
        self._checkpoint, self._progress = checkpoint, progress
        self._functions = Functions(problem)
        self._history = History(problem)
        self._counts: dict[str, Any] = {"method": options.method, "seed": options.seed}
        self._seconds: dict[str, float] = {}
        self._found: list[_Candidate] = []
        self._starts = np.zeros((0, len(problem.names)))

    def design(self) -> Design:
        """Runs all stages."""
        try:
            with self._timed("starts"):
                known = self._checkpoint.array("feasible")
                starts, feasible = checked_starts(self._functions, self._options.starts, self._options.seed, known)
                if len(feasible):
                    self._checkpoint.keep(None, feasible=feasible)
                self._starts = np.concatenate([starts, feasible])
                self._counts["starts"] = len(self._starts)
            best = self._walked()
            self._refined(best)
            with self._timed("proof"):
                chosen = self._chosen()
                verdict = verified(
                    chosen.functions, chosen.z, self._options.neighbours, self._options.radius, self._options.seed
                )
        except KeyboardInterrupt:
            if not len(self._starts):
                self._starts = self._problem.start()[None]
            chosen = self._chosen() if self._found else _Candidate(self._starts[0], 0, None, self._functions)
            begun = any(self._checkpoint.array(name) is not None for name in ("best.z", "feasible"))
            kept = "; the same request goes on at its checkpoint" if begun else ""
            raise OptimisationInterrupted(
                f"Stopped; the best design so far is in the exception's .design{kept}.",
                self._told(chosen, self._unproved(chosen)),
            ) from None
        return self._told(chosen, verdict)

    def _walked(self) -> Best:
        """Walks all starts by the gradient method, if there is one; returns the best of each."""
        options = self._options
        if options.method in HARD_METHODS:
            judged = self._functions.judge_many(self._starts)
            violation = np.maximum(-np.asarray(judged.hard), 0.0)
            value = self._problem.sign * np.asarray(judged.value)
            return self._noted(Best(self._starts, value, np.where(violation <= FEASIBLE, 0.0, violation)))  # type: ignore[arg-type]
        way = gradient_steps.lbfgs() if options.method == "lbfgs" else gradient_steps.adam(options.rate, options.steps)
        walker = Steps(self._functions, way, options.steps)
        with self._timed("gradient steps"):
            walk = walker.begin(self._starts)
            kept = self._checkpoint.load("walk", walk)
            self._history.resume(self._checkpoint)
            walk = walk if kept is None else kept
            for now, trail in self._chunks(walker, walk):
                walk = now
                self._history.add(trail)
                self._checkpoint.keep({"walk": now}, **self._history.arrays(), **{"best.z": np.asarray(now.best.z)})
                self._noted(now.best)
        self._counts["gradients of all starts"] = self._history.steps
        return self._noted(walk.best)

    def _chunks(self, walker: Steps, walk: Walk) -> Iterator[tuple[Walk, Trail]]:
        """Yields the state after every chunk, until the steps are taken or nothing gets better."""
        options = self._options
        total = options.steps * len(self._starts)
        done = self._history.steps
        with Progress(total, "designs", done * len(self._starts), self._progress) as bar:
            for reached in gradient_steps.chunks(options.steps):
                if reached <= done:
                    continue
                if self._history.stalled(options.patience, options.tolerance):
                    self._counts["stopped early"] = True
                    return
                walk, trail = walker.chunk(walk)
                bar.add(gradient_steps.CHUNK * len(self._starts))
                yield walk, trail

    def _noted(self, best: Best) -> Best:
        """Keeps the best walk as a candidate, so that it is never lost."""
        best = Best(*(np.asarray(part) for part in best))  # type: ignore[arg-type]
        k = int(np.lexsort((-np.asarray(best.value), np.asarray(best.violation)))[0])
        self._found = [_Candidate(np.asarray(best.z[k]), k, None, self._functions)]
        return best

    def _refined(self, best: Best) -> None:
        """Refines the best starts with hard constraints, and sharpens what lies between samples."""
        if self._options.hard is None or self._options.refine == 0:
            return
        with self._timed("refinement"):
            hard = Hard(self._functions)
            for place, k in enumerate(_distinct(best, self._options.refine)):
                self._found.append(self._refine(hard, self._functions, np.asarray(best.z[k]), k, f"refined.{place}"))
            for _ in range(_SHARPENED):
                if not self._sharpened():
                    break

    def _refine(
        self, hard: Hard, functions: Functions, z: np.ndarray, start: int, kept: str | None = None
    ) -> _Candidate:
        """Refines one design; ``kept`` is its name in the checkpoint, if it stands there."""
        y, iterates, numbers = (self._checkpoint.array(f"{kept}.{part}") for part in ("y", "iterates", "counts"))
        if y is None or iterates is None or numbers is None:
            seen: list[np.ndarray] = []
            assert self._options.hard is not None
            solved = hard.solve(z, self._options.hard, self._options.iterations, lambda y: seen.append(y.copy()))
            y, iterates = solved.y, np.reshape(seen, (len(seen), len(solved.y)))
            numbers = np.array([solved.evaluations, solved.gradients])
            if kept is not None:
                parts = {"y": y, "iterates": iterates, "counts": numbers}
                self._checkpoint.keep(None, **{f"{kept}.{part}": value for part, value in parts.items()})
        self._history.add_refined(functions, start, list(iterates))
        for name, number in zip(("evaluations", "gradients"), numbers.tolist(), strict=True):
            self._counts[f"refinement {name}"] = self._counts.get(f"refinement {name}", 0) + number
        stationary = hard.polished(y)
        return _Candidate(stationary.y[: len(z)], start, stationary, functions)

    def _sharpened(self) -> bool:
        """Adds samples where the worst pose of the best design lies between them, and refines it; False if none."""
        chosen = self._chosen()
        robot, center = self._problem.design(jnp.asarray(chosen.z))
        changed = 0

        def sharper(one: Objective, scale: float) -> Objective:
            nonlocal changed
            if one.sharper is None:
                return one
            measured = one.measured(robot, center)
            worst = np.asarray(one.parts(robot, center))
            short = worst.min() - measured.value if one.worst == LEAST else measured.value - worst.max()
            if measured.parameters is None or not short > 1e-7 * scale:
                return one
            changed += 1
            return one.sharper(measured.parameters)

        old = chosen.functions
        wanted = sharper(old.problem.objective, old.scale)
        kept = [
            dataclasses.replace(one, objective=sharper(one.objective, float(scale)))
            for one, scale in zip(old.problem.subject_to, old.scales, strict=True)
        ]
        if not changed:
            return False
        side = "maximise" if self._problem.sign > 0 else "minimise"
        functions = Functions(dataclasses.replace(old.problem, **{side: wanted, "subject_to": kept}))
        functions.scale, functions.scales = old.scale, old.scales
        self._counts["samples added"] = self._counts.get("samples added", 0) + changed
        again = self._refine(Hard(functions), functions, chosen.z, chosen.start)
        # What was found before is judged by the sharper functions from now on.
        self._found = [one._replace(functions=functions) for one in self._found] + [again]
        return True

    def _chosen(self) -> _Candidate:
        """Returns the best candidate: feasible before infeasible, then by the objective's worst part."""

        def rank(one: _Candidate) -> tuple[float, float]:
            judged = one.functions.judge_many(one.z)
            violation = max(-float(judged.hard[0]), 0.0)
            value = self._problem.sign * float(judged.level[0]) if judged.fine[0] else -math.inf
            return (violation if violation > 1e-8 else 0.0, -value)

        return min(self._found, key=rank)

    def _unproved(self, chosen: _Candidate) -> Verdict:
        robot, center = self._problem.design(jnp.asarray(chosen.z))
        value = float(self._problem.objective(robot, center))
        return Verdict(Measured(value, math.nan, evidence="smoothed"), (), None, ("The optimisation was stopped.",))

    def _told(self, chosen: _Candidate, verdict: Verdict) -> Design:
        """Puts the result together."""
        problem = self._problem
        robot, center = problem.design(jnp.asarray(chosen.z))
        values = {name: float(value) for name, value in problem.values(jnp.asarray(chosen.z)).items()}
        ends = {
            name: "low" if z < 0.5 else "high"
            for name, z in zip(problem.names, chosen.z, strict=True)
            if min(z, 1 - z) <= _AT_BOUND
        }
        start = problem.values(jnp.asarray(self._starts[chosen.start]))
        counts = {**self._counts, "seconds": {name: round(s, 3) for name, s in self._seconds.items()}}
        return Design(
            problem=problem,
            values=values,
            robot=robot,
            center=None if center is None else np.asarray(center),
            objective=verdict.objective,
            smooth=float(problem.objective(robot, center)),
            requirements=verdict.requirements,
            verified=not verdict.failures,
            failures=verdict.failures,
            bounds=ends,
            stationarity=math.nan if chosen.stationary is None else chosen.stationary.residual,
            neighbourhood=verdict.neighbourhood,
            start={"number": chosen.start, **{name: float(value) for name, value in start.items()}},
            history=self._history.dataset(),
            counts=counts,
            request=self._request.content,
        )

    def _timed(self, stage: str) -> "_Timed":
        return _Timed(self._seconds, stage)


class _Timed:
    """Adds the time of a block to a stage."""

    def __init__(self, seconds: dict[str, float], stage: str):
        self._seconds, self._stage = seconds, stage

    def __enter__(self) -> None:
        self._began = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self._seconds[self._stage] = self._seconds.get(self._stage, 0.0) + time.perf_counter() - self._began


def _distinct(best: Best, most: int) -> list[int]:
    """Returns the numbers of the best starts that ended apart from each other."""
    order = np.lexsort((-np.asarray(best.value), np.asarray(best.violation)))
    chosen: list[int] = []
    for k in map(int, order):
        if not np.isfinite(best.violation[k]):
            continue
        if all(np.max(np.abs(best.z[k] - best.z[other])) > _APART for other in chosen):
            chosen.append(k)
        if len(chosen) == most:
            break
    return chosen
