"""Read the file of a proved trajectory strictly: every number exactly, nothing missing, nothing that is not finite."""

from __future__ import annotations

import ctypes
import hashlib
import json
import math
import os
import re
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from flint import fmpq, fmpz
from numpy.typing import NDArray

from dem_bridge.errors import OF_DAMAGED_DATA, DemBridgeError, one_line
from dem_bridge.foundation.files import checked_file
from dem_bridge.proof.checker_guess import Bond, Chain
from dem_bridge.scene.scene import Scene

SCHEMA = "dem-bridge/proof/1"
#: largest size of a file, bytes, and largest number of bodies, checkpoints, samples and touches: bounds of the work
MOST_BYTES, MOST_BODIES, MOST_CHECKPOINTS, MOST_SAMPLES, MOST_TOUCHES = 2**24, 256, 2000, 10_000, 20_000
#: most characters of a number, and largest exponent of ten: exact numbers stay short
MOST_CHARACTERS, MOST_EXPONENT = 1200, 600
#: twice the power of a force, 2 (n - 1): forces have a bounded slope, and a root of the overlap makes them polynomials
LEAST_TWICE, MOST_TWICE = 2, 8
_DECIMAL = re.compile(r"-?\d+(?:\.(\d*))?(?:[eE]([+-]?\d{1,4}))?", re.ASCII)
_WHOLE = re.compile("-?[0-9]+")
_RATIONAL = re.compile(r"-?\d+(?:/[1-9]\d*)?", re.ASCII)
_HEX = re.compile(r"-?0x[01](?:\.[0-9a-f]{1,16})?p[+-]\d{1,4}", re.ASCII)


class NotProved(DemBridgeError):
    """A file whose claims are not established; the message gives the first reason."""

    exit_code = 1


class Disproved(NotProved):
    """A claim that is wrong."""


@dataclass(frozen=True)
class Check:
    """The result of a check: whether all claims are proved, or the first reason why not."""

    proved: bool
    sentence: str
    segments: int = 0
    pieces: int = 0


@dataclass(frozen=True)
class Ball:
    """All numbers within ``radius`` of ``middle``."""

    middle: fmpq
    radius: fmpq


@dataclass(frozen=True)
class Box:
    """A claim: at this time the state lies in these balls, and the overlaps of the ``closed`` contacts are positive."""

    time: fmpq
    x: tuple[Ball, ...]
    v: tuple[Ball, ...]
    closed: tuple[bool, ...]


@dataclass(frozen=True)
class Touch:
    """A claim: a contact closes or opens at a time in this ball."""

    contact: int
    closes: bool
    time: Ball


@dataclass(frozen=True)
class Sample:
    """A claim: at this time displacements and velocities lie in these balls."""

    time: fmpq
    x: tuple[Ball, ...]
    v: tuple[Ball, ...]


#: crossing time of a contact that has none: later than every end
NEVER = Ball(fmpq(10) ** 30, fmpq(0))


@dataclass(frozen=True)
class Extreme:
    """A claim: the largest overlap of a contact is in this ball, and so is the time of its first maximal compression.

    Overlaps below 0 count as 0. None stands for what is not claimed.
    """

    overlap: Ball | None
    at: fmpq
    """About the time of the largest overlap; a help, no claim."""
    crossing: Ball | None


@dataclass(frozen=True)
class Certificate:
    """The scene and the claims of a file."""

    name: str
    content_hash: str
    duration: fmpq
    chain: Chain
    boxes: tuple[Box, ...]
    touches: tuple[Touch, ...]
    samples: tuple[Sample, ...]
    extremes: tuple[Extreme, ...]


def read_certificate(path: str | Path) -> Certificate:
    """Return the claims of a file; raise NotProved unless it is a complete certificate, OSError if it is unreadable."""
    text = checked_file(path, MOST_BYTES).read_bytes()
    try:
        return _certificate(json.loads(text))
    except OF_DAMAGED_DATA as error:
        raise NotProved(f"the file is no certificate: {one_line(str(error) or type(error).__name__)}") from None


