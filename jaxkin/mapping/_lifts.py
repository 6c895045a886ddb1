"""Assembly modes over many joint points, and which of them continue into each other along short straight ways.

Continuation alone may miss a mode, and solving alone does not tell which mode is which. Here both hold each other: the
modes over both ends of a way are solved for, and every one is followed along the way by Newton's method; two are the
same sheet where the one arrives at the other, and no second one does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.branches import stack_lanes
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.kinematics.legs import Legs, working_mode
from jaxkin.kinematics.solve import forward_lanes
from jaxkin.mapping.batch import in_blocks
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.newton import polish
from jaxkin.numerics.small_linalg import any_determinant, pivoted_solve

#: A mode whose determinant, over Hadamard's bound, is smaller counts as singular: it is half of a double pose.
SINGULAR = 1e-6
#: An entry of B, over the largest of its equation's derivatives, below which a leg counts as stretched or folded.
_STRETCHED = 1e-7
#: Dimensionless distance within which a followed mode has arrived at one that was solved for.
_ARRIVED = 1e-7
#: Longest and shortest Newton moves of a good step, dimensionless, and the shortest step (the way is one long).
_FAR, _NEAR, _SHORTEST = 0.2, 1e-8, 1e-6
#: Attempts of a step: halvings towards a fold and back.
_ATTEMPTS = 64


@dataclass(frozen=True, eq=False)
class Modes:
    """The assembly modes over k joint points.

    Attributes:
        joints: ``(k, n_joint)``.
        poses: ``(k, lanes, n_pose)``, angles in one turn; NaN where there is none.
        regular: ``(k, lanes)`` True where there is a pose, and it is not singular.
        sign: ``(k, lanes)`` sign of det dF/dpose.
        size: ``(k, lanes)`` |det| over Hadamard's bound.
        working: ``(k, lanes, n_leg)`` signs of the entries of B, 0 where a leg is stretched; no leg where working
            modes are no signs.
        residual: ``(k, lanes)`` dimensionless.
    """

    joints: np.ndarray
    poses: np.ndarray
    regular: np.ndarray
    sign: np.ndarray
    size: np.ndarray
    working: np.ndarray
    residual: np.ndarray

    def __len__(self) -> int:
        """Number of joint points."""
        return len(self.joints)

    def joined(self, *others: "Modes") -> "Modes":
        """Returns these modes with those over other points behind them."""
        return Modes(*(np.concatenate([vars(part)[name] for part in (self, *others)]) for name in vars(self)))

    def without(self, poses: np.ndarray, robot: Mechanism, distance: float = 1e-5) -> "Modes":
        """Returns the modes with one pose over each point, ``(k, n_pose)``, no longer regular."""
        gaps = glued_gap(robot, self.poses - poses[:, None])
        return Modes(**{**vars(self), "regular": self.regular & ~(gaps < distance)})


def units_of(robot: Mechanism) -> np.ndarray:
    """Returns one unit per pose axis, ``(n_pose,)``."""
    return np.asarray(scale_vector(robot.pose_axes, robot.characteristic_length()))


def glued_gap(robot: Mechanism, difference: np.ndarray) -> np.ndarray:
    """Returns the largest dimensionless entry of differences of poses the short way round; NaN becomes inf."""
    period = np.array([np.inf if axis.period is None else axis.period for axis in robot.pose_axes])
    gap = np.max(np.abs(short_way(difference, period)) / units_of(robot), axis=-1)
    return np.where(np.isnan(gap), np.inf, gap)


def modes_over(robot: Mechanism, legs: Legs | None, joints: np.ndarray, block: int = 512) -> Modes:
    """Solves the forward problem over joint points ``(k, n_joint)`` and polishes every mode."""
    joints = np.asarray(joints, float).reshape(-1, len(robot.joint_axes))
    poses, regular, sign, size, working, residual = in_blocks(partial(_modes, robot, legs), joints, block=block)
    return Modes(joints, poses, regular, sign, size, working.astype(int), residual)


@partial(jax.jit, static_argnums=1)
def _modes(robot: Mechanism, legs: Legs | None, joints: Array) -> tuple[Array, ...]:
    branches = stack_lanes(forward_lanes(robot, tuple(joints[:, k] for k in range(joints.shape[1]))))
    measure = partial(_measured, robot, legs)
    measured = jax.vmap(jax.vmap(measure, in_axes=(0, None)))(branches.values, joints)
    poses, sign, size, working, residual = measured
    # A double pose stands once: the way away from it leads into two modes, so that it continues into neither.
    single = branches.valid & (branches.multiplicity == 1)
    good = single & (residual <= TOLERANCES.residual) & (size > SINGULAR)
    return jnp.where(branches.valid[..., None], poses, jnp.nan), good, sign, size, working, residual


def measured(robot: Mechanism, legs: Legs | None, poses: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, ...]:
    """Measures configurations ``(k, n_pose)``, ``(k, n_joint)`` as ``modes_over`` does its modes.

    Returns:
        Polished poses, signs and sizes of the determinant, working modes, residuals.
    """
    return in_blocks(partial(_measures, robot, legs), poses, joints)


@partial(jax.jit, static_argnums=1)
def _measures(robot: Mechanism, legs: Legs | None, poses: Array, joints: Array) -> tuple[Array, ...]:
    return jax.vmap(partial(_measured, robot, legs))(poses, joints)


def _measured(robot: Mechanism, legs: Legs | None, pose: Array, joints: Array) -> tuple[Array, ...]:
    """Polishes one mode and measures it: pose, sign and size of the determinant, working mode, residual."""
    unit = scale_vector(robot.pose_axes, robot.characteristic_length())
    pose = jnp.where(jnp.isfinite(pose), pose, 0.5 * unit)
    scales = robot.constraint_scales(pose, joints)

    def system(x: Array) -> Array:
        return robot.constraints(x * unit, joints) / scales

    direct = jax.jacfwd(system)(pose / unit)
    value = any_determinant(direct)
    size = jnp.abs(value) / (jnp.prod(jnp.sqrt(jnp.sum(direct**2, axis=1))) + 1e-300)
    polished = polish(system, pose / unit, steps=2, trust=1e-3) * unit
    # Newton's method wanders where the pose is double: such a pose stays as the forward problem gave it.
    pose = jnp.where(size > SINGULAR, polished, pose)
    residual = jnp.max(jnp.abs(robot.constraints(pose, joints) / scales))
    return pose, jnp.sign(value), size, _working(robot, legs, pose, joints), residual


def _working(robot: Mechanism, legs: Legs | None, pose: Array, joints: Array) -> Array:
    if legs is None:
        return jnp.zeros(0)
    length = robot.characteristic_length()
    entries = jax.jacfwd(robot.constraints, argnums=1)(pose, joints) * scale_vector(robot.joint_axes, length)
    rows = jax.jacfwd(robot.constraints)(pose, joints) * scale_vector(robot.pose_axes, length)
    share = [entries[row, k] / (jnp.sqrt(jnp.sum(rows[row] ** 2)) + 1e-300) for k, row in enumerate(legs.rows)]
    return jnp.where(jnp.abs(jnp.stack(share)) > _STRETCHED, working_mode(robot, legs, pose, joints), 0.0)


def continued(
    robot: Mechanism, poses: np.ndarray, starts: np.ndarray, goals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Follows modes along straight ways in joint space.

    Args:
        robot: The mechanism.
        poses: ``(k, n_pose)`` a regular mode over each start.
        starts: ``(k, n_joint)``.
        goals: ``(k, n_joint)``.

    Returns:
        The poses over the goals (angles run on), and which modes arrived: False where the way meets a fold. A step is
        only taken where Newton's method contracts tenfold at once, which it does not between two modes.
    """
    return in_blocks(partial(_continued, robot), poses, starts, goals)


