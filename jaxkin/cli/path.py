"""``jaxkin path``: a change of assembly mode that meets no singularity."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.folder import check_folder
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
from jaxkin.cli.results import show, timed, write
from jaxkin.core.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from jaxkin.core.mechanism import Mechanism
    from jaxkin.mapping.mode_change import ModeChange


@click.command("path", context_settings={"ignore_unknown_options": True})  # So that a negative number is a value.
@click.argument("mechanism")
@click.argument("values", nargs=-1)
@click.option(
    "--from", "start", type=int, required=True, help="Number of the first mode, as `jaxkin forward` lists it."
)
@click.option("--to", "goal", type=int, required=True, help="Number of the other mode.")
@fix_option
@grid_option
@click.option("--out", type=Path, help="Folder for the numbers (JSON), the path (CSV) and the picture (PNG, PDF).")
@click.option("--animate", is_flag=True, help="Write an animation as well (GIF).")
@click.option("--force", is_flag=True, help="Replace this command's files; others in the folder stay.")
@set_option
@limit_option
@json_option
def path_command(
    mechanism: str,
    values: tuple[str, ...],
    start: int,
    goal: int,
    fixes: tuple[str, ...],
    grids: tuple[str, ...],
    out: Path | None,
    animate: bool,
    force: bool,
    changes: tuple[str, ...],
    limits: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find a path between two assembly modes of the same joint values that meets no singularity.

    \b
    jaxkin forward rpr3 14.98 15.38 12
    jaxkin path rpr3 14.98 15.38 12 --from 5 --to 1 --out path --animate

    The modes are numbered as `jaxkin forward` lists them. --grid over the pose axes says where to search; without
    it the search begins around the poses. Where the two modes are in different aspects, there is no path, and the
    answer names both.

    In a folder that holds the result of the same command, only files that are missing are written; a folder that
    holds anything else is refused, unless --force is given.
    """
    if animate and out is None:
        raise InputError("--animate makes a file: give a folder with --out FOLDER.")
    if out is not None:
        check_folder(out, "path.json", force)
    start_jax()
    robot = robot_of(mechanism, changes, limits)
    joints = _joints(robot, values)
    poses = _modes(robot, joints, start, goal)
    from jaxkin.mapping.mode_change import mode_change

    grid = grid_of(fixes, grids) if fixes or grids else None
    found, content = timed(lambda: mode_change(robot, joints, *poses, grid=grid))
    if out is not None:

        def draw() -> Any:
            from jaxkin.plot.mode_change import mode_change as picture

            return picture(found, robot)

        content["files"] = write(out, "path", content, _rows(robot, found), draw if found.found else None, force)
        if animate and found.found:
            content["files"]["gif"] = str(_animated(robot, found, out / "path.gif", force))
    show(robot, content, str(found), as_json)


def _joints(robot: "Mechanism", values: tuple[str, ...]) -> "np.ndarray":
    import numpy as np

    names = [axis.name for axis in robot.joint_axes]
    for value in values:
        if value.startswith("--"):
            raise InputError(f"There is no option {value!r}: see --help.")
    if len(values) != len(names):
        raise InputError(f"Got {len(values)} values ({' '.join(values)}): the joints are {' '.join(names)}.")
    return np.array([number(name, value) for name, value in zip(names, values, strict=True)])


def _modes(robot: "Mechanism", joints: "np.ndarray", start: int, goal: int) -> tuple[Any, Any]:
    """Returns the poses of two assembly modes by their numbers."""
    import numpy as np

    from jaxkin.kinematics.solve import forward

    modes = forward(robot, joints)
    valid = np.flatnonzero(np.asarray(modes.valid))
    for name, value in (("--from", start), ("--to", goal)):
        if value not in valid:
            listed = ", ".join(map(str, valid)) or "none"
            raise InputError(
                f"{name} is {value}: the assembly modes of these joints are {listed}; see `jaxkin forward`."
            )
    return np.asarray(modes.values)[start], np.asarray(modes.values)[goal]


def _rows(robot: "Mechanism", found: "ModeChange") -> Iterator[list[Any]]:
    """Runs over the lines of path.csv: pose, joints and clearance along the path."""
    yield [*(axis.name for axis in (*robot.pose_axes, *robot.joint_axes)), "clearance"]
    if found.found:
        for pose, joints, clearance in zip(found.poses, found.joints, found.clearances, strict=True):
            yield [*map(float, pose), *map(float, joints), float(clearance)]


def _animated(robot: "Mechanism", found: "ModeChange", path: Path, force: bool) -> Path:
    if force or not path.exists():
        import matplotlib

        matplotlib.use("Agg")
        from jaxkin.plot.animation import animate_mode_change

        animate_mode_change(found, path, robot, overwrite=force)
    return path
