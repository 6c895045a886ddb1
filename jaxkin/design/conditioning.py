"""Objectives of conditioning: smallest singular value, inverse condition number, their mean over a place."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.design.configurations import Coordinates, Posture, posture_over
from jaxkin.design.objective import ONLY, Measured, Objective, checked_width
from jaxkin.design.places import Place
from jaxkin.design.worst_case import worst_case
from jaxkin.numerics import singular_values, small_linalg
from jaxkin.numerics.fusion import waist

_NORMS = ("spectral", "frobenius")


def smallest_singular_value(
    robot: Mechanism,
    place: Place,
    *,
    length: float | None = None,
    mode: Sequence[int] | None = None,
    width: float = 0.0,
) -> Objective:
    """Returns the objective of the smallest singular value of dq/dx = -B^-1 A over a place, its worst value.

    It is the clearance of ``jk.conditioning``. A pose beyond a singularity, seen from the middle of a box, a ball or a
    reach, counts with its negative value, and one that a leg does not reach with how far it is from that (a negative
    number of order one): an optimiser then sees the way back.

    Args:
        robot: The mechanism, for which the objective is made.
        place: Where.
        length: Characteristic length that makes angles and lengths comparable; by default the mechanism's own, which
            changes with its geometry.
        mode: The working mode, one sign a joint; needed where there are several.
        width: Width of the smoothing; 0 takes the worst sample.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The working mode is not given or unknown, or length or width is no such number.
    """
    who = "jk.design.smallest_singular_value"
    at, inside, content = _conditioned(who, robot, place, length, mode, "spectral", 0)
    w, name = checked_width(who, width), "smallest singular value"
    return worst_case(name, "1", at, place, w, names=("",), content=content, inside=inside)


def inverse_condition_number(
    robot: Mechanism,
    place: Place,
    *,
    length: float | None = None,
    mode: Sequence[int] | None = None,
    norm: str = "spectral",
    width: float = 0.0,
) -> Objective:
    """Returns the objective of the inverse condition number of dq/dx over a place, its worst value; 1 is isotropy.

    Args:
        robot: The mechanism, for which the objective is made.
        place: Where.
        length: As for ``smallest_singular_value``.
        mode: As for ``smallest_singular_value``.
        norm: ``"spectral"``, the smallest over the largest singular value, or ``"frobenius"``, n / (|J| |J^-1|) in
            Frobenius norms, which is smooth at isotropy too, where both are 1.
        width: As for ``smallest_singular_value``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``smallest_singular_value``, or no such norm.

    References:
        Salisbury, J. K. and Craig, J. J., 1982, "Articulated hands" (isotropy); Angeles, J., 2014, "Fundamentals of
        Robotic Mechanical Systems" (condition number in Frobenius norms, characteristic length).
    """
    who = "jk.design.inverse_condition_number"
    at, inside, content = _conditioned(who, robot, place, length, mode, norm, 1)
    w, name = checked_width(who, width), "inverse condition number" + ("" if norm == "spectral" else ", Frobenius")
    return worst_case(name, "1", at, place, w, names=("",), content=content, inside=inside)


def global_conditioning(
    robot: Mechanism,
    place: Place,
    *,
    length: float | None = None,
    mode: Sequence[int] | None = None,
    norm: str = "spectral",
) -> Objective:
    """Returns the objective of the global conditioning index: the mean inverse condition number over a place.

    Integrated by Gauss's rule with as many nodes as the place has samples; of a list of poses, the plain mean. The
    quantity itself is measured with twice as many, and its error is the difference. Poses beyond a singularity count
    as negative, those out of reach as how far out they are, so that the index falls where they are met.

    Args:
        robot: The mechanism, for which the objective is made.
        place: Where.
        length: As for ``smallest_singular_value``.
        mode: As for ``smallest_singular_value``.
        norm: As for ``inverse_condition_number``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``inverse_condition_number``.

    References:
        Gosselin, C. and Angeles, J., 1991, "A global performance index for the kinematic optimization of robotic
        manipulators", Eq. (3).
    """
    who = "jk.design.global_conditioning"
    at, _, content = _conditioned(who, robot, place, length, mode, norm, 1)
    mean = partial(_mean, at, place)
    finer = jax.jit(partial(mean, _nodes(place, 2)))
    coarse = jax.jit(partial(mean, _nodes(place, 1)))

    def measured(robot: Mechanism, center: Array | None) -> Measured:
        value = float(finer(robot, center))
        error = abs(value - float(coarse(robot, center))) if place.listed is None else 0.0
        return Measured(value, error + 1e-15, evidence="by Gauss's rule with twice the nodes")

    return Objective(
        name="global conditioning index",
        unit="1",
        parts=lambda robot, center: coarse(robot, center)[None],
        worst=ONLY,
        width=0.0,
        smoothing="none: an integral by Gauss's rule, whose error is measured with twice the nodes",
        measure=measured,
        place=place,
        content={"objective": "global conditioning", "place": place.content(), **content},
    )


def _conditioned(
    who: str, robot: Mechanism, place: Place, length: float | None, mode: Sequence[int] | None, norm: str, index: int
) -> tuple[Callable[..., Array], Callable[..., Array] | None, dict[str, Any]]:
    """Returns the function of the pose, that of the legs' reach if they can miss it, and what determines them."""
    posture = posture_over(who, robot, place, mode)
    if norm not in _NORMS:
        raise InputError(f"{who}: norm is {norm!r}: it must be 'spectral' or 'frobenius'.")
    if length is not None and not (np.isfinite(length) and length > 0):
        raise InputError(f"{who}: length is {length!r}: it must be a positive number.")
    at = partial(_at, posture, length, norm, index, place.listed is None)
    return at, posture.inside, {"length": length, "mode": list(posture.signs), "norm": norm}


