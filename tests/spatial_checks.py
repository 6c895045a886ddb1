"""The 3-PPPS and the TLPM in NumPy, straight from vectors, and joints near every kind of trouble, for their tests."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxkin as jk
from jaxkin.mechanisms import tlpm

ROOT3 = np.sqrt(3.0)
#: Joints of the 3-PPPS of side 1 at the identity pose.
HOME_JOINTS = (0.0, 0.0, ROOT3 / 2, 0.0, -ROOT3 / 2, 0.0)

BLOCK = 8192


def _in_blocks(function: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function of one robot and ``(n, k)`` configurations that is compiled once, not for every n."""
    compiled = jax.jit(jax.vmap(function, in_axes=(None, 0)))

    def many(robot: jk.Mechanism, rows: Any) -> Any:
        # Constructors and jnp.full differ in weak types, each of which would be compiled anew.
        robot, rows = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)), robot), np.asarray(rows, float)
        parts = []
        for start in range(0, len(rows), BLOCK):
            part = np.resize(rows[start : start + BLOCK], (BLOCK, rows.shape[1]))
            parts.append(compiled(robot, jnp.asarray(part)))
        return jax.tree.map(lambda *leaves: np.concatenate(leaves)[: len(rows)], *parts)

    return many


def _count(robot: jk.Mechanism, joints: jax.Array) -> Any:
    assert robot.count_kernel is not None
    return robot.count_kernel(tuple(joints))


#: One robot, many configurations; NumPy arrays come back.
forward_many = _in_blocks(jk.forward)
inverse_many = _in_blocks(jk.inverse)
frames_many = _in_blocks(jk.forward_frames)
count_many = _in_blocks(_count)


def matrices(poses: np.ndarray) -> np.ndarray:
    """Returns Rx(phi) Ry(theta) Rz(sigma) of poses ``(..., 6)`` as a product of three turns, ``(..., 3, 3)``."""
    product = np.eye(3)
    for axis in range(3):
        angle = np.asarray(poses)[..., 3 + axis]
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.zeros((*angle.shape, 3, 3))
        turn[..., axis, axis] = 1
        turn[..., i, i] = turn[..., j, j] = np.cos(angle)
        turn[..., j, i], turn[..., i, j] = np.sin(angle), -np.sin(angle)
        product = product @ turn
    return product


def corners(poses: np.ndarray, side: float = 1.0, mirrored: bool = False) -> np.ndarray:
    """Returns W1, W2, W3, ``(..., 3, 3)``, a corner in each row."""
    half = -side / 2 if mirrored else side / 2
    own = np.array([(0, 0, 0), (-side * ROOT3 / 2, -half, 0), (-side * ROOT3 / 2, half, 0)])
    return np.asarray(poses)[..., None, :3] + own @ np.swapaxes(matrices(poses), -1, -2)


def ppps3_joints(poses: np.ndarray, side: float = 1.0, mirrored: bool = False) -> np.ndarray:
    """Returns the active joints, read off the corners by Eq. (3) of Chablat et al. 2018."""
    w = corners(poses, side, mirrored)
    columns = [w[..., 0, 1], w[..., 0, 2], -w[..., 1, 0], w[..., 1, 2], w[..., 2, 0], w[..., 2, 2]]
    return np.stack(columns, axis=-1)


def ppps3_passive(poses: np.ndarray, side: float = 1.0, mirrored: bool = False) -> np.ndarray:
    """Returns rho1x, rho2x, rho3x."""
    w = corners(poses, side, mirrored)
    return np.stack([w[..., 0, 0], w[..., 1, 1], -w[..., 2, 1]], axis=-1)


def random_rotations(rng: np.random.Generator, n: int) -> np.ndarray:
    """Returns rotations of the Haar measure, ``(n, 3, 3)``, by orthonormalising Gaussian matrices."""
    q, r = np.linalg.qr(rng.normal(size=(n, 3, 3)))
    q = q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    return q * np.linalg.det(q)[:, None, None]


def random_poses(rng: np.random.Generator, n: int, size: float = 1.0) -> np.ndarray:
    """Returns poses ``(n, 6)``: positions in a cube, angles uniform in their intervals."""
    high = np.array([size, size, size, np.pi, np.pi / 2, np.pi])
    return rng.uniform(-high, high, (n, 6))


