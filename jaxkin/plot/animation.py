"""A change of assembly mode as a moving picture."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import animation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.errors import InputError, StoreError
from jaxkin.core.mechanism import Mechanism
from jaxkin.plot import _mode_change_panels as parts
from jaxkin.plot import _paths, style

if TYPE_CHECKING:
    from jaxkin.mapping.cusp_curves import CuspCurves
    from jaxkin.mapping.mode_change import ModeChange
    from jaxkin.mapping.records import Cusps, SingularCurves

#: What writes each kind of file.
_WRITERS = {".gif": "pillow", ".mp4": "ffmpeg"}
_WIDTH, _HEIGHT = 3.6, 3.9
_DOT = style.OKABE_ITO["vermillion"]
_DPI = 80


def animate_mode_change(
    result: "ModeChange",
    path: str | os.PathLike[str],
    robot: Mechanism | None = None,
    curves: "CuspCurves | SingularCurves | None" = None,
    cusps: "Cusps | None" = None,
    *,
    frames: int = 48,
    seconds: float = 6.0,
    overwrite: bool = False,
) -> Path:
    """Writes a moving picture of a change of assembly mode: mechanism, workspace and joint space side by side.

    Args:
        result: What ``jk.mode_change`` returned.
        path: A file that ends in ``.gif``, or in ``.mp4`` where ffmpeg is installed.
        robot: The mechanism, if it can be drawn; without it the path alone is shown.
        curves: Cusp curves, or singular curves of the section in which the loop lies.
        cusps: The cusps of that section.
        frames: Number of pictures.
        seconds: How long they take.
        overwrite: Whether a file that is there is replaced.

    Returns:
        The file.

    Raises:
        InputError: There is no path to draw, the file has another ending or ffmpeg is missing, or the numbers are not
            positive.
        StoreError: The file exists, or cannot be written.
    """
    parts.check(result)
    target = Path(path)
    writer = _writer(target, frames, seconds, overwrite=overwrite)
    curves = parts.own_curves(result) if curves is None and cusps is None else curves
    steps = _paths.key_frames(np.asarray(result.poses), frames)
    figure, panels = _new_panels(result, robot if _paths.drawable(robot) else None, curves)
    marks = _paths.key_frames(np.asarray(result.poses), 2)
    parts.workspace(panels[-2], result, marks)
    parts.joint_space(panels[-1], result, marks, curves, cusps)
    figure.suptitle(parts.title(result), fontsize="small", y=1 - 0.08 / _HEIGHT, va="top")
    ends = _paths.window(robot, result.poses, result.joints) if len(panels) == 3 else np.zeros((2, 2))
    dots = [_dot(panels[-2], result.poses, parts.pose_axes(result), result.pose_names)]
    dots.append(_dot(panels[-1], result.joints, parts.joint_axes(result, curves), result.joint_names))

    def show(step: int) -> list[Any]:
        if len(panels) == 3:
            panels[0].clear()
            _paths.draw_mechanism(robot, result.poses[step], result.joints[step], panels[0], ends)
            panels[0].set_title("mechanism", fontsize="small")
        for dot, points in dots:
            _move(dot, points[step])
        return [dot for dot, _ in dots]

    show(int(steps[0]))
    moving = animation.FuncAnimation(figure, show, frames=list(map(int, steps)), init_func=lambda: [], blit=False)  # type: ignore[arg-type]
    _write(moving, target, writer(fps=frames / seconds))
    plt.close(figure)
    return target


def _writer(target: Path, frames: int, seconds: float, *, overwrite: bool) -> Any:
    """Returns the class that writes this kind of file, before anything is drawn."""
    if frames < 2 or not seconds > 0:
        raise InputError(
            f"animate_mode_change: frames is {frames} and seconds is {seconds}: give at least 2 frames and a positive "
            "time."
        )
    kind = _WRITERS.get(target.suffix.lower())
    if kind is None:
        raise InputError(
            f"animate_mode_change: the file is {str(target)!r}, with the ending {target.suffix!r}: it must be one of "
            f"{', '.join(_WRITERS)}."
        )
    if not animation.writers.is_available(kind):
        raise InputError(f"animate_mode_change: {target.suffix} needs {kind}, which is not there: write a .gif.")
    if target.exists() and not overwrite:
        raise StoreError(
            f"animate_mode_change: {str(target)!r} exists: choose another file, or replace it with overwrite=True."
        )
    if not target.absolute().parent.is_dir():
        raise StoreError(f"animate_mode_change: {str(target.parent)!r} is no folder: make it, or choose another one.")
    return animation.writers[kind]


def _write(moving: animation.FuncAnimation, target: Path, writer: Any) -> None:
    """Writes aside and renames, so that a file that is there is whole."""
    aside = target.with_name(f".{target.stem}.new{target.suffix}")
    try:
        moving.save(aside, writer=writer, dpi=_DPI)
        os.replace(aside, target)
    except OSError as error:
        raise StoreError(
            f"animate_mode_change: {target} cannot be written ({error.strerror}): choose another place."
        ) from error
    finally:
        aside.unlink(missing_ok=True)


def _new_panels(result: "ModeChange", robot: Mechanism | None, curves: object) -> tuple[Figure, list[Axes]]:
    """Returns a figure with two panels, and before them one for the mechanism where it is drawn."""
    sizes = [len(parts.pose_axes(result)), len(parts.joint_axes(result, curves))]
    kinds = ["3d" if n == 3 else "rectilinear" for n in sizes]
    if robot is not None:
        kinds = ["3d" if _paths.in_space(robot) else "rectilinear", *kinds]
    figure = plt.figure(figsize=(_WIDTH * len(kinds), _HEIGHT))
    panels = []
    for k, kind in enumerate(kinds):
        # Placed by hand: constrained layout does not see how far the labels of a 3D plot reach.
        place = (0.03, 0.75, 0.85, 0.67) if kind == "3d" else (0.2, 0.75, 0.7, 0.66)
        left, bottom, width, height = place
        shares = ((k + left) / len(kinds), bottom / _HEIGHT, width / len(kinds), height)
        panels.append(figure.add_axes(shares, projection=kind))
    return figure, panels


def _dot(ax: Axes, points: np.ndarray, axes: Any, names: Any) -> tuple[Any, np.ndarray]:
    """Draws the moving dot of a panel; returns it with the places it takes."""
    columns = [list(names).index(axis.name) for axis in axes]
    if len(columns) == 3 or len(columns) == 2:
        places = points[:, columns]
    else:
        along = np.linspace(0.0, 1.0, len(points))
        places = np.stack([along, np.zeros_like(along)], axis=1)
    (dot,) = ax.plot(*places[:1].T, "o", color=_DOT, markeredgecolor="black", markersize=7, zorder=13)
    return dot, places


def _move(dot: Any, place: np.ndarray) -> None:
    if isinstance(dot.axes, Axes3D):
        dot.set_data_3d(*place[:, None])
    else:
        dot.set_data(*place[:, None])
