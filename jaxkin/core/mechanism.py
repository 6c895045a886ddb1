"""A mechanism: geometry and limits as a pytree, and the constraint equations between pose and joints."""

import dataclasses
import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeVar, dataclass_transform

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.branches import Lane
from jaxkin.core.errors import InputError
from jaxkin.core.tracing import is_traced


@dataclass(frozen=True)
class Axis:
    """One coordinate of a pose or joint space (static: it is no part of the geometry).

    Attributes:
        name: As in the equations, for instance ``rho1``.
        unit: ``"length"`` (whatever unit the geometry is in), ``"mm"``, ``"rad"``, ...
        low: Lower end of the interval in which solutions are sought; ``-inf`` if open.
        high: Upper end; ``inf`` if open.
        period: The period of a glued axis, or None.
    """

    name: str
    unit: str
    low: float = -math.inf
    high: float = math.inf
    period: float | None = None

    @property
    def is_angle(self) -> bool:
        """True for angles, which a characteristic length does not scale."""
        return self.unit == "rad"


def angle(name: str) -> Axis:
    """Returns a periodic angle in [-pi, pi)."""
    return Axis(name, "rad", -math.pi, math.pi, 2 * math.pi)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Limits:
    """Joint limits, leaves of the mechanism like its geometry: they can be batched and optimised.

    Attributes:
        low: ``(n_joint,)`` lower limits.
        high: ``(n_joint,)`` upper limits, ``inf`` where there is none.
    """

    low: Array
    high: Array

    @classmethod
    def lengths(cls, n_joint: int, low: float = 0.0, high: float = math.inf) -> "Limits":
        """Returns the same interval for every leg; by default a length is only not negative.

        Raises:
            InputError: An end is no number. An interval the wrong way round is left to the mechanism's constructor,
                which names the joint.
        """
        ends = _checked_ends("the lengths", (low, high))
        return cls(*(jnp.full(n_joint, end, dtype=float) for end in ends))

    @classmethod
    def none(cls, n_joint: int) -> "Limits":
        """Returns no limits at all (for angles)."""
        return cls(jnp.full(n_joint, -jnp.inf), jnp.full(n_joint, jnp.inf))


class Count(NamedTuple):
    """Number of distinct real solutions, and whether float64 can decide it.

    Attributes:
        number: int8.
        undecided: True where rounding could change the number: a solution is nearly double.
    """

    number: Array
    undecided: Array


