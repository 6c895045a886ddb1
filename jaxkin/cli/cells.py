"""``jaxkin map --adaptive``: cells in which a field is constant, as a picture, as labelled data and as numbers."""

import json
import math
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.folder import check_folder, pictures, request_of, write_files
from jaxkin.core.errors import InputError, StoreError
from jaxkin.sweep.units import grid_text

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Mechanism
    from jaxkin.sweep._adaptive_result import AdaptiveSweep
    from jaxkin.sweep.fields import Field
    from jaxkin.sweep.grid import Grid

_DATA, _NUMBERS = "cells.zarr", "cells.json"
_PICTURES = ("cells.png", "cells.pdf")

#: Options of ``jk.Adaptive``, by their names there.
_OPTIONS = {
    "stride": ("N", int, "grid steps along a side of the coarsest cells, a power of two; 32 or fewer by default."),
    "probes": ("N", int, "random samples in each round of the error estimate, 0 for none; 4000 by default."),
    "seed": ("N", int, "seed of the random samples; 0 by default."),
    "proof": ("N", int, "split cells of more steps until they are proved constant; 1 by default, 0 tries no proof."),
    "label": ("NAME", str, "what is constant in cells: sign of a real field, or one of its discrete variables."),
}


def adaptive_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Adds ``--adaptive`` to a command, and how to refine."""
    for name, (metavar, kind, text) in reversed(_OPTIONS.items()):
        command = click.option(f"--{name}", metavar=metavar, type=kind, help=f"With --adaptive: {text}")(command)
    flag_help = (
        "Sample only where the field changes, down to one step of the grid: cells, with bounds of what is missed."
    )
    return click.option("--adaptive", is_flag=True, help=flag_help)(command)


def check_adaptive(adaptive: bool, refining: dict[str, Any], others: dict[str, Any]) -> None:
    """Refuses options that do not go together.

    Args:
        adaptive: Whether ``--adaptive`` is given.
        refining: Options that need it, by name; None where one is not given.
        others: Options that cannot be given with it, by how they are written.

    Raises:
        InputError: Two options exclude each other, or one needs another.
    """
    without = [f"--{name}" for name, value in refining.items() if value is not None]
    if without and not adaptive:
        raise InputError(
            f"{' and '.join(without)} is given without --adaptive, to which it belongs: give both or none."
        )
    wrong = [option for option, value in others.items() if value]
    if adaptive and wrong:
        raise InputError(
            f"--adaptive computes in this process and in float64, and holds the cells in memory: leave "
            f"{' and '.join(wrong)} out, and give --out FOLDER for the result."
        )


def check_cells_folder(out: Path | None, force: bool) -> None:
    """Refuses a folder for cells that cannot be used, or holds anything but cells."""
    if out is None:
        return
    own = next((name for name in (_DATA, _NUMBERS) if (out / name).exists()), _NUMBERS)
    check_folder(out, own, force)
    if (out / _DATA).exists() and _request_in(out / _DATA) is None:
        raise StoreError(f"{out / _DATA} exists and holds no cells of jaxkin's: move it away or choose another folder.")


def map_cells(
    robot: "Mechanism",
    field: "Field",
    grid: "Grid",
    refining: dict[str, Any],
    workers: int | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Sweeps adaptively, writes the cells into a folder, if there is one, and tells of them."""
    from jaxkin.sweep._adaptive_result import AdaptiveSweep
    from jaxkin.sweep.adaptive import Adaptive
    from jaxkin.sweep.engine import sweep

    how = Adaptive(**{name: value for name, value in refining.items() if value is not None})
    cells = sweep(robot, field, grid, adaptive=how, workers=workers)
    assert isinstance(cells, AdaptiveSweep)
    numbers = _numbers(cells)
    if out is not None:
        numbers["files"] = _write(cells, numbers, out, force)
    click.echo(json.dumps(numbers, indent=2) if as_json else _summary(robot, cells, numbers))


def _numbers(cells: "AdaptiveSweep") -> dict[str, Any]:
    request, attrs = json.loads(cells.attrs["request"]), cells.attrs
    bound = float(attrs["missed_share_bound"])
    return {
        "mechanism": request["mechanism"],
        "geometry": request["geometry"],
        "field": attrs["field"],
        "label": attrs["label"],
        "grid": request["grid"],
        "axis_units": {axis["name"]: axis["unit"] for axis in json.loads(attrs["axes"])},
        "adaptive": request["adaptive"],
        "samples": int(attrs["grid_samples"]),
        "evaluations": int(attrs["evaluations"]),
        "cells": cells.sizes["cell"],
        "complete": bool(attrs["complete"]),
        "resolution": json.loads(attrs["resolution"]),
        "missed_share_bound": None if math.isnan(bound) else bound,
        **_measures(cells),
        "request_hash": attrs["request_hash"],
        "run_log": json.loads(attrs["run_log"]),
    }


