"""Paths of a mode change: candidates from a lattice, made smooth, verified by tracking, and the best of them."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import jax.numpy as jnp
import numpy as np

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics._following import pose_unit
from jaxkin.kinematics.legs import Legs
from jaxkin.kinematics.tracking import track
from jaxkin.mapping._mode_change_search import Explored, Lattice, cheapest_path, explored, widest
from jaxkin.mapping._mode_change_smoothing import resampled, smoothed, spline
from jaxkin.mapping._mode_change_terrain import Ground, Terrain, clearances, grounds
from jaxkin.numerics.gluing import short_way

#: Candidates: the share of the largest width that a path over the lattice keeps, and by how many times that width the
#: gradients begin to care.
_CANDIDATES = ((0.98, 4.0), (0.6, 2.0))
#: So many paths are made smooth at once.
_BATCH = 6
#: How far the radii around the points of the lattice are trusted, one after the other.
_TRUSTS = (1.0, 3.0, np.inf)
#: How often a path is sought anew without edges that do not hold: where there is one already, and else.
_FEW, _MANY = 6, 24
#: Poses of a path, and how many times as many are looked at, at first and at most.
_POSES, _LOOKS = 257, (8, 32)
#: Between two poses looked at, the clearance changes by this share of itself at most.
_CHANGE = 0.1
#: Paths that keep this share of the largest clearance are told apart by their lengths.
_AS_WIDE = 0.9
#: Poses, dimensionless, that agree so far are the same.
_SAME = 1e-6

#: A path to start from: poses and joints, and the clearance at which the gradients begin to care.
Start: TypeAlias = tuple[tuple[np.ndarray, np.ndarray], float]


@dataclass(frozen=True, eq=False)
class Path:
    """A verified path, poses and joints in their own units.

    Attributes:
        poses: ``(k, n_pose)``.
        joints: ``(k, n_joint)``.
        clearances: ``(k,)``.
        clearance: The smallest one of all poses looked at.
        length: Dimensionless.
        evidence: What was found in verifying it.
    """

    poses: np.ndarray
    joints: np.ndarray
    clearances: np.ndarray
    clearance: float
    length: float
    evidence: dict[str, Any]


def best_path(
    robot: Mechanism, terrain: Terrain, legs: Legs | None, box: Lattice, ends: np.ndarray, joints: np.ndarray
) -> tuple[Path | None, dict[str, Any]]:
    """Returns the best path in a box that holds, or None, and what the search found.

    Args:
        robot: The mechanism.
        terrain: Its working mode.
        legs: How the equations hold the joints, or None.
        box: Where to search.
        ends: ``(2, n_pose)`` start and goal, in their own units.
        joints: ``(n_joint,)``.
    """
    unit = np.asarray(terrain.pose_unit)
    x = ends / unit
    found = explored(terrain, legs, box, x, joints)
    evidence: dict[str, Any] = {
        "poses of the lattice, in the aspects of its signs": [len(found.x) - 2, int(np.sum(found.ground.open[:-2]))],
    }
    starts = _starts(terrain, legs, found)
    if not starts:
        return None, evidence
    path, note = _improved(robot, terrain, legs, box, starts, ends, joints)
    return path, {**evidence, **note}


def improved(
    robot: Mechanism,
    terrain: Terrain,
    legs: Legs,
    box: Lattice,
    poses: np.ndarray,
    ends: np.ndarray,
    joints: np.ndarray,
) -> tuple[Path | None, dict[str, Any]]:
    """Returns the best path that gradients make of one that was found otherwise, or None, and how that went.

    Args:
        robot: The mechanism.
        terrain: Its working mode.
        legs: How the equations hold the joints.
        box: Says which axes are fixed.
        poses: ``(k, n_pose)`` the path, in own units.
        ends: ``(2, n_pose)`` start and goal.
        joints: ``(n_joint,)``.
    """
    x = poses / np.asarray(terrain.pose_unit)
    here = grounds(terrain, legs, x)
    width = 1.0 / np.sqrt(np.max(here.stiffness))
    starts = [((x, np.asarray(here.joints)), care * width) for care in (1.0, 2.0, 4.0)]
    return _improved(robot, terrain, legs, box, starts, ends, joints)


def _improved(
    robot: Mechanism,
    terrain: Terrain,
    legs: Legs | None,
    box: Lattice,
    starts: list[Start],
    ends: np.ndarray,
    joints: np.ndarray,
) -> tuple[Path | None, dict[str, Any]]:
    """Makes paths smooth, all at once, and returns the best that holds."""
    free = np.array([float(count > 1) for count in box.shape])
    fair = [resampled(*path) for path, _ in starts]
    # As many paths in every call, so that it is compiled once.
    rows = np.resize(np.arange(len(starts)), _BATCH)
    batch = (np.stack([fair[k][part] for k in rows]) for part in (0, 1))
    cares = np.array([starts[k][1] for k in rows])
    moved = smoothed(terrain, legs, jnp.asarray(cares), jnp.asarray(free), *map(jnp.asarray, batch))
    candidates = [
        (np.asarray(moved.x[k]), np.asarray(moved.joints[k])) for k in range(len(fair)) if bool(moved.holds[k])
    ]
    note = {"paths made smooth that hold": f"{len(candidates)} of {len(fair)}"}
    # The paths as they are, where smoothing has failed.
    fallback = [resampled(*path, count=_POSES) for path, _ in starts]
    for some in (candidates, fallback):
        looked = [_looked(robot, terrain, legs, *candidate, joints, ends) for candidate in some]
        good = [path for path in looked if path is not None]
        if good:
            enough = _AS_WIDE * max(path.clearance for path in good)
            return min((path for path in good if path.clearance >= enough), key=lambda path: path.length), note
    return None, note


def _starts(terrain: Terrain, legs: Legs | None, found: Explored) -> list[Start]:
    """Returns paths over the lattice with the clearance at which the gradients are to begin to care.

    First over edges along which no singularity can be near, then over others: fewer hold, but they may be wider.
    """
    starts: list[Start] = []
    for trust in _TRUSTS:
        narrow = found.narrow(trust)
        width = widest(found, narrow)
        if width is None:
            continue
        known = dict[float, Any]()
        for share, care in _CANDIDATES:
            if share not in known:
                repairs = _FEW if starts else _MANY
                known[share] = cheapest_path(terrain, legs, found, narrow >= share * width, repairs)
            if known[share] is not None:
                starts.append((known[share], care * width))
    return starts


def _looked(
    robot: Mechanism,
    terrain: Terrain,
    legs: Legs | None,
    x: np.ndarray,
    guess: np.ndarray,
    joints: np.ndarray,
    ends: np.ndarray,
    looks: int = _LOOKS[0],
) -> Path | None:
    """Looks at a path closely and tracks its loop; returns it, or None where it does not hold."""
    unit = np.asarray(terrain.pose_unit)
    dense, near = spline(x, guess)(np.linspace(0, 1, looks * (_POSES - 1) + 1))
    dense[0], dense[-1] = x[0], x[-1]
    here = grounds(terrain, legs, dense, near)
    if not np.all(np.asarray(here.open)[1:-1]):
        return None
    clear = clearances(robot, dense * unit, np.asarray(here.joints))
    change = float(np.max(np.abs(np.diff(clear)) / np.minimum(clear[1:], clear[:-1])))
    if change > _CHANGE and looks < _LOOKS[1]:
        return _looked(robot, terrain, legs, x, guess, joints, ends, 2 * looks)
    return _verified(robot, dense[::looks] * unit, _loop(robot, here, looks, joints), clear, looks, change, ends)


def _loop(robot: Mechanism, here: Ground, looks: int, joints: np.ndarray) -> np.ndarray:
    """Returns every so manieth row of joints, glued ones running on from those at the start."""
    period = np.array([np.inf if axis.period is None else axis.period for axis in robot.joint_axes])
    steps = short_way(np.diff(np.asarray(here.joints), axis=0), period)
    loop = np.concatenate([joints[None], joints + np.cumsum(steps, axis=0)])[::looks]
    # The sum of steps is off by rounding; the joints of the goal are those of the start, up to turns.
    loop[-1] -= short_way(loop[-1] - joints, period)
    return loop


def _verified(
    robot: Mechanism,
    poses: np.ndarray,
    joints: np.ndarray,
    clear: np.ndarray,
    looks: int,
    change: float,
    ends: np.ndarray,
) -> Path | None:
    """Tracks the loop from the start; returns the path if that leads over all of its poses to the goal."""
    unit = np.asarray(pose_unit(robot))
    poses = poses.copy()
    poses[0] = ends[0]
    followed = track(robot, joints, ends[0])
    if not (followed.complete and followed.verified):
        return None
    at = np.searchsorted(followed.t, np.arange(len(joints)))
    apart = float(np.max(np.abs(followed.poses[at] - poses) / unit))
    # At the ends themselves a limit may be touched; rounding then sees it left and entered.
    if apart > _SAME or any(1e-6 < event.t < len(joints) - 1 - 1e-6 for event in followed.events):
        return None
    length = float(np.sum(np.sqrt(np.sum((np.diff(poses, axis=0) / unit) ** 2, axis=1))))
    evidence = {
        "the track of the loop is this far from the path, dimensionless": apart,
        "steps of the track there and back": followed.evidence["steps there and back"],
        "poses looked at": len(clear),
        "largest relative change of the clearance between two of them": round(change, 4),
    }
    least = min(float(np.min(clear)), float(np.min(followed.clearance)))
    return Path(poses, joints, clear[::looks], least, length, evidence)
