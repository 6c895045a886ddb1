"""Sections of the workspace: a grid with two free pose axes, bound to a mechanism and checked."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.kinematics.boundary import checked_single
from jaxkin.kinematics.legs import LegKind, Legs, legs_of
from jaxkin.mapping._pose_chart import ENTRY, PARALLEL, SERIAL, ZERO_LENGTH, PoseChart, PoseNumbers
from jaxkin.mapping.batch import BLOCK, over_points
from jaxkin.mapping.chart import SQUARE, UNKNOWN, SectionData, chart_of
from jaxkin.mapping.section import (
    Section,
    equation_scales,
    free_range,
    row_sizes,
    settled,
    spread_samples,
    starts_of,
    traced_factors,
)
from jaxkin.numerics.gluing import short_way
from jaxkin.sweep.grid import BoundGrid, Grid, Span

#: A joint without a limit ends so many characteristic lengths away.
_FAR = 1e4


@dataclass(frozen=True)
class PoseSection(Section):
    """A section of the workspace, ready for computation; its ``grid`` is over the pose axes.

    Attributes:
        legs: How the equations hold the joints, None where working modes are no sign vectors.
        leg: The joint whose leg is singular on the curves, -1 where det A or det B is meant.
    """

    legs: Legs | None
    leg: int = -1

    @property
    def pose_chart(self) -> PoseChart:
        """The structure of the equations."""
        assert isinstance(self.chart, PoseChart)
        return self.chart

    @property
    def joint_period(self) -> np.ndarray:
        """``(n_joint,)`` period of every joint that runs over its whole period, inf for the others."""
        axes, whole = self.robot.joint_axes, np.asarray(self.data.whole)
        return np.array([axis.period if full else np.inf for axis, full in zip(axes, whole, strict=True)], float)

    @property
    def edges(self) -> tuple[int, ...]:
        """Numbers of the borders: ends of the free coordinates first, then limits of the joints."""
        poses = [k for k in range(4) if not self.data.workspace.whole[k // 2]]
        far = _FAR * float(self.robot.characteristic_length())
        ends = np.stack([self.data.low, self.data.high], axis=1).ravel()
        joints = [4 + k for k, end in enumerate(ends) if not self.data.whole[k // 2] and abs(end) < far]
        return (*poses, *joints)

    @property
    def has_twins(self) -> bool:
        """False: another triple of angles of the same configuration lies in another section."""
        return False

    def border(self, number: int) -> tuple[int, float]:
        """Returns the axis that is at its bound on a border (a pose axis for the first four, else a joint), and it."""
        which, end = divmod(number if number < 4 else number - 4, 2)
        if number < 4:
            return self.grid.free[which], float((self.data.workspace.low, self.data.workspace.high)[end][which])
        return which, float((self.data.low, self.data.high)[end][which])

    def border_name(self, number: int) -> str:
        """Names a border, for instance ``x = 4``."""
        axis, bound = self.border(number)
        axes = self.robot.pose_axes if number < 4 else self.robot.joint_axes
        return f"{axes[axis].name} = {bound:g}"

    def put_on_border(self, number: int, joints: np.ndarray, pose: np.ndarray) -> None:
        """Sets the coordinate of a point on a border that is at its bound, in place: it may be an ulp beside it."""
        axis, bound = self.border(number)
        (pose if number < 4 else joints)[axis] = bound

    def settle(self, joints: np.ndarray, poses: np.ndarray) -> None:
        """Moves coordinates that rounding has put an ulp outside their bounds onto them, in place."""
        numbers, free = self.data.workspace, list(self.grid.free)
        joints[:] = settled(joints, np.asarray(self.data.low), np.asarray(self.data.high))
        poses[:, free] = settled(poses[:, free], np.asarray(numbers.low), np.asarray(numbers.high))

    def image_steps(self, joints: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Returns the steps between neighbouring points in the free coordinates, in widths of the section."""
        numbers = self.data.workspace
        width = np.asarray(numbers.high) - np.asarray(numbers.low)
        period = np.where(np.asarray(numbers.whole), width, np.inf)
        return short_way(np.diff(poses[:, list(self.grid.free)], axis=0), period) / width

    def sheets(self) -> "tuple[PoseSection, ...]":
        """Returns the section once for every factor of det A that is traced by itself; mostly once.

        Raises:
            InputError: A factor vanishes at every pose.
        """
        sheets = tuple(s for s in super().sheets() if isinstance(s, PoseSection))
        for sheet, name in zip(sheets, traced_factors(self.robot) or ("det A",), strict=True):
            shares = over_points(row_sizes, sheet.chart, sheet.data, self.samples[:BLOCK])[1]
            if np.all(shares <= TOLERANCES.residual):
                raise InputError(
                    f"{self.who}: {name} vanishes at every pose of the section {self.describe()}: all of it is "
                    "singular; fix the other coordinates elsewhere."
                )
        return sheets

    def serial_sheets(self) -> "tuple[PoseSection, ...]":
        """Returns the section once for every leg that can be stretched, folded or of zero length, with the equation."""
        unknown, kept = self.chart.unknown, np.asarray(self.data.kept_row)
        if self.legs is None:
            return (self._vanishing(SERIAL),) if unknown else ()
        sheets = []
        for k, kind in enumerate(self.chart.kinds):
            if kind == UNKNOWN and self.legs.kinds[k] != LegKind.LINEAR:
                entry = np.zeros((self.chart.n_rows, len(unknown)))
                entry[int(np.flatnonzero(kept[:, self.legs.rows[k]])[0]), unknown.index(k)] = 1.0
                sheets.append(self._vanishing(ENTRY, k, entry=jnp.asarray(entry)))
            elif kind == SQUARE:
                sheets.append(self._vanishing(ZERO_LENGTH, k, square=jnp.eye(len(self.chart.kinds))[k]))
        return tuple(sheets)

    def _vanishing(self, what: str, leg: int = -1, **numbers: Any) -> "PoseSection":
        data = self.data._replace(workspace=self.data.workspace._replace(**numbers))
        return replace(self, chart=_chart(self.chart.n_pose, self.chart.kinds, what), data=data, leg=leg)


