"""``jk.track``: follows one assembly mode along a path of joint values, or says where it ends in a fold."""

import json
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, concrete_reals, plain
from jaxkin.core.provenance import identity
from jaxkin.kinematics import _following
from jaxkin.kinematics._following import ARRIVED, NARROW, Course, Walker
from jaxkin.kinematics._track_events import TrackEvent, _padded, events_of
from jaxkin.kinematics.boundary import checked_single, checked_vector
from jaxkin.kinematics.singularity import raw_conditioning

#: A start whose dimensionless residual is larger is no solution; a smaller one is moved onto it.
START_RESIDUAL = 1e-6
#: Rounds of ``_following.ROUND`` points after which a walk is given up.
_MOST_ROUNDS = 400
#: The walk gives up at a narrow place where safe steps are shorter than this, in t.
_SHORTEST = 1e-13
#: Poses, dimensionless, that agree so far are the same.
_SAME = 1e-7


@dataclass(frozen=True, eq=False)
class Track:
    """One assembly mode along a path of joint values.

    Attributes:
        poses: ``(k, n_pose)``; angles go on continuously from the start's.
        joints: ``(k, n_joint)`` as on the path given.
        t: ``(k,)`` where: waypoint number j of the path is at t = j, straight in between.
        clearance: ``(k,)`` smallest singular value of dq/dx = -B^-1 A scaled by the characteristic length; zero at a
            fold, infinite where det B = 0.
        fold: t of the fold in which the mode ends before the path does; None where it does not.
        reason: What happened, a sentence.
        complete: True where the mode exists to the end of the path.
        singular_value: The clearance at the last pose.
        events: Limits left and entered, and passages through det B = 0, in order; they do not stop the track.
        verified: True where the way back, in half as long steps, ends at the start with the same sign of det A.
        evidence: What speaks for the result, by name.
        request: What determines the numbers.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
    """

    poses: np.ndarray
    joints: np.ndarray
    t: np.ndarray
    clearance: np.ndarray
    fold: float | None
    reason: str
    complete: bool
    singular_value: float
    events: tuple[TrackEvent, ...]
    verified: bool
    evidence: dict[str, Any]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        """Number of points."""
        return len(self.t)

    def __str__(self) -> str:
        """A summary of a few lines."""
        least = int(np.argmin(self.clearance))
        last = ", ".join(f"{name} = {value:.12g}" for name, value in zip(self.pose_names, self.poses[-1], strict=True))
        lines = [
            f"track of {len(self)} points from t = 0 to t = {self.t[-1]:.12g}: {self.reason}",
            f"  ends at {last}",
            f"  smallest clearance {self.clearance[least]:.6g} at t = {self.t[least]:.6g}",
            *(f"  {event}" for event in self.events),
            *(f"  {name}: {value}" for name, value in self.evidence.items()),
        ]
        return "\n".join(lines if self.verified else [*lines, "  NOT VERIFIED: the way back does not end at the start"])

    def to_json(self) -> str:
        """Returns everything as JSON text; an infinite clearance is null."""
        clearance = [value if np.isfinite(value) else None for value in self.clearance.tolist()]
        events = [
            {"t": e.t, "name": e.name, "kind": e.kind, "pose": e.pose.tolist(), "joints": e.joints.tolist()}
            for e in self.events
        ]
        content = {
            "request": self.request,
            "pose_axes": list(self.pose_names),
            "joint_axes": list(self.joint_names),
            "units": self.units,
            "t": self.t.tolist(),
            "poses": self.poses.tolist(),
            "joints": self.joints.tolist(),
            "clearance": clearance,
            "fold": self.fold,
            "reason": self.reason,
            "complete": self.complete,
            "events": events,
            "verified": self.verified,
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


def track(robot: Mechanism, joint_path: ArrayLike, pose: ArrayLike) -> Track:
    """Follows one assembly mode along a path of joint values.

    No step is longer than the singularity nearby allows: within it Kantorovich's theorem leaves one solution, so that
    the track cannot jump to another mode. Second derivatives over the ball of a step are estimated at a few of its
    points, not bounded, so that the way back, in half as long steps, is the check. Where the mode ends (two modes meet,
    det dF/dpose = 0), the fold is solved for with Newton's method on the equations and the determinant.

    Args:
        robot: The mechanism.
        joint_path: ``(m, n_joint)`` waypoints, straight in between as the numbers are given: a glued joint that is
            to go the short way over its seam is given beyond it (3.2 rad, not -3.08).
        pose: ``(n_pose,)`` a solution at the first waypoint (one of ``jk.forward``), to a dimensionless residual of
            1e-6; it is moved onto the solution.

    Returns:
        A ``Track``; ``.complete`` tells whether the mode exists to the end of the path, ``.fold`` where not. Limits do
        not stop it, nor does det B = 0: they are its ``.events``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Wrong shapes, numbers that are not finite, or a start that is no solution.

    Not differentiable.

    References:
        Ortega, J. M. and Rheinboldt, W. C., 1970, "Iterative solution of nonlinear equations in several variables",
        section 12.6 (the Newton-Kantorovich theorem); Deuflhard, P., 2011, "Newton methods for nonlinear problems",
        section 2.1 (its affine covariant form).
    """
    who = "jk.track"
    checked_single(who, robot)
    path = checked_path(who, robot, joint_path)
    start, residual = solution_near(who, robot, path[0], pose)
    waypoints = jnp.asarray(_padded_path(path))
    walked = _followed(robot, waypoints, start, float(len(path) - 1))
    last_t, last_pose = walked.ts[-1], walked.poses[-1]
    ts, poses = walked.ts, walked.poses
    if walked.fold is not None and walked.fold_pose is not None and walked.fold > ts[-1]:
        ts, poses = np.append(ts, walked.fold), np.vstack([poses, walked.fold_pose])
    poses = poses * np.asarray(_following.pose_unit(robot))
    joints = _joints(path, ts)
    clearance, signs = _measured(robot, poses, joints)
    if walked.fold is not None:
        signs = signs[:-1] if len(signs) > 1 else signs
    same_sign = bool(np.all(signs == signs[0]))
    gap, steps = _way_back(robot, path, last_t, last_pose, walked.poses[0])
    axes = (*robot.pose_axes, *robot.joint_axes)
    return Track(
        poses=poses,
        joints=joints,
        t=ts,
        clearance=clearance,
        fold=walked.fold,
        reason=_reason(robot, walked, poses[-1], float(clearance[-1]), len(path)),
        complete=walked.complete,
        singular_value=float(clearance[-1]),
        events=events_of(robot, waypoints, ts, poses, joints) if len(ts) > 1 else (),
        verified=same_sign and gap <= _SAME,
        evidence={
            "steps there and back": [len(walked.ts) - 1, steps],
            "the way back ends this far from the start, dimensionless": gap,
            "det A keeps its sign": same_sign,
            "residual of the start as given": residual,
        },
        request={**identity(robot), "joint_path": path.tolist(), "pose": np.asarray(pose, float).tolist()},
        pose_names=tuple(axis.name for axis in robot.pose_axes),
        joint_names=tuple(axis.name for axis in robot.joint_axes),
        units={axis.name: axis.unit for axis in axes},
    )


def checked_path(who: str, robot: Mechanism, joint_path: ArrayLike) -> np.ndarray:
    """Returns a path of joint values, ``(m, n_joint)``.

    Raises:
        InputError: Not real numbers, of another shape, without a row, or not finite.
    """
    names = ", ".join(axis.name for axis in robot.joint_axes)
    path, n = concrete_reals(joint_path), len(robot.joint_axes)
    if path is None or path.ndim != 2 or path.shape[1] != n or len(path) == 0:
        got = "no numbers" if path is None else f"of shape {path.shape}"
        raise InputError(
            f"{who}: the joint path is {got}; it must be (m, {n}), one row ({names}) a waypoint, two rows for a "
            "straight line."
        )
    if not np.all(np.isfinite(path)):
        row = int(np.flatnonzero(~np.all(np.isfinite(path), axis=1))[0])
        raise InputError(
            f"{who}: waypoint {row} is {plain(path[row])}: every joint value must be a finite number; correct the row."
        )
    return path


def solution_near(who: str, robot: Mechanism, joints: ArrayLike, pose: ArrayLike, what: str = "pose") -> Any:
    """Returns the dimensionless solution next to a pose given to some digits, and the residual of what was given.

    Raises:
        InputError: Wrong shapes, numbers that are not finite, or a pose that is no solution.
    """
    given = np.asarray(checked_vector(who, f"the {what}", pose, robot.pose_axes))
    q = checked_vector(who, "the joints", joints, robot.joint_axes)
    x, moved, residual = (np.asarray(part) for part in _near(robot, jnp.asarray(given), q))
    if not residual <= START_RESIDUAL:
        raise InputError(
            f"{who}: the {what} {plain(given)} is no solution at the joints {plain(np.asarray(q))}: its largest "
            f"dimensionless residual is {float(residual):.3g}, and must be at most {START_RESIDUAL:g}; take it from "
            "jk.forward."
        )
    exact = given / np.asarray(_following.pose_unit(robot))
    # Next to a singularity Newton's method may lead away from a pose that is exact already.
    return (x if moved else exact), float(residual)


@jax.jit
def _near(robot: Mechanism, pose: Array, joints: Array) -> tuple[Array, Array, Array]:
    given = pose / _following.pose_unit(robot)
    residual = _following.dimensionless_residual(robot, given, joints)
    x, last = _following.corrected(robot, given, joints)
    after = _following.dimensionless_residual(robot, x, joints)
    good = (after <= residual) & (last < 1e-9) & (jnp.max(jnp.abs(x - given)) < 1e-2)
    return x, good, residual


@dataclass(frozen=True, eq=False)
class _Walked:
    """A walk: its points (dimensionless poses), and the fold at which it ended."""

    ts: np.ndarray
    poses: np.ndarray
    complete: bool
    fold: float | None = None
    fold_pose: np.ndarray | None = None


def _followed(robot: Mechanism, waypoints: Array, start: np.ndarray, end: float, share: float = 1.0) -> _Walked:
    """Walks to the end of a path or to a fold."""
    course = Course(waypoints, jnp.asarray(end), jnp.asarray(share))
    walker = _following.started(jnp.asarray(start))
    ts, poses = [np.zeros(1)], [np.asarray(start)[None]]
    for _ in range(_MOST_ROUNDS if end > 0 else 0):
        walker = _following.walk(robot, course, walker)
        count = int(walker.recorded)
        ts.append(np.asarray(walker.ts)[:count])
        poses.append(np.asarray(walker.poses)[:count])
        state = int(walker.state)
        if state == ARRIVED:
            return _Walked(np.concatenate(ts), np.concatenate(poses), True)
        if state == NARROW:
            fold = _fold(robot, course, walker, end)
            if fold is not None:
                return _Walked(np.concatenate(ts), np.concatenate(poses), False, *fold)
            if float(walker.floor) < _SHORTEST:
                break
            walker = walker._replace(floor=walker.floor * 1e-2, trust=jnp.ones(()))
    return _Walked(np.concatenate(ts), np.concatenate(poses), end == 0)


def _fold(robot: Mechanism, course: Course, walker: Walker, end: float) -> tuple[float, np.ndarray] | None:
    """Returns t and pose of the fold that a walk at a narrow place runs into, or None."""
    x, t, last, rate = (np.asarray(a) for a in _following.seek_fold(robot, course.waypoints, walker.pose, walker.t))
    corner = min(np.floor(float(walker.t)) + 1.0, end)
    far = float(t) - float(walker.t)
    if not (last <= 1e-9 and far >= -1e-12 and t <= corner + 1e-12):
        return None
    # Next to its fold a mode runs like the root of the rest of the way: so far it has 2 |dx/dt| times that rest to go.
    apart = float(np.linalg.norm(x - np.asarray(walker.pose)))
    # Where a leg is short, safe steps are less than a thousandth of that rest: very near the fold the bound is wider.
    floor = float(walker.floor)
    room = max(1e3 * floor, min(1e5 * floor, 1e-6))
    near = apart <= 1e-6 or (far <= room and 1.5 * rate * far <= apart <= 2.5 * rate * far)
    return (min(float(t), corner), x) if near else None


def _way_back(robot: Mechanism, path: np.ndarray, t: float, pose: np.ndarray, start: np.ndarray) -> tuple[float, int]:
    """Walks back to the first waypoint in half as long steps; returns how far from the start it ends, and its steps."""
    if t == 0:
        return 0.0, 0
    rest = path[: int(np.ceil(t))]
    back = np.vstack([_joints(path, np.array([t])), rest[::-1]])
    walked = _followed(robot, jnp.asarray(_padded_path(back)), pose, float(len(back) - 1), share=0.5)
    gap = float(np.max(np.abs(walked.poses[-1] - start))) if walked.complete else float("inf")
    return gap, len(walked.ts) - 1


def _joints(path: np.ndarray, ts: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(ts, np.arange(len(path)), column) for column in path.T], axis=1)


