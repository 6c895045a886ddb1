"""Cusp curves in the joint space, and the number of cusps of its sections."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.errors import InputError
from jaxkin.mapping.cusp_curves import CuspCurves
from jaxkin.plot import boxes, style

if TYPE_CHECKING:
    from jaxkin.mapping.cusp_curves import Transitions

#: Curves in turn; dashes tell them apart where colours do not.
_COLOURS = tuple(style.OKABE_ITO[c] for c in ("blue", "vermillion", "green", "purple", "orange", "sky", "black"))
_DASHES: tuple[Any, ...] = ("solid", (0, (6, 1.6)), (0, (1.4, 1.2)), (0, (6, 1.6, 1.4, 1.6)))
#: Marks of transitions by kind; kinds that are not here have the last one.
_MARKS = {"swallowtail": "^", "lips": "o", "beaks": "s", "end": "D"}
_OTHER_MARK = "*"
_KINDS = {"end": "end of a curve"}
#: A legend names so many curves one by one; more are counted.
_MOST_NAMES = 8
#: The values of so many transitions are written out.
_MOST_VALUES = 16


def look_of(number: int) -> dict[str, Any]:
    """Returns colour and dashes of a curve by its number."""
    return {
        "color": _COLOURS[number % len(_COLOURS)],
        "linestyle": _DASHES[number // len(_COLOURS) % len(_DASHES)],
        "linewidth": 1.6,
    }


def cusp_curves(result: CuspCurves, axis: str | None = None, axes: Sequence[Axes] | None = None) -> np.ndarray:
    """Draws cusp curves in the joint space, and along one joint the number of cusps of its sections.

    The first panel is the box of the three free joints. With an axis there are three more: the projections on the
    planes of this joint and each of the others, and the number of distinct cusps against it, a step function whose
    steps are the transitions: swallowtails, lips and beaks, and ends of curves on the box's faces. All three
    have the joint as their horizontal axis.

    Args:
        result: What ``jk.cusp_curves`` returned.
        axis: One of the free joints.
        axes: Where to draw: Axes with ``projection="3d"``, and with an axis three flat ones after it.

    Returns:
        The Axes, in the order named.

    Raises:
        InputError: There is no curve, the axis is not free, or the Axes are too many, too few or of the wrong kind.
    """
    style.check_kind(result, CuspCurves, "cusp curves, from jk.cusp_curves")
    if not len(result):
        raise InputError("There is no cusp curve to draw: choose a larger box in jk.cusp_curves.")
    free, box = _box(result)
    if axis is not None and axis not in free:
        raise InputError(f"The axis is {axis!r}: choose one of the free joints, {', '.join(free)}.")
    panels = _panels(axis) if axes is None else _given(axes, axis)
    space(cast(Axes3D, panels[0]), result)
    handles = curve_handles(result)
    if axis is None:
        panels[0].legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 0.9), frameon=False, fontsize="small")
        return panels
    transitions = result.transitions(axis)
    inside = _drawn_marks(transitions)
    for ax, other in zip(panels[1:3], (name for name in free if name != axis), strict=True):
        _projection(ax, result, (axis, other), transitions)
        if axes is None:
            # The step function at the bottom has the joint's name.
            ax.tick_params(labelbottom=False)
            ax.set_xlabel("")
    ends = box[free.index(axis)]
    _steps(panels[3], result, axis, transitions, (float(ends[0]), float(ends[1])))
    panels[0].legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False, fontsize="small"
    )
    if inside:
        panels[3].legend(handles=inside, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize="small")
    return panels


def space(ax: Axes3D, result: CuspCurves) -> None:
    """Draws the curves in the box of the three free joints."""
    free, box = _box(result)
    boxes.frame(ax, free, [result.units[name] for name in free], box)
    columns = [result.joint_names.index(name) for name in free]
    for number, curve in enumerate(result):
        ax.plot(*points_of(curve)[:, columns].T, **look_of(number))


def curve_handles(result: CuspCurves) -> list[Artist]:
    """Returns the legend's entries: a curve each, or the first ones and how many more there are."""
    shown = list(result)[:_MOST_NAMES]
    found: list[Artist] = [Line2D([], [], label=_name(curve), **look_of(k)) for k, curve in enumerate(shown)]
    if len(result) > len(shown):
        found.append(Line2D([], [], linestyle="none", label=f"and {len(result) - len(shown)} more"))
    return found


def _name(curve: Any) -> str:
    return style.words(str(curve.name)) + (", closed" if curve.closed else "")


def _box(result: CuspCurves) -> tuple[list[str], np.ndarray]:
    """Returns the names of the free joints and the ends ``(3, 2)`` of the box."""
    box = result.request.get("box") or result.request["section"]
    free = [name for name, value in box.items() if isinstance(value, list | tuple)]
    return free, np.array([box[name][:2] for name in free], float)


def points_of(curve: Any) -> np.ndarray:
    """Returns the points of a curve, the first one again at the end where it is closed."""
    return np.concatenate([curve.joints, curve.joints[: int(curve.closed)]])


