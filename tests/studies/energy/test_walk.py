"""The energy changes by the predicted jumps, and a faulty run does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.backends.base import AlwaysAvailable, Resolution, Sampling, backend
from dem_bridge.backends.verlet import Verlet
from dem_bridge.errors import UsageError
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.studies import energy_walk as walks
from dem_bridge.studies.energy import ALLOWED, CONTACT, STEP, study_energy, within_contact
from dem_bridge.studies.energy_walk import BEAD, BOX, Walk, long_run
from dem_bridge.trajectory.trajectory import Trajectory


@pytest.fixture(autouse=True)
def _short_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(walks, "ROWS", 10_000)


def _walk(code: str = "verlet", scene: Scene = BOX, step: float = STEP, contacts: int = 300) -> Walk:
    return long_run(backend(code), scene, Resolution(dt=step), contacts)


class Faulty(AlwaysAvailable):
    """Velocity-Verlet with a fault."""

    name = "verlet"
    supports = Verlet.supports

    def __init__(self, damping: float = 0.0, longer: int = 1) -> None:
        self.damping, self.longer = damping, longer

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        assert resolution.dt is not None
        damping = Damping(law="dashpot", coefficient=self.damping) if self.damping else None
        # each of its samples is as far as two
        slower = replace(scene, damping=damping, duration=self.longer * scene.duration)
        return backend("verlet").run(slower, Resolution(dt=self.longer * resolution.dt), sampling)


@pytest.mark.parametrize("code", ["verlet", "blanes-moan"])
def test_the_predicted_jumps_explain_the_changes_of_energy_the_better_the_smaller_the_step(code: str) -> None:
    step = {"verlet": STEP, "blanes-moan": 6.0 * STEP}[code]
    coarse, fine = (_walk(code, step=part * step) for part in (1.0, 0.5))
    assert coarse.unexplained < ALLOWED * step / CONTACT
    assert fine.unexplained < ALLOWED * 0.5 * step / CONTACT
    # jumps go as step^2.5; 300 contacts at different phases have a size that is known to some 6 % each
    assert fine.rms()[0] / coarse.rms()[0] == pytest.approx(2.0**-2.5, rel=0.25)


@pytest.mark.parametrize("fault", [Faulty(damping=0.01), Faulty(longer=2)], ids=["damping", "step"])
def test_a_faulty_run_is_not_explained(fault: Faulty) -> None:
    walk = long_run(fault, BOX, Resolution(dt=STEP), 300)
    assert walk.unexplained > 5.0 * ALLOWED * STEP / CONTACT


def test_a_run_in_pieces_is_the_run_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    pieces = _walk(contacts=150)
    monkeypatch.setattr(walks, "ROWS", 40_000)
    whole = _walk(contacts=150)
    count = min(len(pieces.error), len(whole.error))
    assert count > 80
    assert np.array_equal(pieces.contacts[:count], whole.contacts[:count])
    # overlaps are restarted to the last digit of a displacement, 1e-16; the motion magnifies that by 1e6 at most
    np.testing.assert_allclose(pieces.error[:count], whole.error[:count], atol=1e-9)


def test_one_bead_meets_the_walls_regularly_and_its_energy_does_not_drift() -> None:
    walk = _walk(scene=BEAD, contacts=400)
    # no other contact accelerates it at touch: the next terms are smaller by (step / contact time)^2
    assert walk.unexplained < (STEP / CONTACT) ** 2
    assert np.max(np.abs(walk.error)) < 0.6 * walk.jump * np.sqrt(walk.contacts[-1])


def test_within_a_contact_the_second_term_explains_the_energy_and_half_of_it_does_not() -> None:
    _, measured, predicted = within_contact()
    # the next term of the modified energy is smaller by (omega h)^2 = (5e4 1e-6)^2
    assert np.max(np.abs(measured - predicted)) < 2.5e-3 * np.max(np.abs(measured))
    assert np.max(np.abs(measured - 0.5 * predicted)) > 0.4 * np.max(np.abs(measured))


def test_a_run_whose_energy_doubles_ends_there() -> None:
    walk = long_run(backend("ode45"), BOX, Resolution(rtol=1e-3, atol=1e-6), 100_000)
    assert walk.contacts[-1] < 10_000
    assert 0.5 < np.max(np.abs(walk.error)) <= 1.0
    assert np.all(np.diff(walk.contacts) >= 0)


def test_a_fault_in_the_runs_is_a_failed_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    module = "dem_bridge.studies.energy.backend"
    monkeypatch.setattr(module, lambda name: Faulty(longer=2) if name == "verlet" else backend(name))
    study = study_energy(contacts=1000)
    outcomes = {verdict.backend: verdict.outcome for verdict in study.verdicts}
    assert outcomes == {"verlet": Outcome.FAIL, "blanes-moan": Outcome.PASS}


def test_a_number_of_contacts_out_of_range_is_refused() -> None:
    with pytest.raises(UsageError, match="contacts = 10; allowed: a whole number from 1000"):
        study_energy(contacts=10)
