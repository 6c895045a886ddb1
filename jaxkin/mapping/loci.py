"""``jk.singular_curves``: the singular set of a section of the joint space."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping import search
from jaxkin.mapping.assembly import Arc, End, strands_of
from jaxkin.mapping.batch import in_blocks, over_points
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.meetings import meetings
from jaxkin.mapping.records import Crossings, Curve, SingularCurves
from jaxkin.mapping.section import Section, bind_section
from jaxkin.mapping.tracing import trace_section, whole_curves
from jaxkin.numerics.gluing import short_way
from jaxkin.sweep.grid import Grid

#: Longest chord and sharpest turn (rad) of a curve's image, in widths of the box; shorter chords may turn as they will.
_LONG, _SHARP, _SHORT = 0.02, 0.15, 0.0002
#: Shortest step in pose space that is halved, and how often.
_LEAST, _REFINEMENTS = 1e-3, 9
#: The ends of a component that is one point.
_ALONE = "isolated point"


def singular_curves(robot: Mechanism, section: Grid, *, method: str = "trace") -> SingularCurves:
    """Finds all parallel singularities (det dF/dpose = 0) over a section of the joint space.

    The curves are traced in pose space, where they are smooth also over cusps, on the constraints alone; the joints
    follow by inverse kinematics. A curve goes on over glued angles and straight through crossings; it ends only on the
    borders of the section.

    Args:
        robot: The mechanism.
        section: A grid with two free joint axes; their ends are limits, their numbers only seed. Joint limits of
            the robot cut the ranges.
        method: ``"trace"``, or ``"closed form"`` for a mechanism that declares ``closed_form_curves`` (the analytic
            3-RPR): labelled, and with the virtual parts, whose poses are complex.

    Returns:
        The curves, longest first: ``.joints (k, n_joint)``, ``.poses (k, n_pose)``, ``.closed``, ``.residual``
        (dimensionless) each; and ``.crossings``, ``.evidence``. Empty where the section has no singular pose.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Not exactly two free axes, an unknown axis, a joint fixed outside its limits or at a length of
            zero, a section that no pose reaches, an unknown method.
        GeometryError: The geometry is degenerate, or det dF/dpose vanishes identically.

    Not differentiable. Completeness is not proved: two searches from spread starts, and one for the ends on the
    borders, must lie on the curves; ``.evidence`` holds the numbers.
    """
    bound = bind_section("jk.singular_curves", robot, section)
    if method == "closed form":
        from jaxkin.mapping.closed_form import closed_form_curves

        return closed_form_curves(bound)
    if method != "trace":
        raise InputError(f"jk.singular_curves: method is {method!r}: choose 'trace' or 'closed form'.")
    sheets = bound.sheets()
    traced = [trace_section(sheet) for sheet in sheets]
    met = meetings(bound, traced)
    curves: list[Curve] = []
    for sheet, part, shared in zip(sheets, traced, met.shared, strict=True):
        own = [arc for arc, twice in zip(part.arcs, shared, strict=True) if not twice]
        curves += [_curve(sheet, strand) for strand in whole_curves(sheet, strands_of(own, bound.period))]
    isolated, nodes = (gathered(bound, [getattr(part, name) for part in traced]) for name in ("isolated", "crossings"))
    alone = zip(*evaluated(bound, isolated), strict=True)
    dots = [Curve(q[None], x[None], False, float(r), ends=(_ALONE, _ALONE)) for q, x, r in alone]
    joints, poses, residual = evaluated(bound, gathered(bound, [nodes, met.points]))
    return SingularCurves(
        curves=(*sorted(curves, key=lambda curve: -len(curve)), *dots) if len(sheets) > 1 else (*curves, *dots),
        crossings=Crossings(joints, poses, residual),
        **bound.record("trace"),
        evidence=summed([part.evidence for part in traced]),
    )


def gathered(section: Section, parts: list[np.ndarray]) -> np.ndarray:
    """Returns the points of several sheets, each once."""
    points = np.concatenate(parts)
    points = points[search.distinct(section, points)] if len(parts) > 1 else points
    return points[search.without_twins(section, points)]


def summed(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Adds up the evidence of several sheets."""
    total = dict(parts[0])
    for part in parts[1:]:
        for name, value in part.items():
            total[name] = np.add(total[name], value).tolist()
    return total


def _curve(section: Section, strand: Arc) -> Curve:
    joints, poses, residual = evaluated(section, _refined(section, strand))
    for k, end in ((0, strand.start), (-1, strand.end)):
        if end.kind == "border":  # Where the curve ends the joint is at its bound, not an ulp beside it.
            joint, bound = section.border(end.number)
            joints[k, joint] = bound
    return Curve(
        joints=joints,
        poses=poses,
        closed=strand.closed,
        residual=float(np.max(residual)),
        label=_factor(section, poses),
        ends=(_name(section, strand.start), _name(section, strand.end)),
    )


