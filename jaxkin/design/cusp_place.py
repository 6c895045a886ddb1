"""Objective of cusps: how far the nearest cusp of a section is from a place in joint space."""

from collections.abc import Mapping
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.design.objective import ONLY, Measured, Objective
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.cusps import cusps
from jaxkin.mapping.search import EDGE_SLACK
from jaxkin.mapping.section import Section, bind_section
from jaxkin.numerics import newton
from jaxkin.numerics.implicit import attach_derivatives
from jaxkin.numerics.small_linalg import pivoted_solve
from jaxkin.sweep.grid import Grid, Span

#: Steps from every start: towards the cusps, and Newton's.
_DESCENT, _POLISH = 16, 6
#: A gradient of det A along the section below this share of det A's terms is that of a crossing, near which Newton's
#: method scatters; no cusp.
_FLAT = 1e-3


def cusp_distance(
    robot: Mechanism, section: Grid, target: Mapping[str, float], *, starts: int = 64, width: float | None = None
) -> Objective:
    """Returns the objective of the distance in joint space between a place and the nearest cusp of a section.

    Cusps are roots of {section, det A = 0, grad det A . v = 0} in pose space, by Newton's method from starts spread
    over the section of the mechanism given; derivatives are those of the root (implicit function theorem). Crossings of
    the singular set solve the same equations and are left out. To keep cusps away from a place use ``.at_least``.

    Args:
        robot: The mechanism, for which the objective is made.
        section: A grid with two free joint axes; cusps beyond their ends do not count.
        target: The place: a value for each free joint axis.
        starts: Starts of the search at each evaluation.
        width: Width of the smoothing at distance zero, in the unit of the joints; 1e-3 of the section's larger side by
            default.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``jk.cusps``, or the target does not name the free axes.

    Where no start finds a cusp the distance is that of the section's diagonal, with no derivative.
    """
    who = "jk.design.cusp_distance"
    bound = bind_section(who, robot, section)
    place, scale, unit = _target(who, robot, bound, target)
    smooth = 1e-3 * float(np.max(np.asarray(bound.data.high) - np.asarray(bound.data.low))) if width is None else width
    if not (isinstance(smooth, (int, float)) and np.isfinite(smooth) and smooth > 0):
        raise InputError(
            f"{who}: width is {width!r}: it must be a positive number, as a distance has a corner at zero."
        )
    if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
        raise InputError(f"{who}: starts is {starts!r}: it must be a positive whole number.")
    sheets = bound.sheets()
    nearest = [partial(_nearest, s.chart, s.data, _starts(s, starts), place, scale) for s in sheets]
    diagonal = float(np.linalg.norm((np.asarray(bound.data.high) - np.asarray(bound.data.low)) / np.asarray(scale)))

    def parts(robot: Mechanism, center: Array | None) -> Array:
        del center
        squares = jnp.stack([one(robot, diagonal) for one in nearest])
        return (jnp.sqrt(jnp.min(squares) + smooth**2) - smooth)[None]

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        del center
        found = cusps(robot, section)
        if not len(found.joints):
            return Measured(np.inf, 0.0, evidence="jk.cusps finds no cusp in the section")
        free = found.joints[:, list(bound.grid.free)]
        away = np.linalg.norm((free - np.asarray(place)) / np.asarray(scale), axis=1)
        k = int(np.argmin(away))
        told = (
            f"nearest of {len(away)} cusps that jk.cusps finds, at ({', '.join(f'{q:.8g}' for q in found.joints[k])})"
        )
        return Measured(float(away[k]), float(np.max(found.error[k])) + 1e-15, found.poses[k][0], evidence=told)

    return Objective(
        name="distance to cusp",
        unit=unit,
        parts=parts,
        worst=ONLY,
        width=smooth,
        smoothing=f"sqrt(d^2 + w^2) - w with w = {smooth:g}, below the distance d by at most w; d from {starts} starts",
        measure=measured,
        content={
            "objective": "distance to cusp",
            "section": bound.grid.content(),
            "target": dict(target),
            "starts": starts,
            "width": smooth,
        },
    )


