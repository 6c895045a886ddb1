"""``jk.cusps``: the cusps of a section, found twice over, and what only looks like one."""

import json
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.mapping import search
from jaxkin.mapping.assembly import Arc, short_way
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.loci import evaluated
from jaxkin.mapping.section import Section, bind_section
from jaxkin.mapping.tracing import Traced, trace_section
from jaxkin.numerics import newton
from jaxkin.numerics.small_linalg import pivoted_solve
from jaxkin.sweep.grid import Grid

#: Relative size of a third coefficient, or of a gradient, below which a point is no ordinary cusp.
_DEGENERATE = 1e-6
#: Cusp poses whose joint values differ by less than this share of a length are over one cusp.
_ONE_CUSP = 1e-9
#: Newton's method creeps up to a crossing, where the cusp equations are singular: what is so near is the crossing.
_AT_CROSSING = 1e-4
#: Least cosine between the kernels of neighbouring points of a curve.
_KERNEL_TURN = 0.8
#: Perturbed restarts from which the position error is estimated, and how far they are moved.
_RESTARTS, _MOVED = 8, 1e-7


@dataclass(frozen=True)
class Other:
    """A point at which the cusp equations hold, and that is no cusp.

    Attributes:
        kind: ``"crossing"`` (the gradient of det A vanishes), ``"isolated point"`` (the same, and the singular set is
            this point alone), ``"swallowtail or higher"`` (the third coefficient vanishes as well), or ``"double
            kernel"`` (A loses two ranks).
        joints: ``(n_joint,)``.
        pose: ``(n_pose,)``.
    """

    kind: str
    joints: np.ndarray
    pose: np.ndarray


