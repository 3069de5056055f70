"""What ``import dem_bridge as db`` offers: every name is there, is documented, and is what it is called."""

from __future__ import annotations

import inspect
import pkgutil
import subprocess
import sys
from importlib import import_module
from types import ModuleType

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
