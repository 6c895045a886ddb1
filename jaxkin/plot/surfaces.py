"""Singular surfaces in the workspace, in three dimensions."""

from typing import NamedTuple, cast

import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.precision import TOLERANCES
from jaxkin.mapping.meshes import SingularSurfaces
from jaxkin.plot import boxes, style
from jaxkin.plot.layers import add_layers, add_lines
from jaxkin.plot.shading import shaded

#: The first factor is red in Wenger and Chablat 2009, Fig. 2.
_COLOURS = tuple(style.OKABE_ITO[c] for c in ("vermillion", "sky", "green", "purple", "orange", "blue", "yellow"))
#: Faces on which only the angles are singular; green, as cos(theta) = 0 is in Chablat et al. 2018, Fig. 2.
_CHART = style.OKABE_ITO["green"]
#: Share of colour of the nearest surface at each point of the picture; the farthest one has the rest.
_OPACITY = 0.88


def surfaces(surfaces: SingularSurfaces, ax: Axes | None = None, *, robot: Mechanism | None = None) -> Axes3D:
    """Draws singular surfaces in the space of the three free pose axes, the last one upright.

    The faces of a glued axis are framed, and the curves in which the surfaces meet them drawn in black on both: they
    are the same curves. Where two factors vanish together there is a thin black line.

    Args:
        surfaces: What ``jk.singular_surfaces`` returned.
        ax: Axes with ``projection="3d"``; a new figure if not given.
        robot: The mechanism. If its angles have singularities of their own (``chart_factors``), faces of the box that
            are such are told apart from its surfaces, as a frame and a veil in another colour.

    Returns:
        The Axes, with a legend.

    Raises:
        InputError: They are no singular surfaces or none at all, or the Axes are flat.
    """
    style.check_kind(surfaces, SingularSurfaces, "singular surfaces, from jk.singular_surfaces")
    if not any(len(surface.faces) for surface in surfaces):
        raise InputError("There is no singular surface in the box: choose a larger one in jk.singular_surfaces.")
    below = -0.015 if ax is None else -0.06
    if ax is None:
        # Margins by hand: constrained layout does not see how far the labels of a 3D plot reach.
        figure = plt.figure(figsize=(5.2, 5.2))
        ax = cast(Axes3D, figure.add_axes((0.0, 0.16, 0.93, 0.87), projection="3d"))
    if not isinstance(ax, Axes3D):
        raise InputError('A surface needs Axes of three dimensions: make them with subplot_kw={"projection": "3d"}.')
    free = [surfaces.pose_names.index(name) for name in surfaces.free]
    box = np.array([surfaces.request["box"][name][:2] for name in surfaces.free])
    units = [surfaces.units[name] for name in surfaces.free]
    boxes.frame(ax, surfaces.free, units, box)
    chart = [] if robot is None else _chart_faces(robot, surfaces, box)
    handles: list[Artist] = [*_triangles(ax, surfaces, free, box, chart), *_veils(ax, box, chart)]
    handles += _crossing_lines(ax, surfaces, free)
    handles += _glue_marks(ax, surfaces, free, box, chart)
    ax.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.54, below), ncols=2, frameon=False, fontsize="small"
    )
    return ax


def _triangles(
    ax: Axes3D, surfaces: SingularSurfaces, free: list[int], box: np.ndarray, chart: list["_Face"]
) -> list[Patch]:
    """Draws all surfaces together, without what lies in a face of the chart; returns the legend's handles."""
    scale = boxes.proportions([surfaces.units[name] for name in surfaces.free], box) / (box[:, 1] - box[:, 0])
    corners, colours, handles = [], [], []
    for number, surface in enumerate(surfaces):
        colour = np.array(to_rgb(_COLOURS[number % len(_COLOURS)]))
        triangles = _outside(surface.vertices[:, free][surface.faces], chart)
        corners.append(triangles)
        colours.append(shaded(colour, triangles * scale))
        handles.append(Patch(facecolor=tuple(colour), label=_label(surface.name)))
    add_layers(ax, np.concatenate(corners), np.concatenate(colours), _OPACITY)
    return handles


class _Face(NamedTuple):
    """A face of the box on which the angles are singular: its axis among the free ones, its end, and the factor."""

    place: int
    end: float
    name: str


def _outside(shapes: np.ndarray, chart: list[_Face]) -> np.ndarray:
    """Returns the segments or triangles ``(n, k, 3)`` that do not lie in a face of the chart.

    A factor of the robot that vanishes on all of it has no change of sign there: its triangles are those of rounding.
    """
    for face in chart:
        shapes = shapes[~(shapes[:, :, face.place] == face.end).all(axis=1)]
    return shapes


