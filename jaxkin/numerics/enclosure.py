"""Enclosures of a function, its gradient and its second derivatives over boxes, from its jaxpr.

The function is read once as a list of elementary operations and replayed in interval arithmetic, with first and second
derivatives carried along, for all boxes at once. Nothing is compiled. What encloses is the arithmetic, up to rounding,
which is not directed: a user of the bounds keeps a margin far above it.

References:
    Moore, R. E., 1966, "Interval Analysis"; Neumaier, A., 1990, "Interval Methods for Systems of Equations" (mean
    value and Taylor forms).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.numerics import _intervals as iv
from jaxkin.numerics._intervals import Interval


class UnsupportedOperation(NotImplementedError):
    """The function holds an operation for which no enclosure is known."""


@dataclass(frozen=True, eq=False)
class Jet:
    """An array-valued quantity over B boxes: entries stand flat along an axis of S, boxes along the last.

    Attributes:
        value: ``(S, B)``, or ``(S, 1)`` where it is a constant.
        first: ``(d, S, B)`` first derivatives; None where they are zero.
        second: ``(d (d + 1) / 2, S, B)`` second derivatives, pairs i <= j in order; None where they are zero.
        centre: ``(S, B)`` value at the boxes' centres; None for a constant, which has it everywhere.
        half: ``(d, 1, B)`` half widths of the boxes; None for a constant.
        jumps: 1 for an angle that may jump by a whole turn, 2 for what may jump anyhow, 0 for what does not.
    """

    value: Interval
    first: Interval | None = None
    second: Interval | None = None
    centre: np.ndarray | None = None
    half: np.ndarray | None = None
    jumps: int = 0

    @property
    def middle(self) -> np.ndarray:
        """The value at the boxes' centres."""
        return self.value[0] if self.centre is None else self.centre


def pairs(d: int) -> list[tuple[int, int]]:
    """Returns the pairs i <= j that second derivatives stand for, in order."""
    return [(i, j) for i in range(d) for j in range(i, d)]


def _plus(a: Interval | None, b: Interval | None) -> Interval | None:
    if a is None or b is None:
        return b if a is None else a
    return iv.add(a, b)


def _times(a: Interval | None, b: Interval | None) -> Interval | None:
    return None if a is None or b is None else iv.mul(a, b)


def _products(a: Interval | None, b: Interval | None) -> Interval | None:
    """Returns a_i b_j + a_j b_i for all pairs."""
    if a is None or b is None:
        return None
    found = []
    for i, j in pairs(len(a[0])):
        one = iv.mul((a[0][i], a[1][i]), (b[0][j], b[1][j]))
        other = one if i == j else iv.mul((a[0][j], a[1][j]), (b[0][i], b[1][i]))
        found.append(iv.add(one, other))
    return _stacked(found)


def _squares(a: Interval | None) -> Interval | None:
    """Returns a_i a_j for all pairs."""
    if a is None:
        return None
    parts = [(a[0][i], a[1][i]) for i in range(len(a[0]))]
    return _stacked([iv.square(parts[i]) if i == j else iv.mul(parts[i], parts[j]) for i, j in pairs(len(parts))])


def _stacked(parts: list[Interval]) -> Interval:
    return np.stack([low for low, _ in parts]), np.stack([high for _, high in parts])


def _tight(a: Jet) -> Interval:
    """Returns the value, no wider than the mean value form about the centre, which knows what cancels."""
    if a.first is None or a.centre is None or a.half is None or a.jumps:
        return a.value
    reach = np.sum(np.maximum(np.abs(a.first[0]), np.abs(a.first[1])) * a.half, axis=0)
    reach = reach * (1 + 1e-12) + 1e-13 * (np.abs(a.value[0]) + np.abs(a.value[1]))
    return np.fmax(a.value[0], a.centre - reach), np.fmin(a.value[1], a.centre + reach)


def _half(jets: Sequence[Jet]) -> np.ndarray | None:
    return next((jet.half for jet in jets if jet.half is not None), None)


def _jet(
    value: Interval, first: Interval | None, second: Interval | None, centre: np.ndarray, of: Sequence[Jet], jumps: int
) -> Jet:
    """Returns a jet made of others; a constant if they all are."""
    if first is None:
        return Jet(value)
    plain = Jet(value, first, second, centre, _half(of), jumps)
    return replace(plain, value=_tight(plain))


