"""Objectives of workspace volume: exact integrals over the workspace's own boundary, not counts."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.design.objective import ONLY, Measured, Objective
from jaxkin.kinematics.boundary import checked_single
from jaxkin.mapping.workspace import workspace_volume as volume_of
from jaxkin.numerics import spheres
from jaxkin.numerics.spheres import Shells

#: Points in each interval of heights: optimisers ask often, and what is measured takes 64.
_POINTS = 16


def workspace_volume(robot: Mechanism, *, branch: str = "upper", phi: float = 0.0) -> Objective:
    """Returns the objective of the volume (in the plane: the area) that the limits leave of the workspace.

    For the TLPM the volume of one branch (``jk.workspace_volume``); for a planar 3-RPR with leg limits the area at one
    angle of the platform, for a five-bar the area between its legs' circles: both the intersection of rings, whose
    boundary is arcs, integrated in closed form (Green's theorem). Derivatives are those of the boundary.

    Args:
        robot: The mechanism, with ``reach_spheres()`` or ``reach_rings(phi)``, for which the objective is made.
        branch: Of the TLPM, ``"upper"`` or ``"lower"``.
        phi: Of a 3-RPR, the angle of the platform, rad.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The mechanism has no workspace of this kind, or a limit is infinite.
        GeometryError: As for ``jk.workspace_volume``.
    """
    who = "jk.design.workspace_volume"
    checked_single(who, robot)
    if hasattr(robot, "reach_spheres"):
        volume_of(robot, branch)
        return _objective(
            "workspace volume",
            f"{robot.pose_axes[0].unit}^3",
            _volume,
            lambda robot: (float((found := volume_of(robot, branch)).volume), float(found.error)),
            {"branch": branch},
            f"by {_POINTS} points between heights where slices change, within 1e-8 of the volume",
        )
    if not hasattr(robot, "reach_rings"):
        raise InputError(
            f"{who}: a {type(robot).__name__} has no workspace of this kind: it needs a method reach_spheres() or "
            "reach_rings(phi); jk.sweep(robot, 'limit_margins', grid) maps any."
        )
    if not math.isfinite(phi):
        raise InputError(f"{who}: phi is {phi!r}: it must be a finite number.")
    rings = robot.reach_rings(phi)  # type: ignore[attr-defined]
    if not np.all(np.isfinite(rings.high)):
        raise InputError(f"{who}: a leg has no upper limit: give it one by robot.with_limits(...).")

    def area(robot: Mechanism) -> Array:
        return ring_area(robot.reach_rings(phi))  # type: ignore[attr-defined]

    def with_error(robot: Mechanism) -> tuple[float, float]:
        found = spheres.section(_proper(robot.reach_rings(phi)), jnp.zeros(()))  # type: ignore[attr-defined]
        return float(found.area), float(found.rounding)

    unit = f"{robot.pose_axes[0].unit}^2"
    return _objective("workspace area", unit, area, with_error, {"phi": phi}, "arcs in closed form")


def _volume(robot: Mechanism) -> Array:
    """Returns the volume of one branch; both are mirror images. NaN where the geometry has none."""
    shells, _ = robot.reach_spheres()  # type: ignore[attr-defined]
    good = robot.geometry_ok() & jnp.all((shells.low > 0) & (shells.low < shells.high))
    return jnp.where(good, spheres.volume(shells, _POINTS), jnp.nan)


def ring_area(rings: Shells) -> Array:
    """Returns the area of the intersection of three rings."""
    return spheres.section(_proper(rings), jnp.zeros(())).area


def _proper(rings: Shells) -> Shells:
    """Makes inner radii positive, so that the arithmetic of circles holds; a ring without inner circle has a speck."""
    speck = 1e-150
    return Shells(rings.centres, jnp.maximum(rings.low, speck), jnp.maximum(rings.high, 2 * speck))


def _objective(
    name: str,
    unit: str,
    value: Callable[[Mechanism], Array],
    with_error: Callable[[Mechanism], tuple[float, float]],
    content: dict[str, object],
    rule: str,
) -> Objective:
    kernel = jax.jit(value)

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        del center
        return Measured(*with_error(robot), evidence="closed form of the slices' areas")

    return Objective(
        name=name,
        unit=unit,
        parts=lambda robot, center: kernel(robot)[None],
        worst=ONLY,
        width=0.0,
        smoothing=f"none: the boundary is integrated, and so is its motion with the geometry; {rule}",
        measure=measured,
        content={"objective": name, **content},
    )
