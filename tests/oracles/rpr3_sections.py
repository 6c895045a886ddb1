"""Singular curves and cusps in sections of the joint space of planar 3-RPR robots, exactly.

A section fixes one leg. Let X be the platform joint of that leg seen from its base joint, and phi the angle of
the platform: |X| = rho makes the section's poses a torus of (alpha, phi), X = rho (cos alpha, sin alpha). The other
legs are |X + w_i|^2 = r_i with w_i(phi) = R b_i - a_i; subtracting |X|^2 leaves two lines that cross in a
point X(phi) as long as Delta = w_2 x w_3 is not zero. The joint value is singular where |X(phi)|^2 - r has a double
root, and a cusp where it has a triple one; Delta^2 clears the denominators and gives the polynomial P(phi). On
the torus this reads

    P' = 2 Delta D,        P'' = 2 E + 4 Delta' D,

with trigonometric polynomials D and E that are quadratic in X. D is the determinant of the direct Jacobian. So
the singular curve is D = 0, a conic against a circle at every phi, and the cusps are D = E = 0, less the
zeros that clearing the denominators brought in (at Delta = 0; they are double zeros of E along the curve, so that
E / Delta^2 changes its sign at cusps only).

Two routes that share D and E alone:

* exact: the floats of the input are rational numbers, D and E polynomials in half-angle tangents, the
  cusps the real roots of a resultant; all of them are isolated with certified balls. The curve's components
  follow from the cylindrical decomposition of D = 0 over phi.
* by scanning: signs of D on the nodes of a grid, signs of E where D = 0 meets the grid's edges.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat, arb_poly, ctx, fmpq, fmpq_mat, fmpq_poly

from .rpr3_exact import rational

Number = Any  # float, array, fmpq or arb: the formulas below are written once for all of them
Point = tuple[Number, Number]

PREC = 700  # bits of the balls
_POWERS = np.arange(-2, 3)
_ONE, _T = fmpq_poly([1]), fmpq_poly([0, 1])


class Degenerate(ValueError):
    """The section carries an event (lips, beaks, swallowtail, crossing), or the robot is a special one."""


@dataclass(frozen=True)
class Geometry:
    """Base joints (0, 0), (c2, 0), (c3, d3); platform joints (0, 0), (l2, 0), l3 (cos beta, sin beta).

    `b3` overrides l3 and beta by a point, for platforms that are exact only as points.
    """

    c2: float
    c3: float
    d3: float
    l2: float
    l3: float
    beta: float
    b3: tuple[float, float] | None = None

    def base(self) -> list[Point]:
        return [(fmpq(0), fmpq(0)), (rational(self.c2), fmpq(0)), (rational(self.c3), rational(self.d3))]

    def platform(self) -> list[Point]:
        """Returns the joints as rationals; cos and sin of the float beta are rounded at 2^-200."""
        if self.b3 is not None:
            third = rational(self.b3[0]), rational(self.b3[1])
        else:
            with ctx.workprec(400):
                beta, l3 = arb(rational(self.beta)), arb(rational(self.l3))
                third = _round(l3 * beta.cos(), 200), _round(l3 * beta.sin(), 200)
        return [(fmpq(0), fmpq(0)), (rational(self.l2), fmpq(0)), third]

    def mirrored(self) -> bool:
        """True if the platform is the base mirrored in its x axis (the analytic family)."""
        return all(a[0] == b[0] and a[1] == -b[1] for a, b in zip(self.base(), self.platform(), strict=True))


REFERENCE = Geometry(15.91, 0.0, 10.0, 17.04, 20.84, math.acos((17.04**2 + 20.84**2 - 16.54**2) / (2 * 17.04 * 20.84)))


def analytic(c2: float, c3: float, d3: float) -> Geometry:
    """Returns the member of the analytic family over this base."""
    return Geometry(c2, c3, d3, c2, math.hypot(c3, d3), math.atan2(-d3, c3), (c3, -d3))


class Cusp(NamedTuple):
    """A cusp as balls: the joint values, and the pose x, y, phi with phi in (-pi, pi]."""

    rho: tuple[arb, arb, arb]
    pose: tuple[arb, arb, arb]

    def floats(self) -> tuple[list[float], list[float]]:
        return [float(v.mid()) for v in self.rho], [float(v.mid()) for v in self.pose]

    def radius(self) -> float:
        return max(float(v.rad()) for v in (*self.rho, *self.pose))


class Scan(NamedTuple):
    """What a grid of the torus shows: closed curves of D = 0 and changes of the fold's side along them."""

    components: int
    cusps: int


def _round(value: arb, bits: int) -> fmpq:
    return fmpq(int((value * 2**bits).mid().floor().unique_fmpz()), 2**bits)


def _cross(u: Point, v: Point) -> Number:
    return u[0] * v[1] - u[1] * v[0]


def _dot(u: Point, v: Point) -> Number:
    return u[0] * v[0] + u[1] * v[1]


def _sum(u: Point, v: Point) -> Point:
    return u[0] + v[0], u[1] + v[1]


