"""``jaxkin map``: a field over a grid, as a picture, as labelled data and as numbers."""

import json
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.options import grid_of, json_option, robot_of, set_option, start_jax
from jaxkin.core.errors import InputError, StoreError

if TYPE_CHECKING:
    import xarray

    from jaxkin.core.mechanism import Mechanism

_DATA, _NUMBERS = "map.zarr", "map.json"
_PICTURES = ("map.png", "map.pdf")


@click.command("map")
@click.argument("mechanism")
@click.option("--field", default="forward_count", show_default=True, help="What to map.")
@click.option("--fix", "fixes", multiple=True, metavar="AXIS=VALUE", help="Fix an axis.")
@click.option("--grid", "grids", multiple=True, metavar="AXIS=LOW:HIGH:N", help="Sample an axis.")
@click.option("--out", type=Path, help="Folder for the picture, the data (Zarr) and the numbers (JSON).")
@click.option("--force", is_flag=True, help="Replace a map made by another request.")
@click.option("--workers", type=click.IntRange(min=1), help="Threads; all cores by default.")
@set_option
@json_option
def map_command(
    mechanism: str,
    field: str,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    out: Path | None,
    force: bool,
    workers: int | None,
    changes: tuple[str, ...],
    as_json: bool,
) -> None:
    """Map a field over a grid.

    \b
    jaxkin map rpr3-analytic --fix rho2=1 --grid rho1=0:4:2000 --grid rho3=0:4:2000 --out map

    The same command again goes on where it stopped, and overwrites nothing.
    """
    if out is not None:
        _check_folder(out, force)
    start_jax()
    from jaxkin.sweep.engine import sweep
    from jaxkin.sweep.fields import by_name

    robot = robot_of(mechanism, changes)
    chosen, grid = by_name(field), grid_of(fixes, grids)
    store = None if out is None else out / _DATA
    dataset = sweep(robot, chosen, grid, store=store, overwrite=force, workers=workers)
    numbers = _numbers(robot, dataset)
    if out is not None:
        numbers["files"] = _write(dataset, numbers, out, force)
    click.echo(json.dumps(numbers, indent=2) if as_json else _summary(robot, numbers))


def _check_folder(out: Path, force: bool) -> None:
    """Refuses, before anything is computed, what could lose something."""
    if out.exists() and not out.is_dir():
        raise StoreError(f"--out is {str(out)!r}, which is a file: choose another folder.")
    if out.is_dir() and any(out.iterdir()) and not (out / _DATA).exists() and not force:
        raise StoreError(
            f"--out is {str(out)!r}, which exists and holds something else: choose another folder, or add the map "
            "to it with --force."
        )
    parent = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not os.access(parent, os.W_OK):
        raise StoreError(f"--out is {str(out)!r}, but {str(parent)!r} cannot be written: choose another folder.")


def _numbers(robot: "Mechanism", dataset: "xarray.Dataset") -> dict[str, Any]:
    import numpy as np

    request = json.loads(dataset.attrs["request"])
    name = dataset.attrs["field"]
    main = dataset[name]
    values = np.asarray(main)
    samples = math.prod(len(dataset[axis]) for axis in request["grid"] if axis in dataset.sizes)
    numbers: dict[str, Any] = {
        "mechanism": request["mechanism"],
        "geometry": request["geometry"],
        "field": name,
        "unit": main.attrs["units"],
        "grid": request["grid"],
        "samples": samples,
        "complete": bool(dataset.attrs["complete"]),
    }
    if name == "forward_count":
        found, times = np.unique(values, return_counts=True)
        numbers["fractions"] = {str(int(n)): int(t) / samples for n, t in zip(found, times, strict=True)}
        numbers["nearly_double"] = int(np.asarray(dataset[f"{name}_nearly_double"]).sum())
    else:
        finite = values[np.isfinite(values)]
        numbers["defined"] = finite.size / values.size
        if finite.size:
            numbers |= {"min": float(finite.min()), "mean": float(finite.mean()), "max": float(finite.max())}
    return {
        **numbers,
        "request_hash": dataset.attrs["request_hash"],
        "run_log": json.loads(dataset.attrs["run_log"]),
    }


def _write(dataset: "xarray.Dataset", numbers: dict[str, Any], out: Path, force: bool) -> dict[str, str]:
    """Writes the files that are missing (all, with --force); tells where each is."""
    files = {"data": str(out / _DATA), "numbers": str(out / _NUMBERS)}
    missing = [out / name for name in _PICTURES if force or not (out / name).exists()]
    if missing:
        try:
            _draw(dataset, missing)
        except InputError as error:  # Three free axes, or branches: data without a picture.
            click.echo(f"jaxkin: no picture: {error}", err=True)
    files |= {path.suffix[1:]: str(path) for path in map(out.joinpath, _PICTURES) if path.exists()}
    if force or not (out / _NUMBERS).exists():
        (out / _NUMBERS).write_text(json.dumps({**numbers, "files": files}, indent=2) + "\n")
    return files


def _draw(dataset: "xarray.Dataset", paths: list[Path]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from jaxkin.plot.maps import section

    figure = section(dataset).get_figure(root=True)
    assert figure is not None
    for path in paths:
        figure.savefig(path, dpi=200)
    plt.close("all")


def _summary(robot: "Mechanism", numbers: dict[str, Any]) -> str:
    grid = ", ".join(
        f"{axis} = {value[0]:g} .. {value[1]:g} ({value[2]})" if isinstance(value, list) else f"{axis} = {value:g}"
        for axis, value in numbers["grid"].items()
    )
    lines = [str(robot), f"{numbers['field']} over {grid}: {numbers['samples']:,} samples"]
    if "fractions" in numbers:
        lines += [f"  {n:>3} solutions  {share:10.4%}" for n, share in numbers["fractions"].items()]
        lines.append(f"  nearly double (undecided in float64): {numbers['nearly_double']}")
    else:
        lines.append(
            f"  defined on {numbers['defined']:.2%}"
            + "".join(f", {key} {numbers[key]:.6g}" for key in ("min", "mean", "max") if key in numbers)
        )
    lines += [f"  {kind}: {path}" for kind, path in numbers.get("files", {}).items()]
    return "\n".join(lines)
