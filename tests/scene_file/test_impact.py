"""The impact form of scene files: two spheres, or a sphere and a plane."""

from __future__ import annotations

import math

import pytest

import dem_bridge as db
from dem_bridge.errors import SceneError
from dem_bridge.scene_file import parse_scene

PAIR = """
name = "glass"

[materials.glass]
youngs_modulus = 48.0e9
poissons_ratio = 0.2
density = 2800.0

[impact.first]
radius = 10.0e-3
velocity = 10.0

[impact.second]
radius = 10.0e-3
velocity = -10.0
"""
PLANE = PAIR.replace("[impact.second]\nradius = 10.0e-3\nvelocity = -10.0\n", '[impact.second]\nmaterial = "rigid"\n')
#: modulus / (1 - nu^2), Pa
MODULUS = 48.0e9 / 0.96


def test_a_pair_has_the_effective_modulus_and_radius_of_two_spheres() -> None:
    scene = parse_scene(PAIR)
    assert scene.stiffness == (float(f"{4.0 / 3.0 * (MODULUS / 2.0) * math.sqrt(5.0e-3):.12g}"),)
    assert scene.mass == (float(f"{2800.0 * 4.0 / 3.0 * math.pi * 1e-6:.12g}"),) * 2
    assert scene.velocity == (10.0, -10.0)
    assert (scene.n_body, scene.n_contact, scene.wall_right) == (2, 1, None)


@pytest.mark.parametrize(("plane", "share"), [("rigid", 1.0), ("glass", 0.5)])
def test_a_plane_is_a_wall_of_its_own_material(plane: str, share: float) -> None:
    scene = parse_scene(PLANE.replace('"rigid"', f'"{plane}"'))
    assert scene.wall_right is not None
    assert (scene.n_body, scene.n_contact) == (1, 1)
    # a sphere on a plane has the sphere's radius; two equal materials halve the modulus of a rigid plane
    expected = 4.0 / 3.0 * share * MODULUS * math.sqrt(10.0e-3)
    assert scene.wall_right.stiffness == pytest.approx(expected, rel=1e-11)  # 12 digits


def test_without_a_duration_the_scene_lasts_four_contact_times() -> None:
    scene = parse_scene(PAIR)
    run = db.solve(scene, backend="scipy")
    assert scene.duration == pytest.approx(4.0 * 40.339456e-6, rel=0.05)  # Chung & Ooi 2011; 2 digits
    assert run.velocity[-1] == pytest.approx([-10.0, 10.0], rel=1e-9)


def test_a_linear_spring_and_masses_need_no_material() -> None:
    text = 'name = "hooke"\n[impact]\nlaw = "hooke"\nstiffness = 1e4\n[impact.first]\nmass = 1.0\nvelocity = 1.0\n'
    scene = parse_scene(text + "[impact.second]\nmass = 3.0\n")
    assert (scene.stiffness, scene.exponent, scene.geometry) == ((1e4,), (2.0,), None)
    # half a period of the effective mass, three quarters
    assert scene.duration == pytest.approx(4.0 * math.pi * math.sqrt(0.75 / 1e4), rel=0.05)


WRONG = {
    "no stiffness": ("[impact.first]", '[impact]\nlaw = "hooke"\n[impact.first]', "impact.stiffness is missing"),
    "apart": ("velocity = 10.0", "velocity = -10.0", "duration is missing"),
    "e above 1": ("[impact.first]", "[impact]\nrestitution = 1.1\n[impact.first]", "impact.restitution = 1.1"),
    "two dampings": (
        "[impact.first]",
        '[impact]\nrestitution = 0.5\ndamping = {law = "dashpot", coefficient = 1.0}\n[impact.first]',
        "impact.restitution cannot be combined with damping",
    ),
    "no body": ("radius = 10.0e-3\nvelocity = 10.0", "velocity = 10.0", "impact.first has neither radius nor mass"),
    "unknown key": ("velocity = 10.0", "speed = 10.0", "impact.first.speed is an unknown key"),
    "unknown material": ("velocity = 10.0", 'velocity = 10.0\nmaterial = "brass"', "impact.first.material = 'brass'"),
    "reserved name": ("[materials.glass]", "[materials.rigid]", "materials.rigid is a reserved name"),
    "moving plane": ("radius = 10.0e-3\nvelocity = -10.0", "velocity = -10.0", "impact.second.velocity = -10.0"),
}


@pytest.mark.parametrize(("old", "new", "found"), WRONG.values(), ids=WRONG)
def test_a_mistake_is_named_in_one_line(old: str, new: str, found: str) -> None:
    assert old in PAIR
    with pytest.raises(SceneError) as caught:
        parse_scene(PAIR.replace(old, new, 1), where="own.toml")
    message = str(caught.value)
    assert message.startswith(f"own.toml: {found}"), message
    assert "allowed: " in message, message
    assert "\n" not in message, message


def test_a_surface_energy_gives_the_pull_off_force_of_spheres() -> None:
    def text(keys: str, file: str = PAIR) -> str:
        return file.replace("[impact.first]", f'[impact.adhesion]\nlaw = "dmt"\n{keys}\n[impact.first]')

    for file, radius in ((PAIR, 5.0e-3), (PLANE, 10.0e-3)):
        scene = parse_scene(text("surface_energy = 0.05", file))
        assert scene.adhesion is not None
        assert scene.adhesion.pull_off == (float(f"{4.0 * math.pi * 0.05 * radius:.12g}"),)
    assert parse_scene(text("pull_off = 0.1")).contacts.pull_off.tolist() == [0.1]
    masses = PAIR.replace("radius = 10.0e-3", "mass = 1.0").replace(
        "[impact.first]", "[impact]\nstiffness = 1e9\n[impact.first]"
    )
    for wrong, why in (
        (text(""), "adhesion needs one of two keys; allowed: pull_off"),
        (text("pull_off = 0.1\nsurface_energy = 0.05"), "adhesion needs one of two keys"),
        (text("surface_energy = -1"), "surface_energy"),
        (text("surface_energy = 0.05", masses), "adhesion.surface_energy requires radii; allowed: pull_off (N), or"),
    ):
        with pytest.raises(SceneError) as caught:
            parse_scene(wrong)
        assert why in str(caught.value)
        assert "\n" not in str(caught.value)
