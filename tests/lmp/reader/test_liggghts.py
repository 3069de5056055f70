"""Scripts of LIGGGHTS are read in their plain form, and named as such otherwise."""

from __future__ import annotations

import math

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import BlockedScript
from dem_bridge.lmp.reader.to_scene import ReadDeck, read_deck
from dem_bridge.scene.scene import Damping

#: a script that names no file
NOTHING: dict[str, str] = {}
SCRIPT = """units si
atom_style granular
boundary f f f
newton off
communicate single vel yes
region box block -0.1 0.1 -0.1 0.1 -0.1 0.1 units box
create_box 2 box
hard_particles yes
fix m1 all property/global youngsModulus peratomtype 5e9 2e9
fix m2 all property/global poissonsRatio peratomtype 0.3 0.2
fix m3 all property/global coefficientRestitution peratomtypepair 2 0.8 0.6 0.6 0.5
fix m4 all property/global coefficientFriction peratomtypepair 2 0.1 0.1 0.1 0.1
pair_style gran model hertz tangential off
pair_coeff * *
timestep 1e-7
create_atoms 1 single -0.02100013 0 0 units box
create_atoms 2 single 0 0 0 units box
create_atoms 1 single 0.02010017 0 0 units box
set group all density 2500 diameter 0.02
set atom 1 vx 5
fix w all wall/gran model hertz tangential off primitive type 2 xplane 0.03020017
fix move all nve/sphere
fix check all check/timestep/gran 1 0.1 0.1
dump d all custom 100 dump.lig id x vx
run 20000
"""


def _read(old: str = "", new: str = "") -> ReadDeck:
    assert old in SCRIPT
    return read_deck(SCRIPT.replace(old, new) if old else SCRIPT, file="in.lig", opened=NOTHING.__getitem__)


def test_the_materials_of_types_are_mixed_and_so_is_that_of_the_wall() -> None:
    scene, radius = _read().scene, 0.01

    def modulus(*materials: tuple[float, float]) -> float:
        return 1.0 / sum((1.0 - nu**2) / young for young, nu in materials)

    stiff, soft = (5e9, 0.3), (2e9, 0.2)
    assert scene.stiffness == pytest.approx([4 / 3 * modulus(stiff, soft) * math.sqrt(radius / 2)] * 2, rel=1e-14)
    assert scene.wall_right is not None
    assert scene.wall_left is None
    assert scene.wall_right.stiffness == pytest.approx(4 / 3 * modulus(stiff, soft) * math.sqrt(radius), rel=1e-14)
    assert scene.wall_right.gap == pytest.approx(1e-4, abs=1e-16)
    assert scene.gap == pytest.approx([0.00100013, 0.00010017], abs=1e-16)
    # a density before the diameter gives the mass of the new diameter, in contrast to LAMMPS
    assert scene.mass == pytest.approx([2500 * math.pi / 6 * 0.02**3] * 3, rel=1e-14)
    assert scene.damping == Damping(law="coeff_restitution", coefficient=(0.6,) * 3, clip=False)
    both = SCRIPT.replace("tangential off", "tangential history limitForce on")
    clip = read_deck(both, file="in.lig", opened=NOTHING.__getitem__).scene.damping
    assert clip == Damping(law="coeff_restitution", coefficient=(0.6,) * 3, clip=True)
    assert _read().notes[-1] == "the script is for LIGGGHTS; walls have the material of their type"


def test_the_scene_moves_as_liggghts_moves_it() -> None:
    """Recorded from LIGGGHTS 3.8.0 (Debian) with this script: 1e-11 m/s from the twin.

    Touches must not fall on a step, because a force with overlap^(1/4) makes much of the round-off of an overlap.
    """
    recorded = np.array([-2.1570429866613638, -0.83166720908223302, -0.34504389536763974])
    velocity = db.solve(_read().scene, backend="verlet", dt=1e-7, uncertainty=False).velocity[-1]
    assert np.max(np.abs(velocity - recorded)) < 1e-9
    # a wall of the material of the body, as LAMMPS has it, is another motion
    other = db.solve(_read("type 2 xplane", "type 1 xplane").scene, backend="scipy").velocity[-1]
    assert np.max(np.abs(other - recorded)) > 1e-3


