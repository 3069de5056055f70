"""Scene files in pattern form: the row that a pattern makes, in the order that is said, and each refusal."""

from __future__ import annotations

import math
import random
import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

from dem_bridge.errors import SceneError
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.file.bodies import chain
from dem_bridge.scene.file.conversion import normal_numbers, scattered
from dem_bridge.scene.geometry import Body, Geometry
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.helpers.strategies import examples

MATERIALS = """\
[materials.steel]
youngs_modulus = 193e9
poissons_ratio = 0.3
density = 8000.0
[materials.ptfe]
name = "PTFE"
youngs_modulus = 1.46e9
poissons_ratio = 0.46
density = 2200.0
"""
STRIKER = """\
[chain.striker]
velocity = 0.5
radius = 4e-3
"""
BALL = 'shape = "sphere"\nradius = 9e-3\nmaterial = "steel"\n'
SOFT = 'shape = "sphere"\nradius = 5e-3\nmaterial = "ptfe"\n'
ROD = 'shape = "cylinder"\nradius = 6e-3\nheight = 2e-2\nmaterial = "steel"\n'


def file(*cell: str, keys: str = "repeat = 3", more: str = "", striker: str = STRIKER) -> str:
    """A scene file; ``keys`` of ``[chain.pattern]``, tables ``more`` at the end."""
    head = f'name = "own"\nduration = 1e-3\n{MATERIALS}{striker}[chain.pattern]\n{keys}\n'
    return head + "".join(f"[[chain.pattern.cell]]\n{body}" for body in cell) + more


def bodies(scene: Scene) -> tuple[Body, ...]:
    return known(scene).bodies


def known(scene: Scene) -> Geometry:
    assert scene.geometry is not None
    return scene.geometry


def radii(scene: Scene) -> list[float]:
    """Of all but the striker, mm."""
    return [1e3 * body.radius for body in bodies(scene)[1:]]


def test_cells_are_repeated_behind_a_striker_of_the_first_material() -> None:
    scene = parse_scene(file(BALL, SOFT))
    assert [body.material.name for body in bodies(scene)] == ["steel", *["steel", "PTFE"] * 3]
    assert radii(scene) == pytest.approx([9.0, 5.0] * 3, rel=1e-15)
    assert bodies(scene)[0].radius == 4e-3
    assert scene.velocity == (0.5, *[0.0] * 6)
    # density times volume; (4/3) E* sqrt(R) of two radii and two materials
    assert scene.mass[1:3] == pytest.approx(
        (8000.0 * 4.0 / 3.0 * math.pi * 9e-3**3, 2200.0 * 4.0 / 3.0 * math.pi * 5e-3**3), rel=1e-11
    )
    mixed = 1.0 / ((1.0 - 0.3**2) / 193e9 + (1.0 - 0.46**2) / 1.46e9)
    alike = 193e9 / (2.0 * (1.0 - 0.3**2))
    assert scene.stiffness[:2] == pytest.approx(
        (4.0 / 3.0 * alike * math.sqrt(36e-6 / 13e-3), 4.0 / 3.0 * mixed * math.sqrt(45e-6 / 14e-3)), rel=1e-11
    )
    assert set(scene.stiffness[1:]) == {scene.stiffness[1]}


def test_it_is_the_chain_that_python_has() -> None:
    scene = parse_scene(file(BALL, ROD, SOFT, keys="repeat = 2\ngap = 1e-7"))
    own = chain(
        name="own",
        duration=1e-3,
        bodies=bodies(scene)[1:],
        striker=bodies(scene)[0],
        velocity=0.5,
        gap=(0.0, *[1e-7] * 5),
    )
    assert scene == own
    assert scene.content_hash == own.content_hash


def test_a_step_changes_the_cells_from_its_own_on() -> None:
    step = f"[chain.pattern.step]\nfrom = 1\n[[chain.pattern.step.cell]]\n{SOFT}[[chain.pattern.step.cell]]\n{BALL}"
    assert radii(parse_scene(file(BALL, more=step))) == pytest.approx([9.0, 5.0, 9.0, 5.0, 9.0])
    assert radii(parse_scene(file(BALL, more=step.replace("from = 1", "from = 0")))) == pytest.approx([5.0, 9.0] * 3)


