"""Dormand & Prince's 5(4) pair with the step control of MATLAB's ode45, compiled for chains of contacts.

Dormand & Prince 1980 (*J. Comput. Appl. Math.* 6, 19) for the pair, Shampine & Reichelt 1997 (*SIAM J. Sci. Comput.*
18, 1) for the control and the continuous extension. State: displacement and velocity of each body, straight through
the contacts. Peaks and crossings come from the continuous extension of each step.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.foundation.compiled import Floats, Ints, kernel

#: weights of the earlier stages in each stage; the last row is the step itself (order 5)
STAGES = np.array(
    [
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
#: order 5 minus order 4
ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
#: continuous extension (order 4): weight of stage i at fraction s of the step is sum_j EXTENSION[i, j] s^(j+1)
EXTENSION = np.array(
    [
        [1, -183 / 64, 37 / 12, -145 / 128],
        [0, 0, 0, 0],
        [0, 1500 / 371, -1000 / 159, 1000 / 371],
        [0, -125 / 32, 125 / 12, -375 / 64],
        [0, 9477 / 3392, -729 / 106, 25515 / 6784],
        [0, -11 / 7, 11 / 3, -55 / 28],
        [0, 3 / 2, -4, 5 / 2],
    ]
)

#: the first compressions ahead of a front are up to 2.2 times the step's error estimate, the collisions of the paper's
#: chains from 4.5e3 (at the default tolerances) to 1e11 times
SEEN = 100.0

#: of the inverse frequency of a contact, or of the time in which its bodies would turn back by themselves
WARY = 0.5
#: of the absolute tolerance: contacts less deep are passed over (with n < 2 they are the briefer the less deep)
UNFELT = 1e-6

#: left and right body, stiffness, exponent and gap of each contact
Contacts = tuple[Ints, Ints, Floats, Floats, Floats]
#: how a run ended
FINISHED, STEP_TOO_SMALL, TOO_MANY_STEPS = 0, 1, 2


@kernel()
def integrate(
    mass: Floats, velocity: Floats, contacts: Contacts, free: Floats, times: Floats, rtol: float, atol: Floats,
    most_steps: int, share: float, wary: bool,
) -> tuple[Floats, Floats, Floats, Floats, Floats, int, int, int, float]:  # fmt: skip
    """Integrate a chain, and return what a trajectory has, with the numbers of steps and how it ended.

    The results are displacement, velocity ``(n_t, n_body)`` and force ``(n_t, n_contact)`` at ``times`` (s; the first
    0, the last the end), largest force and first crossing ``(n_contact,)``, accepted and failed steps, how and when it
    ended.

    ``contacts``: bodies on the left and right of each contact (``n_body``: a wall), stiffness, exponent and gap. ``atol
    (2 n_body,)``: absolute tolerance of displacements (m), then of velocities (m/s). No step is longer than ``share``
    of the whole time (MATLAB: a tenth), and if ``wary`` (MATLAB: not) none passes over a contact that is foreseen: none
    of its stages might fall into it.
    """
    n, n_contact, n_t, end = mass.shape[0], contacts[0].shape[0], times.shape[0], times[-1]
    out = np.zeros((n_t, 2 * n))
    out_force = np.zeros((n_t, n_contact))
    peak, crossing = np.zeros(n_contact), np.full(n_contact, np.nan)
    f = np.zeros((7, 2 * n))
    threshold = atol / rtol
    y, stage, new, doubt = np.zeros(2 * n), np.zeros(2 * n), np.zeros(2 * n), np.zeros(2 * n)
    extension = np.zeros((4, 2 * n))
    y[n:] = velocity
    _slope(y, f[0], mass, contacts, free)
    out[0] = y
    _forces(y, out_force[0], peak, contacts)
    t, row, accepted, failed, ended = 0.0, 1, 0, 0, FINISHED
    longest = share * end
    rate = 0.0
    for i in range(2 * n):
        rate = max(rate, abs(f[0, i]) / max(abs(y[i]), threshold[i]))
    rate /= 0.8 * rtol**0.2
    size = longest
    if size * rate > 1.0:
        size = 1.0 / rate
    size = max(size, 16.0 * np.spacing(t))
    done = False
    while not done:
        smallest = 16.0 * np.spacing(t)
        size = min(longest, max(smallest, size))
        if wary:
            size = min(size, max(smallest, _clear(y, f[0], mass, contacts, atol)))
        h = size
        if 1.1 * size >= end - t:  # stretched, so that no sliver is left
            h = size = end - t
            done = True
        first_try = True
        while True:
            for k in range(6):
                for i in range(2 * n):
                    increment = 0.0
                    for j in range(k + 1):
                        increment += STAGES[k, j] * f[j, i]
                    stage[i] = y[i] + h * increment
                if k == 5:
                    h = end - t if done else (t + h) - t  # the step that t really makes
                    new[:] = stage
                _slope(stage, f[k + 1], mass, contacts, free)
            error = 0.0
            for i in range(2 * n):
                doubt[i] = 0.0
                for j in range(7):
                    doubt[i] += size * ERROR[j] * f[j, i]
                error = max(error, abs(doubt[i]) / max(abs(y[i]), abs(new[i]), threshold[i]))
            if error <= rtol or accepted + failed >= most_steps:
                break
            failed += 1
            if size <= smallest:
                ended = STEP_TOO_SMALL
                break
            if first_try:
                size = max(smallest, size * max(0.1, 0.8 * (rtol / error) ** 0.2))
            else:
                size = max(smallest, 0.5 * size)
            first_try = done = False
            h = size
        if accepted + failed >= most_steps:
            ended = TOO_MANY_STEPS
        if ended != FINISHED:
            break
        accepted += 1
        after = end if done else t + h
        for j in range(4):
            for i in range(2 * n):
                extension[j, i] = 0.0
                for k in range(7):
                    extension[j, i] += h * EXTENSION[k, j] * f[k, i]
        _look(y, new, extension, doubt, t, h, peak, crossing, contacts)
        while row < n_t and times[row] <= after:
            if times[row] == after:
                out[row] = new
            else:
                s = (times[row] - t) / h
                for i in range(2 * n):
                    out[row, i] = y[i] + _above(extension[:, i], s)
            _forces(out[row], out_force[row], peak, contacts)
            row += 1
        if first_try:
            shrink = 1.25 * (error / rtol) ** 0.2
            size = size / shrink if shrink > 0.2 else 5.0 * size
        t = after
        y[:] = new
        f[0] = f[6]
    return out[:, :n], out[:, n:], out_force, peak, crossing, accepted, failed, ended, t


@kernel()
def _slope(y: Floats, out: Floats, mass: Floats, contacts: Contacts, free: Floats) -> None:
    """Velocities and accelerations of the state ``y``, into ``out``."""
    left, right, stiffness, exponent, gap = contacts
    n = mass.shape[0]
    for i in range(n):
        out[i] = y[n + i]
        out[n + i] = 0.0
    for k in range(left.shape[0]):
        overlap = _between(y, 0, n, left[k], right[k]) - gap[k]
        if overlap > 0.0:
            force = _law(overlap, stiffness[k], exponent[k])
            if left[k] < n:
                out[n + left[k]] -= force
            if right[k] < n:
                out[n + right[k]] += force
    for i in range(n):
        out[n + i] = out[n + i] / mass[i] + free[i]


@kernel()
def _clear(y: Floats, slope: Floats, mass: Floats, contacts: Contacts, atol: Floats) -> float:
    """Time that passes over no contact: to the next touch, as bodies go on by now, and ``WARY`` of that contact."""
    left, right, stiffness, exponent, gap = contacts
    n, clear = mass.shape[0], np.inf
    for k in range(left.shape[0]):
        a, b = left[k], right[k]
        overlap = _between(y, 0, n, a, b) - gap[k]
        rate, bend = _between(y, n, n, a, b), _between(slope, n, n, a, b)
        until, energy = 0.0, 0.0
        mobility = (1.0 / mass[a] if a < n else 0.0) + (1.0 / mass[b] if b < n else 0.0)
        if overlap > 0.0:
            energy = stiffness[k] * overlap ** exponent[k] / exponent[k]
            bend = 0.0  # its own force, and not what would end a graze
        else:
            squared = rate * rate - 2.0 * bend * overlap
            if squared <= 0.0 or (rate <= 0.0 and bend <= 0.0):
                continue
            # the first root of overlap + rate t + bend t^2 / 2 = 0, without cancellation
            until = -2.0 * overlap / (rate + np.sqrt(squared)) if rate > 0.0 else (np.sqrt(squared) - rate) / bend
            rate = np.sqrt(squared)
        energy += 0.5 * rate * rate / mobility
        depth = (exponent[k] * energy / stiffness[k]) ** (1.0 / exponent[k])
        if depth <= UNFELT * min(atol[a] if a < n else np.inf, atol[b] if b < n else np.inf):
            continue
        brief = 1.0 / np.sqrt((exponent[k] - 1.0) * stiffness[k] * depth ** (exponent[k] - 2.0) * mobility)
        if bend < 0.0:
            brief = min(brief, rate / -bend)
        clear = min(clear, until + WARY * brief)
    return clear


@kernel()
def _law(overlap: float, stiffness: float, exponent: float) -> float:
    if exponent == 2.5:
        return float(stiffness * overlap * np.sqrt(overlap))
    return float(stiffness * overlap ** (exponent - 1.0))


@kernel()
def _between(y: Floats, first: int, n: int, left: int, right: int) -> float:
    """Entry of body ``left`` minus that of body ``right``, in the part of ``y`` from ``first`` on; a wall has 0."""
    there = y[first + left] if left < n else 0.0
    return there - (y[first + right] if right < n else 0.0)


@kernel()
def _forces(y: Floats, out: Floats, peak: Floats, contacts: Contacts) -> None:
    """Write the forces in the state ``y`` into ``out``, and raise ``peak`` to them."""
    left, right, stiffness, exponent, gap = contacts
    n = y.shape[0] // 2
    for k in range(left.shape[0]):
        overlap = _between(y, 0, n, left[k], right[k]) - gap[k]
        out[k] = _law(overlap, stiffness[k], exponent[k]) if overlap > 0.0 else 0.0
        peak[k] = max(peak[k], out[k])


@kernel()
def _look(
    y: Floats, new: Floats, extension: Floats, doubt: Floats, t: float, h: float, peak: Floats, crossing: Floats,
    contacts: Contacts,
) -> None:  # fmt: skip
    """Find each maximal compression within the step from ``y`` to ``new``.

    It is a fall of the closing rate through zero while the contact is closed: ``peak`` rises to its force, ``crossing``
    keeps the first. A compression within ``SEEN`` times the error of the step, or round-off, does not count: ahead of a
    front the stages leave motions of alternating sign and almost no size, which would otherwise be collisions.
    """
    left, right, stiffness, exponent, gap = contacts
    n = y.shape[0] // 2
    overlap, rate = np.zeros(5), np.zeros(5)
    for k in range(left.shape[0]):
        a, b = left[k], right[k]
        rate[0] = _between(y, n, n, a, b)
        last = _between(new, n, n, a, b)
        overlap[0] = _between(y, 0, n, a, b) - gap[k]
        for j in range(4):
            rate[j + 1] = _between(extension[j], n, n, a, b)
            overlap[j + 1] = _between(extension[j], 0, n, a, b)
        if not _positive_somewhere(overlap) or not _positive_somewhere(rate):
            continue
        if last > 0.0 and not _positive_somewhere(-1.0 * rate):
            continue
        size, err = abs(gap[k]), 0.0
        for body in (a, b):
            if body < n:
                size, err = max(size, abs(new[body])), err + abs(doubt[body])
        unseen = max(SEEN * err, 4.0 * 2.0**-52 * size, 1e-300)
        falls, count = find_falls(rate, last)
        for s in falls[:count]:
            top = overlap[0] + _above(overlap[1:], s)
            if top > unseen:
                peak[k] = max(peak[k], _law(top, stiffness[k], exponent[k]))
                # a contact that is pressed from the start is compressed where it is more than that
                if np.isnan(crossing[k]) and abs(top + min(gap[k], 0.0)) > unseen:
                    crossing[k] = t + s * h


@kernel()
def _above(c: Floats, s: float) -> float:
    """``sum_j c[j] s^(j+1)``."""
    return float(s * (c[0] + s * (c[1] + s * (c[2] + s * c[3]))))


@kernel()
def _positive_somewhere(c: Floats) -> bool:
    """Return True if a Bernstein coefficient of the quartic ``sum_j c[j] s^j`` in [0, 1] is positive.

    Otherwise the quartic is positive nowhere in the interval.
    """
    return bool(
        c[0] > 0.0
        or c[0] + c[1] / 4 > 0.0
        or c[0] + c[1] / 2 + c[2] / 6 > 0.0
        or c[0] + 3 * c[1] / 4 + c[2] / 2 + c[3] / 4 > 0.0
        or c[0] + c[1] + c[2] + c[3] + c[4] > 0.0
    )


@kernel()
def find_falls(c: Floats, last: float) -> tuple[Floats, int]:
    """Return where in [0, 1] the quartic ``sum_j c[j] s^j`` falls through zero, ascending, and how many times.

    ``last`` is its value at 1, equal to the last digit to that of the next step's start, so that no fall is seen twice
    or not at all. Between the zeros of its derivative a polynomial is monotone, so a sign change is one root and
    bisection finds it: from the third derivative, a line, up to the quartic itself.
    """
    derivatives = np.zeros((4, 5))
    derivatives[0] = c
    for order in range(1, 4):
        for j in range(5 - order):
            derivatives[order, j] = (j + 1) * derivatives[order - 1, j + 1]
    knots, falls = np.zeros(6), np.zeros(6)
    knots[1] = 1.0
    pieces = 1
    count = 0
    for order in range(3, -1, -1):
        p = derivatives[order]
        count = 0
        for piece in range(pieces):
            low, high = knots[piece], knots[piece + 1]
            at_low = _value(p, low)
            at_high = last if order == 0 and high == 1.0 else _value(p, high)
            falling = at_low > 0.0 and at_high <= 0.0
            if not falling and (order == 0 or not (at_low < 0.0 and at_high >= 0.0)):
                continue
            for _ in range(60):
                middle = 0.5 * (low + high)
                if (_value(p, middle) > 0.0) == falling:
                    low = middle
                else:
                    high = middle
            falls[count] = high
            count += 1
        if order > 0:
            for j in range(count):
                knots[j + 1] = falls[j]
            pieces = count + 1
            knots[pieces] = 1.0
    return falls, count


@kernel()
def _value(c: Floats, s: float) -> float:
    return float(c[0] + _above(c[1:], s))
