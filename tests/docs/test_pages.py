"""Examples on the pages of theory and how-to guides run and print what the pages show."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
THEORY, HOWTO = (sorted((DOCS / folder).glob("*.md")) for folder in ("theory", "howto"))
#: pages with console examples: all of these folders that have one
WITH_EXAMPLES = [page for page in (*THEORY, *HOWTO) if "```pycon" in page.read_text(encoding="utf-8")]


def results(page: Path) -> doctest.TestResults:
    """Run all console examples of a page in one namespace and return how many failed, and how many there are."""
    text = "\n".join(re.findall(r"^```pycon\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL))
    examples = doctest.DocTestParser().get_doctest(text, {}, page.stem, str(page), 0)
    return doctest.DocTestRunner(verbose=False).run(examples, out=lambda text: None)


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_print_what_it_shows(page: Path) -> None:
    failed, attempted = results(page)
    assert (failed, attempted > 0) == (0, True)


def test_a_number_that_is_wrong_is_caught(tmp_path: Path) -> None:
    text = (DOCS / "theory" / "contact.md").read_text(encoding="utf-8")
    assert "+17.77 %" in text
    page = tmp_path / "contact.md"
    page.write_text(text.replace("+17.77 %", "+17.78 %"), encoding="utf-8")
    assert results(page).failed == 1


@pytest.mark.studies  # two pages name modules of theirs
def test_every_theory_page_has_equations_and_names_sources_and_code() -> None:
    assert len(THEORY) >= 6
    for page in THEORY:
        text = page.read_text(encoding="utf-8")
        assert text.count("\n$$\n") >= 2, page.stem
        assert "\nIn the code: `dem_bridge/" in text, page.stem
        # definitions of the project itself, apart from those that name the paper
        assert "\n## Sources\n" in text or page.stem == "observables", page.stem
        for path, modules in re.findall(r"`(dem_bridge/[\w/.]+)`(?: \(([^)]*)\))?", text):
            assert (DOCS.parent / path).exists(), f"{page.stem}: {path}"
            for module in re.findall(r"`(\w+)`", modules):
                assert (DOCS.parent / path / f"{module}.py").exists(), f"{page.stem}: {path}{module}"


def test_the_guide_to_publications_prints_what_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "howto" / "publication.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    blocks = re.findall(r"^```python\n(.*?)^```$(?:\s+^```text\n(.*?)^```$)?", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 3
    for code, printed in blocks:
        exec(compile(code, "publication.md", "exec"), names)
        assert capsys.readouterr().out == printed
    assert {file.name for file in tmp_path.iterdir()} == {"map.pdf", "residence.pdf"}
