"""Fields of solutions: how many there are, and all of them with status and multiplicity, padded to lanes."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.branches import Lane
from jaxkin.core.errors import InputError, Status
from jaxkin.core.mechanism import Axis, Mechanism
from jaxkin.kinematics.solve import forward_lanes, frame_lanes, inside_limits, inverse_lanes
from jaxkin.sweep._field_record import Coordinates, Field, Variable
from jaxkin.sweep.walls import count_walls, inverse_walls

_UNDECIDED_BIT = 0x80


def _count_kernel(robot: Mechanism, joints: Coordinates) -> tuple[Array, ...]:
    if robot.count_kernel is not None:
        number, undecided = robot.count_kernel(joints)
        inside = inside_limits(robot, joints)
        number, undecided = jnp.where(inside, number, 0), undecided & inside
    else:
        lanes = forward_lanes(robot, joints)
        number = sum((lane.multiplicity > 0).astype(jnp.uint8) for lane in lanes)
        undecided = jnp.asarray(False)
        for lane in lanes:
            undecided = undecided | (lane.status == Status.SINGULAR) | (lane.status == Status.UNDECIDED)
    # One output, not two: XLA writes a loop for each, and computes much of the work again in the second.
    flag = jnp.where(undecided, jnp.uint8(_UNDECIDED_BIT), jnp.uint8(0))
    return (jnp.asarray(number).astype(jnp.uint8) | flag,)


def _unpack_count(arrays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    (packed,) = arrays
    return (packed & 0x7F).view(np.int8), packed >= _UNDECIDED_BIT


def _count_variables(robot: Mechanism) -> tuple[Variable, ...]:
    del robot
    return (
        Variable("forward_count", "int8", "1", "number of real forward solutions", missing=-1),
        Variable(
            "forward_count_nearly_double",
            "bool",
            "1",
            "float64 cannot decide the number: a solution is nearly double",
            missing=False,
        ),
    )


#: Number of distinct assembly modes within the joint limits, and where float64 cannot decide it.
forward_count = Field(
    name="forward_count",
    domain="joints",
    variables=_count_variables,
    kernel=_count_kernel,
    block=lambda robot: 1 << 17 if robot.count_kernel is not None else robot.forward_block,
    unpack=_unpack_count,
    walls=count_walls,
)


def _branch_variables(
    name: str, long_name: str, labels: tuple[Any, ...], entries: tuple[tuple[str, str], ...]
) -> tuple[Variable, ...]:
    """Returns the variables of solutions: their lanes' labels, and name and unit of each entry."""
    lanes = ("branch", labels)
    coordinate = f"{name.split('_')[0]}_{'entry' if name.endswith('frames') else 'coordinate'}"
    units = ", ".join(f"{entry}: {unit}" for entry, unit in entries)
    names = tuple(entry for entry, _ in entries)
    meanings = {
        "flag_values": [int(s) for s in Status],
        "flag_meanings": " ".join(s.name.lower() for s in Status),
    }
    return (
        Variable(name, "float64", units, long_name, (lanes, (coordinate, names))),
        Variable(f"{name}_status", "int8", "1", "status of each branch", (lanes,), -1, meanings),
        Variable(f"{name}_multiplicity", "int8", "1", "how many solutions coincide", (lanes,), 0),
    )


def lane_count(robot: Mechanism, forward: bool) -> int:
    axes = robot.joint_axes if forward else robot.pose_axes
    given = tuple(jax.ShapeDtypeStruct((), float) for _ in axes)
    return len(jax.eval_shape(forward_lanes if forward else inverse_lanes, robot, given))


def _codes(lanes: tuple[Lane, ...]) -> list[Array]:
    """Returns status and multiplicity in one byte: every output that XLA need not write costs it a loop less."""
    return [lane.status.astype(jnp.uint8) | (lane.multiplicity.astype(jnp.uint8) << 4) for lane in lanes]


def _branches_kernel(solver: Callable[..., Any]) -> Callable[[Mechanism, Coordinates], tuple[Array, ...]]:
    def kernel(robot: Mechanism, coordinates: Coordinates) -> tuple[Array, ...]:
        lanes = solver(robot, coordinates)
        values = [value for lane in lanes for value in lane.values]
        return (*values, *_codes(lanes))

    return kernel


