"""The five-bar RR-RRR in closed form: circles alone. Nothing but NumPy and SciPy.

Crank k (length a_k) turns about (0, 0) or (base, 0) and ends in C_k; rod k (length b_k) joins C_k to P. Working mode:
signs of dF_k / dtheta_k with F_k = |P - C_k|^2 - b_k^2; since P - A = crank + rod, this is 2 crank x rod up to the sign
-1, positive where C_k lies left of the ray from A_k to P.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

DATA = Path(__file__).parents[1] / "data" / "five_bar_aspects.json"
Mode = tuple[int, int]
MODES: tuple[Mode, ...] = tuple(product((1, -1), repeat=2))


@dataclass(frozen=True)
class FiveBar:
    """Base distance, cranks (a1, a2), rods (b1, b2)."""

    base: float
    cranks: tuple[float, float]
    rods: tuple[float, float]

    def pivot(self, k: int) -> float:
        return (0.0, self.base)[k]

    def annulus(self, k: int) -> tuple[float, float]:
        """Returns the least and largest distance of P from pivot k: the serial boundary det B_k = 0."""
        return abs(self.cranks[k] - self.rods[k]), self.cranks[k] + self.rods[k]

    # --- inverse and forward -----------------------------------------------------------------------------------

    def elbow(self, x: np.ndarray, y: np.ndarray, k: int, sign: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns C_k of one working mode; nan where P is out of reach."""
        dx, dy = np.asarray(x) - self.pivot(k), np.asarray(y) + 0.0
        far = np.hypot(dx, dy)
        with np.errstate(invalid="ignore", divide="ignore"):
            along = (far**2 + self.cranks[k] ** 2 - self.rods[k] ** 2) / (2 * far)
            aside = sign * np.sqrt(self.cranks[k] ** 2 - along**2)
            return self.pivot(k) + (along * dx - aside * dy) / far, (along * dy + aside * dx) / far

    def inverse(self, x: float, y: float, mode: Mode) -> tuple[float, float] | None:
        """Returns the crank angles of one working mode, in (-pi, pi]; None out of reach."""
        angles = []
        for k, sign in enumerate(mode):
            cx, cy = self.elbow(x, y, k, sign)
            if math.isnan(cx):
                return None
            angles.append(math.atan2(cy, cx - self.pivot(k)))
        return angles[0], angles[1]

    def tips(self, theta1: float, theta2: float) -> np.ndarray:
        angles = np.array([theta1, theta2])
        turns = np.array([np.cos(angles), np.sin(angles)]).T
        return turns * np.array(self.cranks)[:, None] + [[0.0, 0.0], [self.base, 0.0]]

    def forward(self, theta1: float, theta2: float) -> list[tuple[float, float]]:
        """Returns P: none, or the two points where the circles about C_1 and C_2 cross."""
        first, second = self.tips(theta1, theta2)
        gap = second - first
        far = math.hypot(*gap)
        b1, b2 = self.rods
        if not abs(b1 - b2) < far < b1 + b2:
            return []
        along = (far**2 + b1**2 - b2**2) / (2 * far)
        aside = math.sqrt(b1**2 - along**2)
        ux, uy = gap / far
        return [(first[0] + along * ux - s * uy, first[1] + along * uy + s * ux) for s in (aside, -aside)]

    # --- determinants ------------------------------------------------------------------------------------------

    def determinants(self, x: float, y: float, theta1: float, theta2: float) -> tuple[float, float, float]:
        """Returns det dF/d(x, y), dF_1/dtheta_1 and dF_2/dtheta_2."""
        tips = self.tips(theta1, theta2)
        rods = np.array([x, y]) - tips
        cranks = tips - [[0.0, 0.0], [self.base, 0.0]]
        direct = 4 * (rods[0, 0] * rods[1, 1] - rods[0, 1] * rods[1, 0])
        inner = -2 * (cranks[:, 0] * rods[:, 1] - cranks[:, 1] * rods[:, 0])
        return direct, inner[0], inner[1]

    def direct(self, x: np.ndarray, y: np.ndarray, mode: Mode) -> np.ndarray:
        """Returns det dF/d(x, y) of one working mode at many points; nan out of reach."""
        (c1x, c1y), (c2x, c2y) = (self.elbow(x, y, k, mode[k]) for k in (0, 1))
        return 4 * ((x - c1x) * (y - c2y) - (y - c1y) * (x - c2x))

    def parallel_curve(self, theta1: np.ndarray, inner: bool = False) -> list[tuple[np.ndarray, np.ndarray]]:
        """Returns the angles theta2 with |C1 C2| = b1 + b2 (inner: |b1 - b2|), two for each theta1 or nan.

        Joint values singular in the direct sense; with equal rods the inner curve is C1 = C2, where P is free on a
        circle: isolated points, self-motions.
        """
        goal = abs(self.rods[0] - self.rods[1]) if inner else sum(self.rods)
        x = self.cranks[0] * np.cos(theta1) - self.base
        y = self.cranks[0] * np.sin(theta1)
        far, heading = np.hypot(x, y), np.arctan2(y, x)
        with np.errstate(invalid="ignore", divide="ignore"):
            turn = np.arccos((far**2 + self.cranks[1] ** 2 - goal**2) / (2 * far * self.cranks[1]))
        return [(theta1, _wrapped(heading + s * turn)) for s in (1, -1)]

    def coincidences(self) -> list[tuple[float, float]]:
        """Returns the points where both crank circles meet: C1 = C2."""
        a1, a2 = self.cranks
        if not self.base or not abs(a1 - a2) < self.base < a1 + a2:
            return []
        x = (self.base**2 + a1**2 - a2**2) / (2 * self.base)
        y = math.sqrt(a1**2 - x**2)
        return [(x, y), (x, -y)]

    # --- areas -------------------------------------------------------------------------------------------------

    def workspace_area(self) -> float:
        """Returns the area of one sheet: both annuli intersected, by lenses."""
        (low1, high1), (low2, high2) = self.annulus(0), self.annulus(1)
        return (
            _lens(high1, high2, self.base)
            - _lens(low1, high2, self.base)
            - _lens(high1, low2, self.base)
            + _lens(low1, low2, self.base)
        )


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return np.arctan2(np.sin(angle), np.cos(angle))


