"""Makes a path of poses short, smooth and far from singular, by gradients."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array
from scipy.interpolate import CubicSpline

from jaxkin.kinematics.legs import Legs
from jaxkin.mapping._mode_change_terrain import Terrain, ground

#: Poses of a path that are moved, both ends included, and gradient steps.
CONTROLS, _STEPS = 65, 500
#: Largest step of a coordinate, dimensionless, before momentum; the share of a step that stays.
_LONGEST, _MOMENTUM = 0.02, 0.8
#: Share of a step that is made, from the first to the last.
_RATE = optax.cosine_decay_schedule(0.3, _STEPS, 0.02)
#: Weight of bending against length, and of walls that are too near.
_BEND, _WALL = 0.2, 30.0


class Smoothed(NamedTuple):
    """A path that was moved.

    Attributes:
        x: ``(CONTROLS, n)``.
        joints: ``(CONTROLS, n_joint)``.
        holds: True where every pose looked at lies in the aspect.
        cost: What was made small.
    """

    x: Array
    joints: Array
    holds: Array
    cost: Array


def resampled(path: np.ndarray, joints: np.ndarray, count: int = CONTROLS) -> tuple[np.ndarray, np.ndarray]:
    """Returns points at even distances along a polyline, and what belongs to them, interpolated."""
    along = np.concatenate([[0.0], np.cumsum(np.sqrt(np.sum(np.diff(path, axis=0) ** 2, axis=1)))])
    places = np.linspace(0, along[-1], count)
    even = [np.stack([np.interp(places, along, column) for column in a.T], axis=1) for a in (path, joints)]
    even[0][0], even[0][-1] = path[0], path[-1]
    return even[0], even[1]


def _energy(
    terrain: Terrain, legs: Legs | None, care: Array, x: Array, guess: Array
) -> tuple[Array, tuple[Array, Array]]:
    """Returns the energy of a path, the integral of w |dx/dt|^2: short, even, and far from where w is large.

    w = 1 + (care^2 |dx/dq|^2)^2 grows like the inverse fourth power of the clearance, so that no path of finite energy
    goes through a singularity.
    """
    count = x.shape[0] - 1
    middles, between = 0.5 * (x[1:] + x[:-1]), 0.5 * (guess[1:] + guess[:-1])
    # Poses and middles in one go: the terrain is what takes long to compile.
    places, guesses = jnp.concatenate([x, middles]), jnp.concatenate([guess, between])
    at = jax.vmap(lambda p, q: ground(terrain, legs, p, q))(places, guesses)
    steps = jnp.sum((x[1:] - x[:-1]) ** 2, axis=1)
    weight = 1.0 + (care**2 * at.stiffness) ** 2
    here, middle = weight[: count + 1], weight[count + 1 :]
    length = count * jnp.sum(steps * (0.5 * middle + 0.25 * (here[1:] + here[:-1])))
    bend = count**3 * jnp.sum((x[2:] - 2 * x[1:-1] + x[:-2]) ** 2)
    inner = jnp.ones(2 * count + 1, bool).at[jnp.array([0, count])].set(False)
    low, holds = 2 * jnp.mean(at.low), jnp.all(at.open | ~inner)
    return length + _BEND * bend + _WALL * low, (at.joints[: count + 1], holds)


def _stiffness(count: int) -> np.ndarray:
    """Returns the second derivative of length and bending alone in the inner poses, ``(count - 2, count - 2)``."""
    first, second = np.diff(np.eye(count), axis=0), np.diff(np.eye(count), n=2, axis=0)
    whole = 2 * (count - 1) * first.T @ first + 2 * _BEND * (count - 1) ** 3 * second.T @ second
    return whole[1:-1, 1:-1]


@partial(jax.jit, static_argnames="legs")
def smoothed(terrain: Terrain, legs: Legs | None, care: Array, free: Array, x: Array, guess: Array) -> Smoothed:
    """Moves paths with fixed ends, ``(batch, CONTROLS, n)``, and returns the best of each that holds.

    Args:
        terrain: The terrain.
        legs: How the equations hold the joints, or None.
        care: ``(batch,)`` clearance below which poses become dear, one a path.
        free: ``(n,)`` 1 for axes that may move, 0 for fixed ones.
        x: The paths, dimensionless.
        guess: Joints near theirs.
    """
    # Plain gradients of length and bending differ by powers of the number of poses: divided by their second
    # derivative, a step moves the path as a whole.
    stiff = jnp.asarray(_stiffness(x.shape[1]))
    optimiser = optax.chain(
        optax.clip(_LONGEST), optax.trace(_MOMENTUM), optax.scale_by_schedule(_RATE), optax.scale(-1.0)
    )
    inner = jnp.ones(x.shape[1]).at[jnp.array([0, -1])].set(0.0)[:, None] * free

    def one(care: Array, x: Array, guess: Array) -> Smoothed:
        slope = jax.value_and_grad(partial(_energy, terrain, legs, care), has_aux=True)

        def step(_: int, carry: tuple[Array, Array, optax.OptState, Smoothed]) -> tuple:  # type: ignore[type-arg]
            x, guess, state, best = carry
            (cost, (joints, holds)), gradient = slope(x, guess)
            better = (holds & ~best.holds) | ((holds == best.holds) & (cost < best.cost))
            now = Smoothed(x, joints, holds, cost)
            best = jax.tree.map(lambda new, old: jnp.where(better, new, old), now, best)
            # A pose beyond a wall may have no gradient.
            gradient = jnp.where(jnp.isfinite(gradient), gradient, 0.0) * inner
            gradient = gradient.at[1:-1].set(jnp.linalg.solve(stiff, gradient[1:-1]))
            change, state = optimiser.update(gradient, state)
            return x + change * inner, joints, state, best  # type: ignore[operator]

        begun = Smoothed(x, guess, jnp.asarray(False), jnp.asarray(jnp.inf))
        return jax.lax.fori_loop(0, _STEPS, step, (x, guess, optimiser.init(x), begun))[3]

    return jax.vmap(one)(care, x, guess)


def spline(x: np.ndarray, joints: np.ndarray) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Returns the smooth curve through the poses of a path over [0, 1], with joints near its own, interpolated."""
    along = np.concatenate([[0.0], np.cumsum(np.sqrt(np.sum(np.diff(x, axis=0) ** 2, axis=1)))])
    along /= along[-1]
    curve = CubicSpline(along, x, axis=0, bc_type="natural")
    return lambda s: (curve(s), np.stack([np.interp(s, along, column) for column in joints.T], axis=1))
