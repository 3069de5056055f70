"""The Scene of a file in impact form: two spheres, or a sphere and a plane, that approach each other.

The force is Hertz's, whose stiffness follows from radii and materials, or that of a linear spring.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from dem_bridge.damping import RESTITUTION, Damping
from dem_bridge.errors import SceneError
from dem_bridge.geometry import Body, Geometry, Material
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.scene import Scene, Wall
from dem_bridge.scene_file import forms
from dem_bridge.scene_file.pattern import material_of, materials_of
from dem_bridge.scene_file.physical import HERTZ, rounded

#: exponent n of the contact, by the law
_EXPONENTS = {"hertz": HERTZ, "hooke": 2.0}
#: name of the material of a plane that does not deform
RIGID = "rigid"
#: duration without an entry in the file, in contact times of the impact without damping
_CONTACT_TIMES = 4.0


def from_impact(file: forms.ImpactScene) -> Scene:
    """Return the Scene of an impact; a plane is the wall on the right of a single body."""
    impact, materials = file.impact, dict(materials_of(file.materials))
    if RIGID in materials:
        raise SceneError(f"materials.{RIGID}", problem="is a reserved name", allowed="another name")
    plane = impact.second.radius is None and impact.second.mass is None
    tables = {"first": impact.first} | ({} if plane else {"second": impact.second})
    if plane and impact.second.velocity != 0.0:
        allowed = "0 for a plane, or a radius or a mass for a second body"
        raise SceneError("impact.second.velocity", value=impact.second.velocity, allowed=allowed)
    bodies = {key: _sphere(table, materials, f"impact.{key}") for key, table in tables.items()}
    mass = tuple(
        rounded(body.mass) if table.mass is None and body is not None else table.mass or math.nan
        for table, body in zip(tables.values(), bodies.values(), strict=True)
    )
    velocity = tuple(table.velocity for table in tables.values())
    stiffness, n = _stiffness(impact, bodies, plane, materials), _EXPONENTS[impact.law]
    spheres = tuple(body for body in bodies.values() if body is not None)
    geometry = Geometry(bodies=spheres) if len(spheres) == len(tables) else None
    radii = forms.effective_radii(() if geometry is None else spheres, (False, plane))
    return Scene(
        name=file.name,
        description=file.description,
        duration=_duration(file, mass, stiffness) if file.duration is None else file.duration,
        mass=mass,
        velocity=velocity,
        stiffness=() if plane else (stiffness,),
        exponent=() if plane else n,
        gap=() if plane else impact.gap,
        wall_right=Wall(stiffness=stiffness, gap=impact.gap, exponent=n) if plane else None,
        damping=_damping(impact),
        adhesion=None if impact.adhesion is None else impact.adhesion.adhesion(radii),
        geometry=geometry,
        samples=file.sampling.count,
        **file.environment.model_dump(),
    )


def _sphere(table: forms.ImpactBody, materials: Mapping[str, Material], where: str) -> Body | None:
    """Return the body of a table, None if only its mass is known."""
    if table.radius is None:
        if table.mass is None:
            raise SceneError(where, problem="has neither radius nor mass", allowed="radius (m), or mass (kg)")
        return None
    return Body(
        shape="sphere", radius=table.radius, material=material_of(table.material, materials, f"{where}.material")
    )


def _stiffness(
    impact: forms.Impact, bodies: Mapping[str, Body | None], plane: bool, materials: Mapping[str, Material]
) -> float:
    """Return the stiffness of the contact, that of the file or by Hertz's law, N/m^(n-1)."""
    from dem_bridge.physics.hertz import sphere_on_plane

    if impact.stiffness is not None:
        return impact.stiffness
    unknown = [key for key, body in bodies.items() if body is None]
    if impact.law != "hertz" or unknown:
        why = f'law = "{impact.law}"' if not unknown else f"impact.{unknown[0]} without a radius"
        allowed = f"a number > 0, which {why} requires"
        raise SceneError("impact.stiffness", problem="is missing", allowed=allowed)
    first = bodies["first"]
    assert first is not None
    if not plane:
        return rounded(Geometry(bodies=tuple(filter(None, bodies.values()))).contact(0).stiffness)
    second = {"young2": math.inf, "poisson2": 0.0}
    if impact.second.material != RIGID:
        flat = material_of(impact.second.material, materials, "impact.second.material", also=(RIGID,))
        second = {"young2": flat.youngs_modulus, "poisson2": flat.poissons_ratio}
    return rounded(sphere_on_plane(radius=first.radius, **first.material.elastic, **second).stiffness)


def _damping(impact: forms.Impact) -> Damping | None:
    """Return the damping of the file."""
    if impact.restitution is not None:
        if impact.damping is not None:
            raise SceneError("impact.restitution", problem="cannot be combined with damping", allowed="one of the two")
        if not 0.0 < impact.restitution <= 1.0:
            raise SceneError("impact.restitution", value=impact.restitution, allowed=RESTITUTION)
        return Damping(law="restitution", coefficient=impact.restitution)
    return None if impact.damping is None else impact.damping.damping()


def _duration(file: forms.ImpactScene, mass: tuple[float, ...], stiffness: float) -> float:
    """Return the time of the approach and four contact times of the impact without damping, s, with 2 digits."""
    impact = file.impact
    closing = impact.first.velocity - impact.second.velocity
    if not closing > 0.0:
        problem = f"is missing, and the bodies approach each other at {closing:g} m/s"
        raise SceneError(
            "duration", problem=problem, allowed="a number > 0 (s), or velocities with which they approach"
        )
    masses = (mass[0], mass[1] if len(mass) > 1 else math.inf)
    exponent = _EXPONENTS[impact.law]
    collision = two_body_collision(masses=masses, velocities=(closing, 0.0), stiffness=stiffness, exponent=exponent)
    return float(f"{max(impact.gap, 0.0) / closing + _CONTACT_TIMES * collision.contact_time:.2g}")
