"""The ground of a mode change: poses with the joints of one working mode, and what must not vanish there.

Poses are dimensionless (lengths over the characteristic length).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.kinematics.legs import Legs, leg_discriminants, leg_joints, working_mode
from jaxkin.kinematics.singularity import raw_conditioning
from jaxkin.mapping.batch import in_blocks
from jaxkin.mapping.chart import tells_factors
from jaxkin.numerics.implicit import solve_linear
from jaxkin.numerics.small_linalg import any_determinant, pivoted_solve

#: Limits (over the characteristic length, or rad) and squared entries of B (over those at the start) should stay above.
_KEEP, _LEAST = 0.02, 1e-3


class Terrain(NamedTuple):
    """A robot in one working mode, a pytree.

    Attributes:
        robot: The mechanism.
        mode: ``(n_joint,)`` signs of the legs; the sign of det B alone where legs have none, ``(1,)``.
        wanted: ``(k,)`` signs of what must not vanish: of det A, or of the mechanism's factors.
        wall_unit: ``(w,)`` unit of each wall: squared entries of B, then margins.
        keep: ``(w,)`` how far from each wall a path should stay.
        pose_unit: ``(n_pose,)``.
        joint_unit: ``(n_joint,)``.
    """

    robot: Mechanism
    mode: Array
    wanted: Array
    wall_unit: Array
    keep: Array
    pose_unit: Array
    joint_unit: Array


class Ground(NamedTuple):
    """What a terrain is at a pose.

    Attributes:
        joints: ``(n_joint,)``.
        open: True where the pose belongs to the working mode, within all limits, with the wanted signs.
        stiffness: Squared Frobenius norm of dx/dq = -A^-1 B, dimensionless: about one over the clearance squared.
        low: How far too near to its walls it is: 0 where it keeps its distance.
    """

    joints: Array
    open: Array
    stiffness: Array
    low: Array


def invariants(robot: Mechanism, pose: Array, joints: Array) -> Array:
    """Returns what vanishes exactly at the singularities of an aspect's border, ``(k,)``: det A, or its factors.

    Where a mechanism tells its own singularities from those of its angles, det A vanishes at the latter too.
    """
    if tells_factors(robot):
        return jnp.stack(list(robot.factors(pose).values()))  # type: ignore[attr-defined]
    return any_determinant(jax.jacfwd(robot.constraints)(pose, joints))[None]


@partial(jax.jit, static_argnames="legs")
def _character(robot: Mechanism, legs: Legs | None, pose: Array, joints: Array) -> tuple[Array, Array]:
    if legs is not None:
        mode = working_mode(robot, legs, pose, joints)
    else:
        mode = jnp.sign(any_determinant(jax.jacfwd(robot.constraints, argnums=1)(pose, joints)))[None]
    return mode, jnp.sign(invariants(robot, pose, joints))


def character(
    robot: Mechanism, legs: Legs | None, pose: np.ndarray, joints: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the working mode of a configuration (signs of the legs, or of det B), and the signs of its invariants."""
    mode, signs = _character(robot, legs, jnp.asarray(pose), jnp.asarray(joints))
    return np.asarray(mode), np.asarray(signs)


def single_valued(robot: Mechanism, legs: Legs | None, start: np.ndarray, joints: np.ndarray) -> bool:
    """True where no invariant changes its sign over a turn of a glued angle, so that its sign is that of the aspect."""
    before = character(robot, legs, start, joints)[1]
    for k, axis in enumerate(robot.pose_axes):
        turn = 2 * np.pi if axis.name in robot.covered else axis.period
        if turn is not None:
            turned = np.array(start, float)
            turned[k] += turn
            if np.any(character(robot, legs, turned, joints)[1] != before):
                return False
    return True


def _walls(terrain: Terrain, legs: Legs | None, pose: Array, joints: Array) -> Array:
    """Returns what must stay positive: squared entries of B (or det B with its sign), and margins, in own units."""
    if legs is None:
        inverse = jax.jacfwd(terrain.robot.constraints, argnums=1)(pose, joints)
        reach = any_determinant(inverse)[None] * terrain.mode
    else:
        reach = leg_discriminants(terrain.robot, legs, pose)
    return jnp.concatenate([reach, jnp.stack(list(terrain.robot.margins(pose, joints).values()))])


def joints_of(terrain: Terrain, legs: Legs | None, x: Array, guess: Array) -> Array:
    """Returns the joints of a pose in the working mode, ``(n_joint,)``: in closed form, or from a guess."""
    robot, pose = terrain.robot, x * terrain.pose_unit
    if legs is not None:
        return leg_joints(robot, legs, terrain.mode, pose)

    def closer(_: int, q: Array) -> Array:
        here = jax.lax.stop_gradient(pose)
        slope = jax.jacfwd(robot.constraints, argnums=1)(here, q)
        return q - pivoted_solve(slope, robot.constraints(here, q))

    q = jax.lax.stop_gradient(jax.lax.fori_loop(0, 6, closer, guess))
    # One more step carries the derivative with respect to the pose.
    slope = jax.lax.stop_gradient(jax.jacfwd(robot.constraints, argnums=1)(pose, q))
    return q - pivoted_solve(slope, robot.constraints(pose, q))


