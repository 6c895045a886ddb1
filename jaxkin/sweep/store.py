"""Zarr stores: written tile by tile, opened lazily, continued by the same request only."""

import json
import os
import re
import shutil
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr

from jaxkin.core.errors import StoreError
from jaxkin.core.provenance import Request
from jaxkin.sweep import result
from jaxkin.sweep.fields import Variable
from jaxkin.sweep.grid import BoundGrid

if TYPE_CHECKING:
    import xarray

#: Lines "<tile> done", each written after the tile's data; a torn last line does not match.
_JOURNAL = "tiles.journal"
_JOURNAL_LINE = re.compile(r"^(\d+) done\n", re.MULTILINE)
_RUN_LOG = "run_log.jsonl"


class Store:
    """One Zarr store; use ``Store.open``."""

    def __init__(self, path: Path, variables: tuple[Variable, ...]):
        self.path = path
        self._variables = variables
        self._group = zarr.open_group(path, mode="r+")
        self._lock = threading.Lock()
        journal = self._beside(_JOURNAL)
        if _text(journal)[-1:] not in ("", "\n"):  # A torn last line must not swallow the next one.
            with open(journal, "a", encoding="ascii") as file:
                file.write("\n")

    @classmethod
    def open(
        cls,
        path: Path,
        request: Request,
        variables: tuple[Variable, ...],
        grid: BoundGrid,
        tile: tuple[int, ...],
        *,
        overwrite: bool,
    ) -> "Store":
        """Opens the store of a request, or makes it.

        Raises:
            StoreError: The path holds something else, another request's store, or cannot be written.
        """
        if path.exists() and not _is_empty_folder(path):
            content = read_request(path)
            if content == json.loads(request.text):
                return cls(path, variables)
            if not overwrite:
                raise StoreError(
                    f"{path} was made by another request ({request.difference(content)}): choose another store, or "
                    "replace it with overwrite=True (--force)."
                )
            shutil.rmtree(path)
        # Made aside and renamed, so that a store that exists is whole.
        aside = path.with_name(f".{path.name}.{os.getpid()}.new")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _lay_out(aside, request, variables, grid, tile)
            os.replace(aside, path)
        except OSError as error:
            shutil.rmtree(aside, ignore_errors=True)
            reason = error.strerror or error
            raise StoreError(f"{path} cannot be written ({reason}): choose a folder that you may write.") from error
        return cls(path, variables)

    def done(self) -> set[int]:
        """Returns the numbers of the tiles that were written whole."""
        return {int(number) for number in _JOURNAL_LINE.findall(_text(self._beside(_JOURNAL)))}

    def write(self, number: int, box: tuple[slice, ...], arrays: dict[str, np.ndarray]) -> None:
        """Writes one tile, then journals it."""
        for name, values in arrays.items():
            self._array(name)[(..., *box)] = values
        with self._lock, open(self._beside(_JOURNAL), "a", encoding="ascii") as journal:
            journal.write(f"{number} done\n")
            journal.flush()
            os.fsync(journal.fileno())

    def _beside(self, name: str) -> Path:
        # In the main array's folder, where Zarr does not look for members of the group.
        return self.path / self._variables[0].name / name

    def _array(self, name: str) -> zarr.Array:
        array = self._group[name]
        assert isinstance(array, zarr.Array)
        return array

    def dataset(self, log: dict[str, Any] | None) -> "xarray.Dataset":
        """Opens the result lazily; a log of this run, if any, is appended first."""
        if log is not None:
            with open(self._beside(_RUN_LOG), "a", encoding="utf-8") as file:
                file.write(json.dumps(log) + "\n")
        return open_store(self.path)


def open_store(path: Path) -> "xarray.Dataset":
    """Opens a store lazily, with all labels."""
    import xarray

    dataset = xarray.open_zarr(path, chunks=None, consolidated=False)
    attrs = dataset.attrs
    labels, tiles = json.loads(attrs.pop("labels")), attrs.pop("tiles")
    beside = path / attrs["field"]
    complete = int(len(set(_JOURNAL_LINE.findall(_text(beside / _JOURNAL)))) == tiles)
    last = (_text(beside / _RUN_LOG).splitlines() or ["{}"])[-1]
    axes = [name for name in dataset.data_vars if name not in json.loads(attrs["request"])["variables"]]
    return dataset.set_coords(axes).assign_coords(labels).assign_attrs(complete=complete, run_log=last)


def read_request(path: Path) -> dict[str, Any]:
    """Returns the content of the request that made a store.

    Raises:
        StoreError: There is no readable jaxkin store.
    """
    if not path.is_dir() or not (path / "zarr.json").exists():
        raise StoreError(
            f"{path} exists and is no jaxkin store: choose another path; jaxkin replaces only stores of its own."
        )
    try:
        return json.loads(json.loads((path / "zarr.json").read_text())["attributes"]["request"])
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise StoreError(
            f"{path} holds a Zarr group without a readable jaxkin request (cut short, or made by another program): "
            "move it away or choose another path."
        ) from error


def _text(path: Path) -> str:
    return path.read_text() if path.exists() else ""


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())


def _lay_out(
    path: Path, request: Request, variables: tuple[Variable, ...], grid: BoundGrid, tile: tuple[int, ...]
) -> None:
    """Writes metadata and coordinates of an empty store."""
    tiles = int(np.prod([-(-n // t) for n, t in zip(grid.shape, tile, strict=True)]))
    # Zarr 3 has no settled format for text, so labels travel as an attribute.
    labels = json.dumps(result.labels(variables))
    group = zarr.create_group(path, attributes={**result.request_attrs(request), "tiles": tiles, "labels": labels})
    for variable in variables:
        group.create_array(
            variable.name,
            shape=(*variable.lead, *grid.shape),
            chunks=(*variable.lead, *tile),
            dtype=variable.dtype,
            fill_value=variable.missing,
            dimension_names=result.variable_dims(variable, grid),
            attributes=result.variable_attrs(variable),
        )
    for name, (dims, values, attrs) in result.axis_coordinates(grid).items():
        array = group.create_array(name, shape=values.shape, dtype="float64", dimension_names=dims, attributes=attrs)
        array[...] = values
