"""All assembly modes of the analytic 3-RPR on one core: kernel in cache, sweep into fresh memory."""

import math
from collections.abc import Callable

import jax
import numpy as np
from bandwidth import FRESH, HELD, writes
from check import residual
from kernel import compiled
from load import WIDE, Rpr3C, load
from metric import Metric, Times, bandwidth, duration, mistakes, speedup, throughput
from numba_branches import branches_analytic_numba

import jaxkin as jk
from jaxkin.sweep.fields import forward_branches
from tests.oracles.rpr3_exact import count_analytic

Kernel = Callable[..., tuple[jax.Array, ...]]
Yardsticks = dict[str, Callable[..., np.ndarray]]

GEOMETRY = (1.0, 0.0, 1.0)
#: The same robot as base c2, c3, d3 and platform l2, l3, beta.
AS_GENERAL = (1.0, 0.0, 1.0, 1.0, 1.0, -math.pi / 2)
#: Largest error of a leg's length; near zero length rounding makes it the root of itself.
LEG_ERROR = 1e-7
KERNEL_BLOCK = 1 << 13
#: C writes 144 bytes a sample; so many stay in its second-level cache.
C_BLOCK = 1 << 12
#: Six poses, six statuses, six multiplicities.
SAMPLE_BYTES = 6 * (3 * 8 + 1 + 1)
#: Samples of one timed run.
SAMPLES = 1 << 19
SIDE = 1024


def measure() -> list[Metric]:
    """Times random samples in cache, then a product grid into fresh memory."""
    jk.enable_x64()
    robot = jk.mechanisms.rpr3.analytic(*GEOMETRY)
    libraries = {"C": load(), "C 512": load(WIDE)}
    present: Yardsticks = {name: library.branches_cubic for name, library in libraries.items() if library is not None}
    if branches_analytic_numba is not None:
        present["numba"] = branches_analytic_numba
    return [*_in_cache(robot, present), *_fresh(robot, present)]


#: numba must be beaten; of C a half.
_GOALS = {"C": 0.5, "C 512": 0.5, "numba": 1.0}


def _in_cache(robot: jk.Mechanism, yardsticks: Yardsticks) -> list[Metric]:
    rho = np.random.default_rng(1).uniform(0, 4, (3, KERNEL_BLOCK))
    joints = tuple(jax.device_put(rho))
    kernel = compiled(forward_branches.kernel, robot, joints)
    out, small = np.empty((6, 3, C_BLOCK)), [each[:C_BLOCK].copy() for each in rho]

    def jaxkin() -> None:
        for _ in range(SAMPLES // KERNEL_BLOCK):
            jax.block_until_ready(kernel(robot, joints))

    def yardstick(branches: Callable[..., np.ndarray]) -> None:
        for _ in range(SAMPLES // C_BLOCK):
            branches(*GEOMETRY, *small, out)

    times = Times({"jaxkin": jaxkin, **{name: lambda b=b: yardstick(b) for name, b in yardsticks.items()}})
    metrics = [
        throughput("analytic branches: kernel in cache", SAMPLES, times.median("jaxkin"), 15),
        duration("analytic branches: compiling", times.compiling("jaxkin")),
    ]
    for name in yardsticks:
        ratio = times.ratio(name, "jaxkin")
        metrics.append(speedup(f"analytic branches: kernel / {name}, in cache", ratio, _GOALS[name]))
        metrics.append(throughput(f"analytic branches: {name}, in cache", SAMPLES, times.median(name)))
    return metrics + _compare(robot, kernel)


def _compare(robot: jk.Mechanism, kernel: Kernel) -> list[Metric]:
    """Compares the numbers of poses on fresh samples; the exact oracle settles every difference."""
    library: Rpr3C | None = load()
    if library is None:
        return []
    rho = np.random.default_rng(2).uniform(0, 4, (3, SAMPLES))
    # Six lanes of x, y, phi, then their statuses, then their multiplicities.
    arrays = forward_branches.unpack(tuple(np.asarray(array) for array in kernel(robot, tuple(rho))))
    poses = np.stack(arrays[:18]).reshape(6, 3, -1)
    flagged = np.isin(np.stack(arrays[18:24]), (jk.Status.SINGULAR, jk.Status.UNDECIDED)).any(axis=0)
    here = np.stack(arrays[24:]) > 0
    count = here.sum(axis=0)
    astray = here & ~(residual(AS_GENERAL, np.moveaxis(poses, 1, 2), rho.T) <= LEG_ERROR)
    other = (~np.isnan(library.branches_cubic(*GEOMETRY, *rho)[:, 0])).sum(axis=0)
    unequal = np.flatnonzero((count != other) & ~flagged)
    wrong = sum(count_analytic(*GEOMETRY, *rho[:, i].tolist()).count != count[i] for i in unequal)
    return [
        mistakes(f"analytic branches: wrong numbers of poses in {SAMPLES}", wrong),
        mistakes(f"analytic branches: poses off by {LEG_ERROR:g} in a leg", int(astray.sum())),
    ]


def _fresh(robot: jk.Mechanism, yardsticks: Yardsticks) -> list[Metric]:
    axis = np.linspace(0.0, 4.0, SIDE)
    flat = [np.ascontiguousarray(r).ravel() for r in np.broadcast_arrays(axis[:, None], 1.0, axis)]
    grid = jk.Grid(rho1=(0.0, 4.0, SIDE), rho2=1.0, rho3=(0.0, 4.0, SIDE))
    runs: dict[str, Callable[[], object]] = {
        "jaxkin": lambda: jk.sweep(robot, "forward_branches", grid, workers=1, progress=False)
    }
    for name, branches in yardsticks.items():
        runs[name] = lambda b=branches: b(*GEOMETRY, *flat)
    samples = SIDE * SIDE
    written = SAMPLE_BYTES * samples
    times = Times(runs | writes(written))
    metrics = [throughput("analytic branches: sweep into fresh memory", samples, times.median("jaxkin"), 15)]
    metrics += [bandwidth(f"analytic branches: {name}", written, times.median(name)) for name in (HELD, FRESH)]
    share = times.ratio(FRESH, "jaxkin")
    metrics.append(Metric("analytic branches: sweep / write, fresh memory", share, "x", "higher"))
    for name in yardsticks:
        ratio = times.ratio(name, "jaxkin")
        metrics.append(speedup(f"analytic branches: sweep / {name}, fresh memory", ratio, _GOALS[name]))
        metrics.append(throughput(f"analytic branches: {name}, fresh memory", samples, times.median(name)))
    return metrics
