/* Second truth for random scenes with every feature: no code and no method of truth_any.c.
 *
 * A whole step is solved at once: closing rates, overlaps and velocities at Gauss-Legendre nodes, by Picard's iteration of
 * the integral equation (collocation). Steps are as long as the last terms of all Legendre series vanish, which makes them
 * short near the powers of an overlap that vanishes; they end at touches and openings, whose time is found by Newton's
 * method on the length of the step. Closing rates and overlaps are Legendre series; the zeros of closing
 * rates are isolated by bisection with proven bounds, those of the Taylor polynomial of each interval, so that none is missed.
 *
 * Input and output are those of truth_any.c; in place of the tolerance stands the number of nodes.
 *
 *     cc -O2 -o truth_again truth_again.c -lm                    x87 long double
 *     cc -O2 -DQUAD -o truth_again truth_again.c -lquadmath -lm  binary128
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#ifdef QUAD
#include <quadmath.h>
typedef __float128 num;
#define FN(name) name##q
#define EPSILON 1.93e-34Q
#define NUMBER(word) strtoflt128(word, NULL)
#define FULL_TURN (2 * M_PIq)
#else
typedef long double num;
#define FN(name) name##l
#define EPSILON 1.09e-19L
#define NUMBER(word) strtold(word, NULL)
#define FULL_TURN 6.28318530717958647692528676655900577L
#endif
#ifndef SECONDS
#define SECONDS 20
#endif

enum { MOST = 48, GRID = 64, APART, TOUCHING, FORCELESS };

/* a contact: its law, its state at the start of the step, and its motion during the step */
typedef struct {
    int left, right, state, heading, unsure, tops, changing;
    num stiff, power, damp, damp_power, pull_off, rest, deep, overlap, closing, peak, crossing, noise, largest, range, ripple;
    num s[MOST], r[MOST], end_s, end_r, series_s[MOST + 2], series_r[MOST + 2];
    num when, top[64]; /* place of its change of state in the step, and of its maxima and minima */
    int rising[64];
} Contact;
/* a body; load: the sum of the sizes of its accelerations in the step, whose round-off stays where they cancel */
typedef struct { num mass, free, speed, place, load, v[MOST], g[MOST], end_v, end_x; } Body;

static int bodies, contacts, nodes, clip, shape, count;
static num node[MOST], weight[MOST], upto[MOST][MOST], coefficient[MOST][MOST], course[MOST];
static num drag, drive[4096], duration, start, scale;
static Contact *c;
static Body *b;

static num absolute(num a) { return a < 0 ? -a : a; }
static num max2(num a, num o) { return a > o ? a : o; }

static num legendre(int l, num x)
{
    num p0 = 1, p1 = x;
    if (l == 0) return 1;
    for (int i = 2; i <= l; i++) { num p = ((2 * i - 1) * x * p1 - (i - 1) * p0) / i; p0 = p1; p1 = p; }
    return p1;
}

static num passed(num x) { return (1 + x) / 2; }

/* what the accelerations in a step of length h would change a closing rate by, were they all of one sign */
static num range(const Contact *j, num h)
{
    return h * ((j->left < bodies ? b[j->left].load : 0) + (j->right < bodies ? b[j->right].load : 0));
}

static void prepare(void)
{
    for (int m = 0; m < nodes; m++) {
        num x = FN(cos)(FULL_TURN / 2 * (nodes - m - (num)0.25) / (nodes + (num)0.5)), slope = 1;
        for (int i = 0; i < 100; i++) {
            num p = legendre(nodes, x);
            slope = nodes * (x * p - legendre(nodes - 1, x)) / (x * x - 1);
            x -= p / slope;
            if (absolute(p / slope) < 2 * EPSILON) break;
        }
        node[m] = x;
        weight[m] = 2 / ((1 - x * x) * slope * slope);
        course[m] = passed(x);
    }
    for (int l = 0; l < nodes; l++)
        for (int m = 0; m < nodes; m++) coefficient[l][m] = (2 * l + 1) * weight[m] * legendre(l, node[m]) / 2;
    for (int i = 0; i < nodes; i++)
        for (int m = 0; m < nodes; m++) {
            num sum = coefficient[0][m] * (1 + node[i]);
            for (int l = 1; l < nodes; l++)
                sum += coefficient[l][m] * (legendre(l + 1, node[i]) - legendre(l - 1, node[i])) / (2 * l + 1);
            upto[i][m] = sum;
        }
}

