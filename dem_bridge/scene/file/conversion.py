"""Convert scene files in raw and in physical form to Scenes, and what all forms have in common.

In physical form numbers are computed from bodies: masses are density times volume, stiffnesses those of Hertz contacts.
Both are rounded to 12 significant digits as they enter the Scene, so that decks do not depend on the last bit of a
library.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from itertools import accumulate, pairwise, repeat
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import LARGEST, SMALLEST, checked_number, checked_numbers
from dem_bridge.scene.file import forms
from dem_bridge.scene.file.forms import CylinderScene, PatternScene, RawScene, SphereScene, WallTable
from dem_bridge.scene.geometry import ANGLE, Body, Geometry, Material
from dem_bridge.scene.scene import Scene, Wall


def effective_radii(bodies: Sequence[Body], walls: tuple[bool, bool]) -> list[float] | None:
    """Return the effective radii of all contacts, m, those of the left and the right wall last; None if not spheres."""
    if not bodies or any(body.shape != "sphere" for body in bodies):
        return None
    radii = [body.radius for body in bodies]
    links = [1.0 / (1.0 / first + 1.0 / second) for first, second in pairwise(radii)]
    return links + [radius for radius, wall in zip((radii[0], radii[-1]), walls, strict=True) if wall]


def in_common(
    file: RawScene | CylinderScene | SphereScene | PatternScene, bodies: Sequence[Body] = ()
) -> dict[str, Any]:
    """Return the arguments of a Scene that all forms share; ``bodies`` if they are known."""
    chain, damping = file.chain, file.chain.damping
    radii = effective_radii(bodies, (chain.wall_left is not None, chain.wall_right is not None))

    def wall(table: WallTable | None) -> Wall | None:
        return None if table is None else Wall(stiffness=table.stiffness, gap=table.gap, exponent=table.exponent)

    return {
        "name": file.name,
        "description": file.description,
        "duration": file.duration,
        "wall_left": wall(chain.wall_left),
        "wall_right": wall(chain.wall_right),
        "precompression": 0.0 if chain.precompression is None else chain.precompression.force,
        "damping": None if damping is None else damping.damping(),
        "adhesion": None if chain.adhesion is None else chain.adhesion.adhesion(radii),
        "drive": None if chain.drive is None else chain.drive.drive(file.duration),
        "samples": file.sampling.count,
        **file.environment.model_dump(),
    }


def from_raw(file: RawScene) -> Scene:
    """Return the Scene of a file in raw form."""
    shared = in_common(file)
    return Scene(**file.chain.model_dump(exclude=set(shared)), **shared)


#: exponent n of a Hertz contact
HERTZ = 2.5
#: the three ways to specify the angles of cylinders, by their keys
WAYS = (("angle",), ("angles",), ("first_angle", "last_angle", "grading"))
Numbers = float | Sequence[float] | NDArray[np.float64]
_PER = "contact between the bodies of the chain"


def rounded(value: float) -> float:
    """Return ``value`` rounded to 12 significant digits.

    Examples
    --------
    >>> rounded(2.0 / 3.0)
    0.666666666667
    """
    return float(f"{value:.12g}")


def normal_numbers(seed: int | str) -> Iterator[float]:
    """Yield independent normal numbers of standard deviation 1, the same with every release of every library.

    They are uniform numbers of :class:`random.Random`, mapped by the inverse of the normal distribution.
    """
    from statistics import NormalDist  # which few scenes need

    uniform, normal = random.Random(seed), NormalDist()
    while True:
        yield normal.inv_cdf(uniform.random())


def scattered(angles: Sequence[float], *, scatter: float, seed: int) -> tuple[float, ...]:
    """Return the angles (degrees) with a normal error of standard deviation ``scatter`` (degrees) added to each.

    An angle outside 0 to 90 degrees is replaced by the equivalent angle within. The same seed always gives the same
    angles, to 9 digits: see :func:`normal_numbers`.

    Examples
    --------
    >>> scattered((2.0, 45.0, 90.0), scatter=2.0, seed=1)
    (0.211990902, 47.0509779, 88.5630056)
    """

    def perturbed(angle: float, number: float) -> float:
        angle_sum = (angle + scatter * number) % 180.0
        return float(f"{min(angle_sum, 180.0 - angle_sum):.9g}")

    return tuple(map(perturbed, angles, normal_numbers(seed)))


def from_cylinders(file: forms.CylinderScene) -> Scene:
    """Return the Scene of cylinders across the chain; ``mass_gradient`` changes only their heights and masses."""
    cylinders, contacts, material = file.chain.cylinders, file.chain.contacts, _material(file)
    growth = [1.0 + cylinders.mass_gradient * i for i in range(1, cylinders.count + 1)]
    if growth[-1] <= 0.0:
        raise SceneError(
            "cylinders.mass_gradient",
            value=cylinders.mass_gradient,
            allowed=f"a number > {-1.0 / cylinders.count:g}, since the last mass is (1 + count mass_gradient) m",
        )
    angles, stiffness = _crossed(contacts, cylinders.count - 1, radius=cylinders.radius, material=material)
    # equal cylinders are one object
    body = cache(lambda height: Body(shape="cylinder", radius=cylinders.radius, height=height, material=material))
    bodies = tuple([body(cylinders.height * factor) for factor in growth])
    crossing: dict[str, Any] = {"law": contacts.law}
    crossing |= {"stiffness": stiffness} if angles is None else {"angles": angles}
    return _scene(file, contacts, bodies, stiffness, 2.0 * cylinders.radius, crossing)


def from_spheres(file: forms.SphereScene) -> Scene:
    """Return the Scene of spheres, each radius ``ratio`` times the previous one; it has a spacing if all are equal."""
    spheres, material = file.chain.spheres, _material(file)
    radii = list(accumulate(repeat(spheres.ratio, spheres.count - 1), mul, initial=spheres.radius))
    if not SMALLEST < radii[-1] < LARGEST:
        problem = f"= {spheres.ratio!r} gives the last sphere a radius of {radii[-1]:g} m"
        raise SceneError("spheres.ratio", problem=problem, allowed=f"{SMALLEST:g} to {LARGEST:g} m")
    bodies = tuple(Body(shape="sphere", radius=radius, material=material) for radius in radii)
    spacing = 2.0 * spheres.radius if spheres.ratio == 1.0 else None
    return _scene(file, file.chain.contacts, bodies, tuple(map(_touching, bodies, bodies[1:])), spacing, {})


def _touching(first: Body, second: Body) -> float:
    """Return the stiffness of two bodies, not both cylinders, by Hertz's law, N/m^1.5, not rounded."""
    return Geometry(bodies=(first, second)).contact(0).stiffness


