"""The workspace of a mechanism as a solid with the limits on its faces."""

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch

from jaxkin.core.bodies import Body
from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Axis
from jaxkin.mapping._workspace_records import WorkspacePatch, WorkspaceSurfaces
from jaxkin.plot import layers, spatial, style
from jaxkin.plot.poses import new_or_given
from jaxkin.plot.shading import shaded

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

#: One for each joint; its upper limit is lighter, the lower one darker.
_HUES = tuple(style.OKABE_ITO[c] for c in ("sky", "orange", "purple", "green", "yellow", "blue"))
_SINGULAR = style.OKABE_ITO["vermillion"]
_LIGHTER, _DARKER = 0.35, 0.62
_OPACITY = 0.9
#: Elevation and azimuth of the view, degrees.
_VIEW = (20.0, -28.0)


def workspace(surfaces: WorkspaceSurfaces | Sequence[WorkspaceSurfaces], ax: Axes | None = None) -> "Axes3D":
    """Draws the boundary of a workspace, each face in the colour of the limit that is reached there (after Fig. 3).

    A joint has one hue, lighter at its upper and darker at its lower limit; a piece of the singular surface is
    vermillion.

    Args:
        surfaces: What ``jk.workspace_surfaces`` returned, or several, such as both branches.
        ax: Axes with ``projection="3d"``; a new figure if not given.

    Returns:
        The Axes, with a legend and the volume in the title.

    Raises:
        InputError: It is no boundary of a workspace, there is no face to draw, or the Axes are flat.
    """
    records: list[WorkspaceSurfaces] = list(surfaces) if isinstance(surfaces, list | tuple) else [surfaces]  # type: ignore[list-item]
    for record in records:
        style.check_kind(record, WorkspaceSurfaces, "the boundary of a workspace, from jk.workspace_surfaces")
    patches = [patch for record in records for patch in record.patches if len(patch.faces)]
    if not patches:
        raise InputError("There is no face to draw: give what jk.workspace_surfaces returned, of a workspace.")
    own, ax = ax is None, new_or_given(ax)
    first = records[0]
    points = np.concatenate([patch.vertices for patch in patches])
    box = spatial.limits([Body("", points, "axis")], margin=0.02)
    axes = [Axis(name, first.units[name]) for name in first.pose_names]
    spatial.frame(ax, box, axes, _VIEW[1], _VIEW[0])
    ax.computed_zorder = False
    paints = {name: _paint(name, patches) for name in dict.fromkeys(patch.name for patch in patches)}
    triangles = [patch.vertices[patch.faces] for patch in patches]
    light = layers.light(ax)
    paint = [shaded(paints[patch.name], corners, light) for patch, corners in zip(patches, triangles, strict=True)]
    every = np.concatenate(triangles)
    layers.add_layers(ax, every, np.concatenate(paint), _OPACITY)
    layers.add_outlines(ax, np.concatenate([patch.vertices[patch.boundary] for patch in patches]), every)
    entries = [Patch(facecolor=tuple(colour), label=_label(name)) for name, colour in paints.items()]
    columns = min(3, len(entries))
    if len(entries) == 7:
        # A legend fills columns: 3, 2 and 2. The singular piece goes below the first joint's limits.
        entries.insert(2, entries.pop())
    spatial.legend(ax, list(entries), columns, own=own)
    title = "\n".join(f"{r.branch} branch: {_volume(r.volume)} {axes[0].unit}$^3$" for r in records)
    if own:
        legend = 0.18 * math.ceil(len(entries) / columns) + 0.12
        spatial.fit([ax], [title], legend=legend, points=points)
    else:
        ax.set_title(title, fontsize="small")
    return ax


def _parts(name: str) -> tuple[str, str] | None:
    """Returns the joint and ``"min"`` or ``"max"`` of a face's name such as ``"l1 = l1_min"``."""
    match = re.fullmatch(r"(\w+) = \1_(min|max)", name)
    return (match[1], match[2]) if match else None


def _paint(name: str, patches: Sequence[WorkspacePatch]) -> np.ndarray:
    parts = _parts(name)
    if parts is None:
        return np.array(to_rgb(_SINGULAR))
    joints = list(dict.fromkeys(found[0] for patch in patches if (found := _parts(patch.name))))
    hue = np.array(to_rgb(_HUES[joints.index(parts[0]) % len(_HUES)]))
    return hue + _LIGHTER * (1 - hue) if parts[1] == "max" else _DARKER * hue


def _label(name: str) -> str:
    parts = _parts(name)
    if parts is None:
        return style.words(name)
    symbol = style.symbol(parts[0])
    end = rf"\mathrm{{{parts[1]}}}"
    limit = symbol.replace("}$", rf",{end}}}$") if symbol.endswith("}$") else symbol[:-1] + rf"_{{{end}}}$"
    return f"{symbol} = {limit}"


def _volume(volume: float) -> str:
    exponent = math.floor(math.log10(volume)) if volume > 0 else 0
    return f"{volume / 10**exponent:.4f} × 10$^{{{exponent}}}$" if abs(exponent) > 3 else f"{volume:.5g}"
