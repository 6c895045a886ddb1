/* Hand-written C yardstick: all assembly modes of a general planar 3-RPR, base (0,0),(c2,0),(c3,d3), platform (0,0), l2 at 0, l3 at beta.
 *
 * |e2 v3 - e3 v2|^2 - rho1^2 (v2 x v3)^2, with v_i = R(phi) b_i - A_i, is a trigonometric polynomial of degree 3 in phi. In the chart
 * t = tan((phi - origin)/2), whose infinity lies where the polynomial is largest of twelve angles, it is a sextic with no root beyond
 * RANGE. Between neighbouring roots of its derivative it is monotone, so real roots are found from the quadratic upwards: bisections, then
 * Cauchy's iteration (parabola through value, slope and curvature), on LANES samples at once in gcc's vector types.
 *
 * Meant for gcc -O3 -march=native -ffast-math -fopenmp-simd with libmvec, single thread; built by load.py. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifndef LANES
#define LANES 4
#endif
enum { BLOCK = 512, CHARTS = 12 };
/* cot(pi/24) and a little: |P| >= M cos(pi/4) at infinity and |P| <= M keep roots pi/12 away */
static const double PI = 3.14159265358979323846, RANGE = 7.7, TINY = 1e-300;

typedef double v __attribute__((vector_size(8 * LANES)));
typedef int64_t w __attribute__((vector_size(8 * LANES)));

static inline v pick(w m, v a, v b) { return (v)(((w)a & m) | ((w)b & ~m)); }
static inline v max0(v x) { return pick(x > 0, x, x - x); }
static inline v vmin(v a, v b) { return pick(a < b, a, b); }
static inline v vmax(v a, v b) { return pick(a > b, a, b); }
static inline v magnitude(v x) { return (v)((w)x & 0x7fffffffffffffff); }
static inline v root(v x) {
    for (int l = 0; l < LANES; l++) x[l] = __builtin_sqrt(x[l]);
    return x;
}
static inline v load_v(const double *p) {
    v x;
    memcpy(&x, p, sizeof x);
    return x;
}
static inline void store_v(double *p, v x) { memcpy(p, &x, sizeof x); }

#define INLINE static inline __attribute__((always_inline))

INLINE v horner(const v *c, int degree, v t) {
    v y = c[degree];
    for (int k = degree - 1; k >= 0; k--) y = y * t + c[k];
    return y;
}

INLINE v between(const v *c0, const v *c1, const v *c2, int degree, v low, v high, int halvings, int steps) {
    const w rising = horner(c0, degree, low) < 0;
    const v turn = pick(rising, low - low + 1, low - low - 1);
    v width = high - low;
    for (int k = 0; k < halvings; k++) {
        width *= 0.5;
        const v middle = low + width;
        low = pick((horner(c0, degree, middle) < 0) == rising, middle, low);
    }
    v t = low + 0.5 * width;
    for (int k = 0; k < steps; k++) {
        const v y = turn * horner(c0, degree, t), d = max0(turn * horner(c1, degree - 1, t));
        const v e = turn * horner(c2, degree - 2, t);
        t = vmin(vmax(t - 2 * y / (d + root(max0(d * d - 2 * y * e)) + TINY), low), low + width);
    }
    return t;
}

