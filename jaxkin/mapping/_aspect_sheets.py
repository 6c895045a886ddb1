"""One sheet cut into cells: proved regular, outside, or undecided; only undecided ones are halved."""

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.mapping._aspect_walls import (
    SPLIT,
    UNDECIDED,
    WallData,
    Walls,
    judged_cells,
    shared_cells,
)
from jaxkin.mapping.batch import in_blocks
from jaxkin.numerics.cells import CellTree, Components
from jaxkin.numerics.enclosure import Enclosure, UnsupportedOperation, enclosure_of, taylor_remainder

#: Cells that one compiled call takes, and one enclosure.
BLOCK, _BOXES = 8192, 4096
#: So many cells get bounds of their own for the sake of all their descendants; more only where these would need them.
_FEW = 65536
#: Cells of a level in which sub-points are compared with scattered ones.
_COMPARED = 8192
#: What of a wall's magnitude over the box counts as rounding.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Box:
    """The free pose axes, cut into cells.

    Attributes:
        low: ``(d,)`` lower corner.
        high: ``(d,)`` upper corner.
        period: ``(d,)`` period of each axis that is glued, inf for the others.
        shape: Cells of the coarsest level along each axis.
        levels: How often they are halved at most.
    """

    low: np.ndarray
    high: np.ndarray
    period: np.ndarray
    shape: tuple[int, ...]
    levels: int

    @property
    def glued(self) -> np.ndarray:
        """True for axes that span their period."""
        return np.isfinite(self.period)

    def width(self, level: int) -> np.ndarray:
        """Returns the size of a cell, ``(d,)``."""
        return (self.high - self.low) / np.array(self.shape) * 0.5**level

    def volume(self, level: int) -> float:
        """Returns the volume of a cell."""
        return float(np.prod(self.width(level)))


@dataclass(frozen=True, eq=False)
class Doubt:
    """Something that could change the count.

    Attributes:
        point: ``(d,)`` where.
        width: ``(d,)`` how small it would have to be.
        cells: Two proved cells whose components might be one; none where a whole piece might have been missed.
    """

    point: np.ndarray
    width: np.ndarray
    cells: tuple[int, ...] = ()


@dataclass(eq=False)
class Sheet:
    """A sheet cut into cells.

    Attributes:
        walls: Structure of its walls.
        data: Their numbers.
        box: The box.
        flips: ``(d,)`` which singular walls change sign over the seam of each axis, as bits.
        tree: The cells.
        components: Connected components of the proved ones.
        kinds: Of each level, what may happen in each cell: REGULAR, FLAT or SEVERAL.
        shares: Of each level, ``(n_undecided, n_code)`` shares of the undecided cells, where they were computed.
        tested: Cells judged at each level.
        undecided: Undecided cells of each level.
        shared_places: The undecided cells that ``shares`` are of, as places in their level.
        bias: By how much scattered sub-points change the volume of a level's shares.
        totals: ``(n_code,)`` volumes of all codes, proved and shared, by level as far as shares were computed.
        counts: Components, joined by lines, of the same levels.
        doubts: What could change the count.
        joined: How many lines joined components.
        walked: How many strips along inner walls joined components.
        saddles: How many critical points of a singular wall showed two components to be one, to be two with a gap
            between them, or to be two that meet where the wall crosses itself.
        links: ``(2, k)`` pairs of proved cells that lines through undecided cells join.
        ways: The points between the two cells of a link that is not straight, ``(k, d)``.
        enclosure: The smooth walls, for bounds over cells.
        scale: ``(n_smooth,)`` magnitude of each smooth wall over the box.
        tiny: ``(W,)`` what of each wall is rounding.
        remainder: ``(n, n_smooth)`` bounds of second-order remainders over the cells of the last level.
    """

    walls: Walls
    data: WallData
    box: Box
    flips: np.ndarray
    tree: CellTree
    components: Components = field(default_factory=Components)
    kinds: list[np.ndarray] = field(default_factory=list)
    shares: dict[int, np.ndarray] = field(default_factory=dict)
    tested: list[int] = field(default_factory=list)
    undecided: list[int] = field(default_factory=list)
    shared_places: dict[int, np.ndarray] = field(default_factory=dict)
    bias: dict[int, float] = field(default_factory=dict)
    totals: list[np.ndarray] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    doubts: list["Doubt"] = field(default_factory=list)
    joined: int = 0
    walked: int = 0
    saddles: dict[str, int] = field(default_factory=lambda: {"connect": 0, "separate": 0, "crossing": 0})
    links: list[np.ndarray] = field(default_factory=list)
    ways: dict[tuple[int, int], np.ndarray] = field(default_factory=dict)
    enclosure: Enclosure | None = None
    scale: np.ndarray | None = None
    tiny: np.ndarray | None = None
    remainder: np.ndarray | None = None

    def centres(self, cells: np.ndarray) -> np.ndarray:
        """Returns the centres of cells given by number, ``(k, d)``."""
        return self.box.low + (self.tree.gathered("index", cells) + 0.5) * self.widths(cells)

    def widths(self, cells: np.ndarray) -> np.ndarray:
        """Returns the sizes of cells given by number, ``(k, d)``."""
        width = np.stack([self.box.width(level) for level in range(len(self.tree.levels))])
        return width[self.tree.level_of(cells)]

    def locate(self, points: np.ndarray) -> np.ndarray:
        """Returns the leaves that hold points ``(k, d)``; -1 outside the box."""
        return self.tree.locate((np.atleast_2d(points) - self.box.low) / self.box.width(0))


