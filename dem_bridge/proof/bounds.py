"""What the polynomials of a step leave out, bounded in doubles: the lemma of the producer, compiled.

Lemma. Let x', v' be the polynomials of a step, made for one start in the balls, and E a vector with
``E > h (J E + d)`` in every component. Here d bounds the defect of the polynomials on [0, h], and J the Jacobian of the
forces wherever the state differs from the polynomials by at most E; both are not negative. Then the true motion differs
from the polynomials by less than E on all of [0, h]. Proof: the difference e starts at 0, and ``|e(t)|`` is at most the
integral of ``J |e| + d`` as long as ``|e| <= E``; at the first time at which a component reached E it would be at most
``h (J E + d) < E``.

d has three parts. (1) x' = v lacks the last coefficient. (2) The force of a closed contact is a product of series that
are cut: all products of coefficients that were left out are summed; and w is not quite the root of the polynomial s:
``|sqrt(s) - w| <= |s - w^2| / min w``. (3) A contact that does not count as closed has a force that is an unknown
function of time in [0, beta max(s, 0)^(n-1)], for the largest s within the step. It is nowhere taken for a constant:
only its bound enters.

All sums are of numbers that are not negative, and what is small was raised to ``balls.FLOOR`` when it was read. Each
result is enlarged by ``ENLARGED``, which is more than ten thousand roundings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dem_bridge.foundation.compiled import Bools, Floats, Ints, kernel
from dem_bridge.proof.balls import FLOOR, SIZE, lower, magnitude, upper
from dem_bridge.proof.series import Chain, Space, last_level, power_of

#: more than the roundings of the ten thousand operations of a bound
ENLARGED = 1.0 + 1e-10
#: a step ends before w falls below this part of its first value, so that 1/w keeps its size
LEAST_ROOT = 0.1
#: shortest step, in units: below it no start of a contact at rest is resolved with the bits that doubles can bound
SHORTEST = 2.0**-400
#: rounds after which the search for E gives up
_ROUNDS = 60
#: the search begins at this part of the limit, and tries this multiple of what would be needed
_TRIFLE, _MARGIN = 1e-4, 1.05


class Coefficients(NamedTuple):
    """Bounds of all coefficients of a step, and room for what follows from them."""

    s: Floats
    """Magnitudes of overlaps, ``(n_contact, order + 1)``."""
    rising: Floats
    """Upper bounds of the overlaps' coefficients."""
    falling: Floats
    """Lower bounds of the overlaps' coefficients."""
    base: Floats
    """Lower bounds of the coefficients on which the force of a closed contact is built: of w, or of s."""
    slope: Floats
    """Lower and upper bound of the rates of overlaps at the start, in the unit of the step, ``(n_contact, 2)``."""
    powers: Floats
    """Magnitudes of the powers of w, ``(n_contact, levels + 1, order)``."""
    last: Floats
    """Magnitudes of the last coefficients of velocities, ``(n_body,)``."""


@kernel()
def read_coefficients(chain: Chain, space: Space, closed: Bools, order: int, c: Coefficients) -> None:
    """Read the bounds of all coefficients."""
    row = SIZE * space.stride
    for i in range(len(chain.mobility) - 1):
        c.last[i] = magnitude(space.v + row * i + SIZE * order)
    for k in range(len(chain.left)):
        s = space.s + row * k
        for o in range(order + 1):
            c.s[k, o], c.rising[k, o] = magnitude(s + SIZE * o), upper(s + SIZE * o)
            c.falling[k, o] = lower(s + SIZE * o)
        c.slope[k, 0], c.slope[k, 1] = lower(s + SIZE), upper(s + SIZE)
        if not closed[k]:
            continue
        for level in range(last_level(chain.doubled[k]) + 1):
            power = power_of(chain, space, k, level)
            for o in range(order):
                c.powers[k, level, o] = magnitude(power + SIZE * o)
                if level == 0:
                    c.base[k, o] = lower(power + SIZE * o)


@kernel()
def power_above(step: float, exponent: int) -> float:
    """Return an upper bound of a power of a step, which doubles would round to 0."""
    return float(max(step**exponent * ENLARGED, FLOOR))


@kernel()
def weighted(c: Floats, step: float, start: int) -> float:
    """Return the sum of ``c[o] step^o`` from ``start`` on, for coefficients that are not negative."""
    total = 0.0
    for o in range(len(c) - 1, start - 1, -1):
        total = total * step + c[o]
    return float(total * power_above(step, start))