def _rotate(c: Number, s: Number, b: Point) -> Point:
    return c * b[0] - s * b[1], s * b[0] + c * b[1]


# --- the two functions on the torus -------------------------------------------------------------------------


class Section:
    """One leg of the robot fixed.

    Args:
        geometry: The robot.
        fixed_axis: The fixed leg: 1, 2 or 3.
        fixed_value: Its length, positive.
    """

    def __init__(self, geometry: Geometry, fixed_axis: int, fixed_value: float) -> None:
        if fixed_axis not in (1, 2, 3) or not fixed_value > 0:
            raise ValueError(f"axis {fixed_axis}, value {fixed_value}: take axis 1, 2 or 3 and a positive length")
        self.geometry, self.axis, self.rho = geometry, fixed_axis, rational(fixed_value)
        a, b = geometry.base(), geometry.platform()
        self.foot, self.arm = a[fixed_axis - 1], b[fixed_axis - 1]
        others = [i for i in range(3) if i != fixed_axis - 1]
        self.exact = [
            ((b[i][0] - self.arm[0], b[i][1] - self.arm[1]), (a[i][0] - self.foot[0], a[i][1] - self.foot[1]))
            for i in others
        ]
        self.rounded = [tuple(tuple(float(Fraction(int(v.p), int(v.q))) for v in p) for p in leg) for leg in self.exact]

    def functions(self, cx: Number, sx: Number, c: Number, s: Number, exact: bool = False) -> tuple[Number, ...]:
        """Returns D, E and Delta from the cosines and sines of alpha and phi."""
        legs, rho = (
            (self.exact, self.rho) if exact else (self.rounded, float(Fraction(int(self.rho.p), int(self.rho.q))))
        )
        point = rho * cx, rho * sx
        line, rate, turn, bend = [], [], [], []
        for b, a in legs:
            rb = _rotate(c, s, b)
            line.append((rb[0] - a[0], rb[1] - a[1]))
            turn.append((-rb[1], rb[0]))
            tip = _sum(point, line[-1])
            rate.append(_dot(tip, turn[-1]))
            bend.append(_dot(b, b) - _dot(tip, rb))
        delta = _cross(*line)
        det = rate[1] * _cross(point, line[0]) - rate[0] * _cross(point, line[1])
        # |Delta X'|^2 and X . (Delta X)'' of the lines' crossing; on D = 0 the rest of P'' vanishes.
        speed = tuple(rate[1] * p - rate[0] * q for p, q in zip(*line, strict=True))
        accel = 2 * (rate[1] * _cross(point, turn[0]) - rate[0] * _cross(point, turn[1]))
        accel = accel + bend[1] * _cross(point, line[0]) - bend[0] * _cross(point, line[1])
        return det, _dot(speed, speed) + delta * accel, delta

    def fold(self, cx: Number, sx: Number, c: Number, s: Number) -> tuple[Number, Number]:
        """Returns w and w . F_xx[v, v] of singular poses, in floats; v spans the Jacobian's kernel, w its cokernel."""
        point = _float(self.rho) * np.array([cx, sx])
        arms, tips = [0 * point], [point]
        for b, a in self.rounded:
            arms.append(np.array(_rotate(c, s, b)))
            tips.append(point + arms[-1] - np.array(a)[:, None])
        turned = [np.array([-arm[1], arm[0]]) for arm in arms]
        jacobian = np.array([[*tip, _dot(tip, turn)] for tip, turn in zip(tips, turned, strict=True)])

        def null(rows: np.ndarray) -> np.ndarray:
            pairs = np.array([np.cross(rows[i], rows[j], axis=0) for i, j in ((0, 1), (1, 2), (2, 0))])
            best = np.argmax(np.sum(pairs**2, axis=1), axis=0)
            vector = pairs[best, :, np.arange(len(best))].T
            return vector / np.sqrt(np.sum(vector**2, axis=0))

        v, w = null(jacobian), null(jacobian.transpose(1, 0, 2))
        rates = [np.sum((v[:2] + v[2] * turn) ** 2, axis=0) for turn in turned]
        bends = [rate - v[2] ** 2 * _dot(tip, arm) for rate, tip, arm in zip(rates, tips, arms, strict=True)]
        return w, np.sum(w * np.array(bends), axis=0)

    def pose(self, cx: Number, sx: Number, c: Number, s: Number, exact: bool = False) -> tuple[Point, list[Number]]:
        """Returns the position of the first platform joint and the three squared lengths."""
        platform, base = self.geometry.platform(), self.geometry.base()
        if not exact:
            platform, base = ([tuple(map(_float, p)) for p in points] for points in (platform, base))
        foot, arm = base[self.axis - 1], platform[self.axis - 1]
        rho = self.rho if exact else _float(self.rho)
        swung = _rotate(c, s, arm)
        first = foot[0] + rho * cx - swung[0], foot[1] + rho * sx - swung[1]
        legs = [_sum(first, _rotate(c, s, b)) for b in platform]
        return first, [(p[0] - a[0]) ** 2 + (p[1] - a[1]) ** 2 for p, a in zip(legs, base, strict=True)]


