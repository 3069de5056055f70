"""What the bodies of a chain are: checked when made, angles found from stiffnesses, no part of the motion."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import pytest

from dem_bridge.errors import SceneError
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.scene.geometry import Body, Geometry, Material
from dem_bridge.scene.scene import Scene

QUARTZ = Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0, name="fused quartz")
SPHERE = Body(shape="sphere", radius=9e-3, material=QUARTZ)
CYLINDER = Body(shape="cylinder", radius=9e-3, height=18e-3, material=QUARTZ)
PAIR = Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))


def test_masses_are_density_times_volume() -> None:
    # as known to the digits given: the paper's m, and a sphere that is not its m0 of 8.1 g
    assert CYLINDER.mass == pytest.approx(10.08e-3, abs=5e-6)
    assert SPHERE.mass == pytest.approx(6.72e-3, abs=5e-6)
    # a cylinder as high as wide holds 3/2 of its sphere
    assert CYLINDER.mass / SPHERE.mass == pytest.approx(1.5, rel=1e-15)


@pytest.mark.parametrize("law", ["paper", "exact"])
def test_angles_follow_from_the_stiffness_by_the_law(law: str) -> None:
    angles = (2.0, 7.0, 45.0, 89.0)
    quartz = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}
    stiffness = [crossed_cylinders(angle=angle, law=law, **quartz).stiffness for angle in angles]  # type: ignore[arg-type]
    bodies = (SPHERE, *[CYLINDER] * 5)
    found = Geometry(bodies=bodies, law=law, stiffness=(None, *stiffness)).angle  # type: ignore[arg-type]
    assert found[0] is None
    # the inverse is good to 1e-12 of itself
    assert found[1:] == pytest.approx(angles, rel=2e-12)


def test_angles_that_were_given_are_those_that_were_given() -> None:
    given = (None, 1.0 / 3.0, 90.0)
    assert Geometry(bodies=(SPHERE, *[CYLINDER] * 3), angles=given).angle == given


def test_spheres_have_no_angles() -> None:
    assert Geometry(bodies=(SPHERE,) * 3).angle == (None, None)
    assert Geometry(bodies=(SPHERE,)).angle == ()


WRONG = {
    "body.shape": (lambda: replace(SPHERE, shape="cube"), "sphere or cylinder"),
    "body.radius": (lambda: replace(SPHERE, radius=-1.0), "> 0 (m)"),
    "body.height": (lambda: replace(CYLINDER, height=None), "None for a sphere"),
    "body.height = 0.1": (lambda: replace(SPHERE, height=0.1), "None for a sphere"),
    "body.material": (lambda: replace(SPHERE, material="quartz"), "a Material"),  # type: ignore[arg-type]
    "material.density": (lambda: replace(QUARTZ, density=math.nan), "> 0 (kg/m^3)"),
    "material.poissons_ratio": (lambda: replace(QUARTZ, poissons_ratio=0.6), "nu <= 0.5"),
    "geometry.bodies": (lambda: Geometry(bodies=(SPHERE, 1)), "a tuple of Body"),  # type: ignore[arg-type]
    "geometry.law": (lambda: Geometry(bodies=(SPHERE,), law="hertz"), "paper or exact"),  # type: ignore[arg-type]
    "geometry has crossed cylinders": (lambda: Geometry(bodies=(CYLINDER,) * 2), "their angles"),
    "geometry has both angles and": (lambda: Geometry(bodies=(SPHERE,), angles=(), stiffness=()), "one of the two"),
    "geometry.angles = (1.0, 2.0)": (lambda: Geometry(bodies=(CYLINDER,) * 2, angles=(1.0, 2.0)), "1 entries, one per"),
    "geometry.angles[0] = 91.0": (lambda: Geometry(bodies=(CYLINDER,) * 2, angles=(91.0,)), "<= 90"),
    "geometry.angles[0] = 0.0": (lambda: Geometry(bodies=(CYLINDER,) * 2, angles=(0.0,)), "> 0"),
    "geometry.angles[0] = None": (
        lambda: Geometry(bodies=(CYLINDER,) * 2, angles=(None,)),
        "None for a contact with a sphere",
    ),
    "geometry.angles[0] = 2.0": (
        lambda: Geometry(bodies=(SPHERE, CYLINDER), angles=(2.0,)),
        "None for a contact with a sphere",
    ),
    "geometry.stiffness[0]": (lambda: Geometry(bodies=(CYLINDER,) * 2, stiffness=(-1.0,)), "> 0 (N/m^1.5)"),
    "geometry has 3 bodies": (lambda: replace(PAIR, geometry=Geometry(bodies=(SPHERE,) * 3)), "2, one per mass"),
    "geometry = 'spheres'": (lambda: replace(PAIR, geometry="spheres"), "a Geometry or None"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize(("start", "make", "allowed"), [(key, *value) for key, value in WRONG.items()], ids=WRONG)
def test_what_no_body_is_is_refused_in_one_line(start: str, make: object, allowed: str) -> None:
    assert callable(make)
    with pytest.raises(SceneError) as caught:
        make()
    message = str(caught.value)
    assert message.startswith(f"scene: {start}")
    assert allowed in message.split("allowed:")[1]
    assert "\n" not in message


def test_a_geometry_decides_nothing_of_the_motion() -> None:
    known = replace(PAIR, geometry=Geometry(bodies=(SPHERE, SPHERE)))
    assert known.content_hash == PAIR.content_hash
    assert known == PAIR
    assert "geometry" not in repr(known)


def test_a_geometry_goes_to_other_processes() -> None:
    stiffness = crossed_cylinders(angle=30.0, radius=9e-3, young=72e9, poisson=0.17).stiffness
    scene = replace(PAIR, geometry=Geometry(bodies=(CYLINDER, CYLINDER), stiffness=(stiffness,)))
    assert scene.geometry is not None
    assert scene.geometry.angle[0] == pytest.approx(30.0, rel=1e-12)
    there = pickle.loads(pickle.dumps(scene))
    assert there.geometry == scene.geometry
    assert there.geometry.angle == scene.geometry.angle
