"""The compiled core of ``jk.track``: steps along a polyline of joints that cannot reach another assembly mode.

Poses are dimensionless here (lengths over the characteristic length). With G = A^-1 F around a pose x of the mode, A =
dF/dx taken there once, and joints q + s d, the map x - G is a contraction of a ball that keeps its centre's mode where
2 K (e s + c s^2) <= (1 - a s)^2, with K the norm of A^-1 F_xx over the ball, e = |A^-1 F_q d|, a = |A^-1 F_xq d| and
c = |A^-1 F_qq d d| / 2 (Kantorovich's theorem for Newton's simplified method, in the form that no scaling of the
equations changes). It implies the coarser |A^-1|^2 K |B| |dq| <= 1/2. The norms over the ball are estimated at a few of
its points.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.numerics.newton import value_and_slope
from jaxkin.numerics.small_linalg import any_determinant, pivoted_solve

RUNNING, ARRIVED, NARROW = 0, 1, 2
#: Points that one compiled round records.
ROUND = 512
#: A step shorter than this, in t, is the sign of a fold: the walk pauses there.
FLOOR = 1e-6
#: By so much the norms found at a few points of a ball are enlarged.
_ALLOWANCE = 1.25
_CORRECTIONS = 6


class Course(NamedTuple):
    """What a walk follows.

    Attributes:
        waypoints: ``(m, n_joint)``; what is beyond the last one repeats it.
        end: t at which the walk ends.
        share: Share of the longest safe step that is made, at most 1.
    """

    waypoints: Array
    end: Array
    share: Array


class Walker(NamedTuple):
    """Where a walk is, and what it recorded in this round.

    Attributes:
        pose: ``(n_pose,)`` dimensionless.
        t: Parameter: waypoint k is at t = k.
        step: The last safe step found.
        trust: Share of it that is tried: halved after a refusal.
        floor: A safe step below it makes the walk pause.
        state: RUNNING, ARRIVED or NARROW.
        recorded: Points recorded in this round.
        poses: ``(ROUND, n_pose)``.
        ts: ``(ROUND,)``.
    """

    pose: Array
    t: Array
    step: Array
    trust: Array
    floor: Array
    state: Array
    recorded: Array
    poses: Array
    ts: Array


def joints_at(waypoints: Array, t: Array) -> tuple[Array, Array]:
    """Returns the joints at t and their derivative on the segment that follows, both ``(n_joint,)``."""
    k = jnp.clip(jnp.floor(t).astype(int), 0, waypoints.shape[0] - 2)
    start, direction = waypoints[k], waypoints[k + 1] - waypoints[k]
    return start + (t - k) * direction, direction


def pose_unit(robot: Mechanism) -> Array:
    """Returns one unit per pose axis."""
    return scale_vector(robot.pose_axes, robot.characteristic_length())


def closure(robot: Mechanism, x: Array, q: Array) -> Array:
    """Returns the constraints at a dimensionless pose, in their own units."""
    return robot.constraints(x * pose_unit(robot), q)


def dimensionless_residual(robot: Mechanism, x: Array, q: Array) -> Array:
    """Returns the largest constraint over the size of its terms."""
    return jnp.max(jnp.abs(closure(robot, x, q)) / robot.constraint_scales(x * pose_unit(robot), q))


def _times(inverse: Array, tensor: Array) -> Array:
    return jnp.tensordot(inverse, tensor, 1)


def _size(tensor: Array) -> Array:
    return jnp.sqrt(jnp.sum(tensor * tensor))


def safe_step(robot: Mechanism, x: Array, q: Array, direction: Array) -> tuple[Array, Array, Array]:
    """Returns the longest safe step from a pose, its tangent dx/dt, and how far from it the mode is alone."""
    n = len(x)

    def equations(z: Array) -> Array:
        return closure(robot, z[:n], q + z[n] * direction)

    slope = jax.jacfwd(equations)
    bends = jax.jacfwd(slope)
    z = jnp.append(x, 0.0)
    first = slope(z)
    inverse = jax.vmap(lambda e: pivoted_solve(first[:, :n], e), out_axes=1)(jnp.eye(n))
    radius = jnp.minimum(1.0 / (_size(_times(inverse, bends(z)[:, :n, :n])) + 1e-300), 1.0)
    ball = jnp.concatenate([jnp.zeros((1, n + 1)), radius * jnp.eye(n, n + 1), -radius * jnp.eye(n, n + 1)])
    # Second derivatives after A^-1: pose with pose, pose with t, t with t, each the largest over the ball.
    seconds = jax.vmap(lambda shift: _times(inverse, bends(z + shift)))(ball)
    parts = (seconds[:, :, :n, :n], seconds[:, :, :n, n], 0.5 * seconds[:, :, n, n])
    curvature, mixed, bend = (_ALLOWANCE * jnp.max(jax.vmap(_size)(part)) for part in parts)
    tangent = -inverse @ first[:, n]
    b = mixed + curvature * _size(tangent)
    # The smallest positive root of 2 K (e s + c s^2) = (1 - a s)^2.
    step = 1.0 / (b + jnp.sqrt(jnp.maximum(b * b - mixed * mixed + 2 * curvature * bend, 0.0)) + 1e-300)
    alone = jnp.maximum(1.0 - mixed * step, 0.0) / (curvature + 1e-300)
    return jnp.where(jnp.isfinite(step), step, 0.0), tangent, alone


def corrected(robot: Mechanism, guess: Array, q: Array) -> tuple[Array, Array]:
    """Returns the pose to which Newton's method moves a guess, and the length of the last move."""
    both = value_and_slope(lambda x: closure(robot, x, q))

    def move(_: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        x, _last = carry
        value, slope = both(x)
        change = pivoted_solve(slope, value)
        return x - change, _size(change)

    return jax.lax.fori_loop(0, _CORRECTIONS, move, (guess, jnp.zeros(())))


def _advance(robot: Mechanism, course: Course, walker: Walker) -> Walker:
    """Moves a walk by one step, or refuses it and trusts less."""
    q, direction = joints_at(course.waypoints, walker.t)
    safe, tangent, alone = safe_step(robot, walker.pose, q, direction)
    corner = jnp.minimum(jnp.floor(walker.t) + 1.0, course.end)
    wanted = safe * course.share * walker.trust
    reaches = walker.t + wanted >= corner
    t = jnp.where(reaches, corner, walker.t + wanted)
    step = t - walker.t
    after = joints_at(course.waypoints, walker.t)[0] + step * direction
    pose, last = corrected(robot, walker.pose + step * tangent, after)
    good = (last < 1e-9) & (_size(pose - walker.pose) <= alone) & (step > 0)
    # A step that is cut short by a corner says nothing of a fold.
    narrow = ~reaches & (safe * walker.trust < walker.floor)
    good, trust = good & ~narrow, jnp.where(good, jnp.minimum(2 * walker.trust, 1.0), 0.5 * walker.trust)
    state = jnp.where(good & (t >= course.end), ARRIVED, jnp.where(narrow, NARROW, RUNNING))
    return Walker(
        pose=jnp.where(good, pose, walker.pose),
        t=jnp.where(good, t, walker.t),
        step=safe,
        trust=trust,
        floor=jnp.where(safe > 1e2 * FLOOR, FLOOR, walker.floor),
        state=state,
        recorded=walker.recorded + good,
        poses=walker.poses.at[walker.recorded].set(jnp.where(good, pose, walker.poses[walker.recorded])),
        ts=walker.ts.at[walker.recorded].set(jnp.where(good, t, walker.ts[walker.recorded])),
    )


def started(pose: Array, t: Array | float = 0.0) -> Walker:
    """Returns a walk that has not begun, at a dimensionless pose."""
    n = pose.shape[-1]
    zero = jnp.zeros(())
    return Walker(
        pose=jnp.asarray(pose),
        t=zero + t,
        step=zero,
        trust=zero + 1.0,
        floor=zero + FLOOR,
        state=jnp.asarray(RUNNING),
        recorded=jnp.asarray(0),
        poses=jnp.zeros((ROUND, n)),
        ts=jnp.zeros(ROUND),
    )


def walk_round(robot: Mechanism, course: Course, walker: Walker) -> Walker:
    """Walks until the end, a narrow place, or until the record of this round is full; ``vmap`` makes many walks."""

    def goes_on(carry: tuple[Array, Walker]) -> Array:
        tries, walker = carry
        return (walker.state == RUNNING) & (walker.recorded < ROUND) & (tries < 4 * ROUND)

    def step(carry: tuple[Array, Walker]) -> tuple[Array, Walker]:
        return carry[0] + 1, _advance(robot, course, carry[1])

    begun = walker._replace(recorded=jnp.zeros_like(walker.recorded), state=jnp.full_like(walker.state, RUNNING))
    return jax.lax.while_loop(goes_on, step, (jnp.asarray(0), begun))[1]


def fold_ahead(robot: Mechanism, waypoints: Array, x: Array, t: Array) -> tuple[Array, Array, Array, Array]:
    """Seeks the fold on the segment of t, by Newton's method on F = 0, det A = 0 in pose and t.

    Returns:
        The dimensionless pose, its t (on the straight line of the segment, also beyond its end), the length of the last
        move, and |dx/dt| at the start.
    """
    n = len(x)
    q, direction = joints_at(waypoints, t)
    slope = jax.jacfwd(partial(closure, robot))
    direct = slope(x, q)
    rows = jnp.sqrt(jnp.sum(direct**2, axis=1))
    tangent = pivoted_solve(direct, jax.jvp(partial(closure, robot, x), (q,), (direction,))[1])

    def system(z: Array) -> Array:
        here = q + z[n] * direction
        return jnp.append(closure(robot, z[:n], here) / rows, any_determinant(slope(z[:n], here) / rows[:, None]))

    both = value_and_slope(system)

    def move(_: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        z, _last = carry
        value, gradient = both(z)
        change = pivoted_solve(gradient, value)
        return z - change, _size(change)

    z, last = jax.lax.fori_loop(0, 12, move, (jnp.append(x, 0.0), jnp.zeros(())))
    return z[:n], t + z[n], last, _size(tangent)


walk = jax.jit(walk_round)
seek_fold = jax.jit(fold_ahead)
