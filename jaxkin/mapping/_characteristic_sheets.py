"""Sheets: the assembly modes over the cells of a section, joined within cells and across the curves between them."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.legs import Legs
from jaxkin.mapping._characteristic_lifting import Source
from jaxkin.mapping._characteristic_roadmap import Roadmap
from jaxkin.mapping._lifts import Modes, glued_gap, linked, modes_over, same_working_mode, union
from jaxkin.mapping.loci import evaluated

#: How many ways across a curve are tried, those nearest its middle first.
_TRIES = 6


@dataclass(frozen=True, eq=False)
class Passage:
    """A mode that goes on across a curve, from a sheet to a sheet.

    Attributes:
        curve: Number of the curve.
        sheets: The sheets on both sides.
        joints: ``(n_joint,)`` a point of the curve.
        pose: ``(n_pose,)`` the mode over it.
    """

    curve: int
    sheets: tuple[int, int]
    joints: np.ndarray
    pose: np.ndarray


@dataclass(frozen=True, eq=False)
class Sheets:
    """The modes over all cells.

    Attributes:
        roadmap: Points of all cells.
        modes: The modes over them.
        cell: ``(n,)`` the cell of each point; -1 where it is in doubt.
        sheet: ``(n, lanes)`` the sheet of each mode, -1 for none.
        cell_of: ``(n_sheet,)``.
        passages: Which sheets go on across curves.
        touches: Which sheets end at a curve, as pairs (curve, sheet).
        evidence: What is in doubt, by name.
    """

    roadmap: Roadmap
    modes: Modes
    cell: np.ndarray
    sheet: np.ndarray
    cell_of: np.ndarray
    passages: tuple[Passage, ...]
    touches: frozenset[tuple[int, int]]
    evidence: dict[str, Any]

    @property
    def count(self) -> int:
        """Number of sheets."""
        return len(self.cell_of)

    def example(self, sheet: int) -> tuple[int, int]:
        """Returns point and lane of a mode on a sheet, as far from all curves as there is one."""
        point, lane = np.nonzero(self.sheet == sheet)
        best = int(np.argmax(self.roadmap.depth[point]))
        return int(point[best]), int(lane[best])


def sheets_of(robot: Mechanism, legs: Legs | None, roadmap: Roadmap, sources: list[Source], cells: Any) -> Sheets:
    """Joins the modes over the roadmap's points into sheets.

    Args:
        robot: The mechanism.
        legs: How its equations hold the joints.
        roadmap: Points between the curves.
        sources: The curves, as the roadmap numbers them.
        cells: ``(components, depth) -> (n,)`` numbers the connected components of the points as cells, -1 for none.
    """
    modes = modes_over(robot, legs, roadmap.joints)
    plain = np.flatnonzero(roadmap.crossings == 0)
    ways, links, lost = _within(robot, modes, roadmap, plain)
    cell = np.asarray(cells(union(len(modes), ways), roadmap))
    sheet, cell_of = _numbered(modes, cell, ways, links)
    passages, touches, unsettled = _across(robot, legs, roadmap, modes, sources, sheet, cell)
    evidence = {
        "points of the roadmap": len(modes),
        "of these left out as too near a curve": int(np.sum(cell < 0)),
        "ways on which a mode was lost": lost,
        "curves that no way settles": unsettled,
    }
    return Sheets(roadmap, modes, cell, sheet, cell_of, passages, touches, evidence)


def _within(robot: Mechanism, modes: Modes, roadmap: Roadmap, plain: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Returns the ways within cells on which all modes continue one to one, their links, and how many others."""
    ways = roadmap.ways[plain]
    links = linked(robot, modes, ways, roadmap.turns()[plain])
    links = same_working_mode(modes, ways, links)
    number = np.sum(modes.regular, axis=1)
    # A way that leaves the cell, where the curve's chord does not show it, loses modes at a fold.
    whole = (np.sum(links >= 0, axis=1) == number[ways[:, 0]]) & (number[ways[:, 0]] == number[ways[:, 1]])
    return ways[whole], links[whole], int(np.sum(~whole))


