"""The impact form of scene files: two spheres, or a sphere and a plane, as the interface contract words it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dem_bridge as db
from dem_bridge.errors import SceneError, UnsupportedScene
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.scene.scene import DAMPING_LAWS, Scene

#: the example of the contract, word for word
CONTRACT = """
name = "glass-pair"            # short form of an impact; the raw form says the same with [chain]
[impact]                       # two spheres, or one sphere and a rigid plane
radius = [0.01, 0.01]          # m; one value and wall = true: a sphere on a plane
wall = false
youngs_modulus = 48e9          # Pa; one value or one each (a plane: rigid)
poissons_ratio = 0.20
density = 2800.0               # kg/m^3
speed = 20.0                   # m/s, of approach (two spheres: half each)
[impact.damping]               # the same table is allowed as [chain.damping]
law = "coeff_restitution"      # "dashpot" (= LAMMPS velocity), "mass_velocity", "kuwabara-kono", "tsuji"
coefficient = 0.5              # N s/m | 1/s | s | e | e   (tsuji: Marshall's polynomial of e; the exact inverse)
clip = false                   # is the net normal force clipped at zero (LAMMPS limit_damping)? default true
[impact.adhesion]              # or [chain.adhesion]
law = "dmt"                    # or "jkr"
surface_energy = 0.1           # J/m^2, LAMMPS' gamma
"""
DAMPED = CONTRACT[: CONTRACT.index("[impact.adhesion]")]
PLAIN = CONTRACT[: CONTRACT.index("[impact.damping]")]
#: modulus over 1 - nu^2, Pa, and mass of the sphere, kg
MODULUS, MASS, SPEED = 48e9 / 0.96, 2800.0 * 4.0 / 3.0 * math.pi * 1e-6, 20.0
#: wall in the file -> radius in the file, effective modulus, radius and mass
WALLS: dict[str, tuple[str, float, float, float]] = {
    "false": ("[0.01, 0.01]", 0.5 * MODULUS, 0.005, 0.5 * MASS),
    "true": ("0.01", MODULUS, 0.01, MASS),
    '"same"': ("[0.01]", 0.5 * MODULUS, 0.01, MASS),
}
COEFFICIENTS = {"dashpot": 300.0, "mass_velocity": 4e4, "kuwabara-kono": 4e-6, "tsuji": 0.5, "coeff_restitution": 0.5}


def changed(text: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def walled(text: str, wall: str) -> str:
    return changed(text, ("[0.01, 0.01]", WALLS[wall][0]), ("wall = false", f"wall = {wall}"))


def exit_share(law: str, coefficient: float, wall: str, clip: bool) -> float:
    """Second writing of the laws: integrate the overlap of the contact, in units of the elastic impact."""
    _, modulus, radius, mass = WALLS[wall]
    k = 4.0 / 3.0 * modulus * math.sqrt(radius)
    length = (mass * SPEED**2 / k) ** 0.4
    time = length / SPEED
    # Marshall (2009), eq. 16; the exact inverse of e(alpha) for Hertz contacts, Antypov & Elliott (2011)
    alpha = {
        "tsuji": math.sqrt(2.0) * np.polyval([4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728], coefficient),
        "coeff_restitution": -math.sqrt(5.0) * math.log(coefficient) / math.hypot(math.log(coefficient), math.pi),
    }.get(law, 0.0)
    factor, power = {
        "dashpot": (coefficient * time / mass, 0.0),
        "mass_velocity": (coefficient * time, 0.0),
        "kuwabara-kono": (coefficient / time, 0.5),
    }.get(law, (alpha, 0.25))

    def force(_: float, y: Any) -> float:
        d = max(y[0], 0.0)
        return float(d ** (1.5 - power) + factor * y[1]) * (1.0 if power == 0.0 else d**power)

    def over(t: float, y: Any) -> float:
        d = max(y[0], 0.0)
        net = d ** (1.5 - power) + factor * y[1]
        return float(net if clip else y[0])

    over.terminal, over.direction = True, -1.0  # type: ignore[attr-defined]
    start = [1e-9, 1.0 - 0.5e-9 * factor * (power == 0.0)]  # the event is at touch, too
    motion = lambda t, y: [y[1], -force(t, y)]  # noqa: E731
    run = solve_ivp(motion, (0.0, 60.0), start, method="DOP853", events=over, rtol=1e-12, atol=1e-13)
    assert run.status == 1
    return float(-run.y_events[0][-1, 1])


@pytest.mark.parametrize("wall", WALLS)
def test_an_impact_has_the_numbers_of_its_spheres(wall: str) -> None:
    _, modulus, radius, mass = WALLS[wall]
    scene = parse_scene(walled(PLAIN, wall))
    k = 4.0 / 3.0 * modulus * math.sqrt(radius)
    assert scene.contacts.stiffness.tolist() == pytest.approx([k], rel=1e-11)  # 12 digits
    assert scene.mass == pytest.approx((MASS,) * scene.n_body, rel=1e-11)
    assert scene.velocity == ((10.0, -10.0) if wall == "false" else (20.0,))
    assert scene.contacts.gap.tolist() == [0.0]
    assert scene.samples == 500
    # Hertz: d = (5 m v^2/(4 k))^(2/5), 2.943275184325 d/v
    contact_time = 2.943275184325 * (1.25 * mass * SPEED**2 / k) ** 0.4 / SPEED
    assert scene.duration == pytest.approx(4.0 * contact_time, rel=1e-11)
    assert parse_scene(scene_toml(scene)) == scene
    run = db.solve(scene, backend="reference")
    assert run.crossing_time[0] == pytest.approx(0.5 * contact_time, rel=1e-11)
    assert run.restitution == pytest.approx(1.0, abs=1e-11)


@pytest.mark.parametrize("wall", WALLS)
@pytest.mark.parametrize("clip", ["true", "false", ""])
@pytest.mark.parametrize("law", DAMPING_LAWS)
def test_every_law_and_clip_has_the_restitution_of_its_second_writing(law: str, clip: str, wall: str) -> None:
    words = f"clip = {clip}" if clip else ""
    text = changed(
        walled(DAMPED, wall),
        ('"coeff_restitution"', f'"{law}"'),
        ("coefficient = 0.5", f"coefficient = {COEFFICIENTS[law]!r}"),
        ("clip = false", words),
    )
    scene = parse_scene(text)
    assert parse_scene(scene_toml(scene)) == scene
    clipped = clip != "false"
    assert scene.damping is not None
    assert (scene.damping.law, scene.damping.clip) == (law, clipped)
    run = db.solve(scene, backend="scipy", uncertainty=False)
    exact = exit_share(law, COEFFICIENTS[law], wall, clipped)
    assert run.restitution == pytest.approx(exact, abs=1e-7)  # the event at the start of the second writing
    # the planted fault: the other clip is far off
    assert abs(run.restitution - exit_share(law, COEFFICIENTS[law], wall, not clipped)) > 1e-3
    if law == "coeff_restitution":
        assert run.restitution == pytest.approx(0.5502831696273 if clipped else 0.5, abs=1e-11)


def test_adhesion_is_that_of_a_surface_energy_and_is_not_clipped() -> None:
    for wall, (_, _, radius, _) in WALLS.items():
        for law, factor in (("dmt", 4.0), ("jkr", 3.0)):
            scene = parse_scene(changed(walled(CONTRACT, wall), ('"dmt"', f'"{law}"'), ("clip = false", "")))
            assert scene.adhesion is not None
            assert scene.adhesion.pull_off == pytest.approx((factor * math.pi * 0.1 * radius,), rel=1e-11)
            assert scene.damping is not None
            assert scene.damping.clip is False
            assert parse_scene(scene_toml(scene)) == scene
    with pytest.raises(SceneError, match=r"impact.damping.clip = True, but contacts have adhesion"):
        parse_scene(changed(CONTRACT, ("clip = false", "clip = true")))


def test_no_backend_solves_jkr_and_each_says_so_in_one_line() -> None:
    scene = parse_scene(changed(CONTRACT, ('"dmt"', '"jkr"')))
    for backend in ("lammps-granular", "scipy", "verlet", "reference"):
        with pytest.raises(UnsupportedScene, match=r"JKR adhesion.*no backend supports this scene$"):
            db.solve(scene, backend=backend)


def test_each_sphere_may_have_its_own_material() -> None:
    text = changed(
        PLAIN,
        ("[0.01, 0.01]", "[0.01, 0.02]"),
        ("48e9", "[48e9, 70e9]"),
        ("0.20", "[0.2, 0.3]"),
        ("2800.0", "[2800.0, 2500.0]"),
    )
    scene = parse_scene(text)
    effective = 1.0 / ((1.0 - 0.04) / 48e9 + (1.0 - 0.09) / 70e9)
    radius = 1.0 / (1.0 / 0.01 + 1.0 / 0.02)
    assert scene.stiffness == pytest.approx((4.0 / 3.0 * effective * math.sqrt(radius),), rel=1e-11)
    assert scene.mass == pytest.approx((MASS, MASS * 8.0 * 25.0 / 28.0), rel=1e-11)
    assert scene.geometry is not None
    assert [body.material.density for body in scene.geometry.bodies] == [2800.0, 2500.0]


def test_a_gap_and_gravity_are_those_of_a_drop() -> None:
    text = (
        changed(walled(PLAIN, "true"), ("speed = 20.0", "speed = 0.0\ngap = 0.1")) + "[environment]\ngravity = 9.81\n"
    )
    with pytest.raises(SceneError, match=r"duration is missing; allowed: a number > 0"):
        parse_scene(text)
    scene = parse_scene("duration = 0.4\n" + text)
    run = db.solve(scene, backend="scipy", uncertainty=False)
    assert run.restitution == pytest.approx(1.0, abs=1e-9)
    assert run.crossing_time[0] == pytest.approx(math.sqrt(0.2 / 9.81), rel=1e-3)


WRONG = {
    "two radii and a plane": (("wall = false", "wall = true"), "impact.radius has 2 values, and wall = true"),
    "one radius": (("[0.01, 0.01]", "0.01"), "impact.radius has 1 value, and wall = false"),
    "an unknown wall": (("wall = false", 'wall = "rigid"'), "impact.wall = 'rigid'; allowed: false, true or 'same'"),
    "three moduli": (("48e9", "[48e9, 48e9, 48e9]"), "impact.youngs_modulus has 3 entries; allowed: 2, one per sphere"),
    "Poisson's ratio": (("0.20", "0.6"), "impact.poissons_ratio = 0.6; allowed: -1 < nu <= 0.5"),
    "density": (("2800.0", "-2800.0"), "impact.density = -2800.0; allowed: a number > 0 (kg/m^3)"),
    "no speed": (("speed = 20.0", ""), "impact.speed is missing"),
    "speed 0": (("speed = 20.0", "speed = 0"), "impact.speed = 0.0; allowed: a number > 0 (m/s); 0 with a gap"),
    "negative gap": (("speed = 20.0", "speed = 20.0\ngap = -1e-6"), "impact.gap = -1e-06; allowed: a number >= 0 (m)"),
    "unknown key": (("speed = 20.0", "speed = 20.0\nrestitution = 0.5"), "impact.restitution is an unknown key"),
    "a word of LAMMPS": (('"coeff_restitution"', '"velocity"'), "impact.damping.law = 'velocity'; allowed: 'dashpot'"),
    "e above 1": (("coefficient = 0.5", "coefficient = 1.1"), "impact.damping.coefficient = 1.1"),
    "pull-off": (("surface_energy = 0.1", "pull_off = 0.1"), "impact.adhesion.pull_off is an unknown key"),
    "energy": (("surface_energy = 0.1", "surface_energy = 0"), "impact.adhesion.surface_energy = 0.0; allowed: a numb"),
}


@pytest.mark.parametrize(("change", "found"), WRONG.values(), ids=WRONG)
def test_a_mistake_is_named_in_one_line(change: tuple[str, str], found: str) -> None:
    with pytest.raises(SceneError) as caught:
        parse_scene(changed(CONTRACT, change), where="own.toml")
    message = str(caught.value)
    assert message.startswith(f"own.toml: {found}"), message
    assert "allowed: " in message, message
    assert "\n" not in message, message


def test_the_raw_form_says_the_same() -> None:
    raw = """
name = "glass-pair"
duration = 1.0e-4
[chain]
mass = [1.0, 2.0]
stiffness = [1e6]
velocity = [1.0, -1.0]
exponent = 2
[chain.damping]
law = "coeff_restitution"
coefficient = 0.5
clip = false
"""
    scene = parse_scene(raw.replace("1.0e-4", "1.0e-2"))
    assert isinstance(scene, Scene)
    # an integer exponent of 2 is Hooke's law: half a period of the damped spring
    assert scene.exponent == (2.0,)
    run = db.solve(scene, backend="scipy", uncertainty=False)
    assert run.restitution == pytest.approx(0.5, abs=1e-11)
