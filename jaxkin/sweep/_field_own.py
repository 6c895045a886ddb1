"""Fields of the user's own, from a function of one configuration or of one design."""

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
from jaxkin.sweep._field_record import Field, Variable, check_name
from jaxkin.sweep.designs import BLOCK, check_number, design, each_sample, refused_variable, traced_kernel
from jaxkin.sweep.walls import Walls

_DOMAINS = ("pose", "joints", "geometry")


def from_function(
    function: Callable[..., Any],
    *,
    name: str,
    domain: str,
    unit: str = "1",
    long_name: str | None = None,
    dtype: str = "float64",
    walls: Callable[[Mechanism, Array], Array] | None = None,
    traced: bool = True,
) -> Field:
    """Makes a field of your own from a function of one configuration, or of one design.

    Args:
        function: ``(mechanism, vector) -> scalar``, traceable; the vector is a pose or the joints. Over geometries
            ``(mechanism) -> scalar``, of a mechanism that has the sample's numbers; its value counts only where
            ``geometry_ok()``.
        name: Name of the field and its variable.
        domain: ``"pose"``, ``"joints"`` or ``"geometry"``.
        unit: Unit of the value.
        long_name: For labels; the name if not given.
        dtype: ``"float64"``, or ``"bool"`` or an integer type for what is constant in cells: a membership, a number of
            tests passed, a label. Such a field can be swept adaptively; its function returns bools or integers too.
        walls: ``(mechanism, vector) -> (m,)`` smooth functions: on any connected set on which none of them vanishes,
            the value is constant (a real field's sign). Adaptive sweeps prove cells by them; jaxkin cannot know
            whether they are all. Not over geometries.
        traced: False where JAX cannot trace the function (a search, a count). Only over geometries; it is called with
            one design at a time then, in Python. Designs that it refuses by ``jk.GeometryError`` or ``jk.InputError``
            have no value; the variable ``<name>_refused`` says where, and the result how many and why the first one.

    Raises:
        InputError: The domain is none of these, the name is none or that of a field of jaxkin, the dtype is another
            one, or walls or ``traced=False`` do not go with the domain. Before a sweep (during it, of a function that
            is not traced): the function returns anything but one number, or one that the dtype would cut off.
    """
    check_name(name)
    if domain not in _DOMAINS:
        raise InputError(f"The domain of field {name!r} is {domain!r}: it must be 'pose', 'joints' or 'geometry'.")
    if name in FIELDS:
        raise InputError(f"A field {name!r} exists in jaxkin: choose another name.")
    kind = _own_dtype(name, dtype)
    main = Variable(name, kind.name, unit, long_name or name, missing=_missing(kind))
    text = _source(function) + ("" if kind == np.float64 else kind.name) + ("" if walls is None else _source(walls))
    version = hashlib.sha256(text.encode()).hexdigest()[:16]
    if domain == "geometry":
        if walls is not None:
            raise InputError(f"Field {name!r} has walls and is one over geometries, where none count: leave them out.")
        return _over_designs(function, main, version, traced)

    def variables(robot: Mechanism) -> tuple[Variable, ...]:
        axes = robot.joint_axes if domain == "joints" else robot.pose_axes
        value = jax.eval_shape(function, robot, jax.ShapeDtypeStruct((len(axes),), float))
        _check_value(main, "configuration", value)
        return (main,)

    return Field(
        name=name,
        domain=domain,
        variables=variables,
        kernel=lambda robot, coordinates: (
            # ``float`` is whichever precision the sweep asks for.
            each_sample(
                lambda vector: jnp.asarray(function(robot, vector), float if kind == np.float64 else kind), coordinates
            ),
        ),
        block=lambda robot: 1 << 12,
        single=True,
        version=version,
        walls=lambda robot: None if walls is None else Walls(walls),
        traced=traced,
    )


def _over_designs(function: Callable[[Mechanism], Any], main: Variable, version: str, traced: bool) -> Field:
    """Makes a field over geometries: all samples of a block at once, or one design at a time."""

    def variables(robot: Mechanism) -> tuple[Variable, ...]:
        try:
            value = jax.eval_shape(function, robot)
        except (InputError, jax.errors.JAXTypeError, jax.errors.JAXIndexError) as error:
            reason = str(error).splitlines()[0].rstrip(".")
            raise InputError(
                f"The function of field {main.name!r} cannot be traced ({reason}): declare the field with "
                "traced=False, which computes it one design at a time."
            ) from error
        _check_value(main, "design", value)
        return (main,)

    if traced:
        kernel = traced_kernel(lambda robot: (function(robot),), (main,))
        return Field(main.name, "geometry", variables, kernel, block=lambda robot: BLOCK, version=version)
    return Field(
        name=main.name,
        domain="geometry",
        variables=lambda robot: (main, refused_variable(main.name)),
        kernel=lambda robot, numbers: (function(design(robot, numbers)),),
        block=lambda robot: 1,
        version=version,
        traced=False,
    )


def _own_dtype(name: str, dtype: Any) -> np.dtype:
    try:
        kind = np.dtype(dtype)
    except TypeError:
        kind = np.dtype(object)
    if kind != np.float64 and kind.kind not in "iub":
        raise InputError(f"The dtype of field {name!r} is {dtype!r}: it must be 'float64', 'bool' or an integer type.")
    return kind


def _check_value(variable: Variable, each: str, value: Any) -> None:
    """Refuses a function whose value, here in the abstract, is not one number of the kind that was declared."""
    name = variable.name
    if not isinstance(value, jax.ShapeDtypeStruct):
        raise InputError(
            f"The function of field {name!r} returns {type(value).__name__}: it must return one number for each "
            f"{each}; make a field of every number."
        )
    check_number(variable, each, value.shape, value.dtype)


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