def _numbered(modes: Modes, cell: np.ndarray, ways: np.ndarray, links: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the sheet of every mode, and the cell of every sheet."""
    points, lanes = modes.regular.shape
    way, lane = np.nonzero(links >= 0)
    pairs = np.stack([ways[way, 0] * lanes + lane, ways[way, 1] * lanes + links[way, lane]], axis=1)
    component = union(points * lanes, pairs).reshape(points, lanes)
    there = modes.regular & (cell >= 0)[:, None]
    names, first, inverse = np.unique(component[there], return_index=True, return_inverse=True)
    sheet = np.full((points, lanes), -1)
    sheet[there] = inverse
    return sheet, np.broadcast_to(cell[:, None], there.shape)[there][first] if len(names) else np.zeros(0, int)


def _across(
    robot: Mechanism,
    legs: Legs | None,
    roadmap: Roadmap,
    modes: Modes,
    sources: list[Source],
    sheet: np.ndarray,
    cell: np.ndarray,
) -> tuple[tuple[Passage, ...], frozenset[tuple[int, int]], int]:
    """Follows the modes of both sides onto every curve, and says which go on and which end there."""
    points, poses = zip(*map(_curve_points, sources), strict=True) if sources else ((), ())
    tries = _tries(roadmap, cell, [len(p) for p in points])
    joints = np.array([points[t.curve][t.at] for t in tries]).reshape(len(tries), len(robot.joint_axes))
    singular = np.array([poses[t.curve][t.at] for t in tries]).reshape(len(tries), len(robot.pose_axes))
    over = modes_over(robot, legs, joints).without(singular, robot)
    landed = _landed(robot, roadmap, modes, over, [t.way for t in tries])
    passages, touches, settled = list[Passage](), set[tuple[int, int]](), set[int]()
    for k, (t, sides) in enumerate(zip(tries, landed, strict=True)):
        if t.run in settled or set(sides[0][sides[0] >= 0]) != set(sides[1][sides[1] >= 0]):
            continue
        settled.add(t.run)
        ends = roadmap.ways[t.way]
        for lane in sides[0][sides[0] >= 0]:
            pair = [int(sheet[end, np.flatnonzero(side == lane)[0]]) for end, side in zip(ends, sides, strict=True)]
            passages.append(Passage(t.curve, (pair[0], pair[1]), joints[k], over.poses[k, lane]))
        for end, side in zip(ends, sides, strict=True):
            touches |= {(t.curve, int(s)) for s in sheet[end, (side < 0) & modes.regular[end]]}
    return tuple(passages), frozenset(touches), _unsettled(tries, settled, cell, roadmap, len(sources))


def _unsettled(tries: "list[_Try]", settled: set[int], cell: np.ndarray, roadmap: Roadmap, curves: int) -> int:
    """Counts the curves without a way that settles them, and their longer stretches between two cells.

    Where two curves meet, one or two ways may seem to lead from cell to cell across a corner: that is no stretch.
    """
    between = {t.run: (t.curve, *sorted(cell[roadmap.ways[t.way]])) for t in tries}
    ways = Counter(t.run for t in tries)
    done = {between[run] for run in settled}
    stretches = {key for run, key in between.items() if ways[run] > 2 and key not in done}
    return curves - len({key[0] for key in done}) + len(stretches)


class _Try(NamedTuple):
    """A way across a curve: the curve, the run of it between the same two cells, a point of it, and the way."""

    curve: int
    run: int
    at: int
    way: int


def _tries(roadmap: Roadmap, cell: np.ndarray, lengths: list[int]) -> list[_Try]:
    """Chooses ways across every run of every curve between the same two cells, those nearest its middle first."""
    single = np.flatnonzero((roadmap.crossings == 1) & np.all(cell[roadmap.ways] >= 0, axis=1))
    chord = roadmap.chord[single]
    curve, first = roadmap.barriers.curve[chord], roadmap.barriers.first[chord]
    sides = np.sort(cell[roadmap.ways[single]], axis=1)
    order = np.lexsort((first + roadmap.share[single], curve))
    keys = np.column_stack([curve, sides])[order]
    starts = np.flatnonzero(np.any(keys[1:] != keys[:-1], axis=1)) + 1
    tries, runs = list[_Try](), np.split(order, starts) if len(order) else []
    for number, run in enumerate(runs):
        middle = 0.5 * (len(run) - 1)
        nearest = run[np.argsort(np.abs(np.arange(len(run)) - middle), kind="stable")][:_TRIES]
        for k in nearest:
            at = first[k] + (roadmap.share[single[k]] > 0.5)
            tries.append(_Try(int(curve[k]), number, int(at % lengths[curve[k]]), int(single[k])))
    return tries


def _curve_points(source: Source) -> tuple[np.ndarray, np.ndarray]:
    joints, poses, _ = evaluated(source.section, source.points)
    return joints, poses


def _landed(robot: Mechanism, roadmap: Roadmap, modes: Modes, over: Modes, ways: list[int]) -> np.ndarray:
    """Returns the lanes over curve points at which the modes of both ends of ways arrive, ``(k, 2, lanes)``."""
    if not ways:
        return np.zeros((0, 2, modes.regular.shape[1]), int)
    everything = modes.joined(over)
    ends = roadmap.ways[ways].reshape(-1)
    goals = len(modes) + np.repeat(np.arange(len(ways)), 2)
    steps = roadmap.plane.near(roadmap.plane.flat(everything.joints[goals]) - roadmap.points[ends])
    there = roadmap.plane.joints(roadmap.points[ends] + steps)
    pairs = np.stack([ends, goals], axis=1)
    links = linked(robot, everything, pairs, there - everything.joints[goals])
    return same_working_mode(everything, pairs, links).reshape(len(ways), 2, -1)


def sheet_at(robot: Mechanism, legs: Legs | None, sheets: Sheets, joints: np.ndarray, pose: np.ndarray) -> int:
    """Returns the sheet of a configuration, -1 where no point of the roadmap sees it along a straight way."""
    here = modes_over(robot, legs, joints)
    gaps = np.where(here.regular[0], glued_gap(robot, here.poses[0] - pose), np.inf)
    lane = int(np.argmin(gaps))
    if not gaps[lane] < 1e-6:
        return -1
    points, there = sheets.roadmap.around(joints, sheets.cell >= 0)
    if len(points) == 0:
        return -1
    everything = sheets.modes.joined(here)
    ways = np.stack([np.full(len(points), len(sheets.modes)), points], axis=1)
    links = linked(robot, everything, ways, there - everything.joints[points])
    links = same_working_mode(everything, ways, links)
    for way, link in zip(ways, links, strict=True):
        if link[lane] >= 0 and np.sum(link >= 0) == np.sum(here.regular[0]) == np.sum(sheets.modes.regular[way[1]]):
            return int(sheets.sheet[way[1], link[lane]])
    return -1
