"""The walls between aspects: functions of the pose on one sheet of the inverse kinematics, and what they say of cells.

A sheet is a working mode over the free pose axes; the joints are functions of the pose on it. Its *singular* walls are
the factors of det A that the mechanism declares, or det A itself; its *inner* walls are positive inside: the legs'
discriminants (reality, and det B = 0) and the joint limits, written smoothly (squares against squares, cosines against
cosines). Margins of other kinds (interference, passive joints) and the clearance have kinks: they are *sampled*.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.legs import LegKind, Legs
from jaxkin.kinematics.singularity import raw_conditioning
from jaxkin.numerics.small_linalg import any_determinant, pivoted_solve

#: What a cell can be besides proved regular (its code of signs, not negative).
OUTSIDE, UNDECIDED, SPLIT = -1, -2, -3
#: What may happen in an undecided cell.
REGULAR, FLAT, SEVERAL = 0, 1, 2
#: A sampled wall keeps its sign over a cell where it is so many times larger than its changes to the cell's faces.
_SLACK = 1.25
#: How much faster than the platform (scaled) joints may be before a pose counts as near a serial singularity.
_SERIAL = 4.0
#: Sub-points an axis by which an undecided cell is shared out, by the number of free axes.
_SUBPOINTS = {1: 16, 2: 4, 3: 3}
#: Irrational steps by which they are moved from cell to cell: no plane of cells repeats one place.
_SCATTER = np.sqrt(np.array([[2.0, 3.0, 5.0], [7.0, 11.0, 13.0], [17.0, 19.0, 23.0]]))


class WallData(NamedTuple):
    """The numbers of a sheet, a pytree.

    Attributes:
        robot: The mechanism.
        signs: ``(n_joint,)`` the working mode.
        fixed: ``(n_pose,)`` pose, of which the free axes are not used.
        low: ``(n_joint,)`` lower joint limits.
        high: ``(n_joint,)`` upper ones.
        clearance: Smallest clearance allowed.
    """

    robot: Mechanism
    signs: Array
    fixed: Array
    low: Array
    high: Array
    clearance: Array


@dataclass(frozen=True)
class Walls:
    """Which walls a sheet has; hashable, so that one compilation serves all numbers.

    Attributes:
        legs: How the equations hold the joints.
        free: Places of the free pose axes.
        factors: Names of the declared factors that stand for det A; empty where det A itself does.
        reality: Legs whose discriminant is a wall.
        limits: Joint limits that are walls, ``(joint, 0 low or 1 high)``.
        margins: Names of the sampled margins.
        clearance: True where the clearance is a sampled wall.
        singular: False where singular walls are left out, and only what is inside counts.
    """

    legs: Legs
    free: tuple[int, ...]
    factors: tuple[str, ...]
    reality: tuple[int, ...]
    limits: tuple[tuple[int, int], ...]
    margins: tuple[str, ...] = ()
    clearance: bool = False
    singular: bool = True

    @property
    def n_singular(self) -> int:
        """Number of singular walls."""
        return max(len(self.factors), 1) if self.singular else 0

    @property
    def n_smooth(self) -> int:
        """Number of walls of which Taylor forms are taken."""
        return self.n_singular + len(self.reality) + len(self.limits)

    @property
    def n_sampled(self) -> int:
        """Number of walls that are sampled only."""
        return len(self.margins) + self.clearance

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all walls, in order."""
        ends = ("low", "high")
        return (
            *((self.factors or ("det A",)) if self.singular else ()),
            *(f"reach of leg {k + 1}" for k in self.reality),
            *(f"joint {k + 1} {ends[end]}" for k, end in self.limits),
            *self.margins,
            *(("clearance",) if self.clearance else ()),
        )

    def pose(self, data: WallData, u: Array) -> Array:
        """Returns the whole pose from its free coordinates."""
        n = data.fixed.shape[0]
        return jnp.stack([u[self.free.index(k)] if k in self.free else data.fixed[k] for k in range(n)])

    def joints(self, data: WallData, pose: Array) -> Array:
        """Returns the joints on the sheet by the smooth form of each root."""
        return jnp.stack([_joint(self, data, pose, k) for k in range(len(self.legs.rows))])

    def smooth(self, data: WallData, u: Array) -> Array:
        """Returns the singular walls, then the inner ones, ``(n_smooth,)``."""
        pose = self.pose(data, u)
        inner = [_discriminant(self, data, pose, k) for k in self.reality]
        limits = [_limit(self, data, pose, *which) for which in self.limits]
        return jnp.stack([*self.singular_values(data, pose), *inner, *limits])

    def singular_values(self, data: WallData, pose: Array) -> list[Array]:
        """Returns the singular walls."""
        if self.singular and self.factors:
            declared: dict[str, Array] = data.robot.factors(pose)  # type: ignore[attr-defined]
            return [declared[name] for name in self.factors]
        return [self.determinant(data, pose)] if self.singular else []

    def determinant(self, data: WallData, pose: Array) -> Array:
        """Returns det A on the sheet."""
        joints = self.joints(data, pose)
        return any_determinant(jax.jacfwd(data.robot.constraints)(pose, joints))

    def sampled(self, data: WallData, u: Array) -> Array:
        """Returns the walls that are sampled only, ``(n_sampled,)``."""
        pose = self.pose(data, u)
        joints = self.joints(data, pose)
        margins = data.robot.margins(pose, joints) if self.margins else {}
        parts = [jnp.asarray(margins[name]) for name in self.margins]
        if self.clearance:
            parts.append(raw_conditioning(data.robot, pose, joints).smallest_singular_value - data.clearance)
        return jnp.stack(parts)

    def all(self, data: WallData, u: Array) -> Array:
        """Returns all walls at a point, ``(n_smooth + n_sampled,)``."""
        smooth = self.smooth(data, u)
        return jnp.concatenate([smooth, self.sampled(data, u)]) if self.n_sampled else smooth


