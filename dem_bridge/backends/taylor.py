"""Taylor series of a chain from contact event to contact event: the compiled core of the reference.

The force beta s^(n-1) is singular where a contact opens or closes (s = 0). With w = sqrt(s) of the contact nearest to
such a moment and the time transformation dt = w dr (a Sundman transformation; Stiefel & Scheifele 1971, *Linear and
Regular Celestial Mechanics*, for the same trick at collisions) its motion is analytic through it::

    w' = u/2    t' = w    v' = w a    s_j' = w u_j    F = beta w^(2(n-1))

with u the closing rate: w passes through 0 with a finite slope, so that openings are simple roots. All series are made
by recurrences (Jorba & Zou 2005, *Exp. Math.* 14, 99), steps follow from the decay of the last coefficients, and
events, samples and peaks are roots of the polynomials, as accurate as the rest.

Only bodies with a closed contact have series. Each component, a run of closed contacts, has a clock r and steps of its
own, because nothing outside acts on it until one of its bodies touches another: that moment is found in physical time,
and only those that it joins start anew. All other bodies coast: their flight is exact and costs nothing until a
collision. Ends of steps and touches wait in a heap. Bodies are numbered from 1; 0 and n_body + 1 are walls, at rest and
infinitely heavy.
"""

from __future__ import annotations

from heapq import heappop

import numpy as np

from dem_bridge.backends.taylor_components import Chain, Rows, coast, commit, meet, renew
from dem_bridge.backends.taylor_series import Event, Table
from dem_bridge.foundation.compiled import Floats, kernel

#: steps without an event after which the pace is examined
_PATIENCE = 500_000


@kernel()
def integrate(
    bodies: Table, contacts: Table, components: Table, times: Floats, order: int, accuracy: float, speed: float,
    most_steps: int,
) -> tuple[Floats, Floats, Floats, int, int, int]:  # fmt: skip
    """Integrate a chain through ``times`` (s; the first is 0) by Taylor series.

    Returns displacement and velocity ``(n_t, n_body)``, force ``(n_t, n_contact)``, steps, openings and closings.
    Largest overlaps and crossing times are in ``contacts``.

    ``bodies``: all bodies with a wall at either end, at time 0; ``contacts`` between them; room
    for as many ``components``. After ``most_steps``, or
    where their coefficients are beyond doubles, it gives up, and velocities are nan.
    """
    n, k, end = len(bodies) - 2, len(contacts), times[-1]
    series = np.empty((8, n + 2, order + 1))
    lowest, highest = 0 if contacts[0].column >= 0 else 1, n if contacts[n].column >= 0 else n - 1
    chain = Chain(bodies, contacts, components, series, end, lowest, highest, speed, accuracy)
    x, v = np.zeros((len(times), n)), np.zeros((len(times), n))
    rows = Rows(times, x, v, np.zeros((len(times), highest + 1 - lowest)))
    heap = [(np.inf, 0, 0)]
    time, now, opened, closed, idle, since, patience = 0.0, 0.0, 0, 0, 0, 0.0, min(_PATIENCE, most_steps)
    made = renew(lowest, highest, now, chain, heap)
    steps = made
    while made >= 0 and steps < most_steps:
        time, number, stamp = heappop(heap)
        if not time < end:
            break
        if (contacts[number].stamp if number < k else components[number - k].stamp) != stamp:
            continue
        now, idle, former = time, idle + 1, opened + closed
        if idle == patience and (now - since) * most_steps < (end - now) * patience:
            break  # at this pace the end is beyond reach
        if number < k:
            joins, (first, last) = number, meet(number, now, chain, rows)
            closed += not contacts[number].felt
        else:
            first = number - k
            last, event, joins = components[first].last, components[first].event, components[first].which
            commit(first, now, chain, rows)
            if event == Event.OPENS:
                contacts[joins].shut, contacts[joins].s = False, 0.0
                opened += 1
            elif event == Event.CLOSES:
                contacts[joins].s = 0.0
            elif event == Event.FELT:
                contacts[joins].s = max(contacts[joins].s, contacts[joins].touch)
        # contacts that fade out together with another one: too weak to be felt, and opening or at rest, where dt = w dr
        # would stand still
        for j in range(first, last + 1):
            fades = contacts[j].shut and j != joins and contacts[j].s < contacts[j].touch
            if fades and bodies[j].v <= bodies[j + 1].v:
                contacts[j].shut = False
                opened += 1
        if opened + closed > former:
            idle, since = 0, now
        made = renew(first, last, now, chain, heap)
        steps += made
    for i in range(n + 2):
        if bodies[i].owner < 0:
            coast(i, end, chain, rows)
        elif bodies[i].owner == i:
            commit(i, end, chain, rows)
    if time < end:
        v[:] = np.nan
    return x, v, rows.force, steps, opened, closed
