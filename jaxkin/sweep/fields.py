"""Fields: what can be mapped over a grid. A field is a record; ``sweep`` is the only loop."""

import difflib
import hashlib
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.branches import Lane
from jaxkin.core.errors import InputError, Status
from jaxkin.core.mechanism import Axis, Mechanism
from jaxkin.kinematics.singularity import elementwise_conditioning, elementwise_determinant
from jaxkin.kinematics.solve import forward_lanes, frame_lanes, inside_limits, inverse_lanes
from jaxkin.sweep.walls import Walls, count_walls, determinant_walls, inverse_walls

Coordinates = tuple[Array, ...]


@dataclass(frozen=True)
class Variable:
    """One array of a field's result.

    Attributes:
        name: Name in the dataset.
        dtype: NumPy dtype.
        unit: Unit, "1" for pure numbers.
        long_name: For axis labels.
        dims: Leading dimensions besides the grid's, each with its labels.
        missing: Value of samples that were not computed.
        attrs: Further attributes.
    """

    name: str
    dtype: str
    unit: str
    long_name: str
    dims: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    missing: Any = np.nan
    attrs: dict[str, Any] = field(default_factory=dict)

    @property
    def lead(self) -> tuple[int, ...]:
        """Sizes of the leading dimensions."""
        return tuple(len(labels) for _, labels in self.dims)


@dataclass(frozen=True)
class Field:
    """A quantity that can be swept.

    Attributes:
        name: Name of the field and of its main variable.
        domain: ``"joints"`` or ``"pose"``.
        variables: Mechanism -> its variables; the first bears the field's name.
        kernel: (mechanism, coordinates) -> one flat tuple of arrays, elementwise over the coordinates: for
            every variable in order, one array per combination of its leading dimensions.
        block: Mechanism -> samples that one call should take, so that its temporaries stay in cache.
        unpack: Turns the flat tuple of arrays that a call returned into that of the variables.
        single: True where float32 is enough to mean something, if the user asks for it.
        version: Raise it when the kernel changes its numbers.
        walls: Mechanism -> between which walls the field's label is constant (its main variable if that is discrete,
            the statuses of its branches, or its sign), so that adaptive sweeps can prove it; None where none are known.
    """

    name: str
    domain: str
    variables: Callable[[Mechanism], tuple[Variable, ...]]
    kernel: Callable[[Mechanism, Coordinates], tuple[Array, ...]]
    block: Callable[[Mechanism], int] = lambda robot: 1 << 14
    unpack: Callable[[tuple[np.ndarray, ...]], tuple[np.ndarray, ...]] = lambda arrays: arrays
    single: bool = False
    version: str = "1"
    walls: Callable[[Mechanism], Walls | None] = lambda robot: None

    def __reduce__(self) -> Any:
        """Fields of jaxkin travel to other processes by their names."""
        return (by_name, (self.name,)) if FIELDS.get(self.name) is self else super().__reduce__()

    def axes(self, robot: Mechanism) -> tuple[Axis, ...]:
        """Returns the mechanism's axes of this field's domain."""
        return robot.joint_axes if self.domain == "joints" else robot.pose_axes


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


def _lane_count(robot: Mechanism, forward: bool) -> int:
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
    return robot.forward_labels or tuple(range(_lane_count(robot, True)))


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
        tuple(range(_lane_count(robot, False))),
        _entries(robot.joint_axes),
    ),
    kernel=_branches_kernel(inverse_lanes),
    unpack=_unpack_branches,
    single=True,
    walls=inverse_walls,
)


def _per_working_mode(
    name: str,
    unit: str,
    long_name: str,
    measure: Callable[[Mechanism, Coordinates, Coordinates], Array],
    walls: Callable[[Mechanism], Walls | None] = lambda robot: None,
    attrs: dict[str, Any] | None = None,
) -> Field:
    """Makes a field over poses: a measure of each working mode, without a branch axis where there is one mode."""

    def variables(robot: Mechanism) -> tuple[Variable, ...]:
        return (Variable(name, "float64", unit, long_name, _working_modes(robot), attrs=attrs or {}),)

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


def _each_sample(function: Callable[..., Array], *groups: Coordinates) -> Array:
    """Applies a function of vectors to coordinates given as tuples of broadcastable arrays."""
    shape = jnp.broadcast_shapes(*(jnp.shape(a) for group in groups for a in group))
    rows = [jnp.stack([jnp.broadcast_to(a, shape).reshape(-1) for a in group]) for group in groups]
    return jax.vmap(function, in_axes=1)(*rows).reshape(shape)


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
)