def _row(walls: Walls, data: WallData, pose: Array, k: int) -> tuple[Array, Array, Array]:
    """Returns value, first and second derivative of leg k's equation in its joint, at zero."""
    row, zeros = walls.legs.rows[k], jnp.zeros(len(walls.legs.rows))

    def along(v: Array) -> Array:
        return data.robot.constraints(pose, zeros.at[k].set(v))[row]

    def slope(v: Array) -> tuple[Array, Array]:
        return jax.jvp(along, (v,), (jnp.ones(()),))

    (f, first), (_, second) = jax.jvp(slope, (jnp.zeros(()),), (jnp.ones(()),))
    return f, first, second


def _discriminant(walls: Walls, data: WallData, pose: Array, k: int) -> Array:
    """Returns what is positive where leg k reaches: of a linear leg its coefficient with the sign of the mode."""
    f, first, second = _row(walls, data, pose, k)
    kind = walls.legs.kinds[k]
    if kind == LegKind.LINEAR:
        return data.signs[k] * first
    if kind == LegKind.QUADRATIC:
        return first * first - 2 * second * f
    return first * first - f * (f + 2 * second)


def _joint(walls: Walls, data: WallData, pose: Array, k: int) -> Array:
    f, first, second = _row(walls, data, pose, k)
    kind = walls.legs.kinds[k]
    if kind == LegKind.LINEAR:
        return -f / first
    size = data.signs[k] * jnp.sqrt(_discriminant(walls, data, pose, k))
    if kind == LegKind.QUADRATIC:
        # Smooth on the sheet; the form without cancellation would change over where ``first`` vanishes.
        return (size - first) / second
    constant = f + second
    return jnp.arctan2(-constant * first + size * second, constant * second + size * first)


