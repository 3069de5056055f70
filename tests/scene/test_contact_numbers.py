"""The numbers of one contact: exact where they are, measured steps that hold, and the page says the same."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.physics.exact import restitution_obtained
from dem_bridge.scene.contact_numbers import LAWS, ContactNumbers, step_errors, steps_for
from tests.helpers.command_line import assert_one_line, run_here

GLASS: dict[str, Any] = {
    "youngs_modulus": 48e9,
    "poissons_ratio": 0.2,
    "density": 2800.0,
    "radius": 0.01,
    "speed": 20.0,
}
PAGE = Path(__file__).parents[2] / "docs" / "howto" / "contact.md"
NODE = shutil.which("node")
PARTNERS = ("sphere", "wall", "rigid-wall")


def test_the_impacts_of_chung_and_ooi() -> None:
    glass = db.contact_numbers(**GLASS)
    assert glass.peak_overlap == pytest.approx(274.11270e-6, rel=2e-8)
    assert glass.peak_force == pytest.approx(10696.88898, rel=1e-9)
    assert glass.contact_time == pytest.approx(40.339456e-6, rel=2e-8)
    # elastic: the quadrature of the damped time is the closed form
    assert glass.damped_contact_time == pytest.approx(glass.contact_time, rel=1e-13)
    alumina: dict[str, Any] = {
        "youngs_modulus": 380e9,
        "poissons_ratio": 0.23,
        "density": 4000.0,
        "radius": 2.5e-3,
        "speed": 3.9,
    }
    assert db.contact_numbers(**alumina, partner="rigid-wall").contact_time == pytest.approx(6.104510e-6, rel=1e-7)
    ratio = db.contact_numbers(**alumina, partner="wall").contact_time / 6.104510e-6
    assert ratio == pytest.approx(2.0**0.4, rel=1e-7)


def _run(numbers: ContactNumbers, dt: float, phase: float) -> tuple[float, float]:
    """Return exit speed over speed, and overlap at the exact end over the largest, of LAMMPS' twin on a rigid wall."""
    v, e, gap = 1.0, numbers.restitution, phase * dt
    end = math.ceil(2.5 * numbers.damped_contact_time / dt) * dt
    scene = db.Scene(
        name="impact",
        duration=end,
        mass=(numbers.mass,),
        stiffness=(),
        velocity=(v,),
        wall_right=db.Wall(stiffness=numbers.stiffness, gap=gap),
        damping=db.Damping(law="coeff_restitution", coefficient=e, clip=False) if e < 1.0 else None,
        samples=1,
    )
    run = db.solve(scene, backend="verlet", dt=dt * (1.0 + 1e-9), uncertainty=False)
    speed = -float(run.velocity[-1, 0]) / v
    # the body flies freely from its last touch on, which is followed back to the exact end
    overlap = float(run.displacement[-1, 0]) - gap + speed * v * (end - gap / v - numbers.damped_contact_time)
    return speed, overlap


@pytest.mark.parametrize("e", [1.0, 0.8, 0.3])
def test_the_twin_of_lammps_makes_the_error_of_the_steps_and_no_larger_one(e: float) -> None:
    material = GLASS | {"speed": 1.0}
    numbers = db.contact_numbers(**material, partner="rigid-wall", restitution=e, errors=[1e-2, 2e-3])
    top = numbers.peak_overlap  # that of the elastic impact: at most 1.6 times the damped one for e = 0.3
    for step in numbers.steps:
        errors = [abs(_run(numbers, step.restitution, phase / 8.0)[0] - e) for phase in range(8)]
        # the table has the worst opening, too; over numbers of steps between its own the largest error is 1.07 of it
        assert 0.4 * step.error < max(errors) < 1.07 * step.error
        overlaps = [abs(_run(numbers, step.position, phase / 8.0)[1]) for phase in range(8)]
        assert 0.5 * step.error < max(overlaps) / top < 1.05 * step.error


def test_errors_fall_with_the_order_of_the_method() -> None:
    elastic, damped = (step_errors(e) for e in (1.0, 0.5))
    orders = [[math.log2(a / b) for a, b in pairwise(errors[4:])] for errors in (*elastic, *damped)]
    # at a touch of a force that grows with d^1.5 the impulse errs with the power 2.5, positions of Verlet with 2
    for few, order in zip(orders, (2.5, 2.0, 1.0, 1.0), strict=True):
        assert few == pytest.approx([order] * len(few), abs=0.12)


