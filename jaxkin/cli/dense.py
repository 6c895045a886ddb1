"""What ``map`` and ``atlas`` share: a dense sweep as a picture, as labelled data and as numbers."""

import contextlib
import json
import math
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.folder import check_folder, pictures, request_of, write_files
from jaxkin.core.errors import ClusterError, InputError, StoreError
from jaxkin.sweep.units import counted, grid_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    import xarray

    from jaxkin.core.mechanism import Mechanism
    from jaxkin.sweep.fields import Field
    from jaxkin.sweep.grid import Grid

#: Samples that are summed up at once where the data says nothing better.
_PIECE = 1 << 24
_SECONDS_TO_CONNECT = 10
#: Attributes of a sweep that was computed one design at a time.
_DESIGNS = ("untraced", "refused_designs", "first_refusal")


def dense_options(stem: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Gives a command the options that say where a sweep is computed, and where its result goes."""
    decorators = (
        click.option("--out", type=Path, help="Folder for the picture, the data (Zarr) and the numbers (JSON)."),
        click.option(
            "--store", type=Path, help=f"Where the data (Zarr) goes; by default {stem}.zarr in the folder of --out."
        ),
        click.option("--resume", is_flag=True, help="Insist that there is something to go on with."),
        click.option("--force", is_flag=True, help="Replace what is there and start anew."),
        click.option("--workers", type=click.IntRange(min=1), help="Threads; all cores by default."),
        click.option(
            "--scheduler", metavar="ADDRESS", help="Compute on the workers of a dask scheduler, tcp://HOST:PORT."
        ),
        click.option("--dry-run", is_flag=True, help="Say what it would take: samples, memory, bytes and time."),
    )

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return decorate


@dataclass(frozen=True)
class Files:
    """Where the result of a dense sweep goes.

    Attributes:
        stem: Name of the command, and of its files in the folder.
        out: The folder of --out.
        store: The store of --store.
        resume: Whether --resume is given.
        force: Whether --force is given.
    """

    stem: str
    out: Path | None
    store: Path | None
    resume: bool
    force: bool

    @property
    def data(self) -> Path | None:
        """The store, None where the data stays in memory."""
        return self.store or (None if self.out is None else self.out / f"{self.stem}.zarr")

    @property
    def numbers(self) -> str:
        """Name of the file of numbers."""
        return f"{self.stem}.json"

    @property
    def pictures(self) -> tuple[str, ...]:
        """Names of the pictures."""
        return f"{self.stem}.png", f"{self.stem}.pdf"

    def check_out(self) -> None:
        """Refuses a folder that cannot be used, or holds anything but this command's files."""
        if self.out is not None:
            # With the data elsewhere, any file of an earlier run tells that the folder is the command's own.
            files = (self.numbers, *self.pictures)
            own = [f"{self.stem}.zarr"] if self.store is None else [n for n in files if (self.out / n).exists()]
            check_folder(self.out, (own or [self.numbers])[0], self.force)

    def check_resume(self) -> None:
        """Refuses to resume what is not there, or what --force would replace."""
        if self.resume and self.force:
            raise InputError("--resume goes on with what is there and --force replaces it: leave one of the two out.")
        if self.resume and (self.data is None or not (self.data / "zarr.json").exists()):
            place = "no --store and no --out is given" if self.data is None else f"there is no store {str(self.data)!r}"
            raise InputError(f"--resume has nothing to go on with, as {place}: leave it out to start anew.")

    def write(self, dataset: "xarray.Dataset", numbers: dict[str, Any]) -> dict[str, str]:
        """Writes the files that are missing or of another request (all, with --force); tells where each is."""
        out = self.out
        assert out is not None
        out.mkdir(parents=True, exist_ok=True)
        force = self.force or request_of(out / self.numbers) != numbers["request_hash"]
        files = {"numbers": str(out / self.numbers)}
        missing = [out / name for name in self.pictures if force or not (out / name).exists()]
        if missing:
            try:
                write_files(_draw(dataset, missing))
            except InputError as error:  # Three free axes, or branches: data without a picture.
                click.echo(f"jaxkin: no picture: {error}", err=True)
        files |= {path.suffix[1:]: str(path) for path in map(out.joinpath, self.pictures) if path.exists()}
        if force or not (out / self.numbers).exists():
            text = json.dumps({**numbers, "files": numbers["files"] | files}, indent=2) + "\n"
            write_files({out / self.numbers: text.encode()})
        return files


def check_dry_run(dry_run: bool, scheduler: str | None) -> None:
    """Refuses to predict what another machine does."""
    if dry_run and scheduler is not None:
        raise InputError("--dry-run predicts the sweep of this machine: leave --scheduler out.")


def run_dense(
    robot: "Mechanism",
    field: "Field",
    grid: "Grid",
    files: Files,
    *,
    dry_run: bool,
    scheduler: str | None,
    workers: int | None,
    as_json: bool,
    precision: str = "float64",
) -> None:
    """Sweeps, writes what is asked for, and prints the numbers; or says what it would take."""
    from jaxkin.sweep.engine import sweep

    options: dict[str, Any] = {"precision": precision, "overwrite": files.force, "workers": workers}
    where = files.data
    if dry_run:
        _foretell(robot, field, grid, {**options, "store": False if where is None else where}, as_json)
        return
    with _cluster(scheduler) as executor:
        dataset = sweep(robot, field, grid, store=where, executor=executor, **options)
    numbers = _numbers(dataset)
    if where is not None:
        numbers["files"] = {"data": str(where)}
    if files.out is not None:
        numbers["files"] |= files.write(dataset, numbers)
    click.echo(json.dumps(numbers, indent=2) if as_json else _summary(robot, numbers))


def _foretell(robot: "Mechanism", field: "Field", grid: "Grid", options: dict[str, Any], as_json: bool) -> None:
    from dataclasses import asdict

    from jaxkin.sweep.forecast import forecast

    found = forecast(robot, field, grid, **options)
    click.echo(json.dumps({**asdict(found), "seconds": found.seconds}, indent=2) if as_json else str(found))


@contextlib.contextmanager
def _cluster(address: str | None) -> "Iterator[Any]":
    """Connects to a scheduler, and lets go of it."""
    if address is None:
        yield None
        return
    try:
        import distributed
    except ImportError:
        raise ClusterError("--scheduler needs dask.distributed: pip install 'jaxkin[scale]'.") from None
    import logging

    # What is lost is told in one sentence, not by every part of the client.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    connecting: Future[Any] = Future()

    def connect() -> None:
        try:
            connecting.set_result(distributed.Client(address, timeout=_SECONDS_TO_CONNECT))
        except BaseException as error:
            connecting.set_exception(error)

    # In a thread, as a port where something else listens is waited for without end.
    threading.Thread(target=connect, daemon=True).start()
    try:
        client = connecting.result(2 * _SECONDS_TO_CONNECT)
    except Exception as error:  # Whatever the addresses that people write meet: many types, one answer.
        raise ClusterError(
            f"--scheduler is {address!r}, where no scheduler answers: start one with 'dask scheduler', and give the "
            "address that it prints, tcp://HOST:PORT."
        ) from error
    with client:
        yield client


def _numbers(dataset: "xarray.Dataset") -> dict[str, Any]:
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
            f"The data of {name!r} cannot be read, as it is damaged: run the same command again, which computes anew "
            "what is damaged."
        ) from error
    numbers |= {name: dataset.attrs[name] for name in _DESIGNS if name in dataset.attrs}
    if "float32_error" in dataset.attrs:
        numbers["float32_error"] = json.loads(dataset.attrs["float32_error"])
    return {**numbers, "request_hash": dataset.attrs["request_hash"], "run_log": json.loads(dataset.attrs["run_log"])}


