"""The answer of the planner: a Plan with the reasons for its numbers, or the accuracy that a budget buys instead."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

from dem_bridge.foundation.notebook import plan_html, plan_text
from dem_bridge.runs.planning.backend_options import Option, Options
from dem_bridge.runs.planning.predict import tidy
from dem_bridge.runs.planning.trials import Candidate, Settled, observed_order

#: settings whose errors a reason lists
LISTED = 3


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Settings for an accuracy, with the reason for each number.

    ``db.solve(scene, backend=plan.backend, **plan.resolution)`` makes the run.
    """

    scene: str
    accuracy: float
    """The accuracy asked for, relative."""
    observable: str
    backend: str
    resolution: Mapping[str, Any]
    """Keywords of :func:`dem_bridge.solve`."""
    predicted_error: float
    """Expected error of the run, relative: measured where a run was made, otherwise by the model."""
    predicted_cost: float
    """Expected CPU time of the run without its uncertainty, s: measured or by the model, likewise."""
    found_error: float | None
    """Measured error of a run with these settings; None: no run was made."""
    found_cost: float | None
    """Measured CPU time, s; None: no run was made with these settings, or the twin's was."""
    model_error: float
    """Error by the model alone."""
    model_cost: float
    """CPU time by the model alone, s."""
    steps: int | None
    """Time steps; None: not known before the run."""
    force_evaluations: int | None
    units: Mapping[str, float]
    """The time step (s) as ``dt``, and as a fraction of the usual time scales of DEM; empty: no fixed step."""
    reasons: tuple[str, ...]
    """One sentence for each number."""

    def as_json(self) -> dict[str, Any]:
        """Return all fields as JSON values."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return values | {key: dict(values[key]) for key in ("resolution", "units")} | {"reasons": list(self.reasons)}

    def __str__(self) -> str:
        """Return at most 15 lines: settings, error, cost and reasons."""
        return plan_text(self)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return plan_html(self)


def answer(options: Options, chosen: Option, left_out: Mapping[str, str], measured_against: str) -> Plan:
    """Return the plan of an option, with its reasons.

    ``left_out``: for each other backend the reason why it was not chosen; ``measured_against``: what errors were
    measured against.
    """
    candidate, trial = chosen.candidate, chosen.trial
    resolution, units = dict(candidate.answer), {}
    steps, evaluations = (trial.cost.steps, trial.cost.force_evaluations) if trial else (None, None)
    if candidate.knob == "dt":
        plan = options.outlook.schedule(chosen.setting)
        coarser = options.interval / (plan.per_sample - 1) if plan.per_sample > 1 else 2.0 * options.interval
        resolution["dt"] = tidy(plan.step, coarser)
        units = {"dt": plan.step, **options.outlook.units(plan.step)}
        steps = plan.steps if steps is None else steps
    elif candidate.knob == "rtol":
        resolution |= candidate.settings_at(chosen.setting)
    if options.outlook.sampling.count != options.scene.samples:
        resolution["samples"] = options.outlook.sampling.count
    own_value = candidate.runs == candidate.name
    return Plan(
        scene=options.scene.name,
        accuracy=options.accuracy,
        observable=options.observable,
        backend=candidate.name,
        resolution=MappingProxyType(resolution),
        predicted_error=chosen.error,
        predicted_cost=chosen.cost,
        found_error=None if trial is None else trial.error,
        found_cost=chosen.cost if trial is not None and own_value else None,
        model_error=_modelled(options, chosen),
        model_cost=options.outlook.cost(candidate.name, chosen.setting),
        steps=steps,
        force_evaluations=evaluations,
        units=MappingProxyType(units),
        reasons=tuple(_reasons(options, chosen, left_out, measured_against)),
    )


def _reasons(options: Options, chosen: Option, left_out: Mapping[str, str], measured_against: str) -> Iterator[str]:
    outlook, candidate = options.outlook, chosen.candidate
    if candidate.knob == "dt":
        yield (
            f"the prescan gives a highest contact frequency of {outlook.prescan.frequency:.3g} rad/s and a phase of"
            f" {outlook.phase:.3g} rad, integrated over the stiffest contact of each moment over"
            f" {options.scene.duration:g} s"
        )
    if chosen.law is not None:
        first = outlook.setting(chosen.law, options.accuracy, options.observable)
        yield (
            f"the error model predicts {options.accuracy:g} at {candidate.knob} = {first:.2g}: it takes errors as"
            f" proportional to {candidate.knob}^{chosen.law.order:g}, and at least four of five random scenes err by at"
            f" most {chosen.law.spread:g} times the prediction"
        )
    if chosen.trial is not None:
        yield chosen.evidence
        if chosen.law is not None:
            yield f"errors are measured against {measured_against}"
    elif chosen.law is not None:
        yield f"no run checked the prediction: the settings are chosen for an error {chosen.law.spread:g} times smaller"
    else:
        yield f"no run checked the prediction: in 95 % of the random scenes {candidate.name} errs by no more"
    if candidate.runs != candidate.name:
        yield (
            f"{candidate.name} was not run: the positional twin gives the same numbers to 1e-10, round-off included;"
            " its cost is predicted from the numbers of bodies, steps and samples"
        )
    for reason in dict.fromkeys(left_out.values()):
        yield f"{', '.join(name for name, why in left_out.items() if why == reason)}: {reason}"


def evidence_of(candidate: Candidate, settled: Settled) -> str:
    """Describe the runs that were made and the order that they show."""
    runs = f"runs of {candidate.runs} err by {errors_by_setting(settled)}"
    if candidate.knob == "rtol":
        return f"{runs} (rtol)"
    order = observed_order(settled.trials)
    return f"{runs} (s)" + ("" if math.isnan(order) else f"; the fitted order is {order:.2f}")


def errors_by_setting(settled: Settled) -> str:
    """List the errors of the best and the next coarser settings, and the largest error of the finer ones."""
    assert settled.best is not None
    errors = {trial.setting: trial.error for trial in settled.trials}
    coarser = sorted(setting for setting in errors if setting >= settled.best.setting)[:LISTED]
    finer = [error for setting, error in errors.items() if setting < settled.best.setting]
    text = ", ".join(f"{errors[setting]:.2g} at {setting:.3g}" for setting in reversed(coarser))
    return f"{text} and at most {max(finer):.2g} at {len(finer)} finer settings" if finer else text


def _modelled(options: Options, chosen: Option) -> float:
    """Return the error by the model alone."""
    if chosen.law is None:
        return options.outlook.known_error(chosen.candidate.name, options.observable)
    return options.outlook.error(chosen.law, chosen.setting, options.observable)


def beyond(options: Options, budget: float, chosen: Option) -> str:
    """Return the message where a plan costs more than the budget, with the accuracy that the budget buys."""
    bought, by = math.inf, ""
    for option in [*(o for o in options.predicted if o.candidate.name != chosen.candidate.name), chosen]:
        name = option.candidate.name
        if option.law is None:
            error = option.error if option.cost <= budget else math.inf
        else:
            setting, law = option.setting, option.law
            scale = option.cost / options.outlook.cost(name, setting)
            low, high = setting, options.most(option.candidate)
            if scale * options.outlook.cost(name, high) > budget:
                continue
            for _ in range(60):
                middle = math.sqrt(low * high)
                too_costly = scale * options.outlook.cost(name, middle) > budget
                low, high = (middle, high) if too_costly else (low, middle)
            error = option.error * (high / setting) ** law.order
        if error < bought:
            bought, by = error, name
    rest = f"it buys an accuracy of about {bought:.1g} by {by}" if bought < 1.0 else "it buys no meaningful run"
    return (
        f"accuracy = {options.accuracy:g} of {options.observable} on {options.scene.name} costs"
        f" {chosen.cost:.2g} s of CPU by {chosen.candidate.name}, and the budget is {budget:g} s; {rest};"
        " ask for less, or give more"
    )
