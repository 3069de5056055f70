/* Truth for random scenes: extended precision, and none of the package's methods.
 *
 * Gragg-Bulirsch-Stoer extrapolation (Hairer, Norsett & Wanner 1993, II.9; columns 2, 4, .. 2K of the modified
 * midpoint rule) in x87 long double (64-bit mantissa, 2048 times finer than double), straight through the contacts:
 * no events, no substitution. Where a contact opens or closes the two last columns disagree until the step is so short
 * that the kink does not matter; that is slow, and simple enough to be believed.
 *
 * In (stdin, C99 hexadecimal floats): bodies contacts samples duration tolerance; per body: mass velocity
 * free-acceleration; per contact: left right stiffness exponent gap, with the index `bodies` for a wall.
 * Out: per sample displacements, then velocities; then per contact largest overlap and crossing time (nan: never).
 *
 *     cc -O2 -o truth truth.c -lm
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef long double real;
enum { K = 10 };

static int n, k, size;
static int *left, *right;
static real *mass, *pull, *beta, *power, *unit;
static long evaluations, steps, failures;

static real force(int j, real s)
{
    if (s <= 0) return 0;
    return power[j] == 1.5L ? beta[j] * s * sqrtl(s) : beta[j] * powl(s, power[j]);
}

/* state: overlaps (k), velocities (n), displacements (n) */
static real rate(const real *y, int j)
{
    real a = left[j] < n ? y[k + left[j]] : 0, b = right[j] < n ? y[k + right[j]] : 0;
    return a - b;
}

static void slope(const real *y, real *d)
{
    evaluations++;
    for (int i = 0; i < n; i++) {
        d[k + i] = pull[i];
        d[k + n + i] = y[k + i];
    }
    for (int j = 0; j < k; j++) {
        real f = force(j, y[j]);
        d[j] = rate(y, j);
        if (left[j] < n) d[k + left[j]] -= f / mass[left[j]];
        if (right[j] < n) d[k + right[j]] += f / mass[right[j]];
    }
}

/* y after h into out; returns the difference of the last two columns in units of unit[] */
static real extrapolated(const real *y, real h, real *out)
{
    static real *table, *d, *a, *b;
    if (!table) {
        table = malloc(sizeof(real) * size * K);
        d = malloc(sizeof(real) * size);
        a = malloc(sizeof(real) * size);
        b = malloc(sizeof(real) * size);
    }
    real worst = 0;
    for (int c = 0; c < K; c++) {
        int m = 2 * (c + 1);
        real g = h / m;
        /* increments from y, so that a short step rounds little */
        slope(y, d);
        for (int q = 0; q < size; q++) { a[q] = 0; b[q] = g * d[q]; }
        for (int p = 1; p <= m; p++) {
            real *at = malloc(sizeof(real) * size);
            for (int q = 0; q < size; q++) at[q] = y[q] + b[q];
            slope(at, d);
            free(at);
            if (p == m) {
                for (int q = 0; q < size; q++) a[q] = 0.5L * (a[q] + b[q] + g * d[q]);
                break;
            }
            for (int q = 0; q < size; q++) {
                real next = a[q] + 2 * g * d[q];
                a[q] = b[q];
                b[q] = next;
            }
        }
        real *row = table + c * size;
        memcpy(row, a, sizeof(real) * size);
        /* Aitken-Neville, rows hold the diagonal that ends in column c */
        for (int r = c - 1; r >= 0; r--) {
            real ratio = (real)m / (2 * (r + 1));
            real w = ratio * ratio - 1;
            real *below = table + r * size, *above = table + (r + 1) * size;
            for (int q = 0; q < size; q++) {
                real better = above[q] + (above[q] - below[q]) / w;
                if (c == K - 1 && r == 0) {
                    real e = fabsl(better - above[q]) / unit[q];
                    if (e > worst) worst = e;
                }
                below[q] = better;
            }
        }
    }
    for (int q = 0; q < size; q++) out[q] = y[q] + table[q];
    return worst;
}

/* root of the overlap (turn = 0) or closing rate (1) of contact j within (0, h]: secant with bisection */
static real root(const real *y, real h, int j, int turn, real *at)
{
    real a = 0, b = h, fa = turn ? rate(y, j) : y[j], fb;
    extrapolated(y, h, at);
    fb = turn ? rate(at, j) : at[j];
    for (int t = 0; t < 200 && b - a > 1e-18L * h; t++) {
        real c = (t % 3 == 2) ? 0.5L * (a + b) : a + fa * (b - a) / (fa - fb);
        if (!(c > a && c < b)) c = 0.5L * (a + b);
        extrapolated(y, c, at);
        real f = turn ? rate(at, j) : at[j];
        if (f == 0) return c;
        if ((f > 0) == (fa > 0)) { a = c; fa = f; } else { b = c; fb = f; }
    }
    extrapolated(y, b, at);
    return b;
}

static real number(void)
{
    char word[128];
    if (scanf("%127s", word) != 1) exit(2);
    return strtold(word, NULL);
}

