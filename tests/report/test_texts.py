"""Texts of the pages of studies: numbers are in the units of their headings, and every text is used."""

from __future__ import annotations

import math
import re
import tomllib
from collections import namedtuple
from pathlib import Path
from typing import Any

import pytest

import dem_bridge
from dem_bridge.report.columns import MILLISECOND, PERCENT, Column
from dem_bridge.report.texts import Texts

FOLDERS = [Path(dem_bridge.__file__).parent / room for room in ("report", "verification", "judging", "studies")]
PAGES = [file for folder in FOLDERS for file in sorted((folder / "pages").glob("*.toml"))]
CODE = "\n".join(file.read_text(encoding="utf-8") for folder in FOLDERS for file in folder.rglob("*.py"))
Run = namedtuple("Run", ("scene", "wall", "error", "count"))
Scene = namedtuple("Scene", ("name",))


@pytest.fixture
def texts() -> Texts:
    result = Texts("none", "dem_bridge.studies")
    result.__dict__["data"] = {
        "sentences": {"share": "{share:.1f %} of {run.scene.name}"},
        "tables": {"runs": {"title": "Runs", "caption": "Of {which}."}},
    }
    return result


def test_cells_are_in_the_unit_of_their_column(texts: Texts) -> None:
    runs = [Run(Scene("a"), 0.25, 0.5, 3), Run(None, None, math.inf, 0)]
    columns = {
        "scene.name": "scene", "wall": Column("wall, least", MILLISECOND),
        "error": Column("error", PERCENT, of="of all"), "count": "count",
    }  # fmt: skip
    table = texts.table("runs", columns, runs, which="least")
    assert table.columns == ("scene", "wall, least (ms)", "error (% of all)", "count")
    assert table.caption == "Of least."
    assert table.rows[0] == ("a", 250.0, 50.0, 3.0)
    assert [str(cell) for cell in table.rows[1]] == ["nan", "nan", "inf", "0.0"]


@pytest.mark.parametrize("name", ["wall (s)", "wall (%)", "wall"])
def test_no_wording_of_a_heading_changes_a_number(name: str, texts: Texts) -> None:
    table = texts.table("runs", (Column(name, MILLISECOND), name), [(0.25, 0.25)], which="least")
    assert table.columns == (f"{name} (ms)", name)
    assert table.rows == ((250.0, 0.25),)


def test_shares_in_sentences_are_per_cent(texts: Texts) -> None:
    assert texts("share", share=0.123, run=Run(Scene("a"), 0.0, 0.0, 0)) == "12.3 % of a"
    with pytest.raises(KeyError, match="run"):
        texts("share", share=0.123)


@pytest.mark.parametrize("file", PAGES, ids=lambda file: file.stem)
def test_every_text_is_used(file: Path) -> None:
    data: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
    assert f'Texts("{file.stem}", ' in CODE
    for kind in ("sentences", "tables", "panels", "figures", "verdicts"):
        for key in data.get(kind, {}):
            assert re.search(rf"[\"']{re.escape(key)}[\"']", CODE), f"{file.name}: nobody reads {kind}.{key}"