def end_with(parent: int) -> None:
    """Request that the kernel ends this process when its parent ends, by whatever signal; end if it has ended."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        os._exit(1)


def require(holds: bool, reason: str) -> None:
    """Raise NotProved with the reason unless something holds."""
    if not holds:
        raise NotProved(reason)


def _entries(data: Any, where: str, needed: str, optional: str = "") -> dict[str, Any]:
    """Return an object that has exactly the needed keys, and perhaps optional ones."""
    require(isinstance(data, dict), f"{where} is no object")
    missing, unknown = set(needed.split()) - set(data), set(data) - set(needed.split()) - set(optional.split())
    require(not missing and not unknown, f"{where} lacks {sorted(missing)} and has unknown {sorted(unknown)} keys")
    return dict(data)


def _items(data: Any, where: str, most: int, count: int | None = None) -> list[Any]:
    """Return a list of a given or bounded length."""
    require(isinstance(data, list) and len(data) <= most, f"{where} is no list of at most {most} entries")
    require(count is None or len(data) == count, f"{where} has {len(data)} entries in place of {count}")
    return list(data)


def exact(text: Any, *, dyadic: bool = False) -> fmpq:
    """Return the number that a text stands for: a decimal, a ratio or a hexadecimal double.

    >>> exact("-1.25e-2"), exact("3/8", dyadic=True), exact("0x1.8p+1")
    (-1/80, 3/8, 3)
    """
    require(isinstance(text, str) and len(text) <= MOST_CHARACTERS, f"{text!r} is no number as a text")
    if _HEX.fullmatch(text):
        value = Fraction(float.fromhex(text))
    elif decimal := (_DECIMAL.fullmatch(text) if not dyadic else None):
        require(abs(int(decimal[2] or 0)) <= MOST_EXPONENT, f"the exponent of {text!r} is above {MOST_EXPONENT}")
        value = Fraction(text)
    else:
        require(bool(_RATIONAL.fullmatch(text)), f"{text!r} is no exact number")
        value = Fraction(text)
    require(not dyadic or value.denominator & (value.denominator - 1) == 0, f"{text!r} is not dyadic")
    return fmpq(value.numerator, value.denominator)


def _ball(data: Any, where: str, short: bool = False) -> Ball:
    """Return the ball of a middle and a radius; if ``short``, a text stands for itself +- a unit of its last digit."""
    if short and isinstance(data, str):
        middle, decimal = exact(data), _DECIMAL.fullmatch(data)
        require(decimal is not None, f"{where}: {data!r} has no last digit")
        assert decimal is not None
        power = int(decimal[2] or 0) - len(decimal[1] or "")
        return Ball(middle, fmpq(10) ** power)
    pair = _items(data, where, 2, 2)
    ball = Ball(exact(pair[0]), exact(pair[1]))
    require(ball.radius >= 0, f"{where} has a negative radius")
    return ball


def _balls(data: Any, where: str, count: int, short: bool = False) -> tuple[Ball, ...]:
    return tuple(_ball(item, where, short) for item in _items(data, where, count, count))


def _chain(scene: dict[str, Any]) -> Chain:
    """Return the equations of motion of a scene."""
    mass = tuple(map(exact, _items(scene["mass"], "scene.mass", MOST_BODIES)))
    n = len(mass)
    require(n > 0 and all(m > 0 for m in mass), "a mass is not positive")
    gravity, load = exact(scene["gravity"]), _items(scene["constant_force"], "scene.constant_force", n, n)
    bonds = []
    for k, item in enumerate(_items(scene["contacts"], "scene.contacts", n + 1)):
        contact = _entries(item, f"contact {k}", "bodies stiffness exponent gap")
        beta, twice = exact(contact["stiffness"]), 2 * (exact(contact["exponent"]) - 1)
        require(beta > 0, f"the stiffness of contact {k} is not positive")
        known = twice.q == 1 and LEAST_TWICE <= twice <= MOST_TWICE
        require(known, f"the exponent of contact {k} is not 2, 5/2, 3, ... 5")
        ends = [tuple(contact["bodies"]) == pair for pair in ((k, k + 1), ("left", 0), (n - 1, "right"))]
        require(any(ends) and ends[0] == (k < n - 1), f"contact {k} joins {contact['bodies']!r}")
        left, right = ((k, k + 1), (None, 0), (n - 1, None))[ends.index(True)]
        bonds.append(Bond(left, right, beta, exact(contact["gap"]), int(twice.p)))
    require(len(bonds) >= n - 1, "a contact of the chain is missing")
    walls = [(bond.left, bond.right) for bond in bonds[n - 1 :]]
    require(walls == sorted(set(walls), key=lambda ends: ends[0] is not None), "walls: left, then right, each once")
    return Chain(mass, tuple(gravity * m + exact(f) for m, f in zip(mass, load, strict=True)), tuple(bonds))


def _box(item: Any, where: str, chain: Chain) -> Box:
    box, n = _entries(item, where, "time displacement velocity closed"), len(chain.mass)
    closed = _items(box["closed"], f"{where}.closed", len(chain.bonds), len(chain.bonds))
    require(all(isinstance(flag, bool) for flag in closed), f"{where}.closed holds no true or false")
    x, v = (_balls(box[key], f"{where}.{key}", n) for key in ("displacement", "velocity"))
    return Box(exact(box["time"], dyadic=True), x, v, tuple(closed))


def _touch(item: Any, where: str, chain: Chain) -> Touch:
    touch = _entries(item, where, "contact closes time")
    k, closes = touch["contact"], touch["closes"]
    known = type(k) is int and 0 <= k < len(chain.bonds) and isinstance(closes, bool)
    require(known, f"{where} names no contact, or does not say whether it closes")
    return Touch(k, closes, _ball(touch["time"], where))


def _samples(data: Any, duration: fmpq, count: Any, until: fmpq, n: int) -> tuple[Sample, ...]:
    """Return the samples: all times ``i duration / count`` up to the time that is proved, in order."""
    samples = _entries(data, "samples", "time displacement velocity", "power")
    times = list(map(exact, _items(samples["time"], "samples.time", MOST_SAMPLES)))
    require(type(count) is int and 0 < count < MOST_SAMPLES, "scene.count is no number of samples")
    wanted = [duration * i / count for i in range(count + 1) if duration * i / count <= until]
    require(times == wanted, "samples.time is not i duration / count up to the time that is proved")
    names = ("displacement", "velocity")
    power = _entries(samples.get("power", dict.fromkeys(names, 0)), "samples.power", " ".join(names))
    require(all(type(power[key]) is int for key in names), "samples.power holds no whole numbers")
    x, v = (
        [_with_power(row, power[key]) for row in _items(samples[key], f"samples.{key}", len(times), len(times))]
        for key in names
    )
    rows = zip(times, x, v, strict=True)
    return tuple(Sample(t, *(_balls(row, "a sample", n, short=True) for row in pair)) for t, *pair in rows)


def _with_power(row: Any, power: int) -> Any:
    """Return a row of samples in which a whole number, one in units of ``10^power``, has its power of ten."""
    if not isinstance(row, list):
        return row
    return [f"{item}e{power}" if isinstance(item, str) and _WHOLE.fullmatch(item) else item for item in row]


def _certificate(data: Any) -> Certificate:
    needed = "schema scene checkpoints touches samples proved_until digest"
    file = _entries(data, "the file", needed, "bits threshold versions peaks crossings digits")
    require(file["schema"] == SCHEMA, f"schema = {file['schema']!r}; allowed: {SCHEMA!r}")
    rest = {key: value for key, value in data.items() if key != "digest"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    require(hashlib.sha256(text.encode()).hexdigest() == file["digest"], "the digest is not that of the content")
    scene = _entries(file["scene"], "scene", "name hash mass contacts velocity gravity constant_force duration count")
    require(isinstance(scene["name"], str) and isinstance(scene["hash"], str), "scene.name or scene.hash is no text")
    chain, duration = _chain(scene), exact(scene["duration"])
    n = len(chain.mass)
    points = _items(file["checkpoints"], "checkpoints", MOST_CHECKPOINTS)
    boxes = tuple(_box(item, f"checkpoint {k}", chain) for k, item in enumerate(points))
    _check_order(boxes, list(map(exact, _items(scene["velocity"], "scene.velocity", n, n))))
    until = exact(file["proved_until"], dyadic=True)
    require(
        len(boxes) > 1 and until == boxes[-1].time <= duration, "proved_until is not the time of the last checkpoint"
    )
    touches = [
        _touch(item, f"touch {k}", chain) for k, item in enumerate(_items(file["touches"], "touches", MOST_TOUCHES))
    ]
    samples = _samples(file["samples"], duration, scene["count"], until, n)
    extremes = _extremes(file, len(chain.bonds), until)
    return Certificate(scene["name"], scene["hash"], duration, chain, boxes, tuple(touches), samples, extremes)


def _extremes(file: dict[str, Any], count: int, until: fmpq) -> tuple[Extreme, ...]:
    """Return the claims of largest overlaps and crossing times: none where an entry is missing or null."""
    peaks, crossings = (_items(file.get(key, [None] * count), key, count, count) for key in ("peaks", "crossings"))
    extremes = []
    for k, (peak, crossing) in enumerate(zip(peaks, crossings, strict=True)):
        overlap, at, time = None, fmpq(0), None
        if peak is not None:
            entry = _entries(peak, f"peak {k}", "overlap at")
            overlap, at = _ball(entry["overlap"], f"peak {k}", short=True), exact(entry["at"])
            require(overlap.middle + overlap.radius >= 0, f"peak {k} is below 0, where overlaps below 0 count as 0")
            require(0 <= at <= until, f"the time of peak {k} is not in the time that is proved")
        if crossing is not None:
            time = NEVER if crossing == "none" else _ball(crossing, f"crossing {k}", short=True)
            inside = time.radius < time.middle and time.middle + time.radius <= until
            require(time == NEVER or inside, f"crossing {k} is not in the time that is proved")
        extremes.append(Extreme(overlap, at, time))
    return tuple(extremes)


def _check_order(boxes: Sequence[Box], velocity: Sequence[fmpq]) -> None:
    """Raise NotProved unless the checkpoints begin with the exact start and follow each other in time."""
    require(bool(boxes), "there are no checkpoints")
    start = boxes[0]
    is_exact = all(ball == Ball(fmpq(0), fmpq(0)) for ball in start.x)
    is_exact &= tuple(start.v) == tuple(Ball(value, fmpq(0)) for value in velocity)
    require(start.time == 0 and is_exact, "the first checkpoint is not the start of the scene")
    for before, after in pairwise(boxes):
        require(before.time < after.time, "the times of the checkpoints do not increase")


def above(value: fmpq) -> float:
    """Return a float above a number, or infinity."""
    try:
        return math.nextafter(int(value.p) / int(value.q), math.inf)
    except OverflowError:
        return math.inf if value > 0 else -1.0e308


def exactly(value: float) -> fmpq:
    """Return a float as a rational number; raise NotProved if it is not finite."""
    require(math.isfinite(value), "errors are out of the range of floats")
    return fmpq(*map(fmpz, value.as_integer_ratio()))


def half_power(value: float, twice: int) -> float:
    """Return ``value^(twice/2)``, or 0 of a negative value, up to roundings."""
    value = max(value, 0.0)
    return value ** (twice // 2) * (math.sqrt(value) if twice % 2 else 1.0)


def radii(box: Box) -> NDArray[np.float64]:
    """Return the radii of displacements and velocities of a box."""
    return np.array([[above(ball.radius) for ball in balls] for balls in (box.x, box.v)])


def shown(value: fmpq) -> str:
    """Return a number for a message."""
    return f"{int(value.p) / int(value.q):.9g}"


def signs_in(chain: Chain, box: Box) -> list[int]:
    """Return the signs of the overlaps in a box, 0 where they are not certain; they must be those of the file."""
    signs = []
    for bond, closed in zip(chain.bonds, box.closed, strict=True):
        middle = sum((-sign * box.x[body].middle for body, sign in bond.ends), -bond.gap)
        radius = sum((box.x[body].radius for body, _ in bond.ends), fmpq(0))
        signs.append(int(middle > radius) - int(middle < -radius))
        require(closed == (signs[-1] > 0), f"closed is wrong at the checkpoint at t = {shown(box.time)} s")
    return signs


def check_start(file: Certificate) -> None:
    """Require a sample and largest overlaps at the time of the first checkpoint to hold the start."""
    box = file.boxes[0]
    for sample in (sample for sample in file.samples if sample.time == box.time):
        pairs = zip((*box.x, *box.v), (*sample.x, *sample.v), strict=True)
        require(all(abs(a.middle - b.middle) <= b.radius for a, b in pairs), "the first sample does not hold the start")
    for bond, peak in zip(file.chain.bonds, file.extremes, strict=True):
        if peak.overlap is not None and peak.at == box.time:
            reached = peak.overlap.middle - peak.overlap.radius <= max(-bond.gap, fmpq(0))
            require(reached, "a largest overlap may not be reached at the start")


def check_scene(file: Certificate, scene: Scene) -> None:
    """Require the numbers of a file to be those of a scene."""
    c, wall, chain = scene.contacts, scene.n_body, file.chain
    ends = zip(c.left.tolist(), c.right.tolist(), strict=True)
    numbers = zip(c.stiffness.tolist(), c.gap.tolist(), c.exponent.tolist(), strict=True)
    bonds = [
        Bond(None if i == wall else i, None if j == wall else j, exactly(beta), exactly(gap), int(2 * (n - 1)))
        for (i, j), (beta, gap, n) in zip(ends, numbers, strict=True)
    ]
    mass, load = tuple(map(exactly, scene.mass)), map(exactly, scene.load.tolist())
    steady = tuple(exactly(scene.gravity) * m + f for m, f in zip(mass, load, strict=True))
    same = chain == Chain(mass, steady, tuple(bonds))
    same &= [ball.middle for ball in file.boxes[0].v] == list(map(exactly, scene.velocity))
    same &= file.duration == exactly(scene.duration) and file.content_hash == scene.content_hash
    require(same, f"the file is not about the scene {scene.name}")


def check_touches(proved: Sequence[Touch], claimed: Sequence[Touch]) -> None:
    """Prove that the touches are those of the file, in its order."""
    proved = sorted(proved, key=lambda touch: touch.time.middle)
    require(len(proved) == len(claimed), f"the file lists {len(claimed)} touches of {len(proved)}")
    before = fmpq(-1)
    for number, (touch, claim) in enumerate(zip(proved, claimed, strict=True)):
        same = (touch.contact, touch.closes) == (claim.contact, claim.closes)
        require(
            same, f"touch {number} is that of contact {touch.contact}, not of {claim.contact}, or of the other kind"
        )
        inside = abs(touch.time.middle - claim.time.middle) + touch.time.radius <= claim.time.radius
        require(inside, f"touch {number} may be outside its ball of times")
        require(touch.time.middle - touch.time.radius > before, f"touch {number} may be before touch {number - 1}")
        before = touch.time.middle + touch.time.radius
