"""Real codes: files of LIGGGHTS, YADE, Kratos, OpenMM and REBOUND, and recipes where the codes are installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import dem_bridge as db

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data" / "foreign"
STEPS = ("1e-7", "5e-8", "2.5e-8")


def _report() -> ModuleType:
    """The script that writes docs/peers.md."""
    spec = importlib.util.spec_from_file_location("report", ROOT / "docs" / "recipes" / "report.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


REPORT = _report()
CODES: dict[str, dict[str, Any]] = REPORT.CODES


def assert_orders(name: str, judgement: db.Judgement) -> None:
    """Orders within 0.05, as asked: three steps whose ratio of errors is 2 to the order within 3 %."""
    for quantity, order in CODES[name]["order"].items():
        assert judgement.order[quantity]["value"] == pytest.approx(order, abs=0.05), quantity
        assert judgement.order[quantity]["uncertainty"] < 0.05


def files(name: str, scene: str) -> list[tuple[Path, float]]:
    """Files of a code in tests/data/foreign, with their time steps."""
    ending = "dump" if name == "liggghts" else "csv"
    return [(DATA / f"{name}.{scene}.{dt}.{ending}.gz", float(dt)) for dt in STEPS]


@pytest.mark.parametrize("name", ["liggghts", "yade", "yade-shifted", "kratos", "kratos-verlet", "openmm", "rebound"])
def test_files_of_a_code_have_its_order(name: str) -> None:
    judgement = db.judge(files(name, "ten-beads"), DATA / "ten-beads.toml")
    assert_orders(name, judgement)


@pytest.mark.slow
@pytest.mark.peers
@pytest.mark.parametrize("name", CODES)
def test_a_recipe_runs_and_has_its_order(name: str) -> None:
    if reason := REPORT.missing(name):
        pytest.skip(f"{name} is {reason}")
    judgement = REPORT.judge(name, "ten-beads-graded")
    assert_orders(name, judgement)
    if name == "sundae":
        assert judgement.error["velocity"]["value"] < 1e-10  # 3e-12 was measured
