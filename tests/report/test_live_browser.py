"""What a page plays, in a browser: slider, pointer and keys show values of the run; without a script all is readable.

These tests need Chromium; that of accessibility needs axe-core, see :mod:`tests.helpers.browser`.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.page import write_study
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import assign_roles
from dem_bridge.verification.verification import verification_of
from tests.helpers.browser import BROWSER, REQUIRED, asked, needs_axe, violations
from tests.helpers.fake_runs import free_flight

pytestmark = [pytest.mark.browser, pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="no Chromium")]

#: a wave along 40 bodies that is known everywhere: body k has its largest velocity at k times 10 us
SCENE = Scene(
    name="wave", duration=5e-4, mass=(1e-2,) * 40, stiffness=(4e9,) * 39, velocity=(0.8, *[0.0] * 39), samples=250
)
TIME = np.linspace(0.0, 5e-4, 251)
VELOCITY = 0.6 * np.exp(-(((TIME[:, None] - 1e-5 * np.arange(40.0)) / 1.5e-5) ** 2))
ERROR = 1e-6 * np.sin(np.arange(40.0))


def study() -> SceneStudy:
    """Return the study of the wave with invented verdicts."""
    roles = assign_roles(SCENE)
    parts = {"time step": 1.1e-6, "table": 0.0, "round-off": 1.7e-9, "sampling": 0.0, "reference": 1e-12}
    budget = Budget(
        quantity="velocity", found=1.1e-6, parts=parts, unexplained=1e-13, allowed=1e-12, scale_name="largest velocity"
    )
    results = []
    for backend, change in ((roles.engine, ERROR), (REFERENCE, 0.0)):
        run = free_flight(bodies=40, contacts=39, samples=250, duration=5e-4)
        provenance = {"backend": backend, "settings": {"dt": 1e-8}}
        times = 1e-5 * np.arange(1.0, 40.0)
        run = replace(run, velocity=VELOCITY + change, crossing_time=times, provenance=provenance)
        case = Case(scene=SCENE, backend=backend, resolution=Resolution(), sampling=Sampling(count=250))
        results.append(Result(case=case, trajectory=run))
    verdict = Verdict(
        scene="wave", quantity="velocity", backend=roles.engine, reference=REFERENCE, outcome=Outcome.PASS,
        sentence="It is small.", difference=1.1e-6, scale=0.6, tolerance=5e-6, meaning="time step",
    )  # fmt: skip
    refinement = {roles.engine: ([2e-8, 1e-8], [4.4e-6, 1.1e-6])}
    return SceneStudy(roles=roles, others=tuple(results), verdicts=(verdict,), budgets=(budget,), refinement=refinement)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("live")
    write_study(verification_of([study()], accuracy=5e-6, wall=1.0), folder)
    return folder / "index.html"


#: the shown map with its frame, its slider and its output, and how a pointer moves to a part of the frame
_PARTS = """
const live = document.querySelector(".live"), [button, slider, output] = live.querySelector(".player").children;
const shown = () => live.querySelector(".view:not([hidden])"), frame = () => shown().querySelector(".frame");
const move = (x, y) => {
  const box = frame().getBoundingClientRect();
  const at = { clientX: box.left + x * box.width, clientY: box.top + y * box.height };
  frame().dispatchEvent(new PointerEvent("pointermove", at));
};
const press = (at, key) => at.dispatchEvent(new KeyboardEvent("keydown", { key, cancelable: true }));
const told_ = [];
const note = () => told_.push(output.textContent);
"""


def _told(page: Path, folder: Path, script: str, *words: str) -> Any:
    return asked(page, folder, f"{_PARTS}{script}; return told_;", *words)


def _number(text: str) -> float:
    """Return the last number before "m/s" of a text."""
    front, power = re.findall(r"([−\d.]+)(?:×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))? m/s", text)[-1]
    digits = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    return float(front.replace("−", "-")) * 10.0 ** int(digits or 0)


def test_the_slider_plays_the_chain_and_says_its_largest_velocity(page: Path, tmp_path: Path) -> None:
    script = """
for (const at of [0, 60, 180]) {
  slider.value = at;
  slider.dispatchEvent(new Event("input"));
  note();
  told_.push(slider.getAttribute("aria-valuetext"), frame().querySelector(".cursor").style.bottom);
}
told_.push(slider.max, live.querySelectorAll("input").length);
"""
    told = _told(page, tmp_path, script)
    last = float(told[-2])
    assert told[-1] == 1  # one slider a page
    for nth, at in enumerate((0, 60, 180)):
        said, spoken, place = told[3 * nth : 3 * nth + 3]
        ms, body = float(said.split(" ")[0]), int(re.findall(r"body (\d+)", said)[0])
        assert spoken == f"{said.split(' ms')[0]} ms"
        assert float(place.rstrip("%")) == pytest.approx(100.0 * min(at, last) / last, abs=0.5)
        row = int(np.argmin(np.abs(TIME - 1e-3 * ms)))
        speeds = (VELOCITY + ERROR)[row, 1:]
        assert body == 1 + int(np.argmax(np.abs(speeds)))
        assert _number(said) == pytest.approx(speeds[body - 1], rel=5e-3)


def test_the_pointer_shows_the_value_of_the_body_and_time_below_it(page: Path, tmp_path: Path) -> None:
    script = 'move(0.513, 0.4); note(); told_.push(frame().querySelector(".pin").style.left);'
    said, left = _told(page, tmp_path, script)
    body, ms = int(re.findall(r"body (\d+) at", said)[0]), float(re.findall(r"at ([\d.]+) ms", said)[0])
    assert body == 1 + int(0.513 * 39)
    assert float(left.rstrip("%")) == pytest.approx(100.0 * (body - 0.5) / 39, abs=0.01)
    row = int(np.argmin(np.abs(TIME - 1e-3 * ms)))
    assert _number(said) == pytest.approx((VELOCITY + ERROR)[row, body], rel=5e-3, abs=2e-5)


def test_the_arrow_keys_read_values_and_the_page_does_not_scroll(page: Path, tmp_path: Path) -> None:
    script = """
