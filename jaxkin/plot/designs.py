"""Designs: how an optimisation went, the mechanism before and after, and the map of its objective."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray
from jax.typing import ArrayLike
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.design.configurations import posture_of
from jaxkin.design.gradient_steps import FEASIBLE
from jaxkin.design.outcome import Design
from jaxkin.design.places import Place
from jaxkin.plot import maps, style
from jaxkin.plot.planar import check_outline, draw_pose, finish, sign_of

_DESIGN = "a design, from jk.design.optimise"
_GREY, _BEST, _REFINED = "#9A9A9A", style.OKABE_ITO["blue"], style.OKABE_ITO["vermillion"]
#: An objective that falls towards zero by more than this is drawn over a logarithmic axis.
_FALLS = 1e3
#: Share of the objectives of all steps, the worst, that may be left out of the picture.
_LEFT_OUT = 0.02
_PLACE: dict[str, Any] = {"facecolor": style.OKABE_ITO["yellow"], "edgecolor": "black", "alpha": 0.4, "zorder": 0.5}


def design_history(design: Design, ax: Axes | None = None) -> Axes:
    """Draws the smoothed objective of every start step by step, the best so far, and the refinements.

    Steps that violate a requirement are dotted. Refinements follow the last gradient step, each with its iterates
    beside the others'. Objectives that fall towards zero have a logarithmic axis, in which zero has no place.

    Args:
        design: What ``jk.design.optimise`` returned.
        ax: Where to draw; a new figure if not given.

    Returns:
        The Axes, whose title says whether the design is verified.

    Raises:
        InputError: It is no design.
    """
    style.check_kind(design, Design, _DESIGN)
    if ax is None:
        _, ax = plt.subplots(figsize=(6.0, 3.8), layout="constrained")
    history, objective = design.history, design.problem.objective
    handles = _draw_steps(history, ax) if "objective" in history else []
    last = history.sizes.get("step", 0)
    if "refined_objective" in history:
        handles.append(_draw_refined(history, ax, last))
        last += int(np.bincount(np.asarray(history.refined_start)).max())
    # Where the objective of the smallest kind is zero, a logarithmic axis would lose the optimum's mark.
    shown = design.smooth
    look: dict[str, Any] = {"marker": "*", "markersize": 12, "markeredgecolor": "black", "linestyle": "none"}
    falls = _falls(history, design.problem.sign)
    if falls:
        ax.set_yscale("log")
    if not falls or shown > 0:
        handles += ax.plot(
            [last], [shown], color=style.OKABE_ITO["yellow"], zorder=6, clip_on=False, label="design", **look
        )
    _limit(history, ax, falls, shown)
    if history.sizes.get("step", 0) and "refined_objective" in history:
        ax.axvline(history.sizes["step"] - 0.5, color="black", linewidth=0.6, linestyle=(0, (4, 3)))
    ax.set_xlabel("step (gradient method, then refinement)" if "refined_objective" in history else "step")
    ax.set_ylabel(style.with_unit(objective.name, objective.unit))
    ax.set_title("verified" if design.verified else "not verified", fontsize="medium")
    ax.legend(handles=handles, fontsize="small", frameon=False, loc="center left", bbox_to_anchor=(1.01, 0.5))
    return ax


def _draw_steps(history: xarray.Dataset, ax: Axes) -> list[Line2D]:
    """Draws every start, dotted where it violates something, and the best feasible so far."""
    value, violation = np.asarray(history.objective), np.asarray(history.violation)
    feasible, steps = violation <= FEASIBLE, np.arange(len(value))
    handles = []
    for keeps, dashes, text in ((True, "solid", "starts"), (False, (0, (1, 2)), "starts, violated")):
        # A step on either side of a border belongs to both, so that no line is torn.
        here = feasible == keeps
        near = here if keeps else _widened(here)
        if here.any():
            lines = ax.plot(steps, np.where(near, value, np.nan), color=_GREY, linewidth=0.7, linestyle=dashes)
            lines[0].set_label(text)
            handles.append(lines[0])
    best = np.asarray(history.best)
    if np.isfinite(best).any():
        best = np.where(np.isfinite(best), best, np.nan)
        handles += ax.plot(steps, best, color=_BEST, linewidth=2.4, zorder=4, label="best so far")
    return handles


def _widened(here: np.ndarray) -> np.ndarray:
    """Adds the step before and the one after to marked steps ``(step, start)``."""
    wide = here.copy()
    wide[1:] |= here[:-1]
    wide[:-1] |= here[1:]
    return wide


def _draw_refined(history: xarray.Dataset, ax: Axes, first: int) -> Line2D:
    """Draws the iterates of all refinements."""
    starts, value = np.asarray(history.refined_start), np.asarray(history.refined_objective)
    look: dict[str, Any] = {"color": _REFINED, "linewidth": 0.9, "marker": ".", "markersize": 4, "zorder": 5}
    line = Line2D([], [], label="refinements", **look)
    for start in np.unique(starts):
        mine = value[starts == start]
        ax.plot(first + np.arange(len(mine)), mine, **look)
    return line


def _all_values(history: xarray.Dataset) -> np.ndarray:
    names = [name for name in ("objective", "refined_objective") if name in history]
    values = np.concatenate([np.zeros(0), *(np.asarray(history[name]).ravel() for name in names)])
    return values[np.isfinite(values)]


def _falls(history: xarray.Dataset, sign: float) -> bool:
    """True where an objective is made small and falls by orders of magnitude towards zero."""
    values = _all_values(history)
    positive = values[values > 0]
    if sign > 0 or not len(positive) or len(positive) < 0.9 * len(values):
        return False
    return bool(np.max(positive) > _FALLS * np.min(positive))


def _limit(history: xarray.Dataset, ax: Axes, falls: bool, shown: float) -> None:
    """Leaves out the worst few values, which would make all others flat."""
    values = _all_values(history)
    if falls or len(values) < 2:
        return
    low, high = np.quantile(values, [_LEFT_OUT, 1 - _LEFT_OUT])
    # A step that is better than all others is no outlier.
    low, high = min(low, shown), max(high, shown)
    room = 0.05 * (high - low) or 1.0
    ax.set_ylim(low - room, high + room)


def design_comparison(design: Design, pose: ArrayLike | None = None, axes: Any = None) -> np.ndarray:
    """Draws a planar mechanism before and after, at one pose, with the prescribed workspace, in equal scales.

    Args:
        design: What ``jk.design.optimise`` returned.
        pose: ``(n_pose,)``; the middle of the prescribed workspace by default, before and after.
        axes: Two Axes to draw in; a new figure if not given.

    Returns:
        Two Axes. Their titles are the numbers that vary.

    Raises:
        InputError: It is no design, the mechanism cannot be drawn in the plane, or there is neither a pose nor a
            prescribed workspace.
    """
    style.check_kind(design, Design, _DESIGN)
    check_outline(design.robot)
    place = _place_of(design)
    if pose is None and place is None:
        raise InputError("The design has no prescribed workspace: give a pose at which the mechanism is drawn.")
    if axes is None:
        _, axes = plt.subplots(1, 2, figsize=(7.2, 4.0), layout="constrained", sharex=True, sharey=True)
    problem = design.problem
    begun = {name: float(value) for name, value in problem.values(problem.start()).items()}  # type: ignore[arg-type]
    robot, moved = problem.made(begun)
    before = (robot, moved, begun, "before")
    after = (design.robot, design.center, design.values, "after")
    for panel, (robot, center, values, word) in zip(np.ravel(axes), (before, after), strict=True):
        middle = place.center if center is None and place is not None else center
        at = np.asarray(middle if pose is None else pose, float)
        _draw_robot(robot, at, problem.objective.content.get("mode"), panel)
        if place is not None:
            draw_place(place, panel, center)
        numbers = style.in_lines(style.value(name, value) for name, value in values.items())
        panel.set_title(f"{word}\n{numbers}", fontsize="small")
    for panel in np.ravel(axes):
        panel.label_outer()
    return np.ravel(axes)


def _place_of(design: Design) -> Place | None:
    every = (design.problem.objective, *(one.objective for one in design.problem.subject_to))
    return next((one.place for one in every if one.place is not None), None)


def _draw_robot(robot: Mechanism, pose: np.ndarray, mode: Any, ax: Axes) -> None:
    joints = np.asarray(posture_of("jk.plot.design_comparison", robot, mode or None, pose).of_one(robot, pose))  # type: ignore[arg-type]
    draw_pose(robot, pose, joints, ax, style.SIGN_COLOURS[sign_of(robot, pose, joints)])
    finish(ax)


def draw_place(place: Place, ax: Axes, center: ArrayLike | None = None) -> None:
    """Draws a prescribed workspace over the first two pose axes: a rectangle, a disc, or poses.

    Args:
        place: The prescribed workspace.
        ax: Where.
        center: ``(n_pose,)`` its middle, where a design moved it.
    """
    x, y = np.asarray(place.center if center is None else center, float)[:2]
    if place.listed is not None:
        shift = np.array([x, y]) - place.center[:2]
        ax.plot(*(place.listed[:, :2] + shift).T, "x", color="black", zorder=0.6)
    elif place.kind == "reach":
        return
    elif set(place.round) >= {0, 1}:
        ax.add_patch(Circle((x, y), place.half[0], **_PLACE))
    else:
        width, height = place.half[:2]
        ax.add_patch(Rectangle((x - width, y - height), 2 * width, 2 * height, **_PLACE))
    ax.autoscale_view()


def design_map(result: xarray.Dataset, design: Design, variable: str | None = None, ax: Axes | None = None) -> Axes:
    """Draws a map over two numbers of the mechanism with the paths of all starts, where they begin, and the design.

    Where more than these two numbers vary, paths are seen in projection, and the map is that of its fixed numbers.

    Args:
        result: What ``jk.sweep`` returned for a field over geometries, such as
            ``jk.design.atlas.smoothed_objective(objective)``.
        design: What ``jk.design.optimise`` returned.
        variable: Which of the map's variables; the field itself by default.
        ax: Where to draw; a new figure if not given.

    Returns:
        The Axes.

    Raises:
        InputError: It is no design or no map of two of the parameters.
    """
    style.check_kind(design, Design, _DESIGN)
    free = _free(result, variable)
    x, y = (_parameter(design, name) for name in free)
    ax = maps.section(result, variable, ax)
    window = ax.axis()
    handles: list[Any] = []
    ink: dict[str, Any] = {"color": "white", "linewidth": 0.7, "zorder": 3}
    if x in design.history and y in design.history:
        paths = [np.asarray(design.history[name]) for name in (x, y)]
        ax.plot(*paths, **{**ink, "alpha": 0.8})
        look: dict[str, Any] = {"marker": "o", "markersize": 4, "markeredgecolor": "black", "linestyle": "none"}
        handles += ax.plot(paths[0][0], paths[1][0], color="white", zorder=4, label="starts", **look)
        projected = len(design.values) > len(free)
        text = "their paths, projected" if projected else "their paths"
        handles.append(Line2D([], [], color=_GREY, linewidth=1.0, label=text))
    look = {"marker": "*", "markersize": 13, "markeredgecolor": "black", "linestyle": "none"}
    place = ([design.values[x]], [design.values[y]])
    colour = style.OKABE_ITO["vermillion"]
    handles += ax.plot(*place, color=colour, zorder=6, clip_on=False, label="design", **look)
    ax.axis(window)
    ax.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=3, frameon=False, fontsize="small"
    )
    return ax


def _free(result: xarray.Dataset, variable: str | None) -> tuple[str, ...]:
    data = result[variable or result.attrs.get("field") or next(iter(result.data_vars))].squeeze()
    if data.ndim != 2:
        raise InputError(f"The map has the free axes {', '.join(map(str, data.dims))}: a map of a design needs two.")
    return tuple(map(str, data.dims))


def _parameter(design: Design, axis: str) -> str:
    """Returns the parameter that sets a number of the mechanism."""
    for name, one in design.problem.parameters.items():
        if axis == name or axis in one.sets:
            return name
    raise InputError(
        f"The map's axis {axis!r} is no parameter of the design: sweep over {', '.join(design.problem.names)}."
    )
