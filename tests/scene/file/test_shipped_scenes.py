"""Every shipped scene: the numbers it had, the bodies it says, the front that passes, and the features."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder, sphere_on_sphere
from dem_bridge.scene.features import (
    CHIRP_DRIVE,
    DASHPOT,
    DRAG,
    GAPS,
    GRADED_EXPONENTS,
    GRAVITY,
    KUWABARA_KONO,
    OTHER_EXPONENTS,
    PRECOMPRESSION,
    WALLS,
    Feature,
)
from dem_bridge.scene.file import MAIN_SCENES
from dem_bridge.scene.scene import Damping, Scene
from tests.conftest import Solve

#: name -> content hash. A changed hash is a changed scene: on purpose, and said in the change log
SHIPPED = {
    "accelerating-200": "9f50f1bd8e5b3dc10a4b0d55e67f69c32b9e489ae6278cd34603c0414e579526",
    "accelerating-40": "9858599c934d30bb63c923afc95a1d5bbbf55ea910fce7a0ea30defee10e6dc8",
    "accelerating-40-heavier": "017b5f1b09e32c88ad24fb7dc37e89eeb912c2828f4ee1ad0ffd54d54da70241",
    "accelerating-40-lighter": "abe5b6c682199c3e2c710b7de3fd2d98e23c35d1dc1ab757eb5954e1894d9583",
    "decelerating-200": "c93e34f5dd9c65037cb7cd9a729b656407e03769568fd68b7ca18f64fe1b8aa2",
    "decelerating-40": "78cb53a62263adca587f59d8c2e757bd4b4a9a0f6bc45af0e486b21e7df62c34",
    "decelerating-40-dashpot": "0bd1e8ecc791505d9916cf4736555d4fae53f676b24ca4b70948d0f79b27f56b",
    "decelerating-40-drag": "ed8cd73ddd5dcb916dec4a7cf6e2936bcb4e539ac024f57e27e9db1097e7115b",
    "decelerating-40-exact": "78ca415ece4fa5dd0b51adbfb09442f23fe0c654fc95036c17330081a2134fb9",
    "decelerating-40-gaps": "91eac19542df1bb232eefd6b5d54a6f6acb996f803e7d4d7506d7ca5b9ea409d",
    "decelerating-40-graded-exponent": "e3082ccac05736c94b587004279738f09f43b7e40bea8e90a297d2d5bb09aaf3",
    "decelerating-40-heavier": "16f1398b9fe92dfd8d71e8bbc80bb37e1bc9e96a78fa77d8c5fb1ba323e6d366",
    "decelerating-40-kuwabara-kono": "6df56cc27d18c7fa3bbc7fda4fbf48571bf2f5dfc98b8982844b7ae57282031b",
    "decelerating-40-lighter": "c2de123251a251c6e279b27782e3ed45a965016450f43aba5e87f03e0d58d90a",
    "decelerating-40-on-base": "2ef7302fac0bcea4ae1c78090e1277fcca1a1c964900ee186455cd09dfe65aac",
    "decelerating-40-scattered": "1db240547772be32b2a4e757bab4936cb1f1be626e6f6aa59ad49e1a48cc159a",
    "decelerating-40-soft-exponent": "dc58d6ffb439b9f9b4de2ae98a6937625efe1a34643a58b767724e6af1575d80",
    "dimer-1-1": "399a10d8d951eaea6943cf4ab37385b56dbc11dabe3be55f699039ece10a9874",
    "driven-dimer": "c3be171b916a3445973aad93b70882499e8a0b3330674af65f131273c02d3e68",
    "driven-monomer": "2758482a8e2e8589b2c9dcb95f568c275af612b35592192394a752ae1f5b7e5c",
    "homogeneous-cylinders": "598d28f01755d98e4181a37ededac3d465cf29643dc756b2d95c38500144625d",
    "homogeneous-spheres": "b71ef731114fe2a6acc9388f49def434b4f6c2795e101c6955d1eaca8af2fff0",
    "sphere-cylinder-sphere": "75a254ad4486276543a89877eef3f08720fc85fa57dea9b75177bef905163e71",
    "stacked-40": "e5090829a035ed813e9a75e8f47627d4077729cab6ea85c49e2b24bf12f467a9",
    "tapered-backward": "2113478c9aeeacdcd05842493089b416110ed0c8e79446fb5465e8f557752333",
    "tapered-forward": "dc573fd8ba7682c8cf8b55296ce44e6ec1d47a9484cca20582aff9ca8aaed461",
}
#: features of the scenes that have any; docs/backends.md has the backends that support them
FEATURES_OF: dict[str, set[Feature]] = {
    "decelerating-40-dashpot": {DASHPOT},
    "decelerating-40-drag": {DRAG},
    "decelerating-40-gaps": {GAPS},
    "decelerating-40-graded-exponent": {OTHER_EXPONENTS, GRADED_EXPONENTS},
    "decelerating-40-kuwabara-kono": {KUWABARA_KONO},
    "decelerating-40-on-base": {WALLS},
    "decelerating-40-soft-exponent": {OTHER_EXPONENTS},
    "driven-dimer": {PRECOMPRESSION, CHIRP_DRIVE},
    "driven-monomer": {PRECOMPRESSION, CHIRP_DRIVE},
    "stacked-40": {WALLS, GRAVITY, PRECOMPRESSION},
}
#: those that the reference hands on to scipy, which takes seconds; the twin says as well where the front is
BY_SCIPY = {"-dashpot", "-kuwabara-kono", "-drag", "-soft-exponent", "-graded-exponent"}

every_scene = pytest.mark.parametrize("name", SHIPPED)


def test_all_shipped_scenes_are_in_this_table() -> None:
    assert db.shipped_scenes() == tuple(sorted(SHIPPED))
    assert set(MAIN_SCENES) <= set(SHIPPED)


@every_scene
def test_a_shipped_scene_keeps_its_name_and_numbers(name: str) -> None:
    scene = db.load_scene(name)
    assert (scene.name, scene.content_hash) == (name, SHIPPED[name])
    assert 20 < len(scene.description) < 80


@every_scene
def test_a_shipped_scene_has_the_features_in_the_table(name: str) -> None:
    assert db.load_scene(name).features == FEATURES_OF.get(name, set())


@every_scene
def test_the_front_passes_the_last_body(name: str, solved: Solve) -> None:
    scene = db.load_scene(name)
    by_twin = name.removeprefix("decelerating-40") in BY_SCIPY or scene.drive is not None
    run = solved(scene, "verlet" if by_twin else "reference", uncertainty=False)
    arrival = run.crossing_time[: scene.n_body - 1]
    # the striker's soft contact may be at its deepest after the stiff one behind it; a light sphere swings between its
    # heavy neighbours, so that in a dimer the front is one of cells
    cell = 2 if name == "dimer-1-1" else 1
    assert arrival[-cell:].max() < scene.duration
    if scene.drive is None:  # behind a long wave that grows and comes back no maximum is the front's
        assert np.all(arrival[1 + cell :] > arrival[1:-cell])


@every_scene
def test_masses_and_stiffnesses_are_those_of_the_bodies(name: str) -> None:
    """Found again from the geometry alone; the paper's striker has a mass and a stiffness of its own."""
    scene = db.load_scene(name)
    assert scene.geometry is not None
    bodies, angles, law = scene.geometry.bodies, scene.geometry.angle, scene.geometry.law
    own = 1 if (scene.mass[0], scene.stiffness[0]) in {(8.1e-3, 3.98e9), (8.1e-3, 1.1743e9)} else 0
    # 12 digits
    assert scene.mass[own:] == pytest.approx([body.mass for body in bodies[own:]], rel=6e-12)
    for k in range(own, scene.n_body - 1):
        angle = angles[k]
        # a sphere before the cylinder that it stands on
        one, two = sorted(bodies[k : k + 2], key=lambda body: body.shape, reverse=True)
        pair = {"radius": one.radius, "young": one.material.youngs_modulus, "poisson": one.material.poissons_ratio}
        pair |= {"radius2": two.radius, "young2": two.material.youngs_modulus, "poisson2": two.material.poissons_ratio}
        if angle is not None:
            expected = crossed_cylinders(angle=angle, law=law, **pair).stiffness
        elif one.shape != two.shape:
            expected = sphere_on_cylinder(**pair).stiffness  # type: ignore[arg-type]
        else:
            expected = sphere_on_sphere(**pair).stiffness
        n = float(scene.contacts.exponent[k])
        # where n is another, forces are equal at 5 um
        assert scene.stiffness[k] * 5e-6 ** (n - 2.5) == pytest.approx(expected, rel=1e-11), k


