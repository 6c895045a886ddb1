"""``jk.fold``: the surface of poses over a section around one singular pose, and the fold on it."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.precision import TOLERANCES
from jaxkin.kinematics.boundary import checked_vector
from jaxkin.mapping.chart import Chart, SectionData
from jaxkin.mapping.loci import evaluated
from jaxkin.mapping.section import Section, bind_section
from jaxkin.numerics import newton
from jaxkin.sweep.grid import Grid

#: How often a patch is made smaller until all of it closes.
_SHRINKINGS = 24


@dataclass(frozen=True)
class Fold:
    """A patch of the section's surface of poses: over its joints it lies in several sheets, which meet along a fold.

    Attributes:
        joints: ``(n, n, n_joint)``.
        poses: ``(n, n, n_pose)``, angles continuous over the patch.
        determinant: ``(n, n)`` det dF/dpose, dimensionless; its sign tells the sheets apart.
        fold_joints: ``(k, n_joint)`` along the singular curve through the pose.
        fold_poses: ``(k, n_pose)``.
        pose: ``(n_pose,)`` the singular pose.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        free: Names of the two free joint axes.
        units: Unit of every axis.
    """

    joints: np.ndarray
    poses: np.ndarray
    determinant: np.ndarray
    fold_joints: np.ndarray
    fold_poses: np.ndarray
    pose: np.ndarray
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    free: tuple[str, str]
    units: dict[str, str]


def fold(robot: Mechanism, section: Grid, pose: ArrayLike, radius: float = 0.4, samples: int = 61) -> Fold:
    """Samples the surface of poses over a section around a singular pose, such as a cusp's.

    Args:
        robot: The mechanism.
        section: A grid with two free joint axes, as for ``cusps``.
        pose: ``(n_pose,)`` a singular pose over the section.
        radius: Half the width of the patch, in characteristic lengths and radians; made less where the surface
            bends away from its tangent plane before.
        samples: Points a side; odd, so that the pose is one of them.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``singular_curves``; the pose is not over the section or not singular; a radius that is
            not positive, or too few samples.
    """
    bound = bind_section("jk.fold", robot, section)
    if not 0 < radius < 10 or samples < 3:
        raise InputError(
            f"jk.fold: radius is {radius!r} and samples is {samples!r}: radius must be positive, samples at least 3."
        )
    vector = np.asarray(checked_vector("jk.fold", "the pose", pose, robot.pose_axes))
    if bound.chart.unknown:
        raise InputError(
            "jk.fold: a free joint of this section is not given by the pose: such folds are not drawn yet."
        )
    u = vector / np.asarray(bound.data.pose_unit)
    centre = np.asarray(_centre(bound.chart, bound.data, jnp.asarray(u)))
    if not np.max(np.abs(centre - u)) < 1e-6:
        raise InputError(
            f"jk.fold: no singular pose of the section {bound.describe()} lies at {vector.tolist()}: take one from "
            "jk.cusps or jk.singular_curves of this section."
        )
    for _ in range(_SHRINKINGS):
        points, determinant, curve, good, missed = (
            np.asarray(a) for a in _patch(bound.chart, bound.data, jnp.asarray(centre), radius, samples | 1)
        )
        if missed <= 1e-10:
            break
        radius *= 0.8
    else:
        raise InputError(
            f"jk.fold: the surface bends away within {radius:g} of {vector.tolist()}: give a smaller radius."
        )
    return _record(bound, points, determinant, curve[good], vector)


def _record(section: Section, points: np.ndarray, determinant: np.ndarray, curve: np.ndarray, pose: np.ndarray) -> Fold:
    side, unit = points.shape[0], np.asarray(section.data.pose_unit)
    record = section.record("fold")
    joints = evaluated(section, points.reshape(-1, points.shape[-1]))[0]
    names = record["joint_names"]
    return Fold(
        joints=joints.reshape(side, side, -1),
        poses=points * unit,
        determinant=determinant,
        fold_joints=evaluated(section, curve)[0],
        fold_poses=curve * unit,
        pose=pose,
        pose_names=record["pose_names"],
        joint_names=names,
        free=(names[section.grid.free[0]], names[section.grid.free[1]]),
        units=record["units"],
    )


def _to_singular(chart: Chart, data: SectionData, u: Array) -> Array:
    return newton.polish(partial(chart.singular, data), u, steps=4)


_centre = jax.jit(_to_singular, static_argnames="chart")


def _patched(
    chart: Chart, data: SectionData, centre: Array, radius: Array, samples: int
) -> tuple[Array, Array, Array, Array, Array]:
    """Samples the surface over its tangent plane, and the singular curve over its tangent."""
    along = chart.tangent(data, centre)
    along = along / jnp.sqrt(jnp.sum(along * along))
    rows = jax.jacfwd(partial(chart.section, data))(centre)
    # Across the curve, within the surface: what is orthogonal to its normals and to the curve's direction.
    across = jnp.linalg.svd(jnp.concatenate([rows, along[None]]), full_matrices=True)[2][-1]
    grid = jnp.linspace(-radius, radius, samples)

    def onto_surface(a: Array, b: Array) -> Array:
        guess = centre + a * along + b * across

        def system(u: Array) -> Array:
            return jnp.concatenate(
                [chart.section(data, u), jnp.stack([jnp.dot(along, u - guess), jnp.dot(across, u - guess)])]
            )

        return newton.polish(system, guess, steps=8, trust=0.3)

    def onto_curve(a: Array) -> tuple[Array, Array]:
        guess = centre + a * along

        def system(u: Array) -> Array:
            return jnp.append(chart.singular(data, u), jnp.dot(along, u - guess))

        u = newton.polish(system, guess, steps=12, trust=0.1)
        return u, jnp.max(jnp.abs(system(u))) < TOLERANCES.residual

    points = jax.vmap(lambda a: jax.vmap(lambda b: onto_surface(a, b))(grid))(grid)
    missed = jax.vmap(jax.vmap(lambda u: jnp.max(jnp.abs(chart.section(data, u)), initial=0.0)))(points)
    determinant = jax.vmap(jax.vmap(partial(chart.determinant, data)))(points)
    curve, good = jax.vmap(onto_curve)(jnp.linspace(-radius, radius, 4 * samples))
    return points, determinant, curve, good, jnp.max(missed)


_patch = jax.jit(_patched, static_argnames=("chart", "samples"))
