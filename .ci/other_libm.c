/* A libm with other last digits, for .ci/machines.py: results are right to 0.9 units in the last place, not to 0.5. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

static uint64_t seed(void)
{
    static uint64_t value;
    if (!value) {
        const char *text = getenv("DEM_BRIDGE_OTHER_LIBM");
        value = 2 * (text ? strtoull(text, 0, 10) : 1) + 1;
    }
    return value;
}

/* exact results stay; of the others those that lie 0.1 to 0.5 units from the exact value go to its other side, or not */
static double other(double near, long double exact, double x, double y)
{
    if (!isfinite(near) || fabs(near) < 1e-290 || (long double)near == exact) return near;
    double side = nextafter(near, exact > near ? INFINITY : -INFINITY);
    if (fabsl(exact - near) < 0.1L * fabsl((long double)side - near)) return near;
    uint64_t a, b;
    memcpy(&a, &x, 8);
    memcpy(&b, &y, 8);
    uint64_t hash = (a ^ (b * 0x9E3779B97F4A7C15u) ^ seed() * 0xD6E8FEB86659FD93u) * 0xBF58476D1CE4E5B9u;
    hash ^= hash >> 29;
    return hash * 0x94D049BB133111EBu >> 63 ? side : near;
}

#define ONE(f) \
    double f(double x) \
    { \
        static double (*real)(double); \
        if (!real) real = (double (*)(double))dlsym(RTLD_NEXT, #f); \
        return other(real(x), f##l(x), x, 0.0); \
    }
ONE(exp) ONE(log) ONE(sin) ONE(cos) ONE(tan) ONE(sinh) ONE(cosh) ONE(tanh) ONE(asin) ONE(acos) ONE(atan)
ONE(expm1) ONE(log1p) ONE(log2) ONE(log10) ONE(cbrt) ONE(exp2) ONE(asinh) ONE(acosh) ONE(atanh)

#define TWO(f) \
    double f(double x, double y) \
    { \
        static double (*real)(double, double); \
        if (!real) real = (double (*)(double, double))dlsym(RTLD_NEXT, #f); \
        return other(real(x, y), f##l(x, y), x, y); \
    }
TWO(pow) TWO(atan2) TWO(hypot)
