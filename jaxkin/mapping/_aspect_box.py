"""What ``jk.aspects`` cuts into cells: the box of the free pose axes, its sheets and their walls."""

import math
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.kinematics.legs import LegKind, Legs, legs_of
from jaxkin.mapping._aspect_sheets import Box, halve, judge, new_sheet
from jaxkin.mapping._aspect_walls import OUTSIDE, UNDECIDED, WallData, Walls, all_values, seam_flips
from jaxkin.mapping.chart import factor_names
from jaxkin.sweep.grid import BoundGrid, Grid, Span

WHO = "jk.aspects"
#: Cells along an axis where no grid says how many, by the number of free axes.
_DEFAULT = {1: 4096, 2: 512, 3: 128}
#: Cells of the coarsest level along the axis that has fewest, and levels at least, so that three can be compared.
_COARSEST, _LEVELS = 8, 2
#: A box is sought within so many lengths of the mechanism and its legs.
_REACH = 4.0


@dataclass(frozen=True, eq=False)
class Task:
    """A box and the sheets over it.

    Attributes:
        box: The cells.
        walls: Structure of the walls, one for all sheets.
        sheets: Numbers of each sheet.
        modes: Working mode of each sheet.
        flips: Which singular walls change sign over the seam of each axis.
        open_ends: ``(d, 2)`` True where the box ends although the axis goes on.
        grid: What the box was made from.
        unused: Fixed pose axes that no wall depends on.
    """

    box: Box
    walls: Walls
    sheets: tuple[WallData, ...]
    modes: tuple[tuple[int, ...], ...]
    flips: np.ndarray
    open_ends: np.ndarray
    grid: dict[str, Any]
    unused: tuple[str, ...]


def prepared(robot: Mechanism, grid: Grid | None, limits: bool | str, clearance: float) -> Task:
    """Binds everything to a mechanism and checks it.

    Raises:
        InputError: No grid where one is needed, a wrong one, or a mechanism without sign vectors as working modes.
        GeometryError: The geometry is degenerate.
    """
    check_arguments(robot, limits, clearance)
    legs = legs_of(robot)
    assert legs is not None  # Others are sampled, see ``_aspect_coupled``.
    bound = _bound(robot, legs, grid, limits)
    return _task(robot, legs, bound, limits, clearance)


def check_arguments(robot: Mechanism, limits: bool | str, clearance: float) -> None:
    """Refuses a degenerate geometry and arguments that are none.

    Raises:
        InputError: ``limits`` or ``clearance`` is wrong.
        GeometryError: The geometry is degenerate.
    """
    if not bool(np.all(robot.geometry_ok())):
        raise GeometryError(
            f"{WHO}: the geometry of {robot} is degenerate or not finite; build it with the mechanism's constructor, "
            "which names what is wrong."
        )
    if limits not in (True, False, "joints"):
        raise InputError(
            f"{WHO}: limits is {limits!r}: give True for all margins of the mechanism, 'joints' for the joints' own "
            "limits alone, or False."
        )
    if not (isinstance(clearance, int | float) and math.isfinite(clearance) and clearance >= 0):
        raise InputError(f"{WHO}: clearance is {clearance!r}: it must be a finite number that is not negative.")


@dataclass(frozen=True)
class _Request:
    free: tuple[int, ...]
    fixed: np.ndarray
    low: np.ndarray
    high: np.ndarray
    counts: tuple[int, ...]
    given: bool


