"""The TLPM robot in certified balls: positions from distance geometry, wrist and links from vectors.

Robot: Fu and Gao, "Kinematic Performances of a Novel TLPM Parallel Robot". Base joints q_i = (L cos eta_i,
L sin eta_i, -h), eta = 0, 120, -120 degrees, here L = `radius`, h = `height`; limb lengths |p - q_i| = L_i0 + l_i.

Position: the bordered Cayley-Menger matrix of the base triangle gives the barycentric weights of the foot of p on
the base plane and the squared height of p over that plane. With the default angles the squared sides 3 L^2 are
rational, and lengths lie in Q(sqrt(L^2 + h^2)), so the number of solutions is decided exactly.

Wrist: the paper prints no consistent model, so this is a reading of it. All axes of a limb meet in p: limb axis z1 =
unit(q_i - p); R1 axis z2, perpendicular to z1 and to the R2 axis; R2 axis z3 = Q Rz(eta_i) (sin45, 0, cos45), Q the
rotation of the platform. The elbow e = +-1 picks z2 = e unit(z1 x z3). Right-handed angles, in radians:

    theta1   about z2, from z1 to z3: e times the angle between them, which lies in (0, pi);
    theta2   about z3, from the part of the platform normal Q e_z perpendicular to z3 to z2;
    psi      about z1, from -y to z2, in the limb frame x = unit(t x z), y = z x x, z = z1, with t =
             (-sin eta_i, cos eta_i, 0) the base axis of the universal joint.

So v_i = R_i0 Rz(psi) Rx(pi/2) Rz(theta1) Ry(pi/2 - theta2) for both elbows, R_i0 = (x, y, z), v_i = Q Rz(eta_i)
Ry(pi/4) Rx(pi/2). The other elbow turns psi and theta2 by pi and negates theta1. At home with L = h: psi = 0, theta1 =
theta2 = pi/2 for e = 1. The reflection y -> -y exchanges limbs 2 and 3, turns e = 1 into e = -1 and negates all
angles but for pi in psi, so the limits of the paper bind e theta1 and e theta2.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, permutations
from typing import NamedTuple

from flint import arb, arb_mat, ctx, fmpq, fmpq_mat, fmpq_poly

from .ppps3_exact import Vec, add, apply, ball, cross, dot, scale
from .rpr3_exact import Number, rational

PREC = 300
Segment = tuple[Vec, Vec]


class Machine(NamedTuple):
    """The translational geometry; floats count as the rationals they are.

    Attributes:
        radius: L.
        height: h.
        initial: The lengths L_i0 at stroke zero; None for sqrt(L^2 + h^2), which makes p = 0 there.
        eta: Angles of the limbs in radians; None for exactly 0, 120, -120 degrees.
    """

    radius: Number
    height: Number
    initial: Sequence[Number] | None = None
    eta: Sequence[Number | arb] | None = None

    def norm(self) -> fmpq:
        """Returns L^2 + h^2."""
        return rational(self.radius) ** 2 + rational(self.height) ** 2

    def lengths_at_zero(self) -> list[arb]:
        return [arb(self.norm()).sqrt()] * 3 if self.initial is None else [ball(v) for v in self.initial]

    def directions(self) -> list[tuple[arb, arb]]:
        """Returns (cos, sin) of the angles of the limbs."""
        if self.eta is None:
            side = arb(3).sqrt() / 2
            return [(arb(1), arb(0)), (arb(-0.5), side), (arb(-0.5), -side)]
        return [(ball(angle).cos(), ball(angle).sin()) for angle in self.eta]

    def anchors(self) -> list[Vec]:
        """Returns the base joints q_i."""
        return [(ball(self.radius) * c, ball(self.radius) * s, -ball(self.height)) for c, s in self.directions()]


# --- position ---------------------------------------------------------------------------------------------------------


class Positions(NamedTuple):
    """Forward solutions.

    Attributes:
        count: Number of distinct real solutions; None if the balls cannot tell, which the default angles exclude.
        points: The solutions in balls, the one with z > -h first.
    """

    count: int | None
    points: list[Vec]


def strokes(machine: Machine, point: Sequence[Number | arb], prec: int = PREC) -> tuple[arb, ...]:
    """Returns l_i = |p - q_i| - L_i0."""
    with ctx.workprec(prec):
        p = tuple(ball(v) for v in point)
        arms = [add(q, p, -1) for q in machine.anchors()]
        return tuple(dot(a, a).sqrt() - i for a, i in zip(arms, machine.lengths_at_zero(), strict=True))


def forward(machine: Machine, stroke: Sequence[Number], prec: int = PREC) -> Positions:
    """Solves the direct position kinematics.

    Args:
        machine: The geometry.
        stroke: The strokes l_i; floats count as the rationals they are.
        prec: Precision in bits.

    Returns:
        The solutions. There is none if a length L_i0 + l_i is negative.
    """
    with ctx.workprec(prec):
        lengths = [i + rational(s) for i, s in zip(machine.lengths_at_zero(), stroke, strict=True)]
        base = machine.anchors()
        sides = [add(p, q, -1) for p, q in combinations(base, 2)]
        matrix = arb_mat(_bordered([dot(s, s) for s in sides], arb(1)))
        weights, square = _foot(matrix.inv(), [v * v for v in lengths])
        signs = [_ball_sign(v) for v in (square, *lengths)]
        if None in signs and machine.eta is None:
            signs = _exact_signs(machine, stroke)
        if -1 in signs:
            return Positions(0, [])
        if None in signs:
            return Positions(None, [])
        if signs[0] and not square > 0:
            return forward(machine, stroke, 2 * prec)
        foot = [sum((w * q[k] for w, q in zip(weights, base, strict=True)), arb(0)) for k in range(3)]
        rises = [square.sqrt(), -square.sqrt()] if signs[0] else [arb(0)]
        points = [(foot[0], foot[1], foot[2] + rise) for rise in rises]
        assert all(_reaches(p, q, length) for p in points for q, length in zip(base, lengths, strict=True))
        return Positions(len(points), points)


def determinant(machine: Machine, point: Sequence[Number | arb], prec: int = PREC) -> arb:
    """Returns the determinant of the rows (q_i - p) / |q_i - p|, equation (11) of the paper."""
    with ctx.workprec(prec):
        p = tuple(ball(v) for v in point)
        return arb_mat([unit(add(q, p, -1)) for q in machine.anchors()]).det()


def _reaches(p: Vec, q: Vec, length: arb) -> bool:
    arm = add(p, q, -1)
    return (dot(arm, arm) - length * length).contains(0)


def _bordered(sides: Sequence, one: arb | fmpq) -> list[list]:
    """Returns the Cayley-Menger matrix of a triangle with squared sides (d12, d13, d23)."""
    a, b, c = sides
    return [[0 * one, one, one, one], [one, 0 * one, a, b], [one, a, 0 * one, c], [one, b, c, 0 * one]]


def _foot(inverse: arb_mat | fmpq_mat, squares: list) -> tuple[list, object]:
    """Returns the barycentric weights of the foot of p and the squared height of p.

    With D the squared sides and w the weights, r_i^2 = (D w)_i + mu, sum w = 1 and mu = H^2 - w.D w / 2. Hence
    sum w_i r_i^2 = w.D w + mu = 2 H^2 - mu.
    """
    known = [1 + 0 * squares[0], *squares]
    mu, *weights = (sum((inverse[i, j] * known[j] for j in range(1, 4)), inverse[i, 0] * known[0]) for i in range(4))
    return weights, (mu + sum((w * s for w, s in zip(weights, squares, strict=True)), 0 * mu)) / 2


def _ball_sign(value: arb) -> int | None:
    return 1 if value > 0 else -1 if value < 0 else None


def _exact_signs(machine: Machine, stroke: Sequence[Number]) -> list[int]:
    """Decides the signs of the squared height and the lengths for the default angles, in Q[t]/(t^2 - L^2 - h^2)."""
    norm = machine.norm()
    zero = [fmpq_poly([0, 1])] * 3 if machine.initial is None else [fmpq_poly([rational(v)]) for v in machine.initial]
    lengths = [i + rational(s) for i, s in zip(zero, stroke, strict=True)]
    inverse = fmpq_mat(_bordered([3 * rational(machine.radius) ** 2] * 3, fmpq(1))).inv()
    _, square = _foot(inverse, [v * v for v in lengths])
    return [_surd_sign(v % fmpq_poly([-norm, 0, 1]), norm) for v in (square, *lengths)]


def _surd_sign(value: fmpq_poly, norm: fmpq) -> int:
    """Returns the sign of u + v sqrt(norm)."""
    u, v = value[0], value[1]
    side = u if u * u > v * v * norm else v
    return 0 if u * u == v * v * norm and u * v <= 0 else (side > 0) - (side < 0)


# --- wrist ------------------------------------------------------------------------------------------------------------


class Limb(NamedTuple):
    """Wrist of one limb, angles in (-pi, pi] up to the radius of the balls.

    Attributes:
        theta1: Angle of R1.
        theta2: Angle of R2.
        psi: Angle of the active revolute joint about the limb axis.
        axes: (z1, z2, z3): limb axis, R1 axis, R2 axis.
        frame: (x, y, z) of the limb, the columns of R_i0.
    """

    theta1: arb
    theta2: arb
    psi: arb
    axes: tuple[Vec, Vec, Vec]
    frame: tuple[Vec, Vec, Vec]


def unit(u: Vec) -> Vec:
    """Returns u / |u|.

    Raises:
        ZeroDivisionError: If u may be zero.
    """
    square = dot(u, u)
    if not square > 0:
        raise ZeroDivisionError("a direction is undefined")
    return scale(1 / square.sqrt(), u)


def angle_of(sin: arb, cos: arb) -> arb:
    """Returns atan2(sin, cos), also in a ball that meets the cut: then close to pi or -pi."""
    if cos < 0 and sin.contains(0):
        return arb.atan2(-sin, -cos) + (arb.pi() if sin.mid() >= 0 else -arb.pi())
    return arb.atan2(sin, cos)


def rotation_of(quaternion: Sequence[Number]) -> arb_mat:
    """Returns the rotation of a quaternion (w, x, y, z) of any length, at the current precision."""
    w, x, y, z = (rational(v) for v in quaternion)
    n = w * w + x * x + y * y + z * z
    k = fmpq_mat(3, 3, [0, -z, y, z, 0, -x, -y, x, 0])
    return arb_mat(fmpq_mat(3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1]) + (k * w + k * k) * (2 / n))


def wrist(
    machine: Machine,
    point: Sequence[Number],
    quaternion: Sequence[Number],
    elbows: Sequence[int] = (1, 1, 1),
    prec: int = PREC,
) -> list[Limb]:
    """Returns the wrists of the three limbs at a pose.

    Args:
        machine: The geometry.
        point: p; floats count as the rationals they are.
        quaternion: (w, x, y, z) of the platform, normalised here.
        elbows: +1 or -1 of each limb.
        prec: Precision in bits.

    Returns:
        One wrist per limb.

    Raises:
        ZeroDivisionError: If an axis is undefined: p = q_i, z1 parallel to z3, or z1 parallel to t.
    """
    with ctx.workprec(prec):
        p, q = tuple(ball(v) for v in point), rotation_of(quaternion)
        base = zip(machine.anchors(), machine.directions(), elbows, strict=True)
        return [_limb(unit(add(anchor, p, -1)), q, direction, e) for anchor, direction, e in base]


def _limb(z1: Vec, q: arb_mat, direction: tuple[arb, arb], elbow: int) -> Limb:
    cos, sin = direction
    half = arb(0.5).sqrt()
    normal, z3 = apply(q, (arb(0), arb(0), arb(1))), apply(q, (half * cos, half * sin, half))
    z2 = scale(arb(elbow), unit(cross(z1, z3)))
    x = unit(cross((-sin, cos, arb(0)), z1))
    y = cross(z1, x)
    return Limb(
        angle_of(dot(z2, cross(z1, z3)), dot(z1, z3)),
        angle_of(dot(z3, cross(normal, z2)), dot(normal, z2)),
        angle_of(dot(x, z2), -dot(y, z2)),
        (z1, z2, z3),
        (x, y, z1),
    )


# --- links ------------------------------------------------------------------------------------------------------------


class Distances(NamedTuple):
    """Distances between the axes of the links of different limbs.

    Attributes:
        d22: Between L_i2 and L_j2 for i, j = (0, 1), (0, 2), (1, 2).
        d33: Between L_i3 and L_j3 for the same pairs.
        d23: Between L_i2 and L_j3 for (i, j) = (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1).
    """

    d22: list[arb]
    d33: list[arb]
    d23: list[arb]


def links(point: Sequence[Number], limb: Limb, b: Number, r1: Number, r2: Number) -> tuple[Segment, Segment]:
    """Returns the axes L_i2 = [p + b z1, p + r1 z2] and L_i3 = [p + r1 z2, p + r2 z3] at the current precision."""
    p = tuple(ball(v) for v in point)
    ends = [add(p, z, ball(length)) for z, length in zip(limb.axes, (b, r1, r2), strict=True)]
    return (ends[0], ends[1]), (ends[1], ends[2])


def distances(
    point: Sequence[Number],
    limbs: Sequence[Limb],
    b: Number = 150,
    r1: Number = 150,
    r2: Number = 110,
    prec: int = PREC,
) -> Distances:
    """Returns the twelve distances between links of different limbs. The default sizes (mm) are assumed ones."""
    with ctx.workprec(prec):
        two, three = zip(*(links(point, limb, b, r1, r2) for limb in limbs), strict=True)
        return Distances(
            [segment_distance(two[i], two[j]) for i, j in combinations(range(3), 2)],
            [segment_distance(three[i], three[j]) for i, j in combinations(range(3), 2)],
            [segment_distance(two[i], three[j]) for i, j in permutations(range(3), 2)],
        )


def segment_distance(first: Segment, second: Segment) -> arb:
    """Returns the distance of two segments, the least value over the Kuhn-Tucker cases.

    The squared distance is convex over the unit square of parameters: an inner stationary point, or else a clamped
    stationary point of an edge, is the minimum. For parallel segments the edges suffice.
    """
    u, w, r = add(first[1], first[0], -1), add(second[1], second[0], -1), add(first[0], second[0], -1)
    uu, uw, ww, ru, rw = dot(u, u), dot(u, w), dot(w, w), dot(r, u), dot(r, w)
    ends = arb(0), arb(1)
    cases = [(s, _clamp((rw + s * uw) / ww)) for s in ends] + [(_clamp((t * uw - ru) / uu), t) for t in ends]
    gram = uu * ww - uw * uw
    if gram > 0:
        s, t = (uw * rw - ww * ru) / gram, (uu * rw - uw * ru) / gram
        if not any(v < 0 or v > 1 for v in (s, t)):
            cases.append((s, t))
    gaps = [add(add(r, u, s), w, -t) for s, t in cases]
    least = dot(gaps[0], gaps[0])
    for gap in gaps[1:]:
        least = least.min(dot(gap, gap))
    return least.nonnegative_part().sqrt()


def _clamp(value: arb) -> arb:
    return value.min(arb(1)).max(arb(0))
