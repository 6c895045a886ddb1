"""Singular surfaces of the analytic 3-RPR family by elimination from its three distance constraints.

Nothing but exact resultants and discriminants of python-flint; no formula of the paper beyond Eqs. (1)-(3) is used.
"""

from __future__ import annotations

from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from oracles.rpr3_exact import Number, rational

_CTX = fmpq_mpoly_ctx.get(("x", "y", "t"))
_X, _Y, _T = _CTX.gens()
_E = 1 + _T**2


def _constraints(geometry: tuple[Number, ...], rho: tuple[Number, ...]) -> tuple[fmpq_mpoly, fmpq_mpoly, fmpq_mpoly]:
    """Returns Eq. (1), and (1 + t^2) times Eqs. (2) and (3) minus (1), with t = tan(phi/2)."""
    c2, c3, d3 = map(rational, geometry)
    r1, r2, r3 = (rational(v) ** 2 for v in rho)

    def line(a: tuple[fmpq, fmpq], b: tuple[fmpq, fmpq], r: fmpq) -> fmpq_mpoly:
        # |X + R b - a|^2 - |X|^2, where (1 + t^2) R b is polynomial in t.
        turned = (1 - _T**2) * b[0] - 2 * _T * b[1], 2 * _T * b[0] + (1 - _T**2) * b[1]
        first, second = turned[0] - _E * a[0], turned[1] - _E * a[1]
        squares = _E * (a[0] ** 2 + a[1] ** 2 + b[0] ** 2 + b[1] ** 2) - 2 * (turned[0] * a[0] + turned[1] * a[1])
        return 2 * (_X * first + _Y * second) + squares - (r - r1) * _E

    zero = fmpq(0)
    return _X**2 + _Y**2 - r1, line((c2, zero), (c2, zero), r2), line((c3, d3), (c3, -d3), r3)


def characteristic(geometry: tuple[Number, ...], rho: tuple[Number, ...]) -> fmpq_mpoly:
    """Eliminates x and y from the two lines, which are parallel: a cubic in t is left."""
    _, two, three = _constraints(geometry, rho)
    cubic = two.resultant(three, "y")
    while (rest := divmod(cubic, _E))[1].is_zero():
        cubic = rest[0]
    return cubic


def double_root(geometry: tuple[Number, ...], rho: tuple[Number, ...]) -> float:
    """Returns the discriminant of the characteristic cubic as a form of degree 3; the elimination gives it 4-fold."""
    cubic = characteristic(geometry, rho)
    top = [cubic[(0, 0, power)] for power in (3, 2)]
    if top[0] == 0:  # A root at infinity, and that of degree 2 is left.
        return float_of(cubic.discriminant("t") * top[1] ** 2) / 4.0**4
    return float_of(cubic.discriminant("t")) / 4.0**4


def parallel_legs(geometry: tuple[Number, ...], rho: tuple[Number, ...]) -> float:
    """Eliminates everything from (1), (4), their tangency and the cubic: the paper's K Q1 Q2 Q3 Q4."""
    circle, two, _ = _constraints(geometry, rho)
    tangency = circle.resultant(two, "y").discriminant("x")
    while (rest := divmod(tangency, _E))[1].is_zero():
        tangency = rest[0]
    while (rest := divmod(tangency, _T))[1].is_zero():
        tangency = rest[0]
    return float_of(tangency.resultant(characteristic(geometry, rho), "t"))


def float_of(constant: fmpq_mpoly) -> float:
    """Converts a constant polynomial."""
    value = constant.coefficient(0) if not constant.is_zero() else fmpq(0)
    return int(value.p) / int(value.q)
