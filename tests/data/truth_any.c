/* First truth for random scenes with every feature, in extended precision and by none of the package's methods.
 *
 * Gragg-Bulirsch-Stoer extrapolation as in truth.c between events. A contact is open, pressing or slack (it overlaps, and
 * its clipped force is zero); its force is smooth within a state. All zeros of the closing rate within a step are
 * isolated: a part of the step is cut in two until a cubic through closing rate and acceleration at both ends either has
 * no zero or is monotone, with a margin. Overlaps are monotone between these zeros, so that no touch, opening or maximum
 * is passed over. After a step each contact takes the state that its own overlap has, however many change at once.
 *
 * In (stdin, C99 hexadecimal floats): bodies contacts duration tolerance clip drag; drive: shape (0 none, 1
 * sine or chirp, 2 table), then count and numbers; breaks: count and times; per body: mass velocity
 * free-acceleration; per contact: left right stiffness exponent gap damping damping-power pull-off resting deep; speed.
 * Out: displacements, then velocities at the end; per contact peak force, crossing time (nan: never), and 1 where the
 * crossing is not sure; at last 1 where nothing is sure, and the steps. Not sure is what round-off decides: a turn within
 * it of touching, two zeros of the closing rate within it of none, a turn at the end of the run.
 *
 *     cc -O2 -o truth_any truth_any.c -lm                    x87 long double
 *     cc -O2 -DQUAD -o truth_any truth_any.c -lquadmath -lm  binary128, some forty times slower
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#ifdef QUAD
#include <quadmath.h>
typedef __float128 real;
#define M(name) name##q
#define ROUND 1.93e-34Q
#define READ(word) strtoflt128(word, NULL)
#define PI M_PIq
#else
typedef long double real;
#define M(name) name##l
#define ROUND 1.09e-19L
#define READ(word) strtold(word, NULL)
#define PI 3.14159265358979323846264338327950288L
#endif
#ifndef SECONDS
#define SECONDS 6 /* of CPU; a truth that takes more is given up */
#endif

enum { K = 9, DEPTH = 24, TURNS = 64, OPEN = 0, PRESS = 1, SLACK = 2 };
enum { OVERLAP, RATE, FORCE, SLOPE }; /* what of a contact is asked for */

typedef struct { real at, overlap, force, slowing; int top; } Turn; /* a zero of the closing rate; top: of a maximum */
typedef struct { int contact, sign, first, count, doubtful; real definite, became; Turn turn[TURNS]; } Walk;

static int n, k, size, shape, clip, numbers;
static int *left, *right, *state, *sign, *doubtful;
static real *mass, *pull, *beta, *power, *damp, *dpower, *off, *resting, *unit, *deep, *drive, drag, grain, speed, now;
static real *y, *scratch[DEPTH + 2];

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
    real rise = drive[5], s = t < rise ? M(sin)(PI * t / (2 * rise)) : 1;
    return drive[0] * s * s * M(sin)(angle + drive[4]);
}

/* the state: overlaps, their rates (of which a common velocity takes no digit), velocities, displacements */
static real rate(const real *at, int j) { return at[k + j]; }

static real elastic(real s, int j) { return power[j] == 1.5L ? beta[j] * s * M(sqrt)(s) : beta[j] * M(pow)(s, power[j]); }

static real damper(real s, int j) { return damp[j] > 0 ? damp[j] * (dpower[j] > 0 ? M(pow)(s, dpower[j]) : 1) : 0; }

static real total(const real *at, int j)
{
    real s = at[j] > 0 ? at[j] : 0;
    return elastic(s, j) - off[j] + damper(s, j) * rate(at, j);
}

