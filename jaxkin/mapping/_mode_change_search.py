"""A first path of a mode change: the cheapest one over a lattice of poses, where cheap is short and far from singular.

A lattice finds, and proves nothing: edges of the path are looked at between their ends, and left out if they leave the
aspect, until a path holds. What a path is worth is decided by ``jk.track`` afterwards.
"""

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from jaxkin.kinematics.legs import Legs
from jaxkin.mapping._mode_change_terrain import Ground, Terrain, grounds, radii
from jaxkin.numerics.gluing import short_way

#: Points at which an edge is looked at, and by how much the clearance may change between two of them: it does by more
#: where the edge goes through a singularity without a change of signs, along which two singular surfaces cross.
_LOOKS, _CHANGE = 65, 1.5
#: How exactly the widest path is found.
_HALVINGS = 10


@dataclass(frozen=True, eq=False)
class Lattice:
    """Poses of a box, dimensionless.

    Attributes:
        low: ``(n,)`` lower ends; a fixed axis has its value here.
        spacing: ``(n,)``; 0 along fixed axes.
        shape: Points along every axis; 1 where it is fixed.
        period: ``(n,)`` inf where not glued; an axis that is glued here is covered by one whole turn.
    """

    low: np.ndarray
    spacing: np.ndarray
    shape: tuple[int, ...]
    period: np.ndarray

    @property
    def wraps(self) -> np.ndarray:
        """Which axes close on themselves."""
        turn = np.array(self.shape) * self.spacing
        return np.isfinite(self.period) & (np.abs(turn - self.period) < 1e-9)

    def points(self) -> np.ndarray:
        """Returns all poses, ``(k, n)``."""
        axes = [low + step * np.arange(count) for low, step, count in zip(*self._columns(), strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))

    def _columns(self) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
        return self.low, self.spacing, self.shape

    def offsets(self) -> list[tuple[int, ...]]:
        """Returns one of each pair of opposite steps: to all neighbours of three axes, along the axes of more."""
        free = sum(count > 1 for count in self.shape)
        steps = itertools.product(*((-1, 0, 1) if count > 1 else (0,) for count in self.shape))
        return [step for step in steps if step > (0,) * len(step) and (free <= 3 or sum(map(abs, step)) == 1)]

    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the numbers of the points at both ends of every edge."""
        numbers = np.arange(np.prod(self.shape)).reshape(self.shape)
        first, second = [], []
        for step in self.offsets():
            here, there = numbers, np.roll(numbers, [-s for s in step], range(len(step)))
            for axis, s in enumerate(step):
                if s != 0 and not self.wraps[axis]:
                    keep = slice(None, -s) if s > 0 else slice(-s, None)
                    here, there = (np.moveaxis(np.moveaxis(a, axis, 0)[keep], 0, axis) for a in (here, there))
            first.append(here.ravel())
            second.append(there.ravel())
        return np.concatenate(first), np.concatenate(second)

    def around(self, x: np.ndarray) -> np.ndarray:
        """Returns the numbers of the corners of the cell that holds a pose."""
        free = [k for k, count in enumerate(self.shape) if count > 1]
        place = np.zeros(len(x))
        glued = np.isfinite(self.period)
        apart = np.where(glued, np.mod(x - self.low, np.where(glued, self.period, 1.0)), x - self.low)
        place[free] = apart[free] / self.spacing[free]
        below = np.floor(place).astype(int)
        corners = [below + np.array(c) for c in itertools.product(*((0, 1) if n > 1 else (0,) for n in self.shape))]
        kept = []
        for corner in corners:
            wrapped = np.where(self.wraps, corner % np.array(self.shape), corner)
            if np.all((wrapped >= 0) & (wrapped < np.array(self.shape))):
                kept.append(int(np.ravel_multi_index(tuple(wrapped), self.shape)))
        return np.array(kept, int)


@dataclass(frozen=True, eq=False)
class Explored:
    """A lattice with what the terrain is at its points, the two ends of the path appended.

    Attributes:
        lattice: The lattice.
        x: ``(k + 2, n)`` its poses, then start and goal.
        ground: The terrain there.
        reached: ``(k + 2,)`` True where the joints belong to the sheet of the start, as far as known.
        edges: The numbers of both ends of every edge between open points.
        radius: ``(k + 2,)`` how far the singularity is from each point, as ``radii`` says.
    """

    lattice: Lattice
    x: np.ndarray
    ground: Ground
    reached: np.ndarray
    edges: tuple[np.ndarray, np.ndarray]
    radius: np.ndarray

    @cached_property
    def width(self) -> np.ndarray:
        """Roughly the clearance at all points, dimensionless: between it over sqrt(n) and itself."""
        return 1.0 / np.sqrt(np.maximum(np.asarray(self.ground.stiffness), 1e-300))

    @cached_property
    def lengths(self) -> np.ndarray:
        """Lengths of the edges, the short way round glued axes."""
        first, second = self.edges
        return np.sqrt(np.sum(short_way(self.x[second] - self.x[first], self.lattice.period) ** 2, axis=1))

    def narrow(self, trust: float) -> np.ndarray:
        """Returns the width that every edge has in its middle at least, by the radii of its ends times a trust in them.

        With a trust of 1 an edge of positive width cannot meet a singularity, as far as the radii are exact.
        """
        first, second = self.edges
        half, width = 0.5 * self.lengths, self.width
        parts = [width[k] * (1.0 - half / (trust * self.radius[k])) for k in (first, second)]
        return np.minimum(*parts)


def explored(terrain: Terrain, legs: Legs | None, lattice: Lattice, ends: np.ndarray, joints: np.ndarray) -> Explored:
    """Looks at all points of a lattice.

    Args:
        terrain: The terrain.
        legs: How the equations hold the joints, or None.
        lattice: Where to look.
        ends: ``(2, n)`` start and goal.
        joints: ``(n_joint,)`` over both.
    """
    x = np.concatenate([lattice.points(), ends])
    k = len(x) - 2
    first, second = lattice.edges()
    corners = [lattice.around(end) for end in ends]
    first = np.concatenate([first, *(np.full(len(c), k + j) for j, c in enumerate(corners))])
    second = np.concatenate([second, *corners])
    if legs is not None:
        ground, reached = grounds(terrain, legs, x), np.ones(len(x), bool)
    else:
        ground, reached = _flooded(terrain, lattice, x, (first, second), joints)
    # Both ends are solutions, whatever rounding says of the limits there.
    is_open = np.asarray(ground.open) & reached
    is_open[k:] = True
    ground = ground._replace(open=is_open)  # type: ignore[arg-type]
    keep = is_open[first] & is_open[second]
    first, second = first[keep], second[keep]
    used = np.unique(np.concatenate([first, second]))
    radius = np.full(len(x), 1e-300)
    radius[used] = radii(terrain, x[used], np.asarray(ground.joints)[used])
    return Explored(lattice, x, ground, reached, (first, second), radius)


def _flooded(
    terrain: Terrain, lattice: Lattice, x: np.ndarray, edges: tuple[np.ndarray, np.ndarray], joints: np.ndarray
) -> tuple[Ground, np.ndarray]:
    """Carries the joints of the start from point to point, each from the first neighbour that is reached.

    A pose that two sheets of the inverse kinematics cover is only seen on the sheet that arrives first.
    """
    count, k = len(x), len(x) - 2
    graph = coo_array((np.ones(len(edges[0])), edges), shape=(count, count)).tocsr()
    graph = (graph + graph.T).tocsr()
    guess = np.tile(joints, (count, 1)).astype(float)
    done, is_open = np.zeros(count, bool), np.zeros(count, bool)
    whole = grounds(terrain, None, x[k:], guess[k:])
    stiffness, low, found = np.full(count, np.inf), np.zeros(count), guess.copy()
    done[k:], is_open[k:], stiffness[k:], low[k:] = True, True, whole.stiffness, whole.low
    front = np.array([k])
    while len(front):
        rows = graph[front]
        parents = np.repeat(front, np.diff(rows.indptr))
        fresh = ~done[rows.indices]
        children, place = np.unique(rows.indices[fresh], return_index=True)
        parents = parents[fresh][place]
        part = grounds(terrain, None, x[children], found[parents])
        done[children], found[children] = True, part.joints
        is_open[children], stiffness[children], low[children] = part.open, part.stiffness, part.low
        front = children[np.asarray(part.open)]
    return Ground(found, is_open, stiffness, low), done  # type: ignore[arg-type]


def widest(found: Explored, narrow: np.ndarray) -> float | None:
    """Returns the largest width that all edges of some path over the lattice have; None where there is none.

    Args:
        found: The lattice, explored.
        narrow: Width of every edge, see ``Explored.narrow``; those of no positive one are left out.
    """
    (first, second), width, count = found.edges, found.width, len(found.x)

    def joined(least: float) -> bool:
        keep = narrow >= least
        graph = coo_array((np.ones(int(keep.sum())), (first[keep], second[keep])), shape=(count, count))
        labels = connected_components(graph, directed=False)[1]
        return bool(labels[-1] == labels[-2])

    low, high = 1e-12, float(np.min(width[-2:]))
    if joined(high):
        return high
    if not joined(low):
        return None
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if joined(middle) else (low, middle)
    return low


def cheapest_path(
    terrain: Terrain, legs: Legs | None, found: Explored, allowed: np.ndarray, repairs: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Returns the shortest path over some of the edges of a lattice that holds between their ends too.

    Args:
        terrain: The terrain.
        legs: How the equations hold the joints, or None.
        found: The lattice, explored.
        allowed: Which edges may be used.
        repairs: How often a path is sought anew.

    Returns:
        Poses ``(k, n)``, angles continuous, and their joints; None where there is no such path.
    """
    first, second = found.edges
    low = np.asarray(found.ground.low)
    cost = found.lengths * (1.0 + 0.5 * (low[first] + low[second])) + 1e-12
    count, allowed = len(found.x), allowed.copy()
    for _ in range(repairs):
        graph = coo_array((cost[allowed], (first[allowed], second[allowed])), shape=(count, count)).tocsr()
        distance, before = dijkstra(graph, directed=False, indices=count - 2, return_predecessors=True)
        if not np.isfinite(distance[count - 1]):
            return None
        numbers = [count - 1]
        while numbers[-1] != count - 2:
            numbers.append(int(before[numbers[-1]]))
        numbers.reverse()
        path = _unrolled(found.x[numbers], found.lattice.period)
        joints = np.asarray(found.ground.joints)[numbers]
        wrong = _leaves(terrain, legs, path, joints)
        if not np.any(wrong):
            return path, joints
        pairs = {frozenset(numbers[j : j + 2]) for j in np.flatnonzero(wrong)}
        bad = np.array([tuple(sorted(pair)) for pair in pairs])
        low, high = np.minimum(first, second), np.maximum(first, second)
        for a, b in bad:
            allowed &= ~((low == a) & (high == b))
    return None


def _unrolled(path: np.ndarray, period: np.ndarray) -> np.ndarray:
    steps = short_way(np.diff(path, axis=0), period)
    return np.concatenate([path[:1], path[:1] + np.cumsum(steps, axis=0)])


def _leaves(terrain: Terrain, legs: Legs | None, path: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """Returns which straight pieces of a path leave the aspect, or go through no clearance, ``(k - 1,)``."""
    looks, shares = _LOOKS, np.linspace(0, 1, _LOOKS)
    between = path[:-1, None] + shares[:, None] * np.diff(path, axis=0)[:, None]
    looked = grounds(terrain, legs, between.reshape(-1, path.shape[1]), np.repeat(guess[:-1], looks, axis=0))
    is_open = np.asarray(looked.open).reshape(-1, looks)
    # Both ends of the path are solutions, whatever rounding says of the limits there.
    is_open[0, 0] = is_open[-1, -1] = True
    stiffness = np.sqrt(np.asarray(looked.stiffness)).reshape(-1, looks)
    change = np.max(np.abs(np.diff(np.log(stiffness), axis=1)), axis=1)
    return ~np.all(is_open, axis=1) | ~(change <= np.log(_CHANGE))
