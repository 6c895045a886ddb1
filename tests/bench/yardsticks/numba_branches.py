"""Numba yardsticks: all assembly modes of the analytic and of a general 3-RPR, one core; None where numba is absent."""

import math
from collections.abc import Callable

import numpy as np

try:
    import numba
except ImportError:
    numba = None

branches_analytic_numba: Callable[..., np.ndarray] | None = None
branches_general_numba: Callable[..., np.ndarray] | None = None

if numba is not None:
    TURN = 0.3  # a turned half-angle frame, so that phi = pi is no special root
    THIRD, ROOT3 = 1 / 3, math.sqrt(3)
    CHARTS = 12
    #: cot(pi/24) and a little: |P| >= M cos(pi/4) at infinity and |P| <= M keep roots pi/12 away.
    RANGE = 7.7
    _ANGLES = 2 * np.pi * np.arange(7) / 7
    _FOURIER = np.vstack([np.ones(7) / 7] + [2 / 7 * f(k * _ANGLES) for k in (1, 2, 3) for f in (np.cos, np.sin)])
    _SAMPLES = 2 * np.pi * np.outer(np.arange(CHARTS), np.arange(4)) / CHARTS
    _COSINE, _SINE = np.cos(_SAMPLES), np.sin(_SAMPLES)

    @numba.njit(fastmath={"contract", "arcp", "nsz", "reassoc"}, error_model="numpy")
    def _analytic(c2, c3, d3, rho1, rho2, rho3, out):
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
            s0, s1, s2, number = 0.0, 0.0, 0.0, 1
            if disc >= 0:
                y = -0.5 * (N + math.copysign(math.sqrt(disc), N))
                y = math.copysign(abs(y) ** THIRD, y)
                s0 = y + M / y - b
            else:
                m = math.sqrt(M)
                psi = math.acos(max(-1.0, min(1.0, -0.5 * N / (m * M)))) * THIRD
                co = m * math.cos(psi)
                si = ROOT3 * math.sqrt(max(M - co * co, 0.0))
                s0, s1, s2, number = 2 * co - b, -co - si - b, si - co - b, 3
            for j in range(3):
                for lane in range(2 * j, 2 * j + 2):
                    out[lane, 0, i] = out[lane, 1, i] = out[lane, 2, i] = math.nan
                if j >= number:
                    continue
                s, t = (s0 if j == 0 else s1 if j == 1 else s2), 3 * a
                S, C = cs * s + sn * t, cs * t - sn * s
                scale = math.copysign(1 / math.sqrt(S * S + C * C), C)
                S, C = S * scale, C * scale
                v, g = (v0 * s + v1 * t) * scale, (g0 * s + g1 * t) * scale
                h = -(v + A / (4 * v)) if v * v > g * g else -(g + B / (4 * g))
                p = square - h * h
                if p > 0:
                    p, phi = math.sqrt(p), 2 * math.atan2(S, C)
                    out[2 * j, 0, i], out[2 * j, 1, i], out[2 * j, 2, i] = p * C - h * S, p * S + h * C, phi
                    out[2 * j + 1, 0, i], out[2 * j + 1, 1, i], out[2 * j + 1, 2, i] = (
                        -p * C - h * S,
                        h * C - p * S,
                        phi,
                    )

    def branches_analytic_numba(
        c2: float,
        c3: float,
        d3: float,
        rho1: np.ndarray,
        rho2: np.ndarray,
        rho3: np.ndarray,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Poses (6 lanes, (x, y, phi), n), NaN where there is none; the closed form of the C yardstick, one sample at a time."""
        out = np.empty((6, 3, rho1.size)) if out is None else out
        _analytic(c2, c3, d3, rho1, rho2, rho3, out)
        return out

    @numba.njit(fastmath={"contract"}, error_model="numpy", inline="always")
    def _horner(p, level, t):
        y = p[level, 6 - level]
        for k in range(5 - level, -1, -1):
            y = y * t + p[level, k]
        return y

    @numba.njit(fastmath={"contract"}, error_model="numpy")
    def _between(p, level, low, high, below, steps):
        """The root of one derivative between two points where its sign differs: bisections, then Cauchy's iteration."""
        turn = 1.0 if below else -1.0
        width = high - low
        for _ in range(5):
            width *= 0.5
            if (_horner(p, level, low + width) < 0) == below:
                low += width
        t = low + 0.5 * width
        for _ in range(steps):
            y, d = turn * _horner(p, level, t), max(turn * _horner(p, level + 1, t), 0.0)
            e = turn * _horner(p, level + 2, t)
            t = t - 2 * y / (d + math.sqrt(max(d * d - 2 * y * e, 0.0)) + 1e-300)
            t = min(max(t, low), low + width)
        return t

    @numba.njit(fastmath={"contract"}, error_model="numpy")
    def _real_roots(p, border):
        """Puts the real roots of p[0] into border[1:], in order, and returns their number; only real derivatives' roots are used."""
        for level in range(1, 6):
            for k in range(7 - level):
                p[level, k] = (k + 1) * p[level - 1, k + 1]
        number = 0
        a, b, c = p[4, 2], p[4, 1], p[4, 0]
        square = b * b - 4 * a * c
        if square > 0:
            large = -0.5 * (b + math.copysign(math.sqrt(square), b))
            x, y = large / a, c / large
            for t in (min(x, y), max(x, y)):
                if -RANGE < t < RANGE:
                    number += 1
                    border[number] = t
        for level in range(3, -1, -1):
            border[number + 1] = RANGE
            low, found = -RANGE, 0
            below = _horner(p, level, low) < 0
            for j in range(1, number + 2):
                high = border[j]
                after = _horner(p, level, high) < 0
                if after != below:
                    found += 1
                    border[found] = _between(p, level, low, high, below, 3 if level == 0 else 2)
                low, below = high, after
            number = found
        return number

    @numba.njit(fastmath={"contract"}, error_model="numpy")
    def _general(geometry, fourier, rho1, rho2, rho3, out):
        c2, c3, d3, l2, l3, beta = geometry
        bx, by = l3 * math.cos(beta), l3 * math.sin(beta)
        f, h, p, border, power = np.empty(7), np.empty(7), np.empty((6, 7)), np.empty(8), np.empty(7)
        for i in range(rho1.size):
            r1 = rho1[i] * rho1[i]
            A, B = r1 - rho2[i] * rho2[i], r1 - rho3[i] * rho3[i]
            power[0], power[1], power[2], power[3] = 1.0, A, B, A * A
            power[4], power[5], power[6] = B * B, A * B, r1
            for j in range(7):
                f[j] = 0.0
                for k in range(7):
                    f[j] += fourier[j, k] * power[k]
            largest, chart = 0.0, 0
            for j in range(CHARTS):
                value = f[0]
                for k in range(1, 4):
                    value += _COSINE[j, k] * f[2 * k - 1] + _SINE[j, k] * f[2 * k]
                if abs(value) > largest:
                    largest, chart = abs(value), j
            c0, s0 = -_COSINE[chart, 1], -_SINE[chart, 1]
            h[0], ck, sk = f[0] / largest, c0 / largest, s0 / largest
            for k in range(1, 4):
                h[2 * k - 1], h[2 * k] = f[2 * k - 1] * ck + f[2 * k] * sk, f[2 * k] * ck - f[2 * k - 1] * sk
                ck, sk = ck * c0 - sk * s0, sk * c0 + ck * s0
            p[0, 0], p[0, 6] = h[0] + h[1] + h[3] + h[5], h[0] - h[1] + h[3] - h[5]
            p[0, 1], p[0, 5] = 2 * h[2] + 4 * h[4] + 6 * h[6], 2 * h[2] - 4 * h[4] + 6 * h[6]
            p[0, 2], p[0, 4] = 3 * h[0] + h[1] - 5 * h[3] - 15 * h[5], 3 * h[0] - h[1] - 5 * h[3] + 15 * h[5]
            p[0, 3] = 4 * h[2] - 20 * h[6]
            number = _real_roots(p, border)
            for j in range(6):
                if j >= number:
                    out[j, 0, i] = out[j, 1, i] = out[j, 2, i] = math.nan
                    continue
                t = border[j + 1]
                w = 1 / (1 + t * t)
                cp, sp = (1 - t * t) * w, 2 * t * w
                co, si = c0 * cp - s0 * sp, s0 * cp + c0 * sp
                x2, y2 = l2 * co - c2, l2 * si
                x3, y3 = bx * co - by * si - c3, bx * si + by * co - d3
                e2, e3 = x2 * x2 + y2 * y2 + A, x3 * x3 + y3 * y3 + B
                over = 0.5 / (x2 * y3 - y2 * x3)
                out[j, 0, i], out[j, 1, i] = (y2 * e3 - y3 * e2) * over, (x3 * e2 - x2 * e3) * over
                out[j, 2, i] = math.atan2(si, co)

    def branches_general_numba(
        geometry: tuple[float, ...],
        rho1: np.ndarray,
        rho2: np.ndarray,
        rho3: np.ndarray,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Poses (6 lanes, (x, y, phi), n), NaN where there is none, as in rpr3_general.c; only the brackets that hold a root are solved."""
        out = np.empty((6, 3, rho1.size)) if out is None else out
        _general(geometry, _coefficients(geometry), rho1, rho2, rho3, out)
        return out

    def _coefficients(geometry: tuple[float, ...]) -> np.ndarray:
        """From 1, A, B, A^2, B^2, A B, rho1^2 to the Fourier coefficients of four times the characteristic function."""
        c2, c3, d3, l2, l3, beta = geometry
        v2 = l2 * np.exp(1j * _ANGLES) - c2
        v3 = l3 * np.exp(1j * (_ANGLES + beta)) - complex(c3, d3)
        n2, n3, product = abs(v2) ** 2, abs(v3) ** 2, v2.conj() * v3
        m, d = product.real, product.imag
        rows = [n2 * n3 * (n2 + n3 - 2 * m), 2 * n3 * (n2 - m), 2 * n2 * (n3 - m), n3, n2, -2 * m, -4 * d * d]
        return _FOURIER @ np.stack(rows, axis=1)
