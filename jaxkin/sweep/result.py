"""Labels of results: dimensions, coordinates and attributes."""

from typing import Any

import numpy as np

from jaxkin.core.provenance import Request
from jaxkin.sweep.fields import Variable
from jaxkin.sweep.grid import BoundGrid


def allocate(variables: tuple[Variable, ...], shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Returns one uninitialised array per variable; filling it first would touch every page twice."""
    return {v.name: np.empty((*v.lead, *shape), dtype=v.dtype) for v in variables}


def mark_missing(arrays: dict[str, np.ndarray], variables: tuple[Variable, ...], box: tuple[slice, ...]) -> None:
    """Fills a tile that was not computed with each variable's ``missing`` value."""
    for variable in variables:
        arrays[variable.name][(..., *box)] = variable.missing


def variable_dims(variable: Variable, grid: BoundGrid) -> tuple[str, ...]:
    """Returns the dimension names of a variable."""
    return (*(name for name, _ in variable.dims), *(grid.axes[k].name for k in grid.free))


def variable_attrs(variable: Variable) -> dict[str, Any]:
    """Returns the attributes of a variable."""
    missing = variable.missing
    # Not CF's "missing_value": xarray would turn integers into floats for its sake.
    known = {} if isinstance(missing, bool) or missing != missing else {"not_computed": missing}
    return {"units": variable.unit, "long_name": variable.long_name, **known, **variable.attrs}


def axis_coordinates(grid: BoundGrid) -> dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, Any]]]:
    """Returns the coordinates of all axes: vectors on free ones, scalars on fixed ones."""
    coordinates = {}
    for k, axis in enumerate(grid.axes):
        samples = grid.coordinate(k)
        dims, values = ((axis.name,), samples) if k in grid.free else ((), samples[0])
        coordinates[axis.name] = (dims, np.asarray(values), {"units": axis.unit, "long_name": axis.name})
    return coordinates


def labels(variables: tuple[Variable, ...]) -> dict[str, list[Any]]:
    """Returns the labels of the leading dimensions."""
    return {name: list(values) for variable in variables for name, values in variable.dims}


def request_attrs(request: Request) -> dict[str, str]:
    """Returns the attributes that give a result its identity."""
    content = request.content
    return {
        "mechanism": content["mechanism"],
        "field": content["field"]["name"],
        "request": request.text,
        "request_hash": request.hash,
    }
