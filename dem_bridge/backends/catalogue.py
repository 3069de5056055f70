"""The backends that exist, by name; no backend is imported before it is used.

Other distributions add backends by entry points (:mod:`dem_bridge.foundation.guests`).
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from dem_bridge.errors import UsageError
from dem_bridge.foundation import guests


class Entry(NamedTuple):
    """The module and class of a backend, and its method and purpose for the README's table."""

    module: str
    """Imported only when the backend is used."""
    attribute: str
    method: str
    purpose: str
    uncertainty: str = ""
    """The rule from which its uncertainty follows, module ``runs/uncertainty/from_RULE``; '': its runs state theirs."""


_HERE = __name__.rpartition(".")[0]
BACKENDS: Mapping[str, Entry] = MappingProxyType({
    "lammps-granular": Entry(
        f"{_HERE}.lammps",
        "LammpsGranular",
        "LAMMPS, `pair_style granular`, velocity-Verlet",
        "the code under test, run in a child process",
        "twins",
    ),
    "lammps-table": Entry(
        f"{_HERE}.lammps",
        "LammpsTable",
        "LAMMPS, `pair_style table`, velocity-Verlet",
        "the same for other laws; with `tables=True` the twin interpolates the same tables (8e-9 of the force)",
        "twins",
    ),
    "verlet": Entry(
        f"{_HERE}.verlet",
        "Verlet",
        "velocity-Verlet in overlap variables (with `surrogate_radius`: in positions), compiled",
        "the algorithmic twin: LAMMPS - twin is implementation and round-off",
        "twins",
    ),
    "blanes-moan": Entry(
        f"{_HERE}.blanes_moan",
        "BlanesMoan",
        "symplectic Runge-Kutta-Nystroem method of order 4 (SRKN_6^b) in overlap variables, compiled",
        "velocities to 1e-6 of v0 for a third of velocity-Verlet's force evaluations",
        "own_steps",
    ),
    "reference": Entry(
        f"{_HERE}.reference",
        "Reference",
        "Taylor series through located, desingularised contacts, compiled; `scipy` where the series do not fit",
        "the reference of `verify`: its error is 3e-14 of v0 on the paper's chains, in 0.1 s",
        "replicas",
    ),
    "scipy": Entry(
        f"{_HERE}.scipy_dop853",
        "ScipyDop853",
        "DOP853, restarted at located contact events",
        "the second reference, by an unrelated method",
        "looser_runs",
    ),
    "ase": Entry(
        f"{_HERE}.ase_verlet",
        "AseVerlet",
        "velocity-Verlet of ASE",
        "an implementation by a third party: it agrees with the twin to 4e-12 of v0",
        "twins",
    ),
    "ode45": Entry(
        f"{_HERE}.ode45",
        "Ode45",
        "Dormand-Prince 5(4) with MATLAB's step control and default tolerances",
        "the paper's own method: its error is 3.6e-3 of v0",
        "replicas",
    ),
    "bca": Entry(
        f"{_HERE}.bca",
        "BinaryCollisions",
        "binary collisions: other equations",
        "the paper's theory: a model difference, never PASS or FAIL",
    ),
    "adiabatic": Entry(
        f"{_HERE}.adiabatic",
        "AdiabaticWaves",
        "the exact solitary wave of each place, its energy followed: other equations",
        "the better theory of times, velocities and forces: a model difference, too",
    ),
})  # fmt: skip

#: those that run LAMMPS, and are constructed with an Engine
ENGINE_BACKENDS = tuple(name for name in BACKENDS if name.startswith("lammps"))

#: what the attribute ``uncertainty_from`` of a foreign backend may be: twins on the same steps, for a code that
#: errs as velocity-Verlet does, or nothing, where the uncertainty is that which the run states
_FAMILIES = ("", "twins")


def backend_names() -> tuple[str, ...]:
    """Return the names of all backends: those of this package, then those of other distributions."""
    return (*BACKENDS, *guests.guest_names(guests.BACKENDS, BACKENDS))


def class_of(name: str) -> Any:
    """Return the class of a backend; raise UsageError for an unknown name, and for a distribution that is faulty."""
    if name in BACKENDS:
        return getattr(importlib.import_module(BACKENDS[name].module), BACKENDS[name].attribute)
    if (point := guests.find_guest(guests.BACKENDS, name)) is None:
        raise UsageError(f"backend = {name!r}; allowed: {', '.join(backend_names())}")
    return guests.load_guest(point)


def entry_of(name: str) -> Entry:
    """Return the entry of a backend; that of another distribution follows from its class."""
    if name in BACKENDS:
        return BACKENDS[name]
    kind = class_of(name)
    family = getattr(kind, "uncertainty_from", "")
    if family not in _FAMILIES:
        allowed = ", ".join(map(repr, _FAMILIES))
        raise UsageError(f"backend {name!r} has uncertainty_from = {family!r}; allowed: {allowed}")
    return Entry(kind.__module__, kind.__qualname__, "", "", family)
