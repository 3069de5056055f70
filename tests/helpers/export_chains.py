"""Provide small scenes for tables: each has something that another has not."""

from __future__ import annotations

from typing import Any

from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder
from dem_bridge.scene.geometry import Body, Geometry, Material
from dem_bridge.scene.scene import Damping, Scene, Wall

QUARTZ = Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0, name="quartz & 100%_pure")
STEEL = Material(youngs_modulus=200e9, poissons_ratio=0.3, density=7800.0, name="steel")
SPHERE = Body(shape="sphere", radius=9e-3, material=QUARTZ)
CYLINDER = Body(shape="cylinder", radius=9e-3, height=18e-3, material=QUARTZ)
ELASTIC: dict[str, Any] = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}

#: a sphere strikes three cylinders; the printed mass of the paper's striker
CROSSED = Scene(
    name="crossed_3",
    duration=2e-4,
    mass=(8.1e-3, CYLINDER.mass, CYLINDER.mass, CYLINDER.mass),
    stiffness=(
        sphere_on_cylinder(**ELASTIC).stiffness,
        crossed_cylinders(angle=20.0, **ELASTIC).stiffness,
        crossed_cylinders(angle=90.0, **ELASTIC).stiffness,
    ),
    velocity=(0.8, 0.0, 0.0, 0.0),
    samples=60,
    spacing=18e-3,
    geometry=Geometry(bodies=(SPHERE, CYLINDER, CYLINDER, CYLINDER), angles=(None, 20.0, 90.0)),
)
#: masses and stiffnesses alone, between walls, one contact of another exponent, one law twice
RAW = Scene(
    name="raw",
    duration=2e-4,
    mass=(8e-3, 1e-2, 1.5e-2, 1e-2),
    stiffness=(4e9, 3e7, 4e9),
    exponent=(2.5, 2.0, 2.5),
    gap=(0.0, 1e-7, 0.0),
    velocity=(0.8, 0.0, 0.0, 0.0),
    wall_left=Wall(stiffness=6e9, gap=1e-6),
    wall_right=Wall(stiffness=4e9),
    damping=Damping(law="dashpot", coefficient=(2.0, 2.0, 2.0, 0.0, 2.0)),
    samples=40,
)
#: two balls that meet
PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=40)

#: a scene file of a striker and four cylinders: a study of its angles takes a tenth of the time of 40 cylinders
CROSSED_FILE = """\
name = "crossed_4"
duration = 3e-4
[material]
youngs_modulus = 72e9
poissons_ratio = 0.17
density = 2200.0
[chain.cylinders]
count = 4
radius = 9e-3
height = 18e-3
[chain.contacts]
law = "paper"
first_angle = 90.0
last_angle = 20.0
grading = "linear-stiffness"
[chain.striker]
radius = 9e-3
mass = 8.1e-3
velocity = 0.8
stiffness = 3.98e9
[sampling]
count = 20
"""
