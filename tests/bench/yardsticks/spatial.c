/* Hand-written C yardsticks for the 3-PPPS (side 1, not mirrored), the TLPM and conditioning, by the formulas of jaxkin's kernels.
 *
 * Arrays are given as rows of n samples; out likewise. Statuses are one byte: POSE, or NONE with NaN for the numbers. Left out is
 * what tells apart samples within rounding of a singularity. Meant for gcc -O3 -march=native -ffast-math -fopenmp-simd with
 * libmvec, single thread; built by load.py. NaN comes in as data because -ffast-math may fold a literal one away. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* gcc would leave the longer ones as calls, which stop vectorisation. */
#define INLINE static inline __attribute__((always_inline))

enum { POSE = 0x10, NONE = 0x02, BLOCK = 512 };
static const double ROOT3 = 1.7320508075688772, HALF_ROOT3 = 0.8660254037844386;

INLINE double min2(double x, double y) { return x < y ? x : y; }
INLINE double max2(double x, double y) { return x > y ? x : y; }
INLINE double clip(double x) { return min2(max2(x, 0), 1); }

/* ---- 3-PPPS ---------------------------------------------------------------------------------------------------------------- */

typedef struct { double r12, r31, r32, inverse, root_a, root_b; } known;

INLINE known know(const double *restrict q, size_t n, size_t i, double nan) {
    double m2 = q[3 * n + i] - q[n + i], m3 = q[5 * n + i] - q[n + i], r32 = m3 - m2;
    double r12 = q[4 * n + i] + q[2 * n + i], r31 = -(m2 + m3) / ROOT3, c = (1 - r32) * (1 + r32);
    double a = c - r31 * r31, b = c - r12 * r12;
    int real = (a > 0) & (b > 0);
    return (known){r12, r31, r32, 1 / c, real ? sqrt(max2(a, 0)) : nan, real ? sqrt(max2(b, 0)) : nan};
}

typedef struct { double r11, r13, r21, r23; } rest;

INLINE rest entries(known k, double r22, double r33) {
    double p = r22 * r33, r12 = k.r12, r31 = k.r31, r32 = k.r32, w = k.inverse;
    return (rest){(p - r12 * r31 * r32) * w, -(r12 * r32 * r33 + r22 * r31) * w, -(r12 * r33 + r22 * r31 * r32) * w,
                  (r12 * r31 - p * r32) * w};
}

static void codes_of(size_t m, const int64_t *restrict real, uint8_t *restrict to) {
    for (size_t i = 0; i < m; i++) to[i] = real[i] ? POSE : NONE;
}

INLINE int64_t has_pose(const double *restrict q, size_t n, size_t i) {
    double m2 = q[3 * n + i] - q[n + i], m3 = q[5 * n + i] - q[n + i], r32 = m3 - m2;
    double r12 = q[4 * n + i] + q[2 * n + i], r31 = -(m2 + m3) / ROOT3, c = (1 - r32) * (1 + r32);
    return (c > r31 * r31) & (c > r12 * r12);
}

static void ppps3_codes(size_t n, size_t o, size_t m, const double *restrict q, uint8_t *restrict codes) {
    int64_t real[BLOCK];
#pragma omp simd
    for (size_t i = 0; i < m; i++) real[i] = has_pose(q, n, o + i);
    for (int lane = 0; lane < 4; lane++) codes_of(m, real, codes + lane * n + o);
}