def test_a_taper_scales_radius_and_height_cell_by_cell() -> None:
    scene = parse_scene(file(BALL, ROD, keys="repeat = 3\ntaper = 0.5"))
    assert radii(scene) == pytest.approx([9.0, 6.0, 4.5, 3.0, 2.25, 1.5])
    assert [body.height for body in bodies(scene)[2::2]] == pytest.approx([2e-2, 1e-2, 5e-3])
    assert np.array(scene.mass[1:]) / [*scene.mass[1:3] * 3] == pytest.approx([1, 1, 1 / 8, 1 / 8, 1 / 64, 1 / 64])


def test_a_decoration_stands_between_each_two_bodies_of_the_chain_untapered() -> None:
    between = f"[chain.pattern.decorate]\n{SOFT}"
    scene = parse_scene(file(BALL, keys="repeat = 3\ntaper = 0.5", more=between))
    assert radii(scene) == pytest.approx([9.0, 5.0, 4.5, 5.0, 2.25])
    second = parse_scene(file(BALL, keys="repeat = 5", more=f"{between}every = 2\n"))
    assert radii(second) == pytest.approx([9, 9, 5, 9, 9, 5, 9])


def test_the_order_of_all_is_as_said() -> None:
    step = f"[chain.pattern.step]\nfrom = 2\n[[chain.pattern.step.cell]]\n{ROD}"
    more = f"{step}[chain.pattern.decorate]\n{SOFT}[chain.pattern.disorder]\nradius = 0.1\nseed = 3\n"
    scene = parse_scene(file(BALL, keys="repeat = 4\ntaper = 0.5", more=more))
    wanted = [9.0, 5.0, 4.5, 5.0, 1.5, 5.0, 0.75]
    drawn = [1.0 + 0.1 * z for z, _ in zip(normal_numbers("radius 3"), wanted, strict=False)]
    # decorations too, the striker not; 9 digits
    assert np.array(radii(scene)) == pytest.approx(np.array(wanted) * drawn, rel=5e-9)
    assert bodies(scene)[0].radius == 4e-3
    assert [body.height for body in bodies(scene)] == [None] * 5 + [5e-3, None, 2.5e-3]


def test_disorder_is_the_same_with_every_library_and_of_the_size_that_is_asked_for() -> None:
    more = "[chain.pattern.disorder]\nradius = 0.01\nseed = 7\n"
    found = radii(parse_scene(file(BALL, keys="repeat = 3", more=more)))
    # a seed is a chain, and must stay that chain; 9 digits, times 1000
    assert found == pytest.approx([9.10666632, 8.89867779, 9.07114842], rel=1e-12)
    uniform = random.Random("radius 7")
    drawn = 9.0 * (1.0 + 0.01 * ndtri([uniform.random() for _ in found]))
    assert np.array(found) == pytest.approx(drawn, rel=5e-9)
    many = np.array(radii(parse_scene(file(BALL, keys="repeat = 4000", more=more)))) / 9.0 - 1.0
    # 5 standard errors of mean and standard deviation
    assert abs(many.mean()) < 5 * 0.01 / math.sqrt(4000)
    assert many.std() == pytest.approx(0.01, rel=5 / math.sqrt(8000))
    assert radii(parse_scene(file(BALL, more=more.replace("7", "8")))) != found


def test_angles_of_disorder_do_not_depend_on_that_of_radii() -> None:
    keys, more = "repeat = 4\nangle = 30.0", "[chain.pattern.disorder]\nangle = 0.5\nseed = 7\n"
    scene = parse_scene(file(ROD, keys=keys, more=more))
    both = parse_scene(file(ROD, keys=keys, more=f"{more}radius = 0.01\n"))
    # the striker, a sphere, has no angle
    assert known(scene).angle == (None, *scattered((30.0,) * 3, scatter=0.5, seed=7))
    assert known(both).angle == known(scene).angle
    assert radii(both) != radii(scene)
    assert both.spacing is None


