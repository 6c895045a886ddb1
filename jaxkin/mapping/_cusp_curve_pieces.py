"""Monotone pieces of the cusp curves for each free joint, what happens at their ends, and which share their image."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jaxkin.mapping import _cusp_curve_equations as equations
from jaxkin.mapping._cusp_curve_cuts import Cut
from jaxkin.mapping._cusp_curve_equations import Sheet
from jaxkin.mapping._transitions import Event, Pieces, Transitions, transitions_of
from jaxkin.mapping.batch import over_points
from jaxkin.mapping.chart import SQUARE
from jaxkin.mapping.loci import evaluated
from jaxkin.mapping.section import Section
from jaxkin.numerics import newton
from jaxkin.numerics.gluing import short_way

#: Restarts from which errors are estimated, and how far they are moved.
_RESTARTS, _MOVED = 6, 1e-7
#: Joint points of images that might be one are this near, in widths of the box, before they are compared exactly.
_NEAR = 0.05
#: Relative distance between ends, and between points within, of pieces that have one image.
_END, _ONE_IMAGE = 1e-9, 1e-11
#: An end of a curve so near the end of the joint's range, in widths, is at it: a leg of zero length is a square root.
_AT_END = 1e-10
_ULP = float(np.finfo(float).eps)


class Drawn(NamedTuple):
    """A cusp curve with its joints and poses.

    Attributes:
        sheet: The sheet of the singular set on which it lies.
        cut: Its points in the chart.
        joints: ``(k, n_joint)``.
        poses: ``(k, n_pose)``.
    """

    sheet: Sheet
    cut: Cut
    joints: np.ndarray
    poses: np.ndarray


class _Piece(NamedTuple):
    """A monotone piece of a curve: its rows, the joint's values there, what happens at both ends, and its range."""

    curve: int
    rows: np.ndarray
    values: np.ndarray
    events: tuple[int, int]
    range: tuple[float, float]

    @property
    def rises(self) -> bool:
        return self.values[-1] >= self.values[0]


def all_transitions(curves: list[Drawn]) -> dict[str, tuple[Pieces, Transitions]]:
    """Returns pieces and transitions for each free joint, by name; empty without curves."""
    if not curves:
        return {}
    section = curves[0].sheet.section
    return {
        section.robot.joint_axes[joint].name: _of_axis(curves, axis, joint)
        for axis, joint in enumerate(section.grid.free)
    }


def _of_axis(curves: list[Drawn], axis: int, joint: int) -> tuple[Pieces, Transitions]:
    section = curves[0].sheet.section
    name = section.robot.joint_axes[joint].name
    ends = float(section.data.low[axis]), float(section.data.high[axis])
    events, pieces, bad = [], [], 0
    for number, curve in enumerate(curves):
        own, found, wrong = _pieces(curve, number, axis, joint, ends, len(events))
        events += own
        pieces += found
        bad += wrong
    table = Pieces(
        low=np.array([min(p.range) for p in pieces]),
        high=np.array([max(p.range) for p in pieces]),
        events=np.array([p.events if p.rises else p.events[::-1] for p in pieces], int).reshape(-1, 2),
        image=_images(curves, pieces, axis, joint),
    )
    doubts = [f"{bad} pieces of cusp curves are not monotone: a critical point was missed"] if bad else []
    lost = sum(end.startswith("lost") for curve in curves for end in curve.cut.ends)
    if lost:
        doubts.append(f"{lost} ends of cusp curves are where the tracer was lost")
    groups = _groups(section, events, table)
    return table, transitions_of(name, ends, table, events, groups, _joint_names(curves), tuple(doubts))


def _joint_names(curves: list[Drawn]) -> tuple[str, ...]:
    return tuple(axis.name for axis in curves[0].sheet.section.robot.joint_axes)


def _pieces(
    curve: Drawn, number: int, axis: int, joint: int, ends: tuple[float, float], first: int
) -> tuple[list[Event], list[_Piece], int]:
    """Returns events and monotone pieces of one curve, and how many of these are not monotone."""
    cut, n = curve.cut, len(curve.joints)
    nodes = [int(k) for k in np.flatnonzero(cut.critical[:, axis])]
    critical = set(nodes)
    if not cut.closed:
        nodes = sorted({0, n - 1} | critical)
    if len(nodes) < 2:
        return [], [], 1
    kinds, errors = _kinds(curve, axis, nodes), _errors(curve, axis, joint, nodes)
    events, at = [], {}
    for place, k in enumerate(nodes):
        value = float(curve.joints[k, joint])
        own_end = min(abs(value - end) for end in ends) <= _AT_END * (ends[1] - ends[0])
        if k not in critical and own_end:
            at[k] = -1  # The end of the range of this joint: no section lies beyond.
            continue
        at[k] = first + len(events)
        kind = kinds[place] if k in critical else "end"
        events.append(Event(value, float(errors[place]), kind, curve.joints[k], curve.poses[k]))
    runs = [(np.arange(a, b + 1), (at[a], at[b])) for a, b in pairwise(nodes)]
    if cut.closed:
        around = np.concatenate([np.arange(nodes[-1], n), np.arange(nodes[0] + 1)])
        runs.append((around, (at[nodes[-1]], at[nodes[0]])))
    period = float(curve.sheet.section.joint_period[joint])
    pieces = [
        p for rows, meets in runs for p in _in_one_turn(number, curve.joints[:, joint], rows, meets, ends, period)
    ]
    slack = 64 * _ULP * (1 + np.max(np.abs(curve.joints[:, joint])))
    return events, pieces, sum(not _monotone(piece.values, slack) for piece in pieces)


