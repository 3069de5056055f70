"""Scene files: both forms load, and every mistake is one line with file, key, value and what is allowed."""

from __future__ import annotations

import math
import os
import random
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

import dem_bridge as db
from dem_bridge.errors import SceneError
from dem_bridge.physics.contact_ellipse import cylinder_stiffness_paper
from dem_bridge.scene.file import MAIN_SCENES, load_scene, parse_scene
from dem_bridge.scene.file.conversion import scattered
from dem_bridge.scene.scene import DAMPING_LAWS, Damping, Scene, Wall
from tests.helpers.quadruple_truth import Truth

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


def test_the_main_scenes_load_by_name() -> None:
    for name in MAIN_SCENES:
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


QUARTZ: dict[str, float] = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}
GRADED = """\
first_angle = 2.0
last_angle = 90.0
grading = "linear-stiffness"
"""
SPHERES = """\
name = "spheres"
duration = 1.0e-3
[material]
youngs_modulus = 72.0e9
poissons_ratio = 0.17
density = 2200.0
[chain.spheres]
count = 4
radius = 9.0e-3
ratio = 0.5
[chain.striker]
radius = 9.0e-3
velocity = 0.8
"""


def _angles(scene: Scene) -> tuple[float | None, ...]:
    assert scene.geometry is not None
    return scene.geometry.angle


def test_a_physical_file_says_what_its_bodies_are() -> None:
    geometry = parse_scene(PHYSICAL).geometry
    assert geometry is not None
    assert [body.shape for body in geometry.bodies] == ["sphere", *["cylinder"] * 5]
    # a striker without radius is the sphere of its mass
    assert geometry.bodies[0].mass == pytest.approx(8.1e-3, rel=1e-15)
    assert (geometry.bodies[1].height, geometry.bodies[1].material.density, geometry.law) == (18e-3, 2200.0, "paper")
    # 2 degrees and 90 were asked for; between, linear in stiffness
    assert geometry.angle[0] is None
    assert geometry.angle[1] == pytest.approx(2.0, rel=1e-12)
    assert geometry.angle[-1] == 90.0
    assert parse_scene(RAW).geometry is None


