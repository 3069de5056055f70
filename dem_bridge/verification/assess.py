"""Judge the runs of one scene: pure functions from results in their roles to verdicts. Nothing is run here.

Failures of LAMMPS that known defects of its release explain are named.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from dem_bridge.foundation.wording import counted, summary
from dem_bridge.lmp.known_defects import known_defects
from dem_bridge.observables.differences import reduced, relative_to
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.runs.campaign import Result
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification import checks
from dem_bridge.verification.budget import Budget, budgets
from dem_bridge.verification.roles import Roles, Runs
from dem_bridge.verification.tolerances import twin_tolerance

#: outcomes that need no further word
CLEAN = (Outcome.PASS, Outcome.MODEL_DIFFERENCE)
#: time steps in s, coarsest first, and the velocity errors of the runs, relative to the reference's largest velocity
Refinement = tuple[list[float], list[float]]


@dataclass(frozen=True, kw_only=True)
class SceneStudy:
    """Runs and verdicts of one scene."""

    roles: Roles
    runs: Runs[Result] | None = None
    """None: the runs of the roles could not be chosen."""
    others: tuple[Result, ...] = ()
    """Results that no check reads."""
    verdicts: tuple[Verdict, ...]
    refinement: dict[str, Refinement] = field(default_factory=dict)
    """Errors at each time step, by backend."""
    budgets: tuple[Budget, ...] = ()
    """Error budgets of LAMMPS' main run, one for each quantity."""
    observables: tuple[tuple[str | float, ...], ...] = ()
    """Rows of the table of observables, see :func:`_observables`."""

    def __str__(self) -> str:
        """Return at most 15 lines: the verdicts by outcome, and those that do not pass."""
        counts = counted(verdict.outcome.value for verdict in self.verdicts)
        title = f"{self.scene.name}: {counts or 'no verdict'}"
        return summary((str(v) for v in self.verdicts if v.outcome not in CLEAN), title=title)

    __repr__ = __str__

    @property
    def scene(self) -> Scene:
        """The scene that is verified."""
        return self.roles.scene

    @property
    def engine(self) -> str:
        """Name of the LAMMPS backend that is verified."""
        return self.roles.engine

    @property
    def results(self) -> tuple[Result, ...]:
        """All results; of each backend the main run comes first."""
        return (*(self.runs or ()), *self.others)

    def run(self, backend: str) -> Trajectory | None:
        """Return the main run of a backend; None where it was not made or failed."""
        return next((result.trajectory for result in self.results if result.case.backend == backend), None)


#: trajectories by their roles, None for those that failed or that the scene has not
_Trajectories = Runs[Trajectory | None]


def assess_scene(roles: Roles, results: Runs[Result], accuracy: float) -> SceneStudy:
    """Judge the runs of a scene.

    Parameters
    ----------
    roles : Roles
        Of the scene.
    results : Runs of Result
        What became of the cases of :func:`~dem_bridge.verification.roles.list_cases`.
    accuracy : float
        Tolerance of velocity errors, relative to the largest velocity.
    """
    runs = results.map(lambda result: result.trajectory)
    study_roles, roles = roles, replace(roles)  # what is read off the runs is forgotten when they are judged
    refinement: dict[str, Refinement] = {}
    if runs.reference is not None:
        for main, levels in ((results.twin, results.twin_refinements), (results.engine, results.engine_refinements)):
            if main.trajectory is not None:
                refinement[main.case.backend] = _refinement(roles, (main, *levels), runs.reference)
    budgets_of_engine = _budgets(roles, runs)
    verdicts = [
        *_failures(roles, results),
        *_implementation(roles, runs, budgets_of_engine),
        *_accuracy(roles, results, runs, refinement, accuracy),
    ]
    if runs.engine is not None:
        verdicts += checks.conserved(roles, runs.engine, accuracy, runs.reference)
    return SceneStudy(
        roles=study_roles,
        runs=results,
        verdicts=tuple(verdicts),
        refinement=refinement,
        budgets=budgets_of_engine,
        observables=tuple(_observables(roles, runs)) if results.engine_refinements else (),
    )


def _observables(roles: Roles, runs: _Trajectories) -> Iterator[tuple[str | float, ...]]:
    """Yield a row for each registered observable; none without a reference.

    It has the scene, the observable, its largest magnitude in the reference, its unit and relative uncertainty; then
    the relative difference from the reference and the uncertainty of LAMMPS, the twin and the second reference.
    """
    if runs.reference is None:
        return
    for observable in OBSERVABLES.values():
        reference, numbers = roles.readings.read(observable.name, runs.reference), []
        for run in (runs.reference, runs.engine, runs.twin, runs.second_reference):
            errors = None if run is None else relative_to(reference, roles.readings.read(observable.name, run))
            numbers += [math.nan, math.nan] if errors is None else [errors.reduced(), reduced(errors.uncertainty)]
        # the reference does not differ from itself
        yield roles.scene.name, observable.words, reduced(reference.values), observable.unit, *numbers[1:]