def _added(a: Jet, b: Jet) -> Jet:
    first, second = _plus(a.first, b.first), _plus(a.second, b.second)
    return _jet(iv.add(a.value, b.value), first, second, a.middle + b.middle, (a, b), max(a.jumps, b.jumps))


def _negated(a: Jet) -> Jet:
    first, second = (None if part is None else iv.neg(part) for part in (a.first, a.second))
    return Jet(iv.neg(a.value), first, second, None if a.centre is None else -a.centre, a.half, a.jumps)


def _multiplied(a: Jet, b: Jet) -> Jet:
    if a is b:
        slope, bend = _double(a.value), iv.point(np.full((1, 1), 2.0))
        return _composed(a, iv.square(a.value), slope, bend, a.middle * a.middle)
    first = _plus(_times(a.first, b.value), _times(b.first, a.value))
    second = _plus(_times(a.second, b.value), _times(b.second, a.value))
    second = _plus(second, _products(a.first, b.first))
    return _jet(iv.mul(a.value, b.value), first, second, a.middle * b.middle, (a, b), 2 * max(a.jumps, b.jumps))


def _double(a: Interval) -> Interval:
    return iv.mul(iv.point(np.full((1, 1), 2.0)), a)


def _composed(a: Jet, value: Interval, slope: Interval, bend: Interval, centre: np.ndarray, turns: bool = False) -> Jet:
    """Returns f(a) from enclosures of f, f' and f'' over a's values, and f at its centre."""
    if a.first is None:
        return Jet(value)
    second = _plus(_times(a.second, slope), _times(_squares(a.first), bend))
    jumps = 0 if turns and a.jumps < 2 else 2 * a.jumps
    return _jet(value, _times(a.first, slope), second, centre, (a,), jumps)


def _reciprocal(a: Jet) -> Jet:
    one = iv.reciprocal(a.value)
    return _composed(a, one, iv.neg(iv.square(one)), _double(iv.power(one, 3)), 1.0 / a.middle)


def _power(a: Jet, n: int) -> Jet:
    if n == 0:
        return Jet(iv.point(np.ones_like(a.value[0])))
    if n < 0:
        return _power(_reciprocal(a), -n)
    slope = (
        iv.mul(iv.point(np.full((1, 1), float(n))), iv.power(a.value, n - 1)) if n > 1 else iv.point(np.ones((1, 1)))
    )
    bend = iv.point(np.zeros((1, 1)))
    if n > 1:
        bend = iv.mul(iv.point(np.full((1, 1), float(n * (n - 1)))), iv.power(a.value, n - 2))
    return _composed(a, iv.power(a.value, n), slope, bend, a.middle**n)


def _root(a: Jet) -> Jet:
    value = iv.root(a.value)
    slope = iv.mul(iv.point(np.full((1, 1), 0.5)), _upright(value))
    bend = iv.mul(iv.point(np.full((1, 1), -2.0)), iv.power(slope, 3))
    return _composed(a, value, slope, bend, np.sqrt(np.maximum(a.middle, 0.0)))


def _upright(root: Interval) -> Interval:
    """Returns 1 / root of roots, which are not negative: from 1 / high to inf where the root may vanish."""
    if iv.thin(root):
        return iv.point(1.0 / root[0])
    return 1.0 / root[1], 1.0 / root[0]


def _turned(a: Jet, sine: bool) -> Jet:
    value, slope = (iv.sine(a.value), iv.cosine(a.value)) if sine else (iv.cosine(a.value), iv.neg(iv.sine(a.value)))
    return _composed(a, value, slope, iv.neg(value), np.sin(a.middle) if sine else np.cos(a.middle), True)


def _direction(y: Jet, x: Jet) -> Jet:
    value = iv.direction(y.value, x.value)
    if y.first is None and x.first is None:
        return Jet(value)
    inverse = iv.reciprocal(iv.add(iv.square(y.value), iv.square(x.value)))
    dy, dx = iv.mul(x.value, inverse), iv.neg(iv.mul(y.value, inverse))
    cross = iv.mul(dy, dx)
    # Second derivatives: yy = 2 dx dy, xx = -2 dx dy, xy = dx^2 - dy^2.
    yy, xx = _double(cross), _double(iv.neg(cross))
    xy = iv.add(iv.square(dx), iv.neg(iv.square(dy)))
    first = _plus(_times(y.first, dy), _times(x.first, dx))
    second = _plus(_times(y.second, dy), _times(x.second, dx))
    bent = _plus(_times(_squares(y.first), yy), _times(_squares(x.first), xx))
    second = _plus(second, _plus(bent, _times(_products(y.first, x.first), xy)))
    jumps = max(1, 2 * max(y.jumps, x.jumps))
    return Jet(value, first, second, np.arctan2(y.middle, x.middle), _half((y, x)), jumps)


