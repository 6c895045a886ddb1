"""Results that lie in a store, opened without loading them."""

import contextlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import zarr

from jaxkin.core.errors import InputError, StoreError
from jaxkin.sweep.coordinates import damaged_coordinates
from jaxkin.sweep.journal import Journal
from jaxkin.sweep.manifest import (
    JOURNAL,
    RUN_LOG,
    Contradiction,
    Manifest,
    beside,
    damaged_store,
    read_manifest,
    tile_file,
)
from jaxkin.sweep.plan import tile_counts, tile_place

if TYPE_CHECKING:
    import xarray


def open_store(path: str | Path, chunks: Any = None) -> "xarray.Dataset":
    """Opens a store that ``jk.sweep`` has written, without loading it.

    Args:
        path: The store's folder.
        chunks: None for plain lazy arrays; ``{}`` or sizes for those of dask, as in ``xarray.open_zarr``.

    Returns:
        The dataset that ``jk.sweep`` returned; attribute ``complete`` is 0 while tiles are missing.

    Raises:
        StoreError: There is no jaxkin store at this path, or its description is damaged.
    """
    import xarray

    path = Path(path)
    manifest = read_manifest(path)
    if not (chunks is None or chunks == "auto" or isinstance(chunks, (int, dict))):
        raise InputError(f"jk.open_store: chunks is {chunks!r}: it must be None, 'auto', a number or a dict of sizes.")
    wrong = damaged_coordinates(path, manifest.request["grid"])
    if wrong:
        raise StoreError(
            f"{path} has damaged coordinates ({', '.join(wrong)}): run the same request again, which writes them anew."
        )
    try:
        dataset = xarray.open_zarr(path, chunks=chunks, consolidated=False)
        for name in manifest.variables:
            if name not in dataset:
                raise Contradiction(f"the array {name!r} is gone")
    except Exception as error:
        raise damaged_store(path, error) from error
    for name in ("labels", "tiles", "layout", "environment"):
        dataset.attrs.pop(name)
    axes = [name for name in dataset.data_vars if name not in manifest.variables]
    done, last = len(journal_of(path, manifest)), (run_logs(path, manifest) or [{}])[-1]
    complete = int(done == manifest.tiles)
    labels = json.loads(manifest.attrs["labels"])
    return dataset.set_coords(axes).assign_coords(labels).assign_attrs(complete=complete, run_log=json.dumps(last))


def journal_of(path: Path, manifest: Manifest) -> Journal:
    """Returns the journal of a store, whatever made it."""
    shapes = {name: zarr.open_array(path / name, mode="r").shape for name in manifest.variables}
    tile = tuple(manifest.layout["tile"])
    counts = tile_counts(shapes[manifest.field][-len(tile) :], tile)

    def files(number: int) -> list[Path]:
        place = tile_place(number, counts)
        return [tile_file(path, name, len(shape) - len(tile), place) for name, shape in shapes.items()]

    return Journal(beside(path, manifest.field, JOURNAL), manifest.tiles, files)


def run_logs(path: Path, manifest: Manifest) -> list[dict[str, Any]]:
    """Returns the logs of the runs that wrote a store, oldest first; torn ones are left out."""
    file = beside(path, manifest.field, RUN_LOG)
    logs = []
    for line in file.read_text(errors="replace").splitlines() if file.exists() else ():
        with contextlib.suppress(ValueError):
            logs.append(json.loads(line))
    return logs