def _chart_faces(robot: Mechanism, surfaces: SingularSurfaces, box: np.ndarray) -> list[_Face]:
    """Returns the faces of the box on which a factor of the chart vanishes, looked at in a few places."""
    factors = getattr(robot, "chart_factors", None)
    if factors is None:
        return []
    request, found = surfaces.request["box"], []
    fixed = {name: value for name, value in request.items() if not isinstance(value, list)}
    for place, name in enumerate(surfaces.free):
        others = [k for k in range(3) if k != place]
        for end in box[place]:
            sides = np.meshgrid(*(box[k][0] + np.ptp(box[k]) * np.array([0.0, 0.3, 0.77, 1.0]) for k in others))
            values = fixed | {name: end}
            values |= {surfaces.free[k]: side.ravel() for k, side in zip(others, sides, strict=True)}
            poses = np.stack([np.broadcast_to(values[pose], sides[0].size) for pose in surfaces.pose_names], axis=1)
            vanished = jax.vmap(factors)(poses)
            found += [_Face(place, float(end), f) for f, v in vanished.items() if np.abs(v).max() < TOLERANCES.geometry]
    return found


def _veils(ax: Axes3D, box: np.ndarray, chart: list[_Face]) -> list[Patch]:
    """Draws the faces of the chart; returns the legend's handles."""
    for face in chart:
        corners = _face_frame(box, face.place, face.end)
        # The nearer of two veils would colour all behind it.
        veil = Poly3DCollection([corners[:-1]], facecolors=[(*to_rgb(_CHART), 0.09)], edgecolors="none", zorder=2.5)
        ax.add_collection3d(veil, autolim=False)
        ax.plot(*corners.T, color=_CHART, linewidth=2.0, linestyle=(0, (4, 1.5)), zorder=5.5)
    names = dict.fromkeys(face.name for face in chart)
    look = {"facecolor": (*to_rgb(_CHART), 0.2), "edgecolor": _CHART, "linewidth": 1.5, "linestyle": "--"}
    return [Patch(label=f"{style.symbol(n)} = 0 (angles, not the robot)", **look) for n in names]


def _face_frame(box: np.ndarray, place: int, end: float) -> np.ndarray:
    """Returns the closed outline ``(5, 3)`` of a face of the box."""
    others = [k for k in range(3) if k != place]
    frame = np.empty((5, 3))
    frame[:, others[0]] = box[others[0]][[0, 1, 1, 0, 0]]
    frame[:, others[1]] = box[others[1]][[0, 0, 1, 1, 0]]
    frame[:, place] = end
    return frame


def _label(name: str) -> str:
    if name.startswith("det"):
        return name.replace("det", "det = 0", 1)
    return f"{style.symbol(name)} = 0"


def _crossing_lines(ax: Axes3D, surfaces: SingularSurfaces, free: list[int]) -> list[Line2D]:
    handles = []
    for crossing in surfaces.crossings:
        look = {"color": "black", "linewidth": 0.8}
        add_lines(ax, crossing.poses[:, free][crossing.segments], zorder=4, **look)
        handles.append(Line2D([], [], label=" = ".join(map(style.symbol, crossing.names)) + " = 0", **look))  # type: ignore[arg-type]
    return handles


def _glue_marks(
    ax: Axes3D, surfaces: SingularSurfaces, free: list[int], box: np.ndarray, chart: list[_Face]
) -> list[Line2D]:
    """Frames both faces of every glued axis, and draws on them the curves that are the same on both."""
    for name in surfaces.glued:
        place = surfaces.free.index(name)
        for end in box[place]:
            ax.plot(*_face_frame(box, place, end).T, color="#555555", linewidth=0.7, zorder=5)
            for surface in surfaces:
                ends = _outside(surface.vertices[:, free][surface.boundary], chart)
                add_lines(ax, ends[(ends[:, :, place] == end).all(axis=1)], color="black", linewidth=1.8, zorder=6)
    if not surfaces.glued:
        return []
    names = list(map(style.symbol, surfaces.glued))
    ends = [[style._in_pi(end) for end in box[surfaces.free.index(name)]] for name in surfaces.glued]
    if len(names) == 1:
        label = f"glued: {names[0]} = {ends[0][0]} and {names[0]} = {ends[0][1]} are the same"
    else:
        both = (f"±{high}" if low == f"−{high}" else f"{low} and {high}" for low, high in ends)
        label = "glued: " + ", ".join(f"{name} = {end}" for name, end in zip(names, both, strict=True))
    return [Line2D([], [], color="black", linewidth=1.8, label=label)]
