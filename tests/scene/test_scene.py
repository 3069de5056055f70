"""A Scene checks itself, cannot change, and is known by a hash of what decides the motion."""

from __future__ import annotations

import math
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given

from dem_bridge.errors import SceneError
from dem_bridge.physics.contact_law import ContactLaw, power_law
from dem_bridge.scene.drive import KEYS, Drive
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.helpers.driven_chains import CHIRP
from tests.helpers.strategies import ANY, scenes

GOOD: dict[str, Any] = {
    "name": "three",
    "duration": 1e-3,
    "mass": (8.1e-3, 1e-2, 2e-2),
    "stiffness": (4e9, 5e9),
    "velocity": (0.8, 0.0, -0.1),
}


def _scene(**changes: Any) -> Scene:
    return Scene(**(GOOD | changes))


def _message(**changes: Any) -> str:
    with pytest.raises(SceneError) as caught:
        _scene(**changes)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_single_numbers_for_exponent_and_gap_stand_for_all_contacts() -> None:
    scene = _scene(exponent=3.0, gap=1e-6)
    assert (scene.exponent, scene.gap) == ((3.0, 3.0), (1e-6, 1e-6))


def test_lists_and_arrays_and_whole_numbers_are_taken_as_floats() -> None:
    scene = _scene(mass=[1, 2, 3], velocity=np.array([1, 0, 0]), gap=np.zeros(2), duration=np.float32(2.0))
    assert scene.mass == (1.0, 2.0, 3.0)
    assert all(type(v) is float for v in (*scene.mass, *scene.velocity, *scene.gap, scene.duration))  # type: ignore[misc]


@pytest.mark.parametrize(
    "mass",
    [
        [1, 2, 3],
        (1, 2, 3),
        range(1, 4),
        np.array([1, 2, 3]),
        np.array([1, 2, 3], dtype=np.float32),
        np.arange(1.0, 7.0)[::2] / 2 + 0.5,
        pd.Series([1, 2, 3], index=[5, 7, 9]),
        pd.DataFrame({"m": [1.0, 2.0, 3.0]})["m"],
    ],
)
def test_any_row_of_numbers_is_taken(mass: Any) -> None:
    assert _scene(mass=mass).mass == (1.0, 2.0, 3.0)
    assert _scene(velocity=mass, gap=mass[:2], stiffness=mass[1:]).velocity == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("mass", "why"),
    [
        (np.array(5.0), "scene: mass has the shape (); allowed: a list"),
        (np.ones((3, 1)), "scene: mass has the shape (3, 1); allowed: a list"),
        (pd.DataFrame({"m": [1.0, 2.0, 3.0]}), "scene: mass has the shape (3, 1); allowed: a list"),
        ([[1.0], [2.0], [3.0]], "scene: mass[0] = [1.0]; allowed: a number > 0 (kg)"),
        ([[1.0], [2.0, 3.0]], "scene: mass[0] = [1.0]; allowed: a number > 0 (kg)"),
        (np.ma.masked_values([1.0, 2.0, -9.0], -9.0), "scene: mass has masked entries; allowed: a list"),
        (pd.Series([1.0, None, 3.0]), "scene: mass[1] = nan; allowed: a number > 0 (kg)"),
        (pd.Series(["a", "b", "c"]), "scene: mass[0] = 'a'; allowed: a number > 0 (kg)"),
        (np.array([1 + 1j] * 3), "scene: mass[0] = np.complex128(1+1j); allowed: a number > 0 (kg)"),
        ({0: 1.0}, "scene: mass = {0: 1.0}; allowed: a list"),
        (np.array([]), "scene: mass is empty; allowed: at least one body"),
    ],
)
def test_what_is_no_row_of_numbers_is_refused_in_one_line(mass: Any, why: str) -> None:
    assert _message(mass=mass).startswith(why)


def test_a_scene_cannot_be_changed() -> None:
    scene = _scene()
    with pytest.raises(FrozenInstanceError):
        scene.duration = 1.0  # type: ignore[misc]


