"""The equations of a section: what is unknown, what vanishes, what lies inside.

A section frees two joints and fixes the others; the poses over it form a surface, on which det A = 0 (A = dF/dpose) is
a curve. Unknown are the pose and those free joints that the pose does not give. A joint is *explicit* where one
equation gives it from the pose alone, as itself (a linear actuator) or as its square (a leg of length rho: the
equation of |B - A|^2 - rho^2 stays smooth through rho = 0, where rho itself does not). For the 3-RPR both free legs are
explicit: three unknowns, one equation of the fixed leg, and the determinant.
"""

from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.numerics.newton import lattice
from jaxkin.numerics.small_linalg import expanded_determinant, null_vector


class Explicit(NamedTuple):
    """A free joint that one equation gives from the pose.

    Attributes:
        joint: Index of the joint.
        row: Index of the equation, which no other unknown joint enters.
        degree: 1 where the equation is linear in the joint, 2 where it holds the joint's square alone.
    """

    joint: int
    row: int
    degree: int


class SectionData(NamedTuple):
    """The numbers of a section, a pytree.

    Attributes:
        robot: The mechanism.
        fixed: ``(n_joint,)`` joint values, those of the free joints being the middle of their range.
        pose_unit: ``(n_pose,)`` one unit per pose axis.
        joint_unit: ``(n_joint,)`` one unit per joint axis.
        row_scale: ``(n,)`` magnitude of each equation's terms.
        matrix_scale: ``(n,)`` magnitude of each row of A, for poses in their units.
        low: ``(2,)`` lower ends of the free joints.
        high: ``(2,)`` upper ends.
    """

    robot: Mechanism
    fixed: Array
    pose_unit: Array
    joint_unit: Array
    row_scale: Array
    matrix_scale: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class Chart:
    """The structure of a section's equations; hashable, so that one compilation serves all numbers.

    Points u are dimensionless: the pose in its units, then the free joints that are not explicit in theirs.

    Attributes:
        n_pose: Number of pose coordinates, and of equations.
        free: Indices of the two free joints.
        explicit: Free joints that the pose gives.
        implicit: Free joints that are unknowns.
        rows: Equations that hold on the section, those of the explicit joints left out.
    """

    n_pose: int
    free: tuple[int, int]
    explicit: tuple[Explicit, ...]
    implicit: tuple[int, ...]
    rows: tuple[int, ...]

    @property
    def dimension(self) -> int:
        """Number of unknowns; there are two more of them than equations of the section."""
        return self.n_pose + len(self.implicit)

    def configuration(self, data: SectionData, u: Array) -> tuple[Array, Array]:
        """Returns pose and joints, explicit joints at zero."""
        joints = data.fixed
        for entry in self.explicit:
            joints = joints.at[entry.joint].set(0.0)
        for k, joint in enumerate(self.implicit):
            joints = joints.at[joint].set(u[self.n_pose + k] * data.joint_unit[joint])
        return u[: self.n_pose] * data.pose_unit, joints

    def section(self, data: SectionData, u: Array) -> Array:
        """Returns the equations that keep u on the section, dimensionless."""
        if not self.rows:
            return jnp.zeros(0)
        rows = np.array(self.rows)
        return (data.robot.constraints(*self.configuration(data, u)) / data.row_scale)[rows]

    def matrix(self, data: SectionData, u: Array) -> Array:
        """Returns A = dF/dpose, dimensionless, ``(n, n)``."""
        pose, joints = self.configuration(data, u)
        direct = jax.jacfwd(data.robot.constraints)(pose, joints)
        return direct * data.pose_unit[None, :] / data.matrix_scale[:, None]

    def determinant(self, data: SectionData, u: Array) -> Array:
        """Returns det A, dimensionless, a polynomial of the entries."""
        return expanded_determinant(self.matrix(data, u))

    def singular(self, data: SectionData, u: Array) -> Array:
        """Returns the equations of the singular curve: section and determinant."""
        return jnp.append(self.section(data, u), self.determinant(data, u))

    def kernel(self, data: SectionData, u: Array) -> Array:
        """Returns the largest column of the adjugate of A: where det A = 0, a direction with A v = 0.

        A fixed column would vanish on a surface of its own.
        """
        adjugate = jax.grad(expanded_determinant)(self.matrix(data, u)).T
        best = jnp.argmax(jnp.sum(adjugate * adjugate, axis=0))
        return adjugate[:, best]

    def fold_rate(self, data: SectionData, u: Array) -> Array:
        """Returns the change of det A along its kernel, which vanishes at cusps (and where det A crosses itself)."""
        direction = jnp.concatenate([self.kernel(data, u), jnp.zeros(len(self.implicit))])
        return jax.jvp(partial(self.determinant, data), (u,), (direction,))[1]

    def cusp(self, data: SectionData, u: Array) -> Array:
        """Returns the square system of cusps."""
        return jnp.append(self.singular(data, u), self.fold_rate(data, u))

    def critical(self, data: SectionData, u_multipliers: Array) -> Array:
        """Returns the square system of critical points of det A on the section, in u and Lagrange's multipliers."""
        u, multipliers = u_multipliers[: self.dimension], u_multipliers[self.dimension :]
        slope = jax.grad(partial(self.determinant, data))(u)
        pull = jax.vjp(partial(self.section, data), u)[1](multipliers)[0]
        return jnp.append(self.section(data, u), slope - pull)

    def explicit_value(self, data: SectionData, u: Array, entry: Explicit) -> Array:
        """Returns an explicit joint, or its square where the degree is 2 (never negative up to rounding)."""
        pose, joints = self.configuration(data, u)

        def row(value: Array) -> Array:
            return data.robot.constraints(pose, joints.at[entry.joint].set(value))[entry.row]

        zero = jnp.zeros(())
        if entry.degree == 1:
            return -row(zero) / jax.grad(row)(zero)
        return -2 * row(zero) / jax.grad(jax.grad(row))(zero)

    def joints(self, data: SectionData, u: Array) -> Array:
        """Returns all joint values, ``(n_joint,)``."""
        joints = self.configuration(data, u)[1]
        for entry in self.explicit:
            value = self.explicit_value(data, u, entry)
            value = jnp.sqrt(jnp.maximum(value, 0.0)) if entry.degree == 2 else value
            joints = joints.at[entry.joint].set(value)
        return joints

    def pose(self, data: SectionData, u: Array) -> Array:
        """Returns the pose in its own units, angles as they come."""
        return u[: self.n_pose] * data.pose_unit

    def margins(self, data: SectionData, u: Array) -> Array:
        """Returns four smooth functions, not negative inside the box: first axis low, high, then the second's.

        Squares are compared with squares; a lower end at zero is no border for them, as no square is negative.
        """
        parts = []
        for k, joint in enumerate(self.free):
            low, high, unit = data.low[k], data.high[k], data.joint_unit[joint]
            entry = next((e for e in self.explicit if e.joint == joint), None)
            if entry is None:
                value = u[self.n_pose + self.implicit.index(joint)] * unit
            else:
                value = self.explicit_value(data, u, entry)
            if entry is not None and entry.degree == 2:
                scale = unit * (unit + high)
                below = jnp.where(low > 0, (value - low * low) / scale, 1.0)
                parts += [below, (high * high - value) / scale]
            else:
                parts += [(value - low) / unit, (high - value) / unit]
        return jnp.stack(parts)

    def tangent(self, data: SectionData, u: Array) -> Array:
        """Returns the oriented direction of the singular curve, not normalised; zero at a crossing."""
        return null_vector(jax.jacfwd(partial(self.singular, data))(u))