def _lens(r: float, s: float, d: float) -> float:
    """Returns the area common to two discs."""
    if r + s <= d:
        return 0.0
    if d <= abs(r - s):
        return math.pi * min(r, s) ** 2
    p, q = (d * d + r * r - s * s) / (2 * d), (d * d + s * s - r * r) / (2 * d)
    return (
        r * r * math.acos(p / r)
        - p * math.sqrt(r * r - p * p)
        + s * s * math.acos(q / s)
        - q * math.sqrt(s * s - q * q)
    )


# --- aspects by labelling --------------------------------------------------------------------------------------


class Piece(NamedTuple):
    """A connected piece of one working mode with one sign of det A.

    Attributes:
        mode: Signs of dF_k/dtheta_k.
        sign: Sign of det A.
        area: By counting samples.
        share: Of the sheet's area.
        point: A point well inside.
        depth: Its distance from the piece's border, in samples.
    """

    mode: Mode
    sign: int
    area: float
    share: float
    point: tuple[float, float]
    depth: float


def pieces(robot: FiveBar, size: int, least_depth: float = 2.0) -> list[Piece]:
    """Labels a grid of size x size samples over the workspace, in each working mode.

    Args:
        robot: The five-bar.
        size: Samples per axis.
        least_depth: Pieces without any sample that deep inside are left out: they are not resolved. The samples lie
            off the base line, on which symmetric robots are singular.

    Returns:
        The pieces, by mode, then descending area.
    """
    (low, high), (bottom, top) = _box(robot)
    step = max(high - low, top - bottom) / size
    x, y = np.meshgrid(
        np.arange(low + 0.37 * step, high, step), np.arange(bottom + 0.41 * step, top, step), indexing="ij"
    )
    found = []
    for mode in MODES:
        value = robot.direct(x, y, mode)
        inside = int(np.sum(~np.isnan(value)))
        for sign in (1, -1):
            with np.errstate(invalid="ignore"):
                labels, count = ndimage.label(sign * value > 0)
            depth = ndimage.distance_transform_edt(labels > 0)
            areas = np.bincount(labels.ravel(), minlength=count + 1)
            deepest = ndimage.maximum_position(depth, labels, np.arange(1, count + 1)) if count else []
            for k, at in enumerate(deepest, start=1):
                if depth[at] >= least_depth:
                    point = float(x[at]), float(y[at])
                    share = areas[k] / inside
                    found.append(Piece(mode, sign, float(areas[k] * step**2), float(share), point, float(depth[at])))
    return sorted(found, key=lambda piece: (-piece.mode[0], -piece.mode[1], -piece.area))


