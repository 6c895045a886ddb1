"""The cells of an adaptive sweep over two free axes."""

import itertools
import textwrap
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch

from jaxkin.core.errors import InputError
from jaxkin.plot import style
from jaxkin.plot.labels import SAMPLES, label_places
from jaxkin.sweep.units import counted

#: Boundary cells, one grid step wide: their colour, and how it is named.
_BOUNDARY = "#000000"
_EDGE = "#555555"
#: Categories in order of their numbers; more than these share their colours.
_CATEGORIES = tuple(style.OKABE_ITO[c] for c in ("sky", "orange", "green", "purple", "yellow", "blue", "vermillion"))
#: Cells without a proof, in a result that proves others, are hatched.
_UNPROVED = "xxxxxx"
#: A picture of more cells is an image in the PDF: no page shows their edges.
_MOST_VECTORS = 5000
#: Letters in a line above the legend.
_TITLE_WIDTH = 24


def cells(result: xarray.Dataset, ax: Axes | None = None) -> Axes:
    """Draws the cells of an adaptive sweep over two free axes: where it refined, and what it found.

    Numbers of solutions have the colours of ``jk.plot.section``, signs those of determinants, other labels one each.
    Each region is named where it is widest. Boundary cells, one grid step wide with corners that differ, are black;
    where the sweep proved cells constant those that are so by samples alone are hatched.

    Args:
        result: What ``jk.sweep(..., adaptive=True)`` returned; of a field with branches, one of them
            (``result.isel(branch=0)``).
        ax: Where to draw; a new figure if not given.

    Returns:
        The Axes, with a legend.

    Raises:
        InputError: It is no adaptive result, or not one over two free axes and one branch.
    """
    label = _checked(result)
    if ax is None:
        _, ax = plt.subplots(figsize=(6.8, 4.6), layout="constrained")
    low, high, constant = (np.asarray(result[name]) for name in ("low", "high", "constant"))
    names = [str(name) for name in result["axis"].values]
    units = dict(entry.split(": ") for entry in result["low"].attrs["units"].split(", "))
    style.dress(ax, *((name, units[name]) for name in names))
    ax.set(xlim=(low[:, 0].min(), high[:, 0].max()), ylim=(low[:, 1].min(), high[:, 1].max()))
    values = np.asarray(label)
    # The label of a boundary cell is that of most corners; black says what it is.
    present = np.unique(values[constant > 0])
    colours, texts = _looks(label, present)
    handles = []
    proofs = bool(np.any(constant == 2))
    for value, colour, text in zip(present, colours, texts, strict=True):
        for proved in (True, False):
            some = (values == value) & (constant == (2 if proved else 1))
            _draw(ax, low[some], high[some], colour, _UNPROVED if proofs and not proved else None)
        handles.append(Patch(facecolor=colour, edgecolor="black", linewidth=0.6, label=text))
    mixed = constant == 0
    if mixed.any():
        _draw(ax, low[mixed], high[mixed], _BOUNDARY, None)
        handles.append(Patch(facecolor=_BOUNDARY, edgecolor=_BOUNDARY, label="boundary"))
    if proofs and np.any(constant == 1):
        handles.append(Patch(facecolor="white", edgecolor=_EDGE, hatch=_UNPROVED, linewidth=0.3, label="not proved"))
    named = dict(zip(present.tolist(), texts, strict=True))
    for x, y, value in _places(low, high, np.where(constant > 0, np.searchsorted(present, values), -1), len(present)):
        _name(ax, x, y, named[present[value].item()])
    look: dict[str, Any] = {"title": _title(label), "title_fontsize": "small", "fontsize": "small", "frameon": False}
    ax.legend(handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5), **look)
    fixed = {str(n): float(c) for n, c in result.coords.items() if c.ndim == 0 and c.dtype.kind == "f"}
    first = style.in_lines(style.value(name, value) for name, value in fixed.items())
    evaluated, whole = result.attrs["evaluations"], result.attrs["grid_samples"]
    second = f"{counted(len(values), 'cell')}, {evaluated:,} of {whole:,} samples evaluated"
    ax.set_title("\n".join(line for line in (first, second) if line), fontsize="medium")
    return ax


