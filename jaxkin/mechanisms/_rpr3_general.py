"""All assembly modes of a general 3-RPR: every angle, then the two lines and the circle, then Newton.

Notation: p = (x, y), v_i = R(phi) b_i - A_i. Legs 2 and 3 minus leg 1 are two lines, v_i . p = e_i with
e_i = -(|v_i|^2 + r1 - r_i) / 2, and leg 1 is the circle |p|^2 = r1. With D = v2 x v3 the characteristic function

    |e2 J v3 - e3 J v2|^2 - r1 D^2

is a trigonometric polynomial of degree 3 in phi. Where D = 0 at one of its roots the lines are one line: the root
is double and carries two regular poses, or none; near such a joint value rounding leaves phi only 1e-8.
Those samples, and all with nearly double roots, take a second, careful pass; the rest never pays for it.

References:
    Gosselin, C. and Sefrioui, J., 1991 (the sextic); Wenger and Chablat 2009, Eqs. (4), (5), where v2 = (R, S) / 2,
    v3 = (U, V) / 2, D = (RV - SU) / 4. The print says that RV - SU = 0 spoils the inverse kinematics; it is
    the forward kinematics, and only this elimination.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.core.branches import Lane
from jaxkin.core.errors import Status
from jaxkin.core.precision import TOLERANCES
from jaxkin.numerics import quarter, sextic
from jaxkin.numerics.fusion import materialise

Points = tuple[tuple[Array, Array], tuple[Array, Array], tuple[Array, Array]]

_LANES = 6
#: How many careful samples are solved together.
_CAREFUL_BLOCK = 32
#: A regular pose next to a double one: the last Newton step and the determinant's share of its terms that rounding
#: leaves.
_STILL = 2e-8
_REGULAR = 1e-11
#: Roots nearer than this angle, or a value under this share of its rounding, leave their number undecided.
_MEETING_ANGLE = 1e-5
_MEETING_VALUE = 1e-11
#: Legs of so many characteristic lengths leave the number of modes undecided.
_FAR = 3e3


class _Robot(NamedTuple):
    """The geometry divided by its characteristic length: A2, A3, B2, B3."""

    a2: tuple[Array, Array]
    a3: tuple[Array, Array]
    b2: tuple[Array, Array]
    b3: tuple[Array, Array]


class _State(NamedTuple):
    """Poses on leading axes: x, y, cos phi, sin phi."""

    x: Array
    y: Array
    c: Array
    s: Array


class _Solved(NamedTuple):
    """Six lanes of one batch, ``(6, n)`` each."""

    x: Array
    y: Array
    phi: Array
    status: Array
    multiplicity: Array
    residual: Array


def forward(base: Points, platform: Points, length: Array, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
    """Finds all assembly modes; real ones come first, by ascending phi in [-pi, pi).

    Args:
        base: A1 = (0, 0), A2, A3, scalars.
        platform: B1 = (0, 0), B2, B3 in the platform's frame, scalars.
        length: Characteristic length, by which everything is divided.
        joints: rho1, rho2, rho3, arrays of one shape.
    """
    shape = jnp.broadcast_shapes(*(jnp.shape(rho) for rho in joints))
    points = [(px / length, py / length) for px, py in (*base[1:], *platform[1:])]
    robot = _Robot(*points)
    rho = jnp.stack([jnp.broadcast_to(value, shape).reshape(-1) / length for value in joints])
    solved, suspicious = _fast(robot, rho)
    solved = _second_pass(robot, rho, solved, suspicious)
    # Where all legs are this long, rounding of the legs moves the platform by as much as its modes are apart.
    far = jnp.min(rho, axis=0) > _FAR
    decided = (solved.status == Status.OK) | (solved.status == Status.NO_REAL_SOLUTION)
    status = jnp.where(far[None] & decided, jnp.int8(Status.UNDECIDED), solved.status)
    solved = solved._replace(status=status)
    lanes = []
    for k in range(_LANES):
        here = solved.multiplicity[k] > 0
        values = (solved.x[k] * length, solved.y[k] * length, solved.phi[k])
        lanes.append(
            Lane(
                values=tuple(jnp.where(here, value, jnp.nan).reshape(shape) for value in values),
                status=solved.status[k].reshape(shape),
                multiplicity=solved.multiplicity[k].reshape(shape),
                residual=jnp.where(here, solved.residual[k], jnp.nan).reshape(shape),
            )
        )
    return tuple(lanes)


def _arms(robot: _Robot, c: Array, s: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Returns v2 and v3."""
    (ax, ay), (bx, by) = robot.a2, robot.b2
    (dx, dy), (ex, ey) = robot.a3, robot.b3
    return (bx * c - by * s - ax, bx * s + by * c - ay), (ex * c - ey * s - dx, ex * s + ey * c - dy)


