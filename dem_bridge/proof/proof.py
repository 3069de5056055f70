"""The answer of a proof: the motion at the sample times with radii that are theorems, and all touches."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.foundation.compiled import Floats
from dem_bridge.foundation.numbers import is_within
from dem_bridge.proof.balls import library
from dem_bridge.proof.certificate import document_of, is_known, read_record, write_document
from dem_bridge.proof.extremes import Unknown, force_at
from dem_bridge.proof.problem import Problem, measure_scale, problem_of
from dem_bridge.proof.producer import MOST_BITS, Record, Touch, choose_bits, prove_from
from dem_bridge.proof.turns import Ball
from dem_bridge.scene.scene import Scene

#: what bits grow by where a proof fails for want of them
_MORE_BITS = 1.25


@dataclass(frozen=True, kw_only=True, eq=False)
class Proof:
    """Enclosures of the motion of a scene: each true value differs from a midpoint by at most its radius.

    ``displacement`` (m) and ``velocity`` (m/s) are midpoints ``(n_t, n_body)`` as doubles, and the radii contain their
    rounding; the balls themselves have all their digits in ``certificate``. ``touches`` are in the order of time.
    ``peak_force`` (N), the largest force until ``proved_until``, and ``crossing_time`` (s), that of the first maximal
    compression, have one value a contact, as in a Trajectory. A value that is not established is nan with the radius
    inf; a contact that is proved to have no crossing time has nan with the radius 0.
    A proof that ends early has samples up to ``proved_until`` (s), and ``reason`` says why it ended.
    """

    scene: Scene
    time: Floats
    displacement: Floats
    displacement_radius: Floats
    velocity: Floats
    velocity_radius: Floats
    peak_force: Floats
    peak_force_radius: Floats
    crossing_time: Floats
    crossing_time_radius: Floats
    touches: tuple[Touch, ...]
    proved_until: float
    reason: str
    digits: float
    """Proved digits of the largest velocity at the end."""
    certificate: dict[str, Any]

    @property
    def complete(self) -> bool:
        """True if the proof goes up to the end of the scene."""
        return not self.reason

    def __str__(self) -> str:
        """Return what is proved, in a few lines."""
        part = "" if self.complete else f", of {self.scene.duration:g} s: {self.reason}"
        counts = f"{len(self.time)} samples, {len(self.touches)} touches"
        return (
            f"{self.scene.name}: proved up to {self.proved_until:g} s{part}\n"
            f"  {counts}, {self.digits:.1f} digits of the largest velocity\n"
            f"  {_summary('peak forces', 'N', self.peak_force, self.peak_force_radius)}\n"
            f"  {_summary('crossing times', 's', self.crossing_time, self.crossing_time_radius)}"
        )

    def as_json(self) -> dict[str, Any]:
        """Return what is proved for JSON; null where a value is not established, and "none" for no crossing time."""
        return {
            "scene": self.scene.name,
            "hash": self.scene.content_hash,
            "proved_until": self.proved_until,
            "complete": self.complete,
            "reason": self.reason,
            "digits": self.digits if math.isfinite(self.digits) else None,
            "touches": [
                {"contact": touch.contact, "closes": touch.closes, "time": list(_double(touch.time))}
                for touch in self.touches
            ],
            "peak_force": _entries(self.peak_force, self.peak_force_radius),
            "crossing_time": _entries(self.crossing_time, self.crossing_time_radius),
            "velocity_radius": float(self.velocity_radius.max()),
            "displacement_radius": float(self.displacement_radius.max()),
        }

    def save(self, file: str | Path) -> None:
        """Write the certificate to a file."""
        write_document(self.certificate, Path(file))


def _summary(name: str, unit: str, values: Floats, radii: Floats) -> str:
    """Return of how many contacts a quantity is proved, its largest radius, and where it is not established."""
    proved, missing = radii[np.isfinite(values)], np.flatnonzero(np.isinf(radii)).tolist()
    radius = f", radius at most {proved.max():.1e} {unit}" if len(proved) else ""
    without = f"; not established at contact {', '.join(map(str, missing))}" if missing else ""
    return f"{name} of {len(proved)} of {len(values)} contacts{radius}{without}"


def _entries(values: Floats, radii: Floats) -> list[list[float] | str | None]:
    """Return value and radius of each contact, or what stands for a value that is missing."""
    return [
        [value, radius] if math.isfinite(value) else "none" if radius == 0.0 else None
        for value, radius in zip(values.tolist(), radii.tolist(), strict=True)
    ]


def prove_scene(scene: Scene, digits: int, file: Path | None = None, *, anew: bool = False) -> Proof:
    """Prove the motion of a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    digits : int
        Digits of the largest velocity that are wanted at the end.
    file : Path, optional
        Certificate, written at each checkpoint. An unfinished one of the same scene is continued.
    anew : bool
        Whether an existing certificate is replaced instead.
    """
    library()
    problem = problem_of(scene)
    scale = measure_scale(scene)
    record = Record(bits=choose_bits(problem, scale, digits))
    if file is not None and file.exists() and not anew:
        record = read_record(file, scene)

    def keep(record: Record) -> None:
        if file is not None:
            write_document(document_of(scene, problem, record), file)

    while True:
        prove_from(problem, scale, record, digits, keep)
        more = min(MOST_BITS, math.ceil(_MORE_BITS * record.bits))
        if not record.reason or more == record.bits:
            break
        again = Record(bits=more)
        prove_from(problem, scale, again, digits)
        if again.checkpoints[-1].time <= record.checkpoints[-1].time:
            break
        record = again
    if len(record.checkpoints) > 1:
        keep(record)
    return _proof(scene, problem, record, document_of(scene, problem, record))


def _proof(scene: Scene, problem: Problem, record: Record, certificate: dict[str, Any]) -> Proof:
    """Return the answer from a record."""
    until = record.checkpoints[-1].time
    times = [i * Fraction(scene.duration) / scene.samples for i in range(len(record.samples))]
    boxes = [box for box, time in zip(record.samples, times, strict=True) if time <= until]
    x, x_radius = _doubles([box.displacement for box in boxes])
    v, v_radius = _doubles([box.velocity for box in boxes])
    force, force_radius, crossing, crossing_radius = _extremes_of(problem, record)
    largest = float(np.abs(v).max())
    radius = max((float(radius) for _, radius in record.checkpoints[-1].box.velocity), default=0.0)
    return Proof(
        scene=scene,
        time=np.array([float(time) for time in times[: len(boxes)]]),
        displacement=x,
        displacement_radius=x_radius,
        velocity=v,
        velocity_radius=v_radius,
        peak_force=force,
        peak_force_radius=force_radius,
        crossing_time=crossing,
        crossing_time_radius=crossing_radius,
        touches=tuple(record.touches),
        proved_until=float(until),
        reason=record.reason,
        digits=math.log10(largest / radius) if radius and largest else math.inf,
        certificate=certificate,
    )


def _extremes_of(problem: Problem, record: Record) -> tuple[Floats, Floats, Floats, Floats]:
    """Return peak forces and crossing times with their radii; nan with the radius inf if one is not established."""
    out = np.full((len(problem.left), 4), (math.nan, math.inf) * 2).T
    for k, (extreme, known) in enumerate(zip(record.extremes, is_known(record.extremes), strict=True)):
        if known:
            out[:2, k] = _double(force_at(problem, extreme, k))
        if isinstance(extreme.crossing, tuple):
            out[2:, k] = _double(extreme.crossing)
        elif extreme.crossing is Unknown.NONE:
            out[3, k] = 0.0
    return out[0], out[1], out[2], out[3]


def _double(ball: Ball) -> tuple[float, float]:
    """Return the midpoint of a ball as a double, and a radius that contains its rounding."""
    middle, radius = ball
    return float(middle), _up(radius + abs(middle - Fraction(float(middle))))


def _doubles(rows: list[tuple[Ball, ...]]) -> tuple[Floats, Floats]:
    """Return balls as doubles, with radii that contain the rounding of the midpoints."""
    both = np.array([[_double(ball) for ball in row] for row in rows])
    return both[..., 0], both[..., 1]


def _up(value: Fraction) -> float:
    """Return the least double that is at least ``value``, or the next."""
    return math.nextafter(float(value), math.inf) if value else 0.0


def checked_digits(digits: object) -> int:
    """Return the number of digits; raise UsageError unless it is a whole number from 1 to 60."""
    if is_within(digits, whole=True, at_least=1, at_most=60):
        return int(digits)
    raise UsageError(f"digits = {digits!r}; allowed: a whole number from 1 to 60")
