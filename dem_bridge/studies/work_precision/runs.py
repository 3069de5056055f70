"""The runs of work-precision: timed alone and warm, within a limit, with their errors.

A run over its limit, or one that fails, has no numbers and keeps its row; what is foreseen to be over the limit is not
run at all.
"""

from __future__ import annotations

import math
import resource
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np

from dem_bridge.backends.base import Backend, Sampling
from dem_bridge.errors import BackendUnavailable, NotAsymptotic, RunBroken, UnsupportedScene, UsageError
from dem_bridge.observables.differences import REDUCTIONS, Reading, read, reduced, relative_to
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.runs.campaign import Progress
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.work_precision.curves import TEXTS, Curve
from dem_bridge.trajectory.trajectory import Trajectory

REFERENCE = "reference"
#: every norm is stored, and any of them may be plotted (DiffEqDevTools.jl, issues 125 and 128)
NORMS = tuple(REDUCTIONS)
#: (observable, norm) -> number
Norms = dict[tuple[str, str], float]
Answer = TypeVar("Answer")

#: calls are repeated no more once all together took so long, s; each is made twice at least
ENOUGH = 1.0
LEAST = 2
#: errors after which a setting has no numbers, and the next one is run
FAILURES = (NotAsymptotic, RunBroken, UnsupportedScene, BackendUnavailable, UsageError)


@dataclass(frozen=True, kw_only=True)
class Point:
    """One setting of a curve; without numbers where there is no run, with the reason. Times are in s."""

    curve: Curve
    value: float
    """Of the curve's knob; nan where it has none."""
    dt: float = math.nan
    """Time step as it was run; nan without a fixed step."""
    steps: float = math.nan
    force_evaluations: float = math.nan
    wall_min: float = math.nan
    wall_median: float = math.nan
    cpu_min: float = math.nan
    cpu_median: float = math.nan
    repeats: float = 0.0
    """Number of timed runs."""
    engine_loop: float = math.nan
    """LAMMPS' own time for its steps."""
    errors: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """(observable, norm) -> relative error."""
    reason: str = ""

    @property
    def ran(self) -> bool:
        """Return whether there is a timed run."""
        return self.repeats > 0.0

    def error(self, observable: str, norm: str = "max") -> float:
        """Return a relative error; nan without a run."""
        return self.errors.get((observable, norm), math.nan)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """All that was measured on one scene."""

    scene: Scene
    sampling: Sampling
    limit: float
    points: tuple[Point, ...]
    uncertainty: Mapping[tuple[str, str], float]
    """(observable, norm) -> relative uncertainty of the reference; the size of an error below it is unknown."""
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def known(self, point: Point, observable: str, norm: str = "max") -> bool:
        """Return whether an error is larger than the uncertainty of the reference."""
        return point.error(observable, norm) > self.uncertainty[observable, norm]

    def bound(self, point: Point, observable: str) -> float:
        """Return the largest error, or the uncertainty of the reference where that is more; inf without a run."""
        error = point.error(observable)
        return max(error, self.uncertainty[observable, "max"]) if math.isfinite(error) else math.inf

    def of(self, name: str) -> list[Point]:
        """List the points of the curve of that name which have numbers."""
        return [point for point in self.points if point.curve.name == name and point.ran]

    @property
    def observables(self) -> tuple[str, ...]:
        """Names of the observables that the reference has."""
        return tuple(dict.fromkeys(name for name, _ in self.uncertainty))

    @property
    def curves(self) -> tuple[str, ...]:
        """Names, in order."""
        return tuple(dict.fromkeys(point.curve.name for point in self.points))


def measured(
    requested: Sequence[tuple[Curve, Backend]],
    scene: Scene,
    sampling: Sampling,
    reference: Mapping[str, Reading],
    *,
    limit: float,
    repeats: int,
    progress: Progress | None,
) -> Iterator[Point]:
    """Measure every setting of every curve against the ``reference``; arguments as of the study."""
    left = {
        (curve.name, place): min(curve.guess(scene, value, sampling), limit)
        for curve, _ in requested
        for place, value in enumerate(curve.values)
    }
    began, fraction = time.perf_counter(), 0.0

    def say(curve: Curve) -> None:
        """Show the part of the expected time that has passed, which never falls; each setting is run twice or so."""
        nonlocal fraction
        spent, rest = time.perf_counter() - began, 2.0 * sum(left.values())
        fraction = max(fraction, spent / (spent + rest) if rest > 0.0 else 1.0)
        if progress is not None:
            progress(fraction, 1, f"{scene.name}: {curve.name}")

    for curve, chosen in requested:
        # size of a setting, wall time of a run of it
        seconds: list[tuple[float, float]] = []
        call = partial(curve.run, chosen, scene, sampling=sampling, limit=limit)
        say(curve)
        # what is compiled, imported or cached on the way is so from here on; a failure counts when it is measured
        with suppress(*FAILURES):
            call(curve.values[0])
        for place, value in enumerate(curve.values):
            expected = predicted(seconds, curve.size(value))
            if expected > limit:
                yield Point(curve=curve, value=value, reason=TEXTS("foreseen", expected=expected, limit=limit))
            else:
                point, wall = _measured(curve, value, partial(call, value), scene, reference, limit, repeats)
                seconds.append((curve.size(value), wall))
                yield point
            del left[curve.name, place]
            for later in range(place + 1, len(curve.values)) if len(seconds) > 1 else ():
                expected = predicted(seconds, curve.size(curve.values[later]))
                left[curve.name, later] = expected if expected <= limit else 0.0
            say(curve)