def _refined(section: Section, strand: Arc) -> np.ndarray:
    """Returns the strand's points with others between them where its image in the joints is coarse.

    The tracer's steps are even in pose space; a leg that almost vanishes turns the image quickly.
    """
    points, free = strand.points, list(section.grid.free)
    width = np.asarray(section.data.high) - np.asarray(section.data.low)
    for _ in range(_REFINEMENTS):
        following = points[:1] if strand.closed else points[:0]
        if strand.closed:
            following = points[-1] + short_way(following - points[-1], section.period)
        a, b = points[: len(points) - (not strand.closed)], np.vstack([points[1:], following])
        steps = np.diff(evaluated(section, np.vstack([points, following]))[0][:, free] / width, axis=0)
        length = np.sqrt(np.sum(steps**2, axis=1))
        unit = steps / np.maximum(length, 1e-300)[:, None]
        turned = np.sum(unit[1:] * unit[:-1], axis=1) < np.cos(_SHARP)
        sharp = np.append(turned, False) | np.insert(turned, 0, False)
        coarse = ((length > _LONG) | (sharp & (length > _SHORT))) & (np.max(np.abs(b - a), axis=1) > _LEAST)
        if not coarse.any():
            break
        middle = search.midpoints(section, np.stack([a[coarse], b[coarse]], axis=1))
        near = np.max(np.abs(middle - 0.5 * (a + b)[coarse]), axis=1) < 0.2 * np.max(np.abs(b - a)[coarse], axis=1)
        points = np.insert(points, np.flatnonzero(coarse)[near] + 1, middle[near], axis=0)
    return points


def _name(section: Section, end: End) -> str:
    """Says in words what a curve ends on."""
    if end.kind != "border":
        return end.kind
    return border_name(section, end.number)


def border_name(section: Section, edge: int) -> str:
    """Names a border of the section, for instance ``rho3 = 4``."""
    joint, bound = section.border(edge)
    return f"{section.robot.joint_axes[joint].name} = {bound:g}"


def evaluated(section: Section, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns joints, poses with angles in one turn, and dimensionless residuals of points of the chart.

    The residual is the largest of |F_i| over the magnitude of its terms and |det A| over Hadamard's bound, the product
    of the lengths of its rows.
    """
    chart, robot = section.chart, section.robot
    values = over_points(_evaluate, chart, section.data, search.glued(section, points))
    joints, poses, residual = np.split(values, [len(robot.joint_axes), len(robot.joint_axes) + chart.n_pose], axis=1)
    poses = _in_intervals(section, points, poses)
    # On the border rounding may put a joint an ulp outside.
    low, high = np.asarray(section.data.low), np.asarray(section.data.high)
    free = list(section.grid.free)
    joints[:, free] = np.where(
        np.abs(joints[:, free] - np.clip(joints[:, free], low, high)) < 1e-12 * (1 + np.abs(high)),
        np.clip(joints[:, free], low, high),
        joints[:, free],
    )
    return joints, poses, residual[:, 0]


def _in_intervals(section: Section, points: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Takes the other triple of angles where one of them is beyond the interval of its axis."""
    robot = section.robot
    if robot.twin is None or len(points) == 0:
        return poses
    low, high = (np.array([getattr(axis, end) for axis in robot.pose_axes]) for end in ("low", "high"))
    inside = np.all((poses >= low - 1e-9) & (poses <= high + 1e-9), axis=1, keepdims=True)
    unit = np.asarray(section.data.pose_unit)
    return np.where(inside, poses, search.twins(section, points)[:, : section.chart.n_pose] * unit)


def _evaluate(chart: Chart, data: SectionData, u: Array) -> Array:
    joints, pose = chart.joints(data, u), chart.pose(data, u)
    closing = jnp.abs(data.robot.constraints(pose, joints)) / data.robot.constraint_scales(pose, joints)
    singular = jnp.abs(chart.determinant(data, u)) / chart.determinant_size(data, u)
    return jnp.concatenate([joints, pose, jnp.maximum(jnp.max(closing), singular)[None]])


def _factor(section: Section, poses: np.ndarray) -> str:
    """Names the factor of the singularity that vanishes along a curve, if the mechanism declares factors."""
    if not hasattr(section.robot, "factors"):
        return ""
    spread = search.starting_points(section, part=0)[:32, : section.chart.n_pose] * np.asarray(section.data.pose_unit)
    here, anywhere = (in_blocks(partial(_factors, section.robot), points) for points in (poses, spread))
    share = {name: float(np.median(np.abs(here[name])) / np.median(np.abs(anywhere[name]))) for name in here}
    return min(share, key=lambda name: share[name])


@jax.jit
def _factors(robot: Any, poses: Array) -> dict[str, Array]:
    return jax.vmap(robot.factors)(poses)
