"""The motion that ``fix move`` prescribes to an atom at the end of a chain, as a Piston.

``linear`` and ``wiggle`` state it. Formulas of ``variable`` are evaluated at steps of the run: the constant, the sine
or the table that has their values is the motion, up to round-off, or the script is refused (LAMMPS manual, *fix move*).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from dem_bridge.lmp.reader.evaluation import UNITS, ReadScript
from dem_bridge.lmp.reader.formula import plain
from dem_bridge.lmp.reader.script import Command
from dem_bridge.physics.contact_law import Floats
from dem_bridge.scene.piston import Piston

#: part of the largest velocity, or of the distance at it, that is round-off: phases of many turns lose digits
WITHIN = 1e-10
#: steps of a run at which formulas are evaluated, and those of the first fit of a sine
_STEPS, _FIRST = 400, 33
_ALLOWED = (
    "fix ID GROUP move linear V 0 0, wiggle A 0 0 PERIOD, or variable with displacement and velocity along the chain"
)
_VARIABLE = re.compile(r"v_(\w+)")
#: the interval in a formula of the cells of a table
_INTERVAL = re.compile(r"floor\([^/]*/\s*([\d.eE+-]+)\)")


def piston_of(script: ReadScript, command: Command, axis: int, sign: float) -> tuple[Piston, str]:
    """Return the motion of an atom of ``fix move`` along a chain, in SI, and a note on it or "".

    Parameters
    ----------
    script : ReadScript
        The evaluated script.
    command : Command
        The ``fix move`` command.
    axis : int
        Axis of the chain.
    sign : float
        +1 if the positive direction of the scene is that of the axis, else -1.

    Raises
    ------
    SceneError
        If the motion is none of a Piston, or not along the chain.
    """
    style, *words = (*command.rest[3:], "")
    count = {"linear": 3, "wiggle": 4, "variable": 6}.get(style, 0)
    options = words[count:-1]
    if not count or len(words) <= count or options not in ([], ["units", "box"], ["units", "lattice"]):
        raise command.error("moves atoms in a way that is not supported", _ALLOWED)
    across = [k for k in range(3) if k != axis]
    if style == "variable":
        other = {words[k + part] for k in across for part in (0, 3)}
        command.fail_if(not other <= {"NULL"}, "moves an atom across the chain by formulas", _ALLOWED)
        return _by_formulas(script, command, words[axis], words[3 + axis], sign)
    command.fail_if(words[axis] == "NULL", "does not move the atom along the chain", _ALLOWED)
    particles = script.particles
    if any(words[k] != "NULL" and script.script.number(command, words[k]) for k in across):
        raise command.error("moves an atom across the chain", _ALLOWED)
    length, time, _ = UNITS[script.units]
    size = sign * particles.scaled(command, words[axis]) * length
    if style == "linear":
        return Piston(shape="constant", velocity=_short(size / time)), ""
    period = script.script.number(command, words[3]) * time
    command.fail_if(not period > 0.0 or size == 0.0, "has no amplitude or no period", _ALLOWED)
    # a sin(2 pi t / period): the velocity is largest at time 0
    speed = _short(abs(size) * 2.0 * math.pi / period)
    phase = math.copysign(90.0, size)
    return Piston(shape="sine", velocity=speed, frequency=_short(1.0 / period), phase=phase), ""


def _short(value: float) -> float:
    """Return a number of a script without the last digits of its conversion."""
    return plain(value, 8.0 * math.ulp(value))


def _by_formulas(script: ReadScript, command: Command, place: str, velocity: str, sign: float) -> tuple[Piston, str]:
    """Return the motion of ``move variable`` with these words along the chain, and a note."""
    length, time, _ = UNITS[script.units]
    command.fail_if(velocity == "NULL", "gives an atom no velocity along the chain", _ALLOWED)
    several = len(script.time_steps) > 1 or not script.step
    command.fail_if(several, "has formulas of the step, whose size changes", "one time step for all runs")
    step = script.step or math.nan
    steps = np.unique(np.rint(np.linspace(0, round(script.duration / step), _STEPS)).astype(np.int64))
    at = steps * step * time
    speed_of, unit = _values(script, command, velocity), sign * length / time
    finer = _values(script, command, velocity, finer=2)
    values = unit * np.array([speed_of(number) for number in steps.tolist()])
    peak = float(np.max(np.abs(values)))
    for piston in _candidates(script, command, velocity, unit, (steps, values), step * time):
        if np.max(np.abs(piston.at(at) - values)) <= WITHIN * max(peak, piston.peak):
            break
    else:
        raise command.error("has a velocity that is neither constant, nor a sine, nor a table of values", _ALLOWED)
    notes = []
    if script.counter == script.steps and any(finer(number) != speed_of(number) for number in steps[:9].tolist()):
        notes.append("its formulas have the time step as a number, and are wrong at others; write step*dt in them")
    if place == "NULL":
        notes.append("it has a velocity alone, which LAMMPS adds up to first order in the time step")
        return piston, f"the moved atom: {'; '.join(notes)}"
    place_of = _values(script, command, place)
    places = sign * length * np.array([place_of(number) for number in steps.tolist()])
    off = np.abs(places - piston.displacement(at))
    if np.max(off) > WITHIN * piston.peak * float(at[-1]):
        k = int(np.argmax(off))
        problem = f"has a displacement that is not the integral of its velocity: {off[k]:.3g} m off at step {steps[k]}"
        raise command.error(problem, _ALLOWED)
    return piston, f"the moved atom: {'; '.join(notes)}" if notes else ""


def _values(script: ReadScript, command: Command, word: str, finer: int = 1) -> Callable[[int], float]:
    """Return the value of a variable, in the units of the script, as a function of the number of steps done.

    With steps that are ``finer`` it is the value at the same time.
    """
    parser, start = script.script, script.counter - script.steps
    name = word.removeprefix("v_")
    style, words = parser.variables.get(name, ("", ()))
    command.fail_if(word == name or style != "equal", f"has {word}, which is no formula", "v_NAME of style equal")

    def value(number: int) -> float:
        known = parser.keywords
        step, done = (script.step or math.nan) / finer, float(finer * number)
        parser.keywords = {**known, "step": start + done, "elapsed": done, "time": done * step, "dt": step}
        try:
            return parser.evaluated(command, " ".join(words))
        finally:
            parser.keywords = known

    return value


def _candidates(
    script: ReadScript,
    command: Command,
    word: str,
    unit: float,
    samples: tuple[NDArray[np.int64], Floats],
    dt: float,
) -> Iterator[Piston]:
    """Yield pistons that may have the ``samples``: steps of ``dt`` (s) and velocities (m/s), ``unit`` times a value."""
    steps, values = samples
    if np.ptp(values) == 0.0:
        yield Piston(shape="constant", velocity=float(values[0]))
        return
    yield from _tables(script, command, word, unit, float(steps[-1] * dt))
    speed_of = _values(script, command, word)
    # of long strides the last digits do not matter, and in short ones no turn is missed
    for stride in dict.fromkeys(max(1, int(steps[-1]) // part) for part in (64, 512, 4096, 10**9)):
        first = stride * np.arange(min(_FIRST, int(steps[-1]) // stride + 1))
        near = unit * np.array([speed_of(number) for number in first.tolist()])
        inner = float(np.sum(near[1:-1] ** 2))
        cosine = float(np.sum(near[1:-1] * (near[:-2] + near[2:]))) / (2.0 * inner) if inner > 0.0 else 1.0
        if abs(cosine) < 1.0:
            yield _sine(np.concatenate([first, steps]) * dt, np.concatenate([near, values]), cosine, stride * dt)


def _sine(time: Floats, values: Floats, cosine: float, stride: float) -> Piston:
    """Return the sine with the values, by least squares over windows that grow from a few ``stride`` (s) to all."""
    turn, end = math.acos(cosine) / stride, 4.0 * stride
    sine = 0.0, 0.0
    while True:
        end *= 2.0
        t, v = time[time <= end], values[time <= end]
        sine = tuple(np.linalg.lstsq(np.stack([np.sin(turn * t), np.cos(turn * t)], axis=1), v)[0].tolist())
        for _ in range(8):
            s, c = np.sin(turn * t), np.cos(turn * t)
            slope = t * (sine[0] * c - sine[1] * s)
            scale = max(float(np.max(np.abs(slope))), 1e-300)
            away = v - sine[0] * s - sine[1] * c
            change = np.linalg.lstsq(np.stack([s, c, slope / scale], axis=1), away)[0].tolist()
            sine, turn = (sine[0] + change[0], sine[1] + change[1]), turn + change[2] / scale
        if end >= time[-1]:
            break
    size, frequency = math.hypot(*sine), abs(turn) / (2.0 * math.pi)
    phase = math.degrees(math.atan2(sine[1], math.copysign(1.0, turn) * sine[0]))
    return Piston(
        shape="sine",
        velocity=plain(size, 0.1 * WITHIN * size) or 1e-300,
        frequency=plain(frequency, 0.1 * WITHIN * frequency) or 1e-300,
        phase=plain(phase, 10.0 * WITHIN),
    )


def _tables(script: ReadScript, command: Command, word: str, unit: float, end: float) -> Iterator[Piston]:
    """Yield the tables of vectors in the formula of a velocity, up to the ``end`` (s), at the interval of its cells."""
    parser, time = script.script, UNITS[script.units][1]
    texts, names = [], [word.removeprefix("v_")]
    for name in names:
        style, words = parser.variables.get(name, ("", ()))
        texts.append((style, name, " ".join(words)))
        names += [other for other in _VARIABLE.findall(texts[-1][2]) if style == "equal" and other not in names]
    intervals = {float(match) * time for style, _, text in texts for match in _INTERVAL.findall(text)}
    for interval in intervals if len(intervals) == 1 else ():
        for name in (name for style, name, _ in texts if style == "vector"):
            vector = np.array(parser.vector(command, name))
            count = min(len(vector), math.ceil(end / interval * (1.0 - 1e-12)) + 1)
            if count > 1:
                yield Piston(shape="table", velocity=tuple((vector[:count] * unit).tolist()), interval=interval)