def _measured(
    curve: Curve,
    value: float,
    call: Callable[[], Trajectory],
    scene: Scene,
    reference: Mapping[str, Reading],
    limit: float,
    repeats: int,
) -> tuple[Point, float]:
    """Return one setting, and the wall time (s) of a run; it has no numbers where it fails or takes too long."""
    began = time.perf_counter()
    try:
        run, timing = timed(call, repeats=repeats)
    except FAILURES as error:
        return Point(curve=curve, value=value, reason=str(error)), time.perf_counter() - began
    wall = min(timing.wall)
    if wall > limit:
        return Point(curve=curve, value=value, reason=TEXTS("late", wall=wall, limit=limit)), wall
    point = Point(
        curve=curve,
        value=value,
        dt=run.provenance["settings"].get("dt", math.nan),
        steps=run.cost.steps,
        force_evaluations=run.cost.force_evaluations,
        **timing.numbers(),
        engine_loop=run.provenance.get("engine_loop", math.nan),
        errors=uncertainties_of(reference) if curve.backend == REFERENCE else errors_of(scene, run, reference),
    )
    return point, wall


def predicted(seconds: Sequence[tuple[float, float]], size: float) -> float:
    """Predict the wall time (s) of a run of that size, by the line through the last two; never less than the last.

    >>> predicted([(1.0, 0.25), (2.0, 0.5)], 4.0), predicted([(1.0, 0.25)], 2.0), predicted([], 1.0)
    (1.0, 0.25, 0.0)
    """
    if len(seconds) < 2:
        return seconds[-1][1] if seconds else 0.0
    (s1, t1), (s2, t2) = seconds[-2:]
    return t2 + max(0.0, (t2 - t1) / (s2 - s1)) * (size - s2) if s2 > s1 else t2


def readings_of(scene: Scene, reference: Trajectory) -> dict[str, Reading]:
    """Return every registered observable of which the reference has at least one value, by name."""
    readings = {name: read(observable, scene, reference) for name, observable in OBSERVABLES.items()}
    return {name: reading for name, reading in readings.items() if np.any(np.isfinite(reading.values))}


def errors_of(scene: Scene, run: Trajectory, reference: Mapping[str, Reading]) -> Norms:
    """Return the relative errors of a run over all samples, bodies or contacts, at the samples of the reference.

    An error is inf where only one of the two has a value.
    """
    errors = {name: relative_to(reading, read(name, scene, run)) for name, reading in reference.items()}
    return {(name, norm): error.reduced(norm) for name, error in errors.items() for norm in NORMS}


def uncertainties_of(reference: Mapping[str, Reading]) -> Norms:
    """Return the uncertainty of the reference as :func:`errors_of`: the size of an error below it is unknown."""
    errors = {name: relative_to(reading, reading) for name, reading in reference.items()}
    return {(name, norm): reduced(error.uncertainty, norm) for name, error in errors.items() for norm in NORMS}


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Times of several calls, s: ``wall`` and ``cpu``, the latter with the children that ended within the call."""

    wall: tuple[float, ...]
    cpu: tuple[float, ...]

    def numbers(self) -> dict[str, Any]:
        """Return least and median times; the least is what the work takes, what is above it was done for others."""
        return {
            "wall_min": min(self.wall),
            "wall_median": statistics.median(self.wall),
            "cpu_min": min(self.cpu),
            "cpu_median": statistics.median(self.cpu),
            "repeats": len(self.wall),
        }


def timed(call: Callable[[], Answer], *, repeats: int) -> tuple[Answer, Timing]:
    """Return the last answer of ``call`` and what each call cost: up to ``repeats`` of them, fewer where they are long.

    One at a time, with nothing before: whoever wants it warm calls it once before. Raises what ``call`` raises.
    """
    wall: list[float] = []
    cpu: list[float] = []
    while len(wall) < min(LEAST, repeats) or (len(wall) < repeats and sum(wall) < ENOUGH):
        began, used = time.perf_counter(), _used()
        answer = call()
        wall.append(time.perf_counter() - began)
        cpu.append(_used() - used)
    return answer, Timing(wall=tuple(wall), cpu=tuple(cpu))


def _used() -> float:
    """Return the CPU time of this process, all threads, and of the children that it has waited for, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
