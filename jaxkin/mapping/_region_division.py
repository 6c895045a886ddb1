"""From the singular curves of a section to the division of its plane: vertices, arcs, their order."""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from jaxkin.mapping._arrangement import Division, Graph, divide, graph
from jaxkin.mapping._region_edges import (
    Crossed,
    Edge,
    at,
    candidates,
    coincident,
    crossed,
    edges_of,
    split,
    with_vertices,
)
from jaxkin.mapping._region_paths import ONE_POINT, Plane, cut_up, refined, strands_of, tilted
from jaxkin.mapping.records import SingularCurves

#: Where over each slab, in shares of it, the order of the arcs is looked at; the first decides.
_LOOKS = (0.5, 0.07, 0.93)
#: How often crossings that the orders betray are sought.
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Divided:
    """The plane of a section, divided.

    Attributes:
        plane: The plane.
        edges: Its arcs, borders included.
        vertices: ``(n, 2)`` plane points.
        shape: The graph.
        order: The arcs over each slab, from below.
        division: Its regions.
        nodes: Where images of different poses cross.
        evidence: What is in doubt, by name.
    """

    plane: Plane
    edges: list[Edge]
    vertices: np.ndarray
    shape: Graph
    order: list[list[int]]
    division: Division
    nodes: Crossed
    evidence: dict[str, int]


def divided(plane: Plane, curves: SingularCurves) -> Divided:
    """Divides the plane of a section by the images of its singular curves."""
    strands = cut_up(plane, refined(plane, strands_of(plane, curves)))
    edges, points = edges_of(plane, strands)
    edges = coincident(plane, with_vertices(_snapped(plane, edges))[0]) if edges else []
    guesses = candidates(edges, list(itertools.combinations(range(len(edges)), 2)))
    first = _new(edges, crossed(plane, edges, guesses))
    nodes, lost = first, 0
    edges, vertices = _with_borders(plane, _cut_at(edges, first))
    shape, order, guesses = _ordered(plane, edges, vertices)
    for _ in range(_ROUNDS):
        if not guesses:
            break
        found = _new(edges, crossed(plane, edges, guesses))
        lost = len(guesses) - len(found.plane)
        nodes = Crossed(*(np.concatenate(pair) for pair in zip(nodes, found, strict=True)))
        edges, vertices = _with_borders(plane, _cut_at([edge for edge in edges if edge.curves], found))
        shape, order, guesses = _ordered(plane, edges, vertices)
    division = divide(shape, order, _glue(plane, edges))
    evidence = {
        "curves over one joint point": points,
        "crossings of images that were not found": lost if guesses else 0,
        "contradictory orders of arcs": division.contradictions,
        "arcs too short to be placed": len(shape.upright),
    }
    return Divided(plane, edges, vertices, shape, order, division, nodes, evidence)


def _snapped(plane: Plane, edges: list[Edge]) -> list[Edge]:
    """Puts ends that lie on a border by rounding onto it."""
    moved = []
    for edge in edges:
        path = edge.plane.copy()
        for k in (0, -1):
            for border in (0.0, 1.0):
                path[k] = np.where(np.abs(path[k] - border) < ONE_POINT, border, path[k])
        moved.append(replace(edge, plane=path))
    return moved


def _new(edges: list[Edge], found: Crossed) -> Crossed:
    """Drops crossings that are a common end of both edges, or listed twice."""
    keep: list[int] = []
    for k, (pair, here) in enumerate(zip(found.edges, found.plane, strict=True)):
        ends = [{edges[number].start, edges[number].end} for number in pair]
        common = [
            edges[number].plane[0 if edges[number].start == vertex else -1]
            for number in pair[:1]
            for vertex in ends[0] & ends[1]
        ]
        if any(np.max(np.abs(point - here)) < 1e-7 for point in common):
            continue
        if any(set(found.edges[j]) == set(pair) and np.max(np.abs(found.plane[j] - here)) < ONE_POINT for j in keep):
            continue
        keep.append(k)
    return Crossed(*(part[keep] for part in found))


