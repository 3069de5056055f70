"""The cheapest settings for an accuracy: predicted by an error model, checked by runs, with the reasons.

:mod:`dem_bridge.runs.uncertainty.step_choice` finds the step whose *uncertainty* is within an accuracy; the planner
finds settings whose *error* is. An uncertainty is about three times the error, so that it holds. The answer is valid
for the settings that were run and, because errors do not fall with every smaller step, only if finer ones serve, too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling
from dem_bridge.backends.reference import SERIES
from dem_bridge.backends.roundoff import roundoff_floor
from dem_bridge.backends.scipy_dop853 import LARGEST_RTOL
from dem_bridge.backends.surrogate_radius import radius_of
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.foundation.numbers import check_number
from dem_bridge.observables.convergence import checked_accuracy
from dem_bridge.runs.case import Case
from dem_bridge.runs.costs import WITH_UNCERTAINTY
from dem_bridge.runs.planning.answer import Plan, answer, beyond, errors_by_setting, evidence_of
from dem_bridge.runs.planning.backend_options import MOST_STEPS, THEORIES, Option, Options
from dem_bridge.runs.planning.predict import OF_RTOL
from dem_bridge.runs.planning.trials import (
    FINEST,
    LEAST_RTOL,
    MARGIN,
    Candidate,
    Judge,
    Settled,
    Trial,
    confirm,
    measured_error,
    measured_uncertainty,
    settle,
)
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.runs.uncertainty.extrapolate import extrapolate
from dem_bridge.runs.uncertainty.fixed_step import last_digit
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory

#: at accuracies below this the round-off of codes that keep positions is measured first, in a run of so many steps
ROUND_OFF_BELOW, FEW_STEPS = 1e-7, 5_000_000
#: at accuracies below this LAMMPS' runs may be extrapolated, if that costs less than this part of one run; the finest
#: of the three runs costs so much more because of its uncertainty
EXTRAPOLATED_BELOW, EXTRAPOLATED_GAIN, EXTRAPOLATED_UNCERTAINTY = 1e-5, 0.8, 1.4
#: Richardson's weights of 4/3 and -1/3 magnify round-off by this factor
EXTRAPOLATED_ROUNDING = 5.0 / 3.0
SAMPLED = ("velocity", "displacement")
#: options that are predicted to cost more than so many times the cheapest are not tried; cost laws are that accurate
WORTH_TRYING = 4.0
#: CPU time, s, that the reference may take, however short the runs are
CHEAP = 1.0
#: largest uncertainty of the reference, as a part of the accuracy
REFERENCE_SHARE = 0.1
#: largest interpolation error of tables, as a part of the accuracy; numbers of points that are tried
TABLE_SHARE, TABLE_POINTS = 0.3, (None, 40_000, 160_000, 640_000)

Progress = Callable[[float, int, str], None]


def plan_for(
    scene: Scene,
    accuracy: float,
    *,
    name: str | None = None,
    observable: str = "velocity",
    sampling: Sampling | None = None,
    left_out: Mapping[str, str] = MappingProxyType({}),
    budget: float | None = None,
    predict_only: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """Plan the settings for an accuracy, see :func:`dem_bridge.plan`.

    ``name`` is that of a backend; None: the cheapest one is chosen. ``left_out``: backends that are no candidates, with
    the reasons.
    """
    if budget is not None:
        check_number("budget", budget, "a number > 0 (s of CPU)", above=0.0)
    options = Options(
        scene, checked_accuracy(accuracy), name, observable, sampling or Sampling(count=scene.samples), left_out
    )
    planner = Planner(options, progress)
    chosen = planner.options.foreseen() if predict_only else planner.checked()
    if budget is not None and chosen.cost > budget:
        raise UsageError(beyond(planner.options, budget, chosen))
    return answer(planner.options, chosen, planner.left_out, planner.measured_against)


class Planner:
    """The search for the cheapest settings: predictions, trial runs and the options that were left out."""

    def __init__(self, options: Options, progress: Progress | None) -> None:
        self.options, self.outlook, self.left_out = options, options.outlook, dict(options.left_out)
        self.scene, self.accuracy, self.observable = options.scene, options.accuracy, options.observable
        self.sampling = options.outlook.sampling
        self.progress, self.start = progress, time.process_time()
        self.measured_against = ""

    def checked(self) -> Option:
        """Return the cheapest option whose error, measured by runs, is within the accuracy."""
        self.judge = Judge(
            scene=self.scene,
            sampling=self.sampling,
            observable=self.observable,
            reference=self._cheap_reference(),
            progress=self._say,
        )
        floors: dict[str, str] = {}
        remaining = list(self.options.predicted)
        while remaining:
            # the cheapest option is confirmed first: the many runs that this takes are often spared for the others
            option = min(remaining, key=lambda o: o.cost / (1.0 if o.settled else WORTH_TRYING))
            remaining.remove(option)
            if option.confirmed:
                for other in remaining:
                    how = "measured" if other.settled else "predicted to"
                    self.left_out[other.candidate.name] = f"{how} cost {other.cost:.2g} s of CPU"
                self.left_out |= floors
                return option
            try:
                remaining.append(self._try(option))
            except (UsageError, RunBroken) as error:
                floors[option.candidate.name] = str(error)
        raise UsageError(
            f"accuracy = {self.accuracy:g} of {self.observable} on {self.scene.name} cannot be reached: "
            + "; ".join(f"{name}: {floor}" for name, floor in floors.items())
            + "; ask for less"
        )

    def _cheap_reference(self) -> Trajectory | None:
        """Solve for a reference; None where it would cost too much or would be too uncertain for the accuracy."""
        options, outlook = self.options.predicted, self.outlook
        tried_costs = [option.cost for option in options if option.cost <= WORTH_TRYING * options[0].cost]
        limit = max(CHEAP, 3.0 * min((option.cost for option in options if option.candidate.knob), default=math.inf))
        if SERIES.covers(self.scene):
            name, settings = "reference", [math.nan]
        else:
            # the finest tolerance, or one that suffices
            law = OF_RTOL["scipy"]
            enough = outlook.setting(law, 0.1 * REFERENCE_SHARE * self.accuracy / law.spread, self.observable)
            name, settings = "scipy", [LEAST_RTOL, min(max(enough, LEAST_RTOL), LARGEST_RTOL)]
        costs = [WITH_UNCERTAINTY[name] * outlook.cost(name, setting) for setting in settings]
        self.expected_cpu = min(costs) + 5.0 * sum(tried_costs)
        for setting, cost in zip(settings, costs, strict=True):
            if cost > limit:
                self.measured_against = f"finer runs of the same backend, because {name} would take {cost:.2g} s"
                continue
            self._say(f"reference by {name}")
            try:
                how = Resolution() if name == "reference" else Resolution(rtol=setting)
                run = solve(Case(scene=self.scene, backend=name, resolution=how, sampling=self.sampling))
            except RunBroken as error:
                self.measured_against = f"finer runs of the same backend, because {error}"
                return None
            uncertainty = measured_uncertainty(self.observable, self.scene, run)
            if uncertainty <= REFERENCE_SHARE * self.accuracy:
                self.measured_against = f"{name}, with an uncertainty of {uncertainty:.1g}"
                return run
            self.measured_against = (
                f"finer runs of the same backend, because {name} has an uncertainty of {uncertainty:.2g}"
            )
        return None

    def _try(self, option: Option) -> Option:
        """Return an option with measured error and cost, after a second call a confirmed one.

        Raises UsageError, with the floor, where no setting serves.
        """
        candidate = option.candidate
        if candidate.knob == "":
            return self._try_without_setting(option)
        if option.settled is None:
            option = replace(option, candidate=self._completed(candidate, option.setting))
        try:
            single = self._settled(option)
        except UsageError:
            # three shorter runs have less round-off than a long one
            if extrapolated := self._extrapolated(replace(option, cost=math.inf)):
                return extrapolated
            raise
        return (self._extrapolated(single) if single.confirmed else None) or single

    def _settled(self, option: Option) -> Option:
        """Return an option at its coarsest setting that serves, confirmed by finer ones if there was one already.

        Raises UsageError, with the floor, where none does.
        """
        candidate, order, least = option.candidate, option.candidate.order, self.options.least(option.candidate)
        target = MARGIN[candidate.kind] * self.accuracy
        if option.settled is None:
            self._check_prospects(option)
            settled = settle(
                partial(self.judge.trial, candidate),
                option.setting,
                target,
                order=order,
                least=least,
                most=self.options.most(candidate),
                knob=candidate.knob,
            )
        else:
            settled = confirm(
                partial(self.judge.trial, candidate, spare=1.0 / FINEST),
                option.settled,
                target,
                order=order,
                least=max(least, self._least_by_roundoff(candidate, option.setting)),
                every=candidate.knob == "rtol",
            )
        if settled.best is None:
            raise UsageError(self._floor(candidate, settled))
        best, runs_itself = settled.best, candidate.runs == candidate.name
        return replace(
            option,
            setting=best.setting,
            error=best.error,
            cost=self.judge.cpu(candidate, best.setting, best.cost.cpu)
            if runs_itself
            else self.outlook.cost(candidate.name, best.setting),
            settled=settled,
            confirmed=option.settled is not None,
            evidence=evidence_of(candidate, settled),
        )

    def _least_by_roundoff(self, candidate: Candidate, setting: float, times: float = 1.0) -> float:
        """Return the finest setting, down to a quarter of this one, whose round-off leaves room for the error.

        ``times``: by this factor the round-off of the finest run counts.
        """
        if candidate.name not in ENGINE_BACKENDS or self.accuracy >= ROUND_OFF_BELOW:
            return 0.0
        for part in (FINEST, 0.5):
            plan = self.outlook.schedule(part * setting)
            if times * roundoff_floor(self.scene, plan, candidate.settings["surrogate_radius"]) <= 0.3 * self.accuracy:
                return part * setting
        return setting

    def _extrapolated(self, plain: Option) -> Option | None:
        """Return the extrapolation of three LAMMPS runs; None where it does not cost less than a single run.

        On random chains whose order is clean it never costs less at 1e-4; at 1e-6 it does in a fifth, at 1e-7 in half.
        """
        candidate = plain.candidate
        possible = candidate.name in ENGINE_BACKENDS and candidate.kind == 2 and self.observable in SAMPLED
        if not possible or self.judge.reference is None or self.accuracy > EXTRAPOLATED_BELOW:
            return None

        def make(candidate: Candidate, setting: float) -> Trajectory:
            self._say(f"{candidate.runs} extrapolated from dt = {setting:.3g}")
            how = Resolution(**candidate.settings, dt=setting)
            case = Case(scene=self.scene, backend=candidate.runs, resolution=how, sampling=self.sampling)
            return extrapolate(replace(case, uncertainty=False))

        def cost(setting: float) -> float:
            coarse, main, fine = (self.outlook.cost(candidate.name, part * setting) for part in (2.0, 1.0, 0.5))
            return coarse + main + EXTRAPOLATED_UNCERTAINTY * fine

        # the coarsest of the three must fall on the samples as well
        least, most, limit = 1.75 * plain.setting, 0.5 * self.options.interval, EXTRAPOLATED_GAIN * plain.cost
        if least >= most or cost(most) > limit:
            return None
        target = MARGIN[4] * self.accuracy
        # the order is 4 in place of 2
        first = min(2.0 * plain.setting * (1e-4 / self.accuracy) ** 0.25, most)
        roundoff = roundoff_floor(
            self.scene, self.outlook.schedule(0.5 * first), candidate.settings["surrogate_radius"]
        )
        if EXTRAPOLATED_ROUNDING * roundoff > self.accuracy:
            return None
        trial = partial(self.judge.trial, candidate, make=make)
        settled = settle(trial, first, target, order=4.0, least=least, most=most)
        if settled.best is None or cost(settled.best.setting) > limit:
            return None
        least = 2.0 * self._least_by_roundoff(candidate, 0.5 * settled.best.setting, EXTRAPOLATED_ROUNDING)
        settled = confirm(trial, settled, target, order=4.0, least=least)
        best = settled.best
        if best is None or cost(best.setting) > limit:
            return None
        return replace(
            plain,
            candidate=replace(candidate, answer={**candidate.answer, "order": "richardson"}),
            setting=best.setting,
            error=best.error,
            cost=cost(best.setting),
            settled=settled,
            confirmed=True,
            evidence=f"extrapolations from steps of 2 dt, dt and dt/2 err by {errors_by_setting(settled)} (s);"
            f" three runs cost {cost(best.setting):.2g} s of CPU"
            + (f", a single run {plain.cost:.2g} s" if plain.cost < math.inf else ", and no single run serves"),
        )

    def _check_prospects(self, option: Option) -> None:
        """Raise UsageError where round-off, or the model with its margin, rules the accuracy out before any run."""
        candidate, law = option.candidate, option.law
        assert law is not None
        if candidate.name in ENGINE_BACKENDS and self.accuracy < ROUND_OFF_BELOW:
            # round-off grows with the number of steps: a longer run has at least that of a shorter one
            dt = max(option.setting, self.scene.duration / FEW_STEPS)
            radius = radius_of(self.scene, Resolution(), self.outlook.prescan)
            floor = roundoff_floor(self.scene, self.outlook.schedule(dt), radius)
            if floor > self.accuracy:
                raise UsageError(f"round-off with a radius of {radius:.3g} m limits the accuracy to {floor:.2g}")
        if candidate.knob == "dt":
            plan = self.outlook.schedule(option.setting)
            if (digits := last_digit(plan)) > self.accuracy:
                raise UsageError(f"the round-off of {plan.steps} steps adds up to {digits:.1g}")
        if option.error > law.spread * self.accuracy:
            most = f"{MOST_STEPS:.0e} steps" if candidate.knob == "dt" else f"rtol = {LEAST_RTOL:g}"
            raise UsageError(f"the predicted error is {option.error:.1g} with {most}")

    def _try_without_setting(self, option: Option) -> Option:
        """Return an option that has no setting, with its error. Raises UsageError where that is above the accuracy."""
        candidate, reference = option.candidate, self.judge.reference
        name = candidate.name
        if name in THEORIES:
            if reference is None:
                raise UsageError("no reference is cheap enough to measure its error")
            run = self.judge.run(candidate, option.setting)
            error = measured_error(self.observable, self.scene, run, reference)
            evidence = f"its error is measured against {self.measured_against}"
        else:
            self._say(f"{name} with its uncertainty")
            if reference is not None and reference.provenance["backend"] == name:
                run = reference
            else:
                run = solve(Case(scene=self.scene, backend=name, resolution=Resolution(), sampling=self.sampling))
            error = measured_uncertainty(self.observable, self.scene, run)
            evidence = "its uncertainty is taken as its error"
        if not error <= self.accuracy:
            raise UsageError(f"its error is {error:.2g}" if name in THEORIES else f"its uncertainty is {error:.2g}")
        cost = self.judge.cpu(candidate, option.setting, run.cost.cpu)
        trial = Trial(setting=option.setting, error=error, cost=run.cost)
        settled = Settled(best=trial, trials=(trial,))
        return replace(option, error=error, cost=cost, settled=settled, confirmed=True, evidence=evidence)

    def _completed(self, candidate: Candidate, setting: float) -> Candidate:
        """Return a candidate with all settings of its runs: for LAMMPS the surrogate radius and the tables."""
        if candidate.name not in ENGINE_BACKENDS:
            return candidate
        provided = {"surrogate_radius": radius_of(self.scene, Resolution(), self.outlook.prescan)}
        if candidate.name != "lammps-table":
            return replace(candidate, settings=provided)
        plain = replace(candidate, settings=provided, name="without tables")
        error = math.inf
        for points in TABLE_POINTS:
            answer = {} if points is None else {"table_points": points}
            tabled = replace(candidate, settings={**provided, **answer, "tables": True}, answer=answer)
            # named by its points, so that runs with other tables are told apart
            run = self.judge.run(replace(tabled, name=f"{points} points"), setting)
            error = measured_error(self.observable, self.scene, run, self.judge.run(plain, setting))
            if error <= TABLE_SHARE * self.accuracy:
                return tabled
        raise UsageError(f"tables of {TABLE_POINTS[-1]} points have an interpolation error of {error:.2g}")

    def _floor(self, candidate: Candidate, settled: Settled) -> str:
        """Return the reason why no setting serves, with the smallest error."""
        last = settled.trials[-1]
        least = f"the smallest measured error is {settled.least:.2g}"
        if candidate.name in ENGINE_BACKENDS:
            radius = candidate.settings["surrogate_radius"]
            floor = roundoff_floor(self.scene, self.outlook.schedule(last.setting), radius)
            if floor > 0.3 * self.accuracy:
                return f"round-off with a radius of {radius:.3g} m limits the accuracy to {floor:.2g}; {least}"
        if last.setting <= self.options.least(candidate) * (1.0 + 1e-9):
            most = f"{MOST_STEPS:.0e} steps" if candidate.knob == "dt" else f"rtol = {LEAST_RTOL:g}"
            return f"{least}, with {most}"
        return f"{least}, and finer settings do not reduce it"

    def _say(self, label: str) -> None:
        if self.progress is not None:
            spent = time.process_time() - self.start
            self.progress(min(0.95, spent / self.expected_cpu), 1, label)
