"""Studies by name: what is asked of them, and the files that every one gets."""

from __future__ import annotations

import functools
import importlib
import inspect
import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.api import guests as catalogue
from dem_bridge.cli import main, terminal
from dem_bridge.cli.studies import declared_by, documentation
from dem_bridge.cli.studies import study as group
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.images import alternative_text, inline
from dem_bridge.report.page import typeset, write_study
from dem_bridge.report.study import FigureData, Panel, Series, Study, Table
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.scene.scene import Scene
from tests.studies.stability.small import small_stability


def small(*, outcome: Outcome = Outcome.PASS, interrupted: bool = False) -> Study:
    """A study with a part of each kind."""
    line = Series(label="twin", style="reference", x=np.array([1.0, 2.0]), y=np.array([0.5, 0.25]))
    panel = Panel(title="(a) one", x_label="dt (s)", y_label="error", series=(line,))
    return Study(
        id="small",
        title="A small study",
        answer=("It <is> so.",),
        tables=(Table(id="numbers", title="Numbers", caption="", columns=("who", "x"), rows=(("[a]", float("nan")),)),),
        figures=(FigureData(id="picture", title="Picture", caption="", panels=(panel,)),),
        verdicts=(Verdict(scene="s", quantity="q", backend="b", reference="r", outcome=outcome, sentence="So it is."),),
        interrupted=interrupted,
    )


def of_scene(
    scene: Scene, *, engine: Engine | None = None, jobs: int | None = None, strength: float = 1.0, progress: Any = None
) -> Study:
    return small(outcome=Outcome.FAIL if strength > 1.0 else Outcome.PASS)


def of_none(*, store: Any) -> Study:
    return small(interrupted=True)


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    names = {"of-scene": "of_scene", "of-none": "of_none"}
    entries = {name: catalogue.Entry(__name__, function, "") for name, function in names.items()}
    monkeypatch.setattr(catalogue, "STUDIES", entries)


# options

#: parameter -> its options on the command line, where these have other names
SHARED = {
    "engine": {"lmp", "lmp_args", "python", "ranks"},
    "jobs": {"jobs", "executor"},
    "store": {"recompute"},
    "progress": set(),
    "measurement": set(),
    "executor": {"executor"},
}
#: annotation -> type of the option, whether it can be repeated, whether it is a flag
KINDS = {
    "float": ("float", False, False),
    "int": ("integer", False, False),
    "str": ("text", False, False),
    "bool": ("boolean", False, True),
    "Sequence[str]": ("text", True, False),
}


@pytest.mark.parametrize("name", list(catalogue.STUDIES))
def test_options_are_the_parameters_of_the_signature_and_each_is_documented(name: str) -> None:
    function = catalogue.study_named(name)
    parameters = inspect.signature(function).parameters
    assert set(parameters) - {"scene"} <= {key for key, one in parameters.items() if one.kind is one.KEYWORD_ONLY}
    description, texts = documentation(function)
    assert set(texts) == set(parameters)
    assert all(texts[key] for key in parameters if key not in SHARED)
    assert description.split("\n")[0] == catalogue.STUDIES[name].summary
    command = group.commands[name]
    command.get_params(click.Context(command))
    options = {one.name for one in command.params} - {"folder", "as_json", "json_progress", "verbose"}
    assert options == {option for key in parameters for option in SHARED.get(key, {key})}
    for option in command.params:
        parameter = parameters.get(str(option.name))
        if isinstance(option, click.Option) and parameter is not None and option.name not in SHARED:
            found = option.type.name, bool(option.multiple), bool(option.is_flag)
            assert found == KINDS[parameter.annotation.removesuffix(" | None")], option.name


def example(
    *,
    size: float = 0.5,
    count: int | None = None,
    fast: bool = False,
    full: bool = True,
    kind: str = "a",
    names: Sequence[str] = ("x", "y"),
) -> None:
    """Do it.

    Parameters
    ----------
    size : float
        Size of :class:`~a.Thing`,
        in ``m``.
    count : int, optional
        Number. None: all.
    fast, full : bool
        Whether.
    kind : str
        Kind.
    names : sequence of str
        Names.

    Returns
    -------
    None
    """


