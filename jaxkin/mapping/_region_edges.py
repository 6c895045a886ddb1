"""Arcs of images as graphs: where they are at an abscissa, where two of them cross, and the area under them."""

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from jaxkin.mapping._region_paths import ONE_POINT, Plane, Spots, Strand, tilted
from jaxkin.mapping.search import twins
from jaxkin.numerics.gluing import short_way

#: Arcs with the same ends are one where they are closer than this at abscissas between them.
_ONE_ARC = 1e-9
#: Poses farther apart than this (dimensionless) over one joint point are two.
_TWO_POSES = 1e-6
#: Newton's steps to a crossing of images, and how near both arcs must come there.
_NEWTON, _MEET = 14, 1e-11


@dataclass(frozen=True, eq=False)
class Edge:
    """A piece of the plane's division: an arc of an image, or of the border; from left to right.

    Attributes:
        curves: Numbers of the curves of which this is an image; empty for the border.
        sheet: Number of the factor that vanishes.
        u: ``(k, m)`` unknowns at its points; ``(2, 0)`` for the border.
        plane: ``(k, 2)`` plane coordinates.
        turn: ``(2,)`` whole turns by which plane coordinates of the unknowns are larger.
        start: Number of the vertex at its left end; -1 while not known.
        end: The same at its right end.
    """

    curves: tuple[int, ...]
    sheet: int
    u: np.ndarray
    plane: np.ndarray
    turn: np.ndarray
    start: int = -1
    end: int = -1

    @property
    def abscissas(self) -> np.ndarray:
        """``(k,)`` ascending."""
        return tilted(self.plane)


def edges_of(plane: Plane, strands: list[Strand]) -> tuple[list[Edge], int]:
    """Cuts strands into edges; also returns how many of their pieces have a point for an image (self-motions)."""
    edges, points = [], 0
    for strand in strands:
        for u, path in _pieces(strand):
            if np.max(np.ptp(path, axis=0)) < ONE_POINT:
                points += 1
                continue
            turn = np.where(plane.glued, np.floor(np.mean(path, axis=0)), 0.0)
            order = slice(None, None, -1 if tilted(path[-1]) < tilted(path[0]) else 1)
            edges.append(Edge((strand.curve,), strand.sheet, u[order], path[order] - turn, turn))
    return edges, points


def _pieces(strand: Strand) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns unknowns and plane points between cuts, without points next to a cut that is nearly there."""
    cuts = np.flatnonzero(strand.cut)
    if len(cuts) == 0:
        return [(strand.u, strand.plane)]
    u, plane, cut = strand.u, strand.plane, strand.cut
    if strand.closed:  # Begin at a cut, so that no piece goes over the end of the list.
        shift_u, shift_plane = u[-1] - u[0], plane[-1] - plane[0]
        first = cuts[0]
        u = np.vstack([u[first:-1], u[: first + 1] + shift_u])
        plane = np.vstack([plane[first:-1], plane[: first + 1] + shift_plane])
        cut = np.concatenate([cut[first:-1], cut[: first + 1]])
        cut[-1] = True
        cuts = np.flatnonzero(cut)
    pieces = []
    for a, b in itertools.pairwise(cuts):
        inner = np.arange(a + 1, b)
        gaps = np.minimum(*(np.max(np.abs(u[inner] - u[end]), axis=1) for end in (a, b)))
        some = np.concatenate([[a], inner[gaps > 1e-7], [b]])
        if np.max(np.abs(u[a] - u[b])) > 1e-9 or len(some) > 2:
            pieces.append((u[some], plane[some]))
    return pieces


class Reached(NamedTuple):
    """Points of edges at abscissas.

    Attributes:
        u: Unknowns (of border edges not a number), ``(n, m)``.
        plane: ``(n, 2)``.
    """

    u: np.ndarray
    plane: np.ndarray


def at(plane: Plane, edges: list[Edge], which: np.ndarray, abscissas: np.ndarray) -> Reached:
    """Returns the points of edges at abscissas within them, polished: by Newton's steps inside a bracket."""
    dimension = plane.section.chart.dimension
    u, place = np.full((len(which), dimension), np.nan), np.empty((len(which), 2))
    share, lanes, spots = np.zeros(len(which)), [], []
    for number in np.unique(which):
        edge, own = edges[number], np.flatnonzero(which == number)
        grid = edge.abscissas
        k = np.clip(np.searchsorted(grid, abscissas[own], side="right") - 1, 0, len(grid) - 2)
        part = np.clip((abscissas[own] - grid[k]) / np.maximum(grid[k + 1] - grid[k], 1e-300), 0.0, 1.0)
        # The abscissa starts and ends like a square where the arc turns back.
        part = np.where(k == 0, np.sqrt(part), np.where(k == len(grid) - 2, 1.0 - np.sqrt(1.0 - part), part))
        if not edge.curves:
            straight = np.clip((abscissas[own] - grid[0]) / (grid[-1] - grid[0]), 0.0, 1.0)[:, None]
            place[own] = edge.plane[0] + straight * (edge.plane[-1] - edge.plane[0])
            continue
        share[own] = part
        lanes.append(own)
        spots.append(Spots(np.full(len(own), edge.sheet), edge.u[k], edge.u[k + 1]))
    if lanes:
        own = np.concatenate(lanes)
        found = Spots(*(np.concatenate(part) for part in zip(*spots, strict=True)))
        turns = np.array([edges[number].turn for number in which[own]])
        u[own], place[own] = _at_chords(plane, found, share[own], abscissas[own] + tilted(turns))
        place[own] -= turns
    return Reached(u, place)


