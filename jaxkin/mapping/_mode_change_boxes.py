"""Boxes of poses in which a mode change is sought."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics._following import pose_unit
from jaxkin.kinematics.solve import forward
from jaxkin.mapping._mode_change_search import Lattice
from jaxkin.sweep.grid import BoundGrid, Grid, Span

#: Points along each axis, by the number of free axes.
_COUNTS = {1: 400, 2: 160, 3: 40, 4: 14, 5: 9, 6: 7}
#: Boxes are enlarged by these shares of their widest side on every side, with so many times as many points an axis.
_ATTEMPTS = ((0.3, 1.0), (0.3, 1.6), (1.0, 1.8))
#: The finest cells of ``jk.aspects`` along each axis, by the number of free axes: it makes few of them.
_CELLS = {1: 1024, 2: 512, 3: 128}
#: Points of a lattice at most: what more axes or finer steps would need is not tried.
_MOST = 400_000


def boxes_of(
    who: str, robot: Mechanism, grid: BoundGrid | None, joints: np.ndarray, ends: np.ndarray
) -> Iterator[Lattice]:
    """Yields the boxes to search, one after the other until something is found.

    Args:
        who: The public function, for messages.
        robot: The mechanism.
        grid: The user's grid, which is then the only one, or None.
        joints: ``(n_joint,)``.
        ends: ``(2, n_pose)`` start and goal.

    Raises:
        InputError: Start or goal lies outside the grid.
    """
    if grid is not None:
        yield _given(who, robot, grid, ends)
        return
    found = forward(robot, joints)
    modes = np.concatenate([np.asarray(found.values)[np.asarray(found.valid)], ends])
    free = len(robot.pose_axes)
    for wider, finer in _ATTEMPTS:
        count = int(_COUNTS.get(free, 5) * finer)
        if count**free <= _MOST:
            yield _around(robot, modes, wider, count)


def _turns(robot: Mechanism) -> np.ndarray:
    """Returns the period of every pose axis, also where its interval is shorter; inf where there is none."""
    turns = [2 * np.pi if axis.name in robot.covered else axis.period for axis in robot.pose_axes]
    return np.array([np.inf if turn is None else turn for turn in turns])


def _around(robot: Mechanism, modes: np.ndarray, wider: float, count: int) -> Lattice:
    """Returns the box around poses, dimensionless, with whole turns of glued angles."""
    unit, period = np.asarray(pose_unit(robot)), _turns(robot)
    points = modes / unit
    plain = ~np.isfinite(period)
    margin = wider * max(float(np.max(np.ptp(points[:, plain], axis=0), initial=0.0)), 1.0)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    ends = np.array([(axis.low, axis.high) for axis in robot.pose_axes]) / unit[:, None]
    low = np.where(plain, np.maximum(low, ends[:, 0]), ends[:, 0])
    high = np.minimum(high, ends[:, 1])
    turn = np.where(plain, 0.0, period / unit)
    spacing = np.where(plain, (high - low) / (count - 1), turn / count)
    return Lattice(low, spacing, (count,) * len(unit), np.where(plain, np.inf, turn))


def _given(who: str, robot: Mechanism, grid: BoundGrid, ends: np.ndarray) -> Lattice:
    unit, period = np.asarray(pose_unit(robot)), _turns(robot)
    low, spacing, shape = [], [], []
    for k, (axis, value) in enumerate(zip(grid.axes, grid.values, strict=True)):
        if not isinstance(value, Span):
            low.append(value)
            spacing.append(0.0)
            shape.append(1)
            inside = np.abs(ends[:, k] - value) <= 1e-9 * unit[k]
            rule = f"fixed at {value:g}"
        else:
            whole = value.high - value.low >= period[k] * (1 - 1e-12)
            low.append(value.low)
            spacing.append(period[k] / value.count if whole else (value.high - value.low) / (value.count - 1))
            shape.append(value.count)
            place = ends[:, k] - value.low
            place = np.mod(place, period[k]) if np.isfinite(period[k]) else place
            inside = (place >= 0) & (place <= value.high - value.low) | whole
            rule = f"from {value.low:g} to {value.high:g}"
        if not np.all(inside):
            which = ("start", "goal")[int(np.flatnonzero(~inside)[0])]
            raise InputError(
                f"{who}: {which} has {axis.name} = {ends[int(which == 'goal'), k]:.12g}, outside the grid, which is "
                f"{rule}: give a grid that holds both poses."
            )
    return Lattice(np.array(low) / unit, np.array(spacing) / unit, tuple(shape), period / unit)


def searched(robot: Mechanism, box: Lattice) -> dict[str, Any]:
    """Returns what was searched: ``[low, high, count]`` of every axis, or its value, in its own unit."""
    unit, content = np.asarray(pose_unit(robot)), dict[str, Any]()
    for k, axis in enumerate(robot.pose_axes):
        low, count = float(box.low[k] * unit[k]), box.shape[k]
        steps = count if box.wraps[k] else count - 1
        high = low + float(box.spacing[k] * unit[k]) * steps
        content[axis.name] = [low, high, count] if count > 1 else low
    return content


def cells_of(box: Lattice, robot: Mechanism, given: bool) -> Grid:
    """Returns a grid of the finest cells for ``jk.aspects`` over a box; as fine as it is where the user gave it."""
    free = sum(count > 1 for count in box.shape)
    axes = {}
    for name, value in searched(robot, box).items():
        axes[name] = (value[0], value[1], value[2] if given else _CELLS[free]) if isinstance(value, list) else value
    return Grid(**axes)
