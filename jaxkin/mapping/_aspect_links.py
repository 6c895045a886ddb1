"""From solutions at single poses to those of a whole lattice, and the components that continuation links."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from jaxkin.mapping._aspect_nodes import Lattice, Measured, Problem, Solutions, follow, measured
from jaxkin.numerics.gluing import short_way

#: Nodes at which a search starts, and others at which it checks what continuation found.
_SEARCHED, _CHECKED = 196, 128
#: Components of fewer nodes are sought again in windows of so many rows around them, ...
SMALL, _MARGIN = 16, 5
#: ... with so many nodes at most, and each cell cut at most so many times.
_WINDOW, _CUTS = 2**13, 9


@dataclass(frozen=True, eq=False)
class Links:
    """Lines from solutions to those of other nodes, arrays over the lines.

    Attributes:
        source: Number of the solution at the start.
        target: At the end, -1 where continuation broke off.
        signs: det A and det B have one sign at all steps, and limits hold.
        sheet: det B does not vanish on the way, as far as its second differences tell.
        aspect: Nor does det A, and limits and clearance hold.
    """

    source: np.ndarray
    target: np.ndarray
    signs: np.ndarray
    sheet: np.ndarray
    aspect: np.ndarray

    def mutual(self, kind: str) -> np.ndarray:
        """Returns the pairs linked in both directions, ``(2, k)``, by one of the three properties."""
        good = getattr(self, kind) & (self.target >= 0)
        size = max(self.source.max(initial=0), self.target.max(initial=0)) + 1
        there, back = self.source * size + self.target, self.target * size + self.source
        good &= np.isin(back, there[good])
        return np.stack([self.source[good], self.target[good]])


def joined(parts: list[Links]) -> Links:
    """Returns the lines of several parts."""
    names = ("source", "target", "signs", "sheet", "aspect")
    return Links(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True, eq=False)
class Bridge:
    """Two solutions of which a finer lattice around them found that they are linked.

    Attributes:
        kind: ``"aspect"`` or ``"sheet"``.
        ends: Their numbers.
        points: ``(k, d)`` nodes of the finer lattice from one to the other, for an aspect.
    """

    kind: str
    ends: tuple[int, int]
    points: np.ndarray


@dataclass(frozen=True, eq=False)
class Linked:
    """All solutions of a lattice in components.

    Attributes:
        solutions: The solutions.
        links: The lines between them.
        bridges: What finer lattices linked.
        numbers: Their determinants.
        aspect: ``(n,)`` component of regular ones within all limits, -1 elsewhere.
        sheet: ``(n,)`` component where only det B separates.
        missed: Solutions that a search found at check nodes, and continuation had not.
        checked: Number of check nodes.
    """

    solutions: Solutions
    links: Links
    bridges: tuple[Bridge, ...]
    numbers: Measured
    aspect: np.ndarray
    sheet: np.ndarray
    missed: int
    checked: int

    def graph(self) -> csr_array:
        """Returns the links within aspects as a symmetric matrix."""
        return _graph(_pairs(self.links, self.bridges, "aspect"), len(self.solutions))

    def between(self, first: int, last: int) -> np.ndarray:
        """Returns the points ``(k, d)`` by which a line of the graph goes; none where it is straight."""
        for bridge in self.bridges:
            if bridge.kind == "aspect" and {first, last} == set(bridge.ends):
                return bridge.points[:: 1 if bridge.ends[0] == first else -1][1:-1]
        return np.zeros((0, len(self.solutions.lattice.shape)))


def linked(problem: Problem, lattice: Lattice, coarse: Linked | None = None) -> Linked:
    """Returns all solutions of a lattice that search and continuation find, in components.

    Args:
        problem: The mechanism.
        lattice: The nodes.
        coarse: What a coarser lattice gave, to start from; without it a search starts.
    """
    solutions = Solutions(lattice, problem)
    if coarse is None:
        nodes, joints = solutions.search(_spread(lattice))
    else:
        nodes, joints = _carried(problem, lattice, coarse.solutions)
    parts = [_flood(solutions, solutions.add(nodes, joints))]
    random = np.random.default_rng(5).permutation(lattice.size)[:_CHECKED]
    before = len(solutions)
    new = solutions.add(*solutions.search(random))
    missed = len(solutions) - before
    parts.append(_flood(solutions, np.unique(new[new >= before])))
    numbers = measured(problem, solutions.poses, solutions.joints)
    links = joined(parts)
    bridges: tuple[Bridge, ...] = ()
    aspect, _ = _components(solutions, links, numbers, bridges)
    # The coarse lattice is only a start and a comparison.
    small = np.bincount(aspect[aspect >= 0]) < SMALL
    for label in np.flatnonzero(small & (coarse is not None)):
        bridges += _window(solutions, numbers, aspect, int(label))
    aspect, sheet = _components(solutions, links, numbers, bridges)
    return Linked(solutions, links, bridges, numbers, aspect, sheet, missed, len(random))


def _spread(lattice: Lattice) -> np.ndarray:
    """Returns nodes spread evenly."""
    shape = np.array(lattice.shape)
    along = np.minimum(shape, max(2, round(_SEARCHED ** (1 / len(shape)))))
    rows = [((np.arange(n) + 0.5) * size / n).astype(int) for n, size in zip(along, shape, strict=True)]
    return np.ravel_multi_index(tuple(part.ravel() for part in np.meshgrid(*rows, indexing="ij")), lattice.shape)


def _carried(problem: Problem, lattice: Lattice, coarse: Solutions) -> tuple[np.ndarray, np.ndarray]:
    """Returns the solutions of a coarser lattice, followed to the nearest nodes."""
    points = coarse.lattice.points(coarse.nodes)
    nodes = lattice.nearest(points)
    moves = lattice.poses(lattice.points(nodes)) - lattice.poses(points)
    found = follow(problem, lattice.poses(points), coarse.joints, moves)
    return nodes[found.reached], found.joints[found.reached]


def lines(solutions: Solutions, numbers: np.ndarray, by: np.ndarray) -> Links:
    """Follows solutions to the nodes so many rows away, ``(k, d)``; ends that are new become solutions."""
    lattice = solutions.lattice
    nodes = lattice.shifted(solutions.nodes[numbers], by)
    numbers, by, nodes = numbers[nodes >= 0], by[nodes >= 0], nodes[nodes >= 0]
    moves = np.zeros((len(by), len(lattice.fixed)))
    moves[:, list(lattice.free)] = by * lattice.width
    found = follow(solutions.problem, solutions.poses[numbers], solutions.joints[numbers], moves)
    target = np.full(len(nodes), -1)
    target[found.reached] = solutions.add(nodes[found.reached], found.joints[found.reached])
    return Links(numbers, target, found.signs, found.sheet, found.aspect)


def _flood(solutions: Solutions, frontier: np.ndarray) -> Links:
    """Follows solutions to all neighbouring nodes, and what is new there in turn, until nothing is new."""
    d = len(solutions.lattice.shape)
    moves = np.concatenate([np.eye(d, dtype=int), -np.eye(d, dtype=int)])
    frontier, parts = np.unique(frontier), []
    while True:
        before = len(solutions)
        parts.append(lines(solutions, np.repeat(frontier, 2 * d), np.tile(moves, (len(frontier), 1))))
        frontier = np.arange(before, len(solutions))
        if len(frontier) == 0:
            return joined(parts)


def _window(solutions: Solutions, numbers: Measured, aspect: np.ndarray, label: int) -> tuple[Bridge, ...]:
    """Seeks links of one component to others in a finer lattice around it, whose nodes include those around it."""
    lattice, problem = solutions.lattice, solutions.problem
    own = np.flatnonzero(aspect == label)
    rows = lattice.index(solutions.nodes)
    shape, centre = np.array(lattice.shape), rows[own[0]]
    period = np.where(lattice.glued, shape, np.inf)
    rows = centre + short_way(rows - centre, period).astype(int)
    first, last = rows[own].min(axis=0) - _MARGIN, rows[own].max(axis=0) + _MARGIN + 1
    first, last = (np.where(lattice.glued, ends, np.clip(ends, 0, shape)) for ends in (first, last))
    last = np.minimum(last, first + shape)
    # An odd number of parts of a cell have its centre among theirs.
    parts = int((_WINDOW / np.prod(last - first)) ** (1 / len(shape)))
    parts = min(_CUTS, parts - 1 + parts % 2)
    if parts < 3:
        return ()
    low, high = lattice.low + first * lattice.width, lattice.low + last * lattice.width
    fine = Lattice(lattice.free, lattice.fixed, low, high, tuple((last - first) * parts), np.zeros(len(shape), bool))
    inside = np.flatnonzero(np.all((rows >= first) & (rows < last), axis=1))
    nodes = np.asarray(np.ravel_multi_index(tuple(((rows[inside] - first) * parts + parts // 2).T), fine.shape))
    finer = Solutions(fine, problem)
    seeds = np.all(numbers.scaled[inside] * numbers.scaled[own[0]] > 0, axis=1)
    links = _flood(finer, finer.add(nodes[seeds], solutions.joints[inside[seeds]]))
    place, start = finer.match(nodes, solutions.joints[inside]), int(np.flatnonzero(inside == own[0])[0])
    others = (aspect[inside] != label) & (place >= 0)
    components = _components(finer, links, measured(problem, finer.poses, finer.joints), ())
    found = []
    for kind, labels in zip(("aspect", "sheet"), components, strict=True):
        same = np.flatnonzero(others & (labels[place] == labels[place[start]]) & (labels[place] >= 0))
        graph = _graph(links.mutual(kind), len(finer))
        for other in same[np.unique(aspect[inside[same]], return_index=True)[1]].tolist():
            route = route_between(graph, int(place[start]), int(place[other]))
            found.append(Bridge(kind, (int(own[0]), int(inside[other])), fine.points(finer.nodes[route])))
    return tuple(found)


def route_between(graph: csr_array, first: int, last: int) -> np.ndarray:
    """Returns the nodes of a shortest way through a symmetric graph."""
    before = breadth_first_order(graph, last, directed=False)[1]
    route = [first]
    while route[-1] != last:
        route.append(int(before[route[-1]]))
    return np.array(route)


def _pairs(links: Links, bridges: tuple[Bridge, ...], kind: str) -> np.ndarray:
    ends = np.array([bridge.ends for bridge in bridges if bridge.kind == kind], int).reshape(-1, 2)
    return np.concatenate([links.mutual(kind), ends.T], axis=1)


def _components(
    solutions: Solutions, links: Links, numbers: Measured, bridges: tuple[Bridge, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the components of aspects and of sheets, numbered from zero; -1 where there is none."""
    labels = []
    for kind, use in (("aspect", numbers.regular), ("sheet", np.abs(numbers.scaled[:, 1]) > 0)):
        label = connected_components(_graph(_pairs(links, bridges, kind), len(solutions)), directed=False)[1]
        found = np.full(len(solutions), -1)
        found[use] = np.unique(label[use], return_inverse=True)[1]
        labels.append(found)
    return labels[0], labels[1]


def _graph(pairs: np.ndarray, size: int) -> csr_array:
    return coo_array((np.ones(pairs.shape[1], np.int32), tuple(pairs)), (size, size)).tocsr()
