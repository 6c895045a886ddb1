"""From traced cusp curves to curves inside the box, with their ends and every critical point of every joint on them.

Between two traced points a joint's rate along the curve is the cubic that has its values and slopes at both; where that
comes near zero Newton's method looks for a critical point. With all of them inserted every joint is monotone between
neighbouring points, so that what leaves the box and returns within one step is seen as well.
"""

from typing import NamedTuple

import numpy as np

from jaxkin.mapping import _cusp_curve_equations as equations
from jaxkin.mapping import search
from jaxkin.mapping._cusp_curve_continuation import LEFT, Chain
from jaxkin.mapping._cusp_curve_equations import Sheet
from jaxkin.mapping._cusp_curve_seeds import FOUND
from jaxkin.mapping.batch import over_points
from jaxkin.mapping.chart import SQUARE
from jaxkin.numerics.gluing import short_way

#: Samples of a segment at which its cubic is looked at, and how near zero it counts, of its largest value.
_LOOKS, _NEARLY = 33, 0.15
#: Critical points closer than this are one; where all rates are below this the tangent is the kernel's.
_ONE, _STILL = 1e-7, 1e-8
#: Where a border is sought between a point inside and one outside.
_SHARES = np.array([0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98])
#: Squared lengths, dimensionless, that are zero.
_ZERO_LENGTH = 1e-12
#: Rates of the joints against their slopes below which a curve turns back where it is cut.
_TURNED = 0.02
#: Values of another factor beside a crossing from which it is extrapolated.
_BESIDE = 1e-3
_PLAIN, _CROSSING, _BORDER = 0, 1, 2


class Cut(NamedTuple):
    """A cusp curve inside the box.

    Attributes:
        points: ``(k, m)`` continuous; a closed one does not repeat its first point.
        tangents: ``(k, m)`` unit tangents in the order of the points; at an end of the curve those nearby.
        critical: ``(k, 3)`` which free joints are critical there.
        closed: True where the last point is followed by the first.
        ends: What it ends on, in words; two empty texts where closed.
    """

    points: np.ndarray
    tangents: np.ndarray
    critical: np.ndarray
    closed: bool
    ends: tuple[str, str]


class _Row(NamedTuple):
    """Points of a chain in order, each with its marks."""

    points: np.ndarray
    tangents: np.ndarray
    critical: np.ndarray
    kind: np.ndarray
    number: np.ndarray


def cuts_of(sheet: Sheet, chains: list[Chain]) -> list[Cut]:
    """Returns the curves inside the box."""
    if not chains:
        return []
    cuts = []
    for chain, row in zip(chains, _marked(sheet, chains), strict=True):
        cuts += _split(sheet, chain, row)
    return cuts


class _Segments(NamedTuple):
    """All segments of all chains: ends, tangents, lengths, rates of the joints and of these, the chain and position."""

    a: np.ndarray
    b: np.ndarray
    ta: np.ndarray
    tb: np.ndarray
    rates: tuple[np.ndarray, ...]
    owner: np.ndarray
    place: np.ndarray

    @property
    def length(self) -> np.ndarray:
        return np.sqrt(np.sum((self.b - self.a) ** 2, axis=1))


def _along(points: np.ndarray, closed: bool) -> np.ndarray:
    """Returns the direction of travel at every point."""
    if len(points) == 1:
        return np.ones_like(points)
    steps = np.diff(points, axis=0)
    return np.vstack([steps, steps[-1:]])


