"""Curves without an orientation of their own, traced from many points at once, both ways, each to the next point.

The kernel of A has no sign that could be chosen without looking back, so that the equations of cusps do not orient
their curves as those of ``numerics.continuation`` do. Here every tracer carries its tangent on. Each seed has two
sides; the piece that leaves one side arrives at one side of another seed, and must come back from there.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.mapping._cusp_curve_equations import tangent_of
from jaxkin.mapping.batch import in_blocks
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.newton import value_and_slope
from jaxkin.numerics.small_linalg import null_vector, pivoted_solve

RUNNING, REACHED, LEFT, STUCK = 0, 1, 2, 3

#: Angle between two tangents that a step aims at and the largest that it may make, rad.
_AIM, _WIDEST = 0.08, 0.25
#: Shortest step, and how near a corrected point must come to a seed to have reached it.
_SHORTEST, _MEETS = 1e-10, 1e-8
_ROUND = 48

#: ``(chart, data, u) -> array``: equations or margins; hashable, compiled for.
Function = Callable[[Any, Any, Array], Array]


class Rules(NamedTuple):
    """The functions of a trace, compiled for.

    Attributes:
        function: ``(chart, data, u) -> (m - 1,)`` equations of order one.
        inside: ``(chart, data, u) -> (k,)`` all not negative inside the region.
        most: ``(chart, data, u) -> ()`` the longest step that is safe at a point, or None.
    """

    function: Function
    inside: Function
    most: Function | None = None


class Lanes(NamedTuple):
    """Tracers, one a lane.

    Attributes:
        u: ``(lanes, m)`` where each is.
        tangent: ``(lanes, m)`` the unit tangent in the direction of travel.
        step: ``(lanes,)`` length of the next step.
        state: ``(lanes,)`` RUNNING, REACHED, LEFT or STUCK.
        target: ``(lanes,)`` the seed that was reached, or -1.
        outside: ``(lanes, m)`` the first point beyond the border, where it was left.
    """

    u: Array
    tangent: Array
    step: Array
    state: Array
    target: Array
    outside: Array


class Piece(NamedTuple):
    """A traced piece.

    Attributes:
        state: REACHED, LEFT or STUCK.
        target: The seed that was reached, or -1.
        side: The side of the target on which it arrived, 0 or 1.
        points: ``(k, m)`` from the seed on, the seed reached or the point beyond the border included.
    """

    state: int
    target: int
    side: int
    points: np.ndarray


def _advance(rules: Rules, chart: Any, shared: tuple[Any, ...], lane: Lanes):  # type: ignore[no-untyped-def]
    """Moves one lane by one step, shortened so as to land on a seed ahead if there is one."""
    data, seeds, alive, period, longest, noise = shared
    t = lane.tangent
    whole = lane.step if rules.most is None else jnp.minimum(lane.step, rules.most(chart, data, lane.u))
    ahead = short_way(seeds - lane.u, period, jnp)
    along = ahead @ t
    across = jnp.sqrt(jnp.maximum(jnp.sum(ahead * ahead, axis=1) - along * along, 0.0))
    near = alive & (along > 1e-9) & (along <= whole) & (across <= 0.5 * along)
    reach = jnp.where(near, along, jnp.inf)
    nearest = jnp.argmin(reach)
    tries = jnp.any(near)
    step = jnp.where(tries, reach[nearest], whole)

    u, ratio, slope = _corrected(partial(rules.function, chart, data), lane.u + step * t, t, noise)
    tangent = tangent_of(slope, t)
    angle = jnp.arccos(jnp.clip(jnp.sum(t * tangent), -1.0, 1.0))
    good = (ratio < 0.1) & (angle < _WIDEST) & (jnp.sum((u - lane.u) ** 2) < (1.3 * step) ** 2)
    met = good & tries & (jnp.max(jnp.abs(short_way(u - seeds[nearest], period, jnp))) < _MEETS + 100 * noise)
    left = good & ~met & ~(jnp.min(rules.inside(chart, data, u)) >= -1e-12)

    grown = lane.step * jnp.clip(_AIM / (angle * lane.step / step + 1e-3), 0.5, 2.0)
    length = jnp.where(good, jnp.minimum(grown, longest * (1 + 0.3 * jnp.max(jnp.abs(u)))), 0.5 * step)
    stuck = ~good & (length < _SHORTEST)
    running = lane.state == RUNNING
    moved = running & good & ~left
    state = jnp.where(met, REACHED, jnp.where(left, LEFT, jnp.where(stuck, STUCK, RUNNING)))
    after = Lanes(
        u=jnp.where(moved, u, lane.u),
        tangent=jnp.where(moved, tangent, t),
        step=jnp.where(running, length, lane.step),
        state=jnp.where(running, state, lane.state),
        target=jnp.where(running & met, nearest, lane.target),
        outside=jnp.where(running & left, u, lane.outside),
    )
    return after, moved


def _corrected(function: Callable[[Array], Array], guess: Array, t: Array, noise: Array) -> tuple[Array, Array, Array]:
    """Returns the point of the curve in the plane through the guess across t, how Newton's moves shrank, the slope."""
    both = value_and_slope(function)

    def body(k: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        u, sizes, _ = carry
        value, slope = both(u)
        move = pivoted_solve(jnp.concatenate([slope, t[None]]), jnp.append(-value, jnp.dot(t, guess - u)))
        return u + move, sizes.at[k].set(jnp.sqrt(jnp.sum(move * move))), slope

    u, sizes, slope = jax.lax.fori_loop(0, 4, body, (guess, jnp.zeros(4), jnp.zeros((len(t) - 1, len(t)))))
    return (
        u,
        jnp.where(sizes[3] < noise * (1 + jnp.max(jnp.abs(u))), sizes[1] / (sizes[0] + 100 * noise), jnp.inf),
        slope,
    )


@partial(jax.jit, static_argnames=("rules", "chart"))
def _round(rules: Rules, chart: Any, shared: tuple[Any, ...], lanes: Lanes):  # type: ignore[no-untyped-def]
    points = jnp.zeros((_ROUND, *lanes.u.shape))
    moves = jnp.zeros((_ROUND, lanes.u.shape[0]), bool)

    def body(carry):  # type: ignore[no-untyped-def]
        k, lanes, points, moves = carry
        lanes, moved = jax.vmap(lambda lane: _advance(rules, chart, shared, lane))(lanes)
        return k + 1, lanes, points.at[k].set(lanes.u), moves.at[k].set(moved)

    def unfinished(carry):  # type: ignore[no-untyped-def]
        return (carry[0] < _ROUND) & jnp.any(carry[1].state == RUNNING)

    return jax.lax.while_loop(unfinished, body, (0, lanes, points, moves))[1:]


@partial(jax.jit, static_argnames=("function", "chart"))
def _tangents(function: Function, chart: Any, data: Any, u: Array) -> Array:
    def one(u: Array) -> Array:
        slope = jax.jacfwd(partial(function, chart, data))(u)
        small = slope.shape[1] <= 4
        t = null_vector(slope) if small else jnp.linalg.svd(slope, full_matrices=True)[2][-1]
        return t / jnp.sqrt(jnp.sum(t * t))

    return jax.vmap(one)(u)


def directions_at(function: Function, chart: Any, data: Any, u: np.ndarray) -> np.ndarray:
    """Returns a unit tangent of the curve at each point, of either sense, ``(k, m)``."""
    return in_blocks(partial(_tangents, function, chart, data), u)


def trace(
    rules: Rules,
    chart: Any,
    data: Any,
    seeds: np.ndarray,
    period: np.ndarray,
    *,
    longest: float,
    noise: float = 1e-11,
    most_steps: int = 20000,
) -> dict[tuple[int, int], Piece]:
    """Traces the curve from both sides of every seed to the next seed or out of the region.

    Args:
        rules: Equations, region and longest steps.
        chart: What they get first; hashable, compiled for.
        data: A pytree that they get.
        seeds: ``(n, m)`` points on the curve.
        period: ``(m,)`` periods of glued unknowns, inf elsewhere.
        longest: First and longest step near the origin; far away steps may grow with the distance.
        noise: How far rounding may move a corrected point.
        most_steps: After so many steps a lane that still runs is STUCK.

    Returns:
        One piece for each (seed, side).
    """
    if len(seeds) == 0:
        return {}
    room = max(64, 1 << (len(seeds) - 1).bit_length())
    padded = np.concatenate([seeds, np.repeat(seeds[-1:], room - len(seeds), axis=0)])
    alive = np.arange(room) < len(seeds)
    directions = directions_at(rules.function, chart, data, padded)
    lanes = Lanes(
        u=jnp.asarray(np.concatenate([padded, padded])),
        tangent=jnp.asarray(np.concatenate([directions, -directions])),
        step=jnp.full(2 * room, longest, float),
        state=jnp.asarray(np.where(np.tile(alive, 2), RUNNING, STUCK), int),
        target=jnp.full(2 * room, -1, int),
        outside=jnp.asarray(np.concatenate([padded, padded])),
    )
    shared = (
        data,
        jnp.asarray(padded),
        jnp.asarray(alive),
        jnp.asarray(period),
        jnp.asarray(longest),
        jnp.asarray(noise),
    )
    tracks: dict[int, list[np.ndarray]] = {int(lane): [] for lane in np.flatnonzero(np.tile(alive, 2))}
    for _ in range(-(-most_steps // _ROUND)):
        lanes, points, moves = _round(rules, chart, shared, lanes)
        points, moves = np.asarray(points), np.asarray(moves)
        for lane, track in tracks.items():
            track.extend(points[moves[:, lane], lane])
        if not np.any(np.asarray(lanes.state) == RUNNING):
            break
    last = [np.asarray(part) for part in (lanes.tangent, lanes.state, lanes.target, lanes.outside)]
    return {
        (lane % room, lane // room): _piece(padded[lane % room], track, directions, [part[lane] for part in last])
        for lane, track in tracks.items()
    }


def _piece(seed: np.ndarray, track: list[np.ndarray], directions: np.ndarray, last: list[Any]) -> Piece:
    tangent, state, target, outside = last
    points = np.array([seed, *track, *([outside] if state == LEFT else [])])
    # Side 0 leaves along the seed's direction, so that who travels along it arrives on side 1.
    side = int(np.dot(tangent, directions[target]) > 0) if state == REACHED else 0
    return Piece(int(state) or STUCK, int(target), side, points)


class Chain(NamedTuple):
    """A whole traced curve.

    Attributes:
        points: ``(k, m)`` continuous; a closed one does not repeat its first point. Ends LEFT are beyond the border.
        closed: True where the last point is followed by the first.
        ends: The states of both ends, LEFT or STUCK.
    """

    points: np.ndarray
    closed: bool
    ends: tuple[int, int]


def chains_of(pieces: dict[tuple[int, int], Piece], period: np.ndarray) -> tuple[list[Chain], int]:
    """Links pieces into chains, and counts contradictions: pieces that do not come back, and stuck ones."""
    contradictions = sum(piece.state == STUCK for piece in pieces.values())
    for key, piece in pieces.items():
        if piece.state == REACHED:
            back = pieces[piece.target, piece.side]
            contradictions += (back.state, back.target, back.side) != (REACHED, *key)
    used: set[tuple[int, int]] = set()
    chains = []
    starts = [key for key, piece in pieces.items() if piece.state != REACHED]
    for start in [*starts, *pieces]:
        if start in used:
            continue
        chain = _walk(pieces, start, used, period)
        if len(chain.points) > 1:
            chains.append(chain)
    return chains, contradictions


def _walk(
    pieces: dict[tuple[int, int], Piece], start: tuple[int, int], used: set[tuple[int, int]], period: np.ndarray
) -> Chain:
    """Goes on from one side of a seed: from an end backwards through it, or round a closed curve."""
    first = pieces[start]
    parts, ends, key = [], [STUCK, STUCK], start
    if first.state != REACHED:
        used.add(start)
        parts, ends[0], key = [first.points[::-1]], first.state, (start[0], 1 - start[1])
    while key not in used:
        piece = pieces[key]
        used.add(key)
        parts.append(piece.points)
        if piece.state != REACHED:
            ends[1] = piece.state
            break
        used.add((piece.target, piece.side))
        key = (piece.target, 1 - piece.side)
    else:
        if first.state == REACHED and key == start:
            points = _joined(parts, period)
            return Chain(points[:-1], True, (STUCK, STUCK))
    return Chain(_joined(parts, period), False, (ends[0], ends[1]))


def _joined(parts: list[np.ndarray], period: np.ndarray) -> np.ndarray:
    """Strings parts together without jumps at the glued ends and without repeated points."""
    glued = np.isfinite(period)
    turn = np.where(glued, period, 1.0)
    whole: list[np.ndarray] = []
    for part in parts:
        if whole:
            part = part + np.where(glued, turn * np.round((whole[-1][-1] - part[0]) / turn), 0.0)
        whole.append(part)
    points = np.concatenate(whole)
    return points[np.concatenate([[True], np.max(np.abs(np.diff(points, axis=0)), axis=1, initial=0.0) > 1e-9])]