def test_raw_scenes_need_no_special_functions() -> None:
    code = (
        f"import sys; from dem_bridge.scene.file import parse_scene; parse_scene({RAW!r});"
        "sys.exit('scipy.special' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_heights_and_masses_follow_the_mass_gradient() -> None:
    scene = parse_scene(_changed(PHYSICAL, "height = 18.0e-3", "height = 18.0e-3\nmass_gradient = -0.1"))
    uniform = parse_scene(PHYSICAL)
    # m_i = m (1 + gamma i), i = 1..5; each rounded to 12 digits
    assert np.array(scene.mass[1:]) / uniform.mass[1] == pytest.approx([0.9, 0.8, 0.7, 0.6, 0.5], rel=1e-11)
    assert (scene.mass[0], scene.stiffness) == (uniform.mass[0], uniform.stiffness)
    assert scene.geometry is not None
    assert scene.geometry.bodies[-1].height == pytest.approx(9e-3, rel=1e-15)


def test_one_angle_serves_all_contacts_and_a_list_each_its_own() -> None:
    one = parse_scene(_changed(PHYSICAL, GRADED, "angle = 30.0\n"))
    assert len(set(one.stiffness[1:])) == 1
    assert one.stiffness[1] == pytest.approx(cylinder_stiffness_paper(30.0, **QUARTZ), rel=1e-11)
    assert _angles(one) == (None, *[30.0] * 4)
    each = parse_scene(_changed(PHYSICAL, GRADED, "angles = [30.0, 10, 5.0, 90.0]\n"))
    assert each.stiffness[1] == one.stiffness[1]
    assert _angles(each) == (None, 30.0, 10.0, 5.0, 90.0)


def test_the_exact_law_is_softer_than_the_papers() -> None:
    scene = parse_scene(_changed(PHYSICAL, 'law = "paper"', 'law = "exact"'))
    assert scene.stiffness[1] == pytest.approx(6.17559e10, rel=5e-6)  # the digits known
    # at 90 degrees the two are one
    assert scene.stiffness[-1] == parse_scene(PHYSICAL).stiffness[-1]
    assert scene.geometry is not None
    assert scene.geometry.law == "exact"
    assert scene.geometry.angle[1] == pytest.approx(2.0, rel=1e-12)


def test_a_striker_is_a_sphere_of_the_chains_material() -> None:
    scene = parse_scene(
        _changed(PHYSICAL, "mass = 8.1e-3\nvelocity = 0.8\nstiffness = 3.98e9", "velocity=1\nradius=9e-3")
    )
    assert scene.mass[0] == pytest.approx(2200.0 * 4.0 / 3.0 * math.pi * 9e-3**3, rel=1e-11)
    assert scene.stiffness[0] == pytest.approx(3.98253e9, rel=5e-6)  # the digits known
    assert scene.velocity[0] == 1.0
    assert scene.geometry is not None
    assert scene.geometry.bodies[0].radius == 9e-3


def test_what_is_given_of_a_striker_comes_before_what_follows_from_its_radius() -> None:
    scene = parse_scene(_changed(PHYSICAL, "mass = 8.1e-3", "mass = 8.1e-3\nradius = 9e-3"))
    assert (scene.mass[0], scene.stiffness[0]) == (8.1e-3, 3.98e9)
    assert scene.geometry is not None
    assert scene.geometry.bodies[0].radius == 9e-3


LIKE = _changed(PHYSICAL, "mass = 8.1e-3\nvelocity = 0.8\nstiffness = 3.98e9", "velocity = 0.8\nlike = 'first-body'")


def test_a_striker_may_be_like_the_first_body() -> None:
    scene = parse_scene(_changed(LIKE, "height = 18.0e-3", "height = 18.0e-3\nmass_gradient = 0.1"))
    assert scene.mass[0] == scene.mass[1] < scene.mass[2]
    assert scene.stiffness[0] == scene.stiffness[1] > scene.stiffness[2]
    assert scene.geometry is not None
    assert scene.geometry.bodies[0] == scene.geometry.bodies[1]
    assert scene.geometry.angle[0] == scene.geometry.angle[1] == pytest.approx(2.0, rel=1e-12)


def test_an_exponent_other_than_hertz_keeps_the_force_at_the_matching_overlap() -> None:
    more = GRADED + "exponent = [2.3, 2.5, 3, 2.4]\nmatching_overlap = 4e-6\n"
    scene, hertz = parse_scene(_changed(PHYSICAL, GRADED, more)), parse_scene(PHYSICAL)
    assert scene.exponent == (2.5, 2.3, 2.5, 3.0, 2.4)
    # both rounded to 12 digits
    assert 4e-6 ** (np.array(scene.exponent) - 1.0) * scene.stiffness == pytest.approx(
        4e-6**1.5 * np.array(hertz.stiffness), rel=2e-11
    )
    assert (scene.stiffness[2], scene.stiffness[0]) == (hertz.stiffness[2], 3.98e9)
    assert _angles(scene) == _angles(hertz)


def test_the_striker_has_an_exponent_of_its_own() -> None:
    text = _changed(LIKE, GRADED, GRADED + "exponent = 2.4\nmatching_overlap = 4e-6\n")
    assert parse_scene(text).exponent == (2.4,) * 5
    text = _changed(text, "like = 'first-body'", "radius = 9e-3\nexponent = 2.2")
    scene = parse_scene(text)
    assert scene.exponent == (2.2, *[2.4] * 4)
    assert scene.stiffness[0] == pytest.approx(3.98253e9 * 4e-6**0.3, rel=5e-6)  # the digits known
    assert parse_scene(_changed(text, "\nexponent = 2.2", "")).exponent[0] == 2.5  # type: ignore[index]


def test_gaps_are_between_the_bodies_of_the_chain_and_before_the_striker() -> None:
    text = _changed(_changed(PHYSICAL, GRADED, GRADED + "gap = 1e-6\n"), "velocity = 0.8", "velocity = 0.8\ngap = 2e-6")
    assert parse_scene(text).gap == (2e-6, *[1e-6] * 4)
    assert parse_scene(_changed(text, "gap = 1e-6", "gap = [1e-6, 0, 0, -1e-7]")).gap == (2e-6, 1e-6, 0.0, 0.0, -1e-7)


def test_scattered_angles_are_the_same_with_every_library() -> None:
    # a seed is a chain, and must stay that chain
    angles = (2.0, 45.0, 90.0)
    found = scattered(angles, scatter=2.0, seed=7)
    assert found == (1.08598465, 42.9344036, 89.2243108)
    uniform = random.Random(7)
    moved = np.array(angles) + 2.0 * ndtri([uniform.random() for _ in angles])
    assert found == pytest.approx([*moved[:2], 180.0 - moved[2] if moved[2] > 90.0 else moved[2]], rel=5e-9)  # 9 digits


@given(
    angles=st.lists(st.floats(0.01, 90.0), min_size=1, max_size=20),
    scatter=st.floats(0.0, 300.0),
    seed=st.integers(0, 2**40),
)
def test_scattered_angles_are_angles(angles: list[float], scatter: float, seed: int) -> None:
    found = scattered(angles, scatter=scatter, seed=seed)
    assert len(found) == len(angles)
    assert all(0.0 <= angle <= 90.0 for angle in found)
    assert found == scattered(angles, scatter=scatter, seed=seed)
    if scatter == 0.0:
        assert found == pytest.approx(angles, rel=5e-9)  # 9 digits


def test_scatter_is_the_standard_deviation_of_each_angle() -> None:
    moved = np.array(scattered([45.0] * 10_000, scatter=2.0, seed=3)) - 45.0
    # 5 standard errors of mean and of standard deviation
    assert abs(moved.mean()) < 5 * 2.0 / 100
    assert moved.std() == pytest.approx(2.0, rel=5 / math.sqrt(2e4))
    # two axes 3 degrees apart that are turned by 5 the other way are 2 apart: mirrored at 0, and at 90 alike
    near = np.array(scattered([1.0] * 10_000, scatter=2.0, seed=3))
    assert near.min() > 0.0
    assert np.mean(near > 1.0) == pytest.approx(0.5 + 0.1587, abs=0.025)  # P(x > 0) + P(x < -1 sigma), 5 errors


def test_scatter_moves_each_angle_and_the_stiffness_with_it() -> None:
    text = _changed(PHYSICAL, GRADED, GRADED + "scatter = 0.5\nseed = 1\n")
    scene, even = parse_scene(text), parse_scene(PHYSICAL)
    angles = [angle for angle in _angles(scene) if angle is not None]
    assert angles == pytest.approx(
        scattered([a for a in _angles(even) if a is not None], scatter=0.5, seed=1), rel=1e-8
    )
    assert scene.stiffness[1:] == pytest.approx([cylinder_stiffness_paper(a, **QUARTZ) for a in angles], rel=1e-11)
    assert parse_scene(text) == scene != parse_scene(_changed(text, "seed = 1", "seed = 2"))


def test_spheres_are_tapered_by_their_ratio() -> None:
    scene = parse_scene(SPHERES)
    assert scene.geometry is not None
    assert [body.radius for body in scene.geometry.bodies] == pytest.approx([9e-3, 9e-3, 4.5e-3, 2.25e-3, 1.125e-3])
    assert np.array(scene.mass) / scene.mass[0] == pytest.approx([1.0, 1.0, 1 / 8, 1 / 64, 1 / 512], rel=1e-11)
    # beta = (4/3) E* sqrt(R): 1/R from the sum of the curvatures
    modulus = 4.0 / 3.0 * 72e9 / (2.0 * (1.0 - 0.17**2))
    radii = np.array([4.5e-3, 3e-3, 1.5e-3, 0.75e-3])
    assert scene.stiffness == pytest.approx(modulus * np.sqrt(radii), rel=1e-11)
    assert scene.spacing is None
    assert scene.geometry.angle == (None,) * 4


def test_equal_spheres_have_a_spacing_and_may_have_gaps_and_a_striker_of_their_own() -> None:
    text = _changed(SPHERES, "ratio = 0.5\n", "[chain.contacts]\ngap = [0, 1e-6, 0]\n")
    text = _changed(text, "radius = 9.0e-3\nvelocity", "mass = 1e-2\nstiffness = 1e9\nvelocity")
    scene = parse_scene(text)
    assert (scene.spacing, scene.gap, scene.mass[0], scene.stiffness[0]) == (18e-3, (0.0, 0.0, 1e-6, 0.0), 1e-2, 1e9)


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


def test_a_chain_of_spheres_states_a_surface_energy_and_a_raw_chain_a_force() -> None:
    spheres = """
name = "beads"
duration = 1e-3
[material]
youngs_modulus = 72e9
poissons_ratio = 0.17
density = 2200.0
[chain]
velocity = 0.1
[chain.spheres]
count = 3
radius = 9e-3
ratio = 0.5
[chain.contacts]
gap = 1e-6
[chain.wall_right]
stiffness = 1e9
gap = 1e-6
[chain.adhesion]
law = "dmt"
surface_energy = 0.05
"""
    radii = (3e-3, 1.5e-3, 2.25e-3)  # of 9 on 4.5, 4.5 on 2.25, and 2.25 mm on the wall
    expected = [float(f"{4.0 * math.pi * 0.05 * radius:.12g}") for radius in radii]
    assert parse_scene(spheres).contacts.pull_off.tolist() == pytest.approx(expected, rel=1e-11)
    raw = RAW + '[chain.adhesion]\nlaw = "dmt"\n'
    assert "adhesion.surface_energy requires radii" in _refusal(raw + "surface_energy = 0.05")


def test_a_file_states_the_damping_law_and_whether_forces_are_clipped() -> None:
    old = 'law = "kuwabara-kono"\ncoefficient = [1e-6, 2e-6, 0]\n'
    for law in DAMPING_LAWS:
        for words, clip in (("", True), ("clip = true\n", True), ("clip = false\n", False)):
            text = _changed(PRESSED, old, f'law = "{law}"\ncoefficient = [0.5, 1, 0.9]\n{words}')
            scene = parse_scene(text)
            assert scene.damping == Damping(law=law, coefficient=(0.5, 1.0, 0.9), clip=clip)
            assert scene.contacts.clip == clip
    free = parse_scene(_changed(PRESSED, "[1e-6, 2e-6, 0]", "1e-6\nclip = false"))
    assert free.damping is not None
    assert free.content_hash != replace(free, damping=replace(free.damping, clip=True)).content_hash


def test_damping_of_adhesive_contacts_is_not_clipped() -> None:
    glued = RAW + '[chain.adhesion]\nlaw = "dmt"\npull_off = 0.1\n[chain.damping]\nlaw = "dashpot"\ncoefficient = 0.1\n'
    for words in ("", "clip = false\n"):
        assert parse_scene(glued + words).damping == Damping(law="dashpot", coefficient=(0.1,) * 3, clip=False)
    assert "chain.damping.clip = True, but contacts have adhesion" in _refusal(glued + "clip = true\n")


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
        "precompression.force = 10.0, but",
        "gaps of 0",
    ),
    "unknown law": ("kuwabara-kono", "hertz", "chain.damping.law = 'hertz'", "dashpot or mass_velocity or kuwabara"),
    "a word of LAMMPS": (
        "kuwabara-kono",
        "viscoelastic",
        "chain.damping.law = 'viscoelastic'",
        "'kuwabara-kono', which",
    ),
    "another word of LAMMPS": ("kuwabara-kono", "velocity", "chain.damping.law = 'velocity'", "'dashpot', which is"),
    "e": ("coefficient = [1e-6, 2e-6, 0]", "e = 0.5", "damping.e is an unknown key", "law, coefficient, clip"),
    "e above 1": (
        'kuwabara-kono"\ncoefficient = [1e-6, 2e-6, 0]',
        'coeff_restitution"\ncoefficient = 1.1',
        "chain.damping.coefficient = 1.1",
        "a coefficient of restitution, above 0 and at most 1",
    ),
    "e of 0": (
        'kuwabara-kono"\ncoefficient = [1e-6, 2e-6, 0]',
        'coeff_restitution"\ncoefficient = [1, 0, 1]',
        "chain.damping.coefficient[1] = 0.0",
        "a coefficient of restitution, above 0 and at most 1",
    ),
    "clip a word": ("[1e-6, 2e-6, 0]", "1e-6\nclip = 'yes'", "chain.damping.clip = 'yes'", "true or false"),
    "no law": ('law = "kuwabara-kono"\n', "", "chain.damping.law is missing", "law, coefficient"),
    "no coefficient": ("coefficient = [1e-6, 2e-6, 0]", "", "chain.damping.coefficient is missing", "law, coefficient"),
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


