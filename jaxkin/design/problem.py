"""Problems: which numbers of a mechanism vary, what is wanted, what has to be kept."""

import hashlib
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.leaves import checked_leaf, leaf_places, leaf_unit, leaf_value, with_leaves
from jaxkin.core.mechanism import Mechanism, concrete_reals
from jaxkin.core.provenance import Request, identity
from jaxkin.design.objective import LEAST, MOST, Objective, Requirement
from jaxkin.kinematics.boundary import checked_single

#: What names of parameters begin with that move the middle of the prescribed places.
CENTER = "center."
_SCALES = ("linear", "log")


@dataclass(frozen=True)
class Parameter:
    """A number that varies.

    Attributes:
        low: Lower bound.
        high: Upper bound.
        scale: ``"linear"``, or ``"log"`` where ratios matter and both bounds are positive.
        start: Where the first start begins; the mechanism's own value by default, if it lies between the bounds.
        sets: The numbers of the mechanism that it sets, all alike; by default the one of the parameter's name.
    """

    low: float
    high: float
    scale: str = "linear"
    start: float | None = None
    sets: tuple[str, ...] = ()


Range: TypeAlias = "Parameter | tuple[float, float] | Sequence[float]"


@dataclass(frozen=True, eq=False)
class Problem:
    """What a design has to be.

    Exactly one of ``maximise`` and ``minimise`` is given.

    Attributes:
        robot: One mechanism; what does not vary stays as it is there.
        vary: Name -> ``Parameter`` or ``(low, high)``. Names are those of the mechanism's numbers (``c3``,
            ``proximal[0]``, ``proximal`` for all of them alike, ``rho1_high``), of arguments of ``build``, or
            ``center.x`` for a coordinate of the middle of every prescribed place.
        maximise: The objective to be made large.
        minimise: The objective to be made small.
        subject_to: Requirements, ``objective.at_least(0.3)``.
        build: Makes the mechanism from parameters by keyword, where a number follows from others (the initial lengths
            of the TLPM from its radius and height); without it numbers are replaced one by one.
        name: For reports.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: A parameter does not exist, bounds contradict each other, or what is wanted is not one objective.
        GeometryError: The mechanism's geometry is degenerate.
    """

    robot: Mechanism
    vary: Mapping[str, Range]
    maximise: Objective | None = None
    minimise: Objective | None = None
    subject_to: Sequence[Requirement] = ()
    build: Callable[..., Mechanism] | None = None
    name: str = ""
    parameters: dict[str, Parameter] = field(init=False)

    def __post_init__(self) -> None:
        """Checks everything."""
        who = "jk.design.Problem"
        checked_single(who, self.robot)
        if not bool(np.all(self.robot.geometry_ok())):
            raise GeometryError(f"{who}: the geometry of {self.robot} is degenerate: build it with its constructor.")
        wanted = [one for one in (self.maximise, self.minimise) if one is not None]
        if len(wanted) != 1 or not isinstance(wanted[0], Objective):
            raise InputError(f"{who} needs one objective: give maximise= or minimise=, an objective of jk.design.")
        for one in self.subject_to:
            if not isinstance(one, Requirement):
                raise InputError(f"{who}: subject_to has {one!r}: write objective.at_least(value) or .at_most(value).")
        if not self.vary:
            raise InputError(f"{who}: nothing varies: name at least one number, vary={{'c3': (0.0, 1.0)}}.")
        parameters = {name: self._checked(who, name, given) for name, given in self.vary.items()}
        object.__setattr__(self, "parameters", parameters)
        _check_twice(who, parameters)
        self._check_middles(who)
        self._check_build(who)
        _check_contradictions(who, self.subject_to)

    @property
    def objective(self) -> Objective:
        """What is wanted, large or small."""
        return self.maximise if self.maximise is not None else self.minimise  # type: ignore[return-value]

    @property
    def sign(self) -> float:
        """1 to maximise, -1 to minimise."""
        return 1.0 if self.maximise is not None else -1.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(self.parameters)

    @property
    def is_worst_case(self) -> bool:
        """True where what is improved is the worst of several parts, each of them smooth."""
        return self.objective.worst == (LEAST if self.sign > 0 else MOST)

    def values(self, z: Array) -> dict[str, Array]:
        """Returns the parameters of a point of the unit cube ``(p,)``; traceable."""
        values = {}
        for k, (name, one) in enumerate(self.parameters.items()):
            if one.scale == "log":
                values[name] = one.low * (one.high / one.low) ** z[k]
            else:
                values[name] = one.low + (one.high - one.low) * z[k]
        return values

    def unit(self, values: Mapping[str, float]) -> np.ndarray:
        """Returns the point of the unit cube of parameters ``(p,)``."""
        z = []
        for name, one in self.parameters.items():
            if one.scale == "log":
                z.append(math.log(values[name] / one.low) / math.log(one.high / one.low))
            else:
                z.append((values[name] - one.low) / (one.high - one.low))
        return np.array(z)

    def design(self, z: Array) -> tuple[Mechanism, Array | None]:
        """Returns the mechanism, and the middle of the places where that varies, of a point of the unit cube."""
        return self.made(self.values(z))

    def made(self, values: Mapping[str, Any]) -> tuple[Mechanism, Array | None]:
        """Returns the mechanism, and the middle of the places where that varies, of parameters; traceable."""
        arguments = {name: value for name, value in values.items() if name in self._arguments}
        robot = self.robot if self.build is None else self.build(**arguments)
        leaves, center = {}, None
        for name, value in values.items():
            if name.startswith(CENTER):
                center = self._middle() if center is None else center
                center = center.at[self._axis(name)].set(value)
            elif name not in arguments:
                leaves.update(dict.fromkeys(self.parameters[name].sets or (name,), value))
        return with_leaves(robot, leaves), center

    def unit_of(self, name: str) -> str:
        """Returns the unit of a parameter, "" where it is not known (an argument of ``build`` that names no number)."""
        if name.startswith(CENTER):
            return self.robot.pose_axes[self._axis(name)].unit
        leaf = (self.parameters[name].sets or (name,))[0]
        return leaf_unit(self.robot, leaf) if leaf in leaf_places(self.robot) else ""

    def start(self) -> np.ndarray:
        """Returns where the first start begins, in the unit cube; the middle where nothing is known."""
        values = {}
        for name, one in self.parameters.items():
            value = one.start if one.start is not None else self._own(name)
            middle = math.sqrt(one.low * one.high) if one.scale == "log" else 0.5 * (one.low + one.high)
            values[name] = value if value is not None and one.low <= value <= one.high else middle
        return np.clip(self.unit(values), 0.0, 1.0)

    def request(self) -> Request:
        """Returns what determines the problem."""
        return Request(
            {
                **identity(self.robot),
                "vary": {
                    name: [one.low, one.high, one.scale, one.start, list(one.sets)]
                    for name, one in self.parameters.items()
                },
                "build": None if self.build is None else _named(self.build),
                "sense": "maximise" if self.sign > 0 else "minimise",
                "objective": self.objective.content or self.objective.name,
                "subject_to": [
                    [one.objective.content or one.objective.name, one.sense, one.bound] for one in self.subject_to
                ],
            }
        )

    def __str__(self) -> str:
        """The problem in a few lines."""
        verb = "maximise" if self.sign > 0 else "minimise"
        lines = [f"{verb} {self.objective}"]
        lines += [f"  subject to {one}" for one in self.subject_to]
        lines += [f"  {name} from {one.low:g} to {one.high:g}" for name, one in self.parameters.items()]
        return "\n".join(lines)

    @property
    def _arguments(self) -> tuple[str, ...]:
        return () if self.build is None else tuple(inspect.signature(self.build).parameters)

    def _checked(self, who: str, name: str, given: Range) -> Parameter:
        one = given if isinstance(given, Parameter) else None
        if one is None:
            ends = concrete_reals(given)
            if ends is None or ends.shape != (2,):
                raise InputError(f"{who}: {name} varies in {given!r}: give (low, high) or a jk.design.Parameter.")
            one = Parameter(float(ends[0]), float(ends[1]))
        for end in ("low", "high", *(("start",) if one.start is not None else ())):
            number = concrete_reals(getattr(one, end))
            if number is None or number.ndim:
                raise InputError(f"{who}: {name} has {end} = {getattr(one, end)!r}: it must be a number.")
        if one.sets and (name.startswith(CENTER) or name in self._arguments):
            raise InputError(f"{who}: {name} sets {', '.join(one.sets)}, but it is {self._kind(name)}: leave sets out.")
        if name.startswith(CENTER):
            self._axis(name)
        elif name not in self._arguments:
            for leaf in one.sets or (name,):
                checked_leaf(self.robot, leaf)
        if not (math.isfinite(one.low) and math.isfinite(one.high) and one.low < one.high):
            raise InputError(
                f"{who}: {name} varies from {one.low:g} to {one.high:g}: both must be finite and low less than high; "
                "exchange them, or leave the name out to keep the number."
            )
        if one.scale not in _SCALES:
            raise InputError(f"{who}: {name} has the scale {one.scale!r}: it must be 'linear' or 'log'.")
        if one.scale == "log" and not one.low > 0:
            raise InputError(f"{who}: {name} varies from {one.low:g} on a log scale: both bounds must be positive.")
        if one.start is not None and not one.low <= one.start <= one.high:
            raise InputError(f"{who}: {name} starts at {one.start:g}, outside {one.low:g} to {one.high:g}.")
        return one

    def _kind(self, name: str) -> str:
        return "a coordinate of the places" if name.startswith(CENTER) else "an argument of build"

    def _check_middles(self, who: str) -> None:
        """Refuses places with different middles where one moves: the coordinates that stay would be one place's."""
        moved = [self._axis(name) for name in self.parameters if name.startswith(CENTER)]
        if not moved:
            return
        objectives = (self.objective, *(one.objective for one in self.subject_to))
        middles = [one.place.center for one in objectives if one.place is not None and one.place.kind != "reach"]
        for k, axis in enumerate(self.robot.pose_axes):
            values = sorted({float(middle[k]) for middle in middles})
            if k not in moved and len(values) > 1:
                raise InputError(
                    f"{who}: the prescribed places have middles at {axis.name} = {values[0]:g} and {values[1]:g}, and "
                    f"they move together: give them one middle, or vary center.{axis.name} too."
                )

    def _check_build(self, who: str) -> None:
        """Refuses a build that cannot be called with the parameters, or makes another mechanism."""
        if self.build is None:
            return
        arguments = {name: jnp.asarray(one.low) for name, one in self.parameters.items() if name in self._arguments}
        try:
            made = jax.eval_shape(lambda values: self.build(**values), arguments)  # type: ignore[misc]
        except TypeError as error:
            raise InputError(f"{who}: build cannot make a mechanism of {', '.join(arguments)}: {error}.") from error
        if jax.tree_util.tree_structure(made) != jax.tree_util.tree_structure(self.robot):
            raise InputError(
                f"{who}: build makes a {type(made).__name__}, and robot is a {type(self.robot).__name__}: they must be "
                "of one kind, with the same entries that do not vary."
            )

    def _axis(self, name: str) -> int:
        axes = [axis.name for axis in self.robot.pose_axes]
        place = self.objective.place or next((r.objective.place for r in self.subject_to if r.objective.place), None)
        if name.removeprefix(CENTER) not in axes:
            raise InputError(f"There is no pose axis {name.removeprefix(CENTER)!r}: choose among {', '.join(axes)}.")
        if place is None or place.kind == "reach":
            raise InputError(f"{name} varies, but no prescribed place has a middle that could move: leave it out.")
        return axes.index(name.removeprefix(CENTER))

    def _middle(self) -> Array:
        objectives = (self.objective, *(one.objective for one in self.subject_to))
        place = next(one.place for one in objectives if one.place is not None)
        return jnp.asarray(place.center)

    def _own(self, name: str) -> float | None:
        """Returns the mechanism's own value of a parameter, if it has one."""
        if name.startswith(CENTER):
            return float(self._middle()[self._axis(name)])
        leaf = (self.parameters[name].sets or (name,))[0]
        try:
            return float(leaf_value(self.robot, leaf))
        except InputError:
            return None


