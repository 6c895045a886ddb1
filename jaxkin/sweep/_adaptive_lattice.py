"""Cells whose corners are samples of a grid, as a linear tree: leaves in Morton order, found by one binary search.

The order interleaves the bits of a cell's place, so that every cell of 2^k steps is one interval of it: the leaf that
holds a place is the last one whose key is not larger.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from jaxkin.core.errors import InputError

#: Keys are int64 and not negative.
_KEY_BITS = 62
#: Label of a cell whose samples differ.
MIXED = -1
#: What is known of a cell: nothing was tried, a proof failed, a proof holds.
UNTRIED, UNPROVED, PROVED = 0, 1, 2


@dataclass(frozen=True)
class Lattice:
    """The samples of a grid and the cells between them.

    Attributes:
        shape: Samples along each free axis.
        steps: Grid steps along each free axis: one less than samples, as many on a periodic axis.
        stride: Steps along a side of the coarsest cells, a power of two.
    """

    shape: tuple[int, ...]
    steps: tuple[int, ...]
    stride: int

    @property
    def dimension(self) -> int:
        """Number of free axes."""
        return len(self.shape)

    @property
    def bits(self) -> int:
        """Bits of a place along the longest axis."""
        return max(self.steps).bit_length()

    def check(self) -> None:
        """Refuses grids whose keys do not fit."""
        if self.bits * self.dimension > _KEY_BITS:
            raise InputError(
                f"The grid has {max(self.shape)} samples along one of {self.dimension} free axes: an adaptive sweep "
                f"numbers cells with {_KEY_BITS // self.dimension} bits an axis here; use at most "
                f"{2 ** (_KEY_BITS // self.dimension) - 1} samples."
            )

    def coarsest(self) -> np.ndarray:
        """Returns the low corners of the coarsest cells, ``(k, d)``."""
        starts = [np.arange(0, steps, self.stride) for steps in self.steps]
        return np.stack(np.meshgrid(*starts, indexing="ij"), axis=-1).reshape(-1, self.dimension)

    def high(self, low: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Returns the high corners of cells; the last ones of an axis may be cut short."""
        return np.minimum(low + size[:, None], self.steps)

    def points(self, low: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Returns the places of corners and centre of cells, ``(k, 2^d + 1, d)``; of one step, twice a corner."""
        high = self.high(low, size)
        corners = self.corners(low, high)
        centre = np.minimum(low + size[:, None] // 2, high)
        return np.concatenate([corners, centre[:, None]], axis=1)

    def corners(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Returns the places of the corners, ``(k, 2^d, d)``."""
        return np.where(self.offsets[None] == 1, high[:, None], low[:, None])

    @property
    def offsets(self) -> np.ndarray:
        """All vectors of zeros and ones, ``(2^d, d)``."""
        return np.array(list(itertools.product((0, 1), repeat=self.dimension)))

    def keys(self, place: np.ndarray) -> np.ndarray:
        """Returns the number of each sample ``(..., d)`` in the order of a dense array; periodic axes wrap."""
        return np.asarray(np.ravel_multi_index(tuple(np.moveaxis(place % self.shape, -1, 0)), self.shape))

    def places(self, keys: np.ndarray) -> np.ndarray:
        """Returns the places of numbered samples, ``(k, d)``."""
        return np.stack(np.unravel_index(keys, self.shape), axis=-1)

    def children(self, low: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Halves cells along every axis; halves that lie outside the grid are left out."""
        half = size // 2
        low = (low[:, None] + self.offsets[None] * half[:, None, None]).reshape(-1, self.dimension)
        inside = np.all(low < self.steps, axis=1)
        return low[inside], np.repeat(half, len(self.offsets))[inside]

    def around(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the cells of one step that meet at samples ``(k, d)``: places ``(2^d k, d)``, and of which sample."""
        cells = (place[None] - self.offsets[:, None]).reshape(-1, self.dimension)
        there = np.ones(len(cells), bool)
        for column, steps, samples in zip(cells.T, self.steps, self.shape, strict=True):
            if steps == samples:
                column %= steps
            else:
                there &= (column >= 0) & (column < steps)
        return cells[there], np.tile(np.arange(len(place)), len(self.offsets))[there]


def morton(place: np.ndarray, bits: int) -> np.ndarray:
    """Interleaves the bits of places ``(k, d)``, the first axis the most significant."""
    d = place.shape[1]
    table = _spread(d)
    keys = np.zeros(len(place), np.int64)
    for byte in range(math.ceil(bits / 8)):
        for axis in range(d):
            keys |= table[(place[:, axis] >> (8 * byte)) & 0xFF] << (8 * byte * d + d - 1 - axis)
    return keys


def _spread(d: int) -> np.ndarray:
    """Returns every byte with its bits d apart."""
    byte = np.arange(256, dtype=np.int64)
    return sum((((byte >> bit) & 1) << (bit * d) for bit in range(min(8, _KEY_BITS // d + 1))), np.zeros(256, np.int64))


class Tree:
    """The leaves: disjoint cells that fill the grid.

    Attributes:
        low: ``(k, d)`` low corners, in grid steps.
        size: ``(k,)`` steps along a side.
        label: ``(k,)`` number of the label that all known samples of a cell share, ``MIXED`` where they differ.
        proof: ``(k,)`` what is known of it.
    """

    def __init__(self, lattice: Lattice):
        self._lattice = lattice
        self._keys = np.zeros(0, np.int64)
        self.low = np.zeros((0, lattice.dimension), np.int64)
        self.size = np.zeros(0, np.int64)
        self.label = np.zeros(0, np.int64)
        self.proof = np.zeros(0, np.int8)

    def __len__(self) -> int:
        """Number of leaves."""
        return len(self._keys)

    def replace(self, gone: np.ndarray, low: np.ndarray, size: np.ndarray, label: np.ndarray) -> None:
        """Puts new leaves in the place of others, given by position."""
        keep = np.ones(len(self), bool)
        keep[gone] = False
        keys = np.concatenate([self._keys[keep], morton(low, self._lattice.bits)])
        order = np.argsort(keys, kind="stable")
        self.low = np.concatenate([self.low[keep], low])[order]
        self.size = np.concatenate([self.size[keep], size])[order]
        self.label = np.concatenate([self.label[keep], label])[order]
        self.proof = np.concatenate([self.proof[keep], np.full(len(low), UNTRIED, np.int8)])[order]
        self._keys = keys[order]

    def locate(self, place: np.ndarray) -> np.ndarray:
        """Returns the positions of the leaves that hold cells of one step ``(k, d)``."""
        return np.searchsorted(self._keys, morton(place, self._lattice.bits), side="right") - 1

    @property
    def constant(self) -> np.ndarray:
        """True for leaves whose known samples are all alike."""
        return self.label != MIXED
