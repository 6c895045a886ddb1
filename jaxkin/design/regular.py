"""Objectives of regular workspaces: the nearest singular pose, the largest box or ball without one, their number."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.design.enclosed import proved_free
from jaxkin.design.growing import Growth, Rays, contacts, contacts_and_nearest
from jaxkin.design.objective import LEAST, ONLY, Measured, Objective, checked_width
from jaxkin.design.places import Place, poses
from jaxkin.design.walls import walls_of
from jaxkin.kinematics.legs import legs_of

#: Rays of the smooth function, and of what is measured after the fact.
_RAYS, _MORE_RAYS = Rays(), Rays(4096, 96, 128, 8)
#: A body smaller by this share is what is proved to be free.
_PROVED_SHARE = 1e-6


def regular_size(
    robot: Mechanism,
    place: Place,
    *,
    grows: Sequence[str] | None = None,
    limits: bool | Sequence[str] = True,
    mode: Sequence[int] | None = None,
    most: float = 10.0,
    width: float = 0.0,
) -> Objective:
    """Returns the objective of the largest regular workspace about a pose: without singularities, within limits.

    The workspace has the shape of the place and grows about its middle: a box in the axes that grow, or a ball; what is
    beside the ball keeps its interval. The size is that of the radius (of the first growing axis' half width). Where
    the middle violates a limit it is negative, the way back to first order.

    Args:
        robot: The mechanism, for which the objective is made.
        place: A box or a ball, with the proportions that are meant.
        grows: Of a box, the names of the axes that grow; all free ones by default.
        limits: True for all finite margins (limits, clearances), False for singularities alone, or names of margins.
        mode: The working mode, one sign a joint; needed where there are several.
        most: Largest size that is looked at, in sizes of the place.
        width: Width of the smoothing between walls, in the unit; 0 takes the nearest wall.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: No box or ball, an axis that is not free, no such margin, or the working mode is not given.

    Points of contact solve Lagrange's conditions (see ``jaxkin.design.growing``): derivatives are those of the size.
    """
    options: dict[str, Any] = {"grows": grows, "limits": limits, "mode": mode, "most": most, "width": width}
    return _regular_size(robot, place, options, None)


def _regular_size(robot: Mechanism, place: Place, options: dict[str, Any], known: np.ndarray | None) -> Objective:
    """Returns the objective of ``regular_size``, with contacts that its rays may miss."""
    who, most = "jk.design.regular_size", options["most"]
    growth = _growth(who, robot, place, options["grows"], options["limits"], options["mode"], most, known)
    first = growth.growing[0]
    unit = float(place.half[first])
    names = growth.walls.names
    w = checked_width(who, options["width"])

    def parts(robot: Mechanism, center: Array | None) -> Array:
        return unit * contacts(growth, _RAYS, robot, place.middle(robot, center))

    finer = jax.jit(partial(contacts_and_nearest, growth, _MORE_RAYS))

    def sharper(contact: np.ndarray) -> Objective:
        return _regular_size(robot, place, options, contact if known is None else np.concatenate([known, contact]))

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        middle = place.middle(robot, center)
        sizes, nearest = (np.asarray(part) for part in finer(robot, middle))
        which = int(np.argmin(sizes))
        size = float(sizes[which])
        proof = proved_free(growth, robot, np.asarray(middle), size * (1 - _PROVED_SHARE)) if size > 0 else None
        told = f"polished from the shortest of {_MORE_RAYS.rays} rays to each wall"
        return Measured(
            unit * size,
            unit * abs(size) * (_PROVED_SHARE if proof else 1e-9),
            part=names[which] if size < growth.most else "no wall",
            evidence=f"{told}; {proof}" if proof else told,
            parameters=nearest[None] if size > 0 else None,
            proved=bool(proof),
        )

    return Objective(
        name="regular workspace",
        unit=robot.pose_axes[first].unit,
        parts=parts,
        worst=LEAST,
        width=w,
        smoothing=(
            f"log-sum-exp of width {w:g} over {len(names)} walls, at most {w * np.log(len(names)):.3g} below the "
            "nearest of them; no smoothing of the distance to each"
        ),
        measure=measured,
        place=place,
        names=names,
        sharper=sharper,
        content={
            "objective": "regular workspace",
            "place": place.content(),
            "grows": list(growth.growing),
            "walls": list(names),
            "mode": list(growth.walls.posture.signs),
            "most": most,
            "width": w,
        },
    )


def singularity_distance(
    robot: Mechanism,
    pose: ArrayLike,
    *,
    length: float | None = None,
    mode: Sequence[int] | None = None,
    most: float = 10.0,
) -> Objective:
    """Returns the objective of the distance from a pose to the nearest singular one.

    The distance is Euclidean in units of the characteristic length and of radians, by batched Newton on Lagrange's
    conditions from the shortest of many rays. On a singularity it is zero.

    Args:
        robot: The mechanism, for which the objective is made.
        pose: ``(n_pose,)``.
        length: The length that stands for a radian; by default the mechanism's characteristic length as it is given.
        mode: The working mode, one sign a joint; needed where there are several.
        most: Largest distance that is looked at, dimensionless.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: No pose, or the working mode is not given.

    References:
        Li, H., Gosselin, C. and Richard, M., 2007, "Determination of the maximal singularity-free zones in the
        six-dimensional workspace of the general Gough-Stewart platform": the nearest singularity by Lagrange's
        conditions.
    """
    who = "jk.design.singularity_distance"
    listed = poses(robot, pose)
    assert listed.listed is not None
    if len(listed.listed) != 1:
        raise InputError(f"{who}: pose has shape {np.shape(pose)}: give one pose.")
    size = float(robot.characteristic_length()) if length is None else float(length)
    if not (np.isfinite(size) and size > 0):
        raise InputError(f"{who}: length is {length!r}: it must be a positive number.")
    half = np.asarray(scale_vector(robot.pose_axes, jnp.asarray(size)))
    n = len(half)
    ball = Place("ball", listed.axes, listed.listed[0], half, tuple(range(n)), (), (2,) * n)
    growth = Growth(ball, walls_of(who, robot, ball.center, mode, False), (), most)
    finer = jax.jit(partial(contacts, growth, _MORE_RAYS))

    def parts(robot: Mechanism, center: Array | None) -> Array:
        # On a singularity what is signed is the way to the other side.
        return jnp.abs(contacts(growth, _RAYS, robot, ball.middle(robot, center)))

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        sizes = np.abs(np.asarray(finer(robot, ball.middle(robot, center))))
        which = int(np.argmin(sizes))
        told = f"polished from the shortest of {_MORE_RAYS.rays} rays"
        return Measured(float(sizes[which]), 1e-9 * float(sizes[which]), part=growth.walls.names[which], evidence=told)

    return Objective(
        name="distance to singularity",
        unit="1",
        parts=parts,
        worst=LEAST,
        width=0.0,
        smoothing="none: the nearest of the factors' zeros, each by Lagrange's conditions",
        measure=measured,
        place=listed,
        names=growth.walls.names,
        content={
            "objective": "distance to singularity",
            "pose": ball.center.tolist(),
            "length": size,
            "mode": list(growth.walls.posture.signs),
            "most": most,
        },
    )


def regular_workspaces(
    robot: Mechanism,
    place: Place,
    size: float,
    *,
    grows: Sequence[str] | None = None,
    limits: bool | Sequence[str] = True,
    most: float = 10.0,
    width: float | None = None,
) -> Objective:
    """Returns the objective of the number of working modes in which there is a regular workspace of a size.

    Args:
        robot: The mechanism, for which the objective is made.
        place: As for ``regular_size``.
        size: Least size that counts, in the unit of ``regular_size``.
        grows: As for ``regular_size``.
        limits: As for ``regular_size``.
        most: As for ``regular_size``.
        width: Width of the smoothing, in the unit; 5 % of the size by default.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``regular_size``.
    """
    who = "jk.design.regular_workspaces"
    w = 0.05 * abs(size) if width is None else checked_width(who, width)
    if not w > 0:
        raise InputError(f"{who}: width is {width!r}: a number of workspaces is smooth only with a positive one.")
    legs = legs_of(robot) if robot.inverse_kernel is None else None
    modes: list[Any] = [None] if legs is None else list(legs.modes)
    options: dict[str, Any] = {"grows": grows, "limits": limits, "most": most}
    each = [regular_size(robot, place, mode=mode, width=w, **options) for mode in modes]

    def parts(robot: Mechanism, center: Array | None) -> Array:
        sizes = jnp.stack([one(robot, center) for one in each])
        return jnp.sum(jax.nn.sigmoid((sizes - size) / w))[None]

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        found = [one.measure(robot, center) for one in each]
        told = ", ".join(f"{mode or 'the working mode'}: {m.value:.6g}" for mode, m in zip(modes, found, strict=True))
        smoothed = float(sum(jax.nn.sigmoid((m.value - size) / w) for m in found))
        return Measured(float(sum(m.value >= size for m in found)), 0.0, evidence=told, smoothed=smoothed)

    return Objective(
        name="regular workspaces",
        unit="1",
        parts=parts,
        worst=ONLY,
        width=0.0,
        smoothing=(
            f"each of {len(modes)} working modes counts by a logistic function of its size, of width {w:g}; the size "
            "is that of regular_size with this width"
        ),
        measure=measured,
        place=place,
        content={"objective": "regular workspaces", "each": each[0].content, "size": size, "width": w},
    )


def _growth(
    who: str,
    robot: Mechanism,
    place: Place,
    grows: Sequence[str] | None,
    limits: bool | Sequence[str],
    mode: Sequence[int] | None,
    most: float,
    known: np.ndarray | None = None,
) -> Growth:
    if not isinstance(place, Place) or place.kind not in ("box", "ball"):
        raise InputError(f"{who} got {place!r} as its place: make a box or a ball by jk.design.box or jk.design.ball.")
    free = tuple(place.axes[k] for k in place.free)
    chosen = free if grows is None else (grows,) if isinstance(grows, str) else tuple(grows)
    if place.round and grows is not None:
        raise InputError(f"{who}: grows is {chosen}: a ball grows in its own axes; leave it out.")
    for name in chosen:
        if name not in free:
            raise InputError(
                f"{who}: grows has {name!r}, which is not free in {place}: choose among {', '.join(free)}."
            )
    if not chosen:
        raise InputError(f"{who}: nothing grows: name at least one of {', '.join(free)}.")
    if not (np.isfinite(most) and most > 0):
        raise InputError(f"{who}: most is {most!r}: it must be a positive number.")
    return Growth(place, walls_of(who, robot, place.center, mode, limits), chosen, float(most), known)
