/* Truth for random scenes with every feature, in extended precision and by none of the package's methods.
 *
 * Gragg-Bulirsch-Stoer extrapolation as in truth.c, in x87 long double, between events: a contact is open, pressing or
 * slack (it overlaps, and its clipped force is zero), its force is smooth within a state, and every change of state is
 * located by secant and bisection.
 *
 * In (stdin, C99 hexadecimal floats): bodies contacts samples duration tolerance clip drag; drive: shape (0 none, 1
 * sine or chirp, 2 table), then count and numbers; breaks: count and times; per body: mass velocity
 * free-acceleration; per contact: left right stiffness exponent gap damping damping-power pull-off resting.
 * Out: displacements, then velocities at the end; then per contact peak force and crossing time (nan: never).
 *
 *     cc -O2 -o truth_any truth_any.c -lm
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

typedef long double real;
enum { K = 9, OPEN = 0, PRESS = 1, SLACK = 2 };
static const real PI = 3.14159265358979323846264338327950288L;

static int n, k, size, shape, clip, numbers;
static int *left, *right, *state;
static real *mass, *pull, *beta, *power, *damp, *dpower, *off, *resting, *unit, *deep, *drive, drag;
static long steps;

static real push(real t)
{
    if (shape == 0) return 0;
    if (shape == 2) { /* interval, values */
        real at = t / drive[0];
        int i = (int)at, last = numbers - 2;
        if (i >= last) return drive[1 + last];
        return drive[1 + i] + (at - i) * (drive[2 + i] - drive[1 + i]);
    }
    /* force, frequency, last frequency, sweep (0: none), phase in radians, rise */
    real angle = 2 * PI * drive[1] * t, sweep = drive[3];
    if (sweep > 0) {
        real change = drive[2] - drive[1];
        angle += t < sweep ? PI * change * t * t / sweep : 2 * PI * change * (t - sweep / 2);
    }
    real rise = drive[5], s = t < rise ? sinl(PI * t / (2 * rise)) : 1;
    return drive[0] * s * s * sinl(angle + drive[4]);
}

static real rate(const real *y, int j)
{
    return (left[j] < n ? y[k + left[j]] : 0) - (right[j] < n ? y[k + right[j]] : 0);
}

static real total(const real *y, int j)
{
    real s = y[j] > 0 ? y[j] : 0;
    real f = (power[j] == 1.5L ? beta[j] * s * sqrtl(s) : beta[j] * powl(s, power[j])) - off[j];
    if (damp[j] > 0) f += damp[j] * (dpower[j] > 0 ? powl(s, dpower[j]) : 1) * rate(y, j);
    return f;
}

static void slope(real t, const real *y, real *d)
{
    for (int i = 0; i < n; i++) {
        d[k + i] = pull[i] - drag * y[k + i];
        d[k + n + i] = y[k + i];
    }
    if (shape) d[k] += push(t) / mass[0];
    for (int j = 0; j < k; j++) {
        real f = state[j] == PRESS ? total(y, j) : 0;
        d[j] = rate(y, j);
        if (left[j] < n) d[k + left[j]] -= f / mass[left[j]];
        if (right[j] < n) d[k + right[j]] += f / mass[right[j]];
    }
}