def _statistics(dataset: "xarray.Dataset", name: str, samples: int) -> dict[str, Any]:
    """Counts, or the range of a scalar, slab by slab so that a map larger than the memory can be summed up."""
    import numpy as np

    main = dataset[name]
    if name == "forward_count":
        counts, undecided = _histogram(main), 0
        for piece in _pieces(main):
            undecided += int(np.asarray(dataset[f"{name}_nearly_double"][piece]).sum())
        found = {str(n): int(counts[n]) for n in np.flatnonzero(counts)}
        fractions = {n: count / samples for n, count in found.items()}
        return {"fractions": fractions, "counts": found, "nearly_double": undecided}
    if "flag_meanings" in main.attrs and main.ndim and main.dims[0] in json.loads(dataset.attrs["request"])["grid"]:
        return _shares(main, samples)
    if any(dim not in json.loads(dataset.attrs["request"])["grid"] for dim in main.dims):
        return {}  # Branches and limits mix quantities; one range over them would mean nothing.
    if main.dtype.kind in "iu" and main.dtype.itemsize == 1:
        return _tally(main, samples)
    low, high, total, number = np.inf, -np.inf, 0.0, 0
    for piece in _pieces(main):
        values = np.asarray(main[piece], float)
        defined = values[~np.isnan(values)]
        low, high = defined.min(initial=low), defined.max(initial=high)
        total, number = total + float(defined.sum()), number + defined.size
    statistics: dict[str, Any] = {"defined": number / main.size}
    if number:
        statistics |= {"min": float(low), "mean": total / number, "max": float(high)}
    return statistics


