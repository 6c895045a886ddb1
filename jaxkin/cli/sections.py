"""``jaxkin loci`` and ``jaxkin cusps``: what is singular over a section of the joint space."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.cli.results import check_out, result_command, robot_and_grid, show, timed, write
from jaxkin.core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from jaxkin.core.mechanism import Mechanism
    from jaxkin.mapping.records import Cusps, SingularCurves
    from jaxkin.sweep.grid import Grid

#: The numbers of solutions under the curves are sampled at most so often a side: no page shows more.
_MOST_SAMPLES = 2000


@result_command("loci")
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
    check_out(out, "loci", force)
    robot, grid = robot_and_grid(mechanism, changes, limits, fixes, grids)
    if closed_form and not hasattr(robot, "closed_form_curves"):
        raise InputError(f"{mechanism} has no closed forms of its singular curves: leave out --closed-form.")
    from jaxkin.mapping.loci import singular_curves
    from jaxkin.mapping.records import coordinates

    method = "closed form" if closed_form else "trace"
    curves, content = timed(lambda: singular_curves(robot, grid, method=method))
    if out is not None:
        content["files"] = write(
            out, "loci", content, _points(curves), lambda: _picture(robot, grid, curves=curves), force
        )
    crossings = [f"  crossing: {coordinates(curves.joint_names, at)}" for at in curves.crossings.joints]
    show(robot, content, "\n".join([str(curves), *crossings]), as_json)


@result_command("cusps")
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
    check_out(out, "cusps", force)
    robot, grid = robot_and_grid(mechanism, changes, limits, fixes, grids)
    from jaxkin.mapping.cusps import cusps
    from jaxkin.mapping.loci import singular_curves

    found, content = timed(lambda: cusps(robot, grid))
    if out is not None:
        content["files"] = write(
            out,
            "cusps",
            content,
            _cusp_poses(found),
            lambda: _picture(robot, grid, curves=singular_curves(robot, grid), cusps=found),
            force,
        )
    show(robot, content, str(found), as_json)


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
