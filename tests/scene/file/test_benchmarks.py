"""The shipped benchmarks of the field give the values of the literature."""

from __future__ import annotations

import json
import re
from functools import cache
from importlib import resources
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.trajectory.trajectory import Trajectory

FOLDER = resources.files("dem_bridge").joinpath("scenes", "benchmarks")
VALUES = json.loads(FOLDER.joinpath("literature.json").read_text(encoding="utf-8"))
SCENES = Path(__file__).parents[3].joinpath("docs", "scenes.md").read_text(encoding="utf-8")


@cache
def _run(name: str) -> Trajectory:
    scene = db.load_scene(name)
    samples = 12_000 if scene.n_body > 2 else None  # peaks of velocity are read from samples
    return db.solve(scene, backend="scipy" if scene.damped else "reference", samples=samples)


def _measured(name: str, key: str) -> float:
    """Return a value of the literature's table as measured by the run of the most accurate backend."""
    run, contacts = _run(name), db.load_scene(name).contacts
    if key == "peak_force_N":
        return float(run.peak_force[0])
    if key == "peak_overlap_um":
        return 1e6 * float((run.peak_force[0] / contacts.stiffness[0]) ** (1.0 / (contacts.exponent[0] - 1.0)))
    if key == "contact_time_us":  # the peak is at half of it without dissipation
        return 2e6 * float(run.crossing_time[0])
    if key == "restitution":
        return run.restitution
    # every second body is heavy, the striker is the first of them; the wave has settled at the 20th to 25th
    return float(run.velocity.max(axis=0)[40:51:2].mean() / run.velocity[0, 0])


@pytest.mark.parametrize(("name", "key"), [(name, key) for name in VALUES for key in VALUES[name] if key != "source"])
def test_a_benchmark_has_the_value_of_the_literature(name: str, key: str) -> None:
    stated = VALUES[name][key]
    digits = 10.0 ** -len(repr(stated).split(".")[1])  # one unit of the last digit that is stated
    assert _measured(name, key) == pytest.approx(stated, abs=0.51 * digits)


def test_a_value_of_the_wrong_wall_is_caught() -> None:
    """A plane of the same material halves the modulus: the peak force falls by 2^(-2/5)."""
    force = _measured("lammps-hertz-wall", "peak_force_N")
    assert force == pytest.approx(VALUES["chung-ooi-3-cast-iron"]["peak_force_N"] * 2.0**-0.4, rel=1e-8)


def test_every_benchmark_is_in_the_table_of_the_docs() -> None:
    listed = re.findall(r"^\| `([a-z0-9-]+)`", SCENES, re.MULTILINE)
    assert sorted(listed) == sorted(db.shipped_scenes("benchmark"))
    counted = re.search(r"^(\d+) benchmarks of the field", SCENES, re.MULTILINE)
    assert counted is not None
    assert int(counted[1]) == len(listed)
