"""Two programs that share no code compute the truths of awkward scenes, and each names faults in the other one."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.scene.scene import Scene, Wall
from tests.helpers import many_scenes
from tests.helpers.awkward_scenes import COUNT, KINDS, awkward, awkward_scene, kind_of
from tests.helpers.fake_runs import free_flight, uncertain
from tests.helpers.kept_truths import load, save
from tests.helpers.truths import DATA, FIRST, QUANTITIES, SECOND, Method, Truth, compiled, disagreements, solved
from tests.runs.uncertainty import measure_bars
from tests.runs.uncertainty.measure_bars import (
    ALLOWED,
    OTHERS,
    REFERENCES,
    Trial,
    enough,
    resumed,
    summary,
    try_backend,
)

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="the truths are computed by C programs")

#: fault: (program, replaced texts, kind of the scenes that can show it, scenes); where the steps of the program end
#: decides which of them shows it
FAULTS: dict[str, tuple[Method, dict[str, str], str, tuple[int, ...]]] = {
    "contacts that change together": (
        FIRST,
        {
            "else settle(j);": "",
            "walks[j].definite <= h) {": "walks[j].definite <= h) {\n                changed = 0;",
            "if (state[j] == OPEN ? s > 0 : s < 0) {": "if (old * s <= 0 && (state[j] == OPEN ? s > 0 : s < 0)) {",
        },
        "symmetric",
        (0, 12),
    ),
    "two turns within a step": (
        FIRST,
        {"if (low > margin || high < -margin) { seen(walk, low > margin,": "if (g0 * g3 > 0) { seen(walk, g0 > 0,"},
        "twice_compressed",
        (10, 166),
    ),
    "grazes within a step": (
        FIRST,
        {"for (int i = 0; i <= walk->count; i++) {": "for (int i = walk->count; i <= walk->count; i++) {"},
        "grazing",
        (38, 50, 146),
    ),
    "largest forces within a step": (
        FIRST,
        {"if (!singular && monotone) return;": "return;"},
        "sticking",
        (20, 116, 152),
    ),
    "drag between two bodies": (SECOND, {"(a - drag * j->r[m])": "a"}, "terminal_velocity", (9, 21)),
    "loads in balance": (SECOND, {"return h * ((j->left": "return 0 * ((j->left"}, "twice_compressed", (118,)),
    "the pull-off": (SECOND, {"num f = -j->pull_off;": "num f = 0;"}, "sticking", (20, 56)),
}


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("truths")
    return {method.source: compiled(method, folder) for method in (FIRST, SECOND)}


def both(programs: dict[str, Path], scene: Scene) -> tuple[Truth, Truth]:
    first, second = (solved(programs[method.source], scene, method.settings) for method in (FIRST, SECOND))
    assert first is not None
    assert second is not None
    return first, second


@pytest.mark.parametrize("number", range(len(KINDS)))
def test_two_programs_agree_on_each_kind_of_scene(programs: dict[str, Path], number: int) -> None:
    assert disagreements(*both(programs, awkward_scene(number))) == {}


@pytest.mark.slow
def test_two_programs_agree_on_all_awkward_scenes(programs: dict[str, Path]) -> None:
    wrong = {}
    for number in range(COUNT):
        if found := disagreements(*both(programs, awkward_scene(number))):
            wrong[number] = found
    assert wrong == {}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_one_program_is_named(programs: dict[str, Path], tmp_path: Path, fault: str) -> None:
    method, replaced, kind, numbers = FAULTS[fault]
    text = (DATA / method.source).read_text()
    for old, new in replaced.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    faulty = compiled(method, tmp_path, source=text)
    named = []
    # the kept scenes, for their numbers have the same last digits on each machine
    for scene, _ in (awkward()[number] for number in numbers):
        assert kind_of(scene) == kind
        first, second = both(programs, scene)
        assert disagreements(first, second) == {}
        wrong = solved(faulty, scene, method.settings)
        # a program that does not come to an end tells as well
        pair = (wrong, second) if method is FIRST else (first, wrong)
        named.append(wrong is None or bool(disagreements(*pair)))
    assert any(named)


def test_contacts_that_have_just_touched_do_not_open_by_the_ripple_of_a_series(
    programs: dict[str, Path], tmp_path: Path
) -> None:
    text = (DATA / SECOND.source).read_text()
    assert text.count(" + nodes * c[q].ripple") == 1
    faulty = compiled(SECOND, tmp_path, source=text.replace(" + nodes * c[q].ripple", ""))

    def unsure(program: Path) -> int:
        """Return how many of three scenes have a quantity of which a program is not sure."""
        truths = [solved(program, awkward_scene(number), SECOND.settings) for number in (480, 487, 491)]
        return sum(truth is None or not all(np.isfinite(d).all() for d in truth.doubt.values()) for truth in truths)

    assert unsure(programs[SECOND.source]) == 0
    # the last digits of a library decide which of them shows it
    assert unsure(faulty) > 0


def turning_at_a_wall(distance: float) -> Scene:
    """Return a body that turns in a field at this distance behind the surface of a wall; 1/64 m is exact."""
    wall = Wall(stiffness=1e9, gap=1.0 / 64.0 - distance)
    return Scene(
        name="graze", duration=0.125, mass=(1e-2,), stiffness=(), velocity=(0.5,), gravity=-8.0, wall_right=wall
    )


def test_both_programs_say_that_a_graze_within_roundoff_is_not_sure(programs: dict[str, Path]) -> None:
    for truth in both(programs, turning_at_a_wall(0.0)):
        assert math.isinf(truth.doubt["crossing_time"][0])
    for distance in (2.0**-50, -(2.0**-50)):
        first, second = both(programs, turning_at_a_wall(distance))
        assert disagreements(first, second) == {}
        assert np.isnan(first.values["crossing_time"][0]) == (distance < 0.0)


def test_both_programs_say_that_a_turn_at_the_end_is_not_sure(programs: dict[str, Path]) -> None:
    # a linear contact of frequency 2^10/s turns after a quarter of a period
    quarter = 0.5 * math.pi / 1024.0
    scene = Scene(
        name="end", duration=quarter, mass=(1.0, 1.0), stiffness=(2.0**19,), exponent=2.0, velocity=(1.0, 0.0)
    )
    for truth in both(programs, scene):
        assert math.isinf(truth.doubt["crossing_time"][0])
    for share in (1e-12, -1e-12):
        first, second = both(programs, replace(scene, duration=quarter * (1.0 + share)))
        assert disagreements(first, second) == {}
        assert np.isfinite(first.doubt["crossing_time"][0])
        assert np.isnan(first.values["crossing_time"][0]) == (share < 0.0)


def test_kept_truths_are_read_as_they_were_written(tmp_path: Path) -> None:
    pairs = [(awkward_scene(number), _truth(awkward_scene(number), number)) for number in range(len(KINDS))]
    save(tmp_path / "kept.npz", pairs)
    for (scene, truth), (old, old_truth) in zip(load(tmp_path / "kept.npz", samples=4), pairs, strict=True):
        assert scene.content_hash == old.content_hash
        for name in QUANTITIES:
            np.testing.assert_array_equal(truth.values[name], old_truth.values[name])
            rounded, doubt = truth.doubt[name], old_truth.doubt[name]
            assert np.all((rounded == doubt) | ((rounded >= doubt) & (rounded < 2.0 * doubt)))


def _truth(scene: Scene, seed: int) -> Truth:
    rng = np.random.default_rng(seed)
    sizes = dict(zip(QUANTITIES, [scene.n_body] * 2 + [scene.n_contact] * 2, strict=True))
    values = {name: rng.choice([1e-9, 0.0, math.nan, 3.0], size) for name, size in sizes.items()}
    return Truth(values, {name: rng.choice([0.0, math.inf, 0.25, 3e-300], size) for name, size in sizes.items()})


def test_the_kept_awkward_scenes_are_those_of_the_generator() -> None:
    assert len(awkward()) == COUNT
    for scene, _ in awkward()[:: len(KINDS) + 1]:
        again = awkward_scene(int(scene.name.split("-")[1]))
        for name in ("mass", "velocity", "gap", "stiffness", "duration", "drag", "gravity"):
            # powers and roots differ in the last digits between machines
            np.testing.assert_allclose(getattr(scene, name), getattr(again, name), rtol=1e-9, atol=1e-13)
    unsure = [scene.name for scene, truth in awkward() if any(np.isinf(doubt).any() for doubt in truth.doubt.values())]
    assert unsure == []


def test_truths_are_kept_when_their_computation_is_interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = [(scene, _truth(scene, 0)) for scene in map(awkward_scene, range(4))]
    file, calls = tmp_path / "kept.npz", []

    def interrupted(_program: Path, scene: Scene, _settings: Any) -> Truth | None:
        calls.append(scene.name)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return _truth(scene, 1) if len(calls) == 1 else None

    for name, value in {"KEPT": file, "many": lambda: old, "solved": interrupted, "compiled": lambda *_: file}.items():
        monkeypatch.setattr(many_scenes, name, value)
    save(file, old)
    with pytest.raises(KeyboardInterrupt):
        many_scenes.main(["again"])
    # the first is new, the second takes too long now, and the others have not been computed again
    kept = {scene.name: truth for scene, truth in load(file, samples=4)}
    assert list(kept) == [old[number][0].name for number in (0, 2, 3)]
    for (scene, _), seed in zip((old[0], old[2], old[3]), (1, 0, 0), strict=True):
        for name in QUANTITIES:
            np.testing.assert_array_equal(kept[scene.name].values[name], _truth(scene, seed).values[name])


@pytest.mark.parametrize("doubt", [math.inf, math.nan, 1e-9])
def test_a_truth_says_nothing_against_a_run_where_it_is_not_sure(doubt: float) -> None:
    run = free_flight(uncertainty=uncertain(crossing_time=np.zeros(2)))
    value = run.crossing_time + np.array([0.0, 1e-3])
    truth = Truth({"crossing_time": value}, {"crossing_time": np.array([0.0, doubt])})
    # two doubts of 1e-9 s for an error of 1e-3 s
    expected = 5e5 if doubt == 1e-9 else 0.0
    assert truth.outside(run, "crossing_time") == pytest.approx(expected, rel=1e-3)


def test_an_interrupted_grading_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def trial(name: str, scene: Scene, truth: Truth) -> Trial:
        calls.append(scene.name)
        return Trial(name, scene.name, dict.fromkeys(QUANTITIES, 0.5), dict.fromkeys(QUANTITIES, math.nan), cpu=1.0)

    monkeypatch.setattr(measure_bars, "try_scene", trial)
    pairs: list[Any] = [(awkward_scene(number), None) for number in range(3)]
    file = tmp_path / "bars.jsonl"
    assert len(list(resumed(["verlet"], pairs[:2], file, keep=False))) == 2
    file.write_text(file.read_text() + json.dumps({"backend": "verlet"})[:-5])
    trials = list(resumed(["verlet"], pairs, file, keep=True))
    assert [each.scene for each in trials] == [scene.name for scene, _ in pairs]
    assert calls == [scene.name for scene, _ in pairs]
    assert len(list(resumed(["verlet"], pairs, file, keep=True))) == 3 == len(calls)
    assert len(list(resumed(["verlet"], pairs, file, keep=False))) == 3 == len(calls) - 3
    assert enough(trials, 0.0)
    assert all("| 3 (0) | 0 |" in line for line in summary(trials))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*REFERENCES, *OTHERS])
def test_the_uncertainties_hold_on_the_awkward_scenes(name: str) -> None:
    trials = try_backend(name, awkward())
    assert enough(trials, 0.0 if name in REFERENCES else ALLOWED), summary(trials)