STRIKER = "mass = 8.1e-3\nvelocity = 0.8\nstiffness = 3.98e9"
WRONG_BODIES = {
    "no angles": (GRADED, "", "chain.contacts has no angles", "first_angle with last_angle and grading"),
    "half a grading": (
        "last_angle = 90.0\n",
        "",
        "chain.contacts.last_angle is missing, but required",
        "with first_angle: first_angle, last_angle, grading",
    ),
    "no grading": (
        'grading = "linear-stiffness"\n',
        "",
        "chain.contacts.grading is missing, but required",
        "with first_angle: first_angle, last_angle, grading",
    ),
    "two ways": (
        GRADED,
        GRADED + "angle = 3\n",
        "chain.contacts.first_angle cannot be combined with angle",
        "angle, or angles",
    ),
    "angles for other contacts": (GRADED, "angles = [1, 2]\n", "chain.contacts.angles has 2", "4, one per contact"),
    "an angle of 0": (GRADED, "angles = [1, 2, 0, 4]\n", "chain.contacts.angles[2] = 0", "greater than 0"),
    "parallel": (GRADED, "angle = 1e-200\n", "chain.contacts cross at 1e-200 degrees", "> 0"),
    "scatter without seed": (GRADED, GRADED + "scatter = 1\n", "chain.contacts.seed is missing", "whole number"),
    "negative scatter": (GRADED, GRADED + "scatter = -1\nseed = 1\n", "chain.contacts.scatter = -1", "equal to 0"),
    "a fraction for a seed": (GRADED, GRADED + "scatter = 1\nseed = 1.5\n", "contacts.seed = 1.5", "whole number"),
    "a power that nothing matches": (
        GRADED,
        GRADED + "exponent = 2.4\n",
        "chain.contacts.matching_overlap is missing",
        "n = 2.4",
    ),
    "exponents for other contacts": (
        GRADED,
        GRADED + "exponent = [2.5, 2.5]\n",
        "chain.contacts.exponent has 2",
        "4, one per contact between the bodies",
    ),
    "an exponent of 1": (GRADED, GRADED + "exponent = 1\n", "chain.contacts.exponent = 1", "n > 1"),
    "gaps for other contacts": (GRADED, GRADED + "gap = [0]\n", "chain.contacts.gap has 1", "4, one per contact"),
    "a mass of nothing": (
        "height = 18.0e-3",
        "height = 18.0e-3\nmass_gradient = -0.2",
        "chain.cylinders.mass_gradient = -0.2",
        "> -0.2",
    ),
    "half a striker": ("stiffness = 3.98e9", "", "chain.striker.stiffness is missing", "the radius of a sphere"),
    "a striker of nothing": (STRIKER, "velocity = 1", "chain.striker.mass is missing", "like = 'first-body'"),
    "a striker like two": (
        STRIKER,
        "velocity = 1\nlike = 'first-body'\nmass = 1",
        "chain.striker.mass cannot be combined with like",
        "velocity and gap",
    ),
    "a striker like another": (STRIKER, "velocity = 1\nlike = 'last'", "chain.striker.like = 'last'", "first-body"),
    "spheres beside cylinders": (
        "[chain.contacts]",
        "[chain.spheres]\ncount = 3\nradius = 1\n[chain.contacts]",
        "chain.spheres is an unknown key",
        "cylinders",
    ),
    "a name of a material": ("density = 2200.0", "density = 2200.0\nname = 3", "material.name = 3", "string"),
}


