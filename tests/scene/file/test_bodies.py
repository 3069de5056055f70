"""Chains of any bodies, from Python: Hertz' contacts by formulas of the test's own, symmetry, and each refusal."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq

import dem_bridge as db
from dem_bridge.errors import SceneError, UsageError
from dem_bridge.scene.file.bodies import chain
from dem_bridge.scene.geometry import Body, Material, crossings
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.helpers.strategies import examples, log_uniform

STEEL = Material(youngs_modulus=193e9, poissons_ratio=0.3, density=8000.0, name="steel")
PTFE = Material(youngs_modulus=1.46e9, poissons_ratio=0.46, density=2200.0, name="PTFE")
BALL = Body(shape="sphere", radius=4.76e-3, material=STEEL)
SOFT = Body(shape="sphere", radius=3e-3, material=PTFE)
ROD = Body(shape="cylinder", radius=5e-3, height=2e-2, material=STEEL)


def of(*bodies: Body, **more: Any) -> Scene:
    settings: dict[str, Any] = {"name": "own", "duration": 1e-3, "bodies": bodies} | more
    return chain(**settings)


def modulus(one: Material, other: Material) -> float:
    return 1.0 / sum((1.0 - m.poissons_ratio**2) / m.youngs_modulus for m in (one, other))


def test_spheres_of_two_materials_meet_as_hertz_has_it() -> None:
    scene = of(BALL, SOFT, BALL, BALL, velocity=0.5)
    # beta = (4/3) E* sqrt(R), 1/R = 1/R1 + 1/R2 (Johnson 1985, section 4.2); 12 digits
    mixed = 4.0 / 3.0 * modulus(STEEL, PTFE) * math.sqrt(1.0 / (1.0 / 4.76e-3 + 1.0 / 3e-3))
    alike = 4.0 / 3.0 * modulus(STEEL, STEEL) * math.sqrt(4.76e-3 / 2.0)
    assert scene.stiffness == pytest.approx((mixed, mixed, alike), rel=1e-11)
    heavy, light = 8000.0 * 4.0 / 3.0 * math.pi * 4.76e-3**3, 2200.0 * 4.0 / 3.0 * math.pi * 3e-3**3
    assert scene.mass == pytest.approx((heavy, light, heavy, heavy), rel=1e-11)
    assert all(number == float(f"{number:.12g}") for number in (*scene.mass, *scene.stiffness))
    assert scene.velocity == (0.5, 0.0, 0.0, 0.0)
    assert scene.exponent == (2.5,) * 3
    assert scene.geometry is not None
    assert scene.geometry.bodies == (BALL, SOFT, BALL, BALL)


def test_cylinders_of_two_materials_cross_at_90_degrees_as_a_sphere_on_a_plane() -> None:
    rods = Body(shape="cylinder", radius=5e-3, height=1e-2, material=PTFE)
    scene = of(ROD, rods, angles=90.0)
    # equal radii r at 90 degrees: a circle with A = B = 1/(2 r), so R = r
    assert scene.stiffness == pytest.approx((4.0 / 3.0 * modulus(STEEL, PTFE) * math.sqrt(5e-3),), rel=1e-11)
    assert scene.mass == pytest.approx(
        (8000.0 * math.pi * 5e-3**2 * 2e-2, 2200.0 * math.pi * 5e-3**2 * 1e-2), rel=1e-11
    )


def ellipse_stiffness(small: float, large: float, young: float) -> float:
    """By quadrature of Hertz' own integrals (Landau & Lifshitz, *Theory of Elasticity*, section 9), N/m^1.5.

    ``small``, ``large``: A and B of the gap A x^2 + B y^2. With semi-axes a and k a, ``h = c I(1/2, 1/2)/a`` and
    ``A = c I(3/2, 1/2)/a^3``, ``B = c I(1/2, 3/2)/a^3``, c = 3 F/(4 pi E*), where I(p, q) is the integral over s from
    0 of ``ds/((1 + s)^p (k^2 + s)^q sqrt(s))``.
    """

    def integral(p: float, q: float, k: float) -> float:
        def integrand(t: float) -> float:  # s = tan(t)^2
            s = math.tan(t) ** 2
            return 2.0 / (math.pow(1.0 + s, p - 1.0) * math.pow(k * k + s, q))

        return float(quad(integrand, 0.0, 0.5 * math.pi, epsabs=0.0, epsrel=1e-13, limit=200)[0])

    k: float = brentq(lambda k: integral(0.5, 1.5, k) / integral(1.5, 0.5, k) - large / small, 1e-2, 1.0, xtol=1e-14)
    c = 3.0 / (4.0 * math.pi * young)
    a: float = math.cbrt(c * integral(1.5, 0.5, k) / small)
    return float((c * integral(0.5, 0.5, k) / a) ** -1.5)


def test_other_contacts_are_those_of_hertz_own_integrals() -> None:
    scene = of(BALL, ROD, ROD, SOFT, angles=30.0)
    between = modulus(STEEL, STEEL)
    on_rod = (0.5 / 4.76e-3, 0.5 * (1.0 / 4.76e-3 + 1.0 / 5e-3))
    crossed = [0.5 / 5e-3 * (1.0 + sign * math.cos(math.radians(30.0))) for sign in (-1, 1)]
    soft = (0.5 / 3e-3, 0.5 * (1.0 / 3e-3 + 1.0 / 5e-3))
    expected = (
        ellipse_stiffness(*on_rod, between),
        ellipse_stiffness(crossed[0], crossed[1], between),
        ellipse_stiffness(*soft, modulus(STEEL, PTFE)),
    )
    # quadrature to 1e-13, its root to 1e-14; scenes have 12 digits
    assert scene.stiffness == pytest.approx(expected, rel=1e-10)


def test_a_striker_stands_before_the_row_and_only_it_moves() -> None:
    struck, row = of(SOFT, BALL, striker=BALL, velocity=0.8), of(BALL, SOFT, BALL, velocity=(0.8, 0, 0))
    assert struck == row
    assert struck.geometry == row.geometry
    # the row behind the striker has two radii; one row of one radius has a distance of centres
    assert (struck.spacing, of(BALL, BALL, striker=SOFT).spacing) == (None, 2.0 * 4.76e-3)


def test_bodies_come_from_loops_and_angles_and_gaps_from_arrays() -> None:
    rods = (Body(shape="cylinder", radius=r, height=1e-2, material=STEEL) for r in np.linspace(4e-3, 5e-3, 4))
    scene = chain(
        name="loop",
        duration=1e-3,
        bodies=rods,
        velocity=np.array([1, 0, 0, 0]),
        angles=np.array([10.0, 20.0, 90.0]),
        gap=np.array([0.0, 1e-6, 0.0]),
    )
    assert scene.geometry is not None
    assert scene.geometry.angle == (10.0, 20.0, 90.0)
    assert (scene.gap, scene.velocity) == ((0.0, 1e-6, 0.0), (1.0, 0.0, 0.0, 0.0))
    assert of(BALL, BALL, BALL, velocity=np.int64(2)).velocity == (2.0, 0.0, 0.0)


def test_angles_are_those_of_two_cylinders_in_order() -> None:
    scene = of(ROD, BALL, ROD, ROD, ROD, SOFT, angles=(10.0, 20.0))
    assert crossings((ROD, BALL, ROD, ROD, ROD, SOFT)) == (2, 3)
    assert scene.geometry is not None
    assert scene.geometry.angle == (None, None, 10.0, 20.0, None)
    softer = of(ROD, ROD, angles=20.0, law="exact").stiffness[0]
    assert (scene.stiffness[3], softer < of(ROD, ROD, angles=20.0, law="paper").stiffness[0]) == (softer, True)


def test_a_wall_of_a_material_is_flat() -> None:
    scene = of(BALL, SOFT, wall_left=STEEL, wall_right=STEEL)
    left = 4.0 / 3.0 * modulus(STEEL, STEEL) * math.sqrt(4.76e-3)
    right = 4.0 / 3.0 * modulus(STEEL, PTFE) * math.sqrt(3e-3)
    assert scene.wall_left is not None
    assert scene.wall_right is not None
    assert (scene.wall_left.stiffness, scene.wall_right.stiffness) == pytest.approx((left, right), rel=1e-11)
    assert of(BALL, wall_right=Wall(stiffness=1e9, gap=1e-6)).wall_right == Wall(stiffness=1e9, gap=1e-6, exponent=2.5)


def test_all_else_is_as_a_scene_has_it() -> None:
    more: dict[str, Any] = {"precompression": 2.0, "gravity": 9.81, "drag": 0.5, "samples": 7, "description": "pressed"}
    scene = of(BALL, BALL, wall_right=STEEL, damping=Damping(law="dashpot", coefficient=1.0), **more)
    assert {key: getattr(scene, key) for key in more} == more
    assert scene.damping == Damping(law="dashpot", coefficient=(1.0, 1.0))


def test_what_repeats_is_reckoned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    own = db.Geometry.contact

    def counted(self: db.Geometry, k: int, law: Any) -> Any:
        asked.append(k)
        return own(self, k, law)

    monkeypatch.setattr(db.Geometry, "contact", counted)
    assert of(*[BALL, ROD] * 50).n_body == 100
    assert asked == [0, 1]


materials = st.builds(
    Material,
    youngs_modulus=log_uniform(1e8, 1e12),
    poissons_ratio=st.floats(0.0, 0.49),
    density=log_uniform(5e2, 2e4),
)
spheres = st.builds(Body, shape=st.just("sphere"), radius=log_uniform(1e-4, 1e-1), material=materials)
rods = st.builds(
    Body, shape=st.just("cylinder"), radius=log_uniform(1e-4, 1e-1), height=log_uniform(1e-3, 1.0), material=materials
)
rows = st.lists(spheres | rods, min_size=1, max_size=6)


@given(rows=rows, angle=st.floats(1.0, 90.0))
@examples(50)
def test_a_row_seen_from_the_other_end_has_the_same_contacts(rows: list[Body], angle: float) -> None:
    angles = angle if crossings(rows) else None
    one, other = of(*rows, angles=angles), of(*rows[::-1], angles=angles)
    assert other.mass == one.mass[::-1]
    # two orders of the same sums, rounded to 12 digits
    assert other.stiffness == pytest.approx(one.stiffness[::-1], rel=1e-11)


@given(rows=rows, angle=st.floats(1.0, 90.0), size=log_uniform(0.1, 10.0), hard=log_uniform(0.1, 10.0))
@examples(50)
def test_sizes_moduli_and_densities_scale(rows: list[Body], angle: float, size: float, hard: float) -> None:
    def scaled(body: Body) -> Body:
        m = body.material
        material = Material(
            youngs_modulus=hard * m.youngs_modulus, poissons_ratio=m.poissons_ratio, density=2.0 * m.density
        )
        height = None if body.height is None else size * body.height
        return Body(shape=body.shape, radius=size * body.radius, height=height, material=material)

    angles = angle if crossings(rows) else None
    one, other = of(*rows, angles=angles), of(*map(scaled, rows), angles=angles)
    # beta as modulus times the root of length, mass as density times volume; both sides to 12 digits
    assert np.array(other.stiffness) == pytest.approx(hard * math.sqrt(size) * np.array(one.stiffness), rel=2e-11)
    assert np.array(other.mass) == pytest.approx(2.0 * size**3 * np.array(one.mass), rel=2e-11)


WRONG: dict[str, tuple[dict[str, Any], str, str]] = {
    "no bodies": ({"bodies": []}, "bodies is not a list of bodies", "one Body or more"),
    "no list": ({"bodies": 3}, "bodies is not a list of bodies", "one Body or more"),
    "a number among them": ({"bodies": [BALL, 3]}, "bodies is not a list of bodies", "one Body or more"),
    "a striker by speed": ({"striker": 0.8}, "striker = 0.8", "a Body or None"),
    "no angles": ({"bodies": [BALL, ROD, ROD]}, "angles are missing; bodies 1 and 2 cross", "list of 1"),
    "angles of spheres": ({"angles": 30.0}, "angles = 30.0", "no two cylinders meet"),
    "two angles for one": ({"bodies": [ROD, ROD], "angles": [3, 4]}, "angles has 2 entries", "1, one per contact of"),
    "angle 0": ({"bodies": [ROD, ROD], "angles": 0.0}, "angles = 0.0", "> 0 and <= 90"),
    "angle 91": ({"bodies": [ROD, ROD], "angles": 91.0}, "angles[0] = 91.0", "> 0 and <= 90"),
    "parallel": ({"bodies": [ROD, ROD], "angles": 1e-200}, "angles = 1e-200", "magnitude"),
    "no law": ({"bodies": [ROD, ROD], "angles": 3, "law": "hertz"}, "law = 'hertz'", "paper or exact"),
    "velocities of others": ({"velocity": [1.0, 0.0, 0.0]}, "velocity has 3 entries", "2, one per body"),
    "velocity nan": ({"velocity": math.nan}, "velocity = nan", "finite number (m/s)"),
    "velocity in words": ({"velocity": "fast"}, "velocity = 'fast'", "finite number (m/s)"),
    "gaps of others": ({"gap": [0.0, 0.0]}, "gap has 2 entries", "1, one per contact"),
    "a cylinder on a wall": (
        {"bodies": [BALL, ROD], "wall_right": STEEL},
        "wall_right is a material, but the body next to it is a cylinder",
        "no point contact",
    ),
    "a wall of words": ({"wall_left": "steel"}, "wall_left = 'steel'", "a Wall or None"),
}


@pytest.mark.parametrize(("more", "found", "allowed"), WRONG.values(), ids=WRONG)
def test_bad_input_is_refused_in_one_line(more: dict[str, Any], found: str, allowed: str) -> None:
    with pytest.raises(SceneError) as caught:
        of(BALL, BALL, **more)
    message = str(caught.value)
    assert found in message
    assert allowed in message.split("allowed:")[1]
    assert "\n" not in message


@pytest.mark.parametrize(
    ("key", "why"), [("mass", "follows from the bodies"), ("stiffness", "follows"), ("precompresion", "is unknown")]
)
def test_keywords_that_there_are_not_are_refused(key: str, why: str) -> None:
    with pytest.raises(UsageError, match=f"setting '{key}' {why}.*allowed: adhesion, angles, bodies, .*velocity"):
        of(BALL, BALL, **{key: 1.0})
