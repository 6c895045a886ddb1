"""Characteristic curves and surfaces: regular poses over singular joint values, with the singular ones."""

from collections.abc import Iterable, Sequence
from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.errors import InputError
from jaxkin.mapping._characteristic_records import CharacteristicCurves, CharacteristicSurfaces
from jaxkin.mapping.records import Curve
from jaxkin.plot import boxes, layers, style
from jaxkin.plot.shading import shaded

#: Signs of the determinant; dashes tell the curves' sources apart.
_SIGNS = {1: style.OKABE_ITO["blue"], -1: style.OKABE_ITO["vermillion"]}
_SOURCES = {"singular": "solid", "serial": (0, (4, 1.5))}
_SINGULAR: tuple[Any, ...] = ("solid", (0, (7, 1.6)), (0, (1.3, 1.1)), (0, (6, 1.6, 1.4, 1.6)))
_SERIAL = {"color": "#777777", "linestyle": (0, (1.2, 1.2)), "linewidth": 1.4}
#: Surfaces: characteristic ones by sign, singular ones paler.
_SURFACES = {1: style.OKABE_ITO["sky"], -1: style.OKABE_ITO["orange"]}
_SINGULAR_SURFACE = "#9A9A9A"
_OPACITY = 0.85
_ROOM = 0.05


def characteristic(
    result: CharacteristicCurves | CharacteristicSurfaces, axes: Sequence[Axes] | None = None
) -> np.ndarray:
    """Draws characteristic curves or surfaces in the workspace, with the singular ones over the same joints.

    Curves and surfaces are coloured by the sign of the direct determinant. Curves in three coordinates are drawn in
    space and in two projections. Where a mechanism has several working modes, panels are repeated for every one; a
    mechanism with six pose coordinates has panels for position and orientation.

    Args:
        result: What ``jk.characteristic_curves`` or ``jk.characteristic_surfaces`` returned.
        axes: Where to draw, as many as there are panels, with ``projection="3d"`` for three coordinates.

    Returns:
        The Axes.

    Raises:
        InputError: It is neither, there is nothing to draw, or the Axes are too many, too few or of the wrong kind.
    """
    style.check_kind(
        result,
        (CharacteristicCurves, CharacteristicSurfaces),
        "characteristic curves or surfaces, from jk.characteristic_curves or jk.characteristic_surfaces",
    )
    if isinstance(result, CharacteristicSurfaces):
        return _surfaces(result, axes)
    if not len(result) and not len(result.singular) and not len(result.serial):
        raise InputError("There is no curve to draw: choose a larger section in jk.characteristic_curves.")
    return _curves(result, axes)


# --- curves -------------------------------------------------------------------------------------------------


def _curves(result: CharacteristicCurves, axes: Sequence[Axes] | None) -> np.ndarray:
    modes = sorted({curve.working_mode for curve in result}, reverse=True) or [()]
    views = _views(result)
    kinds = [len(view) for view in views] * len(modes)
    panels = _new(kinds, len(views)) if axes is None else _given(axes, kinds)
    looks = _singular_looks(result)
    for ax, (mode, group) in zip(panels, ((mode, view) for mode in modes for view in views), strict=True):
        columns = [result.pose_names.index(name) for name in group]
        every = [curve.poses[:, columns] for curve in (*result, *result.singular, *result.serial) if len(curve.poses)]
        _frame(ax, result, group, every)
        angles = [result.units[name] == "rad" for name in group]
        for curve in result.serial:
            _line(ax, _closed(curve)[:, columns], angles, {**_SERIAL, "zorder": 3})
        for curve in result.singular:
            _line(ax, _closed(curve)[:, columns], angles, {**looks[curve.label], "zorder": 4})
        for curve in result:
            if curve.working_mode == mode:
                _line(ax, _closed(curve)[:, columns], angles, _look(curve))
        if len(modes) > 1:
            ax.set_title(f"working mode {mode_text(mode)}", fontsize="small")
    _legend(panels, _curve_handles(result, looks), own=axes is None)
    return panels


def mode_text(mode: Iterable[int]) -> str:
    """Returns the signs of a working mode."""
    return "(" + ", ".join("+" if sign > 0 else "−" for sign in mode) + ")"


