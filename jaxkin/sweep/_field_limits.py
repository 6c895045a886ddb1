"""Fields of limits: how far each is at the inverse solution, and which one binds."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.branches import Lane
from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.solve import inverse_lanes
from jaxkin.sweep._field_measures import working_modes
from jaxkin.sweep._field_record import Coordinates, Field, Variable


def _margin_names(robot: Mechanism) -> tuple[str, ...]:
    pose = jax.ShapeDtypeStruct((len(robot.pose_axes),), float)
    joints = jax.ShapeDtypeStruct((len(robot.joint_axes),), float)
    names: list[str] = []
    # Collected inside the trace: a dict that comes out of one has its keys sorted.
    jax.eval_shape(lambda r, x, q: names.extend(r.margins(x, q)), robot, pose, joints)
    return tuple(names)


def _margin_variables(robot: Mechanism) -> tuple[Variable, ...]:
    long_name = "signed distance to each limit, negative outside"
    names = _margin_names(robot)
    units = ", ".join(f"{name}: {robot.margin_unit(name)}" for name in names)
    dims = (*working_modes(robot), ("limit", names))
    return (Variable("limit_margins", "float64", units, long_name, dims),)


def _margins_by_mode(robot: Mechanism, pose: Coordinates) -> Iterator[tuple[Lane, dict[str, Array]]]:
    """Yields every working mode with its margins."""
    # The limits are what is measured here, so the solutions must not be masked by them.
    for lane in inverse_lanes(_without_limits(robot), pose):
        shape = jnp.broadcast_shapes(*(jnp.shape(a) for a in (*pose, *lane.values)))
        x = jnp.stack([jnp.broadcast_to(a, shape) for a in pose], axis=-1)
        q = jnp.stack([jnp.broadcast_to(a, shape) for a in lane.values], axis=-1)
        yield lane, {name: jnp.broadcast_to(margin, shape) for name, margin in robot.margins(x, q).items()}


def _margin_kernel(robot: Mechanism, pose: Coordinates) -> tuple[Array, ...]:
    return tuple(margin for _, margins in _margins_by_mode(robot, pose) for margin in margins.values())


def _without_limits(robot: Mechanism) -> Mechanism:
    limits = getattr(robot, "limits", None)
    if limits is None:
        return robot
    wide = jax.tree_util.tree_map(lambda leaf: jnp.full_like(leaf, jnp.inf), limits)
    return robot.replace(limits=type(limits)(jnp.negative(wide.low), wide.high))


def _binding_variables(robot: Mechanism) -> tuple[Variable, ...]:
    names, modes = _margin_names(robot), working_modes(robot)
    if len(names) > np.iinfo(np.int8).max:
        raise InputError(f"{type(robot).__name__} has {len(names)} limits: 'binding_limit' numbers 127; use margins.")
    meanings = {"flag_values": list(range(len(names))), "flag_meanings": " ".join(names)}
    long_name = "limit with the smallest margin"
    scaled = "smallest margin, in characteristic lengths and radians"
    return (
        Variable("binding_limit", "int8", "1", long_name, modes, -1, meanings),
        Variable("binding_limit_margin", "float64", "1", scaled, modes),
    )


def _binding_kernel(robot: Mechanism, pose: Coordinates) -> tuple[Array, ...]:
    numbers, smallest = [], []
    for lane, margins in _margins_by_mode(robot, pose):
        number, least = jnp.int8(-1), jnp.inf
        for k, (name, margin) in enumerate(margins.items()):
            scaled = margin if robot.margin_unit(name) == "rad" else margin / robot.characteristic_length()
            number, least = jnp.where(scaled < least, jnp.int8(k), number), jnp.minimum(scaled, least)
        here = lane.multiplicity > 0
        numbers.append(jnp.where(here, number, jnp.int8(-1)))
        smallest.append(jnp.where(here, least, jnp.nan))
    return (*numbers, *smallest)


#: Which limit (or interference) is nearest or most violated at the inverse solution, -1 where none is, and by how much.
binding_limit = Field("binding_limit", "pose", _binding_variables, _binding_kernel, single=True)


#: Signed distance to every joint limit (and interference) at the inverse solution.
limit_margins = Field("limit_margins", "pose", _margin_variables, _margin_kernel, single=True)
