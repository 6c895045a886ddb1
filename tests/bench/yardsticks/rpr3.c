/* Hand-written C yardsticks for the analytic planar 3-RPR: base (0,0),(c2,0),(c3,d3), platform (0,0),(c2,0),(c3,-d3).
 *
 * With S:C = sin(phi/2):cos(phi/2), g = c3 S - d3 C, A = rho1^2 - rho2^2, B = rho1^2 - rho3^2 the poses are the real roots of
 *   4 c2 S g (c2 S - g) + A g - c2 S B = 0        (times S^2 + C^2 = 1)
 * for which h, from 4 u h + 4 u^2 + X = 0 with (u, X) = (c2 S, A) or (g, B), has h^2 < rho1^2; each such root carries two poses.
 *
 * Meant for gcc -O3 -march=native -ffast-math -fopenmp-simd with libmvec, single thread; built by load.py. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* Counts are made as 64-bit words and narrowed afterwards: a byte store in the loop would make gcc unroll it eight-fold and spill. */
enum { BLOCK = 512 };

static inline double min2(double x, double y) { return x < y ? x : y; }
static inline double max2(double x, double y) { return x > y ? x : y; }

static void narrow(size_t m, const int64_t *restrict from, uint8_t *restrict to) {
    for (size_t i = 0; i < m; i++) to[i] = (uint8_t)from[i];
}

/* ---- the cubic, solved ---------------------------------------------------------------------------------------------------- */

/* The cubic in a turned frame S = cs s + sn k, C = cs k - sn s, so that its leading coefficient does not vanish on a whole plane
 * of joint space (in the usual frame it does, on rho1 = rho3 when c3 = 0). Coefficient j is q[j][0] + q[j][1] A + q[j][2] B. */
typedef struct { double q[4][3], v[2], g[2], cs, sn; } frame;

static frame make_frame(double c2, double c, double d) {
    const double turn = 0.3;
    frame f = {.cs = cos(turn), .sn = sin(turn)};
    f.v[0] = c2 * f.cs, f.v[1] = c2 * f.sn;
    f.g[0] = c * f.cs + d * f.sn, f.g[1] = c * f.sn - d * f.cs;
    const double *v = f.v, *g = f.g, e[2] = {v[0] - g[0], v[1] - g[1]};
    f.q[0][0] = 4 * v[0] * g[0] * e[0];
    f.q[1][0] = 4 * (v[1] * g[0] * e[0] + v[0] * g[1] * e[0] + v[0] * g[0] * e[1]);
    f.q[2][0] = 4 * (v[0] * g[1] * e[1] + v[1] * g[0] * e[1] + v[1] * g[1] * e[0]);
    f.q[3][0] = 4 * v[1] * g[1] * e[1];
    f.q[0][1] = f.q[2][1] = g[0], f.q[1][1] = f.q[3][1] = g[1];
    f.q[0][2] = f.q[2][2] = -v[0], f.q[1][2] = f.q[3][2] = -v[1];
    return f;
}

/* y = 3 a t + b turns the cubic into y^3 - 3 M y + N = 0; k = 3 a. A root is the direction s:k, s = y - b. */
typedef struct { double M, N, disc, b, k; } depressed;

static inline depressed depress(const frame *f, double A, double B) {
    double a = f->q[0][0] + f->q[0][1] * A + f->q[0][2] * B, b = f->q[1][0] + f->q[1][1] * A + f->q[1][2] * B;
    double k = f->q[2][0] + f->q[2][1] * A + f->q[2][2] * B, e = f->q[3][0] + f->q[3][1] * A + f->q[3][2] * B;
    double M = b * b - 3 * a * k, N = b * (2 * b * b - 9 * a * k) + 27 * a * a * e;
    return (depressed){M, N, N * N - 4 * M * M * M, b, 3 * a};
}

static inline double single_root(depressed p) {
    double u = cbrt(-0.5 * (p.N + copysign(sqrt(fabs(p.disc)), p.N)));
    return u + p.M / (fabs(u) > 1e-100 ? u : 1e-100) - p.b;
}

typedef struct { double s0, s1, s2; } triple;

/* The angle is arccos(-N / 2 M^1.5), which this form gives well at double roots too. */
static inline triple three_roots(depressed p) {
    double m = sqrt(fabs(p.M)), co = cos(atan2(sqrt(fabs(p.disc)), -p.N) * (1. / 3)), si = sqrt(3 * fabs(1 - co * co));
    return (triple){2 * m * co - p.b, -m * (co + si) - p.b, -m * (co - si) - p.b};
}