class Mechanism:
    """Base of every mechanism; decorate the subclass with ``jk.mechanism``.

    A subclass declares its geometry as annotated fields, ``pose_axes`` and ``joint_axes`` as plain class
    attributes, and ``constraints``. All the rest is optional and has a generic stand-in.

    A spatial mechanism whose determinant vanishes where only the angles of its pose are singular declares ``factors``
    (of the robot) and ``chart_factors`` (of the angles): singular sets are then those of ``factors``.

    ``constraints`` must be square (as many equations as pose coordinates and as joints), smooth, and
    polynomial in lengths and in sines and cosines: no ``abs``, no ``arctan2``, no comparison.

    Optional hot kernels take and return tuples of arrays of one batch shape and are elementwise:
    ``inverse_kernel(pose) -> tuple[Lane, ...]``, ``forward_kernel(joints) -> tuple[Lane, ...]``,
    ``frame_kernel(joints) -> tuple[Lane, ...]`` (spatial robots: position and rotation matrix) and
    ``count_kernel(joints) -> Count`` (forward solutions, counted without solving). A kernel neither
    checks finite input nor applies limits; the caller in ``kinematics`` does that once for all.

    ``jacobian_kernel(pose, joints) -> (rows of A, diagonal of B)``, likewise elementwise, is for mechanisms of which
    each equation holds one joint; without it both Jacobians come from the constraints by autodiff.

    ``count_walls(joints (n,)) -> (m,)`` declares smooth functions between whose zeros the number of assembly modes
    cannot change, limits aside: adaptive sweeps prove maps of it by them.
    """

    id: ClassVar[str] = ""
    pose_axes: ClassVar[tuple[Axis, ...]]
    joint_axes: ClassVar[tuple[Axis, ...]]
    #: What tells the forward lanes apart, where each has an identity (a sign, say); empty where they are only ordered.
    forward_labels: ClassVar[tuple[str, ...]] = ()
    #: Lanes of the generic search where there is no closed form.
    max_branches: ClassVar[int] = 8
    #: Samples of a forward solve that stay in cache together; measured per mechanism.
    forward_block: ClassVar[int] = 4096

    #: Units of those numbers of the geometry that are no lengths.
    leaf_units: ClassVar[dict[str, str]] = {}

    #: Pose angles of which the equations have the period 2 pi although their interval is shorter (Euler angles), ...
    covered: ClassVar[tuple[str, ...]] = ()
    #: ... and the other triple of angles of the same configuration, ``twin(pose) -> pose``.
    twin: Callable[..., Array] | None = None

    inverse_kernel: Callable[..., tuple[Lane, ...]] | None = None
    forward_kernel: Callable[..., tuple[Lane, ...]] | None = None
    frame_kernel: Callable[..., tuple[Lane, ...]] | None = None
    count_kernel: Callable[..., Count] | None = None
    jacobian_kernel: Callable[..., tuple[Any, Any]] | None = None
    count_walls: Callable[..., Array] | None = None

    def constraints(self, pose: Array, joints: Array) -> Array:
        """Returns the residuals F(pose, joints), ``(n,)``, zero where the mechanism closes."""
        raise NotImplementedError

    def characteristic_length(self) -> Array:
        """Returns the length that makes translations and rotations comparable; override it."""
        return jnp.asarray(1.0)

    def constraint_scales(self, pose: Array, joints: Array) -> Array:
        """Returns the magnitude of each equation's terms, ``(n,)``, by which residuals are divided.

        The generic choice is the change of each equation over one characteristic length (one radian) in
        every coordinate, to first and second order; override it where the terms are known.
        """
        pose, joints = jnp.asarray(pose), jnp.asarray(joints)
        length = self.characteristic_length()
        step = scale_vector(self.pose_axes, length), scale_vector(self.joint_axes, length)
        total = 0.0
        for index in (0, 1):
            point = (pose, joints)

            def along(t: Array, k: Array, index: int = index, point: Any = point) -> Array:
                moved = list(point)
                moved[index] = point[index].at[k].add(t * step[index][k])
                return self.constraints(*moved)

            slope = jax.jacfwd(along)
            ks = jnp.arange(len(point[index]))
            first = jax.vmap(lambda k, s=slope: s(0.0, k))(ks)
            second = jax.vmap(lambda k, s=slope: jax.jacfwd(s)(0.0, k))(ks)
            total = total + jnp.sum(jnp.abs(first) + jnp.abs(second), axis=0)
        return total

    def limit_values(self) -> Limits:
        """Returns the joint limits: the field ``limits`` if there is one, else none."""
        limits = getattr(self, "limits", None)
        return Limits.none(len(self.joint_axes)) if limits is None else limits

    def with_limits(self, **intervals: tuple[float, float]) -> "Mechanism":
        """Returns a copy with other limits of some joints, ``robot.with_limits(rho1=(0.5, 2.0))``.

        Raises:
            InputError: A joint is unknown, the mechanism has no limits, or an interval is not two numbers or the wrong
                way round (not checked under tracing).
        """
        changed, robot = dict(intervals), self
        for name, names in self.limit_fields().items():
            own = {key: changed.pop(key) for key in list(changed) if key in names}
            if own:
                robot = robot.replace(**{name: _changed_limits(getattr(robot, name), names, own)})
        if changed:
            known = [key for names in self.limit_fields().values() for key in names]
            raise InputError(
                f"{self.id or type(self).__name__} has no limits of {', '.join(changed)}: choose among "
                f"{', '.join(known) or '(none)'}."
            )
        return robot

    def limit_fields(self) -> dict[str, tuple[str, ...]]:
        """Returns the fields that hold limits, each with the names of what it limits."""
        if not hasattr(self, "limits"):
            return {}
        return {"limits": tuple(axis.name for axis in self.joint_axes)}

    def margins(self, pose: Array, joints: Array) -> dict[str, Array]:
        """Returns the signed distance to every limit, one named entry each; negative is a violation."""
        del pose
        limits = self.limit_values()
        margins = {}
        for index, axis in enumerate(self.joint_axes):
            margins[f"{axis.name}_low"] = joints[..., index] - limits.low[index]
            margins[f"{axis.name}_high"] = limits.high[index] - joints[..., index]
        return margins

    def clearances(self) -> tuple[str, ...]:
        """Returns the names of those margins that are distances between links; override it where there are some."""
        return ()

    def margin_unit(self, name: str) -> str:
        """Returns the unit of a margin; override it where there are margins besides the joints' limits."""
        units = {axis.name: axis.unit for axis in self.joint_axes}
        return units.get(name.removesuffix("_low").removesuffix("_high"), "length")

    def geometry_ok(self) -> Array:
        """True where the geometry defines a working mechanism; elementwise over a batch of robots."""
        ok = jnp.asarray(True)
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if not isinstance(value, Limits) and not field.metadata.get("static", False):
                for leaf in jax.tree_util.tree_leaves(value):
                    ok = ok & jnp.all(jnp.isfinite(leaf))
        return ok

    def geometry(self) -> dict[str, Any]:
        """Returns the leaves and the static fields by name as plain numbers and lists (concrete mechanisms only)."""
        leaves = jax.tree_util.tree_flatten_with_path(self)[0]
        static = [
            field.name
            for field in dataclasses.fields(self)  # type: ignore[arg-type]
            if field.metadata.get("static", False) and field.name != KIND
        ]
        return {
            jax.tree_util.keystr(path, simple=True, separator="."): jnp.asarray(leaf).tolist() for path, leaf in leaves
        } | {name: getattr(self, name) for name in static}

    def replace(self, **changes: Any) -> "Mechanism":
        """Returns a copy with other leaves; unlike the constructors it checks nothing."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def __str__(self) -> str:
        """The id, the geometry and the limits in one line."""
        leaves = jax.tree_util.tree_leaves(self)
        if any(is_traced(leaf) or jnp.ndim(leaf) > 1 for leaf in leaves):
            return f"{self.id or type(self).__name__} (batched or traced)"
        parts = []
        for name, value in self.geometry().items():
            if isinstance(value, int | float):
                parts.append(f"{name}={value:.12g}")
            elif not name.endswith((".low", ".high")):
                parts.append(f"{name}=({', '.join(f'{entry:.6g}' for entry in value)})")
        for field, names in self.limit_fields().items():
            limits = getattr(self, field)
            for name, low, high in zip(names, limits.low.tolist(), limits.high.tolist(), strict=True):
                # That a length is not negative goes without saying.
                if math.isfinite(high) or (math.isfinite(low) and low != 0):
                    parts.append(f"{name} in [{low:.6g}, {high:.6g}]")
        return f"{self.id or type(self).__name__}({', '.join(parts)})"


def _changed_limits(limits: Limits, names: tuple[str, ...], intervals: dict[str, tuple[float, float]]) -> Limits:
    low, high = limits.low, limits.high
    for name, interval in intervals.items():
        least, most = _checked_ends(name, interval)
        known = [concrete_reals(end) for end in interval]
        if known[0] is not None and known[1] is not None and not np.all(known[0] <= known[1]):
            raise InputError(
                f"The limits of {name} are {plain(known[0])} and {plain(known[1])}: the low one must be a number not "
                "greater than the high one; exchange them."
            )
        low, high = low.at[..., names.index(name)].set(least), high.at[..., names.index(name)].set(most)
    return Limits(low, high)


def _checked_ends(name: str, interval: Any) -> tuple[Array, Array]:
    """Returns both ends of an interval as numbers, or says what is wrong with them."""
    ends = [as_reals(end) for end in interval] if isinstance(interval, Sequence | np.ndarray | Array) else []
    if isinstance(interval, str) or len(ends) != 2 or ends[0] is None or ends[1] is None:
        raise InputError(
            f"The limits of {name} are {interval!r}: they must be two numbers, (low, high); give both, inf where there "
            "is no limit."
        )
    for end in map(concrete_reals, interval):
        if end is not None and np.isnan(end).any():
            raise InputError(f"A limit of {name} is {plain(end)}: it must be a number; give inf where there is none.")
    return ends[0], ends[1]


def plain(value: Any) -> str:
    """Returns concrete numbers as they are written, without the names of array types."""
    array = np.asarray(value)
    return f"{array:g}" if array.ndim == 0 else f"({', '.join(map(plain, array))})"


def as_reals(value: Any) -> Array | None:
    """Returns real numbers as a float array, and None for anything else: text, complex numbers, ragged lists."""
    try:
        return jnp.asarray(value, dtype=float) if _are_real(value) else None
    except (TypeError, ValueError, OverflowError):
        return None


def concrete_reals(value: Any) -> np.ndarray | None:
    """Returns real numbers as a NumPy array, and None for anything else, tracers included.

    Inside ``jit`` JAX makes a tracer of every constant that it converts, which NumPy does not.
    """
    try:
        return np.asarray(value, dtype=float) if _are_real(value) else None
    except (TypeError, ValueError, OverflowError):
        return None


def _are_real(value: Any) -> bool:
    return all(map(_is_real, jax.tree_util.tree_leaves(value, is_leaf=lambda part: part is None)))


def _is_real(leaf: Any) -> bool:
    if not hasattr(leaf, "dtype"):
        # NumPy would read text as the number it spells, and None as NaN.
        return leaf is not None and not isinstance(leaf, str | bytes | complex)
    return any(jnp.issubdtype(leaf.dtype, kind) for kind in (jnp.floating, jnp.integer, jnp.bool_))


Subclass = TypeVar("Subclass", bound=type[Mechanism])
#: The static field by which the structure of a mechanism names its class.
KIND = "_kind"


@dataclass_transform(frozen_default=True)
def mechanism(cls: Subclass) -> Subclass:
    """Makes a ``Mechanism`` subclass a frozen dataclass and a JAX pytree, and checks its declaration.

    Raises:
        InputError: An axis tuple is missing or empty, the numbers of pose and joint axes differ, or two
            axes share a name.
    """
    for kind in ("pose_axes", "joint_axes"):
        axes = getattr(cls, kind, None)
        if not axes or not all(isinstance(axis, Axis) for axis in axes):
            raise InputError(
                f"{cls.__name__}.{kind} is {axes!r}: it must be a non-empty tuple of jaxkin.Axis; "
                "declare it as a class attribute without annotation."
            )
    names = [axis.name for axis in (*cls.pose_axes, *cls.joint_axes)]
    if len(cls.pose_axes) != len(cls.joint_axes):
        raise InputError(
            f"{cls.__name__} has {len(cls.pose_axes)} pose axes and {len(cls.joint_axes)} joint axes: their "
            "numbers must be equal; eliminate passive joints from the equations."
        )
    if len(set(names)) != len(names):
        raise InputError(f"{cls.__name__} has axes {names}: every axis needs a name of its own.")
    # Structures of two classes with like fields compare equal in JAX (0.10, 0.12), although their hashes differ: now
    # and then a kernel that was compiled for one would serve the other. A static field, the class, tells them apart.
    cls.__annotations__ = {**inspect.get_annotations(cls), KIND: type}
    setattr(
        cls, KIND, dataclasses.field(default=cls, kw_only=True, repr=False, compare=False, metadata={"static": True})
    )
    return jax.tree_util.register_dataclass(dataclass(frozen=True)(cls))


def scale_vector(axes: tuple[Axis, ...], length: Array) -> Array:
    """Returns one unit per axis: the characteristic length for lengths, 1 for angles."""
    return jnp.stack([jnp.ones_like(length) if axis.is_angle else length for axis in axes])