def _limit(walls: Walls, data: WallData, pose: Array, k: int, end: int) -> Array:
    """Returns a smooth function with the sign of q_k - low or high - q_k."""
    f, first, second = _row(walls, data, pose, k)
    kind, bound, side = walls.legs.kinds[k], (data.low, data.high)[end][k], 1.0 - 2.0 * end
    if kind == LegKind.LINEAR:
        return side * (-f / first - bound)
    discriminant = _discriminant(walls, data, pose, k)
    if kind == LegKind.QUADRATIC:
        # With t = q - vertex and l = bound - vertex: t > l where t |t| > l |l|.
        beyond = bound + first / second
        return side * (data.signs[k] * discriminant / (second * jnp.abs(second)) - beyond * jnp.abs(beyond))
    middle, half = 0.5 * (data.high[k] + data.low[k]), 0.5 * (data.high[k] - data.low[k])
    size, constant = data.signs[k] * jnp.sqrt(discriminant), f + second
    x, y = constant * second + size * first, -constant * first + size * second
    return (x * jnp.cos(middle) + y * jnp.sin(middle)) / (first * first + second * second) - jnp.cos(half)


def _features(walls: Walls, data: WallData, u: Array, half: Array) -> tuple[Array, Array, Array]:
    """Returns walls ``(W,)``, their slopes over half a cell ``(W, d)``, and how far sampled ones change ``(W_s,)``."""
    both = jax.jacfwd(lambda u: (walls.smooth(data, u),) * 2, has_aux=True)
    slope, value = both(u)
    slope = slope * half[None]
    if not walls.n_sampled:
        return value, slope, jnp.zeros(0)
    d = len(walls.free)
    moves = jnp.concatenate([jnp.zeros((1, d)), jnp.eye(d), -jnp.eye(d)]) * half[None]
    around = jax.vmap(lambda move: walls.sampled(data, u + move))(moves)
    middle, above, below = around[0], around[1 : d + 1], around[d + 1 :]
    change = jnp.sum(jnp.maximum(jnp.abs(above - middle), jnp.abs(below - middle)), axis=0)
    return jnp.concatenate([value, middle]), jnp.concatenate([slope, 0.5 * (above - below).T]), change


def _judged(walls: Walls, data: WallData, u: Array, half: Array, remainder: Array, tiny: Array) -> tuple[Array, ...]:
    value, slope, change = _features(walls, data, u, half)
    n = walls.n_smooth
    spread = jnp.sum(jnp.abs(slope[:n]), axis=1)
    bound = jnp.concatenate([spread + remainder, _SLACK * change]) + tiny
    sure = jnp.abs(value) > bound
    inner = jnp.arange(len(value)) >= walls.n_singular
    outside = jnp.any(inner & sure & (value < 0))
    proved = jnp.all(sure)
    code = code_of(walls, value)
    status = jnp.where(outside, OUTSIDE, jnp.where(proved, code, UNDECIDED)).astype(jnp.int8)
    # Decided but for second derivatives; and so loosely that children, of a quarter of the bound, would not be either.
    spare = jnp.abs(value[:n]) - spread - tiny[:n]
    could = (status == UNDECIDED) & jnp.all(sure[:n] | (spare > 0))
    loose = jnp.where(could, jnp.where(jnp.any(~sure[:n] & ~(remainder < 4 * spare)), 2, 1), 0).astype(jnp.int8)
    # The gradient is nowhere zero where one slope exceeds what second derivatives can take from it.
    bent = ~(jnp.max(jnp.abs(slope[:n]), axis=1) > 2 * remainder)
    flat = jnp.any(~sure[: walls.n_singular] & bent[: walls.n_singular])
    kind = jnp.where(jnp.sum(~sure) > 1, SEVERAL, jnp.where(flat, FLAT, REGULAR)).astype(jnp.int8)
    return status, loose, kind


def code_of(walls: Walls, value: Array) -> Array:
    """Returns the signs of the singular walls as the bits of a number, 1 for a negative one."""
    return sum((jnp.where(value[..., j] < 0, 1 << j, 0) for j in range(walls.n_singular)), start=jnp.zeros((), int))