def _float(value: fmpq) -> float:
    return int(value.p) / int(value.q)


def characteristic(geometry: Geometry, rho: tuple[float, float, float], phi: Number) -> Number:
    """Returns (SW - VQ)^2 + (RW - UQ)^2 - r1 (RV - SU)^2 at the angles phi, in floats; see the class docstring."""
    (_, _), (c2, _), (c3, d3) = ([_float(v) for v in p] for p in geometry.base())
    (_, _), (l2, _), b3 = ([_float(v) for v in p] for p in geometry.platform())
    c, s = np.cos(phi), np.sin(phi)
    r1, r2, r3 = (v * v for v in rho)
    bx, by = _rotate(c, s, b3)
    r, s_, u, v = 2 * (l2 * c - c2), 2 * l2 * s, 2 * (bx - c3), 2 * (by - d3)
    q = l2**2 + c2**2 - 2 * c2 * l2 * c + r1 - r2
    w = b3[0] ** 2 + b3[1] ** 2 + c3**2 + d3**2 - 2 * (c3 * bx + d3 * by) + r1 - r3
    return (s_ * w - v * q) ** 2 + (r * w - u * q) ** 2 - r1 * (r * v - s_ * u) ** 2


# --- singular poses at given angles: a conic and a circle ----------------------------------------------------


def singular_points(geometry: Geometry, fixed_axis: int, fixed_value: float, phis: np.ndarray) -> np.ndarray:
    """Returns all real singular poses of the section at the given angles.

    Args:
        geometry: The robot.
        fixed_axis: The fixed leg: 1, 2 or 3.
        fixed_value: Its length.
        phis: Angles of the platform.

    Returns:
        Rows (phi, x, y, rho1, rho2, rho3), at most four for each angle, ordered by angle.
    """
    section = Section(geometry, fixed_axis, fixed_value)
    phis = np.ravel(np.asarray(phis, dtype=float))
    nodes = 2 * np.pi * np.arange(8) / 8
    c, s = np.cos(phis)[:, None], np.sin(phis)[:, None]
    samples = section.functions(np.cos(nodes), np.sin(nodes), c, s)[0]
    fourier = np.fft.fft(samples, axis=1) / 8
    quartic = fourier[:, [-2, -1, 0, 1, 2]]  # ascending powers of z = exp(i alpha), times z^2
    companion = np.zeros((len(phis), 4, 4), complex)
    companion[:, [1, 2, 3], [0, 1, 2]] = 1
    companion[:, :, 3] = -quartic[:, :4] / quartic[:, 4:]
    roots = np.linalg.eigvals(companion)
    rows = []
    for i, angle in enumerate(phis):
        scale = np.abs(quartic[i]).sum()
        found: list[float] = []
        for alpha in np.angle(roots[i][np.abs(np.log(np.abs(roots[i]))) < 1e-4]):
            for _ in range(40):
                waves = quartic[i] * np.exp(1j * alpha * _POWERS)
                slope = np.sum(1j * _POWERS * waves).real
                step = np.clip(np.sum(waves).real / slope, -1e-2, 1e-2) if slope else 0.0
                alpha -= step
                if abs(step) < 1e-15:
                    break
            residual = abs(np.sum(quartic[i] * np.exp(1j * alpha * _POWERS)).real)
            if residual < 1e-13 * scale and all(abs(np.sin((alpha - f) / 2)) > 1e-9 for f in found):
                found.append(alpha)
                (x, y), squares = section.pose(math.cos(alpha), math.sin(alpha), math.cos(angle), math.sin(angle))
                rows.append((angle, x, y, *map(math.sqrt, squares)))
    return np.array(rows).reshape(-1, 6)


# --- the scan of the torus -----------------------------------------------------------------------------------


