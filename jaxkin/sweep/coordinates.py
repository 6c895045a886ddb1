"""The coordinates of a store, which follow from its request: written, told to be damaged, and written anew."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from jaxkin.sweep.grid import BoundGrid
from jaxkin.sweep.result import axis_coordinates

#: Dimensions, values and attributes.
Coordinate = tuple[tuple[str, ...], np.ndarray, dict[str, Any]]


def write_coordinate(group: zarr.Group, name: str, coordinate: Coordinate) -> None:
    """Writes the coordinates of one axis."""
    dims, values, attrs = coordinate
    array = group.create_array(name, shape=values.shape, dtype="float64", dimension_names=dims, attributes=attrs)
    array[...] = values


def mend_coordinates(path: Path, grid: BoundGrid) -> list[str]:
    """Writes those coordinates anew that are not what was laid out; returns the names of their axes."""
    coordinates = axis_coordinates(grid)
    wrong = [name for name, coordinate in coordinates.items() if not _is_laid_out(path / name, coordinate)]
    group = zarr.open_group(path, mode="r+") if wrong else None
    for name in wrong:
        # Whatever is there: a file, or a folder of which a part is gone.
        if (path / name).is_dir() and not (path / name).is_symlink():
            shutil.rmtree(path / name)
        else:
            (path / name).unlink(missing_ok=True)
        assert group is not None
        write_coordinate(group, name, coordinates[name])
    return wrong


def _is_laid_out(path: Path, coordinate: Coordinate) -> bool:
    dims, values, attrs = coordinate
    try:
        array = zarr.open_array(path, mode="r")
        described = array.dtype, tuple(getattr(array.metadata, "dimension_names", None) or ()), dict(array.attrs)
        return described == (np.dtype("float64"), dims, attrs) and np.array_equal(np.asarray(array[...]), values)
    except Exception:  # Whatever Zarr meets in damaged files.
        return False


def damaged_coordinates(path: Path, content: dict[str, Any]) -> list[str]:
    """Returns the axes whose coordinates are not those of a request's grid, as far as a reader can know.

    A reader has no mechanism, and does not know whether an axis has a period, which leaves the upper end out.
    """
    wrong = []
    for name, value in content.items():
        ends = (True, False) if isinstance(value, list) else ()
        expected = [np.linspace(*value, endpoint=end) for end in ends] or [np.asarray(value)]
        try:
            found = np.asarray(zarr.open_array(path / name, mode="r")[...])
        except Exception:  # Whatever Zarr meets in damaged files.
            found = np.empty(0)
        if not any(np.array_equal(found, each) for each in expected):
            wrong.append(name)
    return wrong