def _padded_path(path: np.ndarray) -> np.ndarray:
    room = max(4, 1 << len(path).bit_length())
    return np.concatenate([path, np.repeat(path[-1:], room - len(path), axis=0)])


@jax.jit
def _conditionings(robot: Mechanism, poses: Array, joints: Array) -> tuple[Array, Array]:
    measures = jax.vmap(lambda x, q: raw_conditioning(robot, x, q))(poses, joints)
    return measures.smallest_singular_value, jnp.sign(measures.determinant)


def _measured(robot: Mechanism, poses: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns clearance and sign of det A at all points."""
    clearance, signs = (np.asarray(a)[: len(poses)] for a in _conditionings(robot, *_padded(poses, joints)))
    return np.where(np.isnan(clearance), np.inf, clearance), signs


def _reason(robot: Mechanism, walked: _Walked, pose: np.ndarray, clearance: float, m: int) -> str:
    if walked.complete:
        return f"the mode exists to the end of the path, t = {m - 1}"
    if walked.fold is not None:
        return f"fold at t = {walked.fold:.12g}, singular value {clearance:.2g}{_vanishing(robot, pose)}"
    return (
        f"no safe step beyond t = {walked.ts[-1]:.12g}, singular value {clearance:.2g}{_vanishing(robot, pose)}; it is "
        "no simple fold (a cusp, a crossing of singular sets, or singular angles of the pose), or far too many steps"
    )


def _vanishing(robot: Mechanism, pose: np.ndarray) -> str:
    """Names the factors of det A that vanish at a pose, where the mechanism declares them."""
    found = []
    for kind, note in (("factors", "0"), ("chart_factors", "0, singular angles of the pose only")):
        if hasattr(robot, kind):
            values = getattr(robot, kind)(jnp.asarray(pose))
            size = max(float(jnp.max(jnp.abs(jnp.stack(list(values.values()))))), 1e-300)
            found += [f"{name} = {note}" for name, v in values.items() if abs(float(v)) <= 1e-6 * max(size, 1.0)]
    return f" ({', '.join(found)})" if found else ""