def _named(build: Callable[..., Mechanism]) -> str:
    """Returns what tells a function that makes mechanisms from others: its name, and its source if that is at hand."""
    name = getattr(build, "__qualname__", type(build).__qualname__)
    try:
        return f"{name} {hashlib.sha256(inspect.getsource(build).encode()).hexdigest()[:16]}"
    except (OSError, TypeError):
        return name


def _check_twice(who: str, parameters: Mapping[str, Parameter]) -> None:
    """Refuses two parameters that set one number."""
    seen: dict[str, str] = {}
    for name, one in parameters.items():
        for leaf in one.sets or (name,):
            for other, owner in seen.items():
                if leaf == other or leaf.startswith(f"{other}[") or other.startswith(f"{leaf}["):
                    raise InputError(f"{who}: {owner} and {name} both set {leaf}: leave one of them out.")
            seen[leaf] = name


def _check_contradictions(who: str, requirements: Sequence[Requirement]) -> None:
    """Refuses two bounds of one objective between which nothing lies."""
    for low in requirements:
        for high in requirements:
            same = low.objective is high.objective or (
                low.objective.content and low.objective.content == high.objective.content
            )
            if same and low.sense == ">=" and high.sense == "<=" and low.bound > high.bound:
                raise InputError(f"{who}: {low} and {high} contradict each other: no design keeps both; change one.")
