"""Images of singular curves in the plane of the two free joints, cut into arcs that are graphs over one direction.

Plane coordinates run from 0 to 1 over the section. Arcs are graphs over the direction (1, tilt): generic, so that
neither borders nor images that are vertical, nor points that lie exactly above each other, need a case of their own.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.mapping.batch import over_points
from jaxkin.mapping.chart import SQUARE, Chart, SectionData
from jaxkin.mapping.records import Crossings, Curve, SingularCurves
from jaxkin.mapping.search import twins
from jaxkin.mapping.section import Section, traced_factors
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.newton import polish
from jaxkin.numerics.small_linalg import pivoted_solve

#: Arcs are graphs over first + tilt * second plane coordinate.
TILT = 0.12360679774997896
#: Plane points closer than this are one: far above the rounding of a polished point, far below what is resolved.
ONE_POINT = 3e-9
#: So far, in shares of a segment, slopes are evaluated from an end where the curve has no slope of its own.
_INSET = 0.02
#: Points that are put between two traced ones.
_BETWEEN = (0.25, 0.5, 0.75)
#: A leg shorter than this share of its range may vanish nearby.
_SHORT = 0.2


def _along(chart: Chart, data: SectionData, a: Array, b: Array, s: Array) -> tuple[Array, Array, Array]:
    """Returns the point of the singular curve at the share s of a chord, its free values, and their rates by s."""
    chord = b - a
    size = jnp.sqrt(jnp.sum(chord * chord))
    across = chord / size
    guess = a + s * chord

    def system(u: Array) -> Array:
        return jnp.append(chart.singular(data, u), jnp.dot(across, u - guess))

    def free(u: Array) -> Array:
        return jnp.stack([chart.free_value(data, u, k) for k in range(len(chart.kinds))])

    u = polish(system, guess, steps=4, trust=0.1)
    move = pivoted_solve(jax.jacfwd(system)(u), jnp.zeros(len(u)).at[-1].set(size))
    return u, *jax.jvp(free, (u,), (move,))


class Spots(NamedTuple):
    """Points on chords of singular curves.

    Attributes:
        sheet: ``(n,)`` number of the factor whose curve it is.
        a: ``(n, m)`` where the chord begins.
        b: ``(n, m)`` where it ends.
    """

    sheet: np.ndarray
    a: np.ndarray
    b: np.ndarray

    def of(self, some: np.ndarray) -> "Spots":
        """Returns some of them, by number."""
        return Spots(self.sheet[some], self.a[some], self.b[some])


@dataclass(frozen=True)
class Plane:
    """The plane of the free joints, and the evaluation of singular curves in it.

    Attributes:
        section: The section.
        sheets: The section once for every factor that is traced by itself.
        low: ``(2,)`` lower ends of the free joints.
        width: ``(2,)`` their ranges.
        glued: ``(2,)`` True where a free joint runs over its whole period.
    """

    section: Section
    sheets: tuple[Section, ...]
    low: np.ndarray
    width: np.ndarray
    glued: np.ndarray

    @classmethod
    def over(cls, section: Section) -> "Plane":
        """Returns the plane of a section."""
        low, high = np.asarray(section.data.low), np.asarray(section.data.high)
        return cls(section, section.sheets(), low, high - low, np.asarray(section.data.whole, bool))

    @property
    def squares(self) -> np.ndarray:
        """``(2,)`` True where the pose gives the square of the joint."""
        return np.array([kind == SQUARE for kind in self.section.chart.kinds])

    def place(self, values: np.ndarray) -> np.ndarray:
        """Returns plane coordinates of free joint values, ``(n, 2)``."""
        return (values - self.low) / self.width

    def joints(self, plane: np.ndarray) -> np.ndarray:
        """Returns joint values of plane points, ``(n, n_joint)``."""
        joints = np.tile(np.asarray(self.section.data.fixed), (len(plane), 1))
        joints[:, list(self.section.grid.free)] = self.low + plane * self.width
        return joints

    def along(self, spots: Spots, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns points of the curves at shares of chords: unknowns, plane coordinates and their rates by the share.

        Where a leg vanishes its plane coordinate has a kink, and the rate is infinite or not a number.
        """
        u, values, rates = (np.empty((len(s), width)) for width in (spots.a.shape[1], 2, 2))
        for number, sheet in enumerate(self.sheets):
            own = np.flatnonzero(spots.sheet == number)
            if len(own):
                found = over_points(_along, sheet.chart, sheet.data, spots.a[own], spots.b[own], s[own])
                u[own], values[own], rates[own] = found
        root = np.sqrt(np.maximum(values, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            rates = np.where(self.squares, rates / (2 * root), rates) / self.width
        return u, self.place(np.where(self.squares, root, values)), rates


def tilted(plane: np.ndarray) -> np.ndarray:
    """Returns the coordinate over which arcs are graphs, of plane points ``(..., 2)``."""
    return plane[..., 0] + TILT * plane[..., 1]


@dataclass(frozen=True)
class Strand:
    """A singular curve as a broken line of points on it.

    Attributes:
        curve: Its number among the curves.
        sheet: Number of the factor that vanishes.
        u: ``(k, m)`` unknowns, running on over glued ends; a closed curve repeats its first point.
        plane: ``(k, 2)`` plane coordinates, running on as well.
        cut: ``(k,)`` True where the curve is cut into arcs.
        blunt: ``(k,)`` True where the curve or its image has no slope: at crossings and where a leg vanishes.
        closed: True where the last point is the first.
    """

    curve: int
    sheet: int
    u: np.ndarray
    plane: np.ndarray
    cut: np.ndarray
    blunt: np.ndarray
    closed: bool

    def spots(self) -> Spots:
        """Returns the chords."""
        return Spots(np.full(len(self.u) - 1, self.sheet), self.u[:-1], self.u[1:])

    def with_points(self, at: np.ndarray, u: np.ndarray, plane: np.ndarray, cut: bool, blunt: bool) -> "Strand":
        """Returns the strand with further points, each put after the point ``at``."""

        def put(old: np.ndarray, new: object) -> np.ndarray:
            return np.insert(old, at + 1, new, axis=0)  # type: ignore[call-overload]

        return Strand(
            self.curve, self.sheet, put(self.u, u), put(self.plane, plane), put(self.cut, cut), put(self.blunt, blunt),
            self.closed,
        )  # fmt: skip


def strands_of(plane: Plane, curves: SingularCurves) -> list[Strand]:
    """Returns the curves as strands, with their crossings as cuts; isolated points and virtual curves are left out."""
    names = traced_factors(plane.section.robot)
    strands = []
    for number, curve in enumerate(curves.curves):
        if len(curve) < 2 or curve.virtual:
            continue
        sheet = names.index(curve.label) if names else 0
        u = _lifted(plane.section, _unknowns(plane.section, curve.joints, curve.poses), curve)
        turns = np.where(plane.glued, 1.0, np.inf)
        at = _running(plane.place(_free(plane, curve.joints)), turns)
        if curve.closed:
            at = np.vstack([at, at[-1] + short_way(at[0] - at[-1], turns)])
        nothing = np.zeros(len(u), bool)
        strand = Strand(number, sheet, u, at, nothing, nothing.copy(), curve.closed)
        if not curve.closed:
            strand.cut[[0, -1]] = True
        if plane.glued.any():
            # From here on a plane point is in the turn that its unknowns give.
            _, here, _ = plane.along(strand.spots().of(np.array([0])), np.array([0.5]))
            strand = replace(strand, plane=at + np.round(here - 0.5 * (at[:1] + at[1:2])))
        strands.append(_with_crossings(plane, strand, curves.crossings))
    return strands


def _free(plane: Plane, joints: np.ndarray) -> np.ndarray:
    return joints[:, list(plane.section.grid.free)]


def _unknowns(section: Section, joints: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Returns the chart's unknowns of configurations."""
    free = [section.grid.free[k] for k in section.chart.unknown]
    units = np.asarray(section.data.free_unit)[list(section.chart.unknown)]
    return np.hstack([poses / np.asarray(section.data.pose_unit), joints[:, free] / units])


def _lifted(section: Section, u: np.ndarray, curve: Curve) -> np.ndarray:
    """Returns points of a curve that run on over glued ends, and stay with one of two triples of angles."""
    if section.robot.twin is not None:
        others = twins(section, u)
        near, far = (np.sum(short_way(v[1:] - u[:-1], section.period) ** 2, axis=1) for v in (u, others))
        swapped = np.concatenate([[False], np.cumsum(far < near) % 2 == 1])
        u = np.where(swapped[:, None], others, u)
    u = _running(u, section.period)
    if not curve.closed:
        return u
    last = u[-1] + short_way(u[:1] - u[-1], section.period)
    if section.robot.twin is not None:
        other = u[-1] + short_way(twins(section, u[:1]) - u[-1], section.period)
        last = other if np.sum((other - u[-1]) ** 2) < np.sum((last - u[-1]) ** 2) else last
    return np.vstack([u, last])


def _running(points: np.ndarray, period: np.ndarray) -> np.ndarray:
    steps = short_way(np.diff(points, axis=0), period)
    return np.vstack([points[:1], points[:1] + np.cumsum(steps, axis=0)]) if np.any(np.isfinite(period)) else points


def _with_crossings(plane: Plane, strand: Strand, crossings: Crossings) -> Strand:
    """Marks the points of a strand that are crossings, and inserts those on its chords."""
    section = plane.section
    if len(crossings) == 0:
        return strand
    points = _unknowns(section, crossings.joints, crossings.poses)
    images = plane.place(_free(plane, crossings.joints))
    copies = [points] if section.robot.twin is None else [points, twins(section, points)]
    for copy in copies:
        for point, image in zip(copy, images, strict=True):
            gaps = np.max(np.abs(short_way(strand.u - point, section.period)), axis=1)
            near = np.flatnonzero(gaps < 1e-6)
            if len(near):
                strand.cut[near], strand.blunt[near] = True, True
            else:
                strand = _with_crossing(plane, strand, point, image)
    return strand


def _with_crossing(plane: Plane, strand: Strand, point: np.ndarray, image: np.ndarray) -> Strand:
    """Puts a crossing into a strand if it lies on one of its chords' arcs (curves of two factors cross there)."""
    chord = np.diff(strand.u, axis=0)
    size = np.sum(chord**2, axis=1)
    toward = short_way(point - strand.u[:-1], plane.section.period)
    share = np.clip(np.sum(toward * chord, axis=1) / size, 0.0, 1.0)
    gap = np.sqrt(np.sum((toward - share[:, None] * chord) ** 2, axis=1) / size)
    at = int(np.argmin(gap))
    if gap[at] > 0.2:
        return strand
    u = plane.along(strand.spots().of(np.array([at])), share[at : at + 1])[0][0]
    if np.max(np.abs(short_way(u - point, plane.section.period))) > 1e-6:
        return strand
    turns = np.where(plane.glued, 1.0, np.inf)
    here = strand.plane[at] + short_way(image - strand.plane[at], turns)
    return strand.with_points(np.array([at]), u[None], here[None], cut=True, blunt=True)


def refined(plane: Plane, strands: list[Strand]) -> list[Strand]:
    """Returns the strands with points between theirs, all on the curves."""
    if not strands:
        return []
    spots = _joined(strands)
    count, k = len(spots.sheet), len(_BETWEEN)
    every = spots.of(np.repeat(np.arange(count), k))
    u, at, _ = plane.along(every, np.tile(_BETWEEN, count))
    bounds = np.cumsum([0] + [len(strand.u) - 1 for strand in strands])
    dense = []
    for strand, first, last in zip(strands, bounds[:-1], bounds[1:], strict=True):
        here = slice(k * first, k * last)
        dense.append(strand.with_points(np.repeat(np.arange(last - first), k), u[here], at[here], False, False))
    return dense


def _joined(strands: list[Strand]) -> Spots:
    return Spots(*(np.concatenate(part) for part in zip(*(strand.spots() for strand in strands), strict=True)))


def cut_up(plane: Plane, strands: list[Strand]) -> list[Strand]:
    """Returns the strands with cuts where a leg vanishes, on glued borders, and where they turn back."""
    for j in np.flatnonzero(plane.squares & (plane.low <= 0.0)):
        strands = _cut_where(plane, strands, partial(_leg_vanishes, j=int(j)), zero=int(j))
    for j in np.flatnonzero(plane.glued):
        strands = _cut_where(plane, strands, partial(_passes_seam, j=int(j)), seam=int(j))
    return _cut_where(plane, strands, _turns_back)


class _Ends(NamedTuple):
    """Both ends of all chords: shares at which they are taken, plane points and rates there."""

    shares: tuple[np.ndarray, np.ndarray]
    places: tuple[np.ndarray, np.ndarray]
    rates: tuple[np.ndarray, np.ndarray]


def _leg_vanishes(place: np.ndarray, rate: np.ndarray, _: np.ndarray, j: int) -> np.ndarray:
    """Half the rate of the leg's square; far from where it vanishes it is not asked for."""
    with np.errstate(invalid="ignore"):  # Where it vanishes, exactly, the rate is infinite: the search ends there.
        return np.where(place[:, j] < _SHORT, place[:, j] * rate[:, j], np.nan)


def _passes_seam(place: np.ndarray, _: np.ndarray, level: np.ndarray, j: int) -> np.ndarray:
    return place[:, j] - level[:, j]


def _turns_back(_: np.ndarray, rate: np.ndarray, __: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return tilted(rate)


def _cut_where(plane: Plane, strands: list[Strand], measure, zero: int = -1, seam: int = -1) -> list[Strand]:  # type: ignore[no-untyped-def]
    """Cuts strands where a measure of place and rate changes its sign: solved for along the chord."""
    if not strands:
        return []
    spots, ends = _joined(strands), _ends(plane, strands)
    levels = np.zeros_like(ends.places[0])
    if seam >= 0:
        levels[:, seam] = np.round(0.5 * (ends.places[0] + ends.places[1])[:, seam])
    first, last = (measure(place, rate, levels) for place, rate in zip(ends.places, ends.rates, strict=True))
    with np.errstate(invalid="ignore"):
        if zero >= 0:
            found = np.flatnonzero((first < 0) & (last > 0))
        elif seam >= 0:
            found = np.flatnonzero((first < 0) != (last < 0))
        else:
            found = np.flatnonzero(first * last < 0)
    some = spots.of(found)

    def function(s: np.ndarray, own: np.ndarray) -> np.ndarray:
        _, place, rate = plane.along(some.of(own), s)
        return measure(place, rate, levels[found[own]])

    low, high = (share[found] for share in ends.shares)
    s = bracketed(function, low, high, first[found], last[found])
    u, place, _ = plane.along(some, s)
    keep = np.ones(len(found), bool)
    if zero >= 0:
        keep = place[:, zero] < 1e-6  # A minimum otherwise.
        place[keep, zero] = 0.0
    if seam >= 0:
        place[:, seam] = levels[found, seam]
    owner = np.searchsorted(np.cumsum([len(strand.u) - 1 for strand in strands]), found, side="right")
    starts = np.cumsum([0] + [len(strand.u) - 1 for strand in strands])
    cut = []
    for number, strand in enumerate(strands):
        own = np.flatnonzero(keep & (owner == number))
        at = found[own] - starts[number]
        cut.append(strand.with_points(at, u[own], place[own], cut=True, blunt=zero >= 0))
    return cut


def _ends(plane: Plane, strands: list[Strand]) -> _Ends:
    """Evaluates the chords at both ends; where an end has no slope, a little inside."""
    spots = _joined(strands)
    blunt = [np.concatenate(part) for part in zip(*((s.blunt[:-1], s.blunt[1:]) for s in strands), strict=True)]
    shares = np.where(blunt[0], _INSET, 0.0), np.where(blunt[1], 1.0 - _INSET, 1.0)
    (first, first_rate), (last, last_rate) = (plane.along(spots, share)[1:] for share in shares)
    return _Ends(shares, (first, last), (first_rate, last_rate))


def bracketed(function, low, high, at_low, at_high, steps: int = 60) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Returns zeros between points of opposite sign, by false position (Illinois) with bisections, ``(n,)``.

    Args:
        function: ``(arguments, which of the n) -> values``.
        low: ``(n,)`` lower ends.
        high: ``(n,)`` upper ends.
        at_low: ``(n,)`` values there.
        at_high: ``(n,)`` values there.
        steps: Most steps.
    """
    low, high, f, g = (np.array(part, float) for part in (low, high, at_low, at_high))
    best = np.where(np.abs(f) < np.abs(g), low, high)
    open_, side = np.abs(high - low) > 4e-16, np.zeros(len(low))
    for k in range(steps):
        own = np.flatnonzero(open_)
        if len(own) == 0:
            break
        a, b, fa, fb = low[own], high[own], f[own], g[own]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = b - fb * (b - a) / (fb - fa)
        inside = (t > a) & (t < b) & (k % 4 != 3)
        t = np.where(inside, t, 0.5 * (a + b))
        value = function(t, own)
        still = np.abs(t - best[own]) <= 1e-16
        best[own] = t
        left = np.sign(value) == np.sign(fa)
        repeated = side[own] == np.where(left, -1.0, 1.0)
        low[own], f[own] = np.where(left, t, a), np.where(left, value, np.where(repeated, 0.5 * fa, fa))
        high[own], g[own] = np.where(left, b, t), np.where(left, np.where(repeated, 0.5 * fb, fb), value)
        side[own] = np.where(left, -1.0, 1.0)
        done = (value == 0) | (high[own] - low[own] <= 4e-16) | ~np.isfinite(value) | still
        open_[own] = ~done
    return best
