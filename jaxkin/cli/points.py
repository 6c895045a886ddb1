"""``jaxkin forward`` and ``jaxkin inverse``: one point, or a CSV of points."""

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.folder import csv_text, write_files
from jaxkin.cli.options import json_option, limit_option, number, robot_of, set_option, start_jax
from jaxkin.core.errors import InputError, StoreError

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Axis, Mechanism

_ARGUMENTS = {"ignore_unknown_options": True}  # So that a negative number is a value.


def _point_command(name: str) -> Callable[[Callable[..., int]], click.Command]:
    """Gives a command the arguments and options that both directions share."""
    table_help = "A CSV whose header names the axes; further columns are ignored."
    decorators = (
        click.command(name, context_settings=_ARGUMENTS),
        click.argument("mechanism"),
        click.argument("values", nargs=-1),
        click.option("--csv", "table", type=Path, help=table_help),
        click.option("--out", type=Path, help="Write to a file (.csv or .json) instead of the screen."),
        click.option("--force", is_flag=True, help="Replace the file if it exists."),
        set_option,
        limit_option,
        json_option,
    )

    def decorate(function: Callable[..., int]) -> click.Command:
        command: Any = function
        for decorator in reversed(decorators):
            command = decorator(command)
        return command

    return decorate


@_point_command("forward")
def forward_command(**options: Any) -> int:
    """Find all poses (assembly modes) of given joint values.

    \b
    jaxkin forward rpr3 14.98 15.38 12
    jaxkin forward rpr3-analytic --csv legs.csv --out poses.csv
    """
    return _solve(forward=True, **options)


@_point_command("inverse")
def inverse_command(**options: Any) -> int:
    """Find all joint values (working modes) of a pose.

    \b
    jaxkin inverse rpr3 -8.7 12.2 -0.99
    """
    return _solve(forward=False, **options)


def _solve(
    *,
    forward: bool,
    mechanism: str,
    values: tuple[str, ...],
    table: Path | None,
    out: Path | None,
    force: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
) -> int:
    if out is not None:
        _check_out(out, force)
        if table is not None and out.resolve() == table.resolve():
            raise InputError(f"--csv and --out are both {str(out)!r}: choose another name for the result.")
    from jaxkin.core.provenance import jsonable

    start_jax()
    robot = robot_of(mechanism, changes, limits)
    axes = robot.joint_axes if forward else robot.pose_axes
    if bool(values) == (table is not None):
        names = " ".join(axis.name.upper() for axis in axes)
        raise InputError(f"Give either one point as {names}, or a table with --csv FILE.")
    rows, complaints = ([_one(values, axes)], []) if table is None else _table(table, axes)
    records = _records(robot, rows, forward)
    if as_json or (out is not None and out.suffix == ".json"):
        content: dict[str, Any] = {
            "mechanism": robot.id,
            "geometry": jsonable(robot.geometry()),
            "solutions": records,
        }
        text = json.dumps(content, indent=2) + "\n"
    elif out is not None or table is not None:
        text = csv_text(records[0], ([record[name] for name in records[0]] for record in records))
    else:
        text = _summary(robot, records, axes, rows[0], forward)
    if out is None:
        click.echo(text, nl=False)
    else:
        write_files({out: text.encode()})
        click.echo(f"{len(records)} rows written to {out}", err=True)
    for complaint in complaints:
        click.echo(f"jaxkin: {complaint}", err=True)
    return 2 if complaints else 0


def _check_out(out: Path, force: bool) -> None:
    if out.exists() and not force:
        raise StoreError(f"{out} exists: choose another name, or replace it with --force.")
    if out.suffix not in (".csv", ".json"):
        raise InputError(f"--out is {str(out)!r}: its name must end in .csv or .json.")
    if not out.parent.is_dir():
        raise InputError(f"--out is {str(out)!r}: there is no folder {str(out.parent)!r}; make it first.")


def _one(values: tuple[str, ...], axes: "tuple[Axis, ...]") -> list[float]:
    for value in values:
        if value.startswith("--"):
            raise InputError(f"There is no option {value!r}: see --help.")
    if len(values) != len(axes):
        names = " ".join(axis.name.upper() for axis in axes)
        raise InputError(f"Got {len(values)} values ({' '.join(values)}): a point is {names}.")
    return [number(axis.name, value) for axis, value in zip(axes, values, strict=True)]


