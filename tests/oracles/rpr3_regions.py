"""Areas and number of the regions of a section's joint plane by number of assembly modes, by quadrature.

A line of the section (one free leg fixed as well) is cut by the singular curves in finitely many points, which a
*family* of `rpr3_region_curves` gives. Between the abscissas at which their order changes the lengths of the gaps are
smooth but for square roots at the ends; Gauss's rule under a cubic substitution integrates them to rounding. Counts
come from one line a panel.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .rpr3_region_curves import AnalyticSection, GeneralSection
from .rpr3_torus import REFERENCE

DATA = Path(__file__).parents[1] / "data" / "rpr3_region_areas.json"

#: Maps n abscissas to an (n, k) array of ordinates, nan where a root does not exist.
Family = Callable[[np.ndarray], np.ndarray]
Range = tuple[float, float]


class Region(NamedTuple):
    """A connected region of constant number of modes.

    Attributes:
        count: Number of assembly modes.
        area: Its area within the box.
        error: Difference of two orders of quadrature.
        point: A point inside, abscissa and ordinate.
    """

    count: int
    area: float
    error: float
    point: tuple[float, float]


# --- any family --------------------------------------------------------------------------------------------------


def regions(family: Family, count: Callable[[float, float], int], xs: Range, ys: Range, lines: int) -> list[Region]:
    """Returns the regions of a box, by count and descending area.

    Args:
        family: The singular curves.
        count: The number of modes at a point.
        xs: Range of the abscissa.
        ys: Range of the ordinate.
        lines: Number of lines between which changes of order are looked for.
    """

    def clipped(x: np.ndarray) -> np.ndarray:
        found = family(x)
        with np.errstate(invalid="ignore"):
            return np.where((found > ys[0]) & (found < ys[1]), found, np.nan)

    cuts = [xs[0], *_changes(clipped, xs, lines), xs[1]]
    strips = [_Strip(clipped, count, span, ys) for span in pairwise(cuts) if span[1] - span[0] > 1e-11]
    parent = {(i, j): (i, j) for i, strip in enumerate(strips) for j in range(len(strip.counts))}

    def find(node: tuple[int, int]) -> tuple[int, int]:
        while parent[node] != node:
            node = parent[node]
        return node

    # Strips as narrow as the scatter of a bisection at a tangency join nothing; their gaps go where they overlap most.
    wide = [i for i, strip in enumerate(strips) if strip.span[1] - strip.span[0] > 1e-6]
    for i, m in pairwise(wide):
        for j, k, overlap in _overlaps(strips[i], strips[m]):
            if overlap > 1e-4 * (ys[1] - ys[0]):
                parent[find((i, j))] = find((m, k))
    for i in set(range(len(strips))) - set(wide):
        m = max((n for n in wide if n < i), default=wide[0])
        best = {}
        for k, j, overlap in _overlaps(strips[m], strips[i]):
            best[j] = max(best.get(j, (0.0, 0)), (overlap, k))
        for j, (_, k) in best.items():
            parent[find((i, j))] = find((m, k))
    groups: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for node in parent:
        groups.setdefault(find(node), []).append(node)
    found = []
    for nodes in groups.values():
        fine = sum(strips[i].areas[j] for i, j in nodes)
        coarse = sum(strips[i].coarse[j] for i, j in nodes)
        i, j = max(nodes, key=lambda node: strips[node[0]].areas[node[1]])
        found.append(Region(strips[i].counts[j], float(fine), float(abs(fine - coarse)), strips[i].points[j]))
    return sorted((r for r in found if r.area > 1e-9), key=lambda region: (region.count, -region.area))


def _overlaps(left: _Strip, right: _Strip) -> list[tuple[int, int, float]]:
    """Returns pairs of gaps with equal counts, and how far they overlap where the strips meet."""
    after = right.gaps(0)
    return [
        (j, k, min(q, v) - max(p, u))
        for j, (p, q) in enumerate(left.gaps(1))
        for k, (u, v) in enumerate(after)
        if left.counts[j] == right.counts[k]
    ]


def _orders(values: np.ndarray) -> list[bytes]:
    """Returns the order of the existing roots of every line."""
    order = np.argsort(values, axis=1)  # nan last
    order[np.isnan(np.take_along_axis(values, order, axis=1))] = -1
    return [row.astype(np.int16).tobytes() for row in order]


def _changes(family: Family, xs: Range, lines: int) -> list[float]:
    """Returns the abscissas at which the order changes, bisected to rounding."""
    # Slightly uneven lines: symmetric sections would put events on even ones.
    x = xs[0] + (xs[1] - xs[0]) * (np.arange(lines + 1) / lines + 1e-3 / lines * np.sin(np.arange(lines + 1.0)))
    x[0], x[-1] = xs[0] + 1e-9, xs[1] - 1e-9
    found: list[float] = []
    orders = _orders(family(x))
    brackets = [(p, q, a, b) for (p, q), (a, b) in zip(pairwise(x), pairwise(orders), strict=True) if a != b]
    while brackets:
        low, high = (np.array([bracket[k] for bracket in brackets]) for k in (0, 1))
        first = [bracket[2] for bracket in brackets]
        for _ in range(50):
            middle = (low + high) / 2
            same = np.array([a == b for a, b in zip(_orders(family(middle)), first, strict=True)])
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        found += ((low + high) / 2).tolist()
        # What lies beyond: a bracket may hold several changes.
        beyond = high + 1e-9
        orders = _orders(family(np.minimum(beyond, xs[1] - 1e-9)))
        brackets = [
            (p, q, a, b) for p, (_, q, _, b), a in zip(beyond, brackets, orders, strict=True) if p < q and a != b
        ]
    return sorted(found)


class _Strip:
    """The gaps between two changes of order; neighbouring gaps with equal counts (virtual curves) are one."""

    def __init__(self, family: Family, count: Callable[[float, float], int], span: Range, ys: Range) -> None:
        self.family, self.span, self.ys = family, span, ys
        middle = sum(span) / 2
        ends = self._ends(np.array([middle]))[0]
        counts = [count(middle, float(sum(gap) / 2)) for gap in pairwise(ends)]
        self.starts = [0, *(j for j in range(1, len(counts)) if counts[j] != counts[j - 1])]
        self.counts = [counts[j] for j in self.starts]
        self.points = [(middle, float(sum(gap) / 2)) for gap in self._merged(ends[None])[0]]
        self.areas, self.coarse = self._integrated(40), self._integrated(28)

    def _ends(self, x: np.ndarray) -> np.ndarray:
        values = np.sort(self.family(x), axis=1)
        values = values[:, : int(np.sum(~np.isnan(values[0])))]
        low, high = (np.full((len(x), 1), y) for y in self.ys)
        return np.concatenate([low, values, high], axis=1)

    def _merged(self, ends: np.ndarray) -> np.ndarray:
        cuts = ends[:, [*self.starts, -1]]
        return np.stack([cuts[:, :-1], cuts[:, 1:]], axis=2)

    def gaps(self, end: int) -> list[Range]:
        """Returns the gaps near the left (0) or right (1) end: as near as the order there is that of the strip."""
        width, middle = self.span[1] - self.span[0], sum(self.span) / 2
        offsets = width * 10.0 ** np.arange(-9, -1)
        x = self.span[end] + (offsets if end == 0 else -offsets)
        orders = _orders(self.family(np.array([*x, middle])))
        at = x[[order == orders[-1] for order in orders[:-1]].index(True)]
        return [tuple(gap) for gap in self._merged(self._ends(np.array([at])))[0]]

    def _integrated(self, order: int) -> np.ndarray:
        nodes, weights = np.polynomial.legendre.leggauss(order)
        s = (nodes + 1) / 2
        parts = max(2, math.ceil((self.span[1] - self.span[0]) / (0.05 * (self.ys[1] - self.ys[0]))))
        cuts = self.span[0] + (self.span[1] - self.span[0]) * 0.5 * (1 - np.cos(np.pi * np.arange(parts + 1) / parts))
        low, width = cuts[:-1, None], np.diff(cuts)[:, None]
        x = low + width * s * s * (3 - 2 * s)
        lengths = np.diff(self._merged(self._ends(x.ravel())), axis=2)[..., 0]
        return (width / 2 * weights * 6 * s * (1 - s)).ravel() @ lengths


# --- data file ---------------------------------------------------------------------------------------------------

ANALYTIC_EXAMPLE = AnalyticSection(1.0, 0.0, 1.0, 1.0)


def describe(found: list[Region]) -> dict[str, Any]:
    """Returns the areas by count, and the regions."""
    return {
        "area_by_count": {str(n): sum(r.area for r in found if r.count == n) for n in (0, 2, 4, 6)},
        "regions": [{"count": r.count, "area": r.area, "point": r.point} for r in found],
    }


def analytic_example(lines: int = 400) -> list[Region]:
    """Returns the regions of the analytic example, rho2 = 1, rho1 and rho3 in [0, 4]; areas to 1e-8."""
    section = ANALYTIC_EXAMPLE
    return regions(section.family, section.count, (0.0, 4.0), (0.0, 4.0), lines)


def reference_section(rho1: float, lines: int = 300) -> list[Region]:
    """Returns the regions of the reference robot, abscissa rho2 and ordinate rho3 in [0, 40]; areas to 1e-7."""
    section = GeneralSection(REFERENCE, rho1)
    return regions(section.family, section.count, (0.0, 40.0), (0.0, 40.0), lines)


if __name__ == "__main__":
    known = {"analytic 1 0 1, rho2 = 1, [0, 4]^2": describe(analytic_example(1600))}
    for value in (14.98, 17.0):
        known[f"reference, rho1 = {value}, [0, 40]^2"] = describe(reference_section(value, 1200))
    DATA.write_text(json.dumps(known, indent=1) + "\n")
