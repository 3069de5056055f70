"""The study of sensitivity: what it names, and the tolerance that it allows."""

from __future__ import annotations

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.scene import Scene
from dem_bridge.studies.sensitivity import study_sensitivity

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
