"""A planar mechanism in one pose: its outline, or its links."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxkin.core.bodies import Body
from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.jacobian import jacobians
from jaxkin.plot import style

#: Points of base and platform nearer than this share of the picture would have their letters on one another.
_NEAR = 0.12
#: Room about a linkage, as a share of its longer side.
_ROOM = 0.06
#: Colours and widths of links by kind, as in space.
_LINES = {
    "base": ("#8C8C8C", 2.0),
    "actuated": (style.OKABE_ITO["blue"], 2.6),
    "passive": ("#555555", 1.8),
    "link": ("#555555", 1.8),
    "axis": ("#777777", 0.8),
}


def is_planar(robot: object) -> bool:
    """True for a mechanism that can be drawn in the plane."""
    return hasattr(robot, "outline") or hasattr(robot, "linkage")


def check_outline(robot: object) -> None:
    """Refuses a mechanism that cannot be drawn in the plane.

    Raises:
        InputError: It has neither a method ``outline`` nor ``linkage``.
    """
    if not is_planar(robot):
        raise InputError(
            f"{type(robot).__name__} has no method outline(pose) -> (base, platform) and none linkage(pose, joints) -> "
            "tuple[jaxkin.core.bodies.Body, ...]: add one of them to draw it."
        )


def sign_of(robot: Mechanism, pose: np.ndarray, joints: np.ndarray) -> int:
    """Returns the sign of det dF/dx."""
    return int(np.sign(np.linalg.det(np.asarray(jacobians(robot, pose, joints).direct))))


def draw_pose(
    robot: Any, pose: np.ndarray, joints: np.ndarray, ax: Axes, colour: str, *, letters: bool = True
) -> np.ndarray:
    """Draws base, legs and platform of one pose; returns the platform's points, ``(k, 2)``."""
    if hasattr(robot, "outline"):
        base, platform = robot.outline(pose)
        _outlined(base, platform, ax, colour, letters=letters)
        return platform
    bodies = robot.linkage(pose, joints)
    _linked(bodies, ax, colour, letters=letters)
    return np.concatenate([body.points for body in bodies if body.kind == "platform"])


def points_of(robot: Any, pose: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Returns all points of a drawing, ``(k, 2)``."""
    if hasattr(robot, "outline"):
        return np.concatenate(robot.outline(pose))
    return np.concatenate([body.points for body in robot.linkage(pose, joints)])


def finish(ax: Axes) -> None:
    """Gives Axes with a drawn mechanism equal aspect, margins and labels."""
    ax.set_aspect("equal")
    ax.margins(0.12)
    ax.set_xlabel("x (length)")
    ax.set_ylabel("y (length)")


def _outlined(base: np.ndarray, platform: np.ndarray, ax: Axes, colour: str, *, letters: bool) -> None:
    ax.fill(*base.T, facecolor="#DDDDDD", edgecolor="#777777", linewidth=1, zorder=1)
    for a, b in zip(base, platform, strict=True):
        ax.plot(*np.array([a, b]).T, color="#333333", linewidth=1.2, zorder=2)
    ax.fill(*platform.T, facecolor=colour, alpha=0.3, zorder=3)
    ax.plot(*np.vstack([platform, platform[:1]]).T, color=colour, linewidth=1.6, zorder=3)
    ax.plot(*base.T, "s", color="black", markersize=4, zorder=4)
    ax.plot(*platform.T, "o", color="white", markeredgecolor=colour, markersize=4, zorder=4)
    for letter, points, others, ink in (("A", base, platform, "black"), ("B", platform, base, colour)):
        for k, (point, away) in enumerate(zip(points, _outward(points, others), strict=True), 1):
            if letters:
                _letter(ax, f"${letter}_{k}$", point, away, ink)


def _linked(bodies: tuple[Body, ...], ax: Axes, colour: str, *, letters: bool) -> None:
    """Draws links as lines, joints as circles and the platform in its colour."""
    platform = [body for body in bodies if body.kind == "platform"]
    joints = [body for body in bodies if body.kind == "joint"]
    for body in bodies:
        if body.kind in _LINES:
            ink, width = _LINES[body.kind]
            ax.plot(*body.points.T, color=ink, linewidth=width, solid_capstyle="round", zorder=2)
    for body in platform:
        if len(body.points) > 2:
            ax.fill(*body.points.T, facecolor=colour, alpha=0.3, zorder=3)
        points = np.vstack([body.points, body.points[:1]]) if body.closed else body.points
        ax.plot(*points.T, color=colour, linewidth=1.6, zorder=3)
        # A platform that is a point shows its colour by the point alone.
        ax.plot(*body.points.T, "o", color=colour, markersize=7 if len(body.points) == 1 else 4, zorder=5)
    for body in joints:
        ax.plot(*body.points.T, "o", color="white", markeredgecolor="black", markersize=4, zorder=4)
    # Letters of a long and narrow drawing need as much room on its narrow side.
    every = np.concatenate([body.points for body in bodies])
    room = _ROOM * np.ptp(every, axis=0).max()
    ax.update_datalim([every.min(axis=0) - room, every.max(axis=0) + room])
    ax.autoscale_view()
    named = [body for body in (*joints, *platform) if len(body.points) == 1]
    places = np.array([body.points[0] for body in named]).reshape(-1, 2)
    for body, point, away in zip(named, places, _outward(places, np.zeros((0, 2))), strict=True):
        if letters:
            _letter(ax, style.symbol(body.name), point, away, colour if body.kind == "platform" else "black")


def _letter(ax: Axes, text: str, point: np.ndarray, away: np.ndarray, ink: str) -> None:
    options: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "x-small", "color": ink, "zorder": 6}
    x, y = map(float, 9 * away)
    ax.annotate(text, (float(point[0]), float(point[1])), textcoords="offset points", xytext=(x, y), **options)


def _outward(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Returns unit vectors from the centre of the points to each, turned away from other points nearby."""
    away = _unit(points - points.mean(axis=0))
    apart = points[:, None] - others[None]
    gaps = np.linalg.norm(apart, axis=-1, keepdims=True)
    near = (gaps < _NEAR * np.ptp(np.concatenate([points, others]), axis=0).max()) & (gaps > 0)
    return _unit(away + 2.0 * np.sum(np.where(near, apart / np.where(near, gaps, 1.0), 0.0), axis=1))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
