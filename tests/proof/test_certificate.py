"""A certificate keeps what is proved: it goes on where it ended, refuses damage, and holds exact numbers."""

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.proof.certificate import digest_of, document_of, read_record, read_samples, write_document
from dem_bridge.proof.checker import check_proof
from dem_bridge.proof.checker_file import read_certificate, signs_in
from dem_bridge.proof.problem import measure_scale, problem_of
from dem_bridge.proof.producer import Record, prove_from

pytest.importorskip("flint")

PAIR = db.Scene(
    name="pair", duration=1.5e-4, mass=(8.1e-3, 1e-2), stiffness=(3.98e9,), velocity=(0.8, 0.0), gap=1e-6, samples=40
)


def test_a_proof_that_was_interrupted_goes_on(tmp_path: Path) -> None:
    file, whole = tmp_path / "pair.json", db.prove(PAIR)
    problem, scale = problem_of(PAIR), measure_scale(PAIR)

    def keep(record: Record) -> None:
        write_document(document_of(PAIR, problem, record), file)
        if len(record.checkpoints) == 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        prove_from(problem, scale, Record(bits=whole.certificate["bits"]), 16, keep)
    part = json.loads(file.read_text())
    assert 0.0 < float(Fraction(part["proved_until"])) < PAIR.duration
    again = db.prove(PAIR, file=file)
    assert again.complete
    assert again.certificate["checkpoints"] == whole.certificate["checkpoints"]
    assert again.certificate["touches"] == whole.certificate["touches"]
    assert again.crossing_time.tolist() == whole.crossing_time.tolist()
    for name in ("displacement", "velocity"):  # the samples before the interruption keep their digits
        unit = Fraction(10) ** whole.certificate["samples"]["power"][name]
        rows = (read_samples(proof.certificate["samples"], name) for proof in (again, whole))
        for row, of_whole in zip(*rows, strict=True):
            for (middle, radius), (other, _) in zip(row, of_whole, strict=True):
                assert radius <= unit
                assert abs(middle - other) <= 2 * unit
    np.testing.assert_allclose(again.peak_force, whole.peak_force, rtol=1e-15)
    assert json.loads(file.read_text())["digest"] == digest_of(again.certificate)


def test_samples_are_rounded_outwards() -> None:
    proof = db.prove(PAIR)
    exact = problem_of(PAIR)
    record = Record(bits=proof.certificate["bits"])
    prove_from(exact, measure_scale(PAIR), record, 16)
    for name in ("displacement", "velocity"):
        for row, box in zip(read_samples(proof.certificate["samples"], name), record.samples, strict=True):
            for wide, (middle, radius) in zip(row, getattr(box, name), strict=True):
                assert abs(wide[0] - middle) + radius <= wide[1]
                assert wide[1] <= Fraction(8, 10**17)


def test_whole_numbers_of_samples_have_the_power_of_ten_of_the_file(tmp_path: Path) -> None:
    document = json.loads(json.dumps(db.prove(PAIR).certificate))
    samples = document["samples"]
    power = samples["power"]["velocity"]
    assert all("e" not in entry for row in samples["velocity"] for entry in row)
    write_document(document, tmp_path / "units.json")
    claims = read_certificate(tmp_path / "units.json")
    middle = claims.samples[-1].v[1].middle
    assert Fraction(int(middle.p), int(middle.q)) == int(samples["velocity"][-1][1]) * Fraction(10) ** power
    assert check_proof(tmp_path / "units.json", jobs=1).proved
    # as files were written before: each number has its own
    before = {"time": samples["time"]}
    for name in ("displacement", "velocity"):
        before[name] = [[f"{entry}e{samples['power'][name]}" for entry in row] for row in samples[name]]
    _rewritten(document | {"samples": before}, tmp_path / "before.json")
    assert read_certificate(tmp_path / "before.json").samples == claims.samples
    for wrong in (power - 1, power + 1):
        changed = samples | {"power": samples["power"] | {"velocity": wrong}}
        _rewritten(document | {"samples": changed}, tmp_path / "wrong.json")
        assert not check_proof(tmp_path / "wrong.json", jobs=1).proved
    for wrong in ("-17", None, {"velocity": -17}, {"displacement": -20, "velocity": "-17"}):
        _rewritten(document | {"samples": samples | {"power": wrong}}, tmp_path / "wrong.json")
        assert "samples.power" in check_proof(tmp_path / "wrong.json", jobs=1).sentence


def _rewritten(document: dict[str, Any], path: Path) -> None:
    """Write a certificate whose digest is that of its content."""
    write_document(document | {"digest": digest_of(document)}, path)


def test_each_box_contains_the_motion_that_begins_in_the_one_before() -> None:
    proof = db.prove(PAIR)
    times = [Fraction(point["time"]) for point in proof.certificate["checkpoints"]]
    assert times == sorted(times)
    assert times[-1] == Fraction(PAIR.duration)
    assert len(times) > 20
    assert all(time.denominator & (time.denominator - 1) == 0 for time in times)


def test_damaged_and_foreign_certificates_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "pair.json"
    db.prove(PAIR, file=file)
    with pytest.raises(UsageError, match="it is of another scene, pair"):
        read_record(file, replace(PAIR, gap=2e-6))
    document = json.loads(file.read_text())
    document["touches"][0]["contact"] = 1
    file.write_text(json.dumps(document))
    with pytest.raises(UsageError, match="its digest or schema is wrong"):
        read_record(file, PAIR)
    with pytest.raises(UsageError, match="cannot be read"):
        read_record(tmp_path / "none.json", PAIR)


KEPT = sorted((Path(__file__).parents[2] / "reports" / "proofs").glob("*.json"))


@pytest.mark.parametrize("file", KEPT, ids=lambda file: file.stem)
def test_certificates_that_are_kept_are_whole(file: Path) -> None:
    document = json.loads(file.read_text())
    assert file.stat().st_size <= 2**20
    assert document["digest"] == digest_of(document)
    assert len(document["samples"]["time"]) == document["scene"]["count"] + 1
    assert float(Fraction(document["proved_until"])) == float.fromhex(document["scene"]["duration"])
    claims = read_certificate(file)
    for box in claims.boxes:
        signs_in(claims.chain, box)  # the flags "closed" are those of the box
    if document["scene"]["name"] in db.shipped_scenes():
        assert document["scene"]["hash"] == db.load_scene(document["scene"]["name"]).content_hash
