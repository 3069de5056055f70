"""The checks that a verification consists of, each a pure function from trajectories to verdicts.

===================  ===========================================================================
implementation       LAMMPS - twin: at most the round-off that the twins predict
table                forces and energies from LAMMPS' tables - contact laws: at most the predicted interpolation error
explained            LAMMPS - positional twin: the part of the error that the budget leaves unexplained
two_methods          second reference - reference: at most the sum of their uncertainties
accuracy             a run - reference: at most the accuracy
order                order of convergence over the refinement levels
conserved            drift of momentum and energy, where the scene conserves them
model                binary collisions - reference: a model difference, never PASS or FAIL
===================  ===========================================================================
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dem_bridge.backends.steps import order_on
from dem_bridge.errors import RunBroken
from dem_bridge.observables.conserved import work
from dem_bridge.observables.convergence import ObservedOrder, observed_order
from dem_bridge.observables.differences import Difference, first_divergence
from dem_bridge.observables.registry import OBSERVABLES, observable_named
from dem_bridge.observables.verdict import Outcome, Verdict, judge, judge_relative, numerical_verdict
from dem_bridge.runs.campaign import Result
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY, SCIPY_UNCERTAINTY
from dem_bridge.verification.roles import POSITIONAL, THEORY, TWIN, Roles
from dem_bridge.verification.tolerances import (
    ORDER_TOLERANCE,
    accuracy_tolerance,
    momentum_tolerance,
    references_tolerance,
    table_tolerance,
)

#: meaning of the difference between the two references
INDEPENDENT = "independent check (two unrelated integrators)"
#: observables in which binary collisions are compared with the reference
MODELLED = ("arrival", "residence_time", "arrival_at_end", "peak_force", "velocity")


def absent(roles: Roles, name: str, result: Result) -> Verdict:
    """Return the verdict on a run that was not made or that failed."""
    outcome = Outcome.BROKEN if isinstance(result.failure, RunBroken) else Outcome.NOT_RUN
    return Verdict(
        scene=roles.scene.name,
        quantity="velocity",
        backend=name,
        reference=REFERENCE if name != REFERENCE else "",
        outcome=outcome,
        sentence=f"{name} on {roles.scene.name}: {result.failure}.",
    )


def implementation(roles: Roles, engine: Trajectory, twin: Trajectory) -> Verdict:
    """Judge LAMMPS against the twin: only the round-off of absolute positions, predicted by twins, may differ."""
    # the time-step error is the same in both and cancels
    allowed = engine.uncertainty.parts["round_off"]
    return _against_twin(
        roles, "velocity", engine, twin, allowed, reference=TWIN, meaning="implementation and round-off"
    )


def table(roles: Roles, engine: Trajectory) -> list[Verdict]:
    """Judge forces and energies that LAMMPS takes from tables against the contact laws and the predicted errors."""
    errors, name = engine.provenance["table"], roles.engine
    checked = [("table", "forces", "each contact's largest force", "error")]
    if "measured_energy_error" in errors:  # a contact was closed when LAMMPS printed its energies
        checked.append(("table_energy", "potential energies", "the largest energy in contacts", "energy_error"))
    verdicts = []
    for quantity, what, scale, key in checked:
        measured, predicted = errors[f"measured_{key}"], errors[f"predicted_{key}"]
        tolerance = table_tolerance(errors, key)
        verdicts.append(
            Verdict(
                scene=roles.scene.name,
                quantity=quantity,
                backend=name,
                reference="contact laws",
                outcome=judge_relative(measured, 0.0, tolerance),
                sentence=(
                    f"{what} that {name} takes from tables differ from the contact laws by {measured:.2e} of {scale};"
                    f" the predicted error is {predicted:.2e} and the tolerance {tolerance:.1e}."
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


def explained(roles: Roles, quantity: str, engine: Trajectory, positional: Trajectory, *, allowed: float) -> Verdict:
    """Judge the part of an error that its budget leaves unexplained: LAMMPS minus the positional twin."""
    return _against_twin(roles, quantity, engine, positional, allowed, reference=POSITIONAL, meaning="implementation")


def _against_twin(
    roles: Roles, quantity: str, engine: Trajectory, twin: Trajectory, allowed: float, *, reference: str, meaning: str
) -> Verdict:
    """Judge LAMMPS against a twin, from which it may differ by ``allowed``, relative."""
    digit = engine.uncertainty.parts["last_digit"]
    return numerical_verdict(
        replace(roles.readings.difference(quantity, engine, twin), uncertainty=allowed, reference_uncertainty=digit),
        scene=roles.scene.name,
        backend=roles.engine,
        reference=reference,
        tolerance=allowed,
        meaning=meaning,
        first_divergence=first_divergence(engine, twin, allowed) if quantity == "velocity" else None,
    )


def two_methods(roles: Roles, second: Trajectory | None, reference: Trajectory, *, estimated: bool = True) -> Verdict:
    """Judge two references against each other: each must be right within the uncertainty that it states.

    ``second`` is None where only one backend solves the scene to the accuracy of a reference: NOT_RUN. ``estimated`` is
    False for a second reference that is scipy's run without its uncertainty, which is then :data:`SCIPY_UNCERTAINTY`.
    """
    compared = roles.readings.difference("velocity", second or reference, reference)
    if not estimated:
        compared = replace(compared, uncertainty=SCIPY_UNCERTAINTY)
    allowed = references_tolerance(compared)
    if second is None:
        name, outcome = SCIPY, Outcome.NOT_RUN
        sentence = f"{REFERENCE} on {roles.scene.name} was answered by {SCIPY}: no second solution to compare with."
    else:
        # both uncertainties are part of the tolerance already
        name, outcome = second.provenance["backend"], judge_relative(compared.value, 0.0, allowed)
        sentence = (
            f"velocity of {name} differs from {REFERENCE} by {compared.value:.2e} of {compared.scale_name};"
            f" the sum of their uncertainties is {allowed:.1e}."
        )
    return Verdict.of(
        compared,
        scene=roles.scene.name,
        backend=name,
        reference=REFERENCE,
        outcome=outcome,
        sentence=sentence,
        tolerance=allowed,
        meaning=INDEPENDENT,
    )


def accuracy(roles: Roles, name: str, run: Trajectory, reference: Trajectory, tolerance: float) -> list[Verdict]:
    """Judge a run against the reference: the velocity of the twin, every observable of LAMMPS.

    An observable that follows from another one is not judged.
    """
    parts = ["time step", *(["table"] if "table" in run.provenance else []), "implementation and round-off"]
    meaning = "time step" if name == TWIN else ", ".join(parts)
    without = {*QUANTITIES, *(["residence_time"] if roles.scene.n_body <= 2 else [])}
    others = [item.name for item in OBSERVABLES.values() if not item.follows and item.name not in without]
    quantities = ("velocity",) if name == TWIN else (*QUANTITIES, *others)
    verdicts = []
    for compared in (roles.readings.difference(quantity, run, reference) for quantity in quantities):
        of_velocity = compared.quantity == "velocity"
        verdict = numerical_verdict(
            compared,
            scene=roles.scene.name,
            backend=name,
            reference=REFERENCE,
            tolerance=accuracy_tolerance(compared, tolerance),
            meaning=meaning,
            first_divergence=first_divergence(run, reference, tolerance) if of_velocity else None,
        )
        if verdict.outcome is not Outcome.PASS:
            verdict = replace(verdict, sentence=verdict.sentence + _pull(name, run))
        verdicts.append(verdict)
    return verdicts


def _pull(name: str, run: Trajectory) -> str:
    """Describe the tension in damped contacts of a run with tables; empty where there is none."""
    pull = float(run.provenance.get("table", {}).get("pull", 0.0))
    if pull == 0.0:
        return ""
    return (
        f" In {name} damped contacts are tensile, by up to {pull:.3g} N: their damping is added to a table, and"
        " LAMMPS cannot"
        " clip the sum of two pair styles at zero, as the equations do. With n = 2 or 2.5 in damped contacts it can."
    )


def order(roles: Roles, name: str, refinement: tuple[list[float], list[float]], reference: Trajectory) -> Verdict:
    """Judge the order of convergence over the refinement levels, the main run excluded.

    The uncertainty of the order is the fit's residual over the range of steps. For first order it is the residual
    between two neighbouring levels: contacts with a dashpot close anywhere within a step, and errors of first and
    second order may have different signs, so the order between two levels can differ from that of all.
    """
    expected = order_on(roles.scene)
    allowed = ORDER_TOLERANCE[expected]
    steps, errors = refinement[0][:-1], refinement[1][:-1]
    floor = 10.0 * relative_size(reference.uncertainty["velocity"], float(np.max(np.abs(reference.velocity))))
    fit: ObservedOrder = observed_order(steps, errors, floor=floor)
    deviation, uncertainty, why, outcome = abs(fit.order - expected), math.inf, "", Outcome.NOT_RUN
    if fit.points < 3:
        why = f"{fit.points} of {len(steps)} errors are above round-off, and 3 are needed for a fit"
    elif len(set(steps)) < 3:
        why = (
            f"one sample every {roles.scene.duration / roles.scene.samples:.3g} s is too dense to test convergence,"
            " because all levels have the same step; lower sampling.count"
        )
    else:
        uncertainty = 2.0 * math.log1p(fit.residual) / math.log(steps[0] / steps[-1])
        if expected == 1:
            uncertainty *= fit.points - 1
        outcome = judge(deviation, uncertainty, allowed)
        if not uncertainty < allowed or (expected == 1 and outcome is Outcome.UNDECIDED):
            why = f"errors scatter by {100 * fit.residual:.0f} % about a power of dt: there is no asymptotic range"
        elif expected == 1 and fit.order > 1.0 and outcome is Outcome.FAIL:
            why = (
                f"velocity errors fall as dt^{fit.order:.3f}: little is damped, and the second-order part of the"
                " error, which all scenes have, is not small compared with the first-order part"
            )
    unjudged = Verdict(
        scene=roles.scene.name,
        quantity="order",
        backend=name,
        reference=f"exact {expected}",
        outcome=Outcome.NOT_RUN,
        sentence=f"order of {name} on {roles.scene.name}: {why}.",
        meaning="convergence in the time step",
    )
    if why:
        return unjudged
    reason = (
        f"velocity-Verlet has order 2, tolerance +- {allowed}"
        if expected == 2
        else f"velocity-dependent forces are evaluated at the half step, which makes the order 1,"
        f" tolerance +- {allowed}"
    )
    return replace(
        unjudged,
        outcome=outcome,
        sentence=(
            f"velocity errors of {name} fall as dt^{fit.order:.3f} over dt = {steps[0]:.3g} .. {steps[-1]:.3g} s"
            f" ({fit.points} points, residual {100 * fit.residual:.1f} %); {reason}."
        ),
        difference=deviation,
        scale=1.0,
        scale_name="1",
        reference_uncertainty=uncertainty,
        tolerance=allowed,
    )


def conserved(roles: Roles, run: Trajectory, tolerance: float, reference: Trajectory | None = None) -> list[Verdict]:
    """Judge the drift of momentum, within round-off, and of energy, within the tolerance.

    Each is judged where the scene conserves it. Where a drive gives energy, the energy less its work is, unless samples
    are too far apart to give that work; ``reference`` is the run by which this is decided (None: the run itself).

    The loads on the ends of a precompressed chain without walls cancel; with one wall there is one load alone.
    """
    verdicts = []
    if roles.scene.conserves_momentum:
        verdicts.append(_drift(roles, run, "momentum", momentum_tolerance(run), "round-off"))
    if roles.scene.conserves_energy:
        verdicts.append(_drift(roles, run, "energy", tolerance, "time step"))
    elif not roles.scene.dissipates:
        unknown = work(roles.scene, run if reference is None else reference)[1]
        verdict = _drift(roles, run, "energy_less_work", tolerance, "time step", unknown)
        if unknown < tolerance * verdict.scale or verdict.scale == 0.0:
            verdicts.append(verdict)
    return verdicts


def _drift(roles: Roles, run: Trajectory, name: str, tolerance: float, meaning: str, unknown: float = 0.0) -> Verdict:
    """Return the verdict on the largest change of an observable from its start, which may err by ``unknown``."""
    reading, backend = roles.readings.read(name, run), roles.engine
    observable, scale = reading.observable, float(reading.scale[0])
    drift, uncertainty = (
        relative_size(part, scale) for part in (float(np.max(np.abs(reading.values - reading.values[0]))), unknown)
    )
    return Verdict(
        scene=roles.scene.name,
        quantity=observable.words,
        backend=backend,
        reference="its own start",
        outcome=judge(drift, uncertainty, tolerance),
        sentence=(
            f"{observable.words} of {backend} drifts by at most {drift:.2e} of {scale:.4g} {observable.unit};"
            f" tolerance {tolerance:.1e} ({meaning})."
        ),
        difference=drift,
        scale=scale,
        unit=observable.unit,
        scale_name=observable.scale_name,
        uncertainty=0.0,
        reference_uncertainty=uncertainty,
        tolerance=tolerance,
        meaning=meaning,
    )


def model(roles: Roles, theory: Trajectory, reference: Trajectory) -> list[Verdict]:
    """Return the differences of binary collisions from the reference: numbers of a theory with other equations."""
    differences = [roles.readings.difference(quantity, theory, reference) for quantity in MODELLED]
    if roles.scene.n_body <= 2:
        differences = [part for part in differences if part.quantity != "residence_time"]
    # where only one of the two reaches the end there is no arrival to compare
    differences = [part for part in differences if part.quantity != "arrival_at_end" or math.isfinite(part.value)]
    return [
        Verdict.of(
            part,
            scene=roles.scene.name,
            backend=THEORY,
            reference=REFERENCE,
            outcome=Outcome.MODEL_DIFFERENCE,
            sentence=_model_sentence(part),
            uncertainty=math.nan,
            meaning="model",
        )
        for part in differences
    ]


def _model_sentence(compared: Difference) -> str:
    what, place = observable_named(compared.quantity).words, compared.place
    if not math.isfinite(compared.value):
        return f"Binary collisions and the reference do not both have the {what} of {place} within the duration."
    at = f" ({place})" if place else ""
    return (
        f"Binary collisions differ from the reference in the {what} by up to {100 * compared.value:.3g} % of"
        f" {compared.scale_name}{at}: a model difference, because they are other equations."
    )
