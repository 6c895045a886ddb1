"""Mechanisms, random geometries and poses near every kind of trouble, shared by the tests."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from oracles import rpr3_exact

import jaxkin as jk
from jaxkin.mechanisms import rpr3

#: Wenger and Chablat 2009, the example of the figures.
EXAMPLE = (1.0, 0.0, 1.0)

#: Geometry of Innocenti and Parenti-Castelli 1998: base (0, 0), (15.91, 0), (0, 10), sides 17.04, 16.54, 20.84;
#: poses at these legs and det dF/dpose there, computed in 50 digits.
REFERENCE_JOINTS = (14.98, 15.38, 12.0)
REFERENCE_POSES = np.array(
    [
        (-8.7265953318629088, 12.175669752170042, -0.98697423784544515),
        (-5.4956608154528646, -13.935498276039359, -0.047331369366917773),
        (-14.896128100172762, 1.5829616619626078, 0.24530953099162642),
        (-13.419939013974376, -6.6562479567101796, 0.58567278325855305),
        (14.920133247154399, -1.3379177430462295, 1.0020385399022499),
        (14.673943655735036, -3.0126031249259319, 2.1329043650891289),
    ]
)
REFERENCE_DETERMINANTS = np.array([-233267.66, 295881.28, 76183.82, -78768.95, -367898.55, 313034.17])

Robot = rpr3.AnalyticRPR3 | rpr3.GeneralRPR3


@jk.mechanism
class TwoSliders(jk.Mechanism):
    """A planar 2-PRR: two carriages on the x axis carry the pose (x, y) on rods of two lengths.

    Forward: the joints u1, u2 give the two points where two circles meet. Inverse: each carriage has two places.
    """

    id = "two-sliders"
    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.Axis("u1", "length"), jk.Axis("u2", "length"))

    first: Array
    second: Array

    def constraints(self, pose: Array, joints: Array) -> Array:
        x, y = pose[0], pose[1]
        return jnp.stack(
            [
                (x - joints[0]) ** 2 + y**2 - self.first**2,
                (x - joints[1]) ** 2 + y**2 - self.second**2,
            ]
        )

    def characteristic_length(self) -> Array:
        return self.first


@jk.mechanism
class FiveBar(jk.Mechanism):
    """A planar RR-RRR five-bar: two cranks about (0, 0) and (base, 0), two couplers to the pose (x, y)."""

    id = "five-bar"
    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.angle("theta1"), jk.angle("theta2"))

    base: Array
    crank: Array
    coupler: Array

    def constraints(self, pose: Array, joints: Array) -> Array:
        x, y = pose[0], pose[1]
        dx = jnp.stack([x - self.crank * jnp.cos(joints[0]), x - self.base - self.crank * jnp.cos(joints[1])])
        dy = y - self.crank * jnp.sin(joints)
        return dx**2 + dy**2 - self.coupler**2

    def characteristic_length(self) -> Array:
        return self.crank


def random_analytic(rng: np.random.Generator, n: int) -> np.ndarray:
    """Returns geometries (c2, c3, d3), ``(n, 3)``, of either sign."""
    signs = rng.choice([-1.0, 1.0], (2, n))
    return np.stack([signs[0] * rng.uniform(0.3, 2, n), rng.uniform(-2, 2, n), signs[1] * rng.uniform(0.3, 2, n)], 1)


def random_general(rng: np.random.Generator, n: int) -> np.ndarray:
    """Returns geometries (c2, c3, d3, l2, l3, beta), ``(n, 6)``."""
    low, high = np.array([0.4, -2, 0.3, 0.4, 0.4, -np.pi]), np.array([2, 2, 2, 2, 2, np.pi])
    return rng.uniform(low, high, (n, 6))


def random_poses(rng: np.random.Generator, n: int, size: float = 2.0) -> np.ndarray:
    """Returns poses ``(n, 3)``."""
    return np.concatenate([rng.uniform(-size, size, (n, 2)), rng.uniform(-np.pi, np.pi, (n, 1))], axis=1)


def build(geometry: np.ndarray) -> Robot:
    """Returns one robot, or a batch of robots, of the family that has so many parameters."""
    columns = list(np.moveaxis(np.asarray(geometry, float), -1, 0))
    return rpr3.analytic(*columns) if len(columns) == 3 else rpr3.general(*columns)


forward_batch: Callable[..., jk.Branches] = jax.jit(jax.vmap(jk.forward))
inverse_batch: Callable[..., jk.Branches] = jax.jit(jax.vmap(jk.inverse))


def legs(robot: Robot, poses: np.ndarray) -> np.ndarray:
    """Returns the joints of poses of a batch of robots, ``(n, 3)``."""
    return np.array(inverse_batch(robot, jnp.asarray(poses)).values[:, 0])


def direct_determinant(robot: Robot, pose: Array) -> Array:
    """Returns det dF/dpose, from the constraints alone."""
    return jnp.linalg.det(jax.jacfwd(robot.constraints)(pose, jnp.zeros(3)))


@jax.jit
def _bisected(robot: Robot, start: Array, end: Array) -> tuple[Array, Array]:
    def one(robot: Robot, start: Array, end: Array) -> tuple[Array, Array]:
        def value(t: Array) -> Array:
            return direct_determinant(robot, start + t * (end - start))

        def halve(_: Array, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = bracket
            middle = 0.5 * (low + high)
            same = (value(middle) < 0) == (value(low) < 0)
            return jnp.where(same, middle, low), jnp.where(same, high, middle)

        zero, unit = jnp.zeros(()), jnp.ones(())
        low, _ = jax.lax.fori_loop(0, 60, halve, (zero, unit))
        return start + low * (end - start), (value(zero) < 0) != (value(unit) < 0)

    return jax.vmap(one)(robot, start, end)


def singular_poses(rng: np.random.Generator, geometry: np.ndarray) -> np.ndarray:
    """Returns one pose with det dF/dpose = 0 to rounding for each geometry, by bisection on segments."""
    n = len(geometry)
    robot, found, open_ = build(geometry), np.full((n, 3), np.nan), np.ones(n, bool)
    while open_.any():
        start, end = (jnp.asarray(random_poses(rng, n)) for _ in range(2))
        poses, bracketed = map(np.asarray, _bisected(robot, start, end))
        new = open_ & bracketed
        found[new], open_ = poses[new], open_ & ~new
    return found


def parallel_poses(rng: np.random.Generator, n: int) -> np.ndarray:
    """Returns poses of the analytic family whose three legs are parallel, f1 = 0."""
    phi, h = rng.uniform(-np.pi, np.pi, n), rng.uniform(-2, 2, n)
    return np.stack([-h * np.sin(phi / 2), h * np.cos(phi / 2), phi], axis=1)


def concurrent_poses(rng: np.random.Generator, geometry: np.ndarray) -> np.ndarray:
    """Returns poses of the analytic family with f2 = 0: the lines of the legs meet in one point."""
    c2, c3, d3 = geometry.T
    phi, p = rng.uniform(-np.pi, np.pi, len(c2)), rng.uniform(-2, 2, len(c2))
    s, c = np.sin(phi / 2), np.cos(phi / 2)
    rest = -2 * c3 * d3 * s**3 + 2 * (c3 * c2 - c3**2 + d3**2) * s**2 * c + 2 * d3 * (c3 - c2) * s * c**2
    h = rest / d3
    return np.stack([p * c - h * s, p * s + h * c, phi], axis=1)


#: Relative distances from a singularity: exactly there, within rounding, and up to well outside.
LAYERS = (0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-6)


def perturbed(rng: np.random.Generator, joints: np.ndarray) -> np.ndarray:
    """Returns joints off by a relative amount from ``LAYERS`` each."""
    share = np.resize(LAYERS, len(joints))[:, None]
    return joints * (1 + share * rng.uniform(-1, 1, joints.shape))


def exact_counts(geometry: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Returns the exact number of poses of each sample, by the oracle of the family."""
    if geometry.shape[1] == 3:
        rows = zip(geometry.tolist(), joints.tolist(), strict=True)
        return np.array([rpr3_exact.count_analytic(*g, *q).count for g, q in rows])
    platforms = np.stack([np.stack(p, -1) for p in build(geometry).platform_points()[1:]], 1).tolist()
    rows = zip(platforms, geometry.tolist(), joints.tolist(), strict=True)
    return np.array([rpr3_exact.count_general(b2, b3, *g[:3], *q).count for (b2, b3), g, q in rows])


