"""A pulse that passes between two samples of a long run is seen: the error does not depend on the length of the run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.judging.check.laboratory import Laboratory
from dem_bridge.judging.check.lammps_run import changing, spacing_of
from dem_bridge.judging.check.law import law_of
from dem_bridge.judging.check.step import step_of
from dem_bridge.judging.check.subject import Subject, subject_of
from dem_bridge.observables.verdict import Outcome
from tests.helpers.checked_decks import script

#: contact times of runs of one chain, in which the pulse lasts six
LENGTHS = (6.0, 360.0, 2400.0)


def subject(folder: Path, length: float, per_contact: float = 20.0) -> Subject:
    """Return a chain that was read, with another length of its run."""
    (folder / "in.chain").write_text(script(per_contact=per_contact, length=length))
    with subject_of(folder / "in.chain") as read:
        return read


def other_stiffness(read: Subject) -> Subject:
    """Return a script whose scene is stiffer than its law."""
    assert read.scene is not None
    return replace(read, scene=replace(read.scene, stiffness=tuple(1.01 * k for k in read.scene.stiffness)))


@pytest.mark.lammps
def test_the_error_does_not_depend_on_the_length_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    errors, sparse = [], []
    for length in LENGTHS:
        read = subject(tmp_path, length)
        errors.append(step_of(Laboratory(subject=read), 1e-2, law_is_right=True, lost=False).error)
        with monkeypatch.context() as old:  # samples evenly over the run, and no others
            old.setattr(Laboratory, "skips", False)
            sparse.append(step_of(Laboratory(subject=read), 1e-2, law_is_right=True, lost=False))
    assert errors == pytest.approx([errors[0]] * len(errors), rel=0.03)
    assert sparse[-1].error < 0.6 * errors[0]  # what was missed
    assert sparse[-1].outcome in (Outcome.UNDECIDED, Outcome.PASS)


@pytest.mark.lammps
def test_a_right_step_is_undecided_where_samples_miss_the_pulse(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Laboratory, "skips", False)
    lab = Laboratory(subject=subject(tmp_path, LENGTHS[-1]))
    seen = step_of(lab, 1e-2, law_is_right=True, lost=False).error
    found = step_of(lab, 1.5 * seen, law_is_right=True, lost=False)
    assert (lab.resolves, found.outcome) == (False, Outcome.UNDECIDED)
    assert "larger ones may be between them" in found.sentence
    assert step_of(lab, 2.5 * seen, law_is_right=True, lost=False).outcome is Outcome.PASS


@pytest.mark.lammps
def test_a_wrong_law_is_seen_in_a_long_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "dem_bridge.judging.check.law.cause_by_judge", lambda lab: ("stiffness-scale", "all are too stiff")
    )
    wrong = other_stiffness(subject(tmp_path, LENGTHS[-1]))
    assert law_of(Laboratory(subject=wrong)).outcome is Outcome.FAIL
    # a chain in touch ends with the same velocities whatever its stiffness: samples of the end show nothing
    monkeypatch.setattr(Laboratory, "skips", False)
    lab = Laboratory(subject=wrong)
    ends = lab.lammps().velocity[-1] - lab.reference.values["velocity"][-1]
    assert float(np.max(np.abs(ends))) < 1e-3


@pytest.mark.lammps
def test_bodies_that_the_pulse_passed_between_two_samples_have_moved(tmp_path: Path) -> None:
    (tmp_path / "in.chain").write_text(script(per_contact=20.0, bodies=12, length=LENGTHS[-1]))
    assert not any(entry["name"] == "end" for entry in db.check(tmp_path / "in.chain").plausibility)


@pytest.mark.lammps
def test_a_frozen_ball_and_a_mirrored_chain_have_their_samples(tmp_path: Path) -> None:
    frozen = "group clamp id 5\ngroup free id 1 2 3 4\nfix move free nve\nfix hold clamp freeze"
    back = "group last id 5\nvelocity last set -0.5 0 0 units box"
    for parts in ({"fixes": frozen}, {"start": back}):
        (tmp_path / "in.chain").write_text(script(per_contact=50.0, length=600.0, **parts))
        with subject_of(tmp_path / "in.chain") as read:
            lab = Laboratory(subject=read)
            law = law_of(lab)
        assert len(lab.lammps().active_steps) > 50
        assert (law.outcome, law.difference < 1e-9) == (Outcome.PASS, True), law.sentence


def test_samples_lie_where_velocities_change() -> None:
    time = np.linspace(0.0, 100.0, 4001)
    pulse = np.stack([1.0 / np.cosh(time - 50.0) ** 2, np.tanh(time - 20.0)], axis=1)
    rows = changing(pulse)
    assert 100 < len(rows) < 300
    assert np.max(np.abs(np.diff(pulse[rows], axis=0))) < 0.06
    assert np.max(pulse[rows], axis=0) == pytest.approx([1.0, 1.0], rel=0.02)


def test_frames_are_close_in_a_contact_and_few_in_a_long_run(tmp_path: Path) -> None:
    lab = Laboratory(subject=subject(tmp_path, 6.0, per_contact=400.0))
    assert lab.prescan is not None
    frequency, scene = lab.prescan.frequency, lab.scene
    short = spacing_of(scene, 1e-8, 10_000, 5, frequency)
    assert 0.05 < short.every * 1e-8 * frequency <= 0.1
    # the pulse is a small part of this run, so that its frames are as close
    assert spacing_of(scene, 1e-8, 40_000_000, 5, frequency).every <= 2 * short.every
    always = spacing_of(None, 1e-8, 400_000_000, 5, frequency)
    assert (always.resolves, always.every > short.every) == (False, True)
