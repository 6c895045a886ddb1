"""Exact direct kinematics of planar 3-RPR robots, by rational polynomial arithmetic.

A float64 is a rational number, so the number of poses of a robot given in floats is a question about
polynomials with rational coefficients. It is decided here by remainder sequences and greatest common
divisors alone: no tolerance occurs. Only `poses_general` evaluates roots, in certified balls.

Setting: base joints A1 = (0, 0), A2 = (c2, 0), A3 = (c3, d3); platform joints b1 = (0, 0), b2, b3 in the
frame of the platform; B_i = X + R(phi) b_i with X = (x, y); leg equations |B_i - A_i|^2 = r_i with r_i =
rho_i^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

from flint import arb, arb_poly, ctx, fmpq, fmpq_poly

Number = float | int | Fraction | fmpq
Vector = tuple[fmpq_poly, fmpq_poly]

_ONE = fmpq_poly([1])
_E = fmpq_poly([1, 0, 1])  # 1 + t^2, the common denominator of cos and sin


class ExactCount(NamedTuple):
    """The number of distinct real poses, and whether one of them is singular.

    Attributes:
        count: Number of distinct real poses.
        degenerate: True if the direct Jacobian is exactly singular at one of these poses.
    """

    count: int
    degenerate: bool


class SelfMotion(ValueError):
    """The robot has infinitely many poses."""


def rational(value: Number) -> fmpq:
    """Converts a number to the rational it is, without rounding."""
    return value if isinstance(value, fmpq) else fmpq(*map(int, value.as_integer_ratio()))


def _squared_lengths(rho: tuple[Number, ...], squared: bool) -> list[fmpq]:
    """Returns the exact squared leg lengths."""
    r = [rational(v) if squared else rational(v) ** 2 for v in rho]
    if min(r) < 0:
        raise ValueError("a squared length is negative")
    return r


# --- real roots without approximation -----------------------------------------------------------------------


def tarski_query(f: fmpq_poly, g: fmpq_poly = _ONE) -> int:
    """Sums sign(g) over the distinct real roots of f; with g = 1, counts them.

    Args:
        f: A nonzero polynomial.
        g: Any polynomial.

    Returns:
        The sum, by Sylvester: a difference of sign variations of the remainder sequence of f and f' g.
    """
    chain = [f, divmod(f.derivative() * g, f)[1]]
    while not chain[-1].is_zero():
        chain.append(-divmod(chain[-2], chain[-1])[1])
    at_plus = [p.leading_coefficient() > 0 for p in chain[:-1]]
    at_minus = [sign == (p.degree() % 2 == 0) for p, sign in zip(chain[:-1], at_plus, strict=True)]
    return _variations(at_minus) - _variations(at_plus)


def _variations(signs: list[bool]) -> int:
    return sum(a != b for a, b in pairwise(signs))


def _square_free(f: fmpq_poly) -> fmpq_poly:
    return f // f.gcd(f.derivative())


def _without(f: fmpq_poly, g: fmpq_poly) -> fmpq_poly:
    """Returns the factor of the square-free f that has no root in common with g."""
    return f // f.gcd(g)


def _lifted(f: fmpq_poly, discriminant: fmpq_poly) -> int:
    """Counts the distinct real (t, s) with f(t) = 0 and s^2 = discriminant(t)."""
    return tarski_query(f) + tarski_query(f, discriminant)  # 1 + sign(discriminant) of them over each t


# --- analytic family: platform (0, 0), (c2, 0), (c3, -d3) ---------------------------------------------------


def count_analytic(
    c2: Number, c3: Number, d3: Number, rho1: Number, rho2: Number, rho3: Number, *, squared: bool = False
) -> ExactCount:
    """Counts the poses of a robot of the analytic family, whose platform is the base mirrored in the x axis.

    Put n = (-sin(phi/2), cos(phi/2)), h = X . n, u = c2 sin(phi/2) and v = c3 sin(phi/2) - d3 cos(phi/2).
    Then R b2 - A2 = 2 u n and R b3 - A3 = 2 v n, hence 4 u h + 4 u^2 = r2 - r1 and 4 v h + 4 v^2 = r3 - r1,
    beside h^2 + p^2 = r1. The ratio w = v / u is a projective coordinate of phi, and cos^2 + sin^2 = 1 reads
    u^2 e(w) = 1 with e = 1 / c2^2 + (c3 / c2 - w)^2 / d3^2.

    Args:
        c2: Abscissa of the second base joint, not zero.
        c3: Abscissa of the third base joint.
        d3: Ordinate of the third base joint, not zero.
        rho1: First leg length.
        rho2: Second leg length.
        rho3: Third leg length.
        squared: True if the lengths are given squared.

    Returns:
        The exact count. No member of the family has a self-motion.

    Raises:
        ValueError: If c2 or d3 is zero or a squared length is negative.
    """
    c2, c3, d3 = map(rational, (c2, c3, d3))
    if c2 == 0 or d3 == 0:
        raise ValueError("the analytic family needs c2 != 0 and d3 != 0")
    r1, r2, r3 = _squared_lengths((rho1, rho2, rho3), squared)
    a, b = r1 - r2, r1 - r3
    w = fmpq_poly([0, 1])
    e = (w - c3 / c2) ** 2 / d3**2 + 1 / c2**2
    cubic = 4 * w * (1 - w) + (a * w - b) * e  # formally of degree 3
    room = 16 * r1 * e - (4 + a * e) ** 2  # a positive multiple of p^2 = r1 - h^2 on the roots
    # Never zero: a = b = 0 leaves 4 w (1 - w).
    roots = _square_free(cubic)
    singular = cubic.gcd(cubic.derivative()) * roots.gcd(room)
    count, degenerate = _lifted(roots, room), _lifted(_square_free(singular), room) > 0
    if a == 0:  # w = infinity, that is phi = 0, u = 0
        room_inf = 16 * r1 / d3**2 - (4 + b / d3**2) ** 2
        count += 1 + (room_inf > 0) - (room_inf < 0)
        degenerate |= room_inf == 0 or (room_inf > 0 and cubic.degree() < 2)
    return ExactCount(count, degenerate)


# --- any platform -------------------------------------------------------------------------------------------


def _cross(u: Vector, v: Vector) -> fmpq_poly:
    return u[0] * v[1] - u[1] * v[0]


def _dot(u: Vector, v: Vector) -> fmpq_poly:
    return u[0] * v[0] + u[1] * v[1]


def _turn(u: Vector) -> Vector:
    """Rotates by a right angle."""
    return -u[1], u[0]


def _add(u: Vector, v: Vector) -> Vector:
    return u[0] + v[0], u[1] + v[1]


def _scale(f: fmpq_poly, u: Vector) -> Vector:
    return f * u[0], f * u[1]


@dataclass(frozen=True)
class _Leg:
    """Leg 2 or 3 minus leg 1: the line 2 X . w = k / e, where w = R b - A.

    Attributes:
        arm: e R b.
        w: e (R b - A).
        n: e |R b - A|^2, of degree 2.
        k: Right-hand side, times e.
        room: Over a real t where both lines are this line, the poses are X = (k w + s turn(w)) / (2 e n) with
            s^2 = room.
    """

    arm: Vector
    w: Vector
    n: fmpq_poly
    k: fmpq_poly
    room: fmpq_poly


@dataclass(frozen=True)
class _Lines:
    """The lines 2 X . w_i = k_i / e and the circle |X|^2 = r1 over t = tan((phi - alpha) / 2), e = 1 + t^2.

    The platform frame is turned by alpha with tan(alpha / 2) = turn so that no root lies at t = infinity.

    Attributes:
        turn: tan(alpha / 2).
        legs: Legs 2 and 3.
        delta: w2 x w3 / e, which is zero where the lines are parallel (the paper's R V - S U).
        sextic: Numerator of |X|^2 - r1 at the lines' intersection. At a real t where delta = 0 it vanishes if
            and only if k2 w3 = k3 w2.
    """

    turn: int
    legs: tuple[_Leg, _Leg]
    delta: fmpq_poly
    sextic: fmpq_poly

    @classmethod
    def build(cls, platform: list[tuple[fmpq, fmpq]], base: list[tuple[fmpq, fmpq]], r: list[fmpq]) -> _Lines:
        for turn in range(7):
            two, three = (cls._leg(*leg, r[0], turn) for leg in zip(platform, base, r[1:], strict=True))
            # w2 x w3 and w2 . w3 are constant plus linear in (cos, sin): one factor e divides out.
            delta, along = _cross(two.w, three.w) // _E, _dot(two.w, three.w) // _E
            squares = two.k**2 * three.n - 2 * two.k * three.k * along + three.k**2 * two.n
            sextic = squares - 4 * r[0] * _E * delta**2
            if sextic.degree() == 6:
                return cls(turn, (two, three), delta, sextic)
        # A form of degree 6 with 7 real roots is zero.
        if delta.is_zero():
            raise ValueError("two joints of the base or of the platform coincide")
        raise SelfMotion("every orientation carries a pose")

    @staticmethod
    def _leg(b: tuple[fmpq, fmpq], a: tuple[fmpq, fmpq], r: fmpq, r1: fmpq, turn: int) -> _Leg:
        cos, sin = fmpq(1 - turn**2, 1 + turn**2), fmpq(2 * turn, 1 + turn**2)
        bx, by = cos * b[0] - sin * b[1], sin * b[0] + cos * b[1]
        arm = fmpq_poly([bx, -2 * by, -bx]), fmpq_poly([by, 2 * bx, -by])
        w = arm[0] - a[0] * _E, arm[1] - a[1] * _E
        n = _dot(w, w) // _E
        k = (r - r1) * _E - n
        return _Leg(arm, w, n, k, 4 * r1 * _E * n - k**2)

    def regular(self) -> fmpq_poly:
        """Returns the polynomial whose real roots carry one pose each, where the lines cross."""
        return _without(_square_free(self.sextic), self.delta)

    def coincident(self) -> list[tuple[_Leg, fmpq_poly]]:
        """Returns polynomials at whose real roots both lines are the line of the given leg."""
        f = _square_free(self.sextic).gcd(self.delta)
        two, three = self.legs
        return [(two, _without(f, two.n)), (three, _without(f.gcd(two.n), three.n))]

    def concentric(self) -> fmpq_poly:
        """Returns the polynomial at whose real roots both lines read 0 = 0 and the whole circle remains."""
        f = _square_free(self.sextic).gcd(self.delta)
        for leg in self.legs:
            f = f.gcd(leg.n).gcd(leg.k)
        return f

    def singular(self, leg: _Leg) -> fmpq_poly:
        """Returns a polynomial that is zero where a pose on the coincident lines has a singular Jacobian.

        The determinant of the rows (X, 0), (w_i, (X + w_i) . turn(R b_i)) is a quadratic q(s) over the roots
        s^2 = room; q(s) q(-s) decides about both poses.
        """

        def determinant(s: int) -> fmpq_poly:
            point = _add(_scale(leg.k, leg.w), _scale(fmpq_poly([s]), _turn(leg.w)))  # 2 e n X
            rates = [_dot(_add(point, _scale(2 * leg.n, i.w)), _turn(i.arm)) for i in self.legs]
            return _cross(point, self.legs[0].w) * rates[1] - _cross(point, self.legs[1].w) * rates[0]

        plus, zero, minus = determinant(1), determinant(0), determinant(-1)
        even, odd = zero + ((plus + minus) / 2 - zero) * leg.room, (plus - minus) / 2
        return even**2 - leg.room * odd**2


def _general(
    b2: tuple[Number, Number],
    b3: tuple[Number, Number],
    c2: Number,
    c3: Number,
    d3: Number,
    rho: tuple[Number, Number, Number],
    squared: bool,
) -> tuple[_Lines, bool]:
    """Builds the system; returns it and whether the pose B_i = A_i of three legs of length zero exists."""
    r = _squared_lengths(rho, squared)
    platform = [(rational(p[0]), rational(p[1])) for p in (b2, b3)]
    lines = _Lines.build(platform, [(rational(c2), fmpq(0)), (rational(c3), rational(d3))], r)
    concentric = tarski_query(lines.concentric()) > 0
    if concentric and r[0] > 0:
        raise SelfMotion("the platform translates on a circle")
    return lines, concentric


def count_general(
    b2: tuple[Number, Number],
    b3: tuple[Number, Number],
    c2: Number,
    c3: Number,
    d3: Number,
    rho1: Number,
    rho2: Number,
    rho3: Number,
    *,
    squared: bool = False,
) -> ExactCount:
    """Counts the poses of any planar 3-RPR robot, the analytic family included.

    Args:
        b2: Second platform joint in the frame of the platform.
        b3: Third platform joint in the frame of the platform.
        c2: Abscissa of the second base joint.
        c3: Abscissa of the third base joint.
        d3: Ordinate of the third base joint.
        rho1: First leg length.
        rho2: Second leg length.
        rho3: Third leg length.
        squared: True if the lengths are given squared.

    Returns:
        The exact count.

    Raises:
        SelfMotion: If there are infinitely many poses.
        ValueError: If a squared length is negative, or joints coincide so that the problem loses its meaning.
    """
    lines, concentric = _general(b2, b3, c2, c3, d3, (rho1, rho2, rho3), squared)
    regular = lines.regular()
    # Where the lines cross X is a function of t: a pose is singular if and only if t is a multiple root.
    count = tarski_query(regular) + concentric
    degenerate = concentric or tarski_query(regular.gcd(lines.sextic.derivative())) > 0
    for leg, f in lines.coincident():
        count += _lifted(f, leg.room)
        degenerate |= _lifted(f.gcd(lines.singular(leg)), leg.room) > 0
    return ExactCount(count, degenerate)


def poses_general(
    b2: tuple[Number, Number],
    b3: tuple[Number, Number],
    c2: Number,
    c3: Number,
    d3: Number,
    rho1: Number,
    rho2: Number,
    rho3: Number,
    *,
    squared: bool = False,
) -> list[tuple[float, float, float]]:
    """Solves the direct kinematics of any planar 3-RPR robot with certified error balls.

    Args:
        b2: Second platform joint in the frame of the platform.
        b3: Third platform joint in the frame of the platform.
        c2: Abscissa of the second base joint.
        c3: Abscissa of the third base joint.
        d3: Ordinate of the third base joint.
        rho1: First leg length.
        rho2: Second leg length.
        rho3: Third leg length.
        squared: True if the lengths are given squared.

    Returns:
        All distinct real poses (x, y, phi), phi in [-pi, pi), sorted by (phi, x, y). The balls are narrower
        than 1e-18 max(1, |value|) before they are rounded to floats.

    Raises:
        SelfMotion: If there are infinitely many poses.
        ValueError: If a squared length is negative, or joints coincide so that the problem loses its meaning.
    """
    lines, concentric = _general(b2, b3, c2, c3, d3, (rho1, rho2, rho3), squared)
    prec = 128
    while True:
        with ctx.workprec(prec):
            balls = _pose_balls(lines, concentric)
            if balls is not None:
                poses = [tuple(float(v.mid()) for v in pose) for pose in balls]
                return sorted(poses, key=lambda pose: (pose[2], pose[0], pose[1]))
        prec *= 2


def _pose_balls(lines: _Lines, concentric: bool) -> list[tuple[arb, arb, arb]] | None:
    """Encloses all poses at the current precision; None if that is too low."""
    two, three = lines.legs
    poses = []

    def at(f: fmpq_poly, t: arb) -> arb:
        return arb_poly(f)(t)

    def add(t: arb, numerator: Vector, denominator: fmpq_poly) -> None:
        bottom = at(denominator, t)
        poses.append((at(numerator[0], t) / bottom, at(numerator[1], t) / bottom, _angle(lines, t)))

    crossing = _add(_scale(three.k, _turn(two.w)), _scale(-two.k, _turn(three.w)))
    for t in _real_roots(lines.regular()):
        add(t, crossing, 2 * _E * lines.delta)
    for leg, f in lines.coincident():
        foot, bottom = _scale(leg.k, leg.w), 2 * _E * leg.n
        for t in _real_roots(f.gcd(leg.room)):
            add(t, foot, bottom)
        for t in _real_roots(_without(f, leg.room)):
            room = at(leg.room, t)
            if room.contains(0):
                return None
            if room > 0:
                across, below = _turn(leg.w), at(bottom, t)
                for s in (room.sqrt(), -room.sqrt()):
                    x, y = ((at(a, t) + s * at(b, t)) / below for a, b in zip(foot, across, strict=True))
                    poses.append((x, y, _angle(lines, t)))
    if concentric:
        for t in _real_roots(lines.concentric()):
            poses.append((arb(0), arb(0), _angle(lines, t)))
    if all(v.rad() < 1e-18 * max(arb(1), abs(v.mid())) for pose in poses for v in pose):
        return poses
    return None


def _real_roots(f: fmpq_poly) -> list[arb]:
    """Isolates the real roots of a square-free polynomial in certified balls."""
    roots = [root.real for root, _ in f.numer().complex_roots() if root.imag == 0] if f.degree() > 0 else []
    assert len(roots) == tarski_query(f)
    return roots


def _angle(lines: _Lines, t: arb) -> arb:
    """Returns phi in [-pi, pi) of a root t of the sextic."""
    if lines.turn:
        seam = fmpq(1, lines.turn)  # phi = pi
        # The balls of the roots are disjoint: if the seam is a root and lies in this ball, it is this root.
        if lines.sextic(seam) == 0 and t.contains(arb(seam)):
            return -arb.pi()
        if t * lines.turn > 1:
            return 2 * (t.atan() + arb(lines.turn).atan() - arb.pi())
    return 2 * (t.atan() + arb(lines.turn).atan())
