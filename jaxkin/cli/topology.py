"""``jaxkin aspects`` and ``jaxkin regions``: what the workspace and a section of the joint space fall into."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.options import grid_of, robot_of, start_jax
from jaxkin.cli.results import check_out, result_command, robot_and_grid, show, timed, write

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Mechanism
    from jaxkin.mapping.aspects import Aspects
    from jaxkin.mapping.regions import Regions


@result_command("aspects")
@click.option("--clearance", type=float, default=0.0, help="Smallest singular value that a pose must have.")
def aspects_command(
    mechanism: str,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    out: Path | None,
    force: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
    clearance: float,
) -> None:
    """Find the aspects: the singularity-free domains of the workspace.

    \b
    jaxkin aspects rpr3-analytic --grid x=-3:3:128 --grid y=-3:3:128 --grid phi=-3.141592653589793:3.141592653589793:128
    jaxkin aspects rpr3 --limit rho1=10:32 --limit rho2=10:32 --limit rho3=10:32

    The grid is over the pose axes, and its numbers are the finest resolution: cells are split only where they must
    be. Without --grid and --fix the box follows from the joint limits (--limit); a mechanism whose limits do not bound
    its workspace is looked at where its catalogue entry says.

    In a folder that holds the result of the same command, only files that are missing are written; a folder that
    holds anything else is refused, unless --force is given.
    """
    check_out(out, "aspects", force)
    start_jax()
    robot = robot_of(mechanism, changes, limits)
    from jaxkin.mapping.aspects import aspects
    from jaxkin.mechanisms.catalogue import CATALOGUE
    from jaxkin.sweep.grid import Grid

    known = None if limits else Grid(**CATALOGUE[mechanism].study.poses)
    grid = grid_of(fixes, grids) if fixes or grids else known
    found, content = timed(lambda: aspects(robot, grid, clearance=clearance))
    if out is not None:

        def draw() -> Any:
            from jaxkin.plot.aspects import aspects as picture

            return picture(found)

        content["files"] = write(out, "aspects", content, _aspect_rows(robot, found), draw, force)
    show(robot, content, str(found), as_json)


def _aspect_rows(robot: "Mechanism", found: "Aspects") -> Iterator[list[Any]]:
    """Runs over the lines of aspects.csv: one an aspect, with its deepest pose."""
    yield [
        "aspect",
        "sign",
        "working_mode",
        "volume",
        "error",
        "clearance",
        "touches_edge",
        *found.pose_names,
        *(axis.name for axis in robot.joint_axes),
    ]
    for aspect in found:
        row = [aspect.name, aspect.sign, aspect.mode, aspect.volume, aspect.error, aspect.clearance]
        yield [*row, str(bool(aspect.touches_edge)).lower(), *map(float, aspect.pose), *map(float, aspect.joints)]


@result_command("regions")
def regions_command(
    mechanism: str,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    out: Path | None,
    force: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find the regions of a section of the joint space: constant numbers of solutions, areas, neighbours.

    \b
    jaxkin regions rpr3-analytic --fix rho2=1 --grid rho1=0:4:400 --grid rho3=0:4:400
    jaxkin regions rpr3 --fix rho1=14.98 --grid rho2=0:36:400 --grid rho3=0:36:400 --out regions

    Two axes take --grid, the others --fix: areas follow from the polished curves, and the numbers of samples only
    seed the search. Three axes with --grid give volumes.

    In a folder that holds the result of the same command, only files that are missing are written; a folder that
    holds anything else is refused, unless --force is given.
    """
    check_out(out, "regions", force)
    robot, grid = robot_and_grid(mechanism, changes, limits, fixes, grids)
    from jaxkin.mapping.regions import regions

    found, content = timed(lambda: regions(robot, grid))
    if out is not None:

        def draw() -> Any:
            from jaxkin.plot.regions import regions as picture

            return picture(found)

        content["files"] = write(out, "regions", content, _region_rows(found), draw, force)
    show(robot, content, str(found), as_json)


def _region_rows(found: "Regions") -> Iterator[list[Any]]:
    """Runs over the lines of regions.csv: one a region, with a point inside."""
    size = "volume" if any(getattr(region, "volume", None) is not None for region in found) else "area"
    yield ["region", "solutions", size, "error", *found.joint_names, "neighbours"]
    for region in found:
        neighbours = " ".join(str(number) for number in sorted({other for other, _ in region.neighbours}))
        measure = getattr(region, size)
        yield [region.name, region.n_solutions, measure, region.error, *map(float, region.interior), neighbours]
