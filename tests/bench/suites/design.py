"""Designs on one core: gradients against evaluations, a thousand designs at once, and against other optimisers."""

import math
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from metric import Metric, Times, duration, mistakes

import jaxkin as jk
from jaxkin.design.functions import Functions
from jaxkin.design.gradient_steps import CHUNK, Steps, adam

#: Designs that walk at once, and steps that they take (a multiple of what one call takes).
DESIGNS, STEPS = 1000, {"a, isotropy": 100, "b, workspace": 20, "c, cusp": 20}
#: Calls in one timed run.
REPEATS = 20
#: What counts as the same value: within this share of the best known.
SAME = 1e-6


def measure() -> list[Metric]:
    """Times gradients, then batches, then rivals."""
    jk.enable_x64()
    problems = {"a, isotropy": isotropy(), "b, workspace": workspace(), "c, cusp": cusp()}
    found = _gradients()
    for name, problem in problems.items():
        found += _at_once(name, problem)
    for name, problem in (*problems.items(), ("e, rectangle", rectangle())):
        found += _rivals(name, problem)
    return found


def isotropy() -> jk.design.Problem:
    """Problem (a): L/h of the TLPM for isotropy at home."""
    robot = jk.mechanisms.tlpm.create()
    objective = jk.design.inverse_condition_number(robot, jk.design.poses(robot, np.zeros(3)), norm="frobenius")
    return jk.design.Problem(robot, {"base_radius": (300.0, 1500.0)}, maximise=objective, build=_tlpm_of_radius)


def _tlpm_of_radius(base_radius):  # type: ignore[no-untyped-def]
    return jk.mechanisms.tlpm.create(base_radius, 590.0)


def _thick_tlpm(base_radius, height):  # type: ignore[no-untyped-def]
    return jk.mechanisms.tlpm.create(base_radius, height, stroke=(-150.0, 150.0), a=40.0)


def workspace() -> jk.design.Problem:
    """Problem (b): the largest workspace of the TLPM with thick links under a floor of conditioning."""
    robot = _thick_tlpm(700.0, 700.0)
    everywhere = jk.design.reach(robot, 5, 0)
    kept = [
        jk.design.inverse_condition_number(robot, everywhere, width=0.003).at_least(0.4),
        jk.design.clearance(robot, everywhere, width=0.3).at_least(0.0),
    ]
    vary = {"base_radius": (350.0, 1000.0), "height": (350.0, 900.0)}
    volume = jk.design.workspace_volume(robot)
    return jk.design.Problem(robot, vary, maximise=volume, subject_to=kept, build=_thick_tlpm)


def cusp() -> jk.design.Problem:
    """Problem (c): a cusp of the analytic 3-RPR at a wanted place, that of a known member."""
    wanted = jk.mechanisms.rpr3_closed_forms.section_cusps(jk.mechanisms.rpr3.analytic(1.0, 0.2, 1.2), 1, 1.0).joints
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    section = jk.Grid(rho1=(0.0, 4.0, 400), rho2=1.0, rho3=(0.0, 4.0, 400))
    target = {"rho1": float(wanted[0, 0]), "rho3": float(wanted[0, 2])}
    objective = jk.design.cusp_distance(robot, section, target)
    return jk.design.Problem(robot, {"c3": (-0.5, 0.5), "d3": (0.7, 1.6)}, minimise=objective)


def rectangle() -> jk.design.Problem:
    """Problem (e): the five-bar's worst conditioning over a rectangle."""
    robot = jk.mechanisms.five_bar.create(3.0, (6.0, 6.0), (6.0, 6.0))
    place = jk.design.box(robot, x=(-1.0, 3.0), y=(5.0, 8.0))
    objective = jk.design.inverse_condition_number(robot, place, mode=(1, -1), width=0.003)
    vary = {"base": (0.5, 6.0), "proximal": (2.0, 9.0), "distal": (2.0, 9.0)}
    return jk.design.Problem(robot, vary, maximise=objective)


def _gradients() -> list[Metric]:
    """How many evaluations one gradient by all numbers of the mechanism costs."""
    rpr3 = jk.mechanisms.rpr3.reference(jk.Limits.lengths(3, 5.0, 40.0))
    disc = jk.design.ball(rpr3, {"x": 10.0, "y": -20.0}, 2.0, phi=(-0.5, 0.5))
    tlpm = jk.mechanisms.tlpm.create()
    everywhere = jk.design.reach(tlpm)
    analytic = jk.mechanisms.rpr3.analytic(1.0, 0.05, 1.1)
    five_bar = jk.mechanisms.five_bar.create(9.0, (8.0, 7.0), (5.0, 5.5))
    window = jk.design.box(five_bar, x=(3.0, 6.0), y=(6.0, 8.0))
    design = jk.design
    objectives = {
        "smallest singular value": (rpr3, design.smallest_singular_value(rpr3, disc, width=0.01)),
        "inverse condition number": (rpr3, design.inverse_condition_number(rpr3, disc, width=0.01)),
        "the same, Frobenius": (rpr3, design.inverse_condition_number(rpr3, disc, norm="frobenius", width=0.01)),
        "the same, five-bar": (five_bar, design.inverse_condition_number(five_bar, window, mode=(-1, 1), width=0.01)),
        "global conditioning": (rpr3, design.global_conditioning(rpr3, disc)),
        "limit margin": (rpr3, design.limit_margin(rpr3, disc, width=0.1)),
        "needed stroke": (rpr3, design.needed_stroke(rpr3, disc)),
        "link clearance": (tlpm, design.clearance(tlpm, everywhere, width=1.0)),
        "regular disc": (rpr3, design.regular_size(rpr3, disc)),
        "number of regular workspaces": (five_bar, design.regular_workspaces(five_bar, window, 1.0)),
        "distance to singularity": (rpr3, design.singularity_distance(rpr3, np.array([10.0, -20.0, 0.1]))),
        "distance to cusp": (analytic, cusp().objective),
        "workspace volume": (tlpm, design.workspace_volume(tlpm)),
        "workspace area": (rpr3, design.workspace_volume(rpr3, phi=0.3)),
    }
    found = []
    for name, (robot, objective) in objectives.items():
        value, slope = jax.jit(objective.__call__), jax.jit(jax.value_and_grad(objective.__call__))
        runs = {"value": _called(value, robot), "gradient": _called(slope, robot)}
        ratio = Times(runs, 7).ratio("gradient", "value")
        found.append(Metric(f"design: gradient / evaluation, {name}", ratio, "x", "lower", 0.5, 5.0))
    return found