def _characteristic(robot: _Robot, rho: Array) -> tuple[Array, Array]:
    """Returns the Fourier coefficients of four times the characteristic function, and their magnitude.

    It is a polynomial in a = r1 - r2, b = r1 - r3 and r1 whose coefficients depend on geometry and phi only.
    """
    angles = 2 * math.pi * jnp.arange(7) / 7
    (v2x, v2y), (v3x, v3y) = _arms(robot, jnp.cos(angles), jnp.sin(angles))
    n2, n3 = v2x * v2x + v2y * v2y, v3x * v3x + v3y * v3y
    m, d = v2x * v3x + v2y * v3y, v2x * v3y - v2y * v3x
    values = jnp.stack(
        [n2 * n3 * (n2 + n3 - 2 * m), 2 * n3 * (n2 - m), 2 * n2 * (n3 - m), n3, n2, -2 * m, -4 * d * d],
        axis=1,
    )
    a, b = (rho[0] - rho[1]) * (rho[0] + rho[1]), (rho[0] - rho[2]) * (rho[0] + rho[2])
    monomials = jnp.stack([jnp.ones_like(a), a, b, a * a, b * b, a * b, rho[0] * rho[0]])
    magnitude = jnp.tensordot(jnp.max(jnp.abs(values), axis=0), jnp.abs(monomials), axes=1)
    return jnp.tensordot(sextic.fourier_matrix() @ values, monomials, axes=1), magnitude


def _place(robot: _Robot, rho: Array, c: Array, s: Array, sign: Array | None = None) -> tuple[_State, Array]:
    """Puts B1 on the better line and on the circle, and returns the state and D / (|v2| |v3|).

    Args:
        robot: Geometry.
        rho: ``(3, n)``.
        c: cos phi, ``(m, n)``.
        s: sin phi.
        sign: Which of the two points of line and circle; where None the other line decides.
    """
    (v2x, v2y), (v3x, v3y) = _arms(robot, c, s)
    n2, n3 = v2x * v2x + v2y * v2y, v3x * v3x + v3y * v3y
    e2 = -(n2 + (rho[0] - rho[1]) * (rho[0] + rho[1])) / 2
    e3 = -(n3 + (rho[0] - rho[2]) * (rho[0] + rho[2])) / 2
    d, m = v2x * v3y - v2y * v3x, v2x * v3x + v2y * v3y
    first = n2 >= n3
    vx, vy = jnp.where(first, v2x, v3x), jnp.where(first, v2y, v3y)
    n, e, other = jnp.where(first, n2, n3), jnp.where(first, e2, e3), jnp.where(first, e3, e2)
    inverse = 1 / jnp.maximum(n, 1e-300)
    square = jnp.maximum(rho[0] * rho[0] - e * e * inverse, 0.0)
    # Along the line, from its foot: w = (other - e m / n) |v| / D, in units of |v|.
    turn = jnp.where(first, d, -d)
    along = other - e * m * inverse
    parallel = jnp.abs(d) <= 1e-3 * jnp.sqrt(n2 * n3)
    if sign is None:
        w = jnp.where(
            parallel,
            jnp.where((along < 0) == (turn < 0), 1.0, -1.0) * jnp.sqrt(square * inverse),
            along / jnp.where(parallel, 1.0, turn),
        )
    else:
        w = sign * jnp.sqrt(square * inverse)
    foot = e * inverse
    x, y = materialise(foot * vx - w * vy, foot * vy + w * vx)
    return _State(x, y, c, s), d / jnp.sqrt(n2 * n3 + 1e-300)


class _Step(NamedTuple):
    """A Newton step, the determinant, and the size of the determinant's terms."""

    x: Array
    y: Array
    turn: Array
    determinant: Array
    size: Array