static inline int64_t is_real(const frame *f, double s, double k, double A, double B, double r1) {
    double v = f->v[0] * s + f->v[1] * k, g = f->g[0] * s + f->g[1] * k, w = s * s + k * k;
    int first = v * v > g * g;
    double u2 = first ? v * v : g * g, X = first ? A : B, q = 4 * u2 + X * w;
    return q * q < 16 * u2 * w * r1;
}

/* One real root for every sample first, then the samples with three, gathered: both loops are branch-free. */
static void count_block(const frame *fp, size_t m, const double *restrict A, const double *restrict B, const double *restrict r1,
                        uint8_t *restrict count) {
    const frame f = *fp;
    int64_t buf[BLOCK];
    double disc[BLOCK];
    int32_t at[BLOCK];
#pragma omp simd
    for (size_t i = 0; i < m; i++) {
        depressed p = depress(&f, A[i], B[i]);
        disc[i] = p.disc;
        buf[i] = 2 * is_real(&f, single_root(p), p.k, A[i], B[i], r1[i]);
    }
    narrow(m, buf, count);
    size_t n = 0;
    for (size_t i = 0; i < m; i++) at[n] = (int32_t)i, n += disc[i] < 0;
#pragma omp simd
    for (size_t i = 0; i < n; i++) {
        double Ai = A[at[i]], Bi = B[at[i]], r = r1[at[i]];
        depressed p = depress(&f, Ai, Bi);
        triple t = three_roots(p);
        buf[i] = 2 * (is_real(&f, t.s0, p.k, Ai, Bi, r) + is_real(&f, t.s1, p.k, Ai, Bi, r) + is_real(&f, t.s2, p.k, Ai, Bi, r));
    }
    for (size_t i = 0; i < n; i++) count[at[i]] = (uint8_t)buf[i];
}

void count_cubic(size_t n, double c2, double c3, double d3, const double *restrict rho1, const double *restrict rho2,
                 const double *restrict rho3, uint8_t *restrict count) {
    const frame f = make_frame(c2, c3, d3);
    double A[BLOCK], B[BLOCK], r1[BLOCK];
    for (size_t o = 0; o < n; o += BLOCK) {
        size_t m = n - o < BLOCK ? n - o : BLOCK;
#pragma omp simd
        for (size_t i = 0; i < m; i++) {
            r1[i] = rho1[o + i] * rho1[o + i];
            A[i] = r1[i] - rho2[o + i] * rho2[o + i], B[i] = r1[i] - rho3[o + i] * rho3[o + i];
        }
        count_block(&f, m, A, B, r1, count + o);
    }
}

void count_grid_cubic(size_t n1, size_t n3, double c2, double c3, double d3, const double *restrict rho1, double rho2,
                      const double *restrict rho3, uint8_t *restrict count) {
    const frame f = make_frame(c2, c3, d3);
    double A[BLOCK], B[BLOCK], r1[BLOCK];
    for (size_t j = 0; j < n1; j++) {
        const double r = rho1[j] * rho1[j];
        for (size_t i = 0; i < BLOCK; i++) r1[i] = r, A[i] = r - rho2 * rho2;
        for (size_t o = 0; o < n3; o += BLOCK) {
            size_t m = n3 - o < BLOCK ? n3 - o : BLOCK;
            for (size_t i = 0; i < m; i++) B[i] = r - rho3[o + i] * rho3[o + i];
            count_block(&f, m, A, B, r1, count + j * n3 + o);
        }
    }
}

typedef struct { double x0, y0, x1, y1, phi; } pose_pair;

/* The two poses of root s:k. nan comes in as data because -ffast-math may fold a literal one away. */
static inline pose_pair poses(const frame *f, double s, double k, int64_t real, double A, double B, double r1, double nan) {
    double S = f->cs * s + f->sn * k, C = f->cs * k - f->sn * s;
    double scale = copysign(1 / sqrt(max2(S * S + C * C, 1e-300)), C);
    S *= scale, C *= scale;
    double v = (f->v[0] * s + f->v[1] * k) * scale, g = (f->g[0] * s + f->g[1] * k) * scale;
    int first = v * v > g * g;
    double u = first ? v : g, X = first ? A : B, h = -(u + X / (4 * u)), p2 = r1 - h * h, p = sqrt(max2(p2, 0));
    int64_t ok = real & (p2 > 0);
    double phi = 2 * atan2(S, C);
    return (pose_pair){ok ? p * C - h * S : nan, ok ? p * S + h * C : nan, ok ? -p * C - h * S : nan, ok ? h * C - p * S : nan,
                       ok ? phi : nan};
}

