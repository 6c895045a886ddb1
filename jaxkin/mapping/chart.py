"""The equations of a section or a box: what is unknown, what vanishes, what lies inside.

A section frees two joints and fixes the others; the poses over it form a surface, on which det A = 0 (A = dF/dpose) is
a curve. A box frees three: det A = 0 is a surface then, and the cusps on it form curves. Unknown are the pose and those
free joints that the pose does not give. A joint is *explicit* where one equation gives it from the pose alone, as
itself (a linear actuator) or as its square (a leg of length rho: the equation of |B - A|^2 - rho^2 stays smooth through
rho = 0, where rho itself does not). For the 3-RPR both free legs are explicit: three unknowns, one equation of the
fixed leg, and the determinant.
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


class SectionData(NamedTuple):
    """The numbers of a section, a pytree.

    Which joints are free stands here, as rows of zeros and a one, and not in the chart: sections with other joints
    fixed share their kernels.

    Attributes:
        robot: The mechanism.
        fixed: ``(n_joint,)`` joint values, zero for the free ones.
        free_joint: ``(k, n_joint)`` picks each of the k free joints.
        free_row: ``(k, n)`` picks the equation of each explicit joint; zeros for an unknown one.
        kept_row: ``(n_rows, n)`` picks the equations that hold on the section.
        pose_unit: ``(n_pose,)`` one unit per pose axis.
        free_unit: ``(k,)`` one unit per free joint.
        row_scale: ``(n,)`` magnitude of each equation's terms.
        matrix_scale: ``(n,)`` magnitude of each row of A, for poses in their units.
        factor: ``(n_factor,)`` picks the factor that stands for det A, scaled to order one; empty where det A itself
            is meant.
        low: ``(k,)`` lower ends of the free joints.
        high: ``(k,)`` upper ends.
        whole: ``(k,)`` True where a glued joint runs over its whole period: it has no ends then.
        workspace: The further numbers of a section of the workspace, of ``PoseChart``.
    """

    robot: Mechanism
    fixed: Array
    free_joint: Array
    free_row: Array
    kept_row: Array
    pose_unit: Array
    free_unit: Array
    row_scale: Array
    matrix_scale: Array
    factor: Array
    low: Array
    high: Array
    whole: Array
    workspace: Any = None


#: How a free joint stands in the equations: as an unknown of its own, or given by the pose, as itself or as its square.
UNKNOWN, LINEAR, SQUARE = 0, 1, 2


@dataclass(frozen=True)
class Chart:
    """The structure of a section's equations; hashable, so that one compilation serves all numbers.

    Points u are dimensionless: the pose in its units, then the free joints that are unknowns in theirs. The methods
    are jitted although they only stand inside other kernels: JAX then derives their derivatives once, not at every use,
    which is most of the time that a first call takes.

    Attributes:
        n_pose: Number of pose coordinates, and of equations.
        kinds: UNKNOWN, LINEAR or SQUARE for each of the free joints.
    """

    n_pose: int
    kinds: tuple[int, ...]

    @property
    def n_moving(self) -> int:
        """Number of pose coordinates that are unknowns: all of them, over joints."""
        return self.n_pose

    @property
    def unknown(self) -> tuple[int, ...]:
        """Which of the free joints are unknowns."""
        return tuple(k for k, kind in enumerate(self.kinds) if kind == UNKNOWN)

    @property
    def dimension(self) -> int:
        """Number of unknowns; there are as many more of them than equations as there are free axes."""
        return self.n_moving + len(self.unknown)

    @property
    def n_rows(self) -> int:
        """Number of equations that hold on the section, those of explicit joints left out."""
        return self.n_pose - len(self.kinds) + len(self.unknown)

    def configuration(self, data: SectionData, u: Array) -> tuple[Array, Array]:
        """Returns pose and joints, explicit joints at zero."""
        joints = data.fixed
        for place, k in enumerate(self.unknown):
            joints = joints + data.free_joint[k] * (u[self.n_moving + place] * data.free_unit[k])
        return self.pose(data, u), joints

    @partial(jax.jit, static_argnums=0)
    def section(self, data: SectionData, u: Array) -> Array:
        """Returns the equations that keep u on the section, dimensionless."""
        values = data.robot.constraints(*self.configuration(data, u)) / data.row_scale
        return picked(data.kept_row, values)

    @partial(jax.jit, static_argnums=0)
    def matrix(self, data: SectionData, u: Array) -> Array:
        """Returns A = dF/dpose, dimensionless, ``(n, n)``."""
        pose, joints = self.configuration(data, u)
        direct = jax.jacfwd(data.robot.constraints)(pose, joints)
        return direct * data.pose_unit[None, :] / data.matrix_scale[:, None]

    @partial(jax.jit, static_argnums=0)
    def determinant(self, data: SectionData, u: Array) -> Array:
        """Returns det A, dimensionless, a polynomial of the entries.

        Where one factor is picked, that instead. A mechanism that tells singularities of its pose coordinates apart
        needs this: det A vanishes to second order at a gimbal lock, along curves that are no singularity of the robot.
        """
        if data.factor.shape[0] > 0:
            return jnp.dot(data.factor, self.factors(data, u))
        return expanded_determinant(self.matrix(data, u))

    def factors(self, data: SectionData, u: Array) -> Array:
        """Returns the mechanism's factors of det A, ``(n_factor,)``, in its order."""
        return jnp.stack(list(data.robot.factors(self.pose(data, u)).values()))  # type: ignore[attr-defined]

    def determinant_size(self, data: SectionData, u: Array) -> Array:
        """Returns Hadamard's bound, the product of the lengths of A's rows, by which det A is judged.

        Rows are of order one; a leg of zero length has a row of zeros, and each counts as 0.01 at least. A factor that
        stands for det A is of order one itself.
        """
        if data.factor.shape[0] > 0:
            return jnp.ones(())
        matrix = self.matrix(data, u)
        return jnp.prod(jnp.maximum(jnp.sqrt(jnp.sum(matrix * matrix, axis=1)), 1e-2))

    def singular(self, data: SectionData, u: Array) -> Array:
        """Returns the equations of the singular set: section and determinant."""
        return jnp.append(self.section(data, u), self.determinant(data, u))

    @partial(jax.jit, static_argnums=0)
    def kernel(self, data: SectionData, u: Array) -> Array:
        """Returns the largest column of the adjugate of A: where det A = 0, a direction with A v = 0.

        A fixed column would vanish on a surface of its own.
        """
        adjugate = jax.grad(expanded_determinant)(self.matrix(data, u)).T
        best = jnp.argmax(jnp.sum(adjugate * adjugate, axis=0))
        return adjugate[:, best]

    @partial(jax.jit, static_argnums=0)
    def fold_rate(self, data: SectionData, u: Array) -> Array:
        """Returns the change of det A along its kernel, which vanishes at cusps (and where det A crosses itself)."""
        direction = jnp.concatenate([self.kernel(data, u), jnp.zeros(len(self.unknown))])
        return jax.jvp(partial(self.determinant, data), (u,), (direction,))[1]

    def cusp(self, data: SectionData, u: Array) -> Array:
        """Returns the equations of cusps: points of a section (a square system), curves of a box."""
        return jnp.append(self.singular(data, u), self.fold_rate(data, u))

    def critical(self, data: SectionData, u_multipliers: Array) -> Array:
        """Returns the square system of critical points of det A on the section, in u and Lagrange's multipliers."""
        u, multipliers = u_multipliers[: self.dimension], u_multipliers[self.dimension :]
        slope = jax.grad(partial(self.determinant, data))(u)
        pull = jax.vjp(partial(self.section, data), u)[1](multipliers)[0]
        return jnp.append(self.section(data, u), slope - pull)

    def free_value(self, data: SectionData, u: Array, k: int) -> Array:
        """Returns a free joint, or its square where that is what the pose gives (not negative up to rounding)."""
        if self.kinds[k] == UNKNOWN:
            return u[self.n_moving + self.unknown.index(k)] * data.free_unit[k]
        pose, joints = self.configuration(data, u)

        def row(value: Array) -> Array:
            equations = data.robot.constraints(pose, joints + value * data.free_joint[k])
            return picked(data.free_row[k : k + 1], equations)[0]

        zero = jnp.zeros(())
        if self.kinds[k] == LINEAR:
            return -row(zero) / jax.grad(row)(zero)
        return -2 * row(zero) / jax.grad(jax.grad(row))(zero)

    @partial(jax.jit, static_argnums=0)
    def joints(self, data: SectionData, u: Array) -> Array:
        """Returns all joint values, ``(n_joint,)``."""
        joints = data.fixed
        for k, kind in enumerate(self.kinds):
            value = self.free_value(data, u, k)
            joints = joints + data.free_joint[k] * (jnp.sqrt(jnp.maximum(value, 0.0)) if kind == SQUARE else value)
        return joints

    def pose(self, data: SectionData, u: Array) -> Array:
        """Returns the pose in its own units, angles as they come."""
        return u[: self.n_pose] * data.pose_unit

    @partial(jax.jit, static_argnums=0)
    def margins(self, data: SectionData, u: Array) -> Array:
        """Returns smooth functions, not negative inside the box: first axis low, high, then the second's, and so on.

        Squares are compared with squares; a lower end at zero is no border for them, as no square is negative. A joint
        that runs over its whole period has no border.
        """
        parts = []
        for k, kind in enumerate(self.kinds):
            low, high, unit, value = data.low[k], data.high[k], data.free_unit[k], self.free_value(data, u, k)
            if kind == SQUARE:
                scale = unit * (unit + high)
                below = jnp.where(low > 0, (value - low * low) / scale, 1.0)
                parts += [below, (high * high - value) / scale]
            else:
                parts += [jnp.where(data.whole[k], 1.0, gap / unit) for gap in (value - low, high - value)]
        return jnp.stack(parts)

    def violations(self, data: SectionData, u: Array) -> Array:
        """Returns the margins that are negative, zero for the others."""
        return jnp.minimum(self.margins(data, u), 0.0)

    @partial(jax.jit, static_argnums=0)
    def tangent(self, data: SectionData, u: Array) -> Array:
        """Returns the oriented direction of the singular curve, not normalised; zero at a crossing."""
        return null_vector(jax.jacfwd(partial(self.singular, data))(u))