void ppps3_frames(size_t n, double nan, const double *restrict q, double *restrict out, uint8_t *restrict codes) {
    for (size_t o = 0; o < n; o += BLOCK) {
        size_t m = n - o < BLOCK ? n - o : BLOCK;
        for (int lane = 0; lane < 4; lane++) {
            double s22 = lane < 2 ? 1 : -1, s33 = lane % 2 ? -1 : 1, *restrict to = out + 12 * lane * n + o;
#pragma omp simd
            for (size_t i = 0; i < m; i++) {
                known k = know(q, n, o + i, nan);
                double r22 = s22 * k.root_b, r33 = s33 * k.root_a, none = has_pose(q, n, o + i) ? 0 : nan;
                rest e = entries(k, r22, r33);
                to[i] = HALF_ROOT3 * e.r11 + 0.5 * k.r12 - q[2 * n + o + i], to[n + i] = q[o + i] + none;
                to[2 * n + i] = q[n + o + i] + none, to[3 * n + i] = e.r11, to[4 * n + i] = k.r12 + none;
                to[5 * n + i] = e.r13, to[6 * n + i] = e.r21, to[7 * n + i] = r22, to[8 * n + i] = e.r23;
                to[9 * n + i] = k.r31 + none, to[10 * n + i] = k.r32 + none, to[11 * n + i] = r33;
            }
        }
        ppps3_codes(n, o, m, q, codes);
    }
}

void ppps3_branches(size_t n, double nan, const double *restrict q, double *restrict out, uint8_t *restrict codes) {
    for (size_t o = 0; o < n; o += BLOCK) {
        size_t m = n - o < BLOCK ? n - o : BLOCK;
        for (int lane = 0; lane < 4; lane++) {
            double s22 = lane < 2 ? 1 : -1, s33 = lane % 2 ? -1 : 1, *restrict to = out + 6 * lane * n + o;
#pragma omp simd
            for (size_t i = 0; i < m; i++) {
                known k = know(q, n, o + i, 1);
                double real = has_pose(q, n, o + i) ? 0 : nan, r22 = s22 * k.root_b, r33 = s33 * k.root_a;
                rest e = entries(k, r22, r33);
                to[i] = HALF_ROOT3 * e.r11 + 0.5 * k.r12 - q[2 * n + o + i] + real;
                to[n + i] = q[o + i] + real, to[2 * n + i] = q[n + o + i] + real;
                to[3 * n + i] = atan2(-e.r23, r33) + real;
                to[4 * n + i] = atan2(e.r13, sqrt(e.r23 * e.r23 + r33 * r33)) + real;
                to[5 * n + i] = atan2(r33 * e.r21 - e.r23 * k.r31, r33 * r22 - e.r23 * k.r32) + real;
            }
        }
        ppps3_codes(n, o, m, q, codes);
    }
}

/* ---- TLPM ------------------------------------------------------------------------------------------------------------------ */

typedef struct { double x, y, z; } vec;

INLINE double dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
INLINE vec cross(vec a, vec b) { return (vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
INLINE vec combined(double a, vec u, double b, vec v) {
    return (vec){a * u.x + b * v.x, a * u.y + b * v.y, a * u.z + b * v.z};
}

INLINE double distance(vec p, vec u, vec q, vec v) {
    vec w = combined(1, p, -1, q), normal = cross(u, v);
    double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, w), vw = dot(v, w), nn = dot(normal, normal);
    double s = nn > 1e-150 ? clip(dot(cross(v, w), normal) / nn) : 0, t = clip((vw + s * uv) / vv);
    s = clip((t * uv - uw) / uu);
    vec d = combined(1, combined(1, w, s, u), -t, v);
    return sqrt(dot(d, d));
}

/* size: base points (6), height, initial length, b, r1, r2, bound, then X, T, z3 of each limb (27), as numbers. */
INLINE double clearance(const double *size, double x, double y, double z) {
    const double height = size[6], b = size[8], r1 = size[9], r2 = size[10];
    vec p[6], u[6];
    for (int k = 0; k < 3; k++) {
        const double *axes = size + 12 + 9 * k;
        vec X = {axes[0], axes[1], axes[2]}, T = {axes[3], axes[4], axes[5]}, z3 = {axes[6], axes[7], axes[8]};
        vec away = {size[2 * k] - x, size[2 * k + 1] - y, -height - z};
        vec z1 = combined(1 / sqrt(dot(away, away)), away, 0, away);
        double m31 = dot(z1, X), m33 = -dot(z1, T), inverse = 1 / sqrt(m31 * m31 + m33 * m33);
        vec z2 = combined(-m33 * inverse, X, -m31 * inverse, T);
        p[k] = combined(b, z1, 0, z1), u[k] = combined(r1, z2, -b, z1);
        p[3 + k] = combined(r1, z2, 0, z2), u[3 + k] = combined(r2, z3, -r1, z2);
    }
    double least = 1e300;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            if (i < j) least = min2(least, min2(distance(p[i], u[i], p[j], u[j]), distance(p[3 + i], u[3 + i], p[3 + j], u[3 + j])));
            if (i != j) least = min2(least, distance(p[i], u[i], p[3 + j], u[3 + j]));
        }
    return least - size[11];
}

