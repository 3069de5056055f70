"""The page in a browser: nothing is cut, tables sort, on paper the appendix is unfolded, axe finds nothing.

These tests need Chromium; that of accessibility needs axe-core, too: ``npm install --no-save axe-core@4.14.1``, or the
path of ``axe.min.js`` in the variable AXE_CORE. With DEM_BRIDGE_REQUIRE_BROWSER=1 they fail where either is missing.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from dem_bridge.report.page import write_study
from tests.helpers.browser import BROWSER, REQUIRED, asked, browse, needs_axe, violations
from tests.helpers.fake_paper import fake_paper

pytestmark = [pytest.mark.browser, pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="no Chromium")]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    write_study(fake_paper(), folder)
    return folder / "index.html"


#: notes errors, failed loads and complaints from the first line of the page on
_WATCH = """<script>window.faults = [];
addEventListener("error", (event) => faults.push(event.message || event.target.src || event.target.href), true);
addEventListener("unhandledrejection", (event) => faults.push(String(event.reason)));
for (const kind of ["error", "warn"]) console[kind] = (...words) => faults.push(words.join(" "));</script>"""
#: everything is opened and clicked; then the faults, and the addresses of all that was loaded
_FAULTS = """
for (const one of document.querySelectorAll("details")) one.open = true;
for (const one of document.querySelectorAll("[role=button], button, summary")) one.click();
setTimeout(() => {
  told.textContent = JSON.stringify([faults, performance.getEntriesByType("resource").map((one) => one.name)]);
}, 2000);
return [["no answer"], []];
"""


def _faults(page: Path, folder: Path, more: str = "") -> Any:
    """Return the faults of a page with something added, and what it loads."""
    watched = folder / "watched.html"
    text = page.read_text(encoding="utf-8").replace("<head>", f"<head>{_WATCH}", 1)
    assert _WATCH in text
    watched.write_text(text.replace("</body>", f"{more}</body>"), encoding="utf-8")
    return asked(watched, folder, _FAULTS, "--virtual-time-budget=10000")


def test_the_console_has_no_error_and_nothing_is_loaded(page: Path, tmp_path: Path) -> None:
    assert _faults(page, tmp_path) == [[], []]


def test_an_error_a_complaint_and_a_picture_from_elsewhere_are_caught(page: Path, tmp_path: Path) -> None:
    picture = "http://127.0.0.1:9/x.png"  # nobody listens there
    more = f'<img src="{picture}"><script>console.error("bad")</script><script>nothing.here</script>'
    faults, loaded = _faults(page, tmp_path, more)
    assert {"bad", "Uncaught ReferenceError: nothing is not defined", picture} <= set(faults)
    assert loaded == [picture]


#: what is wider than the window, but for what may be scrolled; texts that leave their cell
_CUT = """
for (const one of document.querySelectorAll("details")) one.open = true;
const cut = [];
for (const one of document.querySelectorAll("body *:not(.scroll *)"))
  if (one.getBoundingClientRect().right > innerWidth + 1) cut.push(one.outerHTML.slice(0, 80));
for (const one of document.querySelectorAll("td, th"))
  if (one.scrollWidth > one.clientWidth + 1) cut.push(one.outerHTML.slice(0, 80));
if (document.documentElement.scrollWidth > innerWidth) cut.push("page");
return cut;
"""


@pytest.mark.parametrize("width", [1280, 800, 500])
def test_nothing_is_cut_nor_wider_than_the_window(page: Path, tmp_path: Path, width: int) -> None:
    assert asked(page, tmp_path, _CUT, f"--window-size={width},900") == []


def _cut_on_a_phone(page: Path, folder: Path, more: str = "") -> Any:
    """Return what is cut in a frame of 390 pixels, because no window of Chromium is as narrow as a phone."""
    script = f'<script>parent.postMessage(JSON.stringify((() => {{{_CUT}}})()), "*")</script>'
    text = page.read_text(encoding="utf-8").replace("</body>", f"{more}{script}</body>")
    (folder / "inner.html").write_text(text, encoding="utf-8")
    frame = '<pre id="told"></pre><iframe src="inner.html" style="width: 390px; height: 900px"></iframe>'
    listening = "<script>onmessage = (event) => { told.textContent = event.data; };</script>"
    (folder / "outer.html").write_text(f"<!DOCTYPE html>{listening}{frame}", encoding="utf-8")
    where = (f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=5000", "--window-size=600,900")
    shown = browse(*where, "--dump-dom", (folder / "outer.html").as_uri())
    return json.loads(unescape(re.findall(r'<pre id="told">(.*?)</pre>', shown, re.DOTALL)[0]))


def test_on_a_phone_nothing_is_cut_and_what_is_too_wide_is_caught(page: Path, tmp_path: Path) -> None:
    assert _cut_on_a_phone(page, tmp_path) == []
    assert len(_cut_on_a_phone(page, tmp_path, '<p style="width: 400px">too wide</p>')) == 2


def test_headings_sort_by_click_and_by_key_numbers_by_value_and_outcomes_by_severity(
    page: Path, tmp_path: Path
) -> None:
    script = """
