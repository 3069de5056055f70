"""The runs of work-precision: timed alone and warm, within a limit, with their errors.

A run over its limit, or one that fails, has no numbers and keeps its row; what is foreseen to be over the limit is not
run at all.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from dem_bridge.backends.base import Backend, Sampling
from dem_bridge.campaign import Progress
from dem_bridge.errors import BackendUnavailable, NotAsymptotic, RunBroken, UnsupportedScene, UsageError
from dem_bridge.observables.errors import Reading
from dem_bridge.scene import Scene
from dem_bridge.studies.work_precision.curves import Curve
from dem_bridge.studies.work_precision.norms import errors_of, uncertainties_of
from dem_bridge.studies.work_precision.timed import Timing, timed

REFERENCE = "reference"


@dataclass(frozen=True, kw_only=True)
class Point:
    """One setting of a curve; without a timing where there is no run, with the reason."""

    curve: Curve
    value: float
    """Of the curve's knob; nan where it has none."""
    timing: Timing | None = None
    dt: float = math.nan
    """s: as it was run; nan without a fixed step."""
    steps: float = math.nan
    evaluations: float = math.nan
    loop: float = math.nan
    """s: LAMMPS' own time for its steps."""
    errors: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """(observable, norm) -> relative error."""
    reason: str = ""

    def error(self, observable: str, norm: str = "max") -> float:
        """nan without a run."""
        return self.errors.get((observable, norm), math.nan)

    @property
    def cpu(self) -> float:
        """Least CPU time of a run, s; nan without one."""
        return math.nan if self.timing is None else self.timing.least_cpu


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
        """The largest error, or the bar of the reference where that is more; inf without a run."""
        error = point.error(observable)
        return max(error, self.uncertainty[observable, "max"]) if math.isfinite(error) else math.inf

    def of(self, name: str) -> list[Point]:
        """The points of the curve of that name which have numbers."""
        return [point for point in self.points if point.curve.name == name and point.timing is not None]

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
    clock = Clock(requested, scene, sampling, limit=limit, progress=progress)
    for curve, chosen in requested:
        seconds: list[tuple[float, float]] = []
        """Size of a setting, wall time of a run of it."""
        clock.say(curve.name)
        _warm(curve, chosen, scene, sampling, limit)
        for place, value in enumerate(curve.values):
            expected = predicted(seconds, curve.size(value))
            if expected > limit:
                yield Point(
                    curve=curve,
                    value=value,
                    reason=f"not run: about {expected:.2g} s, and the limit is {limit:g} s",
                )
            else:
                point, wall = _measured(curve, chosen, value, scene, sampling, reference, limit=limit, repeats=repeats)
                seconds.append((curve.size(value), wall))
                yield point
            clock.done(curve, place, seconds)


def _warm(curve: Curve, chosen: Backend, scene: Scene, sampling: Sampling, limit: float) -> None:
    """A run that is not measured: what is compiled, imported or cached on the way is so from here on."""
    # a run that fails will say so when it counts
    with suppress(NotAsymptotic, RunBroken, UnsupportedScene, BackendUnavailable, UsageError):
        curve.run(chosen, scene, curve.values[0], sampling, limit=limit)


def _measured(
    curve: Curve,
    chosen: Backend,
    value: float,
    scene: Scene,
    sampling: Sampling,
    reference: Mapping[str, Reading],
    *,
    limit: float,
    repeats: int,
) -> tuple[Point, float]:
    """One setting, and the wall time (s) of a run of it; nan errors where it fails or takes more than ``limit``."""
    began = time.perf_counter()
    try:
        run, timing = timed(lambda: curve.run(chosen, scene, value, sampling, limit=limit), repeats=repeats)
    except (NotAsymptotic, RunBroken, UnsupportedScene, BackendUnavailable, UsageError) as error:
        return Point(curve=curve, value=value, reason=str(error)), time.perf_counter() - began
    if timing.least_wall > limit:
        reason = f"took {timing.least_wall:.2g} s, and the limit is {limit:g} s"
        return Point(curve=curve, value=value, reason=reason), timing.least_wall
    return (
        Point(
            curve=curve,
            value=value,
            timing=timing,
            dt=float(run.provenance["settings"].get("dt", math.nan)),
            steps=float(run.cost.steps),
            evaluations=float(run.cost.force_evaluations),
            loop=float(run.provenance.get("engine_loop", math.nan)),
            errors=uncertainties_of(reference) if curve.backend == REFERENCE else errors_of(scene, run, reference),
        ),
        timing.least_wall,
    )


def predicted(seconds: Sequence[tuple[float, float]], size: float) -> float:
    """Wall time (s) of a run of that size, by the line through the last two measured; never less than the last.

    >>> predicted([(1.0, 0.25), (2.0, 0.5)], 4.0), predicted([(1.0, 0.25)], 2.0), predicted([], 1.0)
    (1.0, 0.25, 0.0)
    """
    if len(seconds) < 2:
        return seconds[-1][1] if seconds else 0.0
    (s1, t1), (s2, t2) = seconds[-2:]
    return t2 + max(0.0, (t2 - t1) / (s2 - s1)) * (size - s2) if s2 > s1 else t2


class Clock:
    """Says how far all is, by the time that is expected to be left: a fraction that never falls."""

    def __init__(
        self,
        requested: Sequence[tuple[Curve, Backend]],
        scene: Scene,
        sampling: Sampling,
        *,
        limit: float,
        progress: Progress | None,
    ) -> None:
        self.progress, self.limit, self.scene = progress, limit, scene
        self.began, self.fraction, self.label = time.perf_counter(), 0.0, ""
        self.left = {
            (curve.name, place): min(curve.guess(scene, value, sampling), limit)
            for curve, _ in requested
            for place, value in enumerate(curve.values)
        }

    def say(self, label: str) -> None:
        self.label = f"{self.scene.name}: {label}"
        if self.progress is not None:
            spent = time.perf_counter() - self.began
            # each setting two times or so
            left = 2.0 * sum(self.left.values())
            self.fraction = max(self.fraction, spent / (spent + left) if left > 0.0 else 1.0)
            self.progress(self.fraction, 1, self.label)

    def done(self, curve: Curve, place: int, seconds: Sequence[tuple[float, float]]) -> None:
        """The setting at ``place`` of ``curve`` has been, and the next ones are foreseen by what was found."""
        del self.left[curve.name, place]
        if len(seconds) > 1:
            for later in range(place + 1, len(curve.values)):
                expected = predicted(seconds, curve.size(curve.values[later]))
                self.left[curve.name, later] = expected if expected <= self.limit else 0.0
        self.say(curve.name)
