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
            if not overwrite:
                if content != json.loads(request.text):
                    raise StoreError(
                        f"{path} was made by another request ({request.difference(content)}): choose another store, or "
                        "replace it with overwrite=True (--force)."
                    )
                _verify(path, variables, grid, tile)
                return cls(path, variables)
            shutil.rmtree(path)
        # Made aside and renamed, so that a store that exists is whole.
        aside = path.with_name(f".{path.name}.{os.getpid()}.new")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _lay_out(aside, request, variables, grid, tile)
            os.replace(aside, path)
        except OSError as error:
            if (path / "zarr.json").exists():
                remedy = "another process made it meanwhile; wait for it, then run the same request again"
            else:
                remedy = "choose a folder that you may write"
            raise StoreError(f"{path} cannot be written ({error.strerror or error}): {remedy}.") from error
        finally:
            shutil.rmtree(aside, ignore_errors=True)
        return cls(path, variables)

    def done(self) -> set[int]:
        """Returns the numbers of the tiles that were written whole."""
        return _journalled(self.path, self._variables[0].name)

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
    complete = int(len(_journalled(path, attrs["field"])) == tiles)
    last = (_text(path / attrs["field"] / _RUN_LOG).splitlines() or ["{}"])[-1]
    axes = [name for name in dataset.data_vars if name not in json.loads(attrs["request"])["variables"]]
    return dataset.set_coords(axes).assign_coords(labels).assign_attrs(complete=complete, run_log=last)


def read_request(path: Path) -> dict[str, Any]:
    """Returns the content of the request that made a store.

    Raises:
        StoreError: There is no readable jaxkin store.
    """
    if not path.is_dir() or not (path / "zarr.json").exists():
        raise StoreError(
            f"{path} exists and is no jaxkin store: move it away or choose another path; jaxkin replaces only stores "
            "of its own."
        )
    try:
        return json.loads(json.loads((path / "zarr.json").read_text())["attributes"]["request"])
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise StoreError(
            f"{path} holds a Zarr group without a readable jaxkin request (cut short, or made by another program): "
            "move it away or choose another path; --force replaces only what is surely jaxkin's."
        ) from error


def _text(path: Path) -> str:
    return path.read_text(errors="replace") if path.exists() else ""


def _journalled(path: Path, field: str) -> set[int]:
    """Returns the numbers of the tiles that the journal says were written, and whose data is there.

    Zarr leaves out a chunk that holds nothing but the fill value; only of counts, which never are, a missing
    chunk proves a loss.
    """
    numbers = {int(number) for number in _JOURNAL_LINE.findall(_text(path / field / _JOURNAL))}
    array = zarr.open_array(path / field, mode="r")
    if not np.issubdtype(array.dtype, np.integer):
        return numbers
    counts = [-(-n // c) for n, c in zip(array.shape, array.chunks, strict=True)]
    inside = (number for number in numbers if number < np.prod(counts))
    return {n for n in inside if path.joinpath(field, "c", *map(str, np.unravel_index(n, counts))).exists()}


def _verify(path: Path, variables: tuple[Variable, ...], grid: BoundGrid, tile: tuple[int, ...]) -> None:
    """Raises unless the store has every array as it was laid out, and its coordinates.

    Raises:
        StoreError: It is damaged.
    """
    try:
        group = zarr.open_group(path, mode="r")
        for variable in variables:
            array = group[variable.name]
            expected = (*variable.lead, *grid.shape), (*variable.lead, *tile), np.dtype(variable.dtype)
            if not isinstance(array, zarr.Array) or (array.shape, array.chunks, array.dtype) != expected:
                raise ValueError(f"the array {variable.name!r} has another layout")
        for name, (_, values, _) in result.axis_coordinates(grid).items():
            if not np.array_equal(np.asarray(group[name][...]), values):  # type: ignore[index]
                raise ValueError(f"the coordinates {name!r} are not those of the request")
        if not {"tiles", "labels"} <= set(group.attrs):
            raise ValueError("its attributes are incomplete")
    except Exception as error:  # Whatever Zarr meets in damaged files: many types, one answer.
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise StoreError(
            f"{path} is a damaged jaxkin store ({reason}): move it away, or replace it with overwrite=True (--force)."
        ) from error


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
