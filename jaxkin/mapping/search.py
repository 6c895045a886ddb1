"""Points on a section's singular curves, found from many starts: seeds, borders, crossings.

Everything here is a batch of small Newton problems in the unknowns of ``chart``; nothing proves that all was found,
so that the callers hold the findings against each other.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.precision import TOLERANCES
from jaxkin.mapping.batch import BLOCK, over_points
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.section import PARTS, Section
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.newton import descend, polish
from jaxkin.numerics.small_linalg import pivoted_solve

#: Points closer than this (dimensionless) are one.
SAME = 1e-6
#: A point of the section counts as inside the box with this dimensionless slack.
EDGE_SLACK = 1e-11


def _project(chart: Chart, data: SectionData, u: Array) -> tuple[Array, Array, Array]:
    """Moves points onto the singular curves inside the box; returns them, their residuals and their margins."""

    def objective(u: Array) -> Array:
        return jnp.concatenate([chart.singular(data, u), chart.violations(data, u)])

    u = polish(partial(chart.singular, data), descend(objective, u, 24))
    return u, jnp.max(jnp.abs(chart.singular(data, u))), jnp.min(chart.margins(data, u))


def _edge_points(chart: Chart, data: SectionData, u: Array, edge: Array) -> tuple[Array, Array, Array]:
    """Moves points onto one border each; returns them, residuals and the smallest margin."""

    def system(u: Array) -> Array:
        return jnp.append(chart.singular(data, u), chart.margins(data, u)[edge])

    u = polish(system, descend(system, u, 24))
    return u, jnp.max(jnp.abs(system(u))), jnp.min(chart.margins(data, u))


def _critical_points(chart: Chart, data: SectionData, u: Array) -> tuple[Array, Array, Array]:
    """Seeks critical points of det A on the section.

    Returns:
        They with multipliers, the larger of |det A| over its size and the residual, and the smallest margin.
    """
    slope = jax.grad(partial(chart.determinant, data))(u)
    rows = jax.jacfwd(partial(chart.section, data))(u)
    multipliers = pivoted_solve(rows @ rows.T, rows @ slope) if chart.n_rows else jnp.zeros(0)
    # The starts lie on the curve: near a crossing Newton's method converges, elsewhere nothing is sought.
    z = polish(partial(chart.critical, data), jnp.concatenate([u, multipliers]), steps=12, trust=0.3)
    found = z[: chart.dimension]
    relative = jnp.abs(chart.determinant(data, found)) / chart.determinant_size(data, found)
    residual = jnp.maximum(relative, jnp.max(jnp.abs(chart.critical(data, z))))
    return z, residual, jnp.min(chart.margins(data, found))


def _branches(chart: Chart, data: SectionData, z: Array) -> Array:
    """Returns the two unit directions in which det A vanishes to second order at a critical point; NaN if complex."""
    m = chart.dimension
    u, multipliers = z[:m], z[m:]

    def lagrangian(u: Array) -> Array:
        return chart.determinant(data, u) - jnp.sum(multipliers * chart.section(data, u))

    bend = jax.hessian(lagrangian)(u)
    rows = jax.jacfwd(partial(chart.section, data))(u)
    basis = jnp.linalg.svd(rows, full_matrices=True)[2][-2:] if chart.n_rows else jnp.eye(m)
    h = basis @ bend @ basis.T
    a, b, c = h[0, 0], h[0, 1], h[1, 1]
    # The zero directions of a quadratic form lie symmetric about its eigenvectors.
    mean, spread, axis = 0.5 * (a + c), jnp.hypot(0.5 * (a - c), b), 0.5 * jnp.arctan2(2 * b, a - c)
    half = 0.5 * jnp.arccos(-mean / spread)
    angles = jnp.stack([axis + half, axis - half])
    return jnp.cos(angles)[:, None] * basis[0] + jnp.sin(angles)[:, None] * basis[1]


def onto_curve(chart: Chart, data: SectionData, guess: Array, across: Array) -> Array:
    """Returns the point of the singular curve in the plane through the guess across a direction."""

    def system(u: Array) -> Array:
        return jnp.append(chart.singular(data, u), jnp.dot(across, u - guess))

    return polish(system, guess, steps=4, trust=0.1)


def _midpoint(chart: Chart, data: SectionData, pair: Array) -> Array:
    a, b = pair
    return onto_curve(chart, data, 0.5 * (a + b), (b - a) / jnp.sqrt(jnp.sum((b - a) ** 2)))


def midpoints(section: Section, pairs: np.ndarray) -> np.ndarray:
    """Returns the points of the curve half-way between pairs of its points, ``(k, 2, m) -> (k, m)``."""
    return over_points(_midpoint, section.chart, section.data, pairs)


def starting_points(section: Section, part: int) -> np.ndarray:
    """Returns one part of the samples of the section, ``(starts, m)``: no two parts share a start."""
    some = section.samples[part % len(section.samples) :: PARTS]
    return np.resize(some, (section.starts, section.chart.dimension))


def seeds_on_curves(section: Section, part: int) -> np.ndarray:
    """Returns points on the singular curves inside the box, ``(k, m)``, from one part of the samples."""
    u, residual, margin = over_points(_project, section.chart, section.data, starting_points(section, part))
    good = (residual <= TOLERANCES.residual) & (margin >= 0)
    return glued(section, u[good])


def glued(section: Section, u: np.ndarray) -> np.ndarray:
    """Returns points with their glued unknowns brought into one turn from the lower end."""
    u = np.array(u, float)
    for k in np.flatnonzero(np.isfinite(section.period)):
        turned = (u[..., k] - section.low[k]) % section.period[k] + section.low[k]
        # Rounding may end at the upper end, which is the lower one.
        u[..., k] = np.where(turned >= section.low[k] + section.period[k], section.low[k], turned)
    return u


def near(section: Section, points: np.ndarray, others: np.ndarray, distance: float = SAME) -> np.ndarray:
    """Returns which points have another within a distance on the glued space."""
    gaps = np.max(np.abs(short_way(points[:, None] - others[None], section.period)), axis=2, initial=0.0)
    return np.any(gaps < distance, axis=1)


def distinct(section: Section, u: np.ndarray, distance: float = SAME) -> np.ndarray:
    """Returns the indices of the first of each cluster of points."""
    kept: list[int] = []
    for k in range(len(u)):
        if not near(section, u[k : k + 1], u[kept], distance)[0]:
            kept.append(k)
    return np.array(kept, int)


def twins(section: Section, u: np.ndarray) -> np.ndarray:
    """Returns the same configurations by the other triple of angles (the mechanism has a ``twin``)."""
    n, unit = section.chart.n_pose, np.asarray(section.data.pose_unit)
    assert section.robot.twin is not None
    return glued(section, np.hstack([np.asarray(section.robot.twin(u[:, :n] * unit)) / unit, u[:, n:]]))


def without_twins(section: Section, u: np.ndarray) -> np.ndarray:
    """Returns the indices of points, of two triples of angles of one configuration the first."""
    if not section.has_twins or len(u) == 0:
        return np.arange(len(u))
    others, kept = twins(section, u), list[int]()
    for k in range(len(u)):
        if not near(section, others[k : k + 1], u[kept])[0]:
            kept.append(k)
    return np.array(kept, int)


def crossings(section: Section, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns where the singular curve crosses itself in the box, ``(n, m)``, and both directions, ``(n, 2, m)``.

    A critical point of det A on the section at which det A vanishes too. It is a regular solution of the
    critical equations, so that Newton's method finds it to all digits, although the curve is not smooth there.
    Where both directions are NaN the point is an isolated one.
    """
    m = section.chart.dimension
    if len(seeds) > 0:
        some = seeds[np.linspace(0, len(seeds) - 1, min(len(seeds), BLOCK)).astype(int)]
        z, residual, margin = over_points(_critical_points, section.chart, section.data, some)
        z = z[(residual <= TOLERANCES.residual) & (margin >= -EDGE_SLACK)]
        z = z[distinct(section, glued(section, z[:, :m]))]
        if len(z) > 0:
            return glued(section, z[:, :m]), over_points(_branches, section.chart, section.data, z)
    return np.zeros((0, m)), np.zeros((0, 2, m))


def margins(section: Section, points: np.ndarray) -> np.ndarray:
    """Returns the margins of points, ``(k, n)``: two a free joint."""
    return over_points(_margins, section.chart, section.data, points)


def _margins(chart: Chart, data: SectionData, u: Array) -> Array:
    return chart.margins(data, u)


def seeds_on_borders(section: Section, seeds: np.ndarray) -> np.ndarray:
    """Returns points of the singular curves on the borders of the box, ``(k, m)``, from seeds and from elsewhere."""
    apart = starting_points(section, part=2)[: BLOCK // 4]
    some = np.concatenate([seeds[np.linspace(0, len(seeds) - 1, min(len(seeds), BLOCK // 4)).astype(int)], apart])
    edges = np.repeat(np.array(section.edges, int), len(some))
    u, good = border_points(section, np.tile(some, (len(section.edges), 1)), edges)
    u = glued(section, u[good])
    return u[distinct(section, u)]


def border_points(section: Section, guesses: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns guesses moved onto the border that each names, and which of them solve the equations there."""
    u, residual, margin = over_points(_edge_points, section.chart, section.data, guesses, edges)
    return u, (residual <= TOLERANCES.residual) & (margin >= -EDGE_SLACK)
