"""All assembly modes of the reference 3-RPR on one core: the kernel against C, numba and NumPy eigenvalues."""

import math
from collections.abc import Callable

import jax
import numpy as np
from check import residual
from kernel import compiled
from load import WIDE, load
from metric import Metric, Times, duration, mistakes, speedup, throughput
from numba_branches import branches_general_numba
from numpy_rpr3 import branches_general_companion

import jaxkin as jk
from jaxkin.sweep.fields import forward_branches
from tests.oracles.rpr3_exact import count_general

Kernel = Callable[..., tuple[jax.Array, ...]]
Yardstick = Callable[..., np.ndarray]

BLOCK = 1 << 13
#: Largest error of a leg's length, between 8 and 22 long.
LEG_ERROR = 1e-9
#: Blocks of one timed run, and of the comparison of numbers.
TIMED, COMPARED = 4, 32


def measure() -> list[Metric]:
    """Times random joint values between 8 and 22, and settles every difference by exact arithmetic."""
    jk.enable_x64()
    robot = jk.mechanisms.rpr3.reference()
    rho = np.random.default_rng(3).uniform(8, 22, (COMPARED, 3, BLOCK))
    kernel = compiled(forward_branches.kernel, robot, tuple(rho[0]))
    leaves = robot.geometry()
    geometry = tuple(float(leaves[name]) for name in ("c2", "c3", "d3", "l2", "l3", "beta"))

    def jaxkin() -> None:
        for block in rho[:TIMED]:
            jax.block_until_ready(kernel(robot, tuple(block)))

    def companion() -> None:
        for block in rho[:TIMED]:
            branches_general_companion(*geometry, *block)

    yardsticks, out = _yardsticks(), np.empty((6, 3, BLOCK))

    def in_blocks(branches: Yardstick) -> Callable[[], object]:
        return lambda: [branches(geometry, *block, out) for block in rho[:TIMED]]

    runs = {"jaxkin": jaxkin, "NumPy companion": companion}
    times = Times(runs | {name: in_blocks(branches) for name, branches in yardsticks.items()})
    metrics = [
        throughput("general branches: kernel", TIMED * BLOCK, times.median("jaxkin")),
        duration("general branches: compiling", times.compiling("jaxkin")),
    ]
    for name in ("NumPy companion", *yardsticks):
        ratio = times.ratio(name, "jaxkin")
        metrics.append(speedup(f"general branches: kernel / {name}", ratio, _GOALS[name]))
        metrics.append(throughput(f"general branches: {name}", TIMED * BLOCK, times.median(name)))
    return metrics + _compare(robot, kernel, geometry, rho) + _check_yardsticks(yardsticks, geometry, rho)


_GOALS = {"NumPy companion": 5, "C": 0.5, "C 512": 0.5, "numba": 1.0}


def _yardsticks() -> dict[str, Yardstick]:
    """Returns what fills an array with the poses of one block, by name."""
    libraries = {"C": load(), "C 512": load(WIDE)}
    present: dict[str, Yardstick] = {}
    present |= {name: library.branches_general for name, library in libraries.items() if library is not None}
    if branches_general_numba is not None:
        present["numba"] = branches_general_numba
    return present


def _check_yardsticks(yardsticks: dict[str, Yardstick], geometry: tuple[float, ...], rho: np.ndarray) -> list[Metric]:
    """Counts where a yardstick's number of poses is wrong: a yardstick that is fast and wrong would be none."""
    metrics = []
    for name, branches in yardsticks.items():
        wrong = 0
        for block in rho:
            count = (~np.isnan(branches(geometry, *block)[:, 0])).sum(axis=0)
            other = (~np.isnan(branches_general_companion(*geometry, *block)[..., 0])).sum(axis=1)
            wrong += sum(_exact(geometry, block[:, i]) != count[i] for i in np.flatnonzero(count != other))
        label = f"general branches: {name} wrong in {rho.shape[0] * BLOCK} samples"
        metrics.append(Metric(label, int(wrong), "samples", "lower"))
    return metrics


def _exact(geometry: tuple[float, ...], rho: np.ndarray) -> int:
    """Returns the exact number of poses of one sample."""
    c2, c3, d3, l2, l3, beta = geometry
    b2, b3 = (l2, 0.0), (l3 * math.cos(beta), l3 * math.sin(beta))
    return count_general(b2, b3, c2, c3, d3, *rho.tolist()).count


def _compare(robot: jk.Mechanism, kernel: Kernel, geometry: tuple[float, ...], rho: np.ndarray) -> list[Metric]:
    missed = invented = astray = companion_wrong = 0
    for block in rho:
        # Six lanes of x, y, phi, then their statuses, then their multiplicities.
        arrays = forward_branches.unpack(tuple(np.asarray(array) for array in kernel(robot, tuple(block))))
        poses = np.stack(arrays[:18]).reshape(6, 3, -1)
        here = np.stack(arrays[24:]) > 0
        error = residual(geometry, np.moveaxis(poses, 1, 2), block.T)
        astray += int((here & ~(error <= LEG_ERROR)).sum())
        count = here.sum(axis=0)
        other = (~np.isnan(branches_general_companion(*geometry, *block)[..., 0])).sum(axis=1)
        for i in np.flatnonzero(count != other):
            exact = _exact(geometry, block[:, i])
            missed += max(0, exact - int(count[i]))
            invented += max(0, int(count[i]) - exact)
            companion_wrong += int(other[i] != exact)
    where = f"in {rho.shape[0] * BLOCK} samples"
    return [
        mistakes(f"general branches: missed solutions {where}", missed),
        mistakes(f"general branches: invented solutions {where}", invented),
        mistakes(f"general branches: poses off by {LEG_ERROR:g} in a leg", astray),
        Metric(f"general branches: companion wrong {where}", companion_wrong, "samples", "lower"),
    ]
