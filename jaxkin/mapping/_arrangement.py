"""The division of a plane by arcs that are graphs over one direction: regions, their neighbours, their outlines.

Combinatorial: which arc lies above which between two consecutive abscissas of vertices, and which vertex each arc ends
in. Heights are compared only between vertices on one abscissa.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

#: Abscissas of vertices closer than this are one.
SAME_ABSCISSA = 1e-11


class Trapezoid(NamedTuple):
    """What lies between two arcs, one above the other, and two abscissas.

    Attributes:
        slab: Between which abscissas.
        below: The arc below.
        above: The arc above.
        region: To which region it belongs.
    """

    slab: int
    below: int
    above: int
    region: int


@dataclass(frozen=True, eq=False)
class Graph:
    """Vertices and arcs of a division.

    Attributes:
        bounds: ``(s + 1,)`` abscissas of vertices, ascending: slabs lie between them.
        rank: ``(n,)`` which of them is that of each vertex.
        heights: ``(n,)`` of the vertices.
        start: ``(e,)`` vertex at the left end of each arc.
        end: ``(e,)`` vertex at the right end.
    """

    bounds: np.ndarray
    rank: np.ndarray
    heights: np.ndarray
    start: np.ndarray
    end: np.ndarray

    @property
    def live(self) -> list[np.ndarray]:
        """The arcs over each slab."""
        first, last = self.rank[self.start], self.rank[self.end]
        return [np.flatnonzero((first <= k) & (k < last)) for k in range(len(self.bounds) - 1)]

    @property
    def upright(self) -> np.ndarray:
        """Arcs over no slab: both ends on one abscissa."""
        return np.flatnonzero(self.rank[self.start] >= self.rank[self.end])


def graph(abscissas: np.ndarray, heights: np.ndarray, start: np.ndarray, end: np.ndarray) -> Graph:
    """Ranks the vertices by their abscissas."""
    order = np.argsort(abscissas, kind="stable")
    steps = np.diff(abscissas[order]) > SAME_ABSCISSA
    rank = np.empty(len(order), int)
    rank[order] = np.concatenate([[0], np.cumsum(steps)])
    bounds = abscissas[order][np.concatenate([[True], steps])]
    return Graph(bounds, rank, heights, np.asarray(start, int), np.asarray(end, int))


@dataclass(frozen=True, eq=False)
class Division:
    """The regions of a plane.

    Attributes:
        count: How many there are.
        below: ``(e,)`` the region below each arc; -1 is outside.
        above: ``(e,)`` the region above each arc.
        trapezoids: The pieces of all regions.
        loops: For every region its closed boundaries, the region to the left: arcs as (number, runs to the right).
        contradictions: How often the orders of arcs over neighbouring slabs do not fit together.
    """

    count: int
    below: np.ndarray
    above: np.ndarray
    trapezoids: list[Trapezoid]
    loops: list[list[list[tuple[int, bool]]]]
    contradictions: int


class Unions:
    """Sets that are joined until no more are (union-find)."""

    def __init__(self, count: int):
        self._parent = list(range(count))

    def find(self, k: int) -> int:
        """Returns the representative of the set of k."""
        while self._parent[k] != k:
            self._parent[k] = self._parent[self._parent[k]]
            k = self._parent[k]
        return k

    def join(self, i: int, j: int) -> None:
        """Makes the sets of i and j one."""
        i, j = self.find(i), self.find(j)
        self._parent[max(i, j)] = min(i, j)

    def labels(self) -> np.ndarray:
        """Returns the number of every element's set, from 0 on, by their first elements."""
        roots = [self.find(k) for k in range(len(self._parent))]
        return np.unique(roots, return_inverse=True)[1].reshape(-1)


def divide(
    shape: Graph, order: list[list[int]], glue: Iterable[tuple[tuple[int, bool], tuple[int, bool]]] = ()
) -> Division:
    """Divides the plane.

    Args:
        shape: Vertices and arcs.
        order: For every slab its arcs, from the lowest to the highest.
        glue: Pairs of sides of arcs, (arc, above it), that are one place: the regions there are joined.
    """
    starts = np.cumsum([0] + [max(len(arcs) - 1, 0) for arcs in order])
    unions, contradictions = Unions(int(starts[-1])), 0
    for k in range(1, len(order)):
        left, right, fits = _levels(shape, k, order[k - 1], order[k])
        contradictions += not fits
        _join_over(unions, left, right, int(starts[k - 1]), int(starts[k]))
    sides = _sides(len(shape.start), order, starts)
    for pair in glue:
        one, other = (sides[arc, int(above)] for arc, above in pair)
        if one >= 0 and other >= 0:
            unions.join(one, other)
    labels = unions.labels()
    below, above = (np.where(side >= 0, labels[side] if len(labels) else -1, -1) for side in sides.T)
    trapezoids = [
        Trapezoid(k, arcs[j], arcs[j + 1], int(labels[starts[k] + j]))
        for k, arcs in enumerate(order)
        for j in range(len(arcs) - 1)
    ]
    count = int(labels.max()) + 1 if len(labels) else 0
    loops, odd = _loops(shape, order, below, above, count)
    return Division(count, below, above, trapezoids, loops, contradictions + odd)