def _called(function: Callable, robot: jk.Mechanism) -> Callable[[], object]:
    def run() -> None:
        for _ in range(REPEATS):
            jax.block_until_ready(function(robot))

    return run


def _at_once(name: str, problem: jk.design.Problem) -> list[Metric]:
    """A thousand designs, so many of Adam's steps each, without compiling."""
    functions, steps = Functions(problem), STEPS[name]
    starts = np.random.default_rng(0).uniform(size=(DESIGNS, len(problem.names)))
    functions.sized(functions.judge_many(starts))
    walker = Steps(functions, adam(0.05, steps), steps)
    first = walker.begin(starts)
    began = time.perf_counter()
    state, _ = walker.chunk(first)
    compiled = time.perf_counter()
    state = first
    for _ in range(steps // CHUNK):
        state, _ = walker.chunk(state)
    found = [duration(f"design: {DESIGNS} designs, {steps} steps, problem ({name})", time.perf_counter() - compiled)]
    return [*found, duration(f"design: first {CHUNK} steps with compiling, problem ({name})", compiled - began)]


class _Counted:
    """A smooth function with penalties, as rivals see it: counts calls, and when a value is first reached."""

    def __init__(self, functions: Functions, reach: float):
        self._loss = jax.jit(lambda z: functions.loss(z, jnp.asarray(1e3))[0])
        self._slope = jax.jit(jax.value_and_grad(lambda z: functions.loss(z, jnp.asarray(1e3))[0]))
        # As the methods give it: what is compiled for another kind of number would be compiled again, and timed.
        middle = jnp.asarray(np.full(len(functions.problem.names), 0.5))
        jax.block_until_ready((self._loss(middle), self._slope(middle)))
        self._reach, self.calls, self.at, self.seconds = reach, 0, math.inf, math.inf
        self._began = time.perf_counter()

    def value(self, z: np.ndarray) -> float:
        return self._noted(float(self._loss(jnp.asarray(z))), 1)

    def both(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = self._slope(jnp.asarray(z))
        return self._noted(float(value), 1), np.asarray(slope)

    def _noted(self, value: float, calls: int) -> float:
        self.calls += calls
        if value <= self._reach and math.isinf(self.seconds):
            self.at, self.seconds = self.calls, time.perf_counter() - self._began
        return value if np.isfinite(value) else 1e6


def _rivals(name: str, problem: jk.design.Problem) -> list[Metric]:
    """Evaluations and time until the best known value is reached: gradients, finite differences, no derivatives.

    All see the same smooth function with penalties. The first two are restarted from one list of starts until one of
    them is there.
    """
    functions = Functions(problem)
    rng = np.random.default_rng(1)
    starts = rng.uniform(0.05, 0.95, size=(40, len(problem.names)))
    functions.sized(functions.judge_many(starts))
    bounds = [(0.0, 1.0)] * len(problem.names)
    scout = _Counted(functions, -math.inf)
    ends = [scipy.optimize.minimize(scout.both, z, jac=True, method="L-BFGS-B", bounds=bounds).fun for z in starts[:20]]
    best = float(np.min(ends))
    reach = best + SAME * max(abs(best), 1e-3)
    runs: dict[str, _Counted] = {}
    for kind, jacobian in (("gradients", True), ("finite differences", False)):
        counted = runs[kind] = _Counted(functions, reach)
        for z in starts:
            function = counted.both if jacobian else counted.value
            scipy.optimize.minimize(
                function, z, jac=jacobian or None, method="SLSQP", bounds=bounds, options={"ftol": 1e-12}
            )
            if math.isfinite(counted.seconds):
                break
    counted = runs["differential evolution"] = _Counted(functions, reach)
    scipy.optimize.differential_evolution(
        counted.value,
        bounds,
        seed=0,
        tol=1e-12,
        atol=0.0,
        maxiter=300,
        polish=False,
        callback=lambda *_, counted=counted, **__: math.isfinite(counted.seconds),
    )
    found = [mistakes(f"design: ({name}) not reached by gradients", int(math.isinf(runs["gradients"].seconds)))]
    for kind, one in runs.items():
        found.append(Metric(f"design: ({name}) calls, {kind}", one.at, "calls", "lower"))
        if kind != "gradients":
            ratio = one.seconds / runs["gradients"].seconds
            found.append(Metric(f"design: ({name}) time / gradients' time, {kind}", ratio, "x", "higher"))
    return found