INLINE double solve_tlpm(const double *size, const double *restrict q, size_t n, size_t i, double nan, double *x, double *y) {
    const double ax = size[0] - size[2], ay = size[1] - size[3], bx = size[0] - size[4], by = size[1] - size[5];
    const double inverse = 1 / (ax * by - ay * bx);
    double r1 = q[i] + size[7], r2 = q[n + i] + size[7], r3 = q[2 * n + i] + size[7];
    double g2 = (r2 - r1) * (r2 + r1) / 2, g3 = (r3 - r1) * (r3 + r1) / 2;
    *x = (g2 * by - g3 * ay) * inverse, *y = (ax * g3 - bx * g2) * inverse;
    double dx = *x - size[0], dy = *y - size[1], square = r1 * r1 - dx * dx - dy * dy;
    return (square > 0) & (r1 > 0) & (r2 > 0) & (r3 > 0) ? sqrt(max2(square, 0)) : nan;
}

void tlpm_branches(size_t n, double nan, const double *size, const double *restrict q, double *restrict out, uint8_t *restrict codes) {
    int64_t real[BLOCK];
    for (size_t o = 0; o < n; o += BLOCK) {
        size_t m = n - o < BLOCK ? n - o : BLOCK;
        double *restrict to = out + o;
#pragma omp simd
        for (size_t i = 0; i < m; i++) {
            double x, y, root = solve_tlpm(size, q, n, o + i, -1, &x, &y);
            real[i] = root >= 0;
            double none = root >= 0 ? 0 : nan;
            to[i] = to[3 * n + i] = x + none, to[n + i] = to[4 * n + i] = y + none;
            to[2 * n + i] = root - size[6] + none, to[5 * n + i] = -root - size[6] + none;
        }
        codes_of(m, real, codes + o), codes_of(m, real, codes + n + o);
    }
}

/* Both modes, x, y, z and the smallest of the twelve clearances of each. */
void tlpm_interference(size_t n, double nan, const double *size, const double *restrict q, double *restrict out) {
    for (int lane = 0; lane < 2; lane++) {
        double sign = lane ? -1 : 1, *restrict to = out + 4 * lane * n;
#pragma omp simd
        for (size_t i = 0; i < n; i++) {
            double x, y, root = solve_tlpm(size, q, n, i, -1, &x, &y), none = root >= 0 ? 0 : nan, z = sign * root - size[6];
            to[i] = x + none, to[n + i] = y + none, to[2 * n + i] = z + none, to[3 * n + i] = clearance(size, x, y, z) + none;
        }
    }
}

/* ---- conditioning ---------------------------------------------------------------------------------------------------------- */

typedef struct { double smallest, largest; } extremes;

static const double COSINE_P[] = {0.5, 1.7830573000711942, 2.3297414624942157, 1.3950793910416177, 0.38687826597833, 0.04361518468802272,
                                  0.0013366250926112862};
static const double COSINE_Q[] = {1.0, 2.41141406176318, 2.0972440318348915, 0.797423044457054, 0.12704908948738775,
                                  0.006541037985850415, 3.6963837628258704e-05};
static const double SINE_P[] = {0.8660254037844386, 2.178267763980038, 2.0031317177691976, 0.8230888428011572, 0.14743157483386207,
                                0.009352988492802717, 0.0001044467326175935};
