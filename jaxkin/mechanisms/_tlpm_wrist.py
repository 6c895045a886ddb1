"""Wrist angles and link distances of the TLPM, for a given orientation of the platform [ours].

All axes of a limb meet in p: the limb's axis z1 = unit(q_i - p), about which the active joint turns by psi; the R1 axis
z2, at right angles to z1 and to z3 (alpha1 = alpha2 = 90 degrees); the R2 axis z3, fixed to the platform at the angle
beta2 to its z axis. With the limb's frame R_i0 = [x y z], z = z1, x = unit(t x z), y = z x x, its tangent
t = Rz(eta_i1) e_y, and the rotation Q of the platform, the wrist closes:

    v_i = R_i0  Rz(psi) Rx(pi/2)  Rz(theta1) Ry(pi/2 - theta2)      v_i = Q Rz(eta_i2) Ry(beta2) Rx(pi/2)

Let (X, T, z3) be the columns of Q Rz(eta_i2) Ry(beta2), s = |z1 x z3| = hypot(z1.X, z1.T), and e = +-1 the elbow. Then

    z2 = e unit(z1 x z3)        e theta1 = atan2(s, z1.z3)        psi = atan2(z2.(t x z1), -z2.t)
    cos theta2 = -e z1.T / s    sin theta2 = e z1.X / s           z2 = -(X cos theta2 + T sin theta2)

so that e theta1 is the angle from the limb to the R2 axis, in [0, pi], and theta2 the angle about the R2 axis from -X,
where the platform's centre is, to the R1 axis. The other elbow turns psi and theta2 by pi and negates theta1. X, T and
z3 belong to the robot: a pose costs two square roots a limb, and no sine or cosine.

Link 2 has the axis L_i2 = [p + b z1, p + r1 z2], link 3 L_i3 = [p + r1 z2, p + r2 z3]. Distances are taken relative to
p: they depend on p only through the directions z1.

Conventions where nothing is determined (derivatives there are finite, and of no meaning): z1 = -e_z at p = q_i;
theta2 = e pi/2 where the R2 axis lies on the limb's axis (theta1 = 0 or e pi), so that psi and theta2 turn about one
line; x points to the axis of the base where the limb lies along its tangent t.

References:
    Fu, J. and Gao, F., "Kinematic performances of a novel TLPM parallel robot", section 5. Eqs. (13)-(15) are right.
    Wrong in print: R_i0 of (16)-(18) takes t for y, so it is no rotation unless p lies in the limb's vertical plane
    (t.z1 = -t.p / |q_i - p|). Its inverse makes (23) -90 degrees at every p for Q = 1, which is off by up to 23.1
    degrees for |x|, |y|, |z| <= 200 and L = h = 590; its transpose makes (23) right, and (22) off by up to 5.0. Entry
    (2, 3) of the matrix under (19) must be +s1 s2; R_i1 of (19) is nowhere defined, and stands on the left of (21) for
    R_i2; "(25) and (26)" are (19) and (20); (20) holds for Q = 1 and eta_i2 = eta_i1. A product of two rotations,
    Rz(theta1) Ry(theta2), is no general rotation: with R_i1 = 1, (22) gives psi + pi/2 instead of an angle
    of R1, while (23) gives -theta2. The distances of links must exceed sqrt(2) a; the printed sqrt(a) is no length.
"""

import itertools
import math
from collections.abc import Iterable
from functools import reduce
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import as_reals, concrete_reals
from jaxkin.mechanisms._geometry import checked_kind, checked_numbers
from jaxkin.numerics import rotations, segments
from jaxkin.numerics.fusion import materialise, spread, waist
from jaxkin.numerics.rotations import direction_angle
from jaxkin.numerics.small_linalg import Vector3, cross, dot

if TYPE_CHECKING:
    from jaxkin.mechanisms.tlpm import TLPM

