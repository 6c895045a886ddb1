"""Lifts of a curve of singular poses: the other assembly modes over its joints, as curves of their own."""

from dataclasses import dataclass, replace

import numpy as np

from jaxkin.kinematics.legs import Legs
from jaxkin.mapping import search
from jaxkin.mapping._lifts import Modes, chains, glued_gap, linked, measured, modes_over, same_working_mode
from jaxkin.mapping.loci import evaluated
from jaxkin.mapping.section import Section
from jaxkin.numerics.gluing import short_way

#: Where lifts end, points are put between the curve's until they are so near each other (dimensionless), or so often.
_NEAREST, _ROUNDS = 1e-5, 14
#: A mode that moves farther between two points (dimensionless) gets one between, if these are not this close already.
_COARSE, _FINE = 0.06, 1e-3
#: Points farther apart than this are not neighbours on one chart (the other triple of angles), and none lies between.
_APART = 0.3
#: At the end of a lift: so near the singular pose it ends in a cusp, with so small a determinant in another fold.
_AT_CUSP, _AT_FOLD = 0.02, 0.05


@dataclass(frozen=True, eq=False)
class Source:
    """A curve of singular poses whose joints other modes share.

    Attributes:
        section: The section bound to the equations of the curve.
        points: ``(k, m)`` in the section's unknowns.
        closed: True where the last point is followed by the first.
        leg: The leg that is stretched or folded all along, -1 where it is det A that vanishes.
        ends: What the curve ends on.
        crossings: ``(n, n_pose)`` where the singular set crosses itself.
    """

    section: Section
    points: np.ndarray
    closed: bool
    leg: int
    ends: tuple[str, str]
    crossings: np.ndarray


@dataclass(frozen=True, eq=False)
class Lift:
    """One mode over a curve's joints, as far as it is regular.

    Attributes:
        poses: ``(k, n_pose)``.
        joints: ``(k, n_joint)``.
        sign: Sign of det dF/dpose.
        working: The working mode.
        closed: True where the last point is followed by the first.
        residual: The largest.
        ends: What it ends on.
    """

    poses: np.ndarray
    joints: np.ndarray
    sign: int
    working: tuple[int, ...]
    closed: bool
    residual: float
    ends: tuple[str, str]


