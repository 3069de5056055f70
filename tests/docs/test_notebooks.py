"""The notebooks of the documentation: they are executed when it is built, and a wrong cell ends the build."""

from __future__ import annotations

import doctest
import json
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "_ext"))
notebooks: Any = pytest.importorskip("notebooks")
FILES = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def test_there_are_three_and_none_holds_outputs_of_another_day() -> None:
    assert [file.stem for file in FILES] == ["a-chain", "an-ensemble", "my-code-judged"]
    for file in FILES:
        book = json.loads(file.read_text(encoding="utf-8"))
        assert book["nbformat"] == 4
        assert all(not cell.get("outputs") for cell in book["cells"])
        assert f"notebooks/{file.stem}\n" in (ROOT / "docs" / "index.md").read_text(encoding="utf-8")


def test_the_examples_of_the_extension() -> None:
    result = doctest.testmod(notebooks)
    assert (result.failed, result.attempted > 0) == (0, True)


def test_a_cell_that_is_wrong_ends_the_build_and_is_named() -> None:
    cell = {"cell_type": "code", "source": "1 / 0"}
    with pytest.raises(ZeroDivisionError) as error:
        notebooks.page_of({"cells": [cell]}, "bad.ipynb")
    assert str(error.traceback[-1].path).endswith("bad.ipynb, cell 1")


def test_my_code_is_judged_as_the_page_says() -> None:
    [file] = [file for file in FILES if file.stem == "my-code-judged"]
    page = notebooks.page_of(json.loads(file.read_text(encoding="utf-8")), file.name)
    assert "half-step-velocity" in page
    assert "data:image/png;base64," in page
