"""Where cusp curves are: points from spread starts, on the borders of the box, and critical points of the joints.

Along a closed curve every joint has two critical points at least, and an open curve ends on a border: these points,
if all are found, lie on every component.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxkin.mapping import _cusp_curve_equations as equations
from jaxkin.mapping import search
from jaxkin.mapping._cusp_curve_continuation import Chain, Rules, chains_of, directions_at, trace
from jaxkin.mapping._cusp_curve_equations import Sheet
from jaxkin.mapping.assembly import CLOSED, Arc, End, distance_to_arcs
from jaxkin.mapping.batch import over_points
from jaxkin.numerics.newton import lattice

RULES = Rules(equations.cusp, equations.margins)

#: Residual at which a point counts as found; it is polished further.
FOUND = 1e-10
#: Slope of det A, over its size, below which a root is a crossing of the singular set and no cusp.
_FLAT = 1e-5
#: A point where another factor is smaller than this is a crossing.
_OTHER = 1e-6
#: Starts of a search; first seeds are so far apart; at most so many are traced from at once.
_STARTS, _APART, _SEEDS = 1024, 0.3, 48
#: Critical points are sought from so many cusps for each joint, border points for each border.
_CRITICAL, _BORDER = 192, 96
#: A point lies on a traced segment if it is nearer than this share of the segment's length.
_COVERED = 1e-3
#: Points with a smaller margin lie on the border.
_TOUCH = 1e-9


class Traced(NamedTuple):
    """The cusp curves of one sheet, as far as the box and one point beyond.

    Attributes:
        chains: The curves.
        critical: ``(n, m)`` critical points of any joint, inside the box, from starts of their own.
        evidence: What speaks for completeness, by name.
    """

    chains: list[Chain]
    critical: np.ndarray
    evidence: dict[str, Any]


def trace_sheet(sheet: Sheet, longest: float) -> Traced:
    """Traces all cusp curves of a sheet; what the searches find on no curve is traced from, until nothing is left."""
    section = sheet.section
    first, second = (cusp_points(sheet, part) for part in (0, 1))
    found = np.concatenate([first, second])
    critical = critical_points(sheet, found)
    edges = border_points(sheet, found)
    marks = np.concatenate([edges, critical])
    everything = np.concatenate([marks, found])
    seeds = marks[search.distinct(section, marks)][: _SEEDS // 2]
    spread = found[~search.near(section, found, seeds, _APART)]
    seeds = np.concatenate([seeds, spread[search.distinct(section, spread, _APART)]])[:_SEEDS]
    chains: list[Chain] = []
    missed, contradictions = everything, 0
    for _ in range(6):
        pieces = trace(RULES, sheet.chart, sheet.data, seeds, section.period, longest=longest)
        chains, contradictions = chains_of(pieces, section.period)
        missed = _uncovered(sheet, chains, everything)
        if contradictions:
            longest = 0.4 * longest
        elif len(missed) == 0:
            break
        more = missed[search.distinct(section, missed, 1e-3)][: _SEEDS // 3]
        seeds = np.concatenate([more, seeds])
    evidence = {
        "points found by independent searches": len(everything),
        "of these on no traced curve": len(missed),
        "contradictory pieces": contradictions,
    }
    return Traced(chains, critical, evidence)


def cusp_points(sheet: Sheet, part: int) -> np.ndarray:
    """Returns points of the cusp curves inside the box, ``(k, m)``, from one of several sets of starts."""
    u, residual, margin = over_points(equations.project, sheet.chart, sheet.data, _starts(sheet, part))
    good = (residual <= FOUND) & (margin >= 0)
    return _cusps_only(sheet, search.glued(sheet.section, u[good]))


def _starts(sheet: Sheet, part: int) -> np.ndarray:
    """Returns half of the starts spread over the poses of the box, half denser towards the mechanism itself.

    Most of what happens happens where legs are as long as the mechanism is large; in a wide box that is a small part.
    """
    section, half = sheet.section, _STARTS // 2
    low, high = np.min(section.samples, axis=0), np.max(section.samples, axis=0)
    unit = 2 * lattice(4 * half, len(low))[part::4] - 1
    middle, reach = 0.5 * (low + high), 0.5 * (high - low)
    steep = np.arcsinh(np.maximum(reach, 1e-3))
    warped = np.where(np.isfinite(section.period), unit, np.sinh(steep * unit) / np.sinh(steep))
    return np.concatenate([search.starting_points(section, part)[:half], middle + reach * warped])


def _cusps_only(sheet: Sheet, u: np.ndarray) -> np.ndarray:
    """Returns the points at which the singular set does not cross itself."""
    if len(u) == 0:
        return u
    flat = over_points(equations.gradient_share, sheet.chart, sheet.data, u)
    others = over_points(equations.other_factors, sheet.chart, sheet.data, u)
    return u[(flat > _FLAT) & np.all(np.abs(others) > _OTHER, axis=1)]


def critical_points(sheet: Sheet, found: np.ndarray) -> np.ndarray:
    """Returns critical points of each free joint on the cusp curves inside the box, ``(k, m)``, from spread cusps."""
    m = sheet.chart.dimension
    if len(found) == 0:
        return np.zeros((0, m))
    some = found[np.linspace(0, len(found) - 1, _CRITICAL).astype(int)]
    directions = directions_at(equations.cusp, sheet.chart, sheet.data, some)
    axes = np.repeat(np.eye(3), len(some), axis=0)
    columns = np.tile(some, (3, 1)), np.tile(directions, (3, 1)), axes
    u, _, residual = over_points(equations.seek_critical, sheet.chart, sheet.data, *columns)
    return _inside(sheet, u[residual <= FOUND])


def _inside(sheet: Sheet, u: np.ndarray) -> np.ndarray:
    """Returns distinct cusps inside the box."""
    if len(u):
        u = u[np.min(over_points(equations.margins, sheet.chart, sheet.data, u), axis=1) >= 0]
    u = _cusps_only(sheet, search.glued(sheet.section, u))
    return u[search.distinct(sheet.section, u)]


def border_points(sheet: Sheet, found: np.ndarray) -> np.ndarray:
    """Returns cusps on the borders of the box, ``(k, m)``: each border is a section, whose cusps these are."""
    some = np.concatenate([found[:: max(1, len(found) // _BORDER)], _starts(sheet, 2)[:: 4 * _STARTS // (4 * _BORDER)]])
    edges = np.repeat(np.arange(2 * len(sheet.chart.kinds)), len(some))
    guesses = np.tile(some, (2 * len(sheet.chart.kinds), 1))
    u, residual, margin = over_points(equations.on_border, sheet.chart, sheet.data, guesses, edges)
    u = search.glued(sheet.section, u[(residual <= FOUND) & (margin >= -search.EDGE_SLACK)])
    u = _cusps_only(sheet, u)
    return u[search.distinct(sheet.section, u)]


def arcs_with_tangents(sheet: Sheet, chains: list[Chain]) -> tuple[list[Arc], list[np.ndarray]]:
    """Returns chains as arcs, with unit tangents at their points, for ``distance_to_arcs``."""
    if not chains:
        return [], []
    end = End("border")
    arcs = [Arc(c.points, CLOSED if c.closed else end, CLOSED if c.closed else end) for c in chains]
    tangents = directions_at(equations.cusp, sheet.chart, sheet.data, np.concatenate([a.points for a in arcs]))
    return arcs, np.split(tangents, np.cumsum([len(arc.points) for arc in arcs])[:-1])


def _uncovered(sheet: Sheet, chains: list[Chain], points: np.ndarray) -> np.ndarray:
    """Returns the points on no chain; what touches the box from outside in one point is none."""
    arcs, tangents = arcs_with_tangents(sheet, chains)
    gap, size = distance_to_arcs(points, arcs, tangents, sheet.section.period)
    missed = points[gap > _COVERED * size + 1e-7]
    if chains and len(missed):
        margin = np.min(over_points(equations.margins, sheet.chart, sheet.data, missed), axis=1)
        missed = missed[margin > _TOUCH]
    return missed