def scan(geometry: Geometry, fixed_axis: int, fixed_value: float, size: int) -> Scan:
    """Counts closed curves and cusps on a grid of size x size cells.

    Each grid edge over which D changes its sign carries one point of the curve; the points of a cell are joined
    in pairs, by the sign of D in its centre where there are four. True once the cells resolve the curve.
    """
    section = Section(geometry, fixed_axis, fixed_value)

    def values(alpha: np.ndarray, phi: np.ndarray) -> np.ndarray:
        return section.functions(np.cos(alpha), np.sin(alpha), np.cos(phi), np.sin(phi))[0]

    h = 2 * np.pi / size
    # An irrational offset: symmetric robots would put zeros on the nodes.
    axis = 0.0123456789 + h * np.arange(size)
    alpha, phi = np.meshgrid(axis, axis, indexing="ij")
    positive = values(alpha, phi) > 0
    index, cokernel, bend, count = [], [], [], 0
    for direction in (0, 1):
        crossed = positive != np.roll(positive, -1, direction)
        a, p, first = alpha[crossed], phi[crossed], positive[crossed]
        low, high = np.zeros(len(a)), np.full(len(a), h)
        for _ in range(52):
            middle = (low + high) / 2
            same = (values(a + middle * (direction == 0), p + middle * (direction == 1)) > 0) == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        a, p = a + low * (direction == 0), p + low * (direction == 1)
        w, b = section.fold(np.cos(a), np.sin(a), np.cos(p), np.sin(p))
        cokernel.append(w)
        bend.append(b)
        index.append(np.full(positive.shape, -1))
        index[-1][crossed] = count + np.arange(len(a))
        count += len(a)
    w, side = np.concatenate(cokernel, axis=1), np.concatenate(bend)
    # Edges of the cell (i, j): low phi, high alpha, high phi, low alpha; the corners between them in that order.
    edges = np.stack([index[0], np.roll(index[1], -1, 0), np.roll(index[0], -1, 1), index[1]], -1)
    crossings = np.sum(edges >= 0, -1)
    links = [np.sort(edges[crossings == 2], axis=-1)[:, 2:]]
    four = crossings == 4
    centre = values(alpha[four] + h / 2, phi[four] + h / 2) > 0
    corner = positive[four] == centre  # the corner (i, j) is joined to its opposite: cut off the other two
    e = edges[four]
    pairs = np.where(corner[:, None, None], e[:, [[0, 1], [2, 3]]], e[:, [[3, 0], [1, 2]]])
    links = np.concatenate([*links, pairs.reshape(-1, 2)])
    parent = list(range(count))
    components = count
    for p, q in links.tolist():
        p, q = _find(parent, p), _find(parent, q)
        if p != q:
            parent[p] = q
            components -= 1
    p, q = links.T
    return Scan(components, int(np.sum(side[p] * side[q] * np.sum(w[:, p] * w[:, q], axis=0) < 0)))


