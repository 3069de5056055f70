"""A piston has the velocity of its words, displacement and acceleration follow from it, and wrong ones are refused."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from dem_bridge.errors import SceneError
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.file.load import parse_scene
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.scene.piston import PISTON_KEYS, Piston
from dem_bridge.scene.scene import Adhesion, Scene, Wall
from tests.helpers.driven_chains import PISTONS, TOUCHING, pushed

each = pytest.mark.parametrize("kind", PISTONS)


@each
@pytest.mark.parametrize("time", [3e-5, 1.1e-4, 1.99e-4, 2.6e-4])
def test_displacement_and_acceleration_are_integral_and_slope_of_the_velocity(kind: str, time: float) -> None:
    piston = PISTONS[kind]
    knots = [*piston.breaks[piston.breaks < time], *[2e-4] * (time > 2e-4)]
    way = quad(lambda t: float(piston.at(t)), 0.0, time, points=knots or None, epsabs=1e-17)[0]
    assert float(piston.displacement(time)) == pytest.approx(way, abs=1e-14 * piston.peak)
    h = 1e-8
    slope = (float(piston.at(time + h)) - float(piston.at(time - h))) / (2.0 * h)
    # a sine: its third derivative times h^2/6 = 1e-8 of the slope's scale; and the last digits over h
    scale = piston.peak * max(piston.rate, 1.0)
    assert float(piston.acceleration(time)) == pytest.approx(slope, abs=1e-6 * scale + 1e-7)


@each
def test_peak_rate_and_variation_are_bounds(kind: str) -> None:
    piston, time = PISTONS[kind], np.linspace(0.0, 2e-4, 2001)
    velocity = piston.at(time)
    assert 0.99 * piston.peak <= np.max(np.abs(velocity)) <= piston.peak
    assert np.max(np.abs(np.diff(velocity))) / time[1] <= piston.rate * piston.peak * (1.0 + 1e-9)
    assert np.sum(np.abs(np.diff(velocity))) <= piston.variation(2e-4) + 1e-12
    np.testing.assert_array_equal(piston.times(2.0).at(time), 2.0 * velocity)


def test_a_table_bends_at_inner_knots_and_keeps_its_last_velocity() -> None:
    table = Piston(shape="table", velocity=(0, 1, 2, 2, 2, 0), interval=0.5)
    assert (table.breaks.tolist(), table.end) == ([1.0, 2.0], 2.5)
    assert table.at([2.5, 3.0]).tolist() == [0.0, 0.0]
    moving = replace(table, velocity=(0, 1))
    assert (float(moving.at(2.0)), float(moving.displacement(2.0)), float(moving.acceleration(2.0))) == (1.0, 1.75, 0.0)


def test_a_piston_travels_without_what_it_finds_again() -> None:
    table = PISTONS["table"]
    before = len(pickle.dumps(table))
    assert table.peak == 0.4
    assert len(pickle.dumps(table)) == before
    assert pickle.loads(pickle.dumps(table)) == table


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "a chirp": ({"shape": "chirp", "velocity": 1.0}, "drive.shape = 'chirp'; allowed: constant or sine or table, with"),
    "no frequency": ({"shape": "sine", "velocity": 1.0}, "drive.frequency is missing; allowed: a number > 0 (Hz)"),
    "a sine backwards": ({"shape": "sine", "velocity": -1.0, "frequency": 1.0}, "with phase = 180"),
    "a frequency of a constant": (
        {"shape": "constant", "velocity": 1.0, "frequency": 1.0}, "does not apply to shape = 'constant' with velocity",
    ),
    "a table of one": ({"shape": "table", "velocity": (1.0,), "interval": 1.0}, "has 1 entries; allowed: at least 2"),
    "no number": ({"shape": "constant", "velocity": math.nan}, "drive.velocity = nan; allowed: a finite number (m/s)"),
}  # fmt: skip


@pytest.mark.parametrize(("values", "said"), WRONG.values(), ids=WRONG)
def test_what_is_no_piston_is_refused_in_one_line(values: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError) as caught:
        Piston(**values)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


MISPLACED: dict[str, tuple[dict[str, Any], str]] = {
    "another start": ({"velocity": (0.2, *[0.0] * 5)}, "velocity[0] = 0.2, but the piston starts at 0.3 m/s; allowed"),
    "a wall behind": ({"wall_left": Wall(stiffness=1e9)}, "a wall behind it cannot act; allowed: no wall_left"),
    "too short": (
        {"drive": replace(PISTONS["table"], interval=1e-6), "velocity": (0.0,) * 6}, "drive.velocity ends at 4e-06 s",
    ),
    "a law before a wall": (
        {"law": lambda overlap: 1e6 * overlap, "wall_right": Wall(stiffness=1e9)}, "allowed: no wall_right, or contact",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "said"), MISPLACED.values(), ids=MISPLACED)
def test_a_piston_that_does_not_fit_the_scene_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError) as caught:
        pushed("constant", **changes)
    assert said in str(caught.value)


def test_a_piston_alone_is_refused() -> None:
    with pytest.raises(SceneError, match="the only one; allowed: at least two bodies"):
        Scene(name="a", duration=1.0, mass=(1.0,), stiffness=(), velocity=(0.0,), drive=PISTONS["constant"])


def test_body_0_starts_with_the_piston_and_has_no_mobility() -> None:
    scene = pushed("sine", velocity=(0.0,) * 6)
    assert scene.velocity[0] == pytest.approx(0.15)
    assert scene.mobility.tolist() == [0.0, *[1.0 / mass for mass in scene.mass[1:]], 0.0]
    assert scene.free_acceleration[0] == 0.0
    # adhesion of bodies that touch needs an approach, which is that of the piston
    assert pushed("constant", adhesion=Adhesion(law="dmt", pull_off=(1.0, 0.0, 0.0, 0.0, 0.0))).adhesive


def test_a_force_has_no_hash_of_a_velocity() -> None:
    scene, values = pushed("table"), PISTONS["table"].velocity
    force = Drive(shape="table", force=values, interval=5e-5)
    assert replace(scene, drive=force).content_hash != scene.content_hash


@each
def test_a_written_scene_is_read_with_its_piston(kind: str) -> None:
    scene = pushed(kind)
    assert parse_scene(scene_toml(scene)) == scene


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("force = 1.0", "drive.force = 1.0; allowed: no such key with velocity"),
        ("rise = 1e-4", "drive.rise = 0.0001; allowed: no such key with velocity, only frequency, interval, phase"),
    ],
)
def test_a_key_of_a_force_beside_a_velocity_is_named(line: str, said: str) -> None:
    text = scene_toml(pushed("sine")).replace('shape = "sine"', f'shape = "sine"\n{line}')
    with pytest.raises(SceneError) as caught:
        parse_scene(text)
    assert said in str(caught.value)


def test_every_key_belongs_to_a_shape() -> None:
    assert {key for keys in PISTON_KEYS.values() for key in keys} == {"frequency", "phase", "interval"}
    assert TOUCHING.piston is None
    assert load_scene("driven-dimer").driving_force is not None