def test_a_property_without_effect_and_suffixes_of_styles_are_skipped() -> None:
    fixes = "fix m5 all property/global characteristicVelocity scalar 2\nfix m6 all property/global k0 vector 17 25\n"
    old = "fix move all nve/sphere\n"
    assert _read(old, fixes + "fix move all nve/sphere/omp\n").scene == _read().scene


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (
            "gran model hertz tangential off\npair",
            "gran model hooke tangential off\npair",
            "has model hooke, which is not",
        ),
        ("hertz tangential off\npair", "hertz tangential off cohesion sjkr\npair", "has cohesion sjkr, which is not"),
        ("hertz tangential off\npair", "hertz tangential off surface superquadric\npair", "has surface superquadric"),
        (
            "hertz tangential off\npair",
            "hertz tangential off limitForce\npair",
            "is not supported; allowed: gran model",
        ),
        ("hertz tangential off\npair", "hertz tangential off odd on\npair", "has odd on, which is not supported"),
        (
            "hertz tangential off\npair",
            "hertz absolute_damping on\npair",
            "has absolute_damping, which is not supported",
        ),
        (
            "fix m3",
            "# fix m3",
            "needs the property coefficientRestitution; allowed: fix ID GROUP property/global coeff",
        ),
        ("pair 2 0.8 0.6 0.6 0.5", "pair 2 0.8 0.6 0.6", "has 3 numbers; allowed: 4 after N"),
        (
            "pair 2 0.8 0.6 0.6 0.5",
            "pair 2 0.8 1.6 1.6 0.5",
            "has a coefficient of restitution of 1.6; allowed: a number",
        ),
        ("peratomtype 5e9 2e9", "peratomtype 5e9", "has values for 1 types; allowed: 2 types"),
        ("peratomtype 5e9 2e9", "peratomtype 5e9 -2e9", "of an impossible material; allowed: E > 0, -1 < nu <= 0.5"),
        ("peratomtype 5e9 2e9", "odd 5e9 2e9", "allowed: fix ID GROUP property/global NAME scalar|peratomtype"),
        (
            "primitive type 2 xplane 0.03020017",
            "mesh n_meshes 1 meshes m",
            "has a wall that is not supported; allowed: wall/",
        ),
        ("primitive type 2 xplane 0.03020017", "primitive type 2 zcylinder 1 0 0", "has a wall that is not supported"),
        ("set atom 1 vx 5", "set atom 1 vx 5 omegaz 1", "slide on each other; allowed: no spin, or"),
        (
            "hertz tangential off\npair",
            "hertz tangential off\npair_style gran/hertz/history 1 0\npair",
            "before version 3",
        ),
    ],
)
def test_what_is_not_plain_is_refused_and_the_script_is_named(old: str, new: str, why: str) -> None:
    with pytest.raises(BlockedScript) as caught:
        _read(old, new)
    lines = str(caught.value).splitlines()
    assert lines[0].startswith("in.lig: this is a LIGGGHTS script; allowed: spheres on one line with `pair_style gran")
    assert any(why in line for line in lines[1:])
    assert all("allowed: " in line for line in lines)


def test_all_problems_of_a_script_in_three_dimensions_are_listed() -> None:
    text = SCRIPT.replace("create_atoms 2 single 0 0 0", "create_atoms 2 single 0 0.1e-3 0").replace(
        "fix w all", "fix cad all mesh/surface file a.stl type 1\nfix p all particletemplate/sphere 1\nfix w all"
    )
    with pytest.raises(BlockedScript) as caught:
        read_deck(text, file="in.lig", opened=NOTHING.__getitem__)
    found = [line.split("`")[0] for line in str(caught.value).splitlines()]
    assert found == ["in.lig: this is a LIGGGHTS script; allowed: spheres on one line with ",
                     "in.lig, line 21: ", "in.lig, line 22: ", "in.lig, line 27: "]  # fmt: skip
