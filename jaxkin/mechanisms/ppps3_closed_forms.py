"""Closed forms of the 3-PPPS: its four aspects in two charts of the orientations, and the joints with four solutions.

The robot is singular where R22 R33 = 0, so an aspect is a pair of signs of (R22, R33); position plays no part, and
neither do the side of the platform and its mirroring. With R = Rx(phi) Ry(theta) Rz(sigma) = Rz(alpha) Rx(beta)
Ry(gamma),

    R22 = cos(phi) cos(sigma) - sin(phi) sin(theta) sin(sigma) = cos(alpha) cos(beta)
    R33 = cos(phi) cos(theta)                                  = cos(beta) cos(gamma).

So in the chart Z-X-Y the aspect of the home pose is the open cube (-pi/2, pi/2)^3, and in the chart X-Y-Z of the paper
a pile of intervals of length pi over an open square, see ``home_interval``. In both charts the other three are
translates of it by pi: in Z-X-Y along alpha where R22 < 0 and along gamma where R33 < 0; in X-Y-Z along phi where R33 <
0, which changes both signs, and along sigma where the signs differ. Each has the volume pi^3 in both, and covers a
quarter of all rotations: multiplying from the left by the half turns diag(1, -1, -1), diag(-1, 1, -1), diag(-1, -1, 1)
exchanges them. Each is mapped one to one onto the joints with four solutions, a convex region: it is connected.

References:
    Chablat, D., Baron, L., Jha, R. and Rolland, L., "The 3-PPPS parallel robot with U-shape base, a 6-DOF parallel
    robot with simple kinematics", Advances in Robot Kinematics, 2018, hal-01782286, section 4: the singular surfaces
    and the home aspect in the chart X-Y-Z, from a cylindrical algebraic decomposition with two cells. Each function
    says what the print has wrong. The explicit interval (one cell, with sigma last), the chart Z-X-Y, the other
    aspects, volumes, shares and the region of the joints are ours.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.mechanisms._ppps3_forward import SIGNS
from jaxkin.numerics import rotations

if TYPE_CHECKING:
    from jaxkin.mechanisms.ppps3 import PPPS3

__all__ = [
    "SIGNS",
    "Saddle",
    "Slice",
    "aspect_of",
    "feasibility",
    "home_interval",
    "home_slice",
    "joints_from_zxy",
    "joints_volume",
    "nearest_singular_rotation",
    "saddles",
    "zxy_factors",
]

_SQRT3 = math.sqrt(3.0)
_RIGHT = math.pi / 2
#: R22 and R33 of a pose are sums of two products of sines and cosines; smaller values are rounding.
_ROUNDING = 4 * float(np.finfo(float).eps)


def home_interval(phi: ArrayLike, theta: ArrayLike) -> tuple[Array, Array]:
    """Returns the ends of the interval of sigma in the home aspect, for |phi| <= pi/2 and |theta| <= pi/2.

    R22 = h cos(sigma - delta), with h cos(delta) = cos(phi) and h sin(delta) = -sin(phi) sin(theta): the interval is
    (delta - pi/2, delta + pi/2), of length pi everywhere. Inside, delta = -atan(tan(phi) sin(theta)); written with a
    direction instead it is safe at phi = +-pi/2, where delta jumps at theta = 0 between -+pi/2 and +-pi/2. At those two
    points, where all sigma are singular, the middle, (-pi/2, pi/2), is returned.

    Args:
        phi: ``(...)`` rad; elsewhere the other aspects are found as translates, see the module.
        theta: ``(...)`` rad.

    Returns:
        Two arrays ``(...)``, rad, in [-pi, 0] and [0, pi] but for rounding.

    References:
        Chablat et al. 2018, section 4 and Fig. 3 [the formula is ours]. The second bullet gives the range -pi to pi to
        phi; it is that of sigma, and its ends are only reached at phi = +-pi/2.
    """
    phi, theta = jnp.broadcast_arrays(jnp.asarray(phi, float), jnp.asarray(theta, float))
    delta = rotations.direction_angle(-jnp.sin(phi) * jnp.sin(theta), jnp.cos(phi))
    return delta - _RIGHT, delta + _RIGHT


def aspect_of(pose: ArrayLike) -> Array:
    """Returns the number of a pose's aspect, 0 (home) to 3, or -1 at a singular pose.

    The numbers are those of ``PPPS3.forward_labels``, which are the signs of (R22, R33): ++, +-, -+, --.

    Args:
        pose: ``(..., 6)``, or ``(..., 3)`` for the angles alone.
    """
    pose = jnp.asarray(pose, float)
    m = rotations.matrix_from_xyz(pose[..., -3], pose[..., -2], pose[..., -1])
    r22, r33 = m[1][1], m[2][2]
    number = jnp.where(r22 > 0, 0, 2) + jnp.where(r33 > 0, 0, 1)
    return jnp.where((jnp.abs(r22) <= _ROUNDING) | (jnp.abs(r33) <= _ROUNDING), -1, number).astype(jnp.int8)


def zxy_factors(alpha: ArrayLike, beta: ArrayLike, gamma: ArrayLike) -> tuple[Array, Array]:
    """Returns R22 and R33 in the chart R = Rz(alpha) Rx(beta) Ry(gamma), where they are products of cosines [ours].

    With beta in (-pi/2, pi/2) the sign of R22 is that of cos(alpha), the sign of R33 that of cos(gamma).
    """
    cos = jnp.cos(jnp.asarray(beta, float))
    return jnp.cos(jnp.asarray(alpha, float)) * cos, cos * jnp.cos(jnp.asarray(gamma, float))


class Slice(NamedTuple):
    """A piece of the home aspect at one phi: theta in columns, each with its interval of sigma.

    Attributes:
        theta: ``(k,)`` ascending, rad.
        low: ``(k,)`` lower end of sigma.
        high: ``(k,)`` upper end.
    """

    theta: np.ndarray
    low: np.ndarray
    high: np.ndarray


def home_slice(phi: float, samples: int = 64) -> list[Slice]:
    """Returns the slice of the closed home aspect at one phi: one piece, or two rectangles at phi = +-pi/2.

    At phi = 0 it is the square |theta| <= pi/2, |sigma| <= pi/2. Towards phi = +-pi/2 it is torn at theta = 0; the
    columns are spaced both in theta and in the steps of sigma.

    Args:
        phi: Within [-pi/2, pi/2], rad.
        samples: Columns, about half of them evenly spaced.

    Raises:
        InputError: ``phi`` is outside.

    References:
        Chablat et al. 2018, section 4. Printed: at phi = pi/2 there is sigma > 0 with -pi/2 <= theta <= 0 (right), and
        at phi = -pi/2 there is sigma < 0 with 0 <= theta <= pi/2. That is the second rectangle at phi = +pi/2; at phi =
        -pi/2 sigma and theta have the same sign.
    """
    if not -_RIGHT <= phi <= _RIGHT:
        raise InputError(f"phi is {phi}: the home aspect lies within |phi| <= pi/2 = {_RIGHT:.6f}; give such an angle.")
    count = max(int(samples), 8) // 2
    if abs(phi) == _RIGHT:
        theta, up = np.linspace(0.0, _RIGHT, count + 1), np.full(count + 1, math.pi)
        zero, side = np.zeros(count + 1), math.copysign(1.0, phi)
        below, above = (-theta[::-1], theta) if side > 0 else (theta, -theta[::-1])
        pieces = [Slice(below, zero, up), Slice(above, -up, zero)]
        return sorted(pieces, key=lambda piece: piece.theta[0])
    even = np.linspace(-_RIGHT, _RIGHT, 2 * (count // 2) + 1)
    # delta = -atan(tan(phi) sin(theta)) at |theta| = pi/2 is -+phi.
    steep = np.linspace(-phi, phi, 2 * (count // 2) + 1)
    ratio = np.divide(np.tan(steep), math.tan(phi) if phi else 1.0)
    theta = np.unique(np.concatenate([even, np.arcsin(np.clip(ratio, -1.0, 1.0))]))
    low, high = (np.asarray(end) for end in home_interval(phi, theta))
    return [Slice(theta, low, high)]


class Saddle(NamedTuple):
    """A saddle point of the surface R22 = 0 on the boundary of the home aspect.

    Attributes:
        angles: (phi, theta, sigma), rad.
        axis: Which angle is stationary over the other two: 0 (phi) or 2 (sigma).
        product: The local form: this angle is, to second order, its value there plus ``product`` times the product of
            the deviations of the other two.
        printed: True for the two of the paper.
    """

    angles: tuple[float, float, float]
    axis: int
    product: float
    printed: bool


def saddles() -> tuple[Saddle, ...]:
    """Returns the saddle points of R22 = 0 on the boundary of the home aspect, those of the paper first.

    At (pi/2, 0, 0), phi = pi/2 - theta sigma; there the surface touches the plane phi = pi/2, where R33 = 0. At the
    closure's corners (+-pi/2, 0, +-pi) the same surface has such points again, and sigma is stationary at (0, 0,
    +-pi/2).

    References:
        Chablat et al. 2018, section 4: "two interesting saddle points", without phi = +-pi/2 [the others are ours].
    """
    found = [Saddle((side * _RIGHT, 0.0, 0.0), 0, -1.0, True) for side in (1.0, -1.0)]
    for side in (1.0, -1.0):
        found += [Saddle((side * _RIGHT, 0.0, end * math.pi), 0, -1.0, False) for end in (1.0, -1.0)]
    return (*found, *(Saddle((0.0, 0.0, end * _RIGHT), 2, -1.0, False) for end in (1.0, -1.0)))


def feasibility(robot: "PPPS3", reduced: ArrayLike) -> tuple[Array, Array]:
    """Returns a = R33^2 and b = R22^2 as polynomials of the joints: there are four solutions where both are positive.

    a = 1 - (4/3) (m2^2 - m2 m3 + m3^2) / s^2 and b = 1 - ((m2 - m3)^2 + p^2) / s^2. So the region is the intersection
    of two solid elliptic cylinders; it is convex. Where either is negative there is no real solution.

    Args:
        robot: The robot.
        reduced: ``(..., 3)`` (m2, p, m3) = (mu2z, mu3y, mu3z), see ``ppps3.reduced_joints``.

    References:
        Chablat et al. 2018, Eqs. (25) and (28). The root of (25) is that of a b, which is also positive where both are
        negative; "four solutions for any joint values" counts complex ones.
    """
    m2, p, m3 = (jnp.asarray(reduced, float)[..., k] / robot.side for k in range(3))
    return 1 - (4 / 3) * (m2 * m2 - m2 * m3 + m3 * m3), 1 - (m2 - m3) ** 2 - p * p


def joints_from_zxy(robot: "PPPS3", alpha: ArrayLike, beta: ArrayLike, gamma: ArrayLike) -> Array:
    """Returns (mu2z, mu3y, mu3z), ``(..., 3)``, lengths, of a rotation Rz(alpha) Rx(beta) Ry(gamma) [ours].

    R12 = -cos(beta) sin(alpha), R31 = -cos(beta) sin(gamma), R32 = sin(beta). The cube of the home aspect is mapped one
    to one onto the joints with four solutions, its faces alpha = +-pi/2 onto the patch R22 = 0 of the boundary, gamma =
    +-pi/2 onto R33 = 0: an exact parametrisation of both. The faces beta = +-pi/2 become one point each, where the two
    patches meet and the robot has a self-motion.
    """
    alpha, beta, gamma = jnp.broadcast_arrays(*(jnp.asarray(angle, float) for angle in (alpha, beta, gamma)))
    cos = jnp.cos(beta)
    r12, r31, r32 = -cos * jnp.sin(alpha), -cos * jnp.sin(gamma), jnp.sin(beta)
    half = robot.mirror * r32 / 2
    middle = -(_SQRT3 / 2) * r31
    return robot.side * jnp.stack([middle - half, robot.mirror * r12, middle + half], axis=-1)


def joints_volume(robot: "PPPS3", nodes: int = 16) -> Array:
    """Returns the volume of the joints (mu2z, mu3y, mu3z) with four solutions, a length cubed: 8 / sqrt3 s^3 [ours].

    Integrated over the cube of the home aspect, with the Jacobian of ``joints_from_zxy`` by differentiation; Gauss and
    Legendre's rule converges exponentially, and 16 nodes an axis are enough for rounding. Differentiable.
    """
    points, weights = np.polynomial.legendre.leggauss(nodes)
    angles = jnp.stack(jnp.meshgrid(*[jnp.asarray(_RIGHT * points)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    weight = _RIGHT**3 * np.einsum("i,j,k->ijk", weights, weights, weights).ravel()
    slopes = jax.vmap(jax.jacfwd(lambda angle: joints_from_zxy(robot, *angle)))(angles)
    return jnp.sum(jnp.abs(jnp.linalg.det(slopes)) * weight)


def nearest_singular_rotation(factor: str, turn: ArrayLike) -> Array:
    """Returns a singular rotation nearest to home, ``(..., 3, 3)``: 90 degrees about an axis in a plane [ours].

    A rotation by the angle w about the unit vector n has R33 = cos(w) + (1 - cos(w)) nz^2 >= cos(w). So R33 is positive
    for w < pi/2, and at w = pi/2 it vanishes exactly for the axes with nz = 0; R22 likewise, with ny. Hence the largest
    ball about home within its aspect has the radius pi/2, and the share (pi/2 - 1) / pi = 0.1817 of all rotations.

    Args:
        factor: ``"R22"``, for axes in the plane of x and z, or ``"R33"``, for axes in the plane of x and y.
        turn: ``(...)`` angle of the axis in its plane, from x, rad.

    Raises:
        InputError: ``factor`` is another text.
    """
    if factor not in ("R22", "R33"):
        raise InputError(f"factor is {factor!r}: the 3-PPPS has the factors 'R22' and 'R33'; give one of them.")
    turn = jnp.asarray(turn, float)
    x, other, zero = jnp.cos(turn), jnp.sin(turn), jnp.zeros_like(turn)
    y, z = (other, zero) if factor == "R33" else (zero, other)
    return rotations.as_array(rotations.matrix_from_quaternion((jnp.ones_like(turn), x, y, z)))
