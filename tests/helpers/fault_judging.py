"""Provide scenes on which faults are planted, the runs that ``verify`` makes for them, and names of its verdicts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.runs.campaign import Result, run_case
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.assess import assess_scene
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY
from dem_bridge.verification.roles import POSITIONAL, THEORY, TWIN, Runs, assign_roles
from dem_bridge.verification.verify import plan_scene

Results = Runs[Result]
Plant = TypeVar("Plant")

#: chosen so that everything can show: a light body between two heavy ones collides three times with the striker (peaks
#: of 184, 352 and 157 N; open from 27 to 43 us and from 72 to 94 us), the other contacts start open, and no wall and no
#: weight takes momentum
FREE = Scene(
    name="recolliding",
    duration=1.5e-4,
    mass=(8e-3, 2e-3, 2e-2, 1e-2),
    stiffness=(1e10, 2e9, 2e10),
    velocity=(0.8, 0.0, 0.0, 0.0),
    gap=(0.0, 4e-6, 4e-6),
    samples=150,
)
#: everything else that a deck can say: walls, weight, overlap at the start
HELD = Scene(
    name="held",
    duration=4e-4,
    mass=(8.1e-3, 1e-2, 1.1e-2, 1.2e-2, 9e-3),
    stiffness=(4e9, 5e9, 8e9, 6e9),
    velocity=(0.8, 0.0, 0.0, 0.0, -0.1),
    gap=(0.0, 1e-6, -5e-7, 0.0),
    wall_left=Wall(stiffness=3e9, gap=1e-6),
    wall_right=Wall(stiffness=2e9, gap=5e-6),
    gravity=50.0,
    samples=100,
)


def named(verdict: Verdict) -> str:
    """Return a verdict's name: ``velocity - verlet``, ``energy``, ``scipy: velocity - reference``."""
    name = verdict.quantity
    if name not in ("momentum", "energy", "order"):
        name += f" - {verdict.reference}"
    return name if verdict.backend in ENGINE_BACKENDS else f"{verdict.backend}: {name}"


def minus(reference: str, *quantities: str) -> frozenset[str]:
    """Return the names of the verdicts on quantities of LAMMPS against ``reference``."""
    return frozenset(f"{quantity} - {reference}" for quantity in quantities)


FOUR = ("velocity", "displacement", "peak_force", "crossing_time")
#: LAMMPS against the twin at the same step: implementation and round-off
IMPLEMENTATION = minus(TWIN, "velocity") | minus(POSITIONAL, *FOUR, "contact_force")
#: LAMMPS against the reference: the error that a user has
USER = minus(REFERENCE, *FOUR, "residence_time")
MOMENTUM, ENERGY, ORDER = (frozenset({law}) for law in ("momentum", "energy", "order"))
#: the same without LAMMPS
TWIN_ERROR = frozenset({f"{TWIN}: velocity - {REFERENCE}"})
TWIN_ORDER = frozenset({f"{TWIN}: order"})
TWO_REFERENCES = frozenset({f"{SCIPY}: velocity - {REFERENCE}"})


@dataclass(frozen=True, kw_only=True)
class Fault(Generic[Plant]):
    """Say what a planted defect changes and which verdicts must be FAIL; all others must be PASS."""

    plant: Plant
    shows: frozenset[str]
    begins: float | None = None
    """The sample at which velocities first leave those of the twin, s, within one sample; None: not checked."""


class Bench:
    """Hold a scene with all its runs, each made once and shared by all faults."""

    def __init__(self, scene: Scene, accuracy: float) -> None:
        self.scene, self.accuracy = scene, accuracy
        self.roles = assign_roles(scene)

    @cached_property
    def cases(self) -> Runs[Case]:
        """Return the cases of the scene, in their roles."""
        runs = plan_scene(self.scene, self.accuracy).runs
        assert runs is not None
        return runs

    @property
    def engine_cases(self) -> list[Case]:
        """Return LAMMPS' cases, the main one first."""
        return self.of(self.roles.engine)

    @cached_property
    def _results_of_ours(self) -> dict[int, Result]:
        return {id(case): run_case(case) for case in self.cases if case.backend != self.roles.engine}

    def runs_with(self, run_engine: Callable[[Case], Result]) -> Results:
        """Return results in which ``run_engine`` makes those of LAMMPS; all others are made once."""
        ours = self._results_of_ours
        return self.cases.map(lambda case: ours.get(id(case)) or run_engine(case))

    @cached_property
    def sound_runs(self) -> Results:
        """Return the results without a fault, those of LAMMPS at its refinement levels included."""
        return self.runs_with(run_case)

    @cached_property
    def reference(self) -> Trajectory:
        """Return the run of the reference, for which LAMMPS is not needed."""
        run = self._results_of_ours[id(self.cases.reference)].trajectory
        assert run is not None
        return run

    def of(self, backend: str) -> list[Case]:
        """Return the cases of one backend, the main one first."""
        return [case for case in self.cases if case.backend == backend]

    def main(self, results: Results, backend: str) -> Trajectory:
        run = next(result.trajectory for result in results if result.case.backend == backend)
        assert run is not None
        return run

    def verdicts(self, results: Results) -> dict[str, Verdict]:
        """Return the verdicts by name, without those on the theory, which are never pass or fail."""
        judged = [v for v in assess_scene(self.roles, results, self.accuracy).verdicts if v.backend != THEORY]
        by_name = {named(verdict): verdict for verdict in judged}
        assert len(by_name) == len(judged), "two verdicts share a name"
        return by_name

    def check(self, results: Results, shows: Iterable[str] = ()) -> dict[str, Verdict]:
        """Assert that the verdicts in ``shows`` are FAIL and that all others are PASS; return them all."""
        verdicts = self.verdicts(results)
        expected = set(shows)
        assert {name for name, verdict in verdicts.items() if verdict.outcome is Outcome.FAIL} == expected
        others = {name: verdict.outcome for name, verdict in verdicts.items() if name not in expected}
        assert set(others.values()) == {Outcome.PASS}, others
        return verdicts

    def check_fault(self, results: Results, fault: Fault[Any]) -> None:
        """Assert that the results show the fault where and when it must show."""
        verdicts = self.check(results, fault.shows)
        if fault.begins is not None:
            parted = verdicts[f"velocity - {TWIN}"].first_divergence
            assert parted is not None
            assert abs(parted[0] - fault.begins) < 1.5 * self.scene.duration / self.scene.samples


def replaced(results: Results, new: Result) -> Results:
    """Return the results with the main run of one backend replaced; its refinement levels stay."""
    main = next(result for result in results if result.case.backend == new.case.backend)
    return results.map(lambda result: new if result is main else result)


def with_trajectory(results: Results, case: Case, run: Trajectory) -> Results:
    """Return the results with another trajectory for this case."""
    return results.map(lambda result: replace(result, trajectory=run) if result.case == case else result)


#: dt = 1e-8 s, 15,000 steps; sound runs err by 4.8e-7 of the largest velocity
BENCH = Bench(FREE, 2e-6)
HELD_BENCH = Bench(HELD, 1e-5)