def test_one_angle_serves_all_cylinders_that_meet_and_a_list_each_its_own() -> None:
    scene = parse_scene(file(ROD, BALL, ROD, keys="repeat = 3\nangles = [10.0, 90.0]"))
    assert known(scene).angle == (None, None, None, 10.0, None, None, 90.0, None, None)
    assert known(parse_scene(file(ROD, keys="repeat = 3\nangle = 20.0"))).angle == (None, 20.0, 20.0)
    paper = parse_scene(file(ROD, keys='repeat = 3\nangle = 20.0\nlaw = "paper"'))
    assert (known(paper).law, known(scene).law) == ("paper", "exact")
    # eq. 3.1 is too stiff
    assert paper.stiffness[1] > parse_scene(file(ROD, keys="repeat = 3\nangle = 20.0")).stiffness[1]


def test_a_striker_like_the_first_body_crosses_it_as_the_first_two_cylinders_cross() -> None:
    like = '[chain.striker]\nvelocity = 0.5\nlike = "first-body"\n'
    scene = parse_scene(file(ROD, SOFT, keys="repeat = 2\nangle = 40.0", striker=like))
    assert known(scene).angle == (40.0, None, None, None)
    assert bodies(scene)[0] == bodies(scene)[1]
    each = parse_scene(file(ROD, keys="repeat = 3\nangles = [40.0, 50.0]", striker=like))
    assert known(each).angle == (40.0, 40.0, 50.0)
    assert each.stiffness[0] == each.stiffness[1] == scene.stiffness[0]
    ball = parse_scene(file(BALL, SOFT, striker=like))
    # of two first bodies, not of the first on the second
    assert ball.stiffness[0] == pytest.approx(4.0 / 3.0 * 193e9 / (2.0 * 0.91) * math.sqrt(4.5e-3), rel=1e-11)


def test_what_is_given_of_a_striker_comes_before_what_follows() -> None:
    striker = f"{STRIKER}mass = 8.1e-3\nstiffness = 3.98e9\ngap = 1e-6\n" + 'material = "ptfe"\n'
    scene = parse_scene(file(BALL, striker=striker))
    assert (scene.mass[0], scene.stiffness[0], scene.gap) == (8.1e-3, 3.98e9, (1e-6, 0.0, 0.0))
    assert bodies(scene)[0].material.name == "PTFE"
    of_mass = parse_scene(file(BALL, striker=striker.replace("radius = 4e-3\n", "")))
    assert (bodies(of_mass)[0].mass, of_mass) == (pytest.approx(8.1e-3, rel=1e-14), scene)


def test_the_only_material_need_not_be_named() -> None:
    text = file(BALL).replace('material = "steel"\n', "")
    text = re.sub(r"\[materials.ptfe\](.*\n){5}", "", text)
    assert parse_scene(text) == parse_scene(file(BALL))


def test_bodies_of_one_radius_have_a_distance_of_centres() -> None:
    alike = ROD.replace("6e-3", "9e-3")
    assert parse_scene(file(BALL, alike)).spacing == 18e-3
    assert parse_scene(file(BALL, ROD)).spacing is None


def test_walls_are_flat_or_as_stiff_as_they_are_said_to_be() -> None:
    more = '[chain.wall_left]\nmaterial = "ptfe"\n[chain.wall_right]\nmaterial = "steel"\ngap = 1e-6\n'
    scene = parse_scene(file(SOFT, more=more))
    mixed = 1.0 / ((1.0 - 0.3**2) / 193e9 + (1.0 - 0.46**2) / 1.46e9)
    assert scene.wall_left is not None
    assert scene.wall_right is not None
    # the striker, PTFE too, is on the left; (4/3) E* sqrt(r) on a plane
    soft = 1.46e9 / (2.0 * (1.0 - 0.46**2))
    assert scene.wall_left.stiffness == pytest.approx(4.0 / 3.0 * soft * math.sqrt(4e-3), rel=1e-11)
    assert scene.wall_right.stiffness == pytest.approx(4.0 / 3.0 * mixed * math.sqrt(5e-3), rel=1e-11)
    assert (scene.wall_right.gap, scene.wall_right.exponent) == (1e-6, 2.5)
    stiff = parse_scene(
        file(ROD, keys="repeat = 2\nangle = 9", more="[chain.wall_right]\nstiffness = 1e9\nexponent=2\n")
    )
    assert stiff.wall_right == Wall(stiffness=1e9, exponent=2.0)