#: Elbows (e1, e2, e3) in the order of ``elbow_modes``.
ELBOW_MODES = tuple(itertools.product((1, -1), repeat=3))
#: Links in the order of ``links``; the first digit is the limb's.
LINK_NAMES = ("L12", "L22", "L32", "L13", "L23", "L33")
#: Pairs of links of different limbs by their places in ``LINK_NAMES``: two links 2, two links 3, a link 2 and a link 3.
_PAIRS = (
    *itertools.combinations(range(3), 2),
    *itertools.combinations(range(3, 6), 2),
    *((i, 3 + j) for i, j in itertools.permutations(range(3), 2)),
)
#: Keys of ``clearances`` in their order, such as "L12-L23".
CLEARANCE_NAMES = tuple(f"{LINK_NAMES[i]}-{LINK_NAMES[j]}" for i, j in _PAIRS)

#: Squared lengths, mm^2, that are zero: their inverse powers in second derivatives remain finite.
_TINY = 1e-150
#: Squared sines of angles that are rounding.
_PARALLEL = 1e-30

Points = tuple[Vector3, Vector3]


class Wrist(NamedTuple):
    """The wrist of one limb.

    Attributes:
        theta1: Angle of R1, rad: e times the angle in [0, pi] from the limb's axis to the R2 axis.
        theta2: Angle of R2 in [-pi, pi), rad.
        psi: Angle of the active joint about the limb's axis in [-pi, pi), rad.
        link2: Ends of the axis of link 2, mm.
        link3: Ends of the axis of link 3, mm.
    """

    theta1: Array
    theta2: Array
    psi: Array
    link2: Points
    link3: Points


class _Axes(NamedTuple):
    """Axes of one limb, and the directions (sine, cosine) of e theta1 and theta2."""

    z1: Vector3
    z2: Vector3
    z3: Vector3
    theta1: tuple[Array, Array]
    theta2: tuple[Array, Array]


def _combined(a: Array, u: Vector3, b: Array, v: Vector3) -> Vector3:
    """Returns a u + b v."""
    return (a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2])


def _vector(parts: tuple[Array, ...]) -> Vector3:
    x, y, z = parts
    return x, y, z


def _platform_axes(robot: "TLPM") -> list[tuple[Vector3, Vector3, Vector3]]:
    """Returns the columns X, T, z3 of Q Rz(eta_i2) Ry(beta2) of each limb."""
    w, x, y, z = (robot.orientation[..., k] for k in range(4))
    turn = rotations.matrix_from_quaternion((w, x, y, z))
    cos_beta, sin_beta = jnp.cos(robot.beta2), jnp.sin(robot.beta2)
    cos_eta, sin_eta = jnp.cos(robot.platform_angles), jnp.sin(robot.platform_angles)
    axes = []
    for k in range(3):
        c, s = cos_eta[..., k], sin_eta[..., k]
        outward = rotations.apply(turn, (c * cos_beta, s * cos_beta, -sin_beta))
        tangent = rotations.apply(turn, (-s, c, jnp.zeros_like(c)))
        axes.append((outward, tangent, rotations.apply(turn, (c * sin_beta, s * sin_beta, cos_beta))))
    return axes


def _limb_axis(dx: Array, dy: Array, dz: Array) -> Vector3:
    """Returns the unit vector; -e_z for the null vector."""
    square = dx * dx + dy * dy + dz * dz
    there = square > _TINY
    inverse = 1 / jnp.sqrt(jnp.where(there, square, 1.0))
    unit = (jnp.where(there, c * inverse, other) for c, other in ((dx, 0.0), (dy, 0.0), (dz, -1.0)))
    return _vector(waist(*materialise(*unit)))


def _axes(robot: "TLPM", pose: tuple[Array, ...], elbows: tuple[int, int, int] | None = None) -> list[_Axes]:
    """Returns the axes of the three limbs, with the robot's elbows or others."""
    x, y, z = pose
    found = []
    for (qx, qy), (outward, tangent, z3), elbow in zip(
        robot.base_points(), _platform_axes(robot), elbows or robot.elbows, strict=True
    ):
        qx, qy, qz = spread(x, qx, qy, -robot.height)
        outward, tangent, z3 = _vector(spread(x, *outward)), _vector(spread(x, *tangent)), _vector(spread(x, *z3))
        z1 = _limb_axis(qx - x, qy - y, qz - z)
        m31, m33 = dot(z1, outward), -dot(z1, tangent)
        square = m31 * m31 + m33 * m33
        bent = square > _PARALLEL
        sine = jnp.sqrt(jnp.where(bent, square, 1.0))
        inverse = elbow / sine
        s2, c2 = waist(*materialise(jnp.where(bent, m31 * inverse, float(elbow)), jnp.where(bent, m33 * inverse, 0.0)))
        z2 = _combined(-c2, outward, -s2, tangent)
        found.append(_Axes(z1, z2, z3, (jnp.where(bent, sine, 0.0), dot(z1, z3)), (s2, c2)))
    return found


