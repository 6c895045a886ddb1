"""``jk.regions``: where in a section of the joint space how many assembly modes exist."""

from typing import Any

import jax
import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_single
from jaxkin.mapping._region_cells import Cells, Slicing, box_cells
from jaxkin.mapping._region_counts import counted, inside
from jaxkin.mapping._region_division import Divided, divided
from jaxkin.mapping._region_edges import areas_under
from jaxkin.mapping._region_paths import Plane
from jaxkin.mapping._region_records import Arc, Nodes, Region, Regions, letters
from jaxkin.mapping.loci import evaluated, singular_curves
from jaxkin.mapping.records import SingularCurves
from jaxkin.mapping.section import bind_section
from jaxkin.sweep.grid import Grid

_WHO = "jk.regions"


def regions(robot: Mechanism, section: Grid, *, curves: SingularCurves | None = None) -> Regions | Cells:
    """Divides a section of the joint space, or a box, into its regions with a constant number of assembly modes.

    The images of the singular curves divide a section. They are cut into arcs that are graphs over one direction, at
    points solved for on the equations (where they turn back or have cusps, where they cross, where a leg vanishes); a
    sweep over the abscissas of these points joins what lies between neighbouring arcs. Areas are integrals along the
    arcs in the curves' own smooth parameter. The forward kinematics counts the solutions at several points a region.

    Args:
        robot: The mechanism.
        section: A grid with two free joint axes, as for ``jk.singular_curves``; joint limits cut it. An angle that runs
            over its whole period is glued: regions go on over its ends. With three free axes the grid is a box, which
            is cut into slices across the axis with the fewest samples, at most so many of them (and at least five):
            their regions are joined, and their areas integrated by Simpson's rule, with smaller steps where it errs.
        curves: The singular curves of this robot and section, if they are known already.

    Returns:
        Of a section ``Regions``, largest first: ``.n_solutions``, ``.area`` and ``.error``, ``.interior`` (a point well
        inside), ``.neighbours`` (regions beyond arcs, with the curve between), ``.outline``; and ``.arcs``, ``.nodes``,
        ``.curves``, ``.region_of(joints)``, ``.evidence``. Of a box ``Cells``: ``.n_solutions``, ``.volume`` and
        ``.error``, ``.interior``, ``.neighbours``; and ``.slices``, ``.region_of(joints)``, ``.evidence``. A solution
        counts in whatever working mode and aspect; of all limits only those of the joints are applied.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As ``jk.singular_curves``; not two or three free axes; curves of another section; a slice of a box
            that no pose reaches.
        GeometryError: As ``jk.singular_curves``.

    Not differentiable. That every curve and crossing was found is not proved: ``.evidence`` says how often counts
    disagree within a region, and across how many arcs the number does not change by two a curve. Regions narrower than
    about 1e-5 of the section, where two arcs nearly touch, may be missed. A cell of a box that is thin across the
    slices, or runs sideways by more than its width from one to the next, may be missed or listed in pieces.

    References:
        Wenger and Chablat 2009, Fig. 3: regions with 2, 4 and 6 solutions (those with none are not mentioned).
    """
    if isinstance(section, Grid) and isinstance(robot, Mechanism) and len(section.free) == 3 and curves is None:
        return _of_box(robot, section)
    bound = bind_section(_WHO, robot, section)
    request = bound.record("trace")["request"]
    if curves is None:
        curves = singular_curves(robot, section)
    elif {name: curves.request.get(name) for name in request} != request:
        raise InputError(
            f"{_WHO} got curves of another robot or section, or by closed form: pass "
            "jk.singular_curves(robot, section), or leave them out."
        )
    return _recorded(divided(Plane.over(bound), curves), curves)


def _of_box(robot: Mechanism, box: Grid) -> Cells:
    checked_single(_WHO, robot)
    bound = box.bind(robot.joint_axes, "joint")
    slicing = Slicing.of(_WHO, robot, bound)

    def solve(value: float) -> Regions:
        found = regions(robot, slicing.grid(value))
        assert isinstance(found, Regions)
        return found

    return box_cells(robot, slicing, solve, {**identity(robot), "method": "regions", "box": bound.content()})


def _recorded(found: Divided, curves: SingularCurves) -> Regions:
    """Measures, counts and names what the division has found."""
    plane, division = found.plane, found.division
    robot = plane.section.robot
    area, error = _areas(found)
    points = inside(found)
    numbers, evidence = _numbers(robot, points.region, plane.joints(points.plane), division.count)
    rank = np.argsort(-area, kind="stable")
    place = np.empty(len(rank), int)
    place[rank] = np.arange(len(rank))
    arcs = _arcs(found, place)
    strange = sum(_strange(arc, numbers[rank]) for arc in arcs)
    names = letters(numbers[rank].tolist())
    record = plane.section.record("regions")
    return Regions(
        regions=tuple(
            Region(
                name=names[k],
                n_solutions=int(numbers[region]),
                area=float(area[region]),
                error=float(error[region]),
                interior=plane.joints(points.plane[points.region == region][:1])[0],
                neighbours=_neighbours(arcs, k),
                outline=_outline(found, int(region)),
            )
            for k, region in enumerate(rank)
        ),
        arcs=arcs,
        nodes=_nodes(found),
        curves=curves,
        limits_not_applied=_ignored(robot),
        evidence={
            **found.evidence,
            **evidence,
            "arcs across which the number changes by another one than two a curve": strange,
        },
        _divided=found,
        _numbers=np.append(place, -1),
        **record,
    )