@cache
def _chart(n_pose: int, kinds: tuple[int, ...], vanishing: str) -> PoseChart:
    """One object a structure, see ``chart_of``."""
    return PoseChart(n_pose, kinds, vanishing)


def bind_pose_section(who: str, robot: Mechanism, grid: Grid) -> PoseSection:
    """Fits a section of the workspace to a mechanism.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: No mechanism or grid; an axis is unknown or missing; not exactly two are free; no pose of the
            section can be reached.
        GeometryError: The geometry is degenerate.
    """
    checked_single(who, robot)
    bound = grid.bind(robot.pose_axes, "pose")
    if len(bound.free) != 2:
        remedy = (
            "free another axis" if len(bound.free) < 2 else "fix the others at numbers, or use jk.singular_surfaces"
        )
        raise InputError(
            f"{who}: the section has {len(bound.free)} free pose ax{'is' if len(bound.free) == 1 else 'es'} "
            f"({', '.join(robot.pose_axes[k].name for k in bound.free)}): a section needs exactly two; "
            f"{remedy}."
        )
    if not bool(np.all(robot.geometry_ok())):
        raise GeometryError(
            f"{who}: the geometry of {robot} is degenerate or not finite; build it with the mechanism's constructor, "
            "which names what is wrong."
        )
    chart, picks = chart_of(robot, tuple(range(len(robot.joint_axes))))
    chart = _chart(chart.n_pose, chart.kinds, PARALLEL)
    data = _numbers(who, robot, bound, picks)
    data = data._replace(
        workspace=data.workspace._replace(
            entry=jnp.zeros((chart.n_rows, len(chart.unknown))), square=jnp.zeros(len(chart.kinds))
        )
    )
    starts, region = starts_of(bound), _region(robot, chart, data)
    samples = spread_samples(chart, data, region, starts)
    section = PoseSection(robot, bound, chart, data, *region, samples, starts, who, legs_of(robot))
    if len(samples) == 0:
        raise InputError(
            f"{who}: the mechanism reaches no pose of the section {section.describe()} within its joint limits; widen "
            "the free axes, or fix the others elsewhere."
        )
    norms = np.median(over_points(row_sizes, chart, data, samples[:BLOCK])[0], axis=0)
    scale = data.matrix_scale * np.where(norms > 0, norms, 1.0)
    return replace(section, data=data._replace(matrix_scale=scale))


