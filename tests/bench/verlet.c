/* Velocity-Verlet of a free chain of Hertzian contacts in overlap variables, as one writes it by hand: what the kernels
   of the package are measured against in bench_integrators.py. Contact k is between bodies k - 1 and k; force[0] and
   force[n] stay 0, so that no body is at an end. */

#include <math.h>
#include <string.h>
#include <time.h>

static double cpu(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

/* All loops walk along whole arrays without a branch, so that compilers can make vectors of them. */
static void kick(int n, const double *restrict push, const double *restrict force, double *restrict v)
{
    for (int i = 0; i < n; i++)
        v[i] += push[i] * (force[i] - force[i + 1]);
}

static void drift(int n, double dt, const double *restrict v, double *restrict x)
{
    for (int i = 0; i < n; i++)
        x[i] += dt * v[i];
}

static void contacts(int n, double dt, const double *restrict beta, const double *restrict v,
                     double *restrict overlap, double *restrict force)
{
    for (int k = 1; k < n; k++) {
        overlap[k] += dt * (v[k - 1] - v[k]);
        double closed = overlap[k] > 0.0 ? overlap[k] : 0.0;
        force[k] = beta[k] * closed * sqrt(closed);
    }
}

/* `push` is dt / (2 m); samples velocities (samples, n) into `out`; answers the CPU time, s. */
double verlet(int n, const double *push, const double *beta, double dt, long per_sample, int samples,
              double *v, double *x, double *overlap, double *force, double *out)
{
    double began = cpu();
    contacts(n, 0.0, beta, v, overlap, force);
    for (int sample = 0; sample < samples; sample++) {
        for (long step = 0; step < per_sample; step++) {
            kick(n, push, force, v);
            drift(n, dt, v, x);
            contacts(n, dt, beta, v, overlap, force);
            kick(n, push, force, v);
        }
        memcpy(out + (long)sample * n, v, n * sizeof(double));
    }
    return cpu() - began;
}

/* The same with both half kicks between two drifts in one, but at the samples: `whole` is dt / m. */
double merged(int n, const double *push, const double *whole, const double *beta, double dt, long per_sample,
              int samples, double *v, double *x, double *overlap, double *force, double *out)
{
    double began = cpu();
    contacts(n, 0.0, beta, v, overlap, force);
    for (int sample = 0; sample < samples; sample++) {
        kick(n, push, force, v);
        for (long step = 0; step < per_sample; step++) {
            if (step > 0)
                kick(n, whole, force, v);
            drift(n, dt, v, x);
            contacts(n, dt, beta, v, overlap, force);
        }
        kick(n, push, force, v);
        memcpy(out + (long)sample * n, v, n * sizeof(double));
    }
    return cpu() - began;
}
