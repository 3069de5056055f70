"""The certificate of a proof: one JSON file with boxes, touches and samples as exact decimals, rounded outwards."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from dem_bridge.backends.base import versions_of
from dem_bridge.errors import OF_DAMAGED_DATA, UsageError
from dem_bridge.foundation.files import text_of_file, write_whole
from dem_bridge.proof.extremes import Extreme, Unknown
from dem_bridge.proof.flow import Box
from dem_bridge.proof.problem import Problem
from dem_bridge.proof.producer import WIDER, Checkpoint, Record, Touch
from dem_bridge.proof.turns import Ball
from dem_bridge.scene.scene import Scene
from dem_bridge.version import __version__

#: schema of the file
SCHEMA = "dem-bridge/proof/1"
#: unit of the last digit of a sample, relative to the largest velocity or displacement, where the proof allows it
_LAST_DIGIT = Fraction(1, 10**17)
#: least radius of overlaps and crossing times, relative to the largest overlap and the duration: the checker's room
_LEAST = Fraction(1, 10**20)
#: a largest overlap whose radius is above this part of the largest of all is left out
_WIDEST = Fraction(1, 10**6)
#: unit of the time at which an overlap is largest, relative to the duration
_TIME = Fraction(1, 10**28)
#: an upper bound of any overlap, m: what is known of a contact of which a file says nothing
_UNKNOWN = Fraction(10**9)


def document_of(scene: Scene, problem: Problem, record: Record) -> dict[str, Any]:
    """Return the certificate of what is proved, as it is written to a file."""
    until = record.checkpoints[-1].time
    samples = [box for i, box in enumerate(record.samples) if i * problem.duration / problem.count <= until]
    moved, moving = (_place_of([getattr(box, name) for box in samples]) for name in ("displacement", "velocity"))
    document = {
        "schema": SCHEMA,
        "scene": _scene_entry(scene, problem),
        "bits": record.bits,
        "threshold": "0",
        "checkpoints": [
            {
                "time": str(point.time),
                "displacement": [_pair(ball) for ball in point.box.displacement],
                "velocity": [_pair(ball) for ball in point.box.velocity],
                "closed": list(point.closed),
            }
            for point in record.checkpoints
        ],
        "touches": [
            {"contact": touch.contact, "closes": touch.closes, "time": _pair(touch.time)} for touch in record.touches
        ],
        "peaks": _peaks(problem, record.extremes),
        "crossings": [_crossing(problem, extreme) for extreme in record.extremes],
        "samples": {
            "time": [str(i * problem.duration / problem.count) for i in range(len(samples))],
            "power": {"displacement": moved, "velocity": moving},
            "displacement": [_rounded(box.displacement, moved) for box in samples],
            "velocity": [_rounded(box.velocity, moving) for box in samples],
        },
        "proved_until": str(until),
        "versions": {"dem_bridge": __version__, **versions_of("python-flint", "numba")},
    }
    return {**document, "digest": digest_of(document)}


def digest_of(document: Mapping[str, Any]) -> str:
    """Return the sha256 of a certificate without its entry ``digest``; it finds damage, and proves nothing."""
    rest = {key: value for key, value in document.items() if key != "digest"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def write_document(document: Mapping[str, Any], path: Path) -> None:
    """Write a certificate to a file, in place of an earlier one."""
    write_whole(path.parent, {path.name: json.dumps(document, separators=(",", ":")) + "\n"})


def read_record(path: Path, scene: Scene) -> Record:
    """Return what an unfinished certificate proves, so that the proof can go on.

    Raises
    ------
    UsageError
        If the file cannot be read, is damaged, or is of another scene.
    """
    try:
        document = json.loads(text_of_file(path))
        if document["schema"] != SCHEMA or document["digest"] != digest_of(document):
            raise ValueError("its digest or schema is wrong")
        if document["scene"]["hash"] != scene.content_hash:
            raise ValueError(f"it is of another scene, {document['scene']['name']}")
        samples = document["samples"]
        balls = (read_samples(samples, name) for name in ("displacement", "velocity"))
        return Record(
            bits=int(document["bits"]),
            checkpoints=[_read_checkpoint(point) for point in document["checkpoints"]],
            touches=[
                Touch(contact=item["contact"], closes=item["closes"], time=read_ball(item["time"]))
                for item in document["touches"]
            ],
            samples=[Box(displacement=x, velocity=v) for x, v in zip(*balls, strict=True)],
            extremes=read_extremes(document),
        )
    except OSError as error:
        raise UsageError(f"{path}: the certificate cannot be read ({error.strerror})") from error
    except OF_DAMAGED_DATA as error:
        allowed = "allowed: an unfinished certificate of the same scene, or --force to begin anew"
        raise UsageError(f"{path}: is no certificate that can be continued ({error}); {allowed}") from error


def read_ball(entry: Any, power: int = 0) -> Ball:
    """Return a ball from its entry; one decimal alone has a radius of one unit of its last digit.

    A decimal that has no power of ten is in units of ``10^power``.

    Examples
    --------
    >>> read_ball(["0.5", "1e-3"]), read_ball("12e-1")
    ((Fraction(1, 2), Fraction(1, 1000)), (Fraction(6, 5), Fraction(1, 10)))
    """
    if isinstance(entry, str):
        mantissa, _, own = entry.partition("e")
        unit = Fraction(10) ** int(own or power)
        return Fraction(mantissa) * unit, unit / 10 ** len(mantissa.partition(".")[2])
    middle, radius = entry
    return Fraction(middle), Fraction(radius)


def read_samples(samples: Mapping[str, Any], name: str) -> list[tuple[Ball, ...]]:
    """Return the balls of displacements or velocities at all samples; a whole number is in units of ``10^power``."""
    power = samples.get("power", {}).get(name, 0)
    return [tuple(read_ball(entry, power) for entry in row) for row in samples[name]]


def read_extremes(document: Mapping[str, Any]) -> list[Extreme]:
    """Return what a certificate says of largest overlaps and crossing times; earlier files say nothing."""
    none = [None] * len(document["scene"]["contacts"])
    extremes = []
    for peak, crossing in zip(document.get("peaks", none), document.get("crossings", none), strict=True):
        extreme = Extreme(high=_UNKNOWN)
        if peak is not None:
            middle, radius = read_ball(peak["overlap"])
            extreme = Extreme(low=middle - radius, high=middle + radius, at=Fraction(peak["at"]))
        time = Unknown.UNPROVED if crossing is None else Unknown.NONE if crossing == "none" else read_ball(crossing)
        extremes.append(replace(extreme, crossing=time))
    return extremes


def is_known(extremes: Sequence[Extreme]) -> list[bool]:
    """Return whether the largest overlap of each contact is known to a millionth of the largest of all."""
    largest = max((extreme.low for extreme in extremes), default=Fraction(0))
    return [extreme.high - extreme.low <= _WIDEST * largest or extreme.high == 0 for extreme in extremes]


def _peaks(problem: Problem, extremes: Sequence[Extreme]) -> list[dict[str, Any] | None]:
    """Return the largest overlaps with a time at which each is reached; null where one is not established."""
    largest = max((extreme.low for extreme in extremes), default=Fraction(0))
    least, of_time = _place(_LEAST * largest) if largest else -300, _place(_TIME * problem.duration)
    entries: list[dict[str, Any] | None] = []
    for extreme, known in zip(extremes, is_known(extremes), strict=True):
        ball = (extreme.high + extreme.low) / 2, (extreme.high - extreme.low) / 2
        at = f"{math.floor(extreme.at / Fraction(10) ** of_time)}e{of_time}"
        entries.append({"overlap": _sample(ball, least), "at": at} if known else None)
    return entries


def _crossing(problem: Problem, extreme: Extreme) -> str | None:
    """Return a crossing time; "none" if the contact is proved to have none, null if it is not established."""
    if isinstance(extreme.crossing, Unknown):
        return "none" if extreme.crossing is Unknown.NONE else None
    return _sample(extreme.crossing, _place(_LEAST * problem.duration))


def _read_box(displacement: Any, velocity: Any) -> Box:
    return Box(displacement=tuple(map(read_ball, displacement)), velocity=tuple(map(read_ball, velocity)))


def _read_checkpoint(entry: Mapping[str, Any]) -> Checkpoint:
    box = _read_box(entry["displacement"], entry["velocity"])
    return Checkpoint(time=Fraction(entry["time"]), box=box, closed=tuple(entry["closed"]))


def _scene_entry(scene: Scene, problem: Problem) -> dict[str, Any]:
    c, n = scene.contacts, scene.n_body
    names = [
        ["left", right] if left == n else [left, "right"] if right == n else [left, right]
        for left, right in zip(problem.left, problem.right, strict=True)
    ]
    numbers = zip(names, c.stiffness.tolist(), c.exponent.tolist(), c.gap.tolist(), strict=True)
    return {
        "name": scene.name,
        "hash": scene.content_hash,
        "mass": [value.hex() for value in scene.mass],
        "contacts": [
            {"bodies": bodies, "stiffness": beta.hex(), "exponent": exponent.hex(), "gap": gap.hex()}
            for bodies, beta, exponent, gap in numbers
        ],
        "velocity": [value.hex() for value in scene.velocity],
        "gravity": float(scene.gravity).hex(),
        "constant_force": [value.hex() for value in scene.load.tolist()],
        "duration": float(scene.duration).hex(),
        "count": scene.samples,
    }


def _pair(ball: Ball) -> list[str]:
    """Return a ball as two decimals that contain it; a dyadic midpoint is exact."""
    middle, radius = ball
    if radius == 0:
        return [_decimal(middle, _exact_digits(middle)), "0"]
    unit = math.floor(math.log10(radius)) - 3
    rounded = round(middle / Fraction(10) ** unit)
    return [
        _decimal(rounded * Fraction(10) ** unit, unit),
        _decimal(radius + abs(middle - rounded * Fraction(10) ** unit), unit),
    ]


def _exact_digits(value: Fraction) -> int:
    """Return the place of the last digit of a dyadic number."""
    return -(value.denominator.bit_length() - 1)


def _decimal(value: Fraction, place: int) -> str:
    """Return a number that is not negative rounded up, and one that is a multiple of 10^place exactly."""
    return f"{math.ceil(value / Fraction(10) ** place)}e{place}"


def _place_of(rows: list[tuple[Ball, ...]]) -> int:
    """Return the power of ten of the last digit of samples."""
    largest = max((abs(middle) for row in rows for middle, _ in row), default=Fraction(0))
    return _place(largest * _LAST_DIGIT) if largest else -300


def _rounded(row: tuple[Ball, ...], least: int) -> list[str]:
    """Return balls as decimals whose radius is one unit of the last digit; that of a whole number is ``10^least``.

    The unit is at least twice the widened radius, so that the rounding of the midpoint has room beside it.
    """
    return [_sample(ball, least).removesuffix(f"e{least}") for ball in row]


def _sample(ball: Ball, least: int) -> str:
    """Return a ball as a decimal whose radius is one unit of its last digit, at least ``10^least``.

    One that was such a decimal in the file that is continued stays as it is.
    """
    middle, radius = ball
    place = _place(radius) if radius else least
    if radius and (radius != Fraction(10) ** place or middle % radius):
        place = max(least, _place(2 * WIDER * radius))
    return f"{round(middle / Fraction(10) ** place)}e{place}"


def _place(value: Fraction) -> int:
    """Return the least power of ten that is at least ``value``."""
    power = math.floor(math.log10(value))
    return power if Fraction(10) ** power >= value else power + 1