/* Legendre series of the integral of values at the nodes, from -1, plus a constant; returns the last terms' size */
static num integrated(const num *values, num constant, num *series)
{
    num terms[MOST] = {0};
    for (int l = 0; l < nodes; l++) {
        terms[l] = 0;
        for (int m = 0; m < nodes; m++) terms[l] += coefficient[l][m] * values[m];
    }
    for (int l = 0; l <= nodes; l++) series[l] = 0;
    series[0] = constant + terms[0];
    series[1] = terms[0];
    for (int l = 1; l < nodes; l++) {
        series[l + 1] += terms[l] / (2 * l + 1);
        series[l - 1] -= terms[l] / (2 * l + 1);
    }
    return (absolute(terms[nodes - 1]) + absolute(terms[nodes - 2]) + absolute(terms[nodes - 3])) / nodes;
}

static num at(const num *series, num x, num *slope)
{
    num p0 = 1, p1 = x, d0 = 0, d1 = 1, sum = series[0] + series[1] * x, rise = series[1];
    for (int l = 2; l <= nodes; l++) {
        num p = ((2 * l - 1) * x * p1 - (l - 1) * p0) / l, d = d0 + (2 * l - 1) * p1;
        p0 = p1; p1 = p; d0 = d1; d1 = d;
        sum += series[l] * p;
        rise += series[l] * d;
    }
    if (slope) *slope = rise;
    return sum;
}

static num outer(num t)
{
    if (shape == 0) return 0;
    if (shape == 2) {
        int last = count - 2, cell = (int)(t / drive[0]);
        if (cell > last - 1) cell = last - 1;
        num part = t / drive[0] - cell;
        return (1 - part) * drive[1 + cell] + part * drive[2 + cell];
    }
    num cycles = drive[1] * t, sweep = drive[3], envelope = 1;
    if (sweep > 0) cycles += (drive[2] - drive[1]) * (t < sweep ? t * t / (2 * sweep) : t - sweep / 2);
    if (t < drive[5]) envelope = (1 - FN(cos)(FULL_TURN * t / (2 * drive[5]))) / 2;
    return drive[0] * envelope * FN(sin)(FULL_TURN * cycles + drive[4]);
}

static num force(const Contact *j, num s, num r)
{
    num f = -j->pull_off;
    if (s > 0) f += j->stiff * FN(pow)(s, j->power);
    if (j->damp > 0) f += j->damp * r * (j->damp_power == 0 ? 1 : s > 0 ? FN(pow)(s, j->damp_power) : 0);
    return f;
}

/* the net force, 0 where it is the round-off of its parts */
static num clear_force(const Contact *j, num s, num r)
{
    num f = force(j, s, r);
    return absolute(f) > 256 * EPSILON * force(j, s, absolute(r)) ? f : 0;
}

