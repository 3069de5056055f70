"""The checks that a verification consists of, each a pure function from trajectories to verdicts.

===================  ===========================================================================
implementation       LAMMPS against the twin: the round-off that twins predict, and nothing more
table                forces and energies that LAMMPS takes from tables against the laws: no more than was predicted
explained            LAMMPS against the twin in positions: what its error budget leaves over
two_methods          the two references against each other
accuracy             a run against the reference
order                errors along the ladder of steps
conserved            momentum and energy, where nothing takes or gives any but a drive
model                binary collisions against the reference: a number, never pass or fail
===================  ===========================================================================
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dem_bridge.accuracy import ObservedOrder, observed_order
from dem_bridge.backends.steps import order_on
from dem_bridge.campaign import Result
from dem_bridge.differences import Difference, difference, first_divergence
from dem_bridge.errors import RunBroken
from dem_bridge.observables.conserved import work
from dem_bridge.observables.errors import read
from dem_bridge.observables.registry import observable_named
from dem_bridge.scene import Scene
from dem_bridge.trajectory import QUANTITIES, Trajectory
from dem_bridge.verification.roles import POSITIONAL, REFERENCE, SCIPY, THEORY, TWIN, engine_for
from dem_bridge.verification.verdict import Outcome, Verdict, judge, numerical_verdict

Floats = NDArray[np.float64]

#: what the order of velocity-Verlet may differ by from 2, and from 1 where forces depend on velocities
ORDER_TOLERANCE = {2: 0.05, 1: 0.1}
#: what the second reference shows beside the first
INDEPENDENT = "nothing: two methods"
#: error of scipy where it was not asked for its bars: what they are at most on the shipped scenes, of the largest speed
SECOND_BAR = 2e-10
#: observables in which binary collisions are set beside the reference
MODELLED = ("arrival", "residence_time", "arrival_at_end", "peak_force", "velocity")
#: measured errors of tables may exceed predicted ones so much: both look at places, and each misses the worst
TABLE_TOLERANCE = 1.1


def absent(scene: Scene, name: str, result: Result) -> Verdict:
    outcome = Outcome.BROKEN if isinstance(result.failure, RunBroken) else Outcome.NOT_RUN
    return Verdict(
        scene=scene.name,
        quantity="velocity",
        backend=name,
        reference=REFERENCE if name != REFERENCE else "",
        outcome=outcome,
        sentence=f"{name} on {scene.name}: {result.failure}.",
    )


def implementation(scene: Scene, engine: Trajectory, twin: Trajectory) -> Verdict:
    """LAMMPS against the twin: no more than the round-off that twins predict for a code that keeps positions."""
    expected = engine.uncertainty.parts
    tolerance = expected["round_off"]
    # the same algorithm at the same step: the bars of the time step are common to both and drop out
    found = replace(
        difference("velocity", engine, twin), uncertainty=tolerance, reference_uncertainty=expected["last_digit"]
    )
    return numerical_verdict(
        found,
        scene=scene.name,
        backend=engine_for(scene),
        reference=TWIN,
        tolerance=tolerance,
        meaning="implementation and round-off",
        first_divergence=first_divergence(engine, twin, tolerance),
    )


def table(scene: Scene, engine: Trajectory) -> list[Verdict]:
    """Forces and energies of a run beside the laws that its tables stand for; its own bars are what was predicted."""
    told, name = engine.provenance["table"], engine_for(scene)
    found = [("table", "forces", "each contact's largest force", "error", TABLE_TOLERANCE)]
    if "measured_energy_error" in told:  # a contact was closed when LAMMPS printed its energies
        found.append(("table_energy", "potential energies", "the largest energy in contacts", "energy_error", 1.0))
    verdicts = []
    for quantity, what, scale, key, factor in found:
        measured, predicted = told[f"measured_{key}"], told[f"predicted_{key}"]
        tolerance = factor * predicted + told["round_off"]
        verdicts.append(
            Verdict(
                scene=scene.name,
                quantity=quantity,
                backend=name,
                reference="contact laws",
                outcome=judge(measured, 0.0, tolerance),
                sentence=(
                    f"{what} that {name} takes from tables differ from the contact laws by {measured:.2e} of {scale};"
                    f" {predicted:.2e} was predicted, and the tolerance is {tolerance:.1e}."
                ),
                difference=measured,
                scale=1.0,
                scale_name=scale,
                uncertainty=predicted,
                reference_uncertainty=0.0,
                tolerance=tolerance,
                meaning="interpolation",
            )
        )
    return verdicts


def explained(scene: Scene, quantity: str, engine: Trajectory, positional: Trajectory, *, allowed: float) -> Verdict:
    """What a budget leaves unexplained: the twin in positions shares the step and the round-off."""
    digit = engine.uncertainty.parts["last_digit"]
    found = replace(difference(quantity, engine, positional), uncertainty=allowed, reference_uncertainty=digit)
    return numerical_verdict(
        found,
        scene=scene.name,
        backend=engine_for(scene),
        reference=POSITIONAL,
        tolerance=allowed,
        meaning="implementation",
        first_divergence=first_divergence(engine, positional, allowed) if quantity == "velocity" else None,
    )


def two_methods(scene: Scene, second: Trajectory | None, reference: Trajectory) -> Verdict:
    """Return the verdict on two references: each must be right within the uncertainty that it states.

    ``second`` is None where only one backend solves the scene to the accuracy of a reference: NOT_RUN.
    """
    found = difference("velocity", second or reference, reference)
    if not math.isfinite(found.uncertainty):
        found = replace(found, uncertainty=SECOND_BAR)
    allowed = found.uncertainty + found.reference_uncertainty
    if second is None:
        name, outcome = SCIPY, Outcome.NOT_RUN
        sentence = f"{REFERENCE} on {scene.name} was answered by {SCIPY}: nothing to compare."
    else:
        # both uncertainties are in the tolerance already: no doubt is left
        name, outcome = second.provenance["backend"], judge(found.value, 0.0, allowed)
        sentence = (
            f"velocity of {name} differs from {REFERENCE} by {found.value:.2e} of {found.scale_name};"
            f" their bars together are {allowed:.1e}."
        )
    return Verdict(
        scene=scene.name,
        quantity="velocity",
        backend=name,
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
        meaning=INDEPENDENT,
    )


def accuracy(scene: Scene, name: str, run: Trajectory, truth: Trajectory, wanted: float) -> list[Verdict]:
    """A run against the reference: velocity for the twin, every quantity for LAMMPS."""
    parts = ["time step", *(["table"] if "table" in run.provenance else []), "implementation and round-off"]
    meaning = "time step" if name == TWIN else ", ".join(parts)
    quantities: tuple[str, ...] = ("velocity",)
    if name != TWIN:
        quantities = (*QUANTITIES, "residence_time") if scene.n_body > 2 else QUANTITIES
    found = [difference(quantity, run, truth, scene) for quantity in quantities]
    verdicts = [
        numerical_verdict(
            one,
            scene=scene.name,
            backend=name,
            reference=REFERENCE,
            # the accuracy was asked of velocities; the others may err by what twins predict for this step
            tolerance=wanted if one.quantity == "velocity" else max(wanted, one.uncertainty),
            meaning=meaning,
            first_divergence=first_divergence(run, truth, wanted) if one.quantity == "velocity" else None,
        )
        for one in found
    ]
    why = _pull(name, run)
    return [one if one.outcome is Outcome.PASS else replace(one, sentence=one.sentence + why) for one in verdicts]


def _pull(name: str, run: Trajectory) -> str:
    """What a run with tables has that its equations have not; '' where that is nothing."""
    pull = float(run.provenance.get("table", {}).get("pull", 0.0))
    if pull == 0.0:
        return ""
    return (
        f" {name} has contacts that pull, with up to {pull:.3g} N: their damping stands beside a table, and LAMMPS"
        " cannot clip the sum of two pair styles, as the equations do; with n = 2 or 2.5 in damped contacts it can."
    )


def order(scene: Scene, name: str, refinement: tuple[list[float], list[float]], truth: Trajectory) -> Verdict:
    """Order of convergence over the ladder, without the main run; its bar is the residual over the ladder's length.

    Of first order, it is the residual over one rung: a dashpot's contact closes anywhere within a step, and errors of
    first and of second order may have different signs, so the order between two neighbours need not be that of all.
    """
    expected = order_on(scene)
    allowed = ORDER_TOLERANCE[expected]
    steps, errors = refinement[0][:-1], refinement[1][:-1]
    floor = 10.0 * truth.uncertainty["velocity"] / max(float(np.max(np.abs(truth.velocity))), 1e-300)
    fit: ObservedOrder = observed_order(steps, errors, floor=floor)
    away, bar, why, outcome = abs(fit.order - expected), math.inf, "", Outcome.NOT_RUN
    if fit.points < 3:
        why = f"{fit.points} of {len(steps)} errors are above round-off, and 3 are needed for a fit"
    elif len(set(steps)) < 3:
        why = f"with one sample in {scene.duration / scene.samples:.3g} s the steps of the ladder fall together"
    else:
        bar = 2.0 * math.log1p(fit.residual) / math.log(steps[0] / steps[-1])
        if expected == 1:
            bar *= fit.points - 1
        outcome = judge(away, bar, allowed)
        if not bar < allowed or (expected == 1 and outcome is Outcome.UNDECIDED):
            why = f"errors scatter by {100 * fit.residual:.0f} % about a power of dt: no asymptotic range here"
        elif expected == 1 and fit.order > 1.0 and outcome is Outcome.FAIL:
            why = (
                f"velocity errors fall as dt^{fit.order:.3f}: little is damped, and the part of second order, which all"
                " scenes have, is not yet small beside that of first order"
            )
    if why:
        return Verdict(
            scene=scene.name,
            quantity="order",
            backend=name,
            reference=f"exact {expected}",
            outcome=Outcome.NOT_RUN,
            sentence=f"order of {name} on {scene.name}: {why}.",
            meaning="convergence in the time step",
        )
    reason = (
        f"velocity-Verlet has 2 +- {allowed}"
        if expected == 2
        else f"forces that depend on velocities are evaluated with those of the half step, which leaves 1 +- {allowed}"
    )
    return Verdict(
        scene=scene.name,
        quantity="order",
        backend=name,
        reference=f"exact {expected}",
        outcome=outcome,
        sentence=(
            f"velocity errors of {name} fall as dt^{fit.order:.3f} over dt = {steps[0]:.3g} .. {steps[-1]:.3g} s"
            f" ({fit.points} points, residual {100 * fit.residual:.1f} %); {reason}."
        ),
        difference=away,
        scale=1.0,
        scale_name="1",
        reference_uncertainty=bar,
        tolerance=allowed,
        meaning="convergence in the time step",
    )


def conserved(scene: Scene, run: Trajectory, wanted: float, truth: Trajectory | None = None) -> list[Verdict]:
    """Judge the drift of momentum, to round-off, and of energy, to the wanted accuracy.

    Each is judged where the scene conserves it. Where a drive gives energy, the energy less its work is, unless samples
    are too far apart to tell that work; ``truth`` is the run by which this is decided (None: the run itself).

    The loads on the ends of a precompressed chain without walls cancel; with one wall there is one load alone.
    """
    verdicts = []
    if scene.conserves_momentum:
        # each step rounds each velocity by at most half a unit in its last place
        digits = run.cost.steps * float(np.finfo(float).eps)
        verdicts.append(_drift(scene, run, "momentum", digits, "round-off"))
    if scene.conserves_energy:
        verdicts.append(_drift(scene, run, "energy", wanted, "time step"))
    elif not scene.dissipates:
        unknown = work(scene, run if truth is None else truth)[1]
        verdict = _drift(scene, run, "energy_less_work", wanted, "time step", unknown)
        if unknown < wanted * verdict.scale or verdict.scale == 0.0:
            verdicts.append(verdict)
    return verdicts


def _drift(scene: Scene, run: Trajectory, name: str, tolerance: float, meaning: str, unknown: float = 0.0) -> Verdict:
    """Return the verdict on the largest change of an observable from its start, which may err by ``unknown``."""
    reading, backend = read(name, scene, run), engine_for(scene)
    observable, scale = reading.observable, float(reading.scale[0])
    drift, bar = (
        part / scale if scale > 0.0 else 0.0 for part in (np.max(np.abs(reading.values - reading.values[0])), unknown)
    )
    return Verdict(
        scene=scene.name,
        quantity=observable.words,
        backend=backend,
        reference="its own start",
        outcome=judge(float(drift), bar, tolerance),
        sentence=(
            f"{observable.words} of {backend} drifts by at most {drift:.2e} of {scale:.4g} {observable.unit};"
            f" tolerance {tolerance:.1e} ({meaning})."
        ),
        difference=float(drift),
        scale=scale,
        unit=observable.unit,
        scale_name=observable.scale_name,
        uncertainty=0.0,
        reference_uncertainty=bar,
        tolerance=tolerance,
        meaning=meaning,
    )


def model(scene: Scene, theory: Trajectory, truth: Trajectory) -> list[Verdict]:
    """Return the differences of binary collisions from the reference: numbers of a theory with other equations."""
    found = [difference(quantity, theory, truth, scene) for quantity in MODELLED]
    if scene.n_body <= 2:
        found = [one for one in found if one.quantity != "residence_time"]
    # only one of the two reaches the end
    found = [one for one in found if one.quantity != "arrival_at_end" or math.isfinite(one.value)]
    return [
        Verdict(
            scene=scene.name,
            quantity=one.quantity,
            backend=THEORY,
            reference=REFERENCE,
            outcome=Outcome.MODEL_DIFFERENCE,
            sentence=_of_theory(one),
            difference=one.value,
            scale=one.scale,
            unit=one.unit,
            scale_name=one.scale_name,
            reference_uncertainty=one.reference_uncertainty,
            meaning="model",
        )
        for one in found
    ]


def _of_theory(found: Difference) -> str:
    what, place = observable_named(found.quantity).words, found.place
    at = f" ({place})" if place else ""
    missed = f"binary collisions miss the {what} by up to {100 * found.value:.3g} % of {found.scale_name}{at}"
    if not math.isfinite(found.value):
        missed = f"binary collisions and the reference do not both have the {what} of {place} within the duration"
    return f"{missed}: they are another model, so this is no error of either code."
