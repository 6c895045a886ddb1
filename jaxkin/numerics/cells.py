"""An adaptive complex of box cells with glued axes: a tree of levels, neighbours by pointers, components by edges.

Cells are halved along every axis at once. A cell knows its face neighbours of its own size, or the larger leaf in their
place; smaller ones know it. Nothing is sorted or searched: a child's neighbours are its siblings and the children of
its parent's neighbours, so that cost grows with the number of cells alone, and cells are made only where needed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


@dataclass(eq=False)
class Level:
    """The cells of one size.

    Attributes:
        offset: Number of the first cell among all cells.
        index: ``(n, d)`` integer places.
        neighbours: ``(2 d, n)`` number of the cell behind each face, of this size or larger, -1 where the box ends:
            axis by axis, lower face first. Of the last levels only.
        status: ``(n,)`` int8, -2 where nothing is known yet.
        child: ``(n,)`` number of the first child, -1 where there is none.
        edges: ``(2, k)`` pairs of joined cells, the first of this level, the other of this level or a coarser one.
    """

    offset: int
    index: np.ndarray
    neighbours: np.ndarray
    status: np.ndarray
    child: np.ndarray
    edges: np.ndarray


class CellTree:
    """Cells by levels, the coarsest a full lattice.

    Attributes:
        shape: Cells of the coarsest level along each axis.
        glued: ``(d,)`` True where the last cell of an axis is followed by the first.
        levels: The levels so far.
    """

    def __init__(self, shape: tuple[int, ...], glued: np.ndarray):
        self.shape, self.glued = tuple(shape), np.asarray(glued, bool)
        d = len(shape)
        places = np.indices(shape).reshape(d, -1)
        count = places.shape[1]
        neighbours = np.full((2 * d, count), -1, np.int32)
        for axis in range(d):
            for side, step in ((0, -1), (1, 1)):
                moved = places.copy()
                moved[axis] += step
                here = (moved[axis] >= 0) & (moved[axis] < shape[axis]) | self.glued[axis]
                moved[axis] %= shape[axis]
                neighbours[2 * axis + side, here] = np.ravel_multi_index(tuple(moved[:, here]), shape)
        self.levels = [_level(0, places.T.astype(np.int32), neighbours)]

    @property
    def dimension(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of all cells, leaves or not."""
        last = self.levels[-1]
        return last.offset + len(last.index)

    def cells_along(self, level: int) -> np.ndarray:
        """Returns how many cells of a level fit along each axis."""
        return np.array(self.shape, dtype=np.int64) << level

    def level_of(self, cells: np.ndarray) -> np.ndarray:
        """Returns the level of cells given by number."""
        return np.searchsorted([level.offset for level in self.levels], cells, side="right") - 1

    def gathered(self, name: str, cells: np.ndarray) -> np.ndarray:
        """Returns an attribute (``status``, ``child`` or ``index``) of cells given by number."""
        cells = np.asarray(cells)
        first = getattr(self.levels[0], name)
        if first.ndim == 1 and 8 * cells.size > self.size:
            return np.concatenate([getattr(level, name) for level in self.levels])[cells]
        result = np.empty((*cells.shape, *first.shape[1:]), first.dtype)
        of = self.level_of(cells)
        for number in np.flatnonzero(np.bincount(of.ravel())):
            level, here = self.levels[number], of == number
            result[here] = getattr(level, name)[cells[here] - level.offset]
        return result

    def split(self, which: np.ndarray, mark: int) -> None:
        """Halves cells of the last level, ``(k,)`` places in it, and marks them."""
        last, d = self.levels[-1], self.dimension
        offset, children = self.size, 1 << d
        last.status[which] = mark
        last.child[which] = offset + children * np.arange(len(which), dtype=np.int32)
        bits = (np.arange(children)[:, None] >> np.arange(d)) & 1
        index = (2 * last.index[which][:, None] + bits).reshape(-1, d).astype(np.int32)
        neighbours = np.empty((2 * d, len(which), children), np.int32)
        own = last.child[which]
        for axis in range(d):
            mirrored = np.arange(children, dtype=np.int32) ^ (1 << axis)
            for side in (0, 1):
                behind = last.neighbours[2 * axis + side, which]
                finer = behind >= last.offset
                child = np.where(finer, last.child[np.where(finer, behind - last.offset, 0)], -1)
                inner = bits[:, axis] != side
                target = neighbours[2 * axis + side]
                target[:, inner] = own[:, None] + mirrored[inner]
                target[:, ~inner] = np.where(child >= 0, child, behind)[:, None] + np.where(
                    child[:, None] >= 0, mirrored[~inner], 0
                )
        self.levels.append(_level(offset, index, neighbours.reshape(2 * d, -1)))

    def wraps(self, number: int, face: int, places: np.ndarray) -> np.ndarray:
        """True where what is behind a face lies over a seam, for places in a level."""
        axis, side = divmod(face, 2)
        if not self.glued[axis]:
            return np.zeros(len(places), bool)
        end = self.cells_along(number)[axis] - 1 if side else 0
        return self.levels[number].index[places, axis] == end

    def join(self, flips: np.ndarray) -> None:
        """Finds the edges of the last level: cells with equal labels on both sides of a face.

        Args:
            flips: ``(d,)`` bits by which labels differ over the seam of each axis.
        """
        number, last = len(self.levels) - 1, self.levels[-1]
        proved = np.flatnonzero(last.status >= 0)
        found = []
        for face in range(2 * self.dimension):
            behind = last.neighbours[face, proved]
            # A pair of equal cells is met from both sides, and is kept once.
            use = (behind >= 0) & ((behind < last.offset) | (face % 2 == 1))
            places, behind = proved[use], behind[use]
            label = last.status[places]
            if flips[face // 2]:
                label = np.where(self.wraps(number, face, places), label ^ np.int8(flips[face // 2]), label)
            equal = self.gathered("status", behind) == label
            found.append(np.stack([places[equal] + last.offset, behind[equal]]).astype(np.int32))
        last.edges = np.concatenate(found, axis=1)

    def locate(self, places: np.ndarray) -> np.ndarray:
        """Returns the leaves that hold points, ``(k, d)`` in cells of the coarsest level; -1 outside the box."""
        places = np.asarray(places, float)
        shape = np.array(self.shape)
        places = np.where(self.glued, places % shape, places)
        # A point on the upper end of the box belongs to its last cell.
        places = np.where(~self.glued & (places == shape), np.nextafter(shape, 0), places)
        inside = np.all((places >= 0) & (places < shape), axis=1)
        cells = np.full(len(places), -1, np.int64)
        coarse = np.floor(places[inside]).astype(np.int64)
        cells[inside] = np.ravel_multi_index(tuple(coarse.T), self.shape)
        for number, level in enumerate(self.levels[:-1]):
            here = np.flatnonzero(cells >= level.offset)
            child = level.child[cells[here] - level.offset]
            here, child = here[child >= 0], child[child >= 0]
            bits = np.floor(places[here] * (2 << number)).astype(np.int64) & 1
            cells[here] = child + np.sum(bits << np.arange(self.dimension), axis=1)
        return cells


def _level(offset: int, index: np.ndarray, neighbours: np.ndarray) -> Level:
    n = len(index)
    none = np.zeros((2, 0), np.int32)
    return Level(offset, index, neighbours, np.full(n, -2, np.int8), np.full(n, -1, np.int32), none)


class Components:
    """Connected components of joined cells, kept up level by level.

    Attributes:
        count: How many there are.
        counts: How many there were after each level.
    """

    def __init__(self) -> None:
        self.count = 0
        self.counts: list[int] = []
        self._of_level: list[np.ndarray | None] = []
        self._merges: list[np.ndarray] = []

    def add(self, tree: CellTree) -> None:
        """Takes in the edges of the last level of a tree."""
        last = tree.levels[-1]
        proved = np.flatnonzero(last.status >= 0)
        node = np.full(len(last.index), -1, np.int64)
        node[proved] = self.count + np.arange(len(proved))
        first, second = last.edges.astype(np.int64)
        coarser = second < last.offset
        ends = np.where(coarser, 0, node[np.where(coarser, 0, second - last.offset)])
        if coarser.any():
            ends[coarser] = self.of(tree, second[coarser])
        merged = self._connected(self.count + len(proved), node[first - last.offset], ends)
        own = np.full(len(last.index), -1, np.int32)
        own[proved] = merged[self.count :]
        # Labels of coarser levels are led through the merge; those of this level are new already.
        self._merges.append(merged[: self.count])
        self._of_level.append(own)
        self.count = int(merged.max()) + 1 if len(merged) else 0
        self.counts.append(self.count)

    def unite(self, first: np.ndarray, second: np.ndarray) -> None:
        """Joins pairs of components."""
        merged = self._connected(self.count, np.asarray(first, np.int64), np.asarray(second, np.int64))
        self._merges.append(merged)
        self._of_level.append(None)
        self.count = int(merged.max()) + 1 if len(merged) else 0

    def of(self, tree: CellTree, cells: np.ndarray) -> np.ndarray:
        """Returns the component of cells given by number; -1 for cells that are in none."""
        cells = np.asarray(cells)
        if 8 * cells.size > tree.size:
            # The last entry stands for -1.
            known = [self.level(number) for number in range(sum(own is not None for own in self._of_level))]
            return np.concatenate([*known, np.full(tree.size + 1 - sum(map(len, known)), -1, np.int32)])[cells]
        result = np.full(cells.shape, -1, np.int64)
        of = np.where(cells >= 0, tree.level_of(cells), -1)
        later = self._later()
        for number in range(len(tree.levels)):
            here = of == number
            if here.any():
                place, own = self._place(number)
                result[here] = np.append(later[place], -1)[own[cells[here] - tree.levels[number].offset]]
        return result

    def level(self, number: int) -> np.ndarray:
        """Returns the components of all cells of a level."""
        place, own = self._place(number)
        # The last entry stands for -1, a cell in no component.
        return np.append(self._later()[place], -1).astype(np.int32)[own]

    def _place(self, number: int) -> tuple[int, np.ndarray]:
        """Returns the step that brought a level, and its labels of then."""
        return [(k, own) for k, own in enumerate(self._of_level) if own is not None][number]

    def _later(self) -> list[np.ndarray]:
        """Returns for each step the map from its labels to those of today."""
        maps = [np.arange(self.count)]
        for merge in reversed(self._merges[1:]):
            maps.append(maps[-1][merge])
        return maps[::-1]

    @staticmethod
    def _connected(count: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        if count == 0:
            return np.zeros(0, np.int32)
        graph = coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
        return connected_components(graph, directed=False)[1]