@pytest.mark.parametrize(("old", "new", "found", "allowed"), WRONG_BODIES.values(), ids=WRONG_BODIES)
def test_bodies_that_cannot_be_are_named_in_one_line(old: str, new: str, found: str, allowed: str) -> None:
    message = _refusal(_changed(PHYSICAL, old, new))
    assert found in message
    assert allowed in message.split("allowed:")[1]


WRONG_SPHERES = {
    "angles": ("[chain.striker]", "[chain.contacts]\nangle=1\n[chain.striker]", "chain.contacts.angle is an", "gap"),
    "a ratio of 0": ("ratio = 0.5", "ratio = 0.0", "chain.spheres.ratio = 0.0", "greater than 0"),
    "a ratio beyond all": ("ratio = 0.5", "ratio = 1e30", "ratio = 1e+30 gives the last sphere", "m"),
    "one sphere": ("count = 4", "count = 1", "chain.spheres.count = 1", "equal to 2"),
    "a height": ("ratio = 0.5", "height = 0.5", "chain.spheres.height is an unknown key", "ratio"),
}


@pytest.mark.parametrize(("old", "new", "found", "allowed"), WRONG_SPHERES.values(), ids=WRONG_SPHERES)
def test_spheres_that_cannot_be_are_named_in_one_line(old: str, new: str, found: str, allowed: str) -> None:
    message = _refusal(_changed(SPHERES, old, new))
    assert found in message
    assert allowed in message.split("allowed:")[1]