static const double SINE_Q[] = {1.0, 2.900147139261648, 3.1515066495375663, 1.5859291725257552, 0.36869160810855334,
                                0.034039603675727254, 0.0007899344819197407};

INLINE double polynomial(const double *c, double k) {
    return c[0] + k * (c[1] + k * (c[2] + k * (c[3] + k * (c[4] + k * (c[5] + k * c[6])))));
}

INLINE double sq(double x) { return x * x; }

/* See jaxkin.numerics.singular_values: two eigenvalues of m m^T in closed form, the third from the determinant. */
INLINE extremes of_three(vec x, vec y, vec z) {
    double g00 = dot(x, x), g11 = dot(y, y), g22 = dot(z, z), g01 = dot(x, y), g02 = dot(x, z), g12 = dot(y, z);
    double mean = (g00 + g11 + g22) / 3, d0 = g00 - mean, d1 = g11 - mean, d2 = g22 - mean;
    double square = (d0 * d0 + d1 * d1 + d2 * d2 + 2 * (g01 * g01 + g02 * g02 + g12 * g12)) / 6;
    double spread = sqrt(max2(square, 1e-300)), inverse = 1 / spread;
    d0 *= inverse, d1 *= inverse, d2 *= inverse, g01 *= inverse, g02 *= inverse, g12 *= inverse;
    double c = (d0 * (d1 * d2 - g12 * g12) - g01 * (g01 * d2 - g12 * g02) + g02 * (g01 * g12 - d1 * g02)) / 2;
    double e = sq(d0 * d0 + g01 * g01 + g02 * g02 - 2 - c * d0) + sq(g01 * g01 + d1 * d1 + g12 * g12 - 2 - c * d1) +
               sq(g02 * g02 + g12 * g12 + d2 * d2 - 2 - c * d2) +
               2 * (sq((d0 + d1 - c) * g01 + g02 * g12) + sq((d0 + d2 - c) * g02 + g01 * g12) + sq((d1 + d2 - c) * g12 + g01 * g02));
    double root = sqrt(2 + 2 * fabs(c)), large = 0.5 * root, small = sqrt(e / 6) / root, k = c < 0 ? small : large,
           side = c < 0 ? large : small;
    double p = polynomial(COSINE_P, k), q = polynomial(COSINE_Q, k), s = polynomial(SINE_P, k), t = polynomial(SINE_Q, k);
    double w = 1 / (q * t), cosine = p * t * w, sine = side * s * q * w;
    double first = mean + 2 * spread * cosine, second = max2(mean + spread * (ROOT3 * sine - cosine), 1e-300);
    return (extremes){fabs(dot(x, cross(y, z))) / sqrt(first * second), sqrt(first)};
}

enum { DETERMINANT, SMALLEST, INVERSE_CONDITION };

INLINE double chosen(int what, double det, extremes e) {
    return what == DETERMINANT ? det : what == SMALLEST ? e.smallest : e.smallest / e.largest;
}

/* size: base points (6), platform points (6), characteristic length. */
INLINE double rpr3_at(int what, const double *size, double x, double y, double c, double s) {
    vec row[3], rate[3];
    for (int k = 0; k < 3; k++) {
        double bx = size[6 + 2 * k], by = size[7 + 2 * k], armx = bx * c - by * s, army = bx * s + by * c;
        double dx = x + armx - size[2 * k], dy = y + army - size[2 * k + 1], moment = dy * armx - dx * army;
        double inverse = 1 / sqrt(dx * dx + dy * dy);
        row[k] = (vec){2 * dx, 2 * dy, 2 * moment};
        rate[k] = (vec){dx * inverse, dy * inverse, moment * inverse / size[12]};
    }
    return chosen(what, dot(row[0], cross(row[1], row[2])), of_three(rate[0], rate[1], rate[2]));
}