static void slope(real t, const real *at, real *d)
{
    real *v = d + 2 * k;
    for (int i = 0; i < n; i++) v[i] = pull[i];
    if (shape) v[0] += push(t) / mass[0];
    for (int j = 0; j < k; j++) {
        real f = state[j] == PRESS ? total(at, j) : 0;
        d[j] = rate(at, j);
        if (left[j] < n) v[left[j]] -= f / mass[left[j]];
        if (right[j] < n) v[right[j]] += f / mass[right[j]];
    }
    for (int j = 0; j < k; j++)
        d[k + j] = (left[j] < n ? v[left[j]] : 0) - (right[j] < n ? v[right[j]] : 0) - drag * rate(at, j);
    for (int i = 0; i < n; i++) {
        v[i] -= drag * at[2 * k + i];
        v[n + i] = at[2 * k + i];
    }
}

static real extrapolated(real h, real *out)
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
        slope(now, y, d);
        for (int q = 0; q < size; q++) { a[q] = 0; b[q] = g * d[q]; }
        for (int p = 1; p <= m; p++) {
            for (int q = 0; q < size; q++) at[q] = y[q] + b[q];
            slope(now + p * g, at, d);
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
        memcpy(table + c * size, a, sizeof(real) * size);
        for (int r = c - 1; r >= 0; r--) {
            real ratio = (real)m / (2 * (r + 1)), w = ratio * ratio - 1;
            real *below = table + r * size, *above = table + (r + 1) * size;
            for (int q = 0; q < size; q++) {
                real better = above[q] + (above[q] - below[q]) / w;
                if (c == K - 1 && r == 0) {
                    real e = M(fabs)(better - above[q]) / unit[q];
                    if (!(e <= worst)) worst = e;
                }
                below[q] = better;
            }
        }
    }
    for (int q = 0; q < size; q++) out[q] = y[q] + table[q];
    return worst;
}

static real acceleration(real t, const real *at, int j)
{
    static real *d;
    if (!d) d = malloc(sizeof(real) * size);
    slope(t, at, d);
    return d[k + j];
}

static real value(real t, const real *at, int j, int what)
{
    if (what == OVERLAP) return at[j];
    if (what == RATE) return rate(at, j);
    if (what == FORCE) return total(at, j);
    real s = at[j], u = rate(at, j), a = acceleration(t, at, j);
    if (s <= 0) return -1;
    real f = beta[j] * power[j] * M(pow)(s, power[j] - 1) * u;
    if (dpower[j] > 0) f += damp[j] * dpower[j] * M(pow)(s, dpower[j] - 1) * u * u;
    return f + damper(s, j) * a;
}

/* the zero between a and b from now on, by secant and bisection; `a` where the signs at both ends are the same */
static real root(real a, real b, int j, int what, real *at)
{
    real h = b, fa, fb;
    extrapolated(a, at); fa = value(now + a, at, j, what);
    extrapolated(b, at); fb = value(now + b, at, j, what);
    if ((fa > 0) == (fb > 0)) b = a;
    for (int i = 0; i < 200 && b - a > ROUND * 8 * h; i++) {
        real c = (i % 3 == 2) ? 0.5L * (a + b) : a + fa * (b - a) / (fa - fb);
        if (!(c > a && c < b)) c = 0.5L * (a + b);
        if (!(c > a && c < b)) break;
        extrapolated(c, at);
        real f = value(now + c, at, j, what);
        if (f == 0) return c;
        if ((f > 0) == (fa > 0)) { a = c; fa = f; } else { b = c; fb = f; }
    }
    extrapolated(b, at);
    return b;
}

/* The closing rate has this sign from a to b. Where it had the other one before, there is a turn between. */
static void seen(Walk *walk, int positive, real a, real b)
{
    int is = positive ? 1 : -1, j = walk->contact;
    if (walk->sign == -is && walk->count < TURNS) {
        Turn *turn = walk->turn + walk->count++;
        real *at = scratch[DEPTH + 1];
        turn->at = root(walk->definite, a, j, RATE, at);
        turn->overlap = at[j];
        turn->force = total(at, j);
        turn->slowing = -acceleration(now + turn->at, at, j);
        turn->top = is < 0;
    }
    if (walk->sign == 0) walk->became = a;
    walk->sign = is;
    walk->definite = b;
}

