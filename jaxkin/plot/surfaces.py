"""Singular surfaces in the workspace, in three dimensions."""

import math
from typing import TYPE_CHECKING, Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from jaxkin.core.errors import InputError
from jaxkin.plot import style
from jaxkin.plot.shading import shaded

if TYPE_CHECKING:
    from jaxkin.mapping.meshes import SingularSurfaces

#: The first factor is red in Wenger and Chablat 2009, Fig. 2.
_COLOURS = tuple(style.OKABE_ITO[c] for c in ("vermillion", "sky", "green", "purple", "orange", "blue", "yellow"))
#: Share of colour of the nearest surface at each point of the picture; the farthest one has the rest.
_OPACITY = 0.88
#: Elevation and azimuth of the view, degrees.
_VIEW = (22.0, -52.0)


def surfaces(surfaces: "SingularSurfaces", ax: Axes | None = None) -> Axes3D:
    """Draws singular surfaces in the space of the three free pose axes, the last one upright.

    The faces of a glued axis are framed, and the curves in which the surfaces meet them drawn in black on both: they
    are the same curves. Where two factors vanish together there is a thin black line.

    Args:
        surfaces: What ``jk.singular_surfaces`` returned.
        ax: Axes with ``projection="3d"``; a new figure if not given.

    Returns:
        The Axes, with a legend.

    Raises:
        InputError: There is no surface to draw, or the Axes are flat.
    """
    if not any(len(surface.faces) for surface in surfaces):
        raise InputError("There is no singular surface in the box: choose a larger one in jk.singular_surfaces.")
    if ax is None:
        # Margins by hand: constrained layout does not see how far the labels of a 3D plot reach.
        figure = plt.figure(figsize=(5.2, 5.2))
        ax = cast(Axes3D, figure.add_axes((0.0, 0.14, 0.93, 0.88), projection="3d"))
    if not isinstance(ax, Axes3D):
        raise InputError('A surface needs Axes of three dimensions: make them with subplot_kw={"projection": "3d"}.')
    free = [surfaces.pose_names.index(name) for name in surfaces.free]
    box = np.array([surfaces.request["box"][name][:2] for name in surfaces.free])
    _frame(ax, surfaces, box)
    handles = _triangles(ax, surfaces, free, box)
    handles += _crossing_lines(ax, surfaces, free)
    handles += _glue_marks(ax, surfaces, free, box)
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.54, 0.0), ncols=2, frameon=False, fontsize="small")
    return ax


def _frame(ax: Axes3D, surfaces: "SingularSurfaces", box: np.ndarray) -> None:
    ax.computed_zorder = False
    ax.set(xlim=box[0], ylim=box[1], zlim=box[2])
    ax.margins(0)
    ax.view_init(*_VIEW)
    ax.set_proj_type("persp", focal_length=1.6)
    ax.set_box_aspect(_proportions(surfaces, box), zoom=0.98)  # type: ignore[arg-type]
    axes: tuple[Any, ...] = (ax.xaxis, ax.yaxis, ax.zaxis)
    for name, axis, (low, high) in zip(surfaces.free, axes, box, strict=True):
        unit = surfaces.units[name]
        axis.set_label_text(style.axis_label(name, unit))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set_linewidth(0.6)
        if unit == "rad" and high - low >= math.pi:
            axis.set_major_locator(MultipleLocator(math.pi / 2))
            axis.set_major_formatter(FuncFormatter(lambda value, _: style._in_pi(value)))
        else:
            axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    ax.grid(False)


def _proportions(surfaces: "SingularSurfaces", box: np.ndarray) -> np.ndarray:
    """Returns the sides of the drawn box: one scale for axes of one unit, and the largest of every unit equal."""
    sides = box[:, 1] - box[:, 0]
    units = [surfaces.units[name] for name in surfaces.free]
    largest = {unit: max(s for s, u in zip(sides, units, strict=True) if u == unit) for unit in units}
    return np.array([side / largest[unit] for side, unit in zip(sides, units, strict=True)])


