"""The table of energies against closed forms: a damped linear oscillator, flight with drag, and what LAMMPS reports."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.formats.tables.catalogue import ledger
from dem_bridge.scene.scene import Damping, Scene

#: two bodies on a linear spring and a dashpot, in the middle of their collision at the end
MASS, STIFFNESS, DASHPOT, SPEED = (0.01, 0.03), 1e6, 20.0, 0.8
PAIR = Scene(
    name="oscillator", duration=2e-4, mass=MASS, stiffness=(STIFFNESS,), velocity=(SPEED, 0.0), exponent=2.0,
    damping=Damping(law="dashpot", coefficient=DASHPOT, clip=False), samples=400,
)  # fmt: skip
REDUCED = math.prod(MASS) / sum(MASS)


def _oscillator(time: float) -> tuple[float, float]:
    """Return the stored and the kinetic energy of the relative motion, J, by the closed form."""
    rate = DASHPOT / (2.0 * REDUCED)
    omega = math.sqrt(STIFFNESS / REDUCED - rate**2)
    decay = SPEED * math.exp(-rate * time)
    overlap = decay * math.sin(omega * time) / omega
    closing = decay * (math.cos(omega * time) - rate / omega * math.sin(omega * time))
    return 0.5 * STIFFNESS * overlap**2, 0.5 * REDUCED * closing**2


def _numbers(notes: tuple[str, ...], start: str) -> list[float]:
    [note] = [note for note in notes if note.startswith(start)]
    return [float(number) for number in re.findall(r"-?\d[\d.]*(?:e[-+]?\d+)?(?= J)", note)]


def test_a_damped_contact_stores_and_dissipates_what_the_closed_form_says() -> None:
    table = ledger(PAIR, db.solve(PAIR, backend="scipy"))
    frame = table.to_pandas()
    stored, closing = _oscillator(PAIR.duration)
    relative = 0.5 * REDUCED * SPEED**2
    assert frame["contact"].tolist() == [0]
    assert frame["stored_J"][0] == pytest.approx(stored, rel=1e-6)
    most = max(_oscillator(time)[0] for time in np.linspace(0.0, PAIR.duration, 401).tolist())
    assert frame["most_stored_J"][0] == pytest.approx(most, rel=1e-6)
    lost = relative - stored - closing
    assert frame["dissipated_J"][0] == pytest.approx(lost, rel=1e-6)
    assert 0.0 < frame["dissipated_uncertainty_J"][0] < 1e-3 * lost
    # the motion of the centre of mass keeps its energy
    common = 0.5 * (MASS[0] * SPEED) ** 2 / sum(MASS)
    start, end = _numbers(table.notes, "kinetic energy at the start")
    assert start == pytest.approx(0.5 * MASS[0] * SPEED**2, rel=1e-8)
    assert end == pytest.approx(common + closing, rel=1e-6)
    assert abs(_numbers(table.notes, "balance")[0]) < 1e-6 * start
    assert table.provenance["backend"] == "scipy"
    assert "the run is by scipy" in table.notes


def test_drag_and_weight_take_what_flight_with_drag_says() -> None:
    # bodies that never meet: v = v0 exp(-b t), one kilogram at 2 m/s and two at 1 m/s
    scene = Scene(
        name="flight", duration=0.5, mass=(1.0, 2.0), stiffness=(1e9,), velocity=(2.0, 3.0), gap=(10.0,), drag=1.5,
        samples=200,
    )  # fmt: skip
    start = 0.5 * 4.0 + 9.0
    left = math.exp(-2.0 * 1.5 * 0.5)
    table = ledger(scene, db.solve(scene, backend="scipy"))
    assert _numbers(table.notes, "kinetic energy") == pytest.approx([start, start * left], rel=1e-8)
    work, drag = _numbers(table.notes, "work of the drive")
    assert (work, drag) == (0.0, pytest.approx(start * (1.0 - left), rel=1e-6))
    # without the drag the balance would change by nine tenths of the energy
    assert abs(_numbers(table.notes, "balance")[0]) < 1e-6 * start
    assert table.to_pandas()["dissipated_J"].tolist() == [0.0]
    # weight alone: the potential energy is what the kinetic energy gains
    fall = replace(scene, drag=0.0, gravity=10.0, velocity=(0.0, 0.0))
    notes = ledger(fall, db.solve(fall, backend="scipy")).notes
    assert _numbers(notes, "potential energy of weight")[0] == pytest.approx(-0.5 * 3.0 * (10.0 * 0.5) ** 2, rel=1e-8)
    assert _numbers(notes, "kinetic energy")[1] == pytest.approx(37.5, rel=1e-8)


def test_the_largest_change_of_the_balance_is_stated_whatever_its_sign() -> None:
    run = db.solve(PAIR, backend="scipy")
    # velocities that are too small: the energy of the end is 10 % lower than it should be
    slow = np.where(run.time < 1e-4, 1.0, math.sqrt(0.9))[:, None]
    start = 0.5 * MASS[0] * SPEED**2
    [change] = _numbers(ledger(PAIR, replace(run, velocity=slow * run.velocity)).notes, "balance")
    assert 0.03 * start < change < 0.2 * start


def test_what_lammps_reports_stands_beside_the_ledger() -> None:
    scene = replace(PAIR, damping=None)
    run = db.solve(scene, backend="verlet", dt=1e-8)
    kinetic = 0.5 * sum(m * v**2 for m, v in zip(MASS, run.velocity[-1].tolist(), strict=True))
    largest = 0.5 * MASS[0] * SPEED**2
    for potential, said in ((0.0, "granular styles report none, and no dissipation"), (2e-3, "the contacts store")):
        reported = replace(
            run, provenance={**run.provenance, "energies": [(0.0, 9.0, 9.0), (2e-4, potential, 0.9 * kinetic)]}
        )
        notes = ledger(scene, reported).notes
        [of_kinetic] = [note for note in notes if "thermo ke" in note]
        assert float(of_kinetic.split("difference ")[1].split()[0]) == pytest.approx(0.1 * kinetic / largest, rel=0.05)
        [of_potential] = [note for note in notes if "thermo pe" in note]
        assert said in of_potential
        assert f"{potential:.9g} J" in of_potential
    assert not any("thermo" in note for note in ledger(scene, run).notes)