def _views(result: CharacteristicCurves) -> list[list[str]]:
    """Returns the pose coordinates of each panel, two or three: lengths and angles apart where there are many."""
    names = list(result.pose_names)
    if len(names) == 2:
        return [names]
    angles = [name for name in names if result.units[name] == "rad"]
    if len(names) == 3:
        last = angles[-1] if angles else names[-1]
        first, second = (name for name in names if name != last)
        return [names, [first, second], [first, last]]
    lengths = [name for name in names if name not in angles]
    return [group[:3] for group in (lengths, angles) if len(group) > 1]


def _singular_looks(result: CharacteristicCurves) -> dict[str, dict[str, Any]]:
    labels = list(dict.fromkeys(curve.label for curve in result.singular))
    return {
        label: {"color": "black", "linestyle": _SINGULAR[k % len(_SINGULAR)], "linewidth": 1.9}
        for k, label in enumerate(labels)
    }


def _look(curve: Any) -> dict[str, Any]:
    return {"color": _SIGNS[int(curve.sign)], "linestyle": _SOURCES[curve.kind], "linewidth": 1.3, "zorder": 5}


def _closed(curve: Curve | Any) -> np.ndarray:
    """Returns the poses of a curve, the first again at the end where it is closed; none of a virtual one."""
    if getattr(curve, "virtual", False):
        return np.zeros((0, curve.poses.shape[1]))
    return np.concatenate([curve.poses, curve.poses[: int(curve.closed)]])


def _line(ax: Axes, points: np.ndarray, angles: Sequence[bool], look: dict[str, Any]) -> None:
    """Draws a polyline, interrupted where an angle goes over its glued ends."""
    if not len(points):
        return
    jumps = np.any((np.abs(np.diff(points, axis=0)) > np.pi) & np.array(angles), axis=1)
    for piece in np.split(points, np.flatnonzero(jumps) + 1):
        ax.plot(*piece.T, **look)


def _frame(ax: Axes, result: Any, names: Sequence[str], every: Sequence[np.ndarray]) -> None:
    units = [result.units[name] for name in names]
    points = np.concatenate(list(every))
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    room = _ROOM * np.maximum(high - low, 1e-9)
    box = np.stack([low - room, high + room], axis=1)
    for k, unit in enumerate(units):
        if unit == "rad" and high[k] - low[k] > 0.95 * 2 * np.pi:
            box[k] = -np.pi, np.pi
    if isinstance(ax, Axes3D):
        boxes.frame(ax, names, units, box)
        return
    style.dress(ax, (names[0], units[0]), (names[1], units[1]))
    ax.set(xlim=box[0], ylim=box[1])


def _curve_handles(result: CharacteristicCurves, looks: dict[str, dict[str, Any]]) -> list[Artist]:
    found: list[Artist] = []
    for label, look in looks.items():
        found.append(Line2D([], [], label=f"singular, {style.symbol(label)} = 0" if label else "singular", **look))
    if len(result.serial):
        found.append(Line2D([], [], label="a leg stretched or folded", **_SERIAL))
    seen = dict.fromkeys((curve.kind, int(curve.sign)) for curve in result)
    several = len({kind for kind, _ in seen}) > 1
    for kind, sign in sorted(seen, key=lambda pair: (pair[0] != "singular", -pair[1])):
        label = f"characteristic, det {'>' if sign > 0 else '<'} 0"
        label += {"singular": ", of a singularity", "serial": ", of a leg"}[kind] if several else ""
        found.append(Line2D([], [], label=label, color=_SIGNS[sign], linestyle=_SOURCES[kind], linewidth=1.3))
    return found


# --- surfaces -----------------------------------------------------------------------------------------------