def _bound(robot: Mechanism, legs: Legs, grid: Grid | None, limits: bool | str) -> _Request:
    axes = robot.pose_axes
    if grid is None:
        if len(axes) not in _DEFAULT:
            raise InputError(
                f"{WHO}: {robot.id} has {len(axes)} pose axes, more than three: pass a grid that fixes some of them, "
                f"{_suggested(robot, legs)}."
            )
        free = tuple(range(len(axes)))
        low, high = _derived(robot, legs, free, limits)
        return _Request(free, np.zeros(len(axes)), low, high, (_DEFAULT[len(free)],) * len(free), False)
    if not isinstance(grid, Grid):
        raise InputError(f"{WHO} got {grid!r} as its grid: pass a jaxkin.Grid over the pose axes, or None.")
    bound: BoundGrid = grid.bind(axes, "pose")
    if len(bound.free) not in _DEFAULT:
        raise InputError(f"{WHO}: the grid has {len(bound.free)} free axes: fix all but three of them.")
    fixed = np.array([0.0 if isinstance(value, Span) else value for value in bound.values])
    spans = [bound.values[k] for k in bound.free]
    for k, span in zip(bound.free, spans, strict=True):
        assert isinstance(span, Span)
        period = axes[k].period
        if period is not None and span.high - span.low > period * (1 + 1e-12):
            raise InputError(
                f"{WHO}: {axes[k].name} goes from {span.low:g} to {span.high:g}, more than its period {period:g}: give "
                "one period at most."
            )
        if span.count < _COARSEST * 2:
            raise InputError(
                f"{WHO}: the grid has {span.count} cells along {axes[k].name}, too few to say anything: give at least "
                f"{_COARSEST * 2}; cells are made only where they are needed."
            )
    low, high = (np.array([getattr(span, end) for span in spans]) for end in ("low", "high"))
    # A chart ends where its angles do.
    low = np.maximum(low, [axes[k].low if axes[k].period is None else -np.inf for k in bound.free])
    high = np.minimum(high, [axes[k].high if axes[k].period is None else np.inf for k in bound.free])
    counts = tuple(span.count for span in spans if isinstance(span, Span))
    return _Request(bound.free, fixed, low, high, counts, True)


def _suggested(robot: Mechanism, legs: Legs) -> str:
    n = len(robot.pose_axes)
    walls = Walls(legs, tuple(range(n)), _factors(robot), (), ())
    names = [robot.pose_axes[k].name for k in _unused(robot, walls, _numbers(robot, legs, walls, legs.modes[0]))]
    return f"for instance {', '.join(names)}, on which det dF/dpose does not depend" if names else "at numbers"


def _factors(robot: Mechanism) -> tuple[str, ...]:
    names = factor_names(robot) if hasattr(robot, "factors") else ()
    return names if len(names) <= 3 else ()


def _numbers(
    robot: Mechanism, legs: Legs, walls: Walls, mode: tuple[int, ...], fixed: Any = None, clearance: float = 0.0
) -> WallData:
    low, high = _joint_ends(robot)
    pose = jnp.zeros(len(robot.pose_axes)) if fixed is None else jnp.asarray(fixed)
    signs = jnp.asarray(mode, dtype=float)
    return WallData(robot, signs, pose, jnp.asarray(low), jnp.asarray(high), jnp.asarray(float(clearance)))


