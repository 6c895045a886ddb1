"""Sections and boxes: a grid with two or three free joints, bound to a mechanism and checked."""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_single
from jaxkin.mapping.batch import BLOCK, over_points
from jaxkin.mapping.chart import Chart, SectionData, chart_of, factor_names, tells_factors
from jaxkin.numerics.newton import descend, lattice
from jaxkin.sweep.grid import BoundGrid, Grid, Span

#: Samples of a section are made for so many independent searches.
PARTS = 4


@dataclass(frozen=True)
class Section:
    """A section of the joint space (two free joints) or a box (three), ready for computation.

    Attributes:
        robot: The mechanism.
        grid: The grid in the mechanism's order of joints.
        chart: Structure of the equations.
        data: Their numbers.
        period: ``(m,)`` period of each unknown, dimensionless, inf where it is not glued.
        low: ``(m,)`` lower ends of the region in which solutions are sought.
        high: ``(m,)`` upper ends.
        samples: ``(k, m)`` poses spread over the section, inside the box: where searches start.
        starts: How many starts a search makes; the grid's numbers only choose this.
    """

    robot: Mechanism
    grid: BoundGrid
    chart: Chart
    data: SectionData
    period: np.ndarray
    low: np.ndarray
    high: np.ndarray
    samples: np.ndarray
    starts: int

    def record(self, method: str) -> dict[str, Any]:
        """Returns what every result over this section says of it: request, names and units."""
        poses, joints = self.robot.pose_axes, self.robot.joint_axes
        return {
            "request": {**identity(self.robot), "method": method, "section": self.grid.content()},
            "pose_names": tuple(axis.name for axis in poses),
            "joint_names": tuple(axis.name for axis in joints),
            "units": {axis.name: axis.unit for axis in (*poses, *joints)},
        }

    def sheets(self) -> "tuple[Section, ...]":
        """Returns the section once for every factor of det A that is traced by itself; mostly once."""
        names = traced_factors(self.robot)
        picks = np.eye(len(names)) if names else np.zeros((1, 0))
        return tuple(replace(self, data=self.data._replace(factor=jnp.asarray(pick))) for pick in picks)

    def border(self, number: int) -> tuple[int, float]:
        """Returns the joint that is at its bound on a border, and the bound; borders are numbered as margins are."""
        which, end = divmod(number, 2)
        return self.grid.free[which], float((self.data.low, self.data.high)[end][which])

    def describe(self) -> str:
        """The section in a few words, for messages."""
        return ", ".join(
            f"{name} = {value[0]:g} .. {value[1]:g}" if isinstance(value, list) else f"{name} = {value:g}"
            for name, value in self.grid.content().items()
        )


def traced_factors(robot: Mechanism) -> tuple[str, ...]:
    """Returns the names of the factors that are traced one by one, where the mechanism tells them apart."""
    return factor_names(robot) if tells_factors(robot) else ()


#: What a grid with so many free joints is called.
_KINDS = {2: "section", 3: "box"}
_NUMBERS = {2: "two", 3: "three"}


def bind_section(who: str, robot: Mechanism, grid: Grid, free: int = 2) -> Section:
    """Fits a section to a mechanism, or a box where three joints are free.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: No mechanism or grid; an axis is unknown or missing; not exactly ``free`` are free; a joint is
            fixed outside its limits or at a length of zero; a free joint's range misses its limits; no pose
            reaches the section.
        GeometryError: The geometry is degenerate, or det dF/dpose vanishes identically.
    """
    checked_single(who, robot)
    kind, number = _KINDS[free], _NUMBERS[free]
    if not isinstance(grid, Grid):
        raise InputError(f"{who} got {grid!r} as its {kind}: pass a jaxkin.Grid with {number} free joint axes.")
    bound = grid.bind(robot.joint_axes, "joint")
    if len(bound.free) != free:
        raise InputError(
            f"{who}: the {kind} has {len(bound.free)} free joint ax{'is' if len(bound.free) == 1 else 'es'} "
            f"({', '.join(robot.joint_axes[k].name for k in bound.free)}): a {kind} needs exactly {number}; "
            f"{'free another axis' if len(bound.free) < free else 'fix the others at numbers'}."
        )
    if not bool(np.all(robot.geometry_ok())):
        raise GeometryError(
            f"{who}: the geometry of {robot} is degenerate or not finite; build it with the mechanism's constructor, "
            "which names what is wrong."
        )
    low, high, middle = _ranges(who, robot, bound)
    chart, picks = chart_of(robot, bound.free)
    data = _numbers(robot, bound, picks, low, high, middle)
    _check_fixed(who, robot, bound)
    starts = int(np.clip(1 << (max(bound.shape) - 1).bit_length(), 512, 4096))
    region = _region(robot, bound, chart, data)
    samples = _samples(chart, data, region, starts)
    section = Section(robot, bound, chart, data, *region, samples, starts)
    if len(samples) == 0:
        raise InputError(
            f"{who}: no pose reaches the section {section.describe()}: its joint values lie outside the reachable "
            "range; widen the free axes or fix the others elsewhere."
        )
    _refuse_gimbal_lock(who, section)
    return replace(section, data=_scaled(who, section))


