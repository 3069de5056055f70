"""The fixed-step kernel of :mod:`.blanes_moan`: drifts and kicks of any splitting method, in overlap variables.

A splitting method is two lists of fractions of the step: bodies are kicked by ``kicks[0]``, then drift by ``drifts[j]``
and are kicked by ``kicks[j + 1]``, for each j. The last kick has the force of the end of the step, where the next step
begins: one evaluation of the forces for each drift.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dem_bridge.backends.curves import curve_force


@njit(cache=True, nogil=True)
def integrate(  # type: ignore[no-untyped-def]
    mass,
    velocity,
    left,
    right,
    links,
    stiffness,
    exponent,
    gap,
    weight,
    drifts,
    kicks,
    dt,
    dense_steps,
    curves,
):
    """Velocity, displacement, acceleration ``(n_dense, n_body + 1)`` (last column: the walls, 0), overlap and force
    ``(n_dense, n_contact)`` at ``dense_steps``. The first ``links`` contacts are those of the chain; ``weight
    (n_body,)`` is the constant force on each body, N. With n = 5/2 the force is ``beta s sqrt(s)``, as in the twin.
    """
    n_body, n_contact, n_dense = mass.shape[0], left.shape[0], dense_steps.shape[0]
    curved, hertz = curves.law.shape[0] > 0, np.all(exponent == 2.5)
    v = np.zeros(n_body + 1)
    v[:n_body] = velocity
    x = np.zeros(n_body + 1)
    overlap = -gap
    force = np.zeros(n_contact)
    net = np.zeros(n_body + 1)
    inverse = np.zeros(n_body + 1)
    inverse[:n_body] = 1.0 / mass
    out_v = np.zeros((n_dense, n_body + 1))
    out_x = np.zeros((n_dense, n_body + 1))
    out_a = np.zeros((n_dense, n_body + 1))
    out_overlap = np.zeros((n_dense, n_contact))
    out_force = np.zeros((n_dense, n_contact))
    step, row, stages = 0, 0, len(drifts)
    while True:
        for stage in range(-1 if step == 0 else 0, stages):
            if stage == 0:
                for i in range(n_body):
                    v[i] += dt * kicks[0] * inverse[i] * net[i]
            if stage >= 0:
                drift = dt * drifts[stage]
                for i in range(n_body):
                    x[i] += drift * v[i]
                for k in range(links):
                    overlap[k] += drift * (v[k] - v[k + 1])
                for k in range(links, n_contact):
                    overlap[k] += drift * (v[left[k]] - v[right[k]])
            if curved:
                for k in range(n_contact):
                    force[k] = curve_force(k, overlap[k], curves) if overlap[k] > 0.0 else 0.0
            elif hertz:
                for k in range(n_contact):
                    closed = max(overlap[k], 0.0)
                    force[k] = stiffness[k] * closed * np.sqrt(closed)
            else:
                for k in range(n_contact):
                    closed = max(overlap[k], 0.0)
                    force[k] = stiffness[k] * closed ** (exponent[k] - 1.0)
            for i in range(n_body):
                net[i] = weight[i]
            for k in range(links):
                net[k] -= force[k]
                net[k + 1] += force[k]
            for k in range(links, n_contact):
                net[left[k]] -= force[k]
                net[right[k]] += force[k]
            if stage >= 0:
                for i in range(n_body):
                    v[i] += dt * kicks[stage + 1] * inverse[i] * net[i]
            else:
                break
        if step == dense_steps[row]:
            out_v[row] = v
            out_x[row] = x
            out_overlap[row] = overlap
            out_force[row] = force
            for i in range(n_body):
                out_a[row, i] = net[i] * inverse[i]
            row += 1
            if row == n_dense:
                return out_v, out_x, out_a, out_overlap, out_force
        step += 1
