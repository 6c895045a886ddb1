"""Sections and boxes: a grid with two or three free joints, bound to a mechanism and checked."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Axis, Mechanism, scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_single
from jaxkin.mapping.batch import BLOCK, over_points
from jaxkin.mapping.chart import Chart, SectionData, chart_of, factor_names, tells_factors
from jaxkin.numerics.gluing import short_way
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
        who: The public function that asked, for messages.
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
    who: str

    @property
    def joint_period(self) -> np.ndarray:
        """``(n_joint,)`` period of every joint that runs over its whole period, inf for the others."""
        period = np.full(len(self.robot.joint_axes), np.inf)
        for k, whole in zip(self.grid.free, np.asarray(self.data.whole), strict=True):
            if whole:
                period[k] = self.robot.joint_axes[k].period
        return period

    @property
    def edges(self) -> tuple[int, ...]:
        """Numbers of the borders, as margins are numbered: none of a joint that runs over its whole period."""
        return tuple(number for number in range(2 * len(self.grid.free)) if not self.data.whole[number // 2])

    @property
    def has_twins(self) -> bool:
        """True where one configuration stands twice in the unknowns, by two triples of angles."""
        return self.robot.twin is not None

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

    def border_name(self, number: int) -> str:
        """Names a border, for instance ``rho3 = 4``."""
        joint, bound = self.border(number)
        return f"{self.robot.joint_axes[joint].name} = {bound:g}"

    def put_on_border(self, number: int, joints: np.ndarray, pose: np.ndarray) -> None:
        """Sets the coordinate of a point on a border that is at its bound, in place: it may be an ulp beside it."""
        del pose
        joint, bound = self.border(number)
        joints[joint] = bound

    def settle(self, joints: np.ndarray, poses: np.ndarray) -> None:
        """Moves free joints that rounding has put an ulp outside their bounds onto them, in place."""
        del poses
        free = list(self.grid.free)
        joints[:, free] = settled(joints[:, free], np.asarray(self.data.low), np.asarray(self.data.high))

    def image_steps(self, joints: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Returns the steps between neighbouring points in the free axes, in widths of the section."""
        del poses
        width = np.asarray(self.data.high) - np.asarray(self.data.low)
        return short_way(np.diff(joints, axis=0), self.joint_period)[:, list(self.grid.free)] / width

    def describe(self) -> str:
        """The section in a few words, for messages."""
        return ", ".join(
            f"{name} = {value[0]:g} .. {value[1]:g}" if isinstance(value, list) else f"{name} = {value:g}"
            for name, value in self.grid.content().items()
        )