def _with_borders(plane: Plane, edges: list[Edge]) -> tuple[list[Edge], np.ndarray]:
    """Adds the borders of the square; returns the edges with numbered ends, and the vertices."""
    joined, vertices = with_vertices([*edges, *_borders(plane, edges)])
    return coincident(plane, joined), vertices


def _cut_at(edges: list[Edge], found: Crossed) -> list[Edge]:
    places: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
    for pair, u, here in zip(found.edges, found.u, found.plane, strict=True):
        for number, point in zip(pair, u, strict=True):
            places.setdefault(int(number), []).append((point, here))
    return split(edges, places)


def _borders(plane: Plane, edges: list[Edge]) -> list[Edge]:
    """Returns the four sides of the square, cut where edges end on them."""
    ends = np.array([edge.plane[k] for edge in edges for k in (0, -1)]).reshape(-1, 2)
    sides = []
    for axis, border in itertools.product((0, 1), (0.0, 1.0)):
        on = np.unique(np.concatenate([[0.0, 1.0], ends[ends[:, axis] == border, 1 - axis]]))
        on = on[np.concatenate([[True], np.diff(on) > ONE_POINT])]
        on[-1] = 1.0
        for low, high in itertools.pairwise(on):
            path = np.full((2, 2), border)
            path[:, 1 - axis] = low, high
            sides.append(Edge((), 0, np.full((2, plane.section.chart.dimension), np.nan), path, np.zeros(2)))
    return sides


def _ordered(
    plane: Plane, edges: list[Edge], vertices: np.ndarray
) -> tuple[Graph, list[list[int]], list[tuple[int, int, float]]]:
    """Orders the arcs over every slab; returns also where two orders over one slab betray a crossing."""
    start, end = (np.array([getattr(edge, name) for edge in edges]) for name in ("start", "end"))
    shape = graph(tilted(vertices), vertices[:, 1], start, end)
    live = shape.live
    which = np.concatenate([np.tile(arcs, len(_LOOKS)) for arcs in live])
    shares = np.concatenate([np.repeat(_LOOKS, len(arcs)) for arcs in live])
    slab = np.concatenate([np.full(len(_LOOKS) * len(arcs), k) for k, arcs in enumerate(live)])
    x = shape.bounds[slab] + shares * np.diff(shape.bounds)[slab]
    heights = at(plane, edges, which, x).plane[:, 1]
    order, crossings, first = [], [], 0
    for k, arcs in enumerate(live):
        here = heights[first : first + len(_LOOKS) * len(arcs)].reshape(len(_LOOKS), -1)
        first += here.size
        line = np.argsort(here[0], kind="stable")
        order.append([int(arc) for arc in arcs[line]])
        for other, share in zip(here[1:], _LOOKS[1:], strict=True):
            gaps = np.diff(other[line])
            for j in np.flatnonzero(gaps < -1e-12):
                middle = shape.bounds[k] + 0.5 * (share + _LOOKS[0]) * (shape.bounds[k + 1] - shape.bounds[k])
                crossings.append((int(arcs[line[j]]), int(arcs[line[j + 1]]), float(middle)))
    return shape, order, crossings


def _glue(plane: Plane, edges: list[Edge]) -> list[tuple[tuple[int, bool], tuple[int, bool]]]:
    """Returns pairs of sides of border arcs that are one place, as a joint runs over its whole period."""
    pairs = []
    for axis in np.flatnonzero(plane.glued):
        ends: list[list[tuple[int, float, float]]] = [[], []]
        for number, edge in enumerate(edges):
            for side, border in enumerate((0.0, 1.0)):
                if not edge.curves and np.all(edge.plane[:, axis] == border):
                    ends[side].append((number, *edge.plane[:, 1 - axis]))
        # The square lies above its lower and its right side, and below the others.
        above = [axis == 1, axis == 0]
        for (i, a, b), (j, c, d) in itertools.product(*ends):
            if min(b, d) - max(a, c) > 2 * ONE_POINT:
                pairs.append(((i, above[0]), (j, above[1])))
    return pairs