def test_an_unknown_key_comes_before_the_key_it_was_meant_to_be() -> None:
    message = _refusal(_changed(RAW, "stiffness = [3.98e9", "stifness = [3.98e9"))  # codespell:ignore stifness
    assert "chain.stifness is an unknown key" in message  # codespell:ignore stifness
    assert message.endswith("did you mean 'stiffness'?")


@pytest.mark.parametrize(("number", "line"), [(1, "name ="), (3, "x = = 1"), (2, 'd = "open')])
def test_broken_toml_is_named_with_its_line(number: int, line: str) -> None:
    message = _refusal("\n" * (number - 1) + line + "\n")
    assert "is not TOML" in message
    assert f"line {number}" in message


def test_a_lammps_script_is_named_with_the_commands_that_read_it() -> None:
    message = _refusal("units si\natom_style sphere\n")
    assert "this is a LAMMPS script" in message
    assert "dem-bridge check " in message
    # an entry of a broken scene file is no command, though its key is one
    assert "is not TOML" in _refusal("velocity = [0.8, 0.0]\nx = = 1\n")


def test_an_empty_file_is_refused() -> None:
    assert "name is missing" in _refusal("")


def test_an_unknown_scene_is_refused_with_the_names_that_exist() -> None:
    with pytest.raises(
        SceneError, match=r"^slowing-40: there is no such scene or file; allowed: accelerating-"
    ) as caught:
        load_scene("slowing-40")
    assert str(caught.value).endswith("or the path of a .toml file")
    assert "dem-bridge scenes lists them" in str(caught.value)
    with pytest.raises(SceneError, match=r"or the path of a .toml file; did you mean 'stacked-40'") as caught:
        load_scene("staked-40")
    assert len(str(caught.value)) <= 500


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


