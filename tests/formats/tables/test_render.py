"""Every format read back by its usual reader: machines get the same doubles, people the digits that bars leave."""

from __future__ import annotations

import importlib.util
import io
import json
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, Literal

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict

from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.render import (
    FORMATS,
    SUFFIXES,
    as_csv,
    as_json,
    as_markdown,
    as_parquet,
    as_tex,
    format_for,
)
from dem_bridge.formats.tables.table import Cell, Table, with_uncertainty
from dem_bridge.formats.units import UNITS
from tests.helpers.columns import counts, numbers, texts
from tests.helpers.foreign_readers import NUMBER, read_markdown, read_tex
from tests.helpers.strategies import examples

#: texts that mean something to one of the formats
NASTY = ["plain", 'comma, "quote"', "pipe | star *", r"100 % of a_b & {c} # $x$ ~ ^ \ <d>", "é µ", None]
arrow = pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="no pyarrow")

cells = st.one_of(st.none(), st.floats(allow_nan=False, allow_infinity=False))


@st.composite
def tables(draw: st.DrawFn) -> Table:
    """Columns of each kind with anything in them."""
    rows = draw(st.integers(1, 4))
    row = [draw(st.lists(cells, min_size=rows, max_size=rows)) for _ in range(3)]
    bars = draw(st.lists(st.one_of(st.none(), st.floats(1e-300, 1e300)), min_size=rows, max_size=rows))
    return Table(
        id="random",
        title="Random_table & more",
        columns=(
            counts(
                "body",
                "body",
                draw(st.lists(st.one_of(st.none(), st.integers(0, 2**62)), min_size=rows, max_size=rows)),
            ),
            numbers("one", "one", draw(st.sampled_from(list(UNITS))), row[0]),
            *with_uncertainty("two", "two", draw(st.sampled_from(list(UNITS))), row[1], bars),
            texts("word", "word_s", draw(st.lists(st.sampled_from(NASTY), min_size=rows, max_size=rows))),
        ),
        notes=("what is 100 % unknown is empty",),
        provenance={"scene": "random"},
    )


def _cells(frame: pd.DataFrame) -> list[tuple[Cell, ...]]:
    """What pandas read, None where it found nothing."""
    return [tuple(None if pd.isna(one) else one for one in row) for row in frame.itertuples(index=False)]


def _same(found: list[tuple[Cell, ...]], table: Table) -> None:
    assert found == table.rows
    zeros = [one for row in found for one in row if isinstance(one, float) and one == 0.0]
    wanted = [one for row in table.rows for one in row if isinstance(one, float) and one == 0.0]
    assert [math.copysign(1.0, one) for one in zeros] == [math.copysign(1.0, one) for one in wanted]


@examples(60)
@given(tables())
def test_csv_reads_back_by_pandas_digit_for_digit(table: Table) -> None:
    kinds = {one.name: {"number": "float64", "count": "Int64", "text": "string"}[one.kind] for one in table.columns}
    frame = pd.read_csv(io.StringIO(as_csv(table)), dtype=kinds)
    assert list(frame.columns) == [one.name for one in table.columns]
    _same(_cells(frame), table)


class _Column(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    name: str
    heading: str
    unit: str
    kind: Literal["number", "count", "text"]
    uncertainty_of: str | None


class _Document(BaseModel):
    """The schema dem-bridge/table/1, as a reader of it would have it."""

    model_config = ConfigDict(extra="forbid", strict=True, populate_by_name=True)
    schema_: Literal["dem-bridge/table/1"]
    table: str
    title: str
    columns: list[_Column]
    rows: list[dict[str, float | int | str | None]]
    notes: list[str]
    provenance: dict[str, Any]


def _document(text: str) -> _Document:
    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} is no JSON")

    given = json.loads(text, parse_constant=refuse)
    return _Document(schema_=given.pop("schema"), **given)


@examples(60)
@given(tables())
def test_json_keeps_its_schema_and_every_digit(table: Table) -> None:
    found = _document(as_json(table))
    names = [one.name for one in found.columns]
    assert all(list(row) == names for row in found.rows)
    _same([tuple(row.values()) for row in found.rows], table)
    assert all(one.uncertainty_of is None or one.uncertainty_of in names for one in found.columns)
    assert found.notes == list(table.notes)


@arrow
@examples(20)
@given(tables())
def test_parquet_reads_back_by_pandas_with_units_and_notes(table: Table) -> None:
    frame = pd.read_parquet(io.BytesIO(as_parquet(table)))
    _same(_cells(frame), table)
    assert frame.attrs["notes"] == list(table.notes)
    assert [one["unit"] for one in frame.attrs["columns"]] == [one.unit for one in table.columns]


