"""NumPy yardsticks on whole arrays: forward kinematics of the spatial robots in closed form, conditioning by LAPACK.

``what``, ``size`` and the layout of samples are those of spatial.c and numba_conditioning.
"""

import itertools
import math

import numpy as np

ROOT3 = math.sqrt(3.0)


def ppps3_frames(q: np.ndarray) -> np.ndarray:
    """Position and rotation of the four assembly modes, ``(4, 12, n)``, NaN where there are none."""
    y1, z1, y2, z2, y3, z3 = q
    m2, m3 = z2 - z1, z3 - z1
    r12, r31, r32 = y3 + y2, -(m2 + m3) / ROOT3, m3 - m2
    c = (1 - r32) * (1 + r32)
    a, b = c - r31 * r31, c - r12 * r12
    real = (a > 0) & (b > 0)
    root_a, root_b = np.sqrt(np.where(real, a, np.nan)), np.sqrt(np.where(real, b, np.nan))
    none = root_a * 0
    out = np.empty((4, 12, q.shape[1]))
    for lane, (s22, s33) in enumerate(itertools.product((1, -1), repeat=2)):
        r22, r33 = s22 * root_b, s33 * root_a
        r11, r13 = (r22 * r33 - r12 * r31 * r32) / c, -(r12 * r32 * r33 + r22 * r31) / c
        r21, r23 = -(r12 * r33 + r22 * r31 * r32) / c, (r12 * r31 - r22 * r33 * r32) / c
        x = (ROOT3 * r11 + r12) / 2 - y2
        entries = (x, y1 + none, z1 + none, r11, r12 + none, r13, r21, r22, r23, r31 + none, r32 + none, r33)
        out[lane] = entries
    return out


def ppps3_branches(q: np.ndarray) -> np.ndarray:
    """Poses of the four assembly modes in Euler angles, ``(4, 6, n)``."""
    found = ppps3_frames(q)
    _, _, r13, r21, r22, r23, r31, r32, r33 = np.moveaxis(found[:, 3:], 1, 0)
    out = np.empty((4, 6, q.shape[1]))
    out[:, :3] = found[:, :3]
    out[:, 3] = np.arctan2(-r23, r33)
    out[:, 4] = np.arctan2(r13, np.hypot(r23, r33))
    out[:, 5] = np.arctan2(r33 * r21 - r23 * r31, r33 * r22 - r23 * r32)
    return out


