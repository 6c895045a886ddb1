"""Maps over one or two free axes."""

import textwrap
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import CenteredNorm, ListedColormap, to_rgb
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from jaxkin.core.errors import InputError
from jaxkin.mapping.records import Cusps, SingularCurves
from jaxkin.plot import loci, style
from jaxkin.plot.labels import label_places

#: A picture is drawn from at most about twice so many samples a side.
_MOST_SAMPLES = 2000
#: Categories, told apart by hatching as well where there are more than these; what belongs to none is light grey.
_CATEGORIES = tuple(style.OKABE_ITO[c] for c in ("sky", "orange", "green", "purple", "yellow", "blue", "vermillion"))
_HATCHES = (None, "///", "...", "xxx", "---")
_NONE = "#DDDDDD"
#: Share of white in the colour of a category outside its margin.
_PALE = 0.6
#: A label beside a picture has so many letters in a line.
_LABEL_WIDTH = 48
#: A legend with a longer entry stands below the picture.
_LONG_LABEL = 34


def section(
    result: xarray.Dataset | xarray.DataArray | None,
    variable: str | None = None,
    ax: Axes | None = None,
    curves: SingularCurves | None = None,
    cusps: Cusps | None = None,
) -> Axes:
    """Draws a map over one or two free axes, with the singular curves and cusps of the section.

    Numbers of solutions, and other counts, are drawn as labelled regions (0 white, samples without a value light grey),
    categories (a variable with ``flag_values`` and ``flag_meanings``, such as ``binding_limit``) as named regions,
    signed quantities diverging about their zero line, others in viridis. Where the margin that belongs to a category is
    negative its colour is pale, and the line of margin zero is drawn. Curves of closed forms have their names beside
    them, others stand in the legend; virtual parts, whose poses are complex, are thin and dashed. What is outside the
    map's axes is left out, and not counted. The title names what the map is a slice of: the fixed axes, and a branch,
    limit or coordinate; or of what it counts something (the attribute ``of``).

    Args:
        result: What ``jk.sweep`` returned; None draws the curves and cusps alone, over their section.
        variable: Which of its variables; the field itself if not given.
        ax: Where to draw; a new figure if not given.
        curves: What ``jk.singular_curves`` returned for this section.
        cusps: What ``jk.cusps`` returned for this section.

    Returns:
        The Axes, with a legend or colour bar.

    Raises:
        InputError: There is no such variable; there are not one or two free axes; there is nothing to draw; an argument
            is of the wrong kind; curves or cusps are of another section, or over a map of one free axis.
    """
    _check_kinds(result, curves, cusps)
    given = [record for record in (curves, cusps) if record is not None]
    if result is None and not any(map(len, given)):
        raise InputError(
            "There is nothing to draw: give a map of jk.sweep, or singular curves or cusps that are not empty."
        )
    data = None if result is None else _chosen(result, variable, bool(given))
    free, fixed = loci.section_of(given[0]) if data is None else _section(data)
    for record in given:
        loci.check(record, free, fixed)
    if ax is None:
        wide = given or (data is not None and data.ndim == 2 and _flags(data))
        _, ax = plt.subplots(figsize=(6.8 if wide else 5.2, 4.6), layout="constrained")
    if data is None:
        _frame(given[0], free, ax)
    else:
        lines = [] if curves is None else [loci.free_points(curves, c.joints) for c in curves]
        _map(data, ax, lines, _margin_of(result, data))
    handles = loci.draw(ax, curves, cusps)
    if handles:
        _add_legend(ax, handles)
    lines = [style.in_lines(style.value(name, value) for name, value in fixed.items())]
    lines += [] if data is None else [",  ".join(_slice(data)), style.words(str(data.attrs.get("of", "")))]
    ax.set_title("\n".join(line for line in lines if line), fontsize="medium")
    return ax


def _check_kinds(result: object, curves: object, cusps: object) -> None:
    maps = "a map, from jk.sweep, or None to draw curves alone"
    style.check_kind(result, (xarray.Dataset, xarray.DataArray, type(None)), maps)
    style.check_kind(curves, (SingularCurves, type(None)), "as curves singular curves, from jk.singular_curves")
    style.check_kind(cusps, (Cusps, type(None)), "as cusps those of a section, from jk.cusps")


