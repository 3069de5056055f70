"""The page is one file, says what is in the verdicts, and does not gloss over trouble."""

from __future__ import annotations

import io
import json
import re
from collections import Counter
from dataclasses import replace
from html import escape, unescape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.drawing import draw_figure
from dem_bridge.report.page import KINDS, csv_texts, digits_of, number, sortable, study_files, typeset, write_study
from dem_bridge.report.study import Claim, Study
from dem_bridge.report.svg import compress_png
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.verification.assess import SceneStudy, assess_scene
from dem_bridge.verification.records import junit
from dem_bridge.verification.roles import TWIN, assign_roles
from dem_bridge.verification.verification import SCHEMA, Verification, verification_of
from dem_bridge.verification.verify import plan_scene
from tests.helpers.fake_paper import NOTHING, fake_paper
from tests.helpers.fake_runs import free_flight

PAIR = Scene(
    name="three",
    description="<b>three</b> & more",
    duration=1.5e-4,
    mass=(8e-3, 1e-2, 1e-2),
    stiffness=(4e9, 4e9),
    velocity=(0.8, 0.0, 0.0),
    samples=20,
)


def _verification(scene: Scene, broken: bool = False) -> Verification:
    """All runs of a small scene, with the twin (or a broken run) standing in for LAMMPS."""

    def run(case: Case) -> Result:
        if broken and case.backend == assign_roles(scene).engine:
            return Result(case=case, failure=RunBroken("LAMMPS: ERROR: Lost atoms"))
        name = TWIN if case.backend == assign_roles(scene).engine else case.backend
        how = case.resolution
        run = db.solve(
            scene, backend=name, dt=how.dt, uncertainty=case.uncertainty, surrogate_radius=how.surrogate_radius
        )
        return Result(case=case, trajectory=run)

    plan = plan_scene(scene, 1e-3)
    return verification_of([plan.assess([run(case) for case in plan.cases])], accuracy=1e-3, wall=1.0)


def _written(study: Verification, folder: Path, pictures: Store) -> Path:
    """Write a study and return its page."""
    assert write_study(study, folder, pictures)[0] == "index.html"
    return folder / "index.html"


@pytest.fixture(scope="module")
def found() -> Verification:
    return _verification(PAIR)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Store of the pictures of all pages here."""
    return Store(tmp_path_factory.mktemp("pictures"))


@pytest.fixture(scope="module")
def page(found: Verification, pictures: Store, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Page of a verification without a paper, in a new folder."""
    return _written(found, tmp_path_factory.mktemp("page") / "new" / "folder", pictures)


