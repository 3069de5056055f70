"""Times in another unit than the file states are a cause, and no refusal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.formats.readers.record import Record
from dem_bridge.judging.records import judge_records
from dem_bridge.scene.scene import Scene, Wall

BOX = Scene(
    name="box",
    duration=2e-4,
    mass=(0.01, 0.02, 0.015),
    stiffness=(2e10, 1e10),
    velocity=(0.8, 0.0, 0.0),
    wall_right=Wall(stiffness=1e10),
    samples=60,
)


def _record(factor: float) -> Record:
    run = db.solve(BOX, backend="reference", uncertainty=False)
    rounding = {"velocity": np.full(run.velocity.shape, 1e-13), "time": np.zeros(len(run.time))}
    return Record(
        name="run.csv",
        time=factor * run.time,
        values={"velocity": run.velocity},
        columns={"velocity": (0, 1, 2)},
        rounding=rounding,
        dt=None,
        recognised=(),
    )


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_times_in_another_unit_are_named(factor: float) -> None:
    judgement = judge_records(BOX, [_record(factor)])
    assert (judgement.cause, judgement.outcome) == ("units", "FAIL")
    assert judgement.alternative_causes == ["time-scale"]
    assert f"({factor:g} times SI)" in judgement.evidence
    assert judgement.error["velocity"]["value"] < 1e-11
    assert judge_records(BOX, [_record(factor)], tolerance=1e-3).outcome == "FAIL"


def test_times_of_a_longer_run_are_not_taken_for_another_unit() -> None:
    late = _record(1e3).values["velocity"] * np.linspace(1.0, 1.2, len(_record(1e3).time))[:, None]
    heavier = replace(_record(1e3), values={"velocity": late})
    judgement = judge_records(BOX, [heavier]) if heavier.time[1] < 20 * BOX.duration else None
    assert judgement is None or judgement.cause != "units"
