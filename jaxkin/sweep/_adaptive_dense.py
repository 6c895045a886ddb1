"""From cells back to samples of product grids."""

from dataclasses import dataclass

import numpy as np

from jaxkin.sweep._adaptive_lattice import Lattice, Tree

#: Samples of another grid that are looked up together.
_CHUNK = 1 << 18


@dataclass
class CellMap:
    """Cells of a lattice in Morton order.

    Attributes:
        lattice: The lattice.
        place: ``(k, d)`` low corners in steps.
        size: ``(k,)`` steps along a side.
        constant: ``(k,)`` False where the corners differ.
    """

    lattice: Lattice
    place: np.ndarray
    size: np.ndarray
    constant: np.ndarray

    def own(self, label: np.ndarray, at_samples: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Returns the labels ``(*lead, *shape)`` of all samples of the lattice.

        Args:
            label: ``(k, *lead)`` of cells.
            at_samples: ``(s, *lead)`` of evaluated samples.
            samples: ``(s, d)`` their places.
        """
        dense = np.empty((*self.lattice.shape, *label.shape[1:]), label.dtype)
        large = np.flatnonzero(self.size > 1)
        high = self.lattice.high(self.place[large], self.size[large])
        # The last samples of an axis without period belong to no cell that begins with them.
        high = np.where((high == self.lattice.steps) & np.less(self.lattice.steps, self.lattice.shape), high + 1, high)
        for value, low, end in zip(label[large], self.place[large].tolist(), high.tolist(), strict=True):
            dense[tuple(map(slice, low, end))] = value
        dense[tuple(samples.T)] = at_samples
        return self._lead_first(dense)

    def scattered(self, at_samples: np.ndarray, samples: np.ndarray, missing: object) -> np.ndarray:
        """Returns values ``(*lead, *shape)`` where they were evaluated, ``missing`` elsewhere."""
        dense = np.full((*self.lattice.shape, *at_samples.shape[1:]), missing, at_samples.dtype)
        dense[tuple(samples.T)] = at_samples
        return self._lead_first(dense)

    def nearest(
        self, steps: list[np.ndarray], label: np.ndarray, at_samples: np.ndarray, samples: np.ndarray, missing: object
    ) -> np.ndarray:
        """Returns labels ``(*lead, *shape)`` of another product grid, whose coordinates are given in steps."""
        shape = tuple(map(len, steps))
        found = np.full((int(np.prod(shape)), *label.shape[1:]), missing, label.dtype)
        tree = Tree(self.lattice)
        tree.replace(np.zeros(0, np.int64), self.place.astype(np.int64), self.size, np.arange(len(self.place)))
        keys = self.lattice.keys(samples)
        for start in range(0, len(found), _CHUNK):
            number = np.arange(start, min(start + _CHUNK, len(found)))
            index = np.unravel_index(number, shape)
            point = np.stack([axis[row] for axis, row in zip(steps, index, strict=True)], axis=1)
            point = self._wrapped(point)
            inside = np.all((point >= 0) & (point <= self.lattice.steps), axis=1)
            point, number = point[inside], number[inside]
            cell = np.minimum(np.floor(point).astype(np.int64), np.subtract(self.lattice.steps, 1))
            leaf = tree.label[tree.locate(cell)]
            found[number] = label[leaf]
            mixed = ~self.constant[leaf]
            corner = np.searchsorted(keys, self.lattice.keys(np.round(point[mixed]).astype(np.int64)))
            found[number[mixed]] = at_samples[corner]
        return self._lead_first(found.reshape(*shape, *label.shape[1:]))

    def _wrapped(self, point: np.ndarray) -> np.ndarray:
        """Brings periodic coordinates into the turn, and takes rounding at the ends away."""
        periodic = np.equal(self.lattice.steps, self.lattice.shape)
        point = np.where(periodic, point % self.lattice.steps, point)
        near = np.round(point)
        return np.where(np.abs(point - near) < 1e-9 * (1 + np.abs(near)), near, point)

    def _lead_first(self, dense: np.ndarray) -> np.ndarray:
        d = self.lattice.dimension
        return np.ascontiguousarray(np.moveaxis(dense, range(d), range(-d, 0)))