def _box(robot: FiveBar) -> tuple[tuple[float, float], tuple[float, float]]:
    (_, high1), (_, high2) = robot.annulus(0), robot.annulus(1)
    low, high = max(-high1, robot.base - high2), min(high1, robot.base + high2)
    return (low, high), (-min(high1, high2), min(high1, high2))


def sharp_areas(robot: FiveBar, columns: int, samples: int = 400) -> dict[tuple[Mode, int], list[float]]:
    """Returns the areas of all pieces by mode and sign of det A, descending, from columns with exact ends.

    The ends of the pieces on each column are circles of the annuli and zeros of det A, bisected to rounding; intervals
    of neighbouring columns belong together where they overlap or lie along one circle of the border. Between the
    abscissas at which the workspace's own border turns or has corners the columns are spaced like cosines, so that the
    workspace's area is exact to many digits; vertical tangents of det A = 0 leave an error of order columns^-1.5.
    Pieces of fewer than four columns are left out.
    """
    x, weights = _columns(robot, columns)
    areas = {}
    for mode in MODES:
        intervals = _column_intervals(robot, x, mode, samples)
        for sign in (1, -1):
            areas[mode, sign] = _joined(intervals[sign], weights)
    return areas


def _columns(robot: FiveBar, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns abscissas and weights: midpoints in the angle between the border's turns and corners."""
    (low, high), _ = _box(robot)
    turns = [robot.pivot(k) + s * r for k in (0, 1) for r in robot.annulus(k) for s in (1, -1)]
    if robot.base:
        turns += [(robot.base**2 + r**2 - s**2) / (2 * robot.base) for r in robot.annulus(0) for s in robot.annulus(1)]
    cuts = np.unique(np.round([low, *(t for t in turns if low < t < high), high], 12))
    x, weights = [], []
    for p, q in pairwise(cuts):
        n = max(12, math.ceil(columns * (q - p) / (high - low)))
        angle = math.pi * (np.arange(n) + 0.5) / n
        x.append((p + q) / 2 - (q - p) / 2 * np.cos(angle))
        # The integrals of the sine over the steps, so that the weights add up.
        weights.append((q - p) * math.sin(math.pi / (2 * n)) * np.sin(angle))
    return np.concatenate(x), np.concatenate(weights)


class _Interval(NamedTuple):
    """A part of a column: its ends, and the border's circles that they lie on (None where det A vanishes)."""

    low: float
    high: float
    feet: tuple[str | None, str | None]


def _column_intervals(robot: FiveBar, x: np.ndarray, mode: Mode, samples: int) -> dict[int, list[list[_Interval]]]:
    """Returns the maximal intervals of each sign of det A on every column."""
    spans = [(i, span) for i, at in enumerate(x) for span in _reachable(robot, float(at))]
    which = np.array([i for i, _ in spans])
    lo, hi = (np.array([span[k] for _, span in spans]) for k in (0, 1))
    # Denser towards the ends, where det A turns steeply.
    s = 0.5 - 0.5 * np.cos(math.pi * (np.arange(samples) + 0.5) / samples)
    y = lo[:, None] + (hi - lo)[:, None] * s
    value = robot.direct(x[which][:, None], y, mode)
    row, at = np.nonzero(value[:, 1:] * value[:, :-1] < 0)
    roots = _bisected(robot, mode, x[which[row]], y[row, at], y[row, at + 1])
    result: dict[int, list[list[_Interval]]] = {1: [[] for _ in x], -1: [[] for _ in x]}
    for j, (i, (_, _, (below, above))) in enumerate(spans):
        own = np.sort(roots[row == j]).tolist()
        ends = list(zip([lo[j], *own, hi[j]], [below, *[None] * len(own), above], strict=True))
        for (p, foot), (q, top) in pairwise(ends):
            middle = float(robot.direct(x[i], (p + q) / 2, mode))
            result[1 if middle > 0 else -1][i].append(_Interval(float(p), float(q), (foot, top)))
    return result


def _bisected(robot: FiveBar, mode: Mode, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    first = robot.direct(x, low, mode) > 0
    for _ in range(54):
        middle = (low + high) / 2
        same = (robot.direct(x, middle, mode) > 0) == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return (low + high) / 2


def _reachable(robot: FiveBar, x: float) -> list[_Interval]:
    """Returns the intervals of y in both annuli on a column."""
    spans = [_Interval(-math.inf, math.inf, (None, None))]
    for k in (0, 1):
        (inner, outer), dx = robot.annulus(k), abs(x - robot.pivot(k))
        if dx >= outer:
            return []
        top = math.sqrt(outer**2 - dx**2)
        hole = math.sqrt(inner**2 - dx**2) if dx < inner else 0.0
        names = f"outer{k}-", f"inner{k}-", f"inner{k}+", f"outer{k}+"
        whole = [_Interval(-top, top, (names[0], names[3]))]
        own = [_Interval(-top, -hole, names[:2]), _Interval(hole, top, names[2:])] if hole else whole
        met = [
            (
                max((s.low, s.feet[0]), (t.low, t.feet[0]), key=lambda e: e[0]),
                min((s.high, s.feet[1]), (t.high, t.feet[1]), key=lambda e: e[0]),
            )
            for s in spans
            for t in own
        ]
        spans = [_Interval(low[0], high[0], (low[1], high[1])) for low, high in met if low[0] < high[0]]
    return spans


def _joined(columns: list[list[_Interval]], weights: np.ndarray) -> list[float]:
    """Adds up the columns' intervals that hang together: by overlap, or along a circle of the border."""
    parent: dict[tuple[int, int], tuple[int, int]] = {}

    def find(node: tuple[int, int]) -> tuple[int, int]:
        while parent.setdefault(node, node) != node:
            node = parent[node]
        return node

    def meet(s: _Interval, t: _Interval) -> bool:
        along = any(a is not None and a == b for a, b in zip(s.feet, t.feet, strict=True))
        return along or max(s.low, t.low) < min(s.high, t.high)

    for i, column in enumerate(columns):
        for j, interval in enumerate(column):
            find((i, j))
            for k, other in enumerate(columns[i - 1] if i else []):
                if meet(interval, other):
                    parent[find((i, j))] = find((i - 1, k))
    totals: dict[tuple[int, int], list[float]] = {}
    for i, j in list(parent):
        interval = columns[i][j]
        totals.setdefault(find((i, j)), []).append(float((interval.high - interval.low) * weights[i]))
    return sorted((sum(parts) for parts in totals.values() if len(parts) >= 4), reverse=True)


# --- data file -------------------------------------------------------------------------------------------------

#: Robots with a piece of 0.47 %, several, two and hardly more than slivers along the border (0.02 % of the sheet).
EXAMPLES = (
    FiveBar(9.0, (8.0, 8.0), (5.0, 5.0)),
    FiveBar(7.7, (3.5, 5.8), (6.9, 2.4)),
    FiveBar(5.0, (2.6, 2.6), (8.5, 8.5)),
    FiveBar(5.0, (2.6, 2.6), (3.5, 3.5)),
    FiveBar(9.1, (9.0, 3.0), (5.8, 8.2)),
    FiveBar(3.6, (8.0, 3.2), (8.8, 6.4)),
    FiveBar(4.0, (3.0, 4.0), (4.4, 3.6)),
    FiveBar(3.4, (7.2, 7.2), (6.0, 6.0)),
    FiveBar(2.4, (6.1, 3.2), (7.4, 8.6)),
)


def describe(robot: FiveBar, columns: int) -> dict[str, Any]:
    """Returns the robot, the area of its workspace, and its aspects by working mode and sign with their areas."""
    areas = sharp_areas(robot, columns)
    return {
        "base": robot.base,
        "cranks": robot.cranks,
        "rods": robot.rods,
        "sheet": robot.workspace_area(),
        "aspects": [{"mode": mode, "sign": sign, "area": area} for (mode, sign), own in areas.items() for area in own],
    }


if __name__ == "__main__":
    known = [describe(robot, 3200) for robot in EXAMPLES]
    DATA.write_text(json.dumps(known, indent=1) + "\n")
