"""Hash the code that determines a result: the modules that its numbers pass through, and no others.

The modules of a run are those that its backend imports, directly or through others, and with an uncertainty those of
its family or rule as well. Imports are read from the text, so that nothing is imported. Modules that schedule, keep or
show runs are left out. Values that a study reads from runs depend on the whole package but for the parts that show.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import time
from collections.abc import Callable, Iterable, Mapping
from functools import cache, partial
from pathlib import Path

from dem_bridge.backends.catalogue import BACKENDS, entry_of
from dem_bridge.foundation.leftovers import started

PACKAGE = Path(__file__).parents[1]
#: modules, and folders of them, that schedule, keep, judge or show runs: no number of a trajectory passes through them.
#: What is not listed is in the keys of all runs that import it, wherever it lives
NOT_IN_RUNS = (
    "api", "cli", "ensembles", "formats", "foundation.guests", "foundation.notebook",
    "foundation.presenters", "foundation.wording", "judging", "observables.differences", "observables.verdict", "plot",
    "report", "runs.cache", "runs.campaign", "runs.case", "runs.code", "runs.costs", "runs.digits", "runs.inspect",
    "runs.keys", "runs.locks", "runs.planning", "runs.recall", "runs.store", "studies", "trajectory.shown",
    "verification",
)  # fmt: skip
#: modules, and folders of them, that no number of a study passes through
NOT_IN_STUDIES = (
    "api", "cli", "formats.tables", "formats.writers", "foundation.notebook", "foundation.presenters",
    "foundation.wording", "plot", "report.styles", "report.drawing", "report.drawing_names", "report.drawing_styles",
    "report.drawer", "report.images", "report.live", "report.page", "report.svg", "report.templates",
    "runs.campaign.cluster", "trajectory.shown", "verification.banner", "verification.bundle", "verification.chains",
    "verification.figures", "verification.page", "verification.pictures", "verification.records",
    "verification.regression", "verification.replay", "verification.templates",
)  # fmt: skip
#: folder of the rules of uncertainties, and the module there that selects the family or rule of each backend, which the
#: catalogue names: its imports are those of all backends
_RULES, _SELECTS = "runs.uncertainty", "estimate"
#: files of the package that are code, or texts and tables in place of code
_DATA = (".template", ".toml", ".json", ".j2")
_OURS = "dem_bridge."
_FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+.*\n|\n)*", re.MULTILINE)
_IMPORT = re.compile(r"^[ \t]*(?:from (\S+) import (\([^)]*\)|.*)|import (\S+))", re.MULTILINE)
#: the name of a file
_QUOTED = re.compile(r'"(\w[\w.-]*\.[a-z0-9]+)"')


@cache
def code_of_run(backend: str, *, uncertainty: bool, package: Path = PACKAGE) -> Mapping[str, str]:
    """Return the files that a run of a backend depends on, with the first 12 digits of their sha256."""
    entry = entry_of(backend)
    foreign = {} if backend in BACKENDS else _foreign_files(entry.module)
    modules = [entry.module] if backend in BACKENDS else _ours_in(foreign.values(), package)
    modules = [*reached(modules, imports := partial(_imports, package=package))]
    if uncertainty and entry.uncertainty:
        # a backend may answer through another one, whose rule then applies
        rules = {rule_of(name) for name, other in BACKENDS.items() if other.module in modules and other.uncertainty}
        modules = [*reached([*modules, _rule(_SELECTS), rule_of(backend), *rules], imports)]
    files: set[Path] = set()
    for module in modules:
        file = file_of_module(module, package)
        assert file is not None  # a closure has modules of the package only
        files |= {file, *_named_in(file)}
    return {**_hashes(files, package), **{name: _hash(file) for name, file in sorted(foreign.items())}}


def _foreign_files(module: str) -> dict[str, Path]:
    """Return the code and data of the top package (or the one file) of a module of another distribution, by name."""
    top = module.partition(".")[0]
    spec = importlib.util.find_spec(top)
    assert spec is not None  # the backend was imported from it
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    if not folders:
        return {f"{top}.py": Path(str(spec.origin))}
    return {
        f"{top}/{file.relative_to(folder).as_posix()}": file
        for folder in folders
        for file in folder.rglob("*")
        if file.is_file() and file.suffix != ".pyc"
    }


def _ours_in(files: Iterable[Path], package: Path) -> list[str]:
    """Return the modules of this package that files of another distribution import."""
    texts = [file.read_text(encoding="utf-8") for file in files if file.suffix == ".py"]
    return [name for text in texts for name in imported_names(text) if _counts(name, package)]


def rule_of(backend: str) -> str:
    """Return the module with the rule from which the uncertainty of a backend follows."""
    return _rule(f"from_{entry_of(backend).uncertainty}")


def _rule(name: str) -> str:
    """Return the module of a name in the folder of the rules."""
    return f"{_OURS}{_RULES}.{name}"


@cache
def code_of_studies(package: Path = PACKAGE) -> Mapping[str, str]:
    """Return the files that a value read from runs may depend on, with the first 12 digits of their sha256."""
    return code_without(NOT_IN_STUDIES, package)


def code_without(parts: tuple[str, ...], package: Path = PACKAGE) -> Mapping[str, str]:
    """Return the files of the package outside some modules and folders, with the first 12 digits of their sha256."""
    return _hashes((file for file in sources(package) if not is_within(_name(file, package), parts)), package)


def is_within(name: str, parts: Iterable[str]) -> bool:
    """Return True if a module, named without the package, is one of ``parts`` or in one of them.

    >>> is_within("runs.store", ("runs",)), is_within("runs_of_others", ("runs",))
    (True, False)
    """
    return f"{name}.".startswith(tuple([f"{part}." for part in parts]))


@cache
def code_of_all(package: Path = PACKAGE) -> Mapping[str, str]:
    """Return all files of the package that are code, with the first 12 digits of their sha256."""
    return _hashes(sources(package), package)


@cache
def sources(package: Path = PACKAGE) -> tuple[Path, ...]:
    """Return the modules, templates, texts and tables of the package, without the shipped scenes."""
    scenes, files = package / "scenes", list[Path]()  # scenes have keys of their own
    for folder, folders, names in os.walk(package):
        # a folder of compiled files has a thousand of them
        folders[:] = [name for name in folders if name != "__pycache__" and Path(folder, name) != scenes]
        files += [Path(folder, name) for name in names if name.endswith((".py", *_DATA))]
    return tuple(sorted(files))


def changed_since_start(package: Path = PACKAGE) -> bool:
    """Return True if a file of the package is younger than this process."""
    # the time of change and not of the text: a copy of an older file is a change, too
    return max(os.stat(file).st_ctime for file in _paths(package)) > process_start()


@cache
def _paths(package: Path) -> tuple[str, ...]:
    """Return :func:`sources` as texts, which are looked up several times as fast."""
    return tuple(map(str, sources(package)))


@cache
def process_start() -> float:
    """Return when this process began, s since the epoch: the end of that tick, before any import of this package."""
    ticks = started(os.getpid()) + 1
    return time.time() - time.clock_gettime(time.CLOCK_BOOTTIME) + ticks / os.sysconf("SC_CLK_TCK")


def digest(code: Mapping[str, str]) -> str:
    """Return one sha256 for the hashes of files."""
    return hashlib.sha256(repr(sorted(code.items())).encode()).hexdigest()


def reached(modules: Iterable[str], imports: Callable[[str], Iterable[str]]) -> set[str]:
    """Return modules with all that they import, directly or through others.

    >>> sorted(reached(["a"], {"a": "bc", "b": "d", "c": "a", "d": ""}.__getitem__))
    ['a', 'b', 'c', 'd']
    """
    waiting, found = list(modules), set[str]()
    while waiting:
        if (module := waiting.pop()) not in found:
            found.add(module)
            waiting += imports(module)
    return found


@cache
def _imports(module: str, package: Path) -> frozenset[str]:
    """Return the modules of the package that a module imports, also within functions, and the folder that has it."""
    file = file_of_module(module, package)
    assert file is not None
    names = {module.rpartition(".")[0]}
    if module != _rule(_SELECTS):
        names |= imported_names(file.read_text(encoding="utf-8"))
    return frozenset(name for name in names if _counts(name, package))


def imported_names(text: str) -> set[str]:
    """Return the modules and names that the text of a module imports, within functions too, but not for types alone.

    >>> sorted(imported_names("from dem_bridge.lmp import deck, engine"))
    ['', 'dem_bridge.lmp', 'dem_bridge.lmp.deck', 'dem_bridge.lmp.engine']
    """
    found = _IMPORT.findall(_FOR_TYPES.sub("", text))
    return {part for source, items, name in found for part in (name, source, *_joined(source, items))}


def _joined(source: str, items: str) -> list[str]:
    """Return the dotted names of what is imported from a module."""
    return [f"{source}.{item}" for item in re.findall(r"\w+", items)]


@cache
def _counts(name: str, package: Path) -> bool:
    """Return True for a module of the package that numbers of a run may pass through."""
    inner = name.startswith(_OURS) and not is_within(name.removeprefix(_OURS), NOT_IN_RUNS)
    return inner and file_of_module(name, package) is not None


@cache
def file_of_module(module: str, package: Path = PACKAGE) -> Path | None:
    """Return the file of a module of the package; None if there is none."""
    place = package.joinpath(*module.split(".")[1:])
    return next((file for file in (place.with_suffix(".py"), place / "__init__.py") if file.is_file()), None)


@cache
def _named_in(file: Path) -> frozenset[Path]:
    """Return the files in the folder of a module that its text names: data, and scripts that it starts."""
    names = set(_QUOTED.findall(file.read_text(encoding="utf-8")))
    return frozenset(path for name in names if (path := file.with_name(name)).is_file())


def _name(file: Path, package: Path) -> str:
    """Return the name of the module that a file is, or that it would be if it were one, without the package."""
    return os.path.splitext(_place(file, package))[0].replace("/", ".").removesuffix(".__init__")


def _place(file: Path, package: Path) -> str:
    """Return the path of a file within the package."""
    return str(file).removeprefix(f"{package}/")


def _hashes(files: Iterable[Path], package: Path) -> dict[str, str]:
    """Return the first 12 digits of the sha256 of each file, by its path within the package."""
    return dict(sorted((_place(file, package), _hash(file)) for file in files))


@cache
def _hash(file: Path) -> str:
    """Return the first 12 digits of the sha256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:12]
