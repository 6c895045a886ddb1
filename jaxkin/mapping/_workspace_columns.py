"""How much of a workspace all margins of a robot leave: vertical columns on randomly shifted lattices [ours]."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping._workspace_records import FreeVolume
from jaxkin.mapping.batch import in_blocks
from jaxkin.numerics import bracket, spheres
from jaxkin.numerics.spheres import Shells

#: Independent shifts of the lattice, whose scatter is the sampling error.
_SHIFTS = 8
#: Columns a shift: lattices (k / F_m, k F_(m-1) / F_m), Fibonacci numbers, which are the best of the plane.
_FIBONACCI = [(144, 233), (377, 610), (987, 1597), (2584, 4181), (6765, 10946), (17711, 28657), (46368, 75025)]
#: Where the samples of a column begin: this irrational share of a spacing further in each,
#: and not the golden one, in which the lattice goes on.
_ONWARDS = math.sqrt(2) - 1
#: Cells of a column at first, and at most.
_CELLS, _MOST_CELLS = 32, 512
#: Poses that one compiled call takes.
_BLOCK = 1 << 13
#: A free volume below this share of the workspace is measured as exactly as if it had this share.
_LEAST_SHARE = 0.01


class _Count(NamedTuple):
    """Sums over the columns of one shift; lengths in the robot's unit."""

    total: float
    free: float
    unmet: float
    violated: np.ndarray
    alone: np.ndarray
    removed: float
    columns: int
    samples: int


@dataclass(frozen=True)
class Found:
    """The sums of all shifts of the densest lattice.

    Attributes:
        names: Of the conditions.
        counts: One entry per shift.
    """

    names: tuple[str, ...]
    counts: list[_Count]

    @property
    def shares(self) -> np.ndarray:
        """Free share of the columns' length, per shift."""
        return np.array([c.free / c.total if c.total > 0 else np.nan for c in self.counts])

    @property
    def errors(self) -> tuple[float, float, float]:
        """Errors of the share: between shifts, along columns, and of pieces too small to be met by a sample.

        Sampling errors of eight shifts are themselves uncertain, and refinement ends where they happen to be small:
        they count twice in ``error``.
        """
        total = sum(c.total for c in self.counts)
        sampling = float(np.std(self.shares, ddof=1) / np.sqrt(len(self.counts)))
        unseen = 1 / max(sum(c.samples for c in self.counts), 1)
        return sampling, sum(c.unmet for c in self.counts) / max(total, 1e-300), unseen

    @property
    def error(self) -> float:
        """Estimated error of the share."""
        sampling, resolution, unseen = self.errors
        return 2 * sampling + resolution + unseen

    def target(self, tolerance: float) -> float:
        """Returns the error of the share that a tolerance asks for."""
        return tolerance * max(float(np.mean(self.shares)), _LEAST_SHARE)

    def record(self, workspace: float, tolerance: float, branch: str, unit: str, request: dict[str, Any]) -> FreeVolume:
        """Returns the result; the share times the exact volume of the workspace."""
        sampling, resolution, _ = self.errors
        share, error = float(np.mean(self.shares)), self.error
        if not np.isfinite(share) or not np.isfinite(error):
            # A lattice missed the workspace: nothing is known of it.
            share, error, sampling, resolution = 0.0, 1.0, 0.5, 0.0
        removed = max(sum(c.removed for c in self.counts), 1e-300)
        violated = np.sum([c.violated for c in self.counts], axis=0) / removed
        alone = np.sum([c.alone for c in self.counts], axis=0) / removed
        binding = [k for k in range(len(self.names)) if violated[k] > 0]
        return FreeVolume(
            volume=workspace * share,
            error=workspace * error,
            sampling=workspace * sampling,
            resolution=workspace * resolution,
            workspace=workspace,
            violated={self.names[k]: float(violated[k]) for k in binding},
            alone={self.names[k]: float(alone[k]) for k in binding},
            converged=self.error <= self.target(tolerance),
            columns=sum(c.columns for c in self.counts),
            samples=sum(c.samples for c in self.counts),
            branch=branch,
            unit=unit,
            request=request,
        )


