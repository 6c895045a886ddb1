"""Objectives of limits: the smallest margin of joints or links over a place, and the stroke that a place needs."""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.words import meant
from jaxkin.design.configurations import Coordinates, Posture, posture_over
from jaxkin.design.objective import MOST, Measured, Objective, checked_width
from jaxkin.design.places import Place
from jaxkin.design.worst_case import worst_case


def limit_margin(
    robot: Mechanism,
    place: Place,
    names: Sequence[str] | None = None,
    *,
    mode: Sequence[int] | None = None,
    width: float = 0.0,
) -> Objective:
    """Returns the objective of the smallest distance to a limit over a place; negative where one is violated.

    Args:
        robot: The mechanism, for which the objective is made.
        place: Where.
        names: Which of ``jk.margins``, all of one unit; by default those of all joints with finite limits.
        mode: The working mode, one sign a joint; needed where there are several.
        width: Width of the smoothing, in the unit; 0 takes the worst sample.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: There is no such margin, none is finite, their units differ, or the working mode is not given.
    """
    who = "jk.design.limit_margin"
    if names is None:
        limits = [
            f"{axis}_{end}" for field in robot.limit_fields().values() for axis in field for end in ("low", "high")
        ]
        names = [
            name for name in _finite_margins(robot, place, posture_over(who, robot, place, mode)) if name in limits
        ]
    return _margins(who, "limit margin", robot, place, names, mode, width)


def clearance(
    robot: Mechanism,
    place: Place,
    names: Sequence[str] | None = None,
    *,
    mode: Sequence[int] | None = None,
    width: float = 0.0,
) -> Objective:
    """Returns the objective of the smallest clearance of links over a place; negative where links may touch.

    Args:
        robot: The mechanism, with ``clearances()``, for which the objective is made.
        place: Where.
        names: Which clearances; all by default.
        mode: The working mode, one sign a joint; needed where there are several.
        width: Width of the smoothing, in the unit; 0 takes the worst sample.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The mechanism has no clearances, or as for ``limit_margin``.
    """
    who = "jk.design.clearance"
    return _margins(who, "link clearance", robot, place, robot.clearances() if names is None else names, mode, width)


def needed_stroke(
    robot: Mechanism,
    place: Place,
    joints: Sequence[str] | None = None,
    *,
    mode: Sequence[int] | None = None,
    width: float = 1e-3,
) -> Objective:
    """Returns the objective of the longest stroke that any of the joints needs to serve a place.

    Args:
        robot: The mechanism, for which the objective is made.
        place: Where.
        joints: Names of the joints, all of one unit; all by default.
        mode: The working mode, one sign a joint; needed where there are several.
        width: Width of the smoothing as a share of each stroke's own size at the mechanism given.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: There is no such joint, units differ, or the working mode is not given.
    """
    who = "jk.design.needed_stroke"
    axes = {axis.name: k for k, axis in enumerate(robot.joint_axes)}
    chosen = _known(who, "joint", list(axes) if joints is None else joints, list(axes))
    units = {robot.joint_axes[axes[name]].unit for name in chosen}
    if len(units) != 1:
        raise InputError(f"{who}: its joints have the units {', '.join(sorted(units))}: choose joints of one unit.")
    posture = posture_over(who, robot, place, mode)
    index = [axes[name] for name in chosen]
    searches = [
        [worst_case(name, "", partial(_joints, posture, [k]), place, 0.0, names=(name,), worst=side) for side in _SIDES]
        for name, k in zip(chosen, index, strict=True)
    ]
    samples = place.samples()
    reach = np.asarray(_values(posture, index, place, samples, robot, None))
    sizes = np.maximum(np.ptp(reach, axis=0), 1e-9)
    share = checked_width(who, width)

    def parts(robot: Mechanism, center: Array | None) -> Array:
        q = _values(posture, index, place, samples, robot, center)
        if share == 0:
            return jnp.max(q, axis=0) - jnp.min(q, axis=0)
        w = share * jnp.asarray(sizes)
        return w * (jax.nn.logsumexp(q / w, axis=0) + jax.nn.logsumexp(-q / w, axis=0))

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        best = Measured(-np.inf, 0.0)
        for name, pair in zip(chosen, searches, strict=True):
            low, high = (side.measured(robot, center) for side in pair)
            if high.value - low.value > best.value:
                best = Measured(high.value - low.value, low.error + high.error, high.pose, name, high.evidence)
        return best

    return Objective(
        name="needed stroke",
        unit=next(iter(units)),
        parts=parts,
        worst=MOST,
        width=share * float(np.max(sizes)),
        smoothing=f"log-sum-exp of {share:g} of each stroke's size, above the largest and below the smallest sample by "
        f"at most {share * np.log(max(len(reach), 2)):.3g} of it each",
        measure=measured,
        place=place,
        names=tuple(chosen),
        content={"objective": "needed stroke", "place": place.content(), "joints": list(chosen), "width": share},
    )


