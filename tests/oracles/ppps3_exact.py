"""Exact direct kinematics of the 3-PPPS robot with U-shaped base, by distances between the platform points.

Robot: Chablat, Baron, Jha, Rolland, "The 3-PPPS parallel robot with U-shape base", ARK 2018 (hal-01782286).
The joints (rho1y, rho1z, rho2y, rho2z, rho3y, rho3z) fix all but one coordinate of each platform point:

    W1 = (x, rho1y, rho1z),    W2 = (-rho2y, rho1y + v, rho2z),    W3 = (rho3y, rho1y + w, rho3z).

A pose is a triangle W1 W2 W3 congruent to the platform, that is three quadratic equations for (x, v, w) whose
coefficients are rational when the joints are floats: neither a rotation nor a square root of 3 occurs. With
A2 = leg^2 - (x + rho2y)^2 - (rho2z - rho1z)^2, A3 = leg^2 - (x - rho3y)^2 - (rho3z - rho1z)^2 and
B = side^2 - (rho2y + rho3y)^2 - (rho2z - rho3z)^2 they read v^2 = A2, w^2 = A3, (v - w)^2 = B, and the resultant
with respect to v and w is (A2 - A3)^2 - 2 B (A2 + A3) + B^2, a quadratic in x. The number of real poses is decided
by remainder sequences without any tolerance; the poses are enclosed in certified balls.

Platform: V1 = 0, V2 = side (-sqrt3/2, -1/2, 0), V3 = side (-sqrt3/2, +1/2, 0), the convention of equations (8)-(24)
of the paper. Its equation (4) prints V2 and V3 exchanged; that machine is `mirrored`. A `height` other than
sqrt3/2 side makes the platform isosceles. It serves cases that an equilateral platform only has at irrational joints:
R31 then is rational for rational joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from flint import arb, arb_mat, arb_poly, ctx, fmpq, fmpq_poly

from .rpr3_exact import ExactCount, Number, SelfMotion, _lifted, _real_roots, _square_free, _without, rational

Vec = tuple[arb, arb, arb]

_X = fmpq_poly([0, 1])
_UNITS = tuple(tuple(arb(i == k) for i in range(3)) for k in range(3))


def dot(u: Vec, v: Vec) -> arb:
    """Returns the scalar product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def cross(u: Vec, v: Vec) -> Vec:
    """Returns the vector product."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def add(u: Vec, v: Vec, factor: arb | int = 1) -> Vec:
    """Returns u + factor v."""
    return tuple(a + factor * b for a, b in zip(u, v, strict=True))


def scale(factor: arb, u: Vec) -> Vec:
    """Returns factor u."""
    return tuple(factor * a for a in u)


def ball(value: Number | arb) -> arb:
    """Encloses a number at the current precision."""
    return value if isinstance(value, arb) else arb(rational(value))


def turn(axis: int, angle: arb) -> arb_mat:
    """Returns the rotation about a coordinate axis (0, 1, 2)."""
    sin, cos = angle.sin_cos()
    entries = [[arb(i == j) for j in range(3)] for i in range(3)]
    i, j = (axis + 1) % 3, (axis + 2) % 3
    entries[i][i], entries[i][j], entries[j][i], entries[j][j] = cos, -sin, sin, cos
    return arb_mat(entries)


def apply(matrix: arb_mat, u: Vec) -> Vec:
    """Returns matrix u."""
    return tuple((matrix * arb_mat(3, 1, u)).entries())


class Pose(NamedTuple):
    """One pose in certified balls.

    Attributes:
        position: The point P = C1.
        rotation: The 3 x 3 rotation of the platform.
        passive: The passive joints (rho1x, rho2x, rho3x) = (W1x, W2y, -W3y).
    """

    position: Vec
    rotation: arb_mat
    passive: Vec

    def floats(self) -> tuple[list[float], list[list[float]]]:
        """Returns the midpoints of position and rotation."""
        rows = self.rotation.tolist()
        return [float(v.mid()) for v in self.position], [[float(v.mid()) for v in row] for row in rows]


class Joints(NamedTuple):
    """The joints of a pose in balls.

    Attributes:
        active: (rho1y, rho1z, rho2y, rho2z, rho3y, rho3z).
        passive: (rho1x, rho2x, rho3x).
    """

    active: tuple[arb, ...]
    passive: Vec


class Platform(NamedTuple):
    """The platform triangle.

    Attributes:
        side: Length of V2 V3.
        mirrored: True for V2 and V3 exchanged, as equation (4) of the paper prints them.
        height: Height over V2 V3; None for the equilateral platform.
    """

    side: Number = 1
    mirrored: bool = False
    height: Number | None = None

    def leg_squared(self) -> fmpq:
        """Returns |V2|^2 = |V3|^2."""
        square = rational(self.side) ** 2
        return square if self.height is None else rational(self.height) ** 2 + square / 4

    def altitude(self) -> arb:
        return ball(self.height) if self.height is not None else ball(self.side) * arb(3).sqrt() / 2

    def edge(self) -> arb:
        """Returns the y coordinate of V3 minus that of V2."""
        return -ball(self.side) if self.mirrored else ball(self.side)

    def ends(self, position: Vec, rotation: arb_mat) -> list[Vec]:
        """Returns W_i = P + R V_i."""
        back, half = -self.altitude(), self.edge() / 2
        arms = (back, -half, arb(0)), (back, half, arb(0))
        return [position, *(add(position, apply(rotation, v)) for v in arms)]


STANDARD = Platform()


@dataclass(frozen=True)
class _System:
    """The three distance equations of given joints, as polynomials in x."""

    joints: tuple[fmpq, ...]
    platform: Platform
    square2: fmpq_poly  # v^2 = A2
    square3: fmpq_poly  # w^2 = A3
    gap: fmpq  # (v - w)^2 = B

    @classmethod
    def build(cls, joints: Sequence[Number], platform: Platform) -> _System:
        rho = tuple(rational(j) for j in joints)
        _, z1, y2, z2, y3, z3 = rho
        leg = platform.leg_squared()
        square2, square3 = leg - (_X + y2) ** 2 - (z2 - z1) ** 2, leg - (_X - y3) ** 2 - (z3 - z1) ** 2
        return cls(rho, platform, square2, square3, rational(platform.side) ** 2 - (y2 + y3) ** 2 - (z2 - z3) ** 2)

    def room(self) -> fmpq_poly:
        """Returns v^2 + w^2; over a root of the resultant v^2 and w^2 never have opposite signs."""
        return self.square2 + self.square3

    def product(self) -> fmpq_poly:
        """Returns v w."""
        return (self.room() - self.gap) / 2

    def resultant(self) -> fmpq_poly:
        return (self.square2 - self.square3) ** 2 - 2 * self.gap * self.room() + self.gap**2

    def singular(self) -> fmpq_poly:
        """Returns ((v - w) N)^2, N the z component of (W2 - W1) x (W3 - W1).

        8 (v - w) N is the determinant of the derivatives of the distance equations with respect to (x, v, w).
        """
        two, three = _X + self.joints[2], _X - self.joints[4]
        return self.gap * (self.square2 * three**2 + self.square3 * two**2 - 2 * self.product() * two * three)


def count(joints: Sequence[Number], platform: Platform = STANDARD) -> ExactCount:
    """Counts the real poses of the platform.

    Args:
        joints: (rho1y, rho1z, rho2y, rho2z, rho3y, rho3z).
        platform: The platform triangle.

    Returns:
        The exact number of distinct real poses (the mirrored platform has as many), and whether one of them is
        exactly singular. Floats never give one pose of an equilateral platform: R12^2 = R31^2, which it needs,
        equates a rational with a third of the square of a rational.

    Raises:
        SelfMotion: If there are infinitely many poses.
    """
    system = _System.build(joints, platform)
    f, room = system.resultant(), system.room()
    if f.is_zero() and system.gap == 0:
        raise SelfMotion("V2 V3 is vertical and its middle level with C1: the platform turns about the vertical")
    if f.is_zero():  # then B = -(rho2y + rho3y)^2 < 0
        return ExactCount(0, False)
    return ExactCount(_lifted(_square_free(f), room), _lifted(_square_free(f.gcd(system.singular())), room) > 0)


def forward(joints: Sequence[Number], platform: Platform = STANDARD) -> list[Pose]:
    """Solves the direct kinematics, certified.

    Args:
        joints: (rho1y, rho1z, rho2y, rho2z, rho3y, rho3z).
        platform: The platform triangle.

    Returns:
        All distinct real poses, sorted by (R22, R33, x), in balls of radius below 1e-30 max(1, |value|). Each
        meets the six constraint equations, R^T R = 1 and det R = 1 as far as balls can tell (asserted).

    Raises:
        SelfMotion: If there are infinitely many poses.
    """
    expected = count(joints, platform).count
    system = _System.build(joints, platform)
    prec = 256
    while expected:
        with ctx.workprec(prec):
            poses = _poses(system)
            if poses is not None:
                assert len(poses) == expected
                assert all(v.contains(0) for pose in poses for v in residuals(pose, joints, platform))
                return sorted(poses, key=_order)
        prec *= 2
    return []


def _order(pose: Pose) -> tuple[float, ...]:
    return tuple(float(v.mid()) for v in (pose.rotation[1, 1], pose.rotation[2, 2], pose.position[0]))


def _poses(system: _System) -> list[Pose] | None:
    """Encloses all poses at the current precision; None if that is too low."""
    f = _square_free(system.resultant())
    flat = f.gcd(system.room())  # v = w = 0
    found = [(x, arb(0), arb(0)) for x in _real_roots(flat)]
    for x in _real_roots(_without(f, flat)):
        squares = arb_poly(system.square2)(x), arb_poly(system.square3)(x)
        if squares[0] + squares[1] < 0:
            continue
        swap = squares[0].mid() < squares[1].mid()
        if not squares[swap] > 0:
            return None
        large = squares[swap].sqrt()
        small = arb_poly(system.product())(x) / large
        v, w = (small, large) if swap else (large, small)
        found += [(x, v, w), (x, -v, -w)]
    poses = [_pose(system, *solution) for solution in found]
    values = [v for pose in poses for v in (*pose.position, *pose.rotation.entries(), *pose.passive)]
    return poses if all(v.rad() < 1e-30 * max(arb(1), abs(v.mid())) for v in values) else None


def _pose(system: _System, x: arb, v: arb, w: arb) -> Pose:
    """Places the platform on the triangle W1 W2 W3."""
    y1, z1, y2, z2, y3, z3 = (arb(j) for j in system.joints)
    w1, w2, w3 = (x, y1, z1), (-y2, y1 + v, z2), (y3, y1 + w, z3)
    first = scale(1 / system.platform.altitude(), add(w1, scale(arb(0.5), add(w2, w3)), -1))
    second = scale(1 / system.platform.edge(), add(w3, w2, -1))
    rotation = arb_mat([first, second, cross(first, second)]).transpose()
    return Pose(w1, rotation, (x, w2[1], -w3[1]))


def _active(ends: list[Vec]) -> list[arb]:
    one, two, three = ends
    return [one[1], one[2], -two[0], two[2], three[0], three[2]]


def residuals(pose: Pose, joints: Sequence[Number | arb], platform: Platform = STANDARD) -> list[arb]:
    """Returns the six constraint equations at a pose, the entries of R^T R - 1, and det R - 1, at this precision."""
    rotation = pose.rotation
    ends = platform.ends(pose.position, rotation)
    closure = [a - ball(j) for a, j in zip(_active(ends), joints, strict=True)]
    gram = rotation.transpose() * rotation
    return [*closure, *(gram[i, j] - (i == j) for i in range(3) for j in range(3)), rotation.det() - 1]


def inverse(pose: Sequence[Number | arb], platform: Platform = STANDARD, prec: int = 256) -> Joints:
    """Returns the joints of the pose (x, y, z, phi, theta, sigma) with R = Rx(phi) Ry(theta) Rz(sigma).

    Round the balls with `nearest` to feed them to `forward`.

    Args:
        pose: Position and angles in radians; floats count as the rationals they are.
        platform: The platform triangle.
        prec: Precision in bits.

    Returns:
        Active and passive joints.
    """
    with ctx.workprec(prec):
        x, y, z, *angles = (ball(v) for v in pose)
        ends = platform.ends((x, y, z), rotation_of(*angles))
        return Joints(tuple(_active(ends)), (ends[0][0], ends[1][1], -ends[2][1]))


def rotation_of(phi: Number | arb, theta: Number | arb, sigma: Number | arb) -> arb_mat:
    """Returns Rx(phi) Ry(theta) Rz(sigma) at the current precision."""
    return turn(0, ball(phi)) * turn(1, ball(theta)) * turn(2, ball(sigma))


def nearest(values: Sequence[arb]) -> list[fmpq]:
    """Returns the midpoints of balls as the rationals they are."""
    return [v.mid().fmpq() for v in values]


def jacobian(rotation: arb_mat, platform: Platform = STANDARD) -> arb_mat:
    """Returns the 6 x 6 matrix of d(joints) / d(velocity of P, angular velocity in the base frame).

    Row by row it is d W_ik = e_k . (velocity + omega x R V_i) with the signs of the joints.
    """
    zero = (arb(0), arb(0), arb(0))
    _, two, three = platform.ends(zero, rotation)
    measured = [(zero, 1, 1), (zero, 2, 1), (two, 0, -1), (two, 2, 1), (three, 0, 1), (three, 2, 1)]
    return arb_mat([[sign * v for v in (*_UNITS[k], *cross(arm, _UNITS[k]))] for arm, k, sign in measured])
