"""A roadmap of a section of the joint space: points in all cells between curves, and short straight ways between them.

The points are the centres of a Delaunay triangulation of the curves' points, which reaches into every cell however
thin, and the ways those from triangle to triangle. Which curve a way crosses follows from the curves' chords; what the
chords misjudge shows in the modes that are followed along the ways.
"""

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import Delaunay, KDTree

from jaxkin.mapping.section import Section

#: Lines of extra points across the section, so that large cells have several triangles.
_LINES = 20
#: Share of a turn by which the triangulation reaches beyond a glued end.
_BEYOND = 0.2
#: Triangles with a smaller height, in widths of the section, are none.
_FLAT = 1e-7
#: How many of the nearest points are looked at from a place, and how many of those seen from there are returned.
_LOOKED_AT, _SEEN = 600, 16


@dataclass(frozen=True, eq=False)
class Plane:
    """The free joints of a section as a plane, in widths of the section.

    Attributes:
        fixed: ``(n_joint,)`` the other joints' values.
        free: Which joints are free.
        low: ``(2,)``.
        width: ``(2,)``.
        period: ``(2,)`` in widths; inf where not glued.
    """

    fixed: np.ndarray
    free: tuple[int, int]
    low: np.ndarray
    width: np.ndarray
    period: np.ndarray

    @classmethod
    def of(cls, section: Section) -> "Plane":
        """Returns the plane of a section; an axis is glued where the section spans its whole turn."""
        low, high = np.asarray(section.data.low), np.asarray(section.data.high)
        first, second = section.grid.free
        periods = [section.robot.joint_axes[k].period for k in (first, second)]
        whole = [p is not None and np.isclose(b - a, p) for p, a, b in zip(periods, low, high, strict=True)]
        return cls(np.asarray(section.data.fixed), (first, second), low, high - low, np.where(whole, 1.0, np.inf))

    def flat(self, joints: np.ndarray) -> np.ndarray:
        """Returns joints as points of the plane, ``(..., 2)``."""
        return (np.asarray(joints, float)[..., list(self.free)] - self.low) / self.width

    def joints(self, points: np.ndarray) -> np.ndarray:
        """Returns points of the plane as joints, ``(..., n_joint)``."""
        joints = np.broadcast_to(self.fixed, (*np.shape(points)[:-1], len(self.fixed))).copy()
        joints[..., list(self.free)] = self.low + points * self.width
        return joints

    def near(self, difference: np.ndarray) -> np.ndarray:
        """Returns differences the short way round the glued axes."""
        return np.where(np.isfinite(self.period), difference - np.round(difference), difference)

    def shifts(self) -> np.ndarray:
        """Returns the whole turns by which the section's copies around it are moved, none first, ``(n, 2)``."""
        turns = [(0.0, -1.0, 1.0) if np.isfinite(p) else (0.0,) for p in self.period]
        return np.array(list(itertools.product(*turns)))


