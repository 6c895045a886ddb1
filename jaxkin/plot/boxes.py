"""A box of three axes: poses or joints of a robot with three degrees of freedom."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.plot import style
from jaxkin.plot.spatial import part_tick_labels, upright_labels

#: Elevation and azimuth of the view, degrees.
VIEW = (22.0, -52.0)


def frame(
    ax: Axes3D,
    names: Sequence[str],
    units: Sequence[str],
    box: np.ndarray,
    view: tuple[float, float] = VIEW,
    zoom: float = 0.98,
) -> None:
    """Gives Axes the ends ``box`` ``(3, 2)``, labels with units, ticks, and a view."""
    ax.computed_zorder = False
    ax.set(xlim=box[0], ylim=box[1], zlim=box[2])
    ax.margins(0)
    ax.view_init(*view)
    ax.set_proj_type("persp", focal_length=1.6)
    ax.set_box_aspect(proportions(units, box), zoom=zoom)  # type: ignore[arg-type]
    axes: tuple[Any, ...] = (ax.xaxis, ax.yaxis, ax.zaxis)
    for name, unit, axis, (low, high) in zip(names, units, axes, box, strict=True):
        axis.set_label_text(style.axis_label(name, unit))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set_linewidth(0.6)
        if unit == "rad" and high - low >= math.pi:
            style.ticks_in_pi(axis)
        else:
            axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        axis.set_tick_params(labelsize="small")
        axis.labelpad = 8.0
    part_tick_labels(ax)
    upright_labels(ax, 8.3)
    ax.grid(False)


def proportions(units: Sequence[str], box: np.ndarray) -> np.ndarray:
    """Returns the sides of the drawn box: one scale for axes of one unit, and the largest of every unit equal."""
    sides = box[:, 1] - box[:, 0]
    largest = {unit: max(s for s, u in zip(sides, units, strict=True) if u == unit) for unit in units}
    return np.array([side / largest[unit] for side, unit in zip(sides, units, strict=True)])