def _refuse_gimbal_lock(who: str, section: Section) -> None:
    """Refuses a section with a whole sheet on which only the angles of the pose are singular."""
    if not tells_factors(section.robot):
        return
    sizes = over_points(_chart_factor, section.chart, section.data, section.samples)
    if np.mean(sizes <= 1e-9) > 0.01:
        names = ", ".join(f"{section.robot.joint_axes[k].name}" for k in section.grid.free)
        raise InputError(
            f"{who}: the section {section.describe()} holds a sheet of gimbal lock, where the angles of the pose "
            f"cannot tell its curves apart: move a fixed joint a little (by 1e-3, say), or map over {names} with "
            "jk.sweep."
        )


def _chart_factor(chart: Chart, data: SectionData, u: jax.Array) -> jax.Array:
    factors: dict[str, jax.Array] = data.robot.chart_factors(chart.pose(data, u))  # type: ignore[attr-defined]
    return jnp.min(jnp.abs(jnp.stack(list(factors.values()))))


def _ranges(who: str, robot: Mechanism, bound: BoundGrid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns ends of the free joints within the limits, and the middle of every joint."""
    limits = robot.limit_values()
    lows, highs, middle = [], [], []
    for k, (axis, value) in enumerate(zip(bound.axes, bound.values, strict=True)):
        least, most = max(float(limits.low[k]), axis.low), min(float(limits.high[k]), axis.high)
        if isinstance(value, Span):
            low, high = max(value.low, least), min(value.high, most)
            if not low < high:
                raise InputError(
                    f"{who}: {axis.name} goes from {value.low:g} to {value.high:g}, outside its limits {least:g} to "
                    f"{most:g}: move the range into them, or widen robot.limits."
                )
            lows.append(low)
            highs.append(high)
            middle.append(0.5 * (low + high))
        else:
            if not least <= value <= most:
                raise InputError(
                    f"{who}: {axis.name} is fixed at {value:g}, outside its limits {least:g} to {most:g}: fix it "
                    "inside them, or widen robot.limits."
                )
            middle.append(value)
    return np.array(lows), np.array(highs), np.array(middle)


def _numbers(
    robot: Mechanism,
    bound: BoundGrid,
    picks: dict[str, np.ndarray],
    low: np.ndarray,
    high: np.ndarray,
    middle: np.ndarray,
) -> SectionData:
    length = robot.characteristic_length()
    row_scale = robot.constraint_scales(jnp.zeros(len(robot.pose_axes)), jnp.asarray(middle))
    free = list(bound.free)
    fixed = middle.copy()
    fixed[free] = 0.0
    return SectionData(
        robot=robot,
        fixed=jnp.asarray(fixed),
        **{name: jnp.asarray(rows) for name, rows in picks.items()},
        pose_unit=scale_vector(robot.pose_axes, length),
        free_unit=scale_vector(robot.joint_axes, length)[jnp.array(free)],
        row_scale=row_scale,
        matrix_scale=row_scale,
        factor=jnp.ones(len(traced_factors(robot))),
        low=jnp.asarray(low),
        high=jnp.asarray(high),
    )


def _check_fixed(who: str, robot: Mechanism, bound: BoundGrid) -> None:
    """Refuses a joint fixed at a zero length: the section then has no smooth points to start from."""
    length = float(robot.characteristic_length())
    for axis, value in zip(bound.axes, bound.values, strict=True):
        if isinstance(value, Span) or axis.is_angle:
            continue
        if axis.low == 0.0 and abs(value) <= 1e-6 * length:
            raise InputError(
                f"{who}: {axis.name} is fixed at {value:g}: a leg of zero length has no direction (a serial "
                "singularity), and the section is no surface there; fix it at a positive length."
            )


def _region(
    robot: Mechanism, bound: BoundGrid, chart: Chart, data: SectionData
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns period, low and high of the unknowns, dimensionless."""
    length = float(robot.characteristic_length())
    known = [
        abs(value.high if isinstance(value, Span) else value)
        for axis, value in zip(bound.axes, bound.values, strict=True)
        if not axis.is_angle
    ]
    # No pose lies farther out than the legs and the size of the mechanism together.
    reach = 2 * (1 + max(known, default=0.0) / length)
    low, high, period = [], [], []
    for axis, unit in zip(robot.pose_axes, np.asarray(data.pose_unit), strict=True):
        low.append(max(axis.low / unit, -reach))
        high.append(min(axis.high / unit, reach))
        turn = 2 * np.pi if axis.name in robot.covered else axis.period
        period.append(np.inf if turn is None else turn / unit)
    for k in chart.unknown:
        axis, unit = robot.joint_axes[bound.free[k]], float(data.free_unit[k])
        low.append(float(data.low[k]) / unit)
        high.append(float(data.high[k]) / unit)
        period.append(np.inf if axis.period is None else axis.period / unit)
    return np.array(period), np.array(low), np.array(high)


def _samples(
    chart: Chart, data: SectionData, region: tuple[np.ndarray, np.ndarray, np.ndarray], starts: int
) -> np.ndarray:
    """Returns points spread over the section inside its box, ``(k, m)``.

    The region is as wide as the free joints might allow. Starts from far away all arrive on one side of the section,
    so that the box which the first points fill is filled anew.
    """
    period, low, high = region
    unit, samples = lattice(PARTS * starts, chart.dimension), np.zeros((0, chart.dimension))
    for _ in range(2):
        found, missed = over_points(_onto_section, chart, data, low + (high - low) * unit)
        if not np.any(missed <= 1e-9):
            break
        samples = found[missed <= 1e-9]
        glued, slack = np.isfinite(period), 0.05 * np.ptp(samples, axis=0) + 1e-6
        low = np.where(glued, low, np.maximum(low, np.min(samples, axis=0) - slack))
        high = np.where(glued, high, np.minimum(high, np.max(samples, axis=0) + slack))
    return samples


def _onto_section(chart: Chart, data: SectionData, u: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Moves points onto the section and into the box; returns them, and by how much they miss."""

    def objective(u: jax.Array) -> jax.Array:
        return jnp.concatenate([chart.section(data, u), chart.violations(data, u)])

    u = descend(objective, u, 30)
    return u, jnp.max(jnp.abs(objective(u)))


def _scaled(who: str, section: Section) -> SectionData:
    """Returns the numbers with the scale of A that makes its rows of order one on the section.

    Raises:
        GeometryError: The determinant vanishes at every sample.
    """
    norms, shares = over_points(_sizes, section.chart, section.data, section.samples[:BLOCK])
    typical = np.median(norms, axis=0)
    if np.all(shares <= TOLERANCES.residual) or not np.all(typical > 0):
        raise GeometryError(
            f"{who}: det dF/dpose of {section.robot} vanishes identically on the section: the mechanism is singular at "
            "every pose (two legs, or two equations, depend on each other); change the geometry, or drop an equation "
            "that repeats another."
        )
    return section.data._replace(matrix_scale=section.data.matrix_scale * typical)


def _sizes(chart: Chart, data: SectionData, u: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Returns the lengths of the rows of A, and |det A| over their product, the magnitude of its terms."""
    matrix = chart.matrix(data, u)
    norms = jnp.sqrt(jnp.sum(matrix * matrix, axis=1))
    size = jnp.prod(norms)
    return norms, jnp.abs(chart.determinant(data, u)) / jnp.where(size > 0, size, 1.0)