def _stacked_kernel(solver: Callable[..., Any]) -> Callable[[Mechanism, Coordinates], tuple[Array, ...]]:
    """Like ``_branches_kernel`` with one output for each coordinate, all lanes in it; a call costs by outputs."""

    def kernel(robot: Mechanism, coordinates: Coordinates) -> tuple[Array, ...]:
        shape = jnp.broadcast_shapes(*(jnp.shape(each) for each in coordinates))
        lanes = solver(robot, coordinates)
        columns = (*zip(*(lane.values for lane in lanes), strict=True), _words(_codes(lanes)))
        return tuple(jnp.stack([jnp.broadcast_to(each, shape) for each in column]) for column in columns)

    return kernel


def _words(codes: list[Array]) -> list[Array]:
    """Returns bytes eight to a word, the first in its lowest bits; XLA is slow at stacking bytes."""
    words = []
    for start in range(0, len(codes), 8):
        word = jnp.uint64(0)
        for k, code in enumerate(codes[start : start + 8]):
            word = word | (code.astype(jnp.uint64) << jnp.uint64(8 * k))
        words.append(word)
    return words


def _unpack_stacked(arrays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    *values, words = arrays
    lanes = len(values[0])
    poses = (value[k] for k in range(lanes) for value in values)
    halves = [half.astype("<u8").view(np.int8).reshape(*words.shape, 8) for half in (words & _LOW, words >> 4 & _LOW)]
    return (*poses, *(half[k // 8, ..., k % 8] for half in halves for k in range(lanes)))


#: The lower half of each byte of a word.
_LOW = np.uint64(0x0F0F0F0F0F0F0F0F)


def _unpack_branches(arrays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    codes = [array for array in arrays if array.dtype == np.uint8]
    values = arrays[: len(arrays) - len(codes)]
    return (*values, *((code & 0x0F).view(np.int8) for code in codes), *((code >> 4).view(np.int8) for code in codes))


def _entries(axes: tuple[Axis, ...]) -> tuple[tuple[str, str], ...]:
    return tuple((axis.name, axis.unit) for axis in axes)


def _modes(robot: Mechanism) -> tuple[Any, ...]:
    """Returns the labels of the assembly modes, numbers where the lanes have no identity."""
    return robot.forward_labels or tuple(range(lane_count(robot, True)))


#: Poses of all assembly modes, with status and multiplicity.
forward_branches = Field(
    name="forward_branches",
    domain="joints",
    variables=lambda robot: _branch_variables(
        "forward_branches", "poses of the assembly modes", _modes(robot), _entries(robot.pose_axes)
    ),
    kernel=_stacked_kernel(forward_lanes),
    unpack=_unpack_stacked,
    block=lambda robot: robot.forward_block,
    version="2",
)


def _frame_variables(robot: Mechanism) -> tuple[Variable, ...]:
    _check_frames(robot)
    position = _entries(robot.pose_axes[:3])
    rotation = tuple((f"R{i}{j}", "1") for i in (1, 2, 3) for j in (1, 2, 3))
    long_name = "assembly modes as position and rotation matrix"
    return _branch_variables("forward_frames", long_name, _modes(robot), position + rotation)


def _check_frames(robot: Mechanism) -> None:
    if robot.frame_kernel is None:
        raise InputError(
            f"{type(robot).__name__} has no frame_kernel, which gives poses as position and rotation matrix: use the "
            "field 'forward_branches'."
        )


#: Poses of all assembly modes as position and rotation matrix, without the cost of angles.
forward_frames = Field(
    name="forward_frames",
    domain="joints",
    variables=_frame_variables,
    kernel=_stacked_kernel(frame_lanes),
    unpack=_unpack_stacked,
    block=lambda robot: robot.forward_block,
)

#: Joint values of all working modes, with status and multiplicity.
inverse_branches = Field(
    name="inverse_branches",
    domain="pose",
    variables=lambda robot: _branch_variables(
        "inverse_branches",
        "joint values of the working modes",
        tuple(range(lane_count(robot, False))),
        _entries(robot.joint_axes),
    ),
    kernel=_branches_kernel(inverse_lanes),
    unpack=_unpack_branches,
    single=True,
    walls=inverse_walls,
)