/* Real roots in ascending order of t; here[j] is zero where slot j has none. */
static inline void real_roots(const v *p, v *t, w *here) {
    v d[6][7], b[7], q[6];
    for (int k = 0; k < 7; k++) d[0][k] = p[k];
    for (int l = 1; l < 6; l++)
        for (int k = 0; k < 7 - l; k++) d[l][k] = (k + 1) * d[l - 1][k + 1];
    const v range = p[0] - p[0] + RANGE;
    {
        const v s = root(max0(d[4][1] * d[4][1] - 4 * d[4][2] * d[4][0]));
        const v large = -0.5 * (d[4][1] + pick(d[4][1] < 0, -s, s));
        const v tiny = range - range + TINY;
        const v x = large / pick(magnitude(d[4][2]) < TINY, tiny, d[4][2]), y = d[4][0] / pick(magnitude(large) < TINY, tiny, large);
        q[0] = vmin(vmax(vmin(x, y), -range), range), q[1] = vmin(vmax(vmax(x, y), -range), range);
    }
#define LEVEL(l, count, halvings, steps)                                                                            \
    b[0] = -range;                                                                                                  \
    for (int j = 0; j < count - 1; j++) b[j + 1] = q[j];                                                            \
    b[count] = range;                                                                                               \
    for (int j = 0; j < count; j++) q[j] = between(d[l], d[l + 1], d[l + 2], 6 - l, b[j], b[j + 1], halvings, steps);
    LEVEL(3, 3, 5, 2)
    LEVEL(2, 4, 5, 2)
    LEVEL(1, 5, 5, 2)
    LEVEL(0, 6, 5, 3)
    w left = horner(p, 6, b[0]) < 0;
    for (int j = 0; j < 6; j++) {
        const w right = horner(p, 6, b[j + 1]) < 0;
        t[j] = q[j], here[j] = left ^ right, left = right;
    }
}

typedef struct { double c2, c3, d3, l2, bx, by; double fourier[7][7], cosine[CHARTS][4], sine[CHARTS][4]; } robot;

/* fourier: from 1, A, B, A^2, B^2, A B, rho1^2 (A = rho1^2 - rho2^2, B = rho1^2 - rho3^2) to mean, cos 1, sin 1, ..., sin 3 */
static robot make_robot(const double *g) {
    robot r = {.c2 = g[0], .c3 = g[1], .d3 = g[2], .l2 = g[3], .bx = g[4] * cos(g[5]), .by = g[4] * sin(g[5])};
    for (int j = 0; j < 7; j++) {
        const double phi = 2 * PI * j / 7, c = cos(phi), s = sin(phi);
        const double x2 = r.l2 * c - r.c2, y2 = r.l2 * s, x3 = r.bx * c - r.by * s - r.c3, y3 = r.bx * s + r.by * c - r.d3;
        const double n2 = x2 * x2 + y2 * y2, n3 = x3 * x3 + y3 * y3, m = x2 * x3 + y2 * y3, d = x2 * y3 - y2 * x3;
        const double value[7] = {n2 * n3 * (n2 + n3 - 2 * m), 2 * n3 * (n2 - m), 2 * n2 * (n3 - m), n3, n2, -2 * m, -4 * d * d};
        for (int k = 0; k < 7; k++) {
            r.fourier[0][k] += value[k] / 7;
            for (int f = 1; f < 4; f++) {
                r.fourier[2 * f - 1][k] += 2 * cos(f * phi) * value[k] / 7;
                r.fourier[2 * f][k] += 2 * sin(f * phi) * value[k] / 7;
            }
        }
    }
    for (int j = 0; j < CHARTS; j++)
        for (int f = 0; f < 4; f++) r.cosine[j][f] = cos(2 * PI * f * j / CHARTS), r.sine[j][f] = sin(2 * PI * f * j / CHARTS);
    return r;
}

