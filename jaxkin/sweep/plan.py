"""How a sweep is cut: blocks that a compiled call takes, chunks that are read back, tiles that are written at once."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.words import given
from jaxkin.sweep.fields import Field, Variable
from jaxkin.sweep.grid import BoundGrid

Box = tuple[slice, ...]

#: A tile is one file of a store for each variable, and what is lost when a worker dies: at most so many samples, ...
_TILE_SAMPLES = 1 << 24
#: ... bytes ...
_TILE_BYTES = 1 << 26
#: ... and calls, which bound its time where samples are slow; ...
_TILE_BLOCKS = 128
#: ... and at most such a share of the grid, so that many cores find work.
_TILES_WANTED = 32
#: ... but with runs of memory no shorter than so many bytes, where the grid has them.
_RUN_BYTES = 1 << 13
#: Bytes of a chunk, the least that a reader has to decompress.
_CHUNK_BYTES = 1 << 22
#: Samples of a call on an accelerator, which has to be filled.
_DEVICE_BLOCK = 1 << 20

PRECISIONS = ("float64", "float32")


@dataclass(frozen=True)
class Plan:
    """How a request is cut, which is the same on every machine.

    Attributes:
        field: What is computed.
        grid: Where.
        variables: What is stored.
        block: Samples of one compiled call along each free axis.
        chunk: Samples of a chunk; a tile is a whole number of chunks.
        tile: Samples of a tile.
        precision: "float64" or "float32", in which the kernel computes.
    """

    field: Field
    grid: BoundGrid
    variables: tuple[Variable, ...]
    block: tuple[int, ...]
    chunk: tuple[int, ...]
    tile: tuple[int, ...]
    precision: str = "float64"

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of tiles along each free axis."""
        return tile_counts(self.grid.shape, self.tile)

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return math.prod(self.counts)

    @property
    def sample_bytes(self) -> int:
        """Bytes of one sample, before compression."""
        return _bytes(self.variables)

    def box(self, number: int) -> Box:
        """Returns the samples of a tile."""
        sides = zip(tile_place(number, self.counts), self.tile, self.grid.shape, strict=True)
        return tuple(slice(place * side, min((place + 1) * side, length)) for place, side, length in sides)

    def samples(self, number: int) -> int:
        """Returns how many samples a tile has."""
        return math.prod(extent(self.box(number)))

    def samples_of(self, which: np.ndarray) -> int:
        """Returns how many samples the tiles have that are marked in ``(tiles,)``."""
        sizes = np.ones(1, np.int64)
        for length, side, count in zip(self.grid.shape, self.tile, self.counts, strict=True):
            along = np.full(count, side)
            along[-1] = length - (count - 1) * side
            sizes = np.multiply.outer(sizes, along).ravel()
        return int(sizes[which].sum())

    def layout(self) -> dict[str, Any]:
        """Returns what of the plan a store has to remember."""
        return {"block": list(self.block), "chunk": list(self.chunk), "tile": list(self.tile)}