def _crossed(
    contacts: forms.CylinderContacts, links: int, *, radius: float, material: Material
) -> tuple[tuple[float, ...] | None, tuple[float, ...]]:
    """Return angles (None if the stiffness determines them) and stiffnesses of equal cylinders, ``(links,)`` both."""
    from dem_bridge.physics.hertz import angle_of_stiffness, crossed_cylinders

    law, elastic = contacts.law, material.elastic

    @cache
    def stiffness_at(angle: float) -> float:
        try:
            return crossed_cylinders(angle=angle, radius=radius, law=law, **elastic).stiffness
        except ValueError as error:
            raise SceneError("contacts", problem=f"cross at {angle:g} degrees: {error}", allowed=ANGLE) from None

    _check_way(contacts)
    first, last = contacts.first_angle, contacts.last_angle
    if first is None or last is None:
        entries = contacts.angles if contacts.angle is None else contacts.angle
        angles = checked_numbers("contacts.angles", entries or (), ANGLE, count=links, per=_PER)
    else:
        if links == 1 and first != last:
            allowed = f"first_angle = {first!r}, since two cylinders have one contact"
            raise SceneError("contacts.last_angle", value=last, allowed=allowed)
        stiffness = tuple(np.linspace(stiffness_at(first), stiffness_at(last), links).tolist())
        if contacts.scatter is None:
            return None, stiffness
        # near 90 degrees the inverse is ill-conditioned, so the ends are taken from the file
        between = (angle_of_stiffness(beta, radius=radius, law=law, **elastic) for beta in stiffness[1:-1])
        angles = (first, *between, last)[:links]
    if contacts.scatter is not None:
        if contacts.seed is None:
            allowed = "a whole number >= 0, which scatter requires so that the chain is reproducible"
            raise SceneError("contacts.seed", problem="is missing", allowed=allowed)
        angles = scattered(angles, scatter=contacts.scatter, seed=contacts.seed)
    return angles, tuple(map(stiffness_at, angles))


def _check_way(contacts: forms.CylinderContacts) -> None:
    """Raise SceneError unless the angles are specified completely in one of the three ways."""
    allowed = "angle, or angles, or first_angle with last_angle and grading"
    present = [key for way in WAYS for key in way if getattr(contacts, key) is not None]
    if not present:
        raise SceneError("contacts", problem="has no angles", allowed=allowed)
    way = next(way for way in WAYS if present[0] in way)
    for key in present:
        if key not in way:
            raise SceneError(f"contacts.{key}", problem=f"cannot be combined with {present[0]}", allowed=allowed)
    for key in way:
        if key not in present:
            raise SceneError(
                f"contacts.{key}", problem="is missing, but required", allowed=f"with {present[0]}: {', '.join(way)}"
            )


