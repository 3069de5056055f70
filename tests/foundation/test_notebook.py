"""What notebooks show: well-formed, closed in itself, escaped, with the value's own numbers and their units."""

from __future__ import annotations

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.foundation.notebook import quantity, sketch, template
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.contact_law import law_of
from dem_bridge.report.study import Study, Table
from dem_bridge.trajectory.relative import own_scale
from dem_bridge.verification.roles import assign_roles
from dem_bridge.verification.verification import verification_of
from dem_bridge.verification.verify import study_without_runs
from tests.conftest import Solve

SCENE = db.Scene(
    name="mine",
    description='<script>alert("& more")</script>',
    duration=1e-4,
    mass=(8.1e-3, 10.1e-3, 20e-3),
    stiffness=(4e9, 7e10),
    velocity=(0.8, 0.0, 0.0),
    gap=(0.0, 2e-6),
    samples=50,
)

REFUSED = UsageError("no step < 1 makes it")


def _text(html: str) -> str:
    """What a reader sees. Fails where tags do not match, a value is not escaped or something is fetched or run."""
    root = ElementTree.fromstring(html)
    for node in root.iter():
        assert node.tag.split("}")[-1] not in ("script", "style", "link", "iframe", "object")
        for key, value in node.attrib.items():
            assert not key.startswith("on"), "runs something"
            assert key not in ("href", "class", "id"), "needs something else"
            assert key != "src" or value.startswith("data:image/png;base64,"), "fetches something"
            assert "url(" not in value
        if "background:#" not in node.get("style", ""):
            # ink that is the page's own is seen on any ground
            assert not re.search(r"(?<!-)color:(?!inherit)", node.get("style", ""))
    return " ".join(" ".join(root.itertext()).split())


def test_a_scene_shows_its_numbers_with_units_and_its_description_as_text() -> None:
    text = _text(SCENE._repr_html_())
    for part in (
        '<script>alert("& more")</script>',
        "3, mass 8.1 g to 20 g",
        "4e+09 N/m^1.5 to 7e+10 N/m^1.5",
        "exponent n 2.5 ",
        "gap 0 m to 2 µm",
        "body 0 at 0.8 m/s, all others at rest",
        "further physics none",
        "100 µs, sampled every 2 µs (50 intervals)",
        SCENE.content_hash[:12],
    ):
        assert part in text, part


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"gravity": 9.81}, "gravity 9.81 m/s² (towards the last body)"),
        ({"precompression": 10.0, "gap": 0.0}, "precompression 10 N"),
        (
            {"damping": db.Damping(law="dashpot", coefficient=(1.0, 2.0))},
            "damping by the law dashpot, coefficient 1 N s/m to 2 N s/m",
        ),
        (
            {"damping": db.Damping(law="kuwabara-kono", coefficient=2e-7)},
            "damping by the law kuwabara-kono, coefficient 200 ns",
        ),
        ({"drag": 3.0}, "drag 3 1/s"),
        ({"law": lambda overlap: 4e9 * overlap**1.5}, "contact laws that are functions (1)"),
        ({"exponent": (2.4, 2.5)}, "2.4 to 2.5"),
        ({"wall_right": db.Wall(stiffness=1e9)}, "1 of them with a wall (right)"),
        ({"gap": -1e-6}, "-1 µm (negative: initial overlap)"),
        ({"velocity": (0.0,) * 3}, "all bodies at rest"),
        ({"velocity": (0.8, 0.0, -0.1)}, "body 0 at 0.8 m/s, body 2 at -0.1 m/s, all others at rest"),
    ],
)
def test_a_scene_says_what_else_it_has(more: dict, said: str) -> None:
    assert said not in _text(SCENE._repr_html_())
    assert said in _text(replace(SCENE, **more)._repr_html_())


def test_a_drive_is_named_in_its_own_words() -> None:
    driven = replace(SCENE, drive=db.Drive(shape="sine", force=2.0, frequency=5000.0))
    assert "further physics drive of body 0 by a sine of 2 N at 5000 Hz" in _text(driven._repr_html_())


@pytest.mark.parametrize("name", db.shipped_scenes())
def test_every_shipped_scene_shows_itself_small(name: str) -> None:
    html = db.load_scene(name)._repr_html_()
    _text(html)
    assert len(html) < 40_000


def test_a_scene_of_one_body_and_one_of_very_many_show_themselves() -> None:
    alone = db.Scene(name="alone", duration=1.0, mass=(1.0,), stiffness=(), velocity=(1.0,))
    assert "contacts 0" in _text(alone._repr_html_())
    n = 5000
    many = db.Scene(name="m", duration=1.0, mass=(1.0,) * n, stiffness=(1e9,) * (n - 1), velocity=(1.0,) * n)
    html = many._repr_html_()
    assert "the first 100 of 5000 bodies" in _text(html)
    assert "5000 bodies move, 1 m/s" in _text(html)
    assert len(html) < 40_000


