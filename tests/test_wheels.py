"""Files of a release: what the wheel must have, where it is tried, and the table of the page."""

from __future__ import annotations

import doctest
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.helpers.move_pins import coverage_table, faults, machines, mutate, quality, wheels

ROOT = Path(__file__).parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WORKFLOW = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
CONTAINER = (ROOT / "Containerfile").read_text(encoding="utf-8")


@pytest.mark.parametrize("module", [coverage_table, faults, machines, mutate, quality, wheels])
def test_the_examples_of_the_programs(module: object) -> None:
    result = doctest.testmod(module)  # type: ignore[arg-type]
    assert (result.failed, result.attempted > 0) == (0, True)


def test_a_release_without_a_scene_or_with_caches_and_data_is_caught() -> None:
    package = {"dem_bridge/py.typed", "dem_bridge/scenes/a.toml"}
    beside = {"docs/x.md", "README.md", "PKG-INFO"}
    assert wheels.wrong_contents(package | {"dem_bridge-0.1.dist-info/RECORD"}, package | beside, package) == []
    assert wheels.wrong_contents(package - {"dem_bridge/py.typed"}, package, package) == [
        "wheel: no dem_bridge/py.typed"
    ]
    for more in ("tests/data/big.npz", ".venv/bin/python", "dem_bridge/__pycache__/a.pyc"):
        assert wheels.wrong_contents(package, package | beside | {more}, package) == [f"sdist: {more}"]


def test_a_table_keeps_rows_that_were_not_measured_again_and_must_be_there() -> None:
    page = quality.PAGE.read_text(encoding="utf-8")
    assert quality.with_rows(page, "wheels", []) == page
    assert "\n| 3.99.0 | x |\n<!-- end of wheels -->" in quality.with_rows(page, "wheels", [("3.99.0", "x")])
    with pytest.raises(SystemExit, match="no table 'wheel'"):
        quality.with_rows(page, "wheel", [])


def test_the_workflow_runs_what_developers_run_on_every_python_that_is_promised() -> None:
    promised = re.findall(r"Python :: (3\.\d+)", " ".join(PYPROJECT["project"]["classifiers"]))
    assert promised[0] == PYPROJECT["project"]["requires-python"].removeprefix(">=")
    quoted = ", ".join(f'"{version}"' for version in promised)
    assert f"python: [{quoted}]" in WORKFLOW
    assert "run: bash .ci/run" in WORKFLOW
    # a version, never a branch that moves
    for action in re.findall(r"uses: (\S+)", WORKFLOW):
        assert re.fullmatch(r"actions/[a-z-]+@v\d+\.\d+\.\d+", action)
    measured = set(re.findall(r"^\| (3\.\d+)\.\d+ \|", quality.PAGE.read_text(encoding="utf-8"), re.MULTILINE))
    assert set(promised) <= measured


def test_the_container_has_all_files_that_a_build_needs() -> None:
    for name in re.findall(r"^COPY (?!--)(.+) \S+$", CONTAINER, re.MULTILINE):
        assert all((ROOT / part).exists() for part in name.split())
    project = PYPROJECT["project"]
    needed = {"pyproject.toml", project["readme"], *project["license-files"], "dem_bridge", "constraints.txt"}
    assert needed <= set(" ".join(re.findall(r"^COPY (.+)$", CONTAINER, re.MULTILINE)).split())


def test_the_sample_of_faults_is_the_same_every_time_and_changes_one_line_each() -> None:
    chosen = faults.sample(8, seed=3)
    assert chosen.items() <= faults.sample(12, seed=3).items()
    assert chosen != faults.sample(8, seed=4)
    for number, fault in chosen.items():
        assert fault.before != fault.after
        assert faults.sample(8, 3, files=[fault.file])[number] == fault


@pytest.mark.studies  # one part is theirs
def test_every_part_in_which_faults_are_planted_has_sources_and_tests() -> None:
    parts = [part for group in faults.GROUPS.values() for part in group]
    assert sorted(parts) == sorted(mutate.TESTS)
    files = [file for group in faults.GROUPS for file in faults.targets(group)]
    assert len(files) == len(set(files))
    assert all((ROOT / file).is_file() for file in files)
    assert all((ROOT / test).exists() for tests in mutate.TESTS.values() for test in tests)
    assert {fault.file for fault in faults.sample(8, 3, "services").values()} <= set(faults.targets("services"))
    assert faults.targets("services", "measurement") == sorted(file for file in files if "/measurement/" in file)


#: a number in the source, and what sees it when it is doubled: a function, another module's name for a constant, the
#: default of an argument and that of a field of a class or of a named tuple
PLANTED = (
    (
        "physics/contact_ellipse.py",
        "mean, geometric, term, weight, share",
        "0.5",
        "contact_ellipse.ellipse_integrals(0.5)",
    ),
    ("judging/fitting.py", "TOLERANCE_OF_SEARCH, TOLERANCE_OF_DECISION = ", "1e-13", "search.TOLERANCE_OF_DECISION"),
    (
        "physics/damped_impact.py",
        "def restitution_of_alpha",
        "2.5",
        "impact.restitution_of_alpha(0.1, clip=True)",
    ),
    ("judging/hypotheses.py", "reach: float", "1.5", "hypotheses.Hypothesis('', float, '').reach"),
    ("judging/hypotheses.py", "scale: float", "1.0", "hypotheses.Variant(None).scale"),
)


@pytest.mark.parametrize(("file", "line", "number", "seen"), PLANTED)
def test_a_planted_fault_is_seen_by_all_that_use_it(file: str, line: str, number: str, seen: str) -> None:
    program = f"""
import ast, sys
sys.path[:0] = [".ci", "."]
import faults
from dem_bridge.judging import hypotheses, search
from dem_bridge.physics import contact_ellipse, damped_impact as impact
file = "dem_bridge/{file}"
text = open(file).read()
place = next(k for k, words in enumerate(text.splitlines(), start=1) if {line!r} in words)
index = next(
    k for k, (node, *_) in enumerate(faults.changes(ast.parse(text)))
    if isinstance(node, ast.Constant) and node.value == {number} and node.lineno == place
)
before = {seen}
faults.plant(faults.Mutant(file, index, place, "", ""), faults.Live())
print(before, {seen})
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    before, after = done.stdout.replace("(", "").replace(")", "").split(" ", 1)
    assert before not in after, done.stderr


def test_kernels_that_have_inlined_a_changed_one_are_compiled_again() -> None:
    program = """
import sys
sys.path[:0] = [".ci", "."]
import faults
from dem_bridge.ensembles import damped, lanes, pair
from dem_bridge.judging import kernels
live = faults.Live()
print(sorted({f"{kernel.__module__}.{kernel.__name__}" for kernel in live.callers([pair.contact_force])}))
print(len(live.callers([])), [kernel.__name__ for kernel in live.callers([lanes.march])])
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    names = (
        "damped._correct",
        "damped._push",
        "damped.march_damped",
        "pair._opening",
        "pair._runge_kutta",
        "pair.contact_force",
        "pair.pair_defect",
    )
    assert done.stdout == f"{[f'dem_bridge.ensembles.{name}' for name in names]}\n0 ['march']\n"