OPTIONAL = """\
[chain.precompression]
force = 3.0
[chain.damping]
law = "dashpot"
coefficient = 2.0
[environment]
gravity = 9.81
drag = 0.5
[sampling]
count = 9
"""


def test_optional_physics_is_as_in_the_other_forms() -> None:
    scene = parse_scene(file(BALL, more=OPTIONAL))
    assert (scene.precompression, scene.gravity, scene.drag, scene.samples) == (3.0, 9.81, 0.5, 9)
    assert scene.damping == Damping(law="dashpot", coefficient=(2.0,) * 3)


def test_a_surface_energy_gives_the_pull_off_forces_of_spheres_only() -> None:
    more = '[chain.adhesion]\nlaw = "dmt"\nsurface_energy = 0.05\n'
    scene = parse_scene(file(BALL, keys="repeat = 2\ngap = 1e-6", more=more))
    radii = [body.radius for body in known(scene).bodies]
    expected = [4.0 * math.pi * 0.05 / (1.0 / one + 1.0 / two) for one, two in pairwise(radii)]
    assert len(expected) == 2
    assert scene.contacts.pull_off.tolist() == pytest.approx(expected, rel=1e-11)
    with pytest.raises(SceneError, match=r"adhesion\.surface_energy requires radii"):
        parse_scene(file(BALL, ROD, keys="repeat = 2\ngap = 1e-6", more=more))


def test_a_chain_without_a_striker_is_at_rest_or_moves_as_it_is_said_to() -> None:
    still = parse_scene(file(BALL, SOFT, striker="", more="[chain.precompression]\nforce = 1.0\n"))
    assert (still.n_body, set(still.velocity)) == (6, {0.0})
    assert known(still).bodies == bodies(parse_scene(file(BALL, SOFT)))[1:]
    first = parse_scene(file(BALL, striker="[chain]\nvelocity = 0.3\n"))
    assert first.velocity == (0.3, 0.0, 0.0)
    assert parse_scene(file(BALL, striker="[chain]\nvelocity = [0, 1, -1]\n")).velocity == (0.0, 1.0, -1.0)


CYLINDERS = """\
name = "own"
duration = 1e-3
[material]
name = "steel"
youngs_modulus = 193e9
poissons_ratio = 0.3
density = 8000.0
[chain.cylinders]
count = 3
radius = 6e-3
height = 2e-2
[chain.contacts]
law = "exact"
angle = 30.0
"""


def test_it_is_the_other_forms_where_they_can_say_the_same() -> None:
    keys = "repeat = 3\nangle = 30.0"
    for striker in (STRIKER, "", "[chain]\nvelocity = 0.4\n"):
        scene, other = parse_scene(file(ROD, keys=keys, striker=striker)), parse_scene(CYLINDERS + striker)
        assert scene == other
        assert scene.geometry == other.geometry
    table = CYLINDERS.index("[chain.cylinders]")
    spheres = CYLINDERS[:table] + "[chain.spheres]\ncount = 4\nradius = 9e-3\nratio = 0.9\n" + STRIKER
    tapered, other = parse_scene(file(BALL, keys="repeat = 4\ntaper = 0.9")), parse_scene(spheres)
    # r q q and r (q q): the last digit before rounding
    assert tapered.mass == pytest.approx(other.mass, rel=2e-12)
    assert tapered.stiffness == pytest.approx(other.stiffness, rel=2e-12)


