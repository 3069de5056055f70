"""One extreme: its scene, what is true of it, and what each backend has to say. And the chains that extremes are of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Backend, backend
from dem_bridge.lmp.engine import Engine
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.extremes.judge import Expected, Word
from dem_bridge.studies.extremes.truths import Truth, by_others

#: kinds of backends that an expectation may be for, beside their names
THEORY, VERLET, FIXED_STEP, ENGINE, HERTZ = "theory", "velocity-Verlet", "fixed step", "engine", "hertz"
#: phase of the stiffest contact in one step, where codes have one: errors of 1e-5 to 1e-3
PHASE = 0.02
#: the ordinary chain: about the paper's cylinders, in binary fractions so that speeds add up exactly
MASS, BETA, SPEED = 1e-2, 4.7e9, 0.75


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One line of the catalogue."""

    scene: Scene
    asks: str
    """The question, in words."""
    truths: tuple[Truth, ...]
    """All must be kept; a backend is judged by the one that it is the furthest from."""
    expected: Mapping[str, Expected] = field(default_factory=lambda: MappingProxyType({}))
    """By name or kind of backend; :func:`expectation` has the rest."""
    dt: float | None = None
    """Of codes with a fixed step, s; None: ``phase`` of the stiffest contact."""
    phase: float = PHASE
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: MappingProxyType({}))
    """More settings of a Resolution, by name of backend."""
    instead: Mapping[str, Callable[[Engine | None], Backend]] = field(default_factory=lambda: MappingProxyType({}))
    """Backends with a defect, in place of the one of that name."""
    left_out: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Backends that are not run here for what that takes, with the reason."""
    slow: bool = False
    """Whether it takes more than about 5 s."""

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.name

    @property
    def sources(self) -> str:
        """Sources of the truths in words."""
        return "; ".join(truth.says for truth in self.truths)


def entry(scene: Scene, asks: str, *truths: Callable[[Scene], Truth], **settings: Any) -> Entry:
    """Return an entry; without ``truths`` the scene is compared with another code."""
    return Entry(scene=scene, asks=asks, truths=tuple(truth(scene) for truth in truths or (by_others,)), **settings)


def kinds(judged: Backend) -> tuple[str, ...]:
    """Return the keys under which an expectation for this backend may stand, the most special first."""
    hertz = judged.equations == "hertz"
    holds = {
        ENGINE: judged.name in ENGINE_BACKENDS,
        THEORY: not hertz,
        VERLET: hertz and judged.order == 2,
        FIXED_STEP: hertz and judged.order is not None,
        HERTZ: hertz,
    }
    return (judged.name, *(kind for kind, is_of_it in holds.items() if is_of_it))


def expectation(entry: Entry, name: str) -> Expected:
    """Return the findings that are expected of a backend.

    Unless the entry states more, a code of these equations is right within its uncertainty, and a theory gives a
    number.
    """
    if name in entry.left_out:
        return Expected(Word.NOT_RUN)
    every = kinds(backend(name))
    default = Expected(Word.MODEL if THEORY in every else Word.RIGHT)
    return next((entry.expected[kind] for kind in every if kind in entry.expected), default)


def refused(because: str) -> Expected:
    """Return the expectation that a scene is refused, with a part of the reason."""
    return Expected(Word.REFUSED, because)


def theories_refuse(because: str) -> dict[str, Expected]:
    """Return the expectations of a scene that is no single pulse into a touching chain at rest."""
    return {THEORY: refused(because)}


def checked(entries: Sequence[Entry]) -> Mapping[str, Entry]:
    """Return the entries by name. Raises ValueError for equal names, and for expectations or settings of no backend."""
    kinds_and_names = {*BACKENDS, THEORY, VERLET, FIXED_STEP, ENGINE, HERTZ}
    results: dict[str, Entry] = {}
    for entry in entries:
        if entry.name in results:
            raise ValueError(f"two entries are called {entry.name}")
        if stray := ({*entry.expected} - kinds_and_names) | (
            {*entry.settings, *entry.left_out, *entry.instead} - {*BACKENDS}
        ):
            raise ValueError(
                f"{entry.name}: {min(stray)!r} is no backend and no kind; allowed: {', '.join(sorted(kinds_and_names))}"
            )
        results[entry.name] = entry
    return MappingProxyType(results)


def plain(value: float) -> str:
    """Format a number as people write it and as scene names allow: 1e6, 1e-9, 0.001."""
    return f"{value:g}".replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")


def contact_time(*, stiffness: float = BETA, speed: float = SPEED, exponent: float = 2.5) -> float:
    """Return the contact time of two such bodies that meet at ``speed``, s; it is the unit of durations."""
    masses = (MASS, MASS)
    hit = two_body_collision(masses=masses, velocities=(speed, 0.0), stiffness=stiffness, exponent=exponent)
    return hit.contact_time


def chain(
    name: str,
    *,
    bodies: int = 10,
    speed: float = SPEED,
    mass: float | Sequence[float] = MASS,
    stiffness: float | Sequence[float] = BETA,
    times: float = 5.0,
    samples: int = 20,
    **more: Any,
) -> Scene:
    """Return a row of ``bodies``, the first at ``speed`` unless ``velocity`` is given.

    It lasts so many contact ``times`` of the ordinary bodies at this speed, unless ``duration`` is given.
    """
    masses = (mass,) * bodies if isinstance(mass, float) else tuple(mass)
    if not isinstance(stiffness, float) and isinstance(mass, float):
        masses = (mass,) * (len(stiffness) + 1)
    betas = (stiffness,) * (len(masses) - 1) if isinstance(stiffness, float) else tuple(stiffness)
    settings: dict[str, Any] = {"velocity": (speed, *[0.0] * (len(masses) - 1))}
    if "duration" not in more:
        exponent = more.get("exponent", 2.5)
        settings["duration"] = times * contact_time(speed=speed, exponent=exponent)
    return Scene(name=name, mass=masses, stiffness=betas, samples=samples, **(settings | more))
