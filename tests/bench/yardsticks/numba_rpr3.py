"""Numba yardstick: the count of the analytic 3-RPR, one core. `count_numba` is None where numba is absent."""

import math
from collections.abc import Callable

import numpy as np

try:
    import numba
except ImportError:
    numba = None

count_numba: Callable[..., np.ndarray] | None = None

if numba is not None:
    TURN = 0.3  # a turned half-angle frame, so that phi = pi is no special root
    THIRD, ROOT3 = 1 / 3, math.sqrt(3)

    @numba.njit(fastmath=True, inline="always")
    def _real(v0, v1, g0, g1, s, k, A, B, square):
        v, g, w = v0 * s + v1 * k, g0 * s + g1 * k, s * s + k * k
        first = v * v > g * g
        u2, X = (4 * v * v, A) if first else (4 * g * g, B)
        q = u2 + X * w
        return 2 if q * q < 4 * u2 * w * square else 0

    @numba.njit(fastmath=True, error_model="numpy")
    def _count(c2, c3, d3, rho1, rho2, rho3, out):
        cs, sn = math.cos(TURN), math.sin(TURN)
        v0, v1 = c2 * cs, c2 * sn
        g0, g1 = c3 * cs + d3 * sn, c3 * sn - d3 * cs
        e0, e1 = v0 - g0, v1 - g1
        a0 = 4 * v0 * g0 * e0
        b0 = 4 * (v1 * g0 * e0 + v0 * g1 * e0 + v0 * g0 * e1)
        k0 = 4 * (v0 * g1 * e1 + v1 * g0 * e1 + v1 * g1 * e0)
        f0 = 4 * v1 * g1 * e1
        for i in range(rho1.size):
            square = rho1[i] * rho1[i]
            A, B = square - rho2[i] * rho2[i], square - rho3[i] * rho3[i]
            p0, p1 = g0 * A - v0 * B, g1 * A - v1 * B
            a, b, k, f = a0 + p0, b0 + p1, k0 + p0, f0 + p1
            M = b * b - 3 * a * k
            N = b * (2 * b * b - 9 * a * k) + 27 * a * a * f
            disc = N * N - 4 * M * M * M
            if disc >= 0:
                y = -0.5 * (N + math.copysign(math.sqrt(disc), N))
                y = math.copysign(abs(y) ** THIRD, y)
                out[i] = _real(v0, v1, g0, g1, y + M / y - b, 3 * a, A, B, square)
            else:
                m = math.sqrt(M)
                psi = math.acos(max(-1.0, min(1.0, -0.5 * N / (m * M)))) * THIRD
                co = m * math.cos(psi)
                si = ROOT3 * math.sqrt(max(M - co * co, 0.0))
                n = _real(v0, v1, g0, g1, 2 * co - b, 3 * a, A, B, square)
                n += _real(v0, v1, g0, g1, -co - si - b, 3 * a, A, B, square)
                out[i] = n + _real(v0, v1, g0, g1, si - co - b, 3 * a, A, B, square)

    def count_numba(
        c2: float,
        c3: float,
        d3: float,
        rho1: np.ndarray,
        rho2: np.ndarray,
        rho3: np.ndarray,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Number of real poses; the leg lengths are contiguous arrays. The first call compiles."""
        out = np.empty(rho1.shape, np.uint8) if out is None else out
        _count(c2, c3, d3, rho1, rho2, rho3, out)
        return out
