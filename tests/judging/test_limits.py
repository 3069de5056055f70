"""What limits the accuracy of a deck: effects by twins, and what its commands say, with numbers on both sides."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import DemBridgeError
from dem_bridge.judging.deck import UserDeck
from dem_bridge.judging.limits import Twins, deck_limits
from dem_bridge.lmp.reader.script import Command
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.seams import Seam, plant

PAIR = Scene(name="p", duration=1e-3, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(1.0, 0.0), samples=50)
NAN = math.nan
REFERENCE = np.array([[4.0, 1.0], [-1.0, 0.5]])


def run_of(
    *lines: str, dt: float | None = 1e-6, dangerous: int = 0, units: str = "si", radius: float | None = None,
    scene: Scene | None = None, problems: tuple[str, ...] = (),
) -> Any:  # fmt: skip
    """Return the run of a deck of some commands, perhaps with a scene that can be read."""
    atoms = {} if radius is None else {1: SimpleNamespace(radius=radius)}
    state: Any = SimpleNamespace(units=units, time_steps=[], step=None, particles=SimpleNamespace(atoms=atoms))
    read: Any = None if scene is None else SimpleNamespace(scene=scene, mixed=())
    commands = tuple(Command("in.x", number, tuple(line.split())) for number, line in enumerate(lines, start=1))
    user = UserDeck(path=Path("in.x"), commands=commands, state=state, read=read, mirrored=False, problems=problems)
    return SimpleNamespace(deck=user, dangerous=dangerous, dt=dt, version=20250722)


def file_of(values: Any, time: Any = (0.0, 1e-5), scale: float = 4.0) -> Any:
    """Return the errors of a file with these velocities, m/s, at two times."""
    part = SimpleNamespace(error=values - REFERENCE, columns=(0, 1), scale=scale)
    record = SimpleNamespace(time=np.array(time), values={"velocity": values})
    return SimpleNamespace(quantities={"velocity": part}, record=record)


def read_limits(run: Any, largest: float = 4.0) -> dict[str, tuple[str, float]]:
    """Return the limits that need no twin: samples that do not begin at the start have none."""
    rows = deck_limits(PAIR, run, file_of(REFERENCE, (1e-6, 1e-5), largest))
    return {row.what: (row.found, row.effect) for row in rows}


# ---------------------------------------------------------------- by twins
def numerics(
    monkeypatch: pytest.MonkeyPatch, radius: float | None, rest: float, *lines: str, **stated: float
) -> dict[str, tuple[str, float]]:
    """Return the rows of a run whose twin is off by 0.2 of 4 m/s, by 0.1 m/s more with its radius, 0.5 by gravity."""
    plain = REFERENCE + np.array([[-0.2, 0.1], [0.0, 0.0]])
    rough = plain + np.array([[-0.1, 0.0], [-0.05, 0.0]])

    def velocity(self: Twins, radius: float | None = None, **changes: float) -> Any:
        assert (self.scene.duration, self.scene.samples, changes) == (1e-5, 1, stated if changes else {})
        return (plain if radius is None else rough) + (0.5 if changes else 0.0)

    plant(monkeypatch, Seam.TWIN_VELOCITY, velocity)
    scene = replace(PAIR, **stated) if stated else None  # type: ignore[arg-type]
    run = run_of(*lines, dt=1e-7, radius=radius, scene=scene)
    errors = file_of(plain + (0.5 if stated else 0.0) + np.array([[0.0, 0.0], [0.0, 4.0 * rest]]))
    return {row.what: (row.found, row.effect) for row in deck_limits(PAIR, run, errors)}


def test_the_step_and_the_radius_are_measured_by_twins(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = numerics(monkeypatch, 1e-3, 0.035)
    assert {name: rows[name] for name in [*rows][:3]} == {
        "time step": ("1e-07 s", pytest.approx(0.05)),
        "particle radius": ("0.001 m", pytest.approx(0.025)),
        "neither time step nor radius": ("difference from a twin with this time step", pytest.approx(0.01)),
    }
    assert numerics(monkeypatch, 1e-3, 0.01)["neither time step nor radius"][1] == 0.0
    plain = numerics(monkeypatch, None, 0.035)
    assert [*plain][:2] == ["time step", "neither time step nor radius"]
    assert "particle radius" not in plain
    assert plain["neither time step nor radius"][1] == pytest.approx(0.035)
    # what the deck states otherwise than the scene is no unexplained rest
    stated = numerics(monkeypatch, None, 0.035, gravity=9.81)
    assert stated["neither time step nor radius nor what the deck states"][1] == pytest.approx(0.035)
    assert stated["gravity"] == ("9.81; the scene has 0", pytest.approx(0.125))


def test_limits_of_known_size_stand_before_unknown_ones_and_those_without_effect(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lines = ("newton off", "dump 1 all custom 10 f x")
    expected = [
        *("time step", "particle radius", "neither time step nor radius", "digits of own dump 1"),  # 5 % to 5e-6
        *("comparison with the scene", "columns of own dump 1"),  # not known
        *("newton", "neighbour list"),  # 0
    ]
    assert [*numerics(monkeypatch, 1e-3, 0.035, *lines)] == expected
    # a rest of more than the step stands first, and none at all among those without effect
    assert [*numerics(monkeypatch, 1e-3, 0.9, *lines)][:2] == ["neither time step nor radius", "time step"]
    assert [*numerics(monkeypatch, 1e-3, 0.01, *lines)][-3:] == ["neither time step nor radius", *expected[-2:]]


@pytest.mark.parametrize(
    ("dt", "time", "expected"),
    [
        (1e-7, (0.0, 1e-5), ("time step and radius", "no twin")),
        (None, (0.0, 1e-5), ("time step", "several, or none that can be read")),
        (1e-7, (1e-6, 1e-5), ("time step", "samples are not at even times from the start on")),
        (1e-7, (0.0, 1e-5, 3e-5), ("time step", "samples are not at even times from the start on")),
    ],
)
def test_why_there_is_no_twin_is_said(
    monkeypatch: pytest.MonkeyPatch, dt: float | None, time: tuple[float, ...], expected: tuple[str, str]
) -> None:
    def fail(*arguments: Any, **fields: Any) -> None:
        raise DemBridgeError("no twin")

    plant(monkeypatch, Seam.TWIN_VELOCITY, fail)
    run = run_of(dt=dt, scene=replace(PAIR, gravity=9.81))
    rows = {row.what: (row.found, row.effect) for row in deck_limits(PAIR, run, file_of(REFERENCE, time))}
    assert rows[expected[0]] == (expected[1], pytest.approx(NAN, nan_ok=True))
    # without a twin the effect of a difference is not known, and nothing is left unexplained
    assert math.isnan(rows["gravity"][1])
    assert not any(name.startswith("neither") for name in rows)


def test_twins_are_runs_of_the_samples_of_the_file_however_long_the_scene_is() -> None:
    time = np.linspace(0.0, 4e-5, 5)
    run: Any = SimpleNamespace(dt=1e-6, deck=None)
    part = SimpleNamespace(error=np.zeros((5, 2)), columns=(0, 1), scale=1.0)
    errors: Any = SimpleNamespace(quantities={"velocity": part}, record=SimpleNamespace(time=time))
    short = replace(PAIR, duration=1e-5)
    for scene in (PAIR, short):
        plain = Twins.of(scene, run, errors).plain
        assert plain.shape == (5, 2)
        # before the end of the contact both have moved, and momentum is kept
        assert np.ptp(plain[:, 0]) > 0.1
        np.testing.assert_allclose(plain.sum(axis=1), 1.0, rtol=1e-12)


def test_fields_that_differ_have_their_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    for length, shown in ((160, "x" * 160), (161, f"{'x' * 157}...")):
        found, effect = read_limits(run_of(problems=("x" * length,)))["comparison with the scene"]
        assert found == f"the deck cannot be read as a scene: {shown}"
        assert math.isnan(effect)
    assert read_limits(run_of(problems=("a", "b")))["comparison with the scene"][0].endswith("a scene: a; b")

    def velocity(self: Twins, radius: float | None = None, **changes: Any) -> Any:
        # the effects of both cancel
        wall, gravity = "wall_right" in changes, "gravity" in changes
        return np.array([[4.0, -1.0 - 0.5 * wall + 0.5 * gravity]])

    plant(monkeypatch, Seam.TWIN_VELOCITY, velocity)

    def of_scene(**changes: Any) -> dict[str, float]:
        rows = deck_limits(PAIR, run_of(scene=replace(PAIR, **changes)), file_of(REFERENCE))
        chosen = ("wall right", "gravity", "all differences from the scene together", "comparison with the scene")
        return {row.what: row.effect for row in rows if row.what in chosen}

    wall = Wall(stiffness=1e9)
    assert of_scene(wall_right=wall) == {"wall right": 0.125}
    both = {"wall right": 0.125, "gravity": 0.125, "all differences from the scene together": 0.0}
    assert of_scene(wall_right=wall, gravity=9.81) == both
    assert of_scene() == {}


def test_two_differences_that_add_up_have_the_sum_of_their_effects_together() -> None:
    # bodies a metre apart fly on: weight adds g t to each velocity, another start its difference
    apart, end, scale = replace(PAIR, gap=1.0), 1e-5, 4.0
    deck = replace(apart, gravity=9.81, velocity=(1.0, 3e-4))
    flight = np.array([[1.0, 0.0], [1.0, 0.0]])
    rows = deck_limits(apart, run_of(scene=deck), file_of(flight, (0.0, end), scale))
    effects = {row.what: row.effect for row in rows}
    weight, start = 9.81 * end / scale, 3e-4 / scale
    assert effects["gravity"] == pytest.approx(weight, rel=1e-9)
    assert effects["velocity"] == pytest.approx(start, rel=1e-9)
    assert effects["all differences from the scene together"] == pytest.approx(weight + start, rel=1e-9)


# ---------------------------------------------------------------- by the commands of the deck
@pytest.mark.parametrize(
    ("line", "points"),
    [
        ("pair_style table spline 50", "50 points, spline"),
        ("pair_style hybrid granular table linear 20", "20 points, linear"),
        ("pair_style hybrid a table linear 20 b c", "20 points, linear"),
        ("pair_style a table b", None),
        ("pair_style granular", None),
        ("pair_coeff table spline 50", None),
    ],
)
def test_points_of_tables_are_read(line: str, points: str | None) -> None:
    found, effect = read_limits(run_of(line)).get("table points", (None, NAN))
    assert found == points
    assert math.isnan(effect)


def test_newton_has_no_effect() -> None:
    assert read_limits(run_of("newton on off"))["newton"] == ("on off", 0.0)
    assert "newton" not in read_limits(run_of())


@pytest.mark.parametrize(
    ("lines", "changes", "largest", "risky"),
    [
        # two bodies at 3 m/s for 100 steps of 1 us: 0.6 mm
        (("neighbor 0.61e-3 bin", "neigh_modify delay 100 every 10"), {}, 3.0, False),
        (("neighbor 0.59e-3 bin", "neigh_modify delay 100 every 10"), {}, 3.0, True),
        (("neighbor 0.59e-3 bin", "neigh_modify every 10 delay 100"), {}, 3.0, True),
        (("neighbor 0.59e-3 bin", "neigh_modify every 100"), {}, 3.0, True),
        (("neighbor 0.59e-3 bin", "neigh_modify check yes every 100"), {}, 3.0, True),
        (("neighbor 0.59e-3 bin", "neigh_modify every v_n delay"), {}, 3.0, False),
        (("neighbor 0.59e-3 bin", "neigh_modify every 100"), {"dt": None}, 3.0, False),
        (("neighbor 1.0 bin", "neigh_modify every 1"), {"dt": 0.5}, 1.0, False),  # exactly the skin
        (("neighbor some bin", "neigh_modify every 9999999"), {}, 3.0, False),
        (("neigh_modify every 9999999",), {}, 3.0, False),
        (("neighbor 1e-3 bin",), {"dt": 1.0}, 3.0, False),
        (("neighbor 1e-3 bin",), {"dangerous": 1}, 3.0, True),  # LAMMPS itself says so
        (("neighbor 1e-3 bin", "neigh_modify exclude group"), {}, 3.0, True),
        (("neighbor 1e-3 bin", "neigh_modify delay 0 once yes"), {}, 3.0, True),
        (("neighbor 1e-3 bin", "neigh_modify delay 0 once no"), {}, 3.0, False),
        ((), {}, 3.0, False),
        # a skin is in the units of the deck: 1 mm, 10 cm, and m where they are unknown
        (("neighbor 1e-1 bin", "neigh_modify delay 200"), {"units": "cgs"}, 3.0, True),
        (("neighbor 1e-1 bin", "neigh_modify delay 200"), {}, 3.0, False),
        (("neighbor 0.9e-3 bin", "neigh_modify every 200"), {"units": "unheard"}, 3.0, True),
    ],
)
def test_skins_that_bodies_cross_unseen_are_risky(
    lines: tuple[str, ...], changes: dict[str, Any], largest: float, risky: bool
) -> None:
    found, effect = read_limits(run_of(*lines, **changes), largest)["neighbour list"]
    assert math.isnan(effect) is risky
    assert risky or effect == 0.0
    names = (("neighbor ", "default skin"), ("neigh_modify", "default neigh_modify"))
    texts = [next((line for line in lines if line.startswith(name)), default) for name, default in names]
    assert found == f"{texts[0]}, {texts[1]}; dangerous builds: {changes.get('dangerous', 0)}"


@pytest.mark.parametrize(
    ("lines", "rows"),
    [
        ((), {"own dump": ("none", NAN)}),
        (("dump 1 all custom 10 f vx",), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f x",), {"columns of own dump 1": ("no velocities", NAN),
                                         "digits of own dump 1": ("6", 5e-6)}),
        # the name of the file is no column
        (("dump 1 all custom 10 vx x y",), {"columns of own dump 1": ("no velocities", NAN),
                                            "digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom",), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10",), {"columns of own dump 1": ("no velocities", NAN),
                                     "digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all atom 10 f",), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f.bin vx",), {}),
        (("dump 1 all custom 10 f.bin x",), {"columns of own dump 1": ("no velocities", NAN)}),
        (("dump 1 all custom 10 f.txt vx.bin vx",), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.15g"), {}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.14g"), {"digits of own dump 1": ("14", 5e-14)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 sort id format float %20.3e"), {}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.3f"), {}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %20.8g"), {"digits of own dump 1": ("8", 5e-8)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %d"), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.17g", "dump_modify 1 format float %.9g"),
         {"digits of own dump 1": ("9", 5e-9)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.9g", "dump_modify 1 format float %.7g",
          "dump_modify 1 format float %.17g"), {}),
        (("dump 1 all custom 10 f vx", "dump_modify 2 format float %.17g"), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 sort %.17g"), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f vx", "undump 1 format %.17g"), {"digits of own dump 1": ("6", 5e-6)}),
    ],
)  # fmt: skip
def test_what_the_own_dump_of_a_deck_loses_is_said(lines: tuple[str, ...], rows: dict[str, tuple[str, float]]) -> None:
    actual = {name: row for name, row in read_limits(run_of(*lines)).items() if "own dump" in name}
    assert actual.keys() == rows.keys()
    for name, (text, effect) in rows.items():
        assert actual[name] == (text, pytest.approx(effect, rel=1e-12, abs=0.0, nan_ok=True))