def test_parquet_without_pyarrow_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    table = Table(id="t", title="t", columns=(counts("body", "body", [1]),))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for name in [name for name in sys.modules if name.startswith("pyarrow.")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(
        UsageError, match=r"^format = 'parquet' needs pyarrow, .* install dem-bridge\[parquet\], or use"
    ):
        as_parquet(table)


def _known(table: Table) -> list[int]:
    """Columns that people see: those in which anything is known."""
    return [nth for nth, one in enumerate(table.columns) if any(cell is not None for cell in one.values)]


def _power(heading: str) -> float:
    """The power of ten that a heading has, "(µm)" or "(10⁻⁹ N)"."""
    unit = re.search(r"\(([^()]*(?:\([^()]*\))?[^()]*)\)$", heading)
    if unit is None:
        return 1.0
    plain = unit[1]
    if plain in {one.text for one in UNITS.values()}:
        return 1.0
    if power := re.match(r"10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", plain):
        return float("1e" + power[1].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
    # kilogram has its prefix already
    scale = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}
    return scale[plain[0]] * 1e-3 if plain[1:] == "g" else 1e-3 if plain == "g" else scale[plain[0]]


def _check_rounding(table: Table, rows: list[list[str]], powers: list[float], missing: str) -> None:
    """Numbers for people are the values to within half of their last digit, and no digit is below the bar's first."""
    for place, nth in enumerate(_known(table)):
        column = table.columns[nth]
        if column.kind != "number":
            continue
        for row, (value, bar) in enumerate(zip(column.values, column.uncertainties or [None] * len(rows), strict=True)):
            text = rows[row][place]
            assert (value is None) == (text == missing)
            if value is None:
                continue
            assert NUMBER.fullmatch(text)
            number, last = float(text) * powers[place], _last_digit(text) * powers[place]
            # parsing and the power of ten round, too: a few ulp of the value
            assert abs(number - float(value)) <= 0.5 * last * (1.0 + 1e-6) + 4.0 * math.ulp(float(value))
            if bar is not None and value != 0.0 and abs(float(value)) > float(bar):
                exact = number == float(value)
                assert exact or last >= 0.99 * 10.0 ** math.floor(math.log10(float(bar)) - 1e-9)
            digits = len(re.sub(r"e.*|[-.]", "", text).lstrip("0"))
            assert digits <= 6 or "." not in text


def _last_digit(text: str) -> float:
    mantissa, _, power = text.partition("e")
    decimals = len(mantissa.partition(".")[2])
    if decimals == 0 and not power:  # trailing zeros before the point may be rounded away
        return 10.0 ** (len(mantissa) - len(mantissa.rstrip("0")))
    return 10.0 ** (int(power or 0) - decimals)


finite = st.one_of(st.none(), st.just(0.0), st.floats(1e-15, 1e15), st.floats(-1e15, -1e-15))


@st.composite
def measured(draw: st.DrawFn) -> Table:
    """Columns of numbers as physics has them, with bars."""
    rows = draw(st.integers(1, 4))
    some = st.lists(finite, min_size=rows, max_size=rows)
    bars = draw(st.lists(st.one_of(st.none(), st.floats(1e-18, 1e3)), min_size=rows, max_size=rows))
    return Table(
        id="random",
        title="Random_table & more",
        columns=(
            counts("body", "body", range(rows)),
            numbers("one", "one (of two)", draw(st.sampled_from(list(UNITS))), draw(some)),
            *with_uncertainty("two", "two", draw(st.sampled_from(list(UNITS))), draw(some), bars),
            texts("word", "word_s", draw(st.lists(st.sampled_from(NASTY), min_size=rows, max_size=rows))),
        ),
    )


@examples(100)
@given(measured())
def test_markdown_shows_the_digits_that_the_bar_leaves(table: Table) -> None:
    head, rows = read_markdown(as_markdown(table))
    known = [table.columns[nth] for nth in _known(table)]
    assert [text.startswith(one.heading) for text, one in zip(head, known, strict=True)] == [True] * len(known)
    powers = [_power(text.removeprefix(one.heading)) for text, one in zip(head, known, strict=True)]
    _check_rounding(table, rows, powers, "–")
    if "word" in [one.name for one in known]:
        assert [row[-1] for row in rows] == [word or "–" for word in table.columns[-1].values]


@examples(100)
@given(measured())
def test_latex_is_what_booktabs_and_siunitx_take(table: Table) -> None:
    found = read_tex(as_tex(table))
    head, rows = read_markdown(as_markdown(table))
    assert len(found.head) == len(head)
    kinds = [table.columns[nth].kind for nth in _known(table)]
    assert [kind == "l" for kind in found.types] == [kind == "text" for kind in kinds]
    for tex, markdown in zip(found.rows, rows, strict=True):
        for one, other, kind in zip(tex, markdown, kinds, strict=True):
            if kind != "text":
                assert one == ("{--}" if other == "–" else other)


PLAIN = Table(
    id="plain",
    title="Plain",
    columns=(
        texts("word", "a_b", NASTY),
        *with_uncertainty(
            "force", "force", "N", [254.6131, 1e-3, 0.0, None, 37.5, -2.0], [0.02, 1e-9, 0.1, None, None, 5.0]
        ),
        numbers("beta", "stiffness", "N/m^1.5", [7.27e10, 4.68e9, 5e9, 6e9, 7e9, 8e9]),
        numbers("over", "stiffness", "N/m^(n-1)", [1e-7, 2e-9, 4.0, 5.0, 6.0, 7.0]),
        numbers("axis", "axis", "m", [1.23456789e-5, 2e-6, 3e-6, 1.0 / 3e5, 5e-6, 6e-6]),
        numbers("mass", "mass", "kg", [8.1e-3, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2]),
        numbers("empty", "empty", "m", [None] * 6),
    ),
)


def test_a_table_for_people_as_it_stands() -> None:
    head, rows = read_markdown(as_markdown(PLAIN))
    assert head == [
        "a_b", "force (N)", "force, uncertainty (N)", "stiffness (10⁹ N/m^1.5)", "stiffness (N/m^(n-1))", "axis (µm)",
        "mass (g)",
    ]  # fmt: skip
    assert [row[1] for row in rows] == ["2.5461e2", "1.00000e-3", "0", "–", "3.7500e1", "-2e0"]
    assert [row[3] for row in rows] == ["72.7", "4.68", "5", "6", "7", "8"]
    assert [row[5] for row in rows] == ["12.346", "2.0000", "3.0000", "3.3333", "5.0000", "6.0000"]
    assert [row[6] for row in rows] == ["8.1", "10", "10", "10", "10", "10"]
    tex = as_tex(PLAIN)
    assert r"{stiffness ($10^{9}$ \si{\newton\per\metre\tothe{1.5}})}" in tex
    assert r"{axis (\si{\micro\metre})}" in tex
    assert r"100 \% of a\_b \& \{c\} \# \$x\$ \textasciitilde{} \textasciicircum{} \textbackslash{}" in tex


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex")
def test_latex_compiles(tmp_path: Path) -> None:
    text = "\n".join(
        [
            r"\documentclass{article}",
            r"\usepackage[utf8]{inputenc}",
            r"\usepackage[T1]{fontenc}",
            r"\usepackage{textcomp,booktabs,siunitx}",
            r"\begin{document}",
            as_tex(PLAIN),
            *(as_tex(Table(id="u", title="u", columns=(numbers("x", "x", unit, [1e-9, 2e-9]),))) for unit in UNITS),
            r"\end{document}",
        ]
    )
    (tmp_path / "t.tex").write_text(text, encoding="utf-8")
    if subprocess.run(["kpsewhich", "siunitx.sty"], capture_output=True).returncode:
        pytest.skip("no siunitx")
    words = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "-draftmode", "t.tex"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:]


