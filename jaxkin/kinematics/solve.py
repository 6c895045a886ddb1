"""Inverse and forward kinematics: kernels, guarded by statuses, with derivatives attached."""

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.branches import Branches, Lane, stack_lanes
from jaxkin.core.errors import InputError, Status
from jaxkin.core.mechanism import Axis, Mechanism, scale_vector
from jaxkin.kinematics.boundary import as_tuple, checked_mechanism, checked_vector
from jaxkin.numerics import newton
from jaxkin.numerics.fusion import materialise
from jaxkin.numerics.implicit import attach_derivatives


def inverse(robot: Mechanism, pose: ArrayLike) -> Branches:
    """Finds all joint values of a pose (the working modes).

    Args:
        robot: The mechanism.
        pose: ``(n_pose,)``; use ``jax.vmap`` for many.

    Returns:
        ``Branches`` with ``values`` ``(n_branch, n_joint)``. Solutions outside the joint limits are not
        valid and have the status OUTSIDE_LIMITS.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The pose is not ``n_pose`` numbers.

    Valid, non-singular branches can be differentiated with respect to pose and geometry, forward and
    reverse, to any order. At a singular branch no derivative exists: forward mode gives NaN, reverse mode zero.
    """
    checked_mechanism("jk.inverse", robot)
    return _inverse(robot, checked_vector("jk.inverse", "the pose", pose, robot.pose_axes))


def forward(robot: Mechanism, joints: ArrayLike) -> Branches:
    """Finds all poses of given joint values (the assembly modes).

    Args:
        robot: The mechanism.
        joints: ``(n_joint,)``; use ``jax.vmap`` for many.

    Returns:
        ``Branches`` with ``values`` ``(n_branch, n_pose)``, angles in [-pi, pi). Where the mechanism has
        ``forward_labels`` each lane has an identity (3-PPPS: the signs of R22 and R33; TLPM: the side of the base
        plane); else real solutions come first, for the 3-RPR by ascending phi. Joints outside the limits have no
        solution and the status OUTSIDE_LIMITS.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The joints are not ``n_joint`` numbers.

    Valid, non-singular branches can be differentiated with respect to joints and geometry, forward and
    reverse, to any order. At a singular branch no derivative exists: forward mode gives NaN, reverse mode zero.
    """
    checked_mechanism("jk.forward", robot)
    return _forward(robot, checked_vector("jk.forward", "the joints", joints, robot.joint_axes))