/* Solve a step of length h; return whether it is solved, and in `rounds` in how many rounds. */
static int solve(num h, int *rounds)
{
    num before = INFINITY;
    for (int q = 0; q < contacts; q++)
        for (int m = 0; m < nodes; m++) { c[q].r[m] = c[q].closing; c[q].s[m] = c[q].overlap + c[q].closing * h * course[m]; }
    for (int i = 0; i < bodies; i++) for (int m = 0; m < nodes; m++) b[i].v[m] = b[i].speed;
    for (*rounds = 1; *rounds <= 60; ++*rounds) {
        num change = 0;
        for (int i = 0; i < bodies; i++) {
            b[i].load = 0;
            for (int m = 0; m < nodes; m++) {
                b[i].g[m] = b[i].free + (i == 0 && shape ? outer(start + h * course[m]) / b[0].mass : 0);
                b[i].load = max2(b[i].load, absolute(b[i].g[m]) + drag * absolute(b[i].v[m]));
            }
        }
        for (int q = 0; q < contacts; q++) {
            num most = 0;
            for (int m = 0; m < nodes; m++) {
                num f = c[q].state == TOUCHING ? force(c + q, c[q].s[m], c[q].r[m]) : 0;
                most = max2(most, absolute(f));
                if (c[q].left < bodies) b[c[q].left].g[m] -= f / b[c[q].left].mass;
                if (c[q].right < bodies) b[c[q].right].g[m] += f / b[c[q].right].mass;
            }
            if (c[q].left < bodies) b[c[q].left].load += most / b[c[q].left].mass;
            if (c[q].right < bodies) b[c[q].right].load += most / b[c[q].right].mass;
        }
        for (int q = 0; q < contacts; q++) {
            Contact *j = c + q;
            num g[MOST], way[MOST], most = absolute(j->closing) + range(j, h);
            for (int m = 0; m < nodes; m++) {
                num a = (j->left < bodies ? b[j->left].g[m] : 0) - (j->right < bodies ? b[j->right].g[m] : 0);
                g[m] = (a - drag * j->r[m]) * h / 2;
            }
            for (int i = 0; i < nodes; i++) {
                num r = j->closing;
                for (int m = 0; m < nodes; m++) r += upto[i][m] * g[m];
                most = max2(most, absolute(r));
                num moved = absolute(r - j->r[i]);
                if (!(moved <= change * (scale * (num)1e-6 + most))) change = moved / (scale * (num)1e-6 + most);
                j->r[i] = r;
            }
            for (int m = 0; m < nodes; m++) way[m] = j->r[m] * h / 2;
            for (int i = 0; i < nodes; i++) {
                j->s[i] = j->overlap;
                for (int m = 0; m < nodes; m++) j->s[i] += upto[i][m] * way[m];
            }
        }
        for (int i = 0; i < bodies; i++) {
            num g[MOST];
            for (int m = 0; m < nodes; m++) g[m] = (b[i].g[m] - drag * b[i].v[m]) * h / 2;
            for (int o = 0; o < nodes; o++) {
                num v = b[i].speed;
                for (int m = 0; m < nodes; m++) v += upto[o][m] * g[m];
                num most = scale + absolute(v) + h * b[i].load;
                if (!(absolute(v - b[i].v[o]) <= change * most)) change = absolute(v - b[i].v[o]) / most;
                b[i].v[o] = v;
            }
        }
        if (!(change < INFINITY)) return 0;
        if (change <= 16 * EPSILON || (change <= 4096 * EPSILON && change >= before)) return 1;
        before = change;
    }
    return 0;
}

/* Series and ends of all motions of a solved step; return the size of the last terms against the largest speed and the
 * round-off of the accelerations. */
static num closed(num h)
{
    num tail = 0;
    for (int q = 0; q < contacts; q++) {
        Contact *j = c + q;
        num g[MOST];
        for (int m = 0; m < nodes; m++) {
            num l = j->left < bodies ? b[j->left].g[m] : 0, r = j->right < bodies ? b[j->right].g[m] : 0;
            g[m] = (l - r - drag * j->r[m]) * h / 2;
        }
        j->range = range(j, h);
        j->ripple = integrated(g, j->closing, j->series_r);
        tail = max2(tail, j->ripple / (scale + j->range / 16));
        for (int m = 0; m < nodes; m++) g[m] = j->r[m] * h / 2;
        integrated(g, j->overlap, j->series_s);
        j->end_r = at(j->series_r, 1, NULL);
        j->end_s = at(j->series_s, 1, NULL);
    }
    for (int i = 0; i < bodies; i++) {
        num series[MOST + 2], g[MOST];
        for (int m = 0; m < nodes; m++) g[m] = (b[i].g[m] - drag * b[i].v[m]) * h / 2;
        tail = max2(tail, integrated(g, b[i].speed, series) / (scale + h * b[i].load / 16));
        b[i].end_v = at(series, 1, NULL);
        b[i].end_x = b[i].place;
        for (int m = 0; m < nodes; m++) b[i].end_x += weight[m] * b[i].v[m] * h / 2;
    }
    return tail;
}

