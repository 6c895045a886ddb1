"""The samples that an adaptive sweep has met: evaluated once, in blocks of one size, kept in a sorted table."""

import concurrent.futures
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep._adaptive_labels import Labelling
from jaxkin.sweep._adaptive_lattice import Lattice
from jaxkin.sweep.fields import Field
from jaxkin.sweep.grid import BoundGrid
from jaxkin.sweep.scattered import values_at

#: Scattered samples that one call takes: rounds that follow a boundary ask for few, and pay for a whole block.
BLOCK = 1 << 8


class Evaluator:
    """Evaluates a field at samples of a grid given by their places.

    Args:
        robot: The mechanism.
        field: The field.
        grid: Its grid.
        workers: Threads that run compiled blocks side by side.
    """

    def __init__(self, robot: Mechanism, field: Field, grid: BoundGrid, workers: int):
        self._grid, self._field, self._workers = grid, field, workers
        self._variables = field.variables(robot)
        self._axes = [grid.coordinate(k) for k in range(len(grid.axes))]
        self._block = max(1, min(field.block(robot), BLOCK))
        self._run = partial(values_at, robot, field=field, count=self._block)

    def __call__(self, place: np.ndarray) -> dict[str, np.ndarray]:
        """Returns every variable at samples ``(k, d)``, with the samples along the last axis."""
        pieces = [place[start : start + self._block] for start in range(0, len(place), self._block)]
        if self._workers > 1 and len(pieces) > 1:
            with concurrent.futures.ThreadPoolExecutor(self._workers, thread_name_prefix="jaxkin-adaptive") as pool:
                try:
                    found = list(pool.map(self._piece, pieces))
                except BaseException:
                    # Else Ctrl-C would wait for all blocks.
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
        else:
            found = [self._piece(piece) for piece in pieces]
        return {v.name: np.concatenate([part[v.name] for part in found], axis=-1) for v in self._variables}

    def _piece(self, place: np.ndarray) -> dict[str, np.ndarray]:
        count = len(place)
        padded = np.pad(place, ((0, self._block - count), (0, 0)), mode="edge")
        sides = iter(padded.T)
        coordinates = tuple(
            samples[next(sides)] if k in self._grid.free else samples[0] for k, samples in enumerate(self._axes)
        )
        arrays = iter(self._field.unpack(tuple(np.asarray(array) for array in self._run(coordinates))))
        found = {}
        for variable in self._variables:
            values = np.empty((*variable.lead, count), variable.dtype)
            for lead in np.ndindex(*variable.lead):
                values[lead] = next(arrays)[:count]
            found[variable.name] = values
        return found


class Samples:
    """All samples met so far, in the order of a dense array.

    Attributes:
        keys: ``(k,)`` their numbers in a dense array, ascending.
        label: ``(k,)`` numbers of their labels.
        evaluated: How many samples were evaluated.
    """

    def __init__(
        self, lattice: Lattice, evaluate: Evaluator, labelling: Labelling, count: Callable[[int], None] = lambda n: None
    ):
        self._lattice, self._evaluate, self._labelling, self._count = lattice, evaluate, labelling, count
        self.keys = np.zeros(0, np.int64)
        self.label = np.zeros(0, np.int64)
        self._values: dict[str, np.ndarray] = {}

    @property
    def evaluated(self) -> int:
        """How many samples were evaluated, each once."""
        return len(self.keys)

    @property
    def values(self) -> dict[str, np.ndarray]:
        """Every variable at the samples, with the samples along the last axis."""
        return self._values

    def meet(self, place: np.ndarray) -> np.ndarray:
        """Evaluates those samples ``(k, d)`` that are not known, and returns the numbers of these."""
        keys = np.unique(self._lattice.keys(place))
        fresh = keys[~self._known(keys)]
        if not len(fresh):
            return fresh
        values = self._evaluate(self._lattice.places(fresh))
        label = self._labelling.numbers(values)
        where = np.searchsorted(self.keys, fresh)
        merged = {
            name: np.insert(self._values[name], where, new, axis=-1) if self._values else new
            for name, new in values.items()
        }
        self.label, self.keys, self._values = (
            np.insert(self.label, where, label),
            np.insert(self.keys, where, fresh),
            merged,
        )
        self._count(len(fresh))
        return fresh

    def _known(self, keys: np.ndarray) -> np.ndarray:
        if not len(self.keys):
            return np.zeros(len(keys), bool)
        return self.keys[np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)] == keys

    def labels(self, keys: np.ndarray) -> np.ndarray:
        """Returns the labels of known samples of any shape."""
        return self.label[np.searchsorted(self.keys, keys)]

    def parts(self, size: int) -> Iterator[np.ndarray]:
        """Yields the numbers of all samples, so many at a time."""
        for start in range(0, len(self.keys), size):
            yield self.keys[start : start + size]
