"""The protocol of every backend, its settings, and the table of those that exist.

A backend
1. says which equations it solves (``equations``) and with which order in dt (``order``; None: no fixed step),
2. says whether it can run here, with the reason and the remedy if not (``availability``),
3. declares which scenes it supports (``supports``): what it does not list there is refused before anything runs,
4. turns a Scene, a Resolution and a Sampling into a Trajectory (``run``); its uncertainty is estimated elsewhere
   (:mod:`dem_bridge.runs.uncertainty`),
5. never changes the scene, never repairs a run; raises RunBroken if one fails.

Adding one: docs/inherit.md.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.catalogue import BACKENDS as BACKENDS
from dem_bridge.backends.catalogue import ENGINE_BACKENDS as ENGINE_BACKENDS
from dem_bridge.backends.catalogue import class_of
from dem_bridge.errors import UsageError, shown
from dem_bridge.foundation.numbers import check_number
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.restitution import impact_facts
from dem_bridge.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from dem_bridge.lmp.engine import Engine

#: backends that are recommended before others where one does not support a scene
GENERAL = ("scipy", "verlet")
MOST_SAMPLES = 10_000_000
#: smallest and largest value of numeric settings, and whether they are whole numbers; rtol goes from the least that
#: adaptive integrators take (100 eps) to what decides no step any more
LIMITS = {
    "dt": (1e-40, 1e40, False),
    "rtol": (2.3e-14, 1.0, False),
    "atol": (1e-40, 1e40, False),
    "surrogate_radius": (1e-40, 1e40, False),
    "time_limit": (1e-3, 1e9, False),
    "table_lines": (8, 1_000_000, True),
    "table_points": (2, 100_000_000, True),
}
#: settings that are one of a few words
CHOICES = {
    "geometry": ("surrogate", "physical"),
    "types": ("euler", "per-body"),
    "table_style": ("spline", "linear"),
    "tables": (False, True),
}


@dataclass(frozen=True, kw_only=True)
class Resolution:
    """State how finely to solve.

    None is the backend's own default. A backend ignores settings that do not apply to it.
    """

    dt: float | None = None
    """Largest time step, s."""
    rtol: float | None = None
    """Relative local tolerance of an adaptive integrator; the error of the run is larger."""
    atol: float | None = None
    """Absolute local tolerance of ode45, in SI (m and m/s alike), as MATLAB has it."""
    surrogate_radius: float | None = None
    """Radius written into a LAMMPS deck, m; None: from the overlaps of a coarse run. The twin then keeps absolute
    positions of bodies of this radius; None: overlaps."""
    geometry: str = "surrogate"
    """Radius of the bodies in a LAMMPS deck where ``surrogate_radius`` names none: "surrogate", the least that serves,
    or "physical", half the scene's spacing, with the round-off that comes with it."""
    types: str = "euler"
    """Atom types of a LAMMPS deck: "euler", as few as can be, or "per-body", one for each."""
    table_style: str = "spline"
    """How LAMMPS interpolates between the points of a table: "spline" or "linear"."""
    table_lines: int | None = None
    """Lines of a table file."""
    table_points: int | None = None
    """Points of LAMMPS' internal table; None: 10,000, or fewer where many tables share the memory."""
    tables: bool = False
    """Of the twin: take forces from the tables that LAMMPS would have, not from the laws."""
    time_limit: float = 3600.0
    """Wall time, s, after which an engine in a child process is stopped."""

    def __post_init__(self) -> None:
        for key, (low, high, whole) in LIMITS.items():
            if (value := getattr(self, key)) is not None:
                limits = f"a whole number from {low} to {high}" if whole else f"a number from {low:g} to {high:g}"
                number = check_number(key, value, limits, whole=whole, at_least=low, at_most=high)
                object.__setattr__(self, key, number)
        for key, choices in CHOICES.items():
            value = getattr(self, key)
            if type(value) is not type(choices[0]) or value not in choices:
                raise UsageError(f"{key} = {shown(value)}; allowed: {' or '.join(map(repr, choices))}")