def _measures(cells: "AdaptiveSweep") -> dict[str, Any]:
    """Returns area or volume of every label, with bounds; one of each branch where there are several."""
    found = cells.measure()
    flags = found.label.attrs
    meanings = str(flags.get("flag_meanings", "")).split()
    names = dict(zip([int(v) for v in flags["flag_values"]], meanings, strict=True)) if meanings else {}
    labels = [names.get(label, str(label)) for label in found.label.values.tolist()]
    measures = {
        label: {str(name): found[name].isel(label=k).values.tolist() for name in found.data_vars}
        for k, label in enumerate(labels)
    }
    parts = {name: float(found.attrs[name]) for name in ("total", "proved", "sampled", "boundary")}
    return {"measures": measures, "measure_unit": found["measure"].attrs["units"], "measure_of_cells": parts}


def _write(cells: "AdaptiveSweep", numbers: dict[str, Any], out: Path, force: bool) -> dict[str, str]:
    """Writes the files that are missing (all, with --force); tells where each is.

    Raises:
        StoreError: The folder holds the cells of another request.
    """
    data = out / _DATA
    there = _request_in(data) if data.exists() and not force else None
    if there is not None and there != numbers["request_hash"]:
        raise StoreError(f"{data} was made by another request: choose another folder, or replace it with --force.")
    out.mkdir(parents=True, exist_ok=True)
    if there is None:
        _replace(data, cells)
    # Numbers are written last, and vouch for the pictures.
    anew = force or request_of(out / _NUMBERS) != numbers["request_hash"]
    files = {"data": str(data), "numbers": str(out / _NUMBERS)}
    missing = [out / name for name in _PICTURES if anew or not (out / name).exists()]
    if missing:
        try:
            write_files(_draw(cells, missing))
        except InputError as error:  # Three free axes, or branches: data without a picture.
            click.echo(f"jaxkin: no picture: {error}", err=True)
    files |= {path.suffix[1:]: str(path) for path in map(out.joinpath, _PICTURES) if path.exists()}
    if anew:
        write_files({out / _NUMBERS: (json.dumps({**numbers, "files": files}, indent=2) + "\n").encode()})
    return files


def _replace(data: Path, cells: "AdaptiveSweep") -> None:
    """Writes the data aside and renames it when it is whole."""
    new, old = (data.with_name(f".{data.name}.{what}") for what in ("new", "old"))
    try:
        for folder in (new, old):
            shutil.rmtree(folder, ignore_errors=True)
        cells.to_zarr(new, consolidated=False)
        if data.exists():
            os.rename(data, old)
        os.rename(new, data)
    except OSError as error:
        raise StoreError(f"{data} cannot be written ({error.strerror}): choose another place.") from error
    finally:
        if old.exists() and not data.exists():
            os.rename(old, data)
        for folder in (new, old):
            shutil.rmtree(folder, ignore_errors=True)


def _request_in(data: Path) -> str | None:
    """Returns the request that stored cells belong to, None where there are none."""
    try:
        attrs = json.loads((data / "zarr.json").read_text())["attributes"]
        return attrs["request_hash"] if "evaluations" in attrs else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _draw(cells: "AdaptiveSweep", paths: list[Path]) -> dict[Path, bytes]:
    from jaxkin.plot.cells import cells as draw

    return pictures(paths, lambda: draw(cells))


def _summary(robot: "Mechanism", cells: "AdaptiveSweep", numbers: dict[str, Any]) -> str:
    lines = [str(robot), f"{numbers['label']} over {grid_text(numbers['grid'])}", repr(cells)]
    for label, measures in numbers["measures"].items():
        if isinstance(measures["measure"], float):  # Not one of each branch.
            low, high = measures["low"], measures["high"]
            lines.append(f"  {label:>12}  {measures['measure']:.6g}, between {low:.6g} and {high:.6g}")
    lines += [f"  {kind}: {path}" for kind, path in numbers.get("files", {}).items()]
    return "\n".join(lines)