def _joint_ends(robot: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    limits = robot.limit_values()
    low = np.maximum(np.asarray(limits.low), [axis.low for axis in robot.joint_axes])
    return low, np.minimum(np.asarray(limits.high), [axis.high for axis in robot.joint_axes])


def _points(robot: Mechanism, count: int = 12) -> np.ndarray:
    """Returns poses in general position, ``(count, n_pose)``."""
    unit = np.asarray(scale_vector(robot.pose_axes, robot.characteristic_length()))
    return np.random.default_rng(3).uniform(-1.3, 1.3, (count, len(unit))) * unit


@jax.jit
def _rows(robot: Mechanism, poses: jax.Array) -> jax.Array:
    """Returns value, slope and bend of every equation in every joint at zero, ``(k, 3, n, n)``."""

    def one(pose: jax.Array) -> jax.Array:
        zero = jnp.zeros(len(robot.joint_axes))
        slope = jax.jacfwd(robot.constraints, argnums=1)
        bend = jnp.einsum("ijj->ij", jax.jacfwd(slope, argnums=1)(pose, zero))
        value = jnp.broadcast_to(robot.constraints(pose, zero)[:, None], bend.shape)
        return jnp.stack([value, slope(pose, zero), bend])

    return jax.vmap(one)(poses)


def _inner_walls(
    robot: Mechanism, legs: Legs, limits: bool | str
) -> tuple[tuple[int, ...], tuple[tuple[int, int], ...]]:
    """Returns the legs whose reach is a wall, and the limits that are."""
    rows = np.asarray(_rows(robot, jnp.asarray(_points(robot))))
    low, high = _joint_ends(robot)
    reality, walls = [], []
    for k, (row, kind) in enumerate(zip(legs.rows, legs.kinds, strict=True)):
        _, first, second = rows[:, :, row, k].T
        if kind == LegKind.TRIGONOMETRIC:
            reality.append(k)
            if high[k] - low[k] < 2 * np.pi - 1e-9:
                walls.append((k, 0))
            continue
        ends = [(k, end) for end, bound in enumerate((low[k], high[k])) if np.isfinite(bound)]
        if kind == LegKind.LINEAR:
            reality += [k] if np.ptp(first) > 1e-12 * np.max(np.abs(first)) else []
        else:
            reality.append(k)
            vertex = -first / second
            if len(legs.signs[k]) == 1 and np.ptp(vertex) <= 1e-12 * (1 + np.max(np.abs(vertex))):
                side = legs.signs[k][0] * np.sign(second[0])
                # The sign of the leg says already on which side of the vertex its joint is.
                ends = [e for e in ends if ((low, high)[e[1]][k] - vertex[0]) * side > 0 or (e[1] == 0) != (side > 0)]
        walls += ends
    return tuple(reality), tuple(walls) if limits else ()


def _margin_names(robot: Mechanism, walls: Walls, data: WallData) -> tuple[str, ...]:
    """Returns the margins besides the joints' limits that can be negative."""
    if type(robot).margins is Mechanism.margins:
        return ()
    own = {f"{axis.name}_{end}" for axis in robot.joint_axes for end in ("low", "high")}
    names: list[str] = []

    def one(pose: jax.Array) -> list[jax.Array]:
        found = robot.margins(pose, walls.joints(data, pose))
        names.extend(found)
        return list(found.values())

    poses = jnp.asarray(_points(robot))
    values = [np.asarray(part) for part in jax.jit(jax.vmap(one))(poses)]
    found = zip(names, values, strict=True)
    return tuple(name for name, part in found if name not in own and not np.all(np.isposinf(part)))


def _unused(robot: Mechanism, walls: Walls, data: WallData) -> list[int]:
    """Returns the pose axes that no wall depends on, from values at shifted poses."""
    whole = replace(walls, free=tuple(range(len(robot.pose_axes))))
    poses = _points(robot)
    before, unused = np.asarray(all_values(whole, data, poses)), []
    size = np.nanmax(np.abs(before), axis=0)
    for k in range(len(robot.pose_axes)):
        moved = poses.copy()
        moved[:, k] += 0.37 * np.asarray(scale_vector(robot.pose_axes, robot.characteristic_length()))[k]
        change = np.abs(np.asarray(all_values(whole, data, moved)) - before)
        if not np.any(change > 1e-12 * size):
            unused.append(k)
    return unused


def _derived(robot: Mechanism, legs: Legs, free: tuple[int, ...], limits: bool | str) -> tuple[np.ndarray, np.ndarray]:
    """Returns the box that reach and joint limits leave, from cells not proved outside.

    Raises:
        InputError: An axis is not bounded by them.
    """
    reality, ends = _inner_walls(robot, legs, limits)
    walls = Walls(legs, free, (), reality, ends, singular=False)
    low_joint, high_joint = _joint_ends(robot)
    known = np.abs(np.concatenate([low_joint, high_joint]))
    lengths = [not axis.is_angle for axis in robot.joint_axes] * 2
    size = float(robot.characteristic_length()) + float(np.sum(known[np.isfinite(known) & lengths]))
    axes = [robot.pose_axes[k] for k in free]
    reach = [np.pi if axis.is_angle else _REACH * size for axis in axes]
    low = np.maximum([axis.low for axis in axes], -np.array(reach))
    high = np.minimum([axis.high for axis in axes], reach)
    ended = np.array([[np.isfinite(axis.low), np.isfinite(axis.high)] for axis in axes])
    for turn in range(8):
        first, last = _not_outside(robot, legs, walls, low, high)
        open_ = ~ended & np.stack([first <= low, last >= high], axis=1)
        if turn == 0 and open_.any():
            _refuse_open(robot, legs, free[int(np.argwhere(open_)[0, 0])])
        shrunk = (last - first) / (high - low)
        keep = np.array([axis.period is not None for axis in axes])
        low, high = np.where(keep, low, first), np.where(keep, high, last)
        if np.all((shrunk > 0.9) | keep):
            break
    return low, high


def _refuse_open(robot: Mechanism, legs: Legs, k: int) -> None:
    name = robot.pose_axes[k].name
    raise InputError(
        f"{WHO}: nothing bounds the pose axis {name!r} of {robot}: pass a grid with its range, {name}=(low, high, n), "
        "or limit the joints with robot.with_limits(...)."
    )


def _not_outside(
    robot: Mechanism, legs: Legs, walls: Walls, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners of what holds all cells that are not proved outside, over all sheets."""
    firsts, lasts = [], []
    box = Box(low, high, np.full(len(low), np.inf), (16 if len(low) < 3 else 8,) * len(low), 2)
    for mode in legs.modes:
        sheet = new_sheet(walls, _numbers(robot, legs, walls, mode), box, np.zeros(len(low), int))
        for level in range(box.levels + 1):
            judge(sheet)
            cells = sheet.tree.levels[-1]
            inside = cells.index[(cells.status >= 0) | (cells.status == UNDECIDED)]
            if level < box.levels:
                inside = cells.index[(cells.status != OUTSIDE) & (cells.status != UNDECIDED)]
                halve(sheet, np.flatnonzero(cells.status == UNDECIDED))
            if len(inside):
                firsts.append(low + inside.min(axis=0) * box.width(level))
                lasts.append(low + (inside.max(axis=0) + 1) * box.width(level))
    if not firsts:
        raise InputError(f"{WHO}: no pose of {robot} is within reach and limits; widen the joint limits.")
    return np.min(firsts, axis=0), np.max(lasts, axis=0)


def _task(robot: Mechanism, legs: Legs, request: _Request, limits: bool | str, clearance: float) -> Task:
    axes = [robot.pose_axes[k] for k in request.free]
    reality, ends = _inner_walls(robot, legs, limits)
    walls = Walls(legs, request.free, _factors(robot), reality, ends, clearance=clearance > 0)
    data = _numbers(robot, legs, walls, legs.modes[0], request.fixed, clearance)
    if limits is True:
        walls = replace(walls, margins=_margin_names(robot, walls, data))
    spans = request.high - request.low
    period = np.array(
        [
            axis.period if axis.period is not None and abs(span - axis.period) <= 1e-9 * axis.period else np.inf
            for axis, span in zip(axes, spans, strict=True)
        ]
    )
    levels = max(_LEVELS, int(math.log2(min(request.counts) / _COARSEST)))
    shape = tuple(-(-count // 2**levels) for count in request.counts)
    box = Box(request.low, request.high, period, shape, levels)
    flips = seam_flips(walls, data, box.low, box.high, period)
    if flips is None:
        walls = replace(walls, factors=())
        flips = np.zeros(len(axes), int)
    ends_open = np.array(
        [[low > axis.low, high < axis.high] for axis, low, high in zip(axes, box.low, box.high, strict=True)]
    )
    ends_open &= request.given & ~box.glued[:, None]
    content = {
        axis.name: [
            float(box.low[request.free.index(k)]),
            float(box.high[request.free.index(k)]),
            request.counts[request.free.index(k)],
        ]
        if k in request.free
        else float(request.fixed[k])
        for k, axis in enumerate(robot.pose_axes)
    }
    unused = tuple(robot.pose_axes[k].name for k in _unused(robot, walls, data) if k not in request.free)
    sheets = tuple(data._replace(signs=jnp.asarray(mode, dtype=float)) for mode in legs.modes)
    return Task(box, walls, sheets, legs.modes, flips, ends_open, content, unused)
