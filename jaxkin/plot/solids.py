"""Closed solids: an aspect in a chart of the orientations, or the joints with assembly modes."""

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Axis
from jaxkin.mapping._orientation_records import Solid
from jaxkin.plot import layers, spatial, style
from jaxkin.plot.poses import new_or_given
from jaxkin.plot.shading import shaded

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

#: Factors have the colours that they have as surfaces; the end of a chart is green there as well.
_COLOURS = tuple(style.OKABE_ITO[c] for c in ("vermillion", "sky", "purple", "orange", "blue", "yellow"))
_CHART = "chart"
_CHART_COLOUR = style.OKABE_ITO["green"]
_OPACITY = 0.88
#: Elevation and azimuth of the view, degrees.
_VIEW = (20.0, -58.0)
_CHART_NAMES = {"xyz": "X-Y-Z Euler angles", "zxy": "Z-X-Y Euler angles [ours]", "joints": "joints [ours]"}


def solid(solid: Solid, ax: Axes | None = None) -> "Axes3D":
    """Draws a closed solid, its faces coloured by what vanishes there (after Fig. 3 of Chablat et al. 2018).

    Where only the chart ends, the face is green. Shape and volume belong to the chart, not to the robot.

    Args:
        solid: What ``jk.aspect_solid`` or ``jk.joint_solid`` returned.
        ax: Axes with ``projection="3d"``; a new figure if not given.

    Returns:
        The Axes, with a legend and the volume in the title.

    Raises:
        InputError: It is no solid or one without faces, or the Axes are flat.
    """
    style.check_kind(solid, Solid, "a solid, from jk.aspect_solid or jk.joint_solid")
    if not len(solid.faces):
        raise InputError("There is no face to draw: give a solid of jk.aspect_solid or jk.joint_solid.")
    own, ax = ax is None, new_or_given(ax)
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    axes = [Axis(name, unit) for name, unit in zip(solid.axes, solid.units, strict=True)]
    spatial.frame(ax, np.stack([low, high], axis=1), axes, _VIEW[1], _VIEW[0])
    ax.computed_zorder = False
    names = [name for k, name in enumerate(solid.names) if (solid.patch == k).any()]
    factors = [name for name in solid.names if name != _CHART]
    triangles, paint, entries, light = [], [], [], layers.light(ax)
    for name in names:
        colour = _CHART_COLOUR if name == _CHART else _COLOURS[factors.index(name) % len(_COLOURS)]
        corners = solid.vertices[solid.on(name)]
        triangles.append(corners)
        paint.append(shaded(np.array(to_rgb(colour)), corners, light))
        entries.append(Patch(facecolor=colour, label=_label(name, solid)))
    every = np.concatenate(triangles)
    layers.add_layers(ax, every, np.concatenate(paint), _OPACITY)
    layers.add_outlines(ax, solid.vertices[solid.edges], every)
    columns = 3 if max(len(str(entry.get_label())) for entry in entries) < 16 else 2
    spatial.legend(ax, list(entries), columns, own=own)
    title = f"{style.words(solid.label)}  ({_CHART_NAMES.get(solid.chart, solid.chart)})\n{_volume(solid)}"
    if own:
        legend = 0.18 * math.ceil(len(entries) / columns) + 0.12
        spatial.fit([ax], [title], legend=legend, points=solid.vertices)
    else:
        ax.set_title(title, fontsize="small")
    return ax


def _label(name: str, solid: Solid) -> str:
    if name != _CHART:
        return f"{style.symbol(name)} = 0"
    return f"end of the chart ({style.symbol(f'cos({solid.axes[1]})')} = 0)"


def _volume(solid: Solid) -> str:
    if all(unit == "rad" for unit in solid.units):
        share = solid.volume / math.pi**3
        return f"volume {'' if abs(share - 1) < 1e-9 else f'{share:.6g} '}π$^3$ rad$^3$ in this chart"
    unit = solid.units[0]
    return f"volume of the triangles {solid.volume:.4g} {unit}$^3$"