def _numbers(who: str, robot: Mechanism, bound: BoundGrid, picks: dict[str, np.ndarray]) -> SectionData:
    length = robot.characteristic_length()
    n, free = len(robot.pose_axes), list(bound.free)
    spans = [v for v in bound.values if isinstance(v, Span)]
    ranges = [
        free_range(who, bound.axes[k], span, bound.axes[k].low, bound.axes[k].high)
        for k, span in zip(free, spans, strict=True)
    ]
    low, high, whole = (np.array(column) for column in zip(*ranges, strict=True))
    fixed = np.array([0.0 if isinstance(v, Span) else v for v in bound.values])
    middle = fixed.copy()
    middle[free] = 0.5 * (low + high)
    joint_low, joint_high, joint_whole = _joint_ranges(robot, float(length))
    typical = np.clip(0.0, joint_low, joint_high)
    row_scale = equation_scales(robot, jnp.asarray(middle), jnp.asarray(typical))
    return SectionData(
        robot=robot,
        fixed=jnp.zeros(n),
        **{name: jnp.asarray(rows) for name, rows in picks.items()},
        pose_unit=scale_vector(robot.pose_axes, length),
        free_unit=scale_vector(robot.joint_axes, length),
        row_scale=row_scale,
        matrix_scale=row_scale,
        factor=jnp.ones(len(traced_factors(robot))),
        low=jnp.asarray(joint_low),
        high=jnp.asarray(joint_high),
        whole=jnp.asarray(joint_whole),
        workspace=PoseNumbers(
            fixed=jnp.asarray(fixed),
            free=jnp.eye(n)[jnp.array(free)],
            unit=scale_vector(robot.pose_axes, length)[jnp.array(free)],
            low=jnp.asarray(low),
            high=jnp.asarray(high),
            whole=jnp.asarray(whole),
            entry=jnp.zeros((0, 0)),
            square=jnp.zeros(n),
        ),
    )


def _joint_ranges(robot: Mechanism, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the ends of all joints, far away where there is none, and which run over a whole period."""
    limits = robot.limit_values()
    axes, far = robot.joint_axes, _FAR * length
    low = np.array([max(float(limits.low[k]), axis.low) for k, axis in enumerate(axes)])
    high = np.array([min(float(limits.high[k]), axis.high) for k, axis in enumerate(axes)])
    turn = np.array([np.inf if axis.period is None else axis.period for axis in axes])
    whole = np.isfinite(turn) & (high - low >= turn * (1 - 1e-12))
    return np.maximum(low, -far), np.minimum(high, far), whole


def _region(robot: Mechanism, chart: PoseChart, data: SectionData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns period, low and high of the unknowns, dimensionless."""
    numbers: PoseNumbers = data.workspace
    unit = np.asarray(numbers.unit)
    low, high = list(np.asarray(numbers.low) / unit), list(np.asarray(numbers.high) / unit)
    period = list(np.where(np.asarray(numbers.whole), np.array(high) - np.array(low), np.inf))
    lengths = np.array([not axis.is_angle for axis in robot.pose_axes])
    ends = np.abs(np.stack([numbers.fixed + numbers.free.T @ end for end in (numbers.low, numbers.high)]))
    # No joint is longer than the pose is far and the mechanism large.
    reach = 2 * (1 + float(np.max(ends[:, lengths], initial=0.0)) / float(robot.characteristic_length()))
    for k in chart.unknown:
        axis, size = robot.joint_axes[k], float(data.free_unit[k])
        low.append(max(float(data.low[k]) / size, -reach) if not axis.is_angle else max(float(data.low[k]), -np.pi))
        high.append(min(float(data.high[k]) / size, reach) if not axis.is_angle else min(float(data.high[k]), np.pi))
        turns = axis.period is not None and bool(data.whole[k])
        period.append(axis.period / size if turns else np.inf)  # type: ignore[operator]
    return np.array(period), np.array(low), np.array(high)