static real largest(real a, real b) { return a > b ? a : b; }
static real least(real a, real b) { return a < b ? a : b; }

/* Walk through the closing rate from a (state `from`) to b (state `to`). */
static void walk_rate(Walk *walk, real a, const real *from, real b, const real *to, int depth)
{
    int j = walk->contact;
    real noise = grain * speed, w = b - a, g0 = rate(from, j), g3 = rate(to, j);
    real g1 = g0 + w * acceleration(now + a, from, j) / 3, g2 = g3 - w * acceleration(now + b, to, j) / 3;
    real low = least(least(g0, g1), least(g2, g3)), high = largest(largest(g0, g1), largest(g2, g3));
    real margin = 0.05L * (high - low) + noise;
    if (low > margin || high < -margin) { seen(walk, low > margin, a, b); return; }
    if (high <= noise && low >= -noise) return;
    real e0 = g1 - g0, e1 = g2 - g1, e2 = g3 - g2, most = largest(M(fabs)(e0), largest(M(fabs)(e1), M(fabs)(e2)));
    real falls = largest(e0, largest(e1, e2)), rises = least(e0, least(e1, e2));
    int monotone = falls < -0.05L * most || rises > 0.05L * most;
    if (monotone || depth == DEPTH || w < 16 * ROUND * (now + b)) {
        /* two zeros that only round-off would tell from none */
        if (!monotone && (M(fabs)(g0) <= noise || M(fabs)(g3) <= noise)) walk->doubtful = 1;
        if (M(fabs)(g0) > noise) seen(walk, g0 > 0, a, a);
        if (M(fabs)(g3) > noise) seen(walk, g3 > 0, b, b);
        return;
    }
    real middle = 0.5L * (a + b);
    extrapolated(middle, scratch[depth]);
    walk_rate(walk, a, from, middle, scratch[depth], depth + 1);
    /* the walk through the first half has used deeper scratch alone */
    walk_rate(walk, middle, scratch[depth], b, to, depth + 1);
}

/* Find the largest force of a damped contact from a to b. */
static void search_peak(int j, real a, const real *from, real b, const real *to, real *peak, int depth)
{
    real f0 = total(from, j), f3 = total(to, j), w = b - a;
    *peak = largest(*peak, largest(f0, f3));
    if (to[j] <= 0) return;
    real d0 = value(now + a, from, j, SLOPE), d3 = value(now + b, to, j, SLOPE);
    real f1 = f0 + w * d0 / 3, f2 = f3 - w * d3 / 3, high = largest(f1, f2);
    int singular = from[j] <= 0;
    real e0 = f1 - f0, e1 = f2 - f1, e2 = f3 - f2, most = largest(M(fabs)(e0), largest(M(fabs)(e1), M(fabs)(e2)));
    int monotone = least(e0, least(e1, e2)) >= 0.05L * most || largest(e0, largest(e1, e2)) <= -0.05L * most;
    if (!singular && monotone) return;
    if (!singular && high + 0.1L * (high - least(f0, f3)) <= *peak) return;
    if (!singular && d0 > 0 && d3 <= 0 && e0 > e1 && e1 > e2) {
        real *at = scratch[DEPTH + 1];
        root(a, b, j, SLOPE, at);
        *peak = largest(*peak, total(at, j));
        return;
    }
    if (depth >= 10) return;
    real middle = 0.5L * (a + b);
    extrapolated(middle, scratch[depth]);
    search_peak(j, a, from, middle, scratch[depth], peak, depth + 1);
    search_peak(j, middle, scratch[depth], b, to, peak, depth + 1);
}

static real number(void)
{
    char word[128];
    if (scanf("%127s", word) != 1) exit(2);
    return READ(word);
}