def nothing(branch: str, unit: str, request: dict[str, Any]) -> FreeVolume:
    """Returns the result for strokes that reach nothing: it is exact, and no column stands."""
    return FreeVolume(0.0, 0.0, 0.0, 0.0, 0.0, {}, {}, True, 0, 0, branch, unit, request)


def measured(
    robot: Mechanism, shells: Shells, plane: float, sign: float, tolerance: float, seed: int, most_columns: int
) -> Found:
    """Counts on lattices and with cells that get finer until the error is small enough, or the cap is reached."""
    names, level, cells = _conditions(robot), 0, _CELLS
    side = _Side(robot, shells, plane, sign, len(names))
    while True:
        shifts = np.random.default_rng(seed).random((_SHIFTS, 3))
        found = Found(names, [_counted(side, _FIBONACCI[level], shift, cells) for shift in shifts])
        (sampling, resolution, unseen), target = found.errors, found.target(tolerance)
        if found.error <= target:
            return found
        last = level + 1 == len(_FIBONACCI) or _SHIFTS * _FIBONACCI[level + 1][1] > most_columns
        finer = resolution > target / 3 and cells < _MOST_CELLS
        # A share is not finite where a lattice is so coarse that it misses the workspace.
        denser = not last and (not np.isfinite(sampling) or 2 * sampling + unseen > target / 2 or not finer)
        if not finer and not denser:
            return found
        level, cells = level + denser, cells * 2 if finer else cells


class _Side(NamedTuple):
    robot: Mechanism
    shells: Shells
    plane: float
    sign: float
    conditions: int


def _conditions(robot: Mechanism) -> tuple[str, ...]:
    """Names the margins besides those of the joints' limits, which are what bounds the columns."""
    names: list[str] = []
    pose = jax.ShapeDtypeStruct((len(robot.pose_axes),), float)
    joints = jax.ShapeDtypeStruct((len(robot.joint_axes),), float)
    # Collected inside the trace: a dict that comes out of one has its keys sorted.
    jax.eval_shape(lambda r, x, q: names.extend(_other_margins(r, x, q)), robot, pose, joints)
    return tuple(names)


def _other_margins(robot: Mechanism, pose: Array, joints: Array) -> dict[str, Array]:
    limits = Mechanism.margins(robot, pose, joints)
    return {name: value for name, value in robot.margins(pose, joints).items() if name not in limits}


@jax.jit
def _margins(robot: Mechanism, poses: Array) -> Array:
    """Returns the margins ``(n, conditions)`` at poses ``(n, 3)``; what is not a number is violated."""

    def one(pose: Array) -> Array:
        assert robot.inverse_kernel is not None
        joints = jnp.stack(robot.inverse_kernel(tuple(pose))[0].values)
        values = [jnp.asarray(value, float) for value in _other_margins(robot, pose, joints).values()]
        return jnp.nan_to_num(jnp.stack(values), nan=-1.0) if values else jnp.ones(1)

    return jax.vmap(one)(poses)


@jax.jit
def _ends(robot: Mechanism, start: Array, end: Array, at_start: Array, at_end: Array) -> Array:
    """Returns the share of the way from start to end at which the smallest margin changes its sign."""

    def along(t: Array) -> Array:
        return jnp.min(_margins(robot, start + t[:, None] * (end - start)), axis=1)

    return bracket.zero(along, at_start, at_end)


def _box(shells: Shells) -> tuple[np.ndarray, np.ndarray]:
    """Returns a rectangle around the body's foot in the plane: (x, y) is linear in the squared lengths."""
    ends = np.stack(np.meshgrid(*np.asarray(shells.radii), indexing="ij"), axis=-1).reshape(-1, 3)
    feet = np.asarray(jax.vmap(lambda lengths: spheres.foot(jnp.asarray(shells.centres), lengths))(jnp.asarray(ends)))
    low = np.maximum(feet.min(axis=0), (shells.centres - np.asarray(shells.high)[:, None]).max(axis=0))
    return low, np.minimum(feet.max(axis=0), (shells.centres + np.asarray(shells.high)[:, None]).min(axis=0))


