"""Errors measured by runs at two and more resolutions, and the coarsest setting within a target.

The error of a run is its distance from a reference. Where the Taylor series fit the scene and are cheap that is the
reference solution, and the error is the true one, up to the uncertainty of the reference. Elsewhere it is the same code
at a finer setting: an error that goes as setting^p is ``1/(1 - r^-p)`` times the distance from the run r times finer,
and an order a fifth lower than expected is taken for p, so that the estimate is not below the error where the order is
not clean.

LAMMPS is not run for this: the twin in positions repeats it to 1e-10, round-off included.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.errors import NotAsymptotic, RunBroken, UsageError
from dem_bridge.observables.differences import relative_error, relative_uncertainty
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import FREE, Cost, Trajectory

#: a setting is coarse enough where none this many times coarser serves, or can be expected to, by knob: costs go with
#: 1/dt, but hardly with rtol, in which errors are erratic besides
CLOSE = {"dt": 1.12, "rtol": 10.0}
#: part of the target that is aimed at
AIM = {"dt": 0.92, "rtol": 0.3}
#: errors need not fall with the setting: one is accepted if those that are finer, down to this part of it, serve too
FINEST = 0.25
#: part of the target that errors of accepted settings and of finer ones stay below, because errors between the settings
#: that are tried may be larger: by order of the method, 0 for tolerances. Errors of orders 1 and 2 are almost smooth in
#: the step, those of order 4 scatter with the phases of the steps at contacts, and those of ode45 change at random with
#: its tolerances. On 38 random scenes at three accuracies a margin of 0.8 for all was not enough in 5 of 336 plans
MARGIN: Mapping[int, float] = MappingProxyType({1: 0.8, 2: 0.8, 4: 0.6, 0: 0.25})
#: the settings tried are this far apart where errors are near the target (40 from a setting to a quarter of it), and so
#: many of these distances at most where errors are far below it: ``SKIPPED`` for each factor of e
NEIGHBOUR, SKIPPED, MOST_SKIPPED = FINEST ** (1.0 / 39.0), 2.0, 8
#: errors at settings up to so many times coarser count for that distance
RECENT = 1.6
#: settings that are tried for this, at most
MOST_CONFIRMING = 400
#: the least rtol that scipy is asked for
LEAST_RTOL = 3e-14
#: runs until a search gives up
MOST_TRIALS = 16
#: of clean orders, for the distance to a finer run
CAREFUL = 0.8
#: how much finer that run is. By orders: 1 is that of damped contacts, whose touch steps with a common multiple may all
#: see late by the same; tolerances say little of errors that are near each other
FINER = {"dt": 2.0, "damped": 2.618, "rtol": 30.0}


def measured_error(observable: str, scene: Scene, run: Trajectory, reference: Trajectory) -> float:
    """Return the largest relative error of a run in an observable; UsageError if neither run has a value."""
    return _checked(relative_error(observable, scene, run, reference), observable, scene)


def measured_uncertainty(observable: str, scene: Scene, run: Trajectory) -> float:
    """Return the largest relative uncertainty of a run in an observable; UsageError if the run has no value."""
    return _checked(relative_uncertainty(observable, scene, run), observable, scene)


def _checked(number: float, observable: str, scene: Scene) -> float:
    if math.isnan(number):
        raise UsageError(
            f"observable = {observable!r}: runs of {scene.name} have no value of it within {scene.duration:g} s;"
            " allowed: an observable that the scene has, such as 'velocity'"
        )
    return number


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A backend, the setting that is looked for, and the run that is made in its place."""

    name: str
    runs: str
    """The backend whose runs are looked at: its own name, or "verlet" for a code that it repeats."""
    knob: str
    """"dt", "rtol", or "" where there is nothing to set."""
    order: float
    """Of the error in the knob, as it can be expected."""
    kind: int = 0
    """Order of the method, of a fixed step."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """More settings of those runs."""
    answer: Mapping[str, Any] = field(default_factory=dict)
    """More settings of the backend itself."""
    atol: float = 0.0
    """Absolute tolerance at rtol = 1, of a backend that takes both (SI); 0: the backend takes rtol alone."""

    def settings_at(self, setting: float) -> dict[str, float]:
        """Return the settings that follow from that of the knob."""
        settings = {self.knob: setting} if self.knob else {}
        return {**settings, "atol": float(f"{self.atol * setting:.12g}")} if self.atol else settings


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One setting and what it gave."""

    setting: float
    """The step that was taken, s, or rtol."""
    error: float
    cost: Cost = FREE
    """Cost of the run; nothing where it failed."""


