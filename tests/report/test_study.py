"""What a study shows, as plain data: nothing is lost on the way to JSON, CSV or the content of a picture."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Claim, ClaimValue, FigureData, Map, Panel, Series, Table

LINE = Series(label="law", style="guide", x=np.array([1.0, 2.0]), y=np.array([0.1, 1 / 3]))
BARRED = replace(LINE, label="run", style="reference", bar=np.array([1e-9, 2e-9]))
WAVE = Map(
    label="velocity (m/s)", x=np.array([1.0, 2.0, 3.0]), y=np.array([0.5, 1.5]), values=np.arange(6.0).reshape(2, 3)
)
LINES = Panel(title="(a) speed", x_label="cylinder", y_label="V (m/s)", series=(LINE, BARRED), notes=("a note",))
FIELD = Panel(title="(b) map", x_label="cylinder", y_label="t (ms)", map=WAVE)
FIGURE = FigureData(id="figure-3", title="Speed", caption="A caption.", panels=(LINES, FIELD))


def test_a_row_has_a_cell_for_each_column() -> None:
    with pytest.raises(ValueError, match=r"table t: 1 cells in a row of 2 columns: \(1\.0,\)"):
        Table(id="t", title="", caption="", columns=("a", "b"), rows=((1.0, 2.0), (1.0,)))


def test_a_table_as_csv_gives_every_number_back() -> None:
    rows = (("a, with a comma", 1 / 3), ('"quoted"', 1e-300), ("line\nbreak", -0.1))
    table = Table(id="t", title="", caption="", columns=("what", "how much (m)"), rows=rows)
    header, *found = csv.reader(io.StringIO(table.as_csv()))
    assert header == ["what", "how much (m)"]
    assert [(text, float(number)) for text, number in found] == list(rows)
    assert "\r" not in table.as_csv()


def test_a_claim_as_json_has_null_for_what_is_no_number() -> None:
    values = tuple(
        ClaimValue(name="x", backend="reference", value=value, uncertainty=bar, unit="s")
        for value, bar in ((1.5, 1e-9), (math.nan, math.inf), (2.0, math.nan))
    )
    claim = Claim(
        id="one", where="section 1", statement="It is.", outcome=Outcome.PASS, sentence="1.5 s.", values=values
    )
    found = json.loads(json.dumps(claim.as_json(), allow_nan=False))
    assert set(found) == {"id", "where", "statement", "outcome", "sentence", "short", "kind", "margin", "values"}
    assert found["outcome"] == "PASS"
    assert found["values"][0] == {"name": "x", "backend": "reference", "value": 1.5, "uncertainty": 1e-9, "unit": "s"}
    assert [(one["value"], one["uncertainty"]) for one in found["values"][1:]] == [(None, None), (2.0, None)]


def test_a_figure_as_csv_has_every_mark_and_every_cell_of_a_map() -> None:
    rows = list(csv.DictReader(io.StringIO(FIGURE.as_csv())))
    assert len(rows) == 2 + 2 + 6
    assert [(row["series"], float(row["y"]), row["bar"]) for row in rows[:4]] == [
        ("law", 0.1, ""), ("law", 1 / 3, ""), ("run", 0.1, "1e-09"), ("run", 1 / 3, "2e-09"),
    ]  # fmt: skip
    cells = {(float(row["x"]), float(row["y"])): float(row["value"]) for row in rows[4:]}
    assert cells == {(x, y): WAVE.values[j, i] for j, y in enumerate((0.5, 1.5)) for i, x in enumerate((1.0, 2.0, 3.0))}
    assert {row["panel"] for row in rows} == {"(a) speed", "(b) map"}


def _changed(**panel: Any) -> FigureData:
    return replace(FIGURE, panels=(replace(LINES, **panel), FIELD))


@pytest.mark.parametrize(
    "other",
    [
        replace(FIGURE, title="speed"),
        replace(FIGURE, caption=""),
        replace(FIGURE, id="figure-4"),
        replace(FIGURE, columns=1),
        replace(FIGURE, panels=(LINES,)),
        replace(FIGURE, panels=(FIELD, LINES)),
        _changed(x_label="contact"),
        _changed(log=True),
        _changed(notes=("a", "note")),
        _changed(shares_scale_with=(1,)),
        _changed(series=(LINE,)),
        _changed(series=(replace(LINE, y=np.array([0.1, np.nextafter(1 / 3, 1.0)])), BARRED)),
        _changed(series=(replace(LINE, bar=np.zeros(2)), BARRED)),
        _changed(series=(replace(LINE, style="fit"), BARRED)),
        replace(FIGURE, panels=(LINES, replace(FIELD, map=replace(WAVE, diverging=True)))),
        replace(FIGURE, panels=(LINES, replace(FIELD, map=replace(WAVE, values=WAVE.values.reshape(3, 2))))),
    ],
)
def test_the_content_differs_where_anything_does(other: FigureData) -> None:
    assert other.content() != FIGURE.content()


def test_the_content_is_that_of_the_numbers_and_not_of_their_places_in_memory() -> None:
    copies = tuple(
        replace(one, x=one.x.copy(), y=one.y[::-1].copy()[::-1], bar=None if one.bar is None else one.bar.copy())
        for one in (LINE, BARRED)
    )
    assert _changed(series=copies).content() == FIGURE.content()
