"""Traces the singular set of a section in the unknowns of its chart, and holds it against independent searches."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jax import Array

from jaxkin.core.errors import GeometryError
from jaxkin.mapping import search
from jaxkin.mapping.assembly import Arc, Network, arcs_of, distance_to_arcs
from jaxkin.mapping.batch import over_points
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.section import Section
from jaxkin.numerics import continuation, newton
from jaxkin.numerics.continuation import LEFT, REACHED, STUCK

#: So far from a crossing (dimensionless) the tracer takes over from the straight line through it.
_AWAY = 1e-3
#: How many seeds are traced from at once.
_SEEDS = 96
#: Shorter tangents (dimensionless) are none; points farther apart than this are at different places; and so many places
#: without a tangent are no crossings any more.
_NO_TANGENT, _APART, _PLACES = 1e-5, 1e-2, 24
#: Longest steps of successive attempts: a jump between branches is answered by shorter steps.
_STEPS = (continuation.LONGEST_STEP, 0.015, 0.004)
#: Points with a smaller margin lie on the border.
_TOUCH = 1e-9
#: A point lies on a traced segment if it is nearer than this share of the segment's length.
_COVERED = 1e-3


@dataclass(frozen=True)
class Traced:
    """The singular set of a section in the unknowns of its chart.

    Attributes:
        arcs: Smooth arcs, ending at borders and crossings.
        tangents: The oriented unit tangents at their points, one array an arc; zero at crossings.
        crossings: ``(n, m)``.
        isolated: ``(i, m)`` points where the gradient vanishes as well, and no branch passes: components by themselves.
        evidence: What speaks for completeness, by name.
    """

    arcs: list[Arc]
    tangents: list[np.ndarray]
    crossings: np.ndarray
    isolated: np.ndarray
    evidence: dict[str, Any]


def trace_section(section: Section) -> Traced:
    """Traces all singular curves of a section.

    Two searches from different starts, and one for the ends on the borders, say where the curves are; what they find on
    no traced curve is traced from, until nothing is left.
    """
    first = search.seeds_on_curves(section, part=0)
    nodes, directions = search.crossings(section, first)
    _refuse_double(section, first)
    second = search.seeds_on_curves(section, part=1)
    edges = search.seeds_on_borders(section, first)
    found = np.concatenate([first, second, edges])
    seeds, rounds, attempt = first, 0, 0
    while True:
        network = _network(section, seeds, nodes, directions, _STEPS[attempt])
        if network.contradictions and attempt + 1 < len(_STEPS):
            # The tracer gets stuck at a crossing that the search has missed, and says where it is.
            before = len(nodes)
            nodes, directions = search.crossings(section, np.concatenate([first, _stuck(section, network)]))
            attempt += len(nodes) <= before
            continue
        arcs = arcs_of(network)
        tangents = _tangents(section, arcs)
        gap, size = distance_to_arcs(found, arcs, tangents, section.period)
        missed = found[gap > _COVERED * size + 1e-7]
        rounds += 1
        if rounds > 1 and len(missed):
            # What no arc starts from, after a try, and lies on the border, only touches the box.
            missed = missed[np.min(search.margins(section, missed), axis=1) > _TOUCH]
        missed = missed[~search.near(section, missed, nodes, _AWAY)]
        if len(missed) == 0 or rounds == 6:
            break
        seeds = np.concatenate([missed, seeds])
    ends = [arc.points[k] for arc in arcs for k, end in ((0, arc.start), (-1, arc.end)) if end.kind == "border"]
    met = search.near(section, np.array(ends).reshape(len(ends), section.chart.dimension), edges)
    evidence = {
        "points found by independent searches": len(found),
        "of these on no traced curve": len(missed),
        "ends on borders: traced, found by a search of their own": [len(ends), int(np.sum(met))],
        "contradictory pieces": network.contradictions,
    }
    alone = ~np.all(np.isfinite(directions), axis=(1, 2))
    return Traced(arcs, tangents, nodes[~alone], nodes[alone], evidence)


def _refuse_double(section: Section, seeds: np.ndarray) -> None:
    """Raises where the singular set is double, or a surface, along a whole curve: it has no tangent there."""
    sizes = np.sqrt(np.sum(over_points(_tangent, section.chart, section.data, seeds) ** 2, axis=1))
    double = seeds[~(sizes > _NO_TANGENT)]
    # Starts in a wide neighbourhood all arrive at an isolated point, which is one place.
    places = len(search.distinct(section, double, _APART)) if len(double) > _PLACES else 0
    if places > _PLACES:
        raise GeometryError(
            f"{section.who}: over {section.describe()} the singular set has no tangent at {len(double)} of "
            f"{len(seeds)} singular poses that were looked at, {places} places: the section holds a whole curve of "
            "self-motions, or a curve on which the determinant vanishes to second order, and no curve can be told "
            "from another there; change a length of the mechanism or a fixed value a little (by 1e-3, say), or keep "
            "the free ranges away from it."
        )


def whole_curves(section: Section, strands: list[Arc]) -> list[Arc]:
    """Returns curves, one of the two that are the same configurations by different triples of angles."""
    if not section.has_twins:
        return strands
    kept: list[Arc] = []
    for strand in strands:
        middle = search.twins(section, strand.points[[len(strand.points) // 2]])
        gap, size = distance_to_arcs(middle, kept, _tangents(section, kept), section.period)
        if not gap[0] <= _COVERED * size[0] + 1e-7:
            kept.append(strand)
    return kept


def _stuck(section: Section, network: Network) -> np.ndarray:
    """Returns where tracers got stuck, often enough for a search from some of the points to try them all."""
    pieces = [*network.forward.values(), *network.backward.values()]
    points = [piece.points[-1] for piece in pieces if piece.state == STUCK]
    return np.repeat(np.array(points).reshape(len(points), section.chart.dimension), 8, axis=0)


def _network(
    section: Section, candidates: np.ndarray, nodes: np.ndarray, directions: np.ndarray, longest: float
) -> Network:
    """Traces from seeds to seeds, along the orientation, and against it from seeds that nothing reached."""
    seeds, halves = _seeds(section, candidates, nodes, directions)
    chart, data = section.chart, section.data

    def trace(starts: list[tuple[int, int]]) -> list[continuation.Piece]:
        return continuation.trace(chart.singular, chart.margins, data, seeds, section.period, starts, longest=longest)

    inward = {seed for seed, (_, _, out) in halves.items() if not out}
    forward = {piece.source: piece for piece in trace([(k, 1) for k in range(len(seeds)) if k not in inward])}
    reached = {piece.target for piece in forward.values() if piece.state == REACHED}
    lonely = [k for k in range(len(seeds)) if k not in reached and not (k in halves and halves[k][2])]
    backward = {piece.source: piece for piece in trace([(k, -1) for k in lonely])}
    left = [piece for piece in (*forward.values(), *backward.values()) if piece.state == LEFT]
    borders = _borders(section, left)
    return Network(seeds, halves, forward, backward, borders, nodes, section.period)


def _seeds(
    section: Section, candidates: np.ndarray, nodes: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, dict[int, tuple[int, int, bool]]]:
    """Chooses the seeds: the four half-branches of every crossing, and candidates apart from them."""
    plain = candidates[: 4 * _SEEDS]
    plain = plain[search.distinct(section, plain)]
    plain = plain[~search.near(section, plain, nodes, 2 * _AWAY)][:_SEEDS]
    guesses, keys = [], []
    for number, (node, pair) in enumerate(zip(nodes, directions, strict=True)):
        for half, direction in enumerate((pair[0], -pair[0], pair[1], -pair[1])):
            if np.all(np.isfinite(direction)):  # An isolated point has no branches.
                guesses.append(node + _AWAY * direction)
                keys.append((number, half))
    if not guesses:
        return plain, {}
    points, tangents = over_points(_to_curve, section.chart, section.data, np.array(guesses))
    halves = {}
    for k, (number, half) in enumerate(keys):
        outward = float(np.dot(tangents[k], points[k] - nodes[number])) > 0
        halves[len(plain) + k] = (number, half, outward)
    return np.concatenate([plain, points]), halves


def _to_curve(chart: Chart, data: SectionData, u: Array) -> tuple[Array, Array]:
    u = newton.polish(lambda u: chart.singular(data, u), u, steps=6)
    return u, chart.tangent(data, u)


def _borders(section: Section, left: list[continuation.Piece]) -> dict[tuple[int, int], tuple[np.ndarray, int]]:
    """Returns the point where each piece leaves the box, solved for on the border."""
    if not left:
        return {}
    inside = np.array([piece.points[-1] for piece in left])
    outside = np.array([piece.outside for piece in left])
    before, after = search.margins(section, inside), search.margins(section, outside)
    rows = np.arange(len(left))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(after < 0, before / (before - after), np.inf)
    edges = np.argmin(shares, axis=1)  # The border that is crossed first.
    share = shares[rows, edges]
    guesses = inside + np.clip(share, 0.0, 1.0)[:, None] * (outside - inside)
    points, good = search.border_points(section, guesses, edges)
    near = np.max(np.abs(points - guesses), axis=1) < continuation.LONGEST_STEP
    return {
        (piece.source, piece.sign): (points[k], int(edges[k])) for k, piece in enumerate(left) if good[k] and near[k]
    }


def _tangent(chart: Chart, data: SectionData, u: Array) -> Array:
    return chart.tangent(data, u)


def _tangents(section: Section, arcs: list[Arc]) -> list[np.ndarray]:
    """Returns oriented unit tangents at all points of the arcs; at a crossing a zero vector."""
    if not arcs:
        return []
    points = np.concatenate([arc.points for arc in arcs])
    tangents = over_points(_tangent, section.chart, section.data, points)
    size = np.sqrt(np.sum(tangents**2, axis=1, keepdims=True))
    units = np.where(size > 1e-10, tangents / np.where(size > 0, size, 1.0), 0.0)
    return np.split(units, np.cumsum([len(arc.points) for arc in arcs])[:-1])
