"""Area or volume of each label of an adaptive sweep, with bounds."""

from typing import TYPE_CHECKING

import numpy as np
import xarray

from jaxkin.sweep._adaptive_lattice import Lattice

if TYPE_CHECKING:
    from jaxkin.sweep._adaptive_result import AdaptiveSweep


def measured(found: "AdaptiveSweep", lattice: Lattice) -> xarray.Dataset:
    """Measures labels; see ``AdaptiveSweep.measure``."""
    label = found.label
    volume = np.prod(found.high.values - found.low.values, axis=1)
    constant = found.constant.values
    lead = [dim for dim in label.dims if dim != "cell"]
    cells = label.values.reshape(-1, label.sizes["cell"])
    at = found[f"{label.name}_at_samples"].values.reshape(-1, found.sizes["sample"])
    kinds = np.unique(at)
    mixed = np.flatnonzero(constant == 0)
    low = found.place.values[mixed].astype(np.int64)
    corners = lattice.corners(low, lattice.high(low, found["size"].values[mixed].astype(np.int64)))
    where = np.searchsorted(lattice.keys(found.sample_place.values.astype(np.int64)), lattice.keys(corners))
    total, proved = float(volume.sum()), float(volume[constant == 2].sum())
    rows = []
    for values, samples in zip(cells, at, strict=True):
        of_corner = samples[where]
        rows.append([_bounds(kind, values, of_corner, volume, constant, mixed, proved, total) for kind in kinds])
    shape = (*(label.sizes[dim] for dim in lead), len(kinds))
    table = np.array(rows).reshape(*shape, 5)
    names = ("measure", "low", "high", "proved_low", "proved_high")
    axes = found.low.attrs["units"].split(", ")
    unit = {"units": " ".join(axis.split(": ")[1] for axis in axes)}
    sums = {name: float(volume[constant == k].sum()) for k, name in enumerate(("boundary", "sampled", "proved"))}
    coords = {dim: label[dim] for dim in lead} | {"label": ("label", kinds, dict(label.attrs))}
    made = {name: ((*lead, "label"), table[..., k], unit) for k, name in enumerate(names)}
    return xarray.Dataset(made, coords=coords, attrs={"total": total, **sums})


def _bounds(
    kind: object,
    values: np.ndarray,
    of_corner: np.ndarray,
    volume: np.ndarray,
    constant: np.ndarray,
    mixed: np.ndarray,
    proved: float,
    total: float,
) -> tuple[float, ...]:
    """Returns measure, low, high, and what is proved at least and at most, of one label."""
    own = values == kind
    low = float(volume[own & (constant > 0)].sum())
    surely = float(volume[own & (constant == 2)].sum())
    if not len(mixed):
        return low, low, low, surely, total - (proved - surely)
    share = np.mean(of_corner == kind, axis=1)
    boundary = volume[mixed]
    estimate = low + float(np.sum(share * boundary))
    # A branch may be constant in a cell in which another one changes.
    sure = low + float(np.sum(boundary[share == 1]))
    return estimate, sure, low + float(np.sum(boundary[share > 0])), surely, total - (proved - surely)