def _triangles(ax: Axes3D, surfaces: "SingularSurfaces", free: list[int], box: np.ndarray) -> list[Patch]:
    """Draws all surfaces together, so that their triangles are sorted by depth where they cross.

    Transparent triangles would show their seams, so the picture has two opaque layers: the farthest surface at each
    point (painted from the nearest on), and over it, transparent as a whole, the nearest one.
    """
    scale = _proportions(surfaces, box) / (box[:, 1] - box[:, 0])
    corners, colours, handles = [], [], []
    for number, surface in enumerate(surfaces):
        colour = np.array(to_rgb(_COLOURS[number % len(_COLOURS)]))
        triangles = surface.vertices[:, free][surface.faces]
        corners.append(triangles)
        colours.append(shaded(colour, triangles * scale))
        handles.append(Patch(facecolor=tuple(colour), label=_label(surface.name)))
    triangles, paint = np.concatenate(corners), np.concatenate(colours)
    for zorder in (1, 2):
        # Edges in the colour of their triangle close the gaps that antialiasing leaves.
        layer = Poly3DCollection(triangles, facecolors=paint, edgecolors=paint, linewidths=0.25, zorder=zorder)
        # As vectors, tens of thousands of triangles fill megabytes of a PDF and show their seams.
        layer.set_rasterized(True)
        if zorder == 1:
            # There is no public order from near to far; without it the picture is merely opaque.
            layer._zsortfunc = _nearest_first  # type: ignore[attr-defined]
        else:
            layer.set_agg_filter(_thinned)  # type: ignore[arg-type]
        ax.add_collection3d(layer, autolim=False)
    return handles


def _nearest_first(depths: np.ndarray, axis: int = -1) -> np.ndarray:
    return -np.mean(depths, axis=axis)


def _thinned(image: np.ndarray, dpi: float) -> tuple[np.ndarray, int, int]:
    """Makes a drawn layer transparent as a whole."""
    del dpi
    return image * np.array([1.0, 1.0, 1.0, _OPACITY]), 0, 0


def _label(name: str) -> str:
    if name.startswith("det"):
        return name.replace("det", "det = 0", 1)
    return f"{style.symbol(name)} = 0"


def _lines(ax: Axes3D, segments: np.ndarray, **options: object) -> None:
    ax.add_collection3d(Line3DCollection(segments, capstyle="round", **options), autolim=False)  # type: ignore[arg-type]


def _crossing_lines(ax: Axes3D, surfaces: "SingularSurfaces", free: list[int]) -> list[Line2D]:
    handles = []
    for crossing in surfaces.crossings:
        look = {"color": "black", "linewidth": 0.8}
        _lines(ax, crossing.poses[:, free][crossing.segments], zorder=4, **look)
        handles.append(Line2D([], [], label=" = ".join(map(style.symbol, crossing.names)) + " = 0", **look))  # type: ignore[arg-type]
    return handles


def _glue_marks(ax: Axes3D, surfaces: "SingularSurfaces", free: list[int], box: np.ndarray) -> list[Line2D]:
    """Frames both faces of every glued axis, and draws on them the curves that are the same on both."""
    handles = []
    for name in surfaces.glued:
        place = surfaces.free.index(name)
        others = [k for k in range(3) if k != place]
        for end in box[place]:
            frame = np.empty((5, 3))
            frame[:, others[0]] = box[others[0]][[0, 1, 1, 0, 0]]
            frame[:, others[1]] = box[others[1]][[0, 0, 1, 1, 0]]
            frame[:, place] = end
            ax.plot(*frame.T, color="#555555", linewidth=0.7, zorder=5)
            for surface in surfaces:
                ends = surface.vertices[:, free][surface.boundary]
                _lines(ax, ends[(ends[:, :, place] == end).all(axis=1)], color="black", linewidth=1.8, zorder=6)
        low, high = (style._in_pi(end) for end in box[place])
        label = f"glued: {style.symbol(name)} = {low} and {style.symbol(name)} = {high} are the same"
        handles.append(Line2D([], [], color="black", linewidth=1.8, label=label))
    return handles
