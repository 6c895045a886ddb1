"""Aspects, regions, cusp curves and mode changes of the reference 3-RPR, compiled, against the goals."""

import math
import time

from machine import worker
from metric import Metric, Times, duration, mistakes

#: Finest resolutions of the aspects' grid; cost should grow with the boundary, four times a doubling, not eight.
LEVELS = (128, 256, 512)
#: Half the side of the box of poses: all of the workspace within legs of 40.
REACH = 60.0


def _aspects(n: int) -> tuple[float, float, float, int]:
    """Returns the seconds of a compiled run, the process's peak memory in GB, millions of cells, and the count."""
    import resource

    import jaxkin as jk

    jk.enable_x64()
    robot = jk.mechanisms.rpr3.reference()

    def run(count: int) -> jk.Aspects:
        side = (-REACH, REACH, count)
        return jk.aspects(robot, jk.Grid(x=side, y=side, phi=(-math.pi, math.pi, count)))

    run(64)
    start = time.perf_counter()
    found = run(n)
    elapsed = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    return elapsed, peak, sum(aspect.cells for aspect in found) / 1e6, found.count


def measure() -> list[Metric]:
    """Times each question of the reference 3-RPR, and counts wrong answers."""
    import numpy as np

    import jaxkin as jk

    jk.enable_x64()
    metrics, wrong = [], 0
    for n in LEVELS:
        with worker() as process:
            elapsed, peak, cells, count = process.submit(_aspects, n).result()
        wrong += count != 2  # Coste (2012): two aspects without limits.
        metrics.append(duration(f"topology: aspects at {n}^3", elapsed, 10.0 if n == 512 else None))
        metrics.append(Metric(f"topology: aspects at {n}^3, cells that stay", cells, "10^6", "lower"))
    metrics.append(Metric("topology: aspects at 512^3, peak", peak, "GB", "lower", 0.3, 2.0))
    robot, joints = jk.mechanisms.rpr3.reference(), np.array([14.98, 15.38, 12.0])
    section = jk.Grid(rho1=14.98, rho2=(0.0, 40.0, 400), rho3=(0.0, 40.0, 400))
    box = jk.Grid(rho1=(0.01, 200.0, 100), rho2=(0.0, 400.0, 100), rho3=(0.0, 400.0, 100))
    modes = np.asarray(jk.forward(robot, joints).values)
    times = Times(
        {
            "regions": lambda: jk.regions(robot, section),
            "cusp curves": lambda: jk.cusp_curves(robot, box),
            "mode change": lambda: jk.mode_change(robot, joints, modes[5], modes[1], encircle=False),
        },
        rounds=3,
    )
    change = jk.mode_change(robot, joints, modes[5], modes[1], encircle=False)
    wrong += not (change.found and change.verified)
    metrics += [
        duration("topology: regions and curves of a section", times.median("regions"), 1.0),
        duration("topology: all cusp curves, with every transition", times.median("cusp curves"), 3.0),
        duration("topology: a mode change", times.median("mode change"), 5.0),
        *(duration(f"topology: compiling, {name}", times.compiling(name)) for name in times.first),
        mistakes("topology: wrong answers", wrong),
    ]
    return metrics
