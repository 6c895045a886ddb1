"""A spatial mechanism in one pose, and in all its assembly modes."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jax.typing import ArrayLike
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.bodies import Body
from jaxkin.core.branches import Branches
from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.precision import TOLERANCES
from jaxkin.kinematics.jacobian import jacobians
from jaxkin.kinematics.solve import inverse
from jaxkin.plot import spatial, style

#: A step of the uncontrolled motion, in characteristic lengths and radians, from which its direction is taken.
_STEP = 1e-6
#: Length of its largest arrow, as a share of the picture.
_ARROW = 0.28
_MOTION = style.OKABE_ITO["vermillion"]
_WORD = {1: "> 0", -1: "< 0", 0: "= 0"}


def check_bodies(robot: object) -> None:
    """Refuses a mechanism that does not say what it looks like in space.

    Raises:
        InputError: It has no method ``bodies``.
    """
    if not hasattr(robot, "bodies"):
        raise InputError(
            f"{type(robot).__name__} has no method bodies(pose) -> tuple[jaxkin.core.bodies.Body, ...]: add one to "
            "draw it in space."
        )


def new_or_given(ax: Axes | None) -> Axes3D:
    """Returns Axes of three dimensions: the caller's, or those of a new figure, which ``spatial.fit`` must size.

    Raises:
        InputError: The Axes are flat.
    """
    if ax is None:
        return spatial.panels(1)[0]
    if not isinstance(ax, Axes3D):
        raise InputError('It needs Axes of three dimensions: make them with subplot_kw={"projection": "3d"}.')
    return ax


def pose(robot: Mechanism, pose: ArrayLike, ax: Axes | None = None) -> Axes3D:
    """Draws a spatial mechanism in one pose; at a singular pose arrows show the motion that the joints do not control.

    They are the velocities of the platform's corners while all actuated joints stand still, to no scale: only their
    directions and ratios mean something.

    Args:
        robot: A mechanism that says what it looks like (``bodies(pose)``), such as the 3-PPPS or the TLPM.
        pose: ``(n_pose,)``.
        ax: Axes with ``projection="3d"``; a new figure if not given.

    Returns:
        The Axes, with a legend.

    Raises:
        InputError: The mechanism has no bodies, the pose is of the wrong size or unreachable, or the Axes are flat.
    """
    check_bodies(robot)
    values = np.asarray(pose, float)
    if values.shape != (len(robot.pose_axes),) or not np.isfinite(values).all():
        raise InputError(
            f"The pose is {values.tolist()}: it must be {len(robot.pose_axes)} finite numbers, "
            f"({', '.join(axis.name for axis in robot.pose_axes)})."
        )
    found = inverse(robot, values)
    if not bool(found.valid.any()):
        raise InputError(f"The pose {values.tolist()} cannot be reached: {found.sentences()[0]}.")
    own, ax = ax is None, new_or_given(ax)
    joints = np.asarray(found.values)[np.asarray(found.valid)][0]
    motion = uncontrolled(robot, values, joints)
    sign = _sign(robot, values, joints, singular=len(motion) > 0)
    _draw_pose(robot, values, motion, sign, ax, own=own)
    return ax


def _draw_pose(robot: Any, pose: np.ndarray, motion: np.ndarray, sign: int, ax: Axes3D, *, own: bool) -> None:
    bodies = robot.bodies(pose)
    arrows = _arrows(robot, pose, bodies, motion)
    ends = arrows[:, 0] + arrows[:, 1]
    box = spatial.limits([*bodies, *([Body("", ends, "axis")] if len(ends) else [])])
    spatial.frame(ax, box, robot.pose_axes, spatial.view(bodies))
    spatial.draw(ax, bodies, style.SIGN_COLOURS[sign], size=float(np.ptp(box, axis=1).max()))
    for start, along in arrows:
        spatial.arrow(ax, start, along, _MOTION)
    entries = spatial.handles(bodies) + spatial.sign_handles([sign])
    if len(arrows):
        entries.append(Line2D([], [], color=_MOTION, linewidth=1.8, label="uncontrolled motion"))
    spatial.legend(ax, entries, columns=2, own=own)
    title = style.in_lines(style.value(a.name, v) for a, v in zip(robot.pose_axes, pose, strict=True))
    if own:
        points = np.concatenate([*(body.points for body in bodies), ends])
        spatial.fit([ax], [title], legend=0.18 * math.ceil(len(entries) / 2) + 0.1, points=points)
    else:
        ax.set_title(title, fontsize="small")


def uncontrolled(robot: Mechanism, pose: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Returns the directions ``(k, n_pose)`` of pose in which the constraints do not change, in scaled coordinates.

    None where the mechanism is not singular to the tolerance of double solutions.
    """
    length = float(np.asarray(robot.characteristic_length()))
    unit = np.array([1.0 if axis.is_angle else length for axis in robot.pose_axes])
    direct = np.asarray(jacobians(robot, pose, joints).direct) * unit
    _, sizes, directions = np.linalg.svd(direct)
    return directions[sizes <= TOLERANCES.double_length * sizes[0]] * unit


