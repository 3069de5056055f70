"""Scenes built from a row of bodies: bodies given one by one, or a repeated unit cell with modifications.

The order of the modifications is: the cells, with those of the step from cell ``step.from`` on; the taper, cell by
cell; the decoration, whose bodies are not tapered; the disorder of all radii, then of the angles. A striker in front of
the row is not modified.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from itertools import accumulate, pairwise, repeat
from operator import mul
from typing import Any, Literal

from dem_bridge.errors import SceneError, UsageError
from dem_bridge.foundation.numbers import LARGEST, MOST_BODIES, SMALLEST, checked_numbers
from dem_bridge.scene.file import conversion, forms
from dem_bridge.scene.file.conversion import (
    HERTZ,
    Numbers,
    check_alone,
    checked_velocity,
    normal_numbers,
    rounded,
    scattered,
    sphere_of,
    start_velocity,
)
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


Materials = Mapping[str, Material]
Bodies = tuple[Body, ...]


def from_pattern(file: forms.PatternScene) -> Scene:
    """Return the Scene of the striker and the bodies of the pattern."""
    pattern, table = file.chain.pattern, file.chain.striker
    materials = dict(materials_of(file.materials))
    row = _row(pattern, materials)
    per = "contact of the chain"
    gap = checked_numbers("pattern.gap", pattern.gap, "a finite number (m)", count=len(row) - 1, per=per)
    first = () if table is None else (_striker(table, row[0], materials),)
    scene = chain(
        bodies=row,
        striker=first[0] if first else None,
        velocity=start_velocity(file.chain, len(row)),
        angles=_angles(pattern, first, row),
        law=pattern.law,
        gap=gap if table is None else (table.gap, *gap),
        **conversion.in_common(file, (*first, *row)) | dict(_flat_walls(file, (*first, *row), materials)),
    )
    if table is None:
        return scene
    mass = scene.mass[0] if table.mass is None else table.mass
    stiffness = scene.stiffness[0] if table.stiffness is None else table.stiffness
    return replace(scene, mass=(mass, *scene.mass[1:]), stiffness=(stiffness, *scene.stiffness[1:]))


# bodies


def materials_of(tables: Mapping[str, forms.MaterialTable]) -> Iterator[tuple[str, Material]]:
    """Yield the materials of a file by name."""
    for name, table in tables.items():
        try:
            yield name, Material(**{**table.model_dump(), "name": table.name or name})
        except SceneError as error:
            raise error.at("scene", f"materials.{name}.{error.key.removeprefix('material.')}") from None


def material_of(name: str | None, materials: Materials, where: str, also: Sequence[str] = ()) -> Material:
    """Return the material of this name; None means the only one. ``also`` are further names that a message lists."""
    names = ", ".join((*materials, *also)) or "a name"
    if name is None:
        if len(materials) != 1:
            raise SceneError(where, problem="is missing", allowed=f"one of {names}")
        return next(iter(materials.values()))
    if name not in materials:
        raise SceneError(where, value=name, allowed=f"{names}, the names in [materials.NAME]")
    return materials[name]


def _body(table: forms.BodyTable, materials: Materials, where: str) -> Body:
    """Return the body of a table."""
    material = material_of(table.material, materials, f"{where}.material")
    try:
        return Body(shape=table.shape, radius=table.radius, height=table.height, material=material)
    except SceneError as error:
        raise error.at("scene", f"{where}.{error.key.removeprefix('body.')}") from None


def _cell(tables: Sequence[forms.BodyTable], materials: Materials, where: str) -> Bodies:
    """Return the bodies of a unit cell."""
    return tuple(_body(table, materials, f"{where}[{nth}]") for nth, table in enumerate(tables))


def _row(pattern: forms.Pattern, materials: Materials) -> Bodies:
    """Return all bodies behind the striker, modified in the order that the module states."""
    _check_size(pattern)
    cells = [_cell(pattern.cell, materials, "pattern.cell")] * pattern.repeat
    if pattern.step is not None:
        first = pattern.step.first
        if first >= pattern.repeat:
            allowed = f"a cell from 0 to {pattern.repeat - 1}, the last of repeat = {pattern.repeat}"
            raise SceneError("pattern.step.from", value=first, allowed=allowed)
        cells[first:] = [_cell(pattern.step.cell, materials, "pattern.step.cell")] * (pattern.repeat - first)
    row = tuple(body for cell in _tapered(cells, pattern.taper) for body in cell)
    if pattern.decorate is not None:
        row = _decorated(row, pattern.decorate, _body(pattern.decorate, materials, "pattern.decorate"))
    return row if pattern.disorder is None else _of_random_size(row, pattern.disorder)


def _check_size(pattern: forms.Pattern) -> None:
    """Raise SceneError if the pattern has too many bodies; called before any of them exists."""
    first = pattern.repeat if pattern.step is None else min(pattern.step.first, pattern.repeat)
    count = first * len(pattern.cell)
    count += 0 if pattern.step is None else (pattern.repeat - first) * len(pattern.step.cell)
    count += 0 if pattern.decorate is None else (count - 1) // pattern.decorate.every
    if count > MOST_BODIES:
        problem = f"= {pattern.repeat} gives the chain {count} bodies"
        raise SceneError("pattern.repeat", problem=problem, allowed=f"at most {MOST_BODIES} bodies")


def _tapered(cells: Sequence[Bodies], taper: float) -> Iterator[Bodies]:
    """Yield the cells, all sizes of each multiplied by ``taper`` relative to the previous cell."""
    for nth, share in enumerate(accumulate(repeat(taper, len(cells) - 1), mul, initial=1.0)):
        if not all(SMALLEST < body.radius * share < LARGEST for body in cells[nth]):
            problem = f"= {taper!r} gives cell {nth} bodies of a radius of {cells[nth][0].radius * share:g} m"
            raise SceneError("pattern.taper", problem=problem, allowed=f"{SMALLEST:g} to {LARGEST:g} m")
        yield tuple(
            replace(body, radius=body.radius * share, height=None if body.height is None else body.height * share)
            for body in cells[nth]
        )


def _decorated(row: Bodies, table: forms.Decorate, between: Body) -> Bodies:
    """Return the row with ``between`` inserted behind each ``every``-th body except the last."""
    if table.every >= len(row):
        allowed = f"less than {len(row)}, the number of bodies, since a decoration is placed between two of them"
        raise SceneError("pattern.decorate.every", value=table.every, allowed=allowed)
    out: list[Body] = []
    for nth, body in enumerate(row, start=1):
        out += [body, between] if nth % table.every == 0 and nth < len(row) else [body]
    return tuple(out)


def _of_random_size(row: Bodies, table: forms.Disorder) -> Bodies:
    """Return the row with random radii, rounded to 9 digits.

    The radii use a random sequence of their own, so that no angle depends on them.
    """
    if not table.model_fields_set & {"radius", "angle"}:
        allowed = "radius (relative), angle (degrees), or both"
        raise SceneError("pattern.disorder", problem="has neither radius nor angle", allowed=allowed)
    if table.radius == 0.0:
        return row
    out = []
    for nth, (body, number) in enumerate(zip(row, normal_numbers(f"radius {table.seed}"), strict=False)):
        radius = float(f"{body.radius * (1.0 + table.radius * number):.9g}")
        if radius <= 0.0:
            problem = f"= {table.radius!r} and the seed {table.seed} give body {nth} a radius of {radius:g} m"
            raise SceneError("pattern.disorder.radius", problem=problem, allowed="a value that keeps all radii above 0")
        out.append(replace(body, radius=radius))
    return tuple(out)


# angles, striker, walls


def _angles(pattern: forms.Pattern, first: Bodies, row: Bodies) -> tuple[float, ...] | None:
    """Return an angle for each contact of two cylinders; a striker's contact has the angle of the chain's first one."""
    of_chain, with_striker = len(crossings(row)), len(crossings((*first, *row[:1])))
    present = [key for key in ("angle", "angles") if getattr(pattern, key) is not None]
    scatter = 0.0 if pattern.disorder is None else pattern.disorder.angle
    if len(present) == 2:
        raise SceneError("pattern.angles", problem="cannot be combined with angle", allowed="one of the two")
    if of_chain + with_striker == 0 and present:
        raise SceneError(f"pattern.{present[0]}", problem="is given", allowed="no angle, since no two cylinders meet")
    if of_chain == 0 and scatter > 0.0:
        raise SceneError("pattern.disorder.angle", value=scatter, allowed="0, since no two cylinders of the chain meet")
    if of_chain + with_striker == 0:
        return None
    entries = pattern.angles if pattern.angle is None else pattern.angle
    if entries is None or (pattern.angle is None and of_chain == 0):
        allowed = f"{ANGLE}, between the axes of two cylinders that meet; or a list angles for {of_chain} contacts"
        raise SceneError("pattern.angle", problem="is missing", allowed=allowed)
    per = "contact of two cylinders of the chain"
    angles = checked_numbers("pattern.angles", entries, ANGLE, count=of_chain, per=per)
    of_striker = (pattern.angle or angles[0],) * with_striker
    if pattern.disorder is not None and scatter > 0.0:
        angles = scattered(angles, scatter=scatter, seed=pattern.disorder.seed)
    return (*of_striker, *angles)


def _striker(table: forms.PatternStriker, first: Body, materials: Materials) -> Body:
    """Return the striker's body."""
    if table.exponent not in (None, HERTZ):
        allowed = f"{HERTZ}, since the contacts of a pattern are Hertz contacts"
        raise SceneError("striker.exponent", value=table.exponent, allowed=allowed)
    if table.like is None:
        material = first.material
        if table.material is not None:
            material = material_of(table.material, materials, "striker.material")
        return sphere_of(table, material)
    check_alone(table)
    return first


def _flat_walls(file: forms.PatternScene, bodies: Bodies, materials: Materials) -> Iterator[tuple[str, Wall]]:
    """Yield the walls that are defined by their material."""
    for side, body in (("wall_left", bodies[0]), ("wall_right", bodies[-1])):
        table: forms.PatternWall | None = getattr(file.chain, side)
        if table is None:
            continue
        present = table.model_fields_set & {"stiffness", "material"}
        if len(present) != 1:
            problem = "has neither stiffness nor material" if not present else "has both stiffness and material"
            raise SceneError(side, problem=problem, allowed="one of the two")
        if table.material is None:
            continue
        if table.exponent not in (None, HERTZ):
            raise SceneError(
                f"{side}.exponent", value=table.exponent, allowed=f"{HERTZ}, since a flat wall has a Hertz contact"
            )
        yield side, flat(material_of(table.material, materials, f"{side}.material"), body, side, table.gap)