def test_an_option_for_each_kind_of_parameter() -> None:
    description, texts = documentation(example)
    assert description == "Do it."
    options = [one.parameter() for one in declared_by(example, texts)]
    spelled = {one.name: ([*one.opts, *one.secondary_opts], getattr(one, "help", "")) for one in options}
    assert spelled["size"] == (["--size"], "Size of a.Thing, in m.  [default: 0.5]")
    assert spelled["count"] == (["--count"], "Number. By default all.")
    assert spelled["fast"] == (["--fast", "--no-fast"], "Whether.  [default: no-fast]")
    assert spelled["full"] == (["--full", "--no-full"], "Whether.  [default: full]")
    assert spelled["names"] == (["--name"], "Names.  [default: x, y]  Can be repeated.")
    command = click.Command("example", params=list(options), callback=lambda **given: click.echo(json.dumps(given)))
    words = ["--size", "1", "--no-full", "--name", "u", "--name", "v"]
    told = json.loads(CliRunner().invoke(command, words).stdout)
    found = {key: told[key] for key in ("size", "count", "fast", "full", "kind", "names")}
    assert found == {"size": 1.0, "count": None, "fast": None, "full": False, "kind": None, "names": ["u", "v"]}


@pytest.mark.parametrize("words", [["--help"], ["study", "--help"]], ids=" ".join)
def test_the_list_of_commands_imports_no_study_and_no_numpy(words: list[str]) -> None:
    heavy = ("numpy", "scipy", "numba", "pandas", "rich", "matplotlib", "jinja2")
    script = (
        "import sys\nfrom dem_bridge.cli import main\n"
        f"try:\n    main({words!r})\nexcept SystemExit as end:\n    assert not end.code\n"
        f"found = [name for name in {heavy!r} if name in sys.modules]\n"
        "found += [name for name in sys.modules if 'dem_bridge.studies.' in name]\n"
        "assert not found, found"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in (catalogue.STUDIES if "study" in words else ("study", "verify")))


# every study on a tiny case

STEEL = db.Material(youngs_modulus=193e9, poissons_ratio=0.3, density=7850.0)
ROD = db.Body(shape="cylinder", radius=9e-3, height=18e-3, material=STEEL)
CROSSED = db.chain(
    name="crossed", duration=3e-4, bodies=[ROD] * 5, velocity=0.5, angles=(60.0, 70.0, 80.0, 90.0), samples=20
)
MEASURED = Path(__file__).parents[1] / "data" / "measured-crossed.csv"
MONOMER = db.load_scene("driven-monomer")
DRIVEN = replace(
    MONOMER,
    name="driven",
    duration=8e-3,
    mass=MONOMER.mass[:12],
    stiffness=MONOMER.stiffness[:11],
    velocity=(0.0,) * 12,
    exponent=2.5,
    gap=0.0,
    geometry=None,
    drive=db.Drive(shape="chirp", force=0.02, frequency=600.0, last_frequency=11.4e3, sweep=8e-3),
)
#: study -> scene and settings with which it takes a few seconds at most
TINY: dict[str, tuple[Scene | None, dict[str, Any]]] = {
    "model-hierarchy": (CROSSED, {"draws": 1, "numerics": False, "observables": ["arrival", "peak_force"]}),
    "work-precision": (CROSSED, {"limit": 0.1, "repeats": 1, "backends": ["verlet"]}),
    "rule-of-thumb": (CROSSED, {}),
    "order": (CROSSED, {}),
    "stability": (CROSSED, {"points": 2}),
    "energy": (None, {"contacts": 1000}),
    "extremes": (None, {"match": "at-rest", "quick": True}),
    "bands": (DRIVEN, {"tolerance": 0.05}),
    "horizon": (CROSSED, {"perturbations": 2, "seed": 3}),
    "precision": (CROSSED, {}),
    "measurement": (CROSSED, {"files": [str(MEASURED)], "parameters": ["angle=0.1"], "samples": 10}),
    "scatter": (CROSSED, {"count": 2, "spread": 1.0}),
    "sensitivity": (CROSSED, {"base": 16, "spread": 0.1}),
    "styles": (CROSSED, {"dt": 1e-7}),
    "restitution": (None, {"laws": ["mass_velocity"], "backends": ["verlet"]}),
    "engine": (None, {"match": "hertz-coeff_restitution-pair", "known_defects": "ok"}),
}


def _tiny(name: str) -> tuple[Scene | None, dict[str, Any]]:
    """Return the small case of a study: of the table above, or the constant TINY of the test of the study."""
    case: tuple[Scene | None, dict[str, Any]] | None = TINY.get(name)
    return case or importlib.import_module(f"tests.studies.test_{name.replace('-', '_')}").TINY


