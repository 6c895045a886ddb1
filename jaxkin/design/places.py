"""Prescribed workspaces: the poses at which a design has to be good, as a map from a cube to poses.

A place is a box, a ball (a disc, an interval) that may have a box of further axes beside it, a list of poses, or all
that the joint limits reach. Its parameters run over [-1, 1] each, so that one search finds the worst pose of any place.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, concrete_reals
from jaxkin.core.tracing import is_traced
from jaxkin.kinematics.boundary import as_tuple, checked_single
from jaxkin.kinematics.solve import forward_lanes

#: Samples along each parameter of a place, where nobody says how many.
_SAMPLES = 7


@dataclass(frozen=True, eq=False)
class Place:
    """A prescribed workspace; made by ``box``, ``ball``, ``poses`` or ``reach``.

    Attributes:
        kind: ``"box"``, ``"ball"``, ``"poses"`` or ``"reach"``.
        axes: Names of the pose axes.
        center: ``(n_pose,)`` the middle; designs may vary it.
        half: ``(n_pose,)`` half widths, of a ball's axes their radii; 0 on fixed axes.
        round: Places of the axes that form the ball.
        flat: Places of the free axes beside it.
        numbers: Samples along each parameter.
        listed: ``(k, n_pose)`` the poses of a list.
        lane: The assembly mode in which joints are taken to poses.
    """

    kind: str
    axes: tuple[str, ...]
    center: np.ndarray
    half: np.ndarray
    round: tuple[int, ...] = ()
    flat: tuple[int, ...] = ()
    numbers: tuple[int, ...] = ()
    listed: np.ndarray | None = None
    lane: int = 0

    @property
    def dimension(self) -> int:
        """Number of parameters; a list has none."""
        return len(self.numbers)

    @property
    def free(self) -> tuple[int, ...]:
        """Places of the pose axes that are not fixed."""
        return tuple(range(len(self.center))) if self.kind == "reach" else (*self.round, *self.flat)

    @property
    def representative(self) -> np.ndarray:
        """``(n_pose,)`` the middle; of a list its first pose, as a mean of poses may be none that is served."""
        return self.center if self.listed is None else self.listed[0]

    def pose(self, robot: Mechanism, u: Array, center: Array | None = None) -> Array:
        """Returns the pose ``(n_pose,)`` of parameters in [-1, 1]; traceable."""
        if self.kind == "reach":
            limits = robot.limit_values()
            joints = 0.5 * (limits.low + limits.high) + 0.5 * (limits.high - limits.low) * u
            # Without limits: rounding must not put their own ends outside.
            lane = robot.forward_kernel(as_tuple(joints))[self.lane] if robot.forward_kernel else None
            values = (lane or forward_lanes(robot, as_tuple(joints))[self.lane]).values
            return jnp.stack(values)
        pose = jnp.asarray(self.center if center is None else center, float)
        m = len(self.round)
        for k, part in zip(self.round, _in_ball(u[:m]), strict=True):
            pose = pose.at[k].add(self.half[k] * part)
        for place, k in enumerate(self.flat):
            pose = pose.at[k].add(self.half[k] * u[m + place])
        return pose

    def middle(self, robot: Mechanism, center: Array | None) -> Array:
        """Returns the pose ``(n_pose,)`` in the middle."""
        if self.kind == "reach":
            return self.pose(robot, jnp.zeros(self.dimension))
        return jnp.asarray(self.center if center is None else center, float)

    def samples(self, denser: int = 1) -> np.ndarray:
        """Returns parameters ``(k, dimension)`` that fill the place, its borders included."""
        numbers = [denser * (n - 1) + 1 if n > 1 else 1 for n in self.numbers]
        axes = [np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1) for n in numbers]
        points = list(itertools.product(*axes))
        return np.array(points, float).reshape(len(points), self.dimension)

    def sampled(self, robot: Mechanism, center: Array | None, parameters: np.ndarray) -> Array:
        """Returns the poses ``(k, n_pose)`` of many parameters, or the poses of a list."""
        if self.listed is not None:
            shift = jnp.zeros(len(self.center)) if center is None else center - self.center
            return jnp.asarray(self.listed) + shift
        return jax.vmap(lambda u: self.pose(robot, u, center))(jnp.asarray(parameters))

    def stretch(self, robot: Mechanism, u: Array, center: Array | None) -> Array:
        """Returns the volume of poses (in the free axes' units) that a unit of the parameters' volume stands for."""
        slope = jax.jacfwd(lambda v: self.pose(robot, v, center)[jnp.array(self.free)])(u)
        return jnp.abs(jnp.linalg.det(slope))

    def content(self) -> dict[str, Any]:
        """Returns what determines the place, for the request."""
        return {
            "kind": self.kind,
            "center": self.center.tolist(),
            "half": self.half.tolist(),
            "round": list(self.round),
            "flat": list(self.flat),
            "numbers": list(self.numbers),
            "poses": None if self.listed is None else self.listed.tolist(),
            "lane": self.lane,
        }

    def __str__(self) -> str:
        """The place in a few words."""
        if self.listed is not None:
            return f"{len(self.listed)} pose{'s' if len(self.listed) != 1 else ''}"
        if self.kind == "reach":
            return "all that the joint limits reach"
        parts = []
        if self.round:
            names = ", ".join(self.axes[k] for k in self.round)
            parts.append(f"ball of radius {self.half[self.round[0]]:g} in {names}")
        parts += [
            f"{self.axes[k]} = {self.center[k] - self.half[k]:g} .. {self.center[k] + self.half[k]:g}"
            for k in self.flat
        ]
        parts += [f"{name} = {self.center[k]:g}" for k, name in enumerate(self.axes) if k not in self.free]
        return ", ".join(parts)


def box(robot: Mechanism, n: int | Mapping[str, int] = _SAMPLES, /, **axes: Any) -> Place:
    """Returns a box of poses, ``box(robot, x=(-1.0, 1.0), y=(0.0, 2.0), phi=0.0)``.

    Args:
        robot: The mechanism, whose pose axes are meant.
        n: Samples along each free axis, one number or one by name. They find the worst pose; Newton says where it is.
        axes: Every pose axis: ``(low, high)`` or a number.

    Raises:
        InputError: An axis is unknown, missing, or no interval; no axis is free; too few samples.
    """
    center, half = _intervals("jk.design.box", robot, axes)
    flat = tuple(int(k) for k in np.flatnonzero(half))
    if not flat:
        raise InputError("jk.design.box has no free axis: give at least one as (low, high); for one pose use poses.")
    return Place("box", _names(robot), center, half, (), flat, _numbers("jk.design.box", robot, n, flat))


def ball(
    robot: Mechanism,
    center: Mapping[str, float],
    radius: float,
    n: int | Mapping[str, int] = _SAMPLES,
    /,
    **axes: Any,
) -> Place:
    """Returns a ball (a disc in two axes) of poses, ``ball(robot, {"x": 0.0, "y": 1.0}, 0.5, phi=(-0.5, 0.5))``.

    Args:
        robot: The mechanism, whose pose axes are meant.
        center: The middle, by name: one to three axes of one unit form the ball.
        radius: Its radius, positive.
        n: Samples along each parameter, one number or one by axis name.
        axes: The other pose axes: ``(low, high)``, a box beside the ball, or a number.

    Raises:
        InputError: An axis is unknown, missing or given twice; a number is no number; the radius is not positive.
    """
    who, names = "jk.design.ball", _names(robot)
    both = [name for name in center if name in axes]
    if both:
        raise InputError(f"{who}: the axis {both[0]!r} is given twice: leave it out of the axes beside the ball.")
    if not 1 <= len(center) <= 3:
        raise InputError(f"{who}: the center has {len(center)} axes: a ball needs one to three.")
    size = concrete_reals(radius)
    if size is None or size.ndim or not np.isfinite(size) or not size > 0:
        raise InputError(f"{who}: the radius is {radius!r}: it must be a positive number.")
    middle, half = _intervals(who, robot, {**axes, **dict(center)})
    for name in center:
        if half[names.index(name)] != 0:
            raise InputError(f"{who}: the center has {name} = {center[name]!r}: it must be one number.")
    round_ = tuple(names.index(name) for name in center)
    units = {robot.pose_axes[k].unit for k in round_}
    if len(units) > 1:
        raise InputError(f"{who}: its axes have the units {', '.join(sorted(units))}: those of a ball must be alike.")
    flat = tuple(int(k) for k in np.flatnonzero(half))
    half[list(round_)] = float(size)
    return Place("ball", names, middle, half, round_, flat, _numbers(who, robot, n, (*round_, *flat)))


def poses(robot: Mechanism, values: ArrayLike) -> Place:
    """Returns a list of prescribed poses.

    Args:
        robot: The mechanism.
        values: ``(k, n_pose)``, or one pose.

    Raises:
        InputError: Not real, finite numbers of that shape.
    """
    checked_single("jk.design.poses", robot)
    array = concrete_reals(values)
    count = len(robot.pose_axes)
    if array is None or array.ndim not in (1, 2) or array.shape[-1] != count or not array.size:
        raise InputError(
            f"jk.design.poses got {values!r}: it must be poses of shape (k, {count}), ({', '.join(_names(robot))})."
        )
    if not np.all(np.isfinite(array)):
        raise InputError(f"jk.design.poses got {values!r}: poses must be finite numbers.")
    listed = array.reshape(-1, count).copy()
    return Place("poses", _names(robot), listed.mean(axis=0), np.zeros(count), listed=listed)


def reach(robot: Mechanism, n: int | Mapping[str, int] = 5, lane: int = 0, /) -> Place:
    """Returns all that the joint limits reach in one assembly mode: the image of their box by forward kinematics.

    For mechanisms with a forward kernel whose lanes have an identity (``forward_labels``): the TLPM, the 3-PPPS.

    Args:
        robot: The mechanism; its limits are finite.
        n: Samples along each joint, one number or one by joint name.
        lane: The assembly mode.

    Raises:
        InputError: The lanes have no identity, there is no such lane, or a limit is infinite.
    """
    who = "jk.design.reach"
    checked_single(who, robot)
    if robot.forward_kernel is None or not robot.forward_labels:
        raise InputError(
            f"{who}: the assembly modes of a {type(robot).__name__} have no identity along a path: prescribe a box of "
            "poses, and ask for limit margins in it."
        )
    if isinstance(lane, bool) or lane not in range(len(robot.forward_labels)):
        raise InputError(f"{who}: lane is {lane!r}: choose 0 to {len(robot.forward_labels) - 1}.")
    limits = robot.limit_values()
    for axis, low, high in zip(robot.joint_axes, limits.low.tolist(), limits.high.tolist(), strict=True):
        if not np.isfinite([low, high]).all():
            raise InputError(f"{who}: {axis.name} goes from {low:g} to {high:g}: give it finite limits.")
    middle = np.asarray(robot.forward_kernel(as_tuple(0.5 * (limits.low + limits.high)))[lane].values, float)
    joints = tuple(axis.name for axis in robot.joint_axes)
    numbers = _counts(who, n, joints, tuple(range(len(joints))))
    return Place("reach", _names(robot), middle, np.zeros(len(middle)), numbers=numbers, lane=lane)


def _in_ball(u: Array) -> tuple[Array, ...]:
    """Returns a point of the unit ball in as many coordinates as there are parameters in [-1, 1]."""
    if len(u) < 2:
        return tuple(u)
    r, turn = 0.5 * (1 + u[0]), jnp.pi * u[-1]
    if len(u) == 2:
        return r * jnp.cos(turn), r * jnp.sin(turn)
    high, wide = jnp.sin(0.5 * jnp.pi * u[1]), jnp.cos(0.5 * jnp.pi * u[1])
    return r * wide * jnp.cos(turn), r * wide * jnp.sin(turn), r * high


def _names(robot: Mechanism) -> tuple[str, ...]:
    return tuple(axis.name for axis in robot.pose_axes)


def _intervals(who: str, robot: Mechanism, axes: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Returns middles and half widths of every pose axis."""
    checked_single(who, robot)
    names = _names(robot)
    for name in axes:
        if name not in names:
            raise InputError(f"{who} has an axis {name!r}: the pose axes are {', '.join(names)}; rename it.")
    center, half = np.zeros(len(names)), np.zeros(len(names))
    for k, name in enumerate(names):
        if name not in axes:
            raise InputError(f"{who} lacks the pose axis {name!r}: give it as (low, high) or as a number.")
        value = None if is_traced(axes[name]) else concrete_reals(axes[name])
        if value is None or value.shape not in ((), (2,)) or not np.all(np.isfinite(value)):
            raise InputError(f"{who}: {name} is {axes[name]!r}: it must be (low, high) or one number, finite.")
        low, high = (float(value[0]), float(value[1])) if value.ndim else (float(value), float(value))
        if value.ndim and not low < high:
            raise InputError(f"{who}: {name} goes from {low:g} to {high:g}: low must be less than high; exchange them.")
        center[k], half[k] = 0.5 * (low + high), 0.5 * (high - low)
    return center, half


def _numbers(who: str, robot: Mechanism, n: Any, free: tuple[int, ...]) -> tuple[int, ...]:
    return _counts(who, n, _names(robot), free)


def _counts(who: str, n: Any, names: tuple[str, ...], free: tuple[int, ...]) -> tuple[int, ...]:
    asked = dict(n) if isinstance(n, Mapping) else {names[k]: n for k in free}
    for name, count in asked.items():
        if name not in [names[k] for k in free]:
            raise InputError(f"{who} has samples along {name!r}, which is not free: leave it out.")
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 2:
            raise InputError(f"{who}: n is {count!r} along {name}: it must be a whole number, at least 2.")
    return tuple(int(asked.get(names[k], _SAMPLES)) for k in free)