@given(scene=scenes(walls=True, gravity=True, exponents=ANY))
def test_a_scene_made_of_a_scenes_parts_is_the_same_scene(scene: Scene) -> None:
    again = replace(scene)
    assert again == scene
    assert again.content_hash == scene.content_hash


def test_contacts_are_those_of_the_chain_then_wall_left_then_wall_right() -> None:
    scene = _scene(
        gap=(1e-6, 2e-6),
        exponent=(2.5, 3.0),
        wall_left=Wall(stiffness=1e9, gap=3e-6),
        wall_right=Wall(stiffness=2e9, gap=4e-6, exponent=2.0),
    )
    c = scene.contacts
    assert (scene.n_body, scene.n_contact) == (3, 4)
    assert c.left.tolist() == [0, 1, 3, 2]  # 3 = n_body is the wall
    assert c.right.tolist() == [1, 2, 0, 3]
    assert c.stiffness.tolist() == [4e9, 5e9, 1e9, 2e9]
    assert c.gap.tolist() == [1e-6, 2e-6, 3e-6, 4e-6]
    assert c.exponent.tolist() == [2.5, 3.0, 2.5, 2.0]  # the left wall's: that of the first contact


def test_one_body_between_walls_has_two_contacts_and_they_are_hertzian() -> None:
    scene = Scene(
        name="one",
        duration=1.0,
        mass=(1.0,),
        stiffness=(),
        velocity=(1.0,),
        wall_left=Wall(stiffness=1.0),
        wall_right=Wall(stiffness=2.0),
    )
    assert (scene.n_contact, scene.contacts.exponent.tolist()) == (2, [2.5, 2.5])


def test_one_free_body_has_no_contact() -> None:
    scene = Scene(name="alone", duration=1.0, mass=(1.0,), stiffness=(), velocity=(1.0,))
    assert (scene.n_contact, len(scene.contacts.gap)) == (0, 0)


