"""The suite's own guards: a missing engine is a skip or, where demanded, a failure; litter is an error."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import group_of

ROOT = Path(__file__).parents[1]

PLANTED = """
from pathlib import Path
import pytest

@pytest.mark.lammps
def test_that_needs_the_engine() -> None:
    assert True

def test_that_litters() -> None:
    Path("in.error").write_text("left behind")

def test_that_is_tidy(tmp_path: Path) -> None:
    (tmp_path / "in.error").write_text("where it belongs")
"""


def _run(folder: Path, required: bool) -> str:
    """Outcome of the planted tests, in a world without a LAMMPS that loads."""
    (folder / "lammps.py").write_text("raise ImportError('no LAMMPS in this test')")
    (folder / "test_planted.py").write_text(PLANTED)
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("DEM_BRIDGE", "PYTEST"))}
    environment["PYTHONPATH"] = os.pathsep.join([str(folder), str(ROOT)])
    if required:
        environment["DEM_BRIDGE_REQUIRE_LAMMPS"] = "1"
    words = ["-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "--rootdir", str(folder), "-p", "tests.conftest"]
    words += ["-p", "no:cacheprovider", "--basetemp", str(folder / "temp"), str(folder / "test_planted.py")]
    done = subprocess.run([sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.stderr == ""
    return done.stdout


@pytest.fixture(scope="module")
def skipping(tmp_path_factory: pytest.TempPathFactory) -> str:
    return _run(tmp_path_factory.mktemp("skipping"), required=False)


def test_without_an_engine_its_tests_are_skipped_with_the_reason(skipping: str) -> None:
    assert "1 skipped" in skipping
    assert "no LAMMPS in this test" in skipping


def test_where_the_engine_is_demanded_its_absence_is_a_failure(tmp_path: Path) -> None:
    summary = _run(tmp_path, required=True)
    assert "skipped" not in summary
    assert "DEM_BRIDGE_REQUIRE_LAMMPS=1, but there is no engine" in summary
    assert "test_that_needs_the_engine" in summary.split("short test summary info")[1]


def test_a_test_that_writes_into_the_working_directory_is_an_error(skipping: str) -> None:
    assert "written into the current working directory: ['in.error']" in skipping
    assert "2 passed, 1 skipped, 1 error" in skipping


IN_TWO_PROCESSES = """
import os
import pytest

@pytest.mark.parametrize("number", range(3))
def test_names_its_process(number: int, worker_id: str) -> None:
    print("ran", __file__, worker_id)
"""


@pytest.mark.slow
def test_the_tests_of_a_file_run_in_one_process(tmp_path: Path) -> None:
    # their fixtures are made once then and not once in each process
    names = ("test_here.py", "test_there.py")
    for name in names:
        (tmp_path / name).write_text(IN_TWO_PROCESSES)
    words = ["-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "--rootdir", str(tmp_path), "-p", "tests.conftest"]
    words += ["-p", "no:cacheprovider", "--basetemp", str(tmp_path / "temp"), "-n", "2", "-rP", *map(str, names)]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST")}
    environment["PYTHONPATH"] = str(ROOT)
    done = subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
    ran = {name: re.findall(rf"^ran \S+{name} (\w+)$", done.stdout, re.MULTILINE) for name in names}
    assert {name: len(workers) for name, workers in ran.items()} == dict.fromkeys(names, 3), done.stdout
    assert ran == {"test_here.py": ["gw0"] * 3, "test_there.py": ["gw1"] * 3} or ran == {
        "test_here.py": ["gw1"] * 3,
        "test_there.py": ["gw0"] * 3,
    }


@pytest.mark.studies  # theirs is the folder
def test_a_folder_with_shared_runs_is_one_group() -> None:
    assert group_of("tests/studies/paper/test_claims.py::test_a[x]", ROOT) == "tests/studies/paper"
    assert group_of("tests/backends/test_scipy.py::test_b[a::b]", ROOT) == "tests/backends/test_scipy.py"
    assert group_of("dem_bridge/scene/scene.py::dem_bridge.scene.scene.Scene", ROOT) == "dem_bridge/scene/scene.py"