def tells_factors(robot: Mechanism) -> bool:
    """True where the mechanism tells singularities of its pose coordinates from its own."""
    return hasattr(robot, "chart_factors")


def factor_names(robot: Mechanism) -> tuple[str, ...]:
    """Returns the names of the factors that a mechanism declares, in its order."""
    names: list[str] = []
    pose = jax.ShapeDtypeStruct((len(robot.pose_axes),), float)
    # Collected inside the trace: a dict that comes out of one has its keys sorted.
    jax.eval_shape(lambda r, x: names.extend(r.factors(x)), robot, pose)  # type: ignore[attr-defined]
    return tuple(names)


def picked(rows: Array, values: Array) -> Array:
    """Returns rows @ values, written out so that it fuses."""
    return sum((rows[:, j] * values[j] for j in range(rows.shape[1])), start=jnp.zeros(rows.shape[0]))


def chart_of(robot: Mechanism, free: tuple[int, ...]) -> tuple[Chart, dict[str, np.ndarray]]:
    """Finds which free joints the pose gives, from derivatives of the constraints at a few points.

    The constraints are polynomial in lengths, sines and cosines: a derivative that vanishes at points in general
    position vanishes everywhere.

    Returns:
        The chart, and the entries ``free_joint``, ``free_row`` and ``kept_row`` of its data.
    """
    n = len(robot.pose_axes)
    at_zero, first, second, mixed = (np.asarray(part) for part in _derivatives(robot))
    scale = np.max(np.abs(first), axis=(0, 2), keepdims=True) + 1e-300
    involved = np.any(np.abs(first) > 1e-13 * scale, axis=0)
    kinds, free_row = [UNKNOWN] * len(free), np.zeros((len(free), n))
    for k, joint in enumerate(free):
        rows = np.flatnonzero(involved[:, joint])
        if len(rows) != 1 or any(involved[rows[0], other] for other in free if other != joint):
            continue
        row, size = rows[0], float(np.max(np.abs(first[:, rows[0]])))
        if np.max(np.abs(mixed[:, row, joint])) > 1e-13 * size:
            continue
        bends = second[:, row, joint]
        if np.max(np.abs(bends)) <= 1e-13 * size:
            kinds[k] = LINEAR
        elif np.ptp(bends) <= 1e-13 * size and np.max(np.abs(at_zero[:, row, joint])) <= 1e-13 * size:
            kinds[k] = SQUARE if _is_length(robot, joint, row, bends[0]) else UNKNOWN
        free_row[k, row] = 1.0 if kinds[k] != UNKNOWN else 0.0
    kept = np.flatnonzero(np.sum(free_row, axis=0) == 0)
    picks = {"free_joint": np.eye(n)[list(free)], "free_row": free_row, "kept_row": np.eye(n)[kept]}
    return _chart(n, tuple(kinds)), picks


def _is_length(robot: Mechanism, joint: int, row: int, bend: float) -> bool:
    """True where a joint's square tells the joint: it is not negative, nor is what the poses give for the square."""
    low = max(float(robot.limit_values().low[joint]), robot.joint_axes[joint].low)
    squares = -2 / bend * np.asarray(_constants(robot))[:, row]
    return low >= 0 and bool(np.min(squares) >= -1e-9 * np.max(np.abs(squares)))


@jax.jit
def _constants(robot: Mechanism) -> Array:
    """Returns F with q = 0 at poses all around, ``(k, n)``."""
    n = len(robot.pose_axes)
    poses = jnp.asarray(4 * lattice(64, n) - 2) * scale_vector(robot.pose_axes, robot.characteristic_length())
    return jax.vmap(lambda pose: robot.constraints(pose, jnp.zeros(len(robot.joint_axes))))(poses)


@cache
def _chart(n_pose: int, kinds: tuple[int, ...]) -> Chart:
    """One object a structure: kernels are compiled for its bound methods, which are equal only if the object is one."""
    return Chart(n_pose, kinds)


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
