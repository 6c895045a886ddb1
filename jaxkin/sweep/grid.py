"""Grids: product grids over named axes of a pose or joint space."""

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Axis
from jaxkin.core.words import given


@dataclass(frozen=True)
class Span:
    """A free axis: from ``low`` to ``high`` in ``count`` samples."""

    low: float
    high: float
    count: int


class Grid:
    """A product grid, ``Grid(rho1=(0.0, 4.0, 2000), rho2=1.0, rho3=(0.0, 4.0, 2000))``.

    ``(low, high, n)`` is a free axis, a number fixes it. An axis without period includes both ends; a
    periodic one leaves out the upper. The order of the axes is the mechanism's, whatever the order here.
    """

    def __init__(self, **axes: Any):
        if not axes:
            raise InputError(f"{given('Grid()')} has no axis: give each axis as {_how()}.")
        self.axes: dict[str, Span | float] = {name: _parsed(name, value) for name, value in axes.items()}

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free axes, as given."""
        return tuple(name for name, value in self.axes.items() if isinstance(value, Span))

    def __repr__(self) -> str:
        """The call that makes this grid."""
        values = {
            name: f"({value.low!r}, {value.high!r}, {value.count})" if isinstance(value, Span) else repr(value)
            for name, value in self.axes.items()
        }
        if all(name.isidentifier() for name in values):
            return f"Grid({', '.join(f'{name}={value}' for name, value in values.items())})"
        # Entries of vectors, such as proximal[0].
        return f"Grid(**{{{', '.join(f'{name!r}: {value}' for name, value in values.items())}}})"

    def bind(self, axes: tuple[Axis, ...], space: str, *, every: bool = True) -> "BoundGrid":
        """Fits the grid to a mechanism's axes.

        Args:
            axes: The mechanism's axes of the field's space.
            space: ``"joint"`` or ``"pose"``, for the message.
            every: False where axes that the grid does not name are left out, as of geometries, whose other numbers
                stay as they are.

        Raises:
            InputError: An axis is unknown or missing, or none is free.
        """
        names = [axis.name for axis in axes]
        for name in self.axes:
            if name not in names:
                raise InputError(f"The grid has an axis {name!r}; the {space} space has {', '.join(names)}. Rename it.")
        for name in names:
            if every and name not in self.axes:
                raise InputError(f"The grid lacks the {space} axis {name!r}: give it as {_how()}.")
        if not self.free:
            raise InputError(
                f"The grid has no free axis: give at least one as {given('(low, high, n)')} with at least 2 samples."
            )
        named = tuple(axis for axis in axes if axis.name in self.axes)
        return BoundGrid(named, tuple(self.axes[axis.name] for axis in named))


@dataclass(frozen=True)
class BoundGrid:
    """A grid in a mechanism's order of axes."""

    axes: tuple[Axis, ...]
    values: tuple[Span | float, ...]

    @property
    def free(self) -> tuple[int, ...]:
        """Positions of the free axes."""
        return tuple(k for k, value in enumerate(self.values) if isinstance(value, Span))

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of samples along each free axis."""
        return tuple(value.count for value in self.values if isinstance(value, Span))

    @property
    def size(self) -> int:
        """Number of samples."""
        return math.prod(self.shape)

    def coordinate(self, k: int) -> np.ndarray:
        """Returns the samples of axis k; a fixed axis has one."""
        value = self.values[k]
        if not isinstance(value, Span):
            return np.array([value])
        return np.linspace(value.low, value.high, value.count, endpoint=self.axes[k].period is None)

    def content(self) -> dict[str, Any]:
        """Returns what determines the samples, for the request."""
        return {
            axis.name: [value.low, value.high, value.count] if isinstance(value, Span) else value
            for axis, value in zip(self.axes, self.values, strict=True)
        }


def _how() -> str:
    """Says how an axis is given."""
    return f"{given('(low, high, n)')}, or as {given('a number to fix it')}"


def _parsed(name: str, value: Any) -> Span | float:
    if isinstance(value, Real) and not isinstance(value, bool):
        if not math.isfinite(value):
            raise InputError(f"Grid axis {name!r} is fixed at {value}: it must be a finite number.")
        return float(value)
    try:
        low, high, count = value
    except (TypeError, ValueError):
        raise InputError(f"Grid axis {name!r} is {value!r}: it must be {_how()}.") from None
    if not isinstance(count, Integral) or isinstance(count, bool):
        raise InputError(f"Grid axis {name!r} has n = {count!r}: the number of samples must be an integer.")
    if count < 2:
        raise InputError(
            f"Grid axis {name!r} has n = {count}: a free axis needs at least 2 samples; to fix it, give "
            f"{given('one number')}."
        )
    if not all(isinstance(end, Real) and math.isfinite(end) for end in (low, high)):
        raise InputError(f"Grid axis {name!r} goes from {low!r} to {high!r}: both ends must be finite numbers.")
    if not low < high:
        raise InputError(f"Grid axis {name!r} goes from {low} to {high}: low must be less than high; swap them.")
    return Span(float(low), float(high), int(count))
