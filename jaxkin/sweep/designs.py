"""Designs as samples: all of a block at once, or, where JAX cannot trace a field, one at a time in Python.

A traced field has no value where the geometry is degenerate. One that is not traced refuses designs by exceptions, for
which one variable more says where, and the result how many and why.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.leaves import with_leaves
from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep._field_record import Field, Variable
from jaxkin.sweep.grid import BoundGrid

#: What a result says of itself, in its attribute ``untraced``.
SAID = "computed one design at a time"
#: By what a computation refuses a design; anything else ends the sweep.
_REFUSALS = (GeometryError, InputError)
#: Designs of one compiled call, where nothing better is known: what is worth an atlas has large temporaries.
BLOCK = 1 << 6


def traced_kernel(
    function: Callable[[Mechanism], tuple[Any, ...]], variables: tuple[Variable, ...]
) -> Callable[[Mechanism, dict[str, Array]], tuple[Array, ...]]:
    """Returns the kernel of a field over geometries.

    Args:
        function: A mechanism -> one number for each variable, traceable.
        variables: Their kinds, and their values where the geometry is degenerate.
    """

    def kernel(robot: Mechanism, numbers: dict[str, Array]) -> tuple[Array, ...]:
        def one(vector: Array) -> tuple[Array, ...]:
            made = with_leaves(robot, dict(zip(numbers, vector, strict=True)))
            ok = made.geometry_ok()
            values = zip(variables, function(made), strict=True)
            return tuple(
                jnp.where(ok, jnp.asarray(value, v.dtype), jnp.asarray(v.missing, v.dtype)) for v, value in values
            )

        return each_sample(one, tuple(numbers.values()))

    return kernel


def each_sample(function: Callable[..., Any], *groups: tuple[Array, ...]) -> Any:
    """Applies a function of vectors to coordinates given as tuples of broadcastable arrays."""
    shape = jnp.broadcast_shapes(*(jnp.shape(a) for group in groups for a in group))
    rows = [jnp.stack([jnp.broadcast_to(a, shape).reshape(-1) for a in group]) for group in groups]
    return jax.tree.map(lambda array: array.reshape(shape), jax.vmap(function, in_axes=1)(*rows))


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