@partial(jax.jit, static_argnames="walls")
def judged_cells(
    walls: Walls, data: WallData, low: Array, width: Array, tiny: Array, index: Array, remainder: Array
) -> tuple[Array, ...]:
    """Judges cells: their status, where enclosures are too loose, and where a wall may be critical.

    Args:
        walls: Structure of the sheet.
        data: Its numbers.
        low: ``(d,)`` lower corner of the box.
        width: ``(d,)`` size of a cell.
        tiny: ``(W,)`` what of each wall is rounding.
        index: ``(k, d)`` places of the cells.
        remainder: ``(k, n_smooth)`` bounds of second-order remainders over the cells.

    Returns:
        ``(k,)`` each: int8 code of signs where all walls are proved to keep theirs, else OUTSIDE or UNDECIDED; int8,
        where tighter bounds could decide an undecided cell 1, and 2 where its children would need them as well; and
        int8 REGULAR where one wall is undecided, FLAT where it is a singular one whose gradient may vanish, SEVERAL
        where several are undecided.
    """
    centres = low + (index + 0.5) * width
    return jax.vmap(lambda u, r: _judged(walls, data, u, 0.5 * width, r, tiny))(centres, remainder)


@partial(jax.jit, static_argnames=("walls", "exact", "scatter"))
def shared_cells(
    walls: Walls, data: WallData, low: Array, width: Array, index: Array, exact: bool, scatter: bool = False
) -> Array:
    """Returns the share of each code in each cell at sub-points, ``(k, 2^n_singular)``; no more than 1 together.

    By linear forms about the centre, or exactly, which takes so many times as long as there are sub-points. A linear
    form that is not finite gives NaN. Scattered sub-points lie elsewhere in every cell: along a wall parallel to the
    cells the errors of the others are all one.
    """
    d = len(walls.free)
    count = _SUBPOINTS[d]
    steps = (np.arange(count) + 0.5) * (2 / count) - 1
    points = jnp.asarray(np.stack(np.meshgrid(*[steps] * d, indexing="ij"), axis=-1).reshape(-1, d))

    def one(u: Array, place: Array) -> Array:
        move = (2 / count) * (jnp.sum(_SCATTER[:d, :d] * place, axis=1) % 1.0 - 0.5)
        there = points + move if scatter else points
        if exact:
            values = jax.vmap(lambda v: walls.all(data, u + v))(there * (0.5 * width))
        else:
            value, slope, _ = _features(walls, data, u, 0.5 * width)
            values = value[None] + there @ slope.T
        inside = jnp.all(values[:, walls.n_singular :] > 0, axis=1)
        codes = jnp.where(inside, code_of(walls, values), -1)
        shares = jnp.stack([jnp.mean(codes == code, dtype=float) for code in range(1 << walls.n_singular)])
        return shares if exact else shares + 0 * jnp.sum(values)

    return jax.vmap(one)(low + (index + 0.5) * width, index)


@partial(jax.jit, static_argnames="walls")
def point_codes(walls: Walls, data: WallData, points: Array) -> Array:
    """Returns the code at points ``(k, d)``, OUTSIDE where an inner wall is not positive (or undefined)."""

    def one(u: Array) -> Array:
        value = walls.all(data, u)
        inside = jnp.all(value[walls.n_singular :] > 0)
        return jnp.where(inside & jnp.all(jnp.isfinite(value)), code_of(walls, value), OUTSIDE)

    return jax.vmap(one)(points)


