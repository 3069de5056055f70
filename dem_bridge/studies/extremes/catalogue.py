"""The extremes by name: scales and symmetries, contacts that hardly touch, and the numerics.

An entry has a scene, what is true of it, and what is expected of each backend; most scenes are made by :func:`chain`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from importlib import resources
from types import MappingProxyType
from typing import Any

import numpy as np

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Backend, Resolution, Sampling, backend
from dem_bridge.backends.lammps import LammpsTable
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.tabled import tables_for
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.pair_coefficients import TableSet
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.extremes import truths
from dem_bridge.studies.extremes.judge import Expected, Word
from dem_bridge.studies.extremes.truths import Truth, by_others, scaled, two_bodies

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


#: theories need a single pulse into a touching chain at rest
MOVING = theories_refuse("bodies behind the first that move")


def angles() -> Iterator[Entry]:
    """Yield contact angles over five decades."""
    angle = np.geomspace(90.0, 0.001, 9)
    beta = [crossed_cylinders(angle=a, radius=9e-3, young=72e9, poisson=0.17).stiffness for a in angle.tolist()]
    for name, betas, way in (
        ("angles-90-to-0.001", beta, "stiffer and stiffer"),
        ("angles-0.001-to-90", beta[::-1], "softer and softer"),
    ):
        asks = f"contact angles over {beta[-1] / beta[0]:.0f} in stiffness, {way}"
        yield entry(chain(name, stiffness=betas), asks)


@cache
def _catalogue() -> Mapping[str, Any]:
    """Return the content of the file; what it names is looked up when its entries are made, and so checked."""
    file = resources.files(__package__) / "catalogue.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def listed(group: str) -> Iterator[Entry]:
    """Yield the entries of a group in the file of the catalogue."""
    for item in map(dict, _catalogue()[group]):
        scene = chain(item.pop("name"), **item.pop("chain", {}))
        expected = {kind: refused(because) for kind, because in item.pop("refused", {}).items()}
        expected |= {kind: Expected(Word(word)) for kind, word in item.pop("expected", {}).items()}
        sources = [_source(**source) for source in item.pop("truths", ())]
        yield entry(scene, item.pop("asks"), *sources, expected=expected, **item)


def _source(by: str, **arguments: Any) -> Callable[[Scene], Truth]:
    return partial(getattr(truths, by), **arguments)


def exponents() -> Iterator[Entry]:
    """Yield exponents other than Hertz'."""
    for n in (1.5, 2.0, 2.0001, 2.001, 5.0, 6.0):
        # the force of a Hertz contact at 10 um
        beta = BETA * 1e-5 ** (2.5 - n)
        # below n = 2 contacts are the stiffer the less deep they are: there is no highest frequency to take a step from
        period = contact_time(stiffness=beta, exponent=n)
        scene = chain(f"n-{n:g}", exponent=n, stiffness=beta, duration=5.0 * period)
        expected = {}
        if n != 2.0:
            expected["lammps-granular"] = refused("allowed exponents: 2 and 2.5")
        if not 2.0 <= n <= 5.0:
            expected["lammps-table"] = refused("allowed exponents: 2 to 5")
        if n < 2.1:
            # no steady pulse, and near n = 2 it is too wide to form
            expected["adiabatic"] = refused("allowed exponents: 2.1 to 50")
        dt = period / 200 if n < 2.0 else None
        yield entry(scene, f"n = {n:g}", by_others, partial(scaled, factor=0.5), expected=expected, dt=dt)


def symmetries() -> Iterator[Entry]:
    """Yield scenes that must move as others do."""
    beta = np.geomspace(BETA, 20 * BETA, 9).tolist()
    mirror = chain("mirror", stiffness=beta[::-1], velocity=(*[0.0] * 9, -SPEED), wall_left=Wall(stiffness=BETA))
    yield entry(mirror, "a chain struck from its other end, on a wall", by_others, truths.mirrored, expected=MOVING)
    there = chain("there", stiffness=beta, times=4.0)
    sampling = Sampling(count=there.samples)
    forward = solve(Case(scene=there, backend="reference", resolution=Resolution(), sampling=sampling))
    scene, truth = truths.back_again(forward, there)
    scene = replace(scene, name="time-reversal")
    asks = "all velocities reversed at the end: back to the start"
    yield entry(scene, asks, by_others, lambda scene: truth, expected=MOVING)