def _absolute(a: Jet) -> Jet:
    crosses = (a.value[0] < 0) & (a.value[1] > 0)
    sign = np.where(a.value[0] >= 0, 1.0, np.where(a.value[1] <= 0, -1.0, 0.0))
    slope = np.where(crosses, -1.0, sign), np.where(crosses, 1.0, sign)
    # A kink has no second derivative, so that no Taylor form holds over it.
    bend = np.where(crosses, -np.inf, 0.0), np.where(crosses, np.inf, 0.0)
    return _composed(a, iv.absolute(a.value), slope, bend, np.abs(a.middle))


def _selected(which: Jet, cases: Sequence[Jet]) -> Jet:
    if len(cases) != 2:
        raise UnsupportedOperation("select_n of more than two cases")
    low, high = which.value[0] != 0, which.value[1] != 0
    sure_second, unsure = low, high & ~low
    parts: list[Any] = []
    for order in ("value", "first", "second"):
        zero, one = (getattr(case, order) for case in cases)
        if zero is None and one is None and not (order == "second" and unsure.any()):
            parts.append(None)
            continue
        zero, one = (iv.point(np.zeros((1, 1))) if part is None else part for part in (zero, one))
        wide = iv.hull(zero, one)
        if order == "second":
            wide = np.full(1, -np.inf), np.full(1, np.inf)
            if parts[1] is None:
                parts.append(None)
                continue
        parts.append(
            tuple(np.where(unsure, w, np.where(sure_second, b, a)) for w, a, b in zip(wide, zero, one, strict=True))
        )
    centre = np.where(which.middle != 0, cases[1].middle, cases[0].middle)
    return Jet(*parts, centre=centre, half=_half((which, *cases)), jumps=2)


def _compared(name: str, a: Jet, b: Jet) -> Jet:
    """Returns a truth value: (0, 0) no, (1, 1) yes, (0, 1) not known."""
    (a0, a1), (b0, b1) = a.value, b.value
    if name in ("lt", "le"):
        a0, a1, b0, b1 = b0, b1, a0, a1
    strict = name in ("gt", "lt")
    if name in ("gt", "ge", "lt", "le"):
        always, never = (a0 > b1, a1 <= b0) if strict else (a0 >= b1, a1 < b0)
    else:
        always, never = (a0 == a1) & (b0 == b1) & (a0 == b0), (a1 < b0) | (b1 < a0)
        always, never = (never, always) if name == "ne" else (always, never)
    low, high = always.astype(float), (~never).astype(float)
    compare = {"gt": np.greater, "ge": np.greater_equal, "lt": np.less, "le": np.less_equal, "eq": np.equal}
    return Jet((low, high), centre=compare.get(name, np.not_equal)(a.middle, b.middle).astype(float))


_LOGIC: dict[str, Callable[..., Interval]] = {
    "and": lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1])),
    "or": lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1])),
    "not": lambda a: (1.0 - a[1], 1.0 - a[0]),
}

_UNARY: dict[str, Callable[[Jet], Jet]] = {
    "neg": _negated,
    "sin": lambda a: _turned(a, True),
    "cos": lambda a: _turned(a, False),
    "sqrt": _root,
    "rsqrt": lambda a: _reciprocal(_root(a)),
    "abs": _absolute,
    "square": lambda a: _multiplied(a, a),
}

_SAME = ("convert_element_type", "copy", "copy_p", "stop_gradient", "optimization_barrier", "reduce_precision")

_BINARY: dict[str, Callable[[Jet, Jet], Jet]] = {
    "add": _added,
    "add_any": _added,
    "sub": lambda a, b: _added(a, _negated(b)),
    "mul": _multiplied,
    "div": lambda a, b: _multiplied(a, _reciprocal(b)),
    "atan2": _direction,
}