def _in_one_turn(
    number: int, joint: np.ndarray, rows: np.ndarray, meets: tuple[int, int], ends: tuple[float, float], period: float
) -> list[_Piece]:
    """Returns a monotone piece, cut where a glued joint jumps from one end of its range to the other."""
    values = joint[rows]
    if not np.isfinite(period):
        return [_Piece(number, rows, values, meets, (float(values[0]), float(values[-1])))]
    jumps = np.flatnonzero(np.abs(np.diff(values)) > 0.5 * period)
    pieces = []
    for part in np.split(np.arange(len(rows)), jumps + 1):
        first, last = part[0] == 0, part[-1] == len(rows) - 1
        rises = values[-1] + period * np.sum(np.sign(-np.diff(values)[jumps])) > values[0]
        start = float(values[part[0]]) if first else ends[0 if rises else 1]
        stop = float(values[part[-1]]) if last else ends[1 if rises else 0]
        own = np.array([start, stop]) if len(part) == 1 else values[part]
        taken = rows[part] if len(part) > 1 else np.repeat(rows[part], 2)
        pieces.append(_Piece(number, taken, own, (meets[0] if first else -1, meets[1] if last else -1), (start, stop)))
    return pieces


def _monotone(values: np.ndarray, slack: float) -> bool:
    steps = np.diff(values) * np.sign(values[-1] - values[0])
    return bool(np.all(steps > -slack))


def _kinds(curve: Drawn, axis: int, nodes: list[int]) -> list[str]:
    """Names critical points: swallowtails are critical for every joint."""
    sheet, cut = curve.sheet, curve.cut
    picks = np.tile(np.eye(3)[axis], (len(nodes), 1))
    bend = over_points(equations.measure, sheet.chart, sheet.data, cut.points[nodes], cut.tangents[nodes], picks)[1]
    names = []
    for k, b in zip(nodes, bend, strict=True):
        names.append("swallowtail" if cut.critical[k].all() else "lips" if b > 0 else "beaks")
    return names


def _errors(curve: Drawn, axis: int, joint: int, nodes: list[int]) -> np.ndarray:
    """Returns how far apart in the joint Newton's method ends when it starts anew around each node."""
    sheet, cut, m = curve.sheet, curve.cut, curve.sheet.chart.dimension
    shifts = (newton.lattice(_RESTARTS, m) - 0.5) * _MOVED
    u = (cut.points[nodes][:, None] + shifts[None]).reshape(-1, m)
    t = np.repeat(cut.tangents[nodes], _RESTARTS, axis=0)
    picks = np.tile(np.eye(3)[axis], (len(u), 1))
    again = over_points(equations.polish_critical, sheet.chart, sheet.data, u, t, picks)[0]
    values = evaluated(sheet.section, again)[0][:, joint].reshape(len(nodes), _RESTARTS)
    spread = np.max(np.abs(values - curve.joints[nodes, joint][:, None]), axis=1)
    rounding = 4 * _ULP * np.max(np.abs(curve.joints[nodes]), axis=1)
    # Ends are polished as what they are, points on a border or a crossing.
    return np.where(cut.critical[nodes, axis], spread, 0.0) + rounding


def _groups(section: Section, events: list[Event], table: Pieces) -> np.ndarray:
    """Numbers the distinct joint points of events.

    Only events of one kind at one joint point, to rounding, are one (a symmetry gives a point several poses). A piece
    may be as short as it likes: its own two ends are never one.
    """
    groups = np.arange(len(events))
    joined = {tuple(sorted(pair)) for pair in table.events.tolist()}
    for k, event in enumerate(events):
        for j in range(k):
            gap = np.abs(short_way(event.joints - events[j].joints, section.joint_period))
            alike = np.all(gap < _ONE_IMAGE * (1 + np.abs(event.joints)))
            if alike and event.kind == events[j].kind and (j, k) not in joined:
                groups[k] = groups[j]
                break
    return groups