def touches() -> Iterator[Entry]:
    """Yield contacts that hardly touch."""
    # a ball thrown up at a ceiling, which is where it would turn, or next to it
    g, up = -1e3, SPEED
    height = up**2 / (2.0 * -g)
    for share in (1e-12, 1e-6, 1e-3, -1e-12, -1e-6):
        where = "below" if share > 0.0 else "above"
        ceiling = Wall(stiffness=BETA, gap=height * (1.0 - share))
        name = f"graze-{plain(abs(share))}-{where}"
        yield entry(
            chain(name, bodies=1, gravity=g, wall_right=ceiling, duration=1.5 * up / -g),
            f"a ball that rises to a ceiling {abs(share):g} of its way {where} where it turns",
            expected=theories_refuse("the scene has walls"),
        )
    crawl = chain("closing-1e-12", bodies=2, velocity=(SPEED + SPEED * 2.0**-40, SPEED), samples=3,
                  duration=3.0 * contact_time(speed=SPEED * 2.0**-40))  # fmt: skip
    asks = "two bodies in flight that close in on each other 1e-12 times as fast as they fly"
    yield entry(crawl, asks, two_bodies, by_others, expected=MOVING)


def presses() -> Iterator[Entry]:
    """Yield precompressed chains."""
    dynamic = (1.25 * 0.5 * MASS * SPEED**2 / BETA) ** 0.4
    for share in (1e-9, 1e-3, 1.0, 1e3):
        force = BETA * (share * dynamic) ** 1.5
        # a wave in a chain pressed so much is faster
        scene = chain(f"pressed-{plain(share)}", precompression=force, times=5.0 / max(1.0, share**0.25))
        asks = f"a chain pressed to {share:g} of the dynamic overlap, and struck"
        yield entry(scene, asks, expected=theories_refuse("the scene has precompression"))


def _short_tables(scene: Scene, resolution: Resolution, prescan: Prescan) -> TableSet:
    """Return tables that end where the deepest overlap is foreseen, a line short of it."""
    result = tables_for(scene, resolution, prescan)
    deepest = float(np.max(prescan.peak_overlap))
    cut = {}
    for law, table in result.tables.items():
        kept = table.distance > table.distance[-1] - deepest
        cut[law] = replace(table, distance=table.distance[kept], energy=table.energy[kept], force=table.force[kept])
    return replace(result, tables=cut)


class ShortTable(LammpsTable):
    """Run LAMMPS with tables that are too short."""

    tables_of = staticmethod(_short_tables)


def short_table() -> Iterator[Entry]:
    """Yield a table that is too short."""
    asks = "a table that ends a line short of the deepest overlap"
    expected = refused("table inner cutoff")
    yield entry(
        chain("table-ends-a-line-short"),
        asks,
        instead={"lammps-table": ShortTable},
        expected={"lammps-table": expected},
    )


def steps() -> Iterator[Entry]:
    """Yield time steps at the limit of stability and beyond."""
    # linear springs between walls, pressed so that none opens: the limit is 2 over the highest frequency
    bodies, spring = 8, BETA * 1e-5**0.5
    highest = 2.0 * math.sqrt(spring / MASS) * math.cos(0.5 * math.pi / (bodies + 1))
    wall = Wall(stiffness=spring, exponent=2.0)
    # the twins at twice the step are unstable, and so are those at 1.01; then bodies may pass through others
    unstable = Expected(Word.NO_BAR, otherwise=Word.REFUSED)
    for share, name in ((0.99, "below"), (1.01, "above")):
        dt = share * 2.0 / highest
        scene = chain(f"step-just-{name}-the-limit", bodies=bodies, exponent=2.0, stiffness=spring,
                      wall_left=wall, wall_right=wall, precompression=100.0 * SPEED * math.sqrt(MASS * spring),
                      duration=400 * dt)  # fmt: skip
        expected = theories_refuse("has walls and precompression") | {VERLET: unstable}
        yield entry(scene, f"a step of {share:g} of the limit of velocity-Verlet", dt=dt, expected=expected)
    asks = "a step of 4e-6 s on the paper's chain, where momentum and final energy look right and velocities are not"
    yield entry(replace(load_scene("decelerating-40"), name="step-in-the-trap", samples=60), asks, dt=4e-6)
    over = chain("step-over-contacts", samples=3, times=12.0)
    yield entry(over, "a step of four contact times", dt=over.duration / 3, expected={FIXED_STEP: unstable})


@cache
def catalogue() -> Mapping[str, Entry]:
    """Return all entries by name; the state from which one of them runs backwards is computed by the reference."""
    scales = ("speeds", angles, "ratios", "sizes", exponents, "galilei", symmetries)
    groups = (*scales, touches, "fronts", "gaps", "far", presses, "nothing", "tabulated", short_table, steps)
    parts = [listed(group) if isinstance(group, str) else group() for group in groups]
    return checked([item for part in parts for item in part])