def make_plan(robot: Mechanism, field: Field, grid: BoundGrid, precision: str = "float64") -> Plan:
    """Cuts a grid for a field.

    Raises:
        InputError: The field cannot be computed for this mechanism, or in this precision.
    """
    variables = tuple(_stored(v, precision) for v in field.variables(robot))
    block = _DEVICE_BLOCK if field.traced and _on_accelerator() else field.block(robot)
    most = min(_TILE_SAMPLES, _TILE_BYTES // _bytes(variables), _TILE_BLOCKS * block)
    target = max(1, min(most, max(block, grid.size // _TILES_WANTED)))
    run = _RUN_BYTES // np.dtype(variables[0].dtype).itemsize
    tile = _even(grid.shape, _cube(grid.shape, target, run))
    largest = max(_bytes((v,)) for v in variables)
    chunk = _even(tile, _cube(tile, max(1, _CHUNK_BYTES // largest)))
    tile = tuple(c * math.ceil(t / c) for t, c in zip(tile, chunk, strict=True))
    return Plan(field, grid, variables, _rows(tile, block), chunk, tile, precision)


def check_precision(field: Field, precision: str) -> None:
    """Refuses a precision that is none, or that is not enough for a field.

    Raises:
        InputError: It is one of these.
    """
    if precision not in PRECISIONS:
        raise InputError(f"precision is {precision!r}: it must be 'float64' or 'float32'.")
    if precision == "float32" and field.domain == "geometry":
        what, remedy = given("precision is 'float32'"), given("use 'float64'")
        raise InputError(f"{what}, in which no design is computed: {remedy}; {field.name!r} needs float64.")
    if precision == "float32" and not field.single:
        what, remedy = given("precision is 'float32'"), given("use 'float64'")
        raise InputError(
            f"{what}, which cannot tell close solutions of {field.name!r} apart: {remedy}, or sweep a field that "
            "measures one pose, such as 'inverse_branches' or 'smallest_singular_value'."
        )


def tile_counts(shape: tuple[int, ...], tile: tuple[int, ...]) -> tuple[int, ...]:
    """Returns the number of tiles along each axis."""
    return tuple(math.ceil(n / t) for n, t in zip(shape, tile, strict=True))


def tile_place(number: int, counts: tuple[int, ...]) -> tuple[int, ...]:
    """Returns the place of a tile among the tiles along each axis; they are numbered row by row."""
    return tuple(int(k) for k in np.unravel_index(number, counts))


def boxes(shape: tuple[int, ...], step: tuple[int, ...], origin: tuple[int, ...]) -> Iterator[Box]:
    """Yields the boxes of at most ``step`` that make up a box of ``shape`` at ``origin``, row by row."""
    ends = [o + n for o, n in zip(origin, shape, strict=True)]
    ranges = [range(o, e, s) for o, e, s in zip(origin, ends, step, strict=True)]
    for corner in itertools.product(*ranges):
        yield tuple(slice(c, min(c + s, e)) for c, s, e in zip(corner, step, ends, strict=True))


def extent(box: Box) -> tuple[int, ...]:
    """Returns the samples of a box along each axis."""
    return tuple(side.stop - side.start for side in box)


def _bytes(variables: tuple[Variable, ...]) -> int:
    return sum(np.dtype(v.dtype).itemsize * math.prod(v.lead) for v in variables)


def _stored(variable: Variable, precision: str) -> Variable:
    return replace(variable, dtype=precision) if variable.dtype == "float64" else variable


def _on_accelerator() -> bool:
    import jax

    return jax.devices()[0].platform != "cpu"


def _cube(shape: tuple[int, ...], target: int, run: int = 1) -> tuple[int, ...]:
    """Returns sides as equal as the shape allows, of about ``target`` samples: any slice of it is read cheaply.

    Args:
        shape: The box that is cut.
        target: Samples of a piece.
        run: Least side along the last axis, which may make it longer than the others.
    """
    sides, left = list(shape), float(target)
    last = len(shape) - 1
    order = sorted(range(len(shape)), key=shape.__getitem__)
    if run > target ** (1 / len(shape)):
        order = [last, *(k for k in order if k != last)]
    for place, k in enumerate(order):
        fair = max(1, round(left ** (1 / (len(shape) - place))))
        sides[k] = min(shape[k], max(fair, min(run, target)) if k == last else fair)
        left = max(1.0, left / sides[k])
    return tuple(sides)


def _even(shape: tuple[int, ...], sides: tuple[int, ...]) -> tuple[int, ...]:
    """Shortens sides so that their last repetition is about as long as the others."""
    return tuple(math.ceil(n / math.ceil(n / s)) for n, s in zip(shape, sides, strict=True))


def _rows(shape: tuple[int, ...], target: int) -> tuple[int, ...]:
    """Returns a box of about ``target`` samples in long runs of memory: the last axes whole, as far as they fit."""
    sides, left = list(shape), max(1, target)
    for k in reversed(range(len(shape))):
        sides[k] = _fitting(shape[k], left)
        left = max(1, left // sides[k])
    return tuple(sides)


def _fitting(length: int, target: int) -> int:
    """Returns a side of 2/3 to 3/2 of the target whose repetitions overlap the end of a length the least."""
    most = 3 * target // 2
    if length <= most:
        return length
    counts = range(math.ceil(length / most), max(1, 3 * length // (2 * target)) + 1)
    sides = {math.ceil(length / count) for count in counts} or {target}
    return min(sides, key=lambda side: (math.ceil(length / side) * side, abs(side - target)))
