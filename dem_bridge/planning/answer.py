"""What a planner answers: a Plan, with the reasons for each of its numbers; or what a budget buys instead."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

from dem_bridge.notebook import plan_html
from dem_bridge.planning.options import Option, Options
from dem_bridge.planning.predict import tidy


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

    def _repr_html_(self) -> str:
        return plan_html(self)


def answer(options: Options, chosen: Option, left_out: Mapping[str, str], yardstick: str) -> Plan:
    """The plan of an option, with its reasons.

    ``left_out``: why which backends are not it; ``yardstick``: what errors were measured against.
    """
    candidate, trial = chosen.candidate, chosen.trial
    resolution, units = dict(candidate.answer), {}
    steps, evaluations = (trial.steps, trial.evaluations) if trial else (None, None)
    if candidate.knob == "dt":
        plan = options.outlook.schedule(chosen.setting)
        coarser = options.interval / (plan.per_sample - 1) if plan.per_sample > 1 else 2.0 * options.interval
        resolution["dt"] = tidy(plan.step, coarser)
        units = {"dt": plan.step, **options.outlook.units(plan.step)}
        steps = plan.steps if steps is None else steps
    elif candidate.knob == "rtol":
        resolution["rtol"] = chosen.setting
    if options.outlook.sampling.count != options.scene.samples:
        resolution["samples"] = options.outlook.sampling.count
    own = candidate.runs == candidate.name
    return Plan(
        scene=options.scene.name,
        accuracy=options.accuracy,
        observable=options.observable,
        backend=candidate.name,
        resolution=MappingProxyType(resolution),
        predicted_error=chosen.error,
        predicted_cost=chosen.cost,
        found_error=None if trial is None else trial.error,
        found_cost=chosen.cost if trial is not None and own else None,
        model_error=_modelled(options, chosen),
        model_cost=options.outlook.cost(candidate.name, chosen.setting),
        steps=steps,
        force_evaluations=evaluations,
        units=MappingProxyType(units),
        reasons=tuple(_reasons(options, chosen, left_out, yardstick)),
    )


def _reasons(options: Options, chosen: Option, left_out: Mapping[str, str], yardstick: str) -> Iterator[str]:
    outlook, candidate = options.outlook, chosen.candidate
    if candidate.knob == "dt":
        yield (
            f"the coarse run found contacts of up to {outlook.prescan.frequency:.3g} rad/s, and a phase of"
            f" {outlook.phase:.3g} rad in the stiffest of each moment over {options.scene.duration:g} s"
        )
    if chosen.law is not None:
        first = outlook.setting(chosen.law, options.accuracy, options.observable)
        yield (
            f"the model has {options.accuracy:g} at {candidate.knob} = {first:.2g}: errors go with its power"
            f" {chosen.law.order:g}, and four in five random scenes or more err by"
            f" no more than {chosen.law.spread:g} times that"
        )
    if chosen.trial is not None:
        yield chosen.told
        if chosen.law is not None:
            yield f"errors are measured against {yardstick}"
    elif chosen.law is not None:
        yield f"nothing was run to check it, so the error is planned {chosen.law.spread:g} times smaller"
    else:
        yield f"nothing was run to check it: {candidate.name} errs by no more in 95 % of the random scenes tried"
    if candidate.runs != candidate.name:
        yield (
            f"{candidate.name} was not run: the twin in positions repeats it to 1e-10, round-off included, and its"
            " cost is that of bodies, steps and samples"
        )
    for reason in dict.fromkeys(left_out.values()):
        yield f"{', '.join(name for name, why in left_out.items() if why == reason)}: {reason}"


def _modelled(options: Options, chosen: Option) -> float:
    """Error by the model alone."""
    if chosen.law is None:
        return options.outlook.known_error(chosen.candidate.name, options.observable)
    return options.outlook.error(chosen.law, chosen.setting, options.observable)


def beyond(options: Options, budget: float, chosen: Option) -> str:
    """What to say where the plan costs more than the budget: the accuracy that this buys."""
    bought, by = math.inf, ""
    for one in [*(o for o in options.found if o.candidate.name != chosen.candidate.name), chosen]:
        if one.law is None:
            error = one.error if one.cost <= budget else math.inf
        else:
            known, law = one.setting, one.law
            scale = one.cost / options.outlook.cost(one.candidate.name, known)
            low, high = known, options.most(one.candidate)
            if scale * options.outlook.cost(one.candidate.name, high) > budget:
                continue
            for _ in range(60):
                middle = math.sqrt(low * high)
                dear = scale * options.outlook.cost(one.candidate.name, middle) > budget
                low, high = (middle, high) if dear else (low, middle)
            error = one.error * (high / known) ** law.order
        if error < bought:
            bought, by = error, one.candidate.name
    rest = f"it buys about {bought:.1g} by {by}" if bought < 1.0 else "it buys no run that says anything"
    return (
        f"accuracy = {options.accuracy:g} of {options.observable} on {options.scene.name} costs"
        f" {chosen.cost:.2g} s of CPU by {chosen.candidate.name}, and the budget is {budget:g} s; {rest};"
        " ask for less, or give more"
    )
