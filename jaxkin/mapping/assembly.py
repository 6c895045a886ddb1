"""From traced pieces to whole curves: chains, cycles, and straight ways through crossings (no JAX here)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jaxkin.numerics.continuation import LEFT, REACHED, STUCK, Piece
from jaxkin.numerics.gluing import short_way


class End(NamedTuple):
    """What an arc ends on.

    Attributes:
        kind: "border", "crossing", "lost" (the tracer got stuck) or "" for a closed arc.
        number: Number of the border or of the crossing.
        half: Which of the four half-branches of the crossing: 2 * direction + side.
    """

    kind: str
    number: int = -1
    half: int = -1


CLOSED = End("")
#: Distance between markers on a segment, and how many of the nearest ones are looked at.
_MARKER, _NEIGHBOURS = 0.01, 24


@dataclass(frozen=True)
class Arc:
    """A piece of the curve between ends: smooth, or a whole curve that goes straight through crossings.

    Attributes:
        points: ``(k, m)``, continuous (glued unknowns run on); a closed arc does not repeat its first point.
        start: Where it begins.
        end: Where it ends.
    """

    points: np.ndarray
    start: End
    end: End

    @property
    def closed(self) -> bool:
        """True where the last point is followed by the first."""
        return self.start.kind == ""


@dataclass(frozen=True)
class Network:
    """Pieces between seeds, and what is known of the seeds.

    Attributes:
        seeds: ``(n, m)``.
        halves: Which seeds are half-branches: seed -> (crossing, half, flows out).
        forward: The piece that leaves each seed along the orientation, where there is one.
        backward: The piece that leaves against it, for seeds that nothing reaches.
        borders: The border point and its number, by (seed, sign) of a piece that left the box.
        crossings: ``(n, m)``.
        period: ``(m,)``.
    """

    seeds: np.ndarray
    halves: dict[int, tuple[int, int, bool]]
    forward: dict[int, Piece]
    backward: dict[int, Piece]
    borders: dict[tuple[int, int], tuple[np.ndarray, int]]
    crossings: np.ndarray
    period: np.ndarray

    @property
    def contradictions(self) -> int:
        """How many pieces are stuck, or meet in one seed: 0 where each seed has one successor and one predecessor."""
        pieces = [*self.forward.values(), *self.backward.values()]
        targets = [piece.target for piece in self.forward.values() if piece.state == REACHED]
        stuck = sum(piece.state == STUCK for piece in pieces)
        lost = sum(piece.state == LEFT and (piece.source, piece.sign) not in self.borders for piece in pieces)
        joined = sum(piece.state == REACHED for piece in self.backward.values())
        outward = sum(self.halves[t][2] for t in targets if t in self.halves)
        return stuck + lost + joined + outward + len(targets) - len(set(targets))


def arcs_of(network: Network) -> list[Arc]:
    """Links the pieces into arcs."""
    reached = {piece.target for piece in network.forward.values() if piece.state == REACHED}
    arcs, used = [], set()
    for seed in range(len(network.seeds)):
        if seed not in reached and seed not in used:
            start, lead = _beginning(network, seed)
            arcs.append(_chain(network, seed, start, lead, used))
    for seed in range(len(network.seeds)):
        if seed not in used:
            arcs.append(_chain(network, seed, CLOSED, [], used))
    return [arc for arc in arcs if len(arc.points) > 1]


def _beginning(network: Network, seed: int) -> tuple[End, list[np.ndarray]]:
    """Returns what lies before a seed that no other piece reaches."""
    if seed in network.halves and network.halves[seed][2]:
        crossing, half, _ = network.halves[seed]
        return End("crossing", crossing, half), [network.crossings[crossing][None]]
    piece = network.backward.get(seed)
    if piece is None:
        return End("lost"), []
    end, points = _finish(network, piece)
    return end, [points[::-1]]


def _finish(network: Network, piece: Piece) -> tuple[End, np.ndarray]:
    """Returns the end of a piece that reached no seed, and its points with the border's last."""
    border = network.borders.get((piece.source, piece.sign))
    if piece.state == LEFT and border is not None:
        return End("border", border[1]), np.vstack([piece.points, border[0]])
    return End("lost"), piece.points


def _chain(network: Network, seed: int, start: End, lead: list[np.ndarray], used: set[int]) -> Arc:
    parts, end = lead or [network.seeds[seed][None]], CLOSED
    first = seed
    while True:
        used.add(seed)
        if seed in network.halves and not network.halves[seed][2]:
            crossing, half, _ = network.halves[seed]
            end = End("crossing", crossing, half)
            parts.append(network.crossings[crossing][None])
            break
        piece = network.forward.get(seed)
        if piece is None or piece.state != REACHED:
            end, points = _finish(network, piece) if piece is not None else (End("lost"), network.seeds[seed][None])
            parts.append(points)
            break
        parts.append(piece.points)
        if piece.target == first and start == CLOSED:
            break
        if piece.target in used:  # Two pieces meet in one seed: the network is contradictory.
            end = End("lost")
            break
        seed = piece.target
    points = _joined(parts, network.period)
    closed = start == CLOSED
    if closed and end == CLOSED:
        return Arc(points[:-1], CLOSED, CLOSED)
    return Arc(points, End("lost") if closed else start, end)


def _joined(parts: list[np.ndarray], period: np.ndarray) -> np.ndarray:
    """Strings parts together without jumps at the glued ends and without repeated points."""
    turn = np.where(np.isfinite(period), period, 1.0)
    whole = [parts[0]]
    for part in parts[1:]:
        shift = np.where(np.isfinite(period), turn * np.round((whole[-1][-1] - part[0]) / turn), 0.0)
        whole.append(part + shift)
    points = np.concatenate(whole)
    steps = np.max(np.abs(np.diff(points, axis=0)), axis=1, initial=0.0)
    return points[np.concatenate([[True], steps > 1e-9])]


