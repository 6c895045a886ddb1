"""Many configurations at once, given as arrays: what tables and files are made from."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.branches import Branches, stack_lanes
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.jacobian import raw_jacobians
from jaxkin.kinematics.solve import forward_lanes, inverse_lanes
from jaxkin.numerics.small_linalg import any_determinant


def solve_table(robot: Mechanism, rows: ArrayLike, *, forward: bool) -> tuple[Branches, Array]:
    """Solves the forward or inverse problem of every row, by the elementwise kernels.

    Args:
        robot: The mechanism.
        rows: ``(n, n_axis)`` joints (forward) or poses (inverse).
        forward: Which problem.

    Returns:
        ``Branches`` with a leading axis n, and the direct determinant of every branch ``(n, n_branch)``, NaN where
        there is no solution. Unlike ``jk.forward`` it carries no derivatives.
    """
    return _solve_table(robot, jnp.asarray(rows, float), forward)


def _solve(robot: Mechanism, rows: Array, forward: bool) -> tuple[Branches, Array]:
    given = tuple(rows[:, k] for k in range(rows.shape[1]))
    branches = stack_lanes((forward_lanes if forward else inverse_lanes)(robot, given))

    def determinant(row: Array, solution: Array, here: Array) -> Array:
        pose, joints = (solution, row) if forward else (row, solution)
        return jnp.where(here, any_determinant(raw_jacobians(robot, pose, joints).direct), jnp.nan)

    per_branch = jax.vmap(determinant, in_axes=(None, 0, 0))
    return branches, jax.vmap(per_branch)(rows, branches.values, branches.valid)


def violated_margins(robot: Mechanism, poses: ArrayLike, joints: ArrayLike) -> list[list[str]]:
    """Returns for each of n configurations, ``(n, n_pose)`` and ``(n, n_joint)``, the names of its negative margins."""
    margins = robot.margins(jnp.asarray(poses, float), jnp.asarray(joints, float))
    negative = {name: np.atleast_1d(np.asarray(margin) < 0) for name, margin in margins.items()}
    return [[name for name, where in negative.items() if where[k]] for k in range(len(np.asarray(poses)))]


_solve_table = jax.jit(_solve, static_argnames="forward")