def _arrows(robot: Mechanism, pose: np.ndarray, bodies: Sequence[Body], motion: np.ndarray) -> np.ndarray:
    """Returns origins and velocities ``(k, 2, 3)`` of the platform's corners, scaled for the picture."""
    found = []
    for direction in motion:
        ends = [_corners(robot.bodies(pose + s * _STEP * direction)) for s in (-1.0, 1.0)]  # type: ignore[attr-defined]
        along = ends[1] - ends[0]
        largest = np.linalg.norm(along, axis=1).max()
        if largest > 0:
            size = _ARROW * np.ptp(spatial.limits(bodies), axis=1).max()
            arrows = np.stack([_corners(bodies), along * (size / largest)], axis=1)
            found.append(arrows[np.linalg.norm(along, axis=1) > 0.02 * largest])
    return np.concatenate(found) if found else np.zeros((0, 2, 3))


def _corners(bodies: Sequence[Body]) -> np.ndarray:
    return np.concatenate([body.points for body in bodies if body.kind == "platform"])


def _sign(robot: Mechanism, pose: np.ndarray, joints: ArrayLike, *, singular: bool) -> int:
    return 0 if singular else int(np.sign(np.linalg.det(np.asarray(jacobians(robot, pose, joints).direct))))


def modes(robot: Any, joints: ArrayLike, found: Branches, ax: Axes | None) -> np.ndarray | Axes3D:
    """Draws all assembly modes: each in a panel, or over each other in given Axes."""
    lanes = np.flatnonzero(np.asarray(found.valid))
    poses, multiple = np.asarray(found.values)[lanes], np.asarray(found.multiplicity)[lanes] > 1
    every = [robot.bodies(pose) for pose in poses]
    signs = [_sign(robot, pose, joints, singular=bool(m)) for pose, m in zip(poses, multiple, strict=True)]
    parts = [body for bodies in every for body in bodies]
    box, azimuth = spatial.limits(parts), spatial.view(every[0])
    entries = spatial.handles(parts) + spatial.sign_handles(signs)
    if ax is not None:
        ax = new_or_given(ax)
        _overlay(ax, every, signs, float(np.ptp(box, axis=1).max()))
        spatial.frame(ax, box, robot.pose_axes, azimuth)
        spatial.legend(ax, entries, columns=2, own=False)
        return ax
    shown, titles = spatial.panels(len(poses)), []
    for number, (panel, lane) in enumerate(zip(shown, lanes, strict=True)):
        spatial.frame(panel, box, robot.pose_axes, azimuth)
        size = float(np.ptp(box, axis=1).max())
        spatial.draw(panel, every[number], style.SIGN_COLOURS[signs[number]], size=size)
        label = f"{style.words(robot.forward_labels[lane])};  " if robot.forward_labels else ""
        titles.append(f"{number + 1}:  {label}det {_WORD[signs[number]]}")
    rows = 1 if len(shown) > 1 else math.ceil(len(entries) / 2)
    spatial.legend(shown[0], entries, columns=math.ceil(len(entries) / rows), own=True)
    points = np.concatenate([body.points for body in parts])
    lines = 1 if len(shown) > 1 and len(robot.joint_axes) <= 3 else 2
    spatial.fit(shown, titles, top=0.05 + 0.2 * lines, legend=0.18 * rows + 0.1, points=points)
    _add_joints(shown, robot, np.asarray(joints), lines)
    result = np.empty(len(shown), object)
    result[:] = shown
    return result


def _overlay(ax: Axes3D, every: Sequence[Sequence[Body]], signs: Sequence[int], size: float) -> None:
    """Draws several poses over each other, with their numbers."""
    for number, (bodies, sign) in enumerate(zip(every, signs, strict=True), 1):
        # What all modes share, as the base and its joints, is drawn once.
        shown = [body for body in bodies if number == 1 or not _among(body, every[0])]
        spatial.draw(ax, shown, style.SIGN_COLOURS[sign], letters=False, size=size)
        x, y, z = _corners(bodies).mean(axis=0)
        ax.text(x, y, z, str(number), ha="center", va="center", zorder=spatial.ON_TOP + 1)


def _add_joints(shown: Sequence[Axes3D], robot: Any, joints: np.ndarray, lines: int) -> None:
    """Writes the joint values over all panels."""
    values = ", ".join(style.value(axis.name, v) for axis, v in zip(robot.joint_axes, joints, strict=True))
    number = f"{len(shown)} assembly modes at" if len(shown) > 1 else "One assembly mode at"
    text = f"{number} {values}" if lines == 1 else f"{number}\n{values}"
    figure: Any = shown[0].figure
    size = "medium" if lines == 1 else "small"
    figure.suptitle(text, fontsize=size, y=1 - 0.1 / figure.get_figheight(), va="top")


def _among(body: Body, others: Sequence[Body]) -> bool:
    return any(body.name == o.name and np.array_equal(body.points, o.points) for o in others)