def settled(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Returns values, those on the bounds that are within rounding of them."""
    clipped = np.clip(values, low, high)
    return np.where(np.abs(values - clipped) < 1e-12 * (1 + np.abs(high)), clipped, values)


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
    bound = checked_grid(who, robot, grid, free)
    if not bool(np.all(robot.geometry_ok())):
        raise GeometryError(
            f"{who}: the geometry of {robot} is degenerate or not finite; build it with the mechanism's constructor, "
            "which names what is wrong."
        )
    ranges = _ranges(who, robot, bound)
    chart, picks = chart_of(robot, bound.free)
    data = _numbers(robot, bound, picks, ranges)
    _check_fixed(who, robot, bound)
    starts = starts_of(bound)
    region = _region(robot, bound, chart, data)
    samples = spread_samples(chart, data, region, starts)
    section = Section(robot, bound, chart, data, *region, samples, starts, who)
    if len(samples) == 0:
        raise InputError(
            f"{who}: no pose reaches the section {section.describe()}: its joint values lie outside the reachable "
            "range; widen the free axes or fix the others elsewhere."
        )
    _refuse_gimbal_lock(who, section)
    return replace(section, data=_scaled(who, section))


def checked_grid(who: str, robot: Mechanism, grid: Grid, free: int = 2) -> BoundGrid:
    """Fits a grid to a mechanism's joints: what can be said of a section without looking at the geometry.

    Raises:
        InputError: No grid; an axis is unknown or missing; not exactly ``free`` are free.
    """
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
    return bound


def starts_of(bound: BoundGrid) -> int:
    """Returns how many starts a search makes: so many as the longer axis has samples, a power of two."""
    return int(np.clip(1 << (max(bound.shape) - 1).bit_length(), 512, 4096))


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


class _Ranges(NamedTuple):
    """Ends of the free joints, which of them run over their whole period, and the middle of every joint."""

    low: np.ndarray
    high: np.ndarray
    whole: np.ndarray
    middle: np.ndarray


def _ranges(who: str, robot: Mechanism, bound: BoundGrid) -> _Ranges:
    limits = robot.limit_values()
    spans, middle = [], []
    for k, (axis, value) in enumerate(zip(bound.axes, bound.values, strict=True)):
        least, most = max(float(limits.low[k]), axis.low), min(float(limits.high[k]), axis.high)
        if isinstance(value, Span):
            low, high, whole = free_range(who, axis, value, least, most)
            spans.append((low, high, whole))
            middle.append(0.5 * (low + high))
        else:
            if not any(least <= turned <= most for turned in _turns(axis, value)):
                raise InputError(
                    f"{who}: {axis.name} is fixed at {value:g}, outside its limits {least:g} to {most:g}: fix it "
                    "inside them, or widen robot.limits."
                )
            middle.append(value)
    low, high, whole = (np.array(column) for column in zip(*spans, strict=True))
    return _Ranges(low, high, whole, np.array(middle))


def _turns(axis: Axis, value: float) -> tuple[float, ...]:
    """Returns the values of a glued axis that are the same place, near its own interval."""
    if axis.period is None or not np.isfinite(axis.low):
        return (value,)
    start = value - axis.period * np.floor((value - axis.low) / axis.period)
    return tuple(start + k * axis.period for k in (0, 1, -1))


def free_range(who: str, axis: Axis, span: Span, least: float, most: float) -> tuple[float, float, bool]:
    """Returns the part of a free joint's range within its limits, and whether that is the whole glued period.

    A glued joint's range may lie in any turn, (0, 2 pi) for instance.
    """
    turn = axis.period
    if turn is not None and span.high - span.low > turn * (1 + 1e-12):
        raise InputError(
            f"{who}: {axis.name} goes from {span.low:g} to {span.high:g}, farther than its period {turn:g}: give one "
            "turn at most."
        )
    if turn is not None and most - least >= turn * (1 - 1e-12):
        whole = span.high - span.low >= turn * (1 - 1e-12)
        return span.low, span.high, whole
    turns = [0.0] if turn is None else [turn * k for k in range(-2, 3)]
    parts = [(max(span.low, least + t), min(span.high, most + t)) for t in turns]
    parts = [(low, high) for low, high in parts if low < high]
    if not parts:
        raise InputError(
            f"{who}: {axis.name} goes from {span.low:g} to {span.high:g}, outside its limits {least:g} to "
            f"{most:g}: move the range into them, or widen robot.limits."
        )
    if len(parts) > 1:
        raise InputError(
            f"{who}: {axis.name} goes from {span.low:g} to {span.high:g}, which its limits {least:g} to {most:g} cut "
            f"in two: give it from {least:g} to {most:g}."
        )
    return *parts[0], False


@jax.jit
def equation_scales(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> jax.Array:
    """Returns the magnitude of each equation's terms, compiled once for a kind of robot."""
    return robot.constraint_scales(pose, joints)


def _numbers(robot: Mechanism, bound: BoundGrid, picks: dict[str, np.ndarray], ranges: _Ranges) -> SectionData:
    length = robot.characteristic_length()
    row_scale = equation_scales(robot, jnp.zeros(len(robot.pose_axes)), jnp.asarray(ranges.middle))
    free = list(bound.free)
    fixed = ranges.middle.copy()
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
        low=jnp.asarray(ranges.low),
        high=jnp.asarray(ranges.high),
        whole=jnp.asarray(ranges.whole),
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
        # A part of a turn is an interval like any other: its points lie in one turn.
        period.append(axis.period / unit if axis.period is not None and data.whole[k] else np.inf)
    return np.array(period), np.array(low), np.array(high)


def spread_samples(
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
    norms, shares = over_points(row_sizes, section.chart, section.data, section.samples[:BLOCK])
    typical = np.median(norms, axis=0)
    if np.all(shares <= TOLERANCES.residual) or not np.all(typical > 0):
        raise GeometryError(
            f"{who}: det dF/dpose of {section.robot} vanishes identically on the section: the mechanism is singular at "
            "every pose (two legs, or two equations, depend on each other); change the geometry, or drop an equation "
            "that repeats another."
        )
    return section.data._replace(matrix_scale=section.data.matrix_scale * typical)


def row_sizes(chart: Chart, data: SectionData, u: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Returns the lengths of the rows of A, and |det A| over their product, the magnitude of its terms."""
    matrix = chart.matrix(data, u)
    norms = jnp.sqrt(jnp.sum(matrix * matrix, axis=1))
    size = jnp.prod(norms)
    return norms, jnp.abs(chart.determinant(data, u)) / jnp.where(size > 0, size, 1.0)
