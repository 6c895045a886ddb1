"""The equations of node curves: two singular poses over one joint value, in the doubled space of both.

Every pair of equal poses solves them too. The differences of the joints and of det A are therefore divided by the
distance of the poses, which leaves of the diagonal only the cusps; near them solutions are told by their distance.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.mapping._cusp_curve_continuation import Rules
from jaxkin.mapping._cusp_curve_equations import SheetData, frozen_slope, joint_values
from jaxkin.mapping.chart import UNKNOWN, Chart
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.newton import descend


class PairData(NamedTuple):
    """The numbers of two sheets on which the two poses lie.

    Attributes:
        first: The sheet of the first pose.
        second: The sheet of the second.
        same: 1 where they are one sheet, else 0.
        period: ``(m,)`` periods of the unknowns.
        least: Distance of the poses below which they count as one.
    """

    first: SheetData
    second: SheetData
    same: Array
    period: Array
    least: Array


def apart(chart: Chart, data: PairData, w: Array) -> Array:
    """Returns the distance of both poses, the short way round."""
    m = chart.dimension
    gap = short_way(w[m:] - w[:m], data.period, jnp)
    return jnp.sqrt(jnp.sum(gap * gap) + 1e-300)


def _difference(chart: Chart, data: PairData, w: Array) -> Array:
    """Returns the differences of the free joints of both poses, each over its slopes, ``(3,)``."""
    m = chart.dimension
    one, two = (partial(joint_values, chart, sheet) for sheet in (data.first, data.second))
    gap = two(w[m:]) - one(w[:m])
    for k, kind in enumerate(chart.kinds):
        if kind == UNKNOWN:  # A joint that is glued may be a whole turn on.
            place = chart.n_pose + chart.unknown.index(k)
            gap = gap.at[k].set(short_way(gap[k], data.period[place], jnp))
    still = jax.lax.stop_gradient(w)
    slopes = jax.jacfwd(one)(still[:m]), jax.jacfwd(two)(still[m:])
    return gap / jnp.maximum(jnp.sqrt(jnp.sum(slopes[0] ** 2 + slopes[1] ** 2, axis=1)), 1e-9)


def node(chart: Chart, data: PairData, w: Array) -> Array:
    """Returns the equations of node curves, ``(2 m - 1,)``."""
    m = chart.dimension
    near = jax.lax.stop_gradient(jnp.minimum(apart(chart, data, w), 1.0))
    one, two = (partial(chart.determinant, sheet.section) for sheet in (data.first, data.second))
    first, second = one(w[:m]), two(w[m:])
    size = frozen_slope(one, w[:m]), frozen_slope(two, w[m:])
    # On one sheet the difference of det A over the distance is what tells a node from a pair of equal poses.
    split = jnp.where(data.same > 0, (second - first) / (near * size[0]), second / size[1])
    rest = jnp.concatenate([jnp.stack([first / size[0], split]), _difference(chart, data, w) / near])
    sections = chart.section(data.first.section, w[:m]), chart.section(data.second.section, w[m:])
    return jnp.concatenate([*sections, rest])


def inside(chart: Chart, data: PairData, w: Array) -> Array:
    """Returns the margins of the box, and last that of the distance of the poses."""
    return jnp.append(chart.margins(data.first.section, w[: chart.dimension]), apart(chart, data, w) - data.least)


def seek(chart: Chart, data: PairData, w: Array) -> tuple[Array, Array, Array, Array]:
    """Moves pairs to nodes inside the box.

    Returns:
        The pairs, residuals, smallest margins (that of the distance among them), and the second smallest singular
        value of the equations over their largest: zero where nodes form more than curves.
    """
    m = chart.dimension

    def fibre(other: Array) -> Array:
        return jnp.append(
            chart.section(data.second.section, other), _difference(chart, data, jnp.concatenate([w[:m], other]))
        )

    w = jnp.concatenate([w[:m], descend(fibre, w[m:], 20)])

    def objective(w: Array) -> Array:
        return jnp.append(node(chart, data, w), chart.violations(data.first.section, w[:m]))

    w = descend(objective, w, 30)
    sigma = jnp.linalg.svd(jax.jacfwd(partial(node, chart, data))(w), compute_uv=False)
    return w, jnp.max(jnp.abs(node(chart, data, w))), jnp.min(inside(chart, data, w)), sigma[-1] / sigma[0]


def from_swallowtail(chart: Chart, data: PairData, u: Array, t: Array, size: Array) -> tuple[Array, Array]:
    """Returns the pair of poses at a distance beside a swallowtail, along its tangent, and the residual."""
    w = jnp.concatenate([u - 0.5 * size * t, u + 0.5 * size * t])

    def system(w: Array) -> Array:
        return jnp.append(node(chart, data, w), (apart(chart, data, w) - size) / size)

    w = descend(system, w, 30)
    return w, jnp.max(jnp.abs(system(w)))


def on_border(chart: Chart, data: PairData, w: Array, edge: Array) -> tuple[Array, Array, Array]:
    """Moves pairs onto one border each; returns them, residuals and smallest margins."""
    m = chart.dimension

    def margin(u: Array) -> Array:
        return chart.margins(data.first.section, u)[edge]

    def system(w: Array) -> Array:
        return jnp.append(node(chart, data, w), margin(w[:m]) / frozen_slope(margin, w[:m]))

    w = descend(system, w, 30)
    return w, jnp.max(jnp.abs(system(w))), jnp.min(inside(chart, data, w))


def swapped(w: np.ndarray) -> np.ndarray:
    """Returns pairs in the other order, ``(..., 2 m)``."""
    m = w.shape[-1] // 2
    return np.concatenate([w[..., m:], w[..., :m]], axis=-1)


def safe_step(chart: Chart, data: PairData, w: Array) -> Array:
    """Returns a share of the distance of the poses: a longer step might exchange them at a swallowtail."""
    return 0.3 * apart(chart, data, w)


RULES = Rules(node, inside, safe_step)
