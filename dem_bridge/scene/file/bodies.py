"""A Scene built from a row of bodies, whose masses and Hertz stiffnesses follow from shapes and materials."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from itertools import pairwise
from typing import Any, Literal

from dem_bridge.errors import SceneError, UsageError
from dem_bridge.foundation.numbers import checked_numbers
from dem_bridge.scene.file.physical import HERTZ, Numbers, checked_velocity, rounded
from dem_bridge.scene.geometry import ANGLE, Body, Geometry, Material, crossings
from dem_bridge.scene.scene import Scene, Wall

#: fields of a Scene that are computed from the bodies
_FOLLOW = ("mass", "stiffness", "exponent", "spacing", "geometry", "law", "content_hash")


def chain(
    *,
    name: str,
    duration: float,
    bodies: Iterable[Body],
    striker: Body | None = None,
    velocity: Numbers = 0.0,
    angles: Numbers | None = None,
    law: Literal["paper", "exact"] = "exact",
    gap: Numbers = 0.0,
    wall_left: Wall | Material | None = None,
    wall_right: Wall | Material | None = None,
    **more: Any,
) -> Scene:
    """Return the Scene of a row of bodies, with Hertz contacts computed from the materials of both bodies.

    Masses are density times volume, and stiffnesses are those of :meth:`Geometry.contact`, both rounded to 12 digits.
    The geometry contains the bodies; the spacing is 2 r if all bodies except the striker have the same radius r.

    Parameters
    ----------
    name : str
        Name of the scene.
    duration : float
        Duration, s.
    bodies : iterable of Body
        Bodies of the row, struck end first.
    striker : Body, optional
        A further body in front of them.
    velocity : float or sequence of float
        Start velocity of the very first body, or one for each body, m/s.
    angles : float or sequence of float, optional
        Angles between the axes where two cylinders meet, degrees: one for all, or one for each such contact in order.
    law : {"exact", "paper"}
        Law of crossed cylinders; "paper": Chaunsali, Kim & Yang 2018.
    gap : float or sequence of float
        One gap for all contacts, or one for each, m.
    wall_left, wall_right : Wall or Material, optional
        Walls. A Material is a flat half-space, with which a sphere has a Hertz contact.
    **more
        Further fields of :class:`Scene`: precompression, damping, gravity, drag, samples, description.

    Raises
    ------
    SceneError
        If an entry is invalid.
    UsageError
        If a keyword is unknown.

    Examples
    --------
    >>> steel = Material(youngs_modulus=193e9, poissons_ratio=0.3, density=8000.0, name="steel")
    >>> ptfe = Material(youngs_modulus=1.46e9, poissons_ratio=0.46, density=2200.0, name="PTFE")
    >>> heavy, light = (Body(shape="sphere", radius=4.76e-3, material=material) for material in (steel, ptfe))
    >>> dimer = chain(name="dimer", duration=1e-3, striker=heavy, velocity=0.5, bodies=[heavy, light] * 10)
    >>> dimer.n_body, [f"{beta:.3g}" for beta in dimer.stiffness[:3]], dimer.velocity[:2]
    (21, ['6.9e+09', '1.19e+08', '1.19e+08'], (0.5, 0.0))
    """
    settings = {field.name for field in fields(Scene) if field.init} - set(_FOLLOW)
    if unknown := [key for key in more if key not in settings]:
        why = "follows from the bodies" if unknown[0] in _FOLLOW else "is unknown"
        allowed = ", ".join(sorted(settings | {"bodies", "striker", "angles", "law"}))
        raise UsageError(f"setting {unknown[0]!r} {why}; allowed: {allowed}")
    row, all_bodies = _checked_bodies(bodies, striker)
    links = len(all_bodies) - 1
    try:
        geometry = Geometry(bodies=all_bodies, law=law, angles=_checked_angles(all_bodies, angles))
    except SceneError as error:
        raise error.at(error.where, error.key.removeprefix("geometry.")) from None
    radii = {body.radius for body in row}
    return Scene(
        name=name,
        duration=duration,
        mass=tuple(rounded(body.mass) for body in all_bodies),
        stiffness=stiffnesses(geometry),
        exponent=HERTZ,
        velocity=checked_velocity(velocity, len(all_bodies), "body"),
        gap=checked_numbers("gap", gap, "a finite number (m)", count=links, per="contact"),
        spacing=2.0 * row[0].radius if len(radii) == 1 else None,
        wall_left=flat(wall_left, all_bodies[0], "wall_left") if isinstance(wall_left, Material) else wall_left,
        wall_right=flat(wall_right, all_bodies[-1], "wall_right") if isinstance(wall_right, Material) else wall_right,
        geometry=geometry,
        **more,
    )


def stiffnesses(geometry: Geometry) -> tuple[float, ...]:
    """Return the stiffness of every contact by the geometry's law, N/m^1.5, rounded to 12 digits."""
    computed: dict[tuple[object, ...], float] = {}  # each distinct pair once, because unit cells repeat
    keys = [(*pair, angle) for pair, angle in zip(pairwise(geometry.bodies), geometry.angle, strict=True)]
    for k, key in enumerate(keys):
        if key not in computed:
            computed[key] = rounded(geometry.contact(k, geometry.law).stiffness)
    return tuple(computed[key] for key in keys)


