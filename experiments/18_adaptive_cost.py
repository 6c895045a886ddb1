"""What a digit of area or volume costs: adaptive sweeps against uniform grids, evaluations and seconds, in one table.

All take the same finest grid. With proofs the labels are the same at all of its samples, so that the areas are the same
number; by samples alone a few may be missed, and the table says how many. Exact values: the area from the singular
curves (``jk.regions``), the volume in closed form (``jk.workspace_volume``).
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from _common import start

import jaxkin as jk

_SECTION_SAMPLES = (129, 257, 513, 1025, 2049, 4097)
_BOX_SAMPLES = (33, 65, 129, 257)
#: A box that holds the upper workspace of the TLPM, mm; no sample lies on its planes of symmetry but y = 0.
_BOX = {"x": (-390.0, 400.0), "y": (-340.0, 340.0), "z": (-410.0, 310.0)}


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Returns the result and the shorter of two times; the first call compiles."""
    call()
    begin = time.perf_counter()
    call()
    middle = time.perf_counter()
    result = call()
    return result, min(middle - begin, time.perf_counter() - middle)


def uniform_measure(inside: np.ndarray, volume: float) -> float:
    """Returns the measure where something holds, from a dense map, by the trapezoidal rule."""
    weights = inside.astype(float)
    for axis in range(inside.ndim):
        ends = np.ones(inside.shape[axis])
        ends[[0, -1]] = 0.5
        weights = np.moveaxis(np.moveaxis(weights, axis, -1) * ends, -1, axis)
    return float(weights.sum()) * volume / float(np.prod(np.subtract(inside.shape, 1)))


def row(
    name: str, samples: str, exact: float, areas: tuple[float, float], found: tuple[Any, Any], seconds: tuple
) -> list[str]:
    """Returns one line of the table."""
    uniform, adaptive = areas
    assert abs(uniform - adaptive) < 1e-9 * exact
    error = abs(adaptive - exact) / exact
    costs = [found[0].attrs["grid_samples"], *(each.attrs["evaluations"] for each in found)]
    return [
        name,
        samples,
        f"{error:.1e}",
        *(f"{cost}" for cost in costs),
        *(f"{cost / -np.log10(error):.2g}" for cost in costs),
        *(f"{each:.2g}" for each in seconds),
        f"{found[0].attrs['differ']}",
    ]


def section_rows() -> list[list[str]]:
    """The area with six solutions of the section rho2 = 1 of the analytic 3-RPR."""
    robot = jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)
    grid = jk.Grid(rho1=(0.0, 4.0, 200), rho2=1.0, rho3=(0.0, 4.0, 200))
    regions = jk.regions(robot, grid)
    assert isinstance(regions, jk.Regions)
    exact = regions.areas_by_number()[6]
    rows = []
    for n in _SECTION_SAMPLES:
        grid = jk.Grid(rho1=(0.0, 4.0, n), rho2=1.0, rho3=(0.0, 4.0, n))
        found, dense, seconds = both(robot, "forward_count", grid)
        area = float(found[1].measure()["measure"].sel(label=6))
        whole = uniform_measure(dense.forward_count.values == 6, 16.0)
        rows.append(row("area, six solutions", f"{n}²", exact, (whole, area), found, seconds))
    return rows


def box_rows() -> list[list[str]]:
    """The volume of the upper workspace of the TLPM: poses whose legs are within their strokes."""
    robot = jk.mechanisms.tlpm.create()
    exact = float(jk.workspace_volume(robot, branch="upper").volume)
    rows = []
    for n in _BOX_SAMPLES:
        grid = jk.Grid(**{name: (*ends, n) for name, ends in _BOX.items()})
        found, dense, seconds = both(robot, "inverse_branches", grid)
        volume = float(found[1].measure()["measure"].sel(label=int(jk.Status.OK)).item())
        inside = dense.inverse_branches_status.values[0] == jk.Status.OK
        assert not any(face.any() for axis in range(3) for face in (inside.take(0, axis), inside.take(-1, axis)))
        whole = uniform_measure(inside, float(np.prod([high - low for low, high in _BOX.values()])))
        rows.append(row("volume, TLPM", f"{n}³", exact, (whole, volume), found, seconds))
    return rows


def both(robot: Any, field: str, grid: jk.Grid) -> tuple[tuple[Any, Any], xarray.Dataset, tuple[float, float, float]]:
    """Sweeps uniformly, adaptively by samples alone, and adaptively with all proofs."""
    dense, uniform = timed(lambda: jk.sweep(robot, field, grid))
    quick = jk.Adaptive(proof=0, probes=0)
    light, sampled = timed(lambda: jk.sweep(robot, field, grid, adaptive=quick))
    found, proved = timed(lambda: jk.sweep(robot, field, grid, adaptive=True))
    name = found.attrs["label"]
    assert np.all(found["size"].values[found.constant.values == 1] == 1), "every larger cell is proved"
    assert np.array_equal(found.to_dense()[name].values, dense[name].values)
    light.attrs["differ"] = int((light.to_dense()[name].values != dense[name].values).sum())
    print(found, f"\n  by samples alone {light.attrs['differ']} samples differ", flush=True)
    return (light, found), dense, (uniform, sampled, proved)


_HEADER = (
    "measure",
    "grid",
    "relative error",
    "samples, uniform",
    "by samples",
    "proved",
    "per digit, uniform",
    "by samples",
    "proved",
    "seconds, uniform",
    "by samples",
    "proved",
    "missed by samples",
)


def markdown(rows: list[list[str]]) -> str:
    """Returns the table."""
    lines = [_HEADER, ["---"] + ["---:"] * (len(_HEADER) - 1), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def main() -> None:
    folder = start("18", __doc__)
    table = markdown(section_rows() + box_rows())
    for path in (folder / "adaptive_table.md", Path(__file__).parents[1] / "docs" / "adaptive_table.md"):
        path.write_text(table, encoding="utf-8")
        print(path)
    print(table)


if __name__ == "__main__":
    main()
