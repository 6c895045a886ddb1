"""``jk.singular_curves``: the singular set of a section of the joint space."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, scale_vector
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

_WHO = "jk.singular_curves"
#: Longest chord and sharpest turn (rad) of a curve's image, in widths of the box; shorter chords may turn as they will.
_LONG, _SHARP, _SHORT = 0.02, 0.15, 0.0002
#: Shortest step in pose space that is halved, and how often.
_LEAST, _REFINEMENTS = 1e-3, 9
#: Joints that move less than this along a whole curve stand still.
_STILL = 1e-9
#: The ends of a component that is one point.
_ALONE = "isolated point"


def singular_curves(
    robot: Mechanism, section: Grid, *, method: str = "trace", kind: str = "parallel"
) -> SingularCurves:
    """Finds the singular curves over a section of the joint space, or of the workspace.

    Over two joints: all parallel singularities (type 2, det dF/dpose = 0). The curves are traced in pose space, where
    they are smooth also over cusps, on the constraints alone; the joints follow by inverse kinematics. A curve goes on
    over glued angles and straight through crossings; it ends only on the borders of the section.

    Over two pose coordinates: the same in every working mode, and on request the serial singularities (type 1,
    det dF/djoints = 0), leg by leg where every equation holds one joint. A curve of det A meets the set where a leg is
    stretched or folded only by going over to the working mode with that leg's other sign: there it is cut, both
    pieces end on ``"det B, leg k"`` in one point, and are labelled by their modes. Where no working mode can be told,
    curves are not cut.

    Args:
        robot: The mechanism.
        section: A grid with two free axes, over the joints or over the pose; their ends are limits, their numbers only
            seed. Joint limits of the robot cut the curves.
        method: ``"trace"``, or ``"closed form"`` for a mechanism that declares ``closed_form_curves`` (the analytic
            3-RPR): labelled, and with the virtual parts, whose poses are complex.
        kind: ``"parallel"``, or over a pose section also ``"serial"`` or ``"both"``.

    Returns:
        The curves, longest first: ``.joints (k, n_joint)``, ``.poses (k, n_pose)``, ``.closed``, ``.residual``
        (dimensionless) each; and ``.crossings``, ``.self_motions``, ``.evidence``. Empty where the section has no
        singular pose. A glued joint that is free over its whole period has no border: curves go on over its seam.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Not exactly two free axes, an unknown axis, axes of both spaces, a joint fixed outside its limits or
            at a length of zero, a section that no pose reaches or on which every pose is singular, an unknown method or
            kind.
        GeometryError: The geometry is degenerate, or det dF/dpose vanishes identically, or the singular set is double
            along a curve.

    Not differentiable. Completeness is not proved: two searches from spread starts, and one for the ends on the
    borders, must lie on the curves; ``.evidence`` holds the numbers.
    """
    if _over_poses(robot, section, method, kind):
        from jaxkin.mapping._pose_curves import pose_curves
        from jaxkin.mapping.pose_sections import bind_pose_section

        return pose_curves(bind_pose_section(_WHO, robot, section), kind)
    bound = bind_section(_WHO, robot, section)
    if method == "closed form":
        from jaxkin.mapping.closed_form import closed_form_curves

        return closed_form_curves(bound)
    sheets = bound.sheets()
    traced = [trace_section(sheet) for sheet in sheets]
    met = meetings(bound, traced)
    curves: list[Curve] = []
    for sheet, part, shared in zip(sheets, traced, met.shared, strict=True):
        own = [arc for arc, twice in zip(part.arcs, shared, strict=True) if not twice]
        curves += [_curve(sheet, strand) for strand in whole_curves(sheet, strands_of(own, bound.period))]
    isolated, nodes = (gathered(bound, [getattr(part, name) for part in traced]) for name in ("isolated", "crossings"))
    joints, poses, residual = evaluated(bound, gathered(bound, [nodes, met.points]))
    still = [stands_still(bound, curve.joints) for curve in curves]
    moving = [curve for curve, stands in zip(curves, still, strict=True) if not stands]
    if len(sheets) > 1:
        moving = sorted(moving, key=lambda curve: -len(curve))
    return SingularCurves(
        curves=(*moving, *dots(bound, isolated, "")),
        crossings=Crossings(joints, poses, residual),
        **bound.record("trace"),
        evidence=summed([part.evidence for part in traced]),
        self_motions=tuple(curve for curve, stands in zip(curves, still, strict=True) if stands),
    )


def _over_poses(robot: Mechanism, section: Grid, method: str, kind: str) -> bool:
    """True where the grid is over the pose; refuses what fits neither space."""
    if method not in ("trace", "closed form"):
        raise InputError(f"{_WHO}: method is {method!r}: choose 'trace' or 'closed form'.")
    if kind not in ("parallel", "serial", "both"):
        raise InputError(f"{_WHO}: kind is {kind!r}: choose 'parallel', 'serial' or 'both'.")
    if not isinstance(section, Grid) or not isinstance(robot, Mechanism):
        return False  # What binds the section says what it needs.
    poses, joints = ({axis.name for axis in axes} & set(section.axes) for axes in (robot.pose_axes, robot.joint_axes))
    if poses and joints:
        raise InputError(
            f"{_WHO}: the grid has pose axes ({', '.join(sorted(poses))}) and joint axes ({', '.join(sorted(joints))}):"
            " a section is over one of the two spaces; name the axes of one."
        )
    if poses and method != "trace":
        raise InputError(f"{_WHO}: method is {method!r}, which is over joints only: use 'trace' for a pose section.")
    if not poses and kind != "parallel":
        raise InputError(
            f"{_WHO}: kind is {kind!r}, which needs a grid over the pose axes: over joints there is 'parallel' only."
        )
    return bool(poses)


def stands_still(section: Section, joints: np.ndarray) -> bool:
    """True for a self-motion: the joints stay where they are all along the curve."""
    robot = section.robot
    unit = np.asarray(scale_vector(robot.joint_axes, robot.characteristic_length()))
    away = short_way(joints - joints[:1], section.joint_period) / unit
    return bool(np.max(np.abs(away)) < _STILL)


def dots(section: Section, points: np.ndarray, label: str) -> list[Curve]:
    """Returns components that are one point as curves."""
    alone = zip(*evaluated(section, points), strict=True)
    return [Curve(q[None], x[None], False, float(r), label, ends=(_ALONE, _ALONE)) for q, x, r in alone]


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
    joints, poses, residual = evaluated(section, refined(section, strand))
    for k, end in ((0, strand.start), (-1, strand.end)):
        if end.kind == "border":
            section.put_on_border(end.number, joints[k], poses[k])
    return Curve(
        joints=joints,
        poses=poses,
        closed=strand.closed,
        residual=float(np.max(residual)),
        label=factor_label(section, poses),
        ends=(end_name(section, strand.start), end_name(section, strand.end)),
    )


def refined(section: Section, strand: Arc) -> np.ndarray:
    """Returns the strand's points with others between them where its image in the free axes is coarse.

    The tracer's steps are even in pose space; a leg that almost vanishes turns the image quickly.
    """
    points = strand.points
    for _ in range(_REFINEMENTS):
        following = points[:1] if strand.closed else points[:0]
        if strand.closed:
            following = points[-1] + short_way(following - points[-1], section.period)
        a, b = points[: len(points) - (not strand.closed)], np.vstack([points[1:], following])
        steps = section.image_steps(*evaluated(section, np.vstack([points, following]))[:2])
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


def end_name(section: Section, end: End) -> str:
    """Says in words what a curve ends on."""
    if end.kind != "border":
        return end.kind
    return section.border_name(end.number)


def evaluated(section: Section, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns joints, poses with angles in one turn, and dimensionless residuals of points of the chart.

    The residual is the largest of |F_i| over the magnitude of its terms and |det A| over Hadamard's bound, the product
    of the lengths of its rows.
    """
    chart, robot = section.chart, section.robot
    values = over_points(_evaluate, chart, section.data, search.glued(section, points))
    joints, poses, residual = np.split(values, [len(robot.joint_axes), len(robot.joint_axes) + chart.n_pose], axis=1)
    poses = _in_intervals(section, points, poses)
    section.settle(joints, poses)
    return joints, poses, residual[:, 0]


def _in_intervals(section: Section, points: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Takes the other triple of angles where one of them is beyond the interval of its axis."""
    robot = section.robot
    if not section.has_twins or len(points) == 0:
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


def factor_label(section: Section, poses: np.ndarray) -> str:
    """Names the factor of the singularity that vanishes along a curve, if the mechanism declares factors."""
    if not hasattr(section.robot, "factors"):
        return ""
    spread = evaluated(section, search.starting_points(section, part=0)[:32])[1]
    here, anywhere = (in_blocks(partial(_factors, section.robot), points) for points in (poses, spread))
    share = {name: float(np.median(np.abs(here[name])) / np.median(np.abs(anywhere[name]))) for name in here}
    return min(share, key=lambda name: share[name])


@jax.jit
def _factors(robot: Any, poses: Array) -> dict[str, Array]:
    return jax.vmap(robot.factors)(poses)
