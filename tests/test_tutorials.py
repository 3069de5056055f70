"""The tutorials run as written and print what they say; and the runner of this sees a page that is wrong."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from PIL import Image

from tests.helpers.tutorial_runner import Drift, run, steps

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
NAMES = [page.stem for page in PAGES]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_all_tutorials_are_there() -> None:
    assert NAMES == ["choose-dt-and-table", "compare-with-a-measurement", "judge-my-code", "trust-my-chain"]


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_a_tutorial_runs_as_written_and_makes_its_pictures(page: Path, folder: Path) -> None:
    text = page.read_text(encoding="utf-8")
    run(text, folder)
    for name in re.findall(r"!\[[^\]]+\]\((\S+)\)", text):
        # letters differ between releases of matplotlib, the page does not
        with Image.open(folder / name) as made, Image.open(page.parent / name) as shown:
            assert made.size == shown.size, name
        assert (page.parent / name).stat().st_size < 60_000, name


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_all_that_a_tutorial_links_to_is_there(page: Path) -> None:
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_each_page_has_at_most_two_pictures_and_no_block_without_a_run(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(re.findall(r"!\[", text)) <= 2
    assert len(list(steps(text))) > 10
    # an output that no step prints would never be compared
    printed = [step for step in steps(text) if step.kind == "python" and step.printed]
    assert len(printed) == text.count("```text")


FENCE = "```"
GOOD = f"""
{FENCE}toml
# one.toml
name = "one"
{FENCE}

{FENCE}python
value = 3
print("value", value)
{FENCE}

{FENCE}text
value 3
{FENCE}

{FENCE}console
$ echo "a  b"; cat one.toml
a  b
# one.toml
...
$ true
{FENCE}

{FENCE}python
assert value == 3
{FENCE}
"""


def test_a_page_that_is_right_passes(folder: Path) -> None:
    run(GOOD, folder)


@pytest.mark.parametrize(
    ("right", "wrong", "line"),
    [
        ("value 3\n", "value 4\n", 8),
        ("a  b\n#", "a b\n#", 17),
        ("$ true\n", "$ true\nand more\n", 21),
        ("$ true\n", "$ false\n", 21),
        ("value = 3\n", "value = 3\nprint()\n", 8),
        (f"{FENCE}text\nvalue 3\n{FENCE}\n", "", 8),
        ("# one.toml\nname", "name", 3),
        (f"{FENCE}console\n$ echo", f"{FENCE}console\necho", 17),
        (f"{FENCE}text\nvalue", f"{FENCE}result\nvalue", 13),
    ],
)
def test_a_page_that_drifts_is_caught_at_its_line(folder: Path, right: str, wrong: str, line: int) -> None:
    assert right in GOOD
    with pytest.raises(Drift, match=rf"^line {line}:"):
        run(GOOD.replace(right, wrong, 1), folder)
