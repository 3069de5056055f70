"""Numbers of the claims beside those of a script that shares no code with the package."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dem_bridge.observables.fits import force_exponent
from dem_bridge.observables.pulse import pulse_width_by_force, secondary_fronts, speed_ratio
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.studies.paper.runs import LONG, MAIN, Runs
from dem_bridge.studies.paper.theories import deviation
from dem_bridge.studies.paper.validity import contact_validity
from tests.studies.paper.conftest import planted, truth_of

FOLDER = Path(__file__).parents[3] / "reports" / "independent"
#: twice the step moves the script's numbers by at most 2e-6; those of the package are known to 1e-9
WITHIN = 4e-6


@pytest.fixture(scope="module")
def recomputed() -> dict[str, float]:
    """Return the committed numbers of the script by their names."""
    numbers = json.loads((FOLDER / "claims.json").read_text(encoding="utf-8"))["numbers"]
    assert len({item["name"] for item in numbers}) == len(numbers)
    return {item["name"]: item["value"] for item in numbers}


def _of_package(runs: Runs) -> dict[str, float]:
    """Return the numbers of the package that the script has, by the script's names."""
    result = {}
    for name in MAIN:
        scene, truth, theory = runs.scenes[name], truth_of(runs, name), runs.run(name, "bca")
        assert theory is not None
        off = deviation("residence time", scene, theory, truth)
        result[f"largest deviation of T_i, {name}"] = off[np.argmax(np.abs(off))]
        arrivals = [OBSERVABLES["arrival_at_end"].value(scene, run) for run in (theory, truth)]
        result[f"with T_0, {name}"] = float(arrivals[0] / arrivals[1] - 1.0)
        result[f"V_out/V_in from 3 to 38, {name}"] = speed_ratio(scene, truth).ratio
        contacts = [contact_validity(scene, truth, k) for k in range(40)]
        ellipse, _, tension, crossings, _ = zip(*(contact.judged for contact in contacts), strict=True)
        result[f"contacts below ten crossings, {name}"] = sum(not item.holds for item in crossings)
        result[f"fewest crossings, {name}"] = min(item.ratio for item in crossings)
        result[f"contacts above the strength, {name}"] = sum(not item.holds for item in tension)
        result[f"largest tension over strength, {name}"] = max(item.ratio for item in tension)
        result[f"longest ellipse, {name}"] = max(item.ratio for item in ellipse)
        for body in (10, 20, 30):
            result[f"further pulses at cylinder {body}, {name}"] = secondary_fronts(scene, truth, body).count
    for name in LONG:
        fit, way = force_exponent(runs.scenes[name], truth_of(runs, name)), name.split("-")[0]
        for key, value in (("whole", fit.slope), ("least", fit.spread[0]), ("largest", fit.spread[1])):
            result[f"exponent, {key}, {way}"] = value
    name = "tapered-forward"
    scene, truth = runs.scenes[name], truth_of(runs, name)
    velocity = OBSERVABLES["peak_velocity"].value(scene, truth)
    result["kinetic energy of one sphere kept, 2 %"] = float(
        scene.mass[36] * velocity[36] ** 2 / (scene.mass[10] * velocity[10] ** 2)
    )
    width, times = pulse_width_by_force(scene, truth), truth.crossing_time
    result["width, 2 %"] = float((width.fall[20] - width.rise[20]) / (0.5 * (times[21] - times[19])))
    return result


def _disagreements(package: dict[str, float], recomputed: dict[str, float]) -> set[str]:
    return {name for name, value in package.items() if not abs(value - recomputed[name]) <= WITHIN * abs(value)}


def test_the_package_has_the_numbers_of_the_script(runs: Runs, recomputed: dict[str, float]) -> None:
    package = _of_package(runs)
    assert len(package) > 25
    assert _disagreements(package, recomputed) == set()


FAULTS: dict[str, tuple[Callable[[Runs], Runs], str]] = {
    "a late crossing": (
        lambda runs: planted(
            runs, MAIN[0], crossing_time=truth_of(runs, MAIN[0]).crossing_time + 1e-8 * (np.arange(40) == 37)
        ),
        f"V_out/V_in from 3 to 38, {MAIN[0]}",
    ),
    "large forces": (
        lambda runs: planted(runs, MAIN[1], peak_force=1.0001 * truth_of(runs, MAIN[1]).peak_force),
        f"largest tension over strength, {MAIN[1]}",
    ),
    "fast bodies": (
        lambda runs: planted(
            runs,
            "tapered-forward",
            velocity=truth_of(runs, "tapered-forward").velocity * (1.0 + 1e-4 * (np.arange(41) == 36)),
        ),
        "kinetic energy of one sphere kept, 2 %",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_disagrees_with_the_script(fault: str, runs: Runs, recomputed: dict[str, float]) -> None:
    plant, name = FAULTS[fault]
    assert name in _disagreements(_of_package(plant(runs)), recomputed)


def test_the_script_imports_nothing_of_the_package() -> None:
    lines = (FOLDER / "recompute_claims.py").read_text(encoding="utf-8").splitlines()
    imported = {line.split()[1].split(".")[0] for line in lines if line.startswith(("import ", "from "))}
    outside = imported - set(sys.stdlib_module_names)
    assert outside == {"numpy", "scipy"}


@pytest.mark.slow
def test_the_script_repeats_its_committed_numbers(tmp_path: Path, recomputed: dict[str, float]) -> None:
    subprocess.run([sys.executable, FOLDER / "recompute_claims.py", tmp_path / "claims.json"], check=True, timeout=300)
    result = json.loads((tmp_path / "claims.json").read_text(encoding="utf-8"))
    # all sums are in a fixed order, so that only libraries and processors may change last digits
    assert {item["name"]: item["value"] for item in result["numbers"]} == pytest.approx(recomputed, rel=1e-8, abs=1e-11)
    # located events would reach 1e-12; DOP853 through openings and closings does not
    assert result["checks"]["velocity, largest difference from DOP853, relative"] < 1e-7
    assert result["checks"]["momentum, largest change, relative"] < 1e-13