def _surfaces(result: CharacteristicSurfaces, axes: Sequence[Axes] | None) -> np.ndarray:
    if not any(len(surface.faces) for surface in result):
        raise InputError(
            "There is no characteristic surface to draw: every pose over the singular joints is singular itself, or "
            "outside the box; choose a larger one in jk.characteristic_surfaces."
        )
    singular = result.singular
    free = list(singular.free)
    columns = [result.pose_names.index(name) for name in free]
    box = np.array([singular.request["box"][name][:2] for name in free], float)
    signs = sorted({int(surface.sign) for surface in result if len(surface.faces)}, reverse=True)
    panels = _new([3] * len(signs), 2) if axes is None else _given(axes, [3] * len(signs))
    units = [result.units[name] for name in free]
    scale = boxes.proportions(units, box) / (box[:, 1] - box[:, 0])
    for ax, sign in zip(panels, signs, strict=True):
        boxes.frame(cast(Axes3D, ax), free, units, box)
        shapes, paint = [], []
        for surface in (*singular, *(own for own in result if own.sign == sign and len(own.faces))):
            ours = hasattr(surface, "sign")
            triangles = _inside(surface.vertices[:, columns][surface.faces], box)
            shapes.append(triangles)
            colour = _SURFACES[sign] if ours else _SINGULAR_SURFACE
            paint.append(shaded(np.array(to_rgb(colour)), triangles * scale))
        layers.add_layers(cast(Axes3D, ax), np.concatenate(shapes), np.concatenate(paint), _OPACITY)
        ax.set_title(f"det {'>' if sign > 0 else '<'} 0", fontsize="small", y=0.97)
    handles: list[Artist] = [
        Patch(facecolor=_SINGULAR_SURFACE, label="singular"),
        *(Patch(facecolor=_SURFACES[s], label=f"characteristic, det {'>' if s > 0 else '<'} 0") for s in signs),
    ]
    _legend(panels, handles, own=axes is None)
    return panels


def _inside(triangles: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Returns the triangles in the box: those over a glued end stand at both, and reach beyond it."""
    middle = triangles.mean(axis=1)
    return np.clip(triangles[np.all((middle >= box[:, 0]) & (middle <= box[:, 1]), axis=1)], box[:, 0], box[:, 1])


# --- panels -------------------------------------------------------------------------------------------------


def _new(kinds: Sequence[int], columns: int) -> np.ndarray:
    """Returns new Axes, with so many dimensions each, in rows of so many columns."""
    columns = min(columns, len(kinds))
    rows = -(-len(kinds) // columns)
    width, height, below = 4.4 * columns if columns < 3 else 3.7 * columns, 3.9 * rows + 0.6, 0.6
    figure = plt.figure(figsize=(width, height))
    found = np.empty(len(kinds), object)
    for k, dimensions in enumerate(kinds):
        row, column = divmod(k, columns)
        left, bottom = column / columns, (below + 3.9 * (rows - 1 - row)) / height
        wide, high = 1 / columns, 3.9 / height
        # Places by hand: constrained layout does not see how far the labels of a 3D plot reach.
        if dimensions == 3:
            found[k] = figure.add_axes((left, bottom, 0.93 * wide, high), projection="3d")
        else:
            place = (left + 0.22 * wide, bottom + 0.14 * high, 0.73 * wide, 0.74 * high)
            found[k] = figure.add_axes(place)
    return found


def _given(axes: Sequence[Axes], kinds: Sequence[int]) -> np.ndarray:
    """Returns the caller's Axes, checked."""
    flat = list(np.ravel(np.asarray(axes, dtype=object)))
    if len(flat) != len(kinds) or any(isinstance(ax, Axes3D) != (n == 3) for ax, n in zip(flat, kinds, strict=True)):
        words = ", ".join('one with projection="3d"' if n == 3 else "a flat one" for n in kinds)
        raise InputError(f"axes must be {words}, but {len(flat)} were given, or in another order: give these or none.")
    found = np.empty(len(kinds), object)
    found[:] = flat
    return found


def _legend(panels: np.ndarray, handles: list[Artist], *, own: bool) -> None:
    """Adds one legend: below all panels of a figure of our own, else below the first."""
    look: dict[str, Any] = {"handles": handles, "frameon": False, "fontsize": "small", "handlelength": 3.0}
    columns = 2 if len(panels) == 1 else min(4, len(handles))
    if not own:
        panels[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, **look)
    else:
        panels[0].figure.legend(loc="lower center", ncols=columns, **look)