def _table(path: Path, axes: "tuple[Axis, ...]") -> tuple[list[list[float]], list[str]]:
    """Reads the points; a cell that is no number becomes NaN, and a sentence says where it is."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            header = [name.strip() for name in reader.fieldnames or []]
            reader.fieldnames = header
            records = [(reader.line_num, record) for record in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    for axis in axes:
        if header.count(axis.name) != 1:
            problem = "is missing" if axis.name not in header else "stands twice"
            raise InputError(
                f"{path} has the columns {', '.join(header) or '(none)'}: the column {axis.name!r} {problem}; its "
                f"first line must name {', '.join(a.name for a in axes)} once each, separated by commas."
            )
    if not records:
        raise InputError(f"{path} has a header and no rows: add at least one point.")
    rows, complaints = [], []
    for line, record in records:
        row = []
        if None in record:
            complaints.append(
                f"{path}, line {line} has more cells than the header has names: write numbers with a decimal point. "
                "Its row has the status invalid_input."
            )
            rows.append([math.nan] * len(axes))
            continue
        for axis in axes:
            try:
                row.append(number(f"{path}, line {line}: {axis.name}", (record[axis.name] or "").strip()))
            except InputError as error:
                complaints.append(f"{error} Its row has the status invalid_input.")
                row.append(math.nan)
        rows.append(row)
    return rows, complaints


def _records(robot: "Mechanism", rows: list[list[float]], forward: bool) -> list[dict[str, Any]]:
    import numpy as np

    from jaxkin.core.errors import Status
    from jaxkin.kinematics.batch import solve_table, violated_margins

    given_axes = robot.joint_axes if forward else robot.pose_axes
    found_axes = robot.pose_axes if forward else robot.joint_axes
    branches, determinants = solve_table(robot, np.array(rows), forward=forward)
    values, valid, status = (np.asarray(a) for a in (branches.values, branches.valid, branches.status))
    multiplicity, residual = np.asarray(branches.multiplicity), np.asarray(branches.residual)
    labels = robot.forward_labels if forward else ()
    # Statuses know the joints' limits alone; what else a robot limits is said beside.
    more = set(robot.limit_fields()) - {"limits"}
    records = []
    for row, given in enumerate(rows):
        start = {"row": row, **{axis.name: _or_none(g) for axis, g in zip(given_axes, given, strict=True)}}
        lanes = np.flatnonzero(valid[row])
        if len(lanes) == 0:
            empty = dict.fromkeys([axis.name for axis in found_axes])
            code = Status(int(status[row, 0])).name.lower()
            label = {"label": None} if labels else {}
            measures = (*_MEASURES, "violated") if more else _MEASURES
            records.append({**start, "branch": None, **label, **empty, "status": code, **dict.fromkeys(measures)})
        given_rows = np.tile(np.asarray(given), (len(lanes), 1))
        pair = (values[row, lanes], given_rows) if forward else (given_rows, values[row, lanes])
        beyond = violated_margins(robot, *pair) if more and len(lanes) else []
        for place, lane in enumerate(lanes):
            solution = {axis.name: float(v) for axis, v in zip(found_axes, values[row, lane], strict=True)}
            records.append(
                {
                    **start,
                    "branch": int(lane),
                    **({"label": labels[lane]} if labels else {}),
                    **solution,
                    "status": Status(int(status[row, lane])).name.lower(),
                    "multiplicity": int(multiplicity[row, lane]),
                    "residual": float(residual[row, lane]),
                    "determinant": float(determinants[row, lane]),
                    **({"violated": " ".join(beyond[place])} if more else {}),
                }
            )
    return records


_MEASURES = ("multiplicity", "residual", "determinant")


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _summary(
    robot: "Mechanism",
    records: list[dict[str, Any]],
    axes: "tuple[Axis, ...]",
    row: list[float],
    forward: bool,
) -> str:
    from jaxkin.core.errors import Status

    found_axes = robot.pose_axes if forward else robot.joint_axes
    given = ", ".join(f"{axis.name} = {value:.12g}" for axis, value in zip(axes, row, strict=True))
    solved = [record for record in records if record["branch"] is not None]
    lines = [str(robot), f"{given}: {len(solved)} real solution{'' if len(solved) == 1 else 's'}"]
    if not solved:
        lines.append(f"  {Status[records[0]['status'].upper()].sentence}")
    else:
        lines.append("  " + "".join(f"{axis.name:>20}" for axis in found_axes) + f"{'determinant':>16}  status")
    for record in solved:
        cells = "".join(f"{record[axis.name] + 0.0:20.14g}" for axis in found_axes)
        times = f" (multiplicity {record['multiplicity']})" if record["multiplicity"] > 1 else ""
        label = f"  [{record['label']}]" if record.get("label") else ""
        beyond = f"  violated: {record['violated']}" if record.get("violated") else ""
        lines.append(f"  {cells}{record['determinant']:16.6g}  {record['status']}{times}{label}{beyond}")
    return "\n".join(lines) + "\n"
