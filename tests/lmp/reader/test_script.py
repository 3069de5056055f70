"""Text of a script to commands, by LAMMPS' rules."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.errors import BlockedScript, SceneError
from dem_bridge.foundation.script_files import files_of
from dem_bridge.lmp.reader.evaluation import read_script
from dem_bridge.lmp.reader.formula import evaluated
from dem_bridge.lmp.reader.particles import Particle
from dem_bridge.lmp.reader.script import Script
from tests.helpers.strategies import examples

#: no other files
NOTHING: dict[str, str] = {}


def _words(text: str, files: dict[str, str] | None = None) -> list[tuple[str, ...]]:
    script = Script((files or {}).__getitem__)
    words = [one.words for one in script.commands("in.test", text)]
    if script.blockers:
        raise BlockedScript(script.blockers.values())
    return words


def _message(text: str, files: dict[str, str] | None = None) -> str:
    with pytest.raises(SceneError) as caught:
        _words(text, files)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_comments_continued_lines_and_quotes() -> None:
    text = "a b # c\n\nd &\n  e 'f # g' \"h i\"  # j\n# k\n\tl\n"
    assert _words(text) == [("a", "b"), ("d", "e", "f # g", "h i"), ("l",)]


def test_a_command_knows_its_file_and_first_line() -> None:
    found = list(Script({"b": "x\n\ny &\n z\n"}.__getitem__).commands("in.a", "a\ninclude b\nc\n"))
    assert [(one.file, one.line, one.text) for one in found] == [
        ("in.a", 1, "a"),
        ("b", 1, "x"),
        ("b", 3, "y z"),
        ("in.a", 3, "c"),
    ]


def test_variables_are_put_in_as_lammps_does() -> None:
    text = """variable a index 3 4
variable a index 5
variable b equal v_a/7
variable s string hello
variable t equal 1.0
variable t equal 2.0*PI
c ${a} $a ${b} $(v_b) $(1/4:%.3f) "${a}" ${s} $(sqrt(v_a+1)^2) ${t}
"""
    third = 3 / 7
    last = (
        "c",
        "3",
        "3",
        f"{third:.15g}",
        f"{float(f'{third:.15g}'):.20g}",
        "0.250",
        "${a}",
        "hello",
        "4",
        f"{2 * math.pi:.15g}",
    )
    assert _words(text) == [last]


def test_a_variable_in_a_formula_has_15_digits() -> None:
    """As LAMMPS of 2025-07-22 prints it."""
    text = "variable b equal 1/3\nvariable c equal v_b*3\nc ${c} $(v_b*3:%.17g)"
    assert _words(text) == [("c", "0.999999999999999", "0.99999999999999889")]


def test_the_first_definition_of_an_index_holds_and_so_does_one_from_outside() -> None:
    script = Script(NOTHING.__getitem__, {"dt": ("index", ("5e-9",))})
    assert [one.words for one in script.commands("in", "variable dt index 1e-8\ntimestep ${dt}")] == [
        ("timestep", "5e-9")
    ]


@examples(60)
@given(st.lists(st.tuples(st.sampled_from("+-*/"), st.integers(1, 9)), min_size=1, max_size=6), st.integers(1, 9))
def test_formulas_have_the_values_of_arithmetic(rest: list[tuple[str, int]], first: int) -> None:
    formula = f"{first}" + "".join(f"{sign}{number}" for sign, number in rest)
    [words] = _words(f"c $({formula}:%.17g)")
    # whole numbers are no integers to LAMMPS
    floats = f"{first}.0" + "".join(f"{sign}{number}.0" for sign, number in rest)
    assert float(words[1]) == eval(floats)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("c ${none}", "line 1: `c ${none}` uses the variable none, which is not defined"),
        ("variable i getenv HOME\nc ${i}", "variable i of style getenv, whose value is known during a run only"),
        ("variable i loop 3 1", "is not a loop; allowed: variable NAME loop N"),
        ("variable k equal ke\nc ${k}", "formula 'ke', which is not a constant"),
        ("variable k equal v_k\nc ${k}", "formula 'v_k', which is not a constant"),
        ("c $(-2^2)", "not a constant"),
        ("c $(2^3^2)", "not a constant"),
        ("c $(1/0)", "not a constant"),
        ("c $(9^9^9)", "not a constant"),
        ("c $(__import__)", "not a constant"),
        ("c $(1+1", "has $( without its )"),
        ("c $(1:%s)", "not a constant"),
        ("variable i loop 2\nvariable k index 1 2\nnext i k", "names variables of several styles"),
        ("variable x", "is incomplete; allowed: variable NAME"),
        ("include gone", "names the file gone, which cannot be read"),
    ],
)
def test_what_has_no_value_is_refused(text: str, why: str) -> None:
    assert why in _message(text)


def test_a_file_that_includes_itself_is_refused() -> None:
    assert "is nested too deeply; allowed: one file, nested at most 20 times" in _message(
        "include a", {"a": "include a"}
    )


def test_loops_and_branches_run_as_in_lammps() -> None:
    text = """variable i loop 2 4
