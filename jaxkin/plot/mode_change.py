"""A change of assembly mode without a singularity: mechanism, workspace, joint space and clearance side by side."""

import textwrap
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping._mode_change_records import ModeChange
from jaxkin.plot import _mode_change_panels as parts
from jaxkin.plot import _paths

if TYPE_CHECKING:
    from jaxkin.mapping.cusp_curves import CuspCurves
    from jaxkin.mapping.records import Cusps, SingularCurves

#: The mechanism is shown at so many places of the path.
FRAMES = 5
#: Inches: width and height of the panels below, and height of the mechanism.
_WIDTH, _HEIGHT, _MECHANISM = 3.7, 3.9, 2.5


def mode_change(
    result: ModeChange,
    robot: Mechanism | None = None,
    curves: "CuspCurves | SingularCurves | None" = None,
    cusps: "Cusps | None" = None,
) -> np.ndarray:
    """Draws a change of assembly mode: the mechanism at five places of the path, and the path itself.

    Below the mechanisms are the path in the workspace, its loop in the joint space (it ends where it starts), and the
    clearance along it, which is nowhere zero. Numbers 1 to 5 are the places shown above. In three dimensions the
    shadow of a path is on the floor. Where no path was found, the two poses are drawn, with the reason.

    Args:
        result: What ``jk.mode_change`` returned.
        robot: The mechanism, if it can be drawn; without it the upper row is left out.
        curves: Cusp curves; or the singular curves of the section in which the loop lies. By default the cusp curves
            of the record, if it has them, with the encircled ones in colour.
        cusps: The cusps of that section.

    Returns:
        The Axes: one for each mechanism, then workspace, joint space and clearance.

    Raises:
        InputError: There is neither a path nor a mechanism to draw, or curves or cusps are of another section.
    """
    if isinstance(result, ModeChange) and not result.found and _paths.drawable(robot):
        return _apart(result, robot)
    parts.check(result)
    curves = parts.own_curves(result) if curves is None and cusps is None else curves
    shown = _paths.drawable(robot)
    frames = _paths.key_frames(np.asarray(result.poses), FRAMES)
    panels = _new_panels(result, robot if shown else None, curves)
    if shown:
        ends = _paths.window(robot, result.poses, result.joints)
        for number, (ax, frame) in enumerate(zip(panels, frames, strict=False), 1):
            _paths.draw_mechanism(robot, result.poses[frame], result.joints[frame], ax, ends)
            ax.set_title(_frame_title(number, len(frames)), fontsize="small")
            if number > 1:
                ax.set_ylabel("")
                ax.tick_params(labelleft=isinstance(ax, Axes3D))
    below = panels[-3:]
    parts.workspace(below[0], result, frames)
    parts.joint_space(below[1], result, frames, curves, cusps)
    parts.clearance(below[2], result, frames)
    figure = panels[0].figure
    figure.suptitle(parts.title(result), fontsize="medium", y=1 - 0.08 / figure.get_figheight(), va="top")
    return panels


def _apart(result: ModeChange, robot: Mechanism | None) -> np.ndarray:
    """Draws start and goal of a change that was not found."""
    poses, joints = np.stack([result.start, result.goal]), np.tile(result.request["joints"], (2, 1))
    ends = _paths.window(robot, poses, joints)
    kind = "3d" if _paths.in_space(robot) else "rectilinear"
    figure, axes = plt.subplots(1, 2, figsize=(6.8, 4.0), layout="constrained", subplot_kw={"projection": kind})
    for ax, pose, q, name in zip(axes, poses, joints, ("start", "goal"), strict=True):
        _paths.draw_mechanism(robot, pose, q, ax, ends)
        ax.set_title(name, fontsize="small")
    figure.suptitle(textwrap.fill(f"No path: {result.reason}", 90), fontsize="small")
    return axes


def _frame_title(number: int, count: int) -> str:
    return {1: "1: start", count: f"{count}: goal"}.get(number, str(number))


def _new_panels(result: ModeChange, robot: Mechanism | None, curves: object) -> np.ndarray:
    """Returns new Axes: a row of mechanisms where there is one, and three panels below.

    Placed by hand: constrained layout does not see how far the labels of a 3D plot reach.
    """
    above = _MECHANISM if robot is not None else 0.0
    size = np.array([3 * _WIDTH, _HEIGHT + above + 0.4])
    figure: Figure = plt.figure(figsize=tuple(size))

    def panel(left: float, bottom: float, width: float, height: float, projection: str) -> Axes:
        place = np.array([left, bottom, width, height]) / np.tile(size, 2)
        return figure.add_axes(tuple(place), projection=projection)

    panels: list[Axes] = []
    if robot is not None:
        kind = "3d" if _paths.in_space(robot) else "rectilinear"
        step = (size[0] - 0.75) / FRAMES
        panels += [panel(0.7 + k * step, _HEIGHT + 0.55, step - 0.15, above - 0.75, kind) for k in range(FRAMES)]
    for k, dimensions in enumerate((len(parts.pose_axes(result)), len(parts.joint_axes(result, curves)))):
        if dimensions == 3:
            panels.append(panel(k * _WIDTH + 0.15, 0.7, _WIDTH - 0.5, _HEIGHT - 0.85, "3d"))
        else:
            panels.append(panel(k * _WIDTH + 0.7, 0.85, _WIDTH - 1.0, _HEIGHT - 1.25, "rectilinear"))
    panels.append(panel(2 * _WIDTH + 0.75, 0.85, _WIDTH - 1.0, _HEIGHT - 1.25, "rectilinear"))
    found = np.empty(len(panels), object)
    found[:] = panels
    return found