INLINE double tlpm_at(int what, const double *size, double x, double y, double z) {
    vec row[3], rate[3];
    for (int k = 0; k < 3; k++) {
        vec d = {x - size[2 * k], y - size[2 * k + 1], z + size[6]};
        row[k] = combined(2, d, 0, d), rate[k] = combined(1 / sqrt(dot(d, d)), d, 0, d);
    }
    return chosen(what, dot(row[0], cross(row[1], row[2])), of_three(rate[0], rate[1], rate[2]));
}

/* In two loops: of both in one gcc makes calls of sincos, which it cannot vectorise. */
static void turn(size_t m, const double *restrict angle, double *restrict c, double *restrict s) {
#pragma omp simd
    for (size_t i = 0; i < m; i++) c[i] = cos(angle[i]);
#pragma omp simd
    for (size_t i = 0; i < m; i++) s[i] = sin(angle[i]);
}

/* Samples anywhere, then grids of which sines are taken once an axis value. */
#define FOR_EACH(WHAT, LOOP) \
    if (WHAT == DETERMINANT) { LOOP(DETERMINANT) } else if (WHAT == SMALLEST) { LOOP(SMALLEST) } else { LOOP(INVERSE_CONDITION) }

void rpr3_conditioning(size_t n, int what, const double *size, const double *restrict p, double *restrict out) {
    double c[BLOCK], s[BLOCK];
    for (size_t o = 0; o < n; o += BLOCK) {
        size_t m = n - o < BLOCK ? n - o : BLOCK;
        turn(m, p + 2 * n + o, c, s);
#define LOOP(W) _Pragma("omp simd") for (size_t i = 0; i < m; i++) out[o + i] = rpr3_at(W, size, p[o + i], p[n + o + i], c[i], s[i]);
        FOR_EACH(what, LOOP)
#undef LOOP
    }
}

void rpr3_conditioning_grid(size_t nx, size_t ny, size_t np, int what, const double *size, const double *restrict x,
                            const double *restrict y, const double *restrict turns, double *restrict out) {
#define LOOP(W) for (size_t i = 0; i < nx; i++) for (size_t j = 0; j < ny; j++) { \
        double *restrict to = out + (i * ny + j) * np; const double xi = x[i], yj = y[j]; \
        _Pragma("omp simd") for (size_t k = 0; k < np; k++) to[k] = rpr3_at(W, size, xi, yj, turns[k], turns[np + k]); }
    FOR_EACH(what, LOOP)
#undef LOOP
}

void tlpm_conditioning(size_t n, int what, const double *size, const double *restrict p, double *restrict out) {
#define LOOP(W) _Pragma("omp simd") for (size_t i = 0; i < n; i++) out[i] = tlpm_at(W, size, p[i], p[n + i], p[2 * n + i]);
    FOR_EACH(what, LOOP)
#undef LOOP
}

void tlpm_conditioning_grid(size_t nx, size_t ny, size_t nz, int what, const double *size, const double *restrict x,
                            const double *restrict y, const double *restrict z, double *restrict out) {
#define LOOP(W) for (size_t i = 0; i < nx; i++) for (size_t j = 0; j < ny; j++) { \
        double *restrict to = out + (i * ny + j) * nz; const double xi = x[i], yj = y[j]; \
        _Pragma("omp simd") for (size_t k = 0; k < nz; k++) to[k] = tlpm_at(W, size, xi, yj, z[k]); }
    FOR_EACH(what, LOOP)
#undef LOOP
}

/* The 6x6 of the 3-PPPS: reflections to a bidiagonal matrix, then Laguerre's steps; W samples at once in vectors. */
enum { W = 8, N = 6 };
typedef double lanes __attribute__((vector_size(8 * W)));

INLINE lanes roots(lanes x) {
    for (int l = 0; l < W; l++) x[l] = sqrt(x[l]);
    return x;
}
INLINE lanes all(double x) { return x - (lanes){0}; }
INLINE lanes signed_as(lanes x, lanes like) {
    for (int l = 0; l < W; l++) x[l] = like[l] < 0 ? -x[l] : x[l];
    return x;
}
INLINE lanes magnitude(lanes x) { return signed_as(x, x); }
INLINE lanes positive(lanes x, double other) {
    for (int l = 0; l < W; l++) x[l] = x[l] > 0 ? x[l] : other;
    return x;
}

