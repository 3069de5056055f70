"""Solve chains of contacts in decimal arithmetic of 40 digits: power series in time from event to event.

The powers ``s^p`` of an overlap have series by the recurrence ``s (s^p)' = p s' s^p``. Their step is a fifth of the
distance to the singularity at touch, so that steps grow from touch, and shrink towards it, geometrically. Where a
contact starts, a leap of 1e-23 of its duration with constant accelerations passes the singularity, and leaves out less
than 1e-23. Overlaps are variables, so that a gap of 5e-324 m keeps its digits. Openings, closings, turns and maxima are
roots of the series; each step is searched for several of them.

It shares nothing with the package but the scene's numbers, and does not know drives, laws that are functions, or
adhesion in touch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import cache
from operator import mul

import numpy as np
from numpy.typing import NDArray

from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory

DIGITS, ORDER = 40, 40
#: what the last coefficients may contribute to the powers of an overlap
TOLERANCE = Decimal("1e-24")
#: closing rates below this part of the fastest velocity are its last digits, and have no sign
NOISE = Decimal("1e-34")
#: part of the other forces on its bodies below which a force need not keep its digits
UNFELT = Decimal("1e-100")
#: part of a contact's duration that is leapt over at its start, and of its overlap at its end
LEAP = Decimal("1e-23")
#: pieces of a step that are searched for a change of sign, and halvings of the first where a series begins at 0
PIECES, HALVINGS = 16, 60
MOST_STEPS = 60_000
OPEN, PRESSING, SLACK = range(3)
ZERO = Decimal(0)
Series = list[Decimal]


@dataclass(frozen=True)
class Exact:
    """Hold what a scene ends with."""

    displacement: tuple[float, ...]
    velocity: tuple[float, ...]
    peak_force: tuple[float, ...]
    crossing_time: tuple[float, ...]

    def ratios(self, run: Trajectory) -> dict[str, float]:
        """Return error over uncertainty of each quantity of a run, the largest of all bodies or contacts.

        It is 0 where the uncertainty is infinite, and infinite for a finite uncertainty of what does not exist.
        """
        out = {}
        for name in ("displacement", "velocity", "peak_force", "crossing_time"):
            value, truth = getattr(run, name), np.array(getattr(self, name))
            value = value[-1] if value.ndim > 1 else value
            allowed = np.broadcast_to(np.asarray(run.uncertainty[name]), truth.shape)
            error: NDArray[np.float64] = np.where(
                np.isnan(value) != np.isnan(truth), math.inf, np.nan_to_num(np.abs(value - truth))
            )
            # the truth is rounded to a double
            allowed = allowed + 2.0**-53 * np.nan_to_num(np.abs(truth))
            known = (error > 0.0) & np.isfinite(allowed)
            ratio = np.divide(error, allowed, out=np.where(known, math.inf, 0.0), where=known & (allowed > 0.0))
            out[name] = float(np.max(ratio, initial=0.0))
        return out


def solve_exactly(scene: Scene) -> Exact:
    """Return what the scene ends with, right to the last digit of a double; each scene is solved once."""
    if scene.content_hash not in _SOLVED:
        with localcontext() as context:
            context.prec, context.Emin, context.Emax = DIGITS, -999_999, 999_999
            _SOLVED[scene.content_hash] = Chain(scene).solved()
    return _SOLVED[scene.content_hash]


_SOLVED: dict[str, Exact] = {}


def largest_overlap(scene: Scene, contact: int) -> Decimal | None:
    """Return the largest overlap (m, negative if open) at a turn of an open contact; None if it never turns."""
    with localcontext() as context:
        context.prec, context.Emin, context.Emax = DIGITS, -999_999, 999_999
        chain = Chain(scene)
        chain.solved()
        return max(chain.turns[contact], default=None)


class Chain:
    """State of a chain: overlaps, velocities and displacements (the last one is the wall's), and what has happened."""

    def __init__(self, scene: Scene) -> None:
        c = scene.contacts
        if scene.drive is not None or scene.law is not None:
            raise ValueError("drives and laws that are functions are not solved; give powers and no drive")
        self.left: list[int] = c.left.tolist()
        self.right: list[int] = c.right.tolist()
        self.n, self.k, self.clip = scene.n_body, scene.n_contact, c.clip
        self.inverse = [1 / mass for mass in _decimals(scene.mass)] + [ZERO]
        self.stiffness, self.power = _decimals(c.stiffness), [n - 1 for n in _decimals(c.exponent)]
        self.damping, self.damping_power = _decimals(c.damping), _decimals(c.damping_power)
        self.pull_off, self.free = _decimals(c.pull_off), _decimals(scene.free_acceleration)
        self.drag, self.end, self.now = Decimal(float(scene.drag)), Decimal(float(scene.duration)), ZERO
        self.s, self.x = [-gap for gap in _decimals(c.gap)], [ZERO] * (self.n + 1)
        self.v = [*_decimals(scene.velocity), ZERO]
        self.peak, self.crossing = [ZERO] * self.k, [math.nan] * self.k
        self.deepest, self.turns = [abs(s) for s in self.s], [list[Decimal]() for _ in range(self.k)]
        self.switched, self.state = -1, [OPEN] * self.k
        for j in range(self.k):
            if self.s[j] > 0:
                pulls = self.clip and self._force(j) < 0
                self.state[j] = SLACK if pulls else PRESSING

    def solved(self) -> Exact:
        """Integrate to the end."""
        for _ in range(MOST_STEPS):
            if self.now >= self.end:
                break
            self._begin()
            self._step()
        else:
            raise RuntimeError(f"no end after {MOST_STEPS} steps; give a shorter scene")
        bodies = slice(self.n)
        parts = (self.x[bodies], self.v[bodies], self.peak, self.crossing)
        return Exact(*(tuple(map(float, part)) for part in parts))

    def _rate(self, j: int) -> Decimal:
        rate: Decimal = self.v[self.left[j]] - self.v[self.right[j]]
        return rate

    def _force(self, j: int) -> Decimal:
        """Return the force of a closed contact, before a clip."""
        s = self.s[j]
        elastic = self.stiffness[j] * _power(s, self.power[j]) - self.pull_off[j]
        return elastic + self.damping[j] * self._rate(j) * _power(s, self.damping_power[j])

    def _accelerations(self) -> Series:
        out = [free - self.drag * v for free, v in zip(self.free, self.v, strict=False)] + [ZERO]
        for j in range(self.k):
            if self.state[j] == PRESSING:
                force = self._force(j)
                out[self.left[j]] -= force * self.inverse[self.left[j]]
                out[self.right[j]] += force * self.inverse[self.right[j]]
        return out

    def _begin(self) -> None:
        """Close the contacts in touch whose bodies approach each other, and leap over their singular start."""
        started = []
        for j in range(self.k):
            if self.state[j] != OPEN or self.s[j] < 0:
                continue
            a = self._accelerations()
            bend = a[self.left[j]] - a[self.right[j]]
            if self.s[j] > 0:  # it has crept out of touch, without a force that could be felt
                self.state[j] = PRESSING
            elif self._rate(j) > 0 or (self._rate(j) == 0 and bend > 0):
                self.state[j] = PRESSING
                self.peak[j] = max(self.peak[j], self._force(j))
                started.append(j)
        if not started:
            return
        a, width = self._accelerations(), self.end - self.now
        for j in started:
            rate, bend = self._rate(j), a[self.left[j]] - a[self.right[j]]
            mass = 1 / (self.inverse[self.left[j]] + self.inverse[self.right[j]])
            if rate > 0:
                n = self.power[j] + 1
                width = min(width, _power(n * mass * rate * rate / (2 * self.stiffness[j]), 1 / n) / rate)
                width = min(width, rate / -bend) if bend < 0 else width
            elif bend > 0:
                depth = _power(mass * bend / self.stiffness[j], 1 / self.power[j])
                width = min(width, (depth / bend).sqrt())
        self._leap(width * LEAP)

    def _leap(self, h: Decimal) -> None:
        """Advance with constant accelerations, and open what parts within it."""
        a = self._accelerations()
        for j in range(self.k):
            self.s[j] += self._rate(j) * h + (a[self.left[j]] - a[self.right[j]]) * h * h / 2
            if self.s[j] < 0:
                self.state[j] = OPEN
        for i in range(self.n):
            self.x[i] += self.v[i] * h + a[i] * h * h / 2
            self.v[i] += a[i] * h
        self.now += h

    def _step(self) -> None:
        """Advance by one step of the series, or to the first event in it."""
        v, x, s, u, powers, f = self._series()
        h = self.end - self.now
        for j, each in powers.items():
            tolerance = TOLERANCE * self._tolerated(j)
            for series in each:
                for o in (ORDER - 1, ORDER):
                    if series[o]:
                        h = min(h, _root_of_order(tolerance * series[0] / abs(series[o]), o))
        if self.drag:
            fastest = max(map(abs, self.v))
            for i in range(self.n):
                if v[i][ORDER]:
                    h = min(h, _root_of_order(TOLERANCE * fastest / abs(v[i][ORDER]), ORDER))
        events = [event for j in range(self.k) for event in self._events(j, h, s[j], f[j])]
        h, change, which = min(events, default=(h, "", -1))
        for j in range(self.k):
            self._observe(j, h, s[j], u[j], f[j])
        ends = not change and h == self.end - self.now
        self.x, self.s, self.v = ([_value(series, h) for series in each] for each in (x, s, v))
        self.now = self.end if ends else self.now + h
        if change in ("close", "open"):
            self.s[which] = ZERO
        if change:
            self.state[which] = {"close": OPEN, "open": OPEN, "slack": SLACK, "press": PRESSING}[change]
        self.switched = which if change in ("slack", "press") else -1
        for j in range(self.k):
            self._fade(j)

    def _tolerated(self, j: int) -> Decimal:
        """Return how many times as inexact a force may be as one that is felt.

        In a row of touching bodies the front is 1e-122 m deep three contacts ahead, where every step would be short.
        """
        own = self.stiffness[j] * _power(self.s[j], self.power[j])
        bodies = {self.left[j], self.right[j]} - {self.n}
        others = (
            abs(self._force(i))
            for i in range(self.k)
            if i != j and self.state[i] == PRESSING and bodies & {self.left[i], self.right[i]}
        )
        return max(Decimal(1), UNFELT * max(others, default=ZERO) / own)

    def _fade(self, j: int) -> None:
        """Open a contact whose overlap is nothing and falls."""
        self.deepest[j] = max(self.deepest[j], self.s[j]) if self.state[j] != OPEN else ZERO
        if self.state[j] != OPEN and self._rate(j) < 0 and ZERO < self.s[j] <= LEAP * self.deepest[j]:
            wait = self.s[j] / -self._rate(j)
            if wait < self.end - self.now:
                self._leap(wait)
                self.s[j], self.state[j] = ZERO, OPEN

    def _series(
        self,
    ) -> tuple[list[Series], list[Series], list[Series], list[Series], dict[int, list[Series]], list[Series]]:
        """Return the series of velocities, displacements, overlaps, closing rates, powers of overlaps and forces."""
        v, x, s = ([[value] for value in values] for values in (self.v, self.x, self.s))
        u, f = ([list[Decimal]() for _ in range(self.k)] for _ in range(2))
        live = [j for j in range(self.k) if self.state[j] != OPEN and self.s[j] > 0]
        inverse = {j: 1 / self.s[j] for j in live}
        elastic, viscous = ({j: list[Decimal]() for j in live} for _ in range(2))
        for o in range(ORDER + 1):
            g = [(self.free[i] if o == 0 else ZERO) - self.drag * v[i][o] for i in range(self.n)] + [ZERO]
            for j in range(self.k):
                u[j].append(v[self.left[j]][o] - v[self.right[j]][o])
            for j in live:
                elastic[j].append(_next_of_power(elastic[j], s[j], self.power[j], inverse[j]))
                force = self.stiffness[j] * elastic[j][o] - (self.pull_off[j] if o == 0 else ZERO)
                if self.damping[j]:
                    viscous[j].append(_next_of_power(viscous[j], s[j], self.damping_power[j], inverse[j]))
                    force += self.damping[j] * sum(map(mul, viscous[j], reversed(u[j])))
                f[j].append(force)
                if self.state[j] == PRESSING:
                    g[self.left[j]] -= force * self.inverse[self.left[j]]
                    g[self.right[j]] += force * self.inverse[self.right[j]]
            for i in range(self.n + 1):
                x[i].append(v[i][o] / (o + 1))
                v[i].append(g[i] / (o + 1) if i < self.n else ZERO)
            for j in range(self.k):
                s[j].append(u[j][o] / (o + 1))
        return v, x, s, u, {j: [each for each in (elastic[j], viscous[j]) if each] for j in live}, f

    def _events(self, j: int, h: Decimal, s: Series, f: Series) -> list[tuple[Decimal, str, int]]:
        """Return the first change of state of a contact within a step, of each kind."""
        out = []
        if self.state[j] == OPEN:
            return [(time, "close", j) for time, falls in changes(s, h) if not falls and s[0] <= 0][:1]
        out += [(time, "open", j) for time, falls in changes(s, h) if falls][:1]
        if self.clip and self.damping[j] and f:
            f = [ZERO, *f[1:]] if j == self.switched else f  # it is 0 but for its digits
            sign, presses = next((value for value in f if value), ZERO), self.state[j] == PRESSING
            change = "slack" if presses else "press"
            if (sign < 0) == presses and sign:
                return [*out, (ZERO, change, j)]
            out += [(time, change, j) for time, falls in changes(f, h) if falls == presses][:1]
        return out

    def _observe(self, j: int, h: Decimal, s: Series, u: Series, f: Series) -> None:
        """Keep the largest force of a contact, its first maximal compression, and the turns while it is open."""
        rated = max(abs(u[0]), abs(_value(u, h))) > NOISE * max(map(abs, self.v))
        turns = [time for time, falls in changes(u, h) if falls and rated]
        if self.state[j] == OPEN or not f:
            self.turns[j] += [_value(s, time) for time in turns]
            return
        if self.state[j] == PRESSING:
            tops = [time for time, falls in changes(_derivative(f), h) if falls]
            self.peak[j] = max([self.peak[j], *(_value(f, time) for time in (ZERO, *tops, h))])
        if math.isnan(self.crossing[j]):
            self.crossing[j] = next((float(self.now + time) for time in turns if _value(s, time) > 0), math.nan)


def changes(c: Series, h: Decimal) -> list[tuple[Decimal, bool]]:
    """Return where in (0, h] a series changes its sign, in order, and whether it falls there."""
    lead = next((o for o, value in enumerate(c) if value), -1)
    swing = ZERO
    for value in reversed(c[1:]):
        swing = (swing + abs(value)) * h
    if lead < 0 or (lead == 0 and swing < abs(c[0])):
        return []
    slope = _derivative(c)
    grid = [h * i / PIECES for i in range(1, PIECES + 1)]
    if lead > 0:
        grid = [grid[0] / Decimal(2) ** i for i in range(HALVINGS, 0, -1)] + grid
    out = []
    low, before, tilt = ZERO, c[lead], slope[max(lead - 1, 0)]
    for high in grid:
        after, steep = _value(c, high), _value(slope, high)
        if before and (before > 0) != (after > 0):
            out.append((_between(c, low, high), before > 0))
        elif before and after and (before > 0) == (tilt < 0) and (after > 0) == (steep > 0) and tilt and steep:
            middle = _between(slope, low, high)
            if (_value(c, middle) > 0) != (before > 0):
                out += [(_between(c, low, middle), before > 0), (_root(c, middle, high), before <= 0)]
        low, before, tilt = high, after, steep
    return out


def _between(c: Series, low: Decimal, high: Decimal) -> Decimal:
    """Return the root between two ends of different signs; a root at 0 itself is divided out."""
    lead = next(o for o, value in enumerate(c) if value) if low == 0 else 0
    return _root(c[lead:], low, high)


def _root(c: Series, low: Decimal, high: Decimal) -> Decimal:
    """Return the root between two ends of different signs, by halving and secants in turn."""
    at_low, at_high = _value(c, low), _value(c, high)
    for turn in range(400):
        if not at_high or high - low <= high * Decimal("1e-36"):
            break
        middle = low - at_low * (high - low) / (at_high - at_low) if turn % 3 else (low + high) / 2
        middle = middle if low < middle < high else (low + high) / 2
        at = _value(c, middle)
        if (at > 0) == (at_high > 0):
            high, at_high = middle, at
        else:
            low, at_low = middle, at
    return high


def _value(c: Sequence[Decimal], t: Decimal) -> Decimal:
    total = ZERO
    for value in reversed(c):
        total = total * t + value
    return total


def _derivative(c: Series) -> Series:
    return [value * o for o, value in enumerate(c)][1:]


def _next_of_power(power: Series, s: Series, p: Decimal, inverse: Decimal) -> Decimal:
    """Return the next coefficient of ``s^p``; ``inverse`` is 1/s[0]."""
    o = len(power)
    if o == 0:
        return _power(s[0], p)
    terms = map(mul, map(mul, _factors(p, o), s[1 : o + 1]), reversed(power))
    return sum(terms, start=ZERO) * inverse / o


@cache
def _factors(p: Decimal, o: int) -> tuple[Decimal, ...]:
    """Return the factors ``p d - (o - d)`` of the recurrence, for d from 1 to ``o``."""
    return tuple(p * d - (o - d) for d in range(1, o + 1))


def _power(value: Decimal, p: Decimal) -> Decimal:
    """Return ``value^p`` for p >= 0; 0^0 is 1."""
    if not value:
        return Decimal(int(p == 0))
    whole = int(p)
    if p - whole in (0, Decimal("0.5")):
        return value**whole * (value.sqrt() if p != whole else 1)
    return (value.ln() * p).exp()


def _root_of_order(value: Decimal, o: int) -> Decimal:
    """Return about the ``o``-th root."""
    tens = (math.log10(float(value.scaleb(-value.adjusted()))) + value.adjusted()) / o
    return Decimal(10.0 ** (tens - math.floor(tens))).scaleb(math.floor(tens))


def _decimals(values: Sequence[float] | NDArray[np.float64]) -> Series:
    return [Decimal(float(value)) for value in values]
