"""The stability study of made-up limits: each sentence, table, figure and verdict has the numbers that it should."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.lammps_motion import granular
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.stability import parts, points, step_limits
from dem_bridge.studies.stability import study as stability
from dem_bridge.studies.stability.points import Measured, Trap, chain, engine_on
from dem_bridge.studies.stability.step_limits import Limit
from dem_bridge.studies.stability.study import study_stability
from tests.helpers.export_chains import PAIR
from tests.helpers.export_runs import made_up

SCENE = chain("three", (1e-2,) * 3, (4e9,) * 2)
#: rad/s of one contact and of all, largest stable step for a growth of 1, in s
PAIR_MODE, MODE, STABLE = 1e6, 2e6, 1.25e-6


def _measured(scene: Scene) -> Measured:
    """Return a scene with made-up frequencies."""
    return Measured(scene=scene, truth=made_up(PAIR), pair=PAIR_MODE, mode=MODE, deepest=1e-6, scale=1.0)


def _made_up_limits(monkeypatch: pytest.MonkeyPatch, *, engine: float) -> None:
    """Let LAMMPS have ``engine`` times the limit of the twin, which falls by a tenth for each decade of less growth."""

    def lammps(*_: Any) -> Any:
        raise AssertionError("nothing is run")

    def stable_step(stepper: Any, scene: Scene, *, allowed: float, **_: Any) -> tuple[Limit, float]:
        good = STABLE * (1.0 + 0.1 * math.log10(allowed)) * (engine if stepper is lammps else 1.0)
        return Limit(good=good, bad=1.01 * good, window=math.nan), 0.5

    def accurate_step(*_: Any, stable: float, accuracy: float, **__: Any) -> Limit:
        return Limit(good=stable * math.sqrt(accuracy), bad=stable, window=math.nan)

    def trap_of(result: Measured, stepper: Any, backend: str, dt: float) -> Trap:
        return Trap(backend=backend, dt=dt, velocity=dt * 1e5, last=dt * 1e4, momentum=1e-15, kinetic=1e-6, energy=0.0)

    monkeypatch.setattr(stability, "families", lambda count: points.families(count)[::3])
    monkeypatch.setattr(parts, "measured", _measured)
    monkeypatch.setattr(parts.Settings, "unavailable_reason", lambda _: "")
    monkeypatch.setattr(parts, "engine_on", lambda scene, _: lammps if engine else None)
    monkeypatch.setattr(points, "stable_step", stable_step)
    monkeypatch.setattr(step_limits, "accurate_step", accurate_step)
    monkeypatch.setattr(parts, "trap_of", trap_of)
    monkeypatch.setattr(parts, "gain_map", lambda _, steps, phases: np.full((len(phases), len(steps)), 0.25))


def test_every_part_of_a_whole_study_has_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    _made_up_limits(monkeypatch, engine=1.004)
    labels: list[str] = []
    study = study_stability(SCENE, points=2, progress=lambda done, total, label: labels.append(label))
    assert labels == ["LAMMPS", "speed = 0.001", "speed = 100", "angle = 0.1", "angle = 90", "three", "thresholds",
                      "trap"]  # fmt: skip
    limits, thresholds, traps = study.tables
    row = dict(zip(limits.columns, limits.rows[-1], strict=True))
    assert (row["varied"], row["stable, twin (s)"], row["LAMMPS / twin"]) == ("three", STABLE, pytest.approx(1.004))
    assert row["stable / (2/omega, contact)"] == pytest.approx(0.625)
    assert row["stable / (2/omega, mode)"] == pytest.approx(1.25)
    assert row["stable / accurate to 0.01"] == pytest.approx(10.0)
    assert [cells[1:3] for cells in thresholds.rows[-4:]] == [
        (0.01, pytest.approx(2.0)), (0.1, pytest.approx(2.25)), (1.0, pytest.approx(2.5)), (10.0, pytest.approx(2.75))
    ]  # fmt: skip
    assert [cells[:2] for cells in traps.rows] == [
        (name, dt) for dt in (2e-7, 3e-7, 6e-7, 1e-6) for name in ("verlet", "lammps-granular")
    ]
    assert [figure.id for figure in study.figures] == ["stability-limits", "stability-gain", "stability-trap"]
    assert [len(figure.panels) for figure in study.figures] == [2, 2, 1]
    assert (len(study.verdicts), study.exit_code, study.interrupted) == (5, 0, False)
    told = " ".join(study.answer)
    for part in (
        "On three velocity-Verlet is stable up to dt = 1.25e-06 s (LAMMPS: 1.26e-06 s). This is 1.25 times 2/omega of",
        "Velocities are accurate to 0.01 up to dt = 1.25e-07 s and to 0.0001 up to 1.25e-08 s, which is 10 and 100",
        "from dt = 2e-07 to 1e-06 s the velocity error is 2 to 10 % of the largest velocity (0.2 to 1 % at the end of",
        "momentum changes by at most 1e-15 of its own and the error of the final kinetic energy is at most 1e-06.",
        "On 4 small scenes of 2 families the limit is 1.25 to 1.25 times 2/omega of the highest mode and 0.62 to 0.62",
        "The limits of LAMMPS and of the twin differ by at most 0.4 % on 5 scenes; the search resolves",
        "omega dt at the limit is 1.25 from 0.001 to 100 m/s, with a relative spread of 0e+00.",
        "at 0.1 degrees and",
        "on three, omega dt of the highest mode at the limit is 2.00 for a growth of 0.01 and 2.75 for 10; this study",
    ):
        assert part in told, part


def test_another_limit_of_lammps_fails_and_a_scene_without_it_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    _made_up_limits(monkeypatch, engine=1.02)
    study = study_stability(SCENE, points=2)
    assert [verdict.outcome for verdict in study.verdicts] == [Outcome.FAIL] * 5
    assert study.exit_code == 1
    _made_up_limits(monkeypatch, engine=0.0)
    study = study_stability(replace(SCENE, exponent=3.0), points=2)
    assert study.verdicts == ()
    assert any(note.startswith("LAMMPS was not run on three: ") for note in study.notes)
    assert {cells[0] for cells in study.tables[2].rows} == {"verlet"}


def test_a_scene_that_granular_cannot_express_has_no_engine() -> None:
    with granular(Engine()) as lammps:
        assert engine_on(_measured(replace(SCENE, exponent=3.0)), lammps) is None