@pytest.mark.parametrize(
    "changes",
    [
        {"duration": 2e-3},
        {"mass": (8.1e-3, 1e-2, math.nextafter(2e-2, 1.0))},
        {"stiffness": (5e9, 4e9)},
        {"velocity": (0.8, 0.0, 0.1)},
        {"exponent": (2.5, 2.4)},
        {"gap": (0.0, 1e-9)},
        {"gravity": 9.81},
        {"samples": 499},
        {"wall_left": Wall(stiffness=1e9)},
        {"wall_right": Wall(stiffness=1e9)},
        {"precompression": 1e-3},
        {"drag": 1e-3},
        {"damping": Damping(law="dashpot", coefficient=1e-3)},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_the_hash_sees_everything_that_decides_the_motion(changes: dict[str, Any]) -> None:
    assert _scene(**changes).content_hash != _scene().content_hash


def test_the_hash_sees_the_law_and_every_coefficient_of_damping() -> None:
    laws = [("dashpot", (1.0, 2.0)), ("dashpot", (2.0, 1.0)), ("kuwabara-kono", (1.0, 2.0))]
    hashes = {_scene(damping=Damping(law=law, coefficient=c)).content_hash for law, c in laws}
    assert len(hashes) == 3


def test_the_hash_sees_every_number_of_a_drive_and_what_is_not_its_own_leaves_no_trace() -> None:
    chirp = replace(CHIRP, sweep=1e-3, rise=1e-4, phase=5.0)
    changed = [replace(chirp, **{key: 2.0 * getattr(chirp, key)}) for key in ("force", *KEYS["chirp"])]
    table = Drive(shape="table", force=(0.0, 1.0), interval=1e-3)
    tables = [table, replace(table, force=(0.0, 2.0)), replace(table, interval=2e-3)]
    hashes = {_scene(drive=drive).content_hash for drive in (None, chirp, *changed, *tables)}
    assert len(hashes) == 2 + len(changed) + len(tables)
    assert _scene(drive=None).content_hash == _scene().content_hash


WRONG_DRIVES = {
    "no Drive": (2.0, "drive = 2.0; allowed: a Drive or a Piston or None"),
    "a table that ends early": (
        Drive(shape="table", force=(0.0, 1.0), interval=9e-4),
        "drive.force ends at 0.0009 s (table of 2 forces at intervals of 0.0009 s, at most 1 N); allowed: values up to"
        " the duration, 0.001 s",
    ),
}


@pytest.mark.parametrize(("drive", "said"), WRONG_DRIVES.values(), ids=WRONG_DRIVES)
def test_a_drive_that_does_not_fit_the_scene_is_refused(drive: Any, said: str) -> None:
    assert said in _message(drive=drive)


def test_a_table_whose_end_is_the_scenes_but_for_a_rounding_is_long_enough() -> None:
    interval = math.nextafter(1e-3 / 3.0, 0.0)
    assert _scene(drive=Drive(shape="table", force=(0.0,) * 4, interval=interval)).drive is not None


def test_no_drive_presses_a_law_deeper_than_it_is_known() -> None:
    law = power_law(4e9, 2.5)
    still, pushed = (_scene(law=law, drive=drive).contacts.reach[0] for drive in (None, CHIRP))
    # all that a force of 2 N could do: sqrt(E) grows by at most F t / sqrt(2 m)
    mass, v = np.array(GOOD["mass"]), np.array(GOOD["velocity"])
    root = math.sqrt(0.5 * float(mass @ v**2))
    ratio = (1.0 + 2.0 * 1e-3 / math.sqrt(2.0 * mass[0]) / root) ** 2
    assert law.energy(np.array(pushed)) / law.energy(np.array(still)) == pytest.approx(ratio, rel=0.5)
    assert pushed > still


def test_physics_that_does_nothing_leaves_the_hash_alone() -> None:
    idle = _scene(precompression=0, drag=0.0, damping=Damping(law="dashpot", coefficient=0.0))
    assert idle.content_hash == _scene().content_hash
    assert not idle.dissipates


def test_the_shipped_scenes_keep_the_hashes_of_their_decks_and_reports() -> None:
    # they stand in lammps_inputs/ and reports/: a scene must not change its name when a Scene learns more physics
    hashes = {
        "accelerating-40": "9858599c934d30bb63c923afc95a1d5bbbf55ea910fce7a0ea30defee10e6dc8",
        "decelerating-40": "78cb53a62263adca587f59d8c2e757bd4b4a9a0f6bc45af0e486b21e7df62c34",
    }
    assert {name: load_scene(name).content_hash for name in hashes} == hashes


WALLS = {"wall_left": Wall(stiffness=1e9), "wall_right": Wall(stiffness=2e9, exponent=3.0)}


def test_a_precompressed_contact_starts_with_the_overlap_that_carries_the_force() -> None:
    c = _scene(precompression=10.0, exponent=(2.5, 2.0), **WALLS).contacts
    assert np.all(c.gap < 0.0)
    carried = c.stiffness * (-c.gap) ** (c.exponent - 1.0)
    # overlaps are rounded once, forces go with the power n - 1
    assert carried == pytest.approx(np.full(4, 10.0), rel=8 * 2.0**-52)


def test_a_wall_that_gravity_points_to_bears_the_weight_of_all_above() -> None:
    mass = np.array(GOOD["mass"])
    down = _scene(precompression=10.0, gravity=9.81, **WALLS).contacts
    up = _scene(precompression=10.0, gravity=-9.81, **WALLS).contacts
    above = {0: mass[0], 1: mass[:2].sum(), 2: 0.0, 3: mass.sum()}
    below = {0: mass[1:].sum(), 1: mass[2], 2: mass.sum(), 3: 0.0}
    for c, weights in ((down, above), (up, below)):
        carried = c.stiffness * (-c.gap) ** (c.exponent - 1.0)
        assert carried == pytest.approx([10.0 + 9.81 * weights[k] for k in range(4)], rel=1e-14)


def test_an_end_without_a_wall_is_pressed_by_a_load_towards_the_chain() -> None:
    assert _scene(precompression=10.0).load.tolist() == [10.0, 0.0, -10.0]
    assert _scene(precompression=10.0, wall_left=WALLS["wall_left"]).load.tolist() == [0.0, 0.0, -10.0]
    assert _scene(precompression=10.0, wall_right=WALLS["wall_right"]).load.tolist() == [10.0, 0.0, 0.0]
    assert _scene(precompression=10.0, **WALLS).load.tolist() == [0.0, 0.0, 0.0]
    assert _scene().load.tolist() == [0.0, 0.0, 0.0]


def test_the_acceleration_without_contact_is_that_of_weight_and_load() -> None:
    free = _scene(precompression=10.0, gravity=2.0).free_acceleration
    assert free == pytest.approx([2.0 + 10.0 / 8.1e-3, 2.0, 2.0 - 10.0 / 2e-2], rel=1e-15)
    assert _scene(gravity=9.81).free_acceleration.tolist() == [9.81] * 3


def test_one_body_between_loads_is_free() -> None:
    alone = Scene(name="one", duration=1.0, mass=(1.0,), stiffness=(), velocity=(1.0,), precompression=3.0)
    assert alone.free_acceleration.tolist() == [0.0]


def test_one_coefficient_of_damping_stands_for_all_contacts_walls_included() -> None:
    damping = _scene(damping=Damping(law="dashpot", coefficient=3), **WALLS).damping
    assert damping == Damping(law="dashpot", coefficient=(3.0,) * 4)
    assert _scene(damping=Damping(law="dashpot", coefficient=(0.0, 1.0))).damped


def test_left_and_right_wall_have_different_hashes() -> None:
    wall = Wall(stiffness=1e9)
    assert _scene(wall_left=wall).content_hash != _scene(wall_right=wall).content_hash


def test_the_hash_does_not_see_words_or_ways_of_writing() -> None:
    same = _scene(name="other", description="words", mass=list(GOOD["mass"]), exponent=(2.5, 2.5), gap=[0, 0])
    assert same.content_hash == _scene().content_hash


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"mass": (8.1e-3, -1e-2, 2e-2)}, ("mass[1]", "-0.01", "> 0 (kg)")),
        ({"mass": (0.0, 1e-2, 2e-2)}, ("mass[0]", "0.0", "> 0 (kg)")),
        ({"mass": ()}, ("mass", "is empty", "at least one body")),
        ({"mass": 1.0}, ("mass", "1.0", "a list")),
        ({"mass": "abc"}, ("mass", "'abc'", "a list")),
        ({"mass": None}, ("mass", "None", "a list")),
        ({"mass": (True, 1.0, 1.0)}, ("mass[0]", "True", "> 0 (kg)")),
        ({"stiffness": (4e9,)}, ("stiffness", "has 1 entries", "2, one per contact")),
        ({"stiffness": (4e9, math.inf)}, ("stiffness[1]", "inf", "> 0 (N/m^(n-1))")),
        ({"stiffness": (4e9, -5e9)}, ("stiffness[1]", "-5000000000.0", "> 0 (N/m^(n-1))")),
        ({"velocity": (0.8, 0.0)}, ("velocity", "has 2 entries", "3, one per body")),
        ({"velocity": (0.8, math.nan, 0.0)}, ("velocity[1]", "nan", "a finite number (m/s)")),
        ({"velocity": (0.8, "0", 0.0)}, ("velocity[1]", "'0'", "a finite number (m/s)")),
        ({"exponent": 1.0}, ("exponent", "1.0", "n > 1")),
        ({"exponent": (2.5, 0.5)}, ("exponent[1]", "0.5", "n > 1")),
        ({"exponent": (2.5, 2.5, 2.5)}, ("exponent", "has 3 entries", "2, one per contact")),
        ({"exponent": True}, ("exponent", "True", "n > 1")),
        ({"gap": (0.0, math.inf)}, ("gap[1]", "inf", "a finite number (m)")),
        ({"duration": 0.0}, ("duration", "0.0", "> 0 (s)")),
        ({"duration": math.nan}, ("duration", "nan", "> 0 (s)")),
        ({"duration": "1"}, ("duration", "'1'", "> 0 (s)")),
        ({"gravity": math.inf}, ("gravity", "inf", "a finite number (m/s^2)")),
        ({"precompression": -1.0}, ("precompression", "-1.0", "a number >= 0 (N)")),
        ({"precompression": math.inf}, ("precompression", "inf", "a number >= 0 (N)")),
        ({"precompression": "10"}, ("precompression", "'10'", "a number >= 0 (N)")),
        ({"precompression": 10.0, "gap": (0.0, 1e-6)}, ("precompression", "contact 1 has a gap", "gaps of 0")),
        (
            {"precompression": 10.0, "wall_right": Wall(stiffness=1e9, gap=-1e-6)},
            ("precompression", "contact 2 has a gap", "gaps of 0"),
        ),
        ({"precompression": 1e30, "exponent": 1.1}, ("precompression", "an overlap of", "1e-40 to 1e+40 m")),
        ({"precompression": 1e-9, "exponent": 1.01}, ("precompression", "an overlap of", "1e-40 to 1e+40 m")),
        ({"drag": -0.1}, ("drag", "-0.1", "a number >= 0 (1/s)")),
        ({"drag": math.nan}, ("drag", "nan", "a number >= 0 (1/s)")),
        ({"damping": "dashpot"}, ("damping", "'dashpot'", "a Damping or None")),
        (
            {"damping": Damping(law="hunt", coefficient=1.0)},
            ("damping.law", "'hunt'", "dashpot or mass_velocity or kuwabara-kono"),
        ),
        (
            {"damping": Damping(law="dashpot", coefficient=-1.0)},
            ("damping.coefficient", "-1.0", "a number >= 0 (N s/m)"),
        ),
        (
            {"damping": Damping(law="kuwabara-kono", coefficient=(1e-6, math.inf))},
            ("damping.coefficient[1]", "inf", "a number >= 0 (s)"),
        ),
        (
            {"damping": Damping(law="dashpot", coefficient=(1.0,)), "wall_left": Wall(stiffness=1.0)},
            ("damping.coefficient", "has 1 entries", "3, one per contact, walls included"),
        ),
        (
            {"damping": Damping(law="kuwabara-kono", coefficient=1e-6), "exponent": (2.5, 1.5)},
            ("damping", "contact 1, whose exponent n is 1.5", "n >= 2"),
        ),
        ({"spacing": 0.0}, ("spacing", "0.0", "> 0 (m)")),
        ({"samples": 0}, ("samples", "0", "a whole number >= 1")),
        ({"samples": 2.0}, ("samples", "2.0", "a whole number >= 1")),
        ({"samples": True}, ("samples", "True", "a whole number >= 1")),
        ({"name": ""}, ("name", "''", "1 to 100 of A-Z a-z 0-9 . _ -, a letter or digit first")),
        ({"name": "two words"}, ("name", "'two words'", "1 to 100 of A-Z a-z 0-9 . _ -, a letter or digit first")),
        ({"name": "../up"}, ("name", "'../up'", "1 to 100 of A-Z a-z 0-9 . _ -, a letter or digit first")),
        ({"name": 5}, ("name", "5", "1 to 100 of A-Z a-z 0-9 . _ -, a letter or digit first")),
        ({"wall_left": Wall(stiffness=0.0)}, ("wall_left.stiffness", "0.0", "> 0")),
        ({"wall_right": Wall(stiffness=1.0, gap=math.nan)}, ("wall_right.gap", "nan", "a finite number (m)")),
        ({"wall_right": Wall(stiffness=1.0, exponent=1.0)}, ("wall_right.exponent", "1.0", "n > 1")),
    ],
    ids=str,
)
def test_a_wrong_entry_is_refused_by_key_value_and_what_is_allowed(
    changes: dict[str, Any], parts: tuple[str, str, str]
) -> None:
    message = _message(**changes)
    key, problem, allowed = parts
    assert message.startswith(f"scene: {key} ")
    assert problem in message
    assert allowed in message.split("allowed:")[1]


