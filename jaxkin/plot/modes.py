"""The mechanism itself, in all its assembly modes."""

import math
from typing import Any, overload

import matplotlib.pyplot as plt
import numpy as np
from jax.typing import ArrayLike
from matplotlib.axes import Axes

from jaxkin.core.branches import Branches
from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.jacobian import jacobians
from jaxkin.kinematics.solve import forward
from jaxkin.plot import poses as poses_in_space
from jaxkin.plot import style

#: Points of base and platform nearer than this share of the picture would have their letters on one another.
_NEAR = 0.12


@overload
def mechanism(robot: Mechanism, joints: ArrayLike, branches: Branches | None = None) -> np.ndarray: ...
@overload
def mechanism(robot: Mechanism, joints: ArrayLike, branches: Branches | None = None, *, ax: Axes) -> Axes: ...
def mechanism(
    robot: Mechanism, joints: ArrayLike, branches: Branches | None = None, *, ax: Axes | None = None
) -> np.ndarray | Axes:
    """Draws a mechanism in all its assembly modes, in the plane or in space.

    The platform, in space its outline, is coloured by the sign of the direct determinant (blue positive, vermillion
    negative), which is written out as well.

    Args:
        robot: A mechanism that can outline itself in the plane (``outline(pose)``), such as the 3-RPR, or that says
            what it looks like in space (``bodies(pose)``), such as the 3-PPPS and the TLPM.
        joints: ``(n_joint,)``.
        branches: Its forward solutions, if they are at hand.
        ax: Axes in which all modes are drawn over each other (with ``projection="3d"`` for a spatial mechanism);
            without it every mode has a panel.

    Returns:
        The Axes, or an array of them, one a mode.

    Raises:
        InputError: The mechanism has neither outline nor bodies, there is no real solution to draw, or the Axes are
            flat.
    """
    in_space = hasattr(robot, "bodies")
    if not in_space:
        check_outline(robot)
    found = forward(robot, joints) if branches is None else branches
    poses = np.asarray(found.values)[np.asarray(found.valid)]
    if len(poses) == 0:
        raise InputError(f"No real solution at joints {np.asarray(joints).tolist()}: {found.sentences()[0]}.")
    if in_space:
        return poses_in_space.modes(robot, joints, found, ax)
    if ax is not None:
        for number, pose in enumerate(poses, 1):
            _draw(robot, pose, joints, ax, number, overlaid=True)
        finish(ax)
        return ax
    columns = min(3, len(poses))
    rows = math.ceil(len(poses) / columns)
    figure, panels = plt.subplots(
        rows,
        columns,
        figsize=(2.5 * columns, 2.75 * rows),
        layout="constrained",
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    for number, (panel, pose) in enumerate(zip(panels.flat, poses, strict=False), 1):
        _draw(robot, pose, joints, panel, number, overlaid=False)
        finish(panel)
    for panel in panels.flat[len(poses) :]:
        panel.set_axis_off()
    for panel in panels.flat:
        panel.label_outer()
    _add_joints(figure, robot, np.asarray(joints), len(poses))
    return panels.ravel()[: len(poses)]


def _add_joints(figure: Any, robot: Mechanism, joints: np.ndarray, count: int) -> None:
    """Writes the joint values over all panels."""
    values = ", ".join(f"{style.symbol(a.name)} = {v:g}" for a, v in zip(robot.joint_axes, joints, strict=True))
    figure.suptitle(f"{count} assembly modes at {values}", fontsize="medium")


def check_outline(robot: object) -> None:
    """Refuses a mechanism that cannot outline itself.

    Raises:
        InputError: It has no method ``outline``.
    """
    if not hasattr(robot, "outline"):
        raise InputError(f"{type(robot).__name__} has no method outline(pose) -> (base, platform): add one to draw it.")


def draw_pose(robot: Any, pose: np.ndarray, ax: Axes, colour: str, *, letters: bool = True) -> np.ndarray:
    """Draws base, legs and platform of one pose; returns the platform's points, ``(k, 2)``."""
    base, platform = robot.outline(pose)
    ax.fill(*base.T, facecolor="#DDDDDD", edgecolor="#777777", linewidth=1, zorder=1)
    for a, b in zip(base, platform, strict=True):
        ax.plot(*np.array([a, b]).T, color="#333333", linewidth=1.2, zorder=2)
    ax.fill(*platform.T, facecolor=colour, alpha=0.3, zorder=3)
    ax.plot(*np.vstack([platform, platform[:1]]).T, color=colour, linewidth=1.6, zorder=3)
    ax.plot(*base.T, "s", color="black", markersize=4, zorder=4)
    ax.plot(*platform.T, "o", color="white", markeredgecolor=colour, markersize=4, zorder=4)
    texts = (("A", base, platform, "black"), ("B", platform, base, colour))
    for letter, points, others, ink in texts if letters else ():
        for k, (point, away) in enumerate(zip(points, _outward(points, others), strict=True), 1):
            options = {"ha": "center", "va": "center", "fontsize": "x-small", "color": ink, "zorder": 5}
            ax.annotate(f"${letter}_{k}$", point, textcoords="offset points", xytext=9 * away, **options)
    return platform


def finish(ax: Axes) -> None:
    """Gives Axes with a drawn mechanism equal aspect, margins and labels."""
    ax.set_aspect("equal")
    ax.margins(0.12)
    ax.set_xlabel("x (length)")
    ax.set_ylabel("y (length)")


def _draw(robot: Any, pose: np.ndarray, joints: ArrayLike, ax: Axes, number: int, *, overlaid: bool) -> None:
    determinant = float(np.linalg.det(np.asarray(jacobians(robot, pose, joints).direct)))
    sign = int(np.sign(determinant))
    platform = draw_pose(robot, pose, ax, style.SIGN_COLOURS[sign], letters=not overlaid)
    if overlaid:
        centre = platform.mean(axis=0)
        ax.text(centre[0], centre[1], str(number), ha="center", va="center", zorder=5)
        return
    word = {1: "> 0", -1: "< 0", 0: "= 0"}[sign]
    ax.set_title(f"{number}:  $\\phi$ = {style.number(pose[2])} rad,  det {word}", fontsize="small")


def _outward(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Returns unit vectors from the centre of the points to each, turned away from other points nearby."""
    away = _unit(points - points.mean(axis=0))
    apart = points[:, None] - others[None]
    gaps = np.linalg.norm(apart, axis=-1, keepdims=True)
    near = (gaps < _NEAR * np.ptp(np.concatenate([points, others]), axis=0).max()) & (gaps > 0)
    return _unit(away + 2.0 * np.sum(np.where(near, apart / np.where(near, gaps, 1.0), 0.0), axis=1))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