def _at(
    posture: Posture,
    length: float | None,
    norm: str,
    index: int,
    signed: bool,
    robot: Mechanism,
    poses: Coordinates,
    middle: Array,
) -> Array:
    """Returns smallest singular values (index 0) or inverse condition numbers (1), signed, ``(k, 1)``."""

    def one(robot: Mechanism, pose: Coordinates) -> tuple[Array, Array, Array]:
        rows, direct, inside = _rates(posture, length, robot, pose)
        if norm == "frobenius":
            return _frobenius(rows), direct, inside
        small, large = singular_values.extremes(rows)
        return small if index == 0 else small / large, direct, inside

    value, direct, inside = jax.vmap(one)(_for_each(robot, poses[0]), poses)
    if signed:
        home = _rates(posture, length, robot, tuple(middle))[1]
        value = value * jax.lax.stop_gradient(jnp.sign(direct) * jnp.sign(home))
    return jnp.where(inside > 0, value, inside)[:, None]


def _for_each(robot: Mechanism, like: Array) -> Mechanism:
    """Returns the mechanism once for each sample, so that a gradient sums once over the samples for each number."""
    leaves, kind = jax.tree_util.tree_flatten(robot)
    count = jnp.shape(like)
    return kind.unflatten([waist(jnp.broadcast_to(x, (*count, *jnp.shape(x))))[0] for x in leaves])


def _rates(
    posture: Posture, length: float | None, robot: Mechanism, pose: Coordinates
) -> tuple[list[list[Array]], Array, Array]:
    """Returns of one pose dq/dx in units of the length, det of the direct Jacobian, and how far inside the reach."""
    joints, inside = posture.joints(robot, pose)
    direct, diagonal = _jacobians(posture, robot, pose, joints)
    reaches = inside > 0
    slower = [-1.0 / jnp.where(reaches, b, 1.0) for b in diagonal]
    unit = robot.characteristic_length() if length is None else jnp.asarray(length)
    per_pose, per_joint = (scale_vector(axes, unit) for axes in (robot.pose_axes, robot.joint_axes))
    rows = [
        list(waist(*(entry * slow * (per_pose[j] / per_joint[i]) for j, entry in enumerate(row))))
        for i, (row, slow) in enumerate(zip(direct, slower, strict=True))
    ]
    return rows, small_linalg.expanded_rows(direct), inside


def _jacobians(
    posture: Posture, robot: Mechanism, pose: Coordinates, joints: Coordinates
) -> tuple[list[list[Array]], list[Array]]:
    """Returns the rows of A in the order of the joints, and each joint's entry of B."""
    if robot.jacobian_kernel is not None:
        direct, diagonal = robot.jacobian_kernel(pose, joints)
        return [list(row) for row in direct], [jnp.asarray(b, float) for b in diagonal]
    a, b = jax.jacfwd(robot.constraints, argnums=(0, 1))(jnp.stack(pose), jnp.stack(joints))
    n = len(joints)
    order = posture.legs.rows if posture.legs is not None else tuple(range(n))
    return [[a[row, j] for j in range(n)] for row in order], [b[row, k] for k, row in enumerate(order)]


def _frobenius(rows: list[list[Array]]) -> Array:
    """Returns n / (|J| |J^-1|) in Frobenius norms, by |adj J| / |det J| for |J^-1|; 0 where J is singular."""
    n = len(rows)
    size = sum(entry * entry for row in rows for entry in row)
    minors = sum(
        small_linalg.expanded_rows([[rows[i][j] for j in range(n) if j != b] for i in range(n) if i != a]) ** 2
        for a in range(n)
        for b in range(n)
    )
    return n * jnp.abs(small_linalg.expanded_rows(rows)) / jnp.sqrt(size * minors)


def _nodes(place: Place, times: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns parameters and weights of Gauss's rule on a place; of a list, equal weights."""
    if place.listed is not None:
        return np.zeros((len(place.listed), 0)), np.full(len(place.listed), 1.0 / len(place.listed))
    rules = [np.polynomial.legendre.leggauss(times * n) for n in place.numbers]
    nodes = np.stack(np.meshgrid(*(rule[0] for rule in rules), indexing="ij"), axis=-1).reshape(-1, place.dimension)
    weights = np.ones(1)
    for _, along in rules:
        weights = np.multiply.outer(weights, along).ravel()
    return nodes, weights


def _mean(
    at: Callable[..., Array],
    place: Place,
    rule: tuple[np.ndarray, np.ndarray],
    robot: Mechanism,
    center: Array | None,
) -> Array:
    nodes, weights = rule
    poses = place.sampled(robot, center, nodes)
    values = at(robot, tuple(poses[:, k] for k in range(poses.shape[1])), place.middle(robot, center))[:, 0]
    if place.listed is not None:
        return jnp.sum(values * weights)
    stretch = jax.vmap(lambda u: place.stretch(robot, u, center))(jnp.asarray(nodes)) * weights
    return jnp.sum(values * stretch) / jnp.sum(stretch)