def _tally(main: "xarray.DataArray", samples: int) -> dict[str, Any]:
    """Returns the share of every number that occurs, and of samples without one."""
    counts, missing = _histogram(main), int(main.attrs.get("not_computed", -1)) % 256
    found = {str(n): int(counts[n]) for n in counts.nonzero()[0] if n != missing}
    shares = {n: count / samples for n, count in found.items()}
    return {"fractions": shares, "counts": found, "none": int(counts[missing]) / samples}


def _shares(main: "xarray.DataArray", samples: int) -> dict[str, Any]:
    """Returns the share of every category that occurs, by name."""
    import numpy as np

    counts = _histogram(main)
    values, names = np.atleast_1d(main.attrs["flag_values"]), main.attrs["flag_meanings"].split()
    shares = {name: int(counts[value]) / samples for value, name in zip(values, names, strict=True) if counts[value]}
    return {"shares": dict(sorted(shares.items(), key=lambda entry: -entry[1])), "none": int(counts[255]) / samples}


def _histogram(main: "xarray.DataArray") -> "np.ndarray":
    """Counts every value of a byte."""
    import numpy as np

    counts = np.zeros(256, np.int64)
    for piece in _pieces(main):
        values = np.asarray(main[piece]).view(np.uint8)
        left = values.size
        # Few values occur, mostly the first: comparing bytes is faster than np.bincount, which widens them.
        for value in (*range(8), 255, *range(8, 255)):
            if not left:
                break
            found = np.count_nonzero(values == value)
            counts[value] += found
            left -= found
    return counts


def _pieces(main: "xarray.DataArray") -> "Iterator[tuple[slice, ...]]":
    """Cuts an array along the tiles of its store, or into rows of some million samples."""
    from jaxkin.sweep.plan import boxes

    rows = max(1, _PIECE // max(1, math.prod(main.shape[1:])))
    step = main.encoding.get("shards") or (rows, *main.shape[1:])
    return boxes(main.shape, tuple(step), (0,) * main.ndim)


def _draw(dataset: "xarray.Dataset", paths: list[Path]) -> dict[Path, bytes]:
    from jaxkin.plot.maps import section

    return pictures(paths, lambda: section(dataset))


def _summary(robot: "Mechanism", numbers: dict[str, Any]) -> str:
    lines = [str(robot), f"{numbers['field']} over {grid_text(numbers['grid'])}: {numbers['samples']:,} samples"]
    if not numbers["complete"]:
        lines.append("  incomplete: run the same command again")
    if "fractions" in numbers and "none" in numbers:
        lines += [f"  {n:>3}  {share:10.4%}" for n, share in numbers["fractions"].items()]
        lines += [f"  (no value) {numbers['none']:.4%}"] if numbers["none"] else []
    elif "fractions" in numbers:
        lines += [
            f"  {n:>3} {'solution ' if n == '1' else 'solutions'}  {share:10.4%}"
            for n, share in numbers["fractions"].items()
        ]
        lines.append(f"  nearly double (undecided in float64): {numbers['nearly_double']}")
    elif "shares" in numbers:
        lines += [f"  {name:24}{share:10.4%}" for name, share in numbers["shares"].items()]
        lines.append(f"  {'(none)':24}{numbers['none']:10.4%}")
    elif "defined" in numbers:
        lines.append(
            f"  defined on {numbers['defined']:.2%}"
            + "".join(f", {key} {numbers[key]:.6g}" for key in ("min", "mean", "max") if key in numbers)
        )
    if "untraced" in numbers:
        lines.append(f"  {numbers['untraced']}, {counted(numbers['refused_designs'], 'design')} refused")
        lines += [f"  first refusal: {numbers['first_refusal']}"] if "first_refusal" in numbers else []
    again = numbers["run_log"].get("recomputed_tiles", [])
    if again:
        lines.append(f"  tiles found damaged and computed again: {len(again)}")
    for name, error in numbers.get("float32_error", {}).items():
        if isinstance(error, dict) and "largest_absolute" in error:
            largest, share = error["largest_absolute"], error["largest_relative"]
            lines.append(f"  float32, {name}: off by at most {largest:.2g}, {share:.2g} of the largest")
    lines += [f"  {kind}: {path}" for kind, path in numbers.get("files", {}).items()]
    return "\n".join(lines)