static real extrapolated(real t, const real *y, real h, real *out)
{
    static real *table, *d, *a, *b, *at;
    if (!table) {
        table = malloc(sizeof(real) * size * K);
        d = malloc(sizeof(real) * size); a = malloc(sizeof(real) * size);
        b = malloc(sizeof(real) * size); at = malloc(sizeof(real) * size);
    }
    real worst = 0;
    for (int c = 0; c < K; c++) {
        int m = 2 * (c + 1);
        real g = h / m;
        slope(t, y, d);
        for (int q = 0; q < size; q++) { a[q] = 0; b[q] = g * d[q]; }
        for (int p = 1; p <= m; p++) {
            for (int q = 0; q < size; q++) at[q] = y[q] + b[q];
            slope(t + p * g, at, d);
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
        for (int r = c - 1; r >= 0; r--) {
            real ratio = (real)m / (2 * (r + 1)), w = ratio * ratio - 1;
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

/* what of contact j is asked for the sign of: 0 overlap, 1 closing rate, 2 total force, 3 slope of the total force */
static real value(real t, const real *y, int j, int what)
{
    static real *d;
    if (what == 0) return y[j];
    if (what == 1) return rate(y, j);
    if (what == 2) return total(y, j);
    if (!d) d = malloc(sizeof(real) * size);
    slope(t, y, d);
    real s = y[j], u = rate(y, j), a = rate(d, j);
    if (s <= 0) return -1;
    real f = beta[j] * power[j] * powl(s, power[j] - 1) * u;
    if (dpower[j] > 0) f += damp[j] * dpower[j] * powl(s, dpower[j] - 1) * u * u;
    return f + damp[j] * (dpower[j] > 0 ? powl(s, dpower[j]) : 1) * a;
}

static real root(real t, const real *y, real h, int j, int what, real *at)
{
    real a = 0, b = h, fa = value(t, y, j, what), fb;
    extrapolated(t, y, h, at);
    fb = value(t + h, at, j, what);
    for (int i = 0; i < 150 && b - a > 1e-18L * h; i++) {
        real c = (i % 3 == 2) ? 0.5L * (a + b) : a + fa * (b - a) / (fa - fb);
        if (!(c > a && c < b)) c = 0.5L * (a + b);
        extrapolated(t, y, c, at);
        real f = value(t + c, at, j, what);
        if (f == 0) return c;
        if ((f > 0) == (fa > 0)) { a = c; fa = f; } else { b = c; fb = f; }
    }
    extrapolated(t, y, b, at);
    return b;
}

static real number(void)
{
    char word[128];
    if (scanf("%127s", word) != 1) exit(2);
    return strtold(word, NULL);
}

static real *reals(int count) { return calloc(count + 1, sizeof(real)); }

int main(void)
{
    struct rlimit limit = {6, 6}; /* s of CPU; a truth that takes more is given up */
    setrlimit(RLIMIT_CPU, &limit);
    n = (int)number(); k = (int)number();
    int samples = (int)number();
    real duration = number(), tolerance = number();
    clip = (int)number(); drag = number();
    shape = (int)number(); numbers = (int)number();
    drive = reals(numbers);
    for (int i = 0; i < numbers; i++) drive[i] = number();
    int breaks = (int)number();
    real *stop = reals(breaks);
    for (int i = 0; i < breaks; i++) stop[i] = number();
    size = k + 2 * n;
    left = malloc(sizeof(int) * (k + 1)); right = malloc(sizeof(int) * (k + 1)); state = calloc(k + 1, sizeof(int));
    mass = reals(n); pull = reals(n); beta = reals(k); power = reals(k); damp = reals(k); dpower = reals(k);
    off = reals(k); resting = reals(k); unit = reals(size); deep = reals(k);
    real *y = reals(size), *next = reals(size), *at = reals(size), *peak = reals(k), *crossing = reals(k), *d = reals(size);
    for (int i = 0; i < n; i++) { mass[i] = number(); y[k + i] = number(); pull[i] = number(); }
    for (int j = 0; j < k; j++) {
        left[j] = (int)number(); right[j] = (int)number();
        beta[j] = number(); power[j] = number() - 1; y[j] = -number();
        damp[j] = number(); dpower[j] = number(); off[j] = number(); resting[j] = number();
        deep[j] = number(); /* overlap that a collision of the scene can make, m: the unit */
        unit[j] = deep[j];
        crossing[j] = NAN;
    }
    real speed = number(); /* largest speed of the scene */
    for (int i = 0; i < n; i++) { unit[k + i] = speed; unit[k + n + i] = speed * duration; }
    for (int j = 0; j < k; j++) {
        if (y[j] > 0) state[j] = (clip && damp[j] > 0 && total(y, j) <= 0) ? SLACK : PRESS;
        else state[j] = (y[j] == 0 && rate(y, j) >= 0) ? PRESS : OPEN;
        /* a contact that begins in tension opens, and its largest force is 0 */
        if (y[j] > 0 && state[j] == PRESS && total(y, j) > 0) peak[j] = total(y, j);
    }
    real now = 0, want = duration * 1e-6L;
    int hit = 0;
    while (now < duration) {
        real goal = duration;
        for (int i = 0; i < breaks; i++) if (stop[i] > now && stop[i] < goal) goal = stop[i];
        real fastest = 0, soon = INFINITY;
        slope(now, y, d);
        for (int j = 0; j < k; j++) {
            real mobility = (left[j] < n ? 1 / mass[left[j]] : 0) + (right[j] < n ? 1 / mass[right[j]] : 0);
            real u = rate(y, j), s = y[j] > 0 ? y[j] : 0, a = fabsl(rate(d, j));
            real depth = powl((power[j] + 1) * u * u / (2 * mobility * beta[j]), 1 / (power[j] + 1)) + s;
            real stiff = depth > 0 ? power[j] * beta[j] * powl(depth, power[j] - 1) * mobility : 0;
            real damped = damp[j] > 0 && depth > 0 ? damp[j] * (dpower[j] > 0 ? powl(depth, dpower[j]) : 1) * mobility : 0;
            if (state[j] != OPEN && stiff > fastest) fastest = stiff;
            if (state[j] != OPEN && damped * damped > fastest) fastest = damped * damped;
            if (state[j] == OPEN && y[j] < 0) { /* no step passes over a contact: half the way there, at most */
                real reach = -0.5L * y[j], wait = a > 0 ? (sqrtl(u * u + 2 * a * reach) - (u > 0 ? u : 0)) / a : INFINITY;
                if (u > 0 && reach / u < wait) wait = reach / u;
                real w = sqrtl(stiff) > damped ? sqrtl(stiff) : damped;
                real least = w > 0 ? 1e-3L / w : 1e-6L * duration;
                if (wait < least) wait = least;
                if (wait < soon) soon = wait;
            }
        }
        real h = want, most = fastest > 0 ? 0.2L / sqrtl(fastest) : INFINITY;
        if (h > most) h = most;
        if (h > soon) h = soon;
        int last = h >= goal - now;
        if (last) h = goal - now;
        real error = extrapolated(now, y, h, next) / tolerance;
        real factor = error > 0 ? 0.9L * powl(error, -1.0L / (2 * K - 1)) : 4;
        if (factor > 4) factor = 4;
        if (!(factor > 0.2L)) factor = 0.2L;
        if (!(error <= 1) && h > 1e-19L * duration) { want = h * factor; continue; }
        if (++steps > 3000000) exit(3);
        int changed = -1, to = OPEN;
        real first = h;
        for (int j = 0; j < k; j++) {
            int what = -1, then = OPEN;
            int clipped = clip && damp[j] > 0;
            if (state[j] == OPEN) { if (next[j] > 0) { what = 0; then = PRESS; } }
            else {
                if (next[j] < 0) { what = 0; then = OPEN; }
                if (clipped && state[j] == PRESS && total(next, j) < 0 && (total(y, j) > 0)) { what = 2; then = SLACK; }
                if (clipped && state[j] == SLACK && next[j] > 0 && total(next, j) > 0) { what = 2; then = PRESS; }
            }
            if (what < 0) continue;
            real from = value(now, y, j, what), when = 0;
            if (from != 0 && (from > 0) != (value(now + h, next, j, what) > 0)) when = root(now, y, h, j, what, at);
            else if (from != 0) continue;
            if (when <= first) { first = when; changed = j; to = then; hit = what; }
        }
        if (changed >= 0) {
            h = first;
            last = 0;
            if (h > 0) extrapolated(now, y, h, next); else memcpy(next, y, sizeof(real) * size);
            if (hit == 0) next[changed] = 0;
        }
        for (int j = 0; j < k && h > 0; j++) {
            if (state[j] == PRESS && damp[j] > 0) {
                real f = total(y, j);
                if (f > peak[j]) peak[j] = f;
                f = total(next, j);
                if (f > peak[j]) peak[j] = f;
                if (y[j] > 0 && value(now, y, j, 3) > 0 && value(now + h, next, j, 3) <= 0) {
                    root(now, y, h, j, 3, at);
                    f = total(at, j);
                    if (f > peak[j]) peak[j] = f;
                }
            }
            if (rate(y, j) > 0 && rate(next, j) <= 0) {
                real when = root(now, y, h, j, 1, at);
                slope(now + when, at, d);
                if (at[j] > powl(1e-12L, power[j] < 1 ? 2 / (power[j] + 1) : 1) * deep[j]) {
                    if (state[j] == PRESS && total(at, j) > peak[j]) peak[j] = total(at, j);
                    if (isnan(crossing[j]) && fabsl(rate(d, j)) >= resting[j]) crossing[j] = now + when;
                }
            }
            if (state[j] == PRESS && next[j] > 0 && total(next, j) > peak[j]) peak[j] = total(next, j);
        }
        memcpy(y, next, sizeof(real) * size);
        now = last ? goal : now + h;
        if (changed >= 0) {
            state[changed] = to;
            /* the next step starts where forces may be singular */
            want = h * 0.1L;
            if (want < 1e-9L * duration) want = 1e-9L * duration;
        }
        else if (!last || factor < 1) want = h * factor;
        else if (want < h * factor) want = h * factor;
    }
    (void)samples;
    for (int i = 0; i < n; i++) printf("%a ", (double)y[k + n + i]);
    for (int i = 0; i < n; i++) printf("%a ", (double)y[k + i]);
    printf("\n");
    for (int j = 0; j < k; j++) printf("%a %a\n", (double)peak[j], (double)crossing[j]);
    return 0;
}
