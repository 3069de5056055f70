"""A misspelt field of a sentence of a study is found when the tests start."""

from __future__ import annotations

from copy import deepcopy

import pytest

from tests.report.test_fields import PAGES, code, misspelt


@pytest.mark.parametrize(
    ("page", "group", "key"),
    [
        ("bands", "sentences", "measured"), ("bands", "verdicts", "edge"), ("bands", "tables", "edges"),
        ("horizon", "panels", "energy"), ("horizon", "figures", "horizon-distribution"),
        ("claims", "decelerates", "each"), ("paper", "answer", "codes"), ("overview", "within", "energy"),
    ],
)  # fmt: skip
def test_a_misspelt_field_is_found(page: str, group: str, key: str) -> None:
    lines = misspelt(page, group, key)
    assert lines
    assert all(f"{page}.toml, {group}." in line for line in lines)


def test_a_field_of_the_page_that_a_call_does_not_give_is_found() -> None:
    content = deepcopy(PAGES["bands"])
    content["sentences"]["edges"] += " {tolerance}"
    [line] = code().unknown_fields("bands", content)
    assert line.startswith("bands.toml, sentences.edges: {tolerance} has no value in dem_bridge.studies.bands, line ")


def test_a_misspelt_attribute_of_a_field_is_found() -> None:
    content = deepcopy(PAGES["extremes"])
    content["sentences"]["nearest"] = content["sentences"]["nearest"].replace("finding.ratio", "finding.ratoi")
    [line] = code().unknown_fields("extremes", content)
    assert "{row.finding.ratoi}" in line
