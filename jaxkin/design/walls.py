"""What bounds a regular workspace: singularities, limits, the reach of legs, as functions of the pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.design.configurations import Posture, legs_posture, posture_of
from jaxkin.mapping.chart import factor_names
from jaxkin.numerics import small_linalg
from jaxkin.numerics.newton import lattice

#: Poses all around, from which the walls' sizes are taken.
_AROUND = 32


@dataclass(frozen=True)
class Walls:
    """Named functions of the pose that must not vanish; dimensionless, of order one.

    Attributes:
        posture: How joints follow from poses.
        factors: Names of the singularity's factors; ``("det A",)`` where the mechanism declares none.
        margins: Names of the margins that count.
        sizes: What each wall is divided by, so that it is of order one.
    """

    posture: Posture
    factors: tuple[str, ...]
    margins: tuple[str, ...]
    sizes: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all walls."""
        reaches = [f"reach of leg {k + 1}" for k in self.posture.missing]
        return (*self.factors, *reaches, *self.margins)

    @property
    def singular(self) -> np.ndarray:
        """``(m,)`` True for walls of which either side will do: singularities."""
        return np.arange(len(self.names)) < len(self.factors)

    def values(self, robot: Mechanism, pose: Array) -> Array:
        """Returns all walls at a pose, ``(m,)``; limits and reach are positive inside."""
        joints = self.posture.of_one(robot, pose)
        parts = self._factors(robot, pose, joints) + self.posture.reaches(robot, pose)
        if self.margins:
            margins = robot.margins(pose, joints)
            parts += [margins[name] for name in self.margins]
        return jnp.stack(parts) / jnp.asarray(self.sizes)

    def _factors(self, robot: Mechanism, pose: Array, joints: Array) -> list[Array]:
        if self.factors != ("det A",):
            found = robot.factors(pose)  # type: ignore[attr-defined]
            return [found[name] for name in self.factors]
        matrix = jax.jacfwd(robot.constraints)(pose, joints)
        matrix = matrix * scale_vector(robot.pose_axes, robot.characteristic_length())[None, :]
        return [small_linalg.any_determinant(matrix)]


def walls_of(
    who: str, robot: Mechanism, pose: np.ndarray, mode: Sequence[int] | None, limits: bool | Sequence[str]
) -> Walls:
    """Finds the walls of a mechanism.

    Args:
        who: The public function that asks.
        robot: One mechanism with plain numbers.
        pose: ``(n_pose,)`` in the middle of the workspace.
        mode: The working mode; None where there is only one.
        limits: True for all finite margins, False for none, or their names.

    Raises:
        InputError: There is no such margin, or as for ``posture_of``.
    """
    posture = posture_of(who, robot, mode, pose)
    factors = factor_names(robot) if hasattr(robot, "factors") else ("det A",)
    joints = posture.of_one(robot, jnp.asarray(pose, float))
    found = {name: float(value) for name, value in robot.margins(jnp.asarray(pose, float), joints).items()}
    finite = [name for name, value in found.items() if not np.isinf(value)]
    chosen = finite if limits is True else [] if limits is False else list(limits)
    for name in chosen:
        if name not in finite:
            raise InputError(
                f"{who}: there is no finite margin {name!r}: choose among {', '.join(finite) or '(none)'}."
            )
    return _sized(robot, Walls(posture, factors, tuple(chosen), ()), pose)


def enclosable(robot: Mechanism, walls: Walls, pose: np.ndarray) -> Walls | None:
    """Returns the same walls from the constraints alone, of which enclosures are known; None where there are none."""
    posture = legs_posture(robot, walls.posture, pose)
    return None if posture is None else _sized(robot, replace(walls, posture=posture), pose)


def _sized(robot: Mechanism, walls: Walls, pose: np.ndarray) -> Walls:
    bare = replace(walls, sizes=(1.0,) * len(walls.names))
    around = jnp.asarray(pose) + jnp.asarray(2 * lattice(_AROUND, len(pose)) - 1) * scale_vector(
        robot.pose_axes, robot.characteristic_length()
    )
    values = np.abs(np.asarray(jax.vmap(lambda x: bare.values(robot, x))(around)))
    typical = np.nanmean(np.where(np.isfinite(values), values, np.nan), axis=0)
    return replace(bare, sizes=tuple(float(size) if size > 0 else 1.0 for size in typical))