def _in_power(stiffness: float, n: float, matching_overlap: float | None) -> float:
    """Return the stiffness of a contact with n that has the Hertz force at ``matching_overlap``, N/m^(n-1)."""
    if n == HERTZ:
        return rounded(stiffness)
    if matching_overlap is None:
        allowed = f"a number > 0 (m), the overlap at which a contact with n = {n!r} has the Hertz force"
        raise SceneError("contacts.matching_overlap", problem="is missing", allowed=allowed)
    try:
        return rounded(stiffness * matching_overlap ** (HERTZ - n))
    except OverflowError:
        problem = f"= {matching_overlap!r} gives a contact with n = {n!r} a stiffness that overflows"
        raise SceneError("contacts.matching_overlap", problem=problem, allowed=f"up to {LARGEST:g} N/m^(n-1)") from None


def _scene(
    file: forms.CylinderScene | forms.SphereScene,
    contacts: forms.SphereContacts,
    bodies: tuple[Body, ...],
    stiffness: tuple[float, ...],
    spacing: float | None,
    crossing: Mapping[str, Any],
) -> Scene:
    """Return the Scene of a chain, with its striker in front if it has one.

    ``stiffness`` is that of each contact by Hertz's law, N/m^1.5, not rounded; ``crossing`` has the law of cylinders,
    and their angles or the stiffness from which they follow.
    """
    links, n_above_1 = len(stiffness), "n > 1, one number or one per contact (2.5 for Hertz)"
    exponent = checked_numbers("contacts.exponent", contacts.exponent, n_above_1, count=links, per=_PER, above=1.0)
    gap = checked_numbers("contacts.gap", contacts.gap, "a finite number (m)", count=links, per=_PER)
    mass = tuple([rounded(body.mass) for body in bodies])
    in_power = partial(_in_power, matching_overlap=contacts.matching_overlap)
    columns = {"mass": mass, "stiffness": tuple(map(in_power, stiffness, exponent)), "exponent": exponent, "gap": gap}
    velocity, striker = start_velocity(file.chain, len(bodies)), file.chain.striker
    if striker is not None:
        body = bodies[0] if striker.like is not None else sphere_of(striker, bodies[0].material)
        front = {key: values[0] for key, values in columns.items()} | {"gap": striker.gap}
        if striker.like is not None:
            check_alone(striker)
        else:
            front["exponent"] = HERTZ if striker.exponent is None else striker.exponent
            front["mass"] = rounded(body.mass) if striker.mass is None else striker.mass
            front["stiffness"] = striker.stiffness or in_power(_touching(body, bodies[0]), front["exponent"])
        columns = {key: (front[key], *values) for key, values in columns.items()}
        # a contact with a sphere has no angle; a first body like the chain's has the angle of the next contact
        for key in {"angles", "stiffness"} & set(crossing):
            crossing = {**crossing, key: (None if body.shape == "sphere" else crossing[key][0], *crossing[key])}
        bodies = (body, *bodies)
    numbers: dict[str, Any] = {**columns, "velocity": velocity, "spacing": spacing}
    return Scene(**numbers, geometry=Geometry(bodies=bodies, **crossing), **in_common(file, bodies))


def checked_velocity(velocity: Numbers, count: int, per: str) -> tuple[float, ...]:
    """Return the start velocity of ``count`` bodies, m/s; a number is that of the first one."""
    allowed = "a finite number (m/s)"
    if isinstance(velocity, int | float | np.number):
        return (checked_number("velocity", velocity, allowed), *[0.0] * (count - 1))
    return checked_numbers("velocity", velocity, allowed, count=count, per=per)


def start_velocity(chain: forms.PhysicalChain, count: int) -> tuple[float, ...]:
    """Return the start velocities, m/s: the striker's and ``count`` zeros, or ``chain.velocity`` without a striker."""
    if chain.striker is None:
        return checked_velocity(chain.velocity or 0.0, count, "body of the chain")
    if chain.velocity is not None:
        allowed = "striker.velocity alone, since all bodies behind a striker start at rest"
        raise SceneError("velocity", problem="cannot be combined with a striker", allowed=allowed)
    return (chain.striker.velocity, *[0.0] * count)


def check_alone(striker: forms.Striker) -> None:
    """Raise SceneError if a striker that is like another body has further properties."""
    for key in ("radius", "mass", "stiffness", "exponent", "material"):
        if getattr(striker, key, None) is not None:
            allowed = f"velocity and gap, since everything else is that of the {striker.like}"
            raise SceneError(f"striker.{key}", problem="cannot be combined with like", allowed=allowed)


def sphere_of(striker: forms.Striker, material: Material) -> Body:
    """Return the striker's body, a sphere of its radius or, without a radius, of its mass."""
    if striker.radius is None:
        for key in ("mass", "stiffness"):
            if getattr(striker, key) is None:
                allowed = "mass and stiffness, or the radius of a sphere, or like = 'first-body'"
                raise SceneError(f"striker.{key}", problem="is missing", allowed=allowed)
    radius = striker.radius
    if radius is None:
        assert striker.mass is not None
        radius = math.cbrt(0.75 * striker.mass / (math.pi * material.density))
    return Body(shape="sphere", radius=radius, material=material)


def _material(file: forms.PhysicalScene) -> Material:
    """Return the material of the file."""
    return Material(**file.material.model_dump())