/* x, y, cos phi, sin phi of the six slots of LANES samples */
static inline void solve(const robot *r, v rho1, v rho2, v rho3, double *x, double *y, double *c, double *s, double nan) {
    const v r1 = rho1 * rho1, A = r1 - rho2 * rho2, B = r1 - rho3 * rho3;
    const v power[7] = {A - A + 1, A, B, A * A, B * B, A * B, r1};
    v f[7], p[7], t[6];
    w here[6];
    for (int j = 0; j < 7; j++) {
        f[j] = r->fourier[j][0] * power[0];
        for (int k = 1; k < 7; k++) f[j] += r->fourier[j][k] * power[k];
    }
    v largest = A - A, c0 = largest, s0 = largest;
    for (int j = 0; j < CHARTS; j++) {
        v value = f[0];
        for (int k = 1; k < 4; k++) value += r->cosine[j][k] * f[2 * k - 1] + r->sine[j][k] * f[2 * k];
        const w better = magnitude(value) > largest;
        largest = pick(better, magnitude(value), largest);
        c0 = pick(better, c0 - c0 - r->cosine[j][1], c0), s0 = pick(better, s0 - s0 - r->sine[j][1], s0);
    }
    const v scale = 1 / (largest + TINY);
    v h[7] = {f[0] * scale}, ck = c0, sk = s0;
    for (int k = 1; k < 4; k++) {
        h[2 * k - 1] = (f[2 * k - 1] * ck + f[2 * k] * sk) * scale, h[2 * k] = (f[2 * k] * ck - f[2 * k - 1] * sk) * scale;
        const v next = ck * c0 - sk * s0;
        sk = sk * c0 + ck * s0, ck = next;
    }
    p[0] = h[0] + h[1] + h[3] + h[5], p[6] = h[0] - h[1] + h[3] - h[5];
    p[1] = 2 * h[2] + 4 * h[4] + 6 * h[6], p[5] = 2 * h[2] - 4 * h[4] + 6 * h[6], p[3] = 4 * h[2] - 20 * h[6];
    p[2] = 3 * h[0] + h[1] - 5 * h[3] - 15 * h[5], p[4] = 3 * h[0] - h[1] - 5 * h[3] + 15 * h[5];
    real_roots(p, t, here);
    for (int j = 0; j < 6; j++) {
        const v tt = t[j] * t[j], inverse = 1 / (1 + tt), cp = (1 - tt) * inverse, sp = 2 * t[j] * inverse;
        const v co = c0 * cp - s0 * sp, si = s0 * cp + c0 * sp;
        const v x2 = r->l2 * co - r->c2, y2 = r->l2 * si, x3 = r->bx * co - r->by * si - r->c3, y3 = r->bx * si + r->by * co - r->d3;
        const v e2 = x2 * x2 + y2 * y2 + A, e3 = x3 * x3 + y3 * y3 + B, over = 0.5 / (x2 * y3 - y2 * x3);
        const v none = A - A + nan;
        store_v(x + j * BLOCK, pick(here[j], (y2 * e3 - y3 * e2) * over, none));
        store_v(y + j * BLOCK, pick(here[j], (x3 * e2 - x2 * e3) * over, none));
        store_v(c + j * BLOCK, pick(here[j], co, none)), store_v(s + j * BLOCK, si);
    }
}

/* out: 18 arrays of length n, out[(3 lane + (0 x, 1 y, 2 phi)) n + i]. n is a multiple of LANES. */
void branches_general(size_t n, const double *geometry, const double *restrict rho1, const double *restrict rho2,
                      const double *restrict rho3, double *restrict out) {
    const robot r = make_robot(geometry);
    const uint64_t bits = 0x7ff8000000000000u;
    static double x[6][BLOCK], y[6][BLOCK], c[6][BLOCK], s[6][BLOCK];
    double nan;
    memcpy(&nan, &bits, sizeof nan);
    for (size_t o = 0; o < n; o += BLOCK) {
        const size_t m = n - o < BLOCK ? n - o : BLOCK;
        for (size_t i = 0; i < m; i += LANES)
            solve(&r, load_v(rho1 + o + i), load_v(rho2 + o + i), load_v(rho3 + o + i), x[0] + i, y[0] + i, c[0] + i, s[0] + i, nan);
        for (int j = 0; j < 6; j++) {
            double *restrict to = out + 3 * j * n + o;
#pragma omp simd
            for (size_t i = 0; i < m; i++) to[i] = x[j][i], to[n + i] = y[j][i], to[2 * n + i] = atan2(s[j][i], c[j][i]);
        }
    }
}
