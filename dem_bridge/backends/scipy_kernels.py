"""Compiled parts of the ``scipy`` backend: its own writing of forces and equations of motion.

Nothing here is shared with the kernels of the twin or with those of ``reference``. State of a scene with k contacts and
n bodies: overlap of every contact (m), velocity of every body (m/s), displacement of body 0 (m).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.compiled import Ints, kernel
from dem_bridge.scene.drive import Drive
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
#: a driving force of body 0: size (N; 0: none), angular frequency at the start (rad/s), half its rate of change
#: (rad/s^2) until the time ``sweep`` (s), that from then on, time of the rise (s), and phase (rad)
WAVE = np.dtype([(name, "f8") for name in ("size", "first", "growth", "sweep", "last", "rise", "phase")])


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


def wave_table(drive: Drive | None) -> NDArray[Any]:
    """Return a sine or a chirp, or no drive, as an array of one :data:`WAVE`."""
    table = np.zeros(1, WAVE)
    if drive is None:
        return table
    first = last = 2.0 * math.pi * (drive.frequency or 0.0)
    table["size"], table["rise"], table["phase"] = drive.peak, drive.rise, math.radians(drive.phase)
    table["sweep"] = math.inf
    if drive.last_frequency is not None and drive.sweep is not None:
        last = 2.0 * math.pi * drive.last_frequency
        table["growth"], table["sweep"] = 0.5 * (last - first) / drive.sweep, drive.sweep
    table["first"], table["last"] = first, last
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
            limits = clip, touch[i], unnoticed[i]
            out[row, i] = margin(rows[row, i], rate, state[i], elastic[row], contacts, i, limits)


@kernel(nogil=False)
def margin(
    overlap: float, rate: float, state: int, elastic: Floats, contacts: Table, i: int,
    limits: tuple[bool, float, float],
) -> float:  # fmt: skip
    """Return how far contact ``i`` is from a change of its state: see :func:`margins`.

    ``limits``: clip, and the contact's touch and unnoticed.
    """
    clip, touch, unnoticed = limits
    total = contact_force(overlap, rate, elastic, contacts, i)
    undamped = contact_force(overlap, 0.0, elastic, contacts, i)
    total /= max(unnoticed, UNNOTICED * (abs(undamped) + abs(total - undamped)))
    of_touch = overlap / touch
    if state == OPEN:
        return -of_touch
    if state == SLACK:
        return min(of_touch, -total)
    if clip and contacts[i].damping > 0.0:
        return min(of_touch, total)
    return of_touch


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


@kernel(nogil=False)
def wave_at(wave: Any, t: float) -> float:
    """Return the driving force of a :data:`WAVE` at a time (s), N."""
    if wave.size == 0.0:
        return 0.0
    swept = min(t, wave.sweep)
    angle = (wave.first + wave.growth * swept) * swept + wave.last * (t - swept)
    envelope = np.sin(0.5 * np.pi / wave.rise * min(t, wave.rise)) ** 2 if wave.rise > 0.0 else 1.0
    force: float = wave.size * envelope * np.sin(angle + wave.phase)
    return force


@kernel(nogil=False)
def component(part: float, terms: Floats, start: Floats, i: int) -> float:
    """Return one component of the state at a part of a step, by the operations of scipy's dense output."""
    y, factor, other = 0.0, part, 1.0 - part
    for p in range(len(terms) - 1, -1, -1):
        y = (y + terms[p, i]) * factor
        factor, other = other, factor
    value: float = y + start[i]
    return value


@kernel(nogil=False)
def force_within(part: float, terms: Floats, start: Floats, contacts: Table, n: int, i: int) -> float:
    """Return elastic and damping force of contact ``i`` at a part of a step, N."""
    overlap, rate = contact_within(part, terms, start, contacts, n, i)
    return contact_force(overlap, rate, np.empty(0), contacts, i)


@kernel(nogil=False)
def margin_within(
    part: float, terms: Floats, start: Floats, state: int, contacts: Table, n: int, i: int,
    limits: tuple[bool, float, float],
) -> float:  # fmt: skip
    """Return the margin of contact ``i`` at a part of a step: see :func:`margins`."""
    overlap, rate = contact_within(part, terms, start, contacts, n, i)
    return margin(overlap, rate, state, np.empty(0), contacts, i, limits)


@kernel(nogil=False)
def contact_within(part: float, terms: Floats, start: Floats, contacts: Table, n: int, i: int) -> tuple[float, float]:
    """Return overlap (m) and closing rate (m/s) of contact ``i`` at a part of a step."""
    k, rate = len(contacts), 0.0
    if contacts[i].left < n:
        rate = component(part, terms, start, k + contacts[i].left)
    if contacts[i].right < n:
        rate -= component(part, terms, start, k + contacts[i].right)
    return component(part, terms, start, i), rate