def _theta1(axes: _Axes) -> Array:
    """Returns e theta1 in [0, pi]."""
    angle = direction_angle(*axes.theta1)
    return jnp.where(angle < 0, math.pi, angle)


def _psi(axes: _Axes, cos_eta: Array, sin_eta: Array) -> Array:
    """Returns the angle about z1 from -y to z2, as |t x z1| x = t x z1, |t x z1| y = t - (t.z1) z1, and z1.z2 = 0."""
    t = (-sin_eta, cos_eta, jnp.zeros_like(cos_eta))
    x = cross(t, axes.z1)
    framed = dot(x, x) > _PARALLEL
    inward = (-cos_eta, -sin_eta, jnp.zeros_like(cos_eta))
    sine = jnp.where(framed, dot(axes.z2, x), dot(axes.z2, inward))
    cosine = jnp.where(framed, dot(axes.z2, t), dot(axes.z2, cross(axes.z1, inward)))
    return direction_angle(sine, -cosine)


def wrists(robot: "TLPM", pose: tuple[Array, ...]) -> tuple[Wrist, Wrist, Wrist]:
    """Returns angles and links of the three limbs, elementwise in the coordinates of the pose."""
    cos, sin = jnp.cos(robot.limb_angles), jnp.sin(robot.limb_angles)
    found = []
    for k, (axes, elbow) in enumerate(zip(_axes(robot, pose), robot.elbows, strict=True)):
        p = (pose[0], pose[1], pose[2])
        none = nowhere(p)
        one = jnp.ones_like(axes.z1[0]) + none
        begin, joint, end = (
            _combined(one, p, length, z) for length, z in zip((robot.b, robot.r1, robot.r2), axes[:3], strict=True)
        )
        theta1, theta2 = elbow * _theta1(axes) + none, direction_angle(*axes.theta2) + none
        psi = _psi(axes, cos[..., k], sin[..., k]) + none
        found.append(Wrist(theta1, theta2, psi, (begin, joint), (joint, end)))
    return tuple(found)


def _segments(robot: "TLPM", limbs: list[_Axes], overhang: ArrayLike) -> list[Points]:
    """Returns start and direction of the links' axes relative to p, in the order of ``LINK_NAMES``."""
    b, r1, r2 = spread(limbs[0].z1[0], robot.b, robot.r1, robot.r2)
    # z1, z2 and z2, z3 are at right angles, so the links' lengths do not depend on the pose.
    over = jnp.asarray(overhang, float)
    more2, more3 = over / jnp.sqrt(b * b + r1 * r1), over / jnp.sqrt(r1 * r1 + r2 * r2)
    return [_run(b, limb.z1, r1, limb.z2, more2) for limb in limbs] + [
        _run(r1, limb.z2, r2, limb.z3, more3) for limb in limbs
    ]


def _run(a: Array, u: Vector3, b: Array, v: Vector3, more: Array) -> Points:
    """Returns start and direction of the segment from a u to b v, longer at both ends by ``more`` of its length."""
    whole = 1 + 2 * more
    start, along = _combined((1 + more) * a, u, -more * b, v), _combined(whole * b, v, -whole * a, u)
    return _vector(waist(*start)), _vector(waist(*along))


