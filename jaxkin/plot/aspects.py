"""Aspects of the workspace: by working mode over two pose coordinates, in slices over three."""

from collections.abc import Sequence
from typing import Any

import matplotlib.patheffects as effects
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxkin.core.errors import InputError
from jaxkin.mapping._aspect_records import Aspects, Slice
from jaxkin.mapping.records import SingularCurves
from jaxkin.plot import loci, style

#: Aspects of either sign in turn: cold colours for det > 0, warm ones for det < 0.
_COLOURS = {
    1: tuple(style.OKABE_ITO[c] for c in ("sky", "green", "blue")),
    -1: tuple(style.OKABE_ITO[c] for c in ("orange", "vermillion", "purple", "yellow")),
}
#: Aspects of one working mode that are more than the colours are hatched.
_HATCHES = (None, "////", "....", "xxxx")
_UNDECIDED = "#C8C8C8"
_LOOKS = {
    "det A": {"color": "black", "linewidth": 1.4, "linestyle": "solid"},
    "det B": {"color": "black", "linewidth": 1.2, "linestyle": (0, (1.3, 1.1))},
}
_FACTORS: tuple[Any, ...] = ("solid", (0, (7, 1.6)), (0, (6, 1.6, 1.4, 1.6)))
#: Slices through three coordinates, if their places are not given.
_SLICES = 6
#: The legend names so many aspects, the largest ones; in a panel only those have numbers that fill this share of it.
_MOST_NAMES, _LEAST_SHARE = 16, 0.002
#: Longer side of a panel, room for its labels, and width of the figure, inches.
_SIZE, _LABELS, _PAGE = 2.7, 0.45, 10.0
#: Height of a row of the legend, inches.
_ENTRY = 0.19


def aspects(
    result: Aspects,
    slices: dict[str, Sequence[float]] | None = None,
    curves: SingularCurves | None = None,
    axes: Sequence[Axes] | None = None,
) -> np.ndarray:
    """Draws aspects in their colours, with numbers; the legend has their signs and volumes.

    Over two free pose coordinates every working mode has a panel; over three there are slices at fixed values of one of
    them, for every working mode. Colours are cold where det dF/dpose > 0 and warm where it is < 0. Cells that are not
    proved regular, along the singular curves, are grey.

    Args:
        result: What ``jk.aspects`` returned, over two or three free axes.
        slices: One free axis and its values, for instance ``{"phi": [0.0, 1.0]}``; by default six values of the last
            angle (of the last axis where none is an angle). For three free axes only.
        curves: Singular curves over the same two pose axes (``jk.singular_curves(robot, poses, kind="both")``): solid
            where det dF/dpose = 0, dotted where a leg is stretched or folded. For two free axes only.
        axes: Where to draw, as many as there are panels.

    Returns:
        The Axes, one for each panel.

    Raises:
        InputError: There is no aspect, one free axis, slices or curves that do not fit, or too many or too few Axes.
    """
    style.check_kind(result, Aspects, "aspects, from jk.aspects")
    if not result.count:
        raise InputError("There is no aspect to draw: choose a larger box in jk.aspects.")
    cuts = _cuts(result, slices)
    if curves is not None:
        _check_curves(result, curves)
    modes = {aspect.working_mode: aspect.mode for aspect in result}
    places = [(mode, cut) for mode in modes for cut in cuts]
    panels = _panels(len(places), _proportion(result, cuts[0])) if axes is None else _given(axes, len(places))
    paint = _paint(result)
    undecided = False
    for ax, (mode, cut) in zip(panels, places, strict=True):
        part = result.slice(**cut)
        undecided |= _cells(ax, result, part, mode, paint)
        if curves is not None:
            _curves(ax, curves, mode)
        _frame(ax, result, part)
        _numbers(ax, result, part, mode)
        ax.set_title(_title(modes[mode] if len(modes) > 1 else "", cut), fontsize="small")
    if axes is None:
        for ax in panels:
            ax.label_outer()
    handles = _handles(result, paint, undecided=undecided, curves=curves)
    _legend(panels, handles, own=axes is None)
    return panels


# --- what is drawn ------------------------------------------------------------------------------------------


def _cuts(result: Aspects, slices: dict[str, Sequence[float]] | None) -> list[dict[str, float]]:
    """Returns the fixed coordinate of every slice; one slice without any over two free axes."""
    if len(result.free) == 2:
        if slices is not None:
            raise InputError(f"The aspects are over {' and '.join(result.free)} alone: leave slices out.")
        return [{}]
    if len(result.free) != 3:
        raise InputError(
            f"The aspects are over {', '.join(result.free)}: a picture needs two or three free axes in jk.aspects."
        )
    if slices is None:
        angles = [name for name in result.free if result.units[name] == "rad"]
        name = (angles or list(result.free))[-1]
        low, high = _ends(result, name)
        shares = (np.arange(_SLICES) + 0.5) / _SLICES
        return [{name: float(low + share * (high - low))} for share in shares]
    if len(slices) != 1 or next(iter(slices)) not in result.free:
        raise InputError(f"slices names {', '.join(slices) or 'nothing'}: name one of {', '.join(result.free)}.")
    ((name, values),) = slices.items()
    low, high = _ends(result, name)
    for value in values:
        if not low <= value <= high:
            raise InputError(f"A slice at {name} = {value:g} is outside the box, {low:g} to {high:g}: move it inside.")
    return [{name: float(value)} for value in values]