def _variable(result: xarray.Dataset | xarray.DataArray, name: str | None) -> xarray.DataArray:
    """Returns a variable by name, the field itself where there is no name."""
    if isinstance(result, xarray.DataArray):
        if name not in (None, result.name):
            raise InputError(f"There is no variable {name!r} in the map of {result.name!r} alone: give the dataset.")
        return result
    names = list(map(str, result.data_vars))
    name = name or result.attrs.get("field") or (names[0] if len(names) == 1 else None)
    if name not in names:
        wrong = "Which variable is to be drawn is not said" if name is None else f"There is no variable {name!r}"
        raise InputError(f"{wrong}: choose one of {', '.join(names)}.")
    return result[name]


def _slice(data: xarray.DataArray) -> list[str]:
    """Returns what besides numbers was chosen of a map: ``branch: ...``, ``limit: ...``."""
    chosen = {str(n): c.item() for n, c in data.coords.items() if c.ndim == 0 and c.dtype.kind in "iuUOT"}
    return [f"{style.words(name)}: {style.words(style.greek(str(value)))}" for name, value in chosen.items()]


def _remedy(data: xarray.DataArray) -> str:
    """Returns how to choose a slice of two axes: labels first, then samples."""
    labelled = {dim: dim in data.coords and data[dim].dtype.kind not in "fiu" for dim in data.dims}
    order = sorted(data.dims, key=lambda dim: (not labelled[dim], dim != "branch"))
    many = max(data.ndim - 2, sum(labelled.values()))
    chosen = (
        f".sel({dim}={str(data[dim].values[0])!r})" if labelled[dim] else f".isel({dim}=0)" for dim in order[:many]
    )
    return "".join(chosen)


def _chosen(result: xarray.Dataset | xarray.DataArray, variable: str | None, with_curves: bool) -> xarray.DataArray:
    """Returns the variable to draw, thinned to what a page can show."""
    data = _variable(result, variable).squeeze()
    if data.ndim == 0:
        raise InputError(f"The map of {data.name!r} is one sample: a picture needs one or two free axes.")
    labels = data.ndim == 2 and any(dim in data.coords and data[dim].dtype.kind not in "fiu" for dim in data.dims)
    if data.ndim > 2 or labels:
        raise InputError(
            f"The map of {data.name!r} has the free axes {', '.join(map(str, data.dims))}: a picture needs one or two "
            f"axes of numbers; select of the others first, for instance with {_remedy(data)}."
        )
    if data.ndim == 1 and with_curves:
        raise InputError(f"The map of {data.name!r} has one free axis: singular curves and cusps need a map of two.")
    return _thinned(data)


def _thinned(data: xarray.DataArray) -> xarray.DataArray:
    if data.ndim == 2:
        # No page shows more samples than this, and an image of all would take many times the data's memory.
        data = data.isel({dim: _spread(n) for dim, n in data.sizes.items()})
    return data


def _spread(count: int) -> slice | np.ndarray:
    """Returns which samples of an axis a picture shows, the first and the last one among them."""
    step = count // _MOST_SAMPLES
    return slice(None) if step < 2 else np.rint(np.linspace(0, count - 1, -(-count // step))).astype(int)


def _flags(data: xarray.DataArray) -> dict[int, str]:
    """Returns what the numbers of a category mean; nothing for other variables."""
    values, meanings = data.attrs.get("flag_values"), str(data.attrs.get("flag_meanings", "")).split()
    return {} if values is None else {int(v): text for v, text in zip(values, meanings, strict=False)}


def _margin_of(result: Any, data: xarray.DataArray) -> np.ndarray | None:
    """Returns the margin that belongs to a map of categories, where the dataset has it."""
    name = f"{data.name}_margin"
    if data.ndim != 2 or not _flags(data) or not hasattr(result, "data_vars") or name not in result:
        return None
    margin = np.asarray(_thinned(result[name].squeeze()))
    return margin if margin.shape == data.shape else None


def _map(data: xarray.DataArray, ax: Axes, lines: list[np.ndarray], margin: np.ndarray | None) -> None:
    if data.ndim == 1:
        _line(data, ax)
    elif _flags(data):
        _categories(data, ax, lines, margin)
    elif np.issubdtype(data.dtype, np.integer):
        _regions(data, ax, lines)
    else:
        _shades(data, ax)


def _section(data: xarray.DataArray) -> tuple[tuple[str, ...], dict[str, float]]:
    """Returns the names of the free axes, and the fixed ones with their values."""
    fixed = {str(n): float(c) for n, c in data.coords.items() if c.ndim == 0 and c.dtype.kind == "f"}
    return tuple(map(str, data.dims)), fixed


def _frame(record: SingularCurves | Cusps, free: tuple[str, ...], ax: Axes) -> None:
    """Prepares Axes for curves without a map."""
    x, y = (record.request["section"][name][:2] for name in free)
    style.dress(ax, *((name, record.units[name]) for name in free))
    ax.set(xlim=x, ylim=y)


def _add_legend(ax: Axes, handles: list[Line2D]) -> None:
    """Adds a legend of curves: below that of the regions, or below the Axes where a colour bar is on the right."""
    look: dict[str, Any] = {"handles": handles, "labels": [handle.get_label() for handle in handles]}
    look |= {"frameon": False, "fontsize": "small"}
    regions = ax.get_legend()
    if regions is not None:
        regions.set_loc("upper left")
        regions.set_bbox_to_anchor((1.01, 1.0))
        # A second call of ax.legend would take the first one away.
        legend = ax.add_artist(Legend(ax, loc="lower left", bbox_to_anchor=(1.01, 0.0), **look))
        # Else the layout takes it for clipped at the Axes, and makes no room.
        legend.set_clip_on(False)
    elif ax.images or max(len(str(handle.get_label())) for handle in handles) > _LONG_LABEL:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, **look)
    else:
        ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), **look)


