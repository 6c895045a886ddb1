"""The equations of cusp curves, and of the points on them that matter: critical points, borders, crossings.

Every equation is divided by a frozen measure of its own slope: det A becomes a distance, its rate along the kernel the
cosine of an angle. This changes no root and no tangent, and boxes much wider than the mechanism lose no digits near it.
Where det A has factors, the rate of one is divided by the others: at a pose where two of them vanish the kernel lies in
the sheet of both, so that the whole curve on which they meet would solve the equations without being cusps.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import scale_vector
from jaxkin.mapping.batch import in_blocks
from jaxkin.mapping.chart import SQUARE, Chart, SectionData, factor_names
from jaxkin.mapping.section import Section
from jaxkin.numerics.newton import descend, polish, value_and_slope
from jaxkin.numerics.small_linalg import pivoted_solve

#: Lengths below which a frozen measure is not trusted.
_TINY = 1e-9


class SheetData(NamedTuple):
    """The numbers of one sheet of the singular set: det A = 0, or one factor of it.

    Attributes:
        section: The numbers of the box, with the factor that is meant.
        others: ``(k, n_factor)`` picks the other factors, each scaled to order one.
    """

    section: SectionData
    others: Array


class Sheet(NamedTuple):
    """One sheet of the singular set over a box.

    Attributes:
        section: The box, bound to the sheet's factor.
        data: Its numbers for the functions here.
        name: The factor's name; "" for det A itself.
        other_names: Names of the other factors.
    """

    section: Section
    data: Any
    name: str
    other_names: tuple[str, ...]

    @property
    def chart(self) -> Chart:
        """The structure of the equations."""
        return self.section.chart


def sheets_of(section: Section) -> tuple[Sheet, ...]:
    """Returns the sheets of the singular set: one for every factor that the mechanism declares, else det A."""
    robot = section.robot
    if not hasattr(robot, "factors"):
        return (Sheet(section, SheetData(section.data, jnp.zeros((0, 0))), "", ()),)
    names = factor_names(robot)
    poses = section.samples[:, : section.chart.n_pose] * np.asarray(scale_vector(*_axes(section)))
    sizes = in_blocks(partial(_factor_sizes, robot), poses)
    picks = np.eye(len(names)) / np.array([np.median(sizes[name]) for name in names])[:, None]
    found = []
    for k, name in enumerate(names):
        data = section.data._replace(factor=jnp.asarray(picks[k]))
        others = jnp.asarray(np.delete(picks, k, axis=0))
        bound = Section(**{**section.__dict__, "data": data})
        found.append(Sheet(bound, SheetData(data, others), name, tuple(n for n in names if n != name)))
    return tuple(found)


def _axes(section: Section):  # type: ignore[no-untyped-def]
    return section.robot.pose_axes, section.robot.characteristic_length()


@jax.jit
def _factor_sizes(robot, poses: Array) -> dict[str, Array]:  # type: ignore[no-untyped-def]
    return jax.tree.map(jnp.abs, jax.vmap(robot.factors)(poses))


def frozen_size(vector: Array) -> Array:
    """Returns the length of a vector as a constant."""
    return jax.lax.stop_gradient(jnp.maximum(jnp.sqrt(jnp.sum(vector * vector)), _TINY))


def frozen_slope(function: Callable[[Array], Array], u: Array) -> Array:
    """Returns the length of a function's slope at u as a constant; nothing of it is differentiated."""
    return frozen_size(jax.jacfwd(function)(jax.lax.stop_gradient(u)))


def _rate(chart: Chart, data: SheetData, u: Array) -> tuple[Array, Array]:
    """Returns det A, and its rate along the kernel divided by the kernel's length."""
    kernel = chart.kernel(data.section, u)
    direction = jnp.concatenate([kernel, jnp.zeros(chart.dimension - chart.n_pose)])
    value, rate = jax.jvp(partial(chart.determinant, data.section), (u,), (direction,))
    return value, rate / frozen_size(kernel)


def other_factors(chart: Chart, data: SheetData, u: Array) -> Array:
    """Returns the other factors, ``(k,)``, scaled to order one."""
    if data.others.shape[0] == 0:
        return jnp.zeros(0)
    return data.others @ chart.factors(data.section, u)


def cusp(chart: Chart, data: SheetData, u: Array) -> Array:
    """Returns the equations of the cusp curves of a sheet, ``(m - 1,)``."""
    value, rate = _rate(chart, data, u)
    for k in range(data.others.shape[0]):
        other = jnp.dot(data.others[k], chart.factors(data.section, u))
        rate = rate * jnp.sqrt(1 + other * other) / other
    size = frozen_slope(partial(chart.determinant, data.section), u)
    return jnp.append(chart.section(data.section, u), jnp.stack([value, rate]) / size)


