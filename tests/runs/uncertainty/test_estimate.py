"""Which further runs a case takes for its uncertainty, that each is made once, and that run and estimate are apart."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dem_bridge.backends import splitting
from dem_bridge.backends.base import BACKENDS, Resolution, Sampling, backend
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.scipy_dop853 import LARGEST_RTOL, ScipyDop853
from dem_bridge.backends.steps import peaks_and_crossings
from dem_bridge.backends.twin import solve_dense
from dem_bridge.foundation import progress
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty import from_own_steps as own_steps
from dem_bridge.runs.uncertainty import from_twins as twins
from dem_bridge.runs.uncertainty.estimate import (
    OWN_STEPS,
    REPLICAS,
    TWINS,
    estimate_uncertainty,
    looser_cases,
    needs_of,
    solve,
)
from dem_bridge.runs.uncertainty.from_own_steps import blanes_moan_family
from dem_bridge.runs.uncertainty.from_replicas import moved_by_a_digit
from dem_bridge.runs.uncertainty.from_twins import twin_family, twin_resolution
from dem_bridge.runs.uncertainty.readings import finer_ratio, read_dense
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import QUANTITIES

PAIR = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=20)
DAMPED = replace(PAIR, damping=Damping(law="dashpot", coefficient=10.0))


def _case(name: str, scene: Scene = PAIR, **settings: Any) -> Case:
    return Case(scene=scene, backend=name, resolution=Resolution(**settings), sampling=Sampling(count=scene.samples))


@pytest.fixture
def solved_twins(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, bool]]:
    """Step and positions of every run of a splitting method, as it is made."""
    made: list[tuple[float, bool]] = []
    sound = splitting.run_kernel

    def counted(method: Any, scene: Any, contacts: Any, plan: Any, radius: Any, full: bool) -> Any:
        made.append((plan.step, bool(np.any(np.asarray(radius) > 0.0))))
        return sound(method, scene, contacts, plan, radius, full)

    monkeypatch.setattr(splitting, "run_kernel", counted)
    return made


def test_every_solution_of_the_equations_has_an_uncertainty() -> None:
    listed = {*TWINS, *OWN_STEPS, *REPLICAS}
    assert listed == {name for name in BACKENDS if backend(name).equations == "hertz"}


@pytest.mark.parametrize("name", ["verlet", "ase", "blanes-moan", "reference", "scipy", "ode45"])
def test_a_backend_alone_has_no_uncertainty_and_the_same_run(name: str) -> None:
    case = _case(name, dt=1e-7)
    alone, run = case.solve(), solve(case)
    assert all(np.all(np.isinf(alone.uncertainty[quantity])) for quantity in QUANTITIES)
    assert all(np.all(np.isfinite(run.uncertainty[quantity])) for quantity in QUANTITIES)
    for quantity in (*QUANTITIES, "contact_force"):
        assert getattr(run, quantity).tobytes() == getattr(alone, quantity).tobytes()
    assert solve(replace(case, uncertainty=False)).uncertainty["velocity"] == math.inf


@pytest.mark.parametrize("name", ["bca", "adiabatic"])
def test_a_theory_has_none(name: str) -> None:
    chain = Scene(name="three", duration=1e-4, mass=(1e-2,) * 3, stiffness=(4e9,) * 2, velocity=(0.8, 0.0, 0.0))
    assert solve(_case(name, chain)).uncertainty["velocity"] == math.inf


def test_a_family_is_made_once_and_the_twins_run_is_one_of_it(solved_twins: list[tuple[float, bool]]) -> None:
    cache = RunCache()
    runs = {name: solve(_case(name, dt=1e-7), cache) for name in ("verlet", "ase")}
    # at the step in overlaps and in positions, at twice and at a third of it in overlaps
    steps = [(pytest.approx(step), positional) for step, positional in sorted(solved_twins)]
    assert steps == [(1e-7 / 3, False), (1e-7, False), (1e-7, True), (2e-7, False)]
    for quantity in QUANTITIES:
        np.testing.assert_array_equal(runs["verlet"].uncertainty[quantity], runs["ase"].uncertainty[quantity])


def test_families_are_at_their_ratios_of_the_step() -> None:
    def ratios(scene: Scene, samples: int, dt: float, make: Any = twin_family) -> list[float]:
        found = make(scene, Resolution(dt=dt), Sampling(count=samples))
        assert found is not None
        return sorted(found.others)

    # of 50 steps a sample: 25 and 150; for dashpots the golden ratio, 31 and 131 (1.618 and 0.382 on whole steps)
    assert ratios(PAIR, 20, 1e-7) == pytest.approx([1 / 3, 2.0], rel=1e-12)
    assert ratios(DAMPED, 20, 1e-7) == pytest.approx([50 / 131, 50 / 31], rel=1e-12)
    # one step a sample leaves no coarser one, and two leave no golden ratio
    assert ratios(PAIR, 1000, 1e-7) == pytest.approx([1 / 3, 1 / 2], rel=1e-12)
    assert ratios(DAMPED, 1000, 1e-7) == pytest.approx([1 / 3, 1 / 2], rel=1e-12)
    assert ratios(DAMPED, 500, 1e-7) == pytest.approx([1 / 3, 2.0], rel=1e-12)
    assert ratios(DAMPED, 333, 1e-4 / 999) == pytest.approx([3 / 8, 3 / 2], rel=1e-12)


def _blanes_moan(scene: Scene, resolution: Resolution, sampling: Sampling) -> Any:
    return blanes_moan_family(Case(scene=scene, backend="blanes-moan", resolution=resolution, sampling=sampling))


#: family -> order, part of thinning that counts, factor of the scatter, ratios of the steps, and steps of all runs at
#: 1000 steps: those at other steps, and in positions, too. The factors are those with which random scenes were covered
FAMILIES: dict[str, tuple[Any, int, float, float, list[float], int]] = {
    "twin": (twin_family, 2, 0.5, 0.0, [1 / 3, 2.0], 1000 + 500 + 3000 + 1000),
    "blanes-moan": (_blanes_moan, 4, 1.0, 6.0, [1 / 3, 1 / 2], 1000 + 2000 + 3000),
}


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_has_its_order_its_factors_and_the_cost_of_all_its_runs(name: str) -> None:
    make, order, thinning, scatter, ratios, steps = FAMILIES[name]
    family = make(PAIR, Resolution(dt=1e-7), Sampling(count=20))
    assert (family.order, family.thinning, family.scatter) == (order, thinning, scatter)
    assert sorted(family.others) == pytest.approx(ratios, rel=1e-12)
    assert family.cost.steps == steps
    runs = [family.main, *family.others.values(), *([] if family.positional is family.main else [family.positional])]
    assert family.cost.force_evaluations == sum(run.cost.force_evaluations for run in runs)


def test_readings_are_thinned_to_every_second_dense_sample() -> None:
    plan = Schedule(step=1e-7, per_sample=50, subdivisions=10, samples=20)
    run, dense = solve_dense(PAIR, plan, 0.0)
    found = read_dense(PAIR, plan, dense, run).thinned
    second, third = (peaks_and_crossings(PAIR, plan, dense, every=every) for every in (2, 3))
    for own, expected, other in zip(found, second, third, strict=True):
        np.testing.assert_array_equal(own, expected)
        assert own[0] != other[0]


@pytest.mark.parametrize("make", [twin_family, _blanes_moan])
def test_laws_that_are_functions_are_interpolated_by_half_as_many_cells_too(make: Any) -> None:
    scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=20,
                  law=lambda overlap: 4e9 * overlap**1.5 * (1.0 + 1e4 * overlap))  # fmt: skip
    family = make(scene, Resolution(dt=1e-7), Sampling(count=20))
    assert make(PAIR, Resolution(dt=1e-7), Sampling(count=20)).halved is None
    assert 0.0 < np.max(np.abs(family.halved.velocity - family.main.velocity)) < 1e-3


@pytest.mark.parametrize(
    ("frequency", "steps", "exponent", "ratio"),
    [
        # 1/omega of the stiffest contact over the step: two hundredths of it are enough
        (0.0, 1000, 2.5, 1 / 3),
        (0.03, 1000, 2.5, 1 / 3),
        (0.0599, 1000, 2.5, 1 / 3),
        (0.2, 1000, 2.5, 0.1),
        (2.0, 1000, 2.5, 0.01),
        # below n = 2 a tenth of that
        (0.2, 1000, 1.9, 0.01),
        (0.2, 1000, 2.0, 0.1),
        # 1e7 steps times bodies are afforded
        (2.0, 1_000_000, 2.5, 0.2),
        (2.0, 10_000_000, 2.5, 1 / 3),
    ],
)
def test_the_finer_run_resolves_every_contact_within_what_is_afforded(
    frequency: float, steps: int, exponent: float, ratio: float
) -> None:
    plan = Schedule(step=1.0, per_sample=steps, subdivisions=1, samples=1)
    prescan = cast(Prescan, SimpleNamespace(frequency=frequency))
    scene = replace(PAIR, exponent=exponent)
    assert finer_ratio(1 / 3, scene, plan, prescan, 0.02) == pytest.approx(ratio, rel=1e-12)


@pytest.mark.parametrize(("make", "finest"), [(twin_family, 1 / 3), (_blanes_moan, 1 / 3)])
def test_a_finer_run_of_more_steps_than_are_counted_has_no_family(
    make: Any, finest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (twins, own_steps):
        monkeypatch.setattr(module, "MOST_STEPS", 999 / finest)
    assert make(PAIR, Resolution(dt=1e-7), Sampling(count=20)) is None
    for module in (twins, own_steps):
        monkeypatch.setattr(module, "MOST_STEPS", 1001 / finest)
    assert make(PAIR, Resolution(dt=1e-7), Sampling(count=20)) is not None


def test_the_positional_run_of_a_family_is_that_of_its_case(solved_twins: list[tuple[float, bool]]) -> None:
    cache = RunCache()
    family = twin_family(PAIR, Resolution(dt=1e-7), Sampling(count=20), cache)
    assert family is not None
    radius = family.positional.provenance["settings"]["surrogate_radius"]
    count = len(solved_twins)
    found = solve(replace(_case("verlet", dt=1e-7, surrogate_radius=radius), uncertainty=False), cache)
    assert found is family.positional
    assert len(solved_twins) == count
    alone = _case("verlet", dt=1e-7, surrogate_radius=radius).solve()
    for quantity in (*QUANTITIES, "contact_force"):
        assert getattr(alone, quantity).tobytes() == getattr(found, quantity).tobytes()
    assert alone.provenance == found.provenance


def test_the_tabled_run_of_a_family_is_that_of_its_case() -> None:
    cache, case = RunCache(), _case("verlet", dt=1e-7, tables=True)
    family = twin_family(PAIR, twin_resolution(_case("lammps-table", dt=1e-7)), Sampling(count=20), cache)
    assert family is not None
    assert cache.load(case) is family.tabled
    alone = case.solve()
    for quantity in (*QUANTITIES, "contact_force"):
        assert getattr(alone, quantity).tobytes() == getattr(family.tabled, quantity).tobytes()


def test_codes_on_the_same_steps_share_settings_of_the_twin_and_no_other() -> None:
    plain = Resolution(dt=1e-7)
    for name in ("lammps-granular", "verlet", "ase"):
        assert twin_resolution(_case(name, dt=1e-7, time_limit=5.0)) == plain
    assert twin_resolution(_case("lammps-table", dt=1e-7)) == replace(plain, tables=True)
    assert twin_resolution(_case("verlet", dt=1e-7, tables=True, table_points=300)) == replace(
        plain, tables=True, table_points=300
    )
    at_radius: dict[str, Any] = {"dt": 1e-7, "surrogate_radius": 1e-3}
    assert twin_resolution(_case("lammps-granular", **at_radius)) == Resolution(**at_radius)
    # ASE keeps displacements, whatever the radius
    assert twin_resolution(_case("ase", **at_radius)) == plain


def test_the_looser_runs_of_scipy_are_ordinary_cases_and_are_found_where_they_were_made() -> None:
    case, cache = _case("scipy", rtol=1e-9), RunCache()
    looser = looser_cases(case)
    assert [other.resolution for other in looser] == [Resolution(rtol=factor * 1e-9) for factor in (5.0, 10.0, 20.0)]
    assert not any(other.uncertainty for other in looser)
    # what the digits of the scene leave unknown is seen by one of them
    assert [other.scene for other in looser] == [moved_by_a_digit(case.scene), case.scene, case.scene]
    assert looser[0].scene != case.scene
    first = solve(case, cache)
    for other in looser:
        run = cache.load(other)
        assert run is not None
        # a value of the looser run shows in the uncertainty
        changed = RunCache()
        changed.runs = {**cache.runs, other: replace(run, velocity=run.velocity + 1.0)}
        assert estimate_uncertainty(case, first, changed)["velocity"] == pytest.approx(3.0, rel=1e-6)


def test_the_reference_takes_looser_runs_where_scipy_answers_and_replicas_elsewhere() -> None:
    assert looser_cases(_case("reference")) == ()
    assert [other.backend for other in looser_cases(_case("reference", DAMPED))] == ["scipy"] * 3
    answered, own = solve(_case("reference", DAMPED)), solve(_case("scipy", DAMPED))
    assert answered.uncertainty["velocity"] == own.uncertainty["velocity"]


def test_the_run_and_each_looser_run_are_a_quarter_of_the_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = ScipyDop853.run

    def half_way(self: ScipyDop853, *how: Any) -> Any:
        run = sound(self, *how)
        progress.report(0.5)
        return run

    monkeypatch.setattr(ScipyDop853, "run", half_way)
    seen: list[float] = []
    with progress.listening(seen.append):
        solve(_case("scipy", rtol=1e-6))
    # each run reports a fraction on its way, its end, and the half
    assert seen[1::3] == pytest.approx([1 / 4, 2 / 4, 3 / 4, 1.0], rel=1e-12)
    assert seen[2::3] == pytest.approx([1 / 8, 3 / 8, 5 / 8, 7 / 8], rel=1e-12)


def test_a_case_needs_its_run_and_the_cases_that_others_may_share() -> None:
    twin, ase, scipy = _case("verlet", dt=1e-7), _case("ase", dt=1e-7), _case("scipy", rtol=1e-9)
    for case in (twin, ase, scipy):
        assert needs_of(replace(case, uncertainty=False)) == ()
    # the twin makes its family itself, and that of ASE is the twin's
    assert needs_of(twin) == ()
    assert needs_of(ase) == (replace(ase, uncertainty=False), twin)
    assert needs_of(scipy) == (replace(scipy, uncertainty=False), *looser_cases(scipy))
    for name in ("reference", "ode45", "blanes-moan"):
        assert needs_of(_case(name)) == ()


@pytest.mark.parametrize(("rtol", "needs"), [(LARGEST_RTOL / 20.0, 4), (LARGEST_RTOL / 19.0, 0)])
def test_looser_runs_beyond_the_largest_tolerance_are_not_needed(rtol: float, needs: int) -> None:
    assert len(needs_of(_case("scipy", rtol=rtol))) == needs


def test_the_largest_tolerance_has_an_uncertainty_too() -> None:
    run = solve(_case("scipy", rtol=LARGEST_RTOL))
    assert 0.0 < run.uncertainty["velocity"] < 0.1


@pytest.mark.parametrize("name", ["verlet", "scipy", "reference", "ode45", "blanes-moan"])
def test_the_cost_of_the_uncertainty_is_not_that_of_the_run(name: str) -> None:
    case = _case(name, dt=1e-7)
    alone, run = case.solve(), solve(case)
    assert run.cost.steps == alone.cost.steps
    assert run.cost.force_evaluations == alone.cost.force_evaluations
    assert run.uncertainty.cost.steps > 0
    assert run.uncertainty.cost.cpu > 0.0


def test_a_family_of_too_many_steps_is_not_made_and_nothing_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(twins, "MOST_STEPS", 1)
    scene = Scene(name="two", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=4)
    case = Case(scene=scene, backend="verlet", resolution=Resolution(dt=1e-6), sampling=Sampling(count=4))
    run = solve(case)
    assert all(np.all(np.isinf(run.uncertainty[name])) for name in QUANTITIES)
