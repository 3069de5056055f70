"""The code in a key: a change of a module makes the runs anew whose numbers pass through it, and no others."""

from __future__ import annotations

import importlib
import pickle
import shutil
import subprocess
import sys
from pathlib import Path
from types import FunctionType
from typing import Any, cast

import pytest

import dem_bridge as db
from dem_bridge.backends.catalogue import BACKENDS
from dem_bridge.foundation.compiled import Kernel
from dem_bridge.foundation.kernel_content import functions_of
from dem_bridge.runs import code
from dem_bridge.runs.campaign import identity
from dem_bridge.runs.code import (
    NOT_IN_RUNS,
    NOT_IN_STUDIES,
    PACKAGE,
    code_of_all,
    code_of_run,
    code_of_studies,
    code_without,
    is_within,
)
from tests.test_architecture import MODULES, _ours

#: (backend, with its uncertainty): all kinds of runs
RUNS = [(name, uncertainty) for name in BACKENDS for uncertainty in (False, True)]
#: a line for each file in the key of a run: the backends that have it, with "+" where only runs with uncertainty do
PINNED = Path(__file__).with_name("files_of_keys.txt")
LAMMPS = ("lammps-granular", "lammps-table")
#: modules that are imported for types only
FOR_TYPES = {name: {"dem_bridge.backends.steps"} for name in ("grazes", "moments")}
TWINS = (*LAMMPS, "verlet", "ase")


def pinned_text() -> str:
    """Return the content of :data:`PINNED` by the code as it is."""
    values, both = ({name: set(code_of_run(name, uncertainty=bars)) for name in BACKENDS} for bars in (False, True))
    assert all(values[name] <= both[name] for name in BACKENDS)
    return "".join(
        f"{file}: {' '.join(name + '+' * (file not in values[name]) for name in BACKENDS if file in both[name])}\n"
        for file in sorted(set().union(*both.values()))
    )


