"""What the commands share that compute one result: their options, and the files that they leave in a folder."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.folder import check_folder, csv_text, pictures, write_files
from jaxkin.cli.options import (
    fix_option,
    grid_of,
    grid_option,
    json_option,
    limit_option,
    robot_of,
    set_option,
    start_jax,
)
from jaxkin.core.errors import StoreError
from jaxkin.sweep.units import grid_text

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Mechanism
    from jaxkin.sweep.grid import Grid


def result_command(name: str) -> Callable[[Callable[..., None]], click.Command]:
    """Gives a command the arguments and options of every command that computes one result over a grid."""
    out_help = "Folder for the numbers (JSON), the points (CSV) and the picture (PNG, PDF)."
    decorators = (
        click.command(name),
        click.argument("mechanism"),
        fix_option,
        grid_option,
        click.option("--out", type=Path, help=out_help),
        click.option("--force", is_flag=True, help="Replace this command's files; others in the folder stay."),
        set_option,
        limit_option,
        json_option,
    )

    def decorate(function: Callable[..., None]) -> click.Command:
        command: Any = function
        for decorator in reversed(decorators):
            command = decorator(command)
        return command

    return decorate


def check_out(out: Path | None, name: str, force: bool) -> None:
    """Refuses a folder that holds anything but this command's result."""
    if out is not None:
        check_folder(out, f"{name}.json", force)


def robot_and_grid(
    mechanism: str, changes: tuple[str, ...], limits: tuple[str, ...], fixes: tuple[str, ...], grids: tuple[str, ...]
) -> tuple["Mechanism", "Grid"]:
    """Starts JAX, and makes what the command line names."""
    start_jax()
    return robot_of(mechanism, changes, limits), grid_of(fixes, grids)


def timed(compute: Callable[[], Any]) -> tuple[Any, dict[str, Any]]:
    """Computes a result; returns it, and its content for JSON with the log of the run."""
    from jaxkin.core.provenance import run_log

    begin = time.perf_counter()
    result = compute()
    seconds = round(time.perf_counter() - begin, 3)
    return result, {**json.loads(result.to_json()), "run_log": run_log(seconds=seconds)}


def write(
    out: Path,
    name: str,
    content: dict[str, Any],
    lines: Iterator[list[Any]],
    draw: Callable[[], Any] | None,
    force: bool,
) -> dict[str, str]:
    """Writes the files that are missing (all, with --force), pictures where there is one; tells where each is.

    Raises:
        StoreError: The folder holds the result of another request.
    """
    numbers, table, *shown = (out / f"{name}.{suffix}" for suffix in ("json", "csv", "png", "pdf"))
    if numbers.exists() and not force:
        check_request(numbers, content["request"])
    shown = shown if draw is not None else []
    shown_missing = [path for path in shown if force or not path.exists()]
    contents = pictures(shown_missing, draw) if draw is not None and shown_missing else {}
    if force or not table.exists():
        contents[table] = csv_text(next(lines), lines).encode()
    if force or not numbers.exists():
        contents[numbers] = (json.dumps(content, indent=2) + "\n").encode()  # The last, as it vouches for the others.
    out.mkdir(parents=True, exist_ok=True)
    write_files(contents)
    return {"numbers": str(numbers), "table": str(table), **{path.suffix[1:]: str(path) for path in shown}}


def check_request(path: Path, request: dict[str, Any]) -> None:
    """Refuses a file that holds the result of another request.

    Raises:
        StoreError: It does, or it is no result.
    """
    from jaxkin.core.provenance import Request

    try:
        there = dict(json.loads(path.read_text(encoding="utf-8"))["request"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StoreError(
            f"{path} exists and cannot be read as a result: choose another folder, or replace it with --force."
        ) from error
    if there != json.loads(Request(request).text):
        raise StoreError(
            f"{path} was made by another request ({Request(request).difference(there)}): choose another folder, or "
            "replace it with --force."
        )


def show(robot: "Mechanism", content: dict[str, Any], summary: str, as_json: bool) -> None:
    """Prints a result: as JSON, or robot, space, summary and files."""
    if as_json:
        click.echo(json.dumps(content, indent=2))
        return
    request = content["request"]
    spaces = [f"{kind} {grid_text(request[kind])}" for kind in ("section", "box", "grid") if kind in request]
    files = [f"  {kind}: {path}" for kind, path in content.get("files", {}).items()]
    click.echo("\n".join([str(robot), *spaces, summary, *files]))