def tlpm_branches(size: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Both modes, ``(2, 3, n)``."""
    (x1, y1), (x2, y2), (x3, y3) = size[:6].reshape(3, 2)
    ax, ay, bx, by = x1 - x2, y1 - y2, x1 - x3, y1 - y3
    r1, r2, r3 = q + size[7]
    g2, g3 = (r2 - r1) * (r2 + r1) / 2, (r3 - r1) * (r3 + r1) / 2
    det = ax * by - ay * bx
    x, y = (g2 * by - g3 * ay) / det, (ax * g3 - bx * g2) / det
    square = r1 * r1 - (x - x1) ** 2 - (y - y1) ** 2
    here = (square > 0) & (r1 > 0) & (r2 > 0) & (r3 > 0)
    root = np.sqrt(np.where(here, square, np.nan))
    x, y = x + root * 0, y + root * 0
    return np.stack([np.stack([x, y, root - size[6]]), np.stack([x, y, -root - size[6]])])


def tlpm_interference(size: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Both modes and the smallest clearance of each, ``(2, 4, n)``."""
    poses = tlpm_branches(size, q)
    return np.concatenate([poses, np.stack([_clearance(size, pose) for pose in poses])[:, None]], axis=1)


def _clearance(size: np.ndarray, pose: np.ndarray) -> np.ndarray:
    b, r1, r2, bound = size[8:12]
    begin, end = [], []
    for k, (outward, tangent, z3) in enumerate(size[12:].reshape(3, 3, 3)):
        away = np.array([size[2 * k], size[2 * k + 1], -size[6]])[:, None] - pose
        z1 = away / np.sqrt((away * away).sum(axis=0))
        m31, m33 = outward @ z1, -(tangent @ z1)
        z2 = -(m33 * outward[:, None] + m31 * tangent[:, None]) / np.hypot(m31, m33)
        begin += [(b * z1, r1 * z2 - b * z1)]
        end += [(r1 * z2, r2 * z3[:, None] - r1 * z2)]
    axes = begin + end
    pairs = [*itertools.combinations(range(3), 2), *itertools.combinations(range(3, 6), 2)]
    pairs += [(i, 3 + j) for i, j in itertools.permutations(range(3), 2)]
    return np.minimum.reduce([_distance(*axes[i], *axes[j]) for i, j in pairs]) - bound


def _distance(p: np.ndarray, u: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    w, normal = p - q, np.cross(u, v, axis=0)
    uv, vv = dot(u, v), dot(v, v)
    s = np.clip(dot(np.cross(v, w, axis=0), normal) / dot(normal, normal), 0, 1)
    t = np.clip((dot(v, w) + s * uv) / vv, 0, 1)
    s = np.clip((t * uv - dot(u, w)) / dot(u, u), 0, 1)
    d = w + s * u - t * v
    return np.sqrt(dot(d, d))


def _measure(what: int, rows: list[list[np.ndarray]], rates: np.ndarray) -> np.ndarray:
    """The measure by batched LAPACK; rows in units of the equations, rates ``(n, k, k)``."""
    if what == 0:
        (a, b, c), (d, e, f), (g, h, i) = rows
        return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    values = np.linalg.svd(rates, compute_uv=False)
    return values[:, -1] if what == 1 else values[:, -1] / values[:, 0]


def rpr3_conditioning(what: int, size: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The measure of the 3-RPR at poses ``(3, n)``."""
    x, y, phi = pose
    cos, sin = np.cos(phi), np.sin(phi)
    rows = []
    for (ax, ay), (bx, by) in zip(size[:6].reshape(3, 2), size[6:12].reshape(3, 2), strict=True):
        armx, army = bx * cos - by * sin, bx * sin + by * cos
        dx, dy = x + armx - ax, y + army - ay
        rows.append([2 * dx, 2 * dy, 2 * (dy * armx - dx * army)])
    rates = np.moveaxis(np.array(rows), -1, 0)
    rates = rates / np.linalg.norm(rates[:, :, :2], axis=-1, keepdims=True) / np.array([1.0, 1.0, size[12]])
    return _measure(what, rows, rates)


def tlpm_conditioning(what: int, size: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The measure of the TLPM at poses ``(3, n)``."""
    x, y, z = pose
    rows = [[2 * (x - qx), 2 * (y - qy), 2 * (z + size[6])] for qx, qy in size[:6].reshape(3, 2)]
    rates = np.moveaxis(np.array(rows), -1, 0)
    return _measure(what, rows, rates / np.linalg.norm(rates, axis=-1, keepdims=True))


def ppps3_conditioning(what: int, pose: np.ndarray) -> np.ndarray:
    """The measure of the 3-PPPS at poses ``(6, n)``."""
    (cp, ct, cs), (sp, st, ss) = np.cos(pose[3:]), np.sin(pose[3:])
    zero, one = np.zeros_like(cp), np.ones_like(cp)
    top = ((zero, zero), (-st * cs, st * ss), (-ct * ss, -ct * cs))
    bottom = (
        (cp * ss + sp * st * cs, cp * cs - sp * st * ss),
        (-cp * ct * cs, cp * ct * ss),
        (cp * st * ss + sp * cs, cp * st * cs - sp * ss),
    )
    x2, x3, h2, h3 = (
        [ROOT3 / 2 * a + sign / 2 * b for a, b in pairs] for pairs in (top, bottom) for sign in (1.0, -1.0)
    )
    rates = np.empty((pose.shape[1], 6, 6))
    rows = (
        [zero, one, zero, zero, zero, zero],
        [zero, zero, one, zero, zero, zero],
        [-one, zero, zero, *x2],
        [zero, zero, one, *(-h for h in h2)],
        [one, zero, zero, *(-x for x in x3)],
        [zero, zero, one, *(-h for h in h3)],
    )
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            rates[:, i, j] = entry
    if what == 0:
        return -16 * np.linalg.det(rates)
    return _measure(what, [], rates)
