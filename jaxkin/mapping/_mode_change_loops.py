"""Which cusp curves a loop of joints encircles."""

from typing import NamedTuple

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping.cusp_curves import CuspCurve, CuspCurves, cusp_curves
from jaxkin.mapping.cusps import cusps
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.linking import (
    linking_number,
    polygon_distances,
    sagittas,
    spanning_crossings,
    winding_number,
)
from jaxkin.sweep.grid import Grid

#: The box of cusp curves is the loop's, enlarged by this share of its widest side on every side.
_WIDER = 0.25
#: Samples of every axis of the box: they only seed.
_SEEDS = 64


class Undecided(Exception):
    """Why a loop encircles nothing that could be counted."""


class Encircled(NamedTuple):
    """What lies around a loop of joints.

    Attributes:
        linking: Linking number with every cusp curve, or cusp of two joints, by name; None where it is not decided.
        curves: The cusp curves; None for two joints.
    """

    linking: dict[str, int | None]
    curves: CuspCurves | None


def encircled(robot: Mechanism, loop: np.ndarray) -> Encircled:
    """Returns the linking number of a closed loop of joints with every cusp curve of a box around it.

    With three joints the cusps form curves in the joint space. With a closed one the loop has a linking number; with
    one that runs from border to border of the box its number is that of the curve closed outside the box, which does
    not depend on how (see ``jaxkin.numerics.linking``), but on the box. With two joints cusps are points, and the
    number is how often the loop winds around each. None where it is not decided: a curve that ends inside the box
    (where two triple poses meet), or that runs nearer to the loop than the polygons are exact.

    Args:
        robot: The mechanism.
        loop: ``(k, n_joint)`` the last row equal to the first.

    Raises:
        Undecided: There are neither two nor three joints, or the loop runs around a glued joint.
    """
    n = loop.shape[1]
    if n not in (2, 3):
        raise Undecided(f"with {n} joints the cusps of a loop's surroundings are no curves that it could encircle")
    if np.max(np.abs(loop[-1] - loop[0])) > 1e-6 * (1 + np.max(np.abs(loop))):
        raise Undecided("the loop runs around a glued joint")
    low, high = _box(robot, loop)
    spans = zip(robot.joint_axes, low, high, strict=True)
    box = Grid(**{axis.name: (float(a), float(b), _SEEDS) for axis, a, b in spans})
    try:
        if n == 2:
            found = cusps(robot, box)
            points = enumerate(np.asarray(found.joints), 1)
            return Encircled({f"cusp {k}": winding_number(loop[:-1], point) for k, point in points}, None)
        curves = cusp_curves(robot, box)
    except InputError as problem:
        raise Undecided(str(problem)) from None
    limits = robot.limit_values()
    ends = np.array([axis.low for axis in robot.joint_axes]), np.array([axis.high for axis in robot.joint_axes])
    low = np.maximum(low, np.maximum(ends[0], np.asarray(limits.low)))
    high = np.minimum(high, np.minimum(ends[1], np.asarray(limits.high)))
    return Encircled({curve.name: _number(loop, curve, low, high) for curve in curves}, curves)


def _box(robot: Mechanism, loop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    margin = _WIDER * np.max(np.ptp(loop, axis=0))
    low, high = loop.min(axis=0) - margin, loop.max(axis=0) + margin
    for k, axis in enumerate(robot.joint_axes):
        if axis.period is not None and (low[k] < axis.low or high[k] > axis.high):
            raise Undecided(f"the loop lies over the seam of the glued joint {axis.name}")
    return low, high


def _number(loop: np.ndarray, curve: CuspCurve, low: np.ndarray, high: np.ndarray) -> int | None:
    """Returns the linking number of one curve; None where it is not decided."""
    points = np.concatenate([curve.joints, curve.joints[:1]]) if curve.closed else curve.joints
    if len(points) < 2:
        return None
    rough = sagittas(points) + np.max(sagittas(loop))
    if np.any(polygon_distances(points, loop) <= 2 * rough):
        return None
    if curve.closed:
        return linking_number(loop[:-1], points[:-1])
    ends = points[[0, -1]]
    apart = np.minimum(np.abs(ends - low), np.abs(ends - high)).min(axis=1)
    if np.any(apart > 1e-6 * (1 + np.max(np.abs(high - low)))):
        return None
    return spanning_crossings(loop[:-1], points)


def closed(robot: Mechanism, loop: np.ndarray) -> np.ndarray:
    """Returns a loop whose last row equals the first one up to turns of glued joints exactly."""
    period = np.array([np.inf if axis.period is None else axis.period for axis in robot.joint_axes])
    loop = loop.copy()
    loop[-1] -= short_way(loop[-1] - loop[0], period)
    return loop
