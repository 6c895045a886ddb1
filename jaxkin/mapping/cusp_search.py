"""Roots of the cusp equations of a section: along its traced curves, and from starts of their own."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.precision import TOLERANCES
from jaxkin.mapping import search
from jaxkin.mapping.assembly import Arc
from jaxkin.mapping.batch import over_points
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.section import Section
from jaxkin.mapping.tracing import Traced
from jaxkin.numerics import newton
from jaxkin.numerics.gluing import short_way

#: Least cosine between the kernels of neighbouring points of a curve.
_KERNEL_TURN = 0.8
#: Rates of det A along its kernel that are smaller than this along a whole arc are rounding.
_STILL = 1e-9


def _rates(chart: Chart, data: SectionData, u: Array) -> Array:
    """Returns the kernel and the rate of det A along it, both for a kernel of length one: ``(k, n_pose + 1)``."""
    kernel = chart.kernel(data, u)
    size = jnp.sqrt(jnp.sum(kernel * kernel))
    size = jnp.where(size > 0, size, 1.0)
    return jnp.append(kernel, chart.fold_rate(data, u)) / size


def roots_along_curves(section: Section, traced: Traced) -> tuple[np.ndarray, int, np.ndarray]:
    """Returns roots found where the rate changes sign, or comes near zero, along the arcs; and the changes' number.

    The kernel's sign is carried on from point to point: it may come back reversed on a closed arc. Third, a point of
    every arc along which the rate vanishes throughout: the joints stand still on it, it is a self-motion.
    """
    guesses, changes, still = [], 0, np.zeros((0, section.chart.dimension))
    if traced.arcs:
        lengths = [len(arc.points) for arc in traced.arcs]
        values = over_points(_rates, section.chart, section.data, np.concatenate([arc.points for arc in traced.arcs]))
        for arc, rows in zip(traced.arcs, np.split(values, np.cumsum(lengths)[:-1]), strict=True):
            if np.max(np.abs(rows[:, -1])) < _STILL:
                still = np.vstack([still, arc.points[len(arc.points) // 2]])
                continue
            crossed, near = _brackets(*_smooth(section, arc, rows))
            guesses += crossed + near
            changes += len(crossed)
    if not guesses:
        return np.zeros((0, section.chart.dimension)), 0, still
    pairs = np.array(guesses)
    middle = over_points(_bisect, section.chart, section.data, pairs)
    u, good = newton_roots(section, middle)
    size = np.max(np.abs(pairs[:, 1] - pairs[:, 0]), axis=1)
    here = np.max(np.abs(short_way(u - pairs[:, 0], section.period)), axis=1) < 3 * size + 1e-6
    return search.glued(section, u[good & here]), changes, still


def _smooth(section: Section, arc: Arc, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns points of an arc, without crossings, so close that the kernel turns little; closed arcs repeat the first.

    The kernel may turn faster than the curve, near a pose where A almost loses two ranks: its sign could not be
    carried on over a long step.
    """
    smooth = np.ones(len(arc.points), bool)
    smooth[[0, -1]] = [arc.start.kind != "crossing", arc.end.kind != "crossing"]
    points, rows = arc.points[smooth], rows[smooth]
    if arc.closed:
        last = points[-1] + short_way(points[0] - points[-1], section.period)
        points, rows = np.vstack([points, last]), np.vstack([rows, rows[:1]])
    for _ in range(12):
        wide = np.flatnonzero(np.abs(np.sum(rows[1:, :-1] * rows[:-1, :-1], axis=1)) < _KERNEL_TURN)
        if len(wide) == 0:
            break
        pairs = np.stack([points[wide], points[wide + 1]], axis=1)
        middle = search.midpoints(section, pairs)
        points = np.insert(points, wide + 1, middle, axis=0)
        rows = np.insert(rows, wide + 1, over_points(_rates, section.chart, section.data, middle), axis=0)
    return points, rows


def _brackets(points: np.ndarray, rows: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Returns pairs of points between which the rate changes sign, and pairs about its smallest values otherwise."""
    kernels, rates = rows[:, :-1], rows[:, -1]
    flips = np.where(np.sum(kernels[1:] * kernels[:-1], axis=1) < 0, -1.0, 1.0)
    rates = rates * np.cumprod(np.append(1.0, flips))
    change = rates[:-1] * rates[1:] <= 0
    crossed = [points[k : k + 2] for k in np.flatnonzero(change)]
    size = np.abs(rates)
    dips = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & ~change[:-1] & ~change[1:]
    return crossed, [points[[k, k + 2]] for k in np.flatnonzero(dips)]


def _bisect(chart: Chart, data: SectionData, pair: Array) -> Array:
    """Halves the way between two points of a curve until the rate's change of sign is near; else returns the middle."""
    a, b = pair
    across = (b - a) / jnp.sqrt(jnp.sum((b - a) ** 2))

    def rate(s: Array) -> tuple[Array, Array, Array]:
        u = search.onto_curve(chart, data, a + s * (b - a), across)
        return chart.fold_rate(data, u), chart.kernel(data, u), u

    def halve(k: Array, carry: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, start, reference, _ = carry
        s = jnp.where(k == 0, 0.0, 0.5 * (low + high))
        value, kernel, u = rate(s)
        sign = jnp.sign(value) * jnp.where(k == 0, 1.0, jnp.sign(jnp.dot(kernel, reference)))
        same = (k == 0) | (sign == start)
        return (
            jnp.where(same, s, low),
            jnp.where(same, high, s),
            jnp.where(k == 0, sign, start),
            jnp.where(k == 0, kernel, reference),
            u,
        )

    zero = jnp.zeros(())
    _, high, _, _, u = jax.lax.fori_loop(0, 14, halve, (zero, zero + 1, zero, jnp.zeros(chart.n_pose), a))
    # Without a change of sign the middle is the better guess.
    return jnp.where(high == 1.0, search.onto_curve(chart, data, 0.5 * (a + b), across), u)


def _newton(chart: Chart, data: SectionData, u: Array) -> tuple[Array, Array, Array]:
    """Applies Newton's method to the cusp equations; returns points, residuals, smallest margins."""
    u = newton.polish(partial(chart.cusp, data), u, steps=6, trust=0.1)
    return u, jnp.max(jnp.abs(chart.cusp(data, u))), jnp.min(chart.margins(data, u))


def newton_roots(section: Section, guesses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns where Newton's method arrives from guesses, and which of these are roots in the box."""
    u, residual, margin = over_points(_newton, section.chart, section.data, guesses)
    return u, (residual <= TOLERANCES.residual) & (margin >= -search.EDGE_SLACK)


def _descend(chart: Chart, data: SectionData, u: Array) -> Array:
    return newton.descend(partial(chart.cusp, data), u, 30)


def roots_from_starts(section: Section) -> np.ndarray:
    """Returns the distinct roots of the cusp equations found from starts of their own.

    Half of them are spread over the section, half over the curves; none comes from the tracer. Near a crossing
    Newton's method creeps up to it and leaves a crowd of points, which the caller must tell apart.
    """
    spread = search.starting_points(section, part=2)
    curves = search.seeds_on_curves(section, part=3)
    points = np.concatenate([spread, np.resize(curves, spread.shape) if len(curves) else spread])
    u, good = newton_roots(section, over_points(_descend, section.chart, section.data, points))
    u = search.glued(section, u[good])
    return u[search.distinct(section, u)]
