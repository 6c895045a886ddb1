"""``jaxkin map``: a field over a grid, as a picture, as labelled data and as numbers."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.folder import check_folder, pictures, write_files
from jaxkin.cli.options import (
    fix_option,
    grid_of,
    grid_option,
    grid_text,
    json_option,
    limit_option,
    robot_of,
    set_option,
    start_jax,
)
from jaxkin.core.errors import InputError, StoreError

if TYPE_CHECKING:
    import xarray

    from jaxkin.core.mechanism import Mechanism

_DATA, _NUMBERS = "map.zarr", "map.json"
_PICTURES = ("map.png", "map.pdf")


@click.command("map")
@click.argument("mechanism")
@click.option("--field", default="forward_count", show_default=True, help="What to map.")
@fix_option
@grid_option
@click.option("--out", type=Path, help="Folder for the picture, the data (Zarr) and the numbers (JSON).")
@click.option("--force", is_flag=True, help="Replace what is there and start anew.")
@click.option("--workers", type=click.IntRange(min=1), help="Threads; all cores by default.")
@set_option
@limit_option
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
    limits: tuple[str, ...],
    as_json: bool,
) -> None:
    """Map a field over a grid.

    \b
    jaxkin map rpr3-analytic --fix rho2=1 --grid rho1=0:4:2000 --grid rho3=0:4:2000 --out map

    The same command again goes on where it stopped, and overwrites nothing.
    """
    if out is not None:
        check_folder(out, _DATA, force)
    start_jax()
    from jaxkin.sweep.engine import sweep
    from jaxkin.sweep.fields import by_name

    robot = robot_of(mechanism, changes, limits)
    chosen, grid = by_name(field), grid_of(fixes, grids)
    store = None if out is None else out / _DATA
    dataset = sweep(robot, chosen, grid, store=store, overwrite=force, workers=workers)
    numbers = _numbers(robot, dataset)
    if out is not None:
        numbers["files"] = _write(dataset, numbers, out, force)
    click.echo(json.dumps(numbers, indent=2) if as_json else _summary(robot, numbers))


def _numbers(robot: "Mechanism", dataset: "xarray.Dataset") -> dict[str, Any]:
    request = json.loads(dataset.attrs["request"])
    name = dataset.attrs["field"]
    main = dataset[name]
    samples = math.prod(len(dataset[axis]) for axis in request["grid"] if axis in dataset.sizes)
    numbers: dict[str, Any] = {
        "mechanism": request["mechanism"],
        "geometry": request["geometry"],
        "field": name,
        "unit": main.attrs["units"],
        "grid": request["grid"],
        "axis_units": {axis: dataset[axis].attrs["units"] for axis in request["grid"]},
        "samples": samples,
        "complete": bool(dataset.attrs["complete"]),
    }
    try:
        numbers |= _statistics(dataset, name, samples)
    except Exception as error:  # Whatever Zarr meets in a damaged chunk.
        raise StoreError(
            f"The data of {name!r} cannot be read ({error}): it is damaged; replace it with --force."
        ) from error
    return {**numbers, "request_hash": dataset.attrs["request_hash"], "run_log": json.loads(dataset.attrs["run_log"])}


def _statistics(dataset: "xarray.Dataset", name: str, samples: int) -> dict[str, Any]:
    """Counts, or the range of a scalar, slab by slab so that a map larger than the memory can be summed up."""
    import numpy as np

    main = dataset[name]
    if name == "forward_count":
        counts, undecided = np.zeros(256, np.int64), 0
        for slab in _slabs(main.shape):
            counts += np.bincount(np.asarray(main[slab]).ravel().view(np.uint8), minlength=256)
            undecided += int(np.asarray(dataset[f"{name}_nearly_double"][slab]).sum())
        found = {str(n): int(counts[n]) for n in np.flatnonzero(counts)}
        fractions = {n: count / samples for n, count in found.items()}
        return {"fractions": fractions, "counts": found, "nearly_double": undecided}
    if "flag_meanings" in main.attrs and main.ndim and main.dims[0] in json.loads(dataset.attrs["request"])["grid"]:
        return _shares(main, samples)
    if any(dim not in json.loads(dataset.attrs["request"])["grid"] for dim in main.dims):
        return {}  # Branches and limits mix quantities; one range over them would mean nothing.
    values = np.asarray(main)
    defined = values[~np.isnan(values)]
    statistics: dict[str, Any] = {"defined": defined.size / values.size}
    if defined.size:
        statistics |= {"min": float(defined.min()), "mean": float(defined.mean()), "max": float(defined.max())}
    return statistics


def _shares(main: "xarray.DataArray", samples: int) -> dict[str, Any]:
    """Returns the share of every category that occurs, by name."""
    import numpy as np

    counts = np.zeros(256, np.int64)
    for slab in _slabs(main.shape):
        counts += np.bincount(np.asarray(main[slab]).ravel().view(np.uint8), minlength=256)
    values, names = np.atleast_1d(main.attrs["flag_values"]), main.attrs["flag_meanings"].split()
    shares = {name: int(counts[value]) / samples for value, name in zip(values, names, strict=True) if counts[value]}
    return {"shares": dict(sorted(shares.items(), key=lambda entry: -entry[1])), "none": int(counts[255]) / samples}


def _slabs(shape: tuple[int, ...]) -> list[slice]:
    """Cuts the first axis so that a slab has some million samples."""
    rows = max(1, (1 << 24) // max(1, math.prod(shape[1:])))
    return [slice(start, start + rows) for start in range(0, shape[0], rows)]


def _write(dataset: "xarray.Dataset", numbers: dict[str, Any], out: Path, force: bool) -> dict[str, str]:
    """Writes the files that are missing or of another request (all, with --force); tells where each is."""
    force = force or _request_of(out / _NUMBERS) != numbers["request_hash"]
    files = {"data": str(out / _DATA), "numbers": str(out / _NUMBERS)}
    missing = [out / name for name in _PICTURES if force or not (out / name).exists()]
    if missing:
        try:
            write_files(_draw(dataset, missing))
        except InputError as error:  # Three free axes, or branches: data without a picture.
            click.echo(f"jaxkin: no picture: {error}", err=True)
    files |= {path.suffix[1:]: str(path) for path in map(out.joinpath, _PICTURES) if path.exists()}
    if force or not (out / _NUMBERS).exists():
        text = json.dumps({**numbers, "files": files}, indent=2) + "\n"
        write_files({out / _NUMBERS: text.encode()})
    return files


def _request_of(path: Path) -> str | None:
    """Returns the request that a file of numbers belongs to; it is written last, so it vouches for the pictures."""
    try:
        return json.loads(path.read_text())["request_hash"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _draw(dataset: "xarray.Dataset", paths: list[Path]) -> dict[Path, bytes]:
    from jaxkin.plot.maps import section

    return pictures(paths, lambda: section(dataset))


def _summary(robot: "Mechanism", numbers: dict[str, Any]) -> str:
    lines = [str(robot), f"{numbers['field']} over {grid_text(numbers['grid'])}: {numbers['samples']:,} samples"]
    if not numbers["complete"]:
        lines.append("  incomplete: run the same command again")
    if "fractions" in numbers:
        lines += [f"  {n:>3} solutions  {share:10.4%}" for n, share in numbers["fractions"].items()]
        lines.append(f"  nearly double (undecided in float64): {numbers['nearly_double']}")
    elif "shares" in numbers:
        lines += [f"  {name:24}{share:10.4%}" for name, share in numbers["shares"].items()]
        lines.append(f"  {'(none)':24}{numbers['none']:10.4%}")
    elif "defined" in numbers:
        lines.append(
            f"  defined on {numbers['defined']:.2%}"
            + "".join(f", {key} {numbers[key]:.6g}" for key in ("min", "mean", "max") if key in numbers)
        )
    lines += [f"  {kind}: {path}" for kind, path in numbers.get("files", {}).items()]
    return "\n".join(lines)
