"""Points inside the regions of a divided section, and the number of solutions there."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.spatial import KDTree

from jaxkin.core.errors import Status
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.solve import forward_lanes
from jaxkin.mapping._region_division import Divided
from jaxkin.mapping._region_edges import at
from jaxkin.mapping.batch import in_blocks

#: Where in each trapezoid points are tried: shares of its slab, and of the height there.
_ACROSS, _UP = (0.5, 0.15, 0.85), (0.5, 0.15, 0.85)
#: Points of a region whose solutions are counted, the one deepest inside first.
_POINTS = 6
#: Broken lines have points so close (plane coordinates) when distances from them are measured.
_SPACING = 0.002
#: Joint points that a compiled call solves for, by a closed form and by search.
_BLOCK, _SEARCH_BLOCK = 256, 16
#: Statuses of a solution that leave the number of solutions in doubt.
_UNSURE = (Status.SINGULAR, Status.UNDECIDED, Status.SELF_MOTION)


class Inside(NamedTuple):
    """Points inside regions.

    Attributes:
        region: ``(n,)`` which region each is of; every region has one at least.
        plane: ``(n, 2)`` plane points, those deepest inside first.
    """

    region: np.ndarray
    plane: np.ndarray


def inside(divided: Divided) -> Inside:
    """Returns several points inside every region, the deepest first."""
    region, points = tried(divided)
    tree = KDTree(_boundary(divided))
    depth = tree.query(points)[0]
    regions, kept = [], []
    for number in range(divided.division.count):
        own = np.flatnonzero(region == number)
        own = own[np.argsort(-depth[own], kind="stable")]
        best = _deepest(tree, points[own[0]])
        # Others apart from it and from each other: from different trapezoids first of all.
        others = own[np.unique(np.linspace(0, min(len(own), 4 * _POINTS) - 1, _POINTS).astype(int))]
        kept += [best, *points[others[1:]]]
        regions += [number] * len(others)
    return Inside(np.array(regions), np.array(kept).reshape(-1, 2))


def tried(divided: Divided) -> tuple[np.ndarray, np.ndarray]:
    """Returns points of all trapezoids: their regions, and where they are in the plane."""
    bounds, pieces = divided.shape.bounds, divided.division.trapezoids
    slab = np.array([piece.slab for piece in pieces])
    x = (bounds[slab][:, None] + np.diff(bounds)[slab][:, None] * _ACROSS).ravel()
    low, high = (
        at(divided.plane, divided.edges, np.repeat([getattr(piece, side) for piece in pieces], len(_ACROSS)), x).plane
        for side in ("below", "above")
    )
    points = np.concatenate([low + share * (high - low) for share in _UP])
    return np.tile(np.repeat([piece.region for piece in pieces], len(_ACROSS)), len(_UP)), points


def _boundary(divided: Divided) -> np.ndarray:
    """Returns points along all arcs, close to each other."""
    parts = []
    for edge in divided.edges:
        steps = np.diff(edge.plane, axis=0)
        size = np.sqrt(np.sum(steps**2, axis=1))
        spacing = min(_SPACING, float(np.sum(size)) / 20)
        count = np.maximum(1, np.ceil(size / max(spacing, 1e-9))).astype(int)
        owner = np.repeat(np.arange(len(steps)), count)
        share = (np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)) / count[owner]
        parts.append(edge.plane[owner] + share[:, None] * steps[owner])
    return np.concatenate([*parts, divided.vertices])


def _deepest(tree: KDTree, point: np.ndarray) -> np.ndarray:
    """Moves a point away from the boundary, within the disc around it that holds no boundary."""
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    share = 0.5
    for _ in range(40):
        depth = tree.query(point)[0]
        step = share * max(depth - 2 * _SPACING, 0.0)
        if step < 1e-5:
            break
        around = point + step * ring
        depths = tree.query(around)[0]
        best = int(np.argmax(depths))
        if depths[best] > depth:
            point = around[best]
        else:
            share *= 0.5
    return point


class Counted(NamedTuple):
    """Numbers of solutions at joint points.

    Attributes:
        number: ``(n,)``.
        sure: ``(n,)`` False where solutions nearly coincide, or there is a continuum of them.
    """

    number: np.ndarray
    sure: np.ndarray


def counted(robot: Mechanism, joints: np.ndarray) -> Counted:
    """Counts the solutions of the forward problem at joint points, ``(n, n_joint)``."""
    joints = joints.copy()
    for k, axis in enumerate(robot.joint_axes):
        if axis.period is not None:
            joints[:, k] = (joints[:, k] - axis.low) % axis.period + axis.low
    block = _SEARCH_BLOCK if robot.forward_kernel is None else _BLOCK
    valid, status = in_blocks(partial(_solutions, robot), joints, block=block)
    return Counted(valid.sum(axis=1), ~np.any(np.isin(status, _UNSURE), axis=1))


@jax.jit
def _solutions(robot: Mechanism, joints: Array) -> tuple[Array, Array]:
    lanes = forward_lanes(robot, tuple(joints[:, k] for k in range(joints.shape[1])))
    valid = jnp.stack([lane.multiplicity > 0 for lane in lanes], axis=1)
    return valid, jnp.stack([lane.status for lane in lanes], axis=1)