variable name index a b c
label begin
if "${i} > 2 && ${name} != a" then "c ${i} ${name}" elif "${name} == a" "first ${i}" "again" else "no"
next i
next name
jump SELF begin
variable k loop 1 2 pad
variable gone delete
after ${k}
"""
    assert _words(text) == [("first", "2"), ("again",), ("c", "3", "b"), ("c", "4", "c"), ("after", "1")]


def test_a_jump_out_of_a_loop_and_into_another_file() -> None:
    text = 'variable i loop 9\nlabel a\nif "${i} == 3" then "jump SELF out"\nc ${i}\nnext i\njump SELF a\n'
    text += "label out\njump b"
    assert _words(text, {"b": "d ${i}\n"}) == [("c", "1"), ("c", "2"), ("d", "3")]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("label a\njump SELF a", "loop that does not end"),
        ("jump SELF", "loop that does not end"),
        ("include b\ninclude b", "nested too deeply"),
        ("variable a string xx\nlabel a\nvariable a string ${a}${a}\njump SELF a", "characters long"),
        (
            "\n".join(f"variable v{k} equal v_v{k + 1}+v_v{k + 1}+v_v{k + 1}" for k in range(18)) + "\nc ${v0}",
            "not defined",
        ),
        ("c $(1:%.999999999f)", "not a constant"),
        ("variable i loop 2000000000\nlabel a\nnext i\njump SELF a", "loop that does not end"),
    ],
)
def test_a_script_without_an_end_is_refused(text: str, problem: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dem_bridge.lmp.reader.script.MOST_WORK", 100_000)  # a tenth
    with pytest.raises(SceneError, match=problem):
        _words(text, {"b": "include c\ninclude c", "c": "include b\ninclude b"})


def test_all_problems_are_listed_but_not_those_that_follow_from_others() -> None:
    text = "variable a equal ${none}\nc ${a}\nvariable b equal v_a\nc ${b}\nd ${other}\nvariable e loop 0\nc ${e}"
    with pytest.raises(SceneError) as caught:
        _words(text)
    lines = str(caught.value).splitlines()
    assert [line.split("`")[0] for line in lines] == ["in.test, line 1: ", "in.test, line 5: ", "in.test, line 6: "]


def test_a_variable_without_a_name_is_refused() -> None:
    with pytest.raises(SceneError, match="line 1: `variable`"):
        _words("variable\nc 1")


def test_an_endless_loop_of_commands_that_cannot_be_read_ends_soon() -> None:
    script = Script(NOTHING.__getitem__)
    with pytest.raises(BlockedScript, match="uses the variable nothing, which is not defined"):
        list(script.commands("in.test", "label a\nvariable b equal ${nothing}\njump SELF a\n"))
    assert script._work < 1_100_000
    assert sum(1 for _ in script.blockers) < 10


def test_a_long_file_of_another_kind_is_recognised_at_once(tmp_path: Path) -> None:
    (tmp_path / "numbers").write_text("# ids\n2\n1 0.5\n2 1e-3\n")
    (tmp_path / "other").write_text("1.0 2.0 " * 20_000 + "x\n")
    opened = files_of(tmp_path)
    assert opened("numbers").startswith("# ids")
    with pytest.raises(OSError, match="neither a LAMMPS script nor a data file"):
        opened("other")


_ATOMS = "\n".join(f"{k} 1 0.1 2000 {k} 0 0" for k in range(1, 1001))
#: a data file of 1000 atoms, and rows that are no data file
_FILES = {
    "data": f"x\n1000 atoms\n1 atom types\n0 2000 xlo xhi\n-1 1 ylo yhi\n-1 1 zlo zhi\nAtoms # sphere\n\n{_ATOMS}\n",
    "rows": "1000\n" + "\n".join(f"{k} 1.0" for k in range(1, 1001)),
    "bad": "x\nfoo\n" + "1 2 3\n" * 10_000,
    "labels": "label b\n" * 10_000,
}
_LONG = "1&&" * 5_000 + "1"


@pytest.mark.parametrize(
    ("before", "body"),
    [
        ("", "print " + "x" * 19_000),
        ("", "print " + "x" * 1_000_000),
        (f"variable b equal {_LONG}", "print ${b}"),
        ("", "read_data bad"),
        ("", "jump labels c"),
        ("read_data data\nregion r sphere 0 0 0 1e9", "group g region r"),
        ("read_data data\ngroup b type 1", "group g union all b b b"),
        ("read_data data\nvariable m atomfile rows", "set type 1 mass v_m"),
        ("read_data data", "set type 1 " + "mass 1.0 " * 500),
    ],
)
def test_the_work_of_a_loop_is_that_of_the_texts_and_atoms_of_its_commands(
    before: str, body: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dem_bridge.lmp.reader.script.MOST_WORK", 20_000)
    rounds, lines_of = list[str](), Script.lines_of

    def counted(script: Script, file: str, *settings: Any) -> Any:
        rounds.append(file)
        return lines_of(script, file, *settings)

    monkeypatch.setattr(Script, "lines_of", counted)
    text = f"units si\natom_style sphere\n{before}\nlabel a\n{body}\njump SELF a\n"
    with pytest.raises(BlockedScript, match=r"(in\.test|bad), line"):
        read_script(text, file="in.test", opened=_FILES.__getitem__)
    assert len(rounds) < 100  # 20,000 of work; a round of two short commands takes 20


def test_a_particle_may_be_too_large_for_its_volume() -> None:
    particle = Particle(number=1, kind=1, place=[0.0, 0.0, 0.0], diameter=1e200)
    particle.made_of(1000.0)
    assert particle.mass == math.inf


@pytest.mark.parametrize(("text", "value"), [("-(2+1)", -3.0), ("+2", 2.0), ("3*-2", -6.0), ("-PI", -math.pi)])
def test_signs_stand_before_numbers_and_brackets(text: str, value: float) -> None:
    names: dict[str, float] = {}
    assert evaluated(text, names.__getitem__) == value