@pytest.mark.parametrize("way", ["decelerating", "accelerating"])
def test_mass_gradients_change_the_masses_alone(way: str) -> None:
    main = db.load_scene(f"{way}-40")
    for suffix, gamma in (("lighter", -0.01), ("heavier", 0.01)):
        scene = db.load_scene(f"{way}-40-{suffix}")
        # appendix A: m_i = m (1 + gamma i), i = 1..40; 12 digits
        growth = np.array([1.0, *(1.0 + gamma * np.arange(1, 41))])
        assert np.array(scene.mass) / main.mass == pytest.approx(growth, rel=1e-11)
        assert replace(scene, mass=main.mass).content_hash == main.content_hash


@pytest.mark.parametrize("suffix", ["dashpot", "kuwabara-kono", "drag", "gaps", "on-base", "lighter", "soft-exponent"])
def test_what_a_variant_leaves_out_is_the_main_scene(suffix: str) -> None:
    main, scene = db.load_scene("decelerating-40"), db.load_scene(f"decelerating-40-{suffix}")
    plain = replace(
        scene,
        mass=main.mass,
        stiffness=main.stiffness,
        exponent=main.exponent,
        gap=main.gap,
        damping=None,
        drag=0.0,
        wall_right=None,
        duration=main.duration,
    )
    assert plain.content_hash == main.content_hash != scene.content_hash