def test_a_table_without_rows_is_still_one() -> None:
    empty = Table(id="e", title="e", columns=(counts("contact", "contact", []), numbers("x", "x", "m", [])))
    assert read_markdown(as_markdown(empty)) == (["contact", "x (m)"], [])
    assert read_tex(as_tex(empty)).rows == []
    assert as_csv(empty) == "contact,x_m\n"


def test_the_ending_of_a_file_tells_the_format_and_a_name_goes_before_it() -> None:
    # each of these tables has a format that no other one has
    tables = {"lammps": "pair-coeffs", "c": "constants"}
    named = {format_for(None, Path(f"a{suffix}"), tables.get(name, "bodies")) for suffix, name in SUFFIXES.items()}
    assert named == set(FORMATS)
    assert format_for("csv", Path("a.json"), "bodies") == "csv"
    wrong: dict[str, tuple[str | None, Path | None, str]] = {
        r"^a\.xlsx: no format has the file ending '\.xlsx'; allowed: \.csv, ": (None, Path("a.xlsx"), "bodies"),
        "^format = 'xls' is unknown; allowed: csv, json, ": ("xls", None, "bodies"),
        "^neither a format nor a file was given; allowed formats: ": (None, None, "bodies"),
        "^table 'bodies' cannot be written in the format 'lammps'; allowed: table 'pair-coeffs'": (
            "lammps",
            None,
            "bodies",
        ),
    }
    for message, asked in wrong.items():
        with pytest.raises(UsageError, match=message):
            format_for(*asked)