def _levels(shape: Graph, k: int, left: list[int], right: list[int]) -> tuple[list[int], list[int], bool]:
    """Returns at which level the arcs of two neighbouring slabs meet the abscissa between them, and if all fits.

    Levels are the arcs that go on and the vertices there, from below.
    """
    going = [arc for arc in left if shape.rank[shape.end[arc]] > k]
    fits = going == [arc for arc in right if shape.rank[shape.start[arc]] < k]
    gaps: list[dict[int, float]] = [{} for _ in range(len(going) + 1)]
    for arcs, ends in ((left, shape.end), (right, shape.start)):
        gap, last = 0, -1
        for arc in arcs:
            if arc in going:
                gap, last = going.index(arc) + 1, -1
                continue
            vertex = int(ends[arc])
            fits &= vertex == last or vertex not in gaps[gap] or arcs is right
            gaps[gap][vertex] = float(shape.heights[vertex])
            last = vertex
    level, at = {}, 0
    for gap, vertices in enumerate(gaps):
        for vertex in sorted(vertices, key=lambda v: vertices[v]):
            fits &= ("vertex", vertex) not in level
            level["vertex", vertex] = at
            at += 1
        if gap < len(going):
            level["arc", going[gap]] = at
            at += 1

    def of(arcs: list[int], ends: np.ndarray) -> list[int]:
        return [level["arc", arc] if arc in going else level["vertex", int(ends[arc])] for arc in arcs]

    low, high = of(left, shape.end), of(right, shape.start)
    return low, high, bool(fits and low == sorted(low) and high == sorted(high))


def _join_over(unions: Unions, left: list[int], right: list[int], first: int, second: int) -> None:
    """Joins the trapezoids on both sides of an abscissa that share an open interval of it."""
    for i, (low, high) in enumerate(itertools.pairwise(left)):
        for j, (bottom, top) in enumerate(itertools.pairwise(right)):
            if max(low, bottom) < min(high, top):
                unions.join(first + i, second + j)


def _sides(arcs: int, order: list[list[int]], starts: np.ndarray) -> np.ndarray:
    """Returns a trapezoid below and one above every arc, ``(arcs, 2)``; -1 where there is none."""
    sides = np.full((arcs, 2), -1)
    for k, line in enumerate(order):
        for j, arc in enumerate(line):
            if j > 0:
                sides[arc, 0] = starts[k] + j - 1
            if j + 1 < len(line):
                sides[arc, 1] = starts[k] + j
    return sides


def _loops(
    shape: Graph, order: list[list[int]], below: np.ndarray, above: np.ndarray, count: int
) -> tuple[list[list[list[tuple[int, bool]]]], int]:
    """Walks round all faces; also returns how many walks have more than one region to their left."""
    around = _rotations(shape, order)
    loops: list[list[list[tuple[int, bool]]]] = [[] for _ in range(count)]
    seen: set[tuple[int, bool]] = set()
    odd = 0
    present = sorted({arc for line in order for arc in line})
    for arc in present:
        for rightward in (True, False):
            if (arc, rightward) in seen:
                continue
            walk, here = [], (arc, rightward)
            while here not in seen:
                seen.add(here)
                walk.append(here)
                vertex = int((shape.end if here[1] else shape.start)[here[0]])
                turn = around[vertex]
                following = turn[turn.index(here[0]) - 1]
                here = (following, int(shape.start[following]) == vertex)
            regions = {int((above if r else below)[a]) for a, r in walk}
            odd += len(regions) > 1
            region = int((above if rightward else below)[arc])
            if region >= 0:
                loops[region].append(walk)
    return loops, odd


def _rotations(shape: Graph, order: list[list[int]]) -> dict[int, list[int]]:
    """Returns the arcs around every vertex, counter-clockwise."""
    right: dict[int, list[int]] = {}
    left: dict[int, list[int]] = {}
    for k, line in enumerate(order):
        for arc in line:
            if shape.rank[shape.start[arc]] == k:
                right.setdefault(int(shape.start[arc]), []).append(arc)
            if shape.rank[shape.end[arc]] == k + 1:
                left.setdefault(int(shape.end[arc]), []).append(arc)
    return {v: right.get(v, []) + left.get(v, [])[::-1] for v in {*right, *left}}
