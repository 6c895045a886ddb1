"""Numba yardsticks: conditioning of the 3-RPR, the TLPM and the 3-PPPS (side 1), and interference of the TLPM, one core.

The formulas of jaxkin's kernels and of spatial.c, sample by sample. Each function is None where numba is absent, compiles
at its first call, and writes into an array that it is given. ``what`` is 0 for det dF/dx, 1 for the smallest singular
value of the scaled dq/dx, 2 for the inverse condition number.
"""

import math
from collections.abc import Callable

import numpy as np

try:
    import numba
except ImportError:
    numba = None

rpr3_conditioning: Callable[..., None] | None = None
rpr3_conditioning_grid: Callable[..., None] | None = None
tlpm_conditioning: Callable[..., None] | None = None
tlpm_conditioning_grid: Callable[..., None] | None = None
ppps3_conditioning: Callable[..., None] | None = None
ppps3_conditioning_grid: Callable[..., None] | None = None
tlpm_interference: Callable[..., None] | None = None

HALF_ROOT3, ROOT3 = math.sqrt(3.0) / 2, math.sqrt(3.0)

if numba is not None:
    FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}
    compiled = numba.njit(fastmath=FAST, error_model="numpy")
    inline = numba.njit(fastmath=FAST, error_model="numpy", inline="always")

    @inline
    def _det(a0, a1, a2, b0, b1, b2, c0, c1, c2):
        return a0 * (b1 * c2 - b2 * c1) + a1 * (b2 * c0 - b0 * c2) + a2 * (b0 * c1 - b1 * c0)

    @inline
    def _polynomial(k, c0, c1, c2, c3, c4, c5, c6):
        return c0 + k * (c1 + k * (c2 + k * (c3 + k * (c4 + k * (c5 + k * c6)))))

    @inline
    def _of_three(x0, x1, x2, y0, y1, y2, z0, z1, z2):
        g00, g11, g22 = x0 * x0 + x1 * x1 + x2 * x2, y0 * y0 + y1 * y1 + y2 * y2, z0 * z0 + z1 * z1 + z2 * z2
        g01, g02, g12 = x0 * y0 + x1 * y1 + x2 * y2, x0 * z0 + x1 * z1 + x2 * z2, y0 * z0 + y1 * z1 + y2 * z2
        mean = (g00 + g11 + g22) / 3
        d0, d1, d2 = g00 - mean, g11 - mean, g22 - mean
        square = (d0 * d0 + d1 * d1 + d2 * d2 + 2 * (g01 * g01 + g02 * g02 + g12 * g12)) / 6
        spread = math.sqrt(max(square, 1e-300))
        inverse = 1 / spread
        d0, d1, d2 = d0 * inverse, d1 * inverse, d2 * inverse
        g01, g02, g12 = g01 * inverse, g02 * inverse, g12 * inverse
        c = (d0 * (d1 * d2 - g12 * g12) - g01 * (g01 * d2 - g12 * g02) + g02 * (g01 * g12 - d1 * g02)) / 2
        e0 = d0 * d0 + g01 * g01 + g02 * g02 - 2 - c * d0
        e1 = g01 * g01 + d1 * d1 + g12 * g12 - 2 - c * d1
        e2 = g02 * g02 + g12 * g12 + d2 * d2 - 2 - c * d2
        e01, e02, e12 = (
            (d0 + d1 - c) * g01 + g02 * g12,
            (d0 + d2 - c) * g02 + g01 * g12,
            (d1 + d2 - c) * g12 + g01 * g02,
        )
        e = e0 * e0 + e1 * e1 + e2 * e2 + 2 * (e01 * e01 + e02 * e02 + e12 * e12)
        root = math.sqrt(2 + 2 * abs(c))
        large, small = 0.5 * root, math.sqrt(e / 6) / root
        k, side = (small, large) if c < 0 else (large, small)
        p = _polynomial(
            k,
            0.5,
            1.7830573000711942,
            2.3297414624942157,
            1.3950793910416177,
            0.38687826597833,
            0.04361518468802272,
            0.0013366250926112862,
        )
        q = _polynomial(
            k,
            1.0,
            2.41141406176318,
            2.0972440318348915,
            0.797423044457054,
            0.12704908948738775,
            0.006541037985850415,
            3.6963837628258704e-05,
        )
        s = _polynomial(
            k,
            0.8660254037844386,
            2.178267763980038,
            2.0031317177691976,
            0.8230888428011572,
            0.14743157483386207,
            0.009352988492802717,
            0.0001044467326175935,
        )
        t = _polynomial(
            k,
            1.0,
            2.900147139261648,
            3.1515066495375663,
            1.5859291725257552,
            0.36869160810855334,
            0.034039603675727254,
            0.0007899344819197407,
        )
        w = 1 / (q * t)
        cosine, sine = p * t * w, side * s * q * w
        first = mean + 2 * spread * cosine
        second = max(mean + spread * (ROOT3 * sine - cosine), 1e-300)
        det = abs(_det(x0, x1, x2, y0, y1, y2, z0, z1, z2))
        return det / math.sqrt(first * second), math.sqrt(first)

    @inline
    def _leg(size, k, x, y, c, s):
        bx, by = size[6 + 2 * k], size[7 + 2 * k]
        armx, army = bx * c - by * s, bx * s + by * c
        dx, dy = x + armx - size[2 * k], y + army - size[2 * k + 1]
        return dx, dy, dy * armx - dx * army

    @inline
    def _rpr3_at(what, size, x, y, c, s):
        x0, y0, m0 = _leg(size, 0, x, y, c, s)
        x1, y1, m1 = _leg(size, 1, x, y, c, s)
        x2, y2, m2 = _leg(size, 2, x, y, c, s)
        if what == 0:
            return 8 * _det(x0, y0, m0, x1, y1, m1, x2, y2, m2)
        i0, i1, i2 = (
            1 / math.sqrt(x0 * x0 + y0 * y0),
            1 / math.sqrt(x1 * x1 + y1 * y1),
            1 / math.sqrt(x2 * x2 + y2 * y2),
        )
        unit = 1 / size[12]
        low, high = _of_three(
            x0 * i0, y0 * i0, m0 * i0 * unit, x1 * i1, y1 * i1, m1 * i1 * unit, x2 * i2, y2 * i2, m2 * i2 * unit
        )
        return low if what == 1 else low / high

    @inline
    def _tlpm_at(what, size, x, y, z):
        x0, x1, x2 = x - size[0], x - size[2], x - size[4]
        y0, y1, y2 = y - size[1], y - size[3], y - size[5]
        w = z + size[6]
        if what == 0:
            return 8 * _det(x0, y0, w, x1, y1, w, x2, y2, w)
        i0 = 1 / math.sqrt(x0 * x0 + y0 * y0 + w * w)
        i1 = 1 / math.sqrt(x1 * x1 + y1 * y1 + w * w)
        i2 = 1 / math.sqrt(x2 * x2 + y2 * y2 + w * w)
        low, high = _of_three(x0 * i0, y0 * i0, w * i0, x1 * i1, y1 * i1, w * i1, x2 * i2, y2 * i2, w * i2)
        return low if what == 1 else low / high

    def _over(at, turned):
        """Makes the loops over samples anywhere and over a grid; for a turned pose the third axis is an angle."""

        def anywhere(what, size, pose, out):
            for i in range(out.size):
                if turned:
                    out[i] = at(what, size, pose[0, i], pose[1, i], math.cos(pose[2, i]), math.sin(pose[2, i]))
                else:
                    out[i] = at(what, size, pose[0, i], pose[1, i], pose[2, i])

        def grid(what, size, x, y, z, out):
            c, s = np.cos(z), np.sin(z)
            for i in range(x.size):
                for j in range(y.size):
                    for k in range(z.size):
                        if turned:
                            out[i, j, k] = at(what, size, x[i], y[j], c[k], s[k])
                        else:
                            out[i, j, k] = at(what, size, x[i], y[j], z[k])

        return anywhere, grid

    def _each_measure(function):
        """Compiles one program for each measure, so that no loop asks which."""
        made = {}

        def run(what, *arguments):
            if what not in made:
                made[what] = _specialised(function, what)
            made[what](*arguments)

        return run

    def _specialised(function, what):
        inner = numba.njit(fastmath=FAST, error_model="numpy", inline="always")(function)
        if function.__code__.co_argcount == 4:
            return compiled(lambda size, pose, out: inner(what, size, pose, out))
        return compiled(lambda size, x, y, z, out: inner(what, size, x, y, z, out))

    rpr3_conditioning, rpr3_conditioning_grid = map(_each_measure, _over(_rpr3_at, True))
    tlpm_conditioning, tlpm_conditioning_grid = map(_each_measure, _over(_tlpm_at, False))

    @compiled
    def _laguerre(x, q, e):
        t, slope, bend, first, second = -x, -1.0, 0.0, 0.0, 0.0
        for i in range(6):
            r = 1 / (q[i] + t)
            ratio = slope * r
            first -= ratio
            second += ratio * ratio - bend * r
            factor = e[i] * q[i] * r * r
            t, slope, bend = e[i] * t * r - x, factor * slope - 1, factor * (bend - 2 * slope * ratio)
        root = math.sqrt(max(5 * (6 * second - first * first), 0.0))
        step = 6 / (first - root if first < 0 else first + root)
        return step if abs(step) < 1e300 else 0.0

    @compiled
    def _limit(x, q, e):
        for _ in range(48):
            step = _laguerre(x, q, e)
            x += step
            if not abs(step) > 1e-15 * x:
                break
        return x

    @compiled
    def _reflect(v, n):
        square = 0.0
        for i in range(n):
            square += v[i] * v[i]
        length = math.sqrt(square)
        half = square + length * abs(v[0])
        v[0] += -length if v[0] < 0 else length
        return square, 1 / (half if half > 0 else 1.0)

    @compiled
    def _bidiagonal(a, q, e, v):
        for k in range(5):
            for i in range(k, 6):
                v[i - k] = a[i, k]
            q[k], c = _reflect(v, 6 - k)
            for j in range(k + 1, 6):
                w = 0.0
                for i in range(k, 6):
                    w += v[i - k] * a[i, j]
                for i in range(k, 6):
                    a[i, j] -= v[i - k] * (w * c)
            if k == 4:
                e[k] = a[k, 5] * a[k, 5]
                break
            for j in range(k + 1, 6):
                v[j - k - 1] = a[k, j]
            e[k], c = _reflect(v, 5 - k)
            for i in range(k + 1, 6):
                w = 0.0
                for j in range(k + 1, 6):
                    w += v[j - k - 1] * a[i, j]
                for j in range(k + 1, 6):
                    a[i, j] -= v[j - k - 1] * (w * c)
        q[5], e[5] = a[5, 5] * a[5, 5], 0.0

    @inline
    def _ppps3_at(what, cp, sp, ct, st, cs, ss, a, q, e, v):
        r11, r12 = ct * cs, -ct * ss
        r31, r32 = sp * ss - cp * st * cs, cp * st * ss + sp * cs
        low11, low12 = cp * ss + sp * st * cs, cp * cs - sp * st * ss
        low21, low22 = -cp * ct * cs, cp * ct * ss
        x21, x31 = -HALF_ROOT3 * st * cs + 0.5 * st * ss, -HALF_ROOT3 * st * cs - 0.5 * st * ss
        x22, x32 = HALF_ROOT3 * r12 - 0.5 * r11, HALF_ROOT3 * r12 + 0.5 * r11
        h20, h30 = HALF_ROOT3 * low11 + 0.5 * low12, HALF_ROOT3 * low11 - 0.5 * low12
        h21, h31 = HALF_ROOT3 * low21 + 0.5 * low22, HALF_ROOT3 * low21 - 0.5 * low22
        h22, h32 = HALF_ROOT3 * r32 - 0.5 * r31, HALF_ROOT3 * r32 + 0.5 * r31
        if what == 0:
            one = _det(h20, h21, h22, 0.0, x31, x32, h30, h31, h32)
            return -16 * (one + _det(0.0, x21, x22, h20, h21, h22, h30, h31, h32))
        a[:] = 0.0
        a[0, 1], a[1, 2], a[2, 0], a[3, 2], a[4, 0], a[5, 2] = 1.0, 1.0, -1.0, 1.0, 1.0, 1.0
        a[2, 4], a[2, 5], a[3, 3], a[3, 4], a[3, 5] = x21, x22, -h20, -h21, -h22
        a[4, 4], a[4, 5], a[5, 3], a[5, 4], a[5, 5] = -x31, -x32, -h30, -h31, -h32
        _bidiagonal(a, q, e, v)
        low = math.sqrt(_limit(0.0, q, e))
        if what == 1:
            return low
        mean, spread = 0.0, 0.0
        for i in range(6):
            mean += (q[i] + e[i]) / 6
        for i in range(6):
            d = q[i] + (e[i - 1] if i > 0 else 0.0) - mean
            spread += d * d + 2 * q[i] * e[i]
        return low / math.sqrt(_limit(mean + math.sqrt(spread * (5 / 6)), q, e))

    @compiled
    def _ppps3(what, pose, out):
        a, q, e, v = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(6)
        for i in range(out.size):
            phi, theta, sigma = pose[3, i], pose[4, i], pose[5, i]
            turns = math.cos(phi), math.sin(phi), math.cos(theta), math.sin(theta), math.cos(sigma), math.sin(sigma)
            out[i] = _ppps3_at(what, turns[0], turns[1], turns[2], turns[3], turns[4], turns[5], a, q, e, v)

    @compiled
    def _ppps3_grid(what, phi, theta, sigma, out):
        a, q, e, v = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(6)
        cs, ss = np.cos(sigma), np.sin(sigma)
        for i in range(phi.size):
            cp, sp = math.cos(phi[i]), math.sin(phi[i])
            for j in range(theta.size):
                ct, st = math.cos(theta[j]), math.sin(theta[j])
                for k in range(sigma.size):
                    out[i, j, k] = _ppps3_at(what, cp, sp, ct, st, cs[k], ss[k], a, q, e, v)

    ppps3_conditioning, ppps3_conditioning_grid = _ppps3, _ppps3_grid

    @inline
    def _clip(numerator, denominator):
        return min(max(numerator / denominator, 0.0), 1.0) if denominator > 1e-150 else 0.0

    @compiled
    def _distance(ends, i, j):
        px, py, pz = ends[i, 0] - ends[j, 0], ends[i, 1] - ends[j, 1], ends[i, 2] - ends[j, 2]
        ux, uy, uz, vx, vy, vz = ends[i, 3], ends[i, 4], ends[i, 5], ends[j, 3], ends[j, 4], ends[j, 5]
        uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
        uw, vw = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        cx, cy, cz = vy * pz - vz * py, vz * px - vx * pz, vx * py - vy * px
        s = _clip(cx * nx + cy * ny + cz * nz, nx * nx + ny * ny + nz * nz)
        t = _clip(vw + s * uv, vv)
        s = _clip(t * uv - uw, uu)
        dx, dy, dz = px + s * ux - t * vx, py + s * uy - t * vy, pz + s * uz - t * vz
        return math.sqrt(dx * dx + dy * dy + dz * dz)

    @compiled
    def _clearance(size, x, y, z, ends):
        b, r1, r2 = size[8], size[9], size[10]
        for k in range(3):
            axes = size[12 + 9 * k : 21 + 9 * k]
            ax, ay, az = size[2 * k] - x, size[2 * k + 1] - y, -size[6] - z
            inverse = 1 / math.sqrt(ax * ax + ay * ay + az * az)
            ax, ay, az = ax * inverse, ay * inverse, az * inverse
            m31 = ax * axes[0] + ay * axes[1] + az * axes[2]
            m33 = -(ax * axes[3] + ay * axes[4] + az * axes[5])
            inverse = 1 / math.sqrt(m31 * m31 + m33 * m33)
            for c in range(3):
                z1 = ax if c == 0 else (ay if c == 1 else az)
                z2 = -(m33 * axes[c] + m31 * axes[3 + c]) * inverse
                ends[k, c], ends[k, 3 + c] = b * z1, r1 * z2 - b * z1
                ends[3 + k, c], ends[3 + k, 3 + c] = r1 * z2, r2 * axes[6 + c] - r1 * z2
        least = 1e300
        for i in range(3):
            for j in range(3):
                if i < j:
                    least = min(least, _distance(ends, i, j), _distance(ends, 3 + i, 3 + j))
                if i != j:
                    least = min(least, _distance(ends, i, 3 + j))
        return least - size[11]

    @compiled
    def _interference(size, q, out):
        ends = np.empty((6, 6))
        ax, ay, bx, by = size[0] - size[2], size[1] - size[3], size[0] - size[4], size[1] - size[5]
        inverse = 1 / (ax * by - ay * bx)
        for i in range(q.shape[1]):
            r1, r2, r3 = q[0, i] + size[7], q[1, i] + size[7], q[2, i] + size[7]
            g2, g3 = (r2 - r1) * (r2 + r1) / 2, (r3 - r1) * (r3 + r1) / 2
            x, y = (g2 * by - g3 * ay) * inverse, (ax * g3 - bx * g2) * inverse
            dx, dy = x - size[0], y - size[1]
            square = r1 * r1 - dx * dx - dy * dy
            if square > 0 and r1 > 0 and r2 > 0 and r3 > 0:
                root = math.sqrt(square)
                for lane in range(2):
                    z = (-root if lane else root) - size[6]
                    out[lane, 0, i], out[lane, 1, i], out[lane, 2, i] = x, y, z
                    out[lane, 3, i] = _clearance(size, x, y, z, ends)
            else:
                out[:, :, i] = np.nan

    tlpm_interference = _interference
