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

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from flint import arb, ctx, fmpq, fmpq_poly

from .rpr3_exact import rational

Number = Any  # float, array, fmpq or arb: the formulas below are written once for all of them
Point = tuple[Number, Number]

PREC = 700  # bits of the balls
_POWERS = np.arange(-2, 3)
ONE, T = fmpq_poly([1]), fmpq_poly([0, 1])


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
                third = rounded(l3 * beta.cos(), 200), rounded(l3 * beta.sin(), 200)
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


def rounded(value: arb, bits: int) -> fmpq:
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
