"""Peak resident memory of a process that sweeps 10^8 samples, with a Zarr store and without."""

import tempfile
import time
from pathlib import Path

from machine import worker
from metric import Metric, duration

SIDE = 10_000
#: Memory hardly varies, but thread timing moves it a little.
TOLERANCE = 0.3


def sweep(store: Path | None) -> tuple[float, float]:
    """Sweeps, and returns this process's peak memory in GB and the seconds."""
    import resource

    import jaxkin as jk

    jk.enable_x64()
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    grid = jk.Grid(rho1=(0.0, 4.0, SIDE), rho2=1.0, rho3=(0.0, 4.0, SIDE))
    start = time.perf_counter()
    result = jk.sweep(robot, "forward_count", grid, store=store, progress=False)
    elapsed = time.perf_counter() - start
    assert result.attrs["complete"] == 1
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9, elapsed


def measure() -> list[Metric]:
    """Runs each kind in a fresh process."""
    metrics = []
    with tempfile.TemporaryDirectory() as folder:
        for label, store in (("in memory", None), ("with a Zarr store", Path(folder) / "map")):
            with worker() as process:
                peak, elapsed = process.submit(sweep, store).result()
            metrics.append(Metric(f"memory: 10^8 samples {label}, peak", peak, "GB", "lower", TOLERANCE, 2.0))
            metrics.append(duration(f"memory: 10^8 samples {label}", elapsed))
    return metrics
