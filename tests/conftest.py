"""Share among all tests the marker of the engine, the truth files, runs that are made once, and an empty folder.

A test marked ``lammps`` is skipped, with the reason, where the engine is missing; with DEM_BRIDGE_REQUIRE_LAMMPS=1 it
fails instead, so that CI cannot pass without the code under test.
"""

from __future__ import annotations

import gc
import os
import shutil
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import hypothesis
import pytest

import dem_bridge as db
from dem_bridge.errors import BackendUnavailable
from dem_bridge.lmp import process
from dem_bridge.lmp.engine import Engine
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.quadruple_truth import Truth, load_truth
from tests.helpers.strategies import EXPLORE

# the same examples every time; how long one takes says nothing of its truth. HYPOTHESIS_PROFILE=explore looks further.
hypothesis.settings.register_profile("ci", derandomize=True, deadline=None, database=None, print_blob=True)
hypothesis.settings.register_profile("explore", deadline=None, database=None, print_blob=True, max_examples=2000)
hypothesis.settings.load_profile("explore" if EXPLORE else "ci")

# no test takes a number from a store, or leaves one, unless it names a folder; children too
os.environ["DEM_BRIDGE_STORE"] = ""

#: solve a scene, or hand out the run made before with the same settings
Solve = Callable[..., Trajectory]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each file to one process of xdist, and so each folder whose tests share runs.

    ``--dist loadgroup`` would do it by markers, but pytest 9.2 drops its groups without a word (pytest-xdist #1386).
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByFileOrFolder(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return group_of(nodeid, config.rootpath)

    return ByFileOrFolder(config, log)


def pytest_collection() -> None:
    """Search for no garbage while tests are collected, which takes a fifth of the time and finds none."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


def group_of(nodeid: str, root: Path) -> str:
    """Return the file of a test, or its folder where a conftest.py there makes runs for all files of the folder."""
    file = Path(nodeid.split("::")[0])
    shares_runs = (root / file.parent / "conftest.py").exists() and (root / file).parent != Path(__file__).parent
    return str(file.parent if shares_runs else file)


#: public functions that find a study, whose examples are skipped where there are no studies
_EXAMPLES_OF_STUDIES = ("studies.study", "studies.minimal", "guests.studies_in")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.name in {f"dem_bridge.api.{name}" for name in _EXAMPLES_OF_STUDIES}:
            item.add_marker(pytest.mark.skipif(find_spec("dem_bridge.studies") is None, reason="no studies"))


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("studies") is not None:
        pytest.importorskip("dem_bridge.studies")
    if item.get_closest_marker("lammps") is None:
        return
    try:
        process.require(Engine(), "pair granular")
    except BackendUnavailable as error:
        if os.environ.get("DEM_BRIDGE_REQUIRE_LAMMPS") == "1":
            pytest.fail(f"DEM_BRIDGE_REQUIRE_LAMMPS=1, but there is no engine: {error}", pytrace=False)
        pytest.skip(f"no LAMMPS: {error}")


@pytest.fixture(scope="session")
def empty_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cwd")


@pytest.fixture(autouse=True)
def clean_cwd(empty_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Run every test in an empty folder that it must leave empty: paths are arguments."""
    monkeypatch.chdir(empty_folder)
    yield empty_folder
    litter = sorted(path.name for path in empty_folder.iterdir())
    for name in litter:  # the next test is not to blame
        path = empty_folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert not litter, f"written into the current working directory: {litter}"


@pytest.fixture(scope="session")
def solved() -> Solve:
    """Return ``db.solve`` that runs each combination of scene, backend and settings once in a session."""
    runs: dict[tuple[object, ...], Trajectory] = {}

    def solve(scene: Scene, backend: str, **settings: Any) -> Trajectory:
        key = (scene.name, scene.content_hash, backend, *sorted(settings.items()))
        if key not in runs:
            runs[key] = db.solve(scene, backend=backend, **settings)
        return runs[key]

    return solve


@pytest.fixture(scope="session")
def decelerating() -> Truth:
    """Return the paper's decelerating chain in raw form, far end free."""
    return load_truth("a_N40_dec")


@pytest.fixture(scope="session")
def accelerating() -> Truth:
    """Return the paper's accelerating chain in raw form, far end free."""
    return load_truth("b_N40_inc")


@pytest.fixture(scope="session")
def walled() -> Truth:
    """Return the decelerating chain with a rigid wall behind the last cylinder: ill-conditioned."""
    return load_truth("aw_N40_dec_wall")


@pytest.fixture(scope="session")
def two_bodies() -> Truth:
    """Return the striker on one cylinder."""
    return load_truth("e_two_body")


@pytest.fixture(scope="session", params=["a_N40_dec", "b_N40_inc"], ids=["decelerating", "accelerating"])
def free_chain(request: pytest.FixtureRequest) -> Truth:
    """Return each of the paper's two chains in turn."""
    return load_truth(request.param)
