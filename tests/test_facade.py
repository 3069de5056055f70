"""Every public name of ``import dem_bridge as db`` is there, is documented, and is what it is called."""

from __future__ import annotations

import inspect
import pkgutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import dem_bridge as db

PUBLIC = sorted(set(db.__all__) - {"__version__"})


def test_all_names_are_sorted_and_completed() -> None:
    assert list(db.__all__) == sorted(db.__all__)
    assert set(db.__all__) <= set(dir(db))


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_is_there_and_documented(name: str) -> None:
    assert inspect.getdoc(getattr(db, name))


def test_the_names_of_the_contract_are_public() -> None:
    assert {
        "Engine", "Plan", "Resolution", "Study", "Verification", "available", "compare", "errors", "load_scene",
        "load_trajectory", "observed_order", "plan", "solve", "study", "verify",
    } <= set(PUBLIC)  # fmt: skip


def test_no_module_of_the_package_takes_the_name_of_a_public_function() -> None:
    # an imported submodule becomes an attribute of its package, and would hide a function of the same name
    functions = {name for name in PUBLIC if not isinstance(getattr(db, name), ModuleType)}
    modules = {module.name for module in pkgutil.iter_modules(db.__path__)}
    assert not functions & modules


def test_a_public_name_is_the_same_before_and_after_its_modules_are_imported() -> None:
    before = {name: getattr(db, name) for name in PUBLIC}
    for module in pkgutil.iter_modules(db.__path__):
        import_module(f"dem_bridge.{module.name}")
    assert {name: getattr(db, name) for name in PUBLIC} == before


def test_the_first_import_offers_all_names_and_loads_no_numpy() -> None:
    code = (
        "import sys, dem_bridge as db; print('numpy' in sys.modules, 'solve' in dir(db), db.errors.UsageError.__name__)"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert answer.split() == ["False", "True", "UsageError"]


PAIR = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)


@pytest.mark.parametrize("name", [name for name in db.__all__ if isinstance(getattr(db, name), ModuleType)])
def test_a_public_module_is_there_when_nothing_else_is_imported(name: str) -> None:
    code = f"import dem_bridge as db; print(db.{name}.__doc__[:1])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip(), done.stderr


def test_solve_names_its_settings_in_its_signature() -> None:
    solve = inspect.signature(db.solve).parameters
    settings = {field.name for field in fields(db.Resolution)} - {"bars"}
    engine = {"lmp", "lmp_args", "python", "ranks"}
    assert settings | engine | {"engine", "backend", "accuracy", "order", "samples", "uncertainty"} <= set(solve)
    for name in settings:  # the defaults stand in two places
        assert solve[name].default == getattr(db.Resolution(), name), name


@pytest.mark.parametrize("function", [db.solve, db.verify, db.study, db.regress])
def test_an_engine_may_be_named_beside_its_four_settings(function: Callable[..., Any]) -> None:
    assert {"engine", "lmp", "lmp_args", "python", "ranks"} <= set(inspect.signature(function).parameters)


def test_an_engine_and_one_of_its_settings_are_not_both_given() -> None:
    with pytest.raises(db.errors.UsageError, match="engine and ranks are both given; give one of them"):
        db.solve(PAIR, backend="lammps-granular", engine=db.Engine(), ranks=2)
    with pytest.raises(db.errors.UsageError, match=r"engine = 'lmp'; allowed: an Engine"):
        db.verify(PAIR, engine="lmp")  # type: ignore[arg-type]


def test_a_keyword_that_solve_does_not_have_is_refused_with_those_that_it_has() -> None:
    with pytest.raises(db.errors.UsageError, match="setting 'stepsize' is unknown; allowed: backend, dt, "):
        db.solve(PAIR, backend="verlet", stepsize=1e-7)


def test_a_printed_run_is_ten_lines_with_its_uncertainties() -> None:
    run = db.solve(PAIR, backend="verlet", dt=1e-6)
    lines = str(run).splitlines()
    assert len(lines) == 10
    assert lines[0] == "Trajectory of pair"
    assert "verlet" in lines[1]
    [velocity] = [line for line in lines if line.startswith("  velocity")]
    assert f"uncertainty {1e3 * run.uncertainty['velocity']:.2g} mm/s" in velocity


@pytest.mark.slow
@pytest.mark.lammps
def test_a_verification_has_a_table_and_can_be_saved(tmp_path: Path) -> None:
    found = db.verify(PAIR, accuracy=1e-3, jobs=1, store=False)
    table = found.table()
    assert len(table) == len(found.verdicts)
    assert list(table.outcome) == [verdict.outcome for verdict in found.verdicts]
    found.save(tmp_path / "report")
    assert {file.name for file in (tmp_path / "report").iterdir()} == {"index.html", "verdicts.json", "tables"}


def test_the_directory_of_the_package_has_the_public_names_alone() -> None:
    assert dir(db) == list(db.__all__)


def test_the_package_is_a_program(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dem_bridge", "--version"], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout.strip() == f"dem-bridge, version {db.__version__}"