def test_a_key_with_a_line_feed_is_still_named_in_one_line() -> None:
    _refusal(_changed(RAW, "count = 50", '"a\\nb" = 50'))


def test_two_cylinders_with_two_different_angles_are_refused() -> None:
    _refusal(_changed(PHYSICAL, "count = 5", "count = 2"))


@pytest.mark.parametrize(
    ("chain", "why"),
    [
        ("[chain.spheres]\ncount = 100000000\nradius = 1e-2\n", "chain.spheres.count = 100000000; allowed: "),
        ("[chain.spheres]\ncount = 10000000000000000000000\nradius = 1e-2\n", "chain.spheres.count = 1"),
        (
            "[chain.cylinders]\ncount = 100000000\nradius = 1e-2\nheight = 1e-2\n"
            "[chain.contacts]\nlaw = 'paper'\nangle = 90.0\n",
            "chain.cylinders.count = 100000000",
        ),
    ],
    ids=["spheres", "beyond 64 bits", "cylinders"],
)
def test_too_many_bodies_are_refused_before_one_is_built(chain: str, why: str) -> None:
    material = "[material]\nyoungs_modulus = 7e10\npoissons_ratio = 0.2\ndensity = 2500.0\n"
    with pytest.raises(SceneError) as caught:
        parse_scene(f"name = 'many'\nduration = 1e-3\n{material}{chain}")
    assert why in str(caught.value)