def test_a_whole_number_beyond_all_floats_is_refused() -> None:
    _message(duration=10**400)


def test_a_wall_that_is_no_wall_is_refused() -> None:
    _message(wall_left={"stiffness": 1e9})


def test_an_array_without_dimensions_is_refused() -> None:
    _message(mass=np.array(1.0))


@pytest.mark.parametrize(
    "name",
    # what LAMMPS reads otherwise in a deck (comments, variables, continuation, quotes, wildcards) or no file may have
    [
        "a#b",
        "a$b",
        "a${x}",
        "a$(1)",
        "a&",
        'a"b',
        "a'b",
        "a*b",
        "a%b",
        "größe",
        "a\rb",
        "a\vb",
        "a\0b",
        "x" * 300,
        "-x",
        "..",
        "three<&>",
    ],
    ids=lambda name: ascii(name)[:12],
)
def test_a_name_that_cannot_be_a_file_name_in_a_deck_is_refused(name: str) -> None:
    assert "name" in _message(name=name)


def test_a_scene_can_start_from_the_state_ahead_of_a_wave_front() -> None:
    assert _scene(velocity=(0.8, 1e-20, 1e-60)).n_body == 3


# laws that are functions


def _linear(overlap: np.ndarray) -> np.ndarray:
    return np.asarray(5e6 * overlap)