def strands_of(arcs: list[Arc], period: np.ndarray) -> list[Arc]:
    """Joins smooth arcs that pass straight through a crossing, and returns whole curves, longest first."""
    at: dict[tuple[int, int], tuple[int, bool]] = {}
    for k, arc in enumerate(arcs):
        for end, is_end in ((arc.start, False), (arc.end, True)):
            if end.kind == "crossing":
                at[end.number, end.half] = (k, is_end)
    strands, used = [], set()

    def walk(k: int, backwards: bool) -> tuple[list[np.ndarray], End, End, bool]:
        """Goes on through crossings until an end, or round to the first arc."""
        parts, first = [], k
        start = arcs[k].end if backwards else arcs[k].start
        while True:
            used.add(k)
            parts.append(arcs[k].points[::-1] if backwards else arcs[k].points)
            end = arcs[k].start if backwards else arcs[k].end
            following = at.get((end.number, end.half ^ 1)) if end.kind == "crossing" else None
            if following is None:
                return parts, start, end, False
            k, backwards = following
            if k == first:
                return parts, start, end, True
            if k in used:
                return parts, start, end, False

    def dead(end: End) -> bool:
        return end.kind != "crossing" or (end.number, end.half ^ 1) not in at

    for k, arc in enumerate(arcs):
        if arc.closed:
            used.add(k)
            strands.append(arc)
    for round_ in (0, 1):  # First from true ends, then what is left: cycles through crossings.
        for k, arc in enumerate(arcs):
            if k in used or (round_ == 0 and not dead(arc.start) and not dead(arc.end)):
                continue
            parts, start, end, cycle = walk(k, backwards=round_ == 0 and not dead(arc.start))
            points = _joined(parts, period)
            strands.append(Arc(points[:-1], CLOSED, CLOSED) if cycle else Arc(points, start, end))
    return sorted(strands, key=lambda strand: -_length(strand.points))


def _length(points: np.ndarray) -> float:
    return float(np.sum(np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))))


def distance_to_arcs(
    points: np.ndarray, arcs: list[Arc], tangents: list[np.ndarray], period: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns each point's distance from the nearest arc, and the length of the segment there.

    Between two traced points the arc is the cubic that has their tangents, which errs by less than 1e-4 of the
    segment for the turns that the tracer allows.
    """
    if not arcs or len(points) == 0:
        return np.full(len(points), np.inf), np.ones(len(points))
    a, b, ta, tb = (
        np.concatenate(part)
        for part in zip(*(_segments(arc, t, period) for arc, t in zip(arcs, tangents, strict=True)), strict=True)
    )
    turn = np.where(np.isfinite(period), period, 0.0)
    shift = np.where(turn > 0, period, 1.0)

    def folded(x: np.ndarray) -> np.ndarray:
        inside = np.minimum(x - np.floor(x / shift) * shift, np.nextafter(shift, 0))
        return np.where(turn > 0, inside, x)

    chord = b - a
    size = np.sqrt(np.sum(chord**2, axis=1))
    # Long segments stand beside very short ones: markers along them let the tree compare like with like.
    marks = np.maximum(1, np.ceil(size / _MARKER)).astype(int)
    owner = np.repeat(np.arange(len(a)), marks)
    share = (np.arange(len(owner)) - np.repeat(np.cumsum(marks) - marks, marks) + 0.5) / marks[owner]
    # KDTree glues every axis of finite box size; unglued ones get a size of zero.
    tree = KDTree(folded(a[owner] + share[:, None] * chord[owner]), boxsize=turn)
    count = min(_NEIGHBOURS, len(owner))
    nearest = owner[tree.query(folded(points), k=count)[1].reshape(len(points), count)]
    best, best_size = np.full(len(points), np.inf), np.ones(len(points))
    for column in nearest.T:
        p = short_way(points - a[column], period)
        c, n = chord[column], size[column]
        s = np.clip(np.sum(p * c, axis=1) / n**2, 0.0, 1.0)[:, None]
        curve = (s**3 - 2 * s**2 + s) * ta[column] * n[:, None] + (s**3 - s**2) * tb[column] * n[:, None]
        curve += (3 * s**2 - 2 * s**3) * c
        gap = np.sqrt(np.sum((p - curve) ** 2, axis=1))
        closer = gap < best
        best, best_size = np.where(closer, gap, best), np.where(closer, n, best_size)
    return best, best_size


def _segments(arc: Arc, tangents: np.ndarray, period: np.ndarray) -> tuple[np.ndarray, ...]:
    """Returns both ends of every segment and the unit tangents there, the chord's where there is none (a crossing)."""
    points = np.vstack([arc.points, arc.points[:1]]) if arc.closed else arc.points
    slopes = np.vstack([tangents, tangents[:1]]) if arc.closed else tangents
    a, b = points[:-1], points[1:]
    if arc.closed:  # Its last segment may end a whole turn away.
        b = np.vstack([b[:-1], a[-1] + short_way(b[-1] - a[-1], period)])
    chord = b - a
    chord = chord / np.sqrt(np.sum(chord**2, axis=1, keepdims=True))

    def oriented(t: np.ndarray) -> np.ndarray:
        along = np.sum(t * chord, axis=1, keepdims=True)
        return np.where(np.abs(along) > 0.5, t * np.sign(along), chord)

    return a, b, oriented(slopes[:-1]), oriented(slopes[1:])