def _unit(data: xarray.DataArray, dim: object) -> tuple[str, str]:
    return str(dim), str(data[dim].attrs.get("units", ""))


def _extent(samples: np.ndarray) -> tuple[float, float]:
    half = (samples[1] - samples[0]) / 2
    return float(samples[0] - half), float(samples[-1] + half)


def _line(data: xarray.DataArray, ax: Axes) -> None:
    (dim,) = data.dims
    steps = "steps-mid" if np.issubdtype(data.dtype, np.integer) else "default"
    flags, values = _flags(data), np.asarray(data)
    if "not_computed" in data.attrs and not flags:
        values = np.where(values == data.attrs["not_computed"], np.nan, values)
        ax.yaxis.set_major_locator(MaxNLocator(integer=True))
    if flags:
        # Their numbers mean nothing: those that occur stand at equal distances.
        present, values = np.unique(values, return_inverse=True)
        ax.set_yticks(range(len(present)), [style.words(flags.get(int(n), "none")) for n in present])
    ax.plot(data[dim], values, color=style.OKABE_ITO["blue"], drawstyle=steps)
    name, unit = _unit(data, dim)
    ax.set_xlabel(style.axis_label(name, unit))
    if unit == "rad":
        style.ticks_in_pi(ax.xaxis)
    ax.set_ylabel(_quantity(data))


