"""Interval arithmetic on NumPy arrays: a pair ``(low, high)``; a number is one array twice, and stays one.

Results hold up to rounding, which is not directed: who needs a margin adds one far above 1e-15 of the terms.
"""

from typing import TypeAlias

import numpy as np

Interval: TypeAlias = tuple[np.ndarray, np.ndarray]


def thin(a: Interval) -> bool:
    """True where both ends are one array: a number."""
    return a[0] is a[1]


def point(value: np.ndarray) -> Interval:
    """Returns a number as an interval."""
    return value, value


def add(a: Interval, b: Interval) -> Interval:
    """Returns a + b."""
    low = a[0] + b[0]
    return (low, low) if thin(a) and thin(b) else (low, a[1] + b[1])


def neg(a: Interval) -> Interval:
    """Returns -a."""
    low = -a[1]
    return (low, low) if thin(a) else (low, -a[0])


def mul(a: Interval, b: Interval) -> Interval:
    """Returns a b, with 0 times an infinite end taken as 0; a square where both are the same interval."""
    if thin(a) and thin(b):
        return point(a[0] * b[0])
    if thin(a):
        return _ordered(a[0] * b[0], a[0] * b[1])
    if thin(b):
        return _ordered(b[0] * a[0], b[0] * a[1])
    if a[0] is b[0] and a[1] is b[1]:
        return square(a)
    p, q, r, s = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    # fmin and fmax leave NaN = 0 * inf out, which stands for a zero that another product has as well.
    low, high = np.fmin(p, q), np.fmax(p, q, out=p)
    for other in (r, s):
        np.fmin(low, other, out=low)
        np.fmax(high, other, out=high)
    return low, high


def _ordered(p: np.ndarray, q: np.ndarray) -> Interval:
    return np.fmin(p, q), np.fmax(p, q)


def square(a: Interval) -> Interval:
    """Returns a^2."""
    if thin(a):
        return point(a[0] * a[0])
    p, q = a[0] * a[0], a[1] * a[1]
    return np.where((a[0] < 0) & (a[1] > 0), 0.0, np.minimum(p, q)), np.maximum(p, q)


def power(a: Interval, n: int) -> Interval:
    """Returns a^n for an integer n."""
    if n < 0:
        return reciprocal(power(a, -n))
    if thin(a):
        return point(a[0] ** n)
    if n % 2:
        return a[0] ** n, a[1] ** n
    p, q = a[0] ** n, a[1] ** n
    return np.where((a[0] < 0) & (a[1] > 0), 0.0, np.minimum(p, q)), np.maximum(p, q)


def reciprocal(a: Interval) -> Interval:
    """Returns 1 / a; everything where a holds zero."""
    if thin(a):
        return point(1.0 / a[0])
    holds = (a[0] <= 0) & (a[1] >= 0)
    return np.where(holds, -np.inf, 1.0 / a[1]), np.where(holds, np.inf, 1.0 / a[0])


def root(a: Interval) -> Interval:
    """Returns the square root of what of a is not negative."""
    low = np.sqrt(np.maximum(a[0], 0.0))
    return (low, low) if thin(a) else (low, np.sqrt(np.maximum(a[1], 0.0)))


def cosine(a: Interval) -> Interval:
    """Returns cos a."""
    if thin(a):
        return point(np.cos(a[0]))
    p, q = np.cos(a[0]), np.cos(a[1])
    top = np.floor(a[1] / (2 * np.pi)) >= np.ceil(a[0] / (2 * np.pi))
    bottom = np.floor(a[1] / (2 * np.pi) - 0.5) >= np.ceil(a[0] / (2 * np.pi) - 0.5)
    wild = ~(a[1] - a[0] < 2 * np.pi)
    return np.where(bottom | wild, -1.0, np.fmin(p, q)), np.where(top | wild, 1.0, np.fmax(p, q))


def sine(a: Interval) -> Interval:
    """Returns sin a."""
    if thin(a):
        return point(np.sin(a[0]))
    return cosine((a[0] - np.pi / 2, a[1] - np.pi / 2))


def direction(y: Interval, x: Interval) -> Interval:
    """Returns the angle of (x, y) in [-pi, pi]; everything where the box meets the cut or the origin."""
    corners = [np.arctan2(v, u) for v in y for u in x]
    low, high = np.fmin.reduce(corners), np.fmax.reduce(corners)
    cut = (y[0] <= 0) & (y[1] >= 0) & (x[0] <= 0)
    return np.where(cut, -np.pi, low), np.where(cut, np.pi, high)


def absolute(a: Interval) -> Interval:
    """Returns |a|."""
    if thin(a):
        return point(np.abs(a[0]))
    p, q = np.abs(a[0]), np.abs(a[1])
    return np.where((a[0] < 0) & (a[1] > 0), 0.0, np.minimum(p, q)), np.maximum(p, q)


def hull(a: Interval, b: Interval) -> Interval:
    """Returns the smallest interval that holds both."""
    return np.minimum(a[0], b[0]), np.maximum(a[1], b[1])


def magnitude(a: Interval) -> np.ndarray:
    """Returns the largest absolute value, inf where anything is undefined."""
    size = np.maximum(np.abs(a[0]), np.abs(a[1]))
    return np.where(np.isnan(size), np.inf, size)
