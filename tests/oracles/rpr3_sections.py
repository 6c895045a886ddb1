"""Cusps and components of a section exactly: certified roots, cylindrical decomposition. See ``rpr3_torus``."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

from flint import arb, arb_mat, arb_poly, ctx, fmpq, fmpq_mat, fmpq_poly

from .rpr3_exact import rational
from .rpr3_torus import ONE, PREC, Cusp, Degenerate, Geometry, Number, Point, Section, T, rounded

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
    result, basis = fmpq_poly(), ONE
    for x, y in points:
        result += basis * ((y - result(x)) / basis(x))
        basis *= T - x
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
            found = general_cusps(Section(geometry, fixed_axis, fixed_value))[0]
    return sorted(found, key=lambda cusp: cusp.floats()[1][2])


def general_cusps(section: Section) -> tuple[list[Cusp], float]:
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
    resultant = _strip(resultant, 1 + T**2)
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
    sine, cosine = T + turn, 1 - turn * T
    u, v, e = c2 * sine, c3 * sine - d3 * cosine, sine**2 + cosine**2
    forms = 4 * u * v * (u - v), v * e, -u * e
    # A binary cubic has a triple root where its second derivatives vanish; the third equation, in (t, 1), is
    # Euler's: 3 F = t F_t + F_1, so take F, F_t, F_tt.
    rows = [forms, tuple(f.derivative() for f in forms), tuple(f.derivative().derivative() for f in forms)]

    def minor(i: int, j: int, p: int, q: int) -> fmpq_poly:
        return rows[i][p] * rows[j][q] - rows[i][q] * rows[j][p]

    det = rows[2][0] * minor(0, 1, 1, 2) + rows[2][1] * minor(0, 1, 2, 0) + rows[2][2] * minor(0, 1, 0, 1)
    det = _strip(det, 1 + T**2)
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
        discriminant = _strip(discriminant, 1 + T**2)
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
    sides = [tuple(real_roots(rounded(t, 300) + sign * step) for sign in (-1, 1)) for t in centres]
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