/* the zero of a series that is positive or negative at the lower end, whatever its round-off there */
static num bisected(const num *series, num low, num high, int positive)
{
    for (int i = 0; i < 200; i++) {
        num middle = (low + high) / 2;
        if (!(middle > low && middle < high)) break;
        if ((at(series, middle, NULL) > 0) == positive) low = middle; else high = middle;
    }
    return high;
}

/* Taylor polynomial of a series about the middle of an interval, in units of half its length */
static void taylor(const num *series, num middle, num half, num *terms)
{
    static num p[MOST + 2][MOST + 2]; /* p[l][k]: k-th coefficient of P_l */
    for (int l = 0; l <= nodes; l++) {
        p[l][0] = l == 0 ? 1 : l == 1 ? middle : ((2 * l - 1) * middle * p[l - 1][0] - (l - 1) * p[l - 2][0]) / l;
        for (int k = 1; k <= l; k++) p[l][k] = (l - 2 >= k ? p[l - 2][k] : 0) + (2 * l - 1) * half / k * p[l - 1][k - 1];
    }
    for (int k = 0; k <= nodes; k++) {
        terms[k] = 0;
        for (int l = k; l <= nodes; l++) terms[k] += series[l] * p[l][k];
    }
}

/* Find the zeros of the closing rate in order. `last`: where its sign was sure last; `heading`: that sign. */
static void isolate(Contact *j, num low, num high, num *last, int *heading, int depth)
{
    num middle = (low + high) / 2, terms[MOST + 2], others = 0, bend = 0;
    taylor(j->series_r, middle, (high - low) / 2, terms);
    num value = terms[0];
    for (int k = 1; k <= nodes; k++) others += absolute(terms[k]);
    for (int k = 2; k <= nodes; k++) bend += k * absolute(terms[k]);
    if (absolute(value) + others <= j->noise) return;
    int none = absolute(value) > j->noise + others, monotone = absolute(terms[1]) > bend;
    num probe[2] = {none ? middle : low, none ? middle : high};
    if (!none && !monotone && depth < 40) {
        isolate(j, low, middle, last, heading, depth + 1);
        isolate(j, middle, high, last, heading, depth + 1);
        return;
    }
    if (!none && !monotone && low > -1 && high < 1 && absolute(value) <= 4 * j->noise && j->range > 1000 * j->noise) j->changing = 1;
    for (int side = 0; side < (none ? 1 : 2); side++) {
        num r = at(j->series_r, probe[side], NULL);
        int sign = r > j->noise ? 1 : r < -j->noise ? -1 : 0;
        if (sign == 0) continue;
        if (*heading == -sign && j->tops < 64) {
            int real_change = (at(j->series_r, *last, NULL) > 0) != (r > 0);
            j->rising[j->tops] = sign > 0;
            j->top[j->tops++] = real_change ? bisected(j->series_r, *last, probe[side], sign < 0) : *last;
        }
        *heading = sign;
        *last = none ? high : probe[side];
    }
}

/* the first place where a net force that should keep its sign loses it, between two places; 2: nowhere */
static num force_change(const Contact *j, num low, num high, int positive)
{
    num old = low, f_old = 0;
    for (int i = 1; i <= GRID; i++) {
        num x = low + (high - low) * i / GRID, f = clear_force(j, at(j->series_s, x, NULL), at(j->series_r, x, NULL));
        if (positive ? f < 0 : f > 0) {
            num from = old;
            if (i == 1 && (positive ? f_old < 0 : f_old > 0)) return low;
            for (int o = 0; o < 150; o++) {
                num middle = (from + x) / 2, g = clear_force(j, at(j->series_s, middle, NULL), at(j->series_r, middle, NULL));
                if (!(middle > from && middle < x)) break;
                if (positive ? g < 0 : g > 0) x = middle; else from = middle;
            }
            return x;
        }
        old = x;
        f_old = f;
    }
    return 2;
}

