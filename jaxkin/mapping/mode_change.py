"""``jk.mode_change``: from one assembly mode to another without meeting a singularity, or why that cannot be."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, plain
from jaxkin.core.provenance import identity
from jaxkin.kinematics._following import pose_unit
from jaxkin.kinematics.boundary import checked_single, checked_vector
from jaxkin.kinematics.legs import Legs, legs_of
from jaxkin.kinematics.tracking import solution_near
from jaxkin.mapping._mode_change_boxes import boxes_of, cells_of, searched
from jaxkin.mapping._mode_change_loops import Undecided, closed, encircled
from jaxkin.mapping._mode_change_paths import Path, best_path, improved
from jaxkin.mapping._mode_change_records import ModeChange
from jaxkin.mapping._mode_change_search import Lattice
from jaxkin.mapping._mode_change_terrain import (
    Terrain,
    character,
    clearances,
    single_valued,
    terrain_of,
)
from jaxkin.mapping.aspects import aspects
from jaxkin.mapping.chart import factor_names, tells_factors
from jaxkin.numerics.gluing import short_way
from jaxkin.sweep.grid import Grid

_WHO = "jk.mode_change"
#: Poses, dimensionless, that agree so far are one; a smaller clearance is a singularity.
_SAME, _SINGULAR = 1e-7, 1e-9


def mode_change(
    robot: Mechanism,
    joints: ArrayLike,
    start: ArrayLike,
    goal: ArrayLike,
    grid: Grid | None = None,
    *,
    encircle: bool = True,
) -> ModeChange:
    """Finds a path from one assembly mode to another over the same joints that meets no singularity.

    Such a path exists where both poses lie in one aspect: the joints then run through a loop, and bring the robot back
    in another assembly mode. It is sought over a lattice of poses (the widest path, and the shortest that is wide
    enough), made short, smooth and wide by gradients, and verified: ``jk.track`` along the loop must lead from
    ``start`` over the poses of the path to ``goal``. The working mode is that of ``start`` throughout, and limits hold
    all along.

    Args:
        robot: The mechanism.
        joints: ``(n_joint,)``.
        start: ``(n_pose,)`` a solution there (one of ``jk.forward``), to a dimensionless residual of 1e-6.
        goal: ``(n_pose,)`` another one.
        grid: Where to search, a grid over the pose axes with start and goal inside; a number holds an axis. None takes
            boxes around all assembly modes of ``joints``, wider and finer where nothing is found.
        encircle: Whether to look for the cusp curves in a box around the loop, and which of them it is linked with:
            that takes seconds, and the first time about a minute.

    Returns:
        A ``ModeChange``: ``.found``, ``.reason``, ``.poses``, ``.joints``, ``.clearance``, ``.verified``,
        ``.encircled``. Where ``.found`` is False, ``.certain`` tells whether signs prove that there is none (another
        working mode, another sign of det A or of a factor, a violated limit), or nothing was found in
        the box at this resolution. Encircling no cusp curve is a valid answer (Coste, Wenger and Chablat 2016).

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Wrong shapes; start or goal is no solution at the joints, is singular, or lies outside
            the grid.

    Not differentiable. Where the equations do not hold their joints leg by leg, the working mode is followed by
    continuation, and a pose that several of its sheets cover is searched on one of them only.

    References:
        Wenger, P. and Chablat, D., 1998, "Workspace and assembly modes in fully-parallel manipulators: a descriptive
        study" (aspects and mode changing paths); Coste, M., Wenger, P. and Chablat, D., 2016, "Hidden cusps".
    """
    checked_single(_WHO, robot)
    case = _case(robot, joints, start, goal)
    bound = None if grid is None else grid.bind(robot.pose_axes, "pose")
    apart = _told_apart(case) or _beyond(case)
    if apart is not None:
        return _record(case, found=False, reason=apart)
    if _gap(case) <= _SAME:
        return _trivial(case)
    terrain = terrain_of(robot, case.legs, case.ends, case.joints)
    boxes = list(boxes_of(_WHO, robot, bound, case.joints, case.ends))
    evidence = dict[str, Any]()
    for box in boxes:
        path, evidence = best_path(robot, terrain, case.legs, box, case.ends, case.joints)
        if path is not None:
            return _found(case, path, searched(robot, box), evidence, encircle)
    return _by_cells(case, terrain, boxes, grid is not None, evidence, encircle)


@dataclass(frozen=True, eq=False)
class _Case:
    """A request, checked: both ends are regular solutions within all limits, in their own units."""

    robot: Mechanism
    legs: Legs | None
    joints: np.ndarray
    ends: np.ndarray
    modes: tuple[np.ndarray, np.ndarray]
    signs: tuple[np.ndarray, np.ndarray]
    residuals: tuple[float, float]

    @property
    def aspects(self) -> tuple[str, str]:
        """Names the aspects by what tells them apart."""
        first, second = (_name(self, k) for k in (0, 1))
        return first, second


def _case(robot: Mechanism, joints: ArrayLike, start: ArrayLike, goal: ArrayLike) -> _Case:
    q = np.asarray(checked_vector(_WHO, "the joints", joints, robot.joint_axes))
    if not np.all(np.isfinite(q)):
        raise InputError(f"{_WHO}: the joints are {plain(q)}: they must be finite numbers; correct them.")
    unit = np.asarray(pose_unit(robot))
    named = (("start", start), ("goal", goal))
    solved = [solution_near(_WHO, robot, q, pose, what) for what, pose in named]
    ends = np.stack([x for x, _ in solved]) * unit
    clear = clearances(robot, ends, np.stack([q, q]))
    for k, (what, _) in enumerate(named):
        if not clear[k] > _SINGULAR:
            raise InputError(
                f"{_WHO}: {what} {plain(ends[k])} is singular (clearance {clear[k]:.2g}): it lies on the border of "
                "aspects, in none; move the joints off the singularity."
            )
    legs = legs_of(robot)
    modes, signs = zip(*(character(robot, legs, end, q) for end in ends), strict=True)
    if any(np.any(mode == 0) for mode in modes):
        raise InputError(
            f"{_WHO}: det dF/djoints vanishes at start or goal (a leg is stretched, folded or of zero length): no "
            "working mode is theirs; move the joints."
        )
    return _Case(robot, legs, q, ends, modes, signs, (solved[0][1], solved[1][1]))  # type: ignore[arg-type]


def _name(case: _Case, k: int) -> str:
    """Names an aspect as ``jk.aspects`` does, by the working mode where there are several, and by signs."""
    names = factor_names(case.robot) if tells_factors(case.robot) else ("det",)
    pairs = zip(names, case.signs[k], strict=True)
    text = ", ".join(f"{name} {'>' if sign > 0 else '<'} 0" for name, sign in pairs)
    if case.legs is None:
        return f"det B {'>' if case.modes[k][0] > 0 else '<'} 0, {text}"
    if len(case.legs.modes) == 1:
        return text
    return f"({', '.join('+' if sign > 0 else '-' for sign in case.modes[k])}) {text}"


def _told_apart(case: _Case) -> str | None:
    """Returns why the two poses cannot be in one aspect, where their signs prove it."""
    first, second = case.aspects
    if np.any(case.modes[0] != case.modes[1]):
        return f"not in the same aspect: start is in working mode {first}, goal in {second}, and det B = 0 lies between"
    if np.any(case.signs[0] != case.signs[1]) and single_valued(case.robot, case.legs, case.ends[0], case.joints):
        return f"not in the same aspect: start has {first}, goal has {second}, and a singularity lies between"
    return None


def _beyond(case: _Case) -> str | None:
    """Returns why one of the poses lies in no aspect: it violates a limit."""
    for what, pose in zip(("start", "goal"), case.ends, strict=True):
        margins = case.robot.margins(jnp.asarray(pose), jnp.asarray(case.joints))
        name, value = min(((name, float(value)) for name, value in margins.items()), key=lambda item: item[1])
        if not value >= -1e-9:
            return f"{what} lies in no aspect: its margin {name} is {value:.6g}, and a negative one violates a limit"
    return None


def _by_cells(
    case: _Case, terrain: Terrain, boxes: list[Lattice], given: bool, evidence: dict[str, Any], encircle: bool
) -> ModeChange:
    """Asks ``jk.aspects``, whose cells become fine where a lattice is too coarse, and says what is known."""
    signs = f"both have the signs {case.aspects[0]}, but"
    if case.legs is None or sum(count > 1 for count in boxes[0].shape) > 3:
        reason = f"{signs} no path was found in the box searched, at this resolution"
        tried = searched(case.robot, boxes[-1]) if boxes else {}
        return _record(case, found=False, certain=False, reason=reason, searched=tried, evidence=evidence)
    cells = cells_of(boxes[0], case.robot, given)
    tried = cells.bind(case.robot.pose_axes, "pose").content()
    try:
        found = aspects(case.robot, cells)
    except InputError as problem:
        reason = f"{signs} no path was found in the box searched, at this resolution"
        note = {"jk.aspects": str(problem)}
        return _record(case, found=False, certain=False, reason=reason, searched=tried, evidence={**evidence, **note})
    places = [found.aspect_of(end, case.joints) for end in case.ends]
    poses = found.path(case.ends[0], case.ends[1], case.joints, case.joints)
    note = {"jk.aspects: aspects found, doubts": [found.count, len(found.doubts)]}
    if poses is not None:
        path, more = improved(case.robot, terrain, case.legs, boxes[0], poses, case.ends, case.joints)
        note |= more
        if path is not None:
            return _found(case, path, tried, {**evidence, **note}, encircle)
    names = [found[place].name if place >= 0 else "none that was found" for place in places]
    if poses is None and min(places) >= 0 and places[0] != places[1]:
        reason = f"not in the same aspect: jk.aspects finds {names[0]} around start and {names[1]} around goal"
    else:
        reason = f"{signs} no path was found in the box searched, at this resolution"
    return _record(case, found=False, certain=False, reason=reason, searched=tried, evidence={**evidence, **note})


def _gap(case: _Case) -> float:
    """Returns how far start and goal are apart, dimensionless, on the glued space."""
    period = np.array([np.inf if axis.period is None else axis.period for axis in case.robot.pose_axes])
    return float(np.max(np.abs(short_way(case.ends[1] - case.ends[0], period) / np.asarray(pose_unit(case.robot)))))


def _record(case: _Case, **content: Any) -> ModeChange:
    axes = (*case.robot.pose_axes, *case.robot.joint_axes)
    n = (len(case.robot.pose_axes), len(case.robot.joint_axes))
    nothing = {
        "certain": True,
        "clearance": float("nan"),
        "poses": np.zeros((0, n[0])),
        "joints": np.zeros((0, n[1])),
        "clearances": np.zeros(0),
        "length": 0.0,
        "verified": False,
        "encircled": (),
        "linking": None,
        "searched": {},
        "evidence": {},
    }
    residuals = {"residuals of start and goal as given": list(case.residuals)}
    content["evidence"] = {**content.get("evidence", {}), **residuals}
    return ModeChange(
        **{**nothing, **content},
        start=case.ends[0],
        goal=case.ends[1],
        aspects=case.aspects,
        request={
            **identity(case.robot),
            "joints": case.joints.tolist(),
            "start": case.ends[0].tolist(),
            "goal": case.ends[1].tolist(),
            "searched": content.get("searched", {}),
        },
        pose_names=tuple(axis.name for axis in case.robot.pose_axes),
        joint_names=tuple(axis.name for axis in case.robot.joint_axes),
        units={axis.name: axis.unit for axis in axes},
    )


def _trivial(case: _Case) -> ModeChange:
    clear = clearances(case.robot, case.ends[:1], case.joints[None])
    return _record(
        case,
        found=True,
        reason="start and goal are one pose: there is nothing to change",
        clearance=float(clear[0]),
        poses=case.ends[:1],
        joints=case.joints[None],
        clearances=clear,
        verified=True,
    )


def _found(case: _Case, path: Path, tried: dict[str, Any], evidence: dict[str, Any], encircle: bool) -> ModeChange:
    linking, curves, note = None, None, dict[str, Any]()
    if encircle:
        try:
            linking, curves = encircled(case.robot, closed(case.robot, path.joints))
        except Undecided as why:
            note = {"what the loop encircles is not decided": str(why)}
    return _record(
        case,
        found=True,
        reason=f"a path without a singularity within the aspect {case.aspects[0]}",
        clearance=path.clearance,
        poses=path.poses,
        joints=path.joints,
        clearances=path.clearances,
        length=path.length,
        verified=True,
        encircled=tuple(name for name, number in (linking or {}).items() if number),
        linking=linking,
        cusp_curves=curves,
        searched=tried,
        evidence={**evidence, **path.evidence, **note},
    )
