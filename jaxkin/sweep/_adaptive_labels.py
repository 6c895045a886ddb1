"""What of a field is constant in cells: the variable that labels samples, and numbers for its values."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.words import given
from jaxkin.sweep.fields import Field, Variable

#: The label that asks for the sign of a real field.
SIGN = "sign"
#: Names that the result has itself.
RESERVED = ("low", "high", "place", "size", "level", "constant", "sample_place", "axis", "cell", "sample")
#: Sign of what is no number: outside the limits, or no solution.
NO_SIGN = 2


def labelling(robot: Mechanism, swept: Field, choice: str | None) -> "Labelling":
    """Returns what labels the samples of a field.

    Args:
        robot: The mechanism.
        swept: The field.
        choice: ``"sign"``, the name of one of the field's discrete variables, or None: the main variable if it is
            discrete, else the statuses of its branches.

    Raises:
        InputError: The field has no such label, none without being asked, or the name of something else.
    """
    variables = {variable.name: variable for variable in swept.variables(robot)}
    main = next(iter(variables.values()))
    taken = [name for name in variables if name in RESERVED]
    if taken:
        raise InputError(
            f"Field {swept.name!r} cannot be swept adaptively: {taken[0]!r} is what the cells themselves have; choose "
            "another name."
        )
    discrete = [name for name, variable in variables.items() if _is_discrete(variable)]
    if choice == SIGN:
        if np.dtype(main.dtype).kind != "f" or f"{main.name}_status" in variables:
            raise InputError(f"Field {swept.name!r} is labelled by its sign: it has none; leave {given('label')} out.")
        if not main.signed:
            raise InputError(
                f"Field {swept.name!r} is labelled by its sign: its values cannot be negative, so that the sign tells "
                f"nothing; sweep it without {given('adaptive')}, or 'direct_determinant', whose sign changes."
            )
        return Labelling(_sign_variable(main), lambda values: _signs(values[main.name]))
    if choice is None:
        choice = next((name for name in (main.name, f"{main.name}_status") if name in discrete), None)
    if choice not in discrete:
        wrong = "its values are real numbers" if choice is None else f"{choice!r} is none of its discrete variables"
        known, by_sign = ", ".join(map(repr, discrete)), given("jk.Adaptive(label='sign')")
        remedy = f"choose {known}" if known else f"ask for its sign with {by_sign}"
        raise InputError(
            f"Field {swept.name!r} cannot be swept adaptively: {wrong}, and only what is constant in cells can; "
            f"{remedy}."
        )
    name = choice
    return Labelling(variables[name], lambda values: values[name])


def _is_discrete(variable: Variable) -> bool:
    return np.dtype(variable.dtype).kind in "iub"


def _sign_variable(main: Variable) -> Variable:
    meanings = {"flag_values": [-1, 0, 1, NO_SIGN], "flag_meanings": "negative zero positive undefined"}
    return Variable(f"{main.name}_sign", "int8", "1", f"sign of the {main.long_name}", main.dims, -128, meanings)


def _signs(values: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(values), NO_SIGN, np.sign(np.nan_to_num(values))).astype(np.int8)


@dataclass
class Labelling:
    """Numbers for labels: of one variable, or of all its branches together.

    Attributes:
        variable: The variable that labels.
        read: Variables at samples -> its values, with the samples along the last axis.
    """

    variable: Variable
    read: Callable[[dict[str, np.ndarray]], np.ndarray]
    _numbers: dict[bytes, int] = field(default_factory=dict)
    _rows: list[np.ndarray] = field(default_factory=list)

    def numbers(self, values: dict[str, np.ndarray]) -> np.ndarray:
        """Returns the number of each sample's label; new labels get new numbers."""
        read = self.read(values)
        rows = np.moveaxis(read, -1, 0).reshape(read.shape[-1], -1)
        found, which = np.unique(rows, axis=0, return_inverse=True)
        mapped = np.empty(len(found), np.int64)
        for k, row in enumerate(found):
            key = row.tobytes()
            if key not in self._numbers:
                self._numbers[key] = len(self._rows)
                self._rows.append(row)
            mapped[k] = self._numbers[key]
        return mapped[which.reshape(-1)]

    def values(self, numbers: np.ndarray) -> np.ndarray:
        """Returns the labels of numbers ``(k,)``, with those along the last axis."""
        rows = np.stack(self._rows)[numbers]
        return np.moveaxis(rows.reshape(len(numbers), *self.variable.lead), 0, -1)
