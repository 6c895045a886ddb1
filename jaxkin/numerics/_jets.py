"""Jets over boxes: enclosures of a number, its gradient and its second derivatives, and arithmetic with them.

References:
    Moore, R. E., 1966, "Interval Analysis"; Neumaier, A., 1990, "Interval Methods for Systems of Equations" (mean
    value and Taylor forms).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

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


def _tight(
    value: Interval, first: Interval | None, centre: np.ndarray | None, half: np.ndarray | None, jumps: int
) -> Interval:
    """Returns the value, no wider than the mean value form about the centre, which knows what cancels."""
    if first is None or centre is None or half is None or jumps:
        return value
    size = np.maximum(np.abs(first[0]), np.abs(first[1]))
    reach = size[0] * half[0]
    for k in range(1, len(size)):
        reach = reach + size[k] * half[k]
    reach = reach * (1 + 1e-12) + 1e-13 * (np.abs(value[0]) + np.abs(value[1]))
    return np.fmax(value[0], centre - reach), np.fmin(value[1], centre + reach)


def _half(jets: Sequence[Jet]) -> np.ndarray | None:
    return next((jet.half for jet in jets if jet.half is not None), None)


def _jet(
    value: Interval, first: Interval | None, second: Interval | None, centre: np.ndarray, of: Sequence[Jet], jumps: int
) -> Jet:
    """Returns a jet made of others; a constant if they all are."""
    if first is None:
        return Jet(value)
    half = _half(of)
    return Jet(_tight(value, first, centre, half, jumps), first, second, centre, half, jumps)


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

_BINARY: dict[str, Callable[[Jet, Jet], Jet]] = {
    "add": _added,
    "add_any": _added,
    "sub": lambda a, b: _added(a, _negated(b)),
    "mul": _multiplied,
    "div": lambda a, b: _multiplied(a, _reciprocal(b)),
    "atan2": _direction,
}


_COMPARISONS = ("gt", "lt", "ge", "le", "eq", "ne")


def is_elementwise(name: str) -> bool:
    """True for operations that ``elementwise`` knows."""
    return name in _UNARY or name in _BINARY or name in _LOGIC or name in (*_COMPARISONS, "integer_pow", "select_n")


def elementwise(name: str, inputs: Sequence[Jet], power: int = 0) -> Jet:
    """Returns what an operation on numbers gives; the power is that of ``integer_pow``."""
    if name in _UNARY:
        return _UNARY[name](inputs[0])
    if name in _BINARY:
        return _BINARY[name](inputs[0], inputs[1])
    if name == "integer_pow":
        return _power(inputs[0], power)
    if name == "select_n":
        return _selected(inputs[0], inputs[1:])
    if name in _COMPARISONS:
        return _compared(name, inputs[0], inputs[1])
    centre = _LOGIC[name](*((jet.middle, jet.middle) for jet in inputs))[0]
    return Jet(_LOGIC[name](*(jet.value for jet in inputs)), centre=centre)


def joined(jets: Sequence[Jet], d: int) -> Jet:
    """Returns one jet with the entries of several, in full shape, NaN ends as infinite ones."""
    boxes = max(jet.value[0].shape[-1] for jet in jets)
    parts: list[Any] = []
    for order, count in (("value", None), ("first", d), ("second", d * (d + 1) // 2)):
        shape = (1, boxes) if count is None else (count, 1, boxes)
        of_all = [getattr(jet, order) for jet in jets]
        ends = []
        for end, missing in ((0, -np.inf), (1, np.inf)):
            rows = [np.broadcast_to(0.0 if part is None else part[end], shape) for part in of_all]
            row = np.concatenate(rows, axis=-2)
            row[np.isnan(row)] = missing
            ends.append(row)
        parts.append(tuple(ends))
    return Jet(*parts)
