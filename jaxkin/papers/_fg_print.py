"""Fu and Gao, "Kinematic performances of a novel TLPM parallel robot", as it is printed: equations (1) to (23).

They are written out as they stand, apart from everything else of this package, so that they are a second opinion on it;
read from a text made from the print, so that an index or a sign may be that text's slip. ``_fg_errata`` lists what is
wrong. Lengths in mm; eta is 0, 120, -120 degrees, an order that (3) and (4) fix.
"""

from typing import Any

import numpy as np

Numbers = Any  # numbers or arrays of one shape

ROOT3 = float(np.sqrt(3.0))
ETA = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)
#: Table 1.
P1, P2 = (100.0, 100.0, 100.0), (100.0, 100.0, -1280.0)
#: Intervals of theta_i1 and theta_i2, rad (text after (23)).
ANGLES = ((np.pi / 10, np.pi), (np.pi / 6, np.pi))


def turn(axis: int, angle: Numbers) -> np.ndarray:
    """Returns the rotation about a coordinate axis 0, 1, 2, ``(..., 3, 3)``."""
    angle = np.asarray(angle, float)
    found = np.zeros((*angle.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found[..., axis, axis] = 1.0
    found[..., i, i] = found[..., j, j] = np.cos(angle)
    found[..., j, i] = np.sin(angle)
    found[..., i, j] = -found[..., j, i]
    return found


def base_points(radius: float, height: float) -> np.ndarray:
    """Returns q_i of Eq. (1), ``(3, 3)``."""
    return turn(2, ETA) @ np.array([radius, 0.0, -height])


def lengths(radius: float, height: float, point: np.ndarray) -> np.ndarray:
    """Returns the left-hand sides of Eq. (2), ``(..., 3)``, for ``(..., 3)`` points."""
    return np.linalg.norm(point[..., None, :] - base_points(radius, height), axis=-1)


def position(
    radius: float, height: float, initial: float, strokes: tuple[Numbers, ...], *, corrected: bool
) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """Returns x, y, z1, z2 of Eqs. (3) to (6); z is NaN where the root is not real, as for most y of (4) as printed."""
    (l1, l2, l3), l0, r = strokes, initial, radius
    x = (
        -(l1**2) / (3 * r)
        - 2 * l0 * l1 / (3 * r)
        + l2**2 / (6 * r)
        + l0 * l2 / (3 * r)
        + l3**2 / (6 * r)
        + l0 * l3 / (3 * r)
    )
    second, third = (l0 * l3, l2**2) if corrected else (l0 * l2, l0 * l2**2)
    y = ROOT3 * (l3**2 / (6 * r) + second / (3 * r) - third / (6 * r) - l0 * l2 / (3 * r))
    with np.errstate(invalid="ignore"):
        root = np.sqrt((l0 + l1) ** 2 - (x - r) ** 2 - y**2)
    return x, y, -height + root, -height - root


def directions(radius: float, height: float, point: np.ndarray) -> np.ndarray:
    """Returns J_dir of Eq. (8), ``(..., 3, 3)``: rows (q_i - p) / |q_i - p|."""
    rows = base_points(radius, height) - point[..., None, :]
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def directions_over_squares(radius: float, height: float, point: np.ndarray) -> np.ndarray:
    """Returns J_dir of Eq. (11) as printed, with u_i of (12), which is a squared length, below the fractions."""
    rows = base_points(radius, height) - point[..., None, :]
    return rows / np.sum(rows**2, axis=-1, keepdims=True)


def determinant(radius: float, height: float, point: np.ndarray) -> np.ndarray:
    """Returns det(J_dir) of Eq. (12)."""
    s_d = -3 * ROOT3 * radius**2 * height - 3 * ROOT3 * radius**2 * point[..., 2]
    return s_d / (2 * np.prod(lengths(radius, height, point), axis=-1))


def limb_axes(radius: float, height: float, point: np.ndarray) -> np.ndarray:
    """Returns the unit vectors z_i1 of Eqs. (13) and (14), ``(..., 3, 3)``, a limb a row."""
    return directions(radius, height, point)


def limb_frames(radius: float, height: float, point: np.ndarray, *, corrected: bool) -> np.ndarray:
    """Returns R_i0 of Eqs. (15) to (18), ``(..., 3 limbs, 3, 3)``, columns x, y, z.

    As printed y is the tangent of (15), which is perpendicular to z only where p lies in the limb's vertical plane;
    corrected it is z x x.
    """
    z = limb_axes(radius, height, point)
    tangent = np.broadcast_to(turn(2, ETA) @ np.array([0.0, 1.0, 0.0]), z.shape)
    x = np.cross(tangent, z)
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x) if corrected else tangent, z], axis=-1)


def wrist(theta1: Numbers, theta2: Numbers) -> np.ndarray:
    """Returns the matrix under Eq. (19), ``(..., 3, 3)``."""
    c1, s1, c2, s2 = np.cos(theta1), np.sin(theta1), np.cos(theta2), np.sin(theta2)
    rows = [[c1 * c2, -s1, c1 * s2], [c2 * s1, c1, -s1 * s2], [-s2, 0 * c1, c2]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def platform_frames() -> np.ndarray:
    """Returns v_i of Eq. (20), ``(3, 3, 3)``, for the platform's orientation 1."""
    return turn(2, ETA) @ turn(1, np.pi / 4) @ turn(0, np.pi / 2)


def remaining(frames: np.ndarray) -> np.ndarray:
    """Returns R_i0^-1 v_i of Eq. (21), R_i1 taken for 1."""
    return np.linalg.inv(frames) @ platform_frames()


def angles(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns theta_i1 and theta_i2 by Eqs. (22) and (23) of the matrix (21)."""
    first = -np.arctan2(matrix[..., 0, 1], matrix[..., 1, 1])
    return first, -np.arctan2(matrix[..., 2, 0], matrix[..., 2, 2])
