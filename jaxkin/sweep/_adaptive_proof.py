"""Proofs that cells are constant: no wall vanishes in them, by bounds of the mean value form."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.numerics.enclosure import enclosure_of
from jaxkin.sweep._adaptive_lattice import Lattice
from jaxkin.sweep.grid import BoundGrid, Span
from jaxkin.sweep.walls import Walls

#: Boxes whose bounds are taken together: more leave the cache.
_BOXES = 1 << 12
#: Bounds are rounded to nearest: a wall must stay away from zero by this share of its largest size on the grid.
_ROUNDING = 1e-11
#: Boxes from which that size is taken.
_SCALE_BOXES = 1 << 10


def corner_coordinates(grid: BoundGrid) -> list[np.ndarray]:
    """Returns the coordinates of the cells' corners along each free axis: a periodic one ends where it began."""
    ends = []
    for k in grid.free:
        samples, span = grid.coordinate(k), grid.values[k]
        assert isinstance(span, Span)
        ends.append(samples if grid.axes[k].period is None else np.append(samples, span.high))
    return ends


class Prover:
    """Bounds the walls of a field over cells.

    Args:
        robot: The mechanism.
        walls: Its walls for this field.
        grid: The grid.
        lattice: Its cells.
    """

    def __init__(self, robot: Mechanism, walls: Walls, grid: BoundGrid, lattice: Lattice):
        self._lattice, self._axes, free = lattice, corner_coordinates(grid), grid.free
        fixed = np.array([0.0 if isinstance(value, Span) else value for value in grid.values])
        self._limits, self._walls = _limits(walls, fixed, free), walls

        def of_free(parameters: tuple[Mechanism, Array], u: Array) -> Array:
            own, rest = parameters
            whole = [u[free.index(k)] if k in free else rest[k] for k in range(len(fixed))]
            return walls.function(own, jnp.stack(whole))

        self._parameters: Any = (robot, jnp.asarray(fixed))
        self._enclosure = enclosure_of(of_free, self._parameters, len(free))
        self._tiny = self._scale() * _ROUNDING

    def _scale(self) -> np.ndarray:
        low = self._lattice.coarsest()
        low = low[:: -(-len(low) // _SCALE_BOXES)]
        ends = np.concatenate(self._bounds(*self._box(low, np.full(len(low), self._lattice.stride))), axis=1)
        return np.max(np.where(np.isfinite(ends), np.abs(ends), 0.0), axis=1, keepdims=True)

    def _box(self, low: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        high = self._lattice.high(low, size)
        ends = (np.stack([axis[row] for axis, row in zip(self._axes, part.T, strict=True)]) for part in (low, high))
        return next(ends), next(ends)

    def _bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._enclosure(self._parameters, low, high).value

    def proved(self, low: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Returns where cells ``(k, d)`` are proved constant, ``(k,)``."""
        found = [
            self._piece(low[start : start + _BOXES], size[start : start + _BOXES])
            for start in range(0, len(low), _BOXES)
        ]
        return np.concatenate(found) if found else np.zeros(0, bool)

    def _piece(self, low: np.ndarray, size: np.ndarray) -> np.ndarray:
        below, above = self._box(low, size)
        inside, outside = self._within(below, above)
        proved = outside.copy()
        ask = np.flatnonzero(inside)
        if len(ask):
            least, most = self._bounds(below[:, ask], above[:, ask])
            negative = most < -self._tiny
            sure = negative | (least > self._tiny)
            beyond = np.any(negative[len(sure) - self._walls.inner :], axis=0)
            proved[ask] = np.all(sure, axis=0) | (np.all(sure[: self._walls.always], axis=0) & beyond)
        return proved

    def _within(self, below: np.ndarray, above: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns which boxes lie wholly within the limits, and which wholly outside."""
        low, high, never = self._limits
        inside = np.all((below >= low) & (above <= high), axis=0) & (not never)
        outside = np.any((above < low) | (below > high), axis=0) | never
        return inside, outside


def _limits(walls: Walls, fixed: np.ndarray, free: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, bool]:
    """Returns the limits of the free coordinates ``(d, 1)``, and whether a fixed one lies outside its own."""
    low = np.full(len(fixed), -np.inf) if walls.low is None else np.asarray(walls.low, float)
    high = np.full(len(fixed), np.inf) if walls.high is None else np.asarray(walls.high, float)
    rest = [k for k in range(len(fixed)) if k not in free]
    never = bool(np.any((fixed[rest] < low[rest]) | (fixed[rest] > high[rest])))
    return low[list(free), None], high[list(free), None], never
