"""Fields of the user's own, from a function of one configuration."""

import hashlib
import inspect
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep._field_catalogue import FIELDS
from jaxkin.sweep._field_record import Coordinates, Field, Variable, check_name
from jaxkin.sweep.walls import Walls


def from_function(
    function: Callable[[Mechanism, Array], Array],
    *,
    name: str,
    domain: str,
    unit: str = "1",
    long_name: str | None = None,
    dtype: str = "float64",
    walls: Callable[[Mechanism, Array], Array] | None = None,
) -> Field:
    """Makes a field of your own from a traceable function of one configuration.

    Args:
        function: ``(mechanism, vector) -> scalar``; the vector is a pose or the joints.
        name: Name of the field and its variable.
        domain: ``"pose"`` or ``"joints"``.
        unit: Unit of the value.
        long_name: For labels; the name if not given.
        dtype: ``"float64"``, or ``"bool"`` or an integer type for what is constant in cells: a membership, a number of
            tests passed, a label. Such a field can be swept adaptively; its function returns bools or integers too.
        walls: ``(mechanism, vector) -> (m,)`` smooth functions: on any connected set on which none of them vanishes,
            the value is constant (a real field's sign). Adaptive sweeps prove cells by them; jaxkin cannot know
            whether they are all.

    Raises:
        InputError: The domain is neither, the name is none or that of a field of jaxkin, or the dtype is another one.
            Before a sweep: the function returns anything but one number, or one that the dtype would cut off.
    """
    check_name(name)
    if domain not in ("pose", "joints"):
        raise InputError(f"The domain of field {name!r} is {domain!r}: it must be 'pose' or 'joints'.")
    if name in FIELDS:
        raise InputError(f"A field {name!r} exists in jaxkin: choose another name.")
    kind = _own_dtype(name, dtype)
    text = _source(function) + ("" if kind == np.float64 else kind.name) + ("" if walls is None else _source(walls))

    def variables(robot: Mechanism) -> tuple[Variable, ...]:
        axes = robot.joint_axes if domain == "joints" else robot.pose_axes
        _check_value(name, kind, jax.eval_shape(function, robot, jax.ShapeDtypeStruct((len(axes),), float)))
        return (Variable(name, kind.name, unit, long_name or name, missing=_missing(kind)),)

    return Field(
        name=name,
        domain=domain,
        variables=variables,
        kernel=lambda robot, coordinates: (
            # ``float`` is whichever precision the sweep asks for.
            _each_sample(
                lambda vector: jnp.asarray(function(robot, vector), float if kind == np.float64 else kind), coordinates
            ),
        ),
        block=lambda robot: 1 << 12,
        single=True,
        version=hashlib.sha256(text.encode()).hexdigest()[:16],
        walls=lambda robot: None if walls is None else Walls(walls),
    )


def _own_dtype(name: str, dtype: Any) -> np.dtype:
    try:
        kind = np.dtype(dtype)
    except TypeError:
        kind = np.dtype(object)
    if kind != np.float64 and kind.kind not in "iub":
        raise InputError(f"The dtype of field {name!r} is {dtype!r}: it must be 'float64', 'bool' or an integer type.")
    return kind


def _check_value(name: str, kind: np.dtype, value: Any) -> None:
    """Refuses a function whose value, here in the abstract, is not one number of the kind that was declared."""
    if not isinstance(value, jax.ShapeDtypeStruct):
        raise InputError(
            f"The function of field {name!r} returns {type(value).__name__}: it must return one number for each "
            "configuration; make a field of every number."
        )
    if value.shape:
        raise InputError(
            f"The function of field {name!r} returns an array of shape {value.shape}: it must return one number for "
            "each configuration, of shape (); make a field of every entry."
        )
    if value.dtype.kind == "c" or (kind.kind in "iub" and value.dtype.kind not in "iub"):
        raise InputError(
            f"Field {name!r} is declared as {kind.name} and its function returns {value.dtype.name}, which would be "
            f"cut off: return what was declared, with .astype({kind.name!r}) where the numbers are whole, or declare "
            "dtype='float64'."
        )


def _missing(kind: np.dtype) -> Any:
    """Returns the value of samples that were not computed."""
    if kind.kind == "u":
        return int(np.iinfo(kind).max)
    return {"b": False, "i": -1}.get(kind.kind, np.nan)


def _source(function: Callable[..., Any]) -> str:
    try:
        return inspect.getsource(function)
    except (OSError, TypeError):
        return repr(function)


def _each_sample(function: Callable[..., Array], *groups: Coordinates) -> Array:
    """Applies a function of vectors to coordinates given as tuples of broadcastable arrays."""
    shape = jnp.broadcast_shapes(*(jnp.shape(a) for group in groups for a in group))
    rows = [jnp.stack([jnp.broadcast_to(a, shape).reshape(-1) for a in group]) for group in groups]
    return jax.vmap(function, in_axes=1)(*rows).reshape(shape)
