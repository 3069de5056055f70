"""Whatever may last over two seconds shows what runs before it imports the packages that take the time."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from dem_bridge.cli import main, waiting
from dem_bridge.foundation import kernel_folders
from dem_bridge.foundation.progress import campaign
from tests.helpers.processes import happens, pause

#: ends the process at the first progress, with the label and whether numpy or rich was imported before it
BEGINS = """
import sys
from dem_bridge.cli import waiting
from dem_bridge.cli.group import main

def begins(as_json=False, label=""):
    print(label, [name for name in ("numpy", "rich", "scipy") if name in sys.modules])
    sys.stdout.flush()
    raise SystemExit(77)

waiting.bar = begins
main(sys.argv[1:])
"""
#: as on a terminal, with the end of the process in place of the import of rich
SHOWN = """
import sys
from dem_bridge.cli import waiting

sys.modules["rich.console"] = None
sys.stderr.isatty = lambda: True
try:
    with waiting.bar(label="a chain is solved"):
        pass
except ImportError:
    pass
"""


@pytest.mark.parametrize(
    ("words", "label"),
    [
        ("run tapered-backward --accuracy 1e-5 -o run.csv", "tapered-backward by the cheapest backend"),
        ("verify tapered-backward", "the steps of the runs are chosen"),
        ("judge a.csv --scene tapered-backward", "the reference solution of tapered-backward, and fits to a.csv"),
        ("plan tapered-backward --accuracy 1e-5", "tapered-backward: the cheapest settings for 1e-05"),
        ("check decelerating-40", "check of decelerating-40"),
        pytest.param("study order tapered-backward", "study order is loaded", marks=pytest.mark.studies),
        ("compare a.csv b.nc", "a.csv and b.nc are compared"),
        ("convert a.nc -o b.csv", "a.nc is converted"),
        ("show tapered-backward", "tapered-backward is solved for the drawing"),
        ("export tapered-backward --table observables", "table observables of tapered-backward"),
        ("regress", "the baselines are read"),
    ],
)
def test_a_command_says_what_runs_before_it_imports_numpy(words: str, label: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BEGINS, *words.split()], capture_output=True, text=True, cwd=tmp_path, timeout=60
    )
    assert (done.returncode, done.stdout) == (77, f"{label} []\n"), done.stderr


def test_the_label_is_shown_before_rich_is_imported() -> None:
    done = subprocess.run([sys.executable, "-c", SHOWN], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "a chain is solved")


def test_a_log_has_a_line_on_what_runs_while_one_run_lasts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(waiting, "SECONDS_BETWEEN_LINES", 0.02)
    said = ""

    def says(words: str) -> bool:
        nonlocal said
        said += capsys.readouterr().err
        return words in said

    with waiting.bar(label="steps are chosen") as progress, campaign(4, 1) as state:
        assert progress is not None
        assert happens(lambda: says(" s: 1/4 runs, 0 failed: steps are chosen\n"))
        state.update(done=1, running=("pair: verlet",))
        progress(0.5, 1, "pair")
        assert happens(lambda: says(" s, 50 %: 2/4 runs, "))
        assert happens(lambda: says(" 0 failed: pair: verlet\n"))
    capsys.readouterr()
    pause(0.1)
    assert capsys.readouterr().err == ""  # the lines end with the work


def test_compiling_is_announced_until_a_kernel_is_on_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(kernel_folders, "folders_to_read", lambda: (tmp_path,))
    words = "dem-bridge: kernels are compiled first, once on this machine: up to a minute\n"
    waiting.announce_compiling()
    assert capsys.readouterr().err == words
    (tmp_path / "dem_bridge.backends.verlet.advance-0.kernel").touch()
    waiting.announce_compiling()
    assert capsys.readouterr().err == ""
    # those of the reference are others
    waiting.announce_compiling("taylor", silent=True)
    assert capsys.readouterr().err == ""
    waiting.announce_compiling("taylor")
    assert capsys.readouterr().err == words


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("decelerating-40", "--backend", "verlet", "--dt", "1e-8", "--accuracy", "1e-3"), "dt and accuracy are both"),
        (("mfix-dem-01", "--backend", "bca"), "bca cannot do mfix-dem-01"),
        (("decelerating-40", "--backend", "lammps-granular", "--lmp", "gone"), "gone"),
    ],
)
def test_a_run_that_is_refused_announces_no_kernels(
    words: tuple[str, ...], why: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("dem_bridge.foundation.kernel_folders.folders_to_read", lambda: (tmp_path,))
    done = CliRunner().invoke(main, ["run", *words])
    assert done.exit_code in (2, 3)
    assert "kernels are compiled" not in done.stderr
    assert why in done.stderr


def test_a_check_of_nothing_is_refused_before_anything_is_imported() -> None:
    code = (
        "import sys; from dem_bridge.cli import group\n"
        "try: group.main(['check', 'in.nosuch'])\n"
        "except SystemExit as end: print(end.code, *{'numpy', 'pydantic', 'numba', 'rich'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["2"], done.stderr
    assert done.stderr.startswith("dem-bridge: in.nosuch: there is no such scene or file; allowed: ")
