"""Count map of the analytic 3-RPR: the public sweep on one core against C, NumPy and numba."""

from collections.abc import Callable

import numpy as np
import xarray
from bandwidth import FRESH, HELD, writes
from load import WIDE, Rpr3C, load
from metric import RATIO, Metric, Times, bandwidth, duration, mistakes, throughput
from numba_rpr3 import count_numba
from numpy_rpr3 import count_closed_form

import jaxkin as jk
from tests.oracles.rpr3_exact import count_analytic

GEOMETRY = (1.0, 0.0, 1.0)
RHO2 = 1.0
SIDE = 2000
#: Steps of 0.002, which meet singular points exactly: there the count is flagged, and C may differ.
SPAN = (0.002, 4.0, SIDE)
#: Rows that the yardsticks take at once: 32 000 samples, which stay in cache.
ROWS = 16


def measure() -> list[Metric]:
    """Times the sweep into fresh memory, the yardsticks into arrays that they have already."""
    jk.enable_x64()
    robot = jk.mechanisms.rpr3.analytic(*GEOMETRY)
    grid = jk.Grid(rho1=SPAN, rho2=RHO2, rho3=SPAN)

    def sweep() -> xarray.Dataset:
        return jk.sweep(robot, "forward_count", grid, workers=1, progress=False)

    yardsticks, samples = _yardsticks(), SIDE * SIDE
    # A number and a flag, a byte each.
    times = Times({"jaxkin": sweep, **yardsticks, **writes(2 * samples)})
    metrics = [
        throughput("count map: jaxkin sweep, one core", samples, times.median("jaxkin")),
        duration("count map: compiling", times.compiling("jaxkin")),
    ]
    metrics += [bandwidth(f"count map: {name}", 2 * samples, times.median(name)) for name in (HELD, FRESH)]
    metrics.append(Metric("count map: jaxkin / write, fresh memory", times.ratio(FRESH, "jaxkin"), "x", "higher"))
    for name in yardsticks:
        ratio, label = times.ratio(name, "jaxkin"), f"count map: jaxkin / {name}"
        gated = name not in _INFORMATIONAL
        metrics.append(Metric(label, ratio, "x", "higher", RATIO if gated else None, _GOALS.get(name)))
        metrics.append(throughput(f"count map: {name}", samples, times.median(name)))
    return metrics + _compare(sweep())


_GOALS = {"C cubic": 0.5, "C cubic 512": 0.5, "NumPy": 15}
#: The Sturm counts are the ceiling; whole arrays in NumPy wait for fresh memory.
_INFORMATIONAL = ("C Sturm", "C Sturm 512", "NumPy, whole arrays")


def _axes() -> tuple[np.ndarray, np.ndarray]:
    return np.linspace(*SPAN), np.linspace(*SPAN)


def _flat(rho1: np.ndarray, rho3: np.ndarray) -> list[np.ndarray]:
    """Returns the three lengths of every sample, ``(SIDE, SIDE)`` each."""
    return [np.ascontiguousarray(rho) for rho in np.broadcast_arrays(rho1[:, None], RHO2, rho3)]


def _yardsticks() -> dict[str, Callable[[], object]]:
    rho1, rho3 = _axes()
    out = np.empty((SIDE, SIDE), np.uint8)
    rows = [slice(start, start + ROWS) for start in range(0, SIDE, ROWS)]
    flat = _flat(rho1, rho3)
    pieces = [([rho[part].ravel() for rho in flat], out[part].ravel()) for part in rows]

    def numpy_in_rows() -> None:
        for rho, piece in pieces:
            piece[:] = count_closed_form(*GEOMETRY, *rho)

    def in_rows(count: Callable[..., np.ndarray]) -> Callable[[], object]:
        return lambda: [count(*GEOMETRY, *rho, piece) for rho, piece in pieces]

    def grid(count: Callable[..., np.ndarray]) -> Callable[[], object]:
        return lambda: [count(*GEOMETRY, rho1[part], RHO2, rho3, out[part]) for part in rows]

    runs: dict[str, Callable[[], object]] = {
        "NumPy": numpy_in_rows,
        "NumPy, whole arrays": lambda: count_closed_form(*GEOMETRY, *(rho.ravel() for rho in flat)),
    }
    if count_numba is not None:
        runs["numba"] = in_rows(count_numba)
    for label, flags in (("", ()), (" 512", WIDE)):
        library = load(flags)
        if library is not None:
            runs[f"C cubic{label}"] = grid(library.count_grid_cubic)
            runs[f"C Sturm{label}"] = grid(library.count_grid_sturm)
    return runs


def _compare(result: xarray.Dataset) -> list[Metric]:
    """Compares with C (NumPy without a compiler); the exact oracle settles every difference."""
    library: Rpr3C | None = load()
    rho1, rho3 = _axes()
    if library is not None:
        other = library.count_grid_cubic(*GEOMETRY, rho1, RHO2, rho3)
    else:
        flat = (rho.ravel() for rho in _flat(rho1, rho3))
        other = count_closed_form(*GEOMETRY, *flat).reshape(SIDE, SIDE)
    count = result.forward_count.values
    flagged = result.forward_count_nearly_double.values
    differing = np.argwhere((count != other) & ~flagged)
    wrong = sum(count_analytic(*GEOMETRY, rho1[i], RHO2, rho3[j]).count != count[i, j] for i, j in differing.tolist())
    return [
        mistakes("count map: unflagged differences from C", len(differing)),
        mistakes("count map: of these, wrong by the exact count", wrong),
        Metric("count map: flagged nearly double", 1e6 * flagged.mean(), "per million", "lower"),
    ]
