"""The study of sensitivity: what it names, and the tolerance that it allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.ensembles.sensitivity import Indices
from dem_bridge.errors import UsageError
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.sensitivity import sentence_on_largest, sentences_on_sum, study_sensitivity

THREE = Scene(name="three", duration=1.5e-4, mass=(0.01, 0.015, 0.02), stiffness=(2e10, 1e10), velocity=(0.8, 0.0, 0.0))


def test_the_study_names_what_matters_and_the_tolerance() -> None:
    study = study_sensitivity(THREE, vary="stiffness", spread=0.1, base=32, effect=0.01)
    sentences = " ".join(study.answer)
    assert "stiffness of contact 1 contributes most to the variance of the arrival" in sentences
    spreads, deviations = np.array(study.tables[1].rows, dtype=float).T
    # for small errors the deviation is proportional to the spread
    allowed = float(sentences.split("kept to a standard deviation of ")[1].split()[0])
    assert allowed == pytest.approx(0.01 * spreads[-1] / deviations[-1], rel=0.05)
    confirmed = float(sentences.split("other chains with that spread have ")[1].split()[0])
    # 512 chains: the standard error of a deviation is 3 %; four of them
    assert confirmed == pytest.approx(1.0, rel=0.12)
    with pytest.raises(UsageError, match="vary = 'colour'; allowed: angle"):
        db.study("sensitivity", THREE, vary="colour")
    with pytest.raises(UsageError, match="spread = 0; allowed: a standard deviation above 0"):
        db.study("sensitivity", THREE, vary="stiffness", spread=0)


def test_several_contacts_are_named_where_the_samples_do_not_decide() -> None:
    alike = Scene(
        name="alike", duration=3e-4, mass=(0.01,) * 5, stiffness=(2e10,) * 4, velocity=(0.8, 0.0, 0.0, 0.0, 0.0)
    )
    study = study_sensitivity(alike, vary="stiffness", spread=0.1, base=16)
    which = next(sentence for sentence in study.answer if "variance of the arrival" in sentence)
    assert "is undecided between" in which
    assert "of 4: the stiffness of contacts" in which


@pytest.mark.parametrize(
    ("interval", "said"),
    [((0.9, 0.98), "the rest of the variance, up to 100 %,"), ((0.95, 1.2), "no part of the variance is seen")],
)
def test_the_rest_up_to_100_percent_is_named_only_where_there_is_one(interval: tuple[float, float], said: str) -> None:
    first, nothing = np.array([[0.06, 1.0]]), np.zeros((2, 1, 2))
    indices = Indices(
        columns=(("angle", 0), ("angle", 1)), first=first, first_interval=nothing, total=first, total_interval=nothing,
        leading=np.array([[False, True]]), sum_interval=np.array(interval)[:, None], mean=first[0], deviation=first[0],
        chains=6,
    )  # fmt: skip
    (sentence,) = sentences_on_sum("arrival", indices, 0)
    assert "sum to 106 %" in sentence
    assert said in sentence
    assert "angle of contact 1 contributes most" in sentence_on_largest("arrival", indices, 0)
    none = replace(indices, leading=np.zeros((1, 2), bool), sum_interval=np.full((2, 1), np.nan))
    assert list(sentences_on_sum("arrival", none, 0)) == []
    assert "varies by less than the error of the runs" in sentence_on_largest("arrival", none, 0)