static real *reals(int count) { return calloc(count + 1, sizeof(real)); }

/* Give contact j the state of its own overlap. */
static void settle(int j)
{
    int clipped = clip && damp[j] > 0;
    real s = y[j], u = rate(y, j);
    if (state[j] == OPEN && (s > 0 || (s == 0 && u > 0))) state[j] = PRESS;
    if (state[j] != OPEN && (s < 0 || (s == 0 && u < 0))) state[j] = OPEN;
    if (clipped && state[j] != OPEN && s > 0) state[j] = total(y, j) < 0 || (total(y, j) == 0 && state[j] == SLACK) ? SLACK : PRESS;
}

/* Return when contact j changes its state first within h, inf: not; `next` is the state after h. */
static real change(Walk *walk, real h, const real *next, int *to)
{
    int j = walk->contact, clipped = clip && damp[j] > 0;
    real *at = scratch[DEPTH + 1], before = 0, old = y[j], pressed = total(y, j);
    for (int i = 0; i <= walk->count; i++) {
        Turn *turn = walk->turn + i;
        int end = i == walk->count;
        real when = end ? h : turn->at, s = end ? next[j] : turn->overlap, f = end ? total(next, j) : turn->force;
        if (state[j] == OPEN ? s > 0 : s < 0) {
            int touching = state[j] == OPEN ? old >= 0 : old <= 0;
            real first = touching ? before : root(before, when, j, OVERLAP, at);
            *to = state[j] == OPEN ? PRESS : OPEN;
            /* its force may have vanished before */
            if (state[j] == PRESS && clipped && pressed > 0) { first = root(before, first, j, FORCE, at); *to = SLACK; }
            return first;
        }
        if (clipped && state[j] == PRESS && f < 0 && pressed > 0) { *to = SLACK; return root(before, when, j, FORCE, at); }
        if (clipped && state[j] == SLACK && f > 0 && s > 0) { *to = PRESS; return pressed < 0 ? root(before, when, j, FORCE, at) : before; }
        before = when; old = s; pressed = f;
    }
    return INFINITY;
}

static real longest_step(void)
{
    real fastest = drag * drag, most;
    if (shape == 1) {
        real w = 2 * PI * largest(drive[1], drive[2]) + (drive[5] > 0 ? PI / drive[5] : 0);
        fastest = largest(fastest, w * w / 6);
    }
    for (int j = 0; j < k; j++) {
        real mobility = (left[j] < n ? 1 / mass[left[j]] : 0) + (right[j] < n ? 1 / mass[right[j]] : 0);
        real u = rate(y, j), s = y[j] > 0 ? y[j] : 0;
        real depth = M(pow)((power[j] + 1) * u * u / (2 * mobility * beta[j]), 1 / (power[j] + 1)) + s;
        if (state[j] == OPEN || !(depth > 0)) continue;
        real damped = damper(depth, j) * mobility;
        fastest = largest(fastest, largest(power[j] * beta[j] * M(pow)(depth, power[j] - 1) * mobility, damped * damped));
    }
    most = 0.2L / M(sqrt)(fastest);
    return fastest > 0 ? most : INFINITY;
}

