"""Scene files: both forms load, and every mistake is one line with file, key, value and what is allowed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import SceneError
from dem_bridge.scene import Damping, Wall
from dem_bridge.scene_file import load_scene, parse_scene, shipped_scenes
from tests.truth import Truth

RAW = """\
name = "two-sizes"
description = "words"
duration = 1.0e-3
[chain]
mass = [8.1e-3, 10.1e-3, 10.1e-3]
stiffness = [3.98e9, 7.27e10]
exponent = 2.5
gap = [0.0, 1e-6]
velocity = [0.8, 0.0, 0.0]
[chain.wall_right]
stiffness = 3.0e9
gap = 2e-6
[environment]
gravity = 9.81
[sampling]
count = 50
"""

PHYSICAL = """\
name = "graded"
duration = 3.0e-3
[material]
youngs_modulus = 72.0e9
poissons_ratio = 0.17
density = 2200.0
[chain.cylinders]
count = 5
radius = 9.0e-3
height = 18.0e-3
[chain.contacts]
law = "paper"
first_angle = 2.0
last_angle = 90.0
grading = "linear-stiffness"
[chain.striker]
mass = 8.1e-3
velocity = 0.8
stiffness = 3.98e9
"""


def _refusal(text: str) -> str:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, where="taper.toml")
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("taper.toml: ")
    return message


def _changed(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"{old!r} must occur once"
    return text.replace(old, new)


def test_a_raw_file_becomes_the_scene_that_it_describes() -> None:
    scene = parse_scene(RAW)
    assert (scene.name, scene.description, scene.duration) == ("two-sizes", "words", 1e-3)
    assert scene.mass == (8.1e-3, 10.1e-3, 10.1e-3)
    assert scene.stiffness == (3.98e9, 7.27e10)
    assert (scene.exponent, scene.gap) == ((2.5, 2.5), (0.0, 1e-6))
    assert scene.velocity == (0.8, 0.0, 0.0)
    assert scene.wall_right == Wall(stiffness=3e9, gap=2e-6, exponent=2.5)
    assert scene.wall_left is None
    assert (scene.gravity, scene.samples, scene.spacing) == (9.81, 50, None)


def test_what_a_raw_file_leaves_out_has_the_documented_defaults() -> None:
    scene = parse_scene('name = "short"\nduration = 1.0\n[chain]\nmass = [1, 2]\nstiffness = [3]\nvelocity = [1, 0]\n')
    assert (scene.exponent, scene.gap, scene.gravity, scene.samples) == ((2.5,), (0.0,), 0.0, 500)
    assert (scene.wall_left, scene.wall_right, scene.spacing, scene.description) == (None, None, None, "")


def test_lists_of_exponents_and_a_single_gap_are_taken() -> None:
    text = _changed(_changed(RAW, "exponent = 2.5", "exponent = [2.5, 2.4]"), "gap = [0.0, 1e-6]", "gap = 1e-7")
    scene = parse_scene(text)
    assert (scene.exponent, scene.gap) == ((2.5, 2.4), (1e-7, 1e-7))


def test_the_shipped_scenes_load_by_name() -> None:
    assert shipped_scenes() == ("accelerating-40", "decelerating-40")
    for name in shipped_scenes():
        scene = load_scene(name)
        assert (scene.name, scene.n_body, scene.n_contact, scene.samples) == (name, 41, 40, 500)
        assert db.load_scene(name) == scene


def test_the_shipped_decelerating_chain_has_the_papers_numbers() -> None:
    scene = load_scene("decelerating-40")
    # the paper's section 2 and 3; 12 significant digits where a formula gives them
    assert (scene.duration, scene.spacing) == (3e-3, 18e-3)
    assert (scene.mass[0], scene.stiffness[0]) == (8.1e-3, 3.98e9)
    assert scene.velocity == (0.8, *[0.0] * 40)
    assert scene.stiffness[1] == pytest.approx(7.27299328384e10, rel=5e-13)
    assert scene.stiffness[-1] == pytest.approx(4.689197642511e9, rel=5e-13)
    assert set(scene.mass[1:]) == {float(f"{2200.0 * math.pi * 9e-3**2 * 18e-3:.12g}")}
    # linear: second differences vanish but for the rounding to 12 digits of numbers up to 7.3e10
    assert np.max(np.abs(np.diff(scene.stiffness[1:], n=2))) <= 4 * 0.5 * 0.1


def test_the_shipped_chains_mirror_each_others_stiffness() -> None:
    slow, fast = load_scene("decelerating-40"), load_scene("accelerating-40")
    assert (slow.mass, slow.velocity) == (fast.mass, fast.velocity)
    # both ends and the steps between are each rounded in another order: the 12th digit of 7.3e10
    assert slow.stiffness[:0:-1] == pytest.approx(fast.stiffness[1:], abs=0.1)


def test_the_shipped_chains_are_the_truth_files_up_to_the_printed_digits(
    decelerating: Truth, accelerating: Truth
) -> None:
    for name, truth in (("decelerating-40", decelerating), ("accelerating-40", accelerating)):
        scene = load_scene(name)
        # the truth files use the printed betas 7.27e10 and 4.68e9: 3 digits, the second 0.2 % below any angle's
        assert scene.stiffness == pytest.approx(truth.scene.stiffness, rel=2.5e-3)
        assert scene.mass == pytest.approx(truth.scene.mass, rel=1e-11)


def test_numbers_from_formulas_have_12_significant_digits() -> None:
    scene = parse_scene(PHYSICAL)
    for number in (*scene.mass, *scene.stiffness):
        assert number == float(f"{number:.12g}")


def test_a_physical_file_may_have_walls_gravity_and_a_sampling() -> None:
    text = PHYSICAL + "[chain.wall_right]\nstiffness = 4e9\n[environment]\ngravity = -9.81\n[sampling]\ncount = 7\n"
    scene = parse_scene(text)
    assert scene.wall_right == Wall(stiffness=4e9, gap=0.0, exponent=2.5)
    assert (scene.gravity, scene.samples, scene.n_body, scene.n_contact) == (-9.81, 7, 6, 6)


def test_a_file_is_loaded_by_its_path(tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    file.write_text(RAW)
    assert load_scene(file) == load_scene(str(file)) == parse_scene(RAW)


OPTIONAL = """\
[chain.precompression]
force = 10.0
[chain.damping]
law = "kuwabara-kono"
coefficient = [1e-6, 2e-6, 0]
[environment]
gravity = 9.81
drag = 0.5
"""
PRESSED = (
    RAW.replace("gap = [0.0, 1e-6]\n", "")
    .replace("gap = 2e-6\n", "")
    .replace("[environment]\ngravity = 9.81\n", OPTIONAL)
)


def test_a_raw_file_may_have_precompression_damping_and_drag() -> None:
    scene = parse_scene(PRESSED)
    assert (scene.precompression, scene.drag, scene.gravity) == (10.0, 0.5, 9.81)
    assert scene.damping == Damping(law="kuwabara-kono", coefficient=(1e-6, 2e-6, 0.0))
    assert scene.contacts.gap[2] == pytest.approx(-(((10.0 + 9.81 * 28.3e-3) / 3e9) ** (2.0 / 3.0)), rel=1e-14)
    single = parse_scene(PRESSED.replace("[1e-6, 2e-6, 0]", "3e-6"))
    assert single.damping == Damping(law="kuwabara-kono", coefficient=(3e-6,) * 3)


def test_a_physical_file_may_have_precompression_damping_and_drag() -> None:
    text = PHYSICAL + OPTIONAL.replace("[1e-6, 2e-6, 0]", "1e-6").replace("force = 10.0", "force = 2")
    scene = parse_scene(text)
    assert (scene.precompression, scene.drag, scene.load[0]) == (2.0, 0.5, 2.0)
    assert scene.damping == Damping(law="kuwabara-kono", coefficient=(1e-6,) * 5)


WRONG_PRESSED = {
    "negative force": ("force = 10.0", "force = -1", "chain.precompression.force = -1.0", ">= 0 (N)"),
    "no force": ("force = 10.0", "", "chain.precompression.force is missing", "force"),
    "force misspelt": ("force = 10.0", "forces = 10.0", "chain.precompression.forces is an unknown key", "force"),
    "force a string": ("force = 10.0", "force = '10 N'", "chain.precompression.force = '10 N'", "number"),
    "force beside a gap": (
        "velocity =",
        "gap = [0, 1e-6]\nvelocity =",
        "precompression.force = 10.0, and",
        "gaps of 0",
    ),
    "unknown law": ("kuwabara-kono", "tsuji", "chain.damping.law = 'tsuji'", "'dashpot' or 'kuwabara-kono'"),
    "no law": ('law = "kuwabara-kono"\n', "", "chain.damping.law is missing", "law, coefficient"),
    "no coefficient": ("coefficient = [1e-6, 2e-6, 0]", "", "chain.damping.coefficient is missing", "coefficient"),
    "negative coefficient": (
        "[1e-6, 2e-6, 0]",
        "[1e-6, -2e-6, 0]",
        "chain.damping.coefficient[1] = -2e-06",
        ">= 0 (s)",
    ),
    "coefficient for no wall": ("[1e-6, 2e-6, 0]", "[1e-6, 2e-6]", "chain.damping.coefficient has 2", "3, one per"),
    "coefficient a string": ("[1e-6, 2e-6, 0]", "[1e-6, 'a', 0]", "chain.damping.coefficient[1] = 'a'", "number"),
    "key of damping misspelt": ("coefficient =", "gamma =", "chain.damping.gamma is an unknown key", "coefficient"),
    "law for another exponent": ("exponent = 2.5", "exponent = 1.8", "chain.damping has the law", "n >= 2"),
    "negative drag": ("drag = 0.5", "drag = -0.5", "environment.drag = -0.5", ">= 0 (1/s)"),
    "drag a list": ("drag = 0.5", "drag = [0.5]", "environment.drag = [0.5]", "number"),
}


@pytest.mark.parametrize(("old", "new", "found", "allowed"), WRONG_PRESSED.values(), ids=WRONG_PRESSED)
def test_a_mistake_in_optional_physics_is_named_in_one_line(old: str, new: str, found: str, allowed: str) -> None:
    message = _refusal(_changed(PRESSED, old, new))
    assert found in message
    assert allowed in message.split("allowed:")[1]


WRONG_RAW = {
    "unknown key": ("exponent = 2.5", "exponnent = 2.5", "chain.exponnent is an unknown key", "exponent"),
    "unknown table": ("[sampling]", "[samplings]", "samplings is an unknown key", "sampling"),
    "unknown key in a wall": ("gap = 2e-6", "gapp = 2e-6", "chain.wall_right.gapp is an unknown key", "gap"),
    "unknown key in a subtable": ("count = 50", "counts = 50", "sampling.counts is an unknown key", "count"),
    "physics that is not there": (
        "[environment]",
        "[chain.friction]\n[environment]",
        "chain.friction is an unknown",
        "mass",
    ),
    "missing key": ("stiffness = [3.98e9, 7.27e10]\n", "", "chain.stiffness is missing", "stiffness"),
    "missing name": ('name = "two-sizes"\n', "", "name is missing", "name"),
    "missing in a wall": ("stiffness = 3.0e9\n", "", "chain.wall_right.stiffness is missing", "stiffness"),
    "too short": ("velocity = [0.8, 0.0, 0.0]", "velocity = [0.8]", "chain.velocity has 1 entries", "3, one per body"),
    "too long": ("gap = [0.0, 1e-6]", "gap = [0, 0, 0]", "chain.gap has 3 entries", "2, one per contact"),
    "empty": ("mass = [8.1e-3, 10.1e-3, 10.1e-3]", "mass = []", "chain.mass is empty", "at least one body"),
    "negative": ("[8.1e-3,", "[-8.1e-3,", "chain.mass[0] = -0.0081", "> 0 (kg)"),
    "zero": ("duration = 1.0e-3", "duration = 0", "duration = 0.0", "> 0 (s)"),
    "nan": ("[0.8,", "[nan,", "chain.velocity[0] = nan", "finite"),
    "inf": ("7.27e10]", "inf]", "chain.stiffness[1] = inf", "> 0"),
    "nan in a wall": ("gap = 2e-6", "gap = nan", "chain.wall_right.gap = nan", "finite"),
    "inf in a subtable": ("gravity = 9.81", "gravity = -inf", "environment.gravity = -inf", "finite"),
    "string for a number": ("duration = 1.0e-3", 'duration = "1 ms"', "duration = '1 ms'", "number"),
    "string in a list": ("[8.1e-3,", '["8.1e-3",', "chain.mass[0] = '8.1e-3'", "number"),
    "bool for a number": ("gravity = 9.81", "gravity = true", "environment.gravity = True", "number"),
    "bool in a list": ("[8.1e-3,", "[true,", "chain.mass[0] = True", "number"),
    "bool for a count": ("count = 50", "count = true", "sampling.count = True", "whole number"),
    "fraction for a count": ("count = 50", "count = 50.5", "sampling.count = 50.5", "whole number"),
    "no samples": ("count = 50", "count = 0", "sampling.count = 0", "whole number >= 1"),
    "number for a list": ("mass = [8.1e-3, 10.1e-3, 10.1e-3]", "mass = 8.1e-3", "chain.mass = 0.0081", "list"),
    "list in a list": ("[0.8, 0.0, 0.0]", "[0.8, [0.0], 0.0]", "chain.velocity[1] = [0.0]", "number"),
    "date for a number": (
        "duration = 1.0e-3",
        "duration = 1979-05-27",
        "duration = datetime.date(1979, 5, 27)",
        "number",
    ),
    "exponent too small": ("exponent = 2.5", "exponent = 1.0", "chain.exponent = 1.0", "n > 1"),
    "exponent in a list": ("exponent = 2.5", "exponent = [2.5, 0.9]", "chain.exponent[1] = 0.9", "n > 1"),
    "number for a table": ("[sampling]\ncount = 50", "sampling = 50", "sampling", "count"),
    "list of tables": ("[sampling]", "[[sampling]]", "sampling", "count"),
    "number for a name": ('name = "two-sizes"', "name = 2", "name = 2", "string"),
    "name with a space": ('name = "two-sizes"', 'name = "two sizes"', "name = 'two sizes'", "A-Z a-z 0-9"),
}


@pytest.mark.parametrize(("old", "new", "found", "allowed"), WRONG_RAW.values(), ids=WRONG_RAW)
def test_a_mistake_in_a_raw_file_is_named_in_one_line(old: str, new: str, found: str, allowed: str) -> None:
    message = _refusal(_changed(RAW, old, new) if "sampling = 50" not in new else _sampling_first(new))
    assert found in message
    assert allowed in message.split("allowed:")[1]


def _sampling_first(line: str) -> str:
    """A plain key has to stand above the tables."""
    return f"{line}\n" + RAW.split("[sampling]")[0]


WRONG_PHYSICAL = {
    "unknown key": ("poissons_ratio", "poisson_ratio", "material.poisson_ratio is an unknown key", "poissons_ratio"),
    "missing table": ("[chain.striker]", "[chain.hammer]", "chain.hammer is an unknown key", "striker"),
    "missing key": ("density = 2200.0\n", "", "material.density is missing", "density"),
    "raw key in physical form": (
        "[chain.cylinders]",
        "[chain]\nmass = [1.0]\n[chain.cylinders]",
        "chain.mass",
        "cylinders",
    ),
    "negative": ("radius = 9.0e-3", "radius = -9.0e-3", "chain.cylinders.radius = -0.009", "greater than 0"),
    "nan": ("density = 2200.0", "density = nan", "material.density = nan", "finite"),
    "string": ("velocity = 0.8", 'velocity = "fast"', "chain.striker.velocity = 'fast'", "number"),
    "bool": ("mass = 8.1e-3", "mass = true", "chain.striker.mass = True", "number"),
    "too few cylinders": ("count = 5", "count = 1", "chain.cylinders.count = 1", "greater than or equal to 2"),
    "angle 0": ("first_angle = 2.0", "first_angle = 0.0", "chain.contacts.first_angle = 0.0", "greater than 0"),
    "angle 91": (
        "last_angle = 90.0",
        "last_angle = 91.0",
        "chain.contacts.last_angle = 91.0",
        "less than or equal to 90",
    ),
    "unknown law": ('law = "paper"', 'law = "johnson"', "chain.contacts.law = 'johnson'", "paper"),
    "unknown grading": ('"linear-stiffness"', '"linear"', "chain.contacts.grading = 'linear'", "linear-stiffness"),
    "poisson beyond 1/2": ("0.17", "0.51", "material.poissons_ratio = 0.51", "0.5"),
    "no duration": ("duration = 3.0e-3", "duration = -3.0", "duration = -3.0", "> 0 (s)"),
}


@pytest.mark.parametrize(("old", "new", "found", "allowed"), WRONG_PHYSICAL.values(), ids=WRONG_PHYSICAL)
def test_a_mistake_in_a_physical_file_is_named_in_one_line(old: str, new: str, found: str, allowed: str) -> None:
    message = _refusal(_changed(PHYSICAL, old, new))
    assert found in message
    assert allowed in message.split("allowed:")[1]


def test_an_unknown_key_comes_before_the_key_it_was_meant_to_be() -> None:
    message = _refusal(_changed(RAW, "stiffness = [3.98e9", "stifness = [3.98e9"))
    assert "chain.stifness is an unknown key" in message
    assert message.endswith("1 more to mend after this")


@pytest.mark.parametrize(("number", "line"), [(1, "name ="), (3, "x = = 1"), (2, 'd = "open')])
def test_broken_toml_is_named_with_its_line(number: int, line: str) -> None:
    message = _refusal("\n" * (number - 1) + line + "\n")
    assert "not TOML" in message
    assert f"line {number}" in message


def test_an_empty_file_is_refused() -> None:
    assert "name is missing" in _refusal("")


def test_an_unknown_scene_is_refused_with_the_names_that_exist() -> None:
    with pytest.raises(SceneError, match=r"^slowing-40: no such scene; allowed: accelerating-40, decelerating-40, or"):
        load_scene("slowing-40")


def test_a_directory_is_no_scene(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no such scene"):
        load_scene(tmp_path)


def test_a_binary_file_is_refused_by_name(tmp_path: Path) -> None:
    file = tmp_path / "dump.toml"
    file.write_bytes(bytes(range(256)))
    with pytest.raises(SceneError, match="cannot be read") as caught:
        load_scene(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_file_is_named_by_the_path_that_was_given(tmp_path: Path) -> None:
    file = tmp_path / "taper.toml"
    file.write_text(_changed(RAW, "[0.8,", "[nan,"))
    with pytest.raises(SceneError) as caught:
        load_scene(file)
    assert str(caught.value) == f"{file}: chain.velocity[0] = nan; allowed: a finite number (m/s)"


@pytest.mark.parametrize("key", ["exponent", "gap"])
def test_a_wrong_entry_of_a_list_that_may_be_a_number_is_named(key: str) -> None:
    old = {"exponent": "exponent = 2.5", "gap": "gap = [0.0, 1e-6]"}[key]
    assert f"chain.{key}[1] = 'a'" in _refusal(_changed(RAW, old, f"{key} = [2.5, 'a']"))


@pytest.mark.parametrize("key", ["exponent", "gap"])
def test_one_mistake_is_not_counted_as_two(key: str) -> None:
    old = {"exponent": "exponent = 2.5", "gap": "gap = [0.0, 1e-6]"}[key]
    assert "more to mend" not in _refusal(_changed(RAW, old, f"{key} = 'soft'"))


def test_a_key_with_a_line_feed_is_still_named_in_one_line() -> None:
    _refusal(_changed(RAW, "count = 50", '"a\\nb" = 50'))


def test_two_cylinders_with_two_different_angles_are_refused() -> None:
    _refusal(_changed(PHYSICAL, "count = 5", "count = 2"))