def _failures(roles: Roles, results: Runs[Result]) -> Iterator[Verdict]:
    """Yield a verdict for each role whose run failed, or that its backend cannot play."""
    for result in (results.reference, results.second_reference, results.twin, results.engine, results.theory):
        if result is not None and result.failure is not None:
            yield checks.absent(roles, result.case.backend, result)


def _budgets(roles: Roles, runs: _Trajectories) -> tuple[Budget, ...]:
    if runs.engine is None or runs.twin is None or runs.positional_twin is None or runs.reference is None:
        return ()
    return budgets(roles.readings, runs.engine, runs.twin, runs.positional_twin, runs.reference, runs.tabled_twin)


def _implementation(roles: Roles, runs: _Trajectories, budget: tuple[Budget, ...]) -> Iterator[Verdict]:
    """Yield the verdicts on LAMMPS against its tables and the twins."""
    engine, twin, positional = runs.engine, runs.twin, runs.positional_twin
    if engine is None:
        return
    if "table" in engine.provenance:
        yield from checks.table(roles, engine)
    if twin is None:
        return
    yield checks.implementation(roles, engine, runs.tabled_twin or twin)
    if positional is None or not budget:
        return
    allowed = {part.quantity: part.allowed for part in budget}
    # contact forces have no uncertainty of their own, but their difference must be explained as well
    allowed["contact_force"] = twin_tolerance(roles.readings, "contact_force", twin, positional, runs.tabled_twin)
    for quantity, bound in allowed.items():
        yield checks.explained(roles, quantity, engine, positional, allowed=bound)


def _accuracy(
    roles: Roles, results: Runs[Result], runs: _Trajectories, refinement: dict[str, Refinement], accuracy: float
) -> Iterator[Verdict]:
    """Yield the verdicts of all runs against the reference."""
    reference = runs.reference
    if reference is None:
        return
    if results.second_reference is None or runs.second_reference is not None:
        estimated = results.second_reference is None or results.second_reference.case.uncertainty
        yield checks.two_methods(roles, runs.second_reference, reference, estimated=estimated)
    for result in (results.twin, results.engine):
        if (run := result.trajectory) is None:
            continue
        name = result.case.backend
        yield from checks.accuracy(roles, name, run, reference, accuracy)
        standard = _reference_with_table_error(runs) if result is results.engine else reference
        if len(refinement[name][0]) > 1:
            yield checks.order(roles, name, refinement[name], standard)
    if runs.theory is not None:
        yield from checks.model(roles, runs.theory, reference)


def _reference_with_table_error(runs: _Trajectories) -> Trajectory:
    """Return the reference with the error of the tables added to its uncertainty."""
    reference = runs.reference
    assert reference is not None
    if runs.tabled_twin is None or runs.twin is None:
        return reference
    missed = float(np.max(np.abs(runs.tabled_twin.velocity - runs.twin.velocity)))
    velocity = reference.uncertainty["velocity"] + missed
    return replace(reference, uncertainty=replace(reference.uncertainty, velocity=velocity))


def _refinement(roles: Roles, results: tuple[Result, ...], reference: Trajectory) -> Refinement:
    """Return steps and velocity errors of the runs of one backend, the coarsest step first."""
    runs = [result.trajectory for result in results if result.trajectory is not None]
    steps = [float(run.provenance["settings"]["dt"]) for run in runs]
    errors = [roles.readings.difference("velocity", run, reference).value for run in runs]
    order = np.argsort(steps)[::-1]
    return [steps[i] for i in order], [errors[i] for i in order]


def named_failures(scene: str, engine: str, run: Trajectory | None, verdicts: Iterable[Verdict]) -> Iterator[Verdict]:
    """Yield the verdicts, each failure of LAMMPS with the known defects that the deck of its run meets.

    A defect that the deck meets and that no verdict shows has a verdict that says so.

    Parameters
    ----------
    scene : str
        Its name.
    engine : str
        Backend that is LAMMPS.
    run : Trajectory or None
        Its run; None if it failed.
    verdicts : iterable of Verdict
        The verdicts on the scene.
    """
    names = [] if run is None else run.provenance.get("lammps", {}).get("known_defects", [])
    met = [item for item in known_defects() if item.name in names]
    names_met, shown = ", ".join(item.name for item in met), False
    for verdict in verdicts:
        if met and verdict.backend == engine and verdict.outcome is Outcome.FAIL:
            # the first one describes the defect
            why = f"known defect {names_met}" if shown else "; ".join(map(str, met))
            shown, sentence = True, f"{why[0].upper()}{why[1:]}: {verdict.sentence}"
            verdict = replace(verdict, known_defect=names_met, sentence=sentence)
        yield verdict
    if met and not shown:
        yield Verdict(
            scene=scene,
            quantity="known defect",
            backend=engine,
            reference="",
            outcome=Outcome.PASS,
            sentence=f"No result of {engine} shows the known defect {names_met}, although the deck meets it.",
        )