def _target(who: str, robot: Mechanism, bound: Section, target: Mapping[str, float]) -> tuple[Array, Array, str]:
    """Returns the place ``(2,)``, what its coordinates are divided by, and the unit of the distance."""
    names = [robot.joint_axes[k].name for k in bound.grid.free]
    if not isinstance(target, Mapping) or set(target) != set(names):
        raise InputError(f"{who}: target is {target!r}: it must give a number for each of {', '.join(names)}.")
    try:
        values = np.array([float(target[name]) for name in names])
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if not np.all(np.isfinite(values)):
        raise InputError(f"{who}: target is {target!r}: its values must be finite numbers.")
    for name, value, k in zip(names, values, bound.grid.free, strict=True):
        span = bound.grid.values[k]
        assert isinstance(span, Span)
        if not span.low <= value <= span.high:
            raise InputError(
                f"{who}: target has {name} = {value:g}, outside the section's {span.low:g} to {span.high:g}: widen the "
                "section, whose ends are limits."
            )
    axes = [robot.joint_axes[k] for k in bound.grid.free]
    mixed = len({axis.unit for axis in axes}) > 1
    scale = scale_vector(tuple(axes), robot.characteristic_length()) if mixed else jnp.ones(len(axes))
    return jnp.asarray(values), scale, "1" if mixed else axes[0].unit


def _starts(section: Section, number: int) -> Array:
    pick = np.linspace(0, len(section.samples) - 1, min(number, len(section.samples))).astype(int)
    return jnp.asarray(section.samples[pick])


def _nearest(
    chart: Chart, data: SectionData, starts: Array, place: Array, scale: Array, robot: Mechanism, diagonal: float
) -> Array:
    """Returns the square of the distance to the nearest cusp on one sheet."""
    still = data._replace(robot=jax.lax.stop_gradient(robot))

    def one(u: Array) -> tuple[Array, Array]:
        u = newton.polish(partial(chart.cusp, still), newton.descend(partial(chart.cusp, still), u, _DESCENT), _POLISH)
        # Half of the rounding's room: roots scatter by what the equations' scales leave.
        arrived = jnp.max(jnp.abs(chart.cusp(still, u))) <= 10 * TOLERANCES.residual
        inside = jnp.min(chart.margins(still, u)) >= -EDGE_SLACK
        return u, arrived & inside & (_steepness(chart, still, u) > _FLAT)

    roots, good = jax.vmap(one)(starts)

    def square(numbers: SectionData, u: Array) -> Array:
        joints = numbers.free_joint @ chart.joints(numbers, u)
        away = (joints - place) / scale
        return jnp.sum(away * away)

    squares = jnp.where(good, jax.vmap(lambda u: square(still, u))(roots), jnp.inf)
    best = jnp.argmin(squares)
    found = jnp.isfinite(squares[best])

    def equations(u: Array, moved: Mechanism) -> Array:
        return chart.cusp(data._replace(robot=moved), u)

    root = jnp.where(found, roots[best], starts[0])
    u = attach_derivatives(equations, root, robot, found, found)
    return jnp.where(found, square(data._replace(robot=robot), u), diagonal**2)


def _steepness(chart: Chart, data: SectionData, u: Array) -> Array:
    """Returns the slope of det A along the section over the size of its terms; zero where the singular set crosses."""
    slope = jax.grad(partial(chart.determinant, data))(u)
    if chart.n_rows:
        rows = jax.jacfwd(partial(chart.section, data))(u)
        slope = slope - rows.T @ pivoted_solve(rows @ rows.T, rows @ slope)
    return jnp.sqrt(jnp.sum(slope * slope)) / chart.determinant_size(data, u)
