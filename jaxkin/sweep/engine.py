"""The one loop over samples: chunked, compiled once, on all cores, resumable."""

import concurrent.futures
import itertools
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import GeometryError, InputError, SweepInterrupted
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import Request, identity, run_log
from jaxkin.kinematics.boundary import checked_mechanism
from jaxkin.sweep import fields, result
from jaxkin.sweep.adaptive import Adaptive, adaptive_options, adaptive_sweep
from jaxkin.sweep.fields import Field, Variable
from jaxkin.sweep.grid import BoundGrid, Grid
from jaxkin.sweep.progress import Progress
from jaxkin.sweep.store import Store

if TYPE_CHECKING:
    import xarray

#: A tile is what is written and journalled at once: at most so many samples and bytes.
_TILE_SAMPLES = 1 << 18
_TILE_BYTES = 1 << 24

Box = tuple[slice, ...]


def sweep(
    robot: Mechanism,
    field: Field | str,
    grid: Grid,
    *,
    store: str | Path | None = None,
    overwrite: bool = False,
    workers: int | None = None,
    progress: bool | None = None,
    adaptive: "bool | Adaptive" = False,
) -> "xarray.Dataset":
    """Computes a field at every sample of a grid.

    Args:
        robot: The mechanism.
        field: One of ``jk.fields``, its name, or a field of your own from ``jk.fields.from_function``.
        grid: A ``Grid`` over all axes of the field's space.
        store: Folder of a Zarr store for results that outlive the process or the memory; the same request
            goes on where it stopped. Without it the result is held in memory.
        overwrite: Replaces a jaxkin store, whatever request made it, and starts anew. Nothing else is ever replaced.
        workers: Threads that run compiled chunks side by side; the number of cores by default.
        progress: True or False to force or forbid the progress bar; by default it shows on a terminal.
        adaptive: True or ``jk.Adaptive(...)`` for a field that is constant in cells (a count, a label, a sign): samples
            only where it changes, with a proof or an estimate that nothing larger than a stated size is missed. Held
            in memory.

    Returns:
        An ``xarray.Dataset`` whose main variable bears the field's name: dimensions in the mechanism's order
        of axes, fixed axes as scalar coordinates, units and the request in the attributes. From a store it
        is opened lazily. An adaptive one is a ``jk.AdaptiveSweep``, a dataset with the dimension ``cell`` and the
        methods ``to_dense`` and ``measure``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The field is unknown or the grid does not fit the mechanism.
        GeometryError: The mechanism's geometry is degenerate.
        StoreError: The store holds something else or cannot be written.
        SweepInterrupted: Ctrl-C; ``.dataset`` holds what was computed, and a store keeps it.
    """
    checked_mechanism("jk.sweep", robot)
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise InputError(f"jk.sweep: workers is {workers!r}: it must be a whole number of threads, at least 1.")
    field = fields.by_name(field) if isinstance(field, str) else field
    if not isinstance(field, Field) or not isinstance(grid, Grid):
        raise InputError(
            f"jk.sweep got {type(field).__name__} and {type(grid).__name__}: pass a field (jk.fields.forward_count or "
            "its name) and a jk.Grid."
        )
    if not bool(np.all(robot.geometry_ok())):
        raise GeometryError(f"{robot}: the geometry is degenerate or not finite; build it with its constructor.")
    bound = grid.bind(field.axes(robot), "joint" if field.domain == "joints" else "pose")
    options = adaptive_options(adaptive)
    if options is not None:
        if store is not None:
            raise InputError("jk.sweep: adaptive sweeps are held in memory: leave store out; the result has to_zarr().")
        content = _request(robot, field, bound, field.variables(robot))
        return adaptive_sweep(robot, field, bound, content, options, workers or _cores(), progress)
    plan = _plan(robot, field, bound)
    _check_size(plan, in_memory=store is None)
    request = _request(robot, field, bound, plan.variables)
    keeper: Store | None = None
    if store is not None:
        keeper = Store.open(Path(store), request, plan.variables, bound, plan.tile, overwrite=overwrite)
    return _run(robot, plan, request, keeper, workers or _cores(), progress)


#: More tiles than this would take hours to list; more samples on one axis, gigabytes of coordinates.
_MOST_TILES = 10**7


