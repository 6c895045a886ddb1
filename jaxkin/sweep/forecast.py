"""What a sweep will take, from a few blocks computed and written now: here, or on a cluster."""

import math
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zarr

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep import result
from jaxkin.sweep.designs import SAID
from jaxkin.sweep.engine import check_size, check_workers, planned
from jaxkin.sweep.fields import Field
from jaxkin.sweep.grid import Grid
from jaxkin.sweep.manifest import compressors
from jaxkin.sweep.plan import Box, Plan, extent
from jaxkin.sweep.store import check_store
from jaxkin.sweep.threads import cores
from jaxkin.sweep.tiler import Tiler
from jaxkin.sweep.units import bytes_text, counted, time_text

#: Tiles, spread over the grid, of which a piece is computed and written, and the seconds that a piece may take.
_PROBES, _PATIENCE = 5, 0.3
#: Copies of a tile's bytes that exist while it is written: the arrays, Zarr's, and the encoded ones.
_COPIES = 3


@dataclass(frozen=True)
class Forecast:
    """What a sweep will take.

    Attributes:
        samples: Samples in all.
        tiles: Tiles, each one file of every variable.
        raw_bytes: Bytes of the result.
        stored_bytes: Bytes on the disk, compressed as the probes were; None without a store.
        memory: Peak bytes of this process.
        compiling: Seconds until the first block was done, once for every process.
        tile_computing: Seconds of one thread to compute a tile.
        tile_writing: Seconds of one thread to compress and write it, on the disk of the temporary folder.
        workers: Threads that were assumed.
        one_at_a_time: True where the field cannot be traced, and is computed one design at a time.
    """

    samples: int
    tiles: int
    raw_bytes: int
    stored_bytes: int | None
    memory: int
    compiling: float
    tile_computing: float
    tile_writing: float
    workers: int
    one_at_a_time: bool = False

    @property
    def seconds(self) -> float:
        """Predicted time of the sweep in this process."""
        rounds = math.ceil(self.tiles / self.workers)
        return self.compiling + rounds * (self.tile_computing + self.tile_writing)

    def on_cluster(
        self, workers: int, *, task_seconds: float, bandwidth: float = math.inf, starting: float = 0.0
    ) -> "ClusterForecast":
        """Predicts the same sweep on a cluster of machines like this one.

        Args:
            workers: Threads of all its workers.
            task_seconds: What the scheduler and the client need for one tile, one after the other.
            bandwidth: Bytes per second that the shared storage takes from all of them together.
            starting: Seconds until a worker's first tile, besides compiling.
        """
        rounds = math.ceil(self.tiles / workers)
        return ClusterForecast(
            starting=starting + self.compiling,
            computing=rounds * (self.tile_computing + self.tile_writing),
            scheduling=self.tiles * task_seconds,
            storing=(self.stored_bytes or self.raw_bytes) / bandwidth,
        )

    def __str__(self) -> str:
        """A few lines for a person."""
        rate = self.samples / max(self.seconds, 1e-9) / 1e6
        disk = "" if self.stored_bytes is None else f", about {bytes_text(self.stored_bytes)} on the disk"
        return (
            f"{counted(self.samples, 'sample')} in {counted(self.tiles, 'tile')}\n"
            f"  result      {bytes_text(self.raw_bytes)}{disk}\n"
            f"  memory      about {bytes_text(self.memory)}\n"
            f"  time        about {time_text(self.seconds)} with {counted(self.workers, 'thread')} ({rate:.3g} million "
            "samples/s)" + (f"\n  {SAID}" if self.one_at_a_time else "")
        )


@dataclass(frozen=True)
class ClusterForecast:
    """Predicted seconds on a cluster: what happens at the same time, part by part.

    Attributes:
        starting: Until the first tile.
        computing: Computing and compressing, shared by all workers.
        scheduling: The scheduler's and the client's work, which nobody shares.
        storing: What the shared storage needs to take the bytes.
    """

    starting: float
    computing: float
    scheduling: float
    storing: float

    @property
    def seconds(self) -> float:
        """Predicted time: the longest part hides the others."""
        return self.starting + max(self.computing, self.scheduling, self.storing)

    @property
    def bottleneck(self) -> str:
        """Name of the longest part."""
        return max(("computing", "scheduling", "storing"), key=lambda name: getattr(self, name))


