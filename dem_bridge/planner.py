"""The cheapest settings for a wanted accuracy: predicted by a model, checked by runs, and said why.

Where :mod:`.plan` finds the step whose error *bar* is within an accuracy, this finds what *errs* by no more: a bar is
some three times an error, so that it holds. What is found is found for these settings and no others.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any

from dem_bridge.accuracy import checked_accuracy
from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling, backend
from dem_bridge.backends.reference import series_fit
from dem_bridge.backends.scipy_dop853 import LARGEST_RTOL
from dem_bridge.backends.steps import radius_of
from dem_bridge.backends.twin_bars import last_digit, round_off_floor
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.plan_check import (
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
from dem_bridge.plan_options import MOST_STEPS, THEORIES, Option, Options
from dem_bridge.plan_predict import OF_RTOL, tidy
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

#: steps of a run that only looks for round-off
FEW_STEPS = 1_000_000
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


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Settings for a wanted accuracy, and why each number is what it is.

    ``db.solve(scene, backend=plan.backend, **plan.resolution)`` makes the run.
    """

    scene: str
    accuracy: float
    """Wanted, relative."""
    observable: str
    backend: str
    resolution: Mapping[str, Any]
    """Keywords of :func:`dem_bridge.solve`."""
    predicted_error: float
    """To be expected of the run, relative: what was found, where it was, else what the model says."""
    predicted_cost: float
    """CPU to be expected of the run without bars, s; likewise."""
    found_error: float | None
    """Of a run with these settings; None: there was none."""
    found_cost: float | None
    """None: there was no run with these settings, or its twin's."""
    model_error: float
    """By the model alone."""
    model_cost: float
    steps: int | None
    """None: not known beforehand."""
    force_evaluations: int | None
    units: Mapping[str, float]
    """The step taken (s) as ``dt``, and as a fraction of the times that DEM users think in; empty: no fixed step."""
    reasons: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """All of it, JSON-able."""
        told = {one.name: getattr(self, one.name) for one in fields(self)}
        return told | {key: dict(told[key]) for key in ("resolution", "units")} | {"reasons": list(self.reasons)}


def plan_for(
    scene: Scene,
    accuracy: float,
    *,
    name: str | None = None,
    observable: str = "velocity",
    sampling: Sampling | None = None,
    budget: float | None = None,
    predict_only: bool = False,
    tell: Tell | None = None,
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
        tell=tell,
    )
    chosen = planner.options.foreseen() if predict_only else planner.checked()
    if budget is not None and chosen.cost > budget:
        raise UsageError(planner.beyond(budget, chosen))
    return planner.answer(chosen)


