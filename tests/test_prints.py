"""What public functions return prints in at most 15 lines, the answer first, and has a picture in a notebook."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.foundation.wording import MOST_LINES, WIDTH, counted, summary

PAIR = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)
TRIPLE = db.Scene(
    name="triple", duration=1e-4, mass=(8e-3, 1e-2, 1e-2), stiffness=(4e9, 4e9), velocity=(0.8, 0.0, 0.0), samples=10
)
BIG = db.load_scene("decelerating-200")


@pytest.fixture(scope="module")
def values() -> dict[str, Any]:
    """Results that need no LAMMPS, of chains with many bodies where there may be many."""
    run = db.solve(BIG, backend="verlet", dt=1e-6, uncertainty=False)
    return {
        "Scene": BIG,
        "Geometry": BIG.geometry,
        "Contacts": BIG.contacts,
        "Drive": db.Drive(shape="table", force=(0.0, 1.0) * 500, interval=1e-5),
        "Trajectory": run,
        "Uncertainty": run.uncertainty,
        "Comparison": db.compare(run, db.solve(BIG, backend="verlet", dt=5e-7, uncertainty=False)),
        "Plan": db.plan(PAIR, 1e-3, backend="verlet"),
        "Ensemble": db.ensemble(db.load_scene("decelerating-40"), vary={"angle": 0.5}, n=8, accuracy=1e-2, checks=1),
        "Table": db.table_of(BIG, table="contacts", with_run=False),
    }


NAMES = [
    "Scene",
    "Geometry",
    "Contacts",
    "Drive",
    "Trajectory",
    "Uncertainty",
    "Comparison",
    "Plan",
    "Ensemble",
    "Table",
]
#: what the first lines must have
FIRST = {
    "Scene": "201, mass",
    "Geometry": "201 cylinders",
    "Contacts": "200 contacts",
    "Trajectory": "verlet",
    "Comparison": "velocities differ by at most",
    "Plan": "backend",
    "Ensemble": "8 chains of decelerating-40",
}


@pytest.mark.parametrize("name", NAMES)
def test_a_result_prints_in_at_most_15_lines(name: str, values: dict[str, Any]) -> None:
    lines = str(values[name]).splitlines()
    assert len(lines) <= MOST_LINES
    assert FIRST.get(name, "") in "\n".join(lines[:4])
    assert "array(" not in str(values[name])


@pytest.mark.parametrize("name", ["Trajectory", "Ensemble"])
def test_a_notebook_has_a_picture(name: str, values: dict[str, Any]) -> None:
    html = values[name]._repr_html_()
    assert ("data:image/png;base64," in html) or ("<svg" in html)
    assert len(html) < 600_000


@pytest.mark.lammps
def test_a_verification_prints_its_answer_and_its_counts(tmp_path: Path) -> None:
    found = db.verify(TRIPLE, accuracy=1e-3, jobs=1)
    lines = str(found).splitlines()
    assert len(lines) <= MOST_LINES
    # the answer is the first sentence, and the counts are those of the verdicts
    assert found.answer[0].split()[1] in lines[1]
    assert counted(verdict.outcome.value for verdict in found.verdicts) in str(found)
    assert repr(found) == str(found)
    assert len(str(found.studies[0]).splitlines()) <= MOST_LINES
    assert str(found.verdicts[0]).startswith(f"{found.verdicts[0].outcome.value}: ")
    assert "data:image/png;base64," in found._repr_html_()
    db.write_trajectory(db.solve(PAIR, backend="verlet", dt=1e-6, uncertainty=False), PAIR, tmp_path / "a.csv")
    judgement = db.judge([f"{tmp_path / 'a.csv'}@1e-6"], PAIR)
    assert len(str(judgement).splitlines()) <= MOST_LINES


def test_a_summary_keeps_its_facts_and_cuts_its_sentences() -> None:
    lines = summary([f"sentence {k}" for k in range(100)], ["the end"], title="title").splitlines()
    assert (len(lines), lines[0], lines[1], lines[-1]) == (MOST_LINES, "title", "  sentence 0", "  the end")
    assert lines[-2].endswith(" ...")
    assert max(map(len, summary(["word " * 300], ["w " * 300]).splitlines())) <= WIDTH
