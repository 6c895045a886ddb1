"""Checks of claimed assembly-mode changes of planar 3-RPR robots, and linking numbers of closed polygons.

A path is a list of poses, straight in (x, y, phi) between them. Its joint values follow from the legs; nothing is
taken on trust but the poses. With half-squared legs, dq/dx of the legs themselves is the rows of `aspects_scan.Robot`
divided by the legs; lengths are measured in units of `length`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .aspects_scan import Robot


class PathCheck(NamedTuple):
    """What a path of poses does.

    Attributes:
        least_determinant: Smallest |det| (of half-squared legs) on the sampled path.
        constant_sign: True if the determinant keeps its sign.
        clearance: Smallest singular value of dq/dx, angle in radians, lengths in units of `length`.
        gap: Largest difference of the joint values of start and end: zero for a change of the assembly mode.
        moved: Distance of the first and the last pose, the angle along the circle: zero for a mere loop.
        least_leg: Smallest leg length on the path.
    """

    least_determinant: float
    constant_sign: bool
    clearance: float
    gap: float
    moved: float
    least_leg: float


def check_path(robot: Robot, poses: np.ndarray, length: float, density: int = 400) -> PathCheck:
    """Samples the straight pieces of a path.

    Args:
        robot: The robot.
        poses: ``(k, 3)`` x, y, phi, the angle running on continuously.
        length: The characteristic length.
        density: Samples on every piece.
    """
    points = resampled(np.asarray(poses, dtype=float), density)
    x, y, phi = points.T
    rows = np.array(robot.legs(x, y, phi))  # leg, component, sample
    legs = np.hypot(rows[:, 0], rows[:, 1])
    det = robot.determinant(x, y, phi)
    slopes = np.moveaxis(rows / legs[:, None], 2, 0) / np.array([1.0, 1.0, length])
    start, end = legs[:, 0], legs[:, -1]
    shift = points[-1] - points[0]
    turn = math.remainder(shift[2], 2 * math.pi)
    return PathCheck(
        float(np.min(np.abs(det))),
        bool(np.all(det > 0) or np.all(det < 0)),
        float(np.min(np.linalg.svd(slopes, compute_uv=False))),
        float(np.max(np.abs(end - start))),
        math.hypot(shift[0], shift[1], length * turn),
        float(np.min(legs)),
    )


def resampled(points: np.ndarray, density: int) -> np.ndarray:
    """Returns `density` points on every straight piece, and the end."""
    s = np.arange(density) / density
    pieces = points[:-1, None] + s[None, :, None] * np.diff(points, axis=0)[:, None]
    return np.concatenate([pieces.reshape(-1, points.shape[1]), points[-1:]])


def lengths_along(robot: Robot, poses: np.ndarray, density: int = 1) -> np.ndarray:
    """Returns the legs along a path, ``(n, 3)``: for a mode change a closed curve in joint space."""
    return np.stack(robot.lengths(*resampled(np.asarray(poses, dtype=float), density).T), axis=1)


def linking_number(first: np.ndarray, second: np.ndarray) -> float:
    """Returns Gauss's integral over two disjoint closed polygons in space, exactly: an integer up to rounding.

    Args:
        first: ``(m, 3)`` corners, without the first one again at the end.
        second: ``(n, 3)`` corners.

    Each pair of edges sees the other under a solid angle; these are summed as in Klenin and Langowski 2000, method 1a.
    """
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    a2, b2 = np.roll(a, -1, axis=0), np.roll(b, -1, axis=0)
    r13, r14 = b[None] - a[:, None], b2[None] - a[:, None]
    r23, r24 = b[None] - a2[:, None], b2[None] - a2[:, None]
    normals = [np.cross(u, v) for u, v in ((r13, r14), (r14, r24), (r24, r23), (r23, r13))]
    with np.errstate(invalid="ignore", divide="ignore"):
        units = [np.nan_to_num(n / np.linalg.norm(n, axis=-1, keepdims=True)) for n in normals]
    angles = sum(
        np.arcsin(np.clip(np.sum(u * v, axis=-1), -1, 1)) for u, v in zip(units, [*units[1:], units[0]], strict=True)
    )
    r34, r12 = (b2 - b)[None], (a2 - a)[:, None]
    side = np.sign(np.sum(np.cross(np.broadcast_to(r34, r13.shape), np.broadcast_to(r12, r13.shape)) * r13, axis=-1))
    return float(np.sum(angles * side) / (4 * math.pi))


def winding_number(points: np.ndarray, centre: tuple[float, float]) -> float:
    """Returns how often a closed polygon in the plane turns about a point; its end is joined to its beginning."""
    x, y = (np.asarray(points, dtype=float) - centre).T
    angle = np.arctan2(y, x)
    return float(np.sum(np.remainder(np.diff(angle, append=angle[0]) + math.pi, 2 * math.pi) - math.pi) / (2 * math.pi))