def margins(chart: Chart, data: SheetData, u: Array) -> Array:
    """Returns the margins of the box, as ``Chart.margins``."""
    return chart.margins(data.section, u)


def joint_values(chart: Chart, data: SheetData, u: Array) -> Array:
    """Returns the free joints, or their squares where the pose gives these, dimensionless, ``(3,)``."""
    parts = []
    for k, kind in enumerate(chart.kinds):
        unit = data.section.free_unit[k]
        parts.append(chart.free_value(data.section, u, k) / (unit * unit if kind == SQUARE else unit))
    return jnp.stack(parts)


def tangent(chart: Chart, data: SheetData, u: Array, along: Array) -> Array:
    """Returns the unit tangent that points along a direction; NaN where the curve is not smooth."""
    return tangent_of(jax.jacfwd(partial(cusp, chart, data))(u), along)


def tangent_of(slope: Array, along: Array) -> Array:
    """Returns the unit vector orthogonal to ``(m - 1, m)`` rows that points along a direction."""
    m = slope.shape[1]
    t = pivoted_solve(jnp.concatenate([slope, along[None]]), jnp.zeros(m).at[m - 1].set(1.0))
    return t / jnp.sqrt(jnp.sum(t * t))


def course(chart: Chart, data: SheetData, u: Array, along: Array) -> tuple[Array, Array, Array]:
    """Returns tangent, rates of the joint values along the curve, and the rates' own rates, ``(m,), (3,), (3,)``."""

    def rates(u: Array) -> tuple[Array, Array]:
        t = tangent(chart, data, u, along)
        return jax.jvp(partial(joint_values, chart, data), (u,), (t,))[1], t

    t = tangent(chart, data, u, along)
    value, bend, _ = jax.jvp(rates, (u,), (t,), has_aux=True)
    return t, value, bend


def project(chart: Chart, data: SheetData, u: Array) -> tuple[Array, Array, Array]:
    """Moves points to cusps inside the box; returns them, their residuals and smallest margins."""

    def objective(u: Array) -> Array:
        return jnp.append(cusp(chart, data, u), chart.violations(data.section, u))

    u = descend(objective, u, 30)
    return u, jnp.max(jnp.abs(cusp(chart, data, u))), jnp.min(margins(chart, data, u))


def critical(chart: Chart, data: SheetData, z: Array, axis: Array, along: Array) -> Array:
    """Returns the square system of critical points of one joint along cusp curves, in point and tangent ``(2 m,)``."""
    m = chart.dimension
    u, t = z[:m], z[m:]
    value, moved = jax.jvp(partial(cusp, chart, data), (u,), (t,))
    return jnp.concatenate([value, moved, jnp.stack([jnp.dot(along, t) - 1, _joint_rate(chart, data, u, t, axis)])])


def _joint_rate(chart: Chart, data: SheetData, u: Array, t: Array, axis: Array) -> Array:
    def value(u: Array) -> Array:
        return jnp.dot(axis, joint_values(chart, data, u))

    return jax.jvp(value, (u,), (t,))[1] / frozen_slope(value, u)


def seek_critical(chart: Chart, data: SheetData, u: Array, t: Array, axis: Array) -> tuple[Array, Array, Array]:
    """Descends from a point and a tangent to a critical point of a joint; returns both there, and the residual."""
    m = chart.dimension
    system = partial(critical, chart, data, axis=axis, along=t)
    z = descend(system, jnp.concatenate([u, t]), 30)
    return z[:m], z[m:] / jnp.sqrt(jnp.sum(z[m:] ** 2)), jnp.max(jnp.abs(system(z)))


