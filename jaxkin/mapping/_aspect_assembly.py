"""From cells to aspects: numbers of components, their volumes, signs and deepest poses."""

from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.legs import Legs
from jaxkin.mapping._aspect_joins import Owners, codes_at, shares_of
from jaxkin.mapping._aspect_sheets import Sheet
from jaxkin.mapping._aspect_walls import OUTSIDE, UNDECIDED, measured_points
from jaxkin.mapping.batch import BLOCK, in_blocks

#: Cells of an aspect among which its deepest pose is sought, how many of them are searched around, in how many steps,
#: and how fine at last, in cells of the coarsest level.
_CANDIDATES, _STARTS, _STEPS, _FINEST = 512, 8, 60, 1e-7
#: Error of a cell's shares by sub-points, at least, of what is shared.
_COARSE = 5e-3


@dataclass(frozen=True, eq=False)
class Piece:
    """One component of one sheet.

    Attributes:
        sheet: Number of the sheet.
        component: Its number in the sheet.
        sign: Sign of det A.
        volume: Proved cells and shares of undecided ones.
        proved: Proved cells alone.
        shared: The difference.
        cells: Number of proved cells.
        point: ``(d,)`` deepest point found.
        pose: ``(n_pose,)``.
        joints: ``(n_joint,)``.
        clearance: There.
        touches_edge: True at an open end of the box.
    """

    sheet: int
    component: int
    sign: int
    volume: float
    proved: float
    shared: float
    cells: int
    point: np.ndarray
    pose: np.ndarray
    joints: np.ndarray
    clearance: float
    touches_edge: bool


@dataclass(frozen=True, eq=False)
class Charted:
    """The cells of all sheets with the aspects they belong to.

    Attributes:
        robot: The mechanism.
        legs: Its legs.
        modes: Working mode of each sheet.
        free: Places of the free pose axes.
        fixed: ``(n_pose,)`` values of the fixed ones.
        sheets: The cells.
        owners: Of each sheet, whose the undecided leaves are.
        numbers: Of each sheet, the aspect of each component.
        graphs: Adjacency of each sheet's cells, made when a path is asked for.
    """

    robot: Mechanism
    legs: Legs
    modes: tuple[tuple[int, ...], ...]
    free: tuple[int, ...]
    fixed: np.ndarray
    sheets: tuple[Sheet, ...]
    owners: tuple[Owners, ...]
    numbers: tuple[np.ndarray, ...]
    graphs: dict[int, Any] = field(default_factory=dict)

    def aspect_of_component(self, sheet: int, component: np.ndarray) -> np.ndarray:
        """Returns aspects of components, -1 for -1."""
        return np.append(self.numbers[sheet], -1)[component]

    def cut(self, places: dict[int, float], keep: list[int]) -> tuple[np.ndarray, ...]:
        """Returns low and high corners, aspects and sheets of the leaves that a plane cuts."""
        found = []
        for number, sheet in enumerate(self.sheets):
            for level, cells in enumerate(sheet.tree.levels):
                width = sheet.box.width(level)
                leaf = (cells.child < 0) & (cells.status != OUTSIDE)
                for axis, value in places.items():
                    turned = value
                    if sheet.box.glued[axis]:
                        turned = sheet.box.low[axis] + (value - sheet.box.low[axis]) % sheet.box.period[axis]
                    row = np.floor((turned - sheet.box.low[axis]) / width[axis])
                    last = sheet.tree.cells_along(level)[axis] - 1
                    leaf &= cells.index[:, axis] == (last if turned == sheet.box.high[axis] else row)
                which = np.flatnonzero(leaf)
                low = sheet.box.low + cells.index[which] * width
                aspect = self.aspect_of_component(number, sheet.components.level(level)[which])
                found.append((low[:, keep], (low + width)[:, keep], aspect, np.full(len(which), number)))
        return tuple(np.concatenate(part) for part in zip(*found, strict=True))


def located_aspects(charted: Charted, sheet: int, points: np.ndarray) -> np.ndarray:
    """Returns the aspects of points ``(k, d)`` of a sheet, -1 where there is none or it is undecided."""
    if sheet < 0:
        return np.full(len(points), -1)
    anchor = anchors(charted.sheets[sheet], charted.owners[sheet], points)
    return charted.aspect_of_component(sheet, charted.sheets[sheet].components.of(charted.sheets[sheet].tree, anchor))


def anchors(sheet: Sheet, owners: Owners, points: np.ndarray) -> np.ndarray:
    """Returns a proved cell for each point: its own, or the owner of its part of an undecided cell; -1 for none."""
    cells = sheet.locate(points)
    status = np.where(cells >= 0, sheet.tree.gathered("status", np.maximum(cells, 0)), OUTSIDE)
    anchor = np.where(status >= 0, cells, -1)
    unsure = np.flatnonzero(status == UNDECIDED)
    if len(unsure) == 0:
        return anchor
    # The code belongs to the chart in which the cell lies.
    inside = points[unsure]
    period = np.where(sheet.box.glued, sheet.box.period, 1.0)
    inside = np.where(sheet.box.glued, sheet.box.low + (inside - sheet.box.low) % period, inside)
    codes = codes_at(sheet, inside)
    use = codes != OUTSIDE
    anchor[unsure[use]] = owners.anchor[owners.rows(cells[unsure[use]]), codes[use]]
    return anchor


