"""A path in the workspace or in the joint space, and the mechanism at places along it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.mechanism import Axis, Mechanism
from jaxkin.plot import boxes, planar, spatial, style

PATH = style.OKABE_ITO["blue"]
_SHADOW = "#BBBBBB"
_LABEL: dict[str, Any] = {"fontsize": "x-small", "ha": "center", "va": "center", "zorder": 12}
#: Room about a path, as a share of its extent.
_ROOM = 0.08


def drawable(robot: Mechanism | None) -> bool:
    """True where a mechanism is given and says what it looks like, in the plane or in space."""
    return robot is not None and (planar.is_planar(robot) or hasattr(robot, "bodies"))


def in_space(robot: Any) -> bool:
    """True for a mechanism that is drawn in three dimensions."""
    return hasattr(robot, "bodies")


def window(robot: Any, poses: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Returns low and high ends ``(2 or 3, 2)`` of a picture that holds the mechanism all along a path."""
    if in_space(robot):
        return spatial.limits([body for pose in poses for body in robot.bodies(pose)])
    points = np.concatenate([planar.points_of(robot, *pair) for pair in zip(poses, joints, strict=True)])
    low, high = points.min(axis=0), points.max(axis=0)
    room = _ROOM * float((high - low).max())
    return np.stack([low - room, high + room], axis=1)


def draw_mechanism(robot: Any, pose: np.ndarray, joints: np.ndarray, ax: Axes, ends: np.ndarray) -> None:
    """Draws the mechanism at one place of a path, in a picture with the given ends."""
    colour = style.SIGN_COLOURS[planar.sign_of(robot, pose, joints)]
    if isinstance(ax, Axes3D):
        bodies = robot.bodies(pose)
        spatial.frame(ax, ends, robot.pose_axes, spatial.view(bodies))
        spatial.draw(ax, bodies, colour, letters=False, size=float(np.ptp(ends, axis=1).max()))
        return
    planar.draw_pose(robot, pose, joints, ax, colour, letters=False)
    planar.finish(ax)
    ax.set(xlim=ends[0], ylim=ends[1])


def varying(points: np.ndarray) -> list[int]:
    """Returns the columns of ``(k, n)`` points that are not constant."""
    size = np.maximum(np.abs(points).max(axis=0), 1e-12)
    return [k for k in range(points.shape[1]) if np.ptp(points[:, k]) > 1e-9 * size[k]]


def draw_path(ax: Axes, points: np.ndarray, axes: Sequence[Axis], marks: np.ndarray, colour: str = PATH) -> None:
    """Draws a path with numbered places.

    Args:
        ax: Of three dimensions for three axes, flat for two; for other numbers each coordinate is drawn against the
            path.
        points: ``(k, n)``.
        axes: The n axes.
        marks: Numbers of the points that are marked 1, 2, ...
        colour: Of the path.
    """
    if len(axes) == 3:
        _in_space(ax, points, axes, marks, colour)
    elif len(axes) == 2:
        ax.plot(*points.T, color=colour, linewidth=1.8, zorder=5)
        style.dress(ax, *((axis.name, axis.unit) for axis in axes))
        for place, group in _together(points, marks):
            _dot(ax, place, group)
    else:
        _coordinates(ax, points, axes, marks)


def _in_space(ax: Any, points: np.ndarray, axes: Sequence[Axis], marks: np.ndarray, colour: str) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    box = np.stack([low, high], axis=1)
    room = _ROOM * np.maximum(high - low, 1e-9)
    box = box + np.stack([-room, room], axis=1)
    current = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    if ax.lines or ax.collections:
        # What is there already, as cusp curves, stays in the picture.
        box = np.stack([np.minimum(box[:, 0], current[:, 0]), np.maximum(box[:, 1], current[:, 1])], axis=1)
    boxes.frame(ax, [axis.name for axis in axes], [axis.unit for axis in axes], box, zoom=0.88)
    floor = np.broadcast_to(box[2, 0], len(points))
    ax.plot(*points[:, :2].T, floor, color=_SHADOW, linewidth=1.0, zorder=0.5)
    ax.plot(*points.T, color=colour, linewidth=1.8, zorder=5)
    for place, group in _together(points, marks):
        _dot(ax, place, group)


def _together(points: np.ndarray, marks: np.ndarray) -> list[tuple[np.ndarray, list[int]]]:
    """Returns places with the numbers, from 1, of the marks there: a closed loop starts where it ends."""
    size = np.maximum(np.ptp(points, axis=0), 1e-12)
    found: list[tuple[np.ndarray, list[int]]] = []
    for number, mark in enumerate(marks, 1):
        near = [group for place, group in found if np.max(np.abs(points[mark] - place) / size) < 1e-3]
        if near:
            near[0].append(number)
        else:
            found.append((points[mark], [number]))
    return found


def _dot(ax: Any, place: np.ndarray, group: list[int]) -> None:
    text = ", ".join(map(str, group))
    look = {"boxstyle": "round,pad=0.18", "facecolor": "white", "edgecolor": "black", "linewidth": 0.7}
    ax.text(*place, text, bbox=look, **_LABEL)


def _coordinates(ax: Axes, points: np.ndarray, axes: Sequence[Axis], marks: np.ndarray) -> None:
    """Draws every coordinate against the path, scaled to its own range: lengths and angles share no unit."""
    along = np.linspace(0.0, 1.0, len(points))
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-12)
    colours = tuple(style.OKABE_ITO[c] for c in ("blue", "vermillion", "green", "purple", "orange", "sky", "black"))
    for k, axis in enumerate(axes):
        label = f"{style.symbol(axis.name)}: {low[k]:.3g} to {low[k] + size[k]:.3g} {axis.unit}".replace("-", "−")
        ax.plot(along, (points[:, k] - low[k]) / size[k], color=colours[k % len(colours)], label=label, linewidth=1.5)
    for number, mark in enumerate(marks, 1):
        ax.axvline(float(along[mark]), color="#BBBBBB", linewidth=0.6, zorder=0.5)
        ax.text(float(along[mark]), 1.04, str(number), **_LABEL)
    ax.set(xlabel="path", ylabel="share of its range", ylim=(-0.05, 1.1))
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, frameon=False, fontsize="x-small")


def key_frames(points: np.ndarray, count: int) -> np.ndarray:
    """Returns the numbers of points at equal distances along a path, each coordinate measured by its own range."""
    share = points / np.maximum(np.ptp(points, axis=0), 1e-12)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(share, axis=0), axis=1))])
    return np.array([int(np.argmin(np.abs(arc - at))) for at in np.linspace(0.0, arc[-1], count)])
