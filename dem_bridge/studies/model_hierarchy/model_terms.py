"""Pieces of physics that a chain can have or be without, each as a change of its Scene.

What a geometry tells beyond the numbers of a scene (weight, exact stiffness) can be added;
what a scene has can be left out. Both the error budget of the paper and the ladder of models are made of these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import lru_cache, partial
from typing import Any, Literal

import numpy as np

from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.report.texts import Texts
from dem_bridge.scene.file.conversion import rounded
from dem_bridge.scene.geometry import Body, Geometry
from dem_bridge.scene.scene import Damping, Scene, Wall

TEXTS = Texts("model-hierarchy", "dem_bridge.studies")
#: all pieces of physics, in the order in which they are applied, as sentences call them
PIECES = {
    "stiffness-law": "the exact stiffness law",
    "striker-stiffness": "the striker's exact stiffness",
    "force-law": "forces other than Hertz'",
    "gaps": "the gaps",
    "drag": "drag",
    "damping": "dissipation in contacts",
    "wall": "the wall before the first body",
    "base": "the base",
    "gravity": "gravity",
    "precompression": "the precompression",
}
GRAVITY = 9.81
#: holds the chain together before the impact and does nothing else: N
BARELY = 1e-6
#: each takes about 0.6 % of the energy of one collision (c tau / mu with tau = 30 us, mu = 5 g): N s/m, and s
DASHPOT, VISCOELASTIC = 1.0, 1e-8
#: of the weight: a precompression below this is there for the sake of the statics alone
_BESIDE_WEIGHT = 1e-3
#: Hertz' exponent
HERTZ = 2.5
SIDES = ("wall_left", "wall_right")
Change = Callable[[Scene], Scene]


# what geometry tells


def geometry_of(scene: Scene) -> Geometry:
    """ValueError where the scene has none."""
    if scene.geometry is None:
        raise ValueError(f"{scene.name} has no geometry; a scene in physical form has")
    return scene.geometry


def quartz_sphere(scene: Scene) -> float:
    """Return the mass of a sphere of the cylinders' material and radius, kg: the paper's striker, if it were of it."""
    body = geometry_of(scene).bodies[-1]
    return rounded(Body(shape="sphere", radius=body.radius, material=body.material).mass)


def hertz_stiffness(scene: Scene, law: Literal["paper", "exact"] = "exact") -> tuple[float, ...]:
    """Stiffness of each contact of the chain by Hertz' law at the angles that the scene's own law asks for, N/m^1.5.

    ``law``: of crossed cylinders; "paper" has eq. 3.1's axis ratio.
    """
    return _hertz_stiffness(geometry_of(scene), law)


@lru_cache(maxsize=64)
def _hertz_stiffness(geometry: Geometry, law: Literal["paper", "exact"]) -> tuple[float, ...]:
    """Return the same of a geometry; models of one chain share it, and elliptic integrals take their time."""
    return tuple(rounded(geometry.contact(k, law).stiffness) for k in range(len(geometry.bodies) - 1))


def crossed(scene: Scene) -> bool:
    """Return whether the scene is an upright chain of crossed cylinders, like the paper's."""
    geometry = scene.geometry
    return geometry is not None and scene.law is None and any(angle is not None for angle in geometry.angle)


def hertzian(scene: Scene) -> bool:
    """Return whether all forces follow Hertz' power law."""
    return scene.law is None and bool(np.all(scene.contacts.exponent == HERTZ))


# changes


def by_law(scene: Scene, law: Literal["paper", "exact"]) -> Scene:
    """Contacts between cylinders by this law, at the same angles; those of spheres stay."""
    geometry = geometry_of(scene)
    both = zip(geometry.angle, scene.stiffness, hertz_stiffness(scene, law), strict=True)
    stiffness = tuple(old if angle is None else new for angle, old, new in both)
    return replace(
        scene, stiffness=stiffness, geometry=replace(geometry, law=law, angles=geometry.angle, stiffness=None)
    )


def with_exponent(scene: Scene, exponent: tuple[float, ...], anchor: float) -> Scene:
    """Another exponent in each contact of the chain, with the same force at the overlap ``anchor``, m."""
    old = scene.contacts.exponent[: len(exponent)]
    beta = np.array(scene.stiffness) * anchor ** (old - np.array(exponent))
    return replace(scene, exponent=exponent, stiffness=tuple(map(rounded, beta.tolist())))


def angles_soften(scene: Scene, anchor: float) -> Scene:
    """Let n fall from 2.5 at 90 degrees to 2.2 at the smallest angle, linear in the angle, as the paper suspects."""
    angle = np.array([90.0 if a is None else a for a in geometry_of(scene).angle])
    low = float(angle.min())
    return with_exponent(scene, tuple(float(f"{n:.6g}") for n in 2.2 + 0.3 * (angle - low) / (90.0 - low)), anchor)