def _elementwise(name: str, inputs: list[Jet], params: dict[str, Any]) -> Jet | None:
    """Returns what an elementwise operation gives; None if it is none."""
    if name in _SAME:
        return inputs[0]
    if name in _UNARY:
        return _UNARY[name](inputs[0])
    if name in _BINARY:
        return _BINARY[name](inputs[0], inputs[1])
    if name == "integer_pow":
        return _power(inputs[0], int(params["y"]))
    if name == "select_n":
        return _selected(inputs[0], inputs[1:])
    if name in ("gt", "lt", "ge", "le", "eq", "ne"):
        return _compared(name, inputs[0], inputs[1])
    if name in _LOGIC:
        centre = _LOGIC[name](*((jet.middle, jet.middle) for jet in inputs))[0]
        return Jet(_LOGIC[name](*(jet.value for jet in inputs)), centre=centre)
    return None


def _taken(jet: Jet, where: np.ndarray) -> Jet:
    """Returns entries of a jet by their places."""
    low = jet.value[0][where]
    value = (low, low) if iv.thin(jet.value) else (low, jet.value[1][where])
    rest = (None if part is None else (part[0][:, where], part[1][:, where]) for part in (jet.first, jet.second))
    return Jet(value, *rest, centre=None if jet.centre is None else jet.centre[where], half=jet.half, jumps=jet.jumps)


