"""``jaxkin map``: a field over a grid, as a picture, as labelled data and as numbers."""

from pathlib import Path
from typing import Any

import click

from jaxkin.cli.cells import adaptive_options, check_adaptive, check_cells_folder, map_cells
from jaxkin.cli.dense import Files, check_dry_run, dense_options, run_dense
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


@click.command("map")
@click.argument("mechanism")
@click.option("--field", default="forward_count", show_default=True, help="What to map.")
@fix_option
@grid_option
@dense_options("map")
@click.option("--float32", is_flag=True, help="Compute and store in float32, and say how far off that is.")
@adaptive_options
@set_option
@limit_option
@json_option
def map_command(
    mechanism: str,
    field: str,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    out: Path | None,
    store: Path | None,
    resume: bool,
    force: bool,
    workers: int | None,
    scheduler: str | None,
    float32: bool,
    dry_run: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
    adaptive: bool,
    **refining: Any,
) -> None:
    """Map a field over a grid.

    \b
    jaxkin map rpr3-analytic --fix rho2=1 --grid rho1=0:4:2000 --grid rho3=0:4:2000 --out map

    The same command again goes on where it stopped, and overwrites nothing. 'jaxkin info' and 'jaxkin verify' tell what
    a store holds.

    With --adaptive the data is cells in which the field is constant; they are computed in memory, anew by the same
    command again, and written into the folder of --out, where the files are named cells instead of map.
    """
    alone = {"--store": store, "--resume": resume, "--scheduler": scheduler, "--float32": float32, "--dry-run": dry_run}
    check_adaptive(adaptive, refining, alone)
    files = Files("map", out, store, resume, force)
    if adaptive:
        check_cells_folder(out, force)
    else:
        files.check_out()
    files.check_resume()
    check_dry_run(dry_run, scheduler)
    start_jax()
    from jaxkin.sweep.fields import by_name

    robot = robot_of(mechanism, changes, limits)
    chosen, grid = by_name(field), grid_of(fixes, grids)
    if adaptive:
        map_cells(robot, chosen, grid, refining, workers, out, force, as_json)
        return
    precision = "float32" if float32 else "float64"
    run_dense(
        robot,
        chosen,
        grid,
        files,
        dry_run=dry_run,
        scheduler=scheduler,
        workers=workers,
        as_json=as_json,
        precision=precision,
    )
