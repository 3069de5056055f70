"""The backends that exist, by name. Imports nothing: the command line knows the names before anything is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class Entry(NamedTuple):
    """The module and class of a backend, and its method and purpose for the README's table."""

    module: str
    """Imported only when the backend is used."""
    attribute: str
    method: str
    purpose: str


BACKENDS: Mapping[str, Entry] = MappingProxyType(
    {
        "lammps-granular": Entry(
            "dem_bridge.backends.lammps",
            "LammpsGranular",
            "LAMMPS, `pair_style granular`, velocity-Verlet",
            "the code under test, run in a child process",
        ),
        "lammps-table": Entry(
            "dem_bridge.backends.lammps",
            "LammpsTable",
            "LAMMPS, `pair_style table`, velocity-Verlet",
            "the same for other laws; with `tables=True` the twin interpolates the same tables (8e-9 of the force)",
        ),
        "verlet": Entry(
            "dem_bridge.backends.verlet",
            "Verlet",
            "velocity-Verlet in overlap variables (with `surrogate_radius`: in positions), compiled",
            "the algorithmic twin: LAMMPS - twin is implementation and round-off",
        ),
        "blanes-moan": Entry(
            "dem_bridge.backends.blanes_moan",
            "BlanesMoan",
            "symplectic Runge-Kutta-Nystroem method of order 4 (SRKN_6^b) in overlap variables, compiled",
            "velocities to 1e-6 of v0 for a quarter of velocity-Verlet's force evaluations",
        ),
        "reference": Entry(
            "dem_bridge.backends.reference",
            "Reference",
            "Taylor series through located, desingularised contacts, compiled; `scipy` where the series do not fit",
            "the reference of `verify`: its error is 3e-14 of v0 on the paper's chains, in 0.1 s",
        ),
        "scipy": Entry(
            "dem_bridge.backends.scipy_dop853",
            "ScipyDop853",
            "DOP853, restarted at located contact events",
            "the second reference, by an unrelated method",
        ),
        "ase": Entry(
            "dem_bridge.backends.ase_verlet",
            "AseVerlet",
            "velocity-Verlet of ASE",
            "an implementation by a third party: it agrees with the twin to 4e-12 of v0",
        ),
        "ode45": Entry(
            "dem_bridge.backends.ode45",
            "Ode45",
            "Dormand-Prince 5(4) with MATLAB's step control and default tolerances",
            "the paper's own method: its error is 3.6e-3 of v0",
        ),
        "bca": Entry(
            "dem_bridge.backends.bca",
            "BinaryCollisions",
            "binary collisions: other equations",
            "the paper's theory: a model difference, never PASS or FAIL",
        ),
        "adiabatic": Entry(
            "dem_bridge.backends.adiabatic",
            "AdiabaticWaves",
            "the exact solitary wave of each place, its energy followed: other equations",
            "the better theory of times, velocities and forces: a model difference, too",
        ),
    }
)

#: those that run LAMMPS, and are constructed with an Engine
ENGINE_BACKENDS = tuple(name for name in BACKENDS if name.startswith("lammps"))
