"""``dem-bridge new``: templates that load, run, name every key, and whose comments do not lie."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from click.testing import CliRunner
from pydantic import BaseModel

import dem_bridge as db
from dem_bridge.cli import main
from dem_bridge.cli.scene_files import FORMS, template
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.file.forms import CylinderScene, PatternScene, RawScene, SphereScene
from dem_bridge.scene.file.impact import ImpactScene
from tests.helpers.command_line import choices

TABLES: dict[str, type[BaseModel]] = {
    "pattern": PatternScene,
    "cylinders": CylinderScene,
    "spheres": SphereScene,
    "impact": ImpactScene,
    "raw": RawScene,
}
#: what changes no motion: a default that is said, and a measurement
DEFAULTS = {"exponent = 2.5", "[measurement]"}

every_form = pytest.mark.parametrize("form", FORMS)
every_chain = pytest.mark.parametrize("form", [form for form in FORMS if form != "impact"])


def options(text: str) -> Iterator[tuple[str, int, int]]:
    """Each optional part with its first line and the line behind its last.

    Lines that begin with ``#`` and no space: those under a table's head or behind a comment together, others each.
    """
    lines = text.splitlines()
    # the first line of a file, "#:schema", is for editors
    hidden = [bool(re.match(r"#[^\s:]", line)) for line in lines]
    start = 0
    while start < len(lines):
        if not hidden[start]:
            start += 1
            continue
        end = next((k for k in range(start, len(lines)) if not hidden[k]), len(lines))
        together = lines[start].startswith("#[") or lines[start - 1].startswith("# ")
        for first, behind in [(start, end)] if together else [(k, k + 1) for k in range(start, end)]:
            yield lines[first].lstrip("#").split("  ")[0], first, behind
        start = end


def with_option(text: str, first: int, behind: int) -> str:
    lines = text.splitlines()
    return "\n".join(line[1:] if first <= k < behind else line for k, line in enumerate(lines))


OPTIONS = [(form, *option) for form in FORMS for option in options(template(form, "own"))]


def test_every_form_of_a_scene_file_has_a_template_and_none_is_of_another() -> None:
    files = {file.stem for file in (Path(db.__file__).parent / "scene" / "file" / "templates").glob("*.toml")}
    assert files == set(FORMS) == set(TABLES)
    assert choices("new", "form") == tuple(FORMS)


@every_form
def test_a_template_loads_under_the_name_that_is_asked_for(form: str) -> None:
    scene = parse_scene(template(form, "own"))
    assert scene.name == "own"
    assert (scene.geometry is None) == (form == "raw")


@every_chain
def test_the_front_of_a_template_comes_to_the_last_body(form: str) -> None:
    scene = parse_scene(template(form, "own"))
    run = db.solve(scene, backend="verlet", uncertainty=False)
    assert np.all(np.isfinite(run.crossing_time))
    assert 0.5 * scene.duration < run.crossing_time[-1] < 0.9 * scene.duration


@pytest.mark.parametrize(("form", "what", "first", "behind"), OPTIONS, ids=[f"{one[0]}: {one[1]}" for one in OPTIONS])
def test_what_is_commented_out_is_true_when_it_is_not(form: str, what: str, first: int, behind: int) -> None:
    plain = parse_scene(template(form, "own"))
    other = parse_scene(with_option(template(form, "own"), first, behind))
    if what.strip() in DEFAULTS:
        assert other == plain
    else:
        assert other.content_hash != plain.content_hash or other.spacing != plain.spacing


@every_chain
def test_optional_parts_are_many_and_all_that_do_not_exclude_each_other_go_together(form: str) -> None:
    text = template(form, "own")
    found = list(options(text))
    assert len(found) >= 7
    # gaps exclude precompression
    lines = text.splitlines()
    for what, first, behind in found:
        if what.startswith(("gap", "[chain.contacts]")):
            continue
        lines[first:behind] = [line[1:] for line in lines[first:behind] if not line.startswith("#gap")] + [
            "" for line in lines[first:behind] if line.startswith("#gap")
        ]
    assert parse_scene("\n".join(lines)).precompression > 0.0


def test_an_impact_has_its_options_together_and_rebounds_as_written() -> None:
    text = template("impact", "own").replace("\n#duration", "\n# ")
    scene = parse_scene(re.sub(r"^#(?=[^\s:])", "", text, flags=re.MULTILINE))
    assert (scene.damping, scene.adhesion, scene.gravity) != (None, None, 0.0)
    plain = parse_scene(
        text.replace("#[impact.damping]", "[impact.damping]")
        .replace("#law", "law", 1)
        .replace("#coefficient", "coefficient")
        .replace("#clip", "clip")
    )
    assert db.solve(plain, backend="scipy", uncertainty=False).restitution == pytest.approx(0.5, abs=1e-9)


IN_PLACE = {
    "no striker": ("pattern cylinders spheres", r"\[chain.striker\]\n(#?[a-z]+ =.*\n)+", ""),
    "a speed of the first body": (
        "pattern cylinders spheres",
        r"\[chain.striker\]\n(#?[a-z]+ =.*\n)+",
        "[chain]\nvelocity = 0.4\n",
    ),
    "a mass and a stiffness": (
        "pattern cylinders spheres",
        r"\nradius(.*of a sphere.*\n(material.*\n)?)#mass(.*\n)#",
        r"\n#\1mass\3",
    ),
    "the first body once more": ("cylinders", r"\nradius.*of a sphere.*\n", '\nlike = "first-body"\n'),
    "one angle": ("cylinders", r"first_angle.*\nlast_angle.*\ngrading.*\n", "angle = 45.0\n"),
    "a list of angles": ("pattern", r"angle = 45.0 ", "angles = [1, 2, 3, 4, 5, 6, 7, 8]"),
    "the paper's law": ("pattern cylinders", r'law = "exact"', 'law = "paper"'),
    "a stiff wall": (
        "pattern",
        r"#\[chain.wall_right\](.*)\n#material.*\n",
        r"[chain.wall_right]\1\nstiffness = 3e9\n",
    ),
    "a chirp": (
        "pattern cylinders spheres raw",
        r'#\[chain.drive\]\n#shape = "sine"\n#(force.*\n)#(freq.*\n)#phase.*\n#rise.*\n',
        r'[chain.drive]\nshape = "chirp"\n\1\2last_frequency = 9e3\n',
    ),
    "a table of forces": (
        "pattern cylinders spheres raw",
        r'#\[chain.drive\]\n#shape = "sine"\n#force.*\n#freq.*\n#phase.*\n#rise.*\n',
        '[chain.drive]\nshape = "table"\nforce = [0.0, 1.0, 0.0]\ninterval = 1.0\n',
    ),
    "other losses": (
        "pattern cylinders spheres raw",
        r'#\[chain.damping\]\n#law = "dashpot"(.*)\n#coefficient = 1.0',
        r'[chain.damping]\nlaw = "kuwabara-kono"\1\ncoefficient = 1e-6',
    ),
}


@pytest.mark.parametrize(
    ("form", "old", "new"), [(form, *rest) for forms, *rest in IN_PLACE.values() for form in forms.split()]
)
def test_what_is_said_to_stand_in_place_of_something_may(form: str, old: str, new: str) -> None:
    text = template(form, "own")
    changed, count = re.subn(old, new, text)
    assert count == 1
    assert parse_scene(changed).content_hash != parse_scene(text).content_hash


def keys(table: Any) -> Iterator[str]:
    """Of a table and all tables in it, as they are written."""
    if isinstance(table, type) and issubclass(table, BaseModel):
        for name, field in table.model_fields.items():
            yield field.alias or name
            yield from keys(field.annotation)
    for inner in get_args(table):
        yield from keys(inner)


@every_form
def test_a_template_names_every_key_of_its_form(form: str) -> None:
    found = set(keys(TABLES[form]))
    assert {"name", "gravity", "count"} <= found
    text = template(form, "own")
    assert {key for key in found if not re.search(rf"\b{key}\b", text)} == set()


@every_form
def test_lines_fit_on_a_screen_and_numbers_have_units(form: str) -> None:
    text = template(form, "own")
    assert max(map(len, text.splitlines())) <= 120
    said: set[str] = set()
    for line in text.splitlines():
        if found := re.match(r"#?(\w+) = [\[\d-]", line):
            # a key that was explained above need not be again
            assert "#" in line[1:] or found[1] in said, line
            said.add(found[1])


def run(*words: str) -> Any:
    return CliRunner().invoke(main, ["new", *words])


@every_form
def test_the_command_writes_a_file_and_says_what_to_type_next(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run("granite.toml", "--form", form)
    assert (done.exit_code, done.stderr) == (0, "")
    assert db.load_scene("granite.toml") == parse_scene(template(form, "granite"))
    assert "  dem-bridge run granite.toml --backend reference\n" in done.stdout
    for line in done.stdout.splitlines()[2:]:
        name, command, *words = line.split()
        assert (name, "granite.toml" in words) == ("dem-bridge", True)
        # each can be typed
        context = main.commands[command].make_context(command, words)
        assert context.params


def test_pattern_is_what_is_written_where_nothing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run().exit_code == 0
    assert (tmp_path / "my-chain.toml").read_text() == template("pattern", "my-chain")
    assert run("other", "--form", "raw").exit_code == 0
    assert db.load_scene(tmp_path / "other.toml").name == "other"


def test_nothing_is_replaced_that_is_not_to_be(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("years of work")
    done = run(str(file))
    assert (done.exit_code, done.stderr.count("\n"), file.read_text()) == (2, 1, "years of work")
    assert "the file exists" in done.stderr
    assert "--force" in done.stderr
    assert run(str(file), "--force").exit_code == 0
    assert db.load_scene(file).name == "mine"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a b.toml",), "'a b' is not a valid name of a scene; allowed: 1 to 100 of the characters A-Z"),
        (("nowhere/a.toml",), "the folder nowhere is missing or not writable"),
        (("a.toml", "--form", "chain"), "'chain' is not one of 'pattern', 'cylinders', 'spheres', 'impact', 'raw'"),
        (("a.toml", "b.toml"), "unexpected extra argument"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(
    words: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run(*words)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "own.toml").mkdir()
    done = run(str(tmp_path / "own.toml"), "--force")
    assert (done.exit_code, "is not a regular file" in done.stderr) == (2, True)