def flat(material: Material, body: Body, side: str, gap: float = 0.0) -> Wall:
    """Return the wall that a flat half-space of ``material`` is for a sphere (Johnson 1985, section 4.2); ``gap`` in m.

    Examples
    --------
    >>> glass = Material(youngs_modulus=70e9, poissons_ratio=0.2, density=2500.0)
    >>> f"{flat(glass, Body(shape='sphere', radius=5e-3, material=glass), 'wall_right').stiffness:.4g}"
    '3.437e+09'
    """
    from dem_bridge.physics.hertz import sphere_on_plane

    if body.shape != "sphere":
        allowed = "a sphere next to a wall of a material, since a cylinder has no point contact with it; or a stiffness"
        raise SceneError(side, problem=f"is a material, but the body next to it is a {body.shape}", allowed=allowed)
    second = {"young2": material.youngs_modulus, "poisson2": material.poissons_ratio}
    stiffness = sphere_on_plane(radius=body.radius, **body.material.elastic, **second).stiffness
    return Wall(stiffness=rounded(stiffness), gap=gap, exponent=HERTZ)


def _checked_bodies(bodies: Iterable[Body], striker: Body | None) -> tuple[tuple[Body, ...], tuple[Body, ...]]:
    """Return the row without the striker, and all bodies."""
    # an array without dimensions has an iterator that raises an error
    row = tuple(bodies) if isinstance(bodies, Iterable) and getattr(bodies, "ndim", None) != 0 else ()
    if not row or not all(isinstance(body, Body) for body in row):
        raise SceneError("bodies", problem="is not a list of bodies", allowed="one Body or more, struck end first")
    if not isinstance(striker, Body | None):
        raise SceneError("striker", value=striker, allowed="a Body or None")
    return row, row if striker is None else (striker, *row)


def _checked_angles(bodies: tuple[Body, ...], angles: Numbers | None) -> tuple[float | None, ...] | None:
    """Return an entry for each contact, None for a contact with a sphere; or None if no two cylinders meet."""
    where = crossings(bodies)
    if not where:
        if angles is not None:
            raise SceneError("angles", value=angles, allowed="None, since no two cylinders meet")
        return None
    if angles is None:
        allowed = f"{ANGLE}, or a list of {len(where)}, one per contact of two cylinders"
        raise SceneError("angles", problem=f"are missing; bodies {where[0]} and {where[0] + 1} cross", allowed=allowed)
    checked = checked_numbers("angles", angles, ANGLE, count=len(where), per="contact of two cylinders", above=0.0)
    entries: list[float | None] = [None] * (len(bodies) - 1)
    for k, angle in zip(where, checked, strict=True):
        entries[k] = angle
    return tuple(entries)