def _is_left_out(name: str) -> bool:
    return is_within(name.removeprefix("dem_bridge."), NOT_IN_RUNS)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the package whose files can be edited."""
    copy = tmp_path / "package"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "scenes"))
    return copy


def _forget() -> None:
    """Forget what was read from files, as a new process."""
    for function in vars(code).values():
        if hasattr(function, "cache_clear"):
            function.cache_clear()


def _now(package: Path) -> dict[tuple[str, bool] | str, str]:
    """Return the hash in the key of each kind of run, and of a study, as a new process would find it."""
    _forget()
    kinds: dict[tuple[str, bool] | str, str] = {
        "study": code.digest(code_of_studies(package)),
        "picture": code.digest(code_of_all(package)),
    }
    for name, bars in RUNS:
        kinds[name, bars] = code.digest(code_of_run(name, uncertainty=bars, package=package))
    return kinds


def _of(*backends: str, only_uncertainty: bool = False) -> set[tuple[str, bool] | str]:
    return {(name, bars) for name, bars in RUNS if name in backends and (bars or not only_uncertainty)}


EVERY = _of(*BACKENDS)
#: file -> the runs that a change of it makes anew
EDITS: dict[str, set[tuple[str, bool] | str]] = {
    "report/page.py": set(),
    "report/templates/study.html.j2": set(),
    "cli/terminal.py": set(),
    "cli/options.py": set(),
    "api/studies.py": set(),
    "verification/checks.py": set(),
    "judging/cause.py": set(),
    "foundation/notebook.py": set(),
    "runs/campaign/run.py": set(),
    "runs/store.py": set(),
    "runs/keys.py": set(),
    "backends/taylor.py": _of("reference"),
    "backends/taylor_components.py": _of("reference"),
    "backends/taylor_series.py": _of("reference"),
    "backends/blanes_moan.py": _of("blanes-moan"),
    "backends/dormand_prince.py": _of("ode45"),
    "backends/bca.py": _of("bca", "adiabatic"),
    "backends/ase_verlet.py": _of("ase"),
    "backends/scipy_kernels.py": _of("scipy", "reference"),
    "backends/scipy_step.py": _of("scipy", "reference"),
    # where the laws dissipate, the prescan of all codes with a fixed step but ASE's is a run of the twin
    "backends/twin.py": _of("verlet", "blanes-moan", *LAMMPS) | _of("ase", only_uncertainty=True),
    "lmp/deck.template": _of(*LAMMPS),
    "lmp/worker.py": _of(*LAMMPS),
    "runs/uncertainty/from_twins.py": _of(*TWINS, only_uncertainty=True),
    "runs/uncertainty/from_own_steps.py": _of("blanes-moan", only_uncertainty=True),
    "runs/uncertainty/from_replicas.py": _of("reference", "scipy", "ode45", only_uncertainty=True),
    # the reference answers through scipy where its series do not fit
    "runs/uncertainty/from_looser_runs.py": _of("reference", "scipy", only_uncertainty=True),
    "physics/hertz.py": EVERY,
    "scene/scene.py": EVERY,
    "studies/pages/claims.toml": set(),
}


def test_a_change_makes_the_runs_anew_whose_numbers_pass_through_it_and_no_others(package: Path) -> None:
    before = _now(package)
    for name, anew in EDITS.items():
        if name.startswith("studies/"):  # the last of them
            pytest.importorskip("dem_bridge.studies")
        file = package / name
        text = file.read_text(encoding="utf-8")
        file.write_text(f"{text}\n# another line")
        after = _now(package)
        file.write_text(text)
        changed = {kind for kind, value in after.items() if value != before[kind]}
        assert changed - {"study", "picture"} == anew, name
        of_studies = not is_within(name.rpartition(".")[0].replace("/", "."), NOT_IN_STUDIES)
        assert ("study" in changed) == of_studies, name
        assert "picture" in changed, name
    _forget()


def test_a_module_that_a_kernel_begins_to_import_is_in_its_key(package: Path) -> None:
    # within a function and over several lines, too
    (package / "backends" / "new.py").write_text("")
    file = package / "backends" / "bca.py"
    file.write_text(file.read_text() + "\ndef f():\n    from dem_bridge.backends import (\n        new,\n    )\n")
    _forget()
    assert "backends/new.py" in code_of_run("bca", uncertainty=False, package=package)
    assert "backends/new.py" not in code_of_run("ode45", uncertainty=False, package=package)
    _forget()


@pytest.mark.parametrize(("backend", "uncertainty"), RUNS)
def test_the_imports_read_from_the_text_are_those_of_the_parser(backend: str, uncertainty: bool) -> None:
    entry = BACKENDS[backend]
    wanted = [entry.module, *([code.rule_of(backend)] if uncertainty and entry.uncertainty else [])]
    passed: set[str] = set()
    while wanted:
        if (name := wanted.pop()) not in passed:
            passed.add(name)
            if name != "dem_bridge.backends.base":  # it imports the engine for types only
                more = _ours(name) - {"dem_bridge"} - FOR_TYPES.get(name.rpartition(".")[2], set())
                wanted += [other for other in more if not _is_left_out(other)]
    files = {MODULES[name].relative_to(PACKAGE).as_posix() for name in passed}
    assert files <= set(code_of_run(backend, uncertainty=uncertainty)) | {"scene/drive.py", "lmp/engine.py"}


def test_every_rule_that_the_choice_of_a_rule_imports_is_in_a_key() -> None:
    keys = {file for name in BACKENDS for file in code_of_run(name, uncertainty=True)}
    rules = {name for name in _ours(f"dem_bridge.{code._RULES}.{code._SELECTS}") if f".{code._RULES}." in name}
    assert len(rules) > 4
    assert {MODULES[name].relative_to(PACKAGE).as_posix() for name in rules} <= keys


@pytest.mark.parametrize("part", sorted({*NOT_IN_RUNS, *NOT_IN_STUDIES}))
def test_the_parts_that_are_left_out_exist(part: str) -> None:
    if part == "studies":
        pytest.importorskip("dem_bridge.studies")
    assert f"dem_bridge.{part}" in MODULES or (PACKAGE / part.replace(".", "/")).is_dir()


def test_the_modules_in_the_keys_of_each_backend_are_those_that_were_agreed() -> None:
    # a module that moves to another folder, or is left out by mistake, would vanish from keys in silence
    assert pinned_text() == PINNED.read_text(encoding="utf-8"), f"if intended: python -m {__name__}"


def test_the_code_of_workers_has_what_campaigns_and_ensembles_use_and_all_that_runs_have() -> None:
    workers = code_without(tuple(part for part in NOT_IN_RUNS if not is_within(part, identity.IN_WORKERS)))
    for name in ("runs/keys.py", "runs/campaign/tasks.py", "ensembles/solve.py"):
        assert name in workers
    for name, uncertainty in RUNS:
        assert set(code_of_run(name, uncertainty=uncertainty)) <= set(workers)
    assert not any(name.startswith(("report/", "cli/", "studies/")) for name in workers)


RUN = """
import pickle, sys
from dem_bridge.backends.base import backend, Resolution, Sampling
name, scene = sys.argv[1], pickle.loads(bytes.fromhex(sys.argv[2]))  # the reader of scene files is not imported here
backend(name).run(scene, Resolution(), Sampling(count=1))
print(*sorted(name for name in sys.modules if name.startswith("dem_bridge.")))
"""


@pytest.mark.slow
@pytest.mark.lammps
@pytest.mark.parametrize("backend", BACKENDS)
def test_what_a_process_imports_for_a_run_is_in_the_key(backend: str) -> None:
    words = [sys.executable, "-c", RUN, backend, pickle.dumps(db.load_scene("dimer-1-1")).hex()]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    names = [name for name in done.stdout.split() if not _is_left_out(name)]
    files = {MODULES[name].relative_to(PACKAGE).as_posix() for name in names}
    assert "scene/scene.py" in files
    assert files - set(code_of_run(backend, uncertainty=False)) <= {"foundation/leftovers.py", "version.py"}


def test_the_key_of_a_run_has_all_that_its_kernels_are_compiled_from() -> None:
    checked = set()
    for name, uncertainty in RUNS:
        files = set(code_of_run(name, uncertainty=uncertainty))
        for file in (file for file in files if "@kernel(" in (PACKAGE / file).read_text(encoding="utf-8")):
            module = importlib.import_module(".".join(("dem_bridge", *Path(file).with_suffix("").parts)))
            kernels: list[Any] = [value for value in vars(module).values() if isinstance(value, Kernel)]
            for kernel in kernels:
                for function in functions_of(cast(FunctionType, kernel.py_func)):
                    source = Path(function.__code__.co_filename).relative_to(PACKAGE).as_posix()
                    assert source in files, (name, file, source)
                    checked.add((name, source))
    assert len(checked) > 20


if __name__ == "__main__":
    PINNED.write_text(pinned_text(), encoding="utf-8")


def test_sources_are_the_code_and_its_data_without_scenes_and_compiled_files(tmp_path: Path) -> None:
    names = ("a.py", "b/c.py", "b/d.toml", "b/scenes/e.toml", "f.j2", "g.json", "h.template")
    others = ("scenes/a.toml", "scenes/b/c.py", "__pycache__/a.py", "b/__pycache__/d.json", "i.txt", "j.pyc")
    for name in (*names, *others):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert code.sources(tmp_path) == tuple(sorted(tmp_path / name for name in names))
