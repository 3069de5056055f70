"""Random scenes with every feature: no truth in extended precision lies outside of what the references state."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import reference, scipy_damped
from dem_bridge.errors import RunBroken
from dem_bridge.runs.uncertainty.from_replicas import looser_rule, replica_uncertainty
from tests.helpers.awkward_scenes import awkward
from tests.helpers.many_scenes import many
from tests.helpers.truths import QUANTITIES
from tests.runs.uncertainty.measure_bars import ALLOWED, OTHERS, REFERENCES, enough, summary, try_backend

#: linear chains in touch, whose references were wrong together by up to 1.4 uncertainties (of crossings and of peaks)
LINEAR = ("many-28", "many-58")
#: damped contacts with n < 2, of which the last digits of a time are more than the least overlap that is felt
LATE = ("awkward-41", "awkward-51", "awkward-365", "many-407", "many-1428", "many-5120")
#: contacts in touch at the start, of which some begin while others have just begun
TIES = ("many-472", "many-893")
#: scenes in which two looser runs of scipy agreed with it by chance (up to 2.6 uncertainties), and one in which runs at
#: all tolerances err alike: a body that gravity lets come near to touch, at a speed of which digits are lost (1.1)
ALIKE = ("many-1027", "many-3022", "awkward-266")


@pytest.mark.parametrize("name", LINEAR)
def test_the_first_motions_of_a_linear_chain_are_felt(name: str) -> None:
    pairs = [(scene, truth) for scene, truth in many() if scene.name == name]
    [trial] = try_backend("reference", pairs)
    assert max(trial.ratio.values()) <= 1.0


def test_a_damped_contact_may_end_as_late_as_the_last_digits_of_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = [pair for pair in (*awkward(), *many()) if pair[0].name in LATE]
    trials = try_backend("reference", pairs)
    assert len(trials) == len(LATE)
    assert max(max(trial.ratio.values()) for trial in trials) <= 1.0
    # planted: no digit is allowed for, and what the contact has left begins anew, without end
    monkeypatch.setattr(scipy_damped, "LAST_DIGITS", 0.0)
    assert len(try_backend("reference", pairs)) < len(LATE)


def test_runs_that_agree_by_chance_or_err_alike_are_not_all_that_scipy_is_compared_with() -> None:
    trials = try_backend("scipy", [pair for pair in (*awkward(), *many()) if pair[0].name in ALIKE])
    assert len(trials) == len(ALIKE)
    assert max(max(trial.ratio.values()) for trial in trials) <= 1.0


@pytest.mark.parametrize("name", TIES)
def test_contacts_of_one_moment_have_series_within_doubles(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = [pair for pair in many() if pair[0].name == name]
    [trial] = try_backend("reference", pairs)
    assert max(trial.ratio.values()) <= 1.0
    # planted: one unit of time for all
    monkeypatch.setattr(reference, "time_unit", lambda *scales: 1.0)
    with pytest.raises(RunBroken, match="take backend='scipy'"):
        db.solve(pairs[0][0], backend="reference")


def test_contacts_of_an_ill_conditioned_chain_are_as_uncertain_as_its_velocities() -> None:
    # precompressed, n = 3.52: a last digit of the speeds can move the peaks of all runs alike, by 2.5e-12, and the
    # crossings by 2.8e-12
    [(scene, truth)] = [(scene, truth) for scene, truth in many() if scene.name == "many-117"]
    run = db.solve(scene, backend="scipy")
    assert max(truth.outside(run, quantity) for quantity in QUANTITIES) <= 1.0
    # planted: that error in all runs, while their velocities differ by 4e-12
    wrong: Any = {name: truth.values[name] * (1.0 + 2.8e-12) for name in ("peak_force", "crossing_time")}
    run, rule = replace(run, **wrong), looser_rule(scene)
    other = replace(run, velocity=run.velocity * (1.0 + 4e-12))
    switches: Any = {"peak_force": "peaks_follow_velocities", "crossing_time": "crossings_follow_velocities"}
    for quantity, switch in switches.items():
        for each, inside in ((rule, True), (replace(rule, **{switch: False}), False)):
            stated = replica_uncertainty(run, [other, other], each)
            assert (truth.outside(replace(run, uncertainty=stated), quantity) <= 1.0) is inside


def test_a_damping_force_that_is_largest_at_touch_is_less_the_adhesion() -> None:
    # the peak of its fourth contact was larger by the pull-off, 29 uncertainties
    [trial] = try_backend("verlet", [pair for pair in many() if pair[0].name == "many-413"])
    assert max(trial.ratio.values()) <= 1.0


def test_a_finite_uncertainty_of_what_does_not_exist_is_outside() -> None:
    scene, truth = next(pair for pair in many() if not np.isnan(pair[1].values["crossing_time"]).any())
    run = db.solve(scene, backend="verlet")
    for quantity in QUANTITIES:
        assert truth.outside(run, quantity) <= 1.0
        narrow: Any = 1e-12 * np.asarray(run.uncertainty[quantity])
        assert truth.outside(replace(run, uncertainty=replace(run.uncertainty, **{quantity: narrow})), quantity) > 1.0
    wide = replace(run, uncertainty=replace(run.uncertainty, velocity=2.0 * run.uncertainty.velocity))
    assert truth.width(wide, "velocity") == 2.0 * truth.width(run, "velocity") > 2.0
    lost = replace(run, crossing_time=np.full(scene.n_contact, np.nan))
    assert truth.outside(lost, "crossing_time") == np.inf
    unknown = replace(lost, uncertainty=replace(run.uncertainty, crossing_time=np.full(scene.n_contact, np.inf)))
    assert truth.outside(unknown, "crossing_time") == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", [*REFERENCES, *OTHERS])
def test_the_uncertainties_hold_on_all_scenes(name: str) -> None:
    trials = try_backend(name, many() if name in REFERENCES else many()[:300])
    assert enough(trials, 0.0 if name in REFERENCES else ALLOWED), summary(trials)
