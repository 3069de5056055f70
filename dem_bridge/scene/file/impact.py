"""The impact form of scene files: two spheres, or a sphere and a plane, that approach each other from touch.

The force is Hertz's, whose stiffness follows from radii and materials.
"""

from __future__ import annotations

import math
from typing import Literal

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import Numbers, checked_number, checked_numbers
from dem_bridge.physics.hertz import sphere_on_plane
from dem_bridge.scene.file import conversion, forms
from dem_bridge.scene.file.conversion import HERTZ, rounded
from dem_bridge.scene.geometry import Body, Geometry, Material
from dem_bridge.scene.scene import Scene, Wall

#: duration without an entry in the file, in contact times of the impact without damping and adhesion
_CONTACT_TIMES = 4.0
_POSITIVE = {"above": 0.0}
_NUMBERS = {
    "radius": Numbers("a number > 0 (m)", _POSITIVE),
    "youngs_modulus": Numbers("a number > 0 (Pa)", _POSITIVE),
    "poissons_ratio": Numbers("-1 < nu <= 0.5", {"above": -1.0, "at_most": 0.5}),
    "density": Numbers("a number > 0 (kg/m^3)", _POSITIVE),
}


class SurfaceEnergy(forms.RawTable):
    """Table [impact.adhesion]."""

    law: Literal["dmt", "jkr"]
    surface_energy: float
    """Surface energy, J/m^2: half of the work of adhesion."""


class Impact(forms.RawTable):
    """Table [impact]; numbers of a material are one value, or one of each sphere."""

    radius: forms.Numbers
    """Radius of each sphere, m; one value with a plane."""
    wall: Literal[False, True, "same"] = False
    """True is a rigid plane, "same" a plane of the sphere's material."""
    youngs_modulus: forms.Numbers
    """Young's modulus, Pa."""
    poissons_ratio: forms.Numbers
    """Poisson's ratio."""
    density: forms.Numbers
    """Density, kg/m^3."""
    speed: float
    """Speed of approach, m/s; each of two spheres has half of it."""
    gap: float = 0.0
    """Distance of the surfaces at the start, m."""
    damping: forms.DampingTable | None = None
    adhesion: SurfaceEnergy | None = None


class ImpactScene(forms.RawTable):
    """A scene file with an impact."""

    name: str
    """Name of the scene: 1 to 100 of the characters A-Z a-z 0-9 . _ -"""
    duration: forms.AboveZero | None = None
    """Duration, s; without it the approach and four contact times without damping."""
    description: str = ""
    """What happens, in one line."""
    impact: Impact
    sampling: forms.Sampling = forms.Sampling()
    environment: forms.Environment = forms.Environment()
    measurement: forms.MeasurementTable | None = None


def from_impact(file: ImpactScene) -> Scene:
    """Return the Scene of an impact; a plane is the wall on the right of a single body."""
    impact, plane = file.impact, file.impact.wall is not False
    spheres = _spheres(impact)
    mass = tuple(rounded(sphere.mass) for sphere in spheres)
    speed, gap = _approach(impact)
    if plane:
        elastic = spheres[0].material.elastic
        second = (elastic["young"], elastic["poisson"]) if impact.wall == "same" else (math.inf, 0.0)
        contact = sphere_on_plane(radius=spheres[0].radius, **elastic, young2=second[0], poisson2=second[1])
    else:
        contact = Geometry(bodies=spheres).contact(0)
    stiffness = rounded(contact.stiffness)
    duration = file.duration
    if duration is None:
        if speed == 0.0:
            allowed = "a number > 0 (s), which speed = 0 requires"
            raise SceneError("duration", problem="is missing", allowed=allowed)
        from dem_bridge.physics.exact import two_body_collision  # which most scenes do not need

        masses = (mass[0], math.inf if plane else mass[1])
        hit = two_body_collision(masses=masses, velocities=(speed, 0.0), stiffness=stiffness, exponent=HERTZ)
        duration = rounded(gap / speed + _CONTACT_TIMES * hit.contact_time)
    adhesion = None
    if impact.adhesion is not None:
        table = forms.AdhesionTable(law=impact.adhesion.law, surface_energy=impact.adhesion.surface_energy)
        adhesion = table.adhesion(conversion.effective_radii(spheres, (False, plane)))
    return Scene(
        name=file.name,
        description=file.description,
        duration=duration,
        mass=mass,
        velocity=(speed,) if plane else (0.5 * speed, -0.5 * speed),
        stiffness=() if plane else (stiffness,),
        gap=() if plane else gap,
        wall_right=Wall(stiffness=stiffness, gap=gap, exponent=HERTZ) if plane else None,
        damping=None if impact.damping is None else impact.damping.damping(),
        adhesion=adhesion,
        geometry=Geometry(bodies=spheres),
        samples=file.sampling.count,
        **file.environment.model_dump(),
    )


def _spheres(impact: Impact) -> tuple[Body, ...]:
    """Return the spheres of an impact: one with a plane, otherwise two."""
    count = 2 if impact.wall is False else 1
    radii = impact.radius if isinstance(impact.radius, list) else [impact.radius]
    if len(radii) != count:
        wall = {False: "false", True: "true", "same": '"same"'}[impact.wall]
        problem = f"has {len(radii)} value{'s' * (len(radii) != 1)}, and wall = {wall}"
        allowed = 'one for each of two spheres, or one and a plane: wall = true (rigid) or wall = "same"'
        raise SceneError("impact.radius", problem=problem, allowed=allowed)
    columns = {
        key: checked_numbers(f"impact.{key}", getattr(impact, key), allowed, count=count, per="sphere", **bounds)
        for key, (allowed, bounds, _) in _NUMBERS.items()
    }
    radius = columns.pop("radius")
    materials = [Material(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]
    return tuple(Body(shape="sphere", radius=r, material=m) for r, m in zip(radius, materials, strict=True))


def _approach(impact: Impact) -> tuple[float, float]:
    """Return the speed of approach (m/s) and the distance (m) at the start."""
    gap = checked_number("impact.gap", impact.gap, "a number >= 0 (m)", at_least=0.0)
    if gap > 0.0:
        return checked_number("impact.speed", impact.speed, "a number >= 0 (m/s)", at_least=0.0), gap
    return checked_number("impact.speed", impact.speed, "a number > 0 (m/s); 0 with a gap", above=0.0), gap