#: Smallest over largest singular value of the scaled dq/dx.
inverse_condition_number = _per_working_mode(
    "inverse_condition_number",
    "1",
    "inverse condition number of the scaled dq/dx",
    lambda robot, x, q: elementwise_conditioning(robot, x, q).inverse_condition_number,
    attrs=_SCALED,
)


def _working_modes(robot: Mechanism) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    modes = _lane_count(robot, False)
    return (("branch", tuple(range(modes))),) if modes > 1 else ()


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
    dims = (*_working_modes(robot), ("limit", names))
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
    names, modes = _margin_names(robot), _working_modes(robot)
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


def from_function(
    function: Callable[[Mechanism, Array], Array],
    *,
    name: str,
    domain: str,
    unit: str = "1",
    long_name: str | None = None,
    dtype: str = "float64",
    walls: Callable[[Mechanism, Array], Array] | None = None,
) -> Field:
    """Makes a field of your own from a traceable function of one configuration.

    Args:
        function: ``(mechanism, vector) -> scalar``; the vector is a pose or the joints.
        name: Name of the field and its variable.
        domain: ``"pose"`` or ``"joints"``.
        unit: Unit of the value.
        long_name: For labels; the name if not given.
        dtype: ``"float64"``, or ``"bool"`` or an integer type for what is constant in cells: a membership, a number of
            tests passed, a label. Such a field can be swept adaptively.
        walls: ``(mechanism, vector) -> (m,)`` smooth functions: on any connected set on which none of them vanishes,
            the value is constant (a real field's sign). Adaptive sweeps prove cells by them; jaxkin cannot know
            whether they are all.

    Raises:
        InputError: The domain is neither, the name is that of a field of jaxkin, or the dtype is another one.
    """
    if domain not in ("pose", "joints"):
        raise InputError(f"The domain of field {name!r} is {domain!r}: it must be 'pose' or 'joints'.")
    if name in FIELDS:
        raise InputError(f"A field {name!r} exists in jaxkin: choose another name.")
    kind = _own_dtype(name, dtype)
    text = _source(function) + ("" if kind == np.float64 else kind.name) + ("" if walls is None else _source(walls))
    return Field(
        name=name,
        domain=domain,
        variables=lambda robot: (Variable(name, kind.name, unit, long_name or name, missing=_missing(kind)),),
        kernel=lambda robot, coordinates: (
            # ``float`` is whichever precision the sweep asks for.
            _each_sample(
                lambda vector: jnp.asarray(function(robot, vector), float if kind == np.float64 else kind), coordinates
            ),
        ),
        block=lambda robot: 1 << 12,
        single=True,
        version=hashlib.sha256(text.encode()).hexdigest()[:16],
        walls=lambda robot: None if walls is None else Walls(walls),
    )


def _own_dtype(name: str, dtype: Any) -> np.dtype:
    try:
        kind = np.dtype(dtype)
    except TypeError:
        kind = np.dtype(object)
    if kind != np.float64 and kind.kind not in "iub":
        raise InputError(f"The dtype of field {name!r} is {dtype!r}: it must be 'float64', 'bool' or an integer type.")
    return kind


def _missing(kind: np.dtype) -> Any:
    """Returns the value of samples that were not computed."""
    if kind.kind == "u":
        return int(np.iinfo(kind).max)
    return {"b": False, "i": -1}.get(kind.kind, np.nan)


def _source(function: Callable[..., Any]) -> str:
    try:
        return inspect.getsource(function)
    except (OSError, TypeError):
        return repr(function)


#: The fields that the command line knows, by name.
FIELDS: dict[str, Field] = {
    f.name: f
    for f in (
        forward_count,
        forward_branches,
        forward_frames,
        inverse_branches,
        direct_determinant,
        smallest_singular_value,
        inverse_condition_number,
        limit_margins,
        binding_limit,
    )
}


def by_name(name: str) -> Field:
    """Returns a field of jaxkin by its name.

    Raises:
        InputError: There is none of that name.
    """
    if name in FIELDS:
        return FIELDS[name]
    close = difflib.get_close_matches(name, FIELDS, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else "."
    raise InputError(f"There is no field {name!r}: choose one of {', '.join(FIELDS)}{hint}")