def roughly(edges: list[Edge], which: np.ndarray, abscissas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the heights of the edges' broken lines at abscissas, and by how much the arcs may lie beside them."""
    heights, miss = np.empty(len(which)), np.empty(len(which))
    for number in np.unique(which):
        edge, own = edges[number], which == number
        grid = edge.abscissas
        k = np.clip(np.searchsorted(grid, abscissas[own], side="right") - 1, 0, len(grid) - 2)
        heights[own] = np.interp(abscissas[own], grid, edge.plane[:, 1])
        # Within its chord an arc turns by far less than a right angle.
        miss[own] = np.sum(np.abs(np.diff(edge.plane, axis=0)), axis=1)[k]
    return heights, miss


def _at_chords(plane: Plane, spots: Spots, share: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solves for the shares of chords at which the abscissa is the goal; along them it ascends."""
    low, high, share = np.zeros(len(share)), np.ones(len(share)), share.copy()
    u, place, rate = plane.along(spots, share)
    own = np.arange(len(share))
    for _ in range(40):
        miss = tilted(place[own]) - goal[own]
        high[own] = np.where(miss > 0, share[own], high[own])
        low[own] = np.where(miss > 0, low[own], share[own])
        with np.errstate(divide="ignore", invalid="ignore"):
            step = share[own] - miss / tilted(rate[own])
        inside = (step >= low[own]) & (step <= high[own])
        moved = np.where(inside, step, 0.5 * (low[own] + high[own]))
        going = (np.abs(miss) > 2e-15) & (np.abs(moved - share[own]) > 1e-15)
        own = own[going]
        if len(own) == 0:
            break
        share[own] = moved[going]
        u[own], place[own], rate[own] = plane.along(spots.of(own), share[own])
    return u, place


class Crossed(NamedTuple):
    """Where the images of two edges cross.

    Attributes:
        edges: ``(n, 2)`` numbers of the edges.
        u: ``(n, 2, m)`` unknowns on both.
        plane: ``(n, 2)`` where it is.
    """

    edges: np.ndarray
    u: np.ndarray
    plane: np.ndarray


def crossed(plane: Plane, edges: list[Edge], guesses: list[tuple[int, int, float]]) -> Crossed:
    """Solves for the crossings of images near guesses (two edges and an abscissa): Newton in both places at once."""
    if not guesses:
        return Crossed(np.zeros((0, 2), int), np.zeros((0, 2, plane.section.chart.dimension)), np.zeros((0, 2)))
    pairs = np.array([guess[:2] for guess in guesses])
    place = np.array([
        [np.interp(x, edges[number].abscissas, np.arange(len(edges[number].u))) for number in pair]
        for *pair, x in guesses
    ])  # fmt: skip
    last = np.array([[len(edges[number].u) - 1.0 for number in pair] for pair in pairs])
    turns = np.array([[edges[number].turn for number in pair] for pair in pairs])
    u, found, rates = _at_places(plane, edges, pairs, place)
    for _ in range(_NEWTON):
        moved = place - _newton_step(found - turns, rates)
        # Beyond an end there is nothing; a step that would lead there goes half of the way.
        place = np.where(moved < 0, 0.5 * place, np.where(moved > last, 0.5 * (place + last), moved))
        u, found, rates = _at_places(plane, edges, pairs, place)
    here = found - turns
    good = np.max(np.abs(here[:, 0] - here[:, 1]), axis=1) < _MEET
    good &= _apart(plane, u[:, 0], u[:, 1]) > _TWO_POSES
    return Crossed(pairs[good], u[good], np.mean(here, axis=1)[good])


def _newton_step(here: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Returns by how much both places are to be less, ``(n, 2)``: one chord at most, none where arcs are parallel."""
    miss = here[:, 0] - here[:, 1]
    (a, b), (c, d) = rates[:, 0].T, -rates[:, 1].T
    with np.errstate(divide="ignore", invalid="ignore"):
        step = (
            np.stack([d * miss[:, 0] - c * miss[:, 1], a * miss[:, 1] - b * miss[:, 0]], axis=1)
            / (a * d - b * c)[:, None]
        )
    return np.where(np.isfinite(step), np.clip(step, -1.0, 1.0), 0.0)


def _at_places(
    plane: Plane, edges: list[Edge], pairs: np.ndarray, place: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluates pairs of edges where they are told to, ``(n, 2, ...)`` each."""
    flat, spot = pairs.ravel(), place.ravel()
    chord = np.array([min(int(p), len(edges[number].u) - 2) for number, p in zip(flat, spot, strict=True)], int)
    spots = Spots(
        np.array([edges[number].sheet for number in flat], int),
        np.array([edges[number].u[k] for number, k in zip(flat, chord, strict=True)]),
        np.array([edges[number].u[k + 1] for number, k in zip(flat, chord, strict=True)]),
    )
    parts = plane.along(spots, spot - chord)
    u, found, rates = (part.reshape(len(pairs), 2, -1) for part in parts)
    return u, found, rates


def _apart(plane: Plane, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Returns how far apart configurations are on the glued space, ``(n,)``."""
    section = plane.section
    gap = np.max(np.abs(short_way(u - v, section.period)), axis=1, initial=0.0)
    if section.robot.twin is None or len(u) == 0:
        return gap
    return np.minimum(gap, np.max(np.abs(short_way(twins(section, u) - v, section.period)), axis=1))


def candidates(edges: list[Edge], pairs: list[tuple[int, int]]) -> list[tuple[int, int, float]]:
    """Returns where broken lines of edges cross, as two edges and an abscissa each."""
    found = []
    for i, j in pairs:
        a, b = edges[i], edges[j]
        xa, xb = a.abscissas, b.abscissas
        low, high = max(xa[0], xb[0]), min(xa[-1], xb[-1])
        overlap = np.max([a.plane.min(0), b.plane.min(0)], axis=0) <= np.min([a.plane.max(0), b.plane.max(0)], axis=0)
        if not low < high or not overlap.all():
            continue
        x = np.unique(np.concatenate([xa, xb]))
        x = x[(x >= low) & (x <= high)]
        gap = np.interp(x, xa, a.plane[:, 1]) - np.interp(x, xb, b.plane[:, 1])
        for k in np.flatnonzero(gap[:-1] * gap[1:] < 0):
            found.append((i, j, x[k] + (x[k + 1] - x[k]) * gap[k] / (gap[k] - gap[k + 1])))
    return found


def split(edges: list[Edge], places: dict[int, list[tuple[np.ndarray, np.ndarray]]]) -> list[Edge]:
    """Cuts edges at further points: for each edge a list of unknowns and plane points."""
    parts = []
    for number, edge in enumerate(edges):
        inner = [item for item in places.get(number, []) if _inside(edge, item[1])]
        ends = [
            (edge.u[0], edge.plane[0]),
            *sorted(inner, key=lambda item: tilted(item[1])),
            (edge.u[-1], edge.plane[-1]),
        ]
        grid = edge.abscissas
        for (ua, pa), (ub, pb) in itertools.pairwise(ends):
            own = (grid > tilted(pa)) & (grid < tilted(pb))
            own &= np.minimum(*(np.max(np.abs(edge.u - end), axis=1) for end in (ua, ub))) > 1e-7
            u, plane = (np.vstack([a, old[own], b]) for a, old, b in ((ua, edge.u, ub), (pa, edge.plane, pb)))
            parts.append(replace(edge, u=u, plane=plane))
    return parts


def _inside(edge: Edge, here: np.ndarray) -> bool:
    """True where a point of an edge is none of its ends."""
    return bool(min(np.max(np.abs(edge.plane[k] - here)) for k in (0, -1)) > ONE_POINT)


def coincident(plane: Plane, edges: list[Edge], gap: float = _ONE_ARC) -> list[Edge]:
    """Merges edges with the same ends that are one arc of the plane, traced from several poses."""
    kept: list[Edge] = []
    by_ends: dict[tuple[int, int], list[int]] = {}
    for edge in edges:
        rivals = by_ends.setdefault((edge.start, edge.end), [])
        x = edge.abscissas[0] + np.array([0.3, 0.5, 0.7]) * np.ptp(edge.abscissas)
        same = -1
        for number in rivals:
            pair = [edge, kept[number]]
            where = np.clip(x, kept[number].abscissas[0], kept[number].abscissas[-1])
            heights = at(plane, pair, np.repeat([0, 1], 3), np.concatenate([x, where])).plane[:, 1]
            if np.max(np.abs(heights[:3] - heights[3:])) < gap:
                same = number
                break
        if same < 0:
            rivals.append(len(kept))
            kept.append(edge)
        elif edge.curves:
            kept[same] = replace(kept[same], curves=(*kept[same].curves, *edge.curves))
    return kept


def with_vertices(edges: list[Edge]) -> tuple[list[Edge], np.ndarray]:
    """Gathers the ends of edges that are one point; returns the edges with numbered ends, and the ends ``(n, 2)``."""
    ends = np.array([edge.plane[k] for edge in edges for k in (0, -1)])
    number, points = np.full(len(ends), -1), np.empty((0, 2))
    for k, end in enumerate(ends):
        near = np.flatnonzero(np.max(np.abs(points - end), axis=1, initial=0.0) < ONE_POINT)
        number[k] = near[0] if len(near) else len(points)
        points = points if len(near) else np.vstack([points, end])
    joined = []
    for k, edge in enumerate(edges):
        start, end = int(number[2 * k]), int(number[2 * k + 1])
        path = edge.plane.copy()
        path[0], path[-1] = points[start], points[end]
        joined.append(replace(edge, plane=path, start=start, end=end))
    return joined, points


def areas_under(plane: Plane, edges: list[Edge]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the integral of the second plane coordinate over the first along each edge, and its estimated error.

    Gauss's rule in the share of the chord, which is a smooth parameter also where the image turns back or has a cusp;
    two orders are compared, and parts of chords on which they differ are halved. Next to a crossing of curves points
    are the less sharp the nearer they are: a part whose halves differ no less is kept whole.
    """
    value = np.array([0.0 if edge.curves else _straight(edge) for edge in edges])
    error = np.zeros(len(edges))
    own = [number for number, edge in enumerate(edges) if edge.curves]
    if not own:
        return value, error
    parts = _chords(edges, own)
    area, gap = _gauss(plane, parts)
    for halving in range(_HALVINGS + 1):
        done = (gap < _CHORD_ERROR) | (halving == _HALVINGS)
        halves = parts.halves(~done)
        areas, gaps = _gauss(plane, halves)
        blurred = np.zeros_like(done)
        blurred[~done] = (gap[~done] < _BLURRED) & (_of_both(gaps) >= gap[~done])
        gap[~done] += np.where(blurred[~done], np.abs(_of_both(areas) - area[~done]), 0.0)
        going = ~np.tile(blurred[~done], 2)
        done |= blurred
        np.add.at(value, parts.owner[done], area[done])
        np.add.at(error, parts.owner[done], gap[done] + 4e-16 * np.abs(area[done]))
        parts, area, gap = halves.of(going), areas[going], gaps[going]
        if not going.any():
            break
    return value, error


#: Gauss's rules on [0, 1], the better one first.
_RULES = tuple(((nodes + 1) / 2, weights / 2) for nodes, weights in map(np.polynomial.legendre.leggauss, (4, 3)))
#: Parts of chords on which both rules differ by less are not halved any more, and how often they are at most.
_CHORD_ERROR, _HALVINGS = 1e-13, 8
#: Only where both rules differ by less than this may rounding be what they differ by.
_BLURRED = 1e-10


class _Parts(NamedTuple):
    """Parts of the chords of edges.

    Attributes:
        spots: The chords, ``n`` of them.
        owner: ``(n,)`` numbers of the edges.
        turn: ``(n,)`` whole turns of the edges in the second plane coordinate.
        low: ``(n,)`` shares of the chords where the parts begin.
        high: ``(n,)`` shares where they end.
    """

    spots: Spots
    owner: np.ndarray
    turn: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def of(self, some: np.ndarray) -> "_Parts":
        """Returns some of them."""
        return _Parts(self.spots.of(some), *(column[some] for column in self[1:]))

    def halves(self, some: np.ndarray) -> "_Parts":
        """Returns the first halves of some of them, then the second halves."""
        parts = self.of(some)
        middle = 0.5 * (parts.low + parts.high)
        twice = parts.of(np.tile(np.arange(len(middle)), 2))
        low, high = np.concatenate([parts.low, middle]), np.concatenate([middle, parts.high])
        return twice._replace(low=low, high=high)


def _of_both(halves: np.ndarray) -> np.ndarray:
    return halves.reshape(2, -1).sum(axis=0)


def _chords(edges: list[Edge], own: list[int]) -> _Parts:
    owner = np.repeat(own, [len(edges[number].u) - 1 for number in own])
    spots = Spots(
        np.array([edges[number].sheet for number in owner]),
        np.concatenate([edges[number].u[:-1] for number in own]),
        np.concatenate([edges[number].u[1:] for number in own]),
    )
    turn = np.array([edges[number].turn[1] for number in owner])
    return _Parts(spots, owner, turn, np.zeros(len(owner)), np.ones(len(owner)))


def _straight(edge: Edge) -> float:
    return float(np.mean(edge.plane[:, 1]) * (edge.plane[1, 0] - edge.plane[0, 0]))


def _gauss(plane: Plane, parts: _Parts) -> tuple[np.ndarray, np.ndarray]:
    """Returns the areas under parts of chords by the better rule, and by how much the other one differs."""
    fine, coarse = (_by_rule(plane, parts, nodes, weights) for nodes, weights in _RULES)
    return fine, np.abs(fine - coarse)


def _by_rule(plane: Plane, parts: _Parts, nodes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    count, k = len(parts.low), len(nodes)
    size = parts.high - parts.low
    s = parts.low[:, None] + size[:, None] * nodes
    _, place, rate = plane.along(parts.spots.of(np.repeat(np.arange(count), k)), s.ravel())
    height = place[:, 1].reshape(count, k) - parts.turn[:, None]
    return size * np.sum(weights * height * rate[:, 0].reshape(count, k), axis=1)