def weighing(scene: Scene) -> Scene:
    """Stacked on a base under gravity, in equilibrium before the impact."""
    return replace(on_base(scene), gravity=GRAVITY, precompression=max(scene.precompression, BARELY))


def on_base(scene: Scene) -> Scene:
    """Add a rigid base behind the last body, as stiff as the last contact, where there is no wall yet."""
    if scene.wall_right is not None:
        return scene
    last = len(scene.stiffness) - 1
    exponent = float(scene.contacts.exponent[last])
    return _walled(scene, "wall_right", Wall(stiffness=scene.stiffness[last], exponent=exponent))


def _as_it_is(scene: Scene) -> Scene:
    return scene


def _walled(scene: Scene, side: str, wall: Wall | None) -> Scene:
    """Return the scene with that wall or without it.

    Entries per contact follow; those of a new wall are the last contact's.
    """
    links = len(scene.stiffness)
    before = [place for place in SIDES if getattr(scene, place) is not None]
    after = [place for place in SIDES if (wall if place == side else getattr(scene, place)) is not None]
    places = [*range(links), *(links + before.index(place) if place in before else links - 1 for place in after)]

    def fitted(values: Any) -> tuple[Any, ...]:
        return tuple(values[place] for place in places)

    damping = scene.damping
    changes: dict[str, Any] = {side: wall}
    if damping is not None:
        assert isinstance(damping.coefficient, tuple)  # set when the scene was made
        changes["damping"] = replace(damping, coefficient=fitted(damping.coefficient))
    if scene.law is not None:
        changes["law"] = fitted(scene.law)
    return replace(scene, **changes)


def _weightless(scene: Scene) -> Scene:
    """Return the scene without gravity, and without a precompression that only served its statics."""
    kept = scene.precompression if _pressed(scene) else 0.0
    return replace(scene, gravity=0.0, precompression=kept)


def _pressed(scene: Scene) -> bool:
    """Return whether the scene is compressed by more than its weight."""
    return scene.precompression > _BESIDE_WEIGHT * abs(scene.gravity) * sum(scene.mass)


def _stands(scene: Scene) -> str:
    """Return the wall that bears the weight of a chain in equilibrium; '' where none does."""
    side = SIDES[scene.gravity > 0.0]
    return side if scene.gravity != 0.0 and scene.precompression > 0.0 and getattr(scene, side) is not None else ""


def _hertzian(scene: Scene) -> Scene:
    """Hertz' power in all contacts, with the same force at the largest overlap of each (a coarse run finds it)."""
    c = scene.contacts
    if hertzian(scene):
        return scene
    overlap = prescan_scene(scene).peak_overlap
    deepest = float(np.max(overlap, initial=0.0)) or 1e-6  # a scene at rest has no scale
    overlap = np.where(overlap > 0.0, overlap, deepest)
    beta = list(map(rounded, (c.force(overlap, np.arange(len(overlap))) / overlap ** (HERTZ - 1.0)).tolist()))
    links = len(scene.stiffness)
    walls = [side for side in SIDES if getattr(scene, side) is not None]
    changed = {
        side: replace(getattr(scene, side), stiffness=beta[links + nth], exponent=HERTZ)
        for nth, side in enumerate(walls)
    }
    return replace(scene, law=None, exponent=HERTZ, stiffness=tuple(beta[:links]), **changed)


# switches


@dataclass(frozen=True)
class ModelTerm:
    """A piece of physics of one scene: what the scene is with it, and without."""

    id: str
    what: str
    """What is left out, and what takes its place."""
    _: KW_ONLY
    off: Change = _as_it_is
    on: Change = _as_it_is
    """One of the two leaves the scene as it is: it has the piece, or its geometry tells of it."""
    supposed: bool = False
    """Whether its size is ours: nothing is known of it but that it is there."""


