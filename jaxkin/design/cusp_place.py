"""Objectives of cusps: where in joint space the cusp of a section is that is nearest to a place, and how far away."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

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
_NONE = "jk.cusps finds no cusp in the section"


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
    search = _Search(who, robot, section, "target", target, starts)
    smooth = 1e-3 * float(np.max(search.sides)) if width is None else width
    if not (isinstance(smooth, (int, float)) and np.isfinite(smooth) and smooth > 0):
        raise InputError(
            f"{who}: width is {width!r}: it must be a positive number, as a distance has a corner at zero."
        )
    diagonal = float(np.linalg.norm(search.sides / np.asarray(search.scale)))

    def parts(robot: Mechanism, center: Array | None) -> Array:
        del center
        joints, found = search.nearest(robot)
        square = jnp.where(found, search.square(jnp.where(found, joints, search.place)), diagonal**2)
        return (jnp.sqrt(square + smooth**2) - smooth)[None]

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        del center
        found = search.measured(robot)
        if found is None:
            return Measured(np.inf, 0.0, evidence=_NONE)
        smoothed = float(np.hypot(found.away, smooth) - smooth)
        return Measured(found.away, found.error, found.pose, evidence=found.evidence, smoothed=smoothed)

    return Objective(
        name="distance to cusp",
        unit=search.unit,
        parts=parts,
        worst=ONLY,
        width=0.0,
        smoothing=f"sqrt(d^2 + w^2) - w with w = {smooth:g}, below the distance d by at most w; d from {starts} starts",
        measure=measured,
        content={"objective": "distance to cusp", **search.content(), "width": smooth},
    )


def cusp_coordinate(
    robot: Mechanism, section: Grid, joint: str, near: Mapping[str, float], *, starts: int = 64
) -> Objective:
    """Returns the objective of a coordinate of the cusp of a section that is nearest to a place, with its sign.

    The cusp and its derivatives are found as for ``cusp_distance``; where no start finds one the value is NaN. It jumps
    where another cusp becomes the nearest.

    Args:
        robot: The mechanism, for which the objective is made.
        section: A grid with two free joint axes; cusps beyond their ends do not count.
        joint: The free joint axis whose coordinate it is.
        near: Where: a value for each free joint axis.
        starts: Starts of the search at each evaluation.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``jk.cusps``, the place does not name the free axes, or the joint is none of them.
    """
    who = "jk.design.cusp_coordinate"
    search = _Search(who, robot, section, "near", near, starts)
    if joint not in search.names:
        raise InputError(f"{who}: joint is {joint!r}: choose a free axis of the section, {' or '.join(search.names)}.")
    k = search.names.index(joint)

    def parts(robot: Mechanism, center: Array | None) -> Array:
        del center
        joints, found = search.nearest(robot)
        return jnp.where(found, joints[k], jnp.nan)[None]

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        del center
        found = search.measured(robot)
        if found is None:
            return Measured(np.nan, np.nan, evidence=_NONE)
        return Measured(float(found.joints[k]), found.error, found.pose, evidence=found.evidence)

    return Objective(
        name=f"{joint} of cusp",
        unit=robot.joint_axes[search.bound.grid.free[k]].unit,
        parts=parts,
        worst=ONLY,
        width=0.0,
        smoothing=f"none: the root of the cusp's equations that is nearest to the place, from {starts} starts",
        measure=measured,
        content={"objective": "coordinate of cusp", "joint": joint, **search.content()},
    )


class _Found(NamedTuple):
    """The nearest of the cusps that ``jk.cusps`` finds: its free joints ``(2,)``, how far away, with the error."""

    joints: np.ndarray
    pose: np.ndarray
    away: float
    error: float
    evidence: str


class _Search:
    """The search for the cusp of a section nearest to a place, for mechanisms like the one it is made for.

    Attributes:
        bound: The section.
        names: Names of the two free joint axes.
        place: ``(2,)`` the place.
        scale: ``(2,)`` what distances are divided by.
        unit: Their unit.
        sides: ``(2,)`` of the section.
    """

    def __init__(
        self, who: str, robot: Mechanism, section: Grid, what: str, place: Mapping[str, float], starts: int
    ) -> None:
        self.bound = bound = bind_section(who, robot, section)
        axes = [robot.joint_axes[k] for k in bound.grid.free]
        self.names = [axis.name for axis in axes]
        self.place = _place(who, bound, self.names, what, place)
        if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
            raise InputError(f"{who}: starts is {starts!r}: it must be a positive whole number.")
        mixed = len({axis.unit for axis in axes}) > 1
        self.scale = scale_vector(tuple(axes), robot.characteristic_length()) if mixed else jnp.ones(len(axes))
        self.unit = "1" if mixed else axes[0].unit
        self.sides = np.asarray(bound.data.high) - np.asarray(bound.data.low)
        self._grid, self._given = section, {what: dict(place), "starts": starts}
        self._sheets = [(sheet.chart, sheet.data, _starts(sheet, starts)) for sheet in bound.sheets()]

    def content(self) -> dict[str, Any]:
        """Returns what determines the search."""
        return {"section": self.bound.grid.content(), **self._given}

    def square(self, joints: Array) -> Array:
        """Returns the square of the distance of free joints ``(2,)`` from the place."""
        away = (joints - self.place) / self.scale
        return jnp.sum(away * away)

    def nearest(self, robot: Mechanism) -> tuple[Array, Array]:
        """Returns the free joints ``(2,)`` of the nearest cusp, and whether there is one; differentiable."""
        found = [_nearest(*sheet, self.square, robot) for sheet in self._sheets]
        joints, there = (jnp.stack(part) for part in zip(*found, strict=True))
        best = jnp.argmin(jnp.where(there, jax.vmap(self.square)(joints), jnp.inf))
        return joints[best], there[best]

    def measured(self, robot: Mechanism) -> _Found | None:
        """Returns the nearest cusp that ``jk.cusps`` finds, or None."""
        found = cusps(robot, self._grid)
        if not len(found.joints):
            return None
        free = found.joints[:, list(self.bound.grid.free)]
        away = np.linalg.norm((free - np.asarray(self.place)) / np.asarray(self.scale), axis=1)
        k = int(np.argmin(away))
        where = ", ".join(f"{q:.8g}" for q in found.joints[k])
        told = f"nearest of {len(away)} cusps that jk.cusps finds, at ({where})"
        return _Found(free[k], found.poses[k][0], float(away[k]), float(np.max(found.error[k])) + 1e-15, told)


def _place(who: str, bound: Section, names: list[str], what: str, given: Mapping[str, float]) -> Array:
    """Returns a place in the section ``(2,)``."""
    if not isinstance(given, Mapping) or set(given) != set(names):
        raise InputError(f"{who}: {what} is {given!r}: it must give a number for each of {', '.join(names)}.")
    try:
        values = np.array([float(given[name]) for name in names])
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if not np.all(np.isfinite(values)):
        raise InputError(f"{who}: {what} is {given!r}: its values must be finite numbers.")
    for name, value, k in zip(names, values, bound.grid.free, strict=True):
        span = bound.grid.values[k]
        assert isinstance(span, Span)
        if not span.low <= value <= span.high:
            raise InputError(
                f"{who}: {what} has {name} = {value:g}, outside the section's {span.low:g} to {span.high:g}: widen the "
                "section, whose ends are limits."
            )
    return jnp.asarray(values)


def _starts(section: Section, number: int) -> Array:
    pick = np.linspace(0, len(section.samples) - 1, min(number, len(section.samples))).astype(int)
    return jnp.asarray(section.samples[pick])


def _nearest(
    chart: Chart, data: SectionData, starts: Array, square: Callable[[Array], Array], robot: Mechanism
) -> tuple[Array, Array]:
    """Returns the free joints ``(2,)`` of the nearest cusp on one sheet, and whether there is one."""
    still = data._replace(robot=jax.lax.stop_gradient(robot))

    def one(u: Array) -> tuple[Array, Array]:
        u = newton.polish(partial(chart.cusp, still), newton.descend(partial(chart.cusp, still), u, _DESCENT), _POLISH)
        # Half of the rounding's room: roots scatter by what the equations' scales leave.
        arrived = jnp.max(jnp.abs(chart.cusp(still, u))) <= 10 * TOLERANCES.residual
        inside = jnp.min(chart.margins(still, u)) >= -EDGE_SLACK
        return u, arrived & inside & (_steepness(chart, still, u) > _FLAT)

    def joints(numbers: SectionData, u: Array) -> Array:
        return numbers.free_joint @ chart.joints(numbers, u)

    roots, good = jax.vmap(one)(starts)
    squares = jnp.where(good, jax.vmap(lambda u: square(joints(still, u)))(roots), jnp.inf)
    best = jnp.argmin(squares)
    found = jnp.isfinite(squares[best])

    def equations(u: Array, moved: Mechanism) -> Array:
        return chart.cusp(data._replace(robot=moved), u)

    root = jnp.where(found, roots[best], starts[0])
    u = attach_derivatives(equations, root, robot, found, found)
    return joints(data._replace(robot=robot), u), found


def _steepness(chart: Chart, data: SectionData, u: Array) -> Array:
    """Returns the slope of det A along the section over the size of its terms; zero where the singular set crosses."""
    slope = jax.grad(partial(chart.determinant, data))(u)
    if chart.n_rows:
        rows = jax.jacfwd(partial(chart.section, data))(u)
        slope = slope - rows.T @ pivoted_solve(rows @ rows.T, rows @ slope)
    return jnp.sqrt(jnp.sum(slope * slope)) / chart.determinant_size(data, u)
