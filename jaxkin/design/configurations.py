"""The joints of prescribed poses in one working mode, past limits and past reach, so that designs can come back."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.design.places import Place
from jaxkin.kinematics.boundary import checked_single
from jaxkin.kinematics.legs import LegKind, Legs, leg_discriminants, leg_joints, legs_of

Coordinates: TypeAlias = tuple[Array, ...]


@dataclass(frozen=True)
class Posture:
    """How joints follow from a pose: by the mechanism's own kernel, or leg by leg in a working mode.

    Attributes:
        legs: None where the kernel serves.
        signs: The working mode.
        sizes: Size of each leg's discriminant at the mechanism for which this was made.
    """

    legs: Legs | None
    signs: tuple[int, ...] = ()
    sizes: tuple[float, ...] = ()

    @property
    def always_reaches(self) -> bool:
        """True where every pose has joints, limits aside."""
        return not self.missing

    @property
    def inside(self) -> Callable[[Mechanism, Coordinates], Array] | None:
        """The function of how far inside the reach poses are; None where every pose is."""
        return None if self.always_reaches else lambda robot, poses: self.joints(robot, poses)[1]

    def joints(self, robot: Mechanism, poses: Coordinates) -> tuple[Coordinates, Array]:
        """Returns joints of poses, and how far inside their reach the poses are (dimensionless, negative outside).

        Limits do not count. Where a leg does not reach, its joint is that at which it comes nearest.
        """
        if self.legs is None:
            (lane,) = robot.inverse_kernel(poses)  # type: ignore[misc]
            return lane.values, jnp.full(jnp.shape(lane.values[0]), jnp.inf)
        shape = jnp.broadcast_shapes(*(jnp.shape(part) for part in poses))
        rows = jnp.stack([jnp.broadcast_to(part, shape).reshape(-1) for part in poses], axis=-1)
        signs = jnp.asarray(self.signs, float)
        legs = self.legs

        def one(pose: Array) -> tuple[Array, Array]:
            inside = leg_discriminants(robot, legs, pose) / jnp.asarray(self.sizes)
            return leg_joints(robot, legs, signs, pose), jnp.min(inside)

        joints, inside = jax.vmap(one)(rows)
        return tuple(joints[:, k].reshape(shape) for k in range(joints.shape[1])), inside.reshape(shape)

    @property
    def missing(self) -> tuple[int, ...]:
        """The legs that do not reach every pose."""
        return () if self.legs is None else tuple(k for k, kind in enumerate(self.legs.kinds) if kind != LegKind.LINEAR)

    def reaches(self, robot: Mechanism, pose: Array) -> list[Array]:
        """Returns how far inside the reach of each leg that may miss it one pose is."""
        if not self.missing:
            return []
        assert self.legs is not None
        inside = leg_discriminants(robot, self.legs, pose)
        return [inside[k] / self.sizes[k] for k in self.missing]

    def of_one(self, robot: Mechanism, pose: Array) -> Array:
        """Returns the joints ``(n_joint,)`` of one pose, where a leg does not reach those at which it comes nearest."""
        if self.legs is not None:
            return leg_joints(robot, self.legs, jnp.asarray(self.signs, float), pose)
        return jnp.stack(self.joints(robot, tuple(pose))[0])


def posture_of(who: str, robot: Mechanism, mode: Sequence[int] | None, pose: np.ndarray) -> Posture:
    """Finds how the joints of a mechanism follow from its poses.

    Args:
        who: The public function that asks.
        robot: One mechanism with plain numbers.
        mode: One sign a leg; None where there is only one working mode.
        pose: ``(n_pose,)`` where the sizes of things are taken.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: There are several working modes and none is chosen, or the joints do not follow leg by leg.
    """
    checked_single(who, robot)
    if robot.inverse_kernel is not None and len(robot.inverse_kernel(tuple(jnp.asarray(pose, float)))) == 1:
        if mode is not None:
            raise InputError(f"{who}: mode is {mode!r}: a {type(robot).__name__} has one working mode; leave it out.")
        return Posture(None)
    return _by_legs(who, robot, mode, pose)


def posture_over(who: str, robot: Mechanism, place: Place, mode: Sequence[int] | None) -> Posture:
    """Returns ``posture_of`` at the pose of a place that stands for it.

    Raises:
        InputError: It is no place, or as for ``posture_of``.
    """
    if not isinstance(place, Place):
        raise InputError(f"{who} got {place!r} as its place: make one by jk.design.box, ball, poses or reach.")
    return posture_of(who, robot, mode, place.representative)


def legs_posture(robot: Mechanism, posture: Posture, pose: np.ndarray) -> Posture | None:
    """Returns the same posture leg by leg, from the constraints alone; None where the joints do not follow so.

    Its operations are few, and enclosures of all are known.
    """
    if posture.legs is not None:
        return posture
    legs = legs_of(robot)
    return _by_legs("", robot, None, pose) if legs is not None and len(legs.modes) == 1 else None


def _by_legs(who: str, robot: Mechanism, mode: Sequence[int] | None, pose: np.ndarray) -> Posture:
    legs = legs_of(robot)
    if legs is None:
        raise InputError(
            f"{who}: the joints of a {type(robot).__name__} do not follow leg by leg from a pose, and it has no "
            "inverse_kernel of one lane: give it one."
        )
    modes = legs.modes
    chosen = modes[0] if mode is None and len(modes) == 1 else None if mode is None else tuple(map(int, mode))
    if chosen is None or chosen not in modes:
        told = "not given" if mode is None else f"{tuple(mode)!r}"
        raise InputError(
            f"{who}: the working mode is {told}: choose mode= among {', '.join(map(str, modes))} (the sign of each "
            "leg's entry of B)."
        )
    sizes = np.abs(np.asarray(leg_discriminants(robot, legs, jnp.asarray(pose, float))))
    typical = np.where(sizes > 0, sizes, 1.0)
    return Posture(legs, chosen, tuple(float(size) for size in typical))