def test_the_sketch_has_bodies_to_scale_and_contacts_from_soft_to_stiff() -> None:
    svg = sketch(
        [(1.0, 1.0), (3.0, 3.0), (1.0, 2.0)], [1e9, 1e10], moving=[True, False, False], walls=(True, False), unit="N"
    )
    root = ElementTree.fromstring(svg)
    nodes = [(node.tag.split("}")[-1], node.attrib) for node in root.iter()]
    radii = [float(at["rx"]) for tag, at in nodes if tag == "ellipse"]
    assert radii[1] == pytest.approx(3.0 * radii[0], abs=0.2)  # of pixels, written with one digit
    assert [tag for tag, _ in nodes].count("rect") == 1
    inks = [at["stroke"] for tag, at in nodes if tag == "line"]
    assert inks == ["currentColor", "rgb(0,114,178)", "rgb(230,159,0)"]
    wide = float(next(at["width"] for tag, at in nodes if tag == "svg"))
    assert all(float(at["x2"]) < wide for tag, at in nodes if tag == "line")


def test_a_trajectory_shows_who_made_it_its_bars_and_its_cost(solved: Solve) -> None:
    run = solved(SCENE, "verlet", dt=1e-6)
    text = _text(run._repr_html_())
    worst = (run.uncertainty["peak_force"] / own_scale(run.peak_force)).max()
    for part in (
        "backend verlet (hertz)",
        f"scene mine, hash {SCENE.content_hash[:12]}",
        "time step 1 µs",
        "51 times from 0 to 100 µs, 3 bodies, 2 contacts",
        f"{run.cost.steps} time steps",
        f"velocity {quantity(run.uncertainty['velocity'], 'm/s', 2)}",
        f"{run.uncertainty['velocity'] / abs(run.velocity).max():.1e} the largest, 0.8 m/s",
        f"{worst:.1e} the value of each contact (largest ratio)",
        run.provenance["scene_hash"],
    ):
        assert part in text, part


def test_bars_that_are_not_known_are_said_to_be(solved: Solve) -> None:
    text = _text(solved(SCENE, "verlet", dt=1e-6, uncertainty=False)._repr_html_())
    assert "velocity unknown unknown" in text
    still = replace(SCENE, velocity=(0.0,) * 3)  # no largest velocity, no peak, no crossing
    text = _text(solved(still, "verlet", dt=1e-6)._repr_html_())
    assert "velocity no value" in text
    assert "crossing time no value" in text


def test_a_verification_shows_each_outcome_by_word_and_ground() -> None:
    study = study_without_runs(assign_roles(SCENE), REFUSED)
    found = verification_of([study], accuracy=1e-6, wall=1.0, notes=("a <note>",))
    text = _text(found._repr_html_())
    assert "UNDECIDED 1" in text.replace("\u00a0", " ")
    assert "exit code 4" in text
    assert "a <note>" in text
    assert study.verdicts[0].sentence in text
    several = verification_of(
        [study, study_without_runs(assign_roles(replace(SCENE, name="other")), REFUSED)], accuracy=1e-6, wall=1.0
    )
    text = _text(several._repr_html_())
    assert "UNDECIDED 2" in text.replace("\u00a0", " ")
    assert all(f"{name} velocity" in text for name in (SCENE.name, "other"))


def test_every_outcome_has_a_ground_that_white_is_read_on() -> None:
    for outcome in Outcome:
        html = str(template().module.badge(outcome.value))
        red, green, blue = (int(html.split("background:#")[1][at : at + 2], 16) / 255 for at in (0, 2, 4))
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (red, green, blue)]
        light = float(np.dot(linear, (0.2126, 0.7152, 0.0722)))
        assert 1.05 / (light + 0.05) > 4.5, outcome  # WCAG 2 AA
        assert outcome.value.replace("_", " ") in _text(html)


def test_a_plan_shows_settings_with_units_and_why() -> None:
    plan = db.plan(SCENE, 1e-3, backend="verlet")
    text = _text(plan._repr_html_())
    assert f"dt={plan.resolution['dt']!r} (SI)" in text
    assert quantity(plan.units["dt"], "s") in text
    for reason in plan.reasons:
        assert " ".join(reason.split()) in text


def test_a_study_shows_its_answer_and_folds_its_tables() -> None:
    rows = tuple((f"<{at}>", 0.1 * at) for at in range(250))
    table = Table(id="t", title="many & more", caption="", columns=("name", "time (s)"), rows=rows)
    study = Study(id="s", title="a study", answer=("it is < 3",), tables=(table,), interrupted=True)
    text = _text(study._repr_html_())
    for part in ("it is < 3", "many & more", "<3> 0.3", "50 more rows", "interrupted"):
        assert part in text, part


@given(st.floats(1e-14, 1e11), st.sampled_from(["m", "s", "N", "m/s", "g"]))
def test_a_quantity_reads_back_to_its_digits(value: float, unit: str) -> None:
    number, word = quantity(value, unit).split()
    powers = {"f": -15, "p": -12, "n": -9, "µ": -6, "m": -3, "": 0, "k": 3, "M": 6, "G": 9}
    # three digits: half a unit of the last is at most 5e-3 of the number
    assert float(number) * 10.0 ** powers[word.removesuffix(unit)] == pytest.approx(value, rel=5.001e-3)


def test_laws_that_are_functions_leave_the_stiffness_as_what_is_near_them() -> None:
    law = law_of(lambda overlap: 4e9 * overlap**1.5, reach=1e-4)
    assert "(approximates the contact laws)" in _text(replace(SCENE, law=law)._repr_html_())
