"""Shares of the rotation group: integrals over SO(3) with Haar's measure, which belongs to no choice of angles.

SO(3) is a bundle of circles over the sphere: R -> R e3 has the fibre R Rz(psi), and Haar's measure is the product of
the area of the sphere and the length of the circles, over 8 pi^2. Along a fibre a polynomial of degree d in the entries
of R is a trigonometric polynomial of degree d: all its zeros are known, and the share of a circle on which such
functions have given signs is exact. What remains, a function on the sphere that is smooth between curves, is integrated
over the six faces of a cube around it, one line after the other, each by Gauss and Kronrod's rule on intervals that are
halved until the rule of 7 points agrees with that of 15. No pole, no seam, and no Euler angle is involved.

The same fibres serve for volumes in an Euler chart whose last angle turns about e3, see ``square_shares``.

References:
    Piessens, R. et al., QUADPACK, 1983 (the pair of rules, qk15).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxkin.core.errors import InputError

_TURN = 2 * math.pi
#: Nodes in (0, 1] and weights of the rule of 15 points, and weights of the rule of 7 at every second node.
_NODES = (
    0.991455371120812639206854697526329,
    0.949107912342758524526189684047851,
    0.864864423359769072789712788640926,
    0.741531185599394439863864773280788,
    0.586087235467691130294144691258377,
    0.405845151377397166906606412076961,
    0.207784955007898467600689403773245,
)
_KRONROD = (
    0.022935322010529224963732008058970,
    0.063092092629978553290700663189204,
    0.104790010322250183839876322541518,
    0.140653259715525918745189590510238,
    0.169004726639267902826583426598550,
    0.190350578064785409913256402421014,
    0.204432940075298892414161999234649,
)
_GAUSS = (0.129484966168869693270611432679082, 0.279705391489276667901467771423780, 0.381830050505118944950369775488975)
X = np.array([*(-x for x in _NODES), 0.0, *_NODES[::-1]])
K = np.array([*_KRONROD, 0.209482141084727828012999174891714, *_KRONROD[::-1]])
G = np.zeros(15)
G[1::2] = [*_GAUSS, 0.417959183673469387755102040816327, *_GAUSS[::-1]]
#: Intervals are not halved more often: what is left of a jump is then below rounding.
_DEPTH = 44
#: Every line is halved so often to begin with: what lies between all nodes is not seen.
_FIRST = 2
#: Fibres whose arcs are listed at a time.
_BLOCK = 1 << 15

#: ``(n, 3, 3)`` rotations to ``(k, n)`` values, polynomials of the entries.
Functions = Callable[[np.ndarray], np.ndarray]
#: ``(k, ...)`` truth of "the function is positive" to ``(m, ...)`` truths whose shares are wanted.
Indicator = Callable[[np.ndarray], np.ndarray]


class Affine(NamedTuple):
    """Functions ``constant + sum of slope * R`` of a rotation; callable.

    Attributes:
        constant: ``(k,)``.
        slope: ``(k, 3, 3)``.
    """

    constant: np.ndarray
    slope: np.ndarray

    def __call__(self, rotations: np.ndarray) -> np.ndarray:
        """Returns the values ``(k, n)`` at ``(n, 3, 3)`` rotations."""
        return self.constant[:, None] + np.einsum("kij,nij->kn", self.slope, rotations)


class Shares(NamedTuple):
    """Shares of the rotation group, or volumes.

    Attributes:
        value: ``(m,)``.
        error: ``(m,)`` estimates of the errors, of their order; see ``integrate_square`` for what they leave out.
        fibres: Number of fibres on which the functions were solved.
    """

    value: np.ndarray
    error: np.ndarray
    fibres: int


def random_rotations(count: int, seed: int = 0) -> np.ndarray:
    """Returns rotations drawn evenly from the group, ``(count, 3, 3)``, always the same for one seed."""
    return matrices(np.random.default_rng(seed).normal(size=(count, 4)))


def matrices(quaternions: np.ndarray) -> np.ndarray:
    """Returns the rotations ``(n, 3, 3)`` of quaternions (w, x, y, z) ``(n, 4)`` of any length but zero."""
    w, x, y, z = np.moveaxis(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True), 1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.ascontiguousarray(np.moveaxis(np.array(rows), -1, 0))


def affine(function: Functions, tolerance: float = 1e-11) -> Affine:
    """Returns functions that are affine in the entries of the rotation by their coefficients.

    On the group the nine entries and 1 are independent, so that the coefficients are determined.

    Raises:
        InputError: A function is not affine: its values at other rotations are not those of the fit.
    """
    rotations = random_rotations(48, seed=7)
    values = np.array(function(rotations), float).T
    columns = np.concatenate([np.ones((48, 1)), rotations.reshape(48, 9)], axis=1)
    found = np.linalg.pinv(columns[:24]) @ values[:24]
    off = float(np.abs(columns @ found - values).max(initial=0.0)) / max(1.0, float(np.abs(values).max(initial=0.0)))
    if not off <= tolerance:
        raise InputError(
            f"The functions are not affine in the entries of the rotation: a fit is off by {off:.2g} of the largest "
            "value; pass the function itself, with its degree."
        )
    return Affine(found[0], found[1:].T.reshape(-1, 3, 3))


def all_positive(positive: np.ndarray) -> np.ndarray:
    """Returns, as one row, where all functions are positive."""
    return np.all(positive, axis=0, keepdims=True)


def haar_shares(
    functions: Functions,
    indicator: Indicator = all_positive,
    *,
    degree: int = 1,
    turn: np.ndarray | None = None,
    tolerance: float = 1e-9,
) -> Shares:
    """Returns the share of all rotations at which functions have given signs.

    Args:
        functions: Polynomials in the entries of R; an ``Affine`` is the fastest.
        indicator: What is asked of the signs.
        degree: Degree of the polynomials.
        turn: ``(3, 3)`` a rotation T by which all fibres are turned, to T R Rz(psi). Haar's measure does not change, so
            the result must not; the lines along which the sphere is swept do, so it is a test.
        tolerance: Of the error, which is estimated and reported in any case.

    Raises:
        InputError: The indicator depends on more than the functions' signs, or the tolerance is not positive.
    """
    frame = np.eye(3) if turn is None else np.asarray(turn, float)
    values, errors, fibres = [], [], 0
    for axis in range(3):
        for side in (1.0, -1.0):

            def on_face(s: np.ndarray, t: np.ndarray, axis: int = axis, side: float = side) -> np.ndarray:
                frames, area = _frames_over_face(axis, side, s, t)
                return fibre_shares(functions, indicator, frame @ frames, degree) * (area / (4 * math.pi))

            found = integrate_square(on_face, (-1.0, 1.0), (-1.0, 1.0), tolerance / 6)
            values.append(found.value)
            errors.append(found.error)
            fibres += found.fibres
    return Shares(np.sum(values, axis=0), np.sum(errors, axis=0), fibres)


def _frames_over_face(axis: int, side: float, s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns rotations whose third column points at (side, s, t) of a face, and the area of the sphere there."""
    scale = 1 / np.sqrt(1 + s * s + t * t)
    third = np.empty((len(s), 3))
    third[:, axis], third[:, (axis + 1) % 3], third[:, (axis + 2) % 3] = side * scale, s * scale, t * scale
    across = np.zeros((len(s), 3))
    across[:, (axis + 1) % 3] = 1.0
    first = np.cross(across, third)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(third, first), third], axis=-1), scale**3


