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
from jaxkin.kinematics.solve import forward
from jaxkin.plot import poses as poses_in_space
from jaxkin.plot import style
from jaxkin.plot.planar import check_outline, draw_pose, finish, sign_of


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
        robot: A mechanism that can outline itself in the plane (``outline(pose)``), such as the 3-RPR, or has links
            there (``linkage(pose, joints)``), such as the five-bar, or that says what it looks like in space
            (``bodies(pose)``), such as the 3-PPPS and the TLPM.
        joints: ``(n_joint,)``.
        branches: Its forward solutions, if they are at hand.
        ax: Axes in which all modes are drawn over each other (with ``projection="3d"`` for a spatial mechanism);
            without it every mode has a panel.

    Returns:
        The Axes, or an array of them, one a mode.

    Raises:
        InputError: The mechanism has no outline, linkage or bodies, there is no real solution to draw, or the Axes are
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
    number = f"{count} assembly modes at" if count > 1 else "One assembly mode at"
    figure.suptitle(f"{number} {values}", fontsize="medium")


def _draw(robot: Any, pose: np.ndarray, joints: ArrayLike, ax: Axes, number: int, *, overlaid: bool) -> None:
    sign = sign_of(robot, pose, np.asarray(joints))
    platform = draw_pose(robot, pose, np.asarray(joints), ax, style.SIGN_COLOURS[sign], letters=not overlaid)
    if overlaid:
        centre = platform.mean(axis=0)
        # A number in the middle of a platform that is a point would hide it.
        beside = (0, 0) if len(platform) > 1 else (8, 8)
        look: dict[str, Any] = {"textcoords": "offset points", "xytext": beside, "zorder": 6}
        ax.annotate(str(number), (centre[0], centre[1]), ha="center", va="center", **look)
        return
    word = {1: "> 0", -1: "< 0", 0: "= 0"}[sign]
    ax.set_title(f"{number}:  {_pose(robot, pose)},  det {word}", fontsize="small")


def _pose(robot: Mechanism, pose: np.ndarray) -> str:
    """Returns the angles of a pose in words; all of it where it has none."""
    pairs = list(zip(robot.pose_axes, pose, strict=True))
    angles = [f"{style.symbol(axis.name)} = {style.number(value)} rad" for axis, value in pairs if axis.is_angle]
    return ", ".join(angles or [f"{style.symbol(axis.name)} = {style.number(value)}" for axis, value in pairs])
