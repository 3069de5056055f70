"""Studies are guests: without their folder everything else works, and what needs them says so in one line."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dem_bridge.api.guests import SCENES, STUDIES, VERIFICATIONS, function_of, studies_in
from tests.helpers.recipes import ROOT

IMPORT_ALL = """
import importlib, pkgutil, sys
import dem_bridge
names = [module.name for module in pkgutil.walk_packages(dem_bridge.__path__, "dem_bridge.")]
assert len(names) > 200 and not any(name.startswith("dem_bridge.studies") for name in names)
for name in names:
    if name not in ("dem_bridge.cli.__main__", "dem_bridge.lmp.worker", "dem_bridge.foundation.isolated_child"):
        importlib.import_module(name)
"""


@pytest.mark.studies
def test_every_guest_has_its_function() -> None:
    others = (*VERIFICATIONS.values(), *SCENES.values())
    assert all(callable(function_of(entry)) for entry in others)
    assert (len(others), len(STUDIES) > 10) == (2, True)


def test_only_the_catalogue_of_guests_knows_the_studies() -> None:
    files = {file for file in (ROOT / "dem_bridge").rglob("*.py") if "studies" not in file.relative_to(ROOT).parts[:-1]}
    assert {file.name for file in files if "import dem_bridge.studies" in file.read_text()} == set()
    assert {file.name for file in files if "from dem_bridge.studies" in file.read_text()} == set()


#: folders whose tests have studies as their subject, or measure what everything costs
OF_STUDIES = ("studies", "bench")
_NAMES = "|".join(sorted(map(re.escape, STUDIES), key=len, reverse=True)) or "none"
#: a call of a public function, a command as a text or in words, or a module
NAMED = re.compile(
    rf"db\.study\(|partial\(db\.study,|\bstudy (?:{_NAMES})\b|'study', '(?:{_NAMES})'|db\.minimal\("
    r"|(?:from|import) dem_bridge\.studies"
)
#: how a test says that it is skipped where there are no studies
SKIPPED = re.compile(r"importorskip\('dem_bridge\.studies|mark\.studies\b|find_spec\('dem_bridge\.studies'\)")


def unskipped(text: str) -> list[str]:
    """Return the first lines of those parts of a module that name a study and are not skipped where there is none."""
    parts = [ast.unparse(node) for node in ast.parse(text).body]
    return [part.splitlines()[0] for part in parts if NAMED.search(part) and not SKIPPED.search(part)]


def test_no_test_of_another_room_needs_a_study() -> None:
    files = {file for file in (ROOT / "tests").rglob("*.py") if file.relative_to(ROOT).parts[1] not in OF_STUDIES}
    files.remove(Path(__file__))
    assert len(files) > 200
    assert {file.name: parts for file in files if (parts := unskipped(file.read_text(encoding="utf-8")))} == {}


@pytest.mark.studies
@pytest.mark.parametrize(
    "text",
    [
        "def test():\n    db.study('scatter', PAIR)",
        "RUN = partial(db.study, 'scatter')",
        "from dem_bridge.studies.bands import edges",
        "def helper():\n    from dem_bridge.studies import bands",
        "COMMANDS = ['study order tapered-backward']",
        "def test():\n    run_here('study', 'scatter', '--count', '2')",
        "def test():\n    return db.minimal(SCENE)",
    ],
)
def test_a_test_that_needs_a_study_is_found(text: str) -> None:
    assert len(unskipped(text)) == 1
    assert not text.startswith("def") or unskipped(f"@pytest.mark.studies\n{text}") == []


@pytest.fixture(scope="module")
def without_studies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("without")
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "dem_bridge", folder / "dem_bridge", ignore=ignored)
    shutil.rmtree(folder / "dem_bridge" / "studies")
    return folder


def _run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(folder), "DEM_BRIDGE_STORE": "", "NUMBA_DISABLE_JIT": "1"}
    words = (sys.executable, *words)
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    ["scenes", "study --help", "run decelerating-40 --backend bca", "deck decelerating-40 -o DECKS"],
)
def test_without_the_studies_other_commands_work(without_studies: Path, words: str, tmp_path: Path) -> None:
    done = _run(without_studies, "-m", "dem_bridge.cli", *words.replace("DECKS", str(tmp_path)).split())
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "verify paper -o DECKS",
            "verify paper needs the studies of dem_bridge, which are not installed; install",
        ),
        ("study order decelerating-40", "No such command 'order'"),
    ],
)
def test_without_the_studies_what_needs_them_says_so(
    without_studies: Path, words: str, said: str, tmp_path: Path
) -> None:
    done = _run(without_studies, "-m", "dem_bridge.cli", *words.replace("DECKS", str(tmp_path / "r")).split())
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_without_the_studies_every_module_is_imported(without_studies: Path) -> None:
    done = _run(without_studies, "-c", IMPORT_ALL)
    assert done.returncode == 0, done.stderr


def test_a_study_is_the_function_that_has_the_name_of_its_module(tmp_path: Path) -> None:
    folder = tmp_path / "studies"
    (folder / "deep").mkdir(parents=True)
    texts = {
        "plain.py": 'def study_plain(\n    *, x: float = f("1"),\n) -> Study:\n    """Measure it.\n\n    More."""\n',
        "deep/study.py": 'X = 1\n\n\ndef study_deep() -> Study:\n    """Measure (more)."""\n',
        "helper.py": 'def study_of(rows: int) -> Study:\n    """Return it."""\n',
        "number.py": 'def study_number() -> int:\n    """Count."""\n\n\ndef g() -> Study:\n    """Return."""\n',
        "deep/other.py": 'def study_other() -> Study:\n    """Measure."""\n',
    }
    for name, text in texts.items():
        (folder / name).write_text(f"\n{text}", encoding="utf-8")
    assert {name: tuple(entry) for name, entry in studies_in(folder).items()} == {
        "deep": ("dem_bridge.studies.deep.study", "study_deep", "Measure (more)."),
        "plain": ("dem_bridge.studies.plain", "study_plain", "Measure it."),
    }
    assert studies_in(tmp_path / "nowhere") == {}
