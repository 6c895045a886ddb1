"""A function's jaxpr read as a list of steps on single numbers, and the run of these steps on jets.

Every entry of an array is a number of its own: what only moves entries costs nothing, equal operations are done once,
those that are not needed not at all, and zeros and ones that differentiation leaves behind vanish.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxkin.numerics import _intervals as iv
from jaxkin.numerics._jets import Jet, UnsupportedOperation, elementwise, is_elementwise

_MOVES = frozenset(
    (
        "slice",
        "squeeze",
        "reshape",
        "broadcast_in_dim",
        "concatenate",
        "stack",
        "split",
        "unstack",
        "transpose",
        "expand_dims",
        "rev",
        "gather",
        "scatter",
        "dynamic_slice",
        "dynamic_update_slice",
        "pad",
    )
)
_CALLS = frozenset(
    ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat", "checkpoint")
)
_SAME = frozenset(
    ("convert_element_type", "copy", "copy_p", "stop_gradient", "optimization_barrier", "reduce_precision")
)


class Step(NamedTuple):
    """One operation.

    Attributes:
        function: Takes jets, returns as many jets as there are outputs.
        inputs: Numbers of the jets it takes.
        outputs: Numbers of those it gives.
        dead: Those that nobody asks for afterwards.
    """

    function: Callable[..., Sequence[Jet]]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    dead: tuple[int, ...] = ()


class Program(NamedTuple):
    """What a function does.

    Attributes:
        steps: In order.
        given: Numbers of the parameters' entries and the variables, in order.
        numbers: Jets known beforehand.
        results: Numbers of the results.
        size: How many jets there are.
    """

    steps: tuple[Step, ...]
    given: tuple[int, ...]
    numbers: dict[int, Jet]
    results: tuple[int, ...]
    size: int

    def run(self, given: Sequence[Jet]) -> list[Jet]:
        """Returns the results of jets that are given."""
        jets: list[Any] = [None] * self.size
        for place, jet in self.numbers.items():
            jets[place] = jet
        for place, jet in zip(self.given, given, strict=True):
            jets[place] = jet
        for function, inputs, outputs, dead in self.steps:
            for place, jet in zip(outputs, function(*[jets[k] for k in inputs]), strict=True):
                jets[place] = jet
            for k in dead:
                jets[k] = None
        return [jets[k] for k in self.results]


def program_of(jaxpr: Any, consts: Sequence[Any]) -> Program:
    """Reads a jaxpr of one result, whose last argument are the variables; the others are parameters.

    What is not understood is noted as a step that raises UnsupportedOperation, unless it is not needed.
    """
    reader = _Reader()
    inputs = [reader.fresh(var.aval.shape, k < len(jaxpr.invars) - 1) for k, var in enumerate(jaxpr.invars)]
    (result,) = reader.read(jaxpr, consts, inputs)
    given = tuple(int(k) for part in inputs for k in part.ravel())
    results = tuple(int(k) for k in result.ravel())
    numbers = {k: _number_jet(value) for k, value in reader.numbers.items()}
    return Program(_needed(reader.steps, results, set(given)), given, numbers, results, reader.size)


def _number_jet(value: float) -> Jet:
    return Jet(iv.point(np.full((1, 1), value)))


def _needed(steps: list[Step], results: tuple[int, ...], given: set[int]) -> tuple[Step, ...]:
    """Returns the steps that the results depend on, and in each what may be forgotten after it."""
    wanted, kept = set(results), []
    for step in reversed(steps):
        if wanted.isdisjoint(step.outputs):
            continue
        made = set(step.inputs) | set(step.outputs)
        kept.append(step._replace(dead=tuple(made - wanted - given)))
        wanted |= made
    return tuple(kept[::-1])


class _Reader:
    """Numbers the entries of all arrays of a jaxpr.

    Attributes:
        steps: What was read so far.
        size: How many entries there are.
        numbers: Entries that are known numbers.
        constants: Entries that depend on parameters alone, known numbers included.
    """

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.size = 0
        self.numbers: dict[int, float] = {}
        self.constants: set[int] = set()
        self._places: dict[Any, int] = {}

    def fresh(self, shape: tuple[int, ...], constant: bool) -> np.ndarray:
        """Returns new entries in an array."""
        count = int(np.prod(shape, dtype=int))
        places = np.arange(self.size, self.size + count)
        self.size += count
        if constant:
            self.constants.update(places.tolist())
        return places.reshape(shape)

    def known(self, values: Any) -> np.ndarray:
        """Returns the entries of known numbers."""
        values = np.asarray(values, float)
        return np.array([self._known(value) for value in values.ravel().tolist()], int).reshape(values.shape)

    def _known(self, value: float) -> int:
        key = "number", value.hex()
        if key not in self._places:
            self._places[key] = int(self.fresh((), True))
            self.numbers[self._places[key]] = value
        return self._places[key]

    def read(self, jaxpr: Any, consts: Sequence[Any], inputs: list[np.ndarray]) -> list[np.ndarray]:
        """Returns the entries of a jaxpr's results."""
        values: dict[Any, np.ndarray] = dict(zip(jaxpr.constvars, map(self.known, consts), strict=True))
        values.update(zip(jaxpr.invars, inputs, strict=True))

        def entries(atom: Any) -> np.ndarray:
            return self.known(atom.val) if hasattr(atom, "val") else values[atom]

        for equation in jaxpr.eqns:
            results = self._equation(equation, [entries(atom) for atom in equation.invars])
            values.update(zip(equation.outvars, results, strict=True))
        return [entries(atom) for atom in jaxpr.outvars]

    def _equation(self, equation: Any, inputs: list[np.ndarray]) -> list[np.ndarray]:
        name, params = equation.primitive.name, equation.params
        if name in _CALLS:
            inner = next((params[key] for key in ("jaxpr", "call_jaxpr", "fun_jaxpr") if key in params), None)
            if inner is not None:
                body, consts = (inner.jaxpr, inner.consts) if hasattr(inner, "jaxpr") else (inner, ())
                return self.read(body, consts, inputs)
        if name in _SAME and len(inputs) == 1:
            return inputs
        if all(int(k) in self.numbers for part in inputs for k in part.ravel()):
            return [self.known(out) for out in _bound(equation, [self._plain(part) for part in inputs])]
        if name == "reduce_sum":
            return [self._summed(_groups(inputs[0], params["axes"]))]
        if name == "dot_general":
            return [self._dotted(inputs, params["dimension_numbers"]).reshape(equation.outvars[0].aval.shape)]
        if name in _MOVES and (moved := self._moved(equation, inputs)) is not None:
            return moved
        if is_elementwise(name):
            alike = np.broadcast_arrays(*inputs, np.empty(equation.outvars[0].aval.shape))[:-1]
            rows = zip(*(part.ravel().tolist() for part in alike), strict=True)
            found = [self._one(name, row, int(params.get("y", 0))) for row in rows]
            return [np.array(found, int).reshape(equation.outvars[0].aval.shape)]
        return self._folded(equation, inputs)

    def _plain(self, entries: np.ndarray) -> np.ndarray:
        return np.array([self.numbers[int(k)] for k in entries.ravel()]).reshape(entries.shape)

    def _one(self, name: str, inputs: tuple[int, ...], power: int = 0) -> int:
        """Returns the entry that an operation on numbers gives, an earlier one if it can."""
        if (short := self._short(name, inputs)) is not None:
            return short
        key = name, power, tuple(sorted(inputs)) if name in ("add", "add_any", "mul") else inputs
        if key not in self._places:
            place = int(self.fresh((), self.constants.issuperset(inputs)))

            def function(*jets: Jet) -> tuple[Jet]:
                return (elementwise(name, jets, power),)

            self.steps.append(Step(function, inputs, (place,)))
            self._places[key] = place
        return self._places[key]

    def _short(self, name: str, inputs: tuple[int, ...]) -> int | None:
        """Returns what comes of sums and products with known zeros and ones, and of known choices."""
        a, b = inputs[0], inputs[-1]
        x, y = self.numbers.get(a), self.numbers.get(b)
        if name in ("add", "add_any"):
            return b if x == 0 else a if y == 0 else None
        if name in ("sub", "div"):
            return a if y == (0 if name == "sub" else 1) else None
        if name == "mul":
            if x == 0 or y == 0:
                return self._known(0.0)
            return b if x == 1 else a if y == 1 else None
        if name == "select_n" and x is not None and int(x) < len(inputs) - 1:
            return inputs[1 + int(x)]
        return None

    def _summed(self, groups: np.ndarray) -> np.ndarray:
        """Returns sums along the last axis."""
        total = np.empty(groups.shape[:-1], int)
        for where in np.ndindex(total.shape):
            some = groups[where].tolist()
            total[where] = some[0] if some else self._known(0.0)
            for k in some[1:]:
                total[where] = self._one("add", (int(total[where]), k))
        return total

    def _dotted(self, inputs: list[np.ndarray], numbers: Any) -> np.ndarray:
        """Returns a product with sums over the contracted axes (dot_general), batch by left by right entries."""
        parts = []
        for entries, contract, batch in zip(inputs, *numbers, strict=True):
            free = [k for k in range(entries.ndim) if k not in contract and k not in batch]
            sizes = (int(np.prod([entries.shape[k] for k in axes], dtype=int)) for axes in (batch, free, contract))
            parts.append(entries.transpose(*batch, *free, *contract).reshape(*sizes))
        left, right = np.broadcast_arrays(parts[0][:, :, None], parts[1][:, None])
        factors = zip(left.ravel().tolist(), right.ravel().tolist(), strict=True)
        products = [self._one("mul", pair) for pair in factors]
        return self._summed(np.array(products, int).reshape(left.shape))

    def _moved(self, equation: Any, inputs: list[np.ndarray]) -> list[np.ndarray] | None:
        """Applies an operation that only moves entries to their numbers; None if others than known ones say where."""
        arguments: list[np.ndarray] = []
        for var, entries in zip(equation.invars, inputs, strict=True):
            if jnp.issubdtype(var.aval.dtype, jnp.floating):
                # Place 0 is a zero, which padding and what a scatter drops become.
                arguments.append((entries + 1).astype(var.aval.dtype))
            elif all(int(k) in self.numbers for k in entries.ravel()):
                arguments.append(self._plain(entries).astype(var.aval.dtype))
            else:
                return None
        found = [np.asarray(out).astype(int) - 1 for out in _results(equation, arguments)]
        zero = self._known(0.0)
        return [np.where(out < 0, zero, out) for out in found]

    def _folded(self, equation: Any, inputs: list[np.ndarray]) -> list[np.ndarray]:
        """Notes an operation of constants as it is; of others, that it is not supported."""
        flat = tuple(int(k) for part in inputs for k in part.ravel())
        constant = self.constants.issuperset(flat)
        outputs = [self.fresh(var.aval.shape, constant) for var in equation.outvars]

        def function(*jets: Jet) -> list[Jet]:
            if not constant or not all(jet.first is None and iv.thin(jet.value) for jet in jets):
                raise UnsupportedOperation(equation.primitive.name)
            values, arguments = [float(jet.value[0].ravel()[0]) for jet in jets], []
            for part in inputs:
                arguments.append(np.array(values[: part.size]).reshape(part.shape))
                values = values[part.size :]
            return [_number_jet(float(x)) for out in _bound(equation, arguments) for x in np.asarray(out).ravel()]

        self.steps.append(Step(function, flat, tuple(int(k) for out in outputs for k in out.ravel())))
        return outputs


def _bound(equation: Any, values: list[np.ndarray]) -> list[Any]:
    """Computes an operation as it is."""
    return _results(equation, [v.astype(a.aval.dtype) for v, a in zip(values, equation.invars, strict=True)])


def _results(equation: Any, arguments: list[np.ndarray]) -> list[Any]:
    found = equation.primitive.bind(*map(jnp.asarray, arguments), **equation.params)
    return list(found) if equation.primitive.multiple_results else [found]


def _groups(entries: np.ndarray, axes: Sequence[int]) -> np.ndarray:
    kept = [k for k in range(entries.ndim) if k not in axes]
    shape = [entries.shape[k] for k in kept]
    return entries.transpose(*kept, *axes).reshape(*shape, -1)