def _areas(found: Divided) -> tuple[np.ndarray, np.ndarray]:
    """Returns the area of every region and its estimated error."""
    under, miss = areas_under(found.plane, found.edges)
    area, error = np.zeros(found.division.count), np.zeros(found.division.count)
    for side, sign in ((found.division.below, 1.0), (found.division.above, -1.0)):
        real = side >= 0
        np.add.at(area, side[real], sign * under[real])
        np.add.at(error, side[real], miss[real])
    unit = float(np.prod(found.plane.width))
    return area * unit, (error + 1e-15) * unit


def _numbers(robot: Mechanism, region: np.ndarray, joints: np.ndarray, count: int) -> tuple[np.ndarray, dict[str, int]]:
    """Returns the number of solutions of every region, and how far its points agree on it."""
    found = counted(robot, joints)
    numbers = np.zeros(count, int)
    disagreeing = unsure = 0
    for k in range(count):
        own = region == k
        sure = own & found.sure
        unsure += not sure.any()
        values, times = np.unique(found.number[sure if sure.any() else own], return_counts=True)
        numbers[k] = values[np.argmax(times)]
        disagreeing += int(np.sum(found.number[sure] != numbers[k]))
    return numbers, {
        "points at which solutions were counted": len(region),
        "points whose number of solutions is not their region's": disagreeing,
        "regions without a sure number of solutions": unsure,
    }


def _arcs(found: Divided, place: np.ndarray) -> tuple[Arc, ...]:
    plane, place = found.plane, np.append(place, -1)
    n_pose = plane.section.chart.n_pose
    own = [edge for edge in found.edges if edge.curves]
    poses = np.zeros((0, n_pose))
    if own:
        poses = evaluated(plane.section, np.concatenate([edge.u for edge in own]))[1]
    parts = iter(np.split(poses, np.cumsum([len(edge.u) for edge in own])[:-1]) if own else ())
    return tuple(
        Arc(
            joints=plane.joints(edge.plane),
            poses=next(parts) if edge.curves else np.full((len(edge.plane), n_pose), np.nan),
            curve=edge.curves[0] if edge.curves else -1,
            sides=(int(place[found.division.above[k]]), int(place[found.division.below[k]])),
            curves=edge.curves,
        )
        for k, edge in enumerate(found.edges)
    )


def _strange(arc: Arc, numbers: np.ndarray) -> bool:
    """True where the number of solutions does not change by two for each of an arc's singular poses."""
    left, right = arc.sides
    if not arc.curves or min(left, right) < 0:
        return False
    return abs(int(numbers[left]) - int(numbers[right])) != 2 * arc.multiplicity


def _neighbours(arcs: tuple[Arc, ...], region: int) -> tuple[tuple[int, int], ...]:
    pairs = set()
    for arc in arcs:
        left, right = arc.sides
        if region in arc.sides and left != right and min(left, right) >= 0:
            pairs |= {(right if left == region else left, curve) for curve in arc.curves}
    return tuple(sorted(pairs))


def _outline(found: Divided, region: int) -> list[np.ndarray]:
    """Returns the closed boundaries of a region as joint points; the one round the largest area first."""
    lines, sizes = [], []
    for loop in found.division.loops[region]:
        paths = [found.edges[arc].plane[:: 1 if rightward else -1][:-1] for arc, rightward in loop]
        line = np.concatenate(paths)
        following = np.roll(line, -1, axis=0)
        sizes.append(0.5 * float(np.sum(line[:, 0] * following[:, 1] - line[:, 1] * following[:, 0])))
        lines.append(found.plane.joints(line))
    return [lines[k] for k in np.argsort(-np.array(sizes), kind="stable")]


def _nodes(found: Divided) -> Nodes:
    plane, n = found.plane, found.plane.section.chart.n_pose
    count, m = len(found.nodes.plane), plane.section.chart.dimension
    poses = evaluated(plane.section, found.nodes.u.reshape(2 * count, m))[1] if count else np.zeros((0, n))
    return Nodes(plane.joints(found.nodes.plane), poses.reshape(count, 2, n))


def _ignored(robot: Mechanism) -> tuple[str, ...]:
    """Returns the names of limits besides the joints' own."""
    own = {f"{axis.name}_{end}" for axis in robot.joint_axes for end in ("low", "high")}
    names: list[str] = []

    def listed(r: Any, pose: Any, joints: Any) -> None:
        names.extend(r.margins(pose, joints))

    sizes = [jax.ShapeDtypeStruct((len(axes),), float) for axes in (robot.pose_axes, robot.joint_axes)]
    jax.eval_shape(listed, robot, *sizes)
    return tuple(name for name in names if name not in own)
