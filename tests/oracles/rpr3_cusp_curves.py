"""Cusp curves of planar 3-RPR robots and where their sections gain or lose cusps, by exact elimination.

Let one leg be the first, X its platform joint seen from its base joint, phi the platform's angle. The other legs are
|X + w_i| with w_i(phi) = R b_i - a_i; tau_i = (X + w_i) . J R b_i, J the quarter turn. With X = lam U(m), U a direction
of slope m, the direct determinant is, but for a factor lam, linear in lam,

    D / lam = lam D2(m, t) + D1(m, t),     t a half-angle tangent of phi,

and a kernel vector is (tau_2 J X, -X x w_2). Its derivative of D is lam (lam^2 a + lam b + c). Inserting
lam = -D1 / D2 gives one polynomial G(m, t) whose real zeros are all cusps of the robot, after division by the one
spurious factor U x w_2: a plane curve of degree (4, 10). On it the squared first leg is D1^2 |U|^2 / D2^2, and

* the cusps of the section rho = const are the roots in t of one resultant, of degree 24 after removal of Res(D1, D2);
* the number of cusps changes where rho is critical on G = 0: roots of another resultant. All are isolated in
  certified balls, so that none is missing, however narrow the bands between them.

The analytic family (platform = mirrored base) has closed forms: `rpr3_cusp_edges`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from flint import arb, ctx, fmpq, fmpq_mpoly, fmpq_mpoly_ctx, fmpq_poly

from .rpr3_torus import REFERENCE, Degenerate, Geometry

_CTX = fmpq_mpoly_ctx.get(("m", "t"))
_M, _T = _CTX.gens()
_TURN_T, _TURN_M = fmpq(5, 13), fmpq(3, 7)
_E = 1 + _T**2
_UNIT = fmpq_poly([1, 0, 1])
Pair = tuple[Any, Any]

DATA = Path(__file__).parents[1] / "data" / "rpr3_cusp_transitions.json"


def _cross(u: Pair, v: Pair) -> Any:
    return u[0] * v[1] - u[1] * v[0]


def _dot(u: Pair, v: Pair) -> Any:
    return u[0] * v[0] + u[1] * v[1]


def _turned(u: Pair) -> Pair:
    return -u[1], u[0]


def _derivative_of_determinant(tau: list[Any], area: list[Any], dtau: list[Any], darea: list[Any]) -> Any:
    """Returns the derivative of tau_3 area_2 - tau_2 area_3."""
    return dtau[1] * area[0] + tau[1] * darea[0] - dtau[0] * area[1] - tau[0] * darea[1]


# --- the plane curve of all cusps ------------------------------------------------------------------------------


class Transition(NamedTuple):
    """A place where the number of cusps of the sections rho_axis = const changes.

    Attributes:
        value: rho_axis.
        below: Number of cusps of the section just below, between this and the last transition.
        above: The same above.
        kind: "swallowtail", "lips" or "beaks".
        joints: The three leg lengths.
        pose: x, y, phi of the platform point B1.
    """

    value: float
    below: int
    above: int
    kind: str
    joints: tuple[float, float, float]
    pose: tuple[float, float, float]


@dataclass(frozen=True)
class CuspCurve:
    """All cusps of a robot as one plane curve, seen from one leg.

    Attributes:
        geometry: The robot, not a member of the analytic family.
        axis: The leg that plays the first: 1, 2 or 3.
    """

    geometry: Geometry
    axis: int

    @cached_property
    def legs(self) -> list[tuple[Pair, Pair]]:
        """The other legs' base and platform joints seen from this leg's."""
        base, platform = self.geometry.base(), self.geometry.platform()
        k = self.axis - 1
        return [
            ((base[i][0] - base[k][0], base[i][1] - base[k][1]), (b[0] - platform[k][0], b[1] - platform[k][1]))
            for i, b in enumerate(platform)
            if i != k
        ]

    @cached_property
    def polynomials(self) -> tuple[fmpq_mpoly, fmpq_mpoly, fmpq_mpoly, fmpq_mpoly]:
        """G, D1, D2 and |U|^2, in m and t."""
        if self.geometry.mirrored():
            raise Degenerate("the platform mirrors the base: take `rpr3_cusp_edges`")
        c0, s0 = (1 - _TURN_T**2) / (1 + _TURN_T**2), 2 * _TURN_T / (1 + _TURN_T**2)
        c, s = c0 * (1 - _T**2) - s0 * 2 * _T, s0 * (1 - _T**2) + c0 * 2 * _T
        u: Pair = (1 - _TURN_M * _M, _TURN_M + _M)
        arms = [(c * b[0] - s * b[1], s * b[0] + c * b[1]) for _, b in self.legs]  # times 1 + t^2, as all below
        turns = [_turned(arm) for arm in arms]
        lines = [(arm[0] - _E * a[0], arm[1] - _E * a[1]) for arm, (a, _) in zip(arms, self.legs, strict=True)]
        feet = [a for a, _ in self.legs]

        def dots(x: Pair, ys: list[Pair]) -> list[Any]:
            return [_dot(x, y) for y in ys]

        tau1, tau0 = dots(u, turns), [-_dot(a, y) for a, y in zip(feet, turns, strict=True)]
        area = [_cross(u, w) for w in lines]
        d2 = tau1[1] * area[0] - tau1[0] * area[1]
        d1 = tau0[1] * area[0] - tau0[0] * area[1]
        zero = [0 * _T, 0 * _T]
        # X turns: U moves along J U.
        area_u = [_cross(_turned(u), w) for w in lines]
        turn2 = _derivative_of_determinant(tau1, area, dots(_turned(u), turns), area_u)
        turn1 = _derivative_of_determinant(tau0, area, zero, area_u)
        # The platform turns: R b moves along J R b, and that against R b.
        area_p = [_cross(u, y) for y in turns]
        spin2 = _derivative_of_determinant(tau1, area, [-v for v in dots(u, arms)], area_p)
        spin1 = _derivative_of_determinant(tau0, area, [_dot(a, y) for a, y in zip(feet, arms, strict=True)], area_p)
        a = tau1[0] * turn2 - area[0] * spin2
        b = tau1[0] * turn1 + tau0[0] * turn2 - area[0] * spin1
        g, rest = divmod(d1**2 * a - d1 * d2 * b + d2**2 * tau0[0] * turn1, area[0])
        assert rest == 0
        while (divided := divmod(g, _E))[1] == 0:
            g = divided[0]
        return g, d1, d2, _dot(u, u)

    @cached_property
    def spurious(self) -> fmpq_poly:
        """The angles at which D contains a line through X = 0: nodes of G = 0, not of the cusp curve."""
        _, d1, d2, _ = self.polynomials
        return _univariate(d1.resultant(d2, "m"))

    def section_polynomial(self, squared: fmpq) -> fmpq_poly:
        """Returns the polynomial of degree 24 in t whose real roots are the cusps of the section."""
        g, d1, d2, norm = self.polynomials
        found = _univariate(g.resultant(d1**2 * norm - squared * d2**2, "m"))
        found = _without(_without(found, self.spurious), _UNIT)
        if found.degree() != 24:
            raise Degenerate(f"{found.degree()} complex cusps instead of 24")
        return found

    def count(self, squared: fmpq) -> int:
        """Returns the number of cusps of the section whose first leg has this squared length."""
        roots = self.section_polynomial(squared).complex_roots()
        if any(multiplicity > 1 for _, multiplicity in roots):
            raise Degenerate("two cusps at one angle")
        return sum(1 for root, _ in roots if root.imag.is_zero())

    def critical_polynomial(self) -> tuple[fmpq_poly, fmpq_mpoly]:
        """Returns the polynomial in t of all critical points of rho on the curve, and the condition in m and t."""
        g, d1, d2, norm = self.polynomials
        gm, gt, nm = g.derivative("m"), g.derivative("t"), norm.derivative("m")
        rm = 2 * norm * (d1.derivative("m") * d2 - d1 * d2.derivative("m")) + d1 * d2 * nm
        rt = 2 * norm * (d1.derivative("t") * d2 - d1 * d2.derivative("t"))
        condition = gm * rt - gt * rm
        found = _univariate(g.resultant(condition, "m"))
        # At m = infinity the condition vanishes with G's leading coefficient, by the choice of the coordinate.
        top = fmpq_poly([g[(4, k)] for k in range(g.degrees()[1] + 1)])
        for factor in (self.spurious, _UNIT, top):
            found = _without(found, factor)
        return found, condition


def _univariate(p: fmpq_mpoly) -> fmpq_poly:
    return fmpq_poly([p[(0, k)] for k in range(p.degrees()[1] + 1)])


def _without(f: fmpq_poly, g: fmpq_poly) -> fmpq_poly:
    while (common := f.gcd(g)).degree() > 0:
        f //= common
    return f


def _at(p: fmpq_mpoly, m: arb, t: arb) -> arb:
    return sum((arb(c) * m ** int(i) * t ** int(j) for (i, j), c in p.terms()), arb(0))


# --- transitions -------------------------------------------------------------------------------------------------


def transitions(geometry: Geometry, axis: int, bits: int = 400) -> list[Transition]:
    """Returns all transitions of the sections rho_axis = const, ascending; none is missing.

    Args:
        geometry: The robot, not of the analytic family.
        axis: The leg whose length is fixed: 1, 2 or 3.
        bits: Precision of the balls.

    Raises:
        Degenerate: If two transitions coincide or the robot is a special one.
    """
    curve = CuspCurve(geometry, axis)
    with ctx.workprec(bits):
        found, condition = curve.critical_polynomial()
        points = []
        for root, multiplicity in found.complex_roots():
            if root.imag.is_zero():
                if multiplicity > 1:
                    raise Degenerate("two transitions at one angle")
                points.append(_pose_of(curve, condition, root.real))
        points.sort(key=lambda point: float(point[0]))
        edges = [points[0][0] / 2, *(r for r, _, _ in points), points[-1][0] * 4]
        counts = [curve.count(_rational((lo + hi) / 2)) for lo, hi in pairwise(edges)]
        return [
            _transition(curve, point, below, above)
            for point, below, above in zip(points, counts, counts[1:], strict=False)
        ]


def _rational(value: arb) -> fmpq:
    return fmpq(int((value * 2**200).mid().floor().unique_fmpz()), 2**200)


def _pose_of(curve: CuspCurve, condition: fmpq_mpoly, t: arb) -> tuple[arb, Pair, arb]:
    """Returns the squared leg, X and phi of the critical point with this t."""
    g, d1, d2, _ = curve.polynomials
    quartic = [sum((arb(g[(k, j)]) * t**j for j in range(g.degrees()[1] + 1)), arb(0)) for k in range(5)]
    slopes = []
    for guess in np.roots([float(v.mid()) for v in quartic[::-1]]):
        if abs(guess.imag) > 1e-6 * (1 + abs(guess)):
            continue
        m = arb(float(guess.real))
        for _ in range(14):
            value = sum((v * m**k for k, v in enumerate(quartic)), arb(0))
            slope = sum((k * v * m ** (k - 1) for k, v in enumerate(quartic) if k), arb(0))
            m = (m - value / slope).mid()
        slopes.append(m)
    sizes = sorted((abs(float(_at(condition, m, t).mid())) / _size(condition, m, t), i) for i, m in enumerate(slopes))
    if sizes[0][0] > 1e-60 or (len(sizes) > 1 and sizes[1][0] < 1e-30):
        raise Degenerate(f"the slope of a critical point is not clear: {sizes}")
    m = slopes[sizes[0][1]]
    lam = -_at(d1, m, t) / _at(d2, m, t)
    x = lam * (1 - arb(_TURN_M) * m), lam * (arb(_TURN_M) + m)
    return _dot(x, x), x, 2 * (arb(_TURN_T).atan() + t.atan())


def _size(p: fmpq_mpoly, m: arb, t: arb) -> float:
    return float(sum((abs(arb(c) * m ** int(i) * t ** int(j)) for (i, j), c in p.terms()), arb(0)).mid())


def _transition(curve: CuspCurve, point: tuple[arb, Pair, arb], below: int, above: int) -> Transition:
    squared, x, phi = point
    robot = _Robot(curve.geometry)
    foot, swung = robot.base[curve.axis - 1], _rotated(phi, robot.platform[curve.axis - 1])
    pose = [foot[0] + x[0] - swung[0], foot[1] + x[1] - swung[1], phi]
    kind = _kind(robot, [v.mid() for v in pose], curve.axis - 1)
    joints = tuple(float(v.sqrt().mid()) for v in robot.squares(pose))
    x1, y1, angle = (float(v.mid()) for v in pose)
    return Transition(
        float(squared.sqrt().mid()), below, above, kind, joints, (x1, y1, math.remainder(angle, 2 * math.pi))
    )


class _Robot:
    """Squared lengths, determinant and kernel in balls, derivatives by differences far below the balls' precision."""

    def __init__(self, geometry: Geometry) -> None:
        self.base = [tuple(map(arb, p)) for p in geometry.base()]
        self.platform = [tuple(map(arb, p)) for p in geometry.platform()]

    def tips(self, pose: list[arb]) -> list[tuple[Pair, Pair]]:
        arms = [_rotated(pose[2], b) for b in self.platform]
        return [
            ((pose[0] + arm[0] - a[0], pose[1] + arm[1] - a[1]), arm) for arm, a in zip(arms, self.base, strict=True)
        ]

    def squares(self, pose: list[arb]) -> list[arb]:
        return [_dot(tip, tip) for tip, _ in self.tips(pose)]

    def rows(self, pose: list[arb]) -> list[list[arb]]:
        return [[*tip, _dot(tip, _turned(arm))] for tip, arm in self.tips(pose)]

    def determinant(self, pose: list[arb]) -> arb:
        p, q, r = self.rows(pose)
        return _inner(p, _outer(q, r))

    def kernel(self, pose: list[arb], pair: tuple[int, int]) -> list[arb]:
        rows = self.rows(pose)
        return _outer(rows[pair[0]], rows[pair[1]])

    def best_pair(self, pose: list[arb]) -> tuple[int, int]:
        sizes = {pair: float(_norm(self.kernel(pose, pair)).mid()) for pair in ((0, 1), (1, 2), (2, 0))}
        return max(sizes, key=lambda pair: sizes[pair])


