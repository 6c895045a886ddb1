"""What a design is judged by: a smooth function of the mechanism, and the quantity that it stands for."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.design.places import Place
from jaxkin.numerics.fusion import materialise

#: What the parts of an objective are put together by.
LEAST, MOST, ONLY = "least", "most", "only"


@dataclass(frozen=True)
class Measured:
    """An objective's own quantity at one design, without smoothing.

    Attributes:
        value: The quantity; NaN where it does not exist.
        error: Estimated error of the value.
        pose: ``(n_pose,)`` where it is attained, or None.
        part: Which limit, factor or joint attains it, or "".
        evidence: How it was found, in a few words.
        parameters: ``(j, d)`` the place's parameters of bad poses between its samples, or None.
        proved: True where interval arithmetic proves the value up to its error.
        smoothed: What the objective's smoothing makes of the value, where an objective of one part smooths; None where
            nothing is smoothed, or parts are.
    """

    value: float
    error: float
    pose: np.ndarray | None = None
    part: str = ""
    evidence: str = ""
    parameters: np.ndarray | None = None
    proved: bool = False
    smoothed: float | None = None

    @property
    def where(self) -> str:
        """The pose as the end of a message, such as `` at (0, 1)``; empty without one."""
        return "" if self.pose is None else f" at ({', '.join(f'{x:.6g}' for x in self.pose)})"

    def __str__(self) -> str:
        """One line."""
        part = f" by {self.part}" if self.part else ""
        return f"{self.value:.10g} +- {self.error:.1e}{part}{self.where}{', proved' if self.proved else ''}"


@dataclass(frozen=True, eq=False)
class Objective:
    """A quantity of a design.

    Called with a mechanism (of the kind that it was made for) it returns one smooth number, pure and traceable:
    ``jax.grad``, ``jax.vmap`` over designs, ``jit``. ``measured`` returns the quantity itself.

    Attributes:
        name: What it is.
        unit: Its unit.
        parts: (mechanism, center or None) -> ``(k,)`` numbers, each smooth in the geometry; a center moves the place.
        worst: How the parts make the quantity: ``"least"``, ``"most"``, or ``"only"`` for one part.
        width: Width of the smoothing between parts, in the unit; 0 with one part.
        smoothing: What the smoothing is, and how far off it can be, in a sentence.
        measure: (mechanism, center or None) -> ``Measured``.
        place: The prescribed workspace, if there is one.
        names: Names of the parts by kind, for messages.
        reach: (mechanism, center or None) -> ``(k,)`` how far inside the legs' reach the samples are, if they can miss.
        sharper: Returns the same objective with further samples of its place, ``(j, d)`` parameters; None without.
        content: What determines the numbers, for the request.
    """

    name: str
    unit: str
    parts: Callable[[Mechanism, Array | None], Array]
    worst: str
    width: float
    smoothing: str
    measure: Callable[[Mechanism, Array | None], Measured]
    place: Place | None = None
    names: tuple[str, ...] = ()
    reach: Callable[[Mechanism, Array | None], Array] | None = None
    sharper: "Callable[[np.ndarray], Objective] | None" = None
    content: dict[str, Any] = field(default_factory=dict)

    def __call__(self, robot: Mechanism, center: Array | None = None) -> Array:
        """Returns the smoothed quantity of a mechanism; differentiable with respect to it and to the center."""
        return self.together(self.parts(robot, center))

    def together(self, parts: Array) -> Array:
        """Returns the smoothed quantity of its parts."""
        if self.worst == ONLY:
            return parts[0]
        if self.width == 0:
            return jnp.min(parts) if self.worst == LEAST else jnp.max(parts)
        sign = -1.0 if self.worst == LEAST else 1.0
        # Of deep expressions jaxlib 0.12 compiles the largest for minutes.
        (parts,) = materialise(parts)
        return sign * self.width * jax.nn.logsumexp(sign * parts / self.width)

    def flattery(self, parts: int, sign: float) -> float:
        """Returns by how much smoothing between so many parts can make the quantity better than it is.

        ``sign`` is 1 where more is better, -1 where less is.
        """
        bad_side = LEAST if sign > 0 else MOST
        return 0.0 if self.worst in (ONLY, bad_side) else self.width * float(np.log(parts))

    def measured(self, robot: Mechanism, center: Any = None) -> Measured:
        """Returns the quantity itself, without smoothing, with its error and where it is attained.

        A search, not traceable: worst poses are polished on the equations.
        """
        return self.measure(robot, None if center is None else jnp.asarray(center, float))

    def smoothing_error(self, robot: Mechanism, center: Any = None) -> float:
        """Returns the smoothed quantity less the quantity itself."""
        moved = None if center is None else jnp.asarray(center, float)
        return float(self(robot, moved)) - self.measured(robot, moved).value

    def at_least(self, value: float) -> "Requirement":
        """Returns the requirement that this quantity is not less than a value."""
        return Requirement(self, ">=", _finite(self, value))

    def at_most(self, value: float) -> "Requirement":
        """Returns the requirement that this quantity is not greater than a value."""
        return Requirement(self, "<=", _finite(self, value))

    def __str__(self) -> str:
        """The name, its unit and where."""
        unit = "" if self.unit == "1" else f" ({self.unit})"
        return f"{self.name}{unit}" + ("" if self.place is None else f" over {self.place}")


@dataclass(frozen=True, eq=False)
class Requirement:
    """A bound of an objective that a design has to keep.

    Attributes:
        objective: What is bounded.
        sense: ``">="`` or ``"<="``.
        bound: The bound, in the objective's unit.
    """

    objective: Objective
    sense: str
    bound: float

    @property
    def sign(self) -> float:
        """1 for a least value, -1 for a largest one."""
        return 1.0 if self.sense == ">=" else -1.0

    def smooth_slack(self, parts: Array) -> Array:
        """Returns by how much the smoothed quantity keeps the bound."""
        return self.sign * (self.objective.together(parts) - self.bound)

    def slacks(self, parts: Array) -> Array:
        """Returns by how much each of the objective's parts keeps the bound; negative is a violation.

        Where all parts keep it, the quantity does; where that is not what the requirement needs (the least part is to
        be small), the smoothed quantity stands for it.
        """
        all_of_them = self.objective.worst in (LEAST if self.sign > 0 else MOST, ONLY)
        return self.sign * (parts - self.bound) if all_of_them else self.smooth_slack(parts)[None]

    def slack(self, measured: Measured) -> float:
        """Returns by how much a measured quantity keeps the bound."""
        return self.sign * (measured.value - self.bound)

    def __str__(self) -> str:
        """The requirement as it is written."""
        unit = "" if self.objective.unit == "1" else f" {self.objective.unit}"
        return f"{self.objective.name} {self.sense} {self.bound:g}{unit}"


def _finite(objective: Objective, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"The bound of {objective.name} is {value!r}: it must be a finite number.")
    return number


def checked_width(who: str, width: Any) -> float:
    """Returns the width of a smoothing.

    Raises:
        InputError: It is no number, or negative.
    """
    try:
        number = float(width)
    except (TypeError, ValueError):
        number = np.nan
    if not (np.isfinite(number) and number >= 0):
        raise InputError(f"{who}: width is {width!r}: it must be a number, not negative; 0 for no smoothing.")
    return number