move(0.01, 0.99);
const at = frame(), scrolls = [press(at, "ArrowRight"), press(at, "ArrowRight"), press(at, "ArrowUp")];
note();
told_.push(scrolls, press(at, "Tab"), at.tabIndex);
"""
    said, scrolls, tab, index = _told(page, tmp_path, script)
    assert said.startswith("body 3 at 0.00")
    assert scrolls == [False, False, False]
    assert (tab, index) == (True, 0)  # the Tab key leaves the map


def test_the_error_of_lammps_is_a_second_view_with_its_own_values(page: Path, tmp_path: Path) -> None:
    script = """
const [velocity, error] = live.querySelectorAll(".views button");
error.click();
note();
move(0.5, 0.5);
note();
told_.push(error.getAttribute("aria-pressed"), velocity.getAttribute("aria-pressed"), shown().id);
"""
    _, said, pressed, other, name = _told(page, tmp_path, script)
    body = int(re.findall(r"body (\d+)", said)[0])
    assert _number(said) == pytest.approx(ERROR[body], rel=1e-2, abs=1e-10)
    assert (pressed, other, name) == ("true", "false", "live-wave-error")


def test_play_moves_in_time_and_pause_stops(page: Path, tmp_path: Path) -> None:
    script = """
slider.value = 0; slider.dispatchEvent(new Event("input"));
button.click();
const name = button.textContent;
setTimeout(() => {
  const moved = Number(slider.value);
  button.click();
  told.textContent = JSON.stringify([name, moved, button.textContent]);
}, 2000);
"""
    name, moved, stopped = _told(page, tmp_path, script, "--virtual-time-budget=10000")
    assert (name, stopped) == ("Pause", "Play")
    assert moved > 10


def test_rows_of_the_scale_say_their_values_to_pointer_and_keyboard(page: Path, tmp_path: Path) -> None:
    script = """
const rows = document.querySelectorAll(".errors li"), says = document.querySelector(".errors output");
for (const row of rows) { row.dispatchEvent(new PointerEvent("pointerenter")); told_.push(says.textContent); }
rows[1].focus();
told_.push(says.textContent, document.activeElement === rows[1]);
"""
    *said, focused, active = _told(page, tmp_path, script)
    assert said[0] == "reference (estimate): wave 1×10−12"
    assert "LAMMPS, time step: wave 1.1×10−6" in said
    assert (focused, active) == (said[1], True)


def test_the_colours_of_the_chain_are_those_of_the_map(page: Path, tmp_path: Path) -> None:
    script = """
slider.value = 60; slider.dispatchEvent(new Event("input"));
const canvas = shown().querySelector("canvas"), pen = canvas.getContext("2d");
const colours = [];
for (let k = 0; k < 39; k++) {
  const [r, g, b] = pen.getImageData(Math.round((canvas.width * (k + 0.5)) / 39), canvas.height / 2, 1, 1).data;
  colours.push([r, g, b]);
}
note();
told_.push(colours);
"""
    said, colours = _told(page, tmp_path, script)
    fastest = int(re.findall(r"body (\d+)", said)[0])
    assert colours[fastest - 1] == max(colours, key=lambda colour: colour[0])
    assert colours[38] == [0, 34, 78]  # at rest


def _without_script(page: Path) -> str:
    """Return the words of a page that are seen where no script runs."""
    text = re.sub(r"<(script|style).*?</\1>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = re.sub(r"<(\w+)[^>]* hidden[ >].*?</\1>", "", text, flags=re.DOTALL)
    return unescape(re.sub(r"<[^>]*>", " ", text))


def test_without_a_script_maps_and_values_are_there_and_no_control_is(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.count('<figure class="view"') == text.count('<image href="data:image/png') == 2
    assert text.count('class="ring"') == 0  # no theory ran
    words = re.sub(r"\s+", " ", _without_script(page))
    for part in (
        "PASS : at 1×10 −8 s LAMMPS is within 1.1×10 −6",
        "LAMMPS, time step",
        "Velocity by LAMMPS.",
        "time (ms)",
    ):
        assert part in words
    # whatever needs a script is hidden until it runs
    assert re.search(r'<p class="views" hidden>', text)
    assert re.search(r'<div class="player" hidden>', text)
    assert text.count('<canvas class="row" aria-hidden="true" hidden>') == 2


def test_script_data_and_page_have_their_sizes(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    script = "".join(re.findall(r"<script>(.*?)</script>", text, re.DOTALL))
    data = re.findall(r"data-chain='([^']*)'", text)
    assert len(script.encode()) <= 15_000
    assert 0 < sum(map(len, data)) <= 300_000
    assert len(text.encode()) <= 2_000_000
    assert all(json.loads(unescape(one))["n"] == 39 for one in data)


def test_nothing_is_asked_from_the_network(page: Path, tmp_path: Path) -> None:
    names = 'performance.getEntriesByType("resource").map((one) => one.name)'
    script = f'told_.push({names}.filter((name) => !name.startsWith("data:")));'
    assert _told(page, tmp_path, script) == [[]]
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"fetch\(|XMLHttpRequest|import\(|WebSocket|<link|@import", text)


@needs_axe
@pytest.mark.parametrize("dark", [False, True])
def test_axe_finds_nothing(page: Path, tmp_path: Path, dark: bool) -> None:
    assert violations(page, tmp_path, dark) == []