def ground(terrain: Terrain, legs: Legs | None, x: Array, guess: Array) -> Ground:
    """Returns what the terrain is at a pose; differentiable inside the terrain."""
    robot, pose = terrain.robot, x * terrain.pose_unit
    joints = joints_of(terrain, legs, x, guess)
    direct, inverse = jax.jacfwd(robot.constraints, argnums=(0, 1))(pose, joints)
    inverse = inverse * terrain.joint_unit
    rates = jax.vmap(lambda column: solve_linear(direct * terrain.pose_unit, column), in_axes=1, out_axes=1)(inverse)
    walls = _walls(terrain, legs, pose, joints) / terrain.wall_unit
    signs = invariants(robot, pose, joints) * terrain.wanted
    closed = jnp.max(jnp.abs(robot.constraints(pose, joints))) < 1e-6 * jnp.max(jnp.abs(direct * terrain.pose_unit))
    # A wall of a pose that touches it at an end of the path is at zero there, up to rounding.
    good = jnp.all(signs > 0) & jnp.all(walls >= -1e-12) & closed
    low = jnp.sum(jnp.maximum(1.0 - walls / terrain.keep, 0.0) ** 2)
    return Ground(joints, good, jnp.sum(rates * rates), low)


@partial(jax.jit, static_argnames="legs")
def _grounds(terrain: Terrain, legs: Legs | None, x: Array, guess: Array) -> Ground:
    return jax.vmap(lambda x, q: ground(terrain, legs, x, q))(x, guess)


def grounds(terrain: Terrain, legs: Legs | None, x: np.ndarray, guess: np.ndarray | None = None) -> Ground:
    """Returns the terrain at many poses, as NumPy arrays; guesses are only needed where legs are None."""
    guess = np.zeros((len(x), len(terrain.robot.joint_axes))) if guess is None else guess
    return in_blocks(partial(_grounds, terrain, legs), x, guess, block=1024 if len(x) <= 1024 else 8192)


@jax.jit
def _radii(terrain: Terrain, x: Array, joints: Array) -> Array:
    def one(x: Array, q: Array) -> Array:
        def closure(x: Array) -> Array:
            return terrain.robot.constraints(x * terrain.pose_unit, q)

        slope = jax.jacfwd(closure)
        direct, bends = slope(x), jax.jacfwd(slope)(x)
        n = len(x)
        turned = jax.vmap(lambda b: solve_linear(direct, b), in_axes=1, out_axes=1)(bends.reshape(n, n * n))
        return 1.0 / (jnp.sqrt(jnp.sum(turned * turned)) + 1e-300)

    return jax.vmap(one)(x, joints)


def radii(terrain: Terrain, x: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Returns how far from each pose dF/dpose stays regular with the joints held, ``(k,)``, as 1 / |A^-1 F_xx| says.

    Exact where second derivatives are constant, a measure of the distance elsewhere; joints enter A in few mechanisms.
    """
    return in_blocks(partial(_radii, terrain), x, joints, block=1024 if len(x) <= 1024 else 8192)


@jax.jit
def _clearances(robot: Mechanism, poses: Array, joints: Array) -> Array:
    return jax.vmap(lambda x, q: raw_conditioning(robot, x, q).smallest_singular_value)(poses, joints)


def clearances(robot: Mechanism, poses: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Returns the smallest singular value of dq/dx at many configurations, ``(k,)``."""
    found = in_blocks(partial(_clearances, robot), poses, joints, block=1024)
    return np.where(np.isnan(found), np.inf, found)


_walls_there = jax.jit(_walls, static_argnames="legs")


def terrain_of(robot: Mechanism, legs: Legs | None, ends: np.ndarray, joints: np.ndarray) -> Terrain:
    """Returns the terrain of the first of two poses over the same joints, ``(2, n_pose)``, in their own units."""
    length = robot.characteristic_length()
    mode, signs = character(robot, legs, ends[0], joints)
    names = list(robot.margins(jnp.asarray(ends[0]), jnp.asarray(joints)))
    units = [1.0 if robot.margin_unit(name) == "rad" else float(length) for name in names]
    reach = 1 if legs is None else len(robot.joint_axes)
    bare = Terrain(
        robot=robot,
        mode=jnp.asarray(mode),
        wanted=jnp.asarray(signs),
        wall_unit=jnp.ones(reach + len(names)),
        keep=jnp.ones(reach + len(names)),
        pose_unit=scale_vector(robot.pose_axes, length),
        joint_unit=scale_vector(robot.joint_axes, length),
    )
    walls = np.stack([np.asarray(_walls_there(bare, legs, jnp.asarray(x), jnp.asarray(joints))) for x in ends])
    unit = np.concatenate([np.abs(walls[0, :reach]) + 1e-300, units])
    keep = np.clip(0.5 * np.min(walls / unit, axis=0), _LEAST, _KEEP)
    return bare._replace(wall_unit=jnp.asarray(unit), keep=jnp.asarray(keep))