sizes = st.floats(1e-3, 2e-2)
balls = st.builds('shape = "sphere"\nradius = {}\nmaterial = "{}"\n'.format, sizes, st.sampled_from(["steel", "ptfe"]))
lying = st.builds(
    'shape = "cylinder"\nradius = {}\nheight = {}\nmaterial = "{}"\n'.format,
    sizes,
    sizes,
    st.sampled_from(["steel", "ptfe"]),
)
cells = st.lists(balls | lying, min_size=1, max_size=3)


def any_angle(cell: list[str], repeat: int, more: str = "") -> str:
    """Keys of the pattern, with an angle where one is needed."""
    row = ["cylinder" in body for body in cell * repeat]
    crossed = any(one and other for one, other in pairwise(row))
    return f"repeat = {repeat}\n{more}" + ("angle = 35.0\n" if crossed else "")


@given(cell=cells, repeat=st.integers(1, 4))
@examples(40)
def test_properties_of_rows(cell: list[str], repeat: int) -> None:
    keys = any_angle(cell, repeat)
    scene = parse_scene(file(*cell, keys=keys, striker=""))
    # a taper of 1 is none, and a cell twice is two cells
    assert parse_scene(file(*cell, keys=f"{keys}taper = 1.0", striker="")) == scene
    unrolled = parse_scene(
        file(*cell * repeat, keys=any_angle(cell, repeat).replace(f"repeat = {repeat}", ""), striker="")
    )
    assert unrolled == scene
    # equal cells can change places; disorder of none changes nothing
    none = "[chain.pattern.disorder]\nradius = 0.0\nangle = 0.0\nseed = 1\n"
    assert parse_scene(file(*cell, keys=keys, striker="", more=none)) == scene
    # from the other end: cells backwards
    mirrored = parse_scene(file(*cell[::-1], keys=keys, striker=""))
    assert mirrored.mass == scene.mass[::-1]
    assert mirrored.stiffness == pytest.approx(scene.stiffness[::-1], rel=1e-11)  # sums in two orders, 12 digits


@given(cell=cells, repeat=st.integers(2, 4), taper=st.floats(0.7, 1.4))
@examples(40)
def test_a_taper_scales_masses_by_its_cube_and_stiffnesses_by_its_root(
    cell: list[str], repeat: int, taper: float
) -> None:
    scene = parse_scene(file(*cell, keys=any_angle(cell, repeat, f"taper = {taper!r}\n"), striker=""))
    one = len(cell)
    assert np.array(scene.mass[one:]) == pytest.approx(taper**3 * np.array(scene.mass[:-one]), rel=2e-11)
    assert np.array(scene.stiffness[one:]) == pytest.approx(
        math.sqrt(taper) * np.array(scene.stiffness[:-one]), rel=2e-11
    )