def _rotated(phi: arb, b: Pair) -> Pair:
    c, s = phi.cos(), phi.sin()
    return c * b[0] - s * b[1], s * b[0] + c * b[1]


def _inner(u: list[arb], v: list[arb]) -> arb:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _outer(u: list[arb], v: list[arb]) -> list[arb]:
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


def _norm(u: list[arb]) -> arb:
    return _inner(u, u).sqrt()


def _gradient(f: Callable[[list[arb]], arb], pose: list[arb]) -> list[arb]:
    step = arb(2) ** -100
    ends = []
    for i in range(3):
        high, low = (f([v + sign * step * (i == j) for j, v in enumerate(pose)]) for sign in (1, -1))
        ends.append(((high - low) / (2 * step)).mid())
    return ends


def _sine(u: list[arb], v: list[arb]) -> float:
    return float((_norm(_outer(u, v)) / (_norm(u) * _norm(v))).mid())


def _kind(robot: _Robot, pose: list[arb], leg: int) -> str:
    """Names the transition: the curve's tangent lies in the kernel, or the section is singular (lips, beaks).

    Raises:
        Degenerate: If it is both or neither.
    """
    pair = robot.best_pair(pose)

    def bend(at: list[arb]) -> arb:
        return _inner(_gradient(robot.determinant, at), robot.kernel(at, pair))

    def square(at: list[arb]) -> arb:
        return robot.squares(at)[leg]

    slope, rate = _gradient(robot.determinant, pose), _gradient(square, pose)
    kernel = robot.kernel(pose, pair)
    tangent = _outer(slope, _gradient(bend, pose))
    along, across = _sine(tangent, kernel), _sine(slope, rate)
    if min(along, across) > 1e-20 or max(along, across) < 1e-9:
        raise Degenerate(f"no plain transition: sines {along}, {across}")
    if along < across:
        return "swallowtail"
    ratio = _inner(slope, rate) / _inner(rate, rate)

    def combined(at: list[arb]) -> arb:
        return robot.determinant(at) - ratio * square(at)

    hessian = [_gradient(lambda at, i=i: _gradient(combined, at)[i], pose) for i in range(3)]
    first = kernel
    second = _outer(rate, kernel)
    forms = [[_inner(u, [_inner(row, v) for row in hessian]) for v in (first, second)] for u in (first, second)]
    return "lips" if forms[0][0] * forms[1][1] > forms[0][1] * forms[1][0] else "beaks"


# --- data file ---------------------------------------------------------------------------------------------------


def describe(geometry: Geometry) -> dict[str, Any]:
    """Returns the transitions of all three legs."""
    return {f"rho{axis}": [transition._asdict() for transition in transitions(geometry, axis)] for axis in (1, 2, 3)}


if __name__ == "__main__":
    DATA.write_text(json.dumps({"reference": describe(REFERENCE)}, indent=1) + "\n")
