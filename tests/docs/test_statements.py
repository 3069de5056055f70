"""Statements of the documentation beside a script that measures them and imports nothing of the package."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "reports" / "independent" / "measure_statements.py"


@pytest.fixture(scope="module")
def numbers() -> dict[str, float]:
    """Return the committed numbers of the script."""
    result: dict[str, float] = json.loads(SCRIPT.with_name("statements.json").read_text(encoding="utf-8"))["numbers"]
    return result


def _page(name: str) -> str:
    return " ".join((ROOT / name).read_text(encoding="utf-8").split())


def test_condition_numbers_are_those_of_all_times(numbers: dict[str, float]) -> None:
    page = _page("docs/theory/order.md")
    for name in ("decelerating-40", "accelerating-40"):
        speed, stiffness = (numbers[f"{of}, {name}"] for of in ("d ln v0", "d ln beta"))
        assert f"{speed:.1f}, {stiffness:.1f} and {stiffness:.1f}" in page
    sampled = [numbers[f"{of} at 500 samples, accelerating-40"] for of in ("d ln v0", "d ln beta")]
    assert f"at its 500 samples {sampled[0]:.1f}, {sampled[1]:.1f} and {sampled[1]:.1f}" in page


def test_a_restitution_with_few_steps_errs_as_it_is_said(numbers: dict[str, float]) -> None:
    page = _page("docs/howto/restitution.md")
    for steps in (10, 100):
        assert f"{steps} steps" in page
        assert f"by up to {numbers[f'largest error of e with {steps} steps']:.1g}" in page
    assert f"({numbers['error of e = 0.5 with 100 steps, touch on a step']:.1g} for e = 0.5 only if the touch" in page


def test_both_forms_of_nesterenkos_formula_are_off_as_it_is_said(numbers: dict[str, float]) -> None:
    force, velocity = (
        100.0 * numbers[f"Nesterenko, {form} form over the exact wave, less 1"] for form in ("force", "velocity")
    )
    page = _page("docs/theory/collisions.md")
    assert f"{-force:.2f} % too low in its force form" in page
    assert f"{velocity:.2f} % too high in its velocity form" in page


def test_what_the_stiffness_law_changes_is_said_with_its_cylinders(numbers: dict[str, float]) -> None:
    first, inner = (
        max(abs(numbers[f"exact law, {which}, {name}"]) for name in ("decelerating-40", "accelerating-40"))
        for which in ("speed at cylinder 1", "largest from 5 to 37")
    )
    assert f"up to {100.0 * inner:.1g} % from cylinder 5 on ({100.0 * first:.0f} % at cylinder 1)" in _page("README.md")


def test_the_script_repeats_its_numbers_and_imports_nothing_of_the_package(
    tmp_path: Path, numbers: dict[str, float]
) -> None:
    text = SCRIPT.read_text(encoding="utf-8")
    assert not [line for line in text.splitlines() if line.startswith(("import dem_bridge", "from dem_bridge"))]
    subprocess.run([sys.executable, SCRIPT, tmp_path / "again.json"], check=True, timeout=120, capture_output=True)
    again = json.loads((tmp_path / "again.json").read_text(encoding="utf-8"))["numbers"]
    # its largest numbers are extremes of smooth functions; the smallest are differences of 1e-4 of a speed
    assert again == pytest.approx(numbers, rel=1e-6, abs=1e-9)