def glued_distance(a: np.ndarray, b: np.ndarray, length: np.ndarray | float = 1.0) -> np.ndarray:
    """Returns the largest difference of two poses, lengths divided by ``length``, angles modulo 2 pi."""
    turn = np.abs(a[..., 2] - b[..., 2]) % (2 * np.pi)
    shift = np.max(np.abs(a[..., :2] - b[..., :2]), axis=-1)
    return np.maximum(shift / length, np.minimum(turn, 2 * np.pi - turn))


def nearest(values: np.ndarray, pose: np.ndarray, length: np.ndarray | float = 1.0) -> np.ndarray:
    """Returns the distance from each pose ``(n, 3)`` to the nearest lane of ``(n, lanes, 3)``; NaN never counts."""
    gaps = glued_distance(np.asarray(values), np.asarray(pose)[:, None], np.asarray(length)[..., None])
    return np.min(np.where(np.isnan(gaps), np.inf, gaps), axis=1)


def set_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Returns the Hausdorff distance of two sets of poses ``(n, 3)``, without NaN rows; inf if one alone is empty."""
    if len(first) == 0 or len(second) == 0:
        return 0.0 if len(first) == len(second) else float("inf")
    gaps = glued_distance(first[:, None], second[None])
    return float(max(gaps.min(axis=0).max(), gaps.min(axis=1).max()))


conditioning_batch: Callable[..., jk.Conditioning] = jax.jit(jax.vmap(jk.conditioning))