def _columns(shells: Shells, lattice: tuple[int, int], shift: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the columns that meet the body: place, and its lower and upper end there."""
    step, number = lattice
    index = np.arange(number)
    unit = np.stack([index / number + shift[0], index * step / number + shift[1]], axis=1) % 1.0
    low, high = _box(shells)
    places = low + unit * (high - low)
    far = np.sum((places[:, None] - shells.centres) ** 2, axis=-1)
    bottom = np.maximum((np.asarray(shells.low) ** 2 - far).max(axis=1), 0.0)
    top = (np.asarray(shells.high) ** 2 - far).min(axis=1)
    here = top > bottom
    return places[here], np.sqrt(bottom[here]), np.sqrt(top[here])


def _counted(side: _Side, lattice: tuple[int, int], shift: np.ndarray, cells: int) -> _Count:
    places, bottom, top = _columns(side.shells, lattice, shift)
    if not len(places):
        return _Count(0.0, 0.0, 0.0, np.zeros(side.conditions), np.zeros(side.conditions), 0.0, 0, 0)
    height = _heights(bottom, top, shift[2], cells)
    flat = np.broadcast_to(places, (*height.shape, 2)).reshape(-1, 2)
    poses = np.column_stack([flat, side.plane + side.sign * height.reshape(-1)])
    margins = in_blocks(partial(_margins, side.robot), poses, block=_BLOCK)
    least = margins.min(axis=1).reshape(height.shape)
    cell = np.diff(height, axis=0)
    free = _free_cells(side, poses.reshape(*height.shape, 3), least) * cell
    unmet = _unmet(least > 0, free, cell, (top - bottom) / cells)
    weights = (np.pad(cell, ((0, 1), (0, 0))) + np.pad(cell, ((1, 0), (0, 0)))).reshape(-1) / 2
    broken = (margins <= 0)[:, : side.conditions]
    single = broken & (broken.sum(axis=1) == 1)[:, None]
    return _Count(
        total=float(np.sum(top - bottom)),
        free=float(np.sum(free) + np.sum(unmet)),
        unmet=float(np.sum(np.abs(unmet))),
        violated=weights @ broken,
        alone=weights @ single,
        removed=float(np.sum(weights[broken.any(axis=1)])),
        columns=len(places),
        samples=len(poses),
    )


def _heights(bottom: np.ndarray, top: np.ndarray, shift: float, cells: int) -> np.ndarray:
    """Returns samples ``(cells + 2, columns)``: both ends, and evenly spaced ones that begin elsewhere each time."""
    start = (shift + np.arange(len(bottom)) * _ONWARDS) % 1.0
    inner = (np.arange(cells)[:, None] + start) / cells
    share = np.concatenate([np.zeros((1, len(bottom))), inner, np.ones((1, len(bottom)))])
    return bottom + share * (top - bottom)


def _free_cells(side: _Side, poses: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Returns the free share of every cell ``(cells, columns)``: all, nothing, or up to where the sign changes."""
    free = least > 0
    share = np.where(free[:-1] & free[1:], 1.0, 0.0)
    changes = np.nonzero(free[:-1] != free[1:])
    if len(changes[0]):
        above = (changes[0] + 1, changes[1])
        tiny = np.finfo(float).tiny
        signed = np.where(free, least, np.minimum(least, -tiny))
        columns = (poses[changes], poses[above], signed[changes], signed[above])
        t = in_blocks(partial(_ends, side.robot), *columns, block=_BLOCK)
        share[changes] = np.where(free[changes], t, 1 - t)
    return share


def _unmet(free: np.ndarray, length: np.ndarray, cell: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Returns the free length (removed: negative) of pieces that lie between samples, as those met by one tell of them.

    A piece of length d, shorter than the spacing s, is met by a sample in d / s of all cases, so that each one met
    stands for s / d of them, together s long.

    Args:
        free: ``(n + 1, columns)`` at the samples.
        length: ``(n, columns)`` free length in each cell.
        cell: ``(n, columns)`` their lengths.
        spacing: ``(columns,)`` s.
    """
    alone = (free[:-2] == free[2:]) & (free[1:-1] != free[:-2])
    inside = length[:-1] + length[1:]
    piece = np.where(free[:-2], cell[:-1] + cell[1:] - inside, inside)
    return np.where(alone, np.maximum(spacing - piece, 0.0), 0.0) * np.where(free[:-2], -1.0, 1.0)
