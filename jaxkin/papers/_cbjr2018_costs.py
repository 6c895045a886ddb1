"""Costs of one solution: the operations that Chablat, Baron, Jha and Rolland 2018 state, beside those compiled here.

Operations are counted in what JAX traces, as a compiler leaves it: what several results need is computed once, what
none needs not at all, and what depends on the geometry alone is known beforehand. Comparisons, selections and changes
of sign are not counted, as the paper does not; nor are divisions by one, by which ``jaxkin.numerics.fusion`` tells the
compiler to keep a value.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.mechanisms import ppps3
from jaxkin.papers import _cbjr2018_print as printed
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Table

#: Primitives by the columns of the table.
_KINDS: dict[str, str] = {
    "sin": "trigonometric", "cos": "trigonometric", "tan": "trigonometric", "acos": "trigonometric",
    "asin": "trigonometric", "atan": "trigonometric", "atan2": "trigonometric",
    "sqrt": "roots", "rsqrt": "roots",
    "mul": "products", "div": "products", "square": "products", "integer_pow": "products",
    "add": "sums", "sub": "sums",
}  # fmt: skip
_COLUMNS = ("trigonometric", "roots", "products", "sums")
_WORDS = ("sines, cosines, arc functions", "square roots", "products and quotients", "sums and differences")


def costs() -> Part:
    """Compares the stated numbers of operations with those of the printed formulas and of this package."""
    robot = ppps3.create()
    pose, joints, mu = (tuple(jnp.zeros(n)) for n in (6, 6, 3))
    counted = {
        "(20)-(24), written out": operations(lambda *x: printed.inverse(x[:3], x[3:], jnp), pose),
        "inverse kinematics, this package": operations(lambda *x: robot.inverse_kernel(x)[0].values, pose),
        "(25)-(28), one of 128 candidates, written out": operations(_candidate, mu),
        "all four modes as x and R, this package": operations(lambda *q: _modes(robot, q), joints),
        "all four modes as x, phi, theta, sigma, this package": operations(lambda *q: _poses(robot, q), joints),
        "number of modes, this package": operations(lambda *q: robot.count_kernel(q).number, joints),
    }
    rows = [
        ("inverse kinematics, as stated", *printed.INVERSE_COST),
        ("direct kinematics, one solution, as stated", *printed.DIRECT_COST),
    ]
    rows += [(name, *(found[kind] for kind in _COLUMNS)) for name, found in counted.items()]
    written, own = counted["(20)-(24), written out"], counted["inverse kinematics, this package"]
    one, four = (
        counted["(25)-(28), one of 128 candidates, written out"],
        counted["all four modes as x and R, this package"],
    )
    checks = (
        *_compared("inverse", "text after (24)", "(20)-(24) written out", printed.INVERSE_COST, written, (0, 1, 1, 1)),
        *_compared(
            "direct", "text after (28)", "one of 128 candidates of (25)-(28)", printed.DIRECT_COST, one, (0, 1, 2, 2)
        ),
        count_check(
            "cost-inverse-here",
            "text after (24)",
            "calls of sines and cosines, this package, which has polynomials for both at once",
            0,
            own["trigonometric"],
        ),
        count_check(
            "cost-direct-here",
            "text after (28)",
            "trigonometric functions, this package, all four poses as matrices",
            0,
            four["trigonometric"],
        ),
        count_check("cost-direct-here-roots", "text after (28)", "their square roots, this package", 2, four["roots"]),
    )
    title = "Numbers of operations; arc tangents of this package are polynomials with a root"
    return Part("Cost", checks, tables={"costs": Table(title, ("what", *_WORDS), rows)})


def _compared(
    key: str, where: str, what: str, stated: tuple[int, ...], found: Counter[str], allowed: tuple[int, ...]
) -> list[Check]:
    """Compares stated numbers of operations with those of the printed formulas; the root of 3 is a constant here."""
    return [
        Check(
            f"cost-{key}-{kind}", where, f"{words}, {what}", str(n), str(found[kind]), abs(found[kind] - n), float(most)
        )
        for kind, words, n, most in zip(_COLUMNS, _WORDS, stated, allowed, strict=True)
    ]


def _candidate(m2: Array, p: Array, m3: Array) -> tuple[Any, ...]:
    x = printed.abscissa((m2, p, m3), 1.0, jnp)
    return x, *printed.first_angles((m2, p, m3), x, jnp)


def _modes(robot: ppps3.PPPS3, joints: tuple[Array, ...]) -> list[tuple[Array, ...]]:
    return [lane.values for lane in robot.frame_kernel(joints)]


def _poses(robot: ppps3.PPPS3, joints: tuple[Array, ...]) -> list[tuple[Array, ...]]:
    return [lane.values for lane in robot.forward_kernel(joints)]


def operations(function: Callable[..., Any], arguments: tuple[Array, ...]) -> Counter[str]:
    """Counts the arithmetic operations of a function of scalars, by kind.

    Args:
        function: Takes scalars, returns a tree of scalars.
        arguments: Of the right number; their values play no part.

    Returns:
        Counts of ``"trigonometric"``, ``"roots"``, ``"products"`` and ``"sums"``.
    """
    closed = jax.make_jaxpr(function)(*arguments)
    numbers = _Numbers()
    inputs = [numbers.argument() for _ in closed.jaxpr.invars]
    results = _walk(closed, inputs, numbers)
    return numbers.needed(results)


class _Numbers:
    """Value numbering: equal operations on equal values have one number."""

    def __init__(self) -> None:
        self.known: dict[Any, int] = {}
        self.makes: dict[int, tuple[str, list[int]]] = {}
        self.variable: set[int] = set()

    def argument(self) -> int:
        """Returns a number for an argument."""
        number = len(self.makes)
        self.makes[number] = ("argument", [])
        self.variable.add(number)
        return number

    def constant(self, value: Any) -> int:
        """Returns the number of a constant, the same for equal ones."""
        return self._of(("constant", str(value)), "constant", [])

    def result(self, name: str, how: str, place: int, inputs: list[int]) -> int:
        """Returns the number of one result of an operation."""
        zero, one = self.constant(0.0), self.constant(1.0)
        # x / (0 x + 1) only keeps a compiler from computing x again.
        if name == "mul" and zero in inputs:
            return zero
        if name == "add" and set(inputs) == {zero, one}:
            return one
        if name == "div" and inputs[1] == one:
            return inputs[0]
        ordered = sorted(inputs) if name in ("add", "mul") else inputs
        return self._of((name, how, place, *ordered), name, inputs)

    def _of(self, key: Any, name: str, inputs: list[int]) -> int:
        if key not in self.known:
            number = len(self.makes)
            self.known[key], self.makes[number] = number, (name, inputs)
            if any(i in self.variable for i in inputs):
                self.variable.add(number)
        return self.known[key]

    def needed(self, results: list[int]) -> Counter[str]:
        """Counts the operations behind results that depend on the function's arguments."""
        seen, stack, counted = set(), list(results), Counter[str](dict.fromkeys(_COLUMNS, 0))
        while stack:
            number = stack.pop()
            if number in seen:
                continue
            seen.add(number)
            name, inputs = self.makes[number]
            if name in _KINDS and number in self.variable:
                counted[_KINDS[name]] += 1
            stack += inputs
        return counted


