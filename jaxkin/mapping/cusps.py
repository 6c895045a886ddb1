"""``jk.cusps``: the cusps of a section, found twice over, and what only looks like one."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.mapping import search
from jaxkin.mapping.batch import over_points
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.cusp_search import newton_roots, roots_along_curves, roots_from_starts
from jaxkin.mapping.loci import evaluated, summed
from jaxkin.mapping.records import Cusps, Other
from jaxkin.mapping.section import Section, bind_section
from jaxkin.mapping.tracing import Traced, trace_section
from jaxkin.numerics import newton
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.small_linalg import pivoted_solve
from jaxkin.sweep.grid import Grid

#: Relative size of a third coefficient, or of a gradient, below which a point is no ordinary cusp.
_DEGENERATE = 1e-6
#: Cusp poses whose joint values differ by less than this share of a length are over one cusp.
_ONE_CUSP = 1e-9
#: Newton's method creeps up to a crossing, where the cusp equations are singular: what is so near is the crossing.
_AT_CROSSING = 1e-4
#: Perturbed restarts from which the position error is estimated, and how far they are moved.
_RESTARTS, _MOVED = 8, 1e-7


def cusps(robot: Mechanism, section: Grid) -> Cusps:
    """Finds the cusps of a section of the joint space.

    A cusp is a singular pose at which det A does not change along the kernel of A: three assembly modes meet. All
    roots of {section, det A = 0, grad det A . v = 0} are sought in pose space, from spread starts, and again as
    changes of sign along the traced singular curves; what either finds is reported, and ``.evidence`` counts both.
    Points where grad det A vanishes solve the same equations and are no cusps: there the singular set crosses itself.

    Args:
        robot: The mechanism.
        section: A grid with two free joint axes; their ends are limits, their numbers only seed.

    Returns:
        ``.joints (n, n_joint)``, ``.poses`` (n arrays), ``.residual``, ``.error``, ``.third``, ``.others`` and
        ``.evidence``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``singular_curves``.
        GeometryError: As for ``singular_curves``.

    Not differentiable.

    References:
        Zein, M., Wenger, P. and Chablat, D., 2007, "Singular curves in the joint space and cusp points of 3-RPR
        parallel manipulators", Robotica 25(6): cusps as triple roots, six in their section rho1 = 14.98.
    """
    bound = bind_section("jk.cusps", robot, section)
    facts: list[_Fact] = []
    others: list[Other] = []
    evidence = []
    for sheet in bound.sheets():
        found = _cusps_of(sheet, trace_section(sheet))
        facts, others, evidence = facts + found[0], others + found[1], [*evidence, found[2]]
    return _grouped(bound, facts, others, summed(evidence))


def _cusps_of(section: Section, traced: Traced) -> "tuple[list[_Fact], list[Other], dict[str, Any]]":
    """Finds the cusps on one sheet whose singular curves are traced, what only looks like one, and the evidence."""
    along, changes, still = roots_along_curves(section, traced)
    apart = roots_from_starts(section)
    points = np.concatenate([along, apart])
    kept = search.distinct(section, points)
    kept = kept[search.without_twins(section, points[kept])]
    points = points[kept]
    facts = _facts(section, points)
    near_crossing = search.near(section, points, np.concatenate([traced.crossings, traced.isolated]), _AT_CROSSING)
    kinds = [_kind(f, c) for f, c in zip(facts, near_crossing, strict=True)]
    good = np.array([kind == "cusp" for kind in kinds], bool)
    evidence = {
        "changes of sign along the curves": changes,
        "cusp poses found along the curves": int(np.sum(good & (kept < len(along)))),
        "cusp poses found from spread starts": int(np.sum(search.near(section, points[good], apart))),
        "cusp poses on no traced curve": int(np.sum(good & (kept >= len(along)))),
        **traced.evidence,
    }
    others = [
        Other(kind, f.joints, f.pose)
        for kind, f in zip(kinds, facts, strict=True)
        if kind not in ("cusp", "crossing", "")
    ]
    for kind, points in (("self-motion", still), ("isolated point", traced.isolated), ("crossing", traced.crossings)):
        points = points[search.without_twins(section, points)]
        others += [Other(kind, q, x) for q, x in zip(*evaluated(section, points)[:2], strict=True)]
    return [f for f, ok in zip(facts, good, strict=True) if ok], others, evidence


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


def _measure(chart: Chart, data: SectionData, u: Array) -> tuple[Array, ...]:
    """Measures roots of the cusp equations."""
    rows = jnp.concatenate([jax.jacfwd(partial(chart.section, data))(u), jnp.zeros((0, chart.dimension))])
    slope = jax.jacfwd(partial(chart.determinant, data))(u)
    # The part of the gradient along the section, against the size of the determinant's terms.
    if chart.n_rows:
        slope = slope - rows.T @ pivoted_solve(rows @ rows.T, rows @ slope)
    left, sigma, right = jnp.linalg.svd(chart.matrix(data, u))
    size = chart.determinant_size(data, u)
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


def _facts(section: Section, points: np.ndarray) -> list[_Fact]:
    if len(points) == 0:
        return []
    joints, poses, residual = evaluated(section, points)
    gradient, second, third, rank = over_points(_measure, section.chart, section.data, points)
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
    again = newton_roots(section, (points[:, None] + shifts[None]).reshape(-1, points.shape[1]))[0]
    others = evaluated(section, again)[0].reshape(len(points), _RESTARTS, -1)
    return np.max(np.abs(short_way(others - joints[:, None], section.joint_period)), axis=(1, 2))


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

    def apart(a: _Fact, b: _Fact) -> float:
        return float(np.max(np.abs(short_way(a.joints - b.joints, section.joint_period)) / unit))

    for fact in sorted(facts, key=lambda f: tuple(np.round(f.joints / unit, 8))):
        home = next((g for g in groups if apart(g[0], fact) < _ONE_CUSP + fact.error), None)
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
        **section.record("newton"),
        evidence=evidence,
    )
