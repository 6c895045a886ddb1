"""The fold of the poses over a section around singular poses, such as those over a cusp."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.plot import style
from jaxkin.plot.fold_surface import draw, singular_joints, upright_axis
from jaxkin.plot.planar import check_outline, draw_pose, finish

if TYPE_CHECKING:
    from jaxkin.mapping.fold import Fold

#: Panels side by side; in inches their width, the heights of a surface and a mechanism, and room for title and legend.
_COLUMNS = 3
_WIDTH, _SURFACE, _MECHANISM, _TITLE, _LEGEND = 3.7, 3.2, 2.9, 0.25, 0.4


def folds(
    folds: "Fold | Sequence[Fold]", robot: Mechanism | None = None, axes: Sequence[Axes] | np.ndarray | None = None
) -> np.ndarray:
    """Draws the surface of poses over a section around singular poses, and the mechanism in each of them.

    Upright is the pose coordinate that tells the sheets apart best, an angle by preference. The sheets are coloured
    by the sign of the direct determinant; they meet along the fold, whose projection is on the floor, with the
    cusp where it turns back. At a cusp only so much of the record is drawn that all three sheets are there whole.

    Args:
        folds: What ``jk.fold`` returned, one or several: the poses over one cusp, for instance.
        robot: The mechanism, drawn in every pose; it must be drawable in the plane. Not drawn if not given.
        axes: Axes with ``projection="3d"``, one a fold, followed by flat ones, one a fold, for the mechanism.

    Returns:
        The Axes: a row of surfaces, and with a robot a row of mechanisms below it.

    Raises:
        InputError: There is no fold, too many or too few Axes or flat ones for a surface, no outline.
    """
    several = list(folds) if isinstance(folds, Sequence) else [folds]
    if not several:
        raise InputError("There is no fold to draw: give what jk.fold returned, one record or several.")
    if robot is not None:
        check_outline(robot)
    panels = _new_axes(len(several), robot is not None) if axes is None else _given(axes, len(several), robot)
    upright = upright_axis(several)
    handles: list[Artist] = []
    for fold, ax in zip(several, panels[0], strict=True):
        handles = draw(fold, cast(Axes3D, ax), upright)
    if robot is not None:
        for fold, ax in zip(several, panels[1], strict=True):
            draw_pose(robot, fold.pose, singular_joints(fold), ax, style.SIGN_COLOURS[0])
            finish(ax)
    _finish(several, panels, handles, own=axes is None)
    return panels if robot is not None else panels[0]


# --- the sheet of paper -------------------------------------------------------------------------------------


def _new_axes(count: int, with_robot: bool) -> np.ndarray:
    """Returns new Axes ``(1 or 2, count)``: a mechanism below every surface, or beside the only one."""
    beside = with_robot and count == 1
    columns, rows = min(_COLUMNS, count), math.ceil(count / _COLUMNS)
    block = _SURFACE + (_MECHANISM if with_robot and not beside else 0.0)
    # Over one panel the legend has two rows.
    legend = _LEGEND if count + with_robot > 1 else 1.6 * _LEGEND
    width, height = _WIDTH * (columns + beside), block * rows + _TITLE + legend
    figure = plt.figure(figsize=(width, height))
    panels = np.empty((1 + with_robot, count), object)
    # Places by hand: constrained layout does not see how far the labels of a 3D plot reach.
    for k in range(count):
        left, top = _WIDTH * (k % columns), height - _TITLE - block * (k // columns)
        place = (left + 0.25, top - _SURFACE, _WIDTH - 0.5, _SURFACE + 0.1)
        panels[0, k] = figure.add_axes(_share(place, width, height), projection="3d")
        if with_robot:
            across, down = (left + _WIDTH, top - _MECHANISM - 0.25) if beside else (left, top - block)
            place = (across + 0.75, down + 0.55, _WIDTH - 1.05, _MECHANISM - 0.7)
            panels[1, k] = figure.add_axes(_share(place, width, height))
    return panels


def _share(place: tuple[float, ...], width: float, height: float) -> tuple[float, float, float, float]:
    left, bottom, wide, high = place
    return left / width, bottom / height, wide / width, high / height


def _given(axes: Sequence[Axes] | np.ndarray, count: int, robot: Mechanism | None) -> np.ndarray:
    """Returns the caller's Axes ``(1 or 2, count)``."""
    flat = list(np.ravel(np.asarray(axes, dtype=object)))
    rows = 1 if robot is None else 2
    if len(flat) != rows * count:
        need = f"{count} with three dimensions" + ("" if robot is None else f" and {count} flat ones for the mechanism")
        raise InputError(f"{count} folds need {need}, but axes has {len(flat)}: give so many, or none.")
    for k, ax in enumerate(flat):
        if isinstance(ax, Axes3D) != (k < count):
            raise InputError(
                f"Axes number {k + 1} {'are flat' if k < count else 'have three dimensions'}: the first {count} must "
                'be made with projection="3d", the others without.'
            )
    panels = np.empty((rows, count), object)
    panels.flat[:] = flat
    return panels


def _finish(folds: list["Fold"], panels: np.ndarray, handles: list[Artist], *, own: bool) -> None:
    """Adds titles and the legend."""
    for fold, ax in zip(folds, panels[0], strict=True):
        ax.set_title(_values(fold.pose_names, fold.pose, fold.units), fontsize="small", y=0.95 if own else None)
    look: dict[str, Any] = {"handles": handles, "frameon": False, "fontsize": "small"}
    if not own:
        panels[0, 0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.03), ncols=3, columnspacing=1.5, **look)
        return
    figure = panels[0, 0].figure
    look |= {"loc": "lower center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": figure.transFigure}
    panels[0, 0].legend(ncols=len(handles) if panels.size > 1 else 3, columnspacing=1.5, **look)
    for ax in panels[1:].flat:
        _fill(ax)
    joints = np.array([singular_joints(fold) for fold in folds])
    if np.ptp(joints, axis=0).max() < 1e-6 * (1 + np.abs(joints).max()):
        count = f"{len(folds)} poses" if len(folds) > 1 else "Pose"
        where = ", ".join(
            f"{style.symbol(name)} = {value:g}" for name, value in zip(folds[0].joint_names, joints[0], strict=True)
        )
        figure.suptitle(
            f"{count} over {where}",
            fontsize="medium" if panels.size > 1 else "small",
            y=1 - 0.08 / figure.get_figheight(),
            va="top",
        )


def _fill(ax: Axes) -> None:
    """Widens the limits so that equal aspect fills the panel, with room for letters."""
    ends = np.array([ax.dataLim.min, ax.dataLim.max])
    panel = ax.get_window_extent()
    scale = max((ends[1] - ends[0]) / (panel.width, panel.height)) * 1.3
    for (low, high), side, set_limits in zip(
        ends.T, (panel.width, panel.height), (ax.set_xlim, ax.set_ylim), strict=True
    ):
        set_limits((low + high - scale * side) / 2, (low + high + scale * side) / 2)


def _values(names: Sequence[str], values: np.ndarray, units: dict[str, str]) -> str:
    return ", ".join(
        f"{style.symbol(name)} = {style.number(float(value))}" + (" rad" if units[name] == "rad" else "")
        for name, value in zip(names, values, strict=True)
    )