def _panels(axis: str | None) -> np.ndarray:
    """Returns new Axes, placed by hand: constrained layout does not see how far labels in three dimensions reach."""
    panels = np.empty(1 if axis is None else 4, object)
    if axis is None:
        figure = plt.figure(figsize=(6.6, 4.6))
        panels[0] = figure.add_axes((0.0, 0.05, 0.72, 0.95), projection="3d")
        return panels
    figure = plt.figure(figsize=(9.6, 6.6))
    panels[0] = figure.add_axes((0.0, 0.24, 0.41, 0.74), projection="3d")
    panels[1] = figure.add_axes((0.53, 0.74, 0.29, 0.23))
    panels[2] = figure.add_axes((0.53, 0.47, 0.29, 0.23), sharex=panels[1])
    panels[3] = figure.add_axes((0.53, 0.09, 0.29, 0.26), sharex=panels[1])
    return panels


def _given(axes: Sequence[Axes], axis: str | None) -> np.ndarray:
    """Returns the caller's Axes, checked."""
    needed = 1 if axis is None else 4
    flat = list(np.ravel(np.asarray(axes, dtype=object)))
    if len(flat) != needed or any(isinstance(ax, Axes3D) != (k == 0) for k, ax in enumerate(flat)):
        rest = "" if axis is None else " and after it three flat ones"
        raise InputError(
            f'axes must be one with projection="3d"{rest}, but {len(flat)} were given: give these or none.'
        )
    panels = np.empty(needed, object)
    panels[:] = flat
    return panels


def _projection(ax: Axes, result: CuspCurves, names: tuple[str, str], transitions: "Transitions") -> None:
    columns = [result.joint_names.index(name) for name in names]
    for number, curve in enumerate(result):
        ax.plot(*points_of(curve)[:, columns].T, **look_of(number))
    for kind, chosen in _by_kind(transitions):
        ax.plot(*transitions.joints[chosen][:, columns].T, linestyle="none", zorder=4, **_mark(kind))
    for label, name, axis in zip((ax.set_xlabel, ax.set_ylabel), names, (ax.xaxis, ax.yaxis), strict=True):
        label(style.axis_label(name, result.units[name]))
        if result.units[name] == "rad":
            style.ticks_in_pi(axis)


def _by_kind(transitions: "Transitions") -> list[tuple[str, np.ndarray]]:
    """Returns the kinds of transitions there are, each with the numbers of its own."""
    kinds = [str(kind) for kind in transitions.kinds]
    return [
        (kind, np.array([k for k, own in enumerate(kinds) if own == kind])) for kind in dict.fromkeys(sorted(kinds))
    ]


def _mark(kind: str) -> dict[str, Any]:
    mark = next((own for name, own in _MARKS.items() if kind.startswith(name)), _OTHER_MARK)
    return {
        "marker": mark,
        "markersize": 5.0,
        "markerfacecolor": "white",
        "markeredgecolor": "black",
        "markeredgewidth": 1.0,
    }


def _drawn_marks(transitions: "Transitions") -> list[Artist]:
    return [
        Line2D([], [], linestyle="none", label=f"{_KINDS.get(kind, kind)} ({len(chosen)})", **_mark(kind))
        for kind, chosen in _by_kind(transitions)
    ]


def _steps(ax: Axes, result: CuspCurves, axis: str, transitions: "Transitions", ends: tuple[float, float]) -> None:
    """Draws the number of cusps against one joint."""
    values, counts = np.asarray(transitions.values), np.asarray(transitions.counts).reshape(-1, 2)
    levels = [*counts[:, 0], counts[-1, 1]] if len(values) else [result.count(axis, 0.5 * (ends[0] + ends[1]))]
    edges = np.concatenate([[ends[0]], values, [ends[1]]])
    ax.stairs(levels, edges, baseline=None, color=style.OKABE_ITO["blue"], linewidth=1.8)
    ax.set(xlim=ends, ylim=(min(0, min(levels)) - 0.5, max(levels) + 0.8))
    ax.yaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_ylabel("number of cusps")
    ax.set_xlabel(style.axis_label(axis, result.units[axis]))
    for kind, chosen in _by_kind(transitions):
        ax.plot(values[chosen], counts[chosen].mean(axis=1), linestyle="none", zorder=4, **_mark(kind))
    if len(values) <= _MOST_VALUES:
        _write_values(ax, values, ends)


def _write_values(ax: Axes, values: np.ndarray, ends: tuple[float, float]) -> None:
    """Writes the values of the transitions above the Axes."""
    above = ax.get_xaxis_transform()
    for value, place in zip(values, _apart(values, ends), strict=True):
        ax.plot([value, value], [0.0, 1.0], transform=above, color="#BBBBBB", linewidth=0.5, zorder=0.5)
        ax.plot([value, place], [1.0, 1.05], transform=above, color="#777777", linewidth=0.5, clip_on=False)
        look: dict[str, Any] = {"rotation": 90, "ha": "center", "va": "bottom", "fontsize": "x-small"}
        ax.text(place, 1.07, style.number(float(value)), transform=above, **look)


def _apart(values: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """Returns places for texts near values, none over another."""
    gap = 0.045 * (ends[1] - ends[0])
    places = np.array(values, float)
    for _ in range(100):
        short = np.maximum(gap - np.diff(places), 0.0)
        if not np.any(short > 1e-9 * gap):
            break
        places[:-1] -= short / 2
        places[1:] += short / 2
        places = np.clip(places, ends[0] + 0.3 * gap, ends[1] - 0.3 * gap)
    return places