def named(ids: Iterable[str]) -> str:
    """Return pieces in words, in their order.

    >>> named({"gravity", "drag", "base"})
    'drag, the base and gravity'
    """
    chosen = set(ids)
    words = [word for id, word in PIECES.items() if id in chosen]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def model_terms_of(scene: Scene, *, add: bool = True, dashpot: float = DASHPOT) -> tuple[ModelTerm, ...]:
    """Every piece of physics that this scene can be with and without, in the order in which they are applied.

    ``add``: also those that the scene has not, but its geometry tells. An upright chain of crossed cylinders stands on
    a base under its weight, has exact stiffnesses, and loses energy in its contacts, where the size of the ``dashpot``
    (N s/m) is supposed. Without: what the scene has and may do without. A switch that changes nothing is not there.
    """
    added = _from_geometry(scene, dashpot) if add and crossed(scene) else ()
    terms = {term.id: term for term in (*terms_of_scene(scene), *added)}
    model_terms = tuple(terms[id] for id in PIECES if id in terms)

    def does(term: ModelTerm) -> bool:
        held = frozenset(other.id for other in model_terms if term.id in needs(scene, model_terms, other))
        with_it, without = (model(scene, model_terms, ids) for ids in (held, held | {term.id}))
        return with_it.content_hash != without.content_hash

    return tuple(filter(does, model_terms))


def needs(scene: Scene, model_terms: Sequence[ModelTerm], term: ModelTerm) -> frozenset[str]:
    """Return the ids of the terms that a term needs: a chain that bears its weight needs what it stands on."""
    if term.id != "gravity":
        return frozenset()
    side = _stands(model(scene, model_terms))
    return frozenset({"base" if side == "wall_right" else "wall"} if side else ())


def model(scene: Scene, model_terms: Sequence[ModelTerm], without: frozenset[str] = frozenset()) -> Scene:
    """Return the scene with all switches on, but for those ``without``."""
    changed = scene
    for term in model_terms:
        changed = (term.off if term.id in without else term.on)(changed)
    parts = [f"no-{term.id}" for term in model_terms if term.id in without]
    return replace(changed, name=".".join([scene.name, *(parts or ["fullest"])])[:100])


def _from_geometry(scene: Scene, dashpot: float) -> Iterator[ModelTerm]:
    """Yield the model terms that follow from the geometry of an upright chain of crossed cylinders."""
    geometry, by_sphere = geometry_of(scene), geometry_of(scene).angle[0] is None
    if hertzian(scene):
        what = "the exact Hertz law between cylinders (eq. 3.1's approximation in its place)"
        exact = geometry.law == "exact"
        switch: dict[str, Any] = (
            {"off": partial(by_law, law="paper")} if exact else {"on": partial(by_law, law="exact")}
        )
        yield ModelTerm("stiffness-law", what, **switch)
    if by_sphere and hertzian(scene):
        stiffness = hertz_stiffness(scene)[0]
        what = f"the striker's exact stiffness, {stiffness:.4g} N/m^1.5 ({scene.stiffness[0]:.4g} in its place)"
        yield ModelTerm("striker-stiffness", what, on=lambda s: replace(s, stiffness=(stiffness, *s.stiffness[1:])))
    if not scene.damped:
        dashpots = Damping(law="dashpot", coefficient=dashpot)
        what = f"dissipation in contacts, a dashpot of {dashpot:g} N s/m"
        yield ModelTerm("damping", what, on=lambda s: replace(s, damping=dashpots), supposed=True)
    if scene.wall_right is None:
        yield ModelTerm("base", "the base behind the last body (a free end in its place)", on=on_base)
    # a chain with gaps does not stand in touch
    if scene.gravity == 0.0 and not np.any(scene.contacts.gap > 0.0):
        # a striker that is dropped does not rest on the chain: its wave arrives 0.06 % later (claim gravity-neglected)
        what = "gravity: the static compression by the chain's own weight, with the striker at rest on it"
        yield ModelTerm("gravity", what, on=weighing)


def terms_of_scene(scene: Scene) -> Iterator[ModelTerm]:
    """Yield the model terms that the scene has and can be without.

    Its drive is not among them, because without it there may be no wave.
    """

    def unpressed(scene: Scene) -> Scene:
        return replace(scene, precompression=BARELY if _stands(scene) else 0.0) if _pressed(scene) else scene

    kind = scene.damping.law if scene.damping is not None else ""
    yield ModelTerm("force-law", "forces that are no Hertz power (n = 5/2 in its place)", off=_hertzian)
    yield ModelTerm("gaps", "gaps and overlaps at the start", off=lambda s: replace(s, gap=0.0))
    yield ModelTerm("drag", f"drag of {scene.drag:g} 1/s", off=lambda s: replace(s, drag=0.0))
    yield ModelTerm("damping", f"dissipation in contacts ({kind})", off=lambda s: replace(s, damping=None))
    yield ModelTerm("wall", "the wall before the first body", off=partial(_walled, side="wall_left", wall=None))
    yield ModelTerm("base", "the wall behind the last body", off=partial(_walled, side="wall_right", wall=None))
    yield ModelTerm("gravity", f"gravity of {scene.gravity:g} m/s^2", off=_weightless)
    yield ModelTerm("precompression", f"precompression of {scene.precompression:g} N", off=unpressed)
