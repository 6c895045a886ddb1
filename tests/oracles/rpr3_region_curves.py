"""The singular curves of a section as families of roots on lines: the ordinates at many abscissas at once.

Each root lies on an interval on which a function is monotone, so that none is missed and each keeps its name from line
to line.

* Analytic robots: S is the curve of double roots, (A, B)(psi), with A monotone between the cusps and psi = 0; the Q
  are conics.
* General robots: the curve det = 0 on the torus (alpha, phi) of the fixed leg, traced once and cut where the second
  leg is critical along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from .rpr3_cusp_edges import analytic_edges
from .rpr3_exact import count_analytic, count_general
from .rpr3_torus import Geometry, singular_points

# --- the analytic family -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class AnalyticSection:
    """Section rho2 = const of a robot of the analytic family; abscissa rho1, ordinate rho3."""

    c2: float
    c3: float
    d3: float
    rho2: float

    def _forms(self, psi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Returns u, v and their derivatives."""
        s, c = np.sin(psi), np.cos(psi)
        return self.c2 * s, self.c3 * s - self.d3 * c, self.c2 * c, self.c3 * c + self.d3 * s

    def double(self, psi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns A, B and h where psi = phi/2 is a double root of 4 u v (u - v) + A v - B u."""
        u, v, du, dv = self._forms(psi)
        whole, rate = 4 * u * v * (u - v), 4 * (du * v + u * dv) * (u - v) + 4 * u * v * (du - dv)
        wronskian = self.c2 * self.d3  # u v' - v u'
        a, b = (whole * du - u * rate) / wronskian, (whole * dv - v * rate) / wronskian
        with np.errstate(divide="ignore", invalid="ignore"):
            h = np.where(np.abs(u) > np.abs(v), -a / (4 * u) - u, -b / (4 * v) - v)
        return a, b, h

    def family(self, rho1: np.ndarray) -> np.ndarray:
        """Returns rho3 on the real parts of S, and on the conics."""
        r1 = rho1**2
        # dA/dpsi is u times the condition of a triple root: A is monotone between these angles.
        angles = np.unique(
            np.round([0.0, *(edge.phi / 2 % math.pi for edge in analytic_edges(self.c2, self.c3, self.d3))], 15)
        )
        columns = []
        for p, q in pairwise([*angles, angles[0] + math.pi]):
            columns.append(self._on_s(r1, p, q))
        for sign in (1, -1):
            u = (sign * self.rho2 - rho1) / 2
            with np.errstate(invalid="ignore"):
                root = np.sqrt(1 - (u / self.c2) ** 2)
            for side in (1, -1):
                third = rho1 + 2 * (self.c3 * u / self.c2 + side * self.d3 * root)
                # rho3 = |third|: apart by sign, so that each column is smooth.
                columns += [np.where(third > 0, third, np.nan), np.where(third < 0, -third, np.nan)]
        return np.stack(columns, axis=1)

    def _on_s(self, r1: np.ndarray, p: float, q: float) -> np.ndarray:
        goal = r1 - self.rho2**2
        ends = [float(self.double(np.array(psi))[0]) for psi in (p, q)]
        exists = (goal > min(ends)) & (goal < max(ends))
        low, high = np.full(len(r1), p), np.full(len(r1), q)
        for _ in range(54):
            middle = (low + high) / 2
            below = (self.double(middle)[0] < goal) == (ends[0] < ends[1])
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        _, b, h = self.double((low + high) / 2)
        exists &= (h * h < r1) & (r1 > b)
        return np.where(exists, np.sqrt(np.maximum(r1 - b, 0)), np.nan)

    def count(self, rho1: float, rho3: float) -> int:
        """Returns twice the number of real roots psi with h^2 < r1, by the cubic in the tangent of psi."""
        r1 = rho1**2
        a, b = r1 - self.rho2**2, r1 - rho3**2
        nodes = math.pi * (np.arange(8) + 0.3) / 8
        u, v, _, _ = self._forms(nodes)
        # Harmonics -3, -1, 1, 3 of the form, a cubic in exp(2 i psi).
        values = (4 * u * v * (u - v) + a * v - b * u)[:, None] * np.exp(-1j * nodes[:, None] * [[3, 1, -1, -3]])
        roots = np.roots(values.mean(axis=0))
        psi = np.angle(roots[np.abs(np.abs(roots) - 1) < 1e-7]) / 2
        u, v, _, _ = self._forms(psi)
        with np.errstate(divide="ignore", invalid="ignore"):
            h = np.where(np.abs(u) > np.abs(v), -a / (4 * u) - u, -b / (4 * v) - v)
        return 2 * int(np.sum(h * h < r1))

    def exact_count(self, rho1: float, rho3: float) -> int:
        return count_analytic(self.c2, self.c3, self.d3, rho1, self.rho2, rho3).count


# --- general robots ----------------------------------------------------------------------------------------------


class GeneralSection:
    """Section rho1 = const of a planar 3-RPR; abscissa rho2, ordinate rho3.

    Attributes:
        arcs: Pieces of det = 0 on the torus along which rho2 is monotone: ``(k, 2)`` points (alpha, phi).
        closed: Number of closed curves that were traced.
    """

    def __init__(self, geometry: Geometry, rho1: float, step: float = 4e-3) -> None:
        self.geometry, self.rho1 = geometry, rho1
        base, platform = (
            [tuple(int(v.p) / int(v.q) for v in p) for p in f()] for f in (geometry.base, geometry.platform)
        )
        self.feet, self.arms = np.array(base[1:]), np.array(platform[1:])
        loops = self._loops(step)
        self.closed = len(loops)
        self.arcs = [arc for loop in loops for arc in self._monotone(loop)]

    def _legs(self, points: np.ndarray) -> tuple[Any, ...]:
        alpha, phi = points[..., 0], points[..., 1]
        c, s = np.cos(phi), np.sin(phi)
        x, y = self.rho1 * np.cos(alpha), self.rho1 * np.sin(alpha)
        rows = []
        for (bx, by), (ax, ay) in zip(self.arms, self.feet, strict=True):
            armx, army = c * bx - s * by, s * bx + c * by
            u, v = x + armx - ax, y + army - ay
            rows.append((u, v, armx * v - army * u))
        return x, y, rows

    def determinant(self, points: np.ndarray) -> np.ndarray:
        x, y, ((a, b, c), (d, e, f)) = self._legs(points)
        return x * (b * f - c * e) - y * (a * f - c * d)

    def squares(self, points: np.ndarray, leg: int) -> np.ndarray:
        u, v, _ = self._legs(points)[2][leg]
        return u * u + v * v

    def gradients(self, points: np.ndarray, leg: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Returns the gradients of det and of a squared leg by complex steps."""
        parts = []
        for k in range(2):
            moved = points.astype(complex)
            moved[..., k] += 1e-30j
            parts.append((self.determinant(moved).imag / 1e-30, self.squares(moved, leg).imag / 1e-30))
        return tuple(np.stack([part[i] for part in parts], axis=-1) for i in (0, 1))

    def corrected(self, points: np.ndarray, normal: np.ndarray | None = None) -> np.ndarray:
        """Moves points onto det = 0, along the gradient or a given direction."""
        for _ in range(4):
            slope = self.gradients(points)[0]
            along = slope if normal is None else normal
            points = points - (self.determinant(points) / np.sum(slope * along, axis=-1))[..., None] * along
        return points

    def _loops(self, step: float) -> list[np.ndarray]:
        rows = singular_points(self.geometry, 1, self.rho1, np.linspace(-math.pi, math.pi, 60, endpoint=False) + 0.0123)
        seeds = np.stack([np.arctan2(rows[:, 2], rows[:, 1]), rows[:, 0]], axis=1)
        loops: list[np.ndarray] = []
        for seed in seeds:
            if not any(np.min(_gap(loop, seed)) < 2 * step for loop in loops):
                loops.append(self._loop(seed, step))
        return loops

    def _loop(self, seed: np.ndarray, step: float) -> np.ndarray:
        points = [self.corrected(seed)]
        heading = np.zeros(2)
        while len(points) < 50 / step:
            slope = self.gradients(points[-1])[0]
            tangent = np.array([-slope[1], slope[0]]) / np.hypot(*slope)
            heading = tangent if heading @ tangent >= 0 else -tangent
            points.append(self.corrected(points[-1] + step * heading))
            if len(points) > 3 and _gap(points[-1], points[0]) < 0.75 * step:
                shift = 2 * math.pi * np.round((points[-1] - points[0]) / (2 * math.pi))
                return np.array([*points[:-1], points[0] + shift])
        raise RuntimeError("a singular curve that does not close")

    def _monotone(self, loop: np.ndarray) -> list[np.ndarray]:
        """Cuts a loop where r2 is critical along it, or rho3 = 0: there the curve is reflected in the border."""
        cuts = self._critical(loop, 0)
        cuts += [(i, point) for i, point in self._critical(loop, 1) if self.squares(point, 1) < 1e-12]
        cuts.sort(key=lambda cut: (cut[0], math.dist(cut[1], loop[cut[0]])))
        if not cuts:
            return [loop]
        shift = loop[-1] - loop[0]
        arcs = [np.array([a, *loop[i + 1 : j + 1], b]) for (i, a), (j, b) in pairwise(cuts)]
        (first, start), (last, end) = cuts[0], cuts[-1]
        arcs.append(np.array([end, *loop[last + 1 : -1], *(loop[: first + 1] + shift), start + shift]))
        return arcs

    def _critical(self, loop: np.ndarray, leg: int) -> list[tuple[int, np.ndarray]]:
        """Returns the points at which a leg is critical along the loop, and the chords on which they lie."""

        def rate(points: np.ndarray) -> np.ndarray:
            slope, square = self.gradients(points, leg)
            return slope[..., 0] * square[..., 1] - slope[..., 1] * square[..., 0]

        sign = rate(loop) > 0
        at = np.nonzero(sign[1:] != sign[:-1])[0]
        low, high = np.zeros(len(at)), np.ones(len(at))
        for _ in range(50):
            middle = (low + high) / 2
            same = (rate(self.between(loop[at], loop[at + 1], middle)) > 0) == sign[at]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return list(zip(at.tolist(), self.between(loop[at], loop[at + 1], (low + high) / 2), strict=True))

    def between(self, p: np.ndarray, q: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Returns the curve's points over the chords p q at the parameters s."""
        chord = q - p
        return self.corrected(p + s[:, None] * chord, np.stack([-chord[:, 1], chord[:, 0]], axis=1))

    def family(self, rho2: np.ndarray) -> np.ndarray:
        """Returns rho3 on every arc."""
        result = np.full((len(rho2), len(self.arcs)), np.nan)
        starts, ends, goals, rises, places = [], [], [], [], []
        for j, arc in enumerate(self.arcs):
            squares = self.squares(arc, 0)
            rising = squares[-1] > squares[0]
            ordered = squares if rising else squares[::-1]
            at = np.nonzero((rho2**2 > ordered[0]) & (rho2**2 < ordered[-1]))[0]
            k = np.clip(np.searchsorted(ordered, rho2[at] ** 2) - 1, 0, len(arc) - 2)
            k = k if rising else len(arc) - 2 - k
            starts.append(arc[k])
            ends.append(arc[k + 1])
            goals.append(rho2[at] ** 2)
            rises.append(np.full(len(at), rising))
            places.append(np.stack([at, np.full(len(at), j)]))
        p, q, goal, rising = (np.concatenate(v) for v in (starts, ends, goals, rises))
        low, high = np.zeros(len(goal)), np.ones(len(goal))
        for _ in range(46):
            middle = (low + high) / 2
            below = (self.squares(self.between(p, q, middle), 0) < goal) == rising
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        found = np.sqrt(self.squares(self.between(p, q, (low + high) / 2), 1))
        result[tuple(np.concatenate(places, axis=1))] = found
        return result

    def count(self, rho2: float, rho3: float) -> int:
        """Returns the number of real modes exactly."""
        platform, base = self.geometry.platform(), self.geometry.base()
        return count_general(platform[1], platform[2], base[1][0], *base[2], self.rho1, rho2, rho3).count


def _gap(points: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Returns distances on the torus."""
    return np.hypot(*np.moveaxis(2 * np.sin((points - point) / 2), -1, 0))
