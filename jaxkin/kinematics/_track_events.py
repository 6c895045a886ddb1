"""What happens along a track besides folds: limits that are left or entered, legs that stretch or fold (det B = 0)."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics._following import corrected, joints_at, pose_unit
from jaxkin.kinematics.jacobian import raw_jacobians
from jaxkin.numerics.small_linalg import any_determinant

#: Halvings of the interval between two points of the track.
_HALVINGS = 60
_BLOCK = 16


@dataclass(frozen=True, eq=False)
class TrackEvent:
    """A place on a track where a limit or the determinant of dF/djoints changes sign.

    Attributes:
        t: Where, on the path's scale.
        name: The margin (as in ``jk.margins``), or ``"det B"``.
        kind: ``"left"`` or ``"entered"`` for a limit, ``"serial singularity"`` for det B.
        pose: ``(n_pose,)``.
        joints: ``(n_joint,)``.
    """

    t: float
    name: str
    kind: str
    pose: np.ndarray
    joints: np.ndarray

    def __str__(self) -> str:
        """The event in a few words."""
        what = (
            "serial singularity (det B = 0)" if self.kind == "serial singularity" else f"limit {self.kind}: {self.name}"
        )
        return f"{what} at t = {self.t:.12g}"


def watched(robot: Mechanism, pose: Array, joints: Array) -> Array:
    """Returns what must keep its sign: all margins, then det B, ``(k,)``."""
    serial = any_determinant(raw_jacobians(robot, pose, joints).inverse)
    return jnp.stack([*robot.margins(pose, joints).values(), serial])


def watched_names(robot: Mechanism) -> tuple[str, ...]:
    """Returns the names of what is watched, in its order."""
    names: list[str] = []
    pose, joints = (jax.ShapeDtypeStruct((len(axes),), float) for axes in (robot.pose_axes, robot.joint_axes))
    # Collected inside the trace: a dict that comes out of one has its keys sorted.
    jax.eval_shape(lambda r, x, q: names.extend(r.margins(x, q)), robot, pose, joints)
    return (*names, "det B")


@jax.jit
def _all_watched(robot: Mechanism, poses: Array, joints: Array) -> Array:
    return jax.vmap(lambda x, q: watched(robot, x, q))(poses, joints)


@jax.jit
def _bisected(
    robot: Mechanism, waypoints: Array, which: Array, low: Array, high: Array, first: Array, last: Array
) -> tuple[Array, Array]:
    """Returns t and pose where one watched value changes sign between two points of a track each."""
    unit = pose_unit(robot)

    def one(which: Array, low: Array, high: Array, first: Array, last: Array) -> tuple[Array, Array]:
        def configuration(t: Array) -> tuple[Array, Array]:
            share = (t - low) / (high - low)
            # The segment is that of the interval's middle: its upper end may be a corner.
            k = jnp.floor(0.5 * (low + high))
            start, direction = joints_at(waypoints, k)
            q = start + (t - k) * direction
            return corrected(robot, (first + share * (last - first)) / unit, q)[0] * unit, q

        def negative(t: Array) -> Array:
            return watched(robot, *configuration(t))[which] < 0

        before = negative(low)

        def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
            a, b = bracket
            middle = 0.5 * (a + b)
            same = negative(middle) == before
            return jnp.where(same, middle, a), jnp.where(same, b, middle)

        a, b = jax.lax.fori_loop(0, _HALVINGS, halve, (low, high))
        t = 0.5 * (a + b)
        return t, configuration(t)[0]

    return jax.vmap(one)(which, low, high, first, last)


def events_of(
    robot: Mechanism, waypoints: Array, ts: np.ndarray, poses: np.ndarray, joints: np.ndarray
) -> tuple[TrackEvent, ...]:
    """Finds the events between the points of a track, in order; two changes of sign within one step are not seen."""
    values = np.asarray(_all_watched(robot, *_padded(poses, joints)))[: len(ts)]
    flips = np.argwhere((values[1:] < 0) != (values[:-1] < 0))
    names, found = watched_names(robot), []
    for start in range(0, len(flips), _BLOCK):
        some = np.resize(flips[start : start + _BLOCK], (_BLOCK, 2))
        k, which = some.T
        t, x = _bisected(robot, waypoints, which, ts[k], ts[k + 1], poses[k], poses[k + 1])
        for row, (index, number) in enumerate(flips[start : start + _BLOCK]):
            kind = "left" if values[index + 1, number] < 0 else "entered"
            kind = "serial singularity" if names[number] == "det B" else kind
            q = np.asarray(joints_at(waypoints, t[row])[0])
            found.append(TrackEvent(float(t[row]), names[number], kind, np.asarray(x[row]), q))
    return tuple(sorted(found, key=lambda event: event.t))


def _padded(*columns: np.ndarray) -> list[np.ndarray]:
    """Returns columns with their last row repeated up to a power of two, so that few shapes are ever compiled."""
    room = max(256, 1 << (len(columns[0]) - 1).bit_length())
    return [np.concatenate([c, np.repeat(c[-1:], room - len(c), axis=0)]) for c in columns]
