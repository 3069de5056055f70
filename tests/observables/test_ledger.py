"""The energy ledger: what contacts store and dissipate, and the balance of all entries."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.observables.ledger import Ledger, energy_ledger
from dem_bridge.scene.scene import Damping, Scene
from tests.helpers.fake_runs import free_flight, uncertain

E = 0.7


@pytest.fixture(scope="module")
def cradle() -> tuple[db.Scene, db.Trajectory]:
    scene = db.load_scene("newtons-cradle")
    return scene, db.solve(scene, backend="scipy")


def _start(ledger: Ledger) -> float:
    return float(ledger.kinetic[0] + ledger.stored[0].sum())


def test_a_pair_dissipates_what_its_restitution_says() -> None:
    """In the frame of the centre of mass the share 1 - e^2 of the kinetic energy is lost, whatever the masses are."""
    scene = db.load_scene("polydisperse-pair")
    small, large = scene.mass
    ledger = energy_ledger(scene, db.solve(scene, backend="scipy"))
    lost = 0.5 * small * large / (small + large) * (1.0 - E**2)
    assert ledger.dissipated[-1, 0] == pytest.approx(lost, abs=ledger.dissipated_uncertainty[0])
    assert ledger.dissipated_uncertainty[0] < 2e-5 * lost  # a few intervals of 500 have a singular slope of the force


def test_the_balance_is_zero_and_more_samples_make_it_smaller(cradle: tuple[db.Scene, db.Trajectory]) -> None:
    scene, run = cradle
    ledger = energy_ledger(scene, run)
    assert np.max(np.abs(ledger.balance)) < 1e-6 * _start(ledger)
    assert ledger.dissipated.shape == (len(run.time), 4)
    assert np.all(np.diff(ledger.dissipated, axis=0) > -1e-9 * _start(ledger))


@pytest.mark.parametrize("clip", [True, False])
def test_what_dashpots_take_at_constant_speeds_is_power_times_time(clip: bool) -> None:
    # springs of 10 N/m and dashpots of 1 N s/m; contact 0 closes after half a second by 1 m/s, contact 1 has an overlap
    # of 1 m and opens by 2 m/s until the same time
    scene = Scene(
        name="three", duration=1.0, mass=(2.0, 4.0, 8.0), stiffness=(10.0, 10.0), exponent=2.0, gap=(0.5, -1.0),
        velocity=(2.0, 1.0, 3.0), damping=Damping(law="dashpot", coefficient=1.0, clip=clip),
    )  # fmt: skip
    speed = np.array([2.0, 1.0, 3.0])
    run = free_flight(samples=20, uncertainty=uncertain(velocity=0.1, displacement=0.01))
    run = replace(run, velocity=np.ones((21, 1)) * speed, displacement=run.time[:, None] * speed)
    ledger = energy_ledger(scene, run)
    t = run.time
    assert ledger.dissipated[:, 0] == pytest.approx(np.maximum(t - 0.5, 0.0), abs=1e-12)
    # the dashpot pulls with 2 N; clipped, with no more than the spring's 10 (1 - 2 t) N, from 0.4 s on
    pulled = 4.0 * np.minimum(t, 0.5)
    late = np.clip(t, 0.4, 0.5)
    kept = 1.6 + 20.0 * (late - late**2 - 0.24)
    assert ledger.dissipated[:, 1] == pytest.approx(np.where(t > 0.4, kept, pulled) if clip else pulled, abs=1e-12)
    assert ledger.kinetic == pytest.approx(np.full(21, 0.5 * (2.0 * 4.0 + 4.0 + 8.0 * 9.0)), rel=1e-14)
    stored = 5.0 * np.stack([np.maximum(t - 0.5, 0.0) ** 2, np.maximum(1.0 - 2.0 * t, 0.0) ** 2], axis=1)
    assert ledger.stored == pytest.approx(stored, abs=1e-13)
    assert (ledger.drag == 0.0).all()
    assert (ledger.work == 0.0).all()
    balance = ledger.stored.sum(axis=1) - 5.0 + ledger.dissipated.sum(axis=1)
    assert ledger.balance == pytest.approx(balance, abs=1e-12)
    # closing at 1.2 m/s instead of 1 m/s for half a second, and a share of what is out of balance
    share = 0.5 / float(ledger.dissipated[-1].sum()) * float(np.max(np.abs(balance)))
    assert ledger.dissipated_uncertainty[0] == pytest.approx(0.22 + share, rel=1e-9)
    if not clip:
        share = 2.0 / 2.5 * float(np.max(np.abs(balance)))
        assert ledger.dissipated_uncertainty[1] == pytest.approx(0.5 * (2.2**2 - 4.0) + share, rel=1e-9)
    for lost in (uncertain(velocity=np.inf), uncertain(displacement=np.inf)):
        assert np.isinf(energy_ledger(scene, replace(run, uncertainty=lost)).dissipated_uncertainty).all()
    free = energy_ledger(replace(scene, damping=None), run)
    assert (free.dissipated == 0.0).all()
    assert (free.dissipated_uncertainty == 0.0).all()


def test_what_drag_takes_is_the_kinetic_energy_that_free_bodies_lose() -> None:
    drag, speed, mass = 0.5, np.array([2.0, 3.0]), np.array([2.0, 4.0])
    scene = Scene(
        name="two", duration=1.0, mass=tuple(mass), stiffness=(10.0,), gap=(9.0,), velocity=tuple(speed), drag=drag
    )
    run = free_flight(bodies=2, contacts=1, samples=20)
    left = np.exp(-drag * run.time)[:, None]
    run = replace(run, velocity=left * speed, displacement=(1.0 - left) / drag * speed)
    lost = 0.5 * float(mass @ speed**2) * (1.0 - left[:, 0] ** 2)
    # quintics between samples of 0.05 s err by (0.5 0.05)^6 / 720
    assert energy_ledger(scene, run).drag == pytest.approx(lost, rel=1e-11, abs=1e-15)


def test_what_damping_by_overlap_takes_is_uncertain_by_twice_the_displacement() -> None:
    # n = 3: a force of c overlap rate; two bodies that approach by 1 m/s from touch on, and so an overlap of t
    scene = Scene(
        name="two", duration=1.0, mass=(2.0, 4.0), stiffness=(10.0,), exponent=3.0, velocity=(2.0, 1.0),
        damping=Damping(law="kuwabara-kono", coefficient=0.1, clip=False),
    )  # fmt: skip
    speed = np.array([2.0, 1.0])
    run = free_flight(bodies=2, contacts=1, samples=20)
    run = replace(run, velocity=np.ones((21, 1)) * speed, displacement=run.time[:, None] * speed)
    exact, off = (
        energy_ledger(scene, replace(run, uncertainty=uncertain(displacement=size, velocity=0.0)))
        for size in (0.0, 0.01)
    )
    dissipated = exact.dissipated[-1, 0]  # c / 2
    more = off.dissipated_uncertainty[0] - exact.dissipated_uncertainty[0]
    assert more == pytest.approx(2.0 * 0.01 * 2.0 * dissipated, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "share"), [({"coefficient": 0.91}, 1e-3), ({"clip": True}, 1e-4)], ids=["coefficient", "clip"]
)
def test_a_run_by_another_damping_force_is_out_of_balance(
    cradle: tuple[db.Scene, db.Trajectory], change: dict[str, Any], share: float
) -> None:
    scene, run = cradle
    assert scene.damping is not None
    stated = replace(scene, damping=replace(scene.damping, **change))
    ledger = energy_ledger(stated, run)
    assert np.max(np.abs(ledger.balance)) > share * _start(ledger)


@pytest.mark.parametrize(
    "name",
    [
        "mfix-dem-03",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("decelerating-40-drag", "driven-monomer")),
    ],
)
def test_drag_drive_and_walls_are_in_the_balance(name: str) -> None:
    scene = db.load_scene(name)
    ledger = energy_ledger(scene, db.solve(scene, backend="scipy"))
    scale = max(_start(ledger), float(np.max(np.abs(ledger.work))))
    assert np.max(np.abs(ledger.balance)) < 1e-7 * scale
    assert (ledger.drag[-1] > 0.0) == (scene.drag > 0.0)
    assert (ledger.work[-1] > 0.0) == (scene.drive is not None)


def test_the_table_has_a_row_for_each_contact_and_the_balance() -> None:
    table = db.table_of("mfix-dem-03", "energy-ledger", backend="scipy")
    frame = table.to_pandas()
    assert list(frame) == ["contact", "most_stored_J", "stored_J", "dissipated_J", "dissipated_uncertainty_J"]
    assert len(frame) == 3
    assert (frame["dissipated_J"] > frame["dissipated_uncertainty_J"]).all()
    assert any(note.startswith("balance: ") for note in table.notes)


@pytest.mark.lammps
@pytest.mark.parametrize("backend", ["lammps-granular", "lammps-table"])
def test_the_energies_of_lammps_stand_beside_those_of_the_ledger(backend: str) -> None:
    scene = Scene(
        name="pair", duration=4e-5, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=20
    )  # ends in contact
    run = db.solve(scene, backend=backend, dt=1e-7, uncertainty=False)
    _, potential, kinetic = run.provenance["energies"][-1]
    ledger = energy_ledger(scene, run)
    # 17 digits of the log, and sums over two bodies
    assert kinetic == pytest.approx(ledger.kinetic[-1], rel=1e-14)
    stored = ledger.stored[-1].sum()
    assert stored > 0.1 * ledger.kinetic[0]
    # tables interpolate the energy between their lines; granular styles report none
    assert potential == (0.0 if backend == "lammps-granular" else pytest.approx(stored, rel=1e-5))
    # the planted fault: half the kinetic energy, as of a code that forgets a body, is far off
    assert abs(0.5 * kinetic - ledger.kinetic[-1]) > 0.1 * ledger.kinetic[-1]
    notes = db.table_of(scene, "energy-ledger", backend=backend, dt=1e-7).notes
    assert [note for note in notes if "by LAMMPS (thermo ke)" in note]
    assert [note for note in notes if "by LAMMPS (thermo pe)" in note]
