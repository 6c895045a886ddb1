"""Fields that JAX cannot trace: one design at a time, in Python. What refuses a design is kept, and told."""

from typing import Any

import numpy as np

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.leaves import with_leaves
from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep._field_record import Field, Variable
from jaxkin.sweep.grid import BoundGrid

#: What a result says of itself, in its attribute ``untraced``.
SAID = "computed one design at a time"
#: By what a computation refuses a design; anything else ends the sweep.
_REFUSALS = (GeometryError, InputError)


def refused_variable(name: str) -> Variable:
    """Returns the last variable of a field that is not traced."""
    return Variable(f"{name}_refused", "bool", "1", f"{name}: the computation refused the design", missing=False)


def design(robot: Mechanism, numbers: dict[str, Any]) -> Mechanism:
    """Returns the robot with other numbers.

    Raises:
        GeometryError: Its geometry is degenerate then.
    """
    made = with_leaves(robot, numbers)
    if not bool(np.all(made.geometry_ok())):
        raise GeometryError("The geometry is degenerate or not finite.")
    return made


def design_values(field: Field, robot: Mechanism, coordinates: tuple[Any, ...], shape: tuple[int, ...]) -> tuple:
    """Calls a field's kernel for every sample.

    Args:
        field: A field that is not traced.
        robot: The mechanism.
        coordinates: One array for each axis, broadcastable to the shape.
        shape: Of the samples.

    Returns:
        An array of this shape for every variable.

    Raises:
        InputError: The kernel returns anything but a number for each variable but the last.
    """
    variables = field.variables(robot)
    arrays = tuple(np.full(shape, variable.missing, variable.dtype) for variable in variables)
    spread = [np.broadcast_to(axis, shape) for axis in coordinates]
    for place in np.ndindex(*shape):
        try:
            values = field.values(robot, tuple(float(axis[place]) for axis in spread))
        except _REFUSALS:
            arrays[-1][place] = True
            continue
        for array, variable, value in zip(arrays, variables, values, strict=False):
            array[place] = _number(variable, value)
    return arrays


def _number(variable: Variable, value: Any) -> np.ndarray:
    try:
        number = np.asarray(value)
    except (TypeError, ValueError):
        number = np.asarray(None)
    check_number(variable, "design", number.shape, number.dtype)
    return number


def check_number(variable: Variable, each: str, shape: tuple[int, ...], dtype: np.dtype) -> None:
    """Refuses what is no number of the kind that was declared.

    Raises:
        InputError: It is none.
    """
    name, kind = variable.name, np.dtype(variable.dtype)
    if shape:
        raise InputError(
            f"The function of field {name!r} returns an array of shape {shape}: it must return one number for each "
            f"{each}, of shape (); make a field of every entry."
        )
    if dtype.kind not in "iubfc":
        raise InputError(f"The function of field {name!r} returns no number: it must return one for each {each}.")
    if dtype.kind == "c" or (kind.kind in "iub" and dtype.kind not in "iub"):
        raise InputError(
            f"Field {name!r} is declared as {kind.name} and its function returns {dtype.name}, which would be "
            f"cut off: return what was declared, with .astype({kind.name!r}) where the numbers are whole, or declare "
            "dtype='float64'."
        )


def refusals(field: Field, robot: Mechanism, grid: BoundGrid, refused: np.ndarray) -> dict[str, Any]:
    """Returns how many designs were refused, and the first one with the reason, as attributes of the result.

    The reason is not kept but asked for again: so it is the same whatever was computed first, and by whom.

    Args:
        field: A field that is not traced.
        robot: The mechanism.
        grid: The grid.
        refused: The field's last variable, of the grid's shape.
    """
    told: dict[str, Any] = {"refused_designs": int(refused.sum())}
    if told["refused_designs"]:
        place = iter(np.unravel_index(int(np.argmax(refused)), refused.shape))
        numbers = tuple(float(grid.coordinate(k)[next(place) if k in grid.free else 0]) for k in range(len(grid.axes)))
        at = ", ".join(f"{axis.name} = {number:.12g}" for axis, number in zip(grid.axes, numbers, strict=True))
        told["first_refusal"] = f"{at}: {_reason(field, robot, numbers)}"
    return told


def _reason(field: Field, robot: Mechanism, numbers: tuple[float, ...]) -> str:
    try:
        field.values(robot, numbers)
    except _REFUSALS as error:
        return str(error)
    return "not refused when it was asked again"
