"""Two bodies as unlike as doubles allow: the references agree with the closed form within their uncertainty."""

from __future__ import annotations

from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.backends import scipy_dop853, scipy_integration
from dem_bridge.backends.scales import natural_scales
from dem_bridge.errors import RunBroken
from tests.helpers.exact_collision import Collision, collision, random_collision

#: each was wrong in all digits, or took forever, with an uncertainty of its last digits: both references missed the
#: contact, for its overlap was below their resolution
PAIRS: dict[str, dict[str, Any]] = {
    "a light body far below the scale": {"mass": (1.0, 1e-26), "exponent": 2.000001, "gap": 316.0},
    "a lighter one, linear": {"mass": (1.0, 1e-30), "exponent": 2.0, "gap": 3e4},
    "a lighter one in front": {"mass": (1e-33, 1.0), "exponent": 2.5, "gap": 5e-4},
    "a light body below n = 2": {"mass": (1.0, 1e-19), "exponent": 1.45, "gap": 19.0},
    "a drift of 2e13": {"mass": (1.0, 0.15), "exponent": 1.99, "velocity": (-2e13 + 1.0, -2e13), "gap": 0.0},
    "a drift of 1e11 behind a light body": {
        "mass": (1.0, 1e-13), "exponent": 1.5, "velocity": (-1e11 + 1.0, -1e11), "gap": 1e-4,
    },
    "a drift of 1e10, stiff": {"mass": (1.0, 0.02), "exponent": 5.5, "velocity": (1e10 + 1.0, 1e10), "gap": 1e-4},
    "coefficients beyond doubles": {
        "mass": (1.7, 6.6e-40), "exponent": 2.0, "gap": 41.0, "stiffness": 1.5e13,
        "velocity": (0.2, 0.0), "rest": 230.0,
    },
    "nearly linear, in a long run": {"mass": (0.3, 3e-9), "exponent": 2.000001, "gap": 1.0, "rest": 3e5},
}  # fmt: skip


def _pair(name: str) -> Collision:
    settings: dict[str, Any] = {"velocity": (1.0, 0.0), "stiffness": 1e9, "rest": 3.0, **PAIRS[name]}
    pair = collision(**settings)
    assert pair is not None
    return pair


@pytest.mark.parametrize("backend", ["reference", "scipy"])
@pytest.mark.parametrize("name", PAIRS)
def test_a_contact_below_the_scale_of_the_scene_is_seen(name: str, backend: str) -> None:
    pair = _pair(name)
    run = db.solve(pair.scene, backend=backend)
    assert pair.outside(run) == {}
    # and the uncertainty is that of a reference
    assert run.uncertainty["peak_force"][0] <= 1e-9 * pair.peak_force


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 600), marks=pytest.mark.slow)], ids=["8", "600"])
def test_random_pairs_are_right_or_refused(seeds: range) -> None:
    outside, refused = {}, 0
    pairs = {seed: pair for seed in seeds if (pair := random_collision(seed)) is not None}
    for seed, pair in pairs.items():
        for backend in ("reference", "scipy"):
            try:
                outside[seed, backend] = pair.outside(db.solve(pair.scene, backend=backend))
            except RunBroken:
                refused += 1
    assert {key: misses for key, misses in outside.items() if misses} == {}
    assert refused <= 0.1 * len(outside)


def test_with_one_resolution_for_all_contacts_both_would_be_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    planted: dict[str, Any] = {
        "in_common_frame": (scipy_dop853, lambda scene: (scene, 0.0)),
        "unfelt_overlap": (scipy_integration, lambda scene: 1e-12 * natural_scales(scene)[1]),
    }
    for name, pair in (("in_common_frame", "a drift of 2e13"), ("unfelt_overlap", "a light body below n = 2")):
        module, fault = planted[name]
        with monkeypatch.context() as patch:
            patch.setattr(module, name, fault)
            assert _pair(pair).outside(db.solve(_pair(pair).scene, backend="scipy")) != {}


@pytest.mark.parametrize("unit", [2.0**60, 2.0**-60], ids=["overflow", "underflow"])
def test_series_beyond_doubles_are_refused_at_once(unit: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dem_bridge.backends.reference.time_unit", lambda *scene: unit)
    monkeypatch.setattr("dem_bridge.backends.reference.MOST_STEPS", 1000)
    pair = collision(mass=(1.0, 1.0), velocity=(1.0, 0.0), stiffness=1e9, exponent=2.5, gap=0.0, rest=3.0)
    assert pair is not None
    with pytest.raises(RunBroken, match="take backend='scipy'"):
        db.solve(pair.scene, backend="reference")