def test_steps_are_interpolated_and_extrapolated_with_the_power_of_the_error() -> None:
    second = [(8.0 / count) ** 2 for count in (8, 16, 32, 64, 128, 256, 512, 1024)]
    for wanted in (0.5, 1e-3, 1e-6):
        assert steps_for(second, wanted) == pytest.approx(8.0 * wanted**-0.5, rel=1e-12)
    assert steps_for(second, 2.0) == 8.0
    # a later rise counts, so that no finer step of the table errs more
    assert steps_for([1e-3, 1e-3, 1e-1, 1e-4, 1e-4, 1e-5, 1e-6, 1e-7], 1e-2) > 32.0


def test_what_is_written_gives_what_is_wanted() -> None:
    for e in (0.05, 0.2, 0.5, 0.9, 1.0):
        for row in db.contact_numbers(**GLASS, restitution=e).written:
            law = LAWS[row.code]
            assert row.obtained == restitution_obtained(e, clip=row.clip, law=law)
            if row.write is not None:
                assert restitution_obtained(row.write, clip=row.clip, law=law) == pytest.approx(e, abs=1e-13)
            else:  # below the least, or above the largest, that the law can give
                extremes = [restitution_obtained(w, clip=row.clip, law=law) for w in (5e-324, 1.0)]
                assert not extremes[0] <= e <= extremes[1]