int main(void)
{
    n = (int)number(); k = (int)number();
    int samples = (int)number();
    real duration = number(), tolerance = number();
    size = k + 2 * n;
    left = malloc(sizeof(int) * (k + 1)); right = malloc(sizeof(int) * (k + 1));
    mass = malloc(sizeof(real) * n); pull = malloc(sizeof(real) * n);
    beta = malloc(sizeof(real) * (k + 1)); power = malloc(sizeof(real) * (k + 1));
    unit = malloc(sizeof(real) * size);
    real *y = calloc(size, sizeof(real)), *next = malloc(sizeof(real) * size), *at = malloc(sizeof(real) * size);
    real *peak = calloc(k + 1, sizeof(real)), *crossing = malloc(sizeof(real) * (k + 1));
    real energy = 0, speed = 0, total = 0;
    for (int i = 0; i < n; i++) {
        mass[i] = number(); y[k + i] = number(); pull[i] = number();
        real fall = fabsl(pull[i]) * duration;
        energy += 0.5L * mass[i] * (y[k + i] * y[k + i] + fall * fall);
        if (fabsl(y[k + i]) + fall > speed) speed = fabsl(y[k + i]) + fall;
        total += mass[i];
    }
    real stored = 0;
    for (int j = 0; j < k; j++) {
        left[j] = (int)number(); right[j] = (int)number();
        beta[j] = number(); power[j] = number() - 1; y[j] = -number();
        peak[j] = y[j] > 0 ? y[j] : 0;
        crossing[j] = NAN;
        if (y[j] > 0) stored += force(j, y[j]) * y[j] / (power[j] + 1);
    }
    energy += stored;
    if (sqrtl(2 * stored / total) > speed) speed = sqrtl(2 * stored / total);
    if (speed == 0) speed = 1;
    for (int j = 0; j < k; j++) unit[j] = powl((power[j] + 1) * energy / beta[j], 1 / (power[j] + 1));
    for (int j = 0; j < k; j++) if (unit[j] == 0) unit[j] = 1;
    for (int i = 0; i < n; i++) { unit[k + i] = speed; unit[k + n + i] = speed * duration; }
    real now = 0, want = duration * 1e-6L;
    for (int row = 0; row <= samples; row++) {
        /* the sample times of numpy.linspace, in double */
        real goal = row == samples ? duration : (real)((double)row * ((double)duration / (double)samples));
        while (now < goal) {
            real fastest = 0, soon = INFINITY;
            for (int j = 0; j < k; j++) {
                real mobility = (left[j] < n ? 1 / mass[left[j]] : 0) + (right[j] < n ? 1 / mass[right[j]] : 0);
                real u = rate(y, j), deep = y[j] > 0 ? y[j] : 0;
                real depth = powl((power[j] + 1) * u * u / (2 * mobility * beta[j]), 1 / (power[j] + 1)) + deep;
                real stiff = depth > 0 ? power[j] * force(j, depth) / depth * mobility : 0;
                if (y[j] > 0 && stiff > fastest) fastest = stiff;
                /* an open contact that closes in: look before it is there */
                if (y[j] < 0 && u > 0) {
                    real wait = -0.5L * y[j] / u, least = stiff > 0 ? 1e-3L / sqrtl(stiff) : INFINITY;
                    if (wait < least) wait = least;
                    if (wait < soon) soon = wait;
                }
            }
            real h = want, most = fastest > 0 ? 0.2L / sqrtl(fastest) : INFINITY;
            if (h > most) h = most;
            if (h > soon) h = soon;
            int last = h >= goal - now;
            if (last) h = goal - now;
            real error = extrapolated(y, h, next) / tolerance;
            real factor = error > 0 ? 0.9L * powl(error, -1.0L / (2 * K - 1)) : 4;
            if (factor > 4) factor = 4;
            if (factor < 0.2L) factor = 0.2L;
            if (error > 1 && h > 1e-16L * duration) { want = h * factor; failures++; continue; }
            steps++;
            /* end the step at the first contact that opens or closes in it: no step has a kink inside */
            int touched = -1;
            real first = h;
            for (int j = 0; j < k; j++)
                if ((y[j] > 0 && next[j] < 0) || (y[j] < 0 && next[j] > 0)) {
                    real when = root(y, h, j, 0, at);
                    if (when <= first) { first = when; touched = j; }
                }
            if (touched >= 0 && first > 0) {
                h = first;
                last = 0;
                extrapolated(y, h, next);
                next[touched] = 0;
            }
            for (int j = 0; j < k; j++) {
                if (rate(y, j) > 0 && rate(next, j) <= 0) {
                    real when = root(y, h, j, 1, at);
                    /* what is less deep has no force that matters, and its turns are round-off */
                    if (at[j] > 1e-12L * unit[j]) {
                        if (at[j] > peak[j]) peak[j] = at[j];
                        if (isnan(crossing[j])) crossing[j] = now + when;
                    }
                }
                if (next[j] > peak[j]) peak[j] = next[j];
            }
            memcpy(y, next, sizeof(real) * size);
            now = last ? goal : now + h;
            if (!last || factor < 1) want = h * factor;
            else if (want < h * factor) want = h * factor;
        }
        for (int i = 0; i < n; i++) printf("%a ", (double)y[k + n + i]);
        for (int i = 0; i < n; i++) printf("%a ", (double)y[k + i]);
        printf("\n");
    }
    for (int j = 0; j < k; j++) printf("%a %a %a\n", (double)peak[j], (double)(peak[j] > 0 ? force(j, peak[j]) : 0), (double)crossing[j]);
    fprintf(stderr, "%ld steps, %ld failures, %ld evaluations\n", steps, failures, evaluations);
    return 0;
}