def chart_of(robot: Mechanism, free: tuple[int, int]) -> Chart:
    """Finds which free joints the pose gives, from derivatives of the constraints at a few points.

    The constraints are polynomial in lengths, sines and cosines: a derivative that vanishes at points in general
    position vanishes everywhere.
    """
    n = len(robot.pose_axes)
    at_zero, first, second, mixed = (np.asarray(part) for part in _derivatives(robot))
    scale = np.max(np.abs(first), axis=(0, 2), keepdims=True) + 1e-300
    involved = np.any(np.abs(first) > 1e-13 * scale, axis=0)
    explicit = []
    for joint in free:
        rows = np.flatnonzero(involved[:, joint])
        if len(rows) != 1:
            continue
        row, others = rows[0], [k for k in free if k != joint]
        size = float(np.max(np.abs(first[:, row])))
        bends, tilts = second[:, row, joint], mixed[:, row, joint]
        if involved[row, others].any() or np.max(np.abs(tilts)) > 1e-13 * size:
            continue
        linear = np.max(np.abs(bends)) <= 1e-13 * size
        square = np.ptp(bends) <= 1e-13 * size and np.max(np.abs(at_zero[:, row, joint])) <= 1e-13 * size
        if linear or square:
            explicit.append(Explicit(joint, int(row), 1 if linear else 2))
    implicit = tuple(joint for joint in free if joint not in [entry.joint for entry in explicit])
    rows = tuple(row for row in range(n) if row not in [entry.row for entry in explicit])
    return _chart(n, free, tuple(explicit), implicit, rows)


@cache
def _chart(*structure: Any) -> Chart:
    """One object a structure: kernels are compiled for its bound methods, which are equal only if the object is one."""
    return Chart(*structure)


@jax.jit
def _derivatives(robot: Mechanism) -> tuple[Array, Array, Array, Array]:
    """Returns dF/dq with q = 0 and at q, the diagonal of d2F/dq2, and d2F/dq dx, at three points each."""
    n, length = len(robot.pose_axes), robot.characteristic_length()
    points = jnp.asarray(lattice(3, 2 * n) + 0.5)
    poses = points[:, :n] * scale_vector(robot.pose_axes, length)
    joints = points[:, n:] * scale_vector(robot.joint_axes, length)

    def one(pose: Array, q: Array) -> tuple[Array, Array, Array, Array]:
        slope = jax.jacfwd(robot.constraints, argnums=1)
        bends, tilts = jax.jacfwd(slope, argnums=1)(pose, q), jax.jacfwd(slope, argnums=0)(pose, q)
        return slope(pose, jnp.zeros_like(q)), slope(pose, q), jnp.einsum("ijj->ij", bends), tilts

    return jax.vmap(one)(poses, joints)