def volumes(sheet: Sheet, owners: Owners) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, float]:
    """Returns of each component proved volume, shares of undecided cells and cells; then what no component owns.

    Returns:
        ``(n,)`` each; the volume of shares without an owner, and an estimate of the error of all shares together.
    """
    n = sheet.components.count
    proved, shared, cells, orphan = np.zeros(n), np.zeros(n), np.zeros(n, int), 0.0
    for level, own in enumerate(sheet.tree.levels):
        component = sheet.components.level(level)
        counted = np.bincount(component[own.status >= 0], minlength=n)
        cells += counted
        proved += counted * sheet.box.volume(level)
    component = sheet.components.of(sheet.tree, owners.anchor)
    cell = np.prod(sheet.widths(owners.cells), axis=1)
    volume = shares_of(sheet, owners.cells) * cell[:, None]
    shared += np.bincount(np.maximum(component, 0).ravel(), np.where(component >= 0, volume, 0).ravel(), n)[:n]
    orphan += float(np.sum(volume[component < 0]))
    bias = next(reversed(sheet.bias.values()), 0.0)
    errors = (_share_error(sheet), _COARSE * float(np.sum(shared)), 2 * bias)
    return proved, shared, cells, orphan, max(errors) + orphan


def _share_error(sheet: Sheet) -> float:
    """Returns how far the whole volume moved with the last full level, code by code."""
    if len(sheet.totals) < 2:
        return 0.0
    return float(np.sum(np.abs(sheet.totals[-1] - sheet.totals[-2])))


def pieces(
    number: int, sheet: Sheet, owners: Owners, open_ends: np.ndarray, sampled: tuple[np.ndarray, ...]
) -> list[Piece]:
    """Returns the components of a sheet with their numbers."""
    proved, shared, cells = sampled
    edge = _touching(sheet, open_ends)
    found = []
    for component in range(sheet.components.count):
        point = _deepest(sheet, owners, component)
        pose, joints, clearance, determinant, _ = (part[0] for part in _measured(sheet, point[None]))
        found.append(
            Piece(
                sheet=number,
                component=component,
                sign=int(np.sign(determinant)),
                volume=float(proved[component] + shared[component]),
                proved=float(proved[component]),
                shared=float(shared[component]),
                cells=int(cells[component]),
                point=point,
                pose=pose,
                joints=joints,
                clearance=float(clearance),
                touches_edge=bool(edge[component]),
            )
        )
    return found


def _touching(sheet: Sheet, open_ends: np.ndarray) -> np.ndarray:
    touching = np.zeros(sheet.components.count, bool)
    for level, cells in enumerate(sheet.tree.levels):
        ends = np.stack([cells.index == 0, cells.index == sheet.tree.cells_along(level) - 1], axis=-1)
        here = np.any(ends & open_ends, axis=(1, 2)) & (cells.status >= 0)
        touching[sheet.components.level(level)[here]] = True
    return touching


def _measured(sheet: Sheet, points: np.ndarray) -> tuple[np.ndarray, ...]:
    return in_blocks(partial(measured_points, sheet.walls, sheet.data), points, block=BLOCK)


def _deepest(sheet: Sheet, owners: Owners, component: int) -> np.ndarray:
    """Returns the point of a component with the largest depth: the best of many cells, then searches from there."""
    chosen: list[np.ndarray] = []
    for level, cells in enumerate(sheet.tree.levels):
        places = np.flatnonzero((sheet.components.level(level) == component) & (cells.status >= 0))
        room = _CANDIDATES - sum(map(len, chosen))
        some = (
            places[np.unique(np.linspace(0, len(places) - 1, room).astype(int))] if len(places) and room else places[:0]
        )
        chosen.append(some + cells.offset)
    candidates = np.concatenate(chosen)
    points = sheet.centres(candidates)
    value = _depth(sheet, points)
    starts = _apart(points / sheet.box.width(0), value)
    points, value = points[starts], value[starts]
    step = sheet.widths(candidates[starts])
    directions = np.array([move for move in product((-1.0, 0.0, 1.0), repeat=points.shape[1]) if any(move)])
    rows = np.arange(len(points))
    for _ in range(_STEPS):
        around = points[:, None] + directions * step[:, None]
        flat = around.reshape(-1, points.shape[1])
        inside = sheet.components.of(sheet.tree, anchors(sheet, owners, flat)) == component
        found = np.where(inside, _depth(sheet, flat), -1.0).reshape(len(points), -1)
        best = np.argmax(found, axis=1)
        better = found[rows, best] > value
        points = np.where(better[:, None], around[rows, best], points)
        value = np.where(better, found[rows, best], value)
        step = np.where(better[:, None], step, 0.5 * step)
        if np.all(step < _FINEST * sheet.box.width(0)):
            break
    return points[int(np.argmax(value))]


def _depth(sheet: Sheet, points: np.ndarray) -> np.ndarray:
    return np.nan_to_num(_measured(sheet, points)[4], nan=-1.0, posinf=-1.0)


def _apart(points: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Returns the points of largest values that are half a cell of the coarsest level apart, given in such cells."""
    found: list[int] = []
    for k in np.argsort(-value, kind="stable"):
        if len(found) == _STARTS:
            break
        if not found or np.min(np.max(np.abs(points[found] - points[k]), axis=1)) > 0.5:
            found.append(int(k))
    return np.array(found)