HERTZ = power_law(4e9, 2.5)


def test_one_law_stands_for_all_contacts_walls_included_and_a_list_has_one_each() -> None:
    walled = {"wall_left": Wall(stiffness=1e9)}
    scene = _scene(law=_linear, **walled)
    assert (scene.law, scene.contacts.law.tolist(), len(scene.contacts.laws)) == ((_linear,) * 3, [0, 0, 0], 1)
    several = _scene(law=[HERTZ, _linear, HERTZ], **walled)
    assert (several.law, several.contacts.law.tolist()) == ((HERTZ, _linear, HERTZ), [0, 1, 0])
    assert replace(several) == several
    assert replace(several).content_hash == several.content_hash
    force = several.contacts.force(np.full((2, 3), 1e-6), np.array([1, 0, 2]))
    assert force == pytest.approx(np.array([[5.0, 4.0, 4.0]] * 2), rel=1e-15)


def test_without_laws_contacts_are_powers() -> None:
    c = _scene().contacts
    assert (c.laws, c.law.tolist(), c.reach.tolist()) == ((), [-1, -1], [])
    overlap = np.array([1e-6, 2e-6])
    np.testing.assert_array_equal(c.force(overlap, np.arange(2)), c.stiffness * overlap**1.5)
    np.testing.assert_array_equal(c.energy(overlap[:1], np.array([1])), c.stiffness[1:] * overlap[:1] ** 2.5 / 2.5)


