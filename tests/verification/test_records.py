"""The crate of a report describes every file, and the project describes itself in the same words everywhere."""

from __future__ import annotations

import hashlib
import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from dem_bridge.report.page import write_study
from dem_bridge.verification.records import NAME
from dem_bridge.version import __version__
from tests.helpers.fake_paper import NOTHING, fake_paper

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("paper")
    write_study(fake_paper(), path)
    return path


def _references(value: Any) -> set[str]:
    """Return all ids to which a value refers."""
    if isinstance(value, list):
        return {id for item in value for id in _references(item)}
    if isinstance(value, dict):
        return {value["@id"]} if set(value) == {"@id"} else {id for item in value.values() for id in _references(item)}
    return set()


def check_crate(crate: dict[str, Any], folder: Path) -> None:
    """Assert that a crate has what the profile requires, and describes all files of a folder as they are."""
    entities = {entity["@id"]: entity for entity in crate["@graph"]}
    assert len(entities) == len(crate["@graph"])
    assert entities[NAME]["about"] == {"@id": "./"}
    root, [action] = entities["./"], [e for e in entities.values() if e["@type"] == "CreateAction"]
    assert {"name", "description", "datePublished", "license"} <= set(root)
    assert root["mentions"] == [{"@id": action["@id"]}]
    missing = _references(crate["@graph"]) - set(entities) - {"https://w3id.org/ro/crate/1.1"}
    assert not missing, f"missing entities: {missing}"
    assert entities[action["instrument"]["@id"]]["@type"] == "SoftwareApplication"
    present = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} - {NAME}
    assert {part["@id"] for part in root["hasPart"]} == present
    for name in present:
        content = (folder / name).read_bytes()
        assert entities[name]["contentSize"] == str(len(content))
        assert entities[name]["sha256"] == hashlib.sha256(content).hexdigest(), "another checksum"


def test_the_crate_of_a_paper_describes_every_file(folder: Path) -> None:
    crate = json.loads((folder / NAME).read_text(encoding="utf-8"))
    check_crate(crate, folder)
    assert fake_paper().abstract[0].points[0] in crate["@graph"][1]["description"]


def test_a_crate_with_a_missing_entity_or_another_file_is_caught(folder: Path) -> None:
    text = (folder / NAME).read_text(encoding="utf-8")
    program, checksum = '"@id": "#dem_bridge",\n   "@type"', '"sha256": "'
    for right, planted, said in (
        (program, program.replace("dem_bridge", "other"), "missing entities"),
        (checksum, f"{checksum}0", "another checksum"),
    ):
        assert right in text
        with pytest.raises(AssertionError, match=said):
            check_crate(json.loads(text.replace(right, planted)), folder)


def test_the_committed_report_is_small_and_its_crate_describes_every_file() -> None:
    folder = ROOT / "reports/paper"
    check_crate(json.loads((folder / NAME).read_text(encoding="utf-8")), folder)
    assert (folder / "index.html").stat().st_size < 1_500_000


def test_other_reports_have_no_crate() -> None:
    assert NAME not in NOTHING.page_files()


def test_codemeta_agrees_with_the_metadata_of_the_package() -> None:
    codemeta = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert codemeta["version"] == __version__
    assert codemeta["identifier"] == project["name"]
    assert codemeta["description"] == project["description"]
    assert codemeta["keywords"] == project["keywords"]
    assert codemeta["license"].endswith(project["license"])
    assert codemeta["runtimePlatform"] == f"Python {project['requires-python']}"
    assert [author["name"] for author in codemeta["author"]] == [author["name"] for author in project["authors"]]