const rows = (table) => table.tBodies.length > 1 ? [...table.tBodies].map((one) => one.rows[0]) : table.tBodies[0].rows;
const column = (table, at) => [...rows(table)].map((row) => row.cells[at].textContent);
const button = (table, at) => table.tHead.rows[0].cells[at].querySelector("[role=button]");
const claims = document.querySelector("table.claims"), budget = document.querySelector("#table-budget table");
button(claims, 3).click();
const severity = column(claims, 3), together = [...claims.tBodies].every((one) => one.rows.length === 2);
const press = (key) => button(budget, 3).dispatchEvent(new KeyboardEvent("keydown", { key }));
press("Enter");
const up = column(budget, 3);
press(" ");
button(budget, 2).click();
return [severity, together, up, column(budget, 2), button(budget, 2).tabIndex,
        [...budget.tHead.rows[0].cells].map((one) => one.getAttribute("aria-sort"))];
"""
    severity, together, up, holes, tab, aria = asked(page, tmp_path, script)
    assert list(dict.fromkeys(severity)) == ["exceeds our limit", "undecided", "not run", "theory off", "holds"]
    assert together
    assert up == ["2.2e-11", "1.5e-06", "0.0036", "0.008", "0.021", "0.031", "0.068"]
    assert holes == ["0.02", "0.05", "0.178", "–", "–", "–", "–"]
    assert tab == 0
    assert aria == [None, None, "ascending", None, None, None]


def test_a_link_into_a_fold_opens_it(page: Path, tmp_path: Path) -> None:
    script = 'return ["table-scatter", "table-validity"].map((id) => document.getElementById(id).open);'
    assert asked(page, tmp_path, script, hash="#table-scatter") == [True, False]


def _printed(page: Path, folder: Path) -> Path:
    """Print a page, and return the PDF."""
    pdf = folder / "page.pdf"
    browse(f"--user-data-dir={folder / 'profile'}", "--no-pdf-header-footer", f"--print-to-pdf={pdf}", page.as_uri())
    return pdf


def _words(pdf: Path, *options: str) -> str:
    return subprocess.run(["pdftotext", *options, pdf, "-"], capture_output=True, text=True, check=True).stdout


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="no pdftotext")
def test_on_paper_the_body_is_printed_and_of_the_appendix_nothing_that_is_folded(page: Path, tmp_path: Path) -> None:
    text = _words(_printed(page, tmp_path), "-layout")
    for words in ("200 seeded chains", "largest residence time (s)", "Settings and costs of all runs"):
        assert words not in text
    assert "folded on the screen are not printed" in text
    assert text.count("\f") <= 13


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="no pdftotext")
def test_on_paper_open_parts_are_printed_headings_repeat_and_no_sheet_is_shrunk(page: Path, tmp_path: Path) -> None:
    unfolded = tmp_path / "open.html"
    unfolded.write_text(page.read_text(encoding="utf-8").replace("<details", "<details open"), encoding="utf-8")
    pdf = _printed(unfolded, tmp_path)
    text = _words(pdf, "-layout")
    for words in ("200 seeded chains", "largest residence time (s)", "Settings and costs of all runs"):
        assert words in text
    sheets = text.split("\f")
    assert sum("arrival (ms)" in sheet for sheet in sheets) >= 3  # 200 rows, about 65 a sheet
    # the abstract and its figure stand on the first sheet, and the appendix begins on one of its own, behind 12 at most
    assert "Question" in sheets[0]
    assert "LAMMPS, time step" in sheets[0]
    first = next(nth for nth, sheet in enumerate(sheets) if sheet.strip().startswith("Appendix"))
    assert 2 <= first <= 12
    boxes = _words(pdf, "-bbox")
    wide = float(re.findall(r'<page width="([\d.]+)"', boxes)[0])
    assert wide == pytest.approx(595.3, abs=1.0)  # A4 portrait
    assert _height_of_title(boxes) > 16.0  # 14 pt: lower if Chromium shrinks all sheets because something is too wide
    assert _smallest(boxes) >= 8.0


def _height_of_title(boxes: str) -> float:
    """Return the height of the letters of the title, points."""
    low, high = re.findall(r'yMin="([\d.]+)" xMax="[\d.]+" yMax="([\d.]+)">Chaunsali', boxes)[0]
    return float(high) - float(low)


def _smallest(boxes: str) -> float:
    """Return the size of the smallest words of three letters or more, points; the title has 14."""
    words = re.findall(r'yMin="([\d.]+)" xMax="[\d.]+" yMax="([\d.]+)">[A-Za-z]{3,}<', boxes)
    return round(14.0 * min(float(high) - float(low) for low, high in words) / _height_of_title(boxes), 2)


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="no pdftotext")
def test_something_too_wide_for_a_sheet_or_too_small_to_read_is_caught(page: Path, tmp_path: Path) -> None:
    wide = tmp_path / "wide.html"
    text = page.read_text(encoding="utf-8")
    faults = '<p style="width: 1000px">too wide</p><p style="font-size: 7pt">too small</p>'
    wide.write_text(text.replace("</main>", f"{faults}</main>"), encoding="utf-8")
    boxes = _words(_printed(wide, tmp_path), "-bbox")
    assert _height_of_title(boxes) < 16.0
    assert _smallest(boxes) == pytest.approx(7.0, abs=0.05)


@needs_axe
@pytest.mark.parametrize("dark", [False, True])
def test_axe_finds_nothing(page: Path, tmp_path: Path, dark: bool) -> None:
    assert violations(page, tmp_path, dark) == []


@needs_axe
def test_axe_finds_a_picture_without_words_and_a_page_without_a_language(page: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.html"
    text = page.read_text(encoding="utf-8").replace('<html lang="en">', "<html>").replace("aria-label=", "data-label=")
    bad.write_text(text, encoding="utf-8")
    assert {"html-has-lang", "svg-img-alt"} <= set(violations(bad, tmp_path))