/* the first place in the step where the state of a contact ends; 2: none */
static num state_ends(Contact *j, int *next)
{
    num last = -1, before = -1, old = j->overlap;
    int heading = j->heading;
    j->tops = j->changing = 0;
    isolate(j, -1, 1, &last, &heading, 0);
    for (int i = 0; i <= j->tops; i++) {
        num x = i < j->tops ? j->top[i] : 1, s = i < j->tops ? at(j->series_s, x, NULL) : j->end_s, found = 2;
        if (j->state == APART ? s > 0 : s < 0) {
            found = (j->state == APART ? old >= 0 : old <= 0) ? before : bisected(j->series_s, before, x, j->state != APART);
            *next = j->state == APART ? TOUCHING : APART;
        }
        if (clip && j->damp > 0 && j->state != APART) {
            num sooner = force_change(j, before, found < 2 ? found : x, j->state == TOUCHING);
            /* a force vanishes at touch without a change of its sign */
            if (sooner < 2 && sooner < found && (j->state == FORCELESS || sooner > -1)) { *next = j->state == TOUCHING ? FORCELESS : TOUCHING; return sooner; }
        }
        if (found < 2) return found;
        before = x;
        old = s;
    }
    return 2;
}

static void keep_peak(Contact *j, num x)
{
    num s = at(j->series_s, x, NULL), f = force(j, s, at(j->series_r, x, NULL));
    if (s >= 0 || j->overlap >= 0) j->peak = max2(j->peak, f);
}

/* Take what the step tells of a contact's largest force and first largest overlap. */
static void record(Contact *j, num h)
{
    num sill = FN(pow)((num)1e-12, j->power < 1 ? 2 / (j->power + 1) : 1) * j->deep;
    if (j->state == TOUCHING) {
        for (int i = 0; i < j->tops; i++) keep_peak(j, j->top[i]);
        keep_peak(j, 1);
        num grid[GRID + 1];
        for (int i = 0; j->damp > 0 && i <= GRID; i++) {
            num x = -1 + (num)2 * i / GRID;
            grid[i] = force(j, at(j->series_s, x, NULL), at(j->series_r, x, NULL));
        }
        for (int i = 1; j->damp > 0 && i < GRID; i++) {
            num low = -1 + (num)2 * (i - 1) / GRID, high = -1 + (num)2 * (i + 1) / GRID, golden = (num)0.61803398874989484820;
            if (grid[i] < grid[i - 1] || grid[i] < grid[i + 1] || grid[i] < j->peak * (num)0.99) continue;
            for (int o = 0; o < 70; o++) {
                num u = high - golden * (high - low), w = low + golden * (high - low);
                num fu = force(j, at(j->series_s, u, NULL), at(j->series_r, u, NULL));
                if (fu > force(j, at(j->series_s, w, NULL), at(j->series_r, w, NULL))) high = w; else low = u;
            }
            keep_peak(j, (low + high) / 2);
        }
    }
    for (int i = 0; i < j->tops && isnan((double)j->crossing); i++) {
        num x = j->top[i], s = at(j->series_s, x, NULL), slope, when = start + h * passed(x);
        if (j->rising[i]) continue;
        at(j->series_r, x, &slope);
        num slowing = -2 * slope / h, felt = 1024 * EPSILON * j->deep;
        if ((absolute(s) < sill && s > -sill / 100 && absolute(s) > felt / 64) || (absolute(s) < felt && absolute(s) > 4 * EPSILON * j->deep)) j->unsure = 1;
        if (s <= sill) continue;
        if (slowing > j->rest / 2 && slowing < 2 * j->rest) j->unsure = 1;
        if (slowing < j->rest) continue;
        j->crossing = when;
        if (duration - when < 64 * (num)2.3e-16 * duration) j->unsure = 1;
    }
    if (j->changing && isnan((double)j->crossing) && j->end_s > 0 && j->state != APART) j->unsure = 1;
}