INLINE lanes laguerre(lanes x, const lanes *q, const lanes *e) {
    lanes t = -x, slope = all(-1), bend = all(0), first = all(0), second = all(0);
    for (int i = 0; i < N; i++) {
        lanes r = 1 / (q[i] + t), ratio = slope * r;
        first -= ratio, second += ratio * ratio - bend * r;
        if (i == N - 1) break;
        lanes factor = e[i] * q[i] * r * r, old = slope;
        t = e[i] * t * r - x, slope = factor * slope - 1, bend = factor * (bend - 2 * old * ratio);
    }
    lanes inside = (N - 1) * (N * second - first * first), root = roots(positive(inside, 0)), step = N / (first + signed_as(root, first));
    /* no step where a pivot has vanished: written so that -ffast-math does not fold it away */
    for (int l = 0; l < W; l++) step[l] = fabs(step[l]) < 1e300 ? step[l] : 0;
    return step;
}

static lanes limit(lanes x, const lanes *q, const lanes *e) {
    for (int count = 0; count < 48; count++) {
        lanes step = laguerre(x, q, e);
        int moving = 0;
        for (int l = 0; l < W; l++) moving |= fabs(step[l]) > 1e-15 * x[l];
        x += step;
        if (!moving) break;
    }
    return x;
}

INLINE lanes reflect(lanes *v, int n, lanes *square) {
    lanes s = all(0);
    for (int i = 0; i < n; i++) s += v[i] * v[i];
    lanes length = roots(s), half = s + length * magnitude(v[0]);
    *square = s;
    v[0] += signed_as(length, v[0]);
    return 1 / positive(half, 1);
}

static void of_six(lanes a[N][N], int both, lanes *low, lanes *high) {
    lanes q[N], e[N], v[N];
#pragma GCC unroll 6
    for (int k = 0; k < N; k++) {
        if (k == N - 1) { q[k] = a[k][k] * a[k][k]; break; }
        for (int i = k; i < N; i++) v[i - k] = a[i][k];
        lanes c = reflect(v, N - k, &q[k]);
        for (int j = k + 1; j < N; j++) {
            lanes w = all(0);
            for (int i = k; i < N; i++) w += v[i - k] * a[i][j];
            for (int i = k; i < N; i++) a[i][j] -= v[i - k] * (w * c);
        }
        if (k == N - 2) { e[k] = a[k][N - 1] * a[k][N - 1]; continue; }
        for (int j = k + 1; j < N; j++) v[j - k - 1] = a[k][j];
        c = reflect(v, N - k - 1, &e[k]);
        for (int i = k + 1; i < N; i++) {
            lanes w = all(0);
            for (int j = k + 1; j < N; j++) w += v[j - k - 1] * a[i][j];
            for (int j = k + 1; j < N; j++) a[i][j] -= v[j - k - 1] * (w * c);
        }
    }
    e[N - 1] = all(0);
    lanes mean = all(0), spread = all(0);
    for (int i = 0; i < N; i++) mean += (q[i] + e[i]) / N;
    for (int i = 0; i < N; i++) {
        lanes d = q[i] + (i ? e[i - 1] : all(0)) - mean;
        spread += d * d + 2 * q[i] * e[i];
    }
    *low = roots(limit(all(0), q, e));
    *high = both ? roots(limit(mean + roots(spread * ((N - 1.) / N)), q, e)) : *low;
}

typedef struct { lanes x2[3], h2[3], x3[3], h3[3]; } slopes;