/* out: 18 arrays of length n, out[(3 lane + (0 x, 1 y, 2 phi)) n + i]; lanes 2 j and 2 j + 1 belong to root j. */
void branches_cubic(size_t n, double c2, double c3, double d3, const double *restrict rho1, const double *restrict rho2,
                    const double *restrict rho3, double *restrict out) {
    const frame f = make_frame(c2, c3, d3);
    const uint64_t bits = 0x7ff8000000000000u;
    double nan, s[3][BLOCK], k[BLOCK], A[BLOCK], B[BLOCK], r1[BLOCK];
    int64_t three[BLOCK];
    memcpy(&nan, &bits, sizeof nan);
    for (size_t o = 0; o < n; o += BLOCK) {
        size_t m = n - o < BLOCK ? n - o : BLOCK;
#pragma omp simd
        for (size_t i = 0; i < m; i++) {
            r1[i] = rho1[o + i] * rho1[o + i];
            A[i] = r1[i] - rho2[o + i] * rho2[o + i], B[i] = r1[i] - rho3[o + i] * rho3[o + i];
            depressed p = depress(&f, A[i], B[i]);
            triple t = three_roots(p);
            k[i] = p.k, three[i] = p.disc < 0;
            s[0][i] = three[i] ? t.s0 : single_root(p), s[1][i] = t.s1, s[2][i] = t.s2;
        }
        for (int j = 0; j < 3; j++) {
            double *restrict to = out + 6 * j * n + o;
            const int64_t always = j == 0;
#pragma omp simd
            for (size_t i = 0; i < m; i++) {
                pose_pair q = poses(&f, s[j][i], k[i], (three[i] | always) != 0, A[i], B[i], r1[i], nan);
                to[i] = q.x0, to[n + i] = q.y0, to[2 * n + i] = q.phi;
                to[3 * n + i] = q.x1, to[4 * n + i] = q.y1, to[5 * n + i] = q.phi;
            }
        }
    }
}

/* ---- signs only ------------------------------------------------------------------------------------------------------------ */

/* Legs 1 and 2 and a segment of length 2|c2 S| close a triangle, so the real poses are the roots with S^2 between
 * L = (rho1-rho2)^2/4c2^2 and H = (rho1+rho2)^2/4c2^2: V(-H) - V(-L) + V(L) - V(H) variations of the Sturm chain.
 * Each member of the chain is e + o with e even and o odd in S, and sign(e +- o) = sign(e|e| +- o|o|) needs no square root. */

static inline uint64_t bits(double x) {
    uint64_t b;
    memcpy(&b, &x, sizeof b);
    return b;
}

typedef struct { double a, b, k, e, m, n, disc; } chain;

static inline chain make_chain(double c2, double c, double d, double A, double B) {
    double w = c * A - c2 * B, a = w + 4 * c2 * c * (c2 - c), b = d * (4 * c2 * (2 * c - c2) - A), k = w - 4 * c2 * d * d, e = -d * A;
    /* no zeros of the chain at its ends: a root at phi = pi or phi = 0 is put just beside it, where it is counted once */
    a = a == 0 ? 1e-30 : a, e = e == 0 ? 1e-30 : e;
    double M = b * b - 3 * a * k, n = b * k - 9 * a * e, disc = 4 * M * (k * k - 3 * b * e) - n * n;
    /* remainders times positive factors; sign(a) is carried by the last two */
    double sg = a < 0 ? -1 : 1;
    return (chain){a, b, k, e, sg * 2 * M, sg * n, sg * disc};
}

static inline double sq(double x) { return x * fabs(x); }

/* V(-S) - V(S) modulo 2^64, from the even and odd parts of the chain's members at S */
static inline uint64_t variations(double e0, double o0, double e1, double o1, double e2, double o2, double disc) {
    uint64_t m0 = bits(e0 - o0), m1 = bits(e1 - o1), m2 = bits(e2 - o2), p0 = bits(e0 + o0), p1 = bits(e1 + o1), p2 = bits(e2 + o2);
    uint64_t d = bits(disc);
    return ((m0 ^ m1) >> 63) + ((m1 ^ m2) >> 63) + ((m2 ^ d) >> 63) - ((p0 ^ p1) >> 63) - ((p1 ^ p2) >> 63) - ((p2 ^ d) >> 63);
}