def forward_lanes(robot: Mechanism, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
    """Solves the forward problem elementwise over arrays, statuses included (no derivatives)."""
    if robot.forward_kernel is not None:
        lanes = robot.forward_kernel(joints)
    else:
        lanes = _by_search(robot, joints, robot.joint_axes, robot.pose_axes, False)
    return _guarded(robot, joints, lanes)


def frame_lanes(robot: Mechanism, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
    """Solves the forward problem as position and rotation matrix, statuses included (spatial robots with a kernel)."""
    assert robot.frame_kernel is not None
    return _guarded(robot, joints, robot.frame_kernel(joints))


def _guarded(robot: Mechanism, joints: tuple[Array, ...], lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    outside = ~inside_limits(robot, joints)
    return _masked(lanes, outside, *_nothing_to_say(robot, joints))


def inverse_lanes(robot: Mechanism, pose: tuple[Array, ...]) -> tuple[Lane, ...]:
    """Solves the inverse problem elementwise over arrays, statuses included (no derivatives)."""
    if robot.inverse_kernel is not None:
        lanes = robot.inverse_kernel(pose)
    else:
        lanes = _by_search(robot, pose, robot.pose_axes, robot.joint_axes, True)
    masked = []
    for lane in lanes:
        outside = (lane.multiplicity > 0) & ~inside_limits(robot, lane.values)
        masked += _masked((lane,), outside, *_nothing_to_say(robot, pose))
    return tuple(masked)


def inside_limits(robot: Mechanism, joints: tuple[Array, ...]) -> Array:
    """True where every joint is within its limits (inclusive)."""
    limits = robot.limit_values()
    inside = jnp.asarray(True)
    for k, value in enumerate(joints):
        inside = inside & (value >= limits.low[k]) & (value <= limits.high[k])
    return inside


#: Squares and products of larger inputs would overflow.
LARGEST = 1e60


def _nothing_to_say(robot: Mechanism, given: tuple[Array, ...]) -> tuple[Array, Array]:
    """Returns where the input or the geometry is bad, and the status that says which."""
    finite = jnp.asarray(True)
    # In float32 the bound would be infinite, and let infinity pass.
    largest = min(LARGEST, float(jnp.finfo(jnp.result_type(float)).max) ** 0.2)
    for value in given:
        finite = finite & (jnp.abs(value) <= largest)
    # Kept, or every loop over samples would look at the geometry again, sines of its angles included.
    (fine,) = materialise(jnp.where(robot.geometry_ok(), 1.0, 0.0))
    geometry = fine > 0.5
    return ~(finite & geometry), jnp.where(geometry, Status.INVALID_INPUT, Status.INVALID_GEOMETRY)


def _masked(lanes: tuple[Lane, ...], outside: Array, bad: Array, status: Array) -> tuple[Lane, ...]:
    """Empties lanes outside the limits, and where the input or the geometry is bad."""
    gone = outside | bad
    why = jnp.where(bad, jnp.asarray(status, jnp.int8), jnp.int8(Status.OUTSIDE_LIMITS))
    # One sum for each entry: the tests above would otherwise be made again for each.
    (nothing,) = materialise(jnp.where(gone, jnp.nan, 0.0))
    gone = jnp.isnan(nothing)
    return tuple(
        Lane(
            values=tuple(value + nothing for value in lane.values),
            status=jnp.where(gone, why, lane.status),
            multiplicity=jnp.where(gone, jnp.int8(0), lane.multiplicity),
            residual=lane.residual + nothing,
        )
        for lane in lanes
    )


def _by_search(
    robot: Mechanism,
    given: tuple[Array, ...],
    known: tuple[Axis, ...],
    sought: tuple[Axis, ...],
    joints: bool,
) -> tuple[Lane, ...]:
    """Searches solutions where the mechanism has no closed form; completeness stays unknown."""
    shape = jnp.broadcast_shapes(*(jnp.shape(value) for value in given))
    flat = jnp.stack([jnp.broadcast_to(value, shape).reshape(-1) for value in given], axis=-1)
    length = robot.characteristic_length()
    unit = scale_vector(sought, length)
    lengths = jnp.array([not axis.is_angle for axis in known])

    def one(vector: Array) -> newton.Found:
        vector = jnp.where(jnp.isfinite(vector), vector, 1.0)
        # No solution lies farther out than the known lengths and the size of the mechanism together.
        reach = 2 * (1 + jnp.max(jnp.abs(vector), where=lengths, initial=0.0) / length)
        low = jnp.array([axis.low for axis in sought]) / unit
        high = jnp.array([axis.high for axis in sought]) / unit
        low, high = jnp.where(jnp.isfinite(low), low, -reach), jnp.where(jnp.isfinite(high), high, reach)

        def function(x: Array) -> Array:
            pose, q = (vector, x * unit) if joints else (x * unit, vector)
            return robot.constraints(pose, q) / scale

        middle = 0.5 * (low + high) * unit
        pose, q = (vector, middle) if joints else (middle, vector)
        scale = robot.constraint_scales(pose, q)
        period = jnp.array([jnp.inf if axis.period is None else axis.period for axis in sought])
        found = newton.search(function, low, high, period, robot.max_branches)
        return found._replace(x=found.x * unit, exists=found.exists & ~found.continuum)

    x, exists, residual, singular, continuum = jax.lax.map(one, flat)
    unknown = jnp.where(continuum, jnp.int8(Status.SELF_MOTION), jnp.int8(Status.COMPLETENESS_UNKNOWN)).reshape(shape)
    lanes = []
    for k in range(robot.max_branches):
        here, double = exists[:, k].reshape(shape), singular[:, k].reshape(shape)
        status = jnp.where(here & double, jnp.int8(Status.SINGULAR), unknown)
        number = jnp.where(here, jnp.where(double, jnp.int8(2), jnp.int8(1)), jnp.int8(0))
        lanes.append(
            Lane(
                values=tuple(jnp.where(here, x[:, k, i].reshape(shape), jnp.nan) for i in range(len(sought))),
                status=status,
                multiplicity=number,
                residual=jnp.where(here, residual[:, k].reshape(shape), jnp.nan),
            )
        )
    return tuple(lanes)


def _pose_residual(pose: Array, theta: tuple[Mechanism, Array]) -> Array:
    robot, joints = theta
    return robot.constraints(pose, joints)


def _joint_residual(joints: Array, theta: tuple[Mechanism, Array]) -> Array:
    robot, pose = theta
    return robot.constraints(pose, joints)


def _one_robot(robot: Mechanism) -> None:
    """Raises, while tracing, for a batch of robots."""
    if jnp.ndim(robot.characteristic_length()) != 0:
        raise InputError(
            f"Got a batch of robots of shape {jnp.shape(robot.characteristic_length())}: pass one robot, or use "
            "jax.vmap over the robot as well (in_axes=(0, ...))."
        )


@jax.jit
def _forward(robot: Mechanism, joints: Array) -> Branches:
    _one_robot(robot)
    still = jax.lax.stop_gradient((robot, joints))
    return _with_derivatives(_pose_residual, stack_lanes(forward_lanes(still[0], as_tuple(still[1]))), robot, joints)


@jax.jit
def _inverse(robot: Mechanism, pose: Array) -> Branches:
    _one_robot(robot)
    still = jax.lax.stop_gradient((robot, pose))
    return _with_derivatives(_joint_residual, stack_lanes(inverse_lanes(still[0], as_tuple(still[1]))), robot, pose)


def _with_derivatives(residual, branches: Branches, robot: Mechanism, given: Array) -> Branches:
    regular = branches.valid & (branches.status != Status.SINGULAR)
    given = jnp.where(jnp.isfinite(given), given, 1.0)
    values = jax.vmap(lambda x, ok, here: attach_derivatives(residual, x, (robot, given), ok, here))(
        branches.values, regular, branches.valid
    )
    return Branches(values, branches.valid, branches.status, branches.multiplicity, branches.residual)
