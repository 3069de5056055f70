"""Baselines: what is written is read again to the last digit, and what is not whole is refused by name."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.trajectory.trajectory import Cost, Trajectory, Uncertainty
from dem_bridge.verification.regression.baseline import (
    QUANTITIES,
    Accuracy,
    Baseline,
    RoundoffTolerance,
    baseline_of_text,
    read_baseline,
)

PROVENANCE = {
    "date": "2026-11-21",
    "package": "0.1.0",
    "scene_hash": "5" * 64,
    "source": "",
    "deck_hash": None,
    "lammps": None,
    "versions": {"numpy": "2.0"},
    "machine": "Linux x86_64",
    "solved_with": {"dt": 1e-7, "samples": 4},
}


def small(**changes: Any) -> Baseline:
    """Three bodies, five times, two contacts of which the second is never at its deepest."""
    rng = np.random.default_rng(7)
    velocity = rng.standard_normal((5, 3))
    uncertainty = {
        "velocity": 1e-5,
        "peak_force": np.array([1e-3, math.inf]),
        "crossing_time": np.array([1e-9, 0.0]),
    }
    run: dict[str, Any] = {
        "time": np.linspace(0.0, 3e-3, 5),
        "displacement": math.nan * velocity,
        "velocity": velocity,
        "contact_force": np.full((5, 2), math.nan),
        "peak_force": np.array([31.4, 15.9]),
        "crossing_time": np.array([1.25e-3, math.nan]),
        "cost": Cost(wall=math.nan, cpu=math.nan, steps=0, force_evaluations=0),
        "provenance": PROVENANCE,
    }
    run |= {name: changes.pop(name) for name in run if name in changes}
    estimate = Uncertainty(**({"displacement": math.inf} | changes.pop("uncertainty", uncertainty)))
    parts: dict[str, Any] = {
        "scene": "pair",
        "backend": "verlet",
        "provenance": PROVENANCE,
        "dt": 1e-7,
        "tolerance": 1e-3,
        "same_within": {name: RoundoffTolerance(value=1e-12, reason="its last digits") for name in QUANTITIES},
        "accuracy": {
            "velocity": Accuracy(error=1e-4, uncertainty=1e-12, tolerance=1e-3, outcome="PASS", by="reference")
        },
        "run": Trajectory(uncertainty=estimate, **run),
    }
    return Baseline(**(parts | changes))


def test_what_is_written_is_read_to_the_last_digit() -> None:
    made = small()
    found = baseline_of_text(made.text())
    for name in ("time", *QUANTITIES):
        np.testing.assert_array_equal(getattr(found.run, name), getattr(made.run, name))
    np.testing.assert_array_equal(found.run.uncertainty["peak_force"], made.run.uncertainty["peak_force"])
    assert found.text() == made.text()
    assert found.edited == ()


def test_a_line_is_a_body_or_a_contact() -> None:
    lines = small().text().splitlines()
    assert [json.loads(line.rstrip(","))["body"] for line in lines if '"body"' in line] == [0, 1, 2]
    assert [json.loads(line.rstrip(","))["contact"] for line in lines if '"contact"' in line] == [0, 1]


def _planted(change: Callable[[dict[str, Any]], object]) -> str:
    told = json.loads(small().text())
    change(told)
    return json.dumps(told)


def _swap(rows: list[Any], one: int, other: int) -> None:
    rows[one], rows[other] = rows[other], rows[one]


def _swap_velocities(told: dict[str, Any]) -> None:
    one, other = told["bodies"][0], told["bodies"][2]
    one["velocity"], other["velocity"] = other["velocity"], one["velocity"]


REFUSED: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "another schema": (lambda t: t.update(schema="dem-bridge/baseline/3"), "schema = 'dem-bridge/baseline/3'"),
    "unknown key": (lambda t: t.update(remark="mine"), "remark is unknown"),
    "unknown key within": (lambda t: t["settings"].update(rtol=1e-9), "settings.rtol is unknown"),
    "key left out": (lambda t: t.pop("digests"), "digests is missing"),
    "bodies reordered": (
        lambda t: _swap(t["bodies"], 0, 1),
        "bodies[0].body = 1; allowed: 0; lines are in another order",
    ),
    "contacts reordered": (lambda t: _swap(t["contacts"], 0, 1), "contacts[0].contact = 1"),
    "times reordered": (lambda t: _swap(t["time"], 1, 2), "time[2] = 0.00075 is not after time[1] = 0.0015"),
    "times uneven": (lambda t: t["time"].__setitem__(2, 0.00151), "time[2] = 0.00151; allowed: 4 equal steps"),
    "values in another order": (
        lambda t: _swap(t["bodies"][1]["velocity"], 1, 3),
        "the values of velocity are in another order than they were written",
    ),
    "values of other bodies": (_swap_velocities, "the values of velocity are in another order than they were written"),
    "a body cut off": (lambda t: t["bodies"].pop(), "bodies has 2 lines for counts.bodies = 3; the file is truncated"),
    "a contact cut off": (
        lambda t: t["contacts"].pop(),
        "contacts has 1 lines for counts.contacts = 2; the file is truncated",
    ),
    "a value cut off": (lambda t: t["bodies"][2]["velocity"].pop(), "bodies[2].velocity has 4 values for 5 times"),
    "a time cut off": (lambda t: t["time"].pop(), "time has 4 values for counts.times = 5"),
    "a value that is none": (lambda t: t["bodies"][1]["velocity"].__setitem__(2, None), "bodies[1].velocity[2] = None"),
    "a word for a number": (lambda t: t["contacts"][0].update(peak_force="31"), "peak_force = '31'"),
    "a list for an object": (lambda t: t.update(birth=[]), "birth = []"),
    "counts of another kind": (lambda t: t.update(bodies=3), "bodies = 3; allowed: a list"),
    "less than nothing": (lambda t: t["same_within"]["velocity"].update(value=-1.0), "same_within.velocity.value"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_whole_is_refused_by_name(name: str, tmp_path: Path) -> None:
    change, words = REFUSED[name]
    file = tmp_path / "pair.verlet.json"
    file.write_text(small().text())
    read_baseline(file)
    file.write_text(_planted(change))
    with pytest.raises(UsageError) as caught:
        read_baseline(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("part", [0.0, 0.3, 0.99])
def test_a_text_that_is_cut_short_is_refused_by_name(part: float, tmp_path: Path) -> None:
    text = small().text()
    file = tmp_path / "pair.verlet.json"
    file.write_text(text[: int(part * len(text))])
    with pytest.raises(UsageError, match=r"pair\.verlet\.json: the file is not JSON or is truncated"):
        read_baseline(file)


def test_a_baseline_under_another_name_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "other.verlet.json"
    file.write_text(small().text())
    with pytest.raises(
        UsageError, match=r"the file contains the baseline pair\.verlet\.json; allowed: a file of that name"
    ):
        read_baseline(file)


def test_a_changed_number_is_read_and_named() -> None:
    text = _planted(lambda told: told["contacts"][1].update(peak_force=15.8))
    assert baseline_of_text(text).edited == ("peak_force",)
