"""Random chains that a piston moves: every run is within its uncertainty of a truth without a piston."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.errors import RunBroken, UnsupportedScene
from tests.helpers.random_pistons import pushed_at_random, with_heavy_body
from tests.helpers.truths import FIRST, QUANTITIES, compiled, solved

#: seeds that every run of the suite has, and those of the deep test
FEW, MANY = range(6), range(6, 120)


def _outside(seed: int, backend: str, program: Path) -> list[str]:
    """Return the quantities of a scene that are not within their uncertainties; none where there is no such run."""
    scene = pushed_at_random(seed)
    truth = None if scene is None else solved(program, with_heavy_body(scene), FIRST.settings)
    if scene is None or truth is None:
        return []
    try:
        run = db.solve(scene, backend=backend)
    except (UnsupportedScene, RunBroken):  # a law of another exponent, or too many steps
        return []
    return [f"{scene.name}: {quantity}" for quantity in QUANTITIES if truth.outside(run, quantity) > 1.0]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(FIRST, tmp_path_factory.mktemp("truths"))


@pytest.mark.parametrize("backend", ["reference", "verlet", "blanes-moan"])
def test_a_few_chains_are_within_their_uncertainties(backend: str, program: Path) -> None:
    assert [found for seed in FEW for found in _outside(seed, backend, program)] == []


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["reference", "verlet", "blanes-moan"])
def test_a_hundred_chains_are_within_their_uncertainties(backend: str, program: Path) -> None:
    assert [found for seed in MANY for found in _outside(seed, backend, program)] == []


def test_a_wrong_phase_is_outside(program: Path) -> None:
    drawn = (pushed_at_random(seed) for seed in FEW)
    scene = next(scene for scene in drawn if scene is not None and scene.piston and scene.piston.shape == "sine")
    heavy, run = with_heavy_body(scene), db.solve(scene, backend="scipy")
    assert heavy.driving_force is not None
    late = replace(heavy, drive=replace(heavy.driving_force, phase=heavy.driving_force.phase + 1e-6))
    right, wrong = (solved(program, other, FIRST.settings) for other in (heavy, late))
    assert right is not None
    assert wrong is not None
    assert right.outside(run, "velocity") <= 1.0 < wrong.outside(run, "velocity")
