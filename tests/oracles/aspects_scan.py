"""Aspects of planar 3-RPR robots by labelling a uniform grid of poses, the angle glued. NumPy and SciPy alone.

Leg i is L_i = X + R b_i - a_i; the gradient of half its square is (L_i, b_i turned x L_i), and the direct determinant
is the volume that these three rows span. An aspect is a connected piece of {det > 0} or {det < 0} in the product of
plane and circle, within the limits of the legs; the robot has one working mode, the legs being positive.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

DATA = Path(__file__).parents[1] / "data" / "rpr3_aspects.json"
Point = tuple[float, float]


@dataclass(frozen=True)
class Robot:
    """Base and platform joints."""

    base: tuple[Point, Point, Point]
    platform: tuple[Point, Point, Point]

    def legs(self, x: np.ndarray, y: np.ndarray, phi: np.ndarray) -> list[tuple[np.ndarray, ...]]:
        """Returns (leg vector, moment) of each leg: the rows of the determinant."""
        c, s = np.cos(phi), np.sin(phi)
        rows = []
        for (ax, ay), (bx, by) in zip(self.base, self.platform, strict=True):
            armx, army = bx * c - by * s, bx * s + by * c
            u, v = x + armx - ax, y + army - ay
            rows.append((u, v, armx * v - army * u))
        return rows

    def determinant(self, x: np.ndarray, y: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Returns det d(rho^2 / 2)/d(x, y, phi)."""
        (a, b, c), (d, e, f), (g, h, i) = self.legs(x, y, phi)
        return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)

    def lengths(self, x: np.ndarray, y: np.ndarray, phi: np.ndarray) -> list[np.ndarray]:
        return [np.hypot(u, v) for u, v, _ in self.legs(x, y, phi)]


def analytic(c2: float, c3: float, d3: float) -> Robot:
    """Returns a robot whose platform is its base mirrored."""
    return Robot(((0.0, 0.0), (c2, 0.0), (c3, d3)), ((0.0, 0.0), (c2, 0.0), (c3, -d3)))


def from_sides(c2: float, c3: float, d3: float, sides: tuple[float, float, float]) -> Robot:
    """Returns a robot with platform sides |B1 B2|, |B1 B3|, |B2 B3|, B3 counter-clockwise."""
    l2, l3, l23 = sides
    along = (l2 * l2 + l3 * l3 - l23 * l23) / (2 * l2)
    return Robot(((0.0, 0.0), (c2, 0.0), (c3, d3)), ((0.0, 0.0), (l2, 0.0), (along, math.sqrt(l3**2 - along**2))))


REFERENCE = from_sides(15.91, 0.0, 10.0, (17.04, 20.84, 16.54))


class Piece(NamedTuple):
    """A connected piece of the grid.

    Attributes:
        sign: Sign of the determinant.
        volume: Number of samples times the volume of a cell.
        depth: Largest distance of a sample from the piece's border, in samples (along phi only within the piece's
            samples, glued).
        pose: The deepest sample.
        at_edge: True if it reaches the box's border in x or y.
    """

    sign: int
    volume: float
    depth: float
    pose: tuple[float, float, float]
    at_edge: bool


def scan(
    robot: Robot,
    box: tuple[tuple[float, float], tuple[float, float]],
    sizes: tuple[int, int, int],
    limits: tuple[tuple[float, float], ...] | None = None,
    least_depth: float = 2.0,
) -> list[Piece]:
    """Labels the cell centres of a grid over the box (x, y) and the whole circle of phi.

    Args:
        robot: The robot.
        box: Ranges of x and y.
        sizes: Samples of x, y, phi.
        limits: Ranges of the three legs.
        least_depth: Pieces without a sample that deep inside are not resolved and left out.

    Returns:
        The pieces by descending volume.
    """
    (x0, x1), (y0, y1) = box
    steps = (x1 - x0) / sizes[0], (y1 - y0) / sizes[1], 2 * math.pi / sizes[2]
    axes = [lo + step * (np.arange(n) + 0.5) for lo, step, n in zip((x0, y0, -math.pi), steps, sizes, strict=True)]
    grid = axes[0][:, None, None], axes[1][None, :, None], axes[2][None, None, :]
    det = robot.determinant(*grid)
    inside = np.ones(det.shape, bool)
    for rho, (low, high) in zip(robot.lengths(*grid), limits or (), strict=False):
        inside &= (rho >= low) & (rho <= high)
    found = []
    for sign in (1, -1):
        labels, count = _glued_labels(inside & (sign * det > 0))
        pad = max(2, math.ceil(4 * least_depth))
        wrapped = np.concatenate([labels[..., -pad:], labels, labels[..., :pad]], axis=2) > 0
        depth = ndimage.distance_transform_edt(wrapped)[..., pad:-pad]
        volumes = np.bincount(labels.ravel(), minlength=count + 1) * math.prod(steps)
        for k, place in enumerate(ndimage.maximum_position(depth, labels, np.arange(1, count + 1)), start=1):
            if depth[place] < least_depth:
                continue
            own = labels == k
            edge = own[0].any() or own[-1].any() or own[:, 0].any() or own[:, -1].any()
            pose = tuple(float(axis[i]) for axis, i in zip(axes, place, strict=True))
            found.append(Piece(sign, float(volumes[k]), float(depth[place]), pose, bool(edge)))
    return sorted(found, key=lambda piece: -piece.volume)


def _glued_labels(mask: np.ndarray) -> tuple[np.ndarray, int]:
    """Labels face-connected samples, the last axis periodic; labels 1 to count."""
    labels, count = ndimage.label(mask)
    parent = np.arange(count + 1)

    def find(i: int) -> int:
        while parent[i] != i:
            i = parent[i]
        return i

    first, last = labels[..., 0], labels[..., -1]
    both = (first > 0) & (last > 0)
    for p, q in np.unique(np.stack([first[both], last[both]], axis=1), axis=0):
        parent[find(int(p))] = find(int(q))
    roots = np.array([find(i) for i in range(count + 1)])
    names = np.unique(roots)
    renamed = np.searchsorted(names, roots)
    return renamed[labels], len(names) - 1


# --- data file ---------------------------------------------------------------------------------------------------

EXAMPLE = analytic(1.0, 0.0, 1.0)

#: Robots with one range for all legs whose number of aspects stands when the range changes by 2 %.
LIMITED = (
    ("reference", (10.0, 20.0)),
    ("reference", (5.0, 15.0)),
    ("reference", (15.0, 25.0)),
    ("analytic", (1.0, 2.0)),
    ("analytic", (0.5, 1.5)),
    ("analytic", (1.5, 2.5)),
)


def limited(name: str, legs: tuple[float, float], size: int) -> list[Piece]:
    """Returns the aspects of one of the robots of `LIMITED`; the box holds the whole workspace."""
    robot, reach = {"reference": REFERENCE, "analytic": EXAMPLE}[name], 1.05 * legs[1]
    return scan(robot, ((-reach, reach), (-reach, reach)), (size, size, size), (legs,) * 3)


def describe(size: int) -> list[dict[str, Any]]:
    """Returns signs, volumes and deepest poses of all these aspects."""
    return [
        {
            "robot": name,
            "legs": legs,
            "aspects": [{"sign": p.sign, "volume": p.volume, "pose": p.pose} for p in limited(name, legs, size)],
        }
        for name, legs in LIMITED
    ]


if __name__ == "__main__":
    DATA.write_text(json.dumps(describe(200), indent=1) + "\n")