@pytest.fixture(scope="module")
def whole(found: Verification, pictures: Store, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a report with a paper."""
    return _written(fake_paper(found), tmp_path_factory.mktemp("whole"), pictures).parent


def test_the_page_is_one_file_that_loads_nothing(page: Path) -> None:
    files = {path.relative_to(page.parent).as_posix() for path in page.parent.rglob("*.*")}
    assert files == {"index.html", "verdicts.json", "tables/verdicts.csv", "tables/observables.csv"}
    _loads_nothing(page.read_text(encoding="utf-8"))


def _loads_nothing(text: str) -> None:
    assert text.count("<svg ")
    sources = re.findall(r'(?:src|xlink:href)="([^"]{0,30})', text)
    assert all(source.startswith(("data:image/png;base64,", "#")) for source in sources), "a request"
    assert not re.search(r"<link|@import|url\((?!#)|<script[^>]|<img", text), "a request"


def test_text_with_markup_is_escaped(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "&lt;b&gt;three&lt;/b&gt; &amp; more" in text
    assert "<b>three" not in text


def test_the_page_shows_every_verdict_and_what_is_not_verified(found: Verification, page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for verdict in found.verdicts:
        if verdict.backend != "bca":
            assert number(verdict.difference) in text
    for line in found.not_verified:
        assert _escaped(line) in text


@pytest.mark.parametrize(
    ("changes", "provenance", "words"),
    [
        ({}, {}, "on 1 rank: pair_style granular (hertz), fix nve."),
        (
            {"exponent": (2.0, 2.5), "gravity": 9.8},
            {},
            "on 1 rank: pair_style granular (hooke and hertz), fix nve, fix gravity.",
        ),
        (
            {"damping": Damping(law="kuwabara-kono", coefficient=1e-6), "drag": 1.0},
            {"lammps": {"ranks": 2}},
            "on 2 ranks: pair_style granular (hertz with damping viscoelastic), fix nve,"
            " fix langevin at zero temperature.",
        ),
        ({"exponent": 3.0}, {"table": {"style": "spline"}}, "on 1 rank: pair_style table spline, fix nve."),
        (
            {"exponent": 3.0, "damping": Damping(law="dashpot", coefficient=1.0)},
            {"table": {"style": "linear"}},
            "on 1 rank: pair_style table linear, pair_style granular (damping velocity), fix nve.",
        ),
    ],
    ids=str,
)
def test_what_is_not_verified_goes_by_what_was_run(
    changes: dict[str, Any], provenance: dict[str, Any], words: str
) -> None:
    scene = replace(PAIR, **changes)
    run = free_flight(bodies=3, contacts=2)
    case = Case(scene=scene, backend=assign_roles(scene).engine, resolution=Resolution(), sampling=Sampling(count=2))
    truth = replace(case, backend="reference")
    results = (
        Result(case=case, trajectory=replace(run, provenance={"settings": {}, **provenance})),
        Result(case=truth, trajectory=replace(run, provenance={"settings": {}})),
    )
    study = SceneStudy(roles=assign_roles(scene), others=results, verdicts=())
    lines = verification_of([study], accuracy=1e-3, wall=1.0).not_verified
    assert [line for line in lines if words in line], lines
    assert any("by a second method" in line for line in lines) == bool({"damping", "drag"} & set(changes))


def test_every_sentence_of_an_answer_is_typeset(tmp_path: Path) -> None:
    sentences = tuple(f"The error of beta_{place} is 1e-06." for place in range(4))
    write_study(Study(id="four", title="Four sentences", answer=sentences), tmp_path)
    for place in range(4):
        assert f"β<sub>{place}</sub> is 1×10<sup>−6</sup>." in _text(tmp_path)


def test_the_json_has_the_keys_of_the_contract(page: Path) -> None:
    record = json.loads((page.parent / "verdicts.json").read_text(encoding="utf-8"))
    assert record["schema"] == SCHEMA == "dem-bridge/verdicts/1"
    assert set(record) == {"schema", "verdicts", "claims", "budgets", "observables", "provenance"}
    for verdict in record["verdicts"]:
        assert {
            "scene", "quantity", "backend", "reference", "difference", "scale", "uncertainty",
            "reference_uncertainty", "tolerance", "outcome", "sentence",
        } <= set(verdict)  # fmt: skip
    assert record["provenance"]["runs"][0]["scene_hash"] == PAIR.content_hash


def test_a_broken_run_stands_in_the_headline_and_is_no_pass() -> None:
    broken = _verification(PAIR, broken=True)
    [sentence] = broken.answer
    assert "BROKEN" in sentence
    assert "Lost atoms" in sentence
    assert broken.exit_code == 3


def test_a_failed_check_stands_in_the_headline_instead_of_praise(found: Verification) -> None:
    [study] = found.studies
    assert study.runs is not None
    strict = assess_scene(assign_roles(PAIR), study.runs, 1e-9)
    [sentence] = verification_of([strict], accuracy=1e-3, wall=1.0).answer
    assert "FAIL" in sentence
    assert "are round-off" not in sentence


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be written"):
        write_study(NOTHING, tmp_path / "file")


def test_nothing_names_a_machine_or_a_path(found: Verification) -> None:
    text = json.dumps(found.as_json())
    assert str(Path.home()) not in text.replace("/root", str(Path.home()))
    assert not re.search(r'"/(home|root|tmp|work|usr)/', text)


def test_junit_counts_what_failed() -> None:
    broken = _verification(PAIR, broken=True)
    suite = ElementTree.fromstring(junit(broken.verdicts))
    assert suite.get("errors") == "1"
    assert suite.get("tests") == str(len(broken.verdicts))
    assert len(suite.findall("testcase")) == len(broken.verdicts)


def _text(folder: Path) -> str:
    return (folder / "index.html").read_text(encoding="utf-8")


def test_a_paper_opens_with_its_numbers_and_details_stand_in_the_appendix(whole: Path) -> None:
    text, paper = _text(whole), fake_paper()
    order = [
        "20 statements of the paper", "question", "method", "result",
        "what is wrong in the paper, or beyond our limits", "figures", "claims of the paper", "what is not verified",
        "scope", "appendix",
    ]  # fmt: skip
    headings = [unescape(re.sub("<.*?>", "", one)).lower() for one in re.findall(r"<h2[^>]*>(.*?)</h2>", text)]
    assert headings == order
    first, main = text.split('id="figures"')[0], text.split('id="appendix"')[0]
    opening = text.split('<p class="lead">')[0]
    assert "<b>17 of" not in opening
    assert '<span class="pill PASS">17 of 17 checks of LAMMPS and of our codes pass</span>' in opening
    for headline in paper.headlines:
        assert f"<li><b>{typeset(headline.number)}</b>{typeset(headline.sentence)}</li>" in opening
    assert opening.count('class="cell ') == len(paper.claims) + len({claim.kind for claim in paper.claims})
    for part in paper.abstract:
        for point in part.points:
            assert (first if part in paper.abstract[:3] else text).count(f"<li>{typeset(point)}</li>") == 1, point
    # the sketch of a chain; each figure has its picture, but for the scale of errors, which is text
    assert first.count('<svg class="sketch" role="img" aria-label="A sphere') == 1
    pictures = main.split('id="figures"')[1]
    assert pictures.count("<svg role=") == len(paper.figures) - 1
    # for narrow screens: a legend and two panels of each
    assert pictures.count('<svg class="panel" aria-hidden="true"') == 3 * (len(paper.figures) - 1)
    for sentence in paper.not_verified:
        assert main.count(_escaped(sentence)) == 1, sentence
    # whatever is long is folded, behind the main part
    assert "<details" not in main
    parts = re.findall(r'<details class="part" id="([^"]+)">', text.split('id="appendix"')[1])
    assert {"claims-in-full", "verdicts", "budgets", "provenance", "shared"} < set(parts)
    shown = ("claims", "verdicts", "wrong")
    assert {f"table-{table.id}" for table in paper.tables if table.id not in shown} <= set(parts)


def test_navigation_has_five_entries_before_version_and_date(whole: Path, page: Path) -> None:
    for file in (whole / "index.html", page):
        [nav] = re.findall(r"<body>\s*<nav[^>]*>(.*?)</nav>", file.read_text(encoding="utf-8"), re.DOTALL)
        assert nav.count("<a ") == 5
        assert re.search(rf'class="about"><span>dem_bridge {re.escape(db.__version__)}</span> .*20\d\d-\d\d-\d\d<', nav)


def test_the_strip_of_claims_keeps_its_meaning_without_colour(whole: Path) -> None:
    text, paper = _text(whole), fake_paper()
    [strip] = re.findall(r'<ol class="strip">(.*?)</ol>', text, re.DOTALL)
    cells = re.findall(r'<a class="cell (\w+)" href="#claim-([^"]+)".*?</span>(.)<span class="spoken">', strip)
    kinds = [KINDS[claim.kind] for claim in paper.claims]
    assert cells == [(kind.colour.value, claim.id, kind.mark) for kind, claim in zip(kinds, paper.claims, strict=True)]
    assert len({kind.mark for kind in KINDS.values()}) == len(KINDS) == 6
    [legend] = re.findall(r'<p class="legend">(.*?)</p>', text, re.DOTALL)
    counts = Counter(claim.kind for claim in paper.claims)
    assert [f"{KINDS[kind].name} ({counts[kind]})" in legend for kind in counts] == [True] * len(counts)


def test_every_picture_is_a_vector_with_an_alternative_text_and_letters_of_8_points(whole: Path) -> None:
    pictures = _pictures(whole)
    assert len(pictures) >= len(fake_paper().figures)
    for picture in pictures:
        check_picture(picture)


def _pictures(folder: Path) -> list[str]:
    """Return the pictures of a page, without the sketch and what it plays, whose axes are text of the page."""
    drawn = re.sub(r'<div class="frame">.*?</div>', "", _text(folder), flags=re.DOTALL)
    # panels one by one show what the whole picture has
    return re.findall(r'<svg (?!class="sketch"|class="panel").*?</svg>', drawn, re.DOTALL)


def check_picture(picture: str) -> None:
    """Assert that a picture has an alternative text, that its text is text, and that no letter is below 8 points."""
    words = re.match(r'<svg role="img" aria-label="([^"]{20,})"', picture)
    assert words, "no alternative text"
    sizes = [float(size) for size in re.findall(r"font-size: ([\d.]+)px", picture)]
    assert picture.count("<text") == len(sizes) > 5
    assert min(sizes) >= 8.0, "small letters"
    # user units are points, because a sheet has room for the whole width
    assert float(re.findall(r'viewBox="0 0 ([\d.]+)', picture)[0]) <= 72.0 * 186.0 / 25.4, "wider than a sheet"


@pytest.mark.parametrize(
    ("right", "planted", "said"),
    [
        ("font-size: 8px", "font-size: 7px", "small letters"),
        ('aria-label="', 'aria-label="" data-alt="', "no alternative text"),
        ('viewBox="0 0 ', 'viewBox="0 0 1', "wider than a sheet"),
    ],
)
def test_a_picture_with_small_letters_no_words_or_too_wide_is_caught(
    whole: Path, right: str, planted: str, said: str
) -> None:
    picture = _pictures(whole)[0]
    check_picture(picture)
    with pytest.raises(AssertionError, match=said):
        check_picture(picture.replace(right, planted))


def test_a_request_to_the_network_is_caught(whole: Path) -> None:
    for planted in (
        '<img src="https://x.y/z.png">',
        '<link href="a.css">',
        "<style>a{background:url(http://x.y)}</style>",
    ):
        with pytest.raises(AssertionError, match="a request"):
            _loads_nothing(_text(whole) + planted)


def _escaped(text: str) -> str:
    return escape(text).replace("&#x27;", "&#39;")


def test_scenes_that_fail_stand_before_those_that_pass(pictures: Store, tmp_path: Path) -> None:
    passed, broken = _verification(replace(PAIR, name="sound")), _verification(PAIR, broken=True)
    both = verification_of((*passed.studies, *broken.studies), accuracy=1e-3, wall=1.0)
    page = _written(both, tmp_path, pictures).read_text(encoding="utf-8")
    assert re.findall(r'<div class="banner (\w+)">', page) == ["BROKEN", "PASS"]


def test_runs_that_do_not_pass_stand_on_page_one_of_a_paper(pictures: Store, tmp_path: Path, whole: Path) -> None:
    assert "These verdicts do not pass" not in _text(whole)
    broken = fake_paper(_verification(PAIR, broken=True))
    first = _written(broken, tmp_path, pictures).read_text(encoding="utf-8").split('id="figures"')[0]
    assert re.search('<span class="outcome BROKEN">BROKEN</span> three: [^<]*ERROR: Lost atoms', first)


@pytest.mark.parametrize("count", [2, 4])
def test_a_defect_is_described_once_and_more_than_three_failures_are_folded(count: int) -> None:
    words: dict[str, Any] = {"quantity": "e", "backend": "lammps-granular", "reference": "", "outcome": Outcome.FAIL}
    why = "Known defect d: damping loses too little; see #1"
    found = [Verdict(scene="", sentence=f"{why}: case {k}.", known_defect="d", **words) for k in range(count)]
    page = str(study_files(Study(id="four", title="Impacts", answer=(), verdicts=tuple(found)))["index.html"])
    [listed] = re.findall(r"<ul>(.*?)</ul>", page, re.DOTALL)
    assert (listed.count("loses too little"), listed.count("<li>")) == (1, count)
    assert f"Known defect d: case {count - 1}." in listed
    folded = f'<details><summary class="outcome FAIL">{count} verdicts do not pass</summary>'
    assert (folded in page, "These verdicts do not pass" in page) == (count > 3, count <= 3)


def test_every_claim_has_its_anchor_its_words_and_its_values(whole: Path) -> None:
    text = _text(whole)
    for claim in fake_paper().claims:
        [body] = re.findall(rf'<tbody id="claim-{claim.id}">(.*?)</tbody>\n(?:<tbody|</table></div>)', text, re.DOTALL)
        assert f'href="#claim-{claim.id}"' in text
        for part in (_escaped(claim.where), typeset(claim.statement), typeset(claim.sentence)):
            assert part in body
        assert f'">{KINDS[claim.kind].name}</td>' in body
        assert body.count("<tr>") == 2 + 2 * bool(claim.values)  # one quantity, by six codes
        for value in claim.values:
            assert f'<th class="n">{value.backend}</th>' in body
            bar = (
                "" if value.uncertainty != value.uncertainty else f'<br><span class="faint">± {value.uncertainty:.2g}<'
            )
            assert f'<td class="n">{number(value.value, digits_of(value.value, value.uncertainty))}{bar}' in body


def test_what_is_drawn_and_tabled_lies_beside_the_page_in_full_precision(whole: Path) -> None:
    paper, text = fake_paper(_verification(PAIR)), _text(whole)
    wanted: dict[str, str] = {}
    for figure in paper.figures:
        wanted |= {f"figures/{name}": content for name, content in csv_texts(figure).items()}
    wanted |= {f"tables/{table.id}.csv": table.as_csv() for table in paper.tables}
    assert {str(path.relative_to(whole)) for path in whole.rglob("*.csv")} == set(wanted)
    for name, content in wanted.items():
        assert (whole / name).read_text(encoding="utf-8") == content
        assert text.count(f'href="{name}"') == 1, name
    for figure in paper.figures:
        assert (whole / f"figures/{figure.id}.svg").read_text(encoding="utf-8").startswith("<svg")


def test_claims_stand_in_the_json_without_nan(whole: Path) -> None:
    record = json.loads((whole / "verdicts.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert len(record["claims"]) == 20
    assert set(record["claims"][0]) == set(Claim.__dataclass_fields__)
    printed, reference, *_ = record["claims"][0]["values"]
    assert printed["uncertainty"] is None
    assert reference["uncertainty"] == pytest.approx(1e-10, rel=1e-12, abs=0.0)


def test_the_page_of_a_paper_loads_nothing_escapes_markup_and_stays_small(whole: Path) -> None:
    text = _text(whole)
    _loads_nothing(text)
    assert "<b>cannot" not in text
    assert len(text) < 1.5e6
    ids = re.findall(r' id="([^"]+)"', text)
    assert len(set(ids)) == len(ids)
    assert set(re.findall(r'href="#([^"]+)"', text)) <= set(ids)


def test_outcomes_sort_by_severity_and_numbers_by_value() -> None:
    keys = [sortable(word) for word in ("BROKEN", "FAIL", "UNDECIDED", "NOT_RUN", "MODEL_DIFFERENCE", "PASS")]
    assert keys == sorted(keys)
    assert {sortable(outcome) for outcome in Outcome} == set(keys)
    assert [float(sortable(value)) for value in (1e-300, 0.1 + 0.2, 7, -1e9)] == [1e-300, 0.1 + 0.2, 7.0, -1e9]
    assert sortable(float("nan")) == ""


def test_a_heading_stands_to_the_right_where_its_column_has_numbers(whole: Path) -> None:
    text = _text(whole).split('id="table-gradients"')[1].split("</thead>")[0]
    assert text.count("<th class=n>") == 3  # one of them with an empty cell among its numbers
    assert "<th>outcome</th>" in text


def test_fewer_bytes_take_no_colour_from_a_picture() -> None:
    """Of 1235 colours 256 are left; the rest move by 4 of 255, where the usual choice moves thin lines by 41."""
    full = io.BytesIO()
    draw_figure(fake_paper().figures[0]).savefig(full, format="png", dpi=120)
    small = compress_png(full.getvalue())
    before, after = (np.asarray(Image.open(io.BytesIO(one)).convert("RGB"), float) for one in (full.getvalue(), small))
    assert np.max(np.abs(before - after)) <= 12.0
    assert len(small) < 0.5 * len(full.getvalue())


def _contrast(one: str, other: str) -> float:
    """Return the ratio of contrast of two colours by WCAG 2."""

    def luminance(colour: str) -> float:
        parts = (int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_text_is_legible_on_a_light_and_on_a_dark_page(whole: Path) -> None:
    themes = [dict(re.findall(r"--([\w-]+): (#\w{6})", part)) for part in _text(whole).split("@media screen")[:2]]
    pairs = [(ink, "paper") for ink in ("ink", "faint", "pass", "fail", "doubt", "model")]
    pairs += [("pass", "pass-wash"), ("model", "model-wash"), ("on-fail", "fail"), ("ink", "wash"), ("faint", "wash")]
    for theme in themes:
        assert all(_contrast(theme[ink], theme[ground]) >= 4.5 for ink, ground in pairs), theme
        # lines of pictures need 3
        assert all(_contrast(theme[ink], theme["paper"]) >= 3.0 for ink in ("blue", "grey"))
    assert _contrast(themes[0]["ink"], themes[1]["paper"]) < 4.5  # the ink of one page is not that of the other