def test_long_chains_are_struck_by_their_like_and_sampled_every_2_us() -> None:
    for name in ("decelerating-200", "accelerating-200"):
        scene = db.load_scene(name)
        assert (scene.n_body, scene.mass[0], scene.stiffness[0]) == (201, scene.mass[1], scene.stiffness[1])
        assert scene.duration / scene.samples == pytest.approx(2e-6)
    short, long = db.load_scene("decelerating-40"), db.load_scene("decelerating-200")
    assert (long.stiffness[1], long.stiffness[-1]) == (short.stiffness[1], short.stiffness[-1])


def test_a_stack_carries_its_weight_and_the_striker_at_the_start() -> None:
    scene = db.load_scene("stacked-40")
    forces = scene.contacts.force(-scene.contacts.gap, np.arange(41))
    weight = 9.81 * np.cumsum(scene.mass)
    # each contact bears what lies on it, and 1e-6 N; overlaps are rounded once, forces go with their power 3/2
    assert forces == pytest.approx(weight + 1e-6, rel=1e-14)
    assert forces[-1] == pytest.approx(4.0, abs=0.05)


@pytest.mark.parametrize(
    ("name", "rebounds"),
    [("decelerating-40-dashpot", (0.98, 0.97, 0.94)), ("decelerating-40-kuwabara-kono", (0.96, 0.97, 0.99))],
)
def test_damped_cylinders_rebound_as_the_scene_says(name: str, rebounds: tuple[float, ...]) -> None:
    scene = db.load_scene(name)
    assert scene.damping is not None
    [coefficient] = set(scene.damping.coefficient)  # type: ignore[arg-type]
    mass = scene.mass[1]
    for stiffness, said in zip((scene.stiffness[1], 3e10, scene.stiffness[-1]), rebounds, strict=True):
        damping = Damping(law=scene.damping.law, coefficient=coefficient)
        pair = Scene(
            name="pair",
            duration=2e-4,
            mass=(mass, mass),
            stiffness=(stiffness,),
            velocity=(0.7, 0.0),
            damping=damping,
            samples=1,
        )
        run = db.solve(pair, backend="scipy", uncertainty=False)
        assert (run.velocity[-1, 1] - run.velocity[-1, 0]) / 0.7 == pytest.approx(said, abs=5e-3)


def test_soft_contacts_have_the_papers_force_at_5_um() -> None:
    scene = db.load_scene("decelerating-40-soft-exponent")
    assert scene.exponent == (2.4,) * 40
    # 5 digits in the file
    assert scene.stiffness[0] * 5e-6**1.4 == pytest.approx(3.98e9 * 5e-6**1.5, rel=5e-5)


def test_exponents_rise_to_hertz_with_the_angle() -> None:
    scene = db.load_scene("decelerating-40-graded-exponent")
    assert scene.exponent == pytest.approx([2.5, *np.linspace(2.31, 2.5, 39)], rel=1e-14)


