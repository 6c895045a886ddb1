"""Maps over one or two free axes."""

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import CenteredNorm, ListedColormap
from matplotlib.patches import Patch
from scipy import ndimage

from jaxkin.core.errors import InputError
from jaxkin.plot import style

if TYPE_CHECKING:
    import xarray

#: Regions smaller than this share of the picture get no label; the legend still names them.
_LABEL_SHARE = 0.004
#: A picture is drawn from at most about twice so many samples a side.
_MOST_SAMPLES = 2000
#: Labels are placed on a picture of at most so many samples a side.
_LABEL_SAMPLES = 400


def section(result: "xarray.Dataset | xarray.DataArray", variable: str | None = None, ax: Axes | None = None) -> Axes:
    """Draws a map over one or two free axes.

    Numbers of solutions are drawn as labelled regions (0 white, uncomputed samples light grey), signed
    quantities diverging about their zero line, others in viridis.

    Args:
        result: What ``jk.sweep`` returned.
        variable: Which of its variables; the field itself if not given.
        ax: Where to draw; a new figure if not given.

    Returns:
        The Axes, with a legend or colour bar.

    Raises:
        InputError: There are not one or two free axes.
    """
    data = (
        result if variable is None and not hasattr(result, "data_vars") else result[variable or result.attrs["field"]]
    )
    data = data.squeeze()  # type: ignore[union-attr]
    if data.ndim not in (1, 2):
        raise InputError(
            f"The map of {data.name!r} has the free axes {', '.join(map(str, data.dims))}: a picture needs one or two; "
            "select the others first, for instance with .isel(branch=0)."
        )
    if ax is None:
        _, ax = plt.subplots(figsize=(5.2, 4.6), layout="constrained")
    if data.ndim == 1:
        _line(data, ax)  # type: ignore[arg-type]
    else:
        # No page shows more samples than this, and an image of all would take many times the data's memory.
        data = data[tuple(slice(None, None, max(1, n // _MOST_SAMPLES)) for n in data.shape)]
        (_regions if np.issubdtype(data.dtype, np.integer) else _shades)(data, ax)  # type: ignore[arg-type]
    fixed = [
        f"{style.symbol(str(n))} = {float(c):g}" for n, c in data.coords.items() if c.ndim == 0 and c.dtype.kind == "f"
    ]
    ax.set_title(", ".join(fixed), fontsize="medium")
    return ax


def _unit(data: "xarray.DataArray", dim: object) -> tuple[str, str]:
    return str(dim), str(data[dim].attrs.get("units", ""))


def _extent(samples: np.ndarray) -> tuple[float, float]:
    half = (samples[1] - samples[0]) / 2
    return float(samples[0] - half), float(samples[-1] + half)


def _line(data: "xarray.DataArray", ax: Axes) -> None:
    (dim,) = data.dims
    steps = "steps-mid" if np.issubdtype(data.dtype, np.integer) else "default"
    ax.plot(data[dim], data, color=style.OKABE_ITO["blue"], drawstyle=steps)
    name, unit = _unit(data, dim)
    ax.set_xlabel(style.axis_label(name, unit))
    ax.set_ylabel(str(data.attrs.get("long_name", data.name)))


def _image(data: "xarray.DataArray", ax: Axes, values: np.ndarray, **options: object):
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
    step = samples[1] - samples[0]
    whole = np.isclose(samples[-1] + step - samples[0], 2 * np.pi)
    return float(samples[0]), float(samples[-1] + (step if whole else 0.0))


def _regions(data: "xarray.DataArray", ax: Axes) -> None:
    counts = np.asarray(data).T
    present = [int(n) for n in np.unique(counts)]
    missing = data.attrs.get("not_computed")
    names = {n: "not computed" if n == missing else f"{n}" for n in present}
    colours = ["#DDDDDD" if n == missing else style.count_colour(n) for n in present]
    _image(
        data,
        ax,
        np.searchsorted(present, counts),
        cmap=ListedColormap(colours),
        vmin=-0.5,
        vmax=len(present) - 0.5,
    )
    for x, y, number in _label_places(data, counts, present):
        if number != missing:
            ax.text(x, y, str(number), ha="center", va="center", fontsize="medium")
    handles = [
        Patch(facecolor=colour, edgecolor="black", linewidth=0.6, label=names[n])
        for n, colour in zip(present, colours, strict=True)
    ]
    ax.legend(handles=handles, title="real solutions", loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)


def _label_places(data: "xarray.DataArray", counts: np.ndarray, present: list[int]) -> list[tuple[float, float, int]]:
    """Returns the point farthest from the border of every region that is large enough for a label."""
    step = max(1, -(-max(counts.shape) // _LABEL_SAMPLES))
    small = counts[::step, ::step]
    x, y = (np.asarray(data[dim])[::step] for dim in data.dims)
    places = []
    for number in present:
        pieces, count = ndimage.label(small == number)  # type: ignore[misc]
        sizes = np.bincount(pieces.ravel(), minlength=count + 1)
        for piece in range(1, count + 1):
            if sizes[piece] < _LABEL_SHARE * small.size:
                continue
            # A frame of other samples keeps labels off the edge of the picture.
            depth = np.asarray(ndimage.distance_transform_edt(np.pad(pieces == piece, 1)))[1:-1, 1:-1]
            row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
            places.append((float(x[column]), float(y[row]), number))
    return places


def _shades(data: "xarray.DataArray", ax: Axes) -> None:
    values = np.asarray(data, dtype=float).T
    signed = bool(np.nanmin(values) < 0 < np.nanmax(values)) if np.isfinite(values).any() else False
    values = np.where(np.isfinite(values), values, np.nan)
    options = {"cmap": "RdBu_r", "norm": CenteredNorm()} if signed else {"cmap": "viridis"}
    ax.set_facecolor("#DDDDDD")
    image = _image(data, ax, values, **options)
    if signed:
        x, y = (np.asarray(data[dim]) for dim in data.dims)
        ax.contour(x, y, values, levels=[0.0], colors="black", linewidths=0.8)
    unit = str(data.attrs.get("units", "1"))
    label = str(data.attrs.get("long_name", data.name)) + (f" ({unit})" if unit not in ("", "1") else "")
    ax.figure.colorbar(image, ax=ax, label=label)
