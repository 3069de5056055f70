"""Runs in memory: each case has its own run, with and without its uncertainty, and is solved once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.campaign_cases import SHORT, short_case
from tests.helpers.fake_runs import free_flight

CASE = short_case(dt=1e-6)
#: cases that differ from it in one field each
OTHERS = {
    "scene": replace(CASE, scene=replace(SHORT, mass=(8.2e-3, 1e-2, 1e-2))),
    "backend": replace(CASE, backend="blanes-moan"),
    "resolution": replace(CASE, resolution=Resolution(dt=2e-6)),
    "sampling": replace(CASE, sampling=Sampling(count=5)),
    "engine": replace(CASE, engine=Engine(lmp_args=("-sf", "omp"))),
}


def _runs() -> dict[str, Trajectory]:
    return {name: free_flight(duration=float(nth)) for nth, name in enumerate(("own", *OTHERS), start=1)}


@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("asked", [False, True])
def test_a_run_is_found_by_every_field_of_its_case_but_the_uncertainty(kept: bool, asked: bool) -> None:
    cases, runs, cache = {"own": CASE, **OTHERS}, _runs(), RunCache()
    for name, case in cases.items():
        assert cache.load(replace(case, uncertainty=asked)) is None, name
        assert cache.keep(replace(case, uncertainty=kept), runs[name]) is runs[name]
    for name, case in cases.items():
        assert cache.load(replace(case, uncertainty=asked)) is runs[name], name


def test_a_run_and_a_family_are_solved_once() -> None:
    cache, calls = RunCache(), list[str]()

    def run() -> Trajectory:
        calls.append("run")
        return free_flight()

    def family(case: Case, of: RunCache) -> Any:
        assert of is cache
        assert not case.uncertainty
        calls.append(case.backend)
        return [case.backend]

    first = cache.load_or_solve(CASE, run)
    assert cache.load_or_solve(replace(CASE, uncertainty=True), run) is first
    families = [
        cache.family(replace(case, uncertainty=u), family) for u in (True, False) for case in (CASE, OTHERS["backend"])
    ]
    assert families == [["verlet"], ["blanes-moan"]] * 2
    assert calls == ["run", "verlet", "blanes-moan"]
    # another cache takes over both
    other = RunCache()
    other.adopt(cache)
    assert other.load(CASE) is first
    assert other.family(CASE, family) is families[0]
    assert len(calls) == 3


def test_a_stored_run_with_its_uncertainty_is_that_of_the_case_without_and_not_the_other_way(tmp_path: Path) -> None:
    store, certain = Store(tmp_path), replace(CASE, uncertainty=True)
    assert certain.key is not None
    assert CASE.key is not None
    assert RunCache(None).load_stored(CASE) is None
    store.save(CASE.key, CASE.solve())
    assert RunCache(store).load_stored(certain) is None
    plain = RunCache(store).load_stored(CASE)
    assert plain is not None
    store = Store(tmp_path / "other")
    run = solve(certain)
    store.save(certain.key, run)
    found, with_uncertainty = RunCache(store).load_stored(CASE), RunCache(store).load_stored(certain)
    assert found is not None
    assert with_uncertainty is not None
    np.testing.assert_array_equal(found.velocity, run.velocity)
    assert np.all(np.isinf(found.uncertainty["velocity"]))
    assert np.all(np.isfinite(with_uncertainty.uncertainty["velocity"]))
    assert RunCache(store).load(certain) is not None


def test_keys_differ_with_every_field_of_a_case_and_not_with_the_name_of_its_scene() -> None:
    own = CASE.key
    others = {name: case.key for name, case in OTHERS.items()}
    assert None not in others.values()
    assert len({own, *others.values(), replace(CASE, uncertainty=True).key}) == len(others) + 2
    assert replace(CASE, scene=replace(SHORT, name="other")).key == own
    # a law that is a function is known at some overlaps only
    assert replace(CASE, scene=replace(SHORT, law=lambda overlap: 4e9 * overlap**1.5)).key is None


# what a case is expected to take


def _case(backend: str, scene: Scene = SHORT, **settings: Any) -> Case:
    resolution = Resolution(**settings)
    return Case(scene=scene, backend=backend, resolution=resolution, sampling=Sampling(count=4), uncertainty=False)


def test_the_expected_time_counts_bodies_steps_and_runs() -> None:
    # three bodies, 1e-4 s: a thousand steps of 1e-7 s, fifty dense samples a body
    fast = 4e-4 + 150 * (5e-8 + 3 * 6e-9) + 1000 * (2.8e-8 + 3 * 2.2e-10)
    assert _case("verlet", dt=1e-7).expected == pytest.approx(0.05 + fast)
    assert replace(_case("verlet", dt=1e-7), uncertainty=True).expected == pytest.approx(0.05 + 6 * fast)
    granular = 8.8e-3 + 150 * (7.2e-6 + 3 * 3.1e-7) + 10_000 * (6.1e-7 + 3 * 2.5e-8)
    assert _case("lammps-granular", dt=1e-8).expected == pytest.approx(0.05 + granular)
    assert _case("ase", dt=1e-8).expected == pytest.approx(0.1 + 150 * 3e-6 + 10_000 * (2e-5 + 3 * 5e-7))
    six = 4e-4 + 150 * (5e-8 + 3 * 6e-9) + 6e5 * (2.8e-8 + 3 * 2.2e-10)
    assert _case("blanes-moan").expected == pytest.approx(0.05 + six)
    assert _case("bca").expected == pytest.approx(0.05 + 3e-4)
    # adaptive codes by their bodies; the reference where its series fit, otherwise as scipy
    assert _case("reference").expected == pytest.approx(0.05 + 5e-4 + 3e-5 * 3**1.63 * 150**0.12)
    scipy = 7e-3 + 6.7e-4 * 3**1.19 * 150**0.33 * 1e-4**-0.06
    assert _case("scipy").expected == pytest.approx(0.05 + scipy)
    assert replace(_case("scipy"), uncertainty=True).expected == pytest.approx(0.05 + 4 * scipy)
    assert _case("reference", replace(SHORT, exponent=2.3)).expected == pytest.approx(0.05 + scipy)


def test_a_drive_adds_to_each_step_of_lammps_what_its_formula_takes() -> None:
    driven = replace(SHORT, drive=Drive(shape="chirp", force=1.0, frequency=1e3, last_frequency=2e3, sweep=1e-4))
    more = _case("lammps-granular", driven, dt=1e-8).expected - _case("lammps-granular", dt=1e-8).expected
    assert more == pytest.approx(10_000 * 17e-6)
    assert _case("verlet", driven, dt=1e-8).expected < 0.1


def test_the_label_of_a_case_names_its_scene_code_and_step() -> None:
    assert _case("verlet", dt=1.25e-7).label == "three: verlet at dt = 1.25e-07 s"
    assert _case("scipy").label == "three: scipy"


def test_samples_that_fill_the_memory_are_refused_and_one_less_is_not() -> None:
    # 8 bytes of 1000 velocities, 1000 displacements and 999 forces
    long = Scene(name="long", duration=1.0, mass=(1.0,) * 1000, stiffness=(1.0,) * 999, velocity=(0.0,) * 1000)
    most = 2**32 // (8 * 2999) - 1
    _ = Case(scene=long, backend="bca", resolution=Resolution(), sampling=Sampling(count=most))
    with pytest.raises(UsageError, match=rf"long: {most + 1} samples of 1000 bodies take 4 GiB; allowed: 4 GiB"):
        Case(scene=long, backend="bca", resolution=Resolution(), sampling=Sampling(count=most + 1))