def forecast(
    robot: Mechanism,
    field: Field | str,
    grid: Grid,
    *,
    store: bool | str | Path = True,
    overwrite: bool = False,
    workers: int | None = None,
    precision: str = "float64",
) -> Forecast:
    """Predicts what ``jk.sweep`` of the same arguments will take; computes a few pieces, and keeps none.

    Args:
        robot: The mechanism.
        field: The field, or its name.
        grid: The grid.
        store: True where the result goes into a store, False where it is held in memory; or the folder of the store,
            which is then checked as the sweep would check it. Nothing is written there.
        overwrite: As in ``jk.sweep``.
        workers: Threads; the number of cores by default.
        precision: As in ``jk.sweep``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As from ``jk.sweep``.
        GeometryError: As from ``jk.sweep``.
        StoreError: As from ``jk.sweep``, where the folder of a store is given.
    """
    if not isinstance(store, (bool, str, Path)):
        raise InputError(f"jk.forecast: store is {store!r}: it must be True, False or the path of a folder.")
    plan, request = planned("jk.forecast", robot, field, grid, precision)
    check_workers("jk.forecast", workers)
    if store is False:
        check_size(plan)
    elif store is not True:
        check_store(Path(store), request, plan, overwrite)
    workers = max(1, min(workers or cores(), plan.tiles))
    started = time.perf_counter()
    tiler = Tiler(robot, plan)
    first = plan.box(plan.tiles // 2)
    tiler.compute(_piece(first, plan, 0), _room(plan, _piece(first, plan, 0)))
    compiling = time.perf_counter() - started
    computing = writing = stored = samples = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number in np.unique(np.linspace(0, plan.tiles - 1, min(_PROBES, plan.tiles)).astype(int)).tolist():
            box, seconds, arrays = _computed(tiler, plan, number)
            computing += seconds
            samples += math.prod(extent(box))
            if store:
                started = time.perf_counter()
                stored += _written(Path(folder) / str(number), plan, arrays)
                writing += time.perf_counter() - started
    a_tile = math.prod(plan.tile) / samples
    raw = plan.grid.size * plan.sample_bytes
    tile_bytes = math.prod(plan.tile) * plan.sample_bytes
    return Forecast(
        samples=plan.grid.size,
        tiles=plan.tiles,
        raw_bytes=raw,
        stored_bytes=round(stored / samples * plan.grid.size) if store else None,
        memory=_resident() + (workers * _COPIES * tile_bytes if store else raw),
        compiling=compiling,
        tile_computing=computing * a_tile,
        tile_writing=writing * a_tile,
        workers=workers,
        one_at_a_time=not plan.field.traced,
    )


def _computed(tiler: Tiler, plan: Plan, number: int) -> tuple[Box, float, dict[str, np.ndarray]]:
    """Computes as much of a tile as patience allows; returns what, the seconds, and the values."""
    one = _piece(plan.box(number), plan, 0)
    arrays, started = _room(plan, one), time.perf_counter()
    tiler.compute(one, arrays)
    seconds = time.perf_counter() - started
    box = _piece(plan.box(number), plan, _PATIENCE / max(seconds, 1e-9))
    if box == one:
        return one, seconds, arrays
    arrays, started = _room(plan, box), time.perf_counter()
    tiler.compute(box, arrays)
    return box, time.perf_counter() - started, arrays


def _piece(tile: Box, plan: Plan, rows: float) -> Box:
    """Returns one block of a tile, or so many whole rows of blocks of it."""
    if rows < 1:
        return tuple(slice(s.start, min(s.start + b, s.stop)) for s, b in zip(tile, plan.block, strict=True))
    across = math.prod(math.ceil(n / b) for n, b in zip(extent(tile)[1:], plan.block[1:], strict=True))
    height = max(1, int(min(rows, 1e6) / across)) * plan.block[0]
    return (slice(tile[0].start, min(tile[0].start + height, tile[0].stop)), *tile[1:])


def _room(plan: Plan, box: Box) -> dict[str, np.ndarray]:
    return result.allocate(plan.variables, extent(box))


def _written(path: Path, plan: Plan, arrays: dict[str, np.ndarray]) -> int:
    """Writes values as a store would; returns the bytes on the disk."""
    for variable in plan.variables:
        values = arrays[variable.name]
        shape = values.shape[len(variable.lead) :]
        chunk = tuple(min(n, c) for n, c in zip(shape, plan.chunk, strict=True))
        shard = (math.ceil(n / c) * c for n, c in zip(shape, chunk, strict=True))
        zarr.create_array(
            path / variable.name,
            data=values,
            chunks=(*variable.lead, *chunk),
            shards=(*variable.lead, *shard),
            compressors=compressors(values.dtype),
            fill_value=variable.missing,
        )
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file() and file.name != "zarr.json")


def _resident() -> int:
    """Returns the peak of this process's memory so far, in bytes; 0 where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows.
        return 0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