def _quantity(data: xarray.DataArray) -> str:
    """Returns the name of what is drawn with its unit, in lines that fit beside a picture."""
    unit, long_name = str(data.attrs.get("units", "1")), str(data.attrs.get("long_name", data.name))
    if ": " in unit:
        # Of coordinates of several units: that of the chosen one, where that is known.
        units = dict(entry.split(": ", 1) for entry in unit.split(", ") if ": " in entry)
        unit = next((units[str(c.item())] for c in data.coords.values() if c.ndim == 0 and str(c.item()) in units), "")
    text = style.with_unit(long_name, unit)
    lines = -(-len(text) // _LABEL_WIDTH)
    return textwrap.fill(text, max(len(text) // lines + 6, 12), break_long_words=False)


def _image(data: xarray.DataArray, ax: Axes, values: np.ndarray, **options: object):
    horizontal, vertical = data.dims
    x, y = np.asarray(data[horizontal]), np.asarray(data[vertical])
    image = ax.imshow(
        values,
        origin="lower",
        extent=(*_extent(x), *_extent(y)),
        aspect="auto",
        interpolation_stage="rgba",
        **options,  # type: ignore[arg-type]
    )
    style.dress(ax, _unit(data, horizontal), _unit(data, vertical))
    ax.set(xlim=_limits(x), ylim=_limits(y))
    return image


def _limits(samples: np.ndarray) -> tuple[float, float]:
    """Returns the ends of an axis; a full turn ends one step past its last sample."""
    rest = 2 * np.pi - (samples[-1] - samples[0])
    # Of a thinned axis only that is known which is left of the turn: less than a step, and no more than a sample.
    whole = np.isclose(rest, samples[1] - samples[0]) or (
        len(samples) >= _MOST_SAMPLES and 0 < rest < 1.01 * np.pi / _MOST_SAMPLES
    )
    return float(samples[0]), float(samples[-1] + (rest if whole else 0.0))


def _regions(data: xarray.DataArray, ax: Axes, lines: list[np.ndarray]) -> None:
    counts = np.asarray(data).T
    present = [int(n) for n in np.unique(counts)]
    missing = data.attrs.get("not_computed")
    solutions = data.name == "forward_count"
    absent, colour = ("not computed", style.count_colour) if solutions else ("no value", style.tally_colour)
    names = {n: absent if n == missing else f"{n}" for n in present}
    colours = ["#DDDDDD" if n == missing else colour(n) for n in present]
    _image(
        data,
        ax,
        np.searchsorted(present, counts),
        cmap=ListedColormap(colours),
        vmin=-0.5,
        vmax=len(present) - 0.5,
    )
    x, y = (np.asarray(data[dim]) for dim in data.dims)
    for column, row, number in label_places(x, y, counts, present, lines):
        if number != missing:
            ax.text(column, row, str(number), ha="center", va="center", fontsize="medium")
    handles = [
        Patch(facecolor=colour, edgecolor="black", linewidth=0.6, label=names[n])
        for n, colour in zip(present, colours, strict=True)
    ]
    title = "real solutions" if solutions else _quantity(data)
    ax.legend(handles=handles, title=title, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)


def _categories(data: xarray.DataArray, ax: Axes, lines: list[np.ndarray], margin: np.ndarray | None) -> None:
    """Draws regions with names; colours repeat with a hatching."""
    flags, values = _flags(data), np.asarray(data).T
    present = [int(n) for n in np.unique(values)]
    named = [n for n in present if n in flags]
    paint = {n: np.array(to_rgb(_CATEGORIES[k % len(_CATEGORIES)])) for k, n in enumerate(named)}
    hatches = {n: _HATCHES[(k // len(_CATEGORIES)) % len(_HATCHES)] for k, n in enumerate(named)}
    none = np.array(to_rgb(_NONE))
    place = np.searchsorted(present, values)
    image = np.array([paint.get(n, none) for n in present])[place]
    outside = np.zeros(values.shape, bool) if margin is None else margin.T < 0
    image[outside] += _PALE * (1 - image[outside])
    _image(data, ax, image)
    x, y = (np.asarray(data[dim]) for dim in data.dims)
    for n in named:
        if hatches[n]:
            ax.contourf(x, y, values == n, levels=[0.5, 1.5], colors="none", hatches=[hatches[n]])
    handles: list[Any] = [
        Patch(
            facecolor=tuple(paint[n]), edgecolor="black", linewidth=0.6, hatch=hatches[n], label=style.words(flags[n])
        )
        for n in named
    ]
    if len(named) < len(present):
        handles.append(Patch(facecolor=_NONE, edgecolor="black", linewidth=0.6, label="none"))
    for column, row, n in label_places(x, y, values, named, lines):
        text = ax.text(column, row, style.words(flags[n]), ha="center", va="center", fontsize="small")
        text.set_bbox({"facecolor": "white", "alpha": 0.65, "edgecolor": "none", "pad": 1.0})
    if outside.any():
        handles.append(Patch(facecolor="#F2F2F2", edgecolor="black", linewidth=0.6, label="pale: violated"))
    if outside.any() and not outside.all():
        ax.contour(x, y, margin.T, levels=[0.0], colors="black", linewidths=1.4)  # type: ignore[union-attr]
        handles.append(Line2D([], [], color="black", linewidth=1.4, label="margin 0"))
    title = str(data.attrs.get("long_name", data.name))
    look: dict[str, Any] = {"title": title, "title_fontsize": "small", "fontsize": "small", "frameon": False}
    ax.legend(handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5), **look)


def _shades(data: xarray.DataArray, ax: Axes) -> None:
    values = np.asarray(data, dtype=float).T
    signed = bool(np.nanmin(values) < 0 < np.nanmax(values)) if np.isfinite(values).any() else False
    values = np.where(np.isfinite(values), values, np.nan)
    options = {"cmap": "RdBu_r", "norm": CenteredNorm()} if signed else {"cmap": "viridis"}
    ax.set_facecolor("#DDDDDD")
    image = _image(data, ax, values, **options)
    if signed:
        x, y = (np.asarray(data[dim]) for dim in data.dims)
        ax.contour(x, y, values, levels=[0.0], colors="black", linewidths=0.8)
    ax.figure.colorbar(image, ax=ax, label=_quantity(data))
