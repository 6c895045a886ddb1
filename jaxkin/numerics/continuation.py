"""Curves given by equations, traced from many points at once, each as far as the next point.

A curve in m unknowns is the zero set of m - 1 equations. The cross product of their gradients orients it without
a choice, so that every point on it has one successor: points known to lie on the curves are traced in parallel until
each meets the next, and the pieces then fall into chains (ends on a border) and cycles (closed curves). If two
pieces end in one point, one of them has jumped between branches: the successors check each other.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.newton import value_and_slope
from jaxkin.numerics.small_linalg import null_vector, pivoted_solve

RUNNING, REACHED, LEFT, STUCK = 0, 1, 2, 3

#: Curves are dimensionless, of order one.
LONGEST_STEP, SHORTEST_STEP = 0.06, 1e-9
#: Angle between two tangents that a step aims at and the largest that it may make, rad.
_AIM, _WIDEST = 0.06, 0.2
#: A step ends in a seed when the corrected point is this close to it.
_MEETS = 1e-9
_ROUND = 64

Function = Callable[[Any, Array], Array]


class Lanes(NamedTuple):
    """Tracers, one a lane.

    Attributes:
        u: ``(lanes, m)`` where each is.
        tangent: ``(lanes, m)`` the oriented unit tangent there.
        step: ``(lanes,)`` length of the next step.
        sign: ``(lanes,)`` 1 along the orientation, -1 against it.
        state: ``(lanes,)`` RUNNING, REACHED, LEFT or STUCK.
        target: ``(lanes,)`` the seed that was reached, or -1.
        outside: ``(lanes, m)`` the first point beyond the border, where it was left.
    """

    u: Array
    tangent: Array
    step: Array
    sign: Array
    state: Array
    target: Array
    outside: Array


class Piece(NamedTuple):
    """A traced piece.

    Attributes:
        source: The seed where it starts.
        sign: 1 if it runs along the curve's orientation.
        state: REACHED, LEFT or STUCK.
        target: The seed where it ends, or -1.
        points: ``(k, m)`` from the seed on, both ends included (a seed reached is the last point).
        outside: ``(m,)`` the point beyond the border, where it was left.
    """

    source: int
    sign: int
    state: int
    target: int
    points: np.ndarray
    outside: np.ndarray


class Course(NamedTuple):
    """What all lanes share.

    Attributes:
        data: The pytree that the functions get.
        seeds: ``(n, m)`` points on the curve, at which a lane ends.
        alive: ``(n,)`` which of them are no padding.
        period: ``(m,)``.
        longest: Longest step.
    """

    data: Any
    seeds: Array
    alive: Array
    period: Array
    longest: Array


def _corrected(function: Function, data: Any, guess: Array, t: Array) -> tuple[Array, Array, Array]:
    """Returns the point of the curve in the plane through the guess across t, how Newton's moves shrank, the tangent.

    The ratio is small where the guess lies deep in Newton's domain of this branch; a guess that is nearer to another
    branch than its own error makes it large.
    """
    both = value_and_slope(partial(function, data))

    def body(k: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        u, sizes, _ = carry
        value, slope = both(u)
        move = pivoted_solve(jnp.concatenate([slope, t[None]]), jnp.append(-value, jnp.dot(t, guess - u)))
        return u + move, sizes.at[k].set(jnp.sqrt(jnp.sum(move * move))), slope

    u, sizes, slope = jax.lax.fori_loop(0, 4, body, (guess, jnp.zeros(4), jnp.zeros((len(t) - 1, len(t)))))
    ratio = sizes[1] / (sizes[0] + 1e-10)
    # The last move is far below the rounding of a tangent, so that its slope serves.
    return u, jnp.where(sizes[3] < 1e-11, ratio, jnp.inf), _unit(null_vector(slope))


def _unit(t: Array) -> Array:
    length = jnp.sqrt(jnp.sum(t * t))
    return t / jnp.where(length > 0, length, 1.0)


def _advance(function: Function, inside: Function, course: Course, lane: Lanes) -> tuple[Lanes, Array]:
    """Moves one lane by one step, shortened so as to land on a seed ahead if there is one."""
    data, seeds, alive, period, longest = course
    t = lane.tangent * lane.sign
    ahead = short_way(seeds - lane.u, period, jnp)
    along = ahead @ t
    across = jnp.sqrt(jnp.maximum(jnp.sum(ahead * ahead, axis=1) - along * along, 0.0))
    near = alive & (along > _MEETS) & (along <= lane.step) & (across <= 0.5 * along)
    reach = jnp.where(near, along, jnp.inf)
    nearest = jnp.argmin(reach)
    tries = jnp.any(near)
    step = jnp.where(tries, reach[nearest], lane.step)

    u, ratio, tangent = _corrected(function, data, lane.u + step * t, t)
    turn = jnp.sum(t * tangent * lane.sign)
    angle = jnp.arccos(jnp.clip(turn, -1.0, 1.0))
    good = (ratio < 0.1) & (angle < _WIDEST) & (jnp.sum((u - lane.u) ** 2) < (1.3 * step) ** 2)
    met = good & tries & (jnp.sqrt(jnp.sum(short_way(u - seeds[nearest], period, jnp) ** 2)) < 10 * _MEETS)
    left = good & ~met & ~(jnp.min(inside(data, u)) >= -1e-12)

    grown = lane.step * jnp.clip(_AIM / (angle * lane.step / step + 1e-3), 0.5, 2.0)
    length = jnp.where(good, jnp.minimum(grown, longest), 0.5 * step)
    stuck = ~good & (length < SHORTEST_STEP)
    state = jnp.where(met, REACHED, jnp.where(left, LEFT, jnp.where(stuck, STUCK, RUNNING)))
    running = lane.state == RUNNING
    moved = running & good & ~left
    after = Lanes(
        u=jnp.where(moved, u, lane.u),
        tangent=jnp.where(moved, tangent, lane.tangent),
        step=jnp.where(running, length, lane.step),
        sign=lane.sign,
        state=jnp.where(running, state, lane.state),
        target=jnp.where(running & met, nearest, lane.target),
        outside=jnp.where(running & left, u, lane.outside),
    )
    return after, moved


@partial(jax.jit, static_argnames=("function", "inside"))
def _round(function: Function, inside: Function, course: Course, lanes: Lanes) -> tuple[Lanes, Array, Array]:
    points = jnp.zeros((_ROUND, *lanes.u.shape))
    moves = jnp.zeros((_ROUND, lanes.u.shape[0]), bool)

    def body(carry):
        k, lanes, points, moves = carry
        lanes, moved = jax.vmap(lambda lane: _advance(function, inside, course, lane))(lanes)
        return k + 1, lanes, points.at[k].set(lanes.u), moves.at[k].set(moved)

    def unfinished(carry):
        return (carry[0] < _ROUND) & jnp.any(carry[1].state == RUNNING)

    return jax.lax.while_loop(unfinished, body, (0, lanes, points, moves))[1:]


@partial(jax.jit, static_argnames=("function",))
def _unit_tangents(function: Function, data: Any, u: Array) -> Array:
    return jax.vmap(lambda u: _unit(null_vector(jax.jacfwd(partial(function, data))(u))))(u)


def trace(
    function: Function,
    inside: Function,
    data: Any,
    seeds: np.ndarray,
    period: np.ndarray,
    starts: list[tuple[int, int]],
    *,
    longest: float = LONGEST_STEP,
    most_steps: int = 20000,
) -> list[Piece]:
    """Traces the curve from seeds to the next seed or out of the region.

    Args:
        function: ``(data, u) -> (m - 1,)`` equations of order one; hashable, it is compiled for.
        inside: ``(data, u) -> (k,)`` all not negative inside the region.
        data: A pytree that both get.
        seeds: ``(n, m)`` points on the curve.
        period: ``(m,)`` periods of glued unknowns, inf elsewhere.
        starts: Pairs (seed, sign): which seeds to start from, along (1) or against (-1) the orientation.
        longest: First and longest step.
        most_steps: After so many steps a lane that still runs is STUCK.

    Returns:
        One piece a start, in the same order.
    """
    if not starts:
        return []
    # Sizes are rounded up, so that few shapes are ever compiled.
    room, lanes_room = _padded(len(seeds)), _padded(len(starts))
    padded = np.full((room, seeds.shape[1]), 1e6)
    padded[: len(seeds)] = seeds
    alive = np.arange(room) < len(seeds)
    source = np.zeros(lanes_room, int)
    sign = np.ones(lanes_room)
    source[: len(starts)], sign[: len(starts)] = zip(*starts, strict=True)
    idle = np.arange(lanes_room) >= len(starts)
    lanes = Lanes(
        u=jnp.asarray(padded[source]),
        tangent=_unit_tangents(function, data, padded[source]),
        step=jnp.full(lanes_room, longest),
        sign=jnp.asarray(sign),
        state=jnp.asarray(np.where(idle, STUCK, RUNNING)),
        target=jnp.full(lanes_room, -1),
        outside=jnp.asarray(padded[source]),
    )
    course = Course(data, jnp.asarray(padded), jnp.asarray(alive), jnp.asarray(period), jnp.asarray(longest))
    tracks: list[list[np.ndarray]] = [[seeds[s]] for s, _ in starts]
    for _ in range(-(-most_steps // _ROUND)):
        lanes, points, moves = _round(function, inside, course, lanes)
        points, moves = np.asarray(points), np.asarray(moves)
        for k, track in enumerate(tracks):
            track.extend(points[moves[:, k], k])
        if not np.any(np.asarray(lanes.state) == RUNNING):
            break
    state, target, outside = (np.asarray(a) for a in (lanes.state, lanes.target, lanes.outside))
    return [
        Piece(s, sign, int(state[k]) or STUCK, int(target[k]), np.array(tracks[k]), outside[k])
        for k, (s, sign) in enumerate(starts)
    ]


def _padded(count: int) -> int:
    return max(128, 1 << (count - 1).bit_length())