@dataclass(frozen=True, eq=False)
class Barriers:
    """Chords of the curves that bound the cells, with their copies beyond glued ends.

    Attributes:
        start: ``(s, 2)``.
        step: ``(s, 2)`` from the start to the end of each.
        curve: ``(s,)`` number of the curve.
        first: ``(s,)`` number of the chord's first point on the curve.
    """

    start: np.ndarray
    step: np.ndarray
    curve: np.ndarray
    first: np.ndarray

    @classmethod
    def of(cls, plane: Plane, curves: list[tuple[np.ndarray, bool]]) -> "Barriers":
        """Returns the chords of curves, given by their joints and whether they are closed."""
        parts = [(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, int), np.zeros(0, int))]
        for number, (joints, closed) in enumerate(curves):
            points = plane.flat(joints)
            ends = np.roll(points, -1, axis=0) if closed else points[1:]
            starts = points[: len(ends)]
            count = np.arange(len(ends))
            parts.append((starts, plane.near(ends - starts), np.full(len(ends), number), count))
        start, step, curve, first = (np.concatenate(part) for part in zip(*parts, strict=True))
        shifts = plane.shifts()
        copies = (start[None] + shifts[:, None]).reshape(-1, 2)
        # Ways end within half a turn of the section.
        seen = np.all((copies > -0.6) & (copies < 1.6), axis=1)
        return cls(copies[seen], *(np.concatenate([part] * len(shifts))[seen] for part in (step, curve, first)))

    def crossed(self, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Finds which chords ways cross.

        Returns:
            How often each way crosses chords ``(w,)``; the chord that it crosses (the last one), -1 for none; and the
            share of the chord at which it does.
        """
        count, chord, share = np.zeros(len(starts), int), np.full(len(starts), -1), np.zeros(len(starts))
        if len(self.start) == 0 or len(starts) == 0:
            return count, chord, share
        reach = 0.5 * np.linalg.norm(ends - starts, axis=1) + self._longest
        near = self._tree.query_ball_point(0.5 * (starts + ends), reach * (1 + 1e-9))
        way = np.repeat(np.arange(len(starts)), [len(some) for some in near])
        other = np.concatenate([np.asarray(some, int) for some in near])
        d, e, gap = (ends - starts)[way], self.step[other], self.start[other] - starts[way]
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
            t = (gap[:, 0] * e[:, 1] - gap[:, 1] * e[:, 0]) / bend
            s = (gap[:, 0] * d[:, 1] - gap[:, 1] * d[:, 0]) / bend
            hit = (t >= 0) & (t <= 1) & (s >= 0) & (s < 1)
        np.add.at(count, way[hit], 1)
        chord[way[hit]], share[way[hit]] = other[hit], s[hit]
        return count, chord, share

    def distance(self, point: np.ndarray) -> float:
        """Returns how far a point ``(2,)`` is from the nearest chord."""
        size = np.maximum(np.sum(self.step**2, axis=1), 1e-300)
        share = np.clip(np.sum((point - self.start) * self.step, axis=1) / size, 0.0, 1.0)
        return float(np.min(np.linalg.norm(self.start + share[:, None] * self.step - point, axis=1), initial=np.inf))

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.start + 0.5 * self.step)

    @cached_property
    def _longest(self) -> float:
        return 0.5 * float(np.max(np.linalg.norm(self.step, axis=1)))


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Points of a section and ways between them.

    Attributes:
        plane: The section's plane.
        barriers: The curves.
        points: ``(n, 2)`` in the plane.
        depth: ``(n,)`` how far from the curves a point may be taken to lie: the height of its triangle.
        ways: ``(w, 2)`` numbers of points.
        shift: ``(w, 2)`` whole turns added to the second point.
        crossings: ``(w,)`` how many chords each way crosses.
        chord: ``(w,)`` a chord that it crosses, -1 for none.
        share: ``(w,)`` where on the chord.
    """

    plane: Plane
    barriers: Barriers
    points: np.ndarray
    depth: np.ndarray
    ways: np.ndarray
    shift: np.ndarray
    crossings: np.ndarray
    chord: np.ndarray
    share: np.ndarray

    @property
    def joints(self) -> np.ndarray:
        """Joints of the points, ``(n, n_joint)``."""
        return self.plane.joints(self.points)

    def turns(self) -> np.ndarray:
        """The shifts as joints, ``(w, n_joint)``."""
        return self.plane.joints(self.shift) - self.plane.joints(np.zeros(2))

    def around(self, joints: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns good points that a straight way reaches from joints without crossing a curve, nearest first.

        Returns:
            Their numbers, a few, and their joints moved by whole turns next to the given ones.
        """
        here = self.plane.flat(joints)
        steps = self.plane.near(self.points - here)
        distance = np.where(good, np.sum(steps**2, axis=1), np.inf)
        nearest = np.argsort(distance, kind="stable")[: min(_LOOKED_AT, int(np.sum(good)))]
        there = here + steps[nearest]
        free = np.flatnonzero(self.barriers.crossed(np.broadcast_to(here, there.shape), there)[0] == 0)[:_SEEN]
        return nearest[free], self.plane.joints(there[free])


def roadmap_of(section: Section, curves: list[tuple[np.ndarray, bool]]) -> Roadmap:
    """Builds the roadmap of a section between curves, given by their joints and whether they are closed."""
    plane = Plane.of(section)
    barriers = Barriers.of(plane, curves)
    triangles, neighbours = _triangulated(plane, curves)
    centres = triangles.mean(axis=1)
    depth = _heights(triangles)
    inside = np.all((centres >= 0) & (centres < 1), axis=1) & (depth > _FLAT)
    number = np.cumsum(inside) - 1
    points = centres[inside]
    tree = KDTree(points)
    a = np.repeat(np.arange(len(triangles)), 3)
    b = neighbours.reshape(-1)
    good = inside[a] & (b >= 0)
    a, b = a[good], b[good]
    # Beyond a glued end stands a copy of a triangle inside: the nearest centre is taken for it.
    home = np.where(np.isfinite(plane.period), np.floor(centres[b]), 0.0)
    own = np.all(home == 0, axis=1)
    copied = ~own & np.all((centres[b] - home >= 0) & (centres[b] - home < 1), axis=1)
    kept = (own & inside[b] & (a < b)) | copied
    a, b, home, copied = a[kept], b[kept], home[kept], copied[kept]
    target = np.where(copied, tree.query(centres[b] - home)[1], number[b])
    ways = np.stack([number[a], target], axis=1)
    apart = ways[:, 0] != ways[:, 1]
    ways, home = ways[apart], home[apart]
    crossed = barriers.crossed(points[ways[:, 0]], points[ways[:, 1]] + home)
    return Roadmap(plane, barriers, points, depth[inside], ways, home, *crossed)


def _triangulated(plane: Plane, curves: list[tuple[np.ndarray, bool]]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners of triangles ``(t, 3, 2)`` and their neighbours ``(t, 3)``, -1 for none."""
    lines = np.linspace(0, 1, _LINES + 1)
    rows = [np.stack(np.meshgrid(lines, lines, indexing="ij"), axis=-1).reshape(-1, 2)]
    points = np.concatenate([*(plane.flat(joints) for joints, _ in curves), *rows])
    points = np.where(np.isfinite(plane.period), points - np.floor(points), points)
    copies = (points + plane.shifts()[:, None]).reshape(-1, 2)
    reach = np.where(np.isfinite(plane.period), _BEYOND, 1e-9)
    copies = copies[np.all((copies >= -reach) & (copies <= 1 + reach), axis=1)]
    copies = copies[np.unique(np.round(copies, 9), axis=0, return_index=True)[1]]
    mesh = Delaunay(copies)
    return copies[mesh.simplices], mesh.neighbors


def _heights(triangles: np.ndarray) -> np.ndarray:
    """Returns the smallest height of every triangle."""
    sides = triangles - np.roll(triangles, 1, axis=1)
    longest = np.sqrt(np.max(np.sum(sides**2, axis=-1), axis=1))
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    return area / np.where(longest > 0, longest, 1.0)
