"""Ties: moments of a run that fall on a time step within round-off, so that rounding decides what the step sees.

A contact that closes, opens or turns exactly at a step is closed there for one rounding of positions and open for
another. Each step rounds the position of a body by at most half of its last digit, so that after n steps an overlap is
known to n last digits of a position only, and the time of an event to k = n of them over the closing rate. After
collisions the limit is 20 times what absolute positions change in our code, if that is more.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.backends.base import backend, unsupported_reason
from dem_bridge.errors import DemBridgeError, SceneError
from dem_bridge.foundation.wording import number, share
from dem_bridge.judging.check.law import MULTIPLE_OF_RADIUS_CHANGE
from dem_bridge.judging.deck import UserDeck
from dem_bridge.judging.twin_run import twin_run, with_wider_gaps
from dem_bridge.lmp.reader.evaluation import UNITS
from dem_bridge.observables.verdict import plain
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: values of a run, steps times bodies, up to which ties are looked for: about 0.3 GB
MOST_VALUES = 4_000_000
#: ties whose effect is measured, each by two runs, and samples of these runs
_MOST_MEASURED, _SAMPLES = 8, 200
#: multiple of the effect of a round-off elsewhere from which on an effect is that of the tie
_MULTIPLE_OF_ANY_ROUNDING = 10.0
#: round-offs within which a time in steps is a whole number: two products, a quotient and the number itself round
ROUND_OFFS_OF_A_QUOTIENT = 4.0
#: closing rate below which a contact rests: it crosses the limits of round-off in no less than so many steps
_STEPS_OF_REST = 2.0
#: least effect that is told in the terminal, relative to the largest velocity: digits that LAMMPS' own tests compare
LEAST_EFFECT_TOLD = 1e-12
_CALL = re.compile(r"\b(floor|ceil)\(")


@dataclass(frozen=True, kw_only=True)
class Tie:
    """One moment that falls on a step within round-off."""

    kind: str
    """"touch", "opening", "graze", "simultaneous touches", "dump time" or "segment end"."""
    contacts: tuple[int, ...]
    """Contacts of the scene; none for times of dumps and segments."""
    step: int
    time: float
    """Time of the step, s."""
    distance: float
    """Overlap at the step, m; of times, the distance from the step in steps."""
    allowed: float
    """What round-off explains of it, in the same unit."""
    round_offs: float
    """The same in last digits of the farthest position, or of a number of steps: k."""
    effect: float
    """Largest change of a velocity by the tie, relative to the largest; 0 if the same round-off changes about as much
    without a tie; nan where it was not measured."""
    mend: str
    """What removes the tie."""

    @property
    def sentence(self) -> str:
        """The tie with its effect and what mends it."""
        names = " and ".join(map(str, self.contacts))
        what = f"the {self.kind} of contact{'s' * (len(self.contacts) > 1)} {names}" if names else f"a {self.kind}"
        where = f"falls on step {self.step} ({self.time:.6g} s)"
        if self.kind in ("touch", "opening"):
            where += f" within {self.round_offs:.0f} last digits of positions, which is their round-off by then"
        if self.kind == "graze":
            where = f"is within round-off or half a step at step {self.step} ({self.time:.6g} s)"
        elif self.kind == "simultaneous touches":
            where = f"fall together after step {self.step} ({self.time:.6g} s)"
        size = "how much depends on it was not measured"
        if math.isfinite(self.effect):
            size = f"velocities depend on rounding from {share(self.effect)} of the largest on"
            if self.effect < LEAST_EFFECT_TOLD:
                size = "no more digits depend on it than on any rounding"
        return f"{what} {where}: {size}; {self.mend}"

    @property
    def told(self) -> bool:
        """True if more digits depend on the tie than on any rounding."""
        return self.effect >= LEAST_EFFECT_TOLD

    def as_json(self) -> dict[str, object]:
        """Return the fields and the sentence."""
        return {
            "kind": self.kind,
            "contacts": list(self.contacts),
            "step": self.step,
            "time": self.time,
            "distance": plain(self.distance),
            "allowed": plain(self.allowed),
            "round_offs": plain(self.round_offs),
            "effect": plain(self.effect),
            "mend": self.mend,
            "sentence": self.sentence,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """Overlaps of all contacts at all steps."""

    scene: Scene
    dt: float
    overlap: Floats
    """m, negative if open, ``(n_step + 1, n_contact)``; the other arrays alike."""
    rate: Floats
    """Closing rate, m/s."""
    doubt: Floats
    """Round-off of the overlap, m."""
    speed: float
    """Largest velocity, m/s."""
    change: float
    """Largest change of a velocity in a step, m/s."""
    digit: float
    """Last digit of the farthest position, m."""

    @property
    def steps(self) -> int:
        return len(self.overlap) - 1


def ties_of(deck: UserDeck) -> tuple[tuple[Tie, ...], str]:
    """Return the ties of a script, the largest effect first, and why they were not looked for; '' if they were.

    Ties of times that the script states (dumps by time, numbers of steps by ``floor`` or ``ceil``) need no scene.
    """
    motion, why = _motion(deck)
    ties = list(_of_times(deck, motion))
    if motion is not None and deck.read is not None:
        events = sorted(_of_contacts(motion, _start_gaps(deck)), key=lambda tie: tie.time)
        measured = [replace(tie, effect=_effect(motion, tie)) for tie in events[:_MOST_MEASURED]]
        ties += [*measured, *events[_MOST_MEASURED:]]
    ties.sort(key=lambda tie: -tie.effect if math.isfinite(tie.effect) else 0.0)
    return tuple(ties), why


def _motion(deck: UserDeck) -> tuple[_Motion | None, str]:
    """Return the overlaps of a script at all steps by our code; None and the reason where there are none."""
    if deck.read is None or deck.dt is None or deck.state.steps < 1:
        return None, "the script is not read as a scene with one time step"
    scene, steps = deck.read.scene, deck.state.steps
    if reason := unsupported_reason(backend("verlet"), scene):
        return None, reason
    if steps * scene.n_body > MOST_VALUES:
        return None, f"{steps} steps of {scene.n_body} bodies are more than {MOST_VALUES} values"
    try:
        plainly = _run(scene, deck.dt, steps, steps, None)
        absolute = plainly if deck.radius is None else _run(scene, deck.dt, steps, steps, deck.radius)
    except DemBridgeError as error:
        return None, str(error)
    c = scene.contacts
    moved, other, velocity = (np.pad(part, ((0, 0), (0, 1))) for part in (plainly[1], absolute[1], plainly[0]))
    overlap = moved[:, c.left] - moved[:, c.right] - c.gap
    apart = np.abs(other[:, c.left] - other[:, c.right] - c.gap - overlap)
    digit = math.ulp(_farthest(deck)) * UNITS[deck.state.units][0]
    doubt = np.maximum(
        np.arange(steps + 1)[:, None] * digit, MULTIPLE_OF_RADIUS_CHANGE * np.maximum.accumulate(apart, axis=0)
    )
    return _Motion(
        scene=scene,
        dt=deck.dt,
        overlap=overlap,
        rate=velocity[:, c.left] - velocity[:, c.right],
        doubt=doubt,
        speed=float(np.max(np.abs(velocity))) or 1.0,
        change=float(np.max(np.abs(np.diff(velocity, axis=0)))),
        digit=digit,
    ), ""


def _run(scene: Scene, dt: float, steps: int, samples: int, radius: float | None) -> tuple[Floats, Floats]:
    """Return velocities and displacements of our code at so many samples of a run of so many steps."""
    run = twin_run(replace(scene, duration=dt * steps, samples=samples), dt, radius)
    return run.velocity, run.displacement


def _farthest(deck: UserDeck) -> float:
    """Return the largest coordinate of an atom or a wall at the start, in the unit of the script."""
    assert deck.read is not None  # checked before
    line = deck.read.line
    planes = [abs(plane.position) for plane in line.planes if plane is not None]
    return max([abs(atom.place[line.axis]) for atom in line.atoms] + planes)


def _start_gaps(deck: UserDeck) -> Floats:
    """Return the gaps of the contacts as the positions of the script have them, m, in the order of the scene."""
    assert deck.read is not None  # checked before
    line, length = deck.read.line, UNITS[deck.state.units][0]
    return np.array([line.contacts[k].gap * length for k in line.order])


# ---------------------------------------------------------------- contacts
def _of_contacts(motion: _Motion, gaps: Floats) -> Iterator[Tie]:
    """Yield touches, openings and turns of contacts at a step, and touches of neighbours at one moment."""
    for contact in range(motion.overlap.shape[1]):
        near = np.flatnonzero(np.abs(motion.overlap[:, contact]) <= motion.doubt[:, contact])
        for group in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1):
            if len(group) and (tie := _of_group(motion, gaps, contact, int(group[0]), int(group[-1]))) is not None:
                yield tie
        yield from _turns(motion, contact)
    yield from _simultaneous(motion)


def _of_group(motion: _Motion, gaps: Floats, contact: int, first: int, last: int) -> Tie | None:
    """Return the tie of successive steps at which an overlap is zero within round-off; None if it is none."""
    overlap, rate = motion.overlap[:, contact], motion.rate[:, contact]
    if first == 0:
        # positions that touch exactly are no tie: their difference has no rounding
        doubt = 2.0 * math.ulp(max(abs(gaps[contact]), 1e-300))
        closes = rate[0] > 0.0 and last <= 1
        return _tie(motion, "touch", contact, 0, doubt) if closes and gaps[contact] != 0.0 else None
    before = overlap[first - 1]
    after = overlap[last + 1] if last < motion.steps else math.copysign(1.0, rate[last])
    step = first + int(np.argmin(np.abs(overlap[first : last + 1])))
    rests = abs(rate[step]) * motion.dt * _STEPS_OF_REST <= motion.doubt[step, contact]
    if before < 0.0 < after:
        return None if rests else _tie(motion, "touch", contact, step)
    if after < 0.0 < before:
        return None if rests else _tie(motion, "opening", contact, step)
    return _tie(motion, "graze", contact, step) if last < motion.steps else None


def _turns(motion: _Motion, contact: int) -> Iterator[Tie]:
    """Yield the turns of an open contact between two steps whose nearest approach a step may see or miss."""
    overlap, rate, doubt = (part[:, contact] for part in (motion.overlap, motion.rate, motion.doubt))
    outside = (overlap[:-1] < -doubt[:-1]) & (overlap[1:] < -doubt[1:])
    for step in np.flatnonzero(outside & (rate[:-1] > 0.0) & (rate[1:] < 0.0)).tolist():
        turn = (rate[step] - rate[step + 1]) / motion.dt
        nearest = overlap[step] + rate[step] ** 2 / (2.0 * turn)
        missed = 0.125 * turn * motion.dt**2  # the most that a contact overlaps between two steps that see it open
        if abs(nearest) <= missed:
            yield _tie(motion, "graze", contact, step if overlap[step] > overlap[step + 1] else step + 1, missed)


def _simultaneous(motion: _Motion) -> Iterator[Tie]:
    """Yield touches of two neighbouring contacts at one moment within round-off."""
    c = motion.scene.contacts
    touches = [list(_touches(motion, contact)) for contact in range(motion.overlap.shape[1])]
    for one in range(len(touches)):
        for other in range(one + 1, len(touches)):
            bodies = {int(c.left[one]), int(c.right[one])} & {int(c.left[other]), int(c.right[other])}
            if not bodies - {motion.scene.n_body}:
                continue
            for time, within in touches[one]:
                for time_of_other, within_of_other in touches[other]:
                    if abs(time - time_of_other) <= within + within_of_other:
                        step = math.floor(time / motion.dt)
                        tie = _tie(motion, "simultaneous touches", one, step, 1.0)
                        limit = (within + within_of_other) / motion.dt
                        shift = number(0.5 * abs(motion.rate[step, one]) * motion.dt)
                        yield replace(
                            tie,
                            contacts=(one, other),
                            distance=abs(time - time_of_other) / motion.dt,
                            allowed=limit,
                            mend=f"a gap of contact {one} that is {shift} m wider parts them by half a step",
                        )


def _touches(motion: _Motion, contact: int) -> Iterator[tuple[float, float]]:
    """Yield time, s, and its round-off of each touch of a contact.

    Within a step velocity Verlet moves bodies on parabolas by velocities and forces at its begin, before the touch.
    """
    overlap, rate, doubt = (part[:, contact] for part in (motion.overlap, motion.rate, motion.doubt))
    closes = (overlap[:-1] < -doubt[:-1]) & (overlap[1:] >= -doubt[1:]) & (rate[:-1] > 0.0)
    for step in np.flatnonzero(closes).tolist():
        low, slope = float(overlap[step]), float(rate[step]) * motion.dt
        bend = float(overlap[step + 1]) - low - slope
        part = -low / slope
        for _ in range(3):  # Newton's method; the parabola is nearly straight
            part -= (low + part * (slope + part * bend)) / (slope + 2.0 * part * bend or slope)
        within = float(doubt[step + 1]) / float(rate[step])
        yield (step + part) * motion.dt, within + 2.0 * math.ulp((step + 1.0) * motion.dt)


def _tie(motion: _Motion, kind: str, contact: int, step: int, doubt: float | None = None) -> Tie:
    """Return the tie of a contact at a step, without its effect."""
    limit = float(motion.doubt[step, contact]) if doubt is None else doubt
    rate, time = abs(float(motion.rate[step, contact])), step * motion.dt
    shorter = motion.dt * step / (step + 0.5)
    step_that_mends = f"a time step of {shorter:.6g} s moves it to the middle of a step" if step else ""
    if kind == "touch":
        shift = f"a gap that is {number(0.5 * rate * motion.dt)} m wider (half a step of the approach)"
        mend = f"{shift}, or {step_that_mends}" if step else f"{shift} removes it"
    elif kind == "opening":
        mend = step_that_mends
    else:
        mend = "no shift by a step removes it: change a gap or a speed"
    return Tie(
        kind=kind,
        contacts=(contact,),
        step=step,
        time=time,
        distance=float(motion.overlap[step, contact]),
        allowed=limit,
        round_offs=limit / motion.digit,
        effect=math.nan,
        mend=mend,
    )


def _effect(motion: _Motion, tie: Tie) -> float:
    """Return by how much velocities differ if a contact closes a round-off earlier or later, relative; nan if unknown.

    What the same round-off changes where the contact is half a step of its approach away is no effect of the tie.
    """
    if motion.scene.precompression:
        return math.nan  # its gaps follow from the load
    per_sample = math.ceil(motion.steps / _SAMPLES)
    samples = math.ceil(motion.steps / per_sample)
    # a step of a contact with a turn sees it or not by much more than round-off
    shift = tie.allowed if tie.kind != "simultaneous touches" else float(motion.doubt[tie.step, tie.contacts[0]])
    contact, away = tie.contacts[0], 0.5 * abs(float(motion.rate[tie.step, tie.contacts[0]])) * motion.dt

    def velocity(by: float) -> Floats:
        scene = with_wider_gaps(motion.scene, by * (np.arange(motion.scene.n_contact) == contact))
        return _run(scene, motion.dt, per_sample * samples, samples, None)[0]

    try:
        here, elsewhere = (
            float(np.max(np.abs(velocity(middle - shift) - velocity(middle + shift)))) for middle in (0.0, away)
        )
    except DemBridgeError:
        return math.nan
    return (here if here > _MULTIPLE_OF_ANY_ROUNDING * elsewhere else 0.0) / motion.speed


# ---------------------------------------------------------------- times
def _of_times(deck: UserDeck, motion: _Motion | None) -> Iterator[Tie]:
    """Yield dumps by time and numbers of steps by ``floor`` or ``ceil`` that are a whole number within round-off."""
    if deck.dt is None:
        return
    unit = UNITS.get(deck.state.units, (1.0, 1.0, 1.0))[1]
    effect = math.nan if motion is None else motion.change / motion.speed
    for command in deck.commands:
        words = command.rest
        if command.name == "dump_modify" and "every/time" in words[:-1]:
            try:
                interval = float(words[words.index("every/time") + 1])
            except ValueError:
                continue
            if _is_whole(steps := interval * unit / deck.dt):
                mend = f"dump every {round(steps)} steps in place of every/time"
                yield _of_time(deck.dt, "dump time", steps, effect, mend)
    for steps in _rounded_numbers(deck):
        yield _of_time(deck.dt, "segment end", steps, effect, f"write the number of steps: {round(steps)}")


def _of_time(dt: float, kind: str, steps: float, effect: float, mend: str) -> Tie:
    return Tie(
        kind=kind,
        contacts=(),
        step=round(steps),
        time=round(steps) * dt,
        distance=steps - round(steps),
        allowed=ROUND_OFFS_OF_A_QUOTIENT * math.ulp(steps),
        round_offs=ROUND_OFFS_OF_A_QUOTIENT,
        effect=effect,
        mend=mend,
    )


def _is_whole(steps: float) -> bool:
    """Return True if a number of steps is a whole number within round-off."""
    return steps >= 0.5 and abs(steps - round(steps)) <= ROUND_OFFS_OF_A_QUOTIENT * math.ulp(steps)


def _rounded_numbers(deck: UserDeck) -> Iterator[float]:
    """Yield the arguments of ``floor`` and ``ceil`` in formulas of the script that are whole within round-off."""
    script = deck.state.script
    formulas = [" ".join(words) for style, words in script.variables.values() if style == "equal"]
    at = deck.state.run or deck.state.last
    if at is None:
        return
    for formula in formulas:
        for match in _CALL.finditer(formula):
            inner = _bracketed(formula, match.end())
            if "/" not in inner or "step" in inner:
                continue
            try:
                value = script.evaluated(at, inner)
            except SceneError:
                continue
            if _is_whole(value):
                yield value


def _bracketed(text: str, start: int) -> str:
    """Return the text up to the bracket that closes the one before ``start``."""
    depth = 1
    for place in range(start, len(text)):
        depth += {"(": 1, ")": -1}.get(text[place], 0)
        if depth == 0:
            return text[start:place]
    return text[start:]
