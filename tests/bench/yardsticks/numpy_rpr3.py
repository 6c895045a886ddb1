"""NumPy yardsticks: the count of the analytic 3-RPR in closed form, and all assembly modes of a general 3-RPR by companion eigenvalues."""

import numpy as np

TURN = 0.3  # a turned half-angle frame, so that phi = pi is no special root


def count_closed_form(c2: float, c3: float, d3: float, r1: np.ndarray, r2: np.ndarray, r3: np.ndarray) -> np.ndarray:
    """Number of real poses for base (0,0),(c2,0),(c3,d3) and platform (0,0),(c2,0),(c3,-d3); r1, r2, r3 are the leg lengths."""
    cs, sn = np.cos(TURN), np.sin(TURN)
    v0, v1 = c2 * cs, c2 * sn
    g0, g1 = c3 * cs + d3 * sn, c3 * sn - d3 * cs
    e0, e1 = v0 - g0, v1 - g1
    square = r1 * r1
    A, B = square - r2 * r2, square - r3 * r3
    p0, p1 = g0 * A - v0 * B, g1 * A - v1 * B
    a = p0 + 4 * v0 * g0 * e0
    b = p1 + 4 * (v1 * g0 * e0 + v0 * g1 * e0 + v0 * g0 * e1)
    k = p0 + 4 * (v0 * g1 * e1 + v1 * g0 * e1 + v1 * g1 * e0)
    e = p1 + 4 * v1 * g1 * e1

    ak, bb = a * k, b * b
    M = bb - 3 * ak
    N = b * (2 * bb - 9 * ak) + 27 * a * a * e
    M3 = 4 * M * M * M
    disc = N * N - M3
    three = disc < 0
    denominator = 3 * a

    def real(s: np.ndarray, k: np.ndarray, A: np.ndarray, B: np.ndarray, square: np.ndarray) -> np.ndarray:
        v2, g2, w = (v0 * s + v1 * k) ** 2, (g0 * s + g1 * k) ** 2, s * s + k * k
        first = v2 > g2
        u2 = 4 * np.where(first, v2, g2)
        q = u2 + np.where(first, A, B) * w
        return q * q < 4 * u2 * w * square

    # Each formula only on the samples it applies to: cheaper than both everywhere.
    count = np.empty(np.shape(disc), np.uint8)
    at = ~three
    y = np.cbrt(-0.5 * (N[at] + np.copysign(np.sqrt(disc[at]), N[at])))
    count[at] = 2 * real(y + M[at] / y - b[at], denominator[at], A[at], B[at], square[at])
    m = np.sqrt(M[three])
    psi = np.arccos(np.clip(-N[three] / (2 * m**3), -1, 1)) / 3
    co, si = m * np.cos(psi), np.sqrt(3) * m * np.sin(psi)
    b3, rest = b[three], (denominator[three], A[three], B[three], square[three])
    count[three] = 2 * (
        real(2 * co - b3, *rest).view(np.uint8) + real(-co - si - b3, *rest) + real(si - co - b3, *rest)
    )
    return count


_ANGLES = 2 * np.pi * np.arange(7) / 7
_DFT = np.vstack([np.ones(7) / 7] + [2 / 7 * f(j * _ANGLES) for j in (1, 2, 3) for f in (np.cos, np.sin)])


def _to_half_angle() -> np.ndarray:
    """From seven samples to coefficients in t = tan(psi/2), times (1 + t^2)^3, lowest power first: e^(i psi) = (1 + i t)^2 / (1 + t^2)."""
    one, z = np.array([1, 0, 1]), np.array([1, 2j, -1])
    rows = [np.polynomial.polynomial.polypow(one, 3)]
    for j in (1, 2, 3):
        row = np.array([1.0])
        for factor in [z] * j + [one] * (3 - j):
            row = np.convolve(row, factor)
        rows += [row.real, row.imag]
    return np.array(rows).T @ _DFT


_HALF_ANGLE = _to_half_angle()


def branches_general_companion(
    c2: float,
    c3: float,
    d3: float,
    l2: float,
    l3: float,
    beta: float,
    rho1: np.ndarray,
    rho2: np.ndarray,
    rho3: np.ndarray,
    tolerance: float = 1e-7,
) -> np.ndarray:
    """Poses (n, 6, (x, y, phi)), NaN where there is none, of base (0,0),(c2,0),(c3,d3), platform (0,0), l2 at 0, l3 at beta.

    P(phi) = N1^2 + N2^2 - rho1^2 D^2, with x = N1/D and y = N2/D from the differences of the leg equations, is a trigonometric
    polynomial of degree 3. Not for the mirrored family, where D = 0 identically.
    """
    r1 = rho1 * rho1
    A, B = r1 - rho2 * rho2, r1 - rho3 * rho3

    def linear(
        cos: np.ndarray, sin: np.ndarray, A: np.ndarray, B: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x3, y3 = l3 * (np.cos(beta) * cos - np.sin(beta) * sin), l3 * (np.sin(beta) * cos + np.cos(beta) * sin)
        R, S, Q = 2 * (l2 * cos - c2), 2 * l2 * sin, l2 * l2 + c2 * c2 - 2 * c2 * l2 * cos + A
        U, V, W = 2 * (x3 - c3), 2 * (y3 - d3), l3 * l3 + c3 * c3 + d3 * d3 - 2 * (c3 * x3 + d3 * y3) + B
        return S * W - V * Q, U * Q - R * W, R * V - S * U

    N1, N2, D = linear(np.cos(_ANGLES), np.sin(_ANGLES), A[:, None], B[:, None])
    P = N1 * N1 + N2 * N2 - r1[:, None] * D * D
    # The leading coefficient in t is P(origin + pi): measure psi = phi - origin from where that is close to the largest sample.
    shift = (np.abs(P).argmax(1) + 4) % 7
    P = np.take_along_axis(P, (np.arange(7) + shift[:, None]) % 7, 1)
    coefficient = P @ _HALF_ANGLE.T
    companion = np.zeros((len(P), 6, 6))
    companion[:, np.arange(1, 6), np.arange(5)] = 1
    companion[:, :, 5] = -coefficient[:, :6] / coefficient[:, 6:]
    t = np.linalg.eigvals(companion)

    w = 1 + t.real**2
    cos0, sin0 = np.cos(_ANGLES)[shift, None], np.sin(_ANGLES)[shift, None]
    cos_psi, sin_psi = (2 - w) / w, 2 * t.real / w
    cos, sin = cos0 * cos_psi - sin0 * sin_psi, sin0 * cos_psi + cos0 * sin_psi
    N1, N2, D = linear(cos, sin, A[:, None], B[:, None])
    poses = np.stack([N1 / D, N2 / D, np.arctan2(sin, cos)], -1)
    poses[np.abs(t.imag) > tolerance * w] = np.nan
    return poses