@dataclass(frozen=True)
class Cusps:
    """All cusps of a section: joint points at which three assembly modes meet in one pose.

    Attributes:
        joints: ``(n, n_joint)``, one row a distinct joint point.
        poses: n arrays ``(k_i, n_pose)``: the triple poses over each (two for the analytic 3-RPR).
        residual: ``(n,)`` largest dimensionless residual of the constraints, det A and the second coefficient.
        error: ``(n,)`` estimated error of the joint values, in their unit: how far Newton's method, started
            nearby again, ends apart.
        third: ``(n,)`` smallest third coefficient w (F_xxx v v v - 3 F_xx v A+ F_xx v v), dimensionless, over the poses:
            not zero at a triple solution that is no worse.
        others: What satisfies the cusp equations and is none, by name.
        request: What determines the numbers.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: What speaks for completeness, by name.
    """

    joints: np.ndarray
    poses: tuple[np.ndarray, ...]
    residual: np.ndarray
    error: np.ndarray
    third: np.ndarray
    others: tuple[Other, ...]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        """Number of distinct joint points."""
        return len(self.joints)

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [f"{len(self)} cusps, {sum(map(len, self.poses))} triple poses"]
        for k, (joints, poses) in enumerate(zip(self.joints, self.poses, strict=True)):
            at = ", ".join(f"{n} = {v:.15g}" for n, v in zip(self.joint_names, joints, strict=True))
            lines.append(
                f"  [{k}] {at}  (error {self.error[k]:.0e}, residual {self.residual[k]:.0e}, "
                f"third coefficient {self.third[k]:.2g})"
            )
            for pose in poses:
                there = ", ".join(f"{n} = {v:.15g}" for n, v in zip(self.pose_names, pose, strict=True))
                lines.append(f"      {there}")
        for other in self.others:
            at = ", ".join(f"{n} = {v:.15g}" for n, v in zip(self.joint_names, other.joints, strict=True))
            lines.append(f"  no cusp, {other.kind}: {at}")
        lines += [f"  {name}: {value}" for name, value in self.evidence.items()]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        found = [
            {
                "joints": joints.tolist(),
                "poses": poses.tolist(),
                "residual": float(self.residual[k]),
                "error": float(self.error[k]),
                "third_coefficient": float(self.third[k]),
            }
            for k, (joints, poses) in enumerate(zip(self.joints, self.poses, strict=True))
        ]
        others = [{"kind": o.kind, "joints": o.joints.tolist(), "pose": o.pose.tolist()} for o in self.others]
        content = {
            "request": self.request,
            "joint_axes": list(self.joint_names),
            "pose_axes": list(self.pose_names),
            "units": self.units,
            "cusps": found,
            "others": others,
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


def cusps(robot: Mechanism, section: Grid) -> Cusps:
    """Finds the cusps of a section of the joint space.

    A cusp is a singular pose at which det A does not change along the kernel of A: three assembly modes meet. All
    roots of {section, det A = 0, grad det A . v = 0} are sought in pose space, from spread starts, and again as changes
    of sign along the traced singular curves; both must agree. Points where grad det A vanishes solve the same
    equations and are no cusps: there the singular set crosses itself.

    Args:
        robot: The mechanism.
        section: A grid with two free joint axes; their ends are limits, their numbers only seed.

    Returns:
        ``.joints (n, n_joint)``, ``.poses`` (n arrays), ``.residual``, ``.error``, ``.third``, ``.others``, ``.evidence``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``singular_curves``.
        GeometryError: As for ``singular_curves``.

    Not differentiable.

    References:
        Zein, M., Wenger, P. and Chablat, D., 2007, "Singular curves in the joint space and cusp points of 3-RPR parallel
        manipulators", Robotica 25(6): cusps as triple roots, six in the section rho1 = 14.98 of their geometry.
    """
    bound = bind_section("jk.cusps", robot, section)
    traced = trace_section(bound)
    return cusps_of(bound, traced)


def cusps_of(section: Section, traced: Traced) -> Cusps:
    """Finds the cusps of a section whose singular curves are traced."""
    along, changes = _along_curves(section, traced)
    apart = _from_starts(section)
    points = np.concatenate([along, apart])
    kept = search.distinct(section, points)
    points = points[kept]
    facts = _facts(section, points)
    near_crossing = _near(section, points, traced.crossings, _AT_CROSSING)
    kinds = [_kind(f, c) for f, c in zip(facts, near_crossing, strict=True)]
    good = np.array([kind == "cusp" for kind in kinds], bool)
    evidence = {
        "changes of sign along the curves": changes,
        "cusp poses found along the curves": int(np.sum(good & (kept < len(along)))),
        "cusp poses found from spread starts": _met(section, points[good], apart),
        "cusp poses on no traced curve": int(np.sum(good & (kept >= len(along)))),
        **traced.evidence,
    }
    others = [
        Other(kind, f.joints, f.pose)
        for kind, f in zip(kinds, facts, strict=True)
        if kind not in ("cusp", "crossing", "")
    ]
    joints, poses, _ = evaluated(section, traced.crossings)
    others += [Other("crossing", q, x) for q, x in zip(joints, poses, strict=True)]
    return _grouped(section, [f for f, ok in zip(facts, good, strict=True) if ok], others, evidence)


def _met(section: Section, points: np.ndarray, others: np.ndarray) -> int:
    return int(np.sum(_near(section, points, others, search.SAME)))


def _near(section: Section, points: np.ndarray, others: np.ndarray, distance: float) -> np.ndarray:
    """Returns which points have another within a distance."""
    gaps = np.max(np.abs(short_way(points[:, None] - others[None], section.period)), axis=2, initial=0.0)
    return np.any(gaps < distance, axis=1)


def _fold_rates(chart: Chart, data: SectionData, points: Array) -> Array:
    """Returns the kernel and the rate of det A along it, both for a kernel of length one: ``(k, n_pose + 1)``."""

    def one(u: Array) -> Array:
        kernel = chart.kernel(data, u)
        size = jnp.sqrt(jnp.sum(kernel * kernel))
        size = jnp.where(size > 0, size, 1.0)
        return jnp.append(kernel, chart.fold_rate(data, u)) / size

    return jax.vmap(one)(points)


_rates = jax.jit(_fold_rates, static_argnames="chart")


def _along_curves(section: Section, traced: Traced) -> tuple[np.ndarray, int]:
    """Returns roots found where the rate changes sign, or comes near zero, along the arcs; and the changes' number.

    The kernel's sign is carried on from point to point: it may come back reversed on a closed arc.
    """
    guesses, changes = [], 0
    if traced.arcs:
        lengths = [len(arc.points) for arc in traced.arcs]
        values = search.over_points(_rates, section, np.concatenate([arc.points for arc in traced.arcs]))
        for arc, rows in zip(traced.arcs, np.split(values, np.cumsum(lengths)[:-1]), strict=True):
            crossed, near = _brackets(*_smooth(section, arc, rows))
            guesses += crossed + near
            changes += len(crossed)
    if not guesses:
        return np.zeros((0, section.chart.dimension)), 0
    pairs = np.array(guesses)
    middle = search.over_points(_bisect, section, pairs.reshape(len(pairs), -1))
    u, good = _roots(section, middle)
    size = np.max(np.abs(pairs[:, 1] - pairs[:, 0]), axis=1)
    here = np.max(np.abs(short_way(u - pairs[:, 0], section.period)), axis=1) < 3 * size + 1e-6
    return search.glued(section, u[good & here]), changes


def _smooth(section: Section, arc: Arc, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns points of an arc without crossings, closed ones repeating the first, so close that the kernel turns little.

    The kernel may turn faster than the curve, near a pose where A almost loses two ranks: its sign could not be
    carried on over a long step.
    """
    smooth = np.ones(len(arc.points), bool)
    smooth[[0, -1]] = [arc.start.kind != "crossing", arc.end.kind != "crossing"]
    points, rows = arc.points[smooth], rows[smooth]
    if arc.closed:
        last = points[-1] + short_way(points[0] - points[-1], section.period)
        points, rows = np.vstack([points, last]), np.vstack([rows, rows[:1]])
    for _ in range(12):
        wide = np.flatnonzero(np.abs(np.sum(rows[1:, :-1] * rows[:-1, :-1], axis=1)) < _KERNEL_TURN)
        if len(wide) == 0:
            break
        pairs = np.stack([points[wide], points[wide + 1]], axis=1)
        middle = search.over_points(_midpoints, section, pairs.reshape(len(wide), -1))
        points = np.insert(points, wide + 1, middle, axis=0)
        rows = np.insert(rows, wide + 1, search.over_points(_rates, section, middle), axis=0)
    return points, rows


def _brackets(points: np.ndarray, rows: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Returns pairs of points between which the rate changes sign, and pairs about its smallest values otherwise."""
    kernels, rates = rows[:, :-1], rows[:, -1]
    flips = np.where(np.sum(kernels[1:] * kernels[:-1], axis=1) < 0, -1.0, 1.0)
    rates = rates * np.cumprod(np.append(1.0, flips))
    change = rates[:-1] * rates[1:] <= 0
    crossed = [points[k : k + 2] for k in np.flatnonzero(change)]
    size = np.abs(rates)
    dips = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & ~change[:-1] & ~change[1:]
    return crossed, [points[[k, k + 2]] for k in np.flatnonzero(dips)]


def _onto_curve(chart: Chart, data: SectionData, guess: Array, across: Array) -> Array:
    """Returns the point of the singular curve in the plane through the guess across a direction."""

    def system(u: Array) -> Array:
        return jnp.append(chart.singular(data, u), jnp.dot(across, u - guess))

    return newton.polish(system, guess, steps=4, trust=0.1)


def _all_midpoints(chart: Chart, data: SectionData, pairs: Array) -> Array:
    def one(pair: Array) -> Array:
        a, b = pair[: chart.dimension], pair[chart.dimension :]
        return _onto_curve(chart, data, 0.5 * (a + b), (b - a) / jnp.sqrt(jnp.sum((b - a) ** 2)))

    return jax.vmap(one)(pairs)


_midpoints = jax.jit(_all_midpoints, static_argnames="chart")


def _bisected(chart: Chart, data: SectionData, pairs: Array) -> Array:
    """Halves the way between two points of a curve until the rate's change of sign is near; else returns the middle."""

    def one(pair: Array) -> Array:
        a, b = pair[: chart.dimension], pair[chart.dimension :]
        across = (b - a) / jnp.sqrt(jnp.sum((b - a) ** 2))

        def rate(s: Array) -> tuple[Array, Array, Array]:
            u = _onto_curve(chart, data, a + s * (b - a), across)
            return chart.fold_rate(data, u), chart.kernel(data, u), u

        def halve(k: Array, carry: tuple[Array, ...]) -> tuple[Array, ...]:
            low, high, start, reference, _ = carry
            s = jnp.where(k == 0, 0.0, 0.5 * (low + high))
            value, kernel, u = rate(s)
            sign = jnp.sign(value) * jnp.where(k == 0, 1.0, jnp.sign(jnp.dot(kernel, reference)))
            same = (k == 0) | (sign == start)
            return (
                jnp.where(same, s, low),
                jnp.where(same, high, s),
                jnp.where(k == 0, sign, start),
                jnp.where(k == 0, kernel, reference),
                u,
            )

        zero = jnp.zeros(())
        low, high, _, _, u = jax.lax.fori_loop(0, 14, halve, (zero, zero + 1, zero, jnp.zeros(chart.n_pose), a))
        # Without a change of sign the middle is the better guess.
        return jnp.where(high == 1.0, _onto_curve(chart, data, 0.5 * (a + b), across), u)

    return jax.vmap(one)(pairs)


_bisect = jax.jit(_bisected, static_argnames="chart")


def _newton_all(chart: Chart, data: SectionData, points: Array) -> tuple[Array, Array, Array]:
    """Applies Newton's method to the cusp equations; returns points, residuals, smallest margins."""

    def one(u: Array) -> tuple[Array, Array, Array]:
        u = newton.polish(partial(chart.cusp, data), u, steps=6, trust=0.1)
        return u, jnp.max(jnp.abs(chart.cusp(data, u))), jnp.min(chart.margins(data, u))

    return jax.vmap(one)(points)


_newton = jax.jit(_newton_all, static_argnames="chart")


def _roots(section: Section, guesses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns where Newton's method arrives from guesses, and which of these are roots in the box."""
    room = max(1024, 1 << (len(guesses) - 1).bit_length())
    padded = np.resize(guesses, (room, guesses.shape[1]))
    u, residual, margin = (np.asarray(a)[: len(guesses)] for a in _newton(section.chart, section.data, padded))
    return u, (residual <= TOLERANCES.residual) & (margin >= -search.EDGE_SLACK)


def _descend_all(chart: Chart, data: SectionData, points: Array) -> Array:
    return jax.vmap(lambda u: newton.descend(partial(chart.cusp, data), u, 30))(points)


_descend = jax.jit(_descend_all, static_argnames="chart")


def _from_starts(section: Section) -> np.ndarray:
    """Returns the distinct roots of the cusp equations found from starts of their own.

    Half of them are spread over the glued space, half over the curves; none comes from the tracer. Near a crossing Newton's method converges slowly to the crossing and leaves a crowd; ``_kind`` tells them.
    """
    spread = search.starting_points(section, part=2)
    curves = search.seeds_on_curves(section, part=3)
    points = np.concatenate([spread, np.resize(curves, spread.shape) if len(curves) else spread])
    u, good = _roots(section, np.asarray(_descend(section.chart, section.data, points)))
    u = search.glued(section, u[good])
    return u[search.distinct(section, u)]


@dataclass(frozen=True)
class _Fact:
    """What is measured at one root of the cusp equations; all dimensionless but for joints, pose and error."""

    joints: np.ndarray
    pose: np.ndarray
    residual: float
    error: float
    gradient: float
    second: float
    third: float
    rank: float


def _measured(chart: Chart, data: SectionData, points: Array) -> tuple[Array, ...]:
    """Measures roots of the cusp equations."""

    def one(u: Array) -> tuple[Array, ...]:
        rows = jnp.concatenate([jax.jacfwd(partial(chart.section, data))(u), jnp.zeros((0, chart.dimension))])
        slope = jax.jacfwd(partial(chart.determinant, data))(u)
        # The part of the gradient along the section, against the size of the determinant's terms.
        if chart.n_rows:
            slope = slope - rows.T @ pivoted_solve(rows @ rows.T, rows @ slope)
        left, sigma, right = jnp.linalg.svd(chart.matrix(data, u))
        size = jnp.prod(jnp.sqrt(jnp.sum(chart.matrix(data, u) ** 2, axis=1)))
        w, v = left[:, -1], right[-1]
        pose, joints = chart.configuration(data, u)

        def along(x: Array) -> Array:
            return data.robot.constraints(pose + x * data.pose_unit, joints) / data.matrix_scale

        def second(a: Array, b: Array) -> Array:
            return jax.jvp(lambda x: jax.jvp(along, (x,), (a,))[1], (jnp.zeros_like(pose),), (b,))[1]

        def first_of_second(x: Array) -> Array:
            return jax.jvp(lambda y: jax.jvp(along, (y,), (v,))[1], (x,), (v,))[1]

        cubic = jax.jvp(first_of_second, (jnp.zeros_like(pose),), (v,))[1]
        bend = second(v, v)
        # The pseudo-inverse without its smallest direction, which is the kernel.
        response = right[:-1].T @ ((left[:, :-1].T @ bend) / sigma[:-1])
        third = w @ (cubic - 3 * second(v, response))
        return (
            jnp.sqrt(jnp.sum(slope**2)) / size,
            w @ bend,
            third,
            sigma[-2] / sigma[0],
        )

    return jax.vmap(one)(points)


_measure = jax.jit(_measured, static_argnames="chart")


def _facts(section: Section, points: np.ndarray) -> list[_Fact]:
    if len(points) == 0:
        return []
    joints, poses, residual = evaluated(section, points)
    padded = np.resize(points, (max(64, 1 << (len(points) - 1).bit_length()), points.shape[1]))
    gradient, second, third, rank = (np.asarray(a) for a in _measure(section.chart, section.data, padded))
    spread = _spread(section, points, joints)
    rounding = 4 * np.finfo(float).eps * np.max(np.abs(joints), axis=1)
    return [
        _Fact(
            joints[k],
            poses[k],
            float(max(residual[k], abs(second[k]))),
            float(spread[k] + rounding[k]),
            float(gradient[k]),
            float(second[k]),
            float(abs(third[k])),
            float(rank[k]),
        )
        for k in range(len(points))
    ]


def _spread(section: Section, points: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Returns how far apart in the joints Newton's method ends when it starts anew around each root, ``(k,)``."""
    shifts = (newton.lattice(_RESTARTS, section.chart.dimension) - 0.5) * _MOVED
    again = _roots(section, (points[:, None] + shifts[None]).reshape(-1, points.shape[1]))[0]
    others = evaluated(section, again)[0].reshape(len(points), _RESTARTS, -1)
    return np.max(np.abs(others - joints[:, None]), axis=(1, 2))


def _kind(fact: _Fact, near_crossing: bool) -> str:
    """Says what a root of the cusp equations is; "" for a point that Newton's method has left beside a crossing."""
    if near_crossing:
        return ""
    if fact.gradient < _DEGENERATE:
        return "crossing"
    if fact.rank < _DEGENERATE:
        return "double kernel"
    if fact.third < _DEGENERATE:
        return "swallowtail or higher"
    return "cusp"


def _grouped(section: Section, facts: list[_Fact], others: list[Other], evidence: dict[str, Any]) -> Cusps:
    """Gathers cusp poses over one joint point, in ascending order of the joints."""
    robot = section.robot
    unit = np.asarray(scale_vector(robot.joint_axes, robot.characteristic_length()))
    groups: list[list[_Fact]] = []
    for fact in sorted(facts, key=lambda f: tuple(np.round(f.joints / unit, 8))):
        home = next(
            (g for g in groups if np.max(np.abs(g[0].joints - fact.joints) / unit) < _ONE_CUSP + fact.error), None
        )
        if home is None:
            groups.append([fact])
        else:
            home.append(fact)
    n = len(robot.joint_axes)
    return Cusps(
        joints=np.array([g[0].joints for g in groups]).reshape(len(groups), n),
        poses=tuple(np.array([f.pose for f in sorted(g, key=lambda f: tuple(-f.pose))]) for g in groups),
        residual=np.array([max(f.residual for f in g) for g in groups]),
        error=np.array([max(f.error for f in g) for g in groups]),
        third=np.array([min(f.third for f in g) for g in groups]),
        others=tuple(others),
        request=section.content("newton"),
        pose_names=tuple(axis.name for axis in robot.pose_axes),
        joint_names=tuple(axis.name for axis in robot.joint_axes),
        units=section.units,
        evidence=evidence,
    )