int main(void)
{
    struct rlimit limit = {SECONDS, SECONDS};
    setrlimit(RLIMIT_CPU, &limit);
    n = (int)number(); k = (int)number();
    real duration = number(), tolerance = number();
    clip = (int)number(); drag = number();
    shape = (int)number(); numbers = (int)number();
    drive = reals(numbers);
    for (int i = 0; i < numbers; i++) drive[i] = number();
    int breaks = (int)number();
    real *stop = reals(breaks);
    for (int i = 0; i < breaks; i++) stop[i] = number();
    size = 2 * k + 2 * n;
    int *to = calloc(k + 1, sizeof(int)), unsure = 0, idle = 0;
    left = calloc(k + 1, sizeof(int)); right = calloc(k + 1, sizeof(int)); state = calloc(k + 1, sizeof(int));
    sign = calloc(k + 1, sizeof(int)); doubtful = calloc(k + 1, sizeof(int));
    mass = reals(n); pull = reals(n); beta = reals(k); power = reals(k); damp = reals(k); dpower = reals(k);
    off = reals(k); resting = reals(k); unit = reals(size); deep = reals(k); y = reals(size);
    for (int i = 0; i < DEPTH + 2; i++) scratch[i] = reals(size);
    real *next = reals(size), *peak = reals(k), *crossing = reals(k), *v = y + 2 * k;
    Walk *walks = calloc(k + 1, sizeof(Walk));
    for (int i = 0; i < n; i++) { mass[i] = number(); v[i] = number(); pull[i] = number(); }
    for (int j = 0; j < k; j++) {
        left[j] = (int)number(); right[j] = (int)number();
        beta[j] = number(); power[j] = number() - 1; y[j] = -number();
        damp[j] = number(); dpower[j] = number(); off[j] = number(); resting[j] = number();
        deep[j] = number(); /* overlap that a collision of the scene can make, m: the unit */
        y[k + j] = (left[j] < n ? v[left[j]] : 0) - (right[j] < n ? v[right[j]] : 0);
        crossing[j] = NAN;
    }
    speed = number(); /* largest speed of the scene against another */
    grain = 32 * tolerance;
    for (int j = 0; j < k; j++) {
        unit[j] = deep[j];
        unit[k + j] = speed;
        state[j] = y[j] > 0 || (y[j] == 0 && rate(y, j) >= 0) ? PRESS : OPEN;
        if (y[j] > 0 && clip && damp[j] > 0 && total(y, j) <= 0) state[j] = SLACK;
        sign[j] = (rate(y, j) > grain * speed) - (rate(y, j) < -grain * speed);
        /* a contact that begins in tension opens, and its largest force is 0 */
        if (y[j] > 0 && state[j] == PRESS && total(y, j) > 0) peak[j] = total(y, j);
    }
    real fast = speed;
    for (int i = 0; i < n; i++) fast = largest(fast, M(fabs)(v[i]));
    for (int i = 0; i < n; i++) { unit[2 * k + i] = fast; unit[2 * k + n + i] = fast * duration; }
    real want = duration * 1e-6L;
    long steps = 0;
    while (now < duration) {
        real goal = duration;
        for (int i = 0; i < breaks; i++) if (stop[i] > now && stop[i] < goal) goal = stop[i];
        real h = least(want, longest_step());
        int last = h >= goal - now;
        if (last) h = goal - now;
        real error = extrapolated(h, next) / tolerance;
        real factor = error > 0 ? 0.9L * M(pow)(error, -1.0L / (2 * K - 1)) : 4;
        if (error <= 0.5L && factor < 1.5L) factor = 1.5L; /* the rest of the error is round-off, which no step makes less */
        if (factor > 4) factor = 4;
        if (!(factor > 0.2L)) factor = 0.2L;
        if (!(error <= 1) && h > ROUND * duration) { want = h * factor; continue; }
        if (++steps > 3000000) exit(3);
        real first = INFINITY;
        for (int j = 0; j < k; j++) {
            Walk *walk = walks + j;
            walk->contact = j; walk->sign = walk->first = sign[j];
            walk->count = walk->doubtful = 0; walk->definite = 0; walk->became = 0;
            walk_rate(walk, 0, y, h, next, 0);
            real when = change(walk, h, next, to + j);
            if (when == INFINITY) to[j] = -1;
            walk->definite = when; /* from here on: when it changes */
            first = least(first, when);
        }
        int changed = first < INFINITY;
        if (changed) {
            idle = first > 0 ? 0 : idle + 1;
            if (idle > 4 * k + 20) { unsure = 1; changed = 0; idle = 0; } /* a change of state that undoes itself */
        }
        if (changed) {
            last = 0;
            h = first;
            if (h > 0) extrapolated(h, next); else memcpy(next, y, sizeof(real) * size);
        }
        for (int j = 0; j < k; j++) {
            Walk *walk = walks + j;
            int had = sign[j];
            if (h > 0 && state[j] == PRESS && damp[j] > 0) search_peak(j, 0, y, h, next, peak + j, 0);
            for (int i = 0; i < walk->count && walk->turn[i].at <= h; i++) {
                Turn *turn = walk->turn + i;
                real sill = M(pow)(1e-12L, power[j] < 1 ? 2 / (power[j] + 1) : 1) * deep[j];
                had = turn->top ? -1 : 1;
                if (!turn->top) continue;
                if (state[j] == PRESS) peak[j] = largest(peak[j], turn->force);
                if (M(fabs)(turn->overlap) < 4 * grain * deep[j] && (off[j] > 0 || (damp[j] > 0 && dpower[j] == 0))) unsure |= y[j] < 0;
                if (!isnan((double)crossing[j])) continue;
                /* what is felt, and what is a motion, are thresholds: within them a crossing exists or does not */
                if (M(fabs)(turn->overlap) < largest(sill, 4 * grain * deep[j]) && turn->overlap > -4 * grain * deep[j]
                    && turn->overlap > -sill * 1e-2L && M(fabs)(turn->overlap) > 4 * ROUND * deep[j]) doubtful[j] = 1;
                if (turn->overlap > sill && turn->slowing >= 0.5L * resting[j]) {
                    if (turn->slowing < 2 * resting[j]) doubtful[j] = 1;
                    if (turn->slowing >= resting[j]) {
                        crossing[j] = now + turn->at;
                        if (duration - crossing[j] < 64 * 2.3e-16L * duration) doubtful[j] = 1;
                    }
                }
            }
            if (isnan((double)crossing[j]) && walk->doubtful && state[j] != OPEN && next[j] > 0) doubtful[j] = 1;
            if (had == 0 && walk->first == 0 && walk->became <= h && walk->sign != 0)
                had = walk->count ? (walk->turn[0].top ? 1 : -1) : walk->sign;
            sign[j] = had;
            if (state[j] == PRESS && next[j] > 0) peak[j] = largest(peak[j], total(next, j));
        }
        memcpy(y, next, sizeof(real) * size);
        now = last ? goal : now + h;
        for (int j = 0; j < k; j++) {
            if (changed && to[j] >= 0 && walks[j].definite <= h) {
                if (to[j] == OPEN || state[j] == OPEN) y[j] = 0;
                state[j] = to[j];
            }
            else settle(j);
            /* a force that jumps at touch is in the peak */
            if (state[j] == PRESS && y[j] == 0 && damp[j] > 0) peak[j] = largest(peak[j], total(y, j));
        }
        if (changed) { /* the next step starts where forces may be singular */
            want = h * 0.1L;
            if (want < 1e-9L * duration) want = 1e-9L * duration;
        }
        else if (!last || factor < 1) want = h * factor;
        else if (want < h * factor) want = h * factor;
    }
    for (int j = 0; j < k; j++) { /* a turn that comes just after the end */
        real a = -acceleration(now, y, j), u = rate(y, j);
        if (isnan((double)crossing[j]) && y[j] > 0 && u > 0 && a > 0 && u < a * 64 * 2.3e-16L * duration) doubtful[j] = 1;
    }
    for (int i = 0; i < n; i++) printf("%a ", (double)v[n + i]);
    for (int i = 0; i < n; i++) printf("%a ", (double)v[i]);
    printf("\n");
    for (int j = 0; j < k; j++) printf("%a %a %d\n", (double)peak[j], (double)crossing[j], doubtful[j]);
    printf("%d %ld\n", unsure, steps);
    return 0;
}
