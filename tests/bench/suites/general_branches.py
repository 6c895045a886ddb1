"""All assembly modes of the reference 3-RPR on one core: the kernel against NumPy's companion eigenvalues."""

import math
from collections.abc import Callable

import jax
import numpy as np
from check import residual
from metric import Metric, Times, duration, mistakes, speedup, throughput
from numpy_rpr3 import branches_general_companion

import jaxkin as jk
from jaxkin.sweep.fields import forward_branches
from tests.oracles.rpr3_exact import count_general

Kernel = Callable[..., tuple[jax.Array, ...]]

BLOCK = 1 << 12
#: Largest error of a leg's length, between 8 and 22 long.
LEG_ERROR = 1e-9
#: Blocks of one timed run, and of the comparison of numbers.
TIMED, COMPARED = 8, 64


def measure() -> list[Metric]:
    """Times random joint values between 8 and 22, and settles every difference by exact arithmetic."""
    jk.enable_x64()
    robot = jk.mechanisms.rpr3.reference()
    rho = np.random.default_rng(3).uniform(8, 22, (COMPARED, 3, BLOCK))
    kernel = jax.jit(forward_branches.kernel)
    leaves = robot.geometry()
    geometry = tuple(float(leaves[name]) for name in ("c2", "c3", "d3", "l2", "l3", "beta"))

    def jaxkin() -> None:
        for block in rho[:TIMED]:
            jax.block_until_ready(kernel(robot, tuple(block)))

    def companion() -> None:
        for block in rho[:TIMED]:
            branches_general_companion(*geometry, *block)

    times, samples = Times({"jaxkin": jaxkin, "companion": companion}), TIMED * BLOCK
    return [
        throughput("general branches: kernel", samples, times.median("jaxkin")),
        throughput("general branches: NumPy companion", samples, times.median("companion")),
        duration("general branches: compiling", times.compiling("jaxkin")),
        speedup("general branches: kernel / NumPy companion", times.ratio("companion", "jaxkin"), 5),
        *_compare(robot, kernel, geometry, rho),
    ]


def _compare(robot: jk.Mechanism, kernel: Kernel, geometry: tuple[float, ...], rho: np.ndarray) -> list[Metric]:
    c2, c3, d3, l2, l3, beta = geometry
    b2, b3 = (l2, 0.0), (l3 * math.cos(beta), l3 * math.sin(beta))
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
            exact = count_general(b2, b3, c2, c3, d3, *block[:, i].tolist()).count
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