@dataclass(kw_only=True)
class Judge:
    """Makes runs of a scene and measures their errors."""

    scene: Scene
    sampling: Sampling
    observable: str
    reference: Trajectory | None
    """None: errors come from finer runs."""
    progress: Callable[[str], None]
    _runs: dict[tuple[str, float], Trajectory] = field(default_factory=dict)

    def snapped(self, candidate: Candidate, setting: float) -> float:
        """Return the setting that a run takes: steps fall on the samples."""
        if candidate.knob == "":
            return 0.0
        if candidate.knob != "dt":
            return max(LEAST_RTOL, setting)
        interval = self.scene.duration / self.sampling.count
        return interval / max(1, math.ceil(interval / setting * (1.0 - 1e-12)))

    def run(self, candidate: Candidate, setting: float) -> Trajectory:
        """Return a run at a setting, without its uncertainty; runs by which others are measured are made once."""
        setting = self.snapped(candidate, setting)
        key = (candidate.name, setting)
        if key in self._runs:
            return self._runs[key]
        self.progress(f"{candidate.runs} at {candidate.knob} = {setting:.3g}" if candidate.knob else candidate.runs)
        settings = {**candidate.settings, **candidate.settings_at(setting)}
        run = backend(candidate.runs).run(self.scene, Resolution(**settings), self.sampling)
        if self.reference is None:
            self._runs[key] = run
        return run

    def trial(
        self,
        candidate: Candidate,
        setting: float,
        make: Callable[[Candidate, float], Trajectory] | None = None,
        spare: float = 1.0,
    ) -> Trial:
        """Return the trial of a setting; its error is inf where the run fails.

        ``make`` makes the run in place of :meth:`run`. A new run by which errors are measured is finer by ``spare``
        than this setting needs, and serves finer ones.
        """
        setting = self.snapped(candidate, setting)
        try:
            run = (make or self.run)(candidate, setting)
            return Trial(setting=setting, error=self._error(candidate, setting, run, spare), cost=run.cost)
        except (NotAsymptotic, RunBroken):
            return Trial(setting=setting, error=math.inf)

    def _error(self, candidate: Candidate, setting: float, run: Trajectory, spare: float) -> float:
        if self.reference is not None:
            return measured_error(self.observable, self.scene, run, self.reference)
        kind = "damped" if candidate.knob == "dt" and candidate.order == 1.0 else candidate.knob
        requested = setting / FINER[kind]
        there = [item for name, item in self._runs if name == candidate.name and item <= 1.05 * requested]
        finer = max(there, default=self.snapped(candidate, requested / spare))
        if not finer < setting:
            return math.inf  # there is no finer one to see its error by
        apart = measured_error(self.observable, self.scene, run, self.run(candidate, finer))
        return apart / -math.expm1(-CAREFUL * candidate.order * math.log(setting / finer))

    def cpu(self, candidate: Candidate, setting: float, first: float) -> float:
        """Return the CPU time of a run whose first call took ``first``, s.

        It is the least of three where runs are short, because one may include compilation and another be disturbed.
        """
        results = [first]
        while len(results) < 3 and sum(results) < 0.5:
            self._runs.pop((candidate.name, self.snapped(candidate, setting)), None)
            results.append(self.run(candidate, setting).cost.cpu)
        return min(results)


@dataclass(frozen=True, kw_only=True)
class Settled:
    """The coarsest setting from which on all that were tried serve; ``best`` is None where there is none."""

    best: Trial | None
    trials: tuple[Trial, ...]
    """All, as they were made."""

    @property
    def least(self) -> float:
        """The least error that was found."""
        return min(trial.error for trial in self.trials)


def observed_order(trials: Sequence[Trial]) -> float:
    """Slope of the errors in the settings, in decades, by least squares; nan where there is none."""
    real = [(math.log(trial.setting), math.log(trial.error)) for trial in trials if 0.0 < trial.error < math.inf]
    settings, errors = [s for s, _ in real], [e for _, e in real]
    if len({*settings}) < 2:
        return math.nan
    return statistics.linear_regression(settings, errors).slope