def square_shares(
    functions: Functions,
    indicator: Indicator,
    frames: Callable[[np.ndarray, np.ndarray], np.ndarray],
    first: tuple[float, float],
    second: tuple[float, float],
    *,
    weight: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    degree: int = 1,
    tolerance: float = 1e-9,
) -> Shares:
    """Integrates the shares of fibres frames(u, v) Rz(psi) over a rectangle, times 2 pi: a volume in Euler angles.

    Args:
        functions: As in ``haar_shares``.
        indicator: Likewise.
        frames: ``(n, 3, 3)`` rotations for ``(n,)`` values of two angles, psi = 0.
        first: Interval of u.
        second: Interval of v.
        weight: Factor of the integrand; cos(theta) / (8 pi^2) makes it Haar's measure again.
        degree: Degree of the functions.
        tolerance: Of the error.
    """

    def integrand(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        value = _TURN * fibre_shares(functions, indicator, frames(u, v), degree)
        return value if weight is None else value * weight(u, v)

    return integrate_square(integrand, first, second, tolerance)


def fibre_shares(functions: Functions, indicator: Indicator, frames: np.ndarray, degree: int = 1) -> np.ndarray:
    """Returns the share of every circle frame Rz(psi) that the indicator selects, ``(m, n)``, exact to rounding."""
    parts = []
    for start in range(0, len(frames), _BLOCK):
        length, positive = fibre_arcs(functions, frames[start : start + _BLOCK], degree)
        parts.append(np.einsum("mna,na->mn", np.asarray(indicator(positive)), length) / _TURN)
    return np.concatenate(parts, axis=1)


def fibre_arcs(functions: Functions, frames: np.ndarray, degree: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Returns arcs of every circle frame Rz(psi) on which no function changes sign, in order.

    Zeros of all functions cut the circle, and the middle of each arc tells the signs on it. An extra cut does no harm:
    so zeros need no test for being real.

    Returns:
        Lengths ``(n, a)``, and whether each function is positive ``(k, n, a)``.
    """
    waves = _waves(functions, frames, degree)
    cuts = np.sort(np.moveaxis(_cuts(waves), -1, 0).reshape(waves.shape[-1], -1) % _TURN, axis=1)
    ends = np.concatenate([cuts, cuts[:, :1] + _TURN], axis=1)
    middle = (ends[:, 1:] + ends[:, :-1]) / 2
    value = np.broadcast_to(waves[:, 0, :, None], (len(waves), *middle.shape)).copy()
    for k in range(1, degree + 1):
        cos, sin = np.cos(k * middle), np.sin(k * middle)
        value += waves[:, 2 * k - 1, :, None] * cos + waves[:, 2 * k, :, None] * sin
    return np.diff(ends, axis=1), value > 0


def _waves(functions: Functions, frames: np.ndarray, degree: int) -> np.ndarray:
    """Returns Fourier coefficients (1, cos, sin, cos 2, ...) of each function on each fibre, ``(k, 2 d + 1, n)``."""
    if isinstance(functions, Affine) and degree == 1:
        (c1, c2, c3), (s1, s2, s3) = np.moveaxis(frames, -1, 0), np.moveaxis(functions.slope, -1, 0)
        return np.stack([functions.constant[:, None] + s3 @ c3.T, s1 @ c1.T + s2 @ c2.T, s1 @ c2.T - s2 @ c1.T], axis=1)
    count = 2 * degree + 1
    psi = np.arange(count) * (_TURN / count)
    cos, sin, zero, one = np.cos(psi), np.sin(psi), np.zeros(count), np.ones(count)
    spins = np.moveaxis(np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]]), -1, 0)
    turned = frames[:, None] @ spins
    values = np.asarray(functions(turned.reshape(-1, 3, 3))).reshape(-1, len(frames), count)
    spectrum = np.fft.rfft(values, axis=-1) / count
    waves = [spectrum[..., 0].real]
    for k in range(1, degree + 1):
        waves += [2 * spectrum[..., k].real, -2 * spectrum[..., k].imag]
    return np.stack(waves, axis=1)


def _cuts(waves: np.ndarray) -> np.ndarray:
    """Returns angles ``(k, 2 d, n)`` among which are all zeros."""
    degree = waves.shape[1] // 2
    if degree == 1:
        constant, cos, sin = np.moveaxis(waves, 1, 0)
        size = np.hypot(cos, sin)
        ratio = np.divide(-constant, size, out=np.ones_like(size), where=size > np.abs(constant))
        middle, half = np.arctan2(sin, cos), np.arccos(ratio)
        return np.stack([middle - half, middle + half], axis=1)
    # With z = exp(i psi), z^d times the function is a polynomial of degree 2 d; its zeros by its companion matrix.
    harmonics = [(waves[:, 2 * k - 1] - 1j * waves[:, 2 * k]) / 2 for k in range(degree, 0, -1)]
    whole = np.stack([*harmonics, waves[:, 0].astype(complex), *(h.conj() for h in harmonics[::-1])], axis=-1)
    # A leading coefficient of zero would be a zero at infinity, and belongs to no angle.
    small = 1e-14 * np.abs(whole).max(axis=-1)
    lead = np.where(np.abs(whole[..., 0]) > small, whole[..., 0], np.maximum(small, np.finfo(float).tiny))
    companion = np.zeros((*lead.shape, 2 * degree, 2 * degree), complex)
    companion[..., 0, :] = -whole[..., 1:] / lead[..., None]
    companion[..., np.arange(1, 2 * degree), np.arange(2 * degree - 1)] = 1.0
    return np.moveaxis(np.angle(np.linalg.eigvals(companion)), -1, 1)


def integrate_square(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray],
    first: tuple[float, float],
    second: tuple[float, float],
    tolerance: float,
) -> Shares:
    """Integrates a function over a rectangle, line by line, with an estimate of the error.

    Meant for functions that are smooth between curves, on which they bend, have a root's end, or jump. Pieces that lie
    between all nodes of a line (60 to begin with) are not seen, nor counted in the error: so the tips of slender
    regions are lost, unless opposite faces make up for it.

    Args:
        function: Takes ``(n,)`` values of both variables and returns ``(m, n)``.
        first: Interval of the outer variable.
        second: Interval of the inner variable.
        tolerance: Of the error of each of the m integrals, about.

    Raises:
        InputError: The tolerance is not positive.
    """
    if not tolerance > 0:
        raise InputError(f"tolerance is {tolerance}: it must be positive; give 1e-9, say.")
    points = 0
    inner = tolerance / (4 * (first[1] - first[0]))

    def lines(line: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal points
        del line
        value, error, count = _integrate_lines(lambda k, v: (function(u[k], v), 0.0), len(u), second, inner)
        points += count
        return value, error

    value, error, _ = _integrate_lines(lines, 1, first, tolerance / 2)
    return Shares(value[:, 0], error[:, 0], points)


def _integrate_lines(
    function: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray | float]],
    count: int,
    span: tuple[float, float],
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Integrates many functions of one variable at once, ``(line, x) -> values (m, n), their errors``.

    Returns:
        Integrals ``(m, count)``, estimates of their errors, and the number of points.
    """
    line = np.arange(count)
    middle, half = np.full(count, (span[0] + span[1]) / 2), np.full(count, (span[1] - span[0]) / 2)
    total: np.ndarray | None = None
    spent = before = np.zeros((1, 0))
    points = 0
    for depth in range(_DEPTH + 1):
        value, own = function(np.repeat(line, 15), (middle[:, None] + half[:, None] * X).ravel())
        points_now = value.shape[1]
        points += points_now
        value = value.reshape(len(value), -1, 15)
        best = value @ K * half
        off = np.abs(value @ (K - G)) * half
        if depth:
            # By chance both rules may agree on a bend or a jump, but not also with the whole before it was halved.
            change = np.abs(before - best[:, ::2] - best[:, 1::2]) / 2
            off = np.maximum(off, np.repeat(change, 2, axis=1))
        inherited = np.broadcast_to(own, (len(value), points_now)).reshape(len(value), -1, 15) @ K * half
        if total is None:
            total, spent = np.zeros((len(value), count)), np.zeros((len(value), count))
        # Singular places take a few intervals of every size: each may spend a fixed part of the tolerance.
        done = (off.max(axis=0) <= tolerance / 16) & (depth >= _FIRST) | (depth == _DEPTH)
        for k in range(len(value)):
            np.add.at(total[k], line[done], best[k, done])
            np.add.at(spent[k], line[done], off[k, done] + inherited[k, done])
        line, middle, half = np.repeat(line[~done], 2), np.repeat(middle[~done], 2), np.repeat(half[~done] / 2, 2)
        if not len(line):
            break
        before = best[:, ~done]
        middle[::2] -= half[::2]
        middle[1::2] += half[1::2]
    assert total is not None
    return total, spent, points