DISORDER = "[chain.pattern.disorder]\nradius = 0.01\nseed = 7\n"
STEP = f"[chain.pattern.step]\nfrom = 1\n[[chain.pattern.step.cell]]\n{SOFT}"
DECORATED = f"[chain.pattern.decorate]\n{SOFT}every = 3\n"
WHOLE = file(BALL, ROD, ROD, keys="repeat = 3\nangle = 30.0", more=STEP + DECORATED + DISORDER)
PATTERN = "chain.pattern"
WRONG: dict[str, tuple[str, str, str, str]] = {
    "a key misspelt": ("repeat = 3", "repeats = 3", f"{PATTERN}.repeats is an unknown key", "cell, repeat, law, angle"),
    "a key of a body misspelt": ("height = 2e-2", "length = 2e-2", f"{PATTERN}.cell[1].length is an", "shape, radius"),
    "no repeat": ("repeat = 3", "repeat = 0", f"{PATTERN}.repeat = 0", "greater than or equal to 1"),
    "half a cell": ("repeat = 3", "repeat = 2.5", f"{PATTERN}.repeat = 2.5", "whole number"),
    "no shape": ('shape = "sphere"', 'shape = "cube"', f"{PATTERN}.cell[0].shape = 'cube'", "'sphere' or 'cylinder'"),
    "no height": ("height = 2e-2\n", "", f"{PATTERN}.cell[1].height = None", "> 0 (m)"),
    "a sphere's height": (
        "radius = 9e-3",
        "radius = 9e-3\nheight = 1",
        f"{PATTERN}.cell[0].height = 1.0",
        "None for a",
    ),
    "a negative radius": ("radius = 9e-3", "radius = -9e-3", f"{PATTERN}.cell[0].radius = -0.009", "greater than 0"),
    "a radius beyond all": ("radius = 9e-3", "radius = 1e50", f"{PATTERN}.cell[0].radius = 1e+50", "magnitude"),
    "no such material": ('"steel"', '"brass"', f"{PATTERN}.cell[0].material = 'brass'", "steel, ptfe"),
    "no material": ('material = "steel"\n', "", f"{PATTERN}.cell[0].material is missing", "one of steel, ptfe"),
    "a material beyond all": ("density = 8000.0", "density = 1e50", "materials.steel.density = 1e+50", "magnitude"),
    "half a material": ("density = 8000.0\n", "", "materials.steel.density is missing", "youngs_modulus"),
    "one material": (
        "[chain.striker]",
        "[material]\ndensity = 1.0\n[chain.striker]",
        "material is an unknown",
        "materials",
    ),
    "two forms": ("[chain.striker]", "[chain.spheres]\ncount=1\n[chain.striker]", "chain.spheres is an", "pattern"),
    "no angle": ("angle = 30.0", "", f"{PATTERN}.angle is missing", "list angles for"),
    "two ways": (
        "angle = 30.0",
        "angle = 30.0\nangles = [1]",
        f"{PATTERN}.angles cannot be combined with angle",
        "one of the two",
    ),
    "an angle of 91": ("angle = 30.0", "angle = 91", f"{PATTERN}.angle = 91", "less than or equal to 90"),
    "angles of others": ("angle = 30.0", "angles = [1, 2]", f"{PATTERN}.angles has 2 entries", "1, one per contact"),
    "no taper": ("repeat = 3", "repeat = 3\ntaper = 0", f"{PATTERN}.taper = 0", "greater than 0"),
    "a taper beyond all": ("repeat = 3", "repeat = 3\ntaper = 1e-30", f"{PATTERN}.taper = 1e-30 gives cell 2", "1e-40"),
    "gaps of others": ("repeat = 3", "repeat = 3\ngap = [0]", f"{PATTERN}.gap has 1 entries", "one per contact of the"),
    "a step too late": ("from = 1", "from = 3", f"{PATTERN}.step.from = 3", "from 0 to 2"),
    "a step without cells": (
        "from = 1\n[[chain.pattern.step.cell]]",
        "from = 1\n[chain.x]",
        "chain.x is an",
        "pattern",
    ),
    "a key of a step": ("from = 1", "at = 1", f"{PATTERN}.step.at is an unknown key", "from, cell"),
    "decorations too far apart": ("every = 3", "every = 5", f"{PATTERN}.decorate.every = 5", "less than 5, the number"),
    "no decoration": ("every = 3", "every = 0", f"{PATTERN}.decorate.every = 0", "greater than or equal to 1"),
    "no seed": ("seed = 7\n", "", f"{PATTERN}.disorder.seed is missing", "radius, angle, seed"),
    "no disorder": ("radius = 0.01\nseed", "seed", f"{PATTERN}.disorder has neither", "radius (relative)"),
    "too much disorder": (
        "radius = 0.01",
        "radius = 3",
        f"{PATTERN}.disorder.radius = 3.0 and the seed 7 give",
        "above 0",
    ),
    "less than no disorder": ("radius = 0.01", "radius = -1", f"{PATTERN}.disorder.radius = -1", "equal to 0"),
    "a striker of nothing": ("radius = 4e-3\n", "", "chain.striker.mass is missing", "like = 'first-body'"),
    "a striker's material": (
        "radius = 4e-3",
        "radius = 4e-3\nmaterial='a'",
        "chain.striker.material = 'a'",
        "steel, ptfe",
    ),
    "a striker's exponent": ("radius = 4e-3", "radius = 4e-3\nexponent = 2", "chain.striker.exponent = 2.0", "2.5"),
    "a striker like two": (
        "radius = 4e-3",
        "like = 'first-body'\nmaterial = 'ptfe'",
        "chain.striker.material cannot be combined with like",
        "velocity and gap",
    ),
    "velocities beside a striker": (
        "[chain.striker]",
        "[chain]\nvelocity = 1\n[chain.striker]",
        "chain.velocity cannot be combined with a striker",
        "striker.velocity",
    ),
    "a wall of nothing": ("seed = 7", "seed = 7\n[chain.wall_left]\ngap = 0", "chain.wall_left has neither", "one of"),
    "a wall twice": (
        "seed = 7",
        "seed = 7\n[chain.wall_left]\nstiffness = 1\nmaterial='steel'",
        "chain.wall_left has both",
        "one of the two",
    ),
    "a wall of words": (
        "seed = 7",
        "seed = 7\n[chain.wall_left]\nmaterial='a'",
        "chain.wall_left.material = 'a'",
        "steel",
    ),
    "a wall that is no wall": (
        "seed = 7",
        "seed = 7\n[chain.wall_left]\nmaterial='steel'\nexponent=2",
        "chain.wall_left.exponent = 2.0",
        "2.5",
    ),
}


