"""``jaxkin reproduce``: the figures, tables and numbers of a paper, made anew and checked."""

import importlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jaxkin.cli.folder import check_report_folder, write_files
from jaxkin.cli.options import json_option, robot_of, set_option, start_jax
from jaxkin.papers.catalogue import PAPERS, find

if TYPE_CHECKING:
    from jaxkin.papers.report import Report

#: Written last, so it vouches for the other files.
_REPORT = "report.json"


@click.command("reproduce")
@click.argument("paper", required=False)
@click.option("--out", type=Path, help="Folder for figures (PNG, PDF), tables (CSV) and the report (Markdown, JSON).")
@click.option("--force", is_flag=True, help="Replace files of the same names; others in the folder stay.")
@set_option
@json_option
def reproduce_command(paper: str | None, out: Path | None, force: bool, changes: tuple[str, ...], as_json: bool) -> int:
    """Reproduce a paper: its figures, its tables, and checks of what it prints.

    \b
    jaxkin reproduce wenger-chablat-2009 --out paper
    jaxkin reproduce wenger-chablat-2009 --out paper --set c2=1.5 --set c3=-0.7 --set d3=0.4
    jaxkin reproduce chablat-baron-jha-rolland-2018 --out paper
    jaxkin reproduce fu-gao-tlpm --out paper --set base_radius=834.386

    Without a name it lists the papers. With --set, the paper's figures of a section, of the robot or of its workspace
    are drawn for that geometry as well. It takes about a minute, a quarter of it when repeated. The exit code is 0 if
    every check passed, and 1 if not.
    """
    if paper is None:
        _list(as_json)
        return 0
    entry = find(paper)
    out = check_report_folder(out, _REPORT, "Reproducing a paper", force)
    start_jax()
    robot = robot_of(entry.mechanism, changes) if changes else None
    import matplotlib

    matplotlib.use("Agg")
    module = importlib.import_module(entry.module)
    report = module.reproduce(robot, tell=lambda line: click.echo(f"  {line}", err=True))
    contents = {out / name: content for name, content in report.contents().items()}
    out.mkdir(parents=True, exist_ok=True)
    write_files(contents)
    click.echo(report.json() if as_json else _summary(report, out, list(contents)))
    return 0 if report.passed else 1


def _list(as_json: bool) -> None:
    if as_json:
        content = {name: {"title": entry.title, "source": entry.source} for name, entry in PAPERS.items()}
        click.echo(json.dumps(content, indent=2))
        return
    for name, entry in PAPERS.items():
        click.echo(f"{name}\n  {entry.title}\n  {entry.source}")


def _summary(report: "Report", out: Path, paths: list[Path]) -> str:
    lines = [f"{report.title}: {report.summary()}"]
    lines += [
        f"  FAILED  {check.source}: {check.what}: {check.got}, off by {check.difference:.2g} of {check.tolerance:.2g}"
        for check in report.checks
        if not check.passed
    ]
    lines.append(f"  {len(report.errata)} errata, {len(paths)} files: {out / 'report.md'}")
    return "\n".join(lines)