def _newton_step(robot: _Robot, rho: Array, state: _State) -> _Step:
    """Returns the Newton step on the three constraints, by Cramer's rule; it may be infinite or NaN."""
    x, y, c, s = state
    (v2x, v2y), (v3x, v3y) = _arms(robot, c, s)
    u2x, u2y, u3x, u3y = x + v2x, y + v2y, x + v3x, y + v3y
    f1 = (x * x + y * y - rho[0] * rho[0]) / 2
    f2 = (u2x * u2x + u2y * u2y - rho[1] * rho[1]) / 2
    f3 = (u3x * u3x + u3y * u3y - rho[2] * rho[2]) / 2
    (a2x, a2y), (a3x, a3y) = robot.a2, robot.a3
    # d v_i / d phi = J (v_i + A_i); its product with u_i is a cross product.
    k2 = (v2x + a2x) * u2y - (v2y + a2y) * u2x
    k3 = (v3x + a3x) * u3y - (v3y + a3y) * u3x
    m23, m13, m12 = u2x * u3y - u2y * u3x, x * u3y - y * u3x, x * u2y - y * u2x
    det = k3 * m12 - k2 * m13
    size = (jnp.abs(x) + jnp.abs(y)) * (
        jnp.abs(k3) * (jnp.abs(u2x) + jnp.abs(u2y)) + jnp.abs(k2) * (jnp.abs(u3x) + jnp.abs(u3y))
    )
    return _Step(
        -(f1 * (u2y * k3 - u3y * k2) + (f3 * k2 - f2 * k3) * y) / det,
        -(f1 * (u3x * k2 - u2x * k3) + (f2 * k3 - f3 * k2) * x) / det,
        -(f1 * m23 - f2 * m13 + f3 * m12) / det,
        det,
        size,
    )


def _moved(state: _State, x: Array, y: Array, turn: Array) -> _State:
    x, y = state.x + x, state.y + y
    c, s = state.c - state.s * turn, state.s + state.c * turn
    norm = jnp.sqrt(c * c + s * s)
    return _State(x, y, c / norm, s / norm)


def _damped_newton(robot: _Robot, rho: Array, state: _State) -> tuple[_State, Array, Array]:
    """Takes one Newton step of bounded length.

    Returns:
        The new state, the length of the undamped step, and the determinant as a share of its terms.
    """
    step = _newton_step(robot, rho, state)
    length = jnp.abs(step.turn) + jnp.abs(step.x) + jnp.abs(step.y)
    usable = jnp.isfinite(length)
    share = jnp.minimum(1.0, 0.3 / jnp.where(usable & (length > 0), length, 1.0))
    x, y, turn = (jnp.where(usable, value, 0.0) * share for value in step[:3])
    return _moved(state, x, y, turn), length, jnp.abs(step.determinant) / (step.size + 1e-300)


def _residual(robot: _Robot, rho: Array, state: _State) -> Array:
    """Returns the largest of |F_i| / (rho_i^2 + L^2), L = 1 here."""
    x, y, c, s = state
    (v2x, v2y), (v3x, v3y) = _arms(robot, c, s)
    worst = jnp.abs(x * x + y * y - rho[0] * rho[0]) / (rho[0] * rho[0] + 1)
    for k, ux, uy in ((1, x + v2x, y + v2y), (2, x + v3x, y + v3y)):
        worst = jnp.maximum(worst, jnp.abs(ux * ux + uy * uy - rho[k] * rho[k]) / (rho[k] * rho[k] + 1))
    return worst