def joints_of_entries(
    rng: np.random.Generator, entries: np.ndarray, side: float = 1.0, mirrored: bool = False, shift: float = 1.0
) -> np.ndarray:
    """Returns joints of the 3-PPPS that demand R12, R31, R32 = ``entries`` ``(n, 3)``, anywhere in space."""
    sign = -1.0 if mirrored else 1.0
    r12, r31, r32 = np.moveaxis(entries, -1, 0)
    total, gap = -ROOT3 * side * r31, sign * side * r32
    y1, z1, y2 = rng.uniform(-shift, shift, (3, *r12.shape))
    return np.stack([y1, z1, y2, z1 + (total - gap) / 2, sign * side * r12 - y2, z1 + (total + gap) / 2], axis=-1)


def singular_entries(rng: np.random.Generator, n: int, kind: str, steep: bool = False) -> np.ndarray:
    """Returns (R12, R31, R32) with R33 = 0, R22 = 0, both, or of a self-motion, ``(n, 3)``; steep: R32 close to +-1."""
    turn, share, sign = rng.uniform(-np.pi, np.pi, n), rng.uniform(-0.98, 0.98, n), rng.choice([-1.0, 1.0], n)
    if steep:
        turn = np.sign(turn) * (np.pi / 2 + 10 ** rng.uniform(-6, -1, n))
    sine, cosine = np.sin(turn), np.cos(turn)
    return {
        "R33": lambda: np.stack([share * np.abs(cosine), cosine, sine], axis=-1),
        "R22": lambda: np.stack([cosine, share * np.abs(cosine), sine], axis=-1),
        "both": lambda: np.stack([cosine, sign * cosine, sine], axis=-1),
        "self-motion": lambda: np.stack([0 * sign, 0 * sign, sign], axis=-1),
    }[kind]()


KINDS = ("R33", "R22", "both", "self-motion")
#: How far from singular: exactly there, within rounding, and up to well outside.
LAYERS = (0.0, 1e-16, 1e-15, 1e-14, 1e-13, 1e-12, 1e-10, 1e-8, 1e-6)


def flagged(status: np.ndarray) -> np.ndarray:
    """True where a lane (last axis) warns that the number of poses is not to be relied on."""
    doubtful = (jk.Status.SINGULAR, jk.Status.UNDECIDED, jk.Status.SELF_MOTION)
    return np.any(np.isin(np.asarray(status), doubtful), axis=-1)


def rotation_gap(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Returns the largest difference of entries; NaN counts as infinite."""
    gap = np.max(np.abs(first - second), axis=(-1, -2))
    return np.where(np.isnan(gap), np.inf, gap)


def central_differences(function: Callable[[np.ndarray], Any], point: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Returns the derivative of a batched function along a new last axis, by differences of the fourth order."""
    shifts = np.array([-2.0, -1.0, 1.0, 2.0])
    points = point + (shifts[:, None, None] * np.diag(step)).reshape(-1, len(point))
    values = np.asarray(function(points))
    values = values.reshape(4, len(point), *values.shape[1:])
    slopes = np.einsum("s,s...->...", np.array([1, -8, 8, -1]) / 12, values)
    return np.moveaxis(slopes / step.reshape(-1, *[1] * (slopes.ndim - 1)), 0, -1)


def euler_rates(pose: np.ndarray) -> np.ndarray:
    """Returns E with omega = E d(phi, theta, sigma)/dt, omega in the base frame, ``(3, 3)``."""
    phi, theta = pose[3], pose[4]
    second = (0.0, np.cos(phi), np.sin(phi))
    third = (np.sin(theta), -np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta))
    return np.array([(1.0, 0.0, 0.0), second, third]).T


def tlpm_lengths(robot: tlpm.TLPM, points: np.ndarray) -> np.ndarray:
    """Returns |p - q_i| of points ``(..., 3)``, with q_i as in Eq. (1) of Fu and Gao."""
    eta, radius, height = (np.asarray(v) for v in (robot.limb_angles, robot.base_radius, robot.height))
    base = np.stack([radius * np.cos(eta), radius * np.sin(eta), -height + 0 * eta], axis=-1)
    return np.linalg.norm(np.asarray(points)[..., None, :] - base, axis=-1)