def clearances(robot: "TLPM", pose: tuple[Array, ...], overhang: ArrayLike = 0.0) -> dict[str, Array]:
    """Returns the distances of the axes of links of different limbs, less sqrt(2) a, mm; elementwise.

    A link of square section, side a, lies within a / sqrt2 (half its diagonal) of its axis, whatever its roll about it:
    a common point of two links is within sqrt(2) a of both axes together. So a positive clearance excludes contact, of
    sides and of end faces alike. A negative one says "not proven free", not "interfering": two faces can be parallel
    and little more than a apart. No smaller bound holds for every roll.

    Args:
        robot: The robot.
        pose: Coordinates (x, y, z) of p, arrays of one shape, mm.
        overhang: How far the links' bodies run on beyond the ends of their axes, mm: a / 2 where a joint sits in a cube
            of side a, for instance.

    Returns:
        Twelve entries in the order of ``CLEARANCE_NAMES``: three pairs of links 2, three of links 3, and six of a link
        2 with the link 3 of another limb. Continuous, and differentiable wherever the closest points are unique and
        apart; at touching and at parallel axes the derivatives are finite.

    References:
        Fu and Gao, section 5, have these three kinds of pairs, the last with "i = 1, 2, 3" only, and D > sqrt(a).
    """
    return _marked(_clearances(robot, _axes(robot, pose), overhang), pose)


def _bound(robot: "TLPM") -> Array:
    return math.sqrt(2.0) * robot.a


def _clearances(robot: "TLPM", limbs: list[_Axes], overhang: ArrayLike) -> dict[str, Array]:
    axes = _segments(robot, limbs, overhang)
    apart = _distances([(axes[i], axes[j]) for i, j in _PAIRS])
    return {name: value - _bound(robot) for name, value in zip(CLEARANCE_NAMES, apart, strict=True)}


def _distances(pairs: list[tuple[Points, Points]]) -> list[Array]:
    """Returns the distance of each pair of segments.

    For one pose in one operation over all pairs: unrolled, the derivatives alone take many times as long to compile.
    For arrays of poses unrolled, so that nothing is written in between.
    """
    if jnp.ndim(pairs[0][0][0][0]) > 0:
        return [segments.distance(*one, *other) for one, other in pairs]
    p, u, q, v = (
        tuple(jnp.stack([pair[side][part][c] for pair in pairs]) for c in range(3))
        for side in (0, 1)
        for part in (0, 1)
    )
    found = segments.distance(p, u, q, v)  # type: ignore[arg-type]
    return [found[k] for k in range(len(pairs))]


def _nearest_turn(angle: Array, low: Array, high: Array) -> Array:
    """Returns the angle, but for whole turns, that is nearest to the middle of an interval; to 0 if that has none."""
    bounded = jnp.isfinite(low) & jnp.isfinite(high)
    middle = jnp.where(bounded, (jnp.where(bounded, low, 0.0) + jnp.where(bounded, high, 0.0)) / 2, 0.0)
    return angle - 2 * math.pi * jnp.round((angle - middle) / (2 * math.pi))


def angle_margins(robot: "TLPM", pose: tuple[Array, ...]) -> dict[str, Array]:
    """Returns the margins of e theta_i1 and e theta_i2 within ``robot.wrist_limits``, rad; elementwise.

    Of the angles that differ by turns, e theta_i2 is the one nearest to the middle of its interval: for (pi/6, pi), in
    [-5 pi/12, 19 pi/12). So "below pi" is passed continuously, and the smaller of both margins is continuous all round.
    e theta_i1 is in [0, pi]: it may reach an upper limit of pi, and not pass it.
    """
    return _marked(_all_angle_margins(robot, _axes(robot, pose)), pose)


def _all_angle_margins(robot: "TLPM", limbs: list[_Axes]) -> dict[str, Array]:
    found = {}
    for k, (limb, elbow) in enumerate(zip(limbs, robot.elbows, strict=True)):
        for name, margin in _angle_margins(robot, limb, elbow).items():
            found[f"theta{k + 1}{name}"] = margin
    return found


def _angle_margins(robot: "TLPM", limb: _Axes, elbow: int) -> dict[str, Array]:
    """Returns the four margins of one limb."""
    low, high = robot.wrist_limits.low, robot.wrist_limits.high
    theta1 = _theta1(limb)
    theta2 = _nearest_turn(elbow * direction_angle(*limb.theta2), low[..., 1], high[..., 1])
    return {
        "1_low": theta1 - low[..., 0],
        "1_high": high[..., 0] - theta1,
        "2_low": theta2 - low[..., 1],
        "2_high": high[..., 1] - theta2,
    }