def new_sheet(walls: Walls, data: WallData, box: Box, flips: np.ndarray) -> Sheet:
    """Returns a sheet of which only the coarsest cells exist, not yet judged."""
    sheet = Sheet(walls, data, box, flips, CellTree(box.shape, box.glued))
    sheet.enclosure = _enclosure(walls, data)
    index = sheet.tree.levels[0].index
    try:
        sheet.remainder, size = _remainders(sheet, 0, index)
    except UnsupportedOperation as error:
        raise InputError(
            f"jk.aspects cannot bound the walls of {data.robot} between samples: the constraints hold the operation "
            f"{error}; write them with sums, products, roots, sines and cosines."
        ) from None
    sheet.scale = size
    sheet.tiny = np.concatenate([_ROUNDING * size, np.zeros(walls.n_sampled)])
    return sheet


#: Enclosures that were read, by walls and kind of mechanism: the same for all geometries.
_READ: dict[Any, Enclosure] = {}


def _enclosure(walls: Walls, data: WallData) -> Enclosure:
    leaves, structure = jax.tree_util.tree_flatten(data)
    key = walls, structure, tuple((jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves)
    if key not in _READ:
        _READ[key] = enclosure_of(walls.smooth, data, len(walls.free))
    return _READ[key]


def _remainders(sheet: Sheet, level: int, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounds second-order remainders over cells ``(k, n_smooth)``, and the walls over all of them ``(n_smooth,)``."""
    assert sheet.enclosure is not None
    width, parts, sizes = sheet.box.width(level)[:, None], [], [np.zeros(sheet.walls.n_smooth)]
    for start in range(0, len(index), _BOXES):
        low = sheet.box.low[:, None] + index[start : start + _BOXES].T * width
        jet = sheet.enclosure(sheet.data, low, low + width)
        remainder = taylor_remainder(jet, np.broadcast_to(0.5 * width, low.shape)).astype(np.float32)
        # Where the values alone exclude zero the sign is proved whatever the derivatives: no bound remains to be met.
        margin = 0.0 if sheet.tiny is None else sheet.tiny[: sheet.walls.n_smooth, None]
        remainder[(jet.value[0] > margin) | (jet.value[1] < -margin)] = -np.inf
        parts.append(remainder.T)
        size = np.maximum(np.abs(jet.value[0]), np.abs(jet.value[1]))
        sizes.append(np.max(np.where(np.isfinite(size), size, 0.0), axis=1))
    # Rounded up: single precision is for storage only.
    return np.nextafter(np.concatenate(parts), np.float32(np.inf)), np.max(sizes, axis=0)


def judge(sheet: Sheet) -> None:
    """Judges the cells of the last level, joins them, and counts components."""
    level = len(sheet.tree.levels) - 1
    last = sheet.tree.levels[-1]
    status, loose, kinds = _judged(sheet, level, last.index, sheet.remainder)
    few = int(np.sum(loose > 0)) <= _FEW
    again = np.flatnonzero(loose > (0 if few else 1))
    if len(again) and level:
        found, _ = _remainders(sheet, level, last.index[again])
        sheet.remainder[again] = np.minimum(sheet.remainder[again], found)  # type: ignore[index]
        status[again], _, kinds[again] = _judged(sheet, level, last.index[again], sheet.remainder[again])  # type: ignore[index]
    if sheet.walls.n_sampled and level == 0:
        # Samples of cells this large say little.
        status[:] = UNDECIDED
    last.status[:] = status
    sheet.kinds.append(kinds)
    sheet.tested.append(len(status))
    sheet.undecided.append(int(np.sum(status == UNDECIDED)))
    sheet.tree.join(sheet.flips)
    sheet.components.add(sheet.tree)


def _judged(sheet: Sheet, level: int, index: np.ndarray, remainder: np.ndarray | None) -> tuple[np.ndarray, ...]:
    assert remainder is not None
    low, width = jnp.asarray(sheet.box.low), jnp.asarray(sheet.box.width(level))
    kernel = partial(judged_cells, sheet.walls, sheet.data, low, width, jnp.asarray(sheet.tiny))
    status, loose, kinds = in_blocks(kernel, index, remainder, block=BLOCK)
    return np.array(status), loose, np.array(kinds)


def halve(sheet: Sheet, which: np.ndarray) -> None:
    """Halves cells of the last level, ``(k,)`` places in it."""
    sheet.tree.split(which, SPLIT)
    assert sheet.remainder is not None
    sheet.remainder = np.repeat(sheet.remainder[which] * np.float32(0.25), 1 << sheet.tree.dimension, axis=0)


def share(sheet: Sheet, level: int) -> None:
    """Shares out the undecided cells of a level among the codes: exactly in the plane, else by linear forms."""
    cells = sheet.tree.levels[level]
    places = np.flatnonzero(cells.status == UNDECIDED)
    low, width = jnp.asarray(sheet.box.low), jnp.asarray(sheet.box.width(level))
    kernel = partial(shared_cells, sheet.walls, sheet.data, low, width)
    exact = partial(kernel, exact=True)
    index = cells.index[places]
    if len(sheet.box.low) < 3:
        shares = in_blocks(exact, index, block=BLOCK)
    else:
        shares = np.array(in_blocks(partial(kernel, exact=False), index, block=BLOCK))
        undefined = np.flatnonzero(np.isnan(shares[:, 0]))
        if len(undefined):
            shares[undefined] = in_blocks(exact, index[undefined], block=BLOCK)
    sheet.shares[level] = shares
    sheet.shared_places[level] = places
    stride = -(-max(len(index), 1) // _COMPARED)
    again = in_blocks(partial(exact, scatter=True), index[::stride], block=BLOCK)
    moved = np.nansum(again - shares[::stride], axis=0)
    sheet.bias[level] = stride * sheet.box.volume(level) * float(np.max(np.abs(moved), initial=0.0))


def total_volumes(sheet: Sheet) -> np.ndarray:
    """Returns the volume of every code, proved cells and shares of undecided ones of the last level, ``(n_code,)``."""
    level = len(sheet.tree.levels) - 1
    total = sheet.shares[level].sum(axis=0) * sheet.box.volume(level)
    for number, cells in enumerate(sheet.tree.levels):
        proved = cells.status[cells.status >= 0]
        total = total + np.bincount(proved, minlength=len(total)) * sheet.box.volume(number)
    return total
