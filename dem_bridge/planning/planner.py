"""The cheapest settings for a wanted accuracy: predicted by a model, checked by runs, and said why.

Where :mod:`.bars` finds the step whose error *bar* is within an accuracy, this finds what *errs* by no more: a bar is
some three times an error, so that it holds. What is found is found for these settings and no others.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

from dem_bridge.accuracy import checked_accuracy
from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling, backend
from dem_bridge.backends.reference import series_fit
from dem_bridge.backends.scipy_dop853 import LARGEST_RTOL
from dem_bridge.backends.steps import radius_of
from dem_bridge.backends.twin_bars import last_digit, round_off_floor
from dem_bridge.errors import NotAsymptotic, RunBroken, UsageError
from dem_bridge.extrapolate import extrapolated
from dem_bridge.planning.answer import Plan, answer, beyond
from dem_bridge.planning.check import (
    LEAST_RTOL,
    Candidate,
    Judge,
    Settled,
    Trial,
    observed_order,
    relative_bar,
    relative_error,
    settle,
)
from dem_bridge.planning.options import MOST_STEPS, THEORIES, Option, Options
from dem_bridge.planning.predict import OF_RTOL
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

#: at such accuracies codes that keep positions are asked for their round-off first; steps of a run for it
ROUND_OFF_BELOW, FEW_STEPS = 1e-7, 5_000_000
#: at such accuracies LAMMPS' runs may be extrapolated: where that costs less than this part of one run, with so much
#: more for the finest of the three, which comes with bars
EXTRAPOLATED_BELOW, EXTRAPOLATED_GAIN, EXTRAPOLATED_BARS = 1e-5, 0.8, 1.4
#: weights of 4/3 and -1/3 magnify what was rounded
EXTRAPOLATED_ROUNDING = 5.0 / 3.0
SAMPLED = ("velocity", "displacement")
#: what costs more than so many times the least, as predicted, is not tried: the laws of costs are that good
WORTH_TRYING = 4.0
#: s of CPU that a yardstick may take, whatever the runs take
CHEAP = 1.0
#: runs that bars take, the run itself included
WITH_BARS = MappingProxyType({"reference": 7.0, "scipy": 3.0})
#: part of the accuracy that the bar of the yardstick may be
YARDSTICK_BAR = 0.1
#: tables may miss this part of the accuracy; points of a table that are tried beside the default
TABLE_SHARE, TABLE_POINTS = 0.3, (None, 40_000, 160_000, 640_000)

Tell = Callable[[float, int, str], None]


def plan_for(
    scene: Scene,
    accuracy: float,
    *,
    name: str | None = None,
    observable: str = "velocity",
    sampling: Sampling | None = None,
    budget: float | None = None,
    predict_only: bool = False,
    progress: Tell | None = None,
) -> Plan:
    """See :func:`dem_bridge.plan`; ``name`` is that of a backend, None where the choice is free."""
    if budget is not None and not 0.0 < budget < math.inf:
        raise UsageError(f"budget = {budget!r}; allowed: a number > 0 (s of CPU)")
    planner = Planner(
        scene,
        checked_accuracy(accuracy),
        name=name,
        observable=observable,
        sampling=sampling or Sampling(count=scene.samples),
        progress=progress,
    )
    chosen = planner.options.foreseen() if predict_only else planner.checked()
    if budget is not None and chosen.cost > budget:
        raise UsageError(beyond(planner.options, budget, chosen))
    return answer(planner.options, chosen, planner.left_out, planner.yardstick)


class Planner:
    """One question, and what was found on the way to its answer."""

    def __init__(
        self,
        scene: Scene,
        accuracy: float,
        *,
        name: str | None,
        observable: str,
        sampling: Sampling,
        progress: Tell | None,
    ) -> None:
        self.options = Options(scene, accuracy, name, observable, sampling)
        self.outlook, self.left_out = self.options.outlook, dict(self.options.left_out)
        self.scene, self.accuracy, self.observable, self.sampling = scene, accuracy, observable, sampling
        self.progress, self.began, self.expected, self.yardstick = progress, time.process_time(), 0.0, ""

    def checked(self) -> Option:
        """The cheapest of those that runs found to serve."""
        truth = self._yardstick()
        self.judge = Judge(self.scene, self.sampling, self.observable, truth, progress=self._say)
        best: Option | None = None
        floors: dict[str, str] = {}
        for one in self.options.found:
            name = one.candidate.name
            if best is not None and one.cost > WORTH_TRYING * best.cost:
                self.left_out[name] = f"predicted to cost {one.cost:.2g} s of CPU"
                continue
            try:
                found = self._tried(one)
            except (UsageError, RunBroken) as error:
                floors[name] = str(error)
                continue
            if best is None or found.cost < best.cost:
                if best is not None:
                    self.left_out[best.candidate.name] = f"found to cost {best.cost:.2g} s of CPU"
                best = found
            else:
                self.left_out[name] = f"found to cost {found.cost:.2g} s of CPU"
        self.left_out |= floors
        if best is None:
            raise UsageError(
                f"accuracy = {self.accuracy:g} of {self.observable} on {self.scene.name} cannot be had: "
                + "; ".join(f"{name}: {floor}" for name, floor in floors.items())
                + "; ask for less"
            )
        return best

    def _yardstick(self) -> Trajectory | None:
        """A reference where one is cheap, and well enough known for what is asked."""
        options, outlook = self.options.found, self.outlook
        worth = [one.cost for one in options if one.cost <= WORTH_TRYING * options[0].cost]
        cheap = max(CHEAP, 3.0 * min((one.cost for one in options if one.candidate.knob), default=math.inf))
        if series_fit(self.scene):
            name, settings = "reference", [math.nan]
        else:
            # the finest, or one that is as fine as it must be
            enough = outlook.setting(OF_RTOL, 0.1 * YARDSTICK_BAR * self.accuracy / OF_RTOL.spread, self.observable)
            name, settings = "scipy", [LEAST_RTOL, min(max(enough, LEAST_RTOL), LARGEST_RTOL)]
        costs = [WITH_BARS[name] * outlook.cost(name, setting) for setting in settings]
        self.expected = min(costs) + 5.0 * sum(worth)
        for setting, cost in zip(settings, costs, strict=True):
            if cost > cheap:
                self.yardstick = f"finer runs of its own, for {name} would take {cost:.2g} s"
                continue
            self._say(f"yardstick: {name}")
            try:
                run = backend(name).run(
                    self.scene, Resolution() if name == "reference" else Resolution(rtol=setting), self.sampling
                )
            except RunBroken as error:
                self.yardstick = f"finer runs of its own, for {error}"
                return None
            bar = relative_bar(self.observable, self.scene, run)
            if bar <= YARDSTICK_BAR * self.accuracy:
                self.yardstick = f"{name}, whose bar is {bar:.1g}"
                return run
            self.yardstick = f"finer runs of its own, for {name} has a bar of {bar:.2g}"
        return None

    def _tried(self, one: Option) -> Option:
        """An option with what its runs found; UsageError, with the floor, where none serves."""
        candidate = one.candidate
        if candidate.knob == "":
            return self._tried_as_it_is(one)
        candidate = self._completed(candidate, one.setting)
        one = replace(one, candidate=candidate)
        try:
            alone = self._settled(one)
        except UsageError:
            # three shorter runs have less round-off than a long one
            if together := self._extrapolated(replace(one, cost=math.inf)):
                return together
            raise
        return self._extrapolated(alone) or alone

    def _settled(self, one: Option) -> Option:
        """An option with the coarsest setting that serves; UsageError, with the floor, where none does."""
        self._hopeless(one)
        candidate = one.candidate
        settled = settle(
            lambda setting: self.judge.trial(candidate, setting),
            one.setting,
            self.accuracy,
            order=candidate.order,
            least=self.options.least(candidate),
            most=self.options.most(candidate),
            knob=candidate.knob,
            erratic=candidate.kind in (1, 4),
        )
        if settled.best is None:
            raise UsageError(self._floor(candidate, settled))
        best, own = settled.best, candidate.runs == candidate.name
        return replace(
            one,
            setting=best.setting,
            error=best.error,
            cost=self.judge.cpu(candidate, best.setting, best.cpu)
            if own
            else self.outlook.cost(candidate.name, best.setting),
            trial=best,
            told=_told(candidate, settled),
        )

    def _extrapolated(self, plain: Option) -> Option | None:
        """Three runs of LAMMPS extrapolated, where they cost less than the one that serves alone; None: they do not.

        On random chains they never do at 1e-4, at 1e-6 in a fifth and at 1e-7 in half of those whose order is clean.
        """
        candidate, truth = plain.candidate, self.judge.truth
        wanted = candidate.name in ENGINE_BACKENDS and candidate.kind == 2 and self.observable in SAMPLED
        if not wanted or truth is None or self.accuracy > EXTRAPOLATED_BELOW:
            return None

        def trial(setting: float) -> Trial:
            setting = self.judge.snapped(candidate, float(f"{setting:.2e}"))
            self._say(f"{candidate.runs} extrapolated from dt = {setting:.3g}")
            try:
                resolution = Resolution(**candidate.given, dt=setting, bars=False)
                run = extrapolated(backend(candidate.runs), self.scene, resolution, self.sampling)
                error = relative_error(self.observable, self.scene, run, truth)
            except (NotAsymptotic, RunBroken):
                return Trial(setting=setting, error=math.inf, cpu=math.nan, steps=0, evaluations=0)
            cost = run.cost
            return Trial(
                setting=setting, error=error, cpu=cost.cpu, steps=cost.steps, evaluations=cost.force_evaluations
            )

        def cost(setting: float) -> float:
            coarse, main, fine = (self.outlook.cost(candidate.name, part * setting) for part in (2.0, 1.0, 0.5))
            return coarse + main + EXTRAPOLATED_BARS * fine

        # the coarsest of the three has to fall on the samples, too
        least, most = 1.75 * plain.setting, 0.5 * self.options.interval
        if least >= most or cost(most) > plain.cost:
            return None
        # of order 4 against 2
        first = min(2.0 * plain.setting * (1e-4 / self.accuracy) ** 0.25, most)
        rounds_off = round_off_floor(
            self.scene, self.outlook.schedule(0.5 * first), candidate.given["surrogate_radius"]
        )
        if EXTRAPOLATED_ROUNDING * rounds_off > self.accuracy:
            return None
        settled = settle(trial, first, self.accuracy, order=4.0, least=least, most=most)
        best = settled.best
        if best is None or cost(best.setting) > EXTRAPOLATED_GAIN * plain.cost:
            return None
        return replace(
            plain,
            candidate=replace(candidate, answer={**candidate.answer, "order": "richardson"}),
            setting=best.setting,
            error=best.error,
            cost=cost(best.setting),
            trial=best,
            told=f"twins extrapolated from steps of 2 dt, dt and dt/2 err by {_tried(settled)} s, and three runs cost"
            f" {cost(best.setting):.2g} s of CPU"
            + (f", one that serves alone {plain.cost:.2g} s" if plain.cost < math.inf else "; none serves alone"),
        )

    def _hopeless(self, one: Option) -> None:
        """UsageError where what is asked is beyond what is to be expected by more than the model may be wrong."""
        candidate, law = one.candidate, one.law
        assert law is not None
        if candidate.name in ENGINE_BACKENDS and self.accuracy < ROUND_OFF_BELOW:
            # round-off grows with the number of steps: what a shorter run has, a longer one has, too
            dt = max(one.setting, self.scene.duration / FEW_STEPS)
            radius = radius_of(self.scene, Resolution(), self.outlook.prescan)
            floor = round_off_floor(self.scene, self.outlook.schedule(dt), radius)
            if floor > self.accuracy:
                raise UsageError(f"bodies of {radius:.3g} m round off {floor:.2g} of the velocities")
        if candidate.knob == "dt":
            plan = self.outlook.schedule(one.setting)
            if (digits := last_digit(plan)) > self.accuracy:
                raise UsageError(f"the last digits of {plan.steps} steps add up to {digits:.1g}")
        if one.error > law.spread * self.accuracy:
            most = f"{MOST_STEPS:.0e} steps" if candidate.knob == "dt" else f"rtol = {LEAST_RTOL:g}"
            raise UsageError(f"an error of {one.error:.1g} is predicted with {most}")

    def _tried_as_it_is(self, one: Option) -> Option:
        """What has no setting: it serves or it does not."""
        candidate, truth = one.candidate, self.judge.truth
        name = candidate.name
        if name in THEORIES:
            if truth is None:
                raise UsageError("nothing cheap to check it with")
            run = self.judge.run(candidate, 0.0)
            error, told = relative_error(self.observable, self.scene, run, truth), f"checked against {self.yardstick}"
        else:
            self._say(f"{name} with bars")
            if truth is not None and truth.provenance["backend"] == name:
                run = truth
            else:
                run = backend(name).run(self.scene, Resolution(), self.sampling)
            error, told = relative_bar(self.observable, self.scene, run), "its own error bar stands for its error"
        if not error <= self.accuracy:
            raise UsageError(f"errs by {error:.2g}" if name in THEORIES else f"its bar is {error:.2g}")
        cost = self.judge.cpu(candidate, 0.0, run.cost.cpu)
        trial = Trial(setting=0.0, error=error, cpu=cost, steps=run.cost.steps, evaluations=run.cost.force_evaluations)
        return replace(one, error=error, cost=cost, trial=trial, told=told)

    def _completed(self, candidate: Candidate, setting: float) -> Candidate:
        """A candidate with all settings of the runs that are made for it: LAMMPS' positions and tables."""
        if candidate.name not in ENGINE_BACKENDS:
            return candidate
        given = {"surrogate_radius": radius_of(self.scene, Resolution(), self.outlook.prescan)}
        if candidate.name != "lammps-table":
            return replace(candidate, given=given)
        plain = replace(candidate, given=given, name="without tables")
        error = math.inf
        for points in TABLE_POINTS:
            answer = {} if points is None else {"table_points": points}
            tabled = replace(candidate, given={**given, **answer, "tables": True}, answer=answer)
            # named by its points: what other tables gave is not mistaken for theirs
            beside = self.judge.run(replace(tabled, name=f"{points} points"), setting)
            error = relative_error(self.observable, self.scene, beside, self.judge.run(plain, setting))
            if error <= TABLE_SHARE * self.accuracy:
                return tabled
        raise UsageError(f"tables of {TABLE_POINTS[-1]} points miss {error:.2g}")

    def _floor(self, candidate: Candidate, settled: Settled) -> str:
        """Why no setting serves."""
        last = settled.trials[-1]
        least = f"the least error found is {settled.least:.2g}"
        if candidate.name in ENGINE_BACKENDS:
            radius = candidate.given["surrogate_radius"]
            floor = round_off_floor(self.scene, self.outlook.schedule(last.setting), radius)
            if floor > 0.3 * self.accuracy:
                return f"bodies of {radius:.3g} m round off {floor:.2g} of the velocities, and {least}"
        if last.setting <= self.options.least(candidate) * (1.0 + 1e-9):
            most = f"{MOST_STEPS:.0e} steps" if candidate.knob == "dt" else f"rtol = {LEAST_RTOL:g}"
            return f"{least}, with {most}"
        return f"{least}, and finer settings do no better"

    def _say(self, label: str) -> None:
        if self.progress is not None:
            spent = time.process_time() - self.began
            self.progress(min(0.95, spent / max(self.expected, 1e-9)), 1, label)


def _told(candidate: Candidate, settled: Settled) -> str:
    """The runs that were made, and the order that they show."""
    if candidate.knob == "rtol":
        return f"runs of {candidate.runs} err by {_tried(settled)} (rtol)"
    order = observed_order(settled.trials)
    shown = "" if math.isnan(order) else f": order {order:.2f} on the whole"
    return f"runs of {candidate.runs} err by {_tried(settled)} s{shown}"


def _tried(settled: Settled) -> str:
    """Errors by settings, from the coarsest on."""
    runs = sorted({one.setting: one for one in settled.trials}.values(), key=lambda one: -one.setting)
    return ", ".join(f"{one.error:.2g} at {one.setting:.3g}" for one in runs)