def margins(robot: "TLPM", pose: tuple[Array, ...]) -> dict[str, Array]:
    """Returns the twelve margins of wrist angles (rad), then the twelve clearances (mm); elementwise.

    See ``angle_margins`` and ``clearances``.
    """
    limbs = _axes(robot, pose)
    return _marked(_all_angle_margins(robot, limbs) | _clearances(robot, limbs, 0.0), pose)


def _marked(values: dict[str, Array], pose: tuple[Array, ...]) -> dict[str, Array]:
    """Makes all values NaN where the pose is not finite."""
    none = nowhere(pose)
    return {name: value + none for name, value in values.items()}


class WristAngles(NamedTuple):
    """Wrist angles of the three limbs, rad.

    Attributes:
        theta1: ``(3,)`` angles of R1.
        theta2: ``(3,)`` angles of R2 in [-pi, pi).
        psi: ``(3,)`` angles of the active joints in [-pi, pi).
    """

    theta1: Array
    theta2: Array
    psi: Array


class ElbowModes(NamedTuple):
    """How free each choice of elbows is, in the order of ``elbows``.

    Attributes:
        elbows: ``(8, 3)`` signs.
        angle: ``(8,)`` smallest margin of the six wrist angles, rad.
        clearance: ``(8,)`` smallest of the twelve clearances, mm.
        free: ``(8,)`` True where both are positive, as the paper's limits are strict.
    """

    elbows: Array
    angle: Array
    clearance: Array
    free: Array


def checked_point(who: str, robot: "TLPM", pose: ArrayLike) -> Array:
    """Returns the pose as three numbers, or says what is wrong with it or with the robot."""
    from jaxkin.mechanisms.tlpm import TLPM

    checked_kind(f"jk.mechanisms.tlpm.{who}", robot, TLPM, "TLPM, made with jk.mechanisms.tlpm.create()")
    return checked_numbers("pose", pose, (3,), "x, y and z of p in mm")


def nowhere(pose: tuple[Array, ...]) -> Array:
    """Returns 0, and NaN at a pose that is not finite, which the guards against division by zero would hide."""
    return (pose[0] + pose[1] + pose[2]) * 0.0


def wrist_angles(robot: "TLPM", pose: ArrayLike) -> WristAngles:
    """Returns theta_i1, theta_i2 and psi_i of the three limbs for ``robot.orientation``, rad [ours].

    e theta_i1 is the angle from the limb's axis to the R2 axis; theta_i2 that about the R2 axis from the platform's
    centre to the R1 axis; psi_i that of the active joint about the limb's axis. At home with L = h and e = 1 they are
    90, 90 and 0 degrees. Conventions, and errors of the print: ``jaxkin.mechanisms._tlpm_wrist``.

    Args:
        robot: The robot, with its ``orientation`` and ``elbows``.
        pose: ``(3,)``, mm.

    Raises:
        InputError: The robot is no TLPM, or the pose is not three numbers.
    """
    return _wrist_angles(robot, checked_point("wrist_angles", robot, pose))


@jax.jit
def _wrist_angles(robot: "TLPM", pose: Array) -> WristAngles:
    one, two, three = wrists(robot, tuple(pose))
    return WristAngles(
        jnp.stack([one.theta1, two.theta1, three.theta1]),
        jnp.stack([one.theta2, two.theta2, three.theta2]),
        jnp.stack([one.psi, two.psi, three.psi]),
    )


def links(robot: "TLPM", pose: ArrayLike) -> Array:
    """Returns the ends of the links' axes, ``(6, 2, 3)``, mm, in the order L12, L22, L32, L13, L23, L33 [ours].

    L_i2 runs from the axis of limb i to its R1 axis, and L_i3 from there to the R2 axis, which the platform carries.

    Raises:
        InputError: The robot is no TLPM, or the pose is not three numbers.
    """
    return _links(robot, checked_point("links", robot, pose))


