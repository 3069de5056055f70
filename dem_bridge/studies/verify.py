"""Verify scenes: can a LAMMPS simulation of them be trusted, and what does it differ by?

Each difference isolates one cause:

=========================  ==========================================================================
LAMMPS minus twin          same algorithm, same step: implementation and round-off
  ... twin in positions    the same round-off too: implementation alone
twin minus reference       same equations: the time step
LAMMPS minus reference     both, the error a user has
scipy minus reference      nothing: two methods that share no code, each within its bar
BCA minus reference        other equations: a model difference, never pass or fail
=========================  ==========================================================================
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.accuracy import ObservedOrder, checked_accuracy, observed_order
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.survey import survey
from dem_bridge.campaign import Case, Progress, Result, run_cases
from dem_bridge.compare import Difference, difference, first_divergence
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.observables.conserved import energy, energy_parts, momentum
from dem_bridge.observables.front import residence_by_crossing
from dem_bridge.plan import resolution_for
from dem_bridge.scene import Scene
from dem_bridge.studies.budget import Budget, budgets
from dem_bridge.trajectory import Trajectory, own_scale
from dem_bridge.verdict import Outcome, Verdict, exit_code, judge, numerical_verdict

#: wanted accuracy of velocities where none is named; the paper's chains reach it at dt = 1e-8 s
DEFAULT_ACCURACY = 5e-6
#: steps of the convergence ladder, in units of the main step
LADDER = (10.0, 5.0, 2.5, 1.25)
ENGINE, TWIN, REFERENCE, SECOND, THEORY = "lammps-granular", "verlet", "reference", "scipy", "bca"
#: what the order of velocity-Verlet may differ by from 2
ORDER_TOLERANCE = 0.05
#: the twin as a code that keeps absolute positions, with the gauge radius of the deck
POSITIONAL = "verlet in positions"


@dataclass(frozen=True, kw_only=True)
class SceneStudy:
    """All that was found for one scene."""

    scene: Scene
    results: tuple[Result, ...]
    verdicts: tuple[Verdict, ...]
    ladder: dict[str, tuple[list[float], list[float]]]
    """backend -> (steps in s, velocity errors relative to the reference's largest velocity)."""
    budgets: tuple[Budget, ...] = ()
    """Of LAMMPS' main run, one per quantity."""

    def run(self, backend: str) -> Trajectory | None:
        """The run of that backend at the main resolution."""
        return _main(self.results, backend).trajectory if self.results else None


@dataclass(frozen=True, kw_only=True)
class Verification:
    """Result of :func:`verify_scenes`."""

    studies: tuple[SceneStudy, ...]
    accuracy: float
    wall: float
    """s, for all of it."""

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        return tuple(verdict for study in self.studies for verdict in study.verdicts)

    @property
    def exit_code(self) -> int:
        return exit_code(verdict.outcome for verdict in self.verdicts)


def verify_scenes(
    scenes: Sequence[Scene], *, accuracy: float = DEFAULT_ACCURACY, jobs: int = 1, tell: Progress | None = None
) -> Verification:
    """Run and judge scenes; see :func:`dem_bridge.api.verify` for the arguments."""
    began = time.perf_counter()
    names = [scene.name for scene in scenes]
    if len(set(names)) < len(names):
        raise UsageError(f"two scenes have the same name among {', '.join(names)}; give each its own")
    if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
        raise UsageError(f"jobs = {jobs!r}; allowed: a whole number >= 1")
    checked_accuracy(accuracy)
    cases: list[Case] = []
    hopeless: dict[str, SceneStudy] = {}
    for scene in scenes:
        try:
            cases += cases_of(scene, accuracy)
        except (RunBroken, UnsupportedScene, UsageError) as error:  # this scene's, not the others'
            hopeless[scene.name] = _hopeless(scene, error)
    results = run_cases(cases, jobs=jobs, tell=tell)
    studies = tuple(
        hopeless.get(scene.name)
        or study_of(scene, tuple(r for r in results if r.case.scene.name == scene.name), accuracy)
        for scene in scenes
    )
    return Verification(studies=studies, accuracy=accuracy, wall=time.perf_counter() - began)


def _hopeless(scene: Scene, error: RunBroken | UnsupportedScene | UsageError) -> SceneStudy:
    """A scene for which not even the runs could be chosen."""
    outcomes = {RunBroken: Outcome.BROKEN, UnsupportedScene: Outcome.NOT_RUN, UsageError: Outcome.UNDECIDED}
    verdict = Verdict(
        scene=scene.name,
        quantity="velocity",
        backend=ENGINE,
        reference=REFERENCE,
        outcome=outcomes[type(error)],
        sentence=f"{error}.",
    )
    return SceneStudy(scene=scene, results=(), verdicts=(verdict,), ladder={})


def cases_of(scene: Scene, accuracy: float) -> list[Case]:
    """The runs that a verdict on one scene needs; the main run of each backend first."""
    sampling = Sampling(count=scene.samples)
    main = resolution_for(scene, accuracy, Resolution(), sampling)
    assert main.dt is not None
    coarse = [replace(main, dt=factor * main.dt, bars=False) for factor in LADDER]
    runs = [(name, Resolution()) for name in (REFERENCE, SECOND, THEORY)]
    runs += [(name, settings) for name in (TWIN, ENGINE) for settings in (main, *coarse)]
    runs.append((TWIN, replace(main, gauge_radius=survey(scene).gauge_radius, bars=False)))
    return [Case(scene=scene, backend=name, resolution=settings, sampling=sampling) for name, settings in runs]


def study_of(scene: Scene, results: tuple[Result, ...], accuracy: float) -> SceneStudy:
    """Judge the results of one scene; nothing is run here."""
    truth = _main(results, REFERENCE).trajectory
    verdicts: list[Verdict] = []
    ladder: dict[str, tuple[list[float], list[float]]] = {}
    budget: tuple[Budget, ...] = ()
    for name in (REFERENCE, SECOND, TWIN, ENGINE, THEORY):
        failed = _main(results, name)
        if failed.failure is not None:
            verdicts.append(_absent(scene, name, failed))
    engine, twin, theory = (_main(results, name).trajectory for name in (ENGINE, TWIN, THEORY))
    if engine is not None and twin is not None:
        verdicts.append(_implementation(scene, engine, twin))
        positional = next((r.trajectory for r in results if _in_positions(r)), None)
        if positional is not None and truth is not None:
            budget = budgets(engine, twin, positional, truth)
            verdicts += [_explained(scene, one, engine, positional) for one in budget]
    if truth is not None:
        second = _main(results, SECOND).trajectory
        if second is not None:
            verdicts.append(_two_methods(scene, second, truth))
        for name in (TWIN, ENGINE):
            run = _main(results, name).trajectory
            if run is None:
                continue
            verdicts += _accuracy(scene, name, run, truth, accuracy)
            ladder[name] = _ladder(results, name, truth)
            verdicts.append(_order(scene, name, ladder[name], truth))
        if theory is not None:
            verdicts += _model(scene, theory, truth)
    if engine is not None:
        verdicts += _conserved(scene, engine, accuracy)
    return SceneStudy(scene=scene, results=results, verdicts=tuple(verdicts), ladder=ladder, budgets=budget)


def _main(results: tuple[Result, ...], backend: str) -> Result:
    return next(r for r in results if r.case.backend == backend)


def _in_positions(result: Result) -> bool:
    return result.case.backend == TWIN and result.case.resolution.gauge_radius is not None


def _absent(scene: Scene, name: str, result: Result) -> Verdict:
    outcome = Outcome.BROKEN if isinstance(result.failure, RunBroken) else Outcome.NOT_RUN
    return Verdict(
        scene=scene.name,
        quantity="velocity",
        backend=name,
        reference=REFERENCE if name != REFERENCE else "",
        outcome=outcome,
        sentence=f"{name} on {scene.name}: {result.failure}.",
    )


def _implementation(scene: Scene, engine: Trajectory, twin: Trajectory) -> Verdict:
    """LAMMPS against the twin: no more than the round-off that twins predict for a code that keeps positions."""
    expected = engine.provenance["velocity_bar"]
    tolerance = float(expected["round_off"])
    # the same algorithm at the same step: the bars of the time step are common to both and drop out
    found = replace(
        difference("velocity", engine, twin), uncertainty=tolerance, reference_uncertainty=float(expected["last_digit"])
    )
    return numerical_verdict(
        found,
        scene=scene.name,
        backend=ENGINE,
        reference=TWIN,
        tolerance=tolerance,
        meaning="implementation and round-off",
        first_divergence=first_divergence(engine, twin, tolerance),
    )


def _explained(scene: Scene, budget: Budget, engine: Trajectory, positional: Trajectory) -> Verdict:
    """What the budget of a quantity leaves unexplained: the twin in positions shares step and round-off."""
    digit = float(engine.provenance["velocity_bar"]["last_digit"])
    found = replace(
        difference(budget.quantity, engine, positional), uncertainty=budget.allowed, reference_uncertainty=digit
    )
    return numerical_verdict(
        found,
        scene=scene.name,
        backend=ENGINE,
        reference=POSITIONAL,
        tolerance=budget.allowed,
        meaning="implementation",
        first_divergence=first_divergence(engine, positional, budget.allowed)
        if budget.quantity == "velocity"
        else None,
    )


def _two_methods(scene: Scene, second: Trajectory, truth: Trajectory) -> Verdict:
    """The two references against each other: both must be right within the bars they claim."""
    found = difference("velocity", second, truth)
    allowed = found.uncertainty + found.reference_uncertainty
    answered_by = truth.provenance.get("answered_by")
    if answered_by == SECOND:
        outcome, sentence = (
            Outcome.NOT_RUN,
            f"{REFERENCE} on {scene.name} was answered by {SECOND}: nothing to compare.",
        )
    else:
        # each bar is on one side of the comparison already: no doubt is left
        outcome = judge(found.value, 0.0, allowed)
        sentence = (
            f"velocity of {SECOND} differs from {REFERENCE} by {found.value:.2e} of {found.scale_name};"
            f" their bars together are {allowed:.1e}."
        )
    return Verdict(
        scene=scene.name,
        quantity="velocity",
        backend=SECOND,
        reference=REFERENCE,
        outcome=outcome,
        sentence=sentence,
        difference=found.value,
        scale=found.scale,
        unit=found.unit,
        scale_name=found.scale_name,
        uncertainty=found.uncertainty,
        reference_uncertainty=found.reference_uncertainty,
        tolerance=allowed,
        meaning="nothing: two methods",
    )


def _accuracy(scene: Scene, name: str, run: Trajectory, truth: Trajectory, accuracy: float) -> list[Verdict]:
    """A run against the reference: velocity for the twin, every quantity for LAMMPS."""
    meaning = {TWIN: "time step", ENGINE: "time step, implementation and round-off"}[name]
    quantities = ("velocity",) if name == TWIN else ("velocity", "displacement", "peak_force", "crossing_time")
    found = [difference(quantity, run, truth) for quantity in quantities]
    if name == ENGINE and scene.n_body > 2:
        found.append(_residence(scene, run, truth))
    return [
        numerical_verdict(
            one,
            scene=scene.name,
            backend=name,
            reference=REFERENCE,
            # the accuracy was asked of velocities; the others may err by what twins predict for this step
            tolerance=accuracy if one.quantity == "velocity" else max(accuracy, one.uncertainty),
            meaning=meaning,
            first_divergence=first_divergence(run, truth, accuracy) if one.quantity == "velocity" else None,
        )
        for one in found
    ]


def _residence(scene: Scene, run: Trajectory, truth: Trajectory) -> Difference:
    """Relative difference of residence times; a bar is the sum of those of its two crossings."""
    mine, other = residence_by_crossing(scene, run), residence_by_crossing(scene, truth)
    own = np.maximum(own_scale(other), 1e-300)
    relative = np.abs(mine - other) / own
    relative = np.where(np.isnan(mine) & np.isnan(other), 0.0, np.where(np.isnan(relative), np.inf, relative))
    worst = int(np.argmax(relative))

    def bar(trajectory: Trajectory) -> float:
        crossing = trajectory.uncertainty["crossing_time"][: scene.n_body - 1]
        return float(np.nanmax((crossing[1:] + crossing[:-1]) / own, initial=0.0))

    return Difference(
        quantity="residence_time",
        value=float(relative[worst]),
        scale=float(own[worst]),
        unit="s",
        scale_name="each body's own residence time",
        uncertainty=bar(run),
        reference_uncertainty=bar(truth),
        body=worst + 1,
        time=math.nan,
    )


def _ladder(results: tuple[Result, ...], name: str, truth: Trajectory) -> tuple[list[float], list[float]]:
    mine = [r for r in results if r.case.backend == name and not _in_positions(r)]
    runs = [r.trajectory for r in mine if r.trajectory is not None]
    steps = [float(run.provenance["settings"]["dt"]) for run in runs]
    errors = [difference("velocity", run, truth).value for run in runs]
    order = np.argsort(steps)[::-1]
    return [steps[i] for i in order], [errors[i] for i in order]


def _order(scene: Scene, name: str, ladder: tuple[list[float], list[float]], truth: Trajectory) -> Verdict:
    """Order of convergence over the ladder, without the main run; its bar is the residual over the ladder's length."""
    steps, errors = ladder[0][:-1], ladder[1][:-1]
    floor = 10.0 * truth.uncertainty["velocity"] / max(float(np.max(np.abs(truth.velocity))), 1e-300)
    fit: ObservedOrder = observed_order(steps, errors, floor=floor)
    bar, why = math.inf, ""
    if fit.points < 3:
        why = f"{fit.points} of {len(steps)} errors are above round-off, and 3 are needed for a fit"
    elif len(set(steps)) < 3:
        why = f"with one sample in {scene.duration / scene.samples:.3g} s the steps of the ladder fall together"
    else:
        bar = 2.0 * math.log1p(fit.residual) / math.log(steps[0] / steps[-1])
    if not bar < ORDER_TOLERANCE:
        why = why or f"errors scatter by {100 * fit.residual:.0f} % about a power of dt: no asymptotic range here"
        return Verdict(
            scene=scene.name,
            quantity="order",
            backend=name,
            reference="exact 2",
            outcome=Outcome.NOT_RUN,
            sentence=f"order of {name} on {scene.name}: {why}.",
            meaning="convergence in the time step",
        )
    away = abs(fit.order - 2.0)
    outcome = judge(away, bar, ORDER_TOLERANCE)
    return Verdict(
        scene=scene.name,
        quantity="order",
        backend=name,
        reference="exact 2",
        outcome=outcome,
        sentence=(
            f"velocity errors of {name} fall as dt^{fit.order:.3f} over dt = {steps[0]:.3g} .. {steps[-1]:.3g} s"
            f" ({fit.points} points, residual {100 * fit.residual:.1f} %); velocity-Verlet has 2 +- {ORDER_TOLERANCE}."
        ),
        difference=away,
        scale=1.0,
        scale_name="1",
        reference_uncertainty=bar,
        tolerance=ORDER_TOLERANCE,
        meaning="convergence in the time step",
    )


def _conserved(scene: Scene, run: Trajectory, accuracy: float) -> list[Verdict]:
    """Momentum to round-off, energy to the accuracy asked for; each where nothing takes or gives any.

    The loads on the ends of a precompressed chain without walls cancel; with one wall there is one load alone.
    """
    found: list[tuple[str, np.ndarray[Any, np.dtype[np.float64]], float, str, float, str]] = []
    speed = float(np.max(np.abs(run.velocity)))
    if scene.wall_left is None and scene.wall_right is None and scene.gravity == scene.drag == 0.0:
        scale = sum(scene.mass) * speed
        # each step rounds each velocity by at most half a unit in its last place
        found.append(
            ("momentum", momentum(scene, run), scale, "kg m/s", run.cost.steps * np.finfo(float).eps, "round-off")
        )
    if not scene.dissipates:
        parts = energy_parts(scene, run)
        most = float(np.max(sum(np.abs(part) for part in parts)))
        found.append(("energy", energy(scene, run), most, "J", accuracy, "time step"))
    verdicts = []
    for quantity, series, scale, unit, tolerance, meaning in found:
        drift = float(np.max(np.abs(series - series[0]))) / scale if scale > 0.0 else 0.0
        outcome = judge(drift, 0.0, tolerance)
        verdicts.append(
            Verdict(
                scene=scene.name,
                quantity=quantity,
                backend=ENGINE,
                reference="its own start",
                outcome=outcome,
                sentence=(
                    f"{quantity} of {ENGINE} drifts by at most {drift:.2e} of {scale:.4g} {unit};"
                    f" tolerance {tolerance:.1e} ({meaning})."
                ),
                difference=drift,
                scale=scale,
                unit=unit,
                scale_name="most energy in motion, contacts and height"
                if quantity == "energy"
                else "total mass times largest velocity",
                uncertainty=0.0,
                reference_uncertainty=0.0,
                tolerance=tolerance,
                meaning=meaning,
            )
        )
    return verdicts


def _model(scene: Scene, theory: Trajectory, truth: Trajectory) -> list[Verdict]:
    """BCA beside the reference: numbers of a theory with other equations."""
    arrival, *found = [difference(quantity, theory, truth) for quantity in ("crossing_time", "peak_force", "velocity")]
    last = len(truth.crossing_time) - 1
    away = abs(float(theory.crossing_time[last] - truth.crossing_time[last])) / float(truth.crossing_time[last])
    if math.isfinite(away):
        found.insert(0, replace(arrival, quantity="arrival_at_end", value=away, body=last))
    found.insert(0, replace(arrival, quantity="arrival"))
    if scene.n_body > 2:
        found.insert(1, _residence(scene, theory, truth))
    return [
        Verdict(
            scene=scene.name,
            quantity=one.quantity,
            backend=THEORY,
            reference=REFERENCE,
            outcome=Outcome.MODEL_DIFFERENCE,
            sentence=(
                f"binary collisions miss the {one.quantity.replace('_', ' ')} by up to {100 * one.value:.3g} % of"
                f" {one.scale_name} ({'body' if math.isfinite(one.time) else 'contact'} {one.body}): they are another"
                " model, so this is no error of either code."
            ),
            difference=one.value,
            scale=one.scale,
            unit=one.unit,
            scale_name=one.scale_name,
            reference_uncertainty=one.reference_uncertainty,
            meaning="model",
        )
        for one in found
    ]