@given(scene=scenes(walls=True, gravity=True))
def test_a_law_reaches_as_deep_as_the_energy_at_hand_can_press(scene: Scene) -> None:
    linear = replace(scene, law=_linear)
    mass, speed = sum(scene.mass), np.array(scene.velocity)
    pressed = np.maximum(-linear.contacts.gap, 0.0)
    energy = 0.5 * float(np.sum(np.array(scene.mass) * speed**2)) + float(np.sum(0.5 * 5e6 * pressed**2))
    # nothing falls faster than all of it in one body: sqrt(2 energy / mass) grows by g t
    energy = 0.5 * mass * (math.sqrt(2.0 * energy / mass) + abs(scene.gravity) * scene.duration) ** 2
    if energy > 0.0 and linear.n_contact:
        deepest = math.sqrt(2.0 * energy / 5e6)
        # 5 % of energy and an eighth of the overlap are left over at most
        assert deepest < linear.contacts.reach[0] < 1.16 * deepest


def test_a_law_is_known_by_its_values() -> None:
    expected = _scene(law=_linear).content_hash
    assert _scene(law=lambda overlap: 5e6 * overlap).content_hash == expected
    # summed otherwise it differs in its last digit, as from library to library
    assert _scene(law=lambda overlap: 5e6 * (overlap / 3.0) + overlap * (1e7 / 3.0)).content_hash == expected
    others = [
        _scene(),
        _scene(law=lambda overlap: 5e6 * (1.0 + 1e-9) * overlap),
        # only far from the largest overlap
        _scene(law=lambda overlap: 5e6 * overlap + 1e-3 * np.minimum(overlap / 1e-9, 1.0)),
        _scene(law=ContactLaw(_linear, lambda overlap: 2.5e6 * overlap**2, kinks=(1e-6,))),
        _scene(law=(_linear, lambda overlap: 6e6 * overlap)),
        _scene(law=(lambda overlap: 6e6 * overlap, _linear)),
    ]
    assert len({expected, *(scene.content_hash for scene in others)}) == 1 + len(others)