static num read_number(void)
{
    char word[128];
    if (scanf("%127s", word) != 1) exit(2);
    return NUMBER(word);
}

static void read_scene(num *stops, int *stop_count)
{
    bodies = (int)read_number(); contacts = (int)read_number();
    duration = read_number(); nodes = (int)read_number();
    clip = (int)read_number(); drag = read_number(); shape = (int)read_number(); count = (int)read_number();
    if (count > 4096 || nodes > MOST) exit(2);
    for (int i = 0; i < count; i++) drive[i] = read_number();
    *stop_count = (int)read_number();
    for (int i = 0; i < *stop_count; i++) { num stop = read_number(); if (i < 4096) stops[i] = stop; }
    b = calloc(bodies + 1, sizeof(Body)); c = calloc(contacts + 1, sizeof(Contact));
    for (int i = 0; i < bodies; i++) { b[i].mass = read_number(); b[i].speed = read_number(); b[i].free = read_number(); }
    for (int q = 0; q < contacts; q++) {
        Contact *j = c + q;
        j->left = (int)read_number(); j->right = (int)read_number();
        j->stiff = read_number(); j->power = read_number() - 1; j->overlap = -read_number();
        j->damp = read_number(); j->damp_power = read_number(); j->pull_off = read_number(); j->rest = read_number();
        j->deep = read_number();
        j->closing = (j->left < bodies ? b[j->left].speed : 0) - (j->right < bodies ? b[j->right].speed : 0);
        j->crossing = NAN;
        j->heading = (j->closing > 0) - (j->closing < 0);
        j->state = j->overlap > 0 || (j->overlap == 0 && j->closing >= 0) ? TOUCHING : APART;
        num f = force(j, j->overlap, j->closing);
        if (j->overlap > 0 && clip && j->damp > 0 && f <= 0) j->state = FORCELESS;
        if (j->state == TOUCHING && (j->overlap > 0 || j->damp > 0) && f > 0) j->peak = f;
    }
    scale = read_number();
}

