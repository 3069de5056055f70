"""The package of docs/recipes/foreign_package, installed beside this one, adds what its entry points name.

The tests put it where an installation does, with the metadata that pip writes; ``make wheels`` installs it by pip into
empty environments.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import dem_bridge as db
from tests.helpers.recipes import ROOT

GUEST = ROOT / "docs" / "recipes" / "foreign_package"
KEY = (
    "import dem_bridge as db\n"
    "from dem_bridge.backends.base import Resolution, Sampling\n"
    "from dem_bridge.runs.keys import run_key\n"
    "scene = db.load_scene('decelerating-40')\n"
    "print(run_key(scene, 'guest-verlet', Resolution(dt=1e-6), Sampling(count=10)))\n"
)


def install(folder: Path, *, name: str = "chain-guest", entries: dict[str, dict[str, str]] | None = None) -> Path:
    """Put the package and its metadata into a folder; ``entries``: other entry points than those of its pyproject."""
    project = tomllib.loads((GUEST / "pyproject.toml").read_text())["project"]
    shutil.copytree(GUEST / "chain_guest", folder / "chain_guest", dirs_exist_ok=True)
    metadata = folder / f"{name.replace('-', '_')}-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {project['version']}\n")
    groups = (project["entry-points"] if entries is None else entries).items()
    lines = [line for group, names in groups for line in (f"[{group}]", *(f"{k} = {v}" for k, v in names.items()))]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


def _python(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": f"{site}{os.pathsep}{ROOT}"}
    return subprocess.run([sys.executable, *words], env=environment, capture_output=True, text=True, check=False)


def _said(site: Path, *words: str) -> str:
    done = _python(site, *words)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _command(site: Path, *words: str) -> str:
    return _said(site, "-m", "dem_bridge.cli", *words)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("guest"))


def test_its_backend_runs_by_name_and_passes_the_checks_of_a_backend(site: Path) -> None:
    said = _command(site, "run", "decelerating-40", "--backend", "guest-verlet", "--dt", "1e-6", "--json")
    assert '"guest-verlet"' in said
    backend = "from chain_guest.backend import GuestVerlet as G\nimport dem_bridge.testing as t\nt.check_backend(G())\n"
    _said(site, "-c", backend)


def test_its_study_is_listed_and_answers(site: Path) -> None:
    assert "guest-speed" in _command(site, "study", "--help")
    said = re.search(r"It is (\S+) m/s", _command(site, "study", "guest-speed", "decelerating-40", "--dt", "1e-6"))
    assert said is not None
    right = abs(db.solve("decelerating-40", backend="reference", uncertainty=False).velocity[:, -1]).max()
    assert float(said[1]) == pytest.approx(right, rel=0.02)  # its step is a hundredth of a contact's duration


def test_its_reader_reads_what_judge_is_given(site: Path, tmp_path: Path) -> None:
    run = db.solve("decelerating-40", backend="reference", uncertainty=False)
    rows = ["|".join(["t", *(f"v{k}" for k in range(run.velocity.shape[1]))])]
    rows += ["|".join(map(repr, map(float, (t, *v)))) for t, v in zip(run.time, run.velocity, strict=True)]
    (tmp_path / "run.gst").write_text("\n".join(rows) + "\n")
    words = ("-m", "dem_bridge.cli", "judge", str(tmp_path / "run.gst"), "--scene", "decelerating-40", "--json")
    assert '"cause": "none"' in _said(site, *words)
    assert _python(tmp_path, *words).returncode == 2  # without the package its file is not a table


def test_a_change_of_its_code_changes_the_key_of_its_runs(tmp_path: Path) -> None:
    site = install(tmp_path)
    before = _said(site, "-c", KEY)
    with (site / "chain_guest" / "reader.py").open("a") as file:
        file.write("# changed\n")
    assert before != _said(site, "-c", KEY)


def test_a_package_that_cannot_be_imported_costs_nothing_else(tmp_path: Path) -> None:
    site = install(tmp_path)
    (site / "chain_guest" / "backend.py").write_text("raise RuntimeError('broken')\n")
    said = _said(site, "-c", "import dem_bridge as db; a = db.available(); print(a['guest-verlet'], a['reference'])")
    assert "of the distribution chain-guest cannot be imported" in said
    assert "Availability(available=True" in said
    done = _python(site, "-m", "dem_bridge.cli", "run", "decelerating-40", "--backend", "guest-verlet")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


TAKEN = {"dem_bridge.backends": {"verlet": "chain_guest.backend:GuestVerlet"}}
TWICE = {"dem_bridge.backends": {"guest-verlet": "chain_guest.reader:read_gst"}}


@pytest.mark.parametrize(
    ("name", "entries", "said"),
    [
        ("taker", TAKEN, "is not used, because dem_bridge has that name; rename it there"),
        ("other-guest", TWICE, "is a name in the distributions chain-guest and other-guest"),
    ],
)
def test_the_doctor_names_a_name_that_is_taken(
    tmp_path: Path, name: str, entries: dict[str, dict[str, str]], said: str
) -> None:
    site = install(install(tmp_path), name=name, entries=entries)
    code = "from dem_bridge.cli.doctor import guest_packages\nprint(*guest_packages(), sep='\\n')\n"
    lines = _said(site, "-c", code).splitlines()
    assert [said in line for line in lines].count(True) == 1
    assert re.match(r"ok .*gst", lines[-1])
    kind = _said(site, "-c", "import dem_bridge.backends.base as b\nprint(type(b.backend('verlet')).__module__)")
    assert kind.strip() == "dem_bridge.backends.verlet"