def _ends(result: Aspects, name: str) -> tuple[float, float]:
    low, high, *_ = result.request["grid"][name]
    return float(low), float(high)


def _paint(result: Aspects) -> list[tuple[str, str | None]]:
    """Returns colour and hatching of every aspect: no two of one working mode are alike."""
    found, used = [], dict[tuple[Any, int], int]()
    for aspect in result:
        key = (aspect.working_mode, aspect.sign)
        number = used.get(key, 0)
        used[key] = number + 1
        colours = _COLOURS[aspect.sign]
        found.append((colours[number % len(colours)], _HATCHES[number // len(colours) % len(_HATCHES)]))
    return found


def _cells(ax: Axes, result: Aspects, part: Slice, mode: tuple[int, ...], paint: list[tuple[str, str | None]]) -> bool:
    """Draws the cells of one working mode; returns whether there are undecided ones."""
    own = np.all(part.working_mode == np.array(mode), axis=1)
    for number in np.unique(part.aspect[own]):
        chosen = own & (part.aspect == number)
        low, high = part.low[chosen], part.high[chosen]
        corners = np.stack([low, np.c_[high[:, 0], low[:, 1]], high, np.c_[low[:, 0], high[:, 1]]], axis=1)
        colour, hatch = (_UNDECIDED, None) if number < 0 else paint[number]
        # Edges in the same colour close the gaps that antialiasing leaves between neighbours.
        edge = "black" if hatch else colour
        look: dict[str, Any] = {"facecolors": colour, "edgecolors": edge, "linewidths": 0.0 if hatch else 0.3}
        cells = PolyCollection(corners, hatch=hatch, zorder=1, **look)  # type: ignore[arg-type]
        # As vectors, tens of thousands of cells fill megabytes of a PDF.
        cells.set_rasterized(True)
        ax.add_collection(cells, autolim=False)
    return bool(np.any(own & (part.aspect < 0)))


def _frame(ax: Axes, result: Aspects, part: Slice) -> None:
    style.dress(ax, *((name, result.units[name]) for name in part.axes))
    ax.set(xlim=_ends(result, part.axes[0]), ylim=_ends(result, part.axes[1]))


def _numbers(ax: Axes, result: Aspects, part: Slice, mode: tuple[int, ...]) -> None:
    """Writes the number of every aspect that is not too small into its largest cell."""
    whole = float(np.prod([np.diff(_ends(result, name)) for name in part.axes]))
    for number, aspect in enumerate(result):
        chosen = np.all(part.working_mode == np.array(mode), axis=1) & (part.aspect == number)
        if aspect.working_mode != mode or not chosen.any():
            continue
        areas = np.where(chosen, np.prod(part.high - part.low, axis=1), -1.0)
        if np.sum(areas[chosen]) < _LEAST_SHARE * whole:
            continue
        # Of the larger cells the one nearest to the middle of them all.
        best = np.flatnonzero(areas >= 0.2 * areas.max())
        middles = (part.low + part.high)[best] / 2
        centre = np.average(middles, axis=0, weights=areas[best])
        place = middles[int(np.argmin(np.linalg.norm(middles - centre, axis=1)))]
        text = ax.text(
            float(place[0]),
            float(place[1]),
            str(number),
            ha="center",
            va="center",
            fontsize="small",
            zorder=6,
            clip_on=True,
        )
        text.set_path_effects([effects.withStroke(linewidth=2, foreground="white", alpha=0.8)])


def _title(mode: str, cut: dict[str, float]) -> str:
    shown = mode if mode.startswith("sheet") else f"({', '.join(mode.split()).replace('-', '−')})"
    parts = [f"working mode {shown}"] if mode else []
    parts += [style.value(name, round(value, 4)) for name, value in cut.items()]
    return ", ".join(parts)


# --- curves -------------------------------------------------------------------------------------------------


def _check_curves(result: Aspects, curves: SingularCurves) -> None:
    free, _ = loci.section_of(curves)
    if len(result.free) != 2 or set(free) != set(result.free):
        raise InputError(
            f"The curves are over {' and '.join(free)}, the aspects over {', '.join(result.free)}: both must be over "
            "the same two pose axes."
        )


def _curves(ax: Axes, curves: SingularCurves, mode: tuple[int, ...]) -> None:
    looks = _curve_looks(curves)
    for curve in curves:
        if _in_mode(curve.label, mode):
            for piece in loci.unglued(curves, loci.whole_line(curves, curve)):
                ax.plot(*piece.T, zorder=4, scalex=False, scaley=False, **looks[_kind(curve.label)])


def _kind(label: str) -> str:
    """Returns what vanishes on a curve: ``det A``, a factor, or ``det B`` for every leg."""
    return label.partition(",")[0] or "det A"


def _curve_looks(curves: SingularCurves) -> dict[str, dict[str, Any]]:
    kinds = list(dict.fromkeys(_kind(curve.label) for curve in curves))
    factors = [kind for kind in kinds if kind not in _LOOKS]
    own = {kind: {**_LOOKS["det A"], "linestyle": _FACTORS[k % len(_FACTORS)]} for k, kind in enumerate(factors)}
    return {kind: _LOOKS.get(kind) or own[kind] for kind in kinds}


def _in_mode(label: str, mode: Sequence[int]) -> bool:
    """True where a curve lies in a working mode or on its boundary; a 0 in its label stands for both signs."""
    signs = label.rpartition("working mode ")[2] if "working mode " in label else ""
    return all(text in ("0", "+" if sign > 0 else "-") for text, sign in zip(signs, mode, strict=False))


# --- panels and legend --------------------------------------------------------------------------------------


def _handles(
    result: Aspects, paint: list[tuple[str, str | None]], *, undecided: bool, curves: SingularCurves | None
) -> list[Artist]:
    named = sorted(np.argsort(-result.volume, kind="stable")[:_MOST_NAMES].tolist())
    found: list[Artist] = [
        Patch(facecolor=paint[number][0], hatch=paint[number][1], label=f"{number}: {_described(result, number)}")
        for number in named
    ]
    if len(named) < result.count:
        found.append(Patch(facecolor="none", edgecolor="none", label=f"and {result.count - len(named)} smaller ones"))
    if undecided:
        found.append(Patch(facecolor=_UNDECIDED, label="not proved regular"))
    if curves is not None:
        for kind, look in _curve_looks(curves).items():
            name = kind if kind.startswith("det ") else style.symbol(kind)
            found.append(Line2D([], [], label=f"{name} = 0", **look))
    return found


def _described(result: Aspects, number: int) -> str:
    aspect = result[number]
    size = {2: "area", 3: "volume"}[len(result.free)]
    edge = ", reaches the edge" if aspect.touches_edge else ""
    return f"det {'>' if aspect.sign > 0 else '<'} 0, {size} {_rounded(aspect.volume, aspect.error)}{edge}"


def _rounded(value: float, error: float) -> str:
    """Returns a value with its error, both to the error's first digit."""
    if not 0 < error < abs(value):
        return f"{value:.4g}"
    digits = int(-np.floor(np.log10(error)))
    shown = f"{round(value, digits):.{max(digits, 0)}f}"
    return f"{shown} ± {round(error, digits):.{max(digits, 0)}f}"


def _proportion(result: Aspects, cut: dict[str, float]) -> float:
    """Returns width over height of a panel: as the axes have it where they share a unit."""
    first, second = (name for name in result.free if name not in cut)
    if result.units[first] != result.units[second] or result.units[first] == "rad":
        return 1.0
    sides = [float(np.diff(_ends(result, name))[0]) for name in (first, second)]
    return float(np.clip(sides[0] / sides[1], 0.5, 2.0))


def _panels(count: int, proportion: float) -> np.ndarray:
    """Returns new Axes: in one row where they are narrow."""
    width = _SIZE * min(proportion, 1.0)
    columns = min(count, max(2, int(_PAGE / (width + _LABELS)), 1))
    columns = -(-count // -(-count // columns))
    rows = -(-count // columns)
    height = _SIZE / max(proportion, 1.0)
    size = (max((width + 0.2) * columns + 2 * _LABELS, 6.0), (height + _LABELS + 0.25) * rows + 0.4)
    _, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False, sharex=True, sharey=True)
    for ax in axes.flat[count:]:
        ax.set_axis_off()
    found = np.empty(count, object)
    found[:] = axes.flat[:count]
    return found


def _given(axes: Sequence[Axes], count: int) -> np.ndarray:
    flat = list(np.ravel(np.asarray(axes, dtype=object)))
    if len(flat) != count:
        raise InputError(f"There are {count} panels to draw, but {len(flat)} Axes were given: give so many, or none.")
    found = np.empty(count, object)
    found[:] = flat
    return found


def _legend(panels: np.ndarray, handles: list[Artist], *, own: bool) -> None:
    look: dict[str, Any] = {"handles": handles, "frameon": False, "fontsize": "small"}
    if own:
        figure = panels[0].figure
        columns = 3 if figure.get_figwidth() > 8 else 2
        # Too low a figure makes constrained layout cut the titles of panels with equal aspect.
        figure.set_figheight(figure.get_figheight() + _ENTRY * -(-len(handles) // columns))
        panels[0].figure.legend(loc="outside lower center", ncols=min(columns, len(handles)), **look)
    else:
        panels[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), **look)