def _images(curves: list[Drawn], pieces: list[_Piece], axis: int, joint: int) -> np.ndarray:
    """Numbers the images of pieces: pairs are compared at three values of the joint that both reach."""
    image = np.arange(len(pieces))
    jobs = []
    for a in range(len(pieces)):
        for b in range(a):
            if _same_ends(curves, pieces[a], pieces[b]):
                low, high = sorted(pieces[a].range)
                at = low + (high - low) * np.array([0.25, 0.5, 0.75])
                if _alike(curves, pieces[a], pieces[b], at):
                    jobs.append((a, b, at))
    for (a, b, _), gap in zip(jobs, _gaps(curves, pieces, axis, jobs), strict=True):
        if np.all(gap < _ONE_IMAGE):
            image[image == image[a]] = image[b]
    return image


def _same_ends(curves: list[Drawn], one: _Piece, two: _Piece) -> bool:
    """True where two pieces end at the same joint points.

    Images that are one are so as a whole; two branches beside a swallowtail are near each other, but end apart.
    """
    if max(abs(a - b) for a, b in zip(sorted(one.range), sorted(two.range), strict=True)) > _END * (
        1 + abs(one.range[0])
    ):
        return False
    ends = [curves[p.curve].joints[p.rows[[0, -1] if p.rises else [-1, 0]]] for p in (one, two)]
    return bool(np.max(np.abs(ends[0] - ends[1]) / (1 + np.abs(ends[0]))) < _END)


def _interpolated(rows: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    order = slice(None) if values[-1] >= values[0] else slice(None, None, -1)
    return np.stack([np.interp(at, values[order], column[order]) for column in rows.T], axis=1)


def _alike(curves: list[Drawn], one: _Piece, two: _Piece, at: np.ndarray) -> bool:
    """True where two pieces may have the same image, by straight lines between their points."""
    section = curves[0].sheet.section
    width = np.ones(len(section.robot.joint_axes))
    width[list(section.grid.free)] = np.asarray(section.data.high) - np.asarray(section.data.low)
    a, b = (_interpolated(curves[p.curve].joints[p.rows], p.values, at) for p in (one, two))
    return bool(np.max(np.abs(a - b) / width) < _NEAR)


def _gaps(curves: list[Drawn], pieces: list[_Piece], axis: int, jobs: list[tuple[int, int, np.ndarray]]) -> np.ndarray:
    """Returns how far the images of pairs of pieces are apart at three values each, ``(jobs, 3)``, relative."""
    if not jobs:
        return np.zeros((0, 3))
    joints = [_on_pieces(curves, pieces, axis, [(pair[side], at) for *pair, at in jobs]) for side in (0, 1)]
    size = 1 + np.abs(joints[0])
    return np.max(np.abs(joints[0] - joints[1]) / size, axis=2)


def _on_pieces(curves: list[Drawn], pieces: list[_Piece], axis: int, jobs: list[tuple[int, np.ndarray]]) -> np.ndarray:
    """Returns the joints of pieces where the joint has given values, ``(jobs, 3, n_joint)``, solved for."""
    result = np.full((len(jobs), 3, curves[0].joints.shape[1]), np.nan)
    for sheet in {id(c.sheet): c.sheet for c in curves}.values():
        mine = [k for k, (piece, _) in enumerate(jobs) if curves[pieces[piece].curve].sheet is sheet]
        if not mine:
            continue
        section, guesses, values = sheet.section, [], []
        joint = section.grid.free[axis]
        unit = float(section.data.free_unit[axis])
        for k in mine:
            piece, at = pieces[jobs[k][0]], jobs[k][1]
            curve = curves[piece.curve]
            points = _unrolled(section, curve.cut.points[piece.rows])
            guesses.append(_interpolated(points, piece.values, at))
            values.append((at / unit) ** 2 if sheet.chart.kinds[axis] == SQUARE else at / unit)
        u = np.concatenate(guesses)
        picks = np.tile(np.eye(3)[axis], (len(u), 1))
        goals = np.concatenate(values)
        here = over_points(equations.joint_values, sheet.chart, sheet.data, u)[:, axis]
        goals = here + short_way(goals - here, np.array(float(section.joint_period[joint]) / unit))
        u, _ = over_points(equations.at_value, sheet.chart, sheet.data, u, picks, goals)
        result[mine] = evaluated(section, u)[0].reshape(len(mine), 3, -1)
    return result


def _unrolled(section: Section, points: np.ndarray) -> np.ndarray:
    """Returns points of a piece without jumps by whole turns (a closed curve begins anew in the middle of one)."""
    period = section.period
    turn = np.where(np.isfinite(period), period, 1.0)
    jumps = np.where(np.isfinite(period), turn * np.round(np.diff(points, axis=0) / turn), 0.0)
    return points - np.vstack([np.zeros((1, points.shape[1])), np.cumsum(jumps, axis=0)])
