"""Results that are held in memory."""

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxkin.core.provenance import Request
from jaxkin.sweep import result
from jaxkin.sweep.plan import Plan

if TYPE_CHECKING:
    import xarray


class Memory:
    """Arrays of a whole result, into which tiles are computed; the counterpart of ``Store``.

    Args:
        plan: How they are cut.
        request: What determines their numbers.
        attrs: Further attributes of the result.
    """

    path = None

    def __init__(self, plan: Plan, request: Request, attrs: dict[str, Any]):
        self._plan, self._request, self._attrs = plan, request, attrs
        self._arrays = result.allocate(plan.variables, plan.grid.shape)
        #: ``(tiles,)`` True where a tile is whole.
        self.done = np.zeros(plan.tiles, bool)

    def room(self, number: int) -> dict[str, np.ndarray]:
        """Returns where a tile is to be computed."""
        box = self._plan.box(number)
        return {name: array[(..., *box)] for name, array in self._arrays.items()}

    def keep(self, number: int, arrays: dict[str, np.ndarray]) -> None:
        """Counts a tile whose arrays are filled."""
        del arrays
        self.done[number] = True

    def values(self, name: str) -> np.ndarray:
        """Returns what there is of a variable."""
        self._mark()
        return self._arrays[name]

    def describe(self, attrs: dict[str, Any]) -> None:
        """Adds attributes to the result."""
        self._attrs |= attrs

    def close(self, log: dict[str, Any] | None) -> None:
        """Marks what was not computed."""
        del log
        self._mark()

    def _mark(self) -> None:
        for number in np.flatnonzero(~self.done).tolist():
            result.mark_missing(self._arrays, self._plan.variables, self._plan.box(number))

    def dataset(self, log: dict[str, Any]) -> "xarray.Dataset":
        """Labels the arrays."""
        import xarray

        plan = self._plan
        return xarray.Dataset(
            {
                v.name: (result.variable_dims(v, plan.grid), self._arrays[v.name], result.variable_attrs(v))
                for v in plan.variables
            },
            coords={**result.axis_coordinates(plan.grid), **result.labels(plan.variables)},
            attrs={
                **result.request_attrs(self._request),
                **self._attrs,
                "complete": int(self.done.all()),
                "run_log": json.dumps(log),
            },
        )