def _words(settings: dict[str, Any]) -> list[str]:
    """Spell settings as options."""
    words = []
    for key, value in settings.items():
        name = key.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{name}" if value else f"--no-{name}")
        elif isinstance(value, list):
            words += [word for one in value for word in (f"--{name.removesuffix('s')}", one)]
        else:
            words += [f"--{name}", str(value)]
    return words


#: the studies that take 2 to 10 s of CPU on their tiny case; each is also started by a test of its own
DEEP = (
    "bands", "energy", "engine", "horizon", "model-hierarchy", "order", "precision", "restitution", "rule-of-thumb",
    "stability", "styles", "work-precision",
)  # fmt: skip


@pytest.mark.lammps
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in DEEP else name for name in catalogue.STUDIES]
)
def test_every_study_runs_by_name_and_by_command_and_is_written(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, settings = _tiny(name)
    small_stability(monkeypatch, engine=False)
    monkeypatch.setenv("OMP_WAIT_POLICY", "passive")
    result = db.study(name, scene, folder=tmp_path / "called", **settings)
    assert (result.id, bool(result.answer), bool(result.tables)) == (name, True, True)
    assert result.exit_code == 0, [one.sentence for one in result.verdicts]
    told = _commanded(monkeypatch, name, result, scene, settings, tmp_path)
    assert told == result.as_json()
    assert {id: len(rows) for id, rows in told["tables"].items()} == {one.id: len(one.rows) for one in result.tables}
    files = _files(tmp_path / "called")
    assert files == _files(tmp_path / "commanded")
    assert json.loads(files[f"{name}.json"]) == told
    assert {"index.html", *(f"tables/{one.id}.csv" for one in result.tables)} <= set(files)
    page = files["index.html"].decode("utf-8")
    for figure in result.figures:
        picture = files[f"figures/{figure.id}.svg"].decode("utf-8")
        assert inline(picture, figure.id, alternative_text(figure)) in page
        assert any(re.fullmatch(rf"figures/{figure.id}(-\w+)?\.csv", file) for file in files)
    for sentence in result.answer:
        assert typeset(sentence) in page


def _files(folder: Path) -> dict[str, bytes]:
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*.*")}


def _commanded(
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    result: Study,
    scene: Scene | None,
    settings: dict[str, Any],
    folder: Path,
) -> dict[str, Any]:
    """Give the command for a study whose result is at hand; JSON. Its settings must be those of the call."""
    entry = catalogue.STUDIES[name]
    module = importlib.import_module(entry.module)

    @functools.wraps(getattr(module, entry.function))
    def recorded(**given: Any) -> Study:
        assert given.pop("scene", None) == scene
        assert {key: value for key, value in given.items() if key not in SHARED} == {
            key: tuple(value) if isinstance(value, list) else value for key, value in settings.items()
        }
        return result

    monkeypatch.setattr(module, entry.function, recorded)
    words = ["study", name, *_words(settings), "-o", str(folder / "commanded"), "--json"]
    if scene is not None:
        (folder / "scene.toml").write_text(scene_toml(scene), encoding="utf-8")
        words.append(str(folder / "scene.toml"))
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, (done.output, done.exception)
    told: dict[str, Any] = json.loads(done.stdout, parse_constant=lambda word: pytest.fail(word))
    return told


# what cannot be done


@pytest.mark.usefixtures("made_up")
@pytest.mark.parametrize(
    ("words", "settings", "said"),
    [
        (("nothing",), {}, "study = 'nothing'; allowed: of-scene, of-none"),
        (("of-scene",), {}, "study 'of-scene' needs a scene; allowed: the name of a shipped scene"),
        (("of-none", "decelerating-40"), {}, "has scenes of its own, and 'decelerating-40' was given; leave the scene"),
        (
            ("of-scene", "decelerating-40"),
            {"strengths": 2.0},
            "study 'of-scene' has no setting 'strengths'; allowed: jobs, strength",
        ),
        (("of-scene", "decelerating-40"), {"recompute": True}, "study 'of-scene' has no setting 'store'"),
        (("of-none",), {"jobs": 2}, "study 'of-none' has no setting 'jobs'; allowed: none"),
        (("of-none",), {"ranks": 2}, "study 'of-none' has no setting 'engine'"),
    ],
)
def test_what_cannot_be_asked_is_said_in_one_line(words: Any, settings: Any, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        db.study(*words, **settings)


@pytest.mark.usefixtures("made_up")
def test_a_study_is_written_as_page_json_tables_and_figures(tmp_path: Path) -> None:
    found = db.study("of-scene", "decelerating-40", folder=tmp_path, strength=2.0)
    assert found.exit_code == 1
    names = {"index.html", "small.json", "tables/numbers.csv", "figures/picture.csv", "figures/picture.svg"}
    assert {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*.*")} == names
    record = json.loads((tmp_path / "small.json").read_text())
    assert record["tables"]["numbers"] == [{"who": "[a]", "x": None}]
    page = (tmp_path / "index.html").read_text()
    assert "It &lt;is&gt; so." in page
    assert '<svg role="img" aria-label="Picture.' in page
    assert "Interrupted" not in page
    assert "FAIL</span> s: So it is." in page
    assert (tmp_path / "figures/picture.svg").read_bytes().startswith(b"<svg")


def _parts(page: str) -> list[str]:
    """Return the parts of a study's page in their order."""
    marks = {"picture": 'id="picture"', "answer": 'id="answer"', "further": 'id="further"'}
    marks |= {"measured": 'id="measured"', "tables": 'id="tables"'}
    return sorted((part for part in marks if marks[part] in page), key=lambda part: page.index(marks[part]))


ORDER = ["answer", "picture", "further", "tables", "measured"]


def test_a_page_has_the_answer_in_two_sentences_figure_folded_tables_and_method_in_this_order(tmp_path: Path) -> None:
    study = replace(small(), answer=("First.", "Second.", "Third."), notes=("By counting.",))
    write_study(study, tmp_path)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert _parts(page) == ORDER
    answer = page[page.index('id="answer"') : page.index("</ol>")]
    assert (answer.count("<li>"), "Third." in page) == (2, True)
    assert '<details class="part" id="table-numbers"><summary>' in page  # folded until it is opened
    # planted: the answer behind the figures
    first, second = page.index('<ol class="answer"'), page.index('<section id="figures"')
    end = page.index("</section>", second)
    assert _parts(page[:first] + page[second:end] + page[first:second] + page[end:]) != ORDER


@pytest.mark.usefixtures("made_up")
def test_what_was_interrupted_is_written_and_says_so(tmp_path: Path) -> None:
    assert db.study("of-none", folder=tmp_path).interrupted
    assert "Interrupted" in (tmp_path / "index.html").read_text()


def test_the_terminal_knows_all_outcomes(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(terminal._OUTCOMES) == {outcome.value for outcome in Outcome}
    terminal.print_study(small(), verbose=True)
    shown = capsys.readouterr().out
    assert "* It <is> so." in shown
    assert "[a]" in shown


@pytest.mark.parametrize("names", [("pair",), ("pair", "pair"), ("pair", "chain")], ids=" ".join)
def test_the_scene_stands_in_the_title_if_all_rows_share_it(
    names: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    rows = tuple((name, float(x)) for x, name in enumerate(names))
    table = Table(id="numbers", title="Numbers", caption="", columns=("scene", "x"), rows=rows)
    terminal.print_study(replace(small(), tables=(table,)), verbose=True)
    shown = capsys.readouterr().out
    shared = len(set(names)) == 1
    assert ("Numbers: pair" in shown) == shared
    assert shown.count("pair") == (1 if shared else names.count("pair"))


@pytest.mark.usefixtures("made_up")
def test_a_page_that_is_not_from_dem_bridge_is_not_replaced(tmp_path: Path) -> None:
    page, foreign = tmp_path / "index.html", "<html><title>another project</title></html>"
    page.write_text(foreign)
    report = db.study("of-scene", "decelerating-40", strength=2.0)
    for write in (
        lambda: db.study("of-scene", "decelerating-40", folder=tmp_path, strength=2.0),
        lambda: db.verify("decelerating-40", folder=tmp_path),
        lambda: report.save(tmp_path),
    ):
        with pytest.raises(
            UsageError, match=r"index\.html: the page is not from dem_bridge and would be lost; allowed"
        ):
            write()
    assert [file.name for file in tmp_path.iterdir()] == ["index.html"]
    assert page.read_text() == foreign
    page.unlink()
    report.save(tmp_path)
    earlier = page.read_text().replace('<meta name="generator" content="dem_bridge">\n', "")
    assert "generator" not in earlier
    page.write_text(earlier)
    report.save(tmp_path)
    assert "generator" in page.read_text()