def settle(
    trial: Callable[[float], Trial],
    first: float,
    target: float,
    *,
    order: float,
    least: float,
    most: float,
    knob: str = "dt",
) -> Settled:
    """Return the coarsest setting from ``least`` to ``most`` whose error is within ``target``, up to ``CLOSE[knob]``.

    ``trial`` makes and judges the run of a setting; the search begins at ``first`` and follows the order that the
    runs show, within a bracket as soon as there is one. At least two settings are tried. Errors need not fall with the
    setting everywhere: the setting that is returned, and all finer ones that were tried, have errors within the target.
    """
    created: list[Trial] = []
    close, aim = CLOSE[knob], AIM[knob]

    def known(setting: float) -> bool:
        return any(math.isclose(item.setting, setting, rel_tol=1e-9) for item in created)

    setting = min(max(first, least), most)
    for _ in range(MOST_TRIALS):
        result = trial(rounded(setting))
        if known(result.setting):
            break  # no step between the two that are known
        created.append(result)
        best = accepted(created, target)
        above = min((o.setting for o in created if best is None or o.setting > best.setting), default=math.inf)
        slope = _slope(created, target, order)
        if best is not None:
            room = (target / best.error) ** (1.0 / slope) if best.error > 0.0 else math.inf
            enough = min(room, above / best.setting, most / best.setting) <= close
            if enough and len(created) > 1:
                break
            setting = best.setting * min(
                8.0, max(room * aim ** (1.0 / slope), math.sqrt(room)) if room > close else close
            )
            if not best.setting * 1.02 < setting < above / 1.02:
                setting = math.sqrt(best.setting * above)
            setting = min(setting, most)
        else:
            lowest = min(created, key=lambda item: item.setting)
            if lowest.setting <= least * (1.0 + 1e-9) or _stalled(created):
                break
            ratio = (aim * target / lowest.error) ** (1.0 / slope) if lowest.error < math.inf else 0.25
            setting = max(least, lowest.setting * min(0.9, max(0.05, ratio)))
    return Settled(best=accepted(created, target), trials=tuple(created))


def accepted(trials: Sequence[Trial], target: float) -> Trial | None:
    """Return the coarsest trial that serves with all finer ones; None: the finest one does not serve."""
    best = None
    for item in sorted(trials, key=lambda item: item.setting):
        if not item.error <= target:
            break
        best = item
    return best


def rounded(setting: float) -> float:
    """Return a setting with three digits."""
    return float(f"{setting:.2e}")


def confirm(
    trial: Callable[[float], Trial],
    settled: Settled,
    target: float,
    *,
    order: float,
    least: float,
    every: bool = False,
) -> Settled:
    """Return the coarsest setting, from the best of ``settled`` on, with which the finer ones serve down to a quarter.

    The settings are tried from the coarsest to the finest, as close as :data:`NEIGHBOUR` says where errors are near
    the target, or with ``every`` everywhere. Where one errs by more than the target, the coarsest setting that can be
    accepted is finer than that. None is finer than ``least``.
    """
    assert settled.best is not None
    result, best, end = settled.best, None, least
    skips = () if every else range(2, MOST_SKIPPED + 1)
    tried: list[Trial] = []
    while len(tried) < MOST_CONFIRMING:
        tried.append(result)
        if not result.error <= target:
            best, end = None, least
        elif best is None:
            best, end = result, max(FINEST * result.setting, least)
        if result.setting <= end * (1.0 + 1e-9):
            break
        recent = [item for item in tried if item.setting <= RECENT * result.setting]
        envelope = max(item.error * (result.setting / item.setting) ** order for item in recent)
        clear = sum(envelope * math.exp(count / SKIPPED) < target for count in skips)
        if best is None:
            finer = rounded(result.setting * NEIGHBOUR)
        else:
            # powers to the last digit: errors of ode45 change with every digit of its tolerances
            index = math.floor(math.log(result.setting / best.setting, NEIGHBOUR) + 1e-6) + 1 + clear
            finer = best.setting * NEIGHBOUR**index
        result = trial(max(finer, end))
    else:
        best = None
    others = [item for item in settled.trials if item.setting not in {item.setting for item in tried}]
    return Settled(best=best, trials=(*others, *tried))


def _slope(created: list[Trial], target: float, order: float) -> float:
    """Return the order that the two trials nearest to the target show, as far as it is credible."""
    real = sorted((item for item in created if item.error > 0.0), key=lambda item: abs(math.log(item.error / target)))
    shown = observed_order(real[:2])
    return order if math.isnan(shown) else min(1.5 * order, max(0.5 * order, shown))


def _stalled(created: list[Trial]) -> bool:
    """Return whether the last three trials, each finer than the one before, did not reduce the error: a floor."""
    if len(created) < 4:
        return False
    a, *_, d = created[-4:]
    return d.setting < 0.3 * a.setting and d.error > 0.7 * a.error
