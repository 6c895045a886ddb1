"""Panels of a change of assembly mode: workspace, joint space, clearance."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Axis
from jaxkin.mapping._mode_change_records import ModeChange
from jaxkin.mapping.records import Cusps, SingularCurves
from jaxkin.plot import _paths, boxes, loci, style
from jaxkin.plot.cusp_curves import points_of

if TYPE_CHECKING:
    from jaxkin.mapping.cusp_curves import CuspCurves

_ENCIRCLED = style.OKABE_ITO["vermillion"]
_OTHERS = "#999999"


def check(result: Any) -> None:
    """Refuses what is no change of mode, or one that was not found.

    Raises:
        InputError: It is one of these.
    """
    style.check_kind(result, ModeChange, "a change of assembly mode, from jk.mode_change")
    if not result.found or result.poses is None or not len(result.poses):
        raise InputError(f"There is no path to draw: {result.reason or 'none was found'}. Choose another goal.")


def own_curves(result: ModeChange) -> "CuspCurves | None":
    """Returns the cusp curves around the loop, where they were looked for."""
    found = result.cusp_curves
    return found if found is not None and len(found) else None


def pose_axes(result: ModeChange) -> list[Axis]:
    """Returns the pose axes that vary along the path."""
    return [Axis(result.pose_names[k], result.units[result.pose_names[k]]) for k in _paths.varying(result.poses)]


def joint_axes(result: ModeChange, curves: object = None) -> list[Axis]:
    """Returns the joint axes that vary along the path, or those of the curves that are drawn with it."""
    names = [result.joint_names[k] for k in _paths.varying(result.joints)]
    if isinstance(curves, SingularCurves):
        names = list(loci.section_of(curves)[0])
    return [Axis(name, result.units[name]) for name in names]


def workspace(ax: Axes, result: ModeChange, frames: np.ndarray) -> None:
    """Draws the path in the workspace."""
    axes = pose_axes(result)
    columns = [result.pose_names.index(axis.name) for axis in axes]
    _paths.draw_path(ax, result.poses[:, columns], axes, frames)
    ax.set_title("workspace", fontsize="small")


def joint_space(
    ax: Axes,
    result: ModeChange,
    frames: np.ndarray,
    curves: "CuspCurves | SingularCurves | None" = None,
    cusps: Cusps | None = None,
) -> None:
    """Draws the loop in the joint space, over cusp curves or the singular curves of its section."""
    axes = joint_axes(result, curves)
    columns = [result.joint_names.index(axis.name) for axis in axes]
    handles: list[Any] = []
    if isinstance(curves, SingularCurves) or cusps is not None:
        _section(ax, result, cusps if curves is None else curves)
        handles = loci.draw(ax, curves, cusps)  # type: ignore[arg-type]
    elif curves is not None and isinstance(ax, Axes3D):
        handles = _cusp_curves(ax, result, curves, columns)
    _paths.draw_path(ax, result.joints[:, columns], axes, frames)
    ax.set_title("joint space", fontsize="small")
    if handles:
        figure: Any = ax.figure
        look: dict[str, Any] = {
            "loc": "lower center",
            "bbox_to_anchor": (0.5, 0.0),
            "bbox_transform": figure.transFigure,
        }
        ax.legend(handles=handles, ncols=4, frameon=False, fontsize="x-small", **look)


def _section(ax: Axes, result: ModeChange, given: Any) -> None:
    """Frames the section of curves or cusps, and refuses one that the loop leaves."""
    free, fixed = loci.section_of(given)
    for name, value in fixed.items():
        off = np.abs(result.joints[:, result.joint_names.index(name)] - value).max()
        if off > 1e-6 * (1 + abs(value)):
            raise InputError(
                f"The loop leaves the section {name} = {value:g} by up to {off:.2g}: give cusp curves in space, or "
                "none."
            )
    ends = [given.request["section"][name][:2] for name in free]
    ax.set(xlim=ends[0], ylim=ends[1])


def _cusp_curves(ax: Axes3D, result: ModeChange, curves: Any, columns: list[int]) -> list[Line2D]:
    """Draws cusp curves within the neighbourhood of the loop, the encircled ones in colour."""
    # Names are those of one record: curves of another box are numbered otherwise.
    encircled = set(result.encircled) if curves is own_curves(result) else set[str]()
    handles = {}
    for curve in curves:
        own = curve.name in encircled
        look: dict[str, Any] = {"color": _ENCIRCLED if own else _OTHERS, "linewidth": 1.8 if own else 0.9, "zorder": 4}
        points = points_of(curve)[:, columns]
        ax.plot(*points.T, **look)
        label = (
            f"encircled: {style.words(str(curve.name))}" if own else "other cusp curves" if encircled else "cusp curves"
        )
        handles[label] = Line2D([], [], label=label, **look)
    drawn = np.concatenate([points_of(curve)[:, columns] for curve in curves])
    boxes.frame(ax, *_described(result, columns), np.stack([drawn.min(axis=0), drawn.max(axis=0)], axis=1))
    return list(handles.values())


def _described(result: ModeChange, columns: list[int]) -> tuple[list[str], list[str]]:
    """Returns names and units of joints."""
    names = [result.joint_names[k] for k in columns]
    return names, [result.units[name] for name in names]


def clearance(ax: Axes, result: ModeChange, frames: np.ndarray) -> None:
    """Draws the clearance along the path."""
    values = np.asarray(result.clearances, float)
    along = np.linspace(0.0, 1.0, len(values))
    ax.plot(along, values, color=_paths.PATH, linewidth=1.8)
    least = int(np.argmin(values))
    ax.plot(along[least], values[least], "o", markerfacecolor="white", markeredgecolor="black", zorder=4)
    ax.annotate(
        f"least {result.clearance:.3g}",
        (along[least], values[least]),
        textcoords="offset points",
        xytext=(0, -11),
        ha="left" if along[least] < 0.1 else "right" if along[least] > 0.9 else "center",
        va="center",
        fontsize="x-small",
    )
    top = 1.12 * float(values.max())
    for number, frame in enumerate(frames, 1):
        ax.axvline(float(along[frame]), color="#BBBBBB", linewidth=0.6, zorder=0.5)
        ax.text(float(along[frame]), 1.03 * top, str(number), fontsize="x-small", ha="center", va="bottom")
    ax.axhline(0.0, color="black", linewidth=1.0)
    ax.set(xlim=(-0.02, 1.02), ylim=(-0.12 * top, top), xlabel="share of the path", ylabel="clearance")


def title(result: ModeChange) -> str:
    """Returns what a picture of the change says above its panels."""
    around = ", ".join(style.words(str(name)) for name in result.encircled)
    least = f"least clearance {result.clearance:.3g}"
    return f"Change of assembly mode without a singularity: {least}" + (f"; around {around}" if around else "")
