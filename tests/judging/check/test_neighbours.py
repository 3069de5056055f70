"""A step that is promised for a script holds with its neighbour list, or the list is named as the limit."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.judging.check.laboratory import Laboratory
from dem_bridge.judging.check.neighbours import NeighbourList, neighbour_list
from dem_bridge.judging.deck import user_deck
from tests.helpers.checked_decks import RADIUS, UNDAMPED, script

#: gaps of two radii, a thin skin and rare rebuilds: right at its step by luck
FAR = "\n".join(f"create_atoms 1 single {k * RADIUS * 2.3:.15g} 0 0 units box" for k in range(4))
THIN = "neighbor 1e-5 bin\nneigh_modify delay 10 every 1 check yes"
SOFT = {"coefficients": f"pair_coeff * * hertz 1e7 0 {UNDAMPED}", "step": "timestep 2e-6", "run": "run 9000"}


@pytest.mark.parametrize(
    ("lines", "skin", "steps"),
    [
        ("neighbor 1e-4 bin\nneigh_modify delay 0 every 1 check yes", 1e-4, 1),
        ("neighbor 2e-4 bin\nneigh_modify delay 10", 2e-4, 10),
        ("neigh_modify every 4 delay 10", 1e-3, 12),
        ("neigh_modify once yes", 1e-3, math.inf),
        ("", 1e-3, 1),
    ],
)
def test_skin_and_rebuilds_are_read(tmp_path: Path, lines: str, skin: float, steps: float) -> None:
    (tmp_path / "in.chain").write_text(script(neighbour=lines))
    assert neighbour_list(user_deck(tmp_path / "in.chain")) == NeighbourList(skin=skin, steps=steps)


@pytest.mark.lammps
def test_the_largest_step_is_limited_by_the_list_and_the_line_for_a_larger_one_is_written(tmp_path: Path) -> None:
    path = tmp_path / "in.chain"
    path.write_text(script(atoms=FAR, neighbour=THIN, **SOFT))
    answer = db.check(path)
    limit = 0.5 * 1e-5 / (0.5 * 10)  # half of the skin, at 0.5 m/s, in ten steps
    assert answer.law["outcome"] == "PASS"
    assert (
        f"the neighbour list is safe up to {limit:g} s (a rebuild in 10 steps, skin 1e-05 m)" in answer.step["sentence"]
    )
    assert answer.step["largest_for_accuracy"] <= 2e-6  # at which LAMMPS was seen to be right
    assert [line.partition("  #")[0] for line in answer.advice] == ["neigh_modify delay 0 every 1 check yes"]
    promised = re.search(r"check yes` (\S+) s gives 0.1 %", answer.step["sentence"])
    assert promised is not None
    largest = float(promised[1])
    assert largest > 5e-6
    # the promise holds with the line, and not without it
    coarse = {"step": f"timestep {largest:g}", "run": f"run {math.ceil(9000 * 2e-6 / largest)}"}
    path.write_text(script(atoms=FAR, neighbour="neighbor 1e-5 bin\nneigh_modify delay 0", **{**SOFT, **coarse}))
    assert db.check(path).step["relative_error"] <= 1.05e-3


@pytest.mark.lammps
def test_a_step_that_no_run_confirms_is_not_promised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Laboratory, "error_with_safe_list", lambda self, dt: 0.5)
    (tmp_path / "in.chain").write_text(script(atoms=FAR, neighbour=THIN, **SOFT))
    assert "check yes` larger steps are possible" in db.check(tmp_path / "in.chain").step["sentence"]