@pytest.mark.parametrize(
    ("law", "parts"),
    [
        ("hertz", "law = 'hertz'"),
        (5.0, "law = 5.0"),
        ((_linear,), "law has 1 entries; allowed: 2, one per contact, walls included"),
        ((_linear, 5.0), "law[1] = 5.0; allowed: a ContactLaw, or its force (N)"),
        (lambda overlap: -overlap, "law[0] = -"),
        (lambda overlap: 1.0 + overlap, "law[0] = 1.0 N at overlap 0"),
        (lambda overlap: np.where(overlap < 3e-6, 1e6 * overlap, np.nan), "law[0] = nan N at overlap 3e-06 m"),
        ((_linear, lambda overlap: np.inf * overlap), "law[1] = nan N at overlap 0"),
        (lambda overlap: 1e6 * math.sqrt(overlap), "law[0] raises TypeError on an array of overlaps"),
        (lambda overlap: 1e6, "law[0] returns an array of shape ()"),
        (lambda overlap: 1e7 * overlap * np.exp(-overlap / 1e-6), "law[0] falls from "),
        (lambda overlap: 0.0 * overlap, "law[0] stores 0 J at an overlap of "),
        (ContactLaw(HERTZ.force, power_law(4e9 * (1.0 + 1e-5), 2.5).energy), "law[0] has an energy of "),
        (ContactLaw(HERTZ.force, lambda overlap: np.nan * overlap), "law[0] has an energy of nan J"),
        (ContactLaw(HERTZ.force, lambda overlap: HERTZ.energy(overlap) + 1e-6), "law[0] has an energy of 1e-06 J"),
    ],
)
def test_what_is_no_law_is_refused_in_one_line(law: Any, parts: str) -> None:
    message = _message(law=law)
    assert message.startswith(f"scene: {parts}")
    assert "allowed: " in message


def test_laws_are_refused_beside_physics_that_is_known_for_powers_only() -> None:
    message = _message(law=_linear, precompression=10.0)
    assert message == (
        "scene: precompression = 10.0, but contacts have laws;"
        " allowed: 0, since static overlaps are computed for powers only"
    )
    message = _message(law=_linear, damping=Damping(law="kuwabara-kono", coefficient=1e-6))
    assert message == (
        "scene: damping.law = 'kuwabara-kono', but contacts have laws;"
        " allowed: dashpot or mass_velocity; the others are defined for powers only"
    )


def test_a_law_with_a_wall_behind_some_overlap_ends_before_it() -> None:
    scene = _scene(law=lambda overlap: 1e8 * overlap / (1.0 - overlap / 1e-5))
    assert 5e-6 < scene.contacts.reach[0] < 1e-5