def _check_size(plan: "_Plan", in_memory: bool) -> None:
    """Refuses what cannot fit before anything is allocated."""
    size = plan.grid.size
    if size / math.prod(plan.tile) > _MOST_TILES or max(plan.grid.shape) > 10**8:
        raise InputError(f"The grid has {size:.3g} samples: that is more than one sweep can list; use fewer.")
    need = size * sum(np.dtype(v.dtype).itemsize * math.prod(v.lead) for v in plan.variables)
    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else math.inf
    if in_memory and need > 0.8 * have:
        raise InputError(
            f"The grid has {size:.3g} samples, which need {need / 1e9:.0f} GB; this machine has {have / 1e9:.0f} GB: "
            "give a store (store=..., --out) or use fewer samples."
        )


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class _Plan:
    """How a request is cut: blocks that one compiled call takes, tiles that are written at once."""

    field: Field
    grid: BoundGrid
    variables: tuple[Variable, ...]
    block: tuple[int, ...]
    tile: tuple[int, ...]

    def tiles(self) -> Iterator[tuple[int, Box]]:
        """Yields the number and the box of every tile."""
        return enumerate(_boxes(self.grid.shape, self.tile))


def _plan(robot: Mechanism, field: Field, grid: BoundGrid) -> _Plan:
    variables = field.variables(robot)
    sample = sum(np.dtype(v.dtype).itemsize * math.prod(v.lead) for v in variables)
    block = _fitted(grid.shape, (1,) * len(grid.shape), field.block(robot))
    tile = _fitted(grid.shape, block, min(_TILE_SAMPLES, max(1, _TILE_BYTES // sample)))
    return _Plan(field, grid, variables, block, tile)


def _fitted(shape: tuple[int, ...], unit: tuple[int, ...], target: int) -> tuple[int, ...]:
    """Grows a box from multiples of ``unit``, last axis first, to about ``target`` samples."""
    factors = [1] * len(shape)
    left = max(1, target // math.prod(unit))
    for k in reversed(range(len(shape))):
        whole = math.ceil(shape[k] / unit[k])
        pieces = math.ceil(whole / min(whole, left))
        factors[k] = math.ceil(whole / pieces)
        left = max(1, left // factors[k])
    return tuple(u * f for u, f in zip(unit, factors, strict=True))


def _boxes(shape: tuple[int, ...], step: tuple[int, ...], origin: tuple[int, ...] | None = None) -> Iterator[Box]:
    origin = origin or (0,) * len(shape)
    ranges = [range(o, o + n, s) for o, n, s in zip(origin, shape, step, strict=True)]
    ends = [o + n for o, n in zip(origin, shape, strict=True)]
    for corner in itertools.product(*ranges):
        yield tuple(slice(c, min(c + s, e)) for c, s, e in zip(corner, step, ends, strict=True))


def _request(robot: Mechanism, field: Field, grid: BoundGrid, variables: tuple[Variable, ...]) -> Request:
    from jaxkin.core.precision import TOLERANCES

    return Request(
        {
            **identity(robot),
            "field": {"name": field.name, "version": field.version},
            "variables": [variable.name for variable in variables],
            "grid": grid.content(),
            "tolerances": vars(TOLERANCES),
        }
    )


def _block_values(
    robot: Mechanism,
    coordinates: tuple[Array, ...],
    field: Field,
    free: tuple[int, ...],
    shape: tuple[int, ...],
) -> tuple[Array, ...]:
    """Evaluates a field on one block; coordinates are vectors on free axes and scalars on fixed ones."""
    spread = list(coordinates)
    for place, k in enumerate(free):
        spread[k] = coordinates[k].reshape(tuple(-1 if i == place else 1 for i in range(len(free))))
    values = field.kernel(robot, tuple(spread))
    return tuple(jnp.broadcast_to(value, value.shape[: max(0, value.ndim - len(shape))] + shape) for value in values)


# Not with xla_cpu_prefer_vector_width=512, which would make counts up to 1.4 times faster: with it jaxlib 0.10 computes
# arctangents wrong and different in every run.
_compiled_block = jax.jit(_block_values, static_argnames=("field", "free", "shape"))


class _Tiler:
    """Computes tiles of one plan."""

    def __init__(self, robot: Mechanism, plan: _Plan):
        self._robot = robot
        self._plan = plan
        self._axes = [plan.grid.coordinate(k) for k in range(len(plan.grid.axes))]
        self._run = partial(_compiled_block, field=plan.field, free=plan.grid.free, shape=plan.block)

    def compute(self, box: Box, into: dict[str, np.ndarray]) -> None:
        """Fills the arrays of one tile, block by block."""
        plan = self._plan
        corner = tuple(side.start for side in box)
        extent = tuple(side.stop - side.start for side in box)
        for block in _boxes(extent, plan.block, corner):
            arrays = plan.field.unpack(tuple(np.asarray(a) for a in self._run(self._robot, self._coordinates(block))))
            here = tuple(slice(side.start - c, side.stop - c) for side, c in zip(block, corner, strict=True))
            crop = tuple(slice(0, side.stop - side.start) for side in block)
            source = iter(arrays)
            for variable in plan.variables:
                for lead in np.ndindex(*variable.lead):
                    into[variable.name][(*lead, *here)] = next(source)[crop]

    def _coordinates(self, block: Box) -> tuple[np.ndarray, ...]:
        """Returns the block's coordinates; at the upper edges the last one repeats, so that shapes stay."""
        coordinates: list[np.ndarray] = []
        sides = iter(zip(block, self._plan.block, strict=True))
        for k, samples in enumerate(self._axes):
            if k in self._plan.grid.free:
                side, length = next(sides)
                piece = samples[side]
                # np.pad takes longer than a small block.
                whole = len(piece) == length
                coordinates.append(piece if whole else np.pad(piece, (0, length - len(piece)), mode="edge"))
            else:
                coordinates.append(samples[0])
        return tuple(coordinates)


def _run(
    robot: Mechanism, plan: _Plan, request: Request, keeper: Store | None, workers: int, show: bool | None
) -> "xarray.Dataset":
    started = time.perf_counter()
    done = keeper.done() if keeper else set()
    todo = [(number, box) for number, box in plan.tiles() if number not in done]
    memory = None if keeper else result.allocate(plan.variables, plan.grid)
    samples_done = plan.grid.size - sum(_samples(box) for _, box in todo)
    missing = dict(todo)

    def finish() -> "xarray.Dataset":
        log = run_log(seconds=round(time.perf_counter() - started, 3), workers=workers)
        complete = samples_done == plan.grid.size
        if keeper:
            return keeper.dataset(log if todo else None)
        assert memory is not None
        for box in missing.values():
            result.mark_missing(memory, plan.variables, box)
        return result.dataset(memory, plan.variables, plan.grid, request, log, complete)

    def work(tiler: _Tiler, number: int, box: Box) -> None:
        if memory is not None:
            tiler.compute(box, {name: array[(..., *box)] for name, array in memory.items()})
        elif keeper is not None:
            buffers = result.allocate(plan.variables, plan.grid, tuple(s.stop - s.start for s in box))
            tiler.compute(box, buffers)
            keeper.write(number, box, buffers)

    if todo:
        with Progress(plan.grid.size, plan.field.name, show) as bar:
            bar.add(samples_done)

            def count(number: int) -> None:
                nonlocal samples_done
                samples = _samples(missing.pop(number))
                samples_done += samples
                bar.add(samples)

            try:
                _share(_Tiler(robot, plan), todo, work, count, workers)
            except KeyboardInterrupt:
                kept = f"; the finished tiles are in {keeper.path}, the same request goes on there" if keeper else ""
                message = f"Stopped after {samples_done} of {plan.grid.size} samples{kept}."
                raise SweepInterrupted(message, finish(), samples_done) from None
    return finish()


def _samples(box: Box) -> int:
    return math.prod(side.stop - side.start for side in box)


def _share(
    tiler: _Tiler,
    todo: list[tuple[int, Box]],
    work: Callable[[_Tiler, int, Box], None],
    count: Callable[[int], None],
    workers: int,
) -> None:
    """Shares tiles among threads; JAX and NumPy release the interpreter while they work."""
    queue, lock, stop = iter(todo), threading.Lock(), threading.Event()

    def loop() -> None:
        while not stop.is_set():
            with lock:
                number, box = next(queue, (None, None))
            if number is None or box is None:
                return
            work(tiler, number, box)
            with lock:
                count(number)

    workers = max(1, min(workers, len(todo)))
    with concurrent.futures.ThreadPoolExecutor(workers, thread_name_prefix="jaxkin-sweep") as pool:
        futures = [pool.submit(loop) for _ in range(workers)]
        try:
            # A wait with a timeout lets Ctrl-C through.
            while concurrent.futures.wait(futures, 0.2, concurrent.futures.FIRST_EXCEPTION).not_done:
                if any(f.done() and f.exception() for f in futures):
                    break
        finally:
            stop.set()
    for future in futures:
        future.result()