@dataclass(frozen=True, kw_only=True)
class Sampling:
    """State at which times to answer: ``count`` equal steps from 0 to the scene's duration, or ``given`` times.

    >>> Sampling(count=2).times(1e-4).tolist(), Sampling(given=(0.0, 3e-5, 1e-4)).count
    ([0.0, 5e-05, 0.0001], 2)
    """

    count: int = 0
    given: tuple[float, ...] = ()
    """Times, s, from 0 to the scene's duration, increasing; empty: equal steps."""

    def __post_init__(self) -> None:
        if self.given:
            times = np.array(self.given, dtype=np.float64)
            if times[0] != 0.0 or not np.all(np.isfinite(times)) or not np.all(np.diff(times) > 0.0):
                raise UsageError(f"given times = {shown(self.given)}; allowed: finite times (s) that increase from 0")
            object.__setattr__(self, "given", tuple(times.tolist()))
            object.__setattr__(self, "count", len(times) - 1)
        limits = f"a whole number from 1 to {MOST_SAMPLES}"
        count = check_number("samples", self.count, limits, whole=True, at_least=1, at_most=MOST_SAMPLES)
        object.__setattr__(self, "count", count)

    @property
    def equal_steps(self) -> int:
        """Return the number of equal steps; UsageError where the times are given, which a fixed step would miss."""
        if self.given:
            raise UsageError(
                f"the times of the {self.count} samples are given; allowed with a fixed step: a count of equal steps;"
                " take backend = 'reference' or 'scipy'"
            )
        return self.count

    def times(self, duration: float) -> NDArray[np.float64]:
        """Return the sample times, s, ``(count + 1,)``; UsageError where given times do not end at ``duration``."""
        if self.given and self.given[-1] != duration:
            raise UsageError(
                f"given times end at {self.given[-1]:g} s; allowed: the duration of the scene, {duration:g} s"
            )
        return np.array(self.given) if self.given else np.linspace(0.0, duration, self.count + 1)


@dataclass(frozen=True)
class Availability:
    """State whether a backend can run on this machine; ``reason`` is the reason why not, with a remedy."""

    available: bool
    reason: str = ""


class Named(Protocol):
    """Name and equations of a code, as the provenance of a run has them."""

    name: str
    equations: str


class Backend(Named, Protocol):
    """See the module's docstring."""

    order: int | None
    supports: Support

    def availability(self) -> Availability:
        """Return whether the backend can run on this machine."""
        ...

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve a scene."""
        ...


class AlwaysAvailable:
    """A backend of this package that needs nothing else, of Hertz's equations without a fixed step by default."""

    equations = "hertz"
    order: int | None = None

    def availability(self) -> Availability:
        """Return that the backend can run."""
        return Availability(True)


class Replicating(Backend, Protocol):
    """A backend that makes the further runs for its uncertainty itself."""

    def replicas(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> list[Trajectory]:
        """Return the further runs of a case."""
        ...


def backend(name: str, engine: Engine | None = None) -> Backend:
    """Return the backend of that name.

    ``engine``: which LAMMPS, for backends that run it (None: the default). UsageError for another name, with the
    allowed ones, and for an engine with a backend that runs no LAMMPS.
    """
    kind = class_of(name)
    if name in ENGINE_BACKENDS:
        return cast(Backend, kind(engine))
    if engine is not None:
        raise UsageError(
            f"lmp, lmp_args, python and ranks say which LAMMPS; backend = {name!r} runs none;"
            f" allowed with: {', '.join(ENGINE_BACKENDS)}"
        )
    return cast(Backend, kind())


def unsupported_reason(chosen: Backend, scene: Scene) -> str | None:
    """Return the reason why a backend does not support a scene, in one line; None if it supports it.

    Parameters
    ----------
    chosen : Backend
        Any backend; only its declaration of support is used.
    scene : Scene
        The scene that it is to solve.

    Returns
    -------
    str or None
        What the scene has, what the backend supports, and the backend to use instead.

    Examples
    --------
    >>> scene = Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), drag=1.0)
    >>> unsupported_reason(backend("blanes-moan"), scene).split("; ")[0::3]
    ['the scene has drag', "use backend = 'scipy'"]
    """
    reason = chosen.supports.unsupported_reason(scene)
    if reason is None:
        return None
    order = dict.fromkeys((chosen.supports.instead, *GENERAL, *BACKENDS))
    # a backend is imported when its declaration is asked for: those after the first that fits are not
    other = next((name for name in order if name in BACKENDS and supports_of(name).covers(scene)), None)
    return f"{reason}; " + ("no backend supports this scene" if other is None else f"use backend = {other!r}")


def supports_of(name: str) -> Support:
    """Return the declaration of the backend of that name in the catalogue, without creating the backend."""
    return cast(Support, class_of(name).supports)


def run_provenance(backend: Named, scene: Scene, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Provenance common to all backends: what was run, with which settings and versions. JSON-able."""
    return {
        "backend": backend.name,
        "equations": backend.equations,
        "scene": scene.name,
        "scene_hash": scene.content_hash,
        **({} if (facts := impact_facts(scene)) is None else {"impact": dict(facts)}),
        "settings": dict(settings),
        "versions": versions_of("dem-bridge", "numpy", "scipy", "numba"),
        "machine": f"{platform.system()} {platform.machine()}",
    }


def versions_of(*packages: str) -> dict[str, str | None]:
    """Return the version of each package, None for one that is not installed, and that of Python."""
    return {name: version_of(name) for name in packages} | {"python": platform.python_version()}


@cache
def version_of(package: str) -> str | None:
    """Return the version of an installed package, or None; it is read once, which takes longer than a short run."""
    from importlib import metadata

    with suppress(metadata.PackageNotFoundError):
        return metadata.version(package)
    return None
