"""Lines of other time steps: what is replaced, what is added, and what cannot be changed."""

from __future__ import annotations

from pathlib import Path

import pytest

from dem_bridge.errors import UsageError
from dem_bridge.judging.check.edits import Edit, applied, stretched, tidy_factor
from dem_bridge.judging.check.subject import Subject, subject_of
from tests.helpers.checked_decks import script


def subject(folder: Path, text: str, **files: str) -> Subject:
    """Return a script that was read."""
    (folder / "in.chain").write_text(text)
    for name, more in files.items():
        (folder / name.replace("_", ".")).write_text(more)
    with subject_of(folder / "in.chain") as read:
        return read


@pytest.mark.parametrize(
    ("run", "lines"),
    [
        ("run 60", ["run 240"]),
        ("run 60 pre no", ["run 240 pre no"]),
        ("run 60 every 20 'print a'", ["run 240 every 80 'print a'"]),
        ("variable n equal 60\nrun ${n}", ["run $(4*v_n)"]),
        ("variable n equal 60\nrun $n", ["run $(4*v_n)"]),
        ("run $(6*10)  # steps", ["run $(4*(6*10))"]),
        ("run &\n60", ["run 240"]),
        ("run 30\nrun 30", ["run 120", "run 120"]),
        ("run $(round(6e-6/dt))", []),  # follows the step by itself
    ],
)
def test_the_lines_of_finer_steps_keep_the_duration(tmp_path: Path, run: str, lines: list[str]) -> None:
    read = subject(tmp_path, script(step="timestep 1e-7", run=run))
    assert [edit.new for edit in read.edits(4)] == ["timestep 2.5e-08", *lines]


def test_a_script_without_a_step_gets_one_before_its_run(tmp_path: Path) -> None:
    read = subject(tmp_path, script(step="", run="run 60"))
    step, run = read.edits(2)
    assert (step.new, step.added, run.new) == ("timestep 5e-09", True, "run 120")
    assert read.finer(2)["in.chain"].splitlines()[-2:] == ["timestep 5e-09", "run 120"]


def test_lines_of_included_files_are_changed_there(tmp_path: Path) -> None:
    read = subject(tmp_path, script(step="", run="include run.inc"), run_inc="timestep 1e-7\nrun 60\n")
    assert {edit.file for edit in read.edits(2)} == {"run.inc"}
    assert read.finer(2)["run.inc"] == "timestep 5e-08\nrun 120\n"


@pytest.mark.parametrize("run", ['if "1 == 1" then "run 60"', "run 60 start 0 stop 60"])
def test_steps_that_cannot_be_changed_are_said(tmp_path: Path, run: str) -> None:
    read = subject(tmp_path, script(step="timestep 1e-7", run=run))
    with pytest.raises(UsageError, match=r"in.chain, line 24: `run 60.*` cannot be changed to other steps"):
        read.edits(2)


def test_several_added_lines_keep_their_order() -> None:
    added = [Edit(file="a", line=2, new=text, added=True) for text in ("timestep 1", "run 3")]
    assert applied({"a": "units si\n"}, added)["a"] == "units si\ntimestep 1\nrun 3\n"
    assert str(added[0]) == "timestep 1"
    assert added[0].place == "before line 2 of a"


@pytest.mark.parametrize(("least", "factor"), [(0.5, 1), (1.0, 1), (1.01, 2), (2.6, 4), (7.2, 10), (100.0, 100)])
def test_a_step_that_is_written_has_few_digits(least: float, factor: int) -> None:
    assert tidy_factor(1e-6, least) == factor


def test_only_the_coarse_ones_of_several_steps_are_changed(tmp_path: Path) -> None:
    read = subject(tmp_path, script(step="timestep 2e-6\nrun 40\ntimestep 2e-7", run="run 600"))
    assert [edit.new for edit in read.edits_of_coarse(4)] == ["timestep 5e-07", "run 160"]
    assert [edit.new for edit in read.edits_of_coarse(20)] == [
        "timestep 1e-07",
        "run 800",
        "timestep 1e-07",
        "run 1200",
    ]
    loop = "variable dt index 2e-6 2e-7\nlabel again\ntimestep ${dt}\nrun 40\nnext dt\njump SELF again"
    assert subject(tmp_path, script(step="", run=loop)).edits_of_coarse(4) == ()


def test_a_longer_step_keeps_at_least_the_duration(tmp_path: Path) -> None:
    read = subject(tmp_path, script(step="timestep 2e-6", run="run 41"))
    longer = stretched(read.texts(), read.deck.commands, 5e-6)
    assert [edit.new for edit in longer] == ["timestep 5e-06", "run 17"]
    read = subject(tmp_path, script(step="variable d equal 2e-6\ntimestep ${d}", run="run 41"))
    with pytest.raises(UsageError, match="cannot be changed to other steps"):
        stretched(read.texts(), read.deck.commands, 5e-6)