@partial(jax.jit, static_argnames="walls")
def measured_points(walls: Walls, data: WallData, points: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Returns poses, joints, clearance, det A and depth at points ``(k, d)`` of the sheet.

    The depth is the clearance, or some times the smallest singular value of dx/dq where that is smaller: the clearance
    alone has no maximum, as it is infinite where all legs are stretched.
    """

    def one(u: Array) -> tuple[Array, Array, Array, Array, Array]:
        pose = walls.pose(data, u)
        joints = walls.joints(data, pose)
        measures = raw_conditioning(data.robot, pose, joints)
        clearance = measures.smallest_singular_value
        serial = _SERIAL * measures.inverse_condition_number / clearance
        # No ``jnp.minimum`` (equal, also for NaN): under jaxlib 0.12 LLVM's vectoriser takes exponentially long over
        # what leads to it.
        depth = jnp.where(clearance < serial, clearance, serial)
        return pose, joints, clearance, measures.determinant, depth

    return jax.vmap(one)(points)


@partial(jax.jit, static_argnames="walls")
def critical_points(walls: Walls, data: WallData, starts: Array, which: Array, width: Array) -> tuple[Array, ...]:
    """Seeks critical points of singular walls by Newton's method.

    Args:
        walls: Structure of the sheet.
        data: Its numbers.
        starts: ``(k, d)``.
        which: ``(k,)`` which wall.
        width: ``(d,)`` longest step.

    Returns:
        Points ``(k, d)``, the walls there ``(k,)``, their slopes over a width ``(k,)``, and where it is an extremum.
    """

    def one(start: Array, number: Array) -> tuple[Array, ...]:
        def wall(v: Array) -> Array:
            return jnp.stack(walls.singular_values(data, walls.pose(data, start + v * width)))[number]

        def both(v: Array) -> tuple[Array, tuple[Array, Array]]:
            value, slope = jax.value_and_grad(wall)(v)
            return slope, (value, slope)

        curved = jax.jacfwd(both, has_aux=True)

        # The function stands in the loop only: it is what takes long to compile.
        def step(_: int, carry: tuple[Array, ...]) -> tuple[Array, ...]:
            v = carry[1]
            bend, (value, slope) = curved(v)
            move = pivoted_solve(bend, slope)
            return v, v - move * jnp.minimum(1.0, 1.0 / (jnp.max(jnp.abs(move)) + 1e-300)), value, slope, bend

        zero = jnp.zeros_like(start)
        first = zero, zero, jnp.zeros(()), zero, jnp.zeros((len(start), len(start)))
        v, _, value, slope, bend = jax.lax.fori_loop(0, 13, step, first)
        bends = jnp.linalg.eigvalsh(jnp.where(jnp.isfinite(bend), bend, 0.0))
        return start + v * width, value, jnp.max(jnp.abs(slope)), jnp.all(bends > 0) | jnp.all(bends < 0)

    return jax.vmap(one)(starts, which)


def seam_flips(
    walls: Walls, data: WallData, low: np.ndarray, high: np.ndarray, period: np.ndarray
) -> np.ndarray | None:
    """Returns for each glued axis which singular walls change sign over its seam, as bits, ``(d,)``.

    A factor need not have the period of the constraints: f1 and f2 of the analytic 3-RPR both change sign.

    Returns:
        None where factors are neither equal nor opposite after a turn: det A has to stand for them.
    """
    rng = np.random.default_rng(7)
    points = low + (high - low) * rng.random((24, len(low)))
    values = np.asarray(smooth_values(walls, data, points))[:, : walls.n_singular]
    size, flips = np.nanmax(np.abs(values), axis=0, initial=0.0), np.zeros(len(low), int)
    for k in np.flatnonzero(np.isfinite(period)):
        turned = points.copy()
        turned[:, k] += period[k]
        after = np.asarray(smooth_values(walls, data, turned))[:, : walls.n_singular]
        for j in range(walls.n_singular):
            good = np.isfinite(values[:, j]) & np.isfinite(after[:, j])
            same, opposite = (
                np.all(np.abs(after[good, j] - s * values[good, j]) <= 1e-9 * size[j]) for s in (1.0, -1.0)
            )
            if not same and not opposite:
                return None
            flips[k] |= 0 if same else 1 << j
    return flips


@partial(jax.jit, static_argnames="walls")
def smooth_values(walls: Walls, data: WallData, points: Array) -> Array:
    """Returns the smooth walls at points ``(k, d)``."""
    return jax.vmap(lambda u: walls.smooth(data, u))(points)


@partial(jax.jit, static_argnames="walls")
def all_values(walls: Walls, data: WallData, points: Array) -> Array:
    """Returns all walls at points ``(k, d)``."""
    return jax.vmap(lambda u: walls.all(data, u))(points)
