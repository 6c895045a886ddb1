"""What a field is, and the arrays of its result: two records."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.leaves import leaf_places, leaf_unit
from jaxkin.core.mechanism import Axis, Mechanism
from jaxkin.sweep.walls import Walls

Coordinates = tuple[Array, ...]


@dataclass(frozen=True)
class Variable:
    """One array of a field's result.

    Attributes:
        name: Name in the dataset.
        dtype: NumPy dtype.
        unit: Unit, "1" for pure numbers.
        long_name: For axis labels.
        dims: Leading dimensions besides the grid's, each with its labels.
        missing: Value of samples that were not computed.
        attrs: Further attributes.
        signed: False where the values cannot be negative by what they are, so that their sign is no label.
    """

    name: str
    dtype: str
    unit: str
    long_name: str
    dims: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    missing: Any = np.nan
    attrs: dict[str, Any] = field(default_factory=dict)
    signed: bool = True

    @property
    def lead(self) -> tuple[int, ...]:
        """Sizes of the leading dimensions."""
        return tuple(len(labels) for _, labels in self.dims)


@dataclass(frozen=True)
class Field:
    """A quantity that can be swept.

    Attributes:
        name: Name of the field and of its main variable.
        domain: ``"joints"``, ``"pose"`` or ``"geometry"``.
        variables: Mechanism -> its variables; the first bears the field's name.
        kernel: (mechanism, coordinates) -> one flat tuple of arrays, elementwise over the coordinates: for
            every variable in order, one array per combination of its leading dimensions. Over geometries the
            coordinates are a dict by the names of ``jaxkin.core.leaves``.
        block: Mechanism -> samples that one call should take, so that its temporaries stay in cache.
        unpack: Turns the flat tuple of arrays that a call returned into that of the variables.
        single: True where float32 is enough to mean something, if the user asks for it.
        version: Raise it when the kernel changes its numbers.
        walls: Mechanism -> between which walls the field's label is constant (its main variable if that is discrete,
            the statuses of its branches, or its sign), so that adaptive sweeps can prove it; None where none are known.
        traced: False where JAX cannot trace the kernel (geometries only). It is called with one design's numbers then,
            in Python, and returns one number for each variable but the last; that is of the dtype bool, and True
            where the kernel raised GeometryError or InputError, by which it refuses a design.
        numbers: Of a field over geometries, the names of the numbers that a sweep runs over; see ``over``.

    Raises:
        InputError: The name cannot be that of an array, or a field that is not traced is none over geometries.
    """

    name: str
    domain: str
    variables: Callable[[Mechanism], tuple[Variable, ...]]
    kernel: Callable[[Mechanism, Any], tuple[Any, ...]]
    block: Callable[[Mechanism], int] = lambda robot: 1 << 14
    unpack: Callable[[tuple[np.ndarray, ...]], tuple[np.ndarray, ...]] = lambda arrays: arrays
    single: bool = False
    version: str = "1"
    walls: Callable[[Mechanism], Walls | None] = lambda robot: None
    traced: bool = True
    numbers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Checks the name, and what is computed without JAX."""
        check_name(self.name)
        if not self.traced and self.domain != "geometry":
            raise InputError(
                f"Field {self.name!r} is not traced and its domain is {self.domain!r}: only fields over 'geometry' are "
                "computed one sample at a time; make its function traceable."
            )

    def __reduce__(self) -> Any:
        """Fields of jaxkin travel to other processes by their names."""
        from jaxkin.sweep._field_catalogue import FIELDS, by_name

        return (by_name, (self.name,)) if FIELDS.get(self.name) is self else super().__reduce__()

    def axes(self, robot: Mechanism) -> tuple[Axis, ...]:
        """Returns the mechanism's axes of this field's domain: of geometries, all numbers of the mechanism."""
        if self.domain == "geometry":
            return tuple(Axis(name, leaf_unit(robot, name)) for name in leaf_places(robot))
        return robot.joint_axes if self.domain == "joints" else robot.pose_axes

    def over(self, names: tuple[str, ...]) -> "Field":
        """Returns the field over these axes: one over geometries has to know which numbers its coordinates are."""
        return replace(self, numbers=names) if self.domain == "geometry" else self

    def values(self, robot: Mechanism, coordinates: tuple[Any, ...]) -> tuple[Any, ...]:
        """Calls the kernel; coordinates are in the order of the axes."""
        if self.domain == "geometry":
            return self.kernel(robot, dict(zip(self.numbers, coordinates, strict=True)))
        return self.kernel(robot, coordinates)


def check_name(name: Any) -> None:
    """Refuses a name that cannot be that of an array and of its folder in a store.

    Raises:
        InputError: It is no such name.
    """
    if not isinstance(name, str) or not name.strip() or name.startswith((".", "__")) or set(name) & set("/\\"):
        raise InputError(
            f"The name of a field is {name!r}: it must be text, not empty, without slashes, and not begin with a dot "
            "or two underscores, as an array of the result bears it; choose another name."
        )
