"""LAMMPS' unit tests as files: what is read and written, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from dem_bridge.errors import SceneError
from dem_bridge.foundation.script_files import is_unit_test
from dem_bridge.lmp.unit_test import read_unit_test

FILES = Path(__file__).parents[1] / "data" / "unit_tests"
SPINS = (FILES / "spins.yaml").read_text()


def test_a_test_is_read_with_its_variables_segments_and_states() -> None:
    test = read_unit_test(SPINS, "folder/spins.yaml")
    assert test.name == "spins"
    assert test.ends == (2300, 3200, 4300)
    assert test.variables["modulus"] == "5.0e10"
    assert test.states["run_omega"][2] == {1: (0.0, 0.0, 40.0), 2: (0.0, 0.0, -40.0)}
    assert test.analytic is not None
    assert (test.analytic.model, test.analytic.segment) == ("collision_restitution", 2)
    assert test.commands[0] == "variable modulus index 5.0e10"
    assert test.script.splitlines()[-3:] == ["run 2300", "run 900", "run 1100"]


def test_a_test_that_is_written_is_the_same() -> None:
    assert read_unit_test(SPINS, "spins.yaml").text == SPINS


def test_lists_of_tags_in_both_spellings_and_words_of_analytic_enable() -> None:
    test = read_unit_test(SPINS.replace("tags: granular", "tags: granular,, generated"), "x.yaml")
    assert test.tags == ("granular", "generated")
    assert read_unit_test(SPINS.replace("analytic_enable: yes", "analytic_enable: no"), "x.yaml").analytic is None


def test_a_script_and_a_test_of_another_kind_are_no_unit_tests() -> None:
    assert is_unit_test(SPINS)
    assert not is_unit_test("units si\npair_style granular\nrun 10\n")
    assert not is_unit_test(SPINS.replace("run_segments", "run_forces"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("  2300 900 1100\n", "  2300 900 x\n", "run_segments has 'x' where a number is required; allowed: a number"),
        ("  2300 900 1100\n", "  2300 900.5\n", "run_segments has '900.5' where a whole number is required"),
        ("epsilon: 1e-10", "epsilon: small", "epsilon has 'small' where a number is required"),
        ("    2   2  4.0", "    2  4.0", "run_pos has the row"),
        ("    2   2  4.0", "    3   2  4.0", "run_pos has a row of segment 3; allowed: 0 to 2"),
        ("pair_style: granular", "pair_style:", "pair_style is missing or empty; allowed: a unit test of LAMMPS"),
        ("pair_style: granular", "pair_style: [granular]", "pair_style is a list or a mapping"),
        ("pair_style: granular", "pair_style: 'granular", "is no YAML file"),
    ],
)
def test_what_cannot_be_read_is_said_in_one_line(old: str, new: str, said: str) -> None:
    assert old in SPINS
    with pytest.raises(SceneError, match=r"^x\.yaml") as refused:
        read_unit_test(SPINS.replace(old, new), "x.yaml")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