def _find(parent: list[int], i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


# --- exact polynomials ---------------------------------------------------------------------------------------


class _Chart:
    """D and E as polynomials in s and t, alpha = alpha0 + 2 atan s, phi = phi0 + 2 atan t.

    `det`, `convex`: lists of polynomials in t, by powers 0..4 of s. The turned axes keep s and t finite.
    """

    def __init__(self, section: Section, turns: tuple[fmpq, fmpq] = (fmpq(3, 7), fmpq(5, 13))) -> None:
        self.section, self.turns = section, turns
        self.det, self.convex = self._interpolate(0, 4), self._interpolate(1, 8)
        # Delta does not depend on alpha.
        delta = [
            section.functions(*self._circle(fmpq(0), 0), *self._circle(fmpq(j), 1), exact=True)[2] for j in range(3)
        ]
        self.delta = _newton([(fmpq(j), v * (1 + fmpq(j) ** 2)) for j, v in enumerate(delta)])

    def _circle(self, u: Number, which: int) -> Point:
        """Returns cos and sin of the turned angle."""
        turn = self.turns[which]
        c0, s0 = (1 - turn**2) / (1 + turn**2), 2 * turn / (1 + turn**2)
        c, s = (1 - u**2) / (1 + u**2), 2 * u / (1 + u**2)
        return c0 * c - s0 * s, s0 * c + c0 * s

    def _interpolate(self, k: int, degree: int) -> list[fmpq_poly]:
        def value(i: int, j: int) -> fmpq:
            s, t = fmpq(i), fmpq(j - degree // 2)
            found = self.section.functions(*self._circle(s, 0), *self._circle(t, 1), exact=True)[k]
            return found * (1 + s**2) ** 2 * (1 + t**2) ** (degree // 2)

        rows = [_newton([(fmpq(j - degree // 2), value(i, j)) for j in range(degree + 1)]) for i in range(-2, 3)]
        powers = fmpq_mat(5, 5, [fmpq(i) ** j for i in range(-2, 3) for j in range(5)]).inv()
        table = [sum((powers[k, i] * rows[i] for i in range(5)), fmpq_poly()) for k in range(5)]
        scale = math.lcm(*(int(p.denom()) for p in table))
        return [scale * p for p in table]

    def angle(self, u: arb, which: int) -> arb:
        """Returns alpha or phi in (-pi, pi]."""
        return _wrap(2 * (arb(self.turns[which]).atan() + u.atan()))

    def joints(self, s: arb, t: arb) -> Cusp:
        circles = *self._circle(s, 0), *self._circle(t, 1)
        position, squares = self.section.pose(*circles, exact=True)
        return Cusp(tuple(v.sqrt() for v in squares), (*position, self.angle(t, 1)))


def _wrap(angle: arb) -> arb:
    while angle > arb.pi():
        angle -= 2 * arb.pi()
    while angle < -arb.pi():
        angle += 2 * arb.pi()
    return angle


def _newton(points: list[tuple[fmpq, fmpq]]) -> fmpq_poly:
    """Returns the polynomial through the points."""
    result, basis = fmpq_poly(), _ONE
    for x, y in points:
        result += basis * ((y - result(x)) / basis(x))
        basis *= _T - x
    return result


def _sylvester(f: list[Number], g: list[Number], drop: int = 0) -> list[list[Number]]:
    """Returns Sylvester's matrix of two forms, less `drop` rows of each: columns s^(m+n-1-drop) .. s^0."""
    m, n = len(f) - 1, len(g) - 1
    width = m + n - drop
    zero = f[0] * 0
    rows = []
    for poly, shifts in ((f, n - drop), (g, m - drop)):
        for k in range(shifts):
            rows.append([zero] * k + poly[::-1] + [zero] * (width - k - len(poly)))
    return rows


def _eliminate(f: list[fmpq_poly], g: list[fmpq_poly]) -> fmpq_poly:
    """Returns the resultant in s of two lists of polynomials in t."""
    bound = (len(g) - 1) * max(p.degree() for p in f) + (len(f) - 1) * max(p.degree() for p in g)
    points = []
    for j in range(bound + 1):
        t = fmpq(j - bound // 2)
        entries = [v for row in _sylvester([p(t) for p in f], [p(t) for p in g]) for v in row]
        size = math.isqrt(len(entries))
        points.append((t, fmpq_mat(size, size, entries).det()))
    return _newton(points)


def _strip(f: fmpq_poly, g: fmpq_poly) -> fmpq_poly:
    """Divides f by everything it has in common with powers of g."""
    while (common := f.gcd(g)).degree() > 0:
        f //= common
    return f


def _roots(f: fmpq_poly) -> tuple[list[tuple[arb, int]], list[Any]]:
    """Returns the real roots with multiplicities, ascending, and the others; isolated by flint."""
    real, other = [], []
    for root, multiplicity in f.complex_roots():
        if root.imag.is_zero():
            real.append((root.real, multiplicity))
        else:
            other.append(root)
    return sorted(real, key=lambda pair: float(pair[0].mid())), other


# --- cusps ---------------------------------------------------------------------------------------------------


def cusp_points(geometry: Geometry, fixed_axis: int, fixed_value: float) -> list[Cusp]:
    """Returns all cusps of the section, certified: none is missing, each is one simple zero of (D, E).

    Args:
        geometry: The robot; a member of the analytic family is solved through its cubic.
        fixed_axis: The fixed leg: 1, 2 or 3.
        fixed_value: Its length.

    Returns:
        One entry for every singular pose that maps to a cusp, ordered by phi.

    Raises:
        Degenerate: If the section is not a generic one.
    """
    with ctx.workprec(PREC):
        if geometry.mirrored():
            found = _analytic_cusps(geometry, fixed_axis, fixed_value)
        else:
            found = _general_cusps(Section(geometry, fixed_axis, fixed_value))[0]
    return sorted(found, key=lambda cusp: cusp.floats()[1][2])


def _general_cusps(section: Section) -> tuple[list[Cusp], float]:
    """Returns the cusps and how near the next cusps of complex pose are: the least |Im phi| of these."""
    chart = _Chart(section)
    if chart.delta.is_zero():
        raise Degenerate("the platform mirrors the base: describe it by `analytic`")
    resultant = _eliminate(chart.det, chart.convex)
    if resultant.is_zero():
        raise Degenerate("D and E have a common factor")
    # At each of the two angles with Delta = 0 the two spurious points are simple zeros.
    resultant, rest = divmod(resultant, chart.delta**2)
    if not rest.is_zero() or resultant.gcd(chart.delta).degree() > 0:
        raise Degenerate("a cusp at an angle with Delta = 0, or a special robot")
    resultant = _strip(resultant, 1 + _T**2)
    if resultant.degree() != 24:
        raise Degenerate(f"{resultant.degree()} complex cusps instead of 24")
    real, other = _roots(resultant)
    cusps = []
    for t, multiplicity in real:
        if multiplicity > 1:
            raise Degenerate(f"two cusps at one angle (multiplicity {multiplicity})")
        f, g = ([arb_poly(p)(t) for p in polys] for polys in (chart.det, chart.convex))
        # The last two columns' minors of the first subresultant: minor1 s + minor0 = 0 at the common root.
        rows = _sylvester(f, g, 1)
        minors = [arb_mat([[*row[: len(rows) - 1], row[k]] for row in rows]).det() for k in (-2, -1)]
        s = -minors[1] / minors[0]
        cusps.append(chart.joints(*_certify(chart, s, t)))
    spread = min((abs(float((2 * root.atan()).imag.mid())) for root in other), default=math.inf)
    return cusps, spread


def _certify(chart: _Chart, s: arb, t: arb) -> tuple[arb, arb]:
    """Encloses the one zero of (D, E) near (s, t) by the interval Newton method."""

    def value(polys: list[fmpq_poly], s: arb, t: arb) -> arb:
        return arb_poly([arb_poly(p)(t) for p in polys])(s)

    def slopes(polys: list[fmpq_poly], s: arb, t: arb) -> tuple[arb, arb]:
        by_s = [k * polys[k] for k in range(1, len(polys))]
        return value(by_s, s, t), value([p.derivative() for p in polys], s, t)

    def newton(s: arb, t: arb, box: tuple[arb, arb]) -> tuple[arb, arb]:
        f, g = value(chart.det, s, t), value(chart.convex, s, t)
        (fs, ft), (gs, gt) = slopes(chart.det, *box), slopes(chart.convex, *box)
        det = fs * gt - ft * gs
        if det.contains(0):
            raise Degenerate("the zero of (D, E) is not simple")
        return s - (gt * f - ft * g) / det, t - (fs * g - gs * f) / det

    s, t = s.mid(), t.mid()
    for _ in range(4):
        s, t = (v.mid() for v in newton(s, t, (s, t)))
    box = tuple(v + arb(0, 2.0**-200) * (1 + abs(v)) for v in (s, t))
    image = newton(s, t, box)
    if not all(b.contains_interior(v) for b, v in zip(box, image, strict=True)):
        raise Degenerate("no certificate: the zero of (D, E) is nearly multiple")
    return image


def _analytic_cusps(geometry: Geometry, axis: int, value: float) -> list[Cusp]:
    """Solves F = F' = F'' = 0 for the cubic F(t) = F0 + A F1 + B F2 of the family.

    With (S, C) ~ (t, 1), u = c2 S and v = c3 S - d3 C: 4 u v (u - v) + (A v - B u)(S^2 + C^2) = 0, where A = r1 - r2,
    B = r1 - r3. (S, C) is turned so that no solution is at infinity.
    """
    c2, (c3, d3) = geometry.base()[1][0], geometry.base()[2]
    turn = fmpq(2, 7)
    sine, cosine = _T + turn, 1 - turn * _T
    u, v, e = c2 * sine, c3 * sine - d3 * cosine, sine**2 + cosine**2
    forms = 4 * u * v * (u - v), v * e, -u * e
    # A binary cubic has a triple root where its second derivatives vanish; the third equation, in (t, 1), is
    # Euler's: 3 F = t F_t + F_1, so take F, F_t, F_tt.
    rows = [forms, tuple(f.derivative() for f in forms), tuple(f.derivative().derivative() for f in forms)]

    def minor(i: int, j: int, p: int, q: int) -> fmpq_poly:
        return rows[i][p] * rows[j][q] - rows[i][q] * rows[j][p]

    det = rows[2][0] * minor(0, 1, 1, 2) + rows[2][1] * minor(0, 1, 2, 0) + rows[2][2] * minor(0, 1, 0, 1)
    det = _strip(det, 1 + _T**2)
    cusps = []
    for t, multiplicity in _roots(det)[0]:
        if multiplicity > 1:
            raise Degenerate("a quadruple root")
        at = [[arb_poly(f)(t) for f in row] for row in rows]
        solved = arb_mat([row[1:] for row in at[:2]]).solve(arb_mat([[-row[0]] for row in at[:2]]))
        a, b = solved[0, 0], solved[1, 0]
        r = arb(rational(value)) ** 2
        r1 = (r, r + a, r + b)[axis - 1]
        squares = r1, r1 - a, r1 - b
        norm = arb_poly(e)(t).sqrt()
        sh, ch, uh, vh = (arb_poly(f)(t) / norm for f in (sine, cosine, u, v))
        # h = X . (-S, C) from the leg whose line is the better one, and X = p (C, S) + h (-S, C).
        h = -a / (4 * uh) - uh if abs(uh) > abs(vh) else -b / (4 * vh) - vh
        room = r1 - h * h
        if min(float(x.mid()) for x in (*squares, room)) < 0:
            continue
        phi = _wrap(2 * arb.atan2(sh, ch))
        for p in (room.sqrt(), -room.sqrt()):
            cusps.append(Cusp(tuple(x.sqrt() for x in squares), (p * ch - h * sh, p * sh + h * ch, phi)))
    return cusps


# --- connected components ------------------------------------------------------------------------------------


class Components(NamedTuple):
    """The closed curves of a section's singular set on the torus.

    Attributes:
        count: Their number.
        turning: The number of points at which the angle (phi, unless said otherwise) turns back.
        margin: Least distance of two such angles, or of a complex one from the real axis: small near lips and
            beaks (but also without a reason, where two turning points happen to have similar angles).
    """

    count: int
    turning: int
    margin: float


def components(geometry: Geometry, fixed_axis: int, fixed_value: float, over_alpha: bool = False) -> Components:
    """Counts the connected components of the section's singular curve on the torus (alpha, phi), exactly.

    Between the angles phi at which D = 0 has a double root alpha, or the root s = infinity, the real roots s are
    functions of t in a fixed order; at these angles two of them meet, or one passes through infinity.

    Args:
        geometry: The robot.
        fixed_axis: The fixed leg: 1, 2 or 3.
        fixed_value: Its length.
        over_alpha: Exchange the parts of alpha and phi: another decomposition of the same curve.

    Raises:
        Degenerate: If the curve meets itself or is a point somewhere.
    """
    with ctx.workprec(PREC):
        chart = _Chart(Section(geometry, fixed_axis, fixed_value))
        det = chart.det
        if over_alpha:
            det = [fmpq_poly([p[k] for p in det]) for k in range(5)]
        discriminant = _eliminate([k * det[k] for k in range(1, 5)], [(4 - k) * det[k] for k in range(4)])
        discriminant = _strip(discriminant, 1 + _T**2)
        folds, other = _roots(discriminant)
        if any(multiplicity > 1 for _, multiplicity in folds):
            raise Degenerate("the singular curve crosses itself")
        wraps = _roots(det[4])[0]
        events = sorted([(t, True) for t, _ in folds] + [(t, False) for t, _ in wraps], key=lambda e: float(e[0].mid()))
        count = _link(det, events)
        angles = sorted(float((2 * t.atan()).mid()) for t, _ in folds)
        gaps = [b - a for a, b in pairwise([*angles, angles[0] + 2 * math.pi])] if angles else []
        gaps += [abs(float((2 * t.atan()).imag.mid())) for t in other]
        return Components(count, len(folds), min(gaps, default=math.inf))


def _link(det: list[fmpq_poly], events: list[tuple[arb, bool]]) -> int:
    def real_roots(t: fmpq) -> list[arb]:
        roots, _ = _roots(fmpq_poly([p(t) for p in det]))
        return [s for s, _ in roots]

    if not events:
        return len(real_roots(fmpq(0)))
    centres = [t.mid() for t, _ in events]
    gap = min((q - p for p, q in pairwise(centres)), default=arb(1))
    step = fmpq(1, 2 ** max(60, 60 - math.floor(math.log2(float(gap.mid())))))
    # Samples on both sides of each event; (interval, place in order) are the nodes of the graph.
    sides = [tuple(real_roots(_round(t, 300) + sign * step) for sign in (-1, 1)) for t in centres]
    parent: dict[tuple[int, int], tuple[int, int]] = {}

    def find(node: tuple[int, int]) -> tuple[int, int]:
        while parent.setdefault(node, node) != node:
            node = parent[node]
        return node

    def join(p: tuple[int, int], q: tuple[int, int]) -> None:
        parent[find(p)] = find(q)

    total = len(events)
    for i, ((_, fold), (left, right)) in enumerate(zip(events, sides, strict=True)):
        j = (i + 1) % total  # interval i lies left of event i, interval i + 1 right of it
        if len(sides[j][0]) != len(right):
            raise Degenerate("the number of roots changes between two events")
        small, large = sorted((left, right), key=len)
        if fold:
            if len(large) != len(small) + 2:
                raise Degenerate("an event that is not a turning point")
            gaps = sorted((float((q - p).mid()), k) for k, (p, q) in enumerate(pairwise(large)))
            if len(gaps) > 1 and gaps[1][0] < 1e4 * gaps[0][0]:
                raise Degenerate("it is not clear which branches meet")
            k = gaps[0][1]
            near, far = (i, j) if large is left else (j, i)
            join((near, k), (near, k + 1))
            for m in range(len(small)):
                join((far, m), (near, m if m < k else m + 2))
        elif left:
            if len(left) != len(right):
                raise Degenerate("two branches at infinity")
            ends = [(abs(float(side[0].mid())), abs(float(side[-1].mid()))) for side in (left, right)]
            before, after = ("low" if a > b else "high" for a, b in ends)
            if before == after:
                raise Degenerate("a branch touches infinity")
            shift = 1 if before == "high" else -1
            for m in range(len(left)):
                join((i, m), (j, (m + shift) % len(left)))
    # An event without branches on either side adds no nodes; every other node has been joined or created.
    for i, (left, right) in enumerate(sides):
        for m in range(len(left)):
            find((i, m))
        for m in range(len(right)):
            find(((i + 1) % total, m))
    return len({find(node) for node in list(parent)})


# --- the data file -------------------------------------------------------------------------------------------


def random_section(seed: int) -> tuple[Geometry, int, float]:
    """Draws a robot with sides near 1 and a section of it; every fourth base and every fourth platform is flat."""
    rng = np.random.default_rng(seed)
    c2, l2, l3, value = rng.uniform((0.6, 0.4, 0.4, 0.4), (2.0, 2.0, 2.0, 2.5)).round(3).tolist()
    c3, d3, beta = rng.uniform((-1.0, 0.3, -3.1), (2.0, 2.0, 3.1)).round(3).tolist()
    if seed % 4 == 1:
        d3 = 0.0
    elif seed % 4 == 2:
        beta = 0.0
    return Geometry(c2, c3, d3, l2, l3, beta), 1 + seed % 3, value


def near_event(seed: int, low: float, high: float, offset: float) -> tuple[Geometry, int, float]:
    """Returns the section of a random robot at `offset` (relative) from where its counts change in (low, high)."""
    geometry, axis, _ = random_section(seed)
    before = _counts(geometry, axis, low)
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if _counts(geometry, axis, middle) == before else (low, middle)
    return geometry, axis, round(high * (1 + offset), 7)


def _counts(geometry: Geometry, axis: int, value: float) -> tuple[int, int]:
    return len(cusp_points(geometry, axis, value)), components(geometry, axis, value).count


def describe(geometry: Geometry, fixed_axis: int, fixed_value: float) -> dict[str, Any]:
    """Returns one entry of the data file; the counts are those of two exact decompositions and of two scans.

    Raises:
        RuntimeError: If these disagree.
    """
    cusps = cusp_points(geometry, fixed_axis, fixed_value)
    if max((cusp.radius() for cusp in cusps), default=0.0) > 1e-100:
        raise RuntimeError("the balls of the cusps are too large")
    parts = components(geometry, fixed_axis, fixed_value)
    if components(geometry, fixed_axis, fixed_value, over_alpha=True).count != parts.count:
        raise RuntimeError("the decompositions over phi and over alpha disagree")
    expected, sizes, size = Scan(parts.count, len(cusps)), [], 250
    while len(sizes) < 2:
        seen = scan(geometry, fixed_axis, fixed_value, size) == expected
        sizes = [*sizes, size] if seen else []
        if size > 5000:
            raise RuntimeError(f"no two scans in a row agree with {expected}")
        size = size * 8 // 5
    with ctx.workprec(PREC):
        spread = _general_cusps(Section(geometry, fixed_axis, fixed_value))[1]
    changes, step = [], 1e-3
    here = Scan(parts.count, len(cusps))[::-1]
    for sign in (-1, 1):
        for k in range(1, 21):
            near, far = (fixed_value * (1 + sign * step * j) for j in (k - 1, k))
            if (there := _counts(geometry, fixed_axis, far)) != here:
                while abs(far - near) > 1e-9 * far:
                    middle = (near + far) / 2
                    same = _counts(geometry, fixed_axis, middle) == here
                    near, far = (middle, far) if same else (near, middle)
                there = _counts(geometry, fixed_axis, far)
                changes.append({"value": far, "cusps": there[0], "components": there[1]})
                break
    names = ("c2", "c3", "d3", "l2", "l3", "beta")
    return {
        "geometry": {name: getattr(geometry, name) for name in names},
        "fixed_axis": fixed_axis,
        "fixed_value": fixed_value,
        "components": parts.count,
        "turning_points_in_phi": parts.turning,
        "cusps": [dict(zip(("rho", "pose"), cusp.floats(), strict=True)) for cusp in cusps],
        "scans": sizes,
        "least_imaginary_phi_of_complex_cusps": spread,
        "changes_within_two_percent": changes,
    }


ABOUT = (
    "Sections of the joint space of planar 3-RPR robots with one leg fixed (fixed_axis 1, 2 or 3 at fixed_value), "
    "written by `python -m tests.oracles.rpr3_sections`. Base (0, 0), (c2, 0), (c3, d3); platform (0, 0), (l2, 0), "
    "l3 (cos beta, sin beta). cusps: all of them, from a resultant with rational coefficients and certified balls "
    "(radius below 1e-100), rounded to float64; rho = three leg lengths, pose = x, y of the first platform joint and "
    "phi in (-pi, pi]. components: closed curves of singular poses on the torus of poses with that leg length "
    "(direction of the fixed leg, phi), by exact decompositions over phi and over the leg's direction. scans: sizes "
    "of two grids of the torus that show the same numbers of cusps and components. changes_within_two_percent: the "
    "nearest fixed values below and above at which these numbers change (sampled by 0.1 percent and bisected), with "
    "the numbers beyond; pairs of events within 0.1 percent that cancel are not seen."
)


def main(path: str) -> None:
    """Writes the data file."""
    cases = {
        "reference, rho1 = 14.98": (REFERENCE, 1, 14.98),
        "reference, rho1 = 17": (REFERENCE, 1, 17.0),
        **{f"seed {seed}, {what}": random_section(seed) for seed, what in SEEDS.items()},
        **{f"seed {seed}, {what}": near_event(seed, *rest) for seed, what, *rest in EVENTS},
    }
    entries = []
    for name, case in cases.items():
        entries.append({"name": name, **describe(*case)})
        print(name, len(entries[-1]["cusps"]), entries[-1]["components"], entries[-1]["changes_within_two_percent"])
    Path(path).write_text(json.dumps({"about": ABOUT, "sections": entries}, indent=1) + "\n")


SEEDS = {
    0: "ordinary",
    3: "ordinary",
    5: "flat base",
    7: "ordinary",
    10: "flat platform",
    1: "flat base, few cusps, three components",
    199: "few cusps, three components",
    378: "flat platform, no cusp",
    1122: "flat platform, no cusp",
    14: "flat platform, many cusps",
    569: "flat base, many cusps",
    959: "many cusps",
    120: "many cusps",
    847: "many cusps, three components, narrow necks",
}
# Seed, name, an interval of the fixed value with one change of the counts, and the section's relative offset from it.
EVENTS = [
    (120, "ten cusps, just past beaks", 1.75, 1.79, 1e-4),
    (120, "ten cusps, just past a swallowtail", 1.86, 1.91, 1e-4),
    (14, "flat platform, just short of beaks", 2.1, 2.19, -1e-4),
    (41, "flat base, just past beaks and a swallowtail that are 1e-9 apart or less", 2.1, 2.15, 1e-4),
]

if __name__ == "__main__":
    main(sys.argv[1])
