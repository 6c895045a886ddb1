"""Throughput of every field on this machine, through the public sweep, as a ratio to NumPy's closed form.

Absolute numbers differ between machines; quote the ratios. The benchmarks against C, with a committed
baseline, are in tests/bench.
"""

import sys
import time
from pathlib import Path

import numpy as np
from _common import start

import jaxkin as jk

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.bench.yardsticks.numpy_rpr3 import count_closed_form

_REPEATS = 5


def best(call) -> float:
    """Returns the median seconds of a call, the first one not counted."""
    call()
    seconds = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begin)
    return float(np.median(seconds))


def main() -> None:
    folder = start("03", __doc__)
    analytic, reference = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0), jk.mechanisms.rpr3.reference()
    legs = jk.Grid(rho1=(0.001, 4.0, 1000), rho2=1.0, rho3=(0.001, 4.0, 1000))
    long_legs = jk.Grid(rho1=14.98, rho2=(8.0, 22.0, 400), rho3=(8.0, 22.0, 500))
    poses = jk.Grid(x=(-3.0, 3.0, 100), y=(-3.0, 3.0, 100), phi=(-np.pi, np.pi, 40))
    axis = np.linspace(0.001, 4.0, 1000)
    counts = jk.sweep(analytic, "forward_count", legs).forward_count.values
    rho1, rho3 = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    rho2 = np.ones_like(rho1)
    differ = int((counts.ravel() != count_closed_form(1.0, 0.0, 1.0, rho1, rho2, rho3)).sum())
    yard = 1e6 / best(lambda: count_closed_form(1.0, 0.0, 1.0, rho1, rho2, rho3))
    lines = [
        f"NumPy closed form, count, analytic: ratio 1 by definition ({differ} of 10^6 counts differ from jaxkin's)",
        f"{'mechanism':14} {'field':26} {'M samples/s':>12} {'ratio':>8}",
    ]
    for robot, field, grid, size in (
        (analytic, "forward_count", legs, 10**6),
        (analytic, "forward_branches", legs, 10**6),
        (reference, "forward_count", long_legs, 2 * 10**5),
        (reference, "forward_branches", long_legs, 2 * 10**5),
        (analytic, "inverse_branches", poses, 4 * 10**5),
        (analytic, "direct_determinant", poses, 4 * 10**5),
        (analytic, "smallest_singular_value", poses, 4 * 10**5),
        (analytic, "inverse_condition_number", poses, 4 * 10**5),
        (analytic, "limit_margins", poses, 4 * 10**5),
    ):
        rate = size / best(lambda robot=robot, field=field, grid=grid: jk.sweep(robot, field, grid))
        lines.append(f"{robot.id:14} {field:26} {rate / 1e6:12.2f} {rate / yard:8.2f}")
    text = "\n".join(lines) + "\n"
    (folder / "speed.txt").write_text(text)
    print(text + str(folder / "speed.txt"))


if __name__ == "__main__":
    main()
