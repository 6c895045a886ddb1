"""``jaxkin atlas``: what designs do, over the numbers of their geometry."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

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
from jaxkin.core.errors import InputError
from jaxkin.core.words import spoken

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Mechanism
    from jaxkin.sweep.fields import Field

#: What messages about a section call its axes.
_SECTION_WORDS = {
    "Grid()": "--section",
    "(low, high, n)": "--section AXIS=LOW:HIGH:N",
    "a number to fix it": "--section AXIS=VALUE",
    "one number": "--section AXIS=VALUE",
}


@click.command("atlas")
@click.argument("mechanism")
@click.option("--field", type=click.Choice(["cusps", "volume"]), required=True, help="What to map.")
@click.option(
    "--section",
    "sections",
    multiple=True,
    metavar="AXIS=VALUE|LOW:HIGH:N",
    help="Joints of the section whose cusps are counted.",
)
@click.option("--branch", type=click.Choice(["upper", "lower"]), help="Branch of the volume; upper by default.")
@fix_option
@grid_option
@dense_options("atlas")
@set_option
@limit_option
@json_option
def atlas_command(
    mechanism: str,
    field: str,
    sections: tuple[str, ...],
    branch: str | None,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    out: Path | None,
    store: Path | None,
    resume: bool,
    force: bool,
    workers: int | None,
    scheduler: str | None,
    dry_run: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
) -> None:
    """Map what designs do over the numbers of their geometry.

    \b
    jaxkin atlas rpr3-analytic --field cusps --grid c3=-1:1:21 --grid d3=0.5:1.5:11
      --section rho2=1 --section rho1=0:4:400 --section rho3=0:4:400 --out atlas
    jaxkin atlas tlpm --field volume --grid base_radius=500:700:41 --grid initial_lengths=750:900:41 --out atlas

    --grid and --fix name numbers of the geometry, entries of vectors as proximal[0], limits as rho1_low; those that are
    not named stay as they are, or as --set makes them. The number of cusps is computed one design at a time, at some
    0.2 s each, the volume many at once.

    The same command again goes on where it stopped, and overwrites nothing. 'jaxkin info' and 'jaxkin verify' tell what
    a store holds.
    """
    _check_options(field, sections, branch)
    files = Files("atlas", out, store, resume, force)
    files.check_out()
    files.check_resume()
    check_dry_run(dry_run, scheduler)
    start_jax()
    robot = robot_of(mechanism, changes, limits)
    chosen, grid = _field(robot, field, sections, branch), grid_of(fixes, grids)
    run_dense(robot, chosen, grid, files, dry_run=dry_run, scheduler=scheduler, workers=workers, as_json=as_json)


def _check_options(field: str, sections: tuple[str, ...], branch: str | None) -> None:
    """Refuses options that belong to another field, and a number of cusps without a section."""
    if field == "cusps" and not sections:
        raise InputError(
            "--field cusps counts the cusps of a section, and none is given: add --section AXIS=VALUE or "
            "--section AXIS=LOW:HIGH:N for every joint."
        )
    for option, given, owner in (("--section", sections, "cusps"), ("--branch", branch, "volume")):
        if given and field != owner:
            raise InputError(f"{option} is given, which belongs to --field {owner}: leave it out.")


def _field(robot: "Mechanism", field: str, sections: tuple[str, ...], branch: str | None) -> "Field":
    from jaxkin.design import atlas

    if field == "volume":
        return atlas.workspace_volume(branch or "upper")
    free = tuple(item for item in sections if ":" in item)
    fixed = tuple(item for item in sections if item not in free)
    with spoken(_SECTION_WORDS):
        chosen = atlas.number_of_cusps(grid_of(fixed, free, "--section", "--section"))
        chosen.variables(robot)  # Says what is wrong with the section while its words are those of --section.
    return chosen
