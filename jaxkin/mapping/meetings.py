"""Where two factors of the singularity vanish together: crossings of their curves, and self-motions."""

import itertools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.precision import TOLERANCES
from jaxkin.mapping import search
from jaxkin.mapping.assembly import Arc
from jaxkin.mapping.batch import over_points
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.section import Section, traced_factors
from jaxkin.mapping.tracing import Traced
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.newton import polish

#: A factor that is smaller than this along a whole curve of another vanishes on it.
_ZERO = 1e-9


class Meetings(NamedTuple):
    """What the curves of different factors have in common.

    Attributes:
        points: ``(n, m)`` where curves of two factors cross.
        shared: One entry a factor: True for each of its arcs on which an earlier factor vanishes too.
    """

    points: np.ndarray
    shared: list[np.ndarray]


def meetings(section: Section, traced: list[Traced]) -> Meetings:
    """Finds the crossings of curves of different factors, by changes of sign along the curves, polished on both."""
    shared = [np.zeros(len(part.arcs), bool) for part in traced]
    points = np.zeros((0, section.chart.dimension))
    for j, k in itertools.combinations(range(len(traced_factors(section.robot))), 2):
        for own, other, number in ((j, k, 0), (k, j, 1)):
            guesses = []
            for place, arc in enumerate(traced[own].arcs):
                values = over_points(_factors, section.chart, section.data, arc.points)[:, other]
                if np.max(np.abs(values)) < _ZERO:
                    shared[own][place] |= number == 1
                else:
                    guesses.append(_changes(section, arc, values))
            if guesses and sum(map(len, guesses)):
                points = np.concatenate([points, _polished(section, np.concatenate(guesses), (j, k))])
    points = search.glued(section, points)
    points = points[search.distinct(section, points)]
    return Meetings(points[search.without_twins(section, points)], shared)


def _factors(chart: Chart, data: SectionData, u: Array) -> Array:
    return chart.factors(data, u)


def _changes(section: Section, arc: Arc, values: np.ndarray) -> np.ndarray:
    """Returns points at which a factor changes its sign along an arc, by linear interpolation."""
    points = arc.points
    if arc.closed:
        points = np.vstack([points, points[-1] + short_way(points[:1] - points[-1], section.period)])
        values = np.append(values, values[0])
    at = np.flatnonzero(values[:-1] * values[1:] <= 0)
    share = values[at] / np.where(values[at] == values[at + 1], 1.0, values[at] - values[at + 1])
    return points[at] + share[:, None] * (points[at + 1] - points[at])


def _polished(section: Section, guesses: np.ndarray, pair: tuple[int, int]) -> np.ndarray:
    pairs = np.tile(np.eye(len(traced_factors(section.robot)))[list(pair)], (len(guesses), 1, 1))
    u, residual, margin = over_points(_both, section.chart, section.data, guesses, pairs)
    return u[(residual <= TOLERANCES.residual) & (margin >= -search.EDGE_SLACK)]


def _both(chart: Chart, data: SectionData, u: Array, picks: Array) -> tuple[Array, Array, Array]:
    def system(u: Array) -> Array:
        return jnp.concatenate([chart.section(data, u), picks @ chart.factors(data, u)])

    u = polish(system, u, steps=8)
    return u, jnp.max(jnp.abs(system(u))), jnp.min(chart.margins(data, u))