def _fast(robot: _Robot, rho: Array) -> tuple[_Solved, Array]:
    """Solves every sample; returns with it where the careful pass must look again."""
    fourier, magnitude = _characteristic(robot, rho)
    roots = sextic.real_roots(fourier, magnitude)
    real = roots.quarters < 1
    state, _ = _place(robot, rho, *_direction(roots.quarters))
    step = _newton_step(robot, rho, state)
    state = _State(*materialise(*_moved(state, step.x, step.y, step.turn)))
    (residual,) = materialise(_residual(robot, rho, state))
    bad = real & ~(residual <= TOLERANCES.residual)
    # Neighbours in one place; over the seam at phi = pi the critical value alone tells.
    apart = sum(jnp.abs(value[1:] - value[:-1]) for value in state)
    twin = real[1:] & (apart < 1e-6)
    suspicious = sextic.any_row(bad) | sextic.any_row(twin) | roots.doubtful
    one, none = jnp.int8(1), jnp.int8(0)
    solved = _Solved(
        state.x,
        state.y,
        _angle(state),
        jnp.where(real, jnp.int8(Status.OK), jnp.int8(Status.NO_REAL_SOLUTION)),
        jnp.where(real, one, none),
        residual,
    )
    return solved, suspicious


def _direction(u: Array) -> tuple[Array, Array]:
    """Returns cos phi and sin phi."""
    s, c = quarter.half_angle(u)
    c, s = materialise((c - s) * (c + s), 2 * s * c)
    return c, s


def _angle(state: _State) -> Array:
    """Returns phi in [-pi, pi)."""
    # The half angle twice: an arctangent of one argument in [-1, 1], and no loss next to pi.
    c = jnp.where(state.c > 0, 1 + state.c, jnp.abs(state.s))
    s = jnp.where(state.c > 0, state.s, jnp.where(state.s < 0, state.c - 1, 1 - state.c))
    return quarter.angle(quarter.from_half_angle(s, c))


def _ordered(solved: _Solved) -> _Solved:
    """Returns the first six lanes by phi, those without a pose last.

    By counting what comes before a lane: XLA sorts one sample after the other, and gathers so as well.
    """
    key = jnp.where(solved.multiplicity > 0, solved.phi, 10.0)
    number = jnp.arange(len(key))[:, None]
    earlier = (key[:, None] < key[None]) | (key[:, None] == key[None]) & (number < number.T)[:, :, None]
    rank = jnp.sum(earlier, axis=0)

    def taken(values: Array) -> Array:
        return jnp.stack([jnp.sum(jnp.where(rank == k, values, 0), axis=0) for k in range(_LANES)]).astype(values.dtype)

    return _Solved(*map(taken, solved))


def _second_pass(robot: _Robot, rho: Array, solved: _Solved, suspicious: Array) -> _Solved:
    """Solves the suspicious samples again, a block at a time, until none is left."""
    n = rho.shape[1]
    block = min(_CAREFUL_BLOCK, n)

    def body(carry: tuple[_Solved, Array]) -> tuple[_Solved, Array]:
        solved, left = carry
        index = jnp.nonzero(left, size=block, fill_value=n)[0]
        again = _careful(robot, rho[:, jnp.minimum(index, n - 1)])
        merged = [old.at[:, index].set(new, mode="drop") for old, new in zip(solved, again, strict=True)]
        return _Solved(*merged), left.at[index].set(False, mode="drop")

    return jax.lax.while_loop(lambda carry: jnp.any(carry[1]), body, (solved, suspicious))[0]


