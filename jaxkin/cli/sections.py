"""``jaxkin loci`` and ``jaxkin cusps``: what is singular over a section of the joint space."""

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
    grid_text,
    json_option,
    limit_option,
    robot_of,
    set_option,
    start_jax,
)
from jaxkin.core.errors import InputError, StoreError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from jaxkin.core.mechanism import Mechanism
    from jaxkin.mapping.records import Cusps, SingularCurves
    from jaxkin.sweep.grid import Grid

#: The numbers of solutions under the curves are sampled at most so often a side: no page shows more.
_MOST_SAMPLES = 2000


def _section_command(name: str) -> Callable[[Callable[..., None]], click.Command]:
    """Gives a command the arguments and options that every section has."""
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


@_section_command("loci")
@click.option("--closed-form", is_flag=True, help="Use closed forms: labelled, with virtual parts (rpr3-analytic).")
def loci_command(
    mechanism: str,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    out: Path | None,
    force: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
    closed_form: bool,
) -> None:
    """Find the singular curves of a section of the joint space.

    \b
    jaxkin loci rpr3-analytic --fix rho2=1 --grid rho1=0:4:400 --grid rho3=0:4:400 --out loci
    jaxkin loci rpr3 --fix rho1=14.98 --grid rho2=0:36:400 --grid rho3=0:36:400

    Two axes take --grid, the others --fix. The ends of the axes bound the curves; the numbers of samples only seed
    the search, and sample the picture's numbers of solutions.

    In a folder that holds the result of the same command, only files that are missing are written; a folder that
    holds anything else is refused, unless --force is given.
    """
    _check_out(out, "loci", force)
    robot, grid = _start(mechanism, changes, limits, fixes, grids)
    if closed_form and not hasattr(robot, "closed_form_curves"):
        raise InputError(f"{mechanism} has no closed forms of its singular curves: leave out --closed-form.")
    from jaxkin.mapping.loci import singular_curves
    from jaxkin.mapping.records import coordinates

    start = time.perf_counter()
    curves = singular_curves(robot, grid, method="closed form" if closed_form else "trace")
    content = _content(curves, time.perf_counter() - start)
    if out is not None:
        content["files"] = _write(
            out, "loci", content, _points(curves), lambda: _picture(robot, grid, curves=curves), force
        )
    crossings = [f"  crossing: {coordinates(curves.joint_names, at)}" for at in curves.crossings.joints]
    _print(robot, content, "\n".join([str(curves), *crossings]), as_json)


@_section_command("cusps")
def cusps_command(
    mechanism: str,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    out: Path | None,
    force: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find the cusps of a section of the joint space: points where three assembly modes meet.

    \b
    jaxkin cusps rpr3-analytic --fix rho2=1 --grid rho1=0:4:400 --grid rho3=0:4:400
    jaxkin cusps rpr3 --fix rho1=14.98 --grid rho2=0:36:400 --grid rho3=0:36:400 --out cusps

    Two axes take --grid, the others --fix. Cusps are counted once per joint point, and listed with all their poses;
    crossings and worse points, which are no cusps, are named. The numbers of samples only seed the
    search, and sample the picture's numbers of solutions.

    In a folder that holds the result of the same command, only files that are missing are written; a folder that
    holds anything else is refused, unless --force is given.
    """
    _check_out(out, "cusps", force)
    robot, grid = _start(mechanism, changes, limits, fixes, grids)
    from jaxkin.mapping.cusps import cusps
    from jaxkin.mapping.loci import singular_curves

    start = time.perf_counter()
    found = cusps(robot, grid)
    content = _content(found, time.perf_counter() - start)
    if out is not None:
        content["files"] = _write(
            out,
            "cusps",
            content,
            _cusp_poses(found),
            lambda: _picture(robot, grid, curves=singular_curves(robot, grid), cusps=found),
            force,
        )
    _print(robot, content, str(found), as_json)


def _check_out(out: Path | None, name: str, force: bool) -> None:
    if out is not None:
        check_folder(out, f"{name}.json", force)


def _start(
    mechanism: str, changes: tuple[str, ...], limits: tuple[str, ...], fixes: tuple[str, ...], grids: tuple[str, ...]
) -> tuple["Mechanism", "Grid"]:
    start_jax()
    return robot_of(mechanism, changes, limits), grid_of(fixes, grids)


def _content(result: "SingularCurves | Cusps", seconds: float) -> dict[str, Any]:
    from jaxkin.core.provenance import run_log

    return {**json.loads(result.to_json()), "run_log": run_log(seconds=round(seconds, 3))}


def _points(curves: "SingularCurves") -> Iterator[list[Any]]:
    """Runs over the lines of loci.csv: one a point; the poses of virtual curves are empty."""
    yield ["curve", "label", "virtual", *curves.joint_names, *curves.pose_names]
    for number, curve in enumerate(curves):
        empty = [None] * len(curves.pose_names)
        for joints, pose in zip(curve.joints.tolist(), curve.poses.tolist(), strict=True):
            yield [number, curve.label, str(curve.virtual).lower(), *joints, *(empty if curve.virtual else pose)]


def _cusp_poses(found: "Cusps") -> Iterator[list[Any]]:
    """Runs over the lines of cusps.csv: one a triple pose."""
    yield ["cusp", *found.joint_names, *found.pose_names, "error", "residual", "third_coefficient"]
    measures = zip(found.error.tolist(), found.residual.tolist(), found.third.tolist(), strict=True)
    for number, (joints, poses, rest) in enumerate(zip(found.joints.tolist(), found.poses, measures, strict=True)):
        for pose in poses.tolist():
            yield [number, *joints, *pose, *rest]


def _picture(robot: "Mechanism", grid: "Grid", **layers: Any) -> "Axes":
    """Draws curves and cusps over the numbers of solutions."""
    from jaxkin.plot.maps import section
    from jaxkin.sweep.engine import sweep
    from jaxkin.sweep.grid import Grid, Span

    axes = {
        name: (value.low, value.high, min(value.count, _MOST_SAMPLES)) if isinstance(value, Span) else value
        for name, value in grid.axes.items()
    }
    return section(sweep(robot, "forward_count", Grid(**axes)), **layers)


def _write(
    out: Path, name: str, content: dict[str, Any], lines: Iterator[list[Any]], draw: Callable[[], "Axes"], force: bool
) -> dict[str, str]:
    """Writes the files that are missing (all, with --force); tells where each is.

    Raises:
        StoreError: The folder holds the result of another request.
    """
    numbers, table, *shown = (out / f"{name}.{suffix}" for suffix in ("json", "csv", "png", "pdf"))
    if numbers.exists() and not force:
        _check_request(numbers, content["request"])
    shown_missing = [path for path in shown if force or not path.exists()]
    contents = pictures(shown_missing, draw) if shown_missing else {}
    if force or not table.exists():
        contents[table] = csv_text(next(lines), lines).encode()
    if force or not numbers.exists():
        contents[numbers] = (json.dumps(content, indent=2) + "\n").encode()  # The last, as it vouches for the others.
    out.mkdir(parents=True, exist_ok=True)
    write_files(contents)
    return {"numbers": str(numbers), "table": str(table), **{path.suffix[1:]: str(path) for path in shown}}


def _check_request(path: Path, request: dict[str, Any]) -> None:
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


def _print(robot: "Mechanism", content: dict[str, Any], summary: str, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(content, indent=2))
        return
    files = [f"  {kind}: {path}" for kind, path in content.get("files", {}).items()]
    click.echo("\n".join([str(robot), f"section {grid_text(content['request']['section'])}", summary, *files]))