@jax.jit
def _links(robot: "TLPM", pose: Array) -> Array:
    found = wrists(robot, tuple(pose))
    axes = [wrist.link2 for wrist in found] + [wrist.link3 for wrist in found]
    return jnp.stack([jnp.stack([jnp.stack(end) for end in link]) for link in axes])


@jax.jit
def _stacked_clearances(robot: "TLPM", pose: Array, overhang: Array) -> Array:
    return jnp.stack(list(clearances(robot, tuple(pose), overhang).values()))


def _checked_overhang(overhang: ArrayLike) -> Array:
    length = as_reals(overhang)
    if length is None or length.shape != ():
        raise InputError(f"The overhang is {overhang!r}: it must be one length in mm; for many use jax.vmap.")
    known = concrete_reals(overhang)
    if known is not None and not 0 <= float(known) < math.inf:
        raise InputError(
            f"The overhang is {float(known):g} mm: it must be finite and not negative, as with shorter links a "
            "positive clearance would not exclude contact; give 0 or a / 2, say."
        )
    return length


def link_clearances(robot: "TLPM", pose: ArrayLike, overhang: ArrayLike = 0.0) -> dict[str, Array]:
    """Returns the distances of links of different limbs less sqrt(2) a, mm: positive excludes contact [ours].

    A negative one says "not proven free". The condition is that of Fu and Gao with sqrt(2) a for their sqrt(a), the
    links are those of ``links``; ``jaxkin.mechanisms._tlpm_wrist.clearances`` has the reasons.

    Args:
        robot: The robot.
        pose: ``(3,)``, mm.
        overhang: How far the links' bodies run on beyond the ends of their axes, mm, not negative; a / 2 for instance.

    Returns:
        Twelve scalars, from "L12-L22" to "L32-L23"; the first digit is the limb's.

    Raises:
        InputError: The robot is no TLPM, the pose is not three numbers, or the overhang is no length or negative (its
            sign is not checked under tracing).
    """
    point = checked_point("link_clearances", robot, pose)
    return dict(zip(CLEARANCE_NAMES, _stacked_clearances(robot, point, _checked_overhang(overhang)), strict=True))


def elbow_modes(robot: "TLPM", pose: ArrayLike) -> ElbowModes:
    """Returns the smallest angle margin and the smallest clearance for all eight choices of elbows [ours].

    ``robot.elbows`` plays no part. A wrist changes its elbow only through theta1 = 0 or pi, where R1 and R2 make it
    singular; the limits exclude that, so the choice is made in assembly.

    Raises:
        InputError: The robot is no TLPM, or the pose is not three numbers.
    """
    return _elbow_modes(robot, checked_point("elbow_modes", robot, pose))


@jax.jit
def _elbow_modes(robot: "TLPM", pose: Array) -> ElbowModes:
    point = tuple(pose)
    angles: dict[int, list[Array]] = {}
    axes: dict[int, list[Points]] = {}
    for elbow in (1, -1):
        limbs = _axes(robot, point, (elbow, elbow, elbow))
        angles[elbow] = [_least(_angle_margins(robot, limb, elbow).values()) for limb in limbs]
        axes[elbow] = _segments(robot, limbs, 0.0)
    # Every link depends on the elbow of its own limb alone: 48 distances serve all eight choices.
    pairs = [(i, j, e, f) for (i, j), e, f in itertools.product(_PAIRS, (1, -1), (1, -1))]
    apart = _distances([(axes[e][i], axes[f][j]) for i, j, e, f in pairs])
    distances = dict(zip(pairs, apart, strict=True))
    angle = jnp.stack([_least(angles[e][k] for k, e in enumerate(signs)) for signs in ELBOW_MODES]) + nowhere(point)
    closest = [_least(distances[i, j, signs[i % 3], signs[j % 3]] for i, j in _PAIRS) for signs in ELBOW_MODES]
    clearance = jnp.stack(closest) - _bound(robot) + nowhere(point)
    return ElbowModes(jnp.asarray(ELBOW_MODES), angle, clearance, (angle > 0) & (clearance > 0))


def _least(values: Iterable[Array]) -> Array:
    return reduce(jnp.minimum, values)
