"""The matrix of machines: a control of last digits is caught, and what a machine does not take is skipped."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.move_pins import machines, quality

ROOT = Path(__file__).parent.parent

#: a control of the old kind: it demands that the sum of 3,000 powers is wrong by the very digits that it has here
WAITS_FOR_DIGITS = """\
import hashlib, math, struct

def test_last_digits():
    digits = [math.pow(1.0 + k / 3000.0, 1.7) for k in range(3000)]
    assert hashlib.sha256(struct.pack("3000d", *digits)).hexdigest() == {digest!r}

def test_digits_that_count():
    assert abs(math.pow(2.0, 0.5) - 1.4142135623730951) < 1e-15
"""


def _digest() -> str:
    text = WAITS_FOR_DIGITS.format(digest="").replace("assert", "return", 1).replace(" == ''", "")
    names: dict[str, object] = {}
    exec(text, names)
    found = names["test_last_digits"]
    assert callable(found)
    return str(found())


@pytest.fixture(scope="module")
def here() -> dict[str, Any]:
    found = machines.child_probe({})
    assert found["complaint"] == ""
    return found


def test_a_test_that_waits_for_last_digits_fails_on_another_machine(
    here: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = {each.name: each for each in machines.settings(here["features"], machines.build_libm(tmp_path))}
    if chosen["libm-1"].lacks:
        pytest.skip(chosen["libm-1"].lacks)
    (tmp_path / "test_planted.py").write_text(WAITS_FOR_DIGITS.format(digest=_digest()), encoding="utf-8")
    (tmp_path / "pytest.ini").touch()
    monkeypatch.setattr(machines, "PREPARE", ())
    plain, other = (machines.try_setting(chosen[name], [str(tmp_path)], tmp_path, here) for name in ("plain", "libm-1"))
    assert (plain.passed, plain.failures, plain.changed) == (2, (), ())
    assert (other.passed, other.failures) == (1, ("test_planted::test_last_digits",))
    assert "libm" in other.changed
    assert other.cpu > 0.0


@pytest.mark.parametrize(
    ("variables", "changes", "reason"),
    [
        ({"NPY_DISABLE_CPU_FEATURES": "ABACUS"}, (), "ABACUS"),
        ({"NUMBA_CPU_NAME": "abacus"}, (), "not a recognized processor"),
        ({"LD_PRELOAD": "/nowhere/libm.so"}, ("libm",), "/nowhere/libm.so"),
        ({"PYTHONHASHSEED": "1"}, ("libm", "dot"), "it changes no digit of libm or dot here"),
    ],
)
def test_a_setting_that_is_not_taken_is_skipped_with_the_reason(
    variables: dict[str, str], changes: tuple[str, ...], reason: str, here: dict[str, Any], tmp_path: Path
) -> None:
    outcome = machines.try_setting(machines.Setting("odd", "odd", variables, changes), [str(tmp_path)], tmp_path, here)
    assert reason in outcome.reason
    assert list(tmp_path.iterdir()) == []


def test_settings_that_were_run_are_not_run_again_until_the_code_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[str] = []

    def run(setting: machines.Setting, *_: object) -> machines.Outcome:
        ran.append(setting.name)
        return machines.Outcome(passed=3, failures=("t::a",) if setting.name == "numba" else ())

    monkeypatch.setattr(machines, "try_setting", run)
    options = argparse.Namespace(folder=tmp_path, fresh=False, whole=False, check=True)
    here = {"processor": "abacus", "libc": "none", "versions": "1"}
    chosen = [each for each in machines.settings([], "") if each.name in ("plain", "numba")]
    for _ in range(2):
        assert machines.run_matrix(chosen, options, here) == 1
    assert ran == ["plain", "numba", "numba"]  # what failed is run again
    monkeypatch.setattr(machines, "code_digest", lambda: "another")
    assert machines.run_matrix(chosen[:1], options, here) == 0
    options.fresh = True
    assert machines.run_matrix(chosen[:1], options, here) == 0
    assert ran[3:] == ["plain", "plain"]


def test_every_row_is_that_of_a_setting_and_ci_runs_one() -> None:
    table = (
        quality.PAGE.read_text(encoding="utf-8").partition("<!-- machines: ")[2].partition("<!-- end of machines")[0]
    )
    titles = {each.name: each.title for each in machines.settings(["X86_V3", "X86_V4"], "")}
    rows = {
        row.partition(" | ")[0].removesuffix(" (whole suite)")
        for row in re.findall(r"^\| (.*) \|$", table, re.MULTILINE)
    }
    assert rows - {"setting"} <= set(titles.values())
    [named] = re.findall(r"make machines ARGS=\"--setting (\S+) --check --fresh\"", (ROOT / ".ci/run").read_text())
    assert titles[named] in rows
    assert set(machines.WHOLE) <= set(titles)
    assert all((ROOT / target).exists() for target in machines.DIGITS)
