"""Compiled parts of the ``scipy`` backend: its own writing of forces and equations of motion, and a step of DOP853.

One step of scipy takes some 13 calls of Python and numpy a trial, far more than the forces of a chain. Here all trials
of a step are one call of a kernel, with scipy's table, rules of step control and dense output. Where forces or drives
are functions of Python, scipy's own step is taken. Nothing here is
shared with the kernels of the twin or with those of ``reference``. State of a scene with k contacts and n bodies:
overlap of every contact (m), velocity of every body (m/s), displacement of body 0 (m).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from dem_bridge.foundation.compiled import Ints, kernel
from dem_bridge.scene.scene import Scene

Floats = NDArray[np.float64]
#: arrays of :data:`CONTACT` or :data:`BODY`
Table = NDArray[np.void]

#: states of a contact; slack: it overlaps, but damping would make it pull
OPEN, PRESSING, SLACK = range(3)
#: why a contact needs a closer examination within a step, as bits
ENDS, TURNS, FALLS, DIPS, BUMPS, STARTS = (1 << bit for bit in range(6))

#: part of elastic and damping force that may pull unnoticed: round-off of their sum near its zero is a tenth of it
UNNOTICED = 1e-14
#: Marshall's polynomial of the restitution, highest power first (2009, *J. Comput. Phys.* 228, 1541, eq. 53)
MARSHALL = (4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728)
#: a contact as kernels take it; ``power``: force exponent n - 1; the index n stands for a wall, which rests
CONTACT = np.dtype(
    [
        ("left", "i8"),
        ("right", "i8"),
        ("stiffness", "f8"),
        ("power", "f8"),
        ("damping", "f8"),
        ("damping_power", "f8"),
        ("pull_off", "f8"),
    ]
)
#: a body: inverse mass (1/kg; 0: it keeps its velocity), acceleration without contact (m/s^2)
BODY = np.dtype([("mobility", "f8"), ("free", "f8")])


def contact_table(scene: Scene) -> NDArray[Any]:
    """Return the contacts of a scene as one array of :data:`CONTACT`.

    The damping force is ``damping overlap^damping_power rate``. A force that is given by a restitution e is written by
    the ratio of its damping to the critical one, ``-ln e / sqrt(pi^2 + (ln e)^2)``, of ``sqrt(2 n m beta)``.
    """
    contacts, table = scene.contacts, np.zeros(scene.n_contact, CONTACT)
    n = contacts.exponent
    table["left"], table["right"] = contacts.left, contacts.right
    table["stiffness"], table["power"] = contacts.stiffness, n - 1.0
    if scene.adhesion is not None:
        table["pull_off"] = scene.adhesion.pull_off
    if scene.damping is None:
        return table
    law, value = scene.damping.law, np.array(scene.damping.coefficient)
    mass = np.append(scene.mass, np.inf)
    smaller, larger = np.sort([mass[contacts.left], mass[contacts.right]], axis=0)
    reduced = smaller / (1.0 + smaller / larger)
    if law == "dashpot":
        table["damping"] = value
    elif law == "mass_velocity":
        table["damping"] = value * reduced
    elif law == "kuwabara-kono":
        table["damping"] = value * contacts.stiffness
        # an undamped contact has no such force, whatever its exponent
        table["damping_power"] = np.maximum(n - 2.0, 0.0)
    else:
        loss = -np.log(value)
        ratio = loss / np.sqrt(np.pi**2 + loss**2)
        if law == "tsuji":
            ratio = np.polyval(MARSHALL, value) / np.sqrt(n)
        table["damping"] = ratio * np.sqrt(2.0 * n * contacts.stiffness * reduced)
        table["damping_power"] = np.maximum(n / 2.0 - 1.0, 0.0)
    return table


def body_table(scene: Scene) -> NDArray[Any]:
    """Return the bodies of a scene as one array of :data:`BODY`."""
    table = np.zeros(scene.n_body, BODY)
    table["mobility"], table["free"] = scene.mobility[:-1], scene.free_acceleration
    return table


@kernel(nogil=False)
def derivative(
    y: Floats, state: Ints, elastic: Floats, contacts: Table, bodies: Table, drag: float, push: float, out: Floats
) -> None:
    """Write the time derivative of the state ``y`` into ``out``, with forces at the contacts that are PRESSING.

    ``elastic (n_contact,)``: elastic forces (N) where laws are functions, else empty; ``push``: force on body 0 (N).
    """
    k, n = len(contacts), len(bodies)
    out[k:] = 0.0
    for i in range(k):
        out[i] = closing_rate(y, contacts[i], k, n)
        if state[i] == PRESSING:
            force = contact_force(y[i], out[i], elastic, contacts, i)
            # what acts on a wall, index n, is written where the displacement's rate will be, and overwritten by it
            out[k + contacts[i].left] -= force
            out[k + contacts[i].right] += force
    for i in range(n):
        out[k + i] = out[k + i] * bodies[i].mobility + bodies[i].free
        if drag > 0.0 and bodies[i].mobility > 0.0:
            out[k + i] -= drag * y[k + i]
    out[k] += push * bodies[0].mobility
    out[k + n] = y[k]


@kernel(nogil=False)
def contact_forces(rows: Floats, elastic: Floats, contacts: Table, n: int, out: Floats) -> None:
    """Write elastic and damping force of every contact, whatever the sign of their sum, for each state in ``rows``.

    ``elastic``, ``out``: ``(n_row, n_contact)``; the former has no columns where no law is a function.
    """
    for row in range(len(rows)):
        for i in range(len(contacts)):
            rate = closing_rate(rows[row], contacts[i], len(contacts), n)
            out[row, i] = contact_force(rows[row, i], rate, elastic[row], contacts, i)


@kernel(nogil=False)
def closing_rates(y: Floats, contacts: Table, n: int, out: Floats) -> None:
    """Write the closing rate of every contact into ``out``; the closing acceleration where ``y`` is a derivative."""
    for i in range(len(contacts)):
        out[i] = closing_rate(y, contacts[i], len(contacts), n)


@kernel(nogil=False)
def examine(
    before: Floats, after: Floats, begin: Floats, end: Floats, width: float, state: Ints, contacts: Table, n: int,
    touch: Floats, resting: Floats, marks: Ints,
) -> None:  # fmt: skip
    """Mark in ``marks`` which contacts need the dense output of a step of ``width`` s; 0 where none is needed.

    ``before``, ``after``: states at both ends of the step; ``begin``, ``end``: their derivatives. The bits: ENDS, the
    overlap has left its side by more than ``touch`` (m); TURNS, it approached touch and went back, and may have been
    beyond it; FALLS, the closing rate is no longer positive; DIPS, BUMPS, both its values have one sign, but it may
    have two zeros between, as zero lies between both tangents and more than ``resting`` (m/s^2), the round-off of a
    static force, ends the compression; STARTS, it begins at exactly zero, and may turn at once.
    """
    k = len(contacts)
    for i in range(k):
        contact, mark = contacts[i], 0
        first, last = closing_rate(before, contact, k, n), closing_rate(after, contact, k, n)
        bend, last_bend = closing_rate(begin, contact, k, n), closing_rate(end, contact, k, n)
        side = -1.0 if state[i] == OPEN else 1.0  # side * overlap >= 0 as long as nothing happens
        if side * after[i] < -touch[i]:
            mark |= ENDS
        # far more than any overlap changes by within the step
        change = width * (abs(first) + abs(last) + width * (abs(bend) + abs(last_bend)))
        if first * last < 0.0 and (mark != 0 or (side * first < 0.0 and side * before[i] < change)):
            mark |= TURNS
        if first > 0.0 and last <= 0.0:
            mark |= FALLS
        if first * (first + bend * width) < 0.0 and last * (last - last_bend * width) < 0.0:
            if first > 0.0 and last > 0.0 and bend <= -resting[i]:
                mark |= DIPS
            if first < 0.0 and last < 0.0 and last_bend <= -resting[i]:
                mark |= BUMPS
        if first == 0.0 and (last != 0.0 or bend != 0.0 or last_bend != 0.0):
            mark |= STARTS
        marks[i] = mark


@kernel(nogil=False)
def margins(
    rows: Floats, state: Ints, elastic: Floats, contacts: Table, n: int, clip: bool, touch: Floats, unnoticed: Floats,
    out: Floats,
) -> None:  # fmt: skip
    """Write how far each contact is from a change of its state, for each state in ``rows``; arrays as above.

    Positive while it keeps its state; in units of the overlap ``touch`` (m) and the force ``unnoticed`` (N), or of the
    round-off of the sum where that is larger. An undamped contact, or any without ``clip``, ends with its overlap: its
    force is no second condition.
    """
    for row in range(len(rows)):
        for i in range(len(contacts)):
            rate = closing_rate(rows[row], contacts[i], len(contacts), n)
            total = contact_force(rows[row, i], rate, elastic[row], contacts, i)
            undamped = contact_force(rows[row, i], 0.0, elastic[row], contacts, i)
            total /= max(unnoticed[i], UNNOTICED * (abs(undamped) + abs(total - undamped)))
            overlap = rows[row, i] / touch[i]
            if state[i] == OPEN:
                out[row, i] = -overlap
            elif state[i] == SLACK:
                out[row, i] = min(overlap, -total)
            elif clip and contacts[i].damping > 0.0:
                out[row, i] = min(overlap, total)
            else:
                out[row, i] = overlap


@kernel(nogil=False)
def closing_rate(y: Floats, contact: Any, k: int, n: int) -> float:
    """Return the velocity of the left body less that of the right one; a wall rests."""
    left = y[k + contact.left] if contact.left < n else 0.0
    return left - (y[k + contact.right] if contact.right < n else 0.0)


@kernel(nogil=False)
def contact_force(overlap: float, rate: float, elastic: Floats, contacts: Table, i: int) -> float:
    """Return elastic force less pull-off plus damping of contact ``i``, N; without overlap minus the pull-off."""
    contact, depth = contacts[i], max(overlap, 0.0)
    force: float
    if len(elastic) > 0:
        force = elastic[i]
    elif contact.power == 1.5:
        force = contact.stiffness * depth * np.sqrt(depth)
    else:
        force = contact.stiffness * depth**contact.power
    force -= contact.pull_off
    if contact.damping > 0.0:
        if contact.damping_power > 0.0:
            force += contact.damping * depth**contact.damping_power * rate
        else:
            force += contact.damping * rate
    return force


#: least and largest factor by which a step changes, and the part of the predicted one that is taken, as in scipy
LEAST, MOST, SAFETY = 0.2, 10.0, 0.9


class CompiledDop853(DOP853):  # type: ignore[misc]  # scipy has no types
    """DOP853 whose steps, all trials of each, are computed by :func:`take_step`.

    ``system``: state of the contacts, contacts, bodies and drag, as :func:`~.scipy_kernels.derivative` takes them.
    """

    t: float
    y: Floats
    f: Floats
    h_abs: float
    nfev: int

    def __init__(self, system: tuple[Ints, Table, Table, float], *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.system = system

    def _step_impl(self) -> tuple[bool, str | None]:
        new = np.empty_like(self.y)
        control = (float(self.t), float(self.h_abs), float(self.t_bound), float(self.rtol), self.error_exponent)
        after, size, trials = take_step.compiled(
            control, self.y, self.f, self.atol, (self.A, self.B, self.E5, self.E3), self.K, new, *self.system
        )
        self.nfev += trials * self.n_stages
        if not after > self.t:
            return False, self.TOO_SMALL_STEP
        self.h_previous, self.y_old = after - self.t, self.y
        self.t, self.y, self.h_abs, self.f = after, new, size, self.K[self.n_stages].copy()
        return True, None


@kernel(nogil=False)
def take_step(
    control: tuple[float, float, float, float, float], y: Floats, f: Floats, atol: Floats,
    table: tuple[Floats, Floats, Floats, Floats], stages: Floats, new: Floats, state: Ints, contacts: Table,
    bodies: Table, drag: float,
) -> tuple[float, float, int]:  # fmt: skip
    """Take one step, write the state after it into ``new``, and return its time, the next size (s) and the trials.

    The time is that before the step where its size would be too small. ``control``: time, size, end, relative
    tolerance and exponent of the error; ``table``: coefficients of scipy; ``stages (n_stages + 1, n)``: room.
    """
    t, size, end, rtol, exponent = control
    a, b, fifth, third = table
    count, n, elastic, trial = len(b), len(y), np.empty(0), np.empty_like(y)
    smallest = 10.0 * (np.nextafter(t, np.inf) - t)
    size, rejected, trials = max(size, smallest), False, 0
    while size >= smallest:
        after = min(t + size, end)
        size = after - t
        stages[0] = f
        for s in range(1, count + 1):
            weights = a[s] if s < count else b
            trial[:] = 0.0
            for q in range(s):
                if weights[q] != 0.0:
                    for i in range(n):
                        trial[i] += weights[q] * stages[q, i]
            for i in range(n):
                trial[i] = y[i] + size * trial[i]
            derivative(trial, state, elastic, contacts, bodies, drag, 0.0, stages[s])
        new[:] = trial
        trials += 1
        of_fifth, of_third = 0.0, 0.0
        for i in range(n):
            scale, five, three = atol[i] + max(abs(y[i]), abs(new[i])) * rtol, 0.0, 0.0
            for q in range(count + 1):
                five += fifth[q] * stages[q, i]
                three += third[q] * stages[q, i]
            of_fifth += (five / scale) ** 2
            of_third += (three / scale) ** 2
        error = 0.0
        if of_fifth > 0.0 or of_third > 0.0:
            error = size * of_fifth / np.sqrt((of_fifth + 0.01 * of_third) * n)
        if error < 1.0:
            factor = MOST if error == 0.0 else min(MOST, SAFETY * error**exponent)
            return after, size * (min(1.0, factor) if rejected else factor), trials
        # a trial far too long may end beyond doubles
        size *= max(LEAST, SAFETY * error**exponent) if error < np.inf else LEAST
        rejected = True
    return t, size, trials