def _walk(closed: Any, inputs: list[int], numbers: _Numbers) -> list[int]:
    """Numbers the results of a jaxpr, with the calls in it opened."""
    jaxpr = closed.jaxpr
    place = dict(zip(jaxpr.invars, inputs, strict=True))
    for variable, value in zip(jaxpr.constvars, closed.consts, strict=True):
        place[variable] = numbers.constant(value)

    def read(atom: Any) -> int:
        # Literals carry their value, and cannot be looked up.
        return numbers.constant(atom.val) if hasattr(atom, "val") else place[atom]

    for equation in jaxpr.eqns:
        given = [read(atom) for atom in equation.invars]
        inner = equation.params.get("jaxpr") or equation.params.get("call_jaxpr")
        if inner is not None and hasattr(inner, "consts"):
            place |= dict(zip(equation.outvars, _walk(inner, given, numbers), strict=True))
            continue
        name = equation.primitive.name
        # Conversions and barriers hand on what they get.
        if name in ("convert_element_type", "copy", "stop_gradient", "optimization_barrier"):
            place |= dict(zip(equation.outvars, given, strict=True))
            continue
        for k, variable in enumerate(equation.outvars):
            place[variable] = numbers.result(name, str(equation.params), k, given)
    return [read(atom) for atom in jaxpr.outvars]
