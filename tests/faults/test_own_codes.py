"""Faults in the codes that judge: the twin, two references, the theory. LAMMPS is sound, and the verdicts say so."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import dem_bridge as db
from dem_bridge.backends import bca, driven, scipy_integration, splitting
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics import exact
from dem_bridge.runs.campaign import run_case
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY
from dem_bridge.verification.roles import TWIN
from tests.helpers.fault_judging import (
    BENCH,
    FREE,
    HELD_BENCH,
    IMPLEMENTATION,
    ORDER,
    TWIN_ERROR,
    TWIN_ORDER,
    TWO_REFERENCES,
    USER,
    Bench,
    Fault,
    Results,
    minus,
    with_trajectory,
)
from tests.helpers.no_support import NOTHING

# the twin

Changes = list[tuple[str, str]]

#: the plain kernel's and that of what it calls, without their decorators; the fast one answers the same to the last
#: bit, see tests/backends/test_splitting.py
SOURCE = "".join(
    inspect.getsource(part.py_func).split("\n", 1)[1]
    for part in (splitting.overlaps_of_positions, splitting.add_contact_forces, splitting.integrate)
)

#: what is written -> what is planted, in the twin's own source
TWIN_FAULTS: dict[str, Fault[Changes]] = {
    "tension allowed": Fault(
        plant=[("max(overlap[k], 0.0)", "overlap[k]"), ("np.sqrt(closed)", "np.sqrt(abs(closed))")],
        shows=IMPLEMENTATION | TWIN_ERROR,
    ),
    "one kick with the force of the step before": Fault(
        plant=[
            ("                    closed = ", "                    old = net.copy()\n                    closed = "),
            ("kicks[stage + 1] * push[i] * net[i]", "kicks[stage + 1] * push[i] * old[i]"),
        ],
        shows=IMPLEMENTATION | TWIN_ERROR,
    ),
    "whole kicks instead of half ones": Fault(
        plant=[("dt / mass", "2.0 * dt / mass")], shows=IMPLEMENTATION | TWIN_ERROR
    ),
    "a reaction weaker by 1e-3": Fault(
        plant=[("net[k + 1] += force[k]", "net[k + 1] += 0.999 * force[k]")], shows=IMPLEMENTATION | TWIN_ERROR
    ),
    "samples one step late": Fault(
        plant=[("while step <= dense_steps[row]:", "while step <= dense_steps[row] + (row > 0):")],
        shows=IMPLEMENTATION | TWIN_ERROR,
    ),
    "an exponent in place of the root": Fault(
        plant=[("closed * np.sqrt(closed)", "closed ** 1.45")], shows=IMPLEMENTATION | TWIN_ERROR
    ),
}
#: only overlaps start from it: the twin in positions is another code there, and at one with LAMMPS. With wider gaps the
#: difference of the two, which is taken for round-off, would be as large as the values, and nothing could be explained
GAP_OF_THE_WRONG_SIGN: Fault[Changes] = Fault(
    plant=[("= -gap, start", "= gap.copy(), start")], shows=minus(TWIN, "velocity") | TWIN_ERROR
)
#: no weight in the free scene
WEIGHT_WITHOUT_MASS: Fault[Changes] = Fault(
    plant=[("mass * gravity", "0.01 * gravity")], shows=IMPLEMENTATION | TWIN_ERROR
)


def _with_twin(bench: Bench, monkeypatch: pytest.MonkeyPatch, changes: Changes) -> Results:
    """The sound runs with the twin's, in overlaps and in positions, from a changed source that is not compiled."""
    text = SOURCE
    for old, new in changes:
        assert old in text, f"the twin's source has changed: {old!r} is not in it"
        text = text.replace(old, new)
    names: dict[str, Any] = {"np": np, "driving_force": driven.driving_force, "piston_motion": driven.piston_motion}
    exec(text, names)
    results = bench.sound_runs
    monkeypatch.setattr(splitting, "integrate", names["integrate"])
    monkeypatch.setattr(splitting, "FUSED", NOTHING)
    main, *others = bench.of(TWIN)
    [positional] = [case for case in others if case.resolution.surrogate_radius is not None]
    for case in (main, positional):
        results = with_trajectory(results, case, _faulty(case, results))
    return results


