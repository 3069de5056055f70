"""Faults of what a scene has beyond contacts: masses and stiffnesses, walls, gaps, gravity, loads, damping."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import accumulate
from typing import Any

import numpy as np

from dem_bridge.judging.conformance.contact_faults import bodies, laws
from dem_bridge.judging.conformance.faults import (
    Candidate,
    Change,
    Fault,
    changed,
    entry,
    family,
    placed_family,
    readings,
)
from dem_bridge.judging.conformance.scenes import Probe
from dem_bridge.physics.damped_impact import (
    alpha_of_restitution,
    alpha_of_tsuji,
    alpha_of_tsuji_without_sqrt2,
    restitution_of_alpha,
)
from dem_bridge.scene.damping import BY_RESTITUTION
from dem_bridge.scene.scene import Damping, Scene, Wall

#: name of the damping law that several codes have copied from LAMMPS
TSUJI_OF_LAMMPS = "LAMMPS tsuji without sqrt 2"
#: length in which the places of walls are fitted, m: the overlaps of the scenes are some 10 um
_PLACE_M = 1e-5
_SIDES = (("wall_left", "left", 0), ("wall_right", "right", -1))

Floats = tuple[float, ...]


def candidates(probe: Probe, *, first: bool) -> Iterator[Candidate]:
    """Yield the faults that a scene can show, those of its own question first.

    ``first``: whether units, signs and the like may be wrong, because no simpler scene is right.
    """
    scene = probe.scene
    own: dict[str, Callable[[Scene], Iterator[Candidate]]] = {
        "mixing": _mixing, "walls": _walls, "gaps": _gaps, "gravity": _gravity, "precompression": _precompression,
        "several-moving": _several_moving, "restitution": _restitution,
    }  # fmt: skip
    present = probe.features | ({"mixing"} if "polydisperse" in probe.features else set())
    for name, faults in own.items():
        damped = name == "restitution" and scene.damping is not None
        if name == probe.question or (probe.question == "unseen" and (name in present or damped)):
            yield from faults(scene)
    if first:
        yield from readings()
    yield from laws(probe)
    yield from bodies(probe)


def _mixing(scene: Scene) -> Iterator[Candidate]:
    """Yield faults of which body and contact has which number."""
    del scene
    stiffness: dict[str, Callable[[Floats], Floats]] = {
        "Each contact has the stiffness of the one before it": lambda k: (k[0], *k[:-1]),
        "Each contact has the stiffness of the next one": lambda k: (*k[1:], k[-1]),
        "The stiffnesses are in reverse order": lambda k: k[::-1],
        "All contacts have the stiffness of the first": lambda k: (k[0],) * len(k),
        "All contacts have the stiffness of the last": lambda k: (k[-1],) * len(k),
        "All contacts have the mean stiffness": lambda k: (float(np.mean(k)),) * len(k),
    }
    mass: dict[str, Callable[[Floats], Floats]] = {
        "The masses are in reverse order": lambda m: m[::-1],
        "All bodies have the mass of the first": lambda m: (m[0],) * len(m),
        "All bodies have the mass of the last": lambda m: (m[-1],) * len(m),
        "All bodies have the mean mass": lambda m: (float(np.mean(m)),) * len(m),
        "Each body has the mass of the one before it": lambda m: (m[0], *m[:-1]),
    }
    for key, table in (("stiffness", stiffness), ("mass", mass)):
        for words, change in table.items():
            yield Fault(key, "mixing", f"{words}.", changed(key, change))


def _walls(scene: Scene) -> Iterator[Candidate]:
    """Yield faults of walls."""

    def without(scene: Scene) -> Scene:
        return replace(scene, wall_left=None, wall_right=None)

    def all_by(factor: float) -> Change:
        return lambda scene: _with_walls(scene, lambda wall, _: replace(wall, stiffness=abs(factor) * wall.stiffness))

    def of_next(scene: Scene) -> Scene:
        return _with_walls(scene, lambda wall, contact: replace(wall, stiffness=scene.stiffness[contact]))

    yield Fault("missed-contact", "walls", "There are no walls.", without)
    for field, side, _ in _SIDES:
        yield Fault("missed-contact", "walls", f"There is no {side} wall.", changed(field, lambda wall: None))
    yield Fault("stiffness", "walls", "The walls have the stiffness of the next contact.", of_next)
    yield Fault("stiffness", "walls", "The walls have each other's stiffness.", _exchanged)
    half, twice = math.sqrt(0.5), math.sqrt(2.0)
    table = ((0.5, "half their"), (2.0, "twice their"), (half, "1/sqrt 2 of their"), (twice, "sqrt 2 times their"))
    for factor, words in table:
        yield Fault("stiffness", "walls", f"The walls have {words} stiffness.", all_by(factor))
    yield family("stiffness", "walls", "The walls have {:.5g} times their stiffness.", all_by, (0.7, 1.4))
    for field, side, _ in _SIDES:
        if getattr(scene, field) is not None:
            sentence = f"The {side} wall has {{:.5g}} times its stiffness."
            yield family("stiffness", "walls", sentence, _wall_by(field, "stiffness"))
            sentence = f"The {side} wall is {{:.3g}} m further away."
            yield family("start-position", "walls", sentence, _wall_by(field, "gap"), (0.3, -0.3), unit=_PLACE_M)


def _wall_by(field: str, key: str) -> Callable[[float], Change]:
    """Return the changes of one wall: its stiffness by a factor, or its gap by a length, m."""

    def other(wall: Wall | None, number: float) -> Wall | None:
        if wall is None:
            return None
        return (
            replace(wall, gap=wall.gap + number)
            if key == "gap"
            else replace(wall, stiffness=abs(number) * wall.stiffness)
        )

    return lambda number: changed(field, lambda wall: other(wall, number))


def _with_walls(scene: Scene, change: Callable[[Wall, int], Wall]) -> Scene:
    """Return a scene with other walls; the change is given a wall and the number of the contact next to it."""
    for field, _, contact in _SIDES:
        if (wall := getattr(scene, field)) is not None:
            values: dict[str, Any] = {field: change(wall, contact)}
            scene = replace(scene, **values)
    return scene


def _exchanged(scene: Scene) -> Scene:
    """Return a scene whose walls have exchanged their stiffnesses."""
    left, right = scene.wall_left, scene.wall_right
    if left is None or right is None:
        return scene
    return replace(
        scene,
        wall_left=replace(left, stiffness=right.stiffness),
        wall_right=replace(right, stiffness=left.stiffness),
    )


def _gaps(scene: Scene) -> Iterator[Candidate]:
    """Yield faults of gaps."""
    del scene
    table: dict[str, Callable[[Floats], Floats]] = {
        "All gaps are 0": lambda g: (0.0,) * len(g),
        "All gaps have the other sign: the contacts begin compressed": lambda g: tuple(-x for x in g),
        "The gaps are in reverse order": lambda g: g[::-1],
        "Each gap is counted from the first body": lambda g: tuple(accumulate(g)),
        "All gaps are the first one": lambda g: (g[0],) * len(g),
        "All gaps are the last one": lambda g: (g[-1],) * len(g),
        "All gaps but the first are 0": lambda g: (g[0], *(0.0,) * (len(g) - 1)),
        "The first gap is 0": lambda g: (0.0, *g[1:]),
    }
    for words, change in table.items():
        yield Fault("start-position", "gaps", f"{words}.", changed("gap", change))
    sentence = "All gaps are {:.5g} times those of the scene."
    yield family("start-position", "gaps", sentence, lambda f: changed("gap", lambda g: tuple(f * x for x in g)))


def _gravity(scene: Scene) -> Iterator[Candidate]:
    """Yield faults of gravity."""
    del scene
    yield Fault("gravity", "gravity", "Gravity does not act.", changed("gravity", lambda g: 0.0))
    yield Fault("gravity", "gravity", "Gravity has the other direction.", changed("gravity", lambda g: -g))
    sentence = "Gravity is {:.5g} times that of the scene."
    yield family("gravity", "gravity", sentence, lambda f: changed("gravity", lambda g: f * g))


def _precompression(scene: Scene) -> Iterator[Candidate]:
    """Yield faults of a static force."""
    del scene
    item = "precompression"

    def unheld(scene: Scene) -> Scene:
        return replace(scene, precompression=0.0, gap=tuple(float(g) for g in scene.contacts.gap[: scene.n_body - 1]))

    sentence = "The chain starts without a static force: no overlaps and no load."
    yield Fault("start-position", item, sentence, changed(item, lambda force: 0.0))
    sentence = "The chain starts with its static overlaps, but no load holds them."
    yield Fault("start-position", item, sentence, unheld)
    sentence = "The load acts, but the chain starts without its static overlaps."
    yield Fault("start-position", item, sentence, system=lambda system: system.changed(gap=0.0 * system.gap))
    sentence = "The static force is {:.5g} times that of the scene."
    yield family("start-position", item, sentence, lambda f: changed(item, lambda force: abs(f) * force))


def _several_moving(scene: Scene) -> Iterator[Candidate]:
    """Yield faults of start velocities."""
    item = "several-moving"
    table: dict[str, Callable[[Floats], Floats]] = {
        "Only the first body moves at the start": lambda v: (v[0], *(0.0,) * (len(v) - 1)),
        "All start velocities are positive": lambda v: tuple(map(abs, v)),
        "The bodies behind the first start in the other direction": lambda v: (v[0], *(-x for x in v[1:])),
        "All bodies start with the velocity of the first": lambda v: (v[0],) * len(v),
        "Only the first and the last body move at the start": lambda v: (v[0], *(0.0,) * (len(v) - 2), v[-1]),
    }
    for words, change in table.items():
        yield Fault("start-velocity", item, f"{words}.", changed("velocity", change))
    sentence = "Body {} starts with {:.5g} times its velocity."
    for k in range(1, scene.n_body):
        yield placed_family("start-velocity", item, sentence, partial(entry, "velocity"), k, scene, (0.5, -1.0))


def _restitution(scene: Scene) -> Iterator[Candidate]:
    """Yield faults of damping."""
    damping = scene.damping
    assert damping is not None  # the scene asks for a restitution
    own = bool(damping.clip)
    # the clip of each scene, or one that is not its own
    clips: tuple[tuple[bool | None, str], ...] = ((None, ""), (not own, _clip_words(not own)))
    words = clips[1][1]
    yield Fault("clip", "restitution", f"{words[:1].upper()}{words[1:]}.", lambda scene: _reclipped(scene, not own))
    yield Fault("damping", "restitution", "Contacts are not damped.", changed("damping", lambda _: None))
    for clip, words in clips:
        yield from _other_alphas(damping, clip, f", and {words}" * bool(words))
    for clip, words in clips:
        also = f", and {words}" * bool(words)
        sentence = f"The damping force is {{:.5g}} times that of the law {damping.law}{also}."
        yield family("damping", "restitution", sentence, _more_damped(clip), (0.5, 0.9, 1.5, 2.0))


def _clip_words(clip: bool) -> str:
    """Return what clips the forces of a code."""
    if clip:
        return "net forces are clipped at zero, although the scene has clip = false"
    return "net forces are not clipped at zero: damping pulls"


def _reclipped(scene: Scene, clip: bool) -> Scene:
    """Return a scene whose contacts are clipped or not."""
    return scene if scene.damping is None else replace(scene, damping=replace(scene.damping, clip=clip))


def _other_alphas(damping: Damping, clip: bool | None, also: str) -> Iterator[Fault]:
    """Yield other factors of the damping force of laws that are given a coefficient of restitution."""
    if damping.law not in BY_RESTITUTION:
        return

    def fault(words: str, alpha: Callable[[float], float], cause: str = "damping") -> Fault:
        return Fault(cause, "restitution", f"{words}{also}.", lambda scene: _with_alpha(scene, alpha, clip))

    lammps = f"{TSUJI_OF_LAMMPS}: the prefactor of the polynomial is 1 in place of sqrt 2"
    yield fault(lammps, alpha_of_tsuji_without_sqrt2, TSUJI_OF_LAMMPS)
    table: dict[str, Callable[[float], float]] = {
        "The factor is that of coeff_restitution, the exact inverse of the restitution": alpha_of_restitution,
        "The factor is that of tsuji, Marshall's polynomial": alpha_of_tsuji,
        "The factor of Hooke's law, 2 in place of sqrt 5, is used for Hertz's": lambda e: (
            2.0 * alpha_of_restitution(e) / math.sqrt(5.0)
        ),
        "The factor lacks sqrt(3/2)": lambda e: alpha_of_restitution(e) / math.sqrt(1.5),
        "The factor is that for the mass of a body in place of the effective mass": lambda e: (
            alpha_of_restitution(e) * math.sqrt(2.0)
        ),
        "The coefficient of restitution is used as the factor itself": lambda e: e,
    }
    yield from (fault(words, alpha) for words, alpha in table.items())


def _with_alpha(scene: Scene, alpha: Callable[[float], float], clip: bool | None) -> Scene:
    """Return a scene whose damping by restitution has another factor alpha(e), and its own clip if that is None."""
    damping = scene.damping
    if damping is None or damping.law not in BY_RESTITUTION or not isinstance(damping.coefficient, tuple):
        return scene
    coefficients = zip(damping.coefficient, scene.contacts.exponent.tolist(), strict=True)
    # the law coeff_restitution has the factor alpha at this restitution: its exact inverse, alpha^2 < 2 n
    values = tuple(
        restitution_of_alpha(min(alpha(e), 0.99 * math.sqrt(2.0 * n)), clip=False, exponent=n) for e, n in coefficients
    )
    clipped = damping.clip if clip is None else clip
    return replace(scene, damping=Damping(law="coeff_restitution", coefficient=values, clip=clipped))


def _more_damped(clip: bool | None) -> Callable[[float], Change]:
    """Return the changes of damping forces by a factor."""

    def damped(scene: Scene, factor: float) -> Scene:
        damping = scene.damping
        if damping is None or not isinstance(damping.coefficient, tuple):
            return scene
        if damping.law in BY_RESTITUTION:
            own = alpha_of_tsuji if damping.law == "tsuji" else alpha_of_restitution
            return _with_alpha(scene, lambda e: factor * own(e), clip)
        coefficients: Any = tuple(factor * c for c in damping.coefficient)
        clipped = damping.clip if clip is None else clip
        return replace(scene, damping=Damping(law=damping.law, coefficient=coefficients, clip=clipped))

    return lambda factor: lambda scene: damped(scene, abs(factor))