def test_the_file_that_mistakes_are_made_in_has_none() -> None:
    assert parse_scene(WHOLE).n_body == 7


@pytest.mark.parametrize(("old", "new", "found", "allowed"), WRONG.values(), ids=WRONG)
def test_a_mistake_is_named_in_one_line(old: str, new: str, found: str, allowed: str) -> None:
    assert old in WHOLE
    with pytest.raises(SceneError) as caught:
        parse_scene(WHOLE.replace(old, new, 1), where="own.toml")
    message = str(caught.value)
    assert message.startswith(f"own.toml: {found}"), message
    assert allowed in message.split("allowed:")[1]
    assert "\n" not in message


MORE_WRONG: dict[str, tuple[str, str, str]] = {
    "an angle of spheres": (file(BALL, keys="repeat=2\nangle=3"), f"{PATTERN}.angle is given", "no two cylinders meet"),
    "disorder of no angles": (
        file(BALL, more="[chain.pattern.disorder]\nangle = 1\nseed = 1\n"),
        f"{PATTERN}.disorder.angle = 1.0",
        "no two cylinders of the chain meet",
    ),
    "a striker that crosses alone": (
        file(ROD, SOFT, striker='[chain.striker]\nvelocity = 1\nlike = "first-body"\n'),
        f"{PATTERN}.angle is missing",
        "<= 90",
    ),
    "a cylinder on a flat wall": (
        file(BALL, ROD, more='[chain.wall_right]\nmaterial = "steel"\n'),
        "chain.wall_right is a material, but the body next to it is a cylinder",
        "no point contact",
    ),
    "velocities of others": (
        file(BALL, striker="[chain]\nvelocity = [1]\n"),
        "chain.velocity has 1 entries",
        "3, one per body of the chain",
    ),
    "no cells": (
        'name = "a"\nduration = 1\n[chain.pattern]\ncell = []\n' + MATERIALS,
        f"{PATTERN}.cell = []",
        "1 item",
    ),
    "no materials": (re.sub(r"\[materials.*\](.*\n){4,5}?(?=\[)", "", file(BALL)), "materials is missing", "duration"),
}


@pytest.mark.parametrize(("text", "found", "allowed"), MORE_WRONG.values(), ids=MORE_WRONG)
def test_what_does_not_fit_together_is_named_in_one_line(text: str, found: str, allowed: str) -> None:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, where="own.toml")
    message = str(caught.value)
    assert message.startswith(f"own.toml: {found}"), message
    assert allowed in message.split("allowed:")[1]
    assert "\n" not in message