@jax.jit
def _continued(robot: Mechanism, poses: Array, starts: Array, goals: Array) -> tuple[Array, Array]:
    return jax.vmap(partial(_followed, robot))(poses, starts, goals)


def _followed(robot: Mechanism, pose: Array, start: Array, goal: Array) -> tuple[Array, Array]:
    unit = scale_vector(robot.pose_axes, robot.characteristic_length())
    scales = robot.constraint_scales(pose, start)

    def system(x: Array, t: Array) -> Array:
        return robot.constraints(x * unit, start + t * (goal - start)) / scales

    slope = jax.jacfwd(system)

    def corrected(x: Array, t: Array) -> tuple[Array, Array, Array]:
        def body(k: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            x, sizes, _ = carry
            matrix = slope(x, t)
            move = pivoted_solve(matrix, system(x, t))
            return x - move, sizes.at[k].set(jnp.max(jnp.abs(move))), matrix

        return jax.lax.fori_loop(0, 4, body, (x, jnp.zeros(4), jnp.zeros((len(x), len(x)))))

    def attempt(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        k, x, t, step, matrix = carry
        step = jnp.minimum(step, 1.0 - t)
        rate = pivoted_solve(matrix, jax.jvp(lambda t: system(x, t), (t,), (jnp.ones(()),))[1])
        moved, sizes, after = corrected(x - step * rate, t + step)
        good = (sizes[0] < _FAR) & (sizes[1] <= 0.1 * sizes[0] + 1e-10) & (sizes[3] < _NEAR)
        good = good & (any_determinant(after) * any_determinant(matrix) > 0)
        good = good & (step * jnp.max(jnp.abs(rate)) < 4 * _FAR)
        t = jnp.where(good, t + step, t)
        # The last step is shortened so that t lands on 1 exactly.
        t = jnp.where(t > 1 - 1e-12, 1.0, t)
        return (
            k + 1,
            jnp.where(good, moved, x),
            t,
            jnp.where(good, 2 * step, 0.4 * step),
            jnp.where(good, after, matrix),
        )

    def unfinished(carry: tuple[Array, ...]) -> Array:
        return (carry[0] < _ATTEMPTS) & (carry[2] < 1.0) & (carry[3] > _SHORTEST)

    x, zero = pose / unit, jnp.zeros(())
    _, x, t, _, _ = jax.lax.while_loop(unfinished, attempt, (jnp.asarray(0), x, zero, jnp.ones(()), slope(x, zero)))
    return x * unit, t >= 1.0


def linked(robot: Mechanism, modes: Modes, ways: np.ndarray, shifts: np.ndarray | None = None) -> np.ndarray:
    """Follows all regular modes along ways between points.

    Args:
        robot: The mechanism.
        modes: The modes over all points.
        ways: ``(w, 2)`` numbers of the points where each way starts and ends.
        shifts: ``(w, n_joint)`` whole turns by which the end of a way is moved, on glued joints.

    Returns:
        ``(w, lanes)`` the lane at the end into which each lane continues, -1 for none: a fold lies between, or the mode
        at the end is not regular, or two lanes claim it.
    """
    lanes = modes.poses.shape[1]
    links = np.full((len(ways), lanes), -1)
    way, lane = np.nonzero(modes.regular[ways[:, 0]]) if len(ways) else (np.zeros(0, int),) * 2
    if len(way) == 0:
        return links
    start, end = ways[way].T
    goals = modes.joints[end] + (0 if shifts is None else shifts[way])
    poses, arrived = continued(robot, modes.poses[start, lane], modes.joints[start], goals)
    gaps = glued_gap(robot, modes.poses[end] - poses[:, None])
    gaps = np.where(modes.regular[end], gaps, np.inf)
    nearest = np.argmin(gaps, axis=1)
    found = arrived & (gaps[np.arange(len(way)), nearest] < _ARRIVED)
    found &= modes.sign[start, lane] == modes.sign[end, nearest]
    links[way[found], lane[found]] = nearest[found]
    claims = np.zeros((len(ways), lanes), int)
    np.add.at(claims, (way[found], nearest[found]), 1)
    twice = (links >= 0) & (np.take_along_axis(claims, np.maximum(links, 0), axis=1) > 1)
    return np.where(twice, -1, links)


def same_working_mode(modes: Modes, ways: np.ndarray, links: np.ndarray) -> np.ndarray:
    """Returns the links without those whose ends are in different working modes, or where a leg is stretched."""
    if modes.working.shape[-1] == 0 or len(ways) == 0:
        return links
    before = modes.working[ways[:, 0]]
    after = np.take_along_axis(modes.working[ways[:, 1]], np.maximum(links, 0)[..., None], axis=1)
    same = np.all((before == after) & (before != 0), axis=-1)
    return np.where(same, links, -1)


def chains(count: int, followers: dict[int, int]) -> list[tuple[list[int], bool]]:
    """Gathers nodes into runs along a one-to-one successor relation.

    Args:
        count: Number of nodes.
        followers: The successor of every node that has one; no two share one.

    Returns:
        Runs of node numbers with True where the last is followed by the first.
    """
    reached, runs, used = set(followers.values()), list[tuple[list[int], bool]](), set[int]()
    first = [node for node in range(count) if node not in reached]
    for node in (*first, *range(count)):
        if node in used:
            continue
        run = [node]
        used.add(node)
        while run[-1] in followers and followers[run[-1]] not in used:
            run.append(followers[run[-1]])
            used.add(run[-1])
        runs.append((run, followers.get(run[-1]) == run[0] and len(run) > 1))
    return runs


def union(count: int, pairs: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Returns the number of the connected component of each of ``count`` nodes joined by pairs ``(p, 2)``."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    if count == 0:
        return np.zeros(0, int)
    pairs = np.asarray(pairs).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(int)