/* d(rho2y, -rho2z, -rho3y, -rho3z) by phi, theta, sigma. */
INLINE slopes slopes_at(lanes cp, lanes sp, lanes ct, lanes st, lanes cs, lanes ss) {
    lanes zero = all(0), r11 = ct * cs, r12 = -ct * ss, r31 = sp * ss - cp * st * cs, r32 = cp * st * ss + sp * cs;
    lanes one[3] = {zero, -st * cs, r12}, two[3] = {zero, st * ss, -r11};
    lanes low1[3] = {cp * ss + sp * st * cs, -cp * ct * cs, r32}, low2[3] = {cp * cs - sp * st * ss, cp * ct * ss, -r31};
    slopes f;
    for (int k = 0; k < 3; k++) {
        f.x2[k] = HALF_ROOT3 * one[k] + 0.5 * two[k], f.x3[k] = HALF_ROOT3 * one[k] - 0.5 * two[k];
        f.h2[k] = HALF_ROOT3 * low1[k] + 0.5 * low2[k], f.h3[k] = HALF_ROOT3 * low1[k] - 0.5 * low2[k];
    }
    return f;
}

INLINE lanes three(const lanes *a, const lanes *b, const lanes *c) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

INLINE lanes ppps3_at(int what, lanes cp, lanes sp, lanes ct, lanes st, lanes cs, lanes ss) {
    slopes f = slopes_at(cp, sp, ct, st, cs, ss);
    if (what == DETERMINANT) return -16 * (three(f.h2, f.x3, f.h3) + three(f.x2, f.h2, f.h3));
    lanes zero = all(0), one = all(1), low, high;
    lanes a[N][N] = {{zero, one, zero, zero, zero, zero},           {zero, zero, one, zero, zero, zero},
                     {-one, zero, zero, f.x2[0], f.x2[1], f.x2[2]}, {zero, zero, one, -f.h2[0], -f.h2[1], -f.h2[2]},
                     {one, zero, zero, -f.x3[0], -f.x3[1], -f.x3[2]}, {zero, zero, one, -f.h3[0], -f.h3[1], -f.h3[2]}};
    of_six(a, what == INVERSE_CONDITION, &low, &high);
    return what == SMALLEST ? low : low / high;
}

/* n is a multiple of W; turns: cos and sin of phi, theta, sigma. */
static void ppps3_turned(size_t n, int what, const double *const *turns, double *restrict out) {
    for (size_t i = 0; i < n; i += W) {
        lanes t[6], found;
        for (int k = 0; k < 6; k++) memcpy(&t[k], turns[k] + i, sizeof t[k]);
        found = ppps3_at(what, t[0], t[1], t[2], t[3], t[4], t[5]);
        memcpy(out + i, &found, sizeof found);
    }
}

void ppps3_conditioning(size_t n, int what, const double *restrict p, double *restrict out) {
    double turns[6][BLOCK];
    const double *rows[6] = {turns[0], turns[1], turns[2], turns[3], turns[4], turns[5]};
    for (size_t o = 0; o < n; o += BLOCK) {
        size_t m = n - o < BLOCK ? n - o : BLOCK;
        for (int k = 0; k < 3; k++) turn(m, p + (3 + k) * n + o, turns[2 * k], turns[2 * k + 1]);
        ppps3_turned(m, what, rows, out + o);
    }
}

void ppps3_conditioning_grid(size_t np, size_t nt, size_t ns, int what, const double *phi, const double *theta, const double *sigma,
                             double *restrict out) {
    double turns[6][BLOCK];
    const double *rows[6] = {turns[0], turns[1], turns[2], turns[3], turns[4], turns[5]};
    for (size_t k = 0; k < ns; k++) turns[4][k] = cos(sigma[k]), turns[5][k] = sin(sigma[k]);
    for (size_t i = 0; i < np; i++)
        for (size_t j = 0; j < nt; j++) {
            const double four[4] = {cos(phi[i]), sin(phi[i]), cos(theta[j]), sin(theta[j])};
            for (int r = 0; r < 4; r++)
                for (size_t k = 0; k < ns; k++) turns[r][k] = four[r];
            ppps3_turned(ns, what, rows, out + (i * nt + j) * ns);
        }
}