def polish_critical(chart: Chart, data: SheetData, u: Array, t: Array, axis: Array) -> tuple[Array, Array, Array]:
    """Applies Newton's method to ``critical``; returns the point and its unit tangent, and the last residual but one.

    Two critical points may be so near each other that a descent stays between them.
    """
    m = chart.dimension
    both = value_and_slope(partial(critical, chart, data, axis=axis, along=t))

    def step(_: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        z, _ = carry
        value, slope = both(z)
        move = pivoted_solve(slope, value)
        z = z - move * jnp.minimum(1.0, 0.1 / (jnp.max(jnp.abs(move)) + 1e-300))
        return z, jnp.max(jnp.abs(value))

    z, residual = jax.lax.fori_loop(0, 12, step, (jnp.concatenate([u, t]), jnp.inf * jnp.ones(())))
    return z[:m], z[m:] / jnp.sqrt(jnp.sum(z[m:] ** 2)), residual


def on_border(chart: Chart, data: SheetData, u: Array, edge: Array) -> tuple[Array, Array, Array]:
    """Moves cusps onto one border each; returns them, residuals and smallest margins."""

    def margin(u: Array) -> Array:
        return margins(chart, data, u)[edge]

    def system(u: Array) -> Array:
        return jnp.append(cusp(chart, data, u), margin(u) / frozen_slope(margin, u))

    u = descend(system, u, 30)
    return u, jnp.max(jnp.abs(system(u))), jnp.min(margins(chart, data, u))


def at_crossing(chart: Chart, data: SheetData, u: Array, which: Array) -> tuple[Array, Array]:
    """Moves points of a cusp curve to where another factor vanishes too; returns them and residuals.

    There the rate along the kernel vanishes with the factor: its quotient is the quotient of their slopes.
    """

    def other(u: Array) -> Array:
        return jnp.dot(which, other_factors(chart, data, u))

    def system(u: Array) -> Array:
        pull = jax.jacfwd(other)(u)
        turn = jax.jacfwd(lambda u: _rate(chart, data, u)[1])(u)
        size, steep = frozen_size(pull), frozen_slope(partial(chart.determinant, data.section), u)
        mixed = jnp.dot(turn, pull) / (size * size * steep)
        rest = jnp.stack([chart.determinant(data.section, u) / steep, other(u) / size, mixed])
        return jnp.append(chart.section(data.section, u), rest)

    u = polish(system, u, steps=8, trust=0.1)
    return u, jnp.max(jnp.abs(system(u)))


def beside_crossing(chart: Chart, data: SheetData, u: Array, which: Array, value: Array) -> tuple[Array, Array]:
    """Moves points along a cusp curve to where another factor has a small value; returns them and residuals."""

    def other(u: Array) -> Array:
        return jnp.dot(which, other_factors(chart, data, u))

    def system(u: Array) -> Array:
        return jnp.append(cusp(chart, data, u), (other(u) - value) / frozen_slope(other, u))

    u = polish(system, u, steps=8, trust=0.1)
    return u, jnp.max(jnp.abs(system(u)))


def at_value(chart: Chart, data: SheetData, u: Array, axis: Array, value: Array) -> tuple[Array, Array]:
    """Moves points along the cusp curve to where a joint has a value; returns them and residuals."""

    def joint(u: Array) -> Array:
        return jnp.dot(axis, joint_values(chart, data, u)) - value

    def system(u: Array) -> Array:
        return jnp.append(cusp(chart, data, u), joint(u) / frozen_slope(joint, u))

    u = polish(system, u, steps=10, trust=0.1)
    return u, jnp.max(jnp.abs(system(u)))


def measure(chart: Chart, data: SheetData, u: Array, t: Array, axis: Array) -> tuple[Array, Array]:
    """Measures a critical point of a joint on a cusp curve.

    Returns:
        How far the tangent is from the kernel of all free joints (0 at a swallowtail, at most 1), and the determinant
        of the Hessian of det A on the section through the point, scaled to [-1, 1]: positive at lips, negative at
        beaks.
    """
    slopes = jax.jacfwd(partial(joint_values, chart, data))(u)
    lengths = jnp.maximum(jnp.sqrt(jnp.sum(slopes**2, axis=1)), _TINY)
    turned = jnp.max(jnp.abs(slopes @ t) / lengths) / jnp.sqrt(jnp.sum(t * t))

    def fixed(u: Array) -> Array:
        return jnp.append(chart.section(data.section, u), jnp.dot(axis, joint_values(chart, data, u)))

    rows, slope = jax.jacfwd(fixed)(u), jax.jacfwd(partial(chart.determinant, data.section))(u)
    multipliers = pivoted_solve(rows @ rows.T, rows @ slope)

    def lagrangian(u: Array) -> Array:
        return chart.determinant(data.section, u) - jnp.dot(multipliers, fixed(u))

    basis = jnp.linalg.svd(rows, full_matrices=True)[2][-2:]
    h = basis @ jax.jacfwd(jax.jacfwd(lagrangian))(u) @ basis.T
    return turned, (h[0, 0] * h[1, 1] - h[0, 1] * h[1, 0]) / (0.5 * jnp.sum(h * h) + 1e-300)


def gradient_share(chart: Chart, data: SheetData, u: Array) -> Array:
    """Returns the slope of det A on the box over its size: small where the singular set crosses itself."""
    slope = jax.jacfwd(partial(chart.determinant, data.section))(u)
    if chart.n_rows:
        rows = jax.jacfwd(partial(chart.section, data.section))(u)
        slope = slope - rows.T @ pivoted_solve(rows @ rows.T, rows @ slope)
    matrix = chart.matrix(data.section, u)
    size = jnp.prod(jnp.maximum(jnp.sqrt(jnp.sum(matrix * matrix, axis=1)), _TINY))
    return jnp.sqrt(jnp.sum(slope**2)) / (size if data.section.factor.shape[0] == 0 else 1.0)
