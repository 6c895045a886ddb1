"""What a sweep costs on a cluster: measured on this machine, predicted by the model of jk.forecast, and extrapolated.

Needs the extra `scale`. Run it on a machine with nothing else to do.
"""

import dataclasses
import math
import os
import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import distributed
from _common import start

import jaxkin as jk

#: Samples of the requests that are extrapolated.
SAMPLES = 10**12
WORKERS = (1, 10, 100, 1000)
TILES = tuple(1 << k for k in (18, 20, 22, 24, 26))
#: Bytes per second that a shared file system may take; this machine's disk is measured beside it.
BANDWIDTH = 2e9


def seconds(call: Callable[[], object]) -> float:
    """Times one call."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def requests() -> dict[str, tuple[jk.Mechanism, str, Callable[[int], jk.Grid]]]:
    """Returns a cheap field of few bytes and a dear one of many, each over a grid of about so many samples."""
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)

    def section(n: int) -> jk.Grid:
        side = round(n**0.5)
        return jk.Grid(rho1=(0.0, 4.0, side), rho2=1.0, rho3=(0.0, 4.0, side))

    def box(n: int) -> jk.Grid:
        side = round(n ** (1 / 3))
        return jk.Grid(rho1=(0.0, 4.0, side), rho2=(0.0, 4.0, side), rho3=(0.0, 4.0, side))

    return {"count": (robot, "forward_count", section), "branches": (robot, "forward_branches", box)}


def local(folder: Path, sizes: dict[str, int]) -> list[str]:
    """Compares forecasts with sweeps of this process."""
    lines = [
        "| request | samples | predicted, s | measured, s | predicted MB on disk | measured |",
        "|---|---|---|---|---|---|",
    ]
    for name, (robot, field, grid) in requests().items():
        asked, store = grid(sizes[name]), folder / "local.zarr"
        said = jk.forecast(robot, field, asked)
        took = seconds(lambda r=robot, f=field, g=asked, s=store: jk.sweep(r, f, g, store=s, progress=False))
        stored = jk.describe_store(store).stored_bytes
        shutil.rmtree(store)
        lines.append(
            f"| {name} | {said.samples:.2g} | {said.seconds - said.compiling:.1f} | {took:.1f} | "
            f"{(said.stored_bytes or 0) / 1e6:.3g} | {stored / 1e6:.3g} |"
        )
    return lines


def cluster(folder: Path, sizes: dict[str, int], task: float) -> list[str]:
    """Compares one worker with two, and both with the model."""
    lines = ["| request | workers | predicted, s | measured, s | efficiency |", "|---|---|---|---|---|"]
    for name, (robot, field, grid) in requests().items():
        asked, store, alone = grid(sizes[name]), folder / "cluster.zarr", math.nan
        said = jk.forecast(robot, field, asked)
        for workers in (1, 2):
            with _cluster(workers) as client:
                call = partial(jk.sweep, robot, field, asked, store=store, executor=client, progress=False)
                call()  # The first sweep compiles in every worker.
                shutil.rmtree(store)
                took = seconds(call)
                shutil.rmtree(store)
            alone = took if workers == 1 else alone
            predicted = said.on_cluster(workers, task_seconds=task)
            lines.append(
                f"| {name} | {workers} | {predicted.seconds - said.compiling:.1f} | {took:.1f} | "
                f"{alone / took / workers:.2f} |"
            )
    return lines


class _cluster:
    """Worker processes of one thread each, pinned to a core each, and a client."""

    def __init__(self, workers: int):
        self._cluster = distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
        )
        self._client = distributed.Client(self._cluster)

    def __enter__(self) -> distributed.Client:
        """Pins the workers."""
        cores = sorted(os.sched_getaffinity(0))
        for k, address in enumerate(self._client.scheduler_info()["workers"]):
            self._client.submit(os.sched_setaffinity, 0, {cores[k % len(cores)]}, workers=[address]).result()
        return self._client

    def __exit__(self, *_: object) -> None:
        """Stops all of it."""
        self._client.close()
        self._cluster.close()


def task_seconds() -> float:
    """Returns what one tile costs the scheduler and the client: tiles with next to nothing in them."""
    field = jk.fields.from_function(lambda robot, q: q[0], name="nothing", domain="joints")
    field = dataclasses.replace(field, block=lambda robot: 1)
    robot, grid = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0), jk.Grid(rho1=(0.0, 1.0, 128 * 600), rho2=1.0, rho3=1.0)
    with _cluster(2) as client:
        few = jk.Grid(rho1=(0.0, 1.0, 128 * 60), rho2=1.0, rho3=1.0)
        jk.sweep(robot, field, few, executor=client, progress=False)
        took = [seconds(lambda g=g: jk.sweep(robot, field, g, executor=client, progress=False)) for g in (few, grid)]
    tiles = [jk.forecast(robot, field, g, store=False).tiles for g in (few, grid)]
    return (took[1] - took[0]) / (tiles[1] - tiles[0])


def disk(folder: Path) -> float:
    """Returns bytes per second that the disk takes for good."""
    block, path = os.urandom(1 << 24), folder / "disk.bin"

    def write() -> None:
        with open(path, "wb") as file:
            for _ in range(32):
                file.write(block)
            file.flush()
            os.fsync(file.fileno())

    rate = 32 * len(block) / min(seconds(write) for _ in range(3))
    path.unlink()
    return rate


def extrapolated(task: float) -> list[str]:
    """Predicts 10^12 samples, by workers and by the size of a tile."""
    lines = [
        "| request | workers | samples a tile | tiles | computing, s | scheduling, s | storing, s | all, s | longest |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, (robot, field, grid) in requests().items():
        base, tiny = (jk.forecast(robot, field, grid(n)) for n in (10**9, 100))
        per_tile = base.samples / base.tiles
        # What a tile costs however small it is: files, metadata, the call.
        fixed = tiny.tile_writing
        for workers, size in ((w, s) for w in WORKERS for s in (TILES if w == WORKERS[-1] else TILES[3:4])):
            work = (base.tile_computing + max(base.tile_writing - fixed, 0.0)) / per_tile * size
            scaled = dataclasses.replace(
                base,
                samples=SAMPLES,
                tiles=math.ceil(SAMPLES / size),
                tile_computing=work,
                tile_writing=fixed,
                stored_bytes=round((base.stored_bytes or 0) / base.samples * SAMPLES),
            )
            said = scaled.on_cluster(workers, task_seconds=task, bandwidth=BANDWIDTH)
            lines.append(
                f"| {name} | {workers} | 2^{size.bit_length() - 1} | {scaled.tiles:,} | {said.computing:.3g} | "
                f"{said.scheduling:.3g} | {said.storing:.3g} | {said.seconds:.3g} | {said.bottleneck} |"
            )
    return lines


def main() -> None:
    folder = start("19", __doc__)
    task = task_seconds()
    text = [
        f"Scheduler and client need {task * 1e3:.2f} ms a tile; this disk takes {disk(folder) / 1e6:.0f} MB/s.",
        *local(folder, {"count": 10**9, "branches": 2 * 10**7}),
        *cluster(folder, {"count": 10**9, "branches": 2 * 10**7}, task),
        *extrapolated(task),
    ]
    (folder / "scaling.md").write_text("\n".join(text) + "\n")
    print("\n".join(text))
    print(folder / "scaling.md")


if __name__ == "__main__":
    main()
