"""``jaxkin optimise``: the design that a file asks for, and the proof that it is one."""

import json
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.folder import check_folder
from jaxkin.cli.options import json_option, start_jax
from jaxkin.cli.results import check_request, write

if TYPE_CHECKING:
    from jaxkin.design.outcome import Design

#: jk.design.optimise's methods, which are not imported for --help.
METHODS = ("auto", "adam", "lbfgs", "slsqp", "trust-constr")
_CHECKPOINT, _NUMBERS = "optimise.npz", "optimise.json"


@click.command("optimise")
@click.argument("problem", type=Path)
@click.option(
    "--out", type=Path, help="Folder for the design (JSON), its history (CSV, PNG, PDF) and the checkpoint (NPZ)."
)
@click.option("--method", type=click.Choice(METHODS), help="Instead of the file's; auto by default.")
@click.option("--starts", type=click.IntRange(min=1), metavar="N", help="Number of starts.")
@click.option("--steps", type=click.IntRange(min=1), metavar="N", help="Steps of the gradient method.")
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Of the starts.")
@click.option("--force", is_flag=True, help="Begin anew, and replace this command's files; others in the folder stay.")
@click.option("--progress/--no-progress", default=None, help="Show a bar or none; by default on a terminal only.")
@json_option
def optimise_command(
    problem: Path,
    out: Path | None,
    method: str | None,
    starts: int | None,
    steps: int | None,
    seed: int | None,
    force: bool,
    progress: bool | None,
    as_json: bool,
) -> int:
    """Find the design that a file asks for, and prove that it does what was asked.

    \b
    jaxkin optimise problem.toml --out design

    \b
    [robot]
    mechanism = "tlpm"
    [vary]
    base_radius = [300.0, 900.0]
    [places.home]
    poses = [[0.0, 0.0, 0.0]]
    [maximise]
    objective = "inverse_condition_number"
    place = "home"

    docs/problem_files.md has the whole format. Options stand above those of the file's [optimiser].

    The same command goes on where it was stopped, at the checkpoint in its folder; --force begins anew. The exit code
    is 0 for a verified design, 1 for one that is not verified, 2 for input that cannot be used, 130 after Ctrl-C,
    which leaves the best design so far in the folder.
    """
    if out is not None:
        check_folder(out, _CHECKPOINT if (out / _CHECKPOINT).exists() else _NUMBERS, force)
    start_jax()
    from jaxkin.design.outcome import OptimisationInterrupted
    from jaxkin.design.problem_file import read_problem

    asked, options = read_problem(problem)
    given = {"method": method, "starts": starts, "steps": steps, "seed": seed}
    options |= {name: value for name, value in given.items() if value is not None}
    begin = time.perf_counter()
    try:
        design = _optimised(asked, options, out, force, progress)
    except OptimisationInterrupted as stopped:
        content = _content(stopped.design, begin, stopped=True)
        if out is None:
            _show(stopped.design, content, as_json)
            raise OptimisationInterrupted("Stopped; the best design so far is above.", stopped.design) from None
        _write(out, stopped.design, content, force)
        told = f"Stopped; the best design so far is in {out}, and the same command goes on there."
        raise OptimisationInterrupted(told, stopped.design) from None
    content = _content(design, begin, stopped=False)
    if out is not None:
        content["files"] = _write(out, design, content, force)
    _show(design, content, as_json)
    if not design.verified:
        click.echo(f"jaxkin: the design is not verified: {' '.join(design.failures)}", err=True)
    return 0 if design.verified else 1


def _optimised(problem: Any, options: dict[str, Any], out: Path | None, force: bool, progress: bool | None) -> "Design":
    """Optimises, unless the folder holds the design of another request."""
    from jaxkin.core.errors import InfeasibleWarning
    from jaxkin.design.optimise import optimise, request_of

    if out is not None and not force and (out / _NUMBERS).exists():
        check_request(out / _NUMBERS, request_of(problem, **options).content)
    checkpoint = None if out is None else out / _CHECKPOINT
    with warnings.catch_warnings():
        warnings.simplefilter("always", InfeasibleWarning)
        warnings.showwarning = _spoken(warnings.showwarning)
        return optimise(problem, **options, checkpoint=checkpoint, overwrite=force, progress=progress)


def _spoken(otherwise: Callable[..., None]) -> Callable[..., None]:
    """Returns what shows warnings: those of problems without solution in one line, others as they were."""
    from jaxkin.core.errors import InfeasibleWarning

    def show(message: Warning | str, category: type[Warning], *rest: Any, **more: Any) -> None:
        if issubclass(category, InfeasibleWarning):
            click.echo(f"jaxkin: {message}", err=True)
        else:
            otherwise(message, category, *rest, **more)

    return show


def _content(design: "Design", begin: float, stopped: bool) -> dict[str, Any]:
    from jaxkin.core.provenance import run_log

    seconds = round(time.perf_counter() - begin, 3)
    name = {"name": design.problem.name} if design.problem.name else {}
    return {**name, **design.to_json(), "stopped": stopped, "run_log": run_log(seconds=seconds)}


def _write(out: Path, design: "Design", content: dict[str, Any], force: bool) -> dict[str, str]:
    """Writes the files; those of a run that was stopped are replaced."""
    from jaxkin import plot

    force = force or _was_stopped(out / _NUMBERS)
    draw = None if content["stopped"] else lambda: plot.design_history(design)
    return write(out, "optimise", content, _rows(design), draw, force)


def _was_stopped(path: Path) -> bool:
    return path.exists() and bool(json.loads(path.read_text(encoding="utf-8")).get("stopped"))


def _rows(design: "Design") -> Iterator[list[Any]]:
    """Runs over the lines of optimise.csv: what every start met at every step, then the refinements' iterates."""
    names = list(design.problem.names)
    yield ["stage", "step", "start", "objective", "violation", *names]
    history = {str(name): variable.values.tolist() for name, variable in design.history.data_vars.items()}
    columns = ["objective", "violation", *names]
    for step, objectives in enumerate(history.get("objective", [])):
        for start in range(len(objectives)):
            yield ["gradient", step, start, *(history[name][step][start] for name in columns)]
    for k, start in enumerate(history.get("refined_start", [])):
        yield ["refinement", k, start, *(history[f"refined_{name}"][k] for name in columns)]


def _show(design: "Design", content: dict[str, Any], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(content, indent=2))
        return
    files = [f"  {kind}: {path}" for kind, path in content.get("files", {}).items()]
    named = [design.problem.name] if design.problem.name else []
    click.echo("\n".join([*named, str(design.robot), str(design), *files]))