@kernel()
def tail(a: Floats, b: Floats, step: float, start: int, room: Floats) -> float:
    """Return the sum of ``a[i] b[j] step^(i+j)`` over ``i + j >= start``."""
    power, total, end = 1.0, 0.0, len(b)
    for j in range(end):
        room[j] = b[j] * power
        power = max(power * step, FLOOR)
    for j in range(end - 2, -1, -1):
        room[j] += room[j + 1]
    power = 1.0
    for i in range(len(a)):
        first = max(start - i, 0)
        if first < end:
            total += a[i] * power * room[first]
        power = max(power * step, FLOOR)
    return total * ENLARGED


@kernel()
def largest_overlap(k: int, c: Coefficients, step: float) -> float:
    """Return an upper bound of the polynomial of an overlap within a step."""
    rising, curve = c.rising[k], 0.0
    for o in range(len(rising) - 1, 1, -1):
        curve = curve * step + c.s[k, o] * o
    curve *= step * ENLARGED
    if c.slope[k, 1] + curve <= 0.0:
        return float(rising[0])
    if c.slope[k, 0] - curve >= 0.0:  # it rises all the time: the end counts
        most, size, power = rising[0], abs(rising[0]), 1.0
        for o in range(1, len(rising)):
            power *= step
            most += rising[o] * (max(power, FLOOR) if rising[o] > 0.0 else power)
            size += abs(rising[o]) * power
        # a hundred terms with a rounding each
        return float(most + (ENLARGED - 1.0) * 1e-3 * size)
    return float(rising[0] + max(0.0, c.slope[k, 1] * step * ENLARGED) + weighted(c.s[k], step, 2))


@kernel()
def force_defect(k: int, chain: Chain, c: Coefficients, step: float, order: int, room: Floats) -> float:
    """Return a bound of the force of a closed contact that its series lacks, N; -1 where w may come too near 0."""
    base, m, fall, power = c.base[k], chain.doubled[k], 0.0, 1.0
    for o in range(1, order):
        power = max(power * step, FLOOR)
        fall += max(-base[o], 0.0) * power
    least = base[0] - fall * ENLARGED
    if not (base[0] > 0.0 and least >= LEAST_ROOT * base[0]):
        return -1.0
    error, most = c.s[k, order] * power_above(step, order), weighted(c.s[k], step, 0)
    if m % 2 == 1:
        roots = c.powers[k, 0, :order]
        error += tail(roots, roots, step, order, room)
        if not error < 0.5 * least * least:
            return -1.0
        error /= least
    for level in range(1, last_level(m) + 1):
        error = most * error + tail(c.s[k], c.powers[k, level - 1, :order], step, order, room)
    return float(error * chain.stiffness[k] * ENLARGED)


@kernel()
def enclose(
    chain: Chain, c: Coefficients, closed: Bools, step: float, seconds: float, order: int, limit: Floats, room: Floats,
    errors: Floats, overlaps: Floats,
) -> bool:  # fmt: skip
    """Write E for a step of ``step`` units into ``errors`` (displacements, then velocities); False: there is none.

    ``seconds``: an upper bound of the length of the step; ``limit``: what matters in displacements and velocities.
    ``overlaps`` become the largest overlaps within the step.
    """
    n = len(chain.mobility) - 1
    # room for the wall, which does not move
    x, v, rest = np.full(n + 1, _TRIFLE * limit[0]), np.full(n + 1, _TRIFLE * limit[1]), np.zeros(n + 1)
    x[n] = v[n] = 0.0
    gain = np.zeros(len(closed))
    for k in range(len(closed)):
        left, right = chain.left[k], chain.right[k]
        overlaps[k] = largest_overlap(k, c, step) if not closed[k] else weighted(c.s[k], step, 0)
        if closed[k]:
            defect = force_defect(k, chain, c, step, order, room)
            if not defect >= 0.0:
                return False
            rest[left] += defect
            rest[right] += defect
    for _ in range(_ROUNDS):
        new_x, new_v = np.zeros(n + 1), np.zeros(n + 1)
        for k in range(len(closed)):
            left, right, power = chain.left[k], chain.right[k], 0.5 * chain.doubled[k]
            apart = x[left] + x[right]
            most = overlaps[k] + apart
            if closed[k]:
                if power >= 1.0:
                    gain[k] = power * chain.stiffness[k] * most ** (power - 1.0)
                else:  # the slope of the force is largest at the least overlap, (LEAST_ROOT w)^2
                    least = 0.5 * (LEAST_ROOT * c.base[k, 0]) ** 2 - apart
                    if not least > 0.0:
                        return False
                    gain[k] = power * chain.stiffness[k] * least ** (power - 1.0)
                force = gain[k] * apart
            else:
                force = chain.stiffness[k] * max(most, 0.0) ** power
            new_v[left] += force
            new_v[right] += force
        settled = True
        for i in range(n):
            new_v[i] = seconds * ((new_v[i] + rest[i]) * chain.mobility[i])
            new_x[i] = seconds * (v[i] + c.last[i] * power_above(step, order))
            if not (new_v[i] * ENLARGED < v[i] and new_x[i] * ENLARGED < x[i]):
                settled = False
        if settled:
            errors[:n], errors[n:] = x[:n], v[:n]
            return True
        for i in range(n):
            v[i] = max(v[i], new_v[i] * _MARGIN)
            x[i] = max(x[i], seconds * (v[i] + c.last[i] * power_above(step, order)) * _MARGIN)
            if not (v[i] < 1e100 and x[i] < 1e100):
                return False
    return False


