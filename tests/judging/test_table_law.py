"""Force tables of scripts: the law that they mean, LAMMPS' interpolation, and what it changes in a run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.judging.check.answer import Check
from dem_bridge.judging.deck import user_deck
from dem_bridge.judging.table_law import TableLaw, interpolated_force, read_table
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.force_table import ContactTable, contact_table
from dem_bridge.lmp.interpolation import interpolated
from dem_bridge.lmp.process import run_deck
from dem_bridge.physics.contact_law import power_law
from tests.helpers.checked_decks import RADIUS, script

#: N/m^1.5 of the bodies of the scripts, and the deepest overlap of a table, m
STIFFNESS, REACH = 1e9, 5e-5
TABLE = contact_table(
    power_law(STIFFNESS, 2.5), keyword="BALLS", diameter=2.0 * RADIUS, reach=REACH, points=2000, lines=250
)


def law_of(table: ContactTable = TABLE, style: str = "linear", points: int = 2000) -> TableLaw:
    """Return a table with Hertz's law."""
    return TableLaw(
        name="t", style=style, points=points, distance=table.distance, force=table.force, slopes=table.slopes,
        touch=2.0 * RADIUS, power=1.5, coefficient=STIFFNESS,
    )  # fmt: skip


def write(folder: Path, style: str, text: str = TABLE.text) -> Path:
    """Write a script with a table."""
    deck = script(
        per_contact=300.0, contact=3e-4, pair=f"pair_style table {style}",
        coefficients="pair_coeff * * t.table BALLS",
    )  # fmt: skip
    (folder / "t.table").write_text(text)
    (folder / "in.table").write_text(deck)
    return folder / "in.table"


@pytest.mark.parametrize("style", ["linear", "spline"])
def test_the_interpolation_is_that_of_the_decks_of_the_package(style: str) -> None:
    law = law_of(style=style)
    distance = np.linspace(law.distance[0], law.distance[-1], 5001)[:-1]
    own = interpolated(TABLE, style=style, points=2000).force(distance)  # type: ignore[arg-type]
    np.testing.assert_allclose(interpolated_force(law, distance, 2000), own, rtol=0.0, atol=1e-11 * np.max(own))


@pytest.mark.lammps
@pytest.mark.parametrize("style", ["lookup 500", "linear 500", "spline 200", "bitmap 10"])
def test_the_interpolation_is_that_of_lammps(tmp_path: Path, style: str) -> None:
    path = write(tmp_path, style)
    low, high = float(TABLE.distance[0]) * (1 + 1e-12), 2.0 * RADIUS * (1 - 1e-9)
    head = path.read_text().partition("timestep")[0]
    path.write_text(f"{head}\npair_write 1 1 501 r {low!r} {high!r} out A\n")
    run_deck(tmp_path, path.name, time_limit=60.0, engine=Engine.chosen())
    rows = np.array([line.split() for line in (tmp_path / "out").read_text().splitlines() if re.match(r" +\d", line)])
    told, force = rows[:, 1].astype(float), rows[:, 3].astype(float)
    name, points = style.split()
    ours = interpolated_force(law_of(style=name), told, int(points))
    # squared distances of style bitmap have single precision, and pair_write has forces of -1e9 N in its last cell; a
    # distance of 15 digits may be in the next cell of style lookup
    close = np.abs(ours - force) < (1e-4 if name == "bitmap" else 1e-8) * np.max(ours)
    assert np.mean(close) > {"bitmap": 0.95, "lookup": 0.99}.get(name, 0.9999)


def checked(folder: Path, style: str, text: str = TABLE.text) -> Check:
    """Return the answer for a script with a table."""
    return db.check(write(folder, style, text))


@pytest.mark.lammps
def test_a_good_table_is_right_and_its_law_is_named(tmp_path: Path) -> None:
    answer = checked(tmp_path, "spline 2000")
    assert (answer.outcome, answer.law["outcome"], answer.law["cause"]) == ("PASS", "PASS", "")
    assert answer.law["difference"] < 1e-6
    assert "which means hertz with 1e+09 * overlap^1.5, fitted to its lines" in answer.law["sentence"]


@pytest.mark.lammps
def test_points_that_are_too_few_are_told_with_their_errors_and_the_points_to_write(tmp_path: Path) -> None:
    answer = checked(tmp_path, "linear 60")
    assert (answer.outcome, answer.law["outcome"], answer.law["cause"]) == ("FAIL", "FAIL", "table")
    assert answer.law["difference"] > 1e-3
    # the step is judged by the law, without the table
    assert answer.step["outcome"] == "PASS"
    enough = re.search(r"with (\d+) points it would be within", answer.law["sentence"])
    assert enough is not None, answer
    assert checked(tmp_path, f"linear {enough[1]}").outcome == "PASS"


@pytest.mark.lammps
def test_a_wrong_line_of_a_table_is_seen_in_the_velocities(tmp_path: Path) -> None:
    lines = TABLE.text.splitlines()
    # planted fault: the forces of 20 lines at overlaps of some 1e-5 m are 10 % too large
    first = next(k for k, line in enumerate(lines) if re.match(r"\d+ ", line))
    wrong = [k for k in range(first, len(lines)) if 8e-6 < 2.0 * RADIUS - float(lines[k].split()[1]) < 1.1e-5]
    for k in wrong:
        number, r, energy, force = lines[k].split()
        lines[k] = f"{number} {r} {energy} {1.1 * float(force)!r}"
    answer = checked(tmp_path, "spline 2000", "\n".join(lines) + "\n")
    assert (answer.outcome, answer.law["outcome"]) == ("FAIL", "FAIL")
    assert "with 1e+09 * overlap^1.5" in answer.law["sentence"]  # most lines mean the law
    assert "more points do not help" in answer.law["sentence"]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (("BALLS", "OTHERS"), "the section BALLS of t.table is no table"),
        (("N 250", "N 300"), "the section BALLS of t.table is no table"),
        (None, "is neither that of Hertz nor that of Hooke"),
    ],
)
def test_a_table_that_means_no_law_is_said(tmp_path: Path, change: tuple[str, str] | None, why: str) -> None:
    square = contact_table(power_law(1e13, 3.5), keyword="BALLS", diameter=2.0 * RADIUS, reach=REACH, points=2000)
    text = square.text if change is None else TABLE.text.replace(*change)
    deck = user_deck(write(tmp_path, "spline 2000", text))
    assert (deck.read, deck.tables) == (None, ())
    assert why in deck.unread_table


def test_tables_with_even_distances_and_without_slopes_are_read_as_lammps_does() -> None:
    text = "A\nN 4 R 1 4\n\n" + "".join(f"{k} {9 * k} 0 {k**2}\n" for k in range(1, 5))
    distance, force, slopes = read_table(text, "A", "t")
    assert (distance.tolist(), force.tolist(), slopes) == ([1, 2, 3, 4], [1, 4, 9, 16], (3.0, 7.0))
    with pytest.raises(UsageError, match="the section B of t is no table"):
        read_table(text, "B", "t")


def test_a_table_outside_of_the_folder_is_not_read(tmp_path: Path) -> None:
    path = write(tmp_path, "linear 100")
    path.write_text(path.read_text().replace("t.table", "../t.table"))
    assert "not in the folder of the script" in user_deck(path).unread_table