def _faulty(case: Case, sound: Results, scene: Scene | None = None) -> Trajectory:
    """A run of the case, of another scene if one is given, with the bars of the sound one: none is made for them."""
    kept = next(result.trajectory for result in sound if result.case == case)
    planted = replace(case, scene=scene or case.scene, uncertainty=False)
    run = run_case(planted).trajectory
    assert run is not None
    assert kept is not None
    return replace(run, uncertainty=kept.uncertainty, provenance=kept.provenance)


@pytest.mark.lammps
def test_the_twin_as_it_is_fails_nothing_and_is_what_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = _with_twin(BENCH, monkeypatch, [])
    BENCH.check(plain)
    np.testing.assert_array_equal(BENCH.main(plain, TWIN).velocity, BENCH.main(BENCH.sound_runs, TWIN).velocity)


@pytest.mark.lammps
@pytest.mark.parametrize("fault", TWIN_FAULTS.values(), ids=TWIN_FAULTS)
def test_a_fault_in_the_twin_is_named(fault: Fault[Changes], monkeypatch: pytest.MonkeyPatch) -> None:
    assert not fault.shows & USER
    BENCH.check_fault(_with_twin(BENCH, monkeypatch, fault.plant), fault)


@pytest.mark.lammps
def test_weight_without_mass_in_the_twin_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    HELD_BENCH.check_fault(_with_twin(HELD_BENCH, monkeypatch, WEIGHT_WITHOUT_MASS.plant), WEIGHT_WITHOUT_MASS)


@pytest.mark.lammps
def test_a_gap_of_the_wrong_sign_in_the_twin_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(replace(FREE, gap=(0.0, 1e-8, 1e-8)), BENCH.accuracy)
    bench.check_fault(_with_twin(bench, monkeypatch, GAP_OF_THE_WRONG_SIGN.plant), GAP_OF_THE_WRONG_SIGN)


# the references


@pytest.mark.lammps
def test_a_second_method_that_restarts_late_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    sound, sound_runs = scipy_integration.Integration.first_event, BENCH.sound_runs  # made before the fault

    def late(self: Any, solver: Any, dense: Any, closed: NDArray[np.bool_]) -> tuple[float, int] | None:
        event = sound(self, solver, dense, closed)
        return None if event is None else (float(solver.t), event[1])

    monkeypatch.setattr(scipy_integration.Integration, "first_event", late)
    [case] = BENCH.of(SCIPY)
    BENCH.check(with_trajectory(sound_runs, case, _faulty(case, sound_runs)), TWO_REFERENCES)


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("backend", "factor", "shows"),
    [
        # far below what a user would notice, and the two references do not agree any more
        (REFERENCE, 1.0 + 1e-10, TWO_REFERENCES),
        (SCIPY, 1.0 + 1e-10, TWO_REFERENCES),
        (SCIPY, 1.0 + 1e-3, TWO_REFERENCES),
        # against a wrong reference everything is wrong and falls with no step, while LAMMPS and its twin agree
        (REFERENCE, 1.0 + 1e-3, TWO_REFERENCES | TWIN_ERROR | USER | ORDER | TWIN_ORDER),
    ],
)
def test_a_reference_of_another_stiffness_is_named(backend: str, factor: float, shows: frozenset[str]) -> None:
    [case] = BENCH.of(backend)
    other = replace(FREE, stiffness=tuple(factor * k for k in FREE.stiffness))
    run = _faulty(case, BENCH.sound_runs, scene=other)
    verdicts = BENCH.check(with_trajectory(BENCH.sound_runs, case, run), shows)
    assert all(verdicts[name].outcome is Outcome.PASS for name in IMPLEMENTATION)


# the theory


def test_a_theory_with_the_masses_swapped_loses_momentum(monkeypatch: pytest.MonkeyPatch) -> None:
    # other equations are never pass or fail: no verdict can show it, its own law must
    def swapped(
        *, masses: tuple[float, float], velocities: tuple[float, float], stiffness: float, exponent: float
    ) -> exact.TwoBodyCollision:
        return exact.two_body_collision(
            masses=masses[::-1], velocities=velocities, stiffness=stiffness, exponent=exponent
        )

    pulse = replace(FREE, gap=0.0)
    weights = np.array(pulse.mass)
    sound = db.solve(pulse, backend="bca").velocity @ weights
    assert np.max(np.abs(sound / sound[0] - 1.0)) < 1e-14
    monkeypatch.setattr(bca, "two_body_collision", swapped)
    total = db.solve(pulse, backend="bca").velocity @ weights
    assert np.max(np.abs(total / total[0] - 1.0)) > 1e-3