def _careful(robot: _Robot, rho: Array) -> _Solved:
    """Solves samples whose roots nearly meet: every angle and critical angle, with both points of the line.

    A critical angle whose two roots are closer than the tolerance is a singular pose, taken as it is, unless D = 0
    there; every other candidate must converge as a regular solution. What lies at a singular pose belongs to it.
    """
    fourier, magnitude = _characteristic(robot, rho)
    roots = sextic.real_roots(fourier, magnitude, sextic.CAREFUL)

    c, s = _direction(jnp.concatenate([roots.quarters, roots.critical] * 2))
    sign = jnp.repeat(jnp.array([1.0, -1.0]), len(c) // 2)[:, None]
    start, _ = _place(robot, rho, c, s, sign)

    def polish(_: Array, carry: tuple) -> tuple:
        return _damped_newton(robot, rho, carry[0])

    begin = (start, jnp.full_like(c, jnp.inf), jnp.zeros_like(c))
    state, step, determinant = jax.lax.fori_loop(0, 12, polish, begin)
    residual = _residual(robot, rho, state)
    regular = (residual <= TOLERANCES.residual) & (step < _STILL) & (determinant > _REGULAR)

    # What the values of the characteristic function are known to, as a share of its maximum.
    known = magnitude / jnp.maximum(jnp.max(jnp.abs(fourier), axis=0), 1e-300)
    double, double_times = _singular_poses(robot, rho, roots, known)
    double_residual = _residual(robot, rho, double)
    both = _State(*(jnp.concatenate([a, b]) for a, b in zip(double, state, strict=True)))
    accepted = jnp.concatenate([double_times > 0, regular])
    times = jnp.concatenate([double_times, jnp.ones_like(regular, jnp.int8)])
    # An accepted pose close to an earlier accepted one is the same.
    reach = jnp.where(times > 1, jnp.where(times > 2, 20 * TOLERANCES.triple_angle, 20 * TOLERANCES.double_angle), 1e-7)
    apart = sum(jnp.abs(value[:, None] - value[None]) for value in both)
    close = apart < reach[None]

    def decide(i: Array, keep: Array) -> Array:
        return keep.at[i].set(keep[i] & ~jnp.any(keep & close[i] & (jnp.arange(len(keep)) < i)[:, None], axis=0))

    keep = jax.lax.fori_loop(0, len(accepted), decide, accepted)
    multiplicity = jnp.where(keep, times, jnp.int8(0))

    moving = roots.vanishes | _circle_of_poses(robot, rho, c, s)
    meeting = (roots.gap < _MEETING_ANGLE) | (roots.closeness < _MEETING_VALUE * known)
    # With multiplicity the number of modes is even; an odd one means that rounding lost or made one.
    odd = jnp.sum(multiplicity, axis=0) % 2 == 1
    undecided = (jnp.any(meeting, axis=0) & ~jnp.any(multiplicity > 1, axis=0)) | odd
    empty = jnp.where(undecided, jnp.int8(Status.UNDECIDED), jnp.int8(Status.NO_REAL_SOLUTION))
    empty = jnp.where(moving, jnp.int8(Status.SELF_MOTION), empty)
    plain = jnp.where(undecided, jnp.int8(Status.UNDECIDED), jnp.int8(Status.OK))
    status = jnp.where(multiplicity > 1, jnp.int8(Status.SINGULAR), plain[None])
    return _ordered(
        _Solved(
            both.x,
            both.y,
            _angle(both),
            jnp.where(keep, status, empty[None]),
            multiplicity,
            jnp.concatenate([double_residual, residual]),
        )
    )


def _singular_poses(robot: _Robot, rho: Array, roots: sextic.SexticRoots, known: Array) -> tuple[_State, Array]:
    """Returns the poses at the critical angles and their multiplicity, 0 where they are not singular."""
    state, lines = _place(robot, rho, *_direction(roots.critical))
    step = _newton_step(robot, rho, state)
    determinant = jnp.abs(step.determinant) / (step.size + 1e-300)
    residual = _residual(robot, rho, state)
    singular = (residual <= TOLERANCES.residual) & (jnp.abs(lines) > 1e-7) & (determinant < 1e-4)
    double = singular & ((roots.gap <= TOLERANCES.double_angle) | (roots.closeness <= 1e-15 * known))
    following = [jnp.roll(value, -1, axis=0) for value in (*state, singular)]
    apart = jnp.abs(state.c - following[2]) + jnp.abs(state.s - following[3])
    crowded = singular & following[4] & (apart < TOLERANCES.triple_angle)
    crowded = crowded & (jnp.arange(5) < 4)[:, None]
    triple = crowded & (jnp.maximum(roots.gap, jnp.roll(roots.gap, -1, axis=0)) <= TOLERANCES.triple_angle)
    times = jnp.where(triple, jnp.int8(3), jnp.where(double, jnp.int8(2), jnp.int8(0)))
    return state, times


def _circle_of_poses(robot: _Robot, rho: Array, c: Array, s: Array) -> Array:
    """True where at some candidate angle all legs are parallel translations of one: a circle of poses."""
    (v2x, v2y), (v3x, v3y) = _arms(robot, c, s)
    still = v2x * v2x + v2y * v2y + v3x * v3x + v3y * v3y < 1e-12
    equal = jnp.maximum(jnp.abs(rho[0] - rho[1]), jnp.abs(rho[0] - rho[2])) < 1e-10 * (1 + rho[0])
    return jnp.any(still, axis=0) & equal & (rho[0] > 0)