class Planner:
    """One question, and what was found on the way to its answer."""

    def __init__(
        self, scene: Scene, accuracy: float, *, name: str | None, observable: str, sampling: Sampling, tell: Tell | None
    ) -> None:
        self.options = Options(scene, accuracy, name, observable, sampling)
        self.outlook, self.left_out = self.options.outlook, dict(self.options.left_out)
        self.scene, self.accuracy, self.observable, self.sampling = scene, accuracy, observable, sampling
        self.tell, self.began, self.expected, self.yardstick = tell, time.process_time(), 0.0, ""

    def checked(self) -> Option:
        """The cheapest of those that runs found to serve."""
        truth = self._yardstick()
        self.judge = Judge(self.scene, self.sampling, self.observable, truth, tell=self._say)
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
        self._hopeless(one)
        candidate = self._completed(candidate, one.setting)
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
        setting, own = settled.best.setting, candidate.runs == candidate.name
        return replace(
            one,
            candidate=candidate,
            setting=setting,
            error=settled.best.error,
            cost=self.judge.cpu(candidate, setting) if own else self.outlook.cost(candidate.name, setting),
            trial=settled.best,
            told=_told(candidate, settled),
        )

    def _hopeless(self, one: Option) -> None:
        """UsageError where what is asked is beyond what is to be expected by more than the model may be wrong."""
        candidate, law = one.candidate, one.law
        assert law is not None
        if candidate.name in ENGINE_BACKENDS:
            # round-off grows with the number of steps: what a shorter run has, a longer one has, too
            dt = max(one.setting, self.scene.duration / FEW_STEPS)
            radius = radius_of(self.scene, Resolution(), self.outlook.look)
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
        cost = self.judge.cpu(candidate, 0.0)
        trial = Trial(setting=0.0, error=error, cpu=cost, steps=run.cost.steps, evaluations=run.cost.force_evaluations)
        return replace(one, error=error, cost=cost, trial=trial, told=told)

    def _completed(self, candidate: Candidate, setting: float) -> Candidate:
        """A candidate with all settings of the runs that are made for it: LAMMPS' positions and tables."""
        if candidate.name not in ENGINE_BACKENDS:
            return candidate
        given = {"gauge_radius": radius_of(self.scene, Resolution(), self.outlook.look)}
        if candidate.name != "lammps-table":
            return replace(candidate, given=given)
        plain = replace(candidate, given=given, name="without tables")
        error = math.inf
        for points in TABLE_POINTS:
            answer = {} if points is None else {"table_points": points}
            tabled = replace(candidate, given={**given, **answer, "tables": True}, answer=answer)
            runs = self.judge.run(tabled, setting), self.judge.run(plain, setting)
            error = relative_error(self.observable, self.scene, *runs)
            if error <= TABLE_SHARE * self.accuracy:
                return tabled
            self.judge.forget(tabled)
        raise UsageError(f"tables of {TABLE_POINTS[-1]} points miss {error:.2g}")

    def _floor(self, candidate: Candidate, settled: Settled) -> str:
        """Why no setting serves."""
        last = settled.trials[-1]
        least = f"the least error found is {settled.least:.2g}"
        if candidate.name in ENGINE_BACKENDS:
            radius = candidate.given["gauge_radius"]
            floor = round_off_floor(self.scene, self.outlook.schedule(last.setting), radius)
            if floor > 0.3 * self.accuracy:
                return f"bodies of {radius:.3g} m round off {floor:.2g} of the velocities, and {least}"
        if last.setting <= self.options.least(candidate) * (1.0 + 1e-9):
            most = f"{MOST_STEPS:.0e} steps" if candidate.knob == "dt" else f"rtol = {LEAST_RTOL:g}"
            return f"{least}, with {most}"
        return f"{least}, and finer settings do no better"

    def beyond(self, budget: float, chosen: Option) -> str:
        """What to say where the plan costs more than the budget: the accuracy that this buys."""
        bought, by = math.inf, ""
        for one in [*(o for o in self.options.found if o.candidate.name != chosen.candidate.name), chosen]:
            if one.law is None:
                error = one.error if one.cost <= budget else math.inf
            else:
                known, law = one.setting, one.law
                scale = one.cost / self.outlook.cost(one.candidate.name, known)
                low, high = known, self.options.most(one.candidate)
                if scale * self.outlook.cost(one.candidate.name, high) > budget:
                    continue
                for _ in range(60):
                    middle = math.sqrt(low * high)
                    dear = scale * self.outlook.cost(one.candidate.name, middle) > budget
                    low, high = (middle, high) if dear else (low, middle)
                error = one.error * (high / known) ** law.order
            if error < bought:
                bought, by = error, one.candidate.name
        rest = f"it buys about {bought:.1g} by {by}" if bought < 1.0 else "it buys no run that says anything"
        return (
            f"accuracy = {self.accuracy:g} of {self.observable} on {self.scene.name} costs {chosen.cost:.2g} s of CPU"
            f" by {chosen.candidate.name}, and the budget is {budget:g} s; {rest}; ask for less, or give more"
        )

    def answer(self, chosen: Option) -> Plan:
        """The plan, with its reasons."""
        candidate, trial = chosen.candidate, chosen.trial
        resolution, units = dict(candidate.answer), {}
        steps, evaluations = (trial.steps, trial.evaluations) if trial else (None, None)
        if candidate.knob == "dt":
            plan = self.outlook.schedule(chosen.setting)
            coarser = (
                self.options.interval / (plan.per_sample - 1) if plan.per_sample > 1 else 2.0 * self.options.interval
            )
            resolution["dt"] = tidy(plan.step, coarser)
            units = {"dt": plan.step, **self.outlook.units(plan.step)}
            steps = plan.steps
        elif candidate.knob == "rtol":
            resolution["rtol"] = chosen.setting
        if self.sampling.count != self.scene.samples:
            resolution["samples"] = self.sampling.count
        own = candidate.runs == candidate.name
        return Plan(
            scene=self.scene.name,
            accuracy=self.accuracy,
            observable=self.observable,
            backend=candidate.name,
            resolution=MappingProxyType(resolution),
            predicted_error=chosen.error,
            predicted_cost=chosen.cost,
            found_error=None if trial is None else trial.error,
            found_cost=chosen.cost if trial is not None and own else None,
            model_error=(
                self.outlook.known_error(candidate.name, self.observable)
                if chosen.law is None
                else self.outlook.error(chosen.law, chosen.setting, self.observable)
            ),
            model_cost=self.outlook.cost(candidate.name, chosen.setting),
            steps=steps,
            force_evaluations=evaluations,
            units=MappingProxyType(units),
            reasons=tuple(self._reasons(chosen)),
        )

    def _reasons(self, chosen: Option) -> Iterator[str]:
        outlook, candidate = self.outlook, chosen.candidate
        if candidate.knob == "dt":
            yield (
                f"the coarse run found contacts of up to {outlook.look.frequency:.3g} rad/s, and a phase of"
                f" {outlook.phase:.3g} rad in the stiffest of each moment over {self.scene.duration:g} s"
            )
        if chosen.law is not None:
            first = outlook.setting(chosen.law, self.accuracy, self.observable)
            yield (
                f"the model has {self.accuracy:g} at {candidate.knob} = {first:.2g}: errors go with its power"
                f" {chosen.law.order:g}, and 95 % of random scenes err by no more than {chosen.law.spread:g} times that"
            )
        if chosen.trial is not None:
            yield chosen.told
            if chosen.law is not None:
                yield f"errors are measured against {self.yardstick}"
        elif chosen.law is not None:
            yield f"nothing was run to check it, so the error is planned {chosen.law.spread:g} times smaller"
        else:
            yield f"nothing was run to check it: {candidate.name} errs by no more in 95 % of the random scenes tried"
        if candidate.runs != candidate.name:
            yield (
                f"{candidate.name} was not run: the twin in positions repeats it to 1e-10, round-off included, and its"
                " cost is that of bodies, steps and samples"
            )
        for reason in dict.fromkeys(self.left_out.values()):
            yield f"{', '.join(name for name, why in self.left_out.items() if why == reason)}: {reason}"

    def _say(self, label: str) -> None:
        if self.tell is not None:
            spent = time.process_time() - self.began
            self.tell(min(0.95, spent / max(self.expected, 1e-9)), 1, label)


def _told(candidate: Candidate, settled: Settled) -> str:
    """The runs that were made, and the order that they show."""
    runs = sorted(settled.trials, key=lambda one: -one.setting)
    tried = ", ".join(f"{one.error:.2g} at {one.setting:.3g}" for one in runs)
    if candidate.knob == "rtol":
        return f"runs of {candidate.runs} err by {tried} (rtol)"
    order = observed_order(runs)
    shown = "" if math.isnan(order) else f": order {order:.2f} on the whole"
    return f"runs of {candidate.runs} err by {tried} s{shown}"
