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


def assert_judged(name: str, judgement: db.Judgement) -> None:
    """Orders within 0.05: the ratio of the errors at two steps is 2 to the order within 3 %; and the cause."""
    for quantity, order in CODES[name]["order"].items():
        assert judgement.order[quantity]["value"] == pytest.approx(order, abs=0.05), quantity
        assert judgement.order[quantity]["uncertainty"] < 0.05
    assert judgement.cause == CODES[name]["cause"]
    assert judgement.outcome == ("PASS" if judgement.cause == "none" else "FAIL")
    if judgement.cause == "half-step-velocity":  # the same numbers where the start has no acceleration
        assert judgement.alternative_causes == ["first-order-integrator"]


def files(name: str, scene: str) -> list[tuple[Path, float]]:
    """Files of a code in tests/data/foreign, with their time steps."""
    ending = "dump" if name == "liggghts" else "csv"
    return [(DATA / f"{name}.{scene}.{dt}.{ending}.gz", float(dt)) for dt in STEPS]


DEEP = pytest.mark.slow
FILES = [
    *("liggghts", "yade", "yade-shifted"),
    *(pytest.param(name, marks=DEEP) for name in ("kratos", "kratos-verlet", "openmm", "openmm-custom", "rebound")),
]


@pytest.mark.parametrize("scene", ["ten-beads", pytest.param("ten-beads-graded", marks=DEEP)])
@pytest.mark.parametrize("name", FILES)
def test_files_of_a_code_have_its_order_and_its_cause(name: str, scene: str) -> None:
    assert_judged(name, db.judge(files(name, scene), DATA / f"{scene}.toml"))


@DEEP
@pytest.mark.parametrize("name", ["yade", "kratos", "openmm"])
def test_one_file_of_a_half_step_code_is_enough_for_its_cause(name: str) -> None:
    judgement = db.judge(files(name, "ten-beads")[0], DATA / "ten-beads.toml")
    assert judgement.cause == "half-step-velocity"
    assert judgement.alternative_causes == ["first-order-integrator"]


@pytest.mark.slow
@pytest.mark.peers
@pytest.mark.parametrize("name", CODES)
def test_a_recipe_runs_and_has_its_order_and_its_cause(name: str) -> None:
    if reason := REPORT.missing(name):
        pytest.skip(f"{name} is {reason}")
    judgement = REPORT.judge(name, "ten-beads-graded")
    assert_judged(name, judgement)
    if name == "sundae":
        assert judgement.error["velocity"]["value"] < 1e-10  # 3e-12 was measured