static inline uint64_t variations_at(const chain *p, double S2) {
    double C2 = 1 - S2;
    return variations(C2 * sq(p->b * S2 + p->e * C2), S2 * sq(p->a * S2 + p->k * C2), sq(3 * p->a * S2 + p->k * C2),
                      4 * S2 * C2 * sq(p->b), C2 * sq(p->n), S2 * sq(p->m), p->disc);
}

static inline int64_t count_signs(double c2, double c, double d, double inv, double A, double B, double r1, double lo, double hi) {
    chain p = make_chain(c2, c, d, A, B);
    int64_t n = (int64_t)(variations_at(&p, min2(hi * hi * inv, 1)) - variations_at(&p, min2(lo * lo * inv, 1)));
    /* rho1 = rho2 makes phi = 0 a root on which legs 1 and 2 impose nothing: leg 3 decides */
    double q = 4 * d * d + B;
    n -= (A == 0) & (q * q >= 16 * d * d * r1);
    return 2 * n;
}

void count_sturm(size_t n, double c2, double c3, double d3, const double *restrict rho1, const double *restrict rho2,
                 const double *restrict rho3, uint8_t *restrict count) {
    const double inv = 1 / (4 * c2 * c2);
    int64_t buf[BLOCK];
    for (size_t o = 0; o < n; o += BLOCK) {
        size_t m = n - o < BLOCK ? n - o : BLOCK;
#pragma omp simd
        for (size_t i = 0; i < m; i++) {
            double a = rho1[o + i], b = rho2[o + i], c = rho3[o + i];
            buf[i] = count_signs(c2, c3, d3, inv, a * a - b * b, a * a - c * c, a * a, a - b, a + b);
        }
        narrow(m, buf, count + o);
    }
}

/* On a row rho1 and rho2 are fixed, so the four points are too: each member of the chain is a polynomial in B, its values at the
 * points S:C, -S:C read off with one or two multiplications. */
void count_grid_sturm(size_t n1, size_t n3, double c2, double c3, double d3, const double *restrict rho1, double rho2,
                      const double *restrict rho3, uint8_t *restrict count) {
    int64_t buf[BLOCK];
    for (size_t j = 0; j < n1; j++) {
        const double r1 = rho1[j] * rho1[j], A = r1 - rho2 * rho2, b = d3 * (4 * c2 * (2 * c3 - c2) - A), e = A == 0 ? 1e-30 : -d3 * A;
        const double a0 = c3 * A + 4 * c2 * c3 * (c2 - c3), k0 = c3 * A - 4 * c2 * d3 * d3;
        const double lo = min2(fabs(rho1[j] - rho2) / fabs(2 * c2), 1), hi = min2((rho1[j] + rho2) / fabs(2 * c2), 1);
        const double S[2] = {hi, lo}, C[2] = {sqrt(1 - hi * hi), sqrt(1 - lo * lo)};
        for (size_t o = 0; o < n3; o += BLOCK) {
            size_t m = n3 - o < BLOCK ? n3 - o : BLOCK;
#pragma omp simd
            for (size_t i = 0; i < m; i++) {
                double B = r1 - rho3[o + i] * rho3[o + i], a = a0 - c2 * B, k = k0 - c2 * B;
                a = a == 0 ? 1e-30 : a;
                double M = b * b - 3 * a * k, n = b * k - 9 * a * e, disc = 4 * M * (k * k - 3 * b * e) - n * n, sg = copysign(1, a);
                uint64_t v[2];
                for (int q = 0; q < 2; q++) {
                    double s = S[q], c = C[q], ss = s * s, cc = c * c;
                    v[q] = variations(c * (b * ss + e * cc), s * (a * ss + k * cc), 3 * a * ss + k * cc, 2 * s * c * b, c * (sg * n),
                                      2 * s * (sg * M), sg * disc);
                }
                int64_t total = (int64_t)(v[0] - v[1]);
                double w = 4 * d3 * d3 + B;
                total -= (A == 0) & (w * w >= 16 * d3 * d3 * r1);
                buf[i] = 2 * total;
            }
            narrow(m, buf, count + j * n3 + o);
        }
    }
}