def test_the_exact_chain_is_softer_and_its_striker_lighter() -> None:
    scene, main = db.load_scene("decelerating-40-exact"), db.load_scene("decelerating-40")
    assert 1.0 - scene.stiffness[1] / main.stiffness[1] == pytest.approx(0.15, abs=5e-3)
    assert scene.stiffness[-1] == main.stiffness[-1]
    assert scene.mass[0] == pytest.approx(6.72e-3, abs=5e-6)


def test_scattered_angles_are_half_a_degree_off() -> None:
    scattered, main = db.load_scene("decelerating-40-scattered").geometry, db.load_scene("decelerating-40").geometry
    assert scattered is not None
    assert main is not None
    off = np.array(scattered.angle[1:], dtype=float) - np.array(main.angle[1:], dtype=float)
    # 39 draws: 4 standard errors of a standard deviation
    assert math.sqrt(np.mean(off**2)) == pytest.approx(0.5, rel=4 / math.sqrt(2 * 39))


@pytest.mark.parametrize("name", ["homogeneous-spheres", "homogeneous-cylinders"])
def test_a_homogeneous_chain_carries_the_solitary_wave(name: str, solved: Solve) -> None:
    scene = db.load_scene(name)
    run = solved(scene, "reference", uncertainty=False)
    [mass], [stiffness] = set(scene.mass), set(scene.stiffness)
    # the exact wave of the discrete chain, known to 12 digits; away from both ends
    force = run.peak_force[40:90]
    speed = 0.905515776419 * stiffness ** (1 / 3) * mass**-0.5 * force ** (1 / 6)
    assert 1.0 / np.diff(run.crossing_time[40:91]) == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize(("name", "slope"), [("tapered-forward", 0.0295), ("tapered-backward", -0.0309)])
def test_the_front_of_a_tapered_chain_gains_or_loses_3_percent_a_sphere(name: str, slope: float) -> None:
    scene = db.load_scene(name)
    fastest = np.max(db.solve(scene, backend="reference", samples=5000, uncertainty=False).velocity, axis=0)
    grains = np.arange(15, 36)
    # the digits known; samples of 0.2 us miss less than 1e-4 of a peak 20 us wide
    assert np.polyfit(grains, np.log(fastest[grains]), 1)[0] == pytest.approx(slope, abs=6e-5)


def test_a_dimer_carries_a_wave_that_sheds_little_a_cell(solved: Solve) -> None:
    scene = db.load_scene("dimer-1-1")
    run = solved(scene, "reference", uncertainty=False)
    # (4/3) E* sqrt(R/2) of steel on PTFE, and the ratio of their densities
    modulus = 1.0 / ((1.0 - 0.3**2) / 193e9 + (1.0 - 0.46**2) / 1.46e9)
    assert set(scene.stiffness) == {float(f"{4.0 / 3.0 * modulus * math.sqrt(4.76e-3 / 2.0):.12g}")}
    assert scene.mass[0] / scene.mass[1] == pytest.approx(8000.0 / 2200.0, rel=1e-11)
    # away from both ends. At few ratios of masses alone does a dimer shed nothing (Jayaprakash, Starosvetsky & Vakakis
    # 2011, Phys. Rev. E 83, 036606); at this one 0.2 % of the force a cell, and speeds go as its sixth root
    force, arrival = run.peak_force[17:33], run.crossing_time[17:33]
    assert force[2:] / force[:-2] == pytest.approx(1.0 - 0.0020, abs=3e-4)
    transit = arrival[2:] - arrival[:-2]
    assert transit[2:] / transit[:-2] == pytest.approx(1.0 + 0.0020 / 6.0, abs=1.5e-4)  # still settling
    # the two contacts of a light sphere are of one stiffness and never alike
    assert force[0] / force[1] == pytest.approx(0.895, abs=1e-3)


def test_spheres_and_cylinders_in_turn_begin_and_end_with_a_sphere() -> None:
    scene = db.load_scene("sphere-cylinder-sphere")
    assert scene.geometry is not None
    shapes = [body.shape for body in scene.geometry.bodies]
    assert shapes == ["sphere", *["sphere", "cylinder"] * 15, "sphere"]
    [lying] = set(scene.stiffness[1:])
    # the digits known: of two spheres, and of a sphere on a cylinder of the same radius and quartz
    assert (scene.stiffness[0], lying) == pytest.approx((3.31576e9, 3.98253e9), rel=5e-6)