_SIDES = ("least", "most")


def _joints(posture: Posture, index: list[int], robot: Mechanism, poses: Coordinates, middle: Array) -> Array:
    del middle
    joints, _ = posture.joints(robot, poses)
    return jnp.stack([joints[k] for k in index], axis=-1)


def _values(
    posture: Posture, index: list[int], place: Place, samples: np.ndarray, robot: Mechanism, center: Array | None
) -> Array:
    poses = place.sampled(robot, center, samples)
    return _joints(posture, index, robot, tuple(poses[:, k] for k in range(poses.shape[1])), poses[0])


def _margins(
    who: str,
    name: str,
    robot: Mechanism,
    place: Place,
    names: Sequence[str],
    mode: Sequence[int] | None,
    width: float,
) -> Objective:
    posture = posture_over(who, robot, place, mode)
    finite = _finite_margins(robot, place, posture)
    if not names:
        raise InputError(
            f"{who}: {robot.id or type(robot).__name__} has no finite margin of this kind: give it limits."
        )
    chosen = tuple(_known(who, "margin", names, list(finite)))
    units = {robot.margin_unit(one) for one in chosen}
    if len(units) != 1:
        raise InputError(
            f"{who}: its margins have the units {', '.join(sorted(units))}, which have no least: choose names= of one "
            "unit, and require the others by themselves."
        )

    def at(robot: Mechanism, poses: Coordinates, middle: Array) -> Array:
        del middle
        joints, inside = posture.joints(robot, poses)
        shape = jnp.shape(inside)
        stacked = [jnp.stack([jnp.broadcast_to(x, shape) for x in part], axis=-1) for part in (poses, joints)]
        margins = robot.margins(*stacked)
        values = jnp.stack([jnp.broadcast_to(margins[one], shape) for one in chosen], axis=-1)
        # Where a leg does not reach, its joint's margin says nothing.
        return values if posture.always_reaches else jnp.where(inside[:, None] > 0, values, inside[:, None])

    return worst_case(
        name,
        next(iter(units)),
        at,
        place,
        checked_width(who, width),
        names=chosen,
        content={"margins": list(chosen), "mode": list(posture.signs)},
        inside=posture.inside,
    )


def _finite_margins(robot: Mechanism, place: Place, posture: Posture) -> tuple[str, ...]:
    """Returns the names of the margins that are not infinite in the middle of a place."""
    pose = jnp.asarray(place.representative, float)
    joints = posture.of_one(robot, pose)
    return tuple(name for name, value in robot.margins(pose, joints).items() if not np.isinf(value))


def _known(who: str, what: str, names: Sequence[str], known: list[str]) -> list[str]:
    asked = [names] if isinstance(names, str) else list(names)
    for name in asked:
        if name not in known:
            raise InputError(
                f"{who}: there is no finite {what} {name!r}: choose among {', '.join(known)}{meant(name, known)}"
            )
    return asked
