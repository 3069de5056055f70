"""Runs are compared with the proved motion of their scene, where the checkout has a certificate of it."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification import proved
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.page import verification_files
from dem_bridge.verification.proved import COLUMNS, largest_proved_error, proved_motion, proved_sentence, proved_table
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import assign_roles
from dem_bridge.verification.verification import verification_of

PAIR = Scene(
    name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), gap=(1e-6,), samples=20
)
#: how far the certificate is off, m/s, m, N and s, and its radii
OFF = {"velocity": 3e-3, "displacement": 2e-7, "peak_force": 0.5, "crossing_time": 4e-8}
RADIUS = {"velocity": 1e-5, "displacement": 1e-9, "peak_force": 0.25, "crossing_time": 1e-9}


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proved, "FOLDER", tmp_path)


def certificate(run: Trajectory, *, every: int = 1, until: int = 20, **changes: Any) -> dict[str, Any]:
    """Return a certificate of every so many samples of the pair up to one, which differs from a run by ``OFF``."""

    def ball(value: float, quantity: str) -> list[str]:
        return [f"{Fraction(value) + Fraction(OFF[quantity])}", f"{RADIUS[quantity]:e}"]

    rows = {
        name: [[ball(value, name) for value in row] for row in getattr(run, name)[: until + 1 : every].tolist()]
        for name in ("velocity", "displacement")
    }
    # the overlap at which the force is larger by OFF, with the radius that it has by the slope of the force
    overlap = ((float(run.peak_force[0]) + OFF["peak_force"]) / 4e9) ** (1 / 1.5)
    slope = 1.5 * 4e9 * overlap**0.5
    scene = replace(PAIR, samples=PAIR.samples // every)
    document = {
        "schema": "dem-bridge/proof/1",
        "scene": {"name": PAIR.name, "hash": scene.content_hash, "count": scene.samples},
        "samples": rows,
        "peaks": [{"overlap": [f"{overlap:.20e}", f"{RADIUS['peak_force'] / slope:.20e}"], "at": "0"}],
        "crossings": [ball(float(run.crossing_time[0]), "crossing_time")],
        "proved_until": str(Fraction(PAIR.duration) * until / PAIR.samples),
    }
    return document | changes


def written(document: dict[str, Any], folder: Path) -> Path:
    """Write a certificate; each test has its own folder, and a certificate is read once."""
    digest = hashlib.sha256(json.dumps(document, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
    (folder / "pair.json").write_text(json.dumps(document | {"digest": digest}))
    return folder / "pair.json"


def study(run: Trajectory) -> SceneStudy:
    roles = assign_roles(PAIR)
    results = [
        Result(
            case=Case(scene=PAIR, backend=name, resolution=Resolution(), sampling=Sampling(count=20)), trajectory=run
        )
        for name in (REFERENCE, roles.engine)
    ]
    return SceneStudy(roles=roles, others=tuple(results), verdicts=())


@pytest.mark.parametrize("every", [1, 4])
def test_differences_are_bounds_relative_to_the_proved_values(tmp_path: Path, every: int) -> None:
    run = db.solve(PAIR, backend=REFERENCE)
    written(certificate(run, every=every), tmp_path)
    motion = proved_motion(PAIR)
    assert motion is not None
    assert (motion.stride, motion.until, list(motion.values)) == (every, PAIR.duration, list(OFF))
    for quantity, off in OFF.items():
        values = getattr(run, quantity)[::every] if quantity in ("velocity", "displacement") else getattr(run, quantity)
        scale = float(np.abs(values + off).max())
        # the force grows with the power 3/2 of the overlap, by less than 1e-3 of its radius more than by its slope
        np.testing.assert_allclose(motion.difference(quantity, run), (off + RADIUS[quantity]) / scale, rtol=1e-3)
        stated = float(np.max(run.uncertainty[quantity]))
        np.testing.assert_allclose(motion.uncertainty(quantity, run), stated / scale, rtol=1e-6)


def test_a_table_and_a_sentence_say_what_is_proved_and_the_report_has_the_certificate(tmp_path: Path) -> None:
    run = db.solve(PAIR, backend=REFERENCE)
    file = written(certificate(run), tmp_path)
    of_pair = study(run)
    table = proved_table([of_pair])
    assert table is not None
    assert table.columns == COLUMNS
    assert [row[1] for row in table.rows] == ["velocity", "displacement", "peak force", "crossing time"]
    sentence = proved_sentence(of_pair)
    assert sentence.startswith("LAMMPS minus the proved trajectory: at most 3.7e-03 of the largest velocity (proved up")
    # 3e-3 m/s of 0.803 m/s
    assert largest_proved_error([of_pair]) == pytest.approx(3.7e-3, rel=2e-2)
    assert math.isnan(largest_proved_error([]))
    files = verification_files(verification_of([of_pair], accuracy=5e-6, wall=1.0))
    assert files["proofs/pair.json"] == file.read_bytes()
    page = str(files["index.html"])
    assert 'href="proofs/pair.json"' in page
    assert "Differences from proved trajectories" in page


def test_a_proof_that_ends_early_has_its_samples_and_no_peak_force(tmp_path: Path) -> None:
    run = db.solve(PAIR, backend=REFERENCE)
    written(certificate(run, until=12), tmp_path)
    motion = proved_motion(PAIR)
    assert motion is not None
    assert list(motion.values) == ["velocity", "displacement", "crossing_time"]
    assert math.isnan(largest_proved_error([study(run)]))
    # what differs later does not count
    later = np.array(run.velocity)
    later[13:] += 0.1
    differs = motion.difference("velocity", replace(run, velocity=later))
    assert differs == motion.difference("velocity", run)
    later[12] += 0.1
    assert motion.difference("velocity", replace(run, velocity=later)) > differs + 0.1


def test_what_is_not_established_is_left_out_and_what_a_run_lacks_is_not(tmp_path: Path) -> None:
    run = db.solve(PAIR, backend=REFERENCE)
    written(certificate(run, peaks=[None], crossings=["none"]), tmp_path)
    motion = proved_motion(PAIR)
    assert motion is not None
    assert [motion.difference(name, run) for name in ("peak_force", "crossing_time")] == [0.0, 0.0]
    proved._read.cache_clear()
    written(certificate(run), tmp_path)
    motion = proved_motion(PAIR)
    assert motion is not None
    without = replace(run, crossing_time=np.array([np.nan]))
    assert motion.difference("crossing_time", without) == np.inf


def test_other_scenes_and_damaged_files_have_no_proof(tmp_path: Path) -> None:
    run = db.solve(PAIR, backend=REFERENCE)
    of_pair = study(run)
    assert (proved_motion(PAIR), proved_table([of_pair]), proved_sentence(of_pair)) == (None, None, "")
    proved._read.cache_clear()
    file = written(certificate(run, every=4), tmp_path)
    assert proved_motion(PAIR) is not None
    for other in ({"gravity": 9.81}, {"mass": (8e-3, 1.0000001e-2)}, {"samples": 6}, {"duration": 1.1e-4}):
        assert proved_motion(replace(PAIR, **other)) is None
    assert proved_motion(replace(PAIR, samples=10)) is not None
    for text in ("", "{}", file.read_text().replace('"proved_until": "', '"proved_until": "1')):
        proved._read.cache_clear()
        file.write_text(text)
        assert proved_motion(PAIR) is None


@pytest.mark.parametrize(("name", "within"), [("accelerating-40", "6e-15"), ("decelerating-40", "8e-14")])
def test_the_certificates_of_the_paper_s_chains_cover_them(
    name: str, within: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(__file__).parents[2]
    monkeypatch.setattr(proved, "FOLDER", root / "reports" / "proofs")
    scene = db.load_scene(name)
    motion = proved_motion(scene)
    assert motion is not None
    assert motion.until == scene.duration
    run = db.solve(scene, backend=REFERENCE)
    for quantity in motion.values:
        assert motion.difference(quantity, run) <= motion.uncertainty(quantity, run) + 1e-15
    # the last digits of the reference are those of the processor; the pages have those of one
    assert motion.difference("velocity", run) < 1e-13
    with (root / "reports/paper/tables/proved.csv").open(encoding="utf-8", newline="") as file:
        [row] = [row for row in csv.DictReader(file) if (row["scene"], row["quantity"]) == (name, "velocity")]
    pages = [" ".join((root / page).read_text(encoding="utf-8").split()) for page in ("README.md", "docs/paper.md")]
    said = f"LAMMPS minus the proved trajectory is at most {float(row['LAMMPS - proved']):.1e} of the largest velocity"
    assert all(said in text for text in pages)
    assert "the reference less than 1e-13" in pages[0]
    assert float(row["reference - proved"]) <= float(within)
    assert f"within {within}" in pages[1]