int main(void)
{
    struct rlimit limit = {SECONDS, SECONDS};
    setrlimit(RLIMIT_CPU, &limit);
    static num stops[4096];
    int stop_count, idle = 0, all_unsure = 0, rounds;
    long steps = 0;
    read_scene(stops, &stop_count);
    prepare();
    num wanted = duration / 256;
    while (start < duration) {
        num goal = duration, h;
        for (int i = 0; i < stop_count && i < 4096; i++) if (stops[i] > start && stops[i] < goal) goal = stops[i];
        h = wanted < goal - start ? wanted : goal - start;
        int last = h == goal - start, who = -1, next = 0, refined = 0;
        num tail = 0;
        for (;;) { /* the step ends at the first change of a state */
            if (++steps > 400000) exit(3);
            int solved = solve(h, &rounds);
            tail = closed(h) / (64 * EPSILON);
            if (!solved || !(tail <= 1)) {
                if (h <= EPSILON * duration * (num)1e-6) break;
                h /= tail > 1e6 ? 4 : 2;
                last = refined = 0; who = -1; wanted = h;
                continue;
            }
            if (who >= 0 && refined < 40) { /* Newton's method for the end of the state, from the solved step */
                Contact *j = c + who;
                num wrong = next == FORCELESS || (next == TOUCHING && j->state == FORCELESS) ? 0 : j->end_s;
                num step = j->end_r != 0 ? wrong / j->end_r : 0;
                if (absolute(step) > 2 * EPSILON * h && absolute(step) < h / 5) { h -= step; refined++; continue; }
            }
            num first = 2;
            int found = -1, then = 0;
            for (int q = 0; q < contacts; q++) {
                int to = 0;
                /* near a touch the closing rate is a power; its series, cut off, swings about it by some last terms */
                c[q].noise = 64 * EPSILON * (c[q].largest + c[q].range) + nodes * c[q].ripple;
                num x = state_ends(c + q, &to);
                c[q].when = x;
                if (q == who && x < 2 && passed(x) > (num)0.999999) continue;
                if (x < first) { first = x; found = q; then = to; }
            }
            if (found < 0 || passed(first) >= 1) {
                if (found >= 0 && who < 0) { who = found; next = then; }
                break;
            }
            if (refined >= 40 || idle > 4 * contacts + 20) { all_unsure |= idle > 4 * contacts + 20; break; }
            who = found; next = then; last = 0;
            h *= passed(first);
            if (h <= 0) { h = 0; break; }
        }
        if (h > 0) {
            idle = 0;
            for (int q = 0; q < contacts; q++) {
                Contact *j = c + q;
                int heading = j->heading;
                record(j, h);
                for (int i = 0; i < j->tops; i++) heading = j->rising[i] ? 1 : -1;
                if (heading == 0 && absolute(j->end_r) > j->noise) heading = j->end_r > 0 ? 1 : -1;
                j->heading = heading;
                j->largest = max2(j->largest, max2(absolute(j->closing), absolute(j->end_r)));
                j->overlap = j->end_s; j->closing = j->end_r;
            }
            for (int i = 0; i < bodies; i++) { b[i].speed = b[i].end_v; b[i].place = b[i].end_x; }
            start = last ? goal : start + h;
        }
        else idle++;
        for (int q = 0; q < contacts; q++) {
            Contact *j = c + q;
            int old = j->state;
            if (q == who) { j->state = next; if (old == APART || next == APART) j->overlap = 0; }
            else if (j->state == APART && (j->overlap > 0 || (j->overlap == 0 && j->closing > 0))) j->state = TOUCHING;
            else if (j->state != APART && (j->overlap < 0 || (j->overlap == 0 && j->closing < 0))) j->state = APART;
            else if (clip && j->damp > 0 && j->state != APART && j->overlap > 0) {
                num f = clear_force(j, j->overlap, j->closing);
                if (f != 0) j->state = f > 0 ? TOUCHING : FORCELESS;
            }
            if (j->state == TOUCHING && old != TOUCHING && j->damp > 0) j->peak = max2(j->peak, force(j, j->overlap, j->closing));
        }
        /* forces may be singular where a state has changed */
        if (who >= 0) wanted /= 1000;
        else if (h >= wanted * (num)0.9) wanted *= rounds > 20 ? 1 : tail < 1e-6 ? 3 : tail < 1e-2 ? (num)1.5 : 1;
    }
    for (int q = 0; q < contacts; q++) {
        num a = 0;
        Contact *j = c + q;
        for (int o = 0; o < contacts; o++) {
            num push = c[o].state == TOUCHING ? force(c + o, c[o].overlap, c[o].closing) : 0;
            for (int side = 0; side < 2; side++) {
                int body = side ? j->right : j->left;
                if (body >= bodies) continue;
                num sign = side ? -1 : 1;
                if (c[o].left == body) a -= sign * push / b[body].mass;
                if (c[o].right == body) a += sign * push / b[body].mass;
            }
        }
        if (isnan((double)j->crossing) && j->overlap > 0 && j->closing > 0 && a < 0 && j->closing < -a * 64 * (num)2.3e-16 * duration) j->unsure = 1;
    }
    for (int i = 0; i < bodies; i++) printf("%a ", (double)b[i].place);
    for (int i = 0; i < bodies; i++) printf("%a ", (double)b[i].speed);
    printf("\n");
    for (int q = 0; q < contacts; q++) printf("%a %a %d\n", (double)c[q].peak, (double)c[q].crossing, c[q].unsure);
    printf("%d %ld\n", all_unsure, steps);
    return 0;
}
