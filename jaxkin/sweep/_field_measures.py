"""Fields that measure each working mode at a pose: determinant and singular values."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.singularity import elementwise_conditioning, elementwise_determinant
from jaxkin.kinematics.solve import inverse_lanes
from jaxkin.sweep._field_record import Coordinates, Field, Variable
from jaxkin.sweep._field_solutions import lane_count
from jaxkin.sweep.walls import Walls, determinant_walls


def _per_working_mode(
    name: str,
    unit: str,
    long_name: str,
    measure: Callable[[Mechanism, Coordinates, Coordinates], Array],
    walls: Callable[[Mechanism], Walls | None] = lambda robot: None,
    attrs: dict[str, Any] | None = None,
    signed: bool = True,
) -> Field:
    """Makes a field over poses: a measure of each working mode, without a branch axis where there is one mode."""

    def variables(robot: Mechanism) -> tuple[Variable, ...]:
        return (Variable(name, "float64", unit, long_name, working_modes(robot), attrs=attrs or {}, signed=signed),)

    def kernel(robot: Mechanism, pose: Coordinates) -> tuple[Array, ...]:
        out = []
        for lane in inverse_lanes(robot, pose):
            # NaN where there is no solution: cheaper than to find out about its multiplicity again.
            none = jnp.isnan(lane.values[0])
            out.append(jnp.where(none, jnp.nan, measure(robot, pose, lane.values)))
        return tuple(out)

    return Field(name, "pose", variables, kernel, block=_measure_block, single=True, version="2", walls=walls)


def _measure_block(robot: Mechanism) -> int:
    """Returns what outweighs a call where a sample is cheap, and stays in cache where its matrix is large."""
    return 1 << 15 if len(robot.pose_axes) <= 3 else 1 << 13


#: det dF/dpose at the inverse solution, in the units of the equations.
direct_determinant = _per_working_mode(
    "direct_determinant",
    "units of the constraints",
    "determinant of the direct Jacobian",
    elementwise_determinant,
    determinant_walls,
)

_SCALED = {"scaling": "rates in units of the mechanism's characteristic length and radians"}

#: Clearance: smallest singular value of dq/dx after scaling by the characteristic length.
smallest_singular_value = _per_working_mode(
    "smallest_singular_value",
    "1",
    "smallest singular value of the scaled dq/dx",
    lambda robot, x, q: elementwise_conditioning(robot, x, q).smallest_singular_value,
    attrs=_SCALED,
    signed=False,
)

#: Smallest over largest singular value of the scaled dq/dx.
inverse_condition_number = _per_working_mode(
    "inverse_condition_number",
    "1",
    "inverse condition number of the scaled dq/dx",
    lambda robot, x, q: elementwise_conditioning(robot, x, q).inverse_condition_number,
    attrs=_SCALED,
    signed=False,
)


def working_modes(robot: Mechanism) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    modes = lane_count(robot, False)
    return (("branch", tuple(range(modes))),) if modes > 1 else ()
