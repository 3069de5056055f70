"""Every field of every sentence has a value: a misspelt one is found when the tests start, not after a study ran."""

from __future__ import annotations

import tomllib
from copy import deepcopy
from functools import cache
from pathlib import Path

import pytest

import dem_bridge
from tests.helpers.sentences import Code, Source, fields_of

ROOT = Path(dem_bridge.__file__).parent
FILES = [file for room in ("report", "verification", "judging", "studies") for file in (ROOT / room).rglob("*.py")]
PAGES = {file.stem: tomllib.loads(file.read_text(encoding="utf-8")) for file in sorted(ROOT.glob("*/pages/*.toml"))}


@cache
def code() -> Code:
    """Return the modules that fill texts."""
    return Code(
        [
            Source(file.read_text(encoding="utf-8"), ".".join(file.relative_to(ROOT.parent).with_suffix("").parts))
            for file in FILES
        ]
    )


def test_every_field_of_every_sentence_has_a_value() -> None:
    assert [line for page, content in PAGES.items() for line in code().unknown_fields(page, content)] == []


def misspelt(page: str, group: str, key: str) -> list[str]:
    """Return what is said when one field of a text of a page is misspelt."""
    content = deepcopy(PAGES[page])
    entry = content[group]
    if isinstance(entry[key], dict):
        entry, key = entry[key], next(name for name, text in entry[key].items() if fields_of(text))
    field = sorted(fields_of(entry[key]))[0]
    entry[key] = entry[key].replace("{" + field, "{" + field[:-1] + "q" + field[-1], 1)
    return [*code().unknown_fields(page, content)]


#: a text of each kind and room, with a field that no code gives; those of studies are in tests/studies/report
FAULTS = [
    ("verify", "sentences", "engine"), ("banner", "why", "step"), ("scope", "sentences", "code"),
    ("judge", "sentences", "error"), ("check", "panels", "error"),
]  # fmt: skip


@pytest.mark.parametrize(("page", "group", "key"), FAULTS)
def test_a_misspelt_field_is_found(page: str, group: str, key: str) -> None:
    lines = misspelt(page, group, key)
    assert lines
    assert all(f"{page}.toml, {group}." in line for line in lines)
