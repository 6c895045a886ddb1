"""All inverse solutions at the nodes of a lattice of poses, and which of them continuation links."""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.kinematics.jacobian import raw_jacobians
from jaxkin.kinematics.singularity import raw_conditioning
from jaxkin.kinematics.solve import inverse
from jaxkin.mapping.batch import in_blocks
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.small_linalg import any_determinant, pivoted_solve

#: Joints closer than this (dimensionless) are one solution.
_SAME = 1e-6
#: Steps of a continuation, and those of its repetition where the first was refused.
_STEPS, _FINE = 4, 24
#: Last correction of a continuation that converged, and determinants that count as zero, over their scales.
_CONVERGED, _ZERO = 1e-9, 1e-9
#: Where it is least a determinant must exceed so many times the error of linear interpolation between the steps.
_SAFETY = 2.0
#: Lines that one call follows, few ones in smaller calls, and poses that one searches.
_BLOCK, _FEW, _SEARCHED = 2048, 128, 32


@dataclass(frozen=True)
class Rule:
    """What must hold besides regularity; hashable, it is compiled for.

    Attributes:
        limits: True, ``"joints"`` or False, as in ``jk.aspects``.
        clearance: Whether the clearance must exceed a value.
    """

    limits: bool | str
    clearance: bool


@dataclass(frozen=True, eq=False)
class Lattice:
    """Centres of the equal cells of a box over the free pose axes.

    Attributes:
        free: Places of the free pose axes.
        fixed: ``(n_pose,)`` values of the fixed ones.
        low: ``(d,)`` lower corner of the box.
        high: ``(d,)`` upper corner.
        shape: Cells along each axis.
        glued: ``(d,)`` True where the box is one turn of a glued axis.
    """

    free: tuple[int, ...]
    fixed: np.ndarray
    low: np.ndarray
    high: np.ndarray
    shape: tuple[int, ...]
    glued: np.ndarray

    @property
    def size(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.shape))

    @cached_property
    def width(self) -> np.ndarray:
        """``(d,)`` widths of a cell."""
        return (self.high - self.low) / np.array(self.shape)

    def index(self, nodes: np.ndarray) -> np.ndarray:
        """Returns rows of nodes along each axis, ``(k, d)``."""
        return np.stack(np.unravel_index(nodes, self.shape), axis=-1)

    def points(self, nodes: np.ndarray) -> np.ndarray:
        """Returns the free coordinates of nodes, ``(k, d)``."""
        return self.low + (self.index(nodes) + 0.5) * self.width

    def shifted(self, nodes: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Returns the nodes so many rows away, ``(k,)`` for ``by`` of ``(k, d)`` or ``(d,)``; -1 beyond the box."""
        return self._numbered(self.index(nodes) + by)

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Returns the nodes of the cells that hold points ``(k, d)``; -1 outside the box."""
        rows = np.floor((points - self.low) / self.width).astype(int)
        # The upper corner belongs to the last cell.
        last = ~self.glued & (np.abs(points - self.high) <= 1e-12 * (self.high - self.low))
        return self._numbered(np.where(last, np.array(self.shape) - 1, rows))

    def _numbered(self, rows: np.ndarray) -> np.ndarray:
        rows = np.where(self.glued, rows % np.array(self.shape), rows)
        inside = np.all((rows >= 0) & (rows < np.array(self.shape)), axis=-1)
        return np.where(inside, np.ravel_multi_index(tuple(np.where(inside[:, None], rows, 0).T), self.shape), -1)

    def poses(self, points: np.ndarray) -> np.ndarray:
        """Returns the poses at free coordinates ``(k, d)``, ``(k, n_pose)``."""
        poses = np.tile(self.fixed, (len(points), 1))
        poses[:, list(self.free)] = points
        return poses


class Followed(NamedTuple):
    """What continuation along straight lines of poses says, arrays over the lines.

    Attributes:
        joints: ``(k, n_joint)`` at the end, not wrapped.
        reached: Every step converged.
        signs: det A and det B have one sign at all steps, and limits hold.
        sheet: det B keeps its sign, also between the steps as far as second differences tell.
        aspect: So does det A, and limits and clearance hold at all steps.
    """

    joints: np.ndarray
    reached: np.ndarray
    signs: np.ndarray
    sheet: np.ndarray
    aspect: np.ndarray


def follow(problem: "Problem", poses: np.ndarray, joints: np.ndarray, moves: np.ndarray) -> Followed:
    """Follows solutions of poses along straight moves, all ``(k, n)``; what is refused once more in shorter steps."""
    found = _follow(problem, _STEPS, poses, joints, moves)
    again = np.flatnonzero(~(found.reached & found.aspect))
    if len(again):
        finer = _follow(problem, _FINE, poses[again], joints[again], moves[again])
        for before, after in zip(found, finer, strict=True):
            before[again] = after
    return found


def _follow(problem: "Problem", steps: int, poses: np.ndarray, joints: np.ndarray, moves: np.ndarray) -> Followed:
    kernel = partial(_followed, steps, problem.rule, problem.robot, problem.clearance)
    block = _FEW if len(poses) <= 4 * _FEW else _BLOCK
    return Followed(*map(np.array, in_blocks(kernel, poses, joints, moves, block=block)))


@dataclass(frozen=True, eq=False)
class Problem:
    """A mechanism and what must hold in its aspects.

    Attributes:
        robot: The mechanism.
        rule: Which limits count.
        clearance: What the clearance must exceed.
    """

    robot: Mechanism
    rule: Rule
    clearance: float

    @cached_property
    def period(self) -> np.ndarray:
        """``(n_joint,)`` periods of the joints, inf where they have none."""
        return np.array([np.inf if axis.period is None else axis.period for axis in self.robot.joint_axes])

    @cached_property
    def unit(self) -> np.ndarray:
        """``(n_joint,)`` units that make joints dimensionless."""
        return np.asarray(scale_vector(self.robot.joint_axes, self.robot.characteristic_length()))

    def wrapped(self, joints: np.ndarray) -> np.ndarray:
        """Returns joints with glued ones within their intervals."""
        low = np.array([axis.low for axis in self.robot.joint_axes])
        glued = np.isfinite(self.period)
        low = np.where(glued, low, 0.0)
        return np.where(glued, low + (joints - low) % np.where(glued, self.period, 1.0), joints)


def _wrapped(robot: Mechanism, joints: Array) -> Array:
    low = jnp.array([0.0 if axis.period is None else axis.low for axis in robot.joint_axes])
    turn = jnp.array([jnp.inf if axis.period is None else axis.period for axis in robot.joint_axes])
    glued = jnp.isfinite(turn)
    wrapped = low + (joints - low) % jnp.where(glued, turn, 1.0)
    return jnp.where(glued, wrapped, joints)


def _scaled(matrix: Array, unit: Array) -> Array:
    """Returns a determinant over the product of its rows' lengths, in [-1, 1]."""
    rows = matrix * unit[None]
    return any_determinant(rows / (jnp.sqrt(jnp.sum(rows**2, axis=1, keepdims=True)) + 1e-300))


def _allowed(robot: Mechanism, rule: Rule, clearance: Array, pose: Array, joints: Array) -> Array:
    """True where limits and clearance hold; joints given on their way, not wrapped, from within their intervals."""
    limits, inside = robot.limit_values(), _wrapped(robot, joints)
    slack = []
    for k, axis in enumerate(robot.joint_axes):
        if axis.period is None:
            slack += [inside[k] - axis.low, axis.high - inside[k]]
        elif rule.limits:
            # Both ends of a step may be within the limits, and the gap between these at the seam be jumped.
            full = (limits.low[k] <= axis.low + 1e-9) & (limits.high[k] >= axis.high - 1e-9)
            slack.append(jnp.where(full | (joints[k] == inside[k]), 1.0, -1.0))
    if rule.limits:
        slack += [*(inside - limits.low), *(limits.high - inside)]
    if rule.limits is True:
        slack += list(robot.margins(pose, inside).values())
    if rule.clearance:
        slack.append(raw_conditioning(robot, pose, joints).smallest_singular_value - clearance)
    return jnp.all(jnp.stack(slack) >= 0) if slack else jnp.asarray(True)


@partial(jax.jit, static_argnums=(0, 1))
def _followed(
    steps: int, rule: Rule, robot: Mechanism, clearance: Array, poses: Array, joints: Array, moves: Array
) -> tuple[Array, ...]:
    length = robot.characteristic_length()
    pose_unit, unit = scale_vector(robot.pose_axes, length), scale_vector(robot.joint_axes, length)
    ends = jnp.linspace(0.0, 1.0, steps + 1)
    if steps == _FINE:
        # Short steps at both ends: near a fold solutions move like a root of the distance.
        for _ in range(2):
            ends = ends**2 * (3 - 2 * ends)
    parts = jnp.stack([ends[:-1], ends[1:]], axis=1)

    def one(pose: Array, q: Array, move: Array) -> tuple[Array, ...]:
        stride = jnp.max(jnp.abs(move / pose_unit))

        def looked(pose: Array, q: Array) -> tuple[Array, Array, Array]:
            a, b = raw_jacobians(robot, pose, q)
            values = jnp.stack([_scaled(a, pose_unit), _scaled(b, unit)])
            return -pivoted_solve(b, a @ move), values, _allowed(robot, rule, clearance, pose, q)

        def advance(carry: tuple[Array, Array], part: Array) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
            (q, rate), share = carry, part[1] - part[0]
            target, lead = pose + part[1] * move, share * rate

            def correct(_: Array, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
                q, largest, _ = state
                slope, value = jax.jacfwd(lambda q: (robot.constraints(target, q),) * 2, has_aux=True)(q)
                change = pivoted_solve(slope, value)
                size = jnp.max(jnp.abs(change / unit))
                return q - change, jnp.maximum(largest, size), size

            q, largest, last = jax.lax.fori_loop(0, 4, correct, (q + lead, jnp.zeros(()), jnp.zeros(())))
            # A correction as long as the step itself may have led to another solution.
            near = largest <= 0.5 * (jnp.max(jnp.abs(lead / unit)) + share * stride)
            rate, values, allowed = looked(target, q)
            return (q, rate), (near & (last <= _CONVERGED), values, allowed)

        rate, first, allowed = looked(pose, q)
        (q, _), (good, rest, inside) = jax.lax.scan(advance, (q, rate), parts)
        values = jnp.concatenate([first[None], rest])
        same = jnp.all(values * first > 0, axis=0)
        size = jnp.abs(values)
        bend = jnp.abs(size[2:] - 2 * size[1:-1] + size[:-2])
        # Between the steps it is smaller than at them only about a least one: at a fold det B grows like a root, and
        # bends much without coming back.
        least = (size[1:-1] <= size[2:]) & (size[1:-1] <= size[:-2])
        away = jnp.all(~least | (size[1:-1] > _SAFETY * bend / 8), axis=0) & (jnp.min(size, axis=0) > _ZERO)
        reached, inside = jnp.all(good) & jnp.all(jnp.isfinite(q)), allowed & jnp.all(inside)
        kept = same & away & reached
        return q, reached, reached & jnp.all(same) & inside, kept[1], jnp.all(kept) & inside

    return jax.vmap(one)(poses, joints, moves)


class Measured(NamedTuple):
    """Numbers of configurations, arrays over these.

    Attributes:
        determinant: det A.
        scaled: ``(k, 2)`` det A and det B over their scales.
        clearance: Smallest singular value of -B^-1 A, scaled.
        allowed: Limits and clearance hold.
    """

    determinant: np.ndarray
    scaled: np.ndarray
    clearance: np.ndarray
    allowed: np.ndarray

    @property
    def regular(self) -> np.ndarray:
        """True where nothing is singular and all limits hold."""
        return self.allowed & np.all(np.abs(self.scaled) > _ZERO, axis=1)


@partial(jax.jit, static_argnums=0)
def _measured(rule: Rule, robot: Mechanism, clearance: Array, poses: Array, joints: Array) -> tuple[Array, ...]:
    length = robot.characteristic_length()

    def one(pose: Array, q: Array) -> tuple[Array, ...]:
        a, b = raw_jacobians(robot, pose, q)
        found = raw_conditioning(robot, pose, q)
        scaled = [_scaled(m, scale_vector(x, length)) for m, x in ((a, robot.pose_axes), (b, robot.joint_axes))]
        allowed = _allowed(robot, rule, clearance, pose, q)
        return found.determinant, jnp.stack(scaled), found.smallest_singular_value, allowed

    return jax.vmap(one)(poses, joints)


def measured(problem: Problem, poses: np.ndarray, joints: np.ndarray) -> Measured:
    """Returns the numbers of configurations ``(k, n)``."""
    kernel = partial(_measured, problem.rule, problem.robot, problem.clearance)
    return Measured(*in_blocks(kernel, poses, joints, block=_BLOCK))


@jax.jit
def _searched(robot: Mechanism, poses: Array) -> Array:
    return jax.vmap(lambda pose: inverse(robot, pose).values)(poses)


class Solutions:
    """Inverse solutions at the nodes of a lattice, each with a number.

    Attributes:
        lattice: The nodes.
        problem: The mechanism.
        nodes: ``(n,)`` node of each solution.
        joints: ``(n, n_joint)``.
        table: ``(nodes, lanes)`` numbers of the solutions at each node, -1 where there are no more.
    """

    def __init__(self, lattice: Lattice, problem: Problem):
        self.lattice, self.problem = lattice, problem
        self.nodes = np.zeros(0, int)
        self.joints = np.zeros((0, len(problem.robot.joint_axes)))
        self.table = np.full((lattice.size, problem.robot.max_branches), -1)

    def __len__(self) -> int:
        """Number of solutions."""
        return len(self.nodes)

    @property
    def poses(self) -> np.ndarray:
        """``(n, n_pose)`` their poses."""
        return self.lattice.poses(self.lattice.points(self.nodes))

    def match(self, nodes: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Returns the numbers of known solutions at nodes, ``(k,)``; -1 for a new one."""
        if len(self) == 0:
            return np.full(len(nodes), -1)
        known = self.table[nodes]
        gap = short_way(joints[:, None] - self.joints[known], self.problem.period) / self.problem.unit
        same = (known >= 0) & (np.max(np.abs(gap), axis=-1) < _SAME)
        return np.where(same.any(axis=1), known[np.arange(len(nodes)), np.argmax(same, axis=1)], -1)

    def add(self, nodes: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Returns the numbers of solutions, those that are new being added."""
        numbers = self.match(nodes, joints)
        while (rest := np.flatnonzero(numbers < 0)).size:
            # One new solution a node in turn: two candidates of a node may be the same.
            new = rest[np.unique(nodes[rest], return_index=True)[1]]
            lane = np.sum(self.table[nodes[new]] >= 0, axis=1)
            if lane.max() >= self.table.shape[1]:
                self.table = np.concatenate([self.table, np.full_like(self.table, -1)], axis=1)
            numbers[new] = len(self) + np.arange(len(new))
            self.table[nodes[new], lane] = numbers[new]
            self.nodes = np.concatenate([self.nodes, nodes[new]])
            self.joints = np.concatenate([self.joints, self.problem.wrapped(joints[new])])
            left = rest[~np.isin(rest, new)]
            numbers[left] = self.match(nodes[left], joints[left])
        return numbers

    def search(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns all solutions at nodes by search from many starts: their nodes and joints, limits not applied."""
        robot = self.problem.robot
        names = [name for joints in robot.limit_fields().values() for name in joints]
        free = robot.with_limits(**{axis.name: (-np.inf, np.inf) for axis in robot.joint_axes if axis.name in names})
        poses = self.lattice.poses(self.lattice.points(nodes))
        values = in_blocks(partial(_searched, free), poses, block=_SEARCHED)
        row, lane = np.nonzero(np.all(np.isfinite(values), axis=-1))
        return nodes[row], values[row, lane]