def chart_points(section: Section, joints: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Returns configurations as points of the section's chart, ``(k, m)``."""
    chart, data = section.chart, section.data
    unit = np.asarray(data.free_unit)
    unknown = [joints[:, [section.grid.free[k]]] / unit[k] for k in chart.unknown]
    return np.hstack([poses / np.asarray(data.pose_unit), *unknown])


def lifts_of(source: Source, legs: Legs | None) -> tuple[list[Lift], int]:
    """Lifts a curve into all other modes that belong to an aspect it bounds.

    Of a curve with det A = 0 these are the modes in the singular pose's working mode; of a stretched leg those in one
    of the two working modes that meet, and with the pose's sign of det A.

    Returns:
        The lifts, and how many modes over the curve's points were left out because they are in no such aspect.
    """
    points = source.points
    modes, other = _modes(source, legs, points)
    order = list(range(len(points)))
    ways = list(zip(order, order[1:] + order[:1] * source.closed, strict=False))
    links = dict(zip(ways, _links(source, modes, ways), strict=True))
    for _ in range(_ROUNDS):
        broken = _broken(source, points, modes, links)
        if not broken:
            break
        middles, kept = _between(source, points, broken)
        added, more = _modes(source, legs, middles)
        new = {way: len(points) + k for k, way in enumerate(w for w, ok in zip(broken, kept, strict=True) if ok)}
        points, modes, other = np.vstack([points, middles]), modes.joined(added), other + more
        if not new:
            break
        halves = [half for (a, b), k in new.items() for half in ((a, k), (k, b))]
        links = {way: link for way, link in links.items() if way not in new}
        links |= dict(zip(halves, _links(source, modes, halves), strict=True))
    return _gathered(source, points, modes, links), other


def _modes(source: Source, legs: Legs | None, points: np.ndarray) -> tuple[Modes, int]:
    """Returns the modes over points that belong to an aspect the curve bounds, and how many others there are."""
    joints, poses, _ = evaluated(source.section, points)
    robot = source.section.robot
    modes = modes_over(robot, legs, joints).without(poses, robot)
    own = np.ones(modes.regular.shape, bool)
    if legs is not None and len(points):
        sign, working = _signs_at(source, legs, joints, poses)
        same = modes.working == working[:, None]
        if source.leg >= 0:
            same[..., source.leg] = True
            own &= modes.sign == sign[:, None]
        own &= np.all(same, axis=-1)
    return replace(modes, regular=modes.regular & own), int(np.sum(modes.regular & ~own))


def _signs_at(source: Source, legs: Legs, joints: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    _, sign, _, working, _ = measured(source.section.robot, legs, poses, joints)
    return sign, working.astype(int)


def _links(source: Source, modes: Modes, ways: list[tuple[int, int]]) -> np.ndarray:
    numbers = np.array(ways, int).reshape(-1, 2)
    return same_working_mode(modes, numbers, linked(source.section.robot, modes, numbers))


def _steps(source: Source, points: np.ndarray, ways: list[tuple[int, int]]) -> np.ndarray:
    numbers = np.array(ways, int).reshape(-1, 2)
    return short_way(points[numbers[:, 1]] - points[numbers[:, 0]], source.section.period)


def _broken(
    source: Source, points: np.ndarray, modes: Modes, links: dict[tuple[int, int], np.ndarray]
) -> list[tuple[int, int]]:
    """Returns the ways, long enough to be halved, on which a mode begins or ends or moves far."""
    if not links:
        return []
    ways = list(links)
    size = np.max(np.abs(_steps(source, points, ways)), axis=1)
    a, b = np.array(ways).T
    link = np.array(list(links.values()))
    continues = link >= 0
    number = np.sum(modes.regular, axis=1)
    lost = np.sum(continues, axis=1) < np.maximum(number[a], number[b])
    after = np.take_along_axis(modes.poses[b], np.maximum(link, 0)[..., None], axis=1)
    gaps = glued_gap(source.section.robot, after - modes.poses[a])
    far = np.max(np.where(continues, gaps, 0.0), axis=1) > _COARSE
    wanted = (lost & (size > _NEAREST)) | (far & (size > _FINE))
    return [way for way, want in zip(ways, wanted & (size < _APART), strict=True) if want]


def _between(source: Source, points: np.ndarray, ways: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the points of the curve in the middle of ways, and for which ways there is one."""
    starts = points[[a for a, _ in ways]]
    steps = _steps(source, points, ways)
    middles = search.midpoints(source.section, np.stack([starts, starts + steps], axis=1))
    size = np.max(np.abs(steps), axis=1)
    near = np.max(np.abs(middles - starts - 0.5 * steps), axis=1) < 0.3 * size
    return middles[near], near


def _gathered(source: Source, points: np.ndarray, modes: Modes, links: dict[tuple[int, int], np.ndarray]) -> list[Lift]:
    """Gathers the linked modes into curves; a point alone is none."""
    lanes = modes.poses.shape[1]
    followers = {
        a * lanes + int(lane): b * lanes + int(link[lane])
        for (a, b), link in links.items()
        for lane in np.flatnonzero(link >= 0)
    }
    singular = evaluated(source.section, points)[1]
    inner = {a for a, _ in links}, {b for _, b in links}
    lifts = []
    for run, closed in chains(len(points) * lanes, followers):
        at, lane = np.divmod(run, lanes)
        if len(run) < 2:
            continue
        ends = (
            ("", "")
            if closed
            else tuple(
                _end(source, modes, singular, at[k], lane[k], at[k] not in inner[1 if k == 0 else 0], k)
                for k in (0, -1)
            )
        )
        lifts.append(
            Lift(
                poses=modes.poses[at, lane],
                joints=modes.joints[at],
                sign=int(modes.sign[at[0], lane[0]]),
                working=tuple(modes.working[at[0], lane[0]].tolist()),
                closed=closed,
                residual=float(np.max(modes.residual[at, lane])),
                ends=ends,  # type: ignore[arg-type]
            )
        )
    return lifts


def _end(source: Source, modes: Modes, singular: np.ndarray, at: int, lane: int, last: bool, which: int) -> str:
    """Says on what a lift ends: with the curve, in a cusp, where it folds itself, or on nothing that is known."""
    if last:
        return source.ends[which] or "end of the curve"
    robot = source.section.robot
    if glued_gap(robot, modes.poses[at, lane] - singular[at]) < _AT_CUSP:
        return "crossing" if np.any(glued_gap(robot, source.crossings - singular[at]) < 2 * _AT_CUSP) else "cusp"
    if modes.size[at, lane] < _AT_FOLD:
        return "singular curve"
    return "unknown"