WRONG = {
    "youngs_modulus": (-1.0, "allowed: a finite number > 0"),
    "poissons_ratio": (0.6, "allowed: a number above -1 and up to 0.5"),
    "density": (math.nan, "allowed: a finite number > 0"),
    "radius": (0.0, "allowed: a finite number > 0"),
    "speed": (-2.0, r"allowed: a number above 0 \(m/s\)"),
    "restitution": (0.01, "allowed: a number from 0.05 to 1"),
    "partner": ("plane", "allowed: sphere, wall, rigid-wall"),
    "errors": ([0.5], "allowed: numbers from 1e-8 to 0.1"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_number_that_is_not_allowed_is_refused(name: str) -> None:
    value, allowed = WRONG[name]
    with pytest.raises(UsageError, match=allowed):
        db.contact_numbers(**(GLASS | {name: value}))


WORDS = ("contact", "--E", "48e9", "--nu", "0.2", "--rho", "2800", "--R", "0.01", "--v", "20")


def test_the_command_prints_the_numbers(tmp_path: Path) -> None:
    done = run_here(*WORDS, "--e", "0.5", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert "largest force    10696.88898 N (elastic)" in done.stdout
    assert re.search(r"LAMMPS tsuji, until July 2026 +no +0.366651 +0.616076\n", done.stdout)
    document = json.loads(run_here(*WORDS, "--e", "0.5", "--errors", "1e-3", "--json", cwd=tmp_path).stdout)
    assert document == json.loads(json.dumps(db.contact_numbers(**GLASS, restitution=0.5, errors=[1e-3]).as_json()))
    assert_one_line(run_here(*WORDS, "--e", "2", cwd=tmp_path), "--e = 2.0; allowed: a number from 0.05 to 1")


def _random_inputs(count: int) -> list[dict[str, Any]]:
    """Return random contacts: soft and hard, small and large, slow and fast."""
    random = np.random.default_rng(20260722)
    return [
        {
            "youngs_modulus": 10.0 ** random.uniform(5.0, 12.0),
            "poissons_ratio": random.uniform(-0.5, 0.5),
            "density": 10.0 ** random.uniform(1.0, 4.3),
            "radius": 10.0 ** random.uniform(-6.0, 1.0),
            "speed": 10.0 ** random.uniform(-5.0, 3.0),
            "restitution": random.uniform(0.05, 1.0) if index % 10 else 1.0,
            "partner": PARTNERS[index % 3],
            "errors": [1e-2, 10.0 ** random.uniform(-8.0, -2.0)],
        }
        for index in range(count)
    ]


def _differences(page: str, inputs: list[dict[str, Any]]) -> list[str]:
    """Return the names of numbers in which the script of the page differs from Python by more than 1e-12."""
    assert NODE is not None
    [script] = re.findall(r"<script>\n(.*?)</script>", page, re.DOTALL)
    # node is started in a folder of its own; the inputs are in the text of the script
    code = f"{script}\nconsole.log(JSON.stringify({json.dumps(inputs)}.map(contactNumbers)));"
    done = subprocess.run([NODE, "-e", code], capture_output=True, text=True, check=True, timeout=300)
    wrong: list[str] = []

    def compare(name: str, theirs: Any, ours: Any) -> None:
        if isinstance(ours, dict):
            assert theirs.keys() == ours.keys(), name
            for key, value in ours.items():
                compare(f"{name}.{key}", theirs[key], value)
        elif isinstance(ours, list):
            assert len(theirs) == len(ours), name
            for index, value in enumerate(ours):
                compare(f"{name}[{index}]", theirs[index], value)
        elif isinstance(ours, float):
            # coefficients of restitution are at most 1: what is written may be as small as 1e-10, as a root is found
            scale = 1.0 if name.endswith((".write", ".obtained")) else abs(ours)
            if theirs is None or not abs(theirs - ours) <= 1e-12 * scale:
                wrong.append(name)
        elif theirs != ours:
            wrong.append(name)

    for theirs, given in zip(json.loads(done.stdout), inputs, strict=True):
        ours = json.loads(json.dumps(db.contact_numbers(**given).as_json()))
        del ours["schema"]
        compare("", theirs, ours)
    return wrong


@pytest.mark.skipif(NODE is None, reason="no node, which runs the script of the page")
def test_the_page_in_a_browser_computes_the_same() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert _differences(page, _random_inputs(200)) == []


FAULTS = {
    "sqrt 2 of tsuji": ("Math.SQRT2 * marshall", "marshall"),
    "modulus": ("? 1 : 2)", "? 1 : 2.000000001)"),
    "rayleigh": ("0.1631", "0.163"),
    "clip": ("Math.exp(-2 * zeta", "Math.exp(-2.0000001 * zeta"),
    "half step": ("alpha * Math.sqrt(root) * half", "alpha * Math.sqrt(root) * speed"),
    "places of the touch": ("[0, 1, 2, 3, 4, 5, 6, 7]", "[0, 1, 2, 3]"),
}


@pytest.mark.skipif(NODE is None, reason="no node, which runs the script of the page")
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_the_page_is_seen(fault: str) -> None:
    page, (right, wrong) = PAGE.read_text(encoding="utf-8"), FAULTS[fault]
    assert page.count(right) == 1
    assert _differences(page.replace(right, wrong), _random_inputs(6)) != []


#: the parts of a document that the page uses, with the values of its form
_DOCUMENT = """
const tables = {}, message = { textContent: "-" };
const cell = () => ({ cells: [], appendChild(child) { this.cells.push(child); return child; } });
globalThis.FormData = function () { return Object.entries(FORM); };
globalThis.document = {
  createElement: cell,
  getElementById: (id) => id === "contact-message" ? message : { addEventListener() {} },
  querySelector: (id) => ({
    replaceChildren(...rows) { tables[id] = rows.map((row) => row.cells.map((c) => `${c.textContent}`)); },
  }),
};
"""


def _shown(**form: str) -> tuple[dict[str, list[list[str]]], str]:
    """Return the cells of the tables and the message that the page shows for the texts of its form."""
    assert NODE is not None
    page = PAGE.read_text(encoding="utf-8")
    [script] = re.findall(r"<script>\n(.*?)</script>", page, re.DOTALL)
    given = dict(re.findall(r'<input name="(\w+)" value="(.*?)">', page)) | {"partner": "sphere"} | form
    code = f"const FORM = {json.dumps(given)};{_DOCUMENT}{script}"
    words = [NODE, "-e", f"{code}\nconsole.log(JSON.stringify([tables, message.textContent]));"]
    tables, message = json.loads(subprocess.run(words, capture_output=True, text=True, check=True, timeout=300).stdout)
    return tables, message


@pytest.mark.skipif(NODE is None, reason="no node, which runs the script of the page")
def test_the_page_shows_its_numbers_and_refuses_wrong_ones() -> None:
    tables, message = _shown()
    assert message == ""
    numbers = db.contact_numbers(**GLASS, restitution=0.5)
    assert tables["#contact-numbers tbody"][2] == ["largest force, elastic", f"{numbers.peak_force:.10g} N"]
    assert [len(row) for row in tables["#contact-steps tbody"]] == [7, 7, 7]
    assert float(tables["#contact-steps tbody"][1][1]) == pytest.approx(numbers.steps[1].restitution, rel=1e-3)
    assert ["LAMMPS tsuji, until July 2026", "no", "0.366651", "0.616076"] in tables["#contact-written tbody"]
    assert _shown(restitution="2")[1] == "e = 2; allowed: a number from 0.05 to 1"
    assert _shown(radius="")[1] == "R = NaN; allowed: a number above 0"


def test_the_page_needs_no_network() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert not re.search(r"\b(?:fetch|XMLHttpRequest|import)\b|https?://|\bsrc=", page)