def _segments(sheet: Sheet, chains: list[Chain]) -> tuple[_Segments, list[np.ndarray]]:
    whole = []
    for chain in chains:
        points = chain.points
        if chain.closed:
            points = np.vstack([points, points[-1] + short_way(points[0] - points[-1], sheet.section.period)])
        whole.append(points)
    along = np.concatenate([_along(points, False) for points in whole])
    t, rate, bend = over_points(equations.course, sheet.chart, sheet.data, np.concatenate(whole), along)
    owner = np.repeat(np.arange(len(whole)), [len(points) for points in whole])
    place = np.concatenate([np.arange(len(points)) for points in whole])
    points = np.concatenate(whole)
    k = np.flatnonzero(owner[1:] == owner[:-1])
    rates = (rate[k], rate[k + 1], bend[k], bend[k + 1])
    return _Segments(points[k], points[k + 1], t[k], t[k + 1], rates, owner[k], place[k]), np.split(
        t, np.flatnonzero(np.diff(owner)) + 1
    )


def _cubic(start: np.ndarray, end: np.ndarray, slope: np.ndarray, end_slope: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Returns the cubic with given values and slopes at 0 and 1."""
    return (
        (2 * s**3 - 3 * s**2 + 1) * start
        + (s**3 - 2 * s**2 + s) * slope
        + (3 * s**2 - 2 * s**3) * end
        + (s**3 - s**2) * end_slope
    )


def _guesses(segments: _Segments) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns where a joint's rate may vanish: segment, axis, share of the segment."""
    h = segments.length[:, None, None]
    ra, rb, sa, sb = (part[:, :, None] for part in segments.rates)
    s = np.linspace(-0.03, 1.03, _LOOKS)
    value = _cubic(ra, rb, h * sa, h * sb, s)
    size = np.abs(value)
    change = value[..., 1:] * value[..., :-1] <= 0
    small = np.maximum(np.max(size, axis=2, keepdims=True) * _NEARLY, 0)
    dip = (size[..., 1:-1] <= size[..., 2:]) & (size[..., 1:-1] <= size[..., :-2]) & (size[..., 1:-1] < small)
    one, two = np.nonzero(change), np.nonzero(dip)
    share = np.concatenate([0.5 * (s[one[2]] + s[one[2] + 1]), s[two[2] + 1]])
    return np.concatenate([one[0], two[0]]), np.concatenate([one[1], two[1]]), share


def _at(segments: _Segments, which: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns points and unit tangents of the cubics of segments."""
    h, s = segments.length[which][:, None], share[:, None]
    a, b, ta, tb = (part[which] for part in segments[:4])
    t = (1 - s) * ta + s * tb
    return _cubic(a, b, h * ta, h * tb, s), t / np.sqrt(np.sum(t * t, axis=1, keepdims=True))


class _Marks(NamedTuple):
    """Points to insert: segment, share of it, the point, its tangent, critical axes, kind and number."""

    segment: np.ndarray
    share: np.ndarray
    points: np.ndarray
    tangents: np.ndarray
    critical: np.ndarray
    kind: np.ndarray
    number: np.ndarray


def _placed(segments: _Segments, which: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the share of the segment at which points lie, and which of them lie on it."""
    chord = segments.b[which] - segments.a[which]
    square = np.sum(chord**2, axis=1)
    offset = points - segments.a[which]
    share = np.sum(offset * chord, axis=1) / square
    across = np.sqrt(np.sum((offset - share[:, None] * chord) ** 2, axis=1))
    slack = 1e-9 / np.sqrt(square)
    return share, (share >= -slack) & (share <= 1 + slack) & (across <= 0.15 * np.sqrt(square) + 1e-9)


def _critical_marks(sheet: Sheet, segments: _Segments) -> _Marks:
    which, axis, share = _guesses(segments)
    u, t = _at(segments, which, share)
    chart, data = sheet.chart, sheet.data
    u, t, residual = over_points(equations.polish_critical, chart, data, u, t, np.eye(3)[axis])
    share, on = _placed(segments, which, u)
    good = (residual <= FOUND) & on
    which, axis, share, u, t = which[good], axis[good], share[good], u[good], t[good]
    turned = over_points(equations.measure, chart, data, u, t, np.eye(3)[axis])[0]
    critical = np.where((turned < _STILL)[:, None], True, np.eye(3, dtype=bool)[axis])
    # One point found from two guesses, or a swallowtail found for each joint, stands once.
    order = np.lexsort((share, which))
    kept: list[int] = []
    for k in order:
        twins = [
            j for j in kept[-12:] if np.max(np.abs(u[j] - u[k])) < _ONE and np.array_equal(critical[j], critical[k])
        ]
        if not twins:
            kept.append(int(k))
    zeros = np.zeros(len(kept), int)
    return _Marks(which[kept], share[kept], u[kept], t[kept], critical[kept], zeros, zeros)


def _crossing_marks(sheet: Sheet, segments: _Segments) -> list[_Marks]:
    """Returns where another factor vanishes on the curves."""
    values = [over_points(equations.other_factors, sheet.chart, sheet.data, p) for p in (segments.a, segments.b)]
    found = []
    for number in range(values[0].shape[1]):
        a, b = values[0][:, number], values[1][:, number]
        which = np.flatnonzero(a * b <= 0)
        if len(which) == 0:
            continue
        u, t = _at(segments, which, a[which] / (a[which] - b[which]))
        pick = np.tile(np.eye(values[0].shape[1])[number], (len(which), 1))
        u, good = _crossing_points(sheet, segments, which, u, pick)
        share, on = _placed(segments, which, u)
        good &= on
        count = int(np.sum(good))
        found.append(
            _Marks(
                which[good],
                share[good],
                u[good],
                t[good],
                np.zeros((count, 3), bool),
                np.full(count, _CROSSING),
                np.full(count, number),
            )
        )
    return found


def _crossing_points(
    sheet: Sheet, segments: _Segments, which: np.ndarray, guess: np.ndarray, pick: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns where another factor vanishes on segments, and which of these points are good.

    Where legs vanish too A loses two ranks, and the equations of the point are singular: it is extrapolated then, to
    the fourth order, from pairs of points of the curve on both sides.
    """
    u, residual = over_points(equations.at_crossing, sheet.chart, sheet.data, guess, pick)
    good = residual <= FOUND
    good &= _placed(segments, which, u)[1]
    middle, fine = [], np.ones(len(guess), bool)
    for step in (_BESIDE, 2 * _BESIDE):
        pair = []
        for value in (step, -step):
            at = np.full(len(guess), value)
            side, miss = over_points(equations.beside_crossing, sheet.chart, sheet.data, guess, pick, at)
            fine &= miss <= FOUND
            pair.append(side)
        middle.append(0.5 * (pair[0] + pair[1]))
    rough = (4 * middle[0] - middle[1]) / 3
    return np.where(good[:, None], u, rough), good | fine


def _marked(sheet: Sheet, chains: list[Chain]) -> list[_Row]:
    """Returns the points of every chain with critical points and crossings among them; closed ones repeat the first."""
    segments, tangents = _segments(sheet, chains)
    crossing = _crossing_marks(sheet, segments)
    parts = [_critical_marks(sheet, segments), *crossing]
    marks = _Marks(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    # At a crossing the joints stand still by themselves: the curve is cut there anyway.
    cut = marks.points[marks.kind == _CROSSING]
    beside = np.array([np.any(np.max(np.abs(cut - p), axis=1) < 1e-4) for p in marks.points], bool)
    marks = _Marks(*(column[(marks.kind == _CROSSING) | ~beside] for column in marks))
    rows = []
    for owner, t in enumerate(tangents):
        own = np.flatnonzero(segments.owner == owner)
        points = np.vstack([segments.a[own], segments.b[own[-1:]]])
        mine = np.flatnonzero(segments.owner[marks.segment] == owner)
        position = segments.place[marks.segment[mine]] + np.clip(marks.share[mine], 0.0, 1.0)
        order = np.argsort(np.concatenate([np.arange(len(points)), position]), kind="stable")
        plain = np.zeros(len(points), int)
        row = _Row(
            np.concatenate([points, marks.points[mine]])[order],
            np.concatenate([t, _oriented(marks.tangents[mine], segments.ta[marks.segment[mine]])])[order],
            np.concatenate([np.zeros((len(points), 3), bool), marks.critical[mine]])[order],
            np.concatenate([plain, marks.kind[mine]])[order],
            np.concatenate([plain, marks.number[mine]])[order],
        )
        rows.append(_without_doubles(row))
    return rows


def _oriented(t: np.ndarray, like: np.ndarray) -> np.ndarray:
    sign = np.sign(np.sum(t * like, axis=1, keepdims=True))
    return t * np.where(sign == 0, 1.0, sign)


def _without_doubles(row: _Row) -> _Row:
    """Drops traced points that a marked one stands for; the first and last point stay."""
    marked = np.any(row.critical, axis=1) | (row.kind != _PLAIN)
    gap = np.max(np.abs(np.diff(row.points, axis=0)), axis=1)
    close = gap < 1e-9
    drop = np.zeros(len(marked), bool)
    drop[1:] |= close & ~marked[1:] & marked[:-1]
    drop[:-1] |= close & ~marked[:-1] & marked[1:]
    critical, kind, number = row.critical.copy(), row.kind.copy(), row.number.copy()
    for end, inner in ((0, 1), (len(marked) - 1, len(marked) - 2)):
        if drop[end]:  # The mark moves onto the end.
            drop[end], drop[inner] = False, True
            critical[end], kind[end], number[end] = critical[inner], kind[inner], number[inner]
    return _Row(*(column[~drop] for column in (row.points, row.tangents, critical, kind, number)))


def _split(sheet: Sheet, chain: Chain, row: _Row) -> list[Cut]:
    """Cuts a chain at the borders and at crossings."""
    margins = over_points(equations.margins, sheet.chart, sheet.data, row.points)
    inside = np.min(margins, axis=1) >= -search.EDGE_SLACK
    stops = row.kind == _CROSSING
    if chain.closed and inside.all() and not stops.any():
        critical = row.critical[:-1].copy()
        critical[0] |= row.critical[-1]  # The last point repeats the first.
        return [Cut(row.points[:-1], row.tangents[:-1], critical, True, ("", ""))]
    if chain.closed:
        row, inside, margins = _rotated(sheet, row, inside, margins, int(np.flatnonzero(~inside | stops)[0]))
        stops = row.kind == _CROSSING
    cuts, run = [], list[int]()
    borders = _borders(sheet, row, inside, margins)
    for k in range(len(inside)):
        if inside[k]:
            run.append(k)
        if run and (not inside[k] or k + 1 == len(inside) or (stops[k] and len(run) > 1)):
            cuts.append(_cut(sheet, chain, row, run, borders))
            run = [k] if inside[k] and stops[k] else []
    return [cut for cut in cuts if len(cut.points) > 1]


def _rotated(
    sheet: Sheet, row: _Row, inside: np.ndarray, margins: np.ndarray, first: int
) -> tuple[_Row, np.ndarray, np.ndarray]:
    """Begins a closed row, whose last point repeats the first, at another point."""
    turn = row.points[-1] - row.points[0]
    order = np.concatenate([np.arange(first, len(inside) - 1), np.arange(first + 1)])
    shift = np.where(np.arange(len(order)) >= len(inside) - 1 - first, 1.0, 0.0)[:, None] * turn
    rotated = _Row(row.points[order] + shift, *(column[order] for column in row[1:]))
    return rotated, inside[order], margins[order]


def _borders(
    sheet: Sheet, row: _Row, inside: np.ndarray, margins: np.ndarray
) -> dict[tuple[int, int], tuple[np.ndarray, int]]:
    """Returns the border point, and its number, between neighbours of which one is inside, by (inside, outside)."""
    steps = [(k, k + 1) for k in np.flatnonzero(inside[:-1] & ~inside[1:])]
    steps += [(k + 1, k) for k in np.flatnonzero(~inside[:-1] & inside[1:])]
    jobs = [
        (k, j, edge, s)
        for k, j in steps
        for edge in np.flatnonzero(margins[j] < 0)
        for s in _shares(margins, int(k), int(j), int(edge))
    ]
    if not jobs:
        return {}
    k, j, edge, share = (np.array(column) for column in zip(*jobs, strict=True))
    a, b = row.points[k], row.points[j]
    guess = a + share[:, None] * (b - a)
    u, residual, margin = over_points(equations.on_border, sheet.chart, sheet.data, guess, edge)
    chord = b - a
    size = np.sqrt(np.sum(chord**2, axis=1))
    along = np.sum((u - a) * chord, axis=1) / size**2
    gap = np.sqrt(np.sum((u - a - along[:, None] * chord) ** 2, axis=1))
    slack = 1e-7 / size
    on = (along >= -slack) & (along <= 1 + slack) & (gap <= 0.2 * size + 1e-7)
    good = (residual <= FOUND) & (margin >= -search.EDGE_SLACK) & on
    found: dict[tuple[int, int], tuple[np.ndarray, int]] = {}
    for n in np.flatnonzero(good)[np.argsort(along[good])[::-1]]:
        found[int(k[n]), int(j[n])] = (u[n], int(edge[n]))
    return found


def _shares(margins: np.ndarray, k: int, j: int, edge: int) -> np.ndarray:
    linear = np.clip(margins[k, edge] / (margins[k, edge] - margins[j, edge]), 0.0, 1.0)
    return np.append(_SHARES, linear)


def _cut(
    sheet: Sheet, chain: Chain, row: _Row, run: list[int], borders: dict[tuple[int, int], tuple[np.ndarray, int]]
) -> Cut:
    """Makes a curve of neighbouring points inside the box."""
    points, ends = [row.points[run]], []
    tangents, critical = [row.tangents[run]], [row.critical[run].copy()]
    for end, beyond in ((run[0], run[0] - 1), (run[-1], run[-1] + 1)):
        border = borders.get((end, beyond))
        if border is None:
            ends.append(_end_name(sheet, chain, row, end))
            critical[0][0 if end == run[0] else -1] = False
            continue
        ends.append(sheet.section.border_name(border[1]))
        at = 0 if beyond < end else len(points)
        for parts, new in ((points, border[0]), (tangents, row.tangents[end]), (critical, np.zeros(3, bool))):
            parts.insert(at, new[None])
    joined, t, marks = (np.concatenate(parts) for parts in (points, tangents, critical))
    apart = np.concatenate([[True], np.max(np.abs(np.diff(joined, axis=0)), axis=1) > 1e-10])
    return Cut(joined[apart], t[apart], marks[apart], False, (ends[0], ends[1]))


def _end_name(sheet: Sheet, chain: Chain, row: _Row, k: int) -> str:
    """Says in words what a curve ends on inside the box."""
    point = row.points[k : k + 1]
    values = over_points(equations.joint_values, sheet.chart, sheet.data, point)[0]
    for axis, kind in enumerate(sheet.chart.kinds):
        if kind == SQUARE and values[axis] < _ZERO_LENGTH:
            joint = sheet.section.robot.joint_axes[sheet.section.grid.free[axis]].name
            return f"leg of zero length ({joint} = 0)"
    if row.kind[k] == _CROSSING:
        other = sheet.other_names[int(row.number[k])]
        turned = over_points(equations.measure, sheet.chart, sheet.data, point, row.tangents[k : k + 1], np.eye(3)[:1])[
            0
        ]
        # Where all joints turn back there, two poses of each point meet, and beyond they are complex.
        return f"reality lost ({other} = 0)" if turned[0] < _TURNED else f"crossing ({other} = 0)"
    flat = over_points(equations.gradient_share, sheet.chart, sheet.data, point)[0]
    return "crossing (the slope of det A vanishes)" if flat < 1e-3 and LEFT not in chain.ends else "lost"
