"""``jaxkin analyse``: everything about one mechanism, in one folder."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.folder import check_report_folder, write_files
from jaxkin.cli.options import (
    fix_option,
    grid_of,
    grid_option,
    json_option,
    limit_option,
    number,
    robot_of,
    set_option,
    start_jax,
)
from jaxkin.core.errors import InputError

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Mechanism
    from jaxkin.mechanisms.catalogue import Study
    from jaxkin.reports.chapters import Places
    from jaxkin.sweep.grid import Grid

#: Written last, so it vouches for the other files.
_REPORT = "report.json"


@click.command("analyse")
@click.argument("mechanism")
@fix_option
@grid_option
@click.option("--joints", metavar="Q1:Q2:...", help="Joint values whose assembly modes are listed and joined.")
@click.option("--out", type=Path, help="Folder for the report (Markdown, JSON), figures (PNG, PDF) and data.")
@click.option("--force", is_flag=True, help="Replace files of the same names; others in the folder stay.")
@set_option
@limit_option
@json_option
def analyse_command(
    mechanism: str,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    joints: str | None,
    out: Path | None,
    force: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
) -> None:
    """Analyse a mechanism: aspects, singular curves, cusps, regions, uniqueness domains, mode changes.

    \b
    jaxkin analyse rpr3-analytic --out analysis
    jaxkin analyse five-bar --set base=7 --joints 1:2 --out seven

    Where to look is chosen for the default geometry of each mechanism. --grid and --fix replace that: over the pose
    axes the box of the aspects, over the joint axes the section (two axes with --grid). Another geometry needs them.

    It writes a report in Markdown with all figures and data. It takes some minutes, most of them to compile the
    first time.
    """
    out = check_report_folder(out, _REPORT, "An analysis", force)
    start_jax()
    robot = robot_of(mechanism, changes, limits)
    from jaxkin.mechanisms.catalogue import CATALOGUE

    places = _places(robot, CATALOGUE[mechanism].study, fixes, grids, joints)
    import matplotlib

    matplotlib.use("Agg")
    from jaxkin.reports.analysis import analyse

    analysis = analyse(robot, places, tell=lambda line: click.echo(f"  {line}", err=True))
    contents = {out / name: content for name, content in analysis.contents().items()}
    out.mkdir(parents=True, exist_ok=True)
    write_files(contents)
    if as_json:
        click.echo(analysis.json())
        return
    for chapter in analysis.chapters:
        click.echo(f"{chapter.title}\n" + "\n".join(f"  {line}" for line in chapter.text))
    click.echo(f"{len(contents)} files: {out / 'report.md'}")


def _places(
    robot: "Mechanism", study: "Study", fixes: tuple[str, ...], grids: tuple[str, ...], joints: str | None
) -> "Places":
    """Returns where to look: what the command line says, else what the catalogue does."""
    from jaxkin.reports.chapters import Places
    from jaxkin.sweep.grid import Grid

    given: dict[str, Any] = dict(_axes(grid_of(fixes, grids))) if fixes or grids else {}
    pose_names = [axis.name for axis in robot.pose_axes]
    joint_names = [axis.name for axis in robot.joint_axes]
    unknown = [name for name in given if name not in (*pose_names, *joint_names)]
    if unknown:
        raise InputError(
            f"There is no axis {unknown[0]!r}: the pose axes are {', '.join(pose_names)}, the joint axes "
            f"{', '.join(joint_names)}."
        )
    poses = {**study.poses, **{name: value for name, value in given.items() if name in pose_names}}
    section = {**study.section, **{name: value for name, value in given.items() if name in joint_names}}
    return Places(
        poses=Grid(**poses),
        section=Grid(**section),
        box=Grid(**study.box) if study.box else None,
        joints=study.joints if joints is None else _values(joints, joint_names),
    )


def _axes(grid: "Grid") -> dict[str, Any]:
    """Returns the axes of a grid as its constructor takes them."""
    from jaxkin.sweep.grid import Span

    return {
        name: (value.low, value.high, value.count) if isinstance(value, Span) else value
        for name, value in grid.axes.items()
    }


def _values(text: str, names: list[str]) -> tuple[float, ...]:
    parts = text.split(":")
    if len(parts) != len(names):
        raise InputError(f"--joints is {text!r}: write it as {':'.join(names)}, {len(names)} numbers.")
    return tuple(number(f"--joints ({name})", part) for name, part in zip(names, parts, strict=True))
