"""Two cores against one: two processes, one pinned to a single core, take turns."""

from collections.abc import Callable
from functools import cache

from machine import worker
from metric import Metric, Times, throughput

#: Field, samples along each of two axes.
SWEEPS = {"forward_count": 10_000, "forward_branches": 1_500}


@cache
def _sweep(field: str, side: int) -> Callable[[], object]:
    import jaxkin as jk

    jk.enable_x64()
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    grid = jk.Grid(rho1=(0.0, 4.0, side), rho2=1.0, rho3=(0.0, 4.0, side))
    return lambda: jk.sweep(robot, field, grid, progress=False)


def run(field: str, side: int) -> None:
    """Sweeps with one thread a core; the result is dropped, so nothing is sent back."""
    _sweep(field, side)()


def measure() -> list[Metric]:
    """Times each sweep in both processes."""
    metrics = []
    with worker(1) as one, worker(2) as two:
        for field, side in SWEEPS.items():
            runs = {
                name: lambda pool=pool, field=field, side=side: pool.submit(run, field, side).result()
                for name, pool in (("one", one), ("two", two))
            }
            times = Times(runs, rounds=5)
            metrics.append(Metric(f"two cores: {field}, two / one", times.ratio("one", "two"), "x", "higher"))
            metrics.append(throughput(f"two cores: {field}", side * side, times.median("two")))
    return metrics