@kernel()
def _arrival(k: int, c: Coefficients) -> float:
    """Return about when the polynomial of an overlap that is below 0 and rises passes 0; inf if it does not."""
    at = 0.0
    for _ in range(30):
        value, slope = 0.0, 0.0
        for o in range(len(c.rising[k]) - 1, -1, -1):
            slope = slope * at + value
            value = value * at + c.rising[k, o]
        if not slope > 0.0:
            return np.inf
        at -= value / slope
        if not 0.0 <= at <= 1.0:
            return np.inf
        if abs(value) <= 1e-15 * abs(c.rising[k, 0]):
            break
    return at


@kernel()
def choose_step(
    chain: Chain, c: Coefficients, closed: Bools, unit: float, order: int, limit: Floats, room: Floats, errors: Floats,
    overlaps: Floats,
) -> float:  # fmt: skip
    """Return a long step, at most 1 unit of ``unit`` seconds, for which E is within the ``limit``; 0: there is none.

    A step ends just before an open contact touches, if it cannot end after the touch.
    """
    n = len(chain.mobility) - 1

    def serves(step: float) -> bool:
        if not enclose(chain, c, closed, step, step * unit * ENLARGED, order, limit, room, errors, overlaps):
            return False
        return bool(errors[:n].max() <= limit[0] and errors[n:].max() <= limit[1])

    step = 1.0
    while not serves(step):
        step *= 0.5
        if step < SHORTEST:
            return 0.0
    if step == 1.0:
        return step
    too_long = 2.0 * step
    for k in range(len(closed)):
        if not closed[k] and c.rising[k, 0] < 0.0:
            arrival = _arrival(k, c)
            if step < arrival < too_long:
                for before in (1e-12, 1e-9, 1e-6, 1e-3):
                    candidate = arrival * (1.0 - before)
                    if candidate > step and serves(candidate):
                        return candidate
    for _ in range(4):
        middle = 0.5 * (step + too_long)
        if serves(middle):
            step = middle
        else:
            too_long = middle
    serves(step)  # E and overlaps are those of the step, not of the last trial
    return step


@kernel()
def find_signs(
    chain: Chain,
    c: Coefficients,
    closed: Bools,
    step: float,
    unit: float,
    errors: Floats,
    overlaps: Floats,
    signs: Ints,
) -> None:
    """Write the signs that overlaps and their rates keep throughout a step into ``signs (2, n_contact)``; 0: none.

    Lower bounds are sums of the negative coefficients, upper bounds of the positive ones.
    """
    n = len(chain.mobility) - 1
    for k in range(len(closed)):
        signs[:, k] = 0
        apart, faster = 0.0, 0.0
        for i in (chain.left[k], chain.right[k]):
            if i < n:
                apart += errors[i] * ENLARGED
                faster += errors[n + i] * unit * ENLARGED
        fall, slower, quicker = 0.0, 0.0, 0.0
        for o in range(c.s.shape[1] - 1, 0, -1):
            fall = (fall + max(-c.falling[k, o], 0.0)) * step
            if o > 1:
                slower = (slower + max(-c.falling[k, o], 0.0) * o) * step
                quicker = (quicker + max(c.rising[k, o], 0.0) * o) * step
        if c.slope[k, 0] - (slower * ENLARGED + faster) > 0.0:
            signs[1, k] = 1
        elif c.slope[k, 1] + (quicker * ENLARGED + faster) < 0.0:
            signs[1, k] = -1
        if closed[k]:
            # w stays above LEAST_ROOT of its first value, and s above half the square of it
            least = c.base[k, 0] if chain.doubled[k] % 2 == 0 else c.base[k, 0] ** 2
            signs[0, k] = 1 if 0.5 * LEAST_ROOT**2 * least > apart else 0
        elif overlaps[k] + apart < 0.0:
            signs[0, k] = -1
        elif c.falling[k, 0] - (fall * ENLARGED + apart) > 0.0:
            signs[0, k] = 1
