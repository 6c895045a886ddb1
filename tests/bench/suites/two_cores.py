"""Two cores against one, in processes that take turns: threads over compiled blocks, and devices of XLA's own."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

from machine import worker
from metric import Metric, Times, throughput

#: Field, samples along each of two axes.
SWEEPS = {"forward_count": 10_000, "forward_branches": 1_500}
#: Blocks of one run of bare kernels.
BLOCKS = 64


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


def two_devices() -> None:
    """Tells XLA, before it starts, to split this machine's cores between two devices."""
    os.environ["XLA_FLAGS"] = "--xla_force_host_platform_device_count=2"


@cache
def _block(field: str, device: int) -> Callable[[], object]:
    """Returns a call of the field's kernel on one block of random samples, on one device."""
    import jax
    import numpy as np
    from kernel import compiled

    import jaxkin as jk
    from jaxkin.sweep import fields

    jk.enable_x64()
    robot, chosen = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0), fields.by_name(field)
    place = jax.devices()[device]
    rho = np.random.default_rng(device).uniform(0, 4, (3, chosen.block(robot)))
    given = jax.device_put((robot, tuple(rho)), place)
    kernel = compiled(chosen.kernel, *given)
    return lambda: kernel(*given)


def run_threads(field: str) -> None:
    """Runs the blocks in two threads, on one device."""
    import jax

    call = _block(field, 0)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: jax.block_until_ready(call()), range(BLOCKS)))


def run_devices(field: str) -> None:
    """Runs the blocks on two devices from one thread, one block ahead."""
    import jax

    calls = [_block(field, device) for device in range(2)]
    for _ in range(BLOCKS // 2):
        jax.block_until_ready([call() for call in calls])


def measure() -> list[Metric]:
    """Times each sweep in both processes, then bare kernels both ways."""
    metrics = []
    with worker(1) as one, worker(2) as two, worker(2) as split:
        split.submit(two_devices).result()
        for field, side in SWEEPS.items():
            runs = {
                name: lambda pool=pool, field=field, side=side: pool.submit(run, field, side).result()
                for name, pool in (("one", one), ("two", two))
            }
            times = Times(runs, rounds=5)
            metrics.append(Metric(f"two cores: {field}, two / one", times.ratio("one", "two"), "x", "higher"))
            metrics.append(throughput(f"two cores: {field}", side * side, times.median("two")))
            ways = {
                "threads": lambda field=field: two.submit(run_threads, field).result(),
                "devices": lambda field=field: split.submit(run_devices, field).result(),
            }
            ratio = Times(ways, rounds=5).ratio("devices", "threads")
            metrics.append(Metric(f"two cores: {field}, threads / devices", ratio, "x", "higher"))
    return metrics