@pytest.mark.parametrize("pattern", ["repeat = 1000000000", "repeat = 9223372036854775808", "repeat = 400000"])
def test_too_many_cells_are_refused_before_one_is_built(pattern: str) -> None:
    body = "{shape = 'sphere', radius = 1e-2}"
    cell = f"cell = [{body}, {body}, {body}]"
    material = "[materials.glass]\nyoungs_modulus = 7e10\npoissons_ratio = 0.2\ndensity = 2500.0\n"
    with pytest.raises(SceneError, match=r"chain\.pattern\.repeat = \d+.* allowed: .*1000000"):
        parse_scene(f"name = 'many'\nduration = 1e-3\n{material}[chain.pattern]\n{pattern}\n{cell}\n")


def test_a_stiffness_that_overflows_is_refused_in_one_line() -> None:
    material = "[material]\nyoungs_modulus = 7e10\npoissons_ratio = 0.2\ndensity = 2500.0\n"
    chain = "[chain.spheres]\ncount = 3\nradius = 1e-2\n[chain.contacts]\nexponent = 90.1\nmatching_overlap = 1e-6\n"
    with pytest.raises(SceneError, match=r"chain\.contacts\.matching_overlap = 1e-06 .* overflows"):
        parse_scene(f"name = 'stiff'\nduration = 1e-3\n{material}{chain}")


def test_files_of_a_scene_are_below_its_folder_unless_the_user_says_otherwise(tmp_path: Path) -> None:
    (tmp_path / "force.csv").write_text("0,1\n1,1\n")
    (tmp_path / "inner").mkdir()
    scene = tmp_path / "inner" / "scene.toml"
    scene.write_text(
        "name = 'driven'\nduration = 1.0\n[chain]\nmass = [1.0]\nstiffness = []\nvelocity = [0.0]\n"
        "[chain.drive]\nshape = 'table'\nfile = '../force.csv'\n"
    )
    with pytest.raises(SceneError, match=r"drive\.file = '\.\./force\.csv' cannot be read: it is not below the folder"):
        load_scene(scene)
    assert load_scene(scene, files_below=tmp_path).drive is not None
    os.mkfifo(tmp_path / "inner" / "pipe")
    scene.write_text(scene.read_text().replace("../force.csv", "pipe"))
    with pytest.raises(SceneError, match="Is a device or a pipe"):
        load_scene(scene)