def _checked(result: Any) -> xarray.DataArray:
    style.check_kind(result, (xarray.Dataset,), "an adaptive result, from jk.sweep(..., adaptive=True)")
    if "constant" not in result or "label" not in result.attrs:
        raise InputError("The dataset has no cells: draw dense maps with jk.plot.section.")
    label = result[result.attrs["label"]]
    if result.sizes["axis"] != 2:
        raise InputError(
            f"The cells have {result.sizes['axis']} free axes: a picture needs two; draw a section of to_dense()."
        )
    if label.ndim != 1:
        dim = next(str(dim) for dim in label.dims if dim != "cell")
        raise InputError(f"The label has the dimension {dim!r}: choose one first, with .isel({dim}=0).")
    return label


def _draw(ax: Axes, low: np.ndarray, high: np.ndarray, colour: str, hatch: str | None) -> None:
    if not len(low):
        return
    corners = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)], 1)
    some = PolyCollection(
        list(corners), facecolors=colour, edgecolors=_EDGE, linewidths=0.15, rasterized=len(low) > _MOST_VECTORS
    )
    if hatch is not None:
        some.set_hatch(hatch)
    ax.add_collection(some, autolim=False)


def _places(low: np.ndarray, high: np.ndarray, values: np.ndarray, count: int) -> list[tuple[float, float, int]]:
    """Returns where the labels 0 .. count - 1 stand: on an image of the cells, of which the smallest may be lost."""
    start, end = low.min(axis=0), high.max(axis=0)
    step = (end - start) / SAMPLES
    x, y = (a + (np.arange(SAMPLES) + 0.5) * s for a, s in zip(start, step, strict=True))
    image = np.full((SAMPLES, SAMPLES), -1)
    first, last = (np.ceil((edge - start) / step - 0.5).astype(int) for edge in (low, high))
    sides = last - first
    for size in np.unique(sides, axis=0):
        own = np.flatnonzero((sides == size).all(axis=1))
        columns, rows = (first[own, k, None] + np.arange(size[k]) for k in (0, 1))
        image[rows[:, :, None], columns[:, None, :]] = values[own, None, None]
    return label_places(x, y, image, range(count))


def _name(ax: Axes, x: float, y: float, text: str) -> None:
    """Writes a label, so that colours are not all that tells labels apart."""
    written = ax.text(x, y, text, ha="center", va="center", fontsize="small", clip_on=True)
    written.set_bbox({"facecolor": "white", "alpha": 0.65, "edgecolor": "none", "pad": 1.0})


def _looks(label: xarray.DataArray, present: np.ndarray) -> tuple[list[str], list[str]]:
    """Returns colour and text of each label."""
    flags = label.attrs.get("flag_values")
    meanings = str(label.attrs.get("flag_meanings", "")).split()
    if flags is not None and str(label.name).endswith("_sign"):
        known = dict(zip(map(int, flags), meanings, strict=True))
        return [style.SIGN_COLOURS.get(int(v), "#DDDDDD") for v in present], [known[int(v)] for v in present]
    if flags is not None:
        known = dict(zip(map(int, flags), meanings, strict=False))
        texts = [style.words(known.get(int(v), "none")) for v in present]
        colours = itertools.cycle(_CATEGORIES)
        return [next(colours) if int(v) in known else "#DDDDDD" for v in present], texts
    if str(label.name) == "forward_count":
        return [style.count_colour(int(v)) for v in present], [str(int(v)) for v in present]
    if label.dtype == bool:
        return [style.OKABE_ITO["sky"] if v else "#FFFFFF" for v in present], [
            "true" if v else "false" for v in present
        ]
    missing = label.attrs.get("not_computed")
    texts = ["no value" if v == missing else str(int(v)) for v in present]
    return ["#DDDDDD" if v == missing else style.tally_colour(int(v)) for v in present], texts


def _title(label: xarray.DataArray) -> str:
    text = "real solutions" if label.name == "forward_count" else str(label.attrs.get("long_name", label.name))
    return textwrap.fill(text, _TITLE_WIDTH)