def _joined(jets: Sequence[Jet], d: int) -> Jet:
    """Puts the entries of several jets behind each other."""
    width = max(part.value[0].shape[-1] for part in jets)
    parts: list[Any] = []
    for order, count in (("value", None), ("first", d), ("second", d * (d + 1) // 2)):
        of_all = [getattr(jet, order) for jet in jets]
        if all(part is None for part in of_all):
            parts.append(None)
            continue
        ends = []
        for end in (0, 1):
            filled = []
            for jet, part in zip(jets, of_all, strict=True):
                size = (len(jet.value[0]), width)
                shape = size if count is None else (count, *size)
                filled.append(np.zeros(shape) if part is None else np.broadcast_to(part[end], shape))
            ends.append(np.concatenate(filled, axis=-2))
        constant = order == "value" and all(iv.thin(jet.value) for jet in jets)
        parts.append((ends[0], ends[0]) if constant else tuple(ends))
    centre = None
    if any(jet.centre is not None for jet in jets):
        centre = np.concatenate([np.broadcast_to(jet.middle, (len(jet.value[0]), width)) for jet in jets])
    return Jet(*parts, centre=centre, half=_half(jets), jumps=max(jet.jumps for jet in jets))


def _summed(jet: Jet, groups: np.ndarray) -> Jet:
    """Returns sums of entries, ``(n_sum, n_term)`` places."""
    total = _taken(jet, groups[:, 0])
    for column in groups.T[1:]:
        total = _added(total, _taken(jet, column))
    return total


def _dotted(a: Jet, b: Jet, shapes: tuple[tuple[int, ...], tuple[int, ...]], numbers: Any) -> Jet:
    """Returns a product with sums over the contracted axes (dot_general)."""
    (contract_a, contract_b), (batch_a, batch_b) = numbers
    places = []
    for shape, contract, batch in ((shapes[0], contract_a, batch_a), (shapes[1], contract_b, batch_b)):
        free = [k for k in range(len(shape)) if k not in contract and k not in batch]
        order = np.arange(int(np.prod(shape))).reshape(shape).transpose(*batch, *free, *contract)
        n_batch = int(np.prod([shape[k] for k in batch], dtype=int))
        n_free = int(np.prod([shape[k] for k in free], dtype=int))
        places.append(order.reshape(n_batch, n_free, -1))
    left = np.repeat(places[0][:, :, None], places[1].shape[1], axis=2)
    right = np.repeat(places[1][:, None], places[0].shape[1], axis=1)
    terms = left.shape[-1]
    left, right = left.reshape(-1, terms), right.reshape(-1, terms)
    total = _multiplied(_taken(a, left[:, 0]), _taken(b, right[:, 0]))
    for k in range(1, terms):
        total = _added(total, _multiplied(_taken(a, left[:, k]), _taken(b, right[:, k])))
    return total


def _moved(equation: Any, inputs: list[Jet], d: int, known: dict[Any, list[np.ndarray]], key: Any) -> list[Jet]:
    """Applies an operation that only moves entries: once on their numbers, later by the places found then.

    Raises:
        UnsupportedOperation: It does something else.
    """
    floats = [k for k, var in enumerate(equation.invars) if jnp.issubdtype(var.aval.dtype, jnp.floating)]
    if equation.primitive.name not in _MOVES or not floats:
        return _folded(equation, inputs)
    if key not in known:
        known[key] = _places(equation, inputs, floats)
    # Place 0 is a zero, which padding and what a scatter drops become.
    pool = [Jet(iv.point(np.zeros((1, 1)))), *(inputs[k] for k in floats)]
    if len(floats) > 1 or any(np.any(places == 0) for places in known[key]):
        joined = _joined(pool, d)
        return [_taken(joined, places) for places in known[key]]
    return [_taken(pool[1], places - 1) for places in known[key]]


def _folded(equation: Any, inputs: list[Jet]) -> list[Jet]:
    """Computes an operation of constants as it is."""
    if not all(jet.first is None and iv.thin(jet.value) for jet in inputs):
        raise UnsupportedOperation(equation.primitive.name)
    arguments = [_plain(jet, var) for jet, var in zip(inputs, equation.invars, strict=True)]
    found = equation.primitive.bind(*map(jnp.asarray, arguments), **equation.params)
    found = found if equation.primitive.multiple_results else [found]
    return [Jet(iv.point(np.asarray(out, float).reshape(-1, 1))) for out in found]


def _plain(jet: Jet, var: Any) -> np.ndarray:
    return jet.value[0][..., 0].reshape(var.aval.shape).astype(var.aval.dtype)


def _places(equation: Any, inputs: list[Jet], floats: list[int]) -> list[np.ndarray]:
    """Returns where each entry of the results comes from, counted from 1 through all operands; 0 for a zero."""
    arguments: list[Any] = list(equation.invars)
    numbered = 1
    for k, var in enumerate(equation.invars):
        size = int(np.prod(var.aval.shape, dtype=int))
        if k in floats:
            arguments[k] = np.arange(numbered, numbered + size, dtype=var.aval.dtype).reshape(var.aval.shape)
            numbered += size
        else:
            arguments[k] = _plain(inputs[k], var)
    found = equation.primitive.bind(*map(jnp.asarray, arguments), **equation.params)
    found = found if equation.primitive.multiple_results else [found]
    return [np.asarray(out).reshape(-1).astype(int) for out in found]


_MOVES = (
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

_CALLS = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat", "checkpoint")


def _inner(equation: Any) -> Any:
    for name in ("jaxpr", "call_jaxpr", "fun_jaxpr"):
        if name in equation.params:
            return equation.params[name]
    raise UnsupportedOperation(equation.primitive.name)


def _replayed(
    jaxpr: Any, consts: Sequence[Any], inputs: list[Jet], d: int, known: dict[Any, Any], path: tuple[int, ...] = ()
) -> list[Jet]:
    values: dict[Any, Jet] = {}

    def read(atom: Any) -> Jet:
        if hasattr(atom, "val"):
            return Jet(iv.point(np.asarray(atom.val, float).reshape(-1, 1)))
        return values[atom]

    for var, const in zip(jaxpr.constvars, consts, strict=True):
        values[var] = Jet(iv.point(np.asarray(const, float).reshape(-1, 1)))
    values.update(zip(jaxpr.invars, inputs, strict=True))
    if path not in known:
        known[path] = _needed(jaxpr)
    for number, equation in enumerate(known[path]):
        name, arguments = equation.primitive.name, [read(atom) for atom in equation.invars]
        if name in _CALLS:
            inner = _inner(equation)
            body, inside = (inner.jaxpr, inner.consts) if hasattr(inner, "jaxpr") else (inner, ())
            results = _replayed(body, inside, arguments, d, known, (*path, number))
        elif name == "reduce_sum":
            results = [_summed(arguments[0], _groups(equation.invars[0].aval.shape, equation.params["axes"]))]
        elif name == "dot_general":
            shapes = equation.invars[0].aval.shape, equation.invars[1].aval.shape
            results = [_dotted(arguments[0], arguments[1], shapes, equation.params["dimension_numbers"])]
        else:
            same = arguments if name in _MOVES else _spread(arguments, equation)
            one = _elementwise(name, same, equation.params)
            results = _moved(equation, arguments, d, known, (path, number)) if one is None else [one]
        values.update(zip(equation.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _spread(inputs: list[Jet], equation: Any) -> list[Jet]:
    """Gives the operands of an elementwise operation the shape of its result, where an axis has one entry only."""
    shape = equation.outvars[0].aval.shape
    spread = []
    for jet, atom in zip(inputs, equation.invars, strict=True):
        own = atom.aval.shape
        if own != shape and len(own) == len(shape) and int(np.prod(own, dtype=int)) > 1:
            places = np.broadcast_to(np.arange(int(np.prod(own))).reshape(own), shape)
            jet = _taken(jet, places.reshape(-1))
        spread.append(jet)
    return spread


def _groups(shape: tuple[int, ...], axes: Sequence[int]) -> np.ndarray:
    places = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)
    kept = [k for k in range(len(shape)) if k not in axes]
    size = int(np.prod([shape[k] for k in axes], dtype=int))
    return places.transpose(*kept, *axes).reshape(-1, size)


def _needed(jaxpr: Any) -> list[Any]:
    """Returns the equations that the results depend on."""
    wanted = {atom for atom in jaxpr.outvars if not hasattr(atom, "val")}
    kept = []
    for equation in reversed(jaxpr.eqns):
        if any(var in wanted for var in equation.outvars):
            kept.append(equation)
            wanted.update(atom for atom in equation.invars if not hasattr(atom, "val"))
    return kept[::-1]


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A function ``(parameters, x) -> (m,)`` that can be enclosed over boxes of x; make it with ``enclosure_of``."""

    jaxpr: Any
    consts: tuple[Any, ...]
    size: int
    known: dict[Any, Any]

    def __call__(self, parameters: Any, low: np.ndarray, high: np.ndarray) -> Jet:
        """Encloses the function and its derivatives over boxes.

        Args:
            parameters: Numbers in the structure for which the function was read.
            low: ``(d, B)`` lower ends.
            high: ``(d, B)`` upper ends.

        Returns:
            The jet: value ``(m, B)``, first ``(d, m, B)`` and second derivatives ``(d (d + 1) / 2, m, B)``, a low and
            a high array each; infinite where nothing is known, for instance where a root may vanish.

        Raises:
            UnsupportedOperation: No enclosure is known of one of its operations.
        """
        d, boxes = low.shape
        unit = np.broadcast_to(np.eye(d)[:, :, None], (d, d, boxes))
        leaves = [np.asarray(leaf, float).reshape(-1, 1) for leaf in jax.tree_util.tree_leaves(parameters)]
        variables = Jet((low, high), iv.point(unit), None, 0.5 * (low + high), 0.5 * (high - low)[:, None])
        inputs = [*(Jet(iv.point(leaf)) for leaf in leaves), variables]
        with np.errstate(all="ignore"):
            (result,) = _replayed(self.jaxpr, self.consts, inputs, d, self.known)
        shapes = (self.size, boxes), (d, self.size, boxes), (d * (d + 1) // 2, self.size, boxes)
        parts = result.value, result.first, result.second
        value, first, second = (_filled(part, shape) for part, shape in zip(parts, shapes, strict=True))
        return Jet(value, first, second)


def _filled(part: Interval | None, shape: tuple[int, ...]) -> Interval:
    """Returns an interval in its full shape, NaN ends as infinite ones."""
    low, high = (np.zeros(1),) * 2 if part is None else part
    low, high = np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)
    return np.broadcast_to(low, shape), np.broadcast_to(high, shape)


def enclosure_of(function: Callable[[Any, Any], Any], parameters: Any, dimension: int) -> Enclosure:
    """Reads a function ``(parameters, x) -> (m,)`` of JAX, x of ``(dimension,)``, for enclosures over boxes of x.

    It may hold sums, products, quotients, integer powers, square roots, sines, cosines, two-argument arctangents,
    absolute values, comparisons and choices. Whole numbers that say where entries go must not depend on the parameters.
    """
    closed = jax.make_jaxpr(function)(parameters, jnp.zeros(dimension))
    return Enclosure(closed.jaxpr, tuple(closed.consts), int(np.prod(closed.out_avals[0].shape, dtype=int)), {})


def taylor_remainder(jet: Jet, half: np.ndarray) -> np.ndarray:
    """Bounds what a second-order remainder adds to a linear form about a box's centre, ``(m, B)``.

    Args:
        jet: Enclosure over the box, or over a larger one.
        half: ``(d, B)`` half widths of the box.
    """
    assert jet.second is not None
    total = np.zeros(jet.second[0].shape[1:])
    with np.errstate(invalid="ignore"):
        for k, (i, j) in enumerate(pairs(len(half))):
            size = iv.magnitude((jet.second[0][k], jet.second[1][k]))
            total += (0.5 if i == j else 1.0) * size * half[i] * half[j]
    return total * (1 + 1e-9)
