"""The backends that exist, by name. Imports nothing: the command line knows the names before anything is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

#: name -> (module, class); imported only when asked for
BACKENDS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "lammps-granular": ("dem_bridge.backends.lammps", "LammpsGranular"),
        "lammps-table": ("dem_bridge.backends.lammps", "LammpsTable"),
        "verlet": ("dem_bridge.backends.verlet", "Verlet"),
        "blanes-moan": ("dem_bridge.backends.blanes_moan", "BlanesMoan"),
        "reference": ("dem_bridge.backends.reference", "Reference"),
        "scipy": ("dem_bridge.backends.scipy_dop853", "ScipyDop853"),
        "ase": ("dem_bridge.backends.ase_verlet", "AseVerlet"),
        "ode45": ("dem_bridge.backends.ode45", "Ode45"),
        "bca": ("dem_bridge.backends.bca", "BinaryCollisions"),
        "adiabatic": ("dem_bridge.backends.adiabatic", "AdiabaticWaves"),
    }
)

#: those that run LAMMPS, and are constructed with an Engine
ENGINE_BACKENDS = tuple(name for name in BACKENDS if name.startswith("lammps"))
