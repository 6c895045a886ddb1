"""Numba yardsticks: 3-PPPS (side 1, not mirrored) and TLPM by the formulas of jaxkin's kernels, one core.

Each function is None where numba is absent, compiles at its first call, and writes into arrays that it is given. Left
out is what tells apart samples within rounding of a singularity.
"""

import math
from collections.abc import Callable

import numpy as np

try:
    import numba
except ImportError:
    numba = None

ppps3_inverse: Callable[..., None] | None = None
ppps3_inverse_grid: Callable[..., None] | None = None
ppps3_frames: Callable[..., None] | None = None
ppps3_branches: Callable[..., None] | None = None
tlpm_inverse: Callable[..., None] | None = None
tlpm_branches: Callable[..., None] | None = None
segment_distances: Callable[..., None] | None = None

#: status and multiplicity in one byte, as the sweep's kernels return them: a pose, and no real solution.
POSE, NONE = 0x10, 0x02
HALF_ROOT3, ROOT3 = math.sqrt(3.0) / 2, math.sqrt(3.0)

if numba is not None:
    compiled = numba.njit(fastmath={"nsz", "arcp", "contract", "afn", "reassoc"}, error_model="numpy")
    inline = numba.njit(fastmath={"nsz", "arcp", "contract", "afn", "reassoc"}, error_model="numpy", inline="always")

    @inline
    def _legs(x, z, cp, sp, ct, st, cs, ss):
        r11, r12 = HALF_ROOT3 * ct * cs, -0.5 * ct * ss
        r31, r32 = HALF_ROOT3 * (sp * ss - cp * st * cs), 0.5 * (cp * st * ss + sp * cs)
        return r11 + r12 - x, z - r31 - r32, x - r11 + r12, z - r31 + r32

    @compiled
    def _inverse(pose, out):
        for i in range(pose.shape[1]):
            x, z = pose[0, i], pose[2, i]
            phi, theta, sigma = pose[3, i], pose[4, i], pose[5, i]
            out[0, i], out[1, i] = pose[1, i], z
            out[2, i], out[3, i], out[4, i], out[5, i] = _legs(
                x, z, math.cos(phi), math.sin(phi), math.cos(theta), math.sin(theta), math.cos(sigma), math.sin(sigma)
            )

    @compiled
    def _inverse_grid(x, y, z, phi, theta, sigma, out):
        cs, ss = np.cos(sigma), np.sin(sigma)
        for i in range(phi.size):
            cp, sp = math.cos(phi[i]), math.sin(phi[i])
            for j in range(theta.size):
                ct, st = math.cos(theta[j]), math.sin(theta[j])
                for k in range(sigma.size):
                    out[0, i, j, k], out[1, i, j, k] = y, z
                    out[2, i, j, k], out[3, i, j, k], out[4, i, j, k], out[5, i, j, k] = _legs(
                        x, z, cp, sp, ct, st, cs[k], ss[k]
                    )

    @inline
    def _known(q, i):
        m2, m3 = q[3, i] - q[1, i], q[5, i] - q[1, i]
        r12, r31, r32 = q[4, i] + q[2, i], -(m2 + m3) / ROOT3, m3 - m2
        c = (1 - r32) * (1 + r32)
        return r12, r31, r32, c, c - r31 * r31, c - r12 * r12

    @inline
    def _entries(r12, r31, r32, r22, r33, inverse):
        r11, r13 = (r22 * r33 - r12 * r31 * r32) * inverse, -(r12 * r32 * r33 + r22 * r31) * inverse
        return r11, r13, -(r12 * r33 + r22 * r31 * r32) * inverse, (r12 * r31 - r22 * r33 * r32) * inverse

    @compiled
    def _frames(q, out, codes):
        for i in range(q.shape[1]):
            r12, r31, r32, c, a, b = _known(q, i)
            if a > 0 and b > 0:
                root_a, root_b, inverse = math.sqrt(a), math.sqrt(b), 1 / c
                for lane in range(4):
                    r22, r33 = root_b if lane < 2 else -root_b, root_a if lane % 2 == 0 else -root_a
                    r11, r13, r21, r23 = _entries(r12, r31, r32, r22, r33, inverse)
                    o = out[lane]
                    o[0, i], o[1, i], o[2, i] = HALF_ROOT3 * r11 + 0.5 * r12 - q[2, i], q[0, i], q[1, i]
                    o[3, i], o[4, i], o[5, i] = r11, r12, r13
                    o[6, i], o[7, i], o[8, i] = r21, r22, r23
                    o[9, i], o[10, i], o[11, i] = r31, r32, r33
                    codes[lane, i] = POSE
            else:
                for lane in range(4):
                    codes[lane, i] = NONE
                    for k in range(12):
                        out[lane, k, i] = np.nan

    @compiled
    def _branches(q, out, codes):
        for i in range(q.shape[1]):
            r12, r31, r32, c, a, b = _known(q, i)
            if a > 0 and b > 0:
                root_a, root_b, inverse = math.sqrt(a), math.sqrt(b), 1 / c
                for lane in range(4):
                    r22, r33 = root_b if lane < 2 else -root_b, root_a if lane % 2 == 0 else -root_a
                    r11, r13, r21, r23 = _entries(r12, r31, r32, r22, r33, inverse)
                    o = out[lane]
                    o[0, i], o[1, i], o[2, i] = HALF_ROOT3 * r11 + 0.5 * r12 - q[2, i], q[0, i], q[1, i]
                    o[3, i] = math.atan2(-r23, r33)
                    o[4, i] = math.atan2(r13, math.sqrt(r23 * r23 + r33 * r33))
                    # With phi undone, as in the kernel: exact at gimbal lock.
                    o[5, i] = math.atan2(r33 * r21 - r23 * r31, r33 * r22 - r23 * r32)
                    codes[lane, i] = POSE
            else:
                for lane in range(4):
                    codes[lane, i] = NONE
                    for k in range(6):
                        out[lane, k, i] = np.nan

    @compiled
    def _tlpm_inverse(base, height, initial, p, out):
        for i in range(p.shape[1]):
            w = p[2, i] + height
            for k in range(3):
                dx, dy = p[0, i] - base[k, 0], p[1, i] - base[k, 1]
                out[k, i] = math.sqrt(dx * dx + dy * dy + w * w) - initial

    @compiled
    def _tlpm_branches(base, height, initial, q, out, codes):
        ax, ay = base[0, 0] - base[1, 0], base[0, 1] - base[1, 1]
        bx, by = base[0, 0] - base[2, 0], base[0, 1] - base[2, 1]
        inverse = 1 / (ax * by - ay * bx)
        for i in range(q.shape[1]):
            r1, r2, r3 = q[0, i] + initial, q[1, i] + initial, q[2, i] + initial
            g2, g3 = (r2 - r1) * (r2 + r1) / 2, (r3 - r1) * (r3 + r1) / 2
            x, y = (g2 * by - g3 * ay) * inverse, (ax * g3 - bx * g2) * inverse
            dx, dy = x - base[0, 0], y - base[0, 1]
            square = r1 * r1 - dx * dx - dy * dy
            here = square > 0 and r1 > 0 and r2 > 0 and r3 > 0
            root = math.sqrt(square) if here else np.nan
            x, y = (x, y) if here else (np.nan, np.nan)
            out[0, 0, i], out[0, 1, i], out[0, 2, i] = x, y, root - height
            out[1, 0, i], out[1, 1, i], out[1, 2, i] = x, y, -root - height
            codes[0, i] = codes[1, i] = POSE if here else NONE

    @inline
    def _clip(numerator, denominator):
        return min(max(numerator / denominator, 0.0), 1.0) if denominator > 1e-150 else 0.0

    @compiled
    def _segment_distances(starts, runs, pairs, bound, out):
        for i in range(starts.shape[2]):
            for k in range(pairs.shape[0]):
                m, n = pairs[k, 0], pairs[k, 1]
                ux, uy, uz = runs[m, 0, i], runs[m, 1, i], runs[m, 2, i]
                vx, vy, vz = runs[n, 0, i], runs[n, 1, i], runs[n, 2, i]
                wx = starts[m, 0, i] - starts[n, 0, i]
                wy = starts[m, 1, i] - starts[n, 1, i]
                wz = starts[m, 2, i] - starts[n, 2, i]
                uu, uv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz
                vv, uw = vx * vx + vy * vy + vz * vz, ux * wx + uy * wy + uz * wz
                vw = vx * wx + vy * wy + vz * wz
                nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
                cx, cy, cz = vy * wz - vz * wy, vz * wx - vx * wz, vx * wy - vy * wx
                s = _clip(cx * nx + cy * ny + cz * nz, nx * nx + ny * ny + nz * nz)
                t = _clip(vw + s * uv, vv)
                s = _clip(t * uv - uw, uu)
                dx, dy, dz = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
                out[k, i] = math.sqrt(dx * dx + dy * dy + dz * dz) - bound

    ppps3_inverse, ppps3_inverse_grid = _inverse, _inverse_grid
    ppps3_frames, ppps3_branches = _frames, _branches
    tlpm_inverse, tlpm_branches, segment_distances = _tlpm_inverse, _tlpm_branches, _segment_distances
