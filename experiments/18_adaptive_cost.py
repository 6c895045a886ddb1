"""What a digit of area or volume costs: adaptive sweeps against uniform grids, evaluations and seconds, in one table.

All take the same finest grid. With proofs the labels are the same at all of its samples, so that the areas are the same
number; by samples alone a few may be missed, and the table says how many. Exact values: the area from the singular
curves (``jk.regions``), the volume in closed form (``jk.workspace_volume``).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray
from _common import start

import jaxkin as jk

_ANALYTIC_SAMPLES = (129, 257, 513, 1025, 2049, 4097)
_REFERENCE_SAMPLES = (129, 257, 513, 1025)
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


@dataclass
class Costs:
    """One grid, swept in three ways: uniformly, by samples alone, and with proofs (None where there are none)."""

    dense: xarray.Dataset
    sampled: Any
    proved: Any
    seconds: tuple[float, ...]

    def row(self, name: str, grid: str, exact: float, area: float, uniform: float) -> list[str]:
        """Returns one line of the table."""
        error = abs(uniform - exact) / exact
        label = self.sampled.attrs["label"]
        differ = int((self.sampled.to_dense()[label].values != self.dense[label].values).sum())
        if self.proved is not None:
            assert np.array_equal(self.proved.to_dense()[label].values, self.dense[label].values)
            assert np.all(self.proved["size"].values[self.proved.constant.values == 1] == 1), "not all is proved"
            assert abs(area - uniform) < 1e-9 * exact
        swept = [each for each in (self.sampled, self.proved) if each is not None]
        costs = [self.sampled.attrs["grid_samples"], *(each.attrs["evaluations"] for each in swept)]
        digits = -np.log10(error)
        columns = (
            [f"{cost}" for cost in costs],
            [f"{cost / digits:,.0f}" for cost in costs],
            [f"{each:.2g}" for each in self.seconds],
        )
        missing = ["-"] * (3 - len(costs))
        cells = [text for column in columns for text in (*column, *missing)]
        print(swept[-1], f"\n  by samples alone {differ} samples differ, area {area!r}", flush=True)
        return [name, grid, f"{error:.1e}", *cells, f"{differ}"]


def swept(robot: Any, field: str, grid: jk.Grid) -> Costs:
    """Sweeps a field in all ways that it allows."""
    dense, uniform = timed(lambda: jk.sweep(robot, field, grid))
    quick = jk.Adaptive(proof=0, probes=0)
    sampled, light = timed(lambda: jk.sweep(robot, field, grid, adaptive=quick))
    if jk.fields.by_name(field).walls(robot) is None:
        return Costs(dense, sampled, None, (uniform, light))
    proved, full = timed(lambda: jk.sweep(robot, field, grid, adaptive=True))
    return Costs(dense, sampled, proved, (uniform, light, full))


def area_rows(name: str, robot: Any, samples: tuple[int, ...], **axes: Any) -> list[list[str]]:
    """The area with six solutions of a section of a 3-RPR; free axes are given by their ends."""
    spaces = {key: ends for key, ends in axes.items() if isinstance(ends, tuple)}

    def grid(n: int) -> jk.Grid:
        return jk.Grid(**{**axes, **{key: (*ends, n) for key, ends in spaces.items()}})

    regions = jk.regions(robot, grid(200))
    assert isinstance(regions, jk.Regions)
    exact = regions.areas_by_number()[6]
    whole = float(np.prod([high - low for low, high in spaces.values()]))
    rows = []
    for n in samples:
        costs = swept(robot, "forward_count", grid(n))
        best = costs.sampled if costs.proved is None else costs.proved
        area = float(best.measure()["measure"].sel(label=6))
        uniform = uniform_measure(costs.dense.forward_count.values == 6, whole)
        rows.append(costs.row(name, f"{n}²", exact, area, uniform))
    return rows


def volume_rows() -> list[list[str]]:
    """The volume of the upper workspace of the TLPM: poses whose legs are within their strokes."""
    robot = jk.mechanisms.tlpm.create()
    exact = float(jk.workspace_volume(robot, branch="upper").volume)
    whole = float(np.prod([high - low for low, high in _BOX.values()]))
    rows = []
    for n in _BOX_SAMPLES:
        costs = swept(robot, "inverse_branches", jk.Grid(**{name: (*ends, n) for name, ends in _BOX.items()}))
        area = float(costs.proved.measure()["measure"].sel(label=int(jk.Status.OK)).item())
        inside = costs.dense.inverse_branches_status.values[0] == jk.Status.OK
        assert not any(face.any() for axis in range(3) for face in (inside.take(0, axis), inside.take(-1, axis)))
        rows.append(costs.row("volume, TLPM", f"{n}³", exact, area, uniform_measure(inside, whole)))
    return rows


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
    analytic = jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)
    rows = area_rows("area, analytic 3-RPR", analytic, _ANALYTIC_SAMPLES, rho1=(0.0, 4.0), rho2=1.0, rho3=(0.0, 4.0))
    reference = jk.mechanisms.rpr3.reference()
    rows += area_rows(
        "area, reference 3-RPR", reference, _REFERENCE_SAMPLES, rho1=14.98, rho2=(0.0, 40.0), rho3=(0.0, 40.0)
    )
    table = markdown(rows + volume_rows())
    path = folder / "adaptive_table.md"
    path.write_text(table, encoding="utf-8")
    print(table)
    print(path)


if __name__ == "__main__":
    main()
