"""Decks and foreign codes without running them: what is read, copied, compared, measured and shown, in full."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import DemBridgeError, RunBroken, UsageError
from dem_bridge.formats.readers import Record
from dem_bridge.judging import beside, deck, foreign, limits
from dem_bridge.judging.beside import CodeRun
from dem_bridge.judging.error import QuantityErrors
from dem_bridge.judging.judgement import Addition, Judgement
from dem_bridge.judging.limits import Limit
from dem_bridge.lmp.reader.script import Command
from dem_bridge.scene.scene import Scene, Wall

PAIR = Scene(name="p", duration=1e-3, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(1.0, 0.0), samples=50)
NAN = math.nan


def commands(*lines: str) -> tuple[Command, ...]:
    return tuple(Command("in.x", number, tuple(line.split())) for number, line in enumerate(lines, start=1))


def user_deck(*lines: str, units: str = "si", read: Any = None, problems: tuple[str, ...] = ()) -> deck.UserDeck:
    state: Any = SimpleNamespace(units=units, time_steps=[], step=None)
    return deck.UserDeck(
        path=Path("in.x"), commands=commands(*lines), state=state, read=read, mirrored=False, problems=problems
    )


def run_of(user: deck.UserDeck, *, dangerous: int = 0, dt: float | None = 1e-6) -> Any:
    return SimpleNamespace(deck=user, dangerous=dangerous, dt=dt, version=20250722)


# ---------------------------------------------------------------- what a deck says
def test_units_steps_and_radii_of_a_deck_are_in_si() -> None:
    user = user_deck("timestep 1", "run 5", "timestep 2", units="micro")
    state: Any = user.state
    state.particles = SimpleNamespace(atoms={1: SimpleNamespace(radius=3.0), 2: SimpleNamespace(radius=5.0)})
    assert (user.dt, user.radius) == (None, pytest.approx(5e-6))
    state.step = 4.0
    assert user.dt == pytest.approx(4e-6)
    state.time_steps = [7.0]
    assert user.dt == pytest.approx(7e-6)
    state.units = "unheard"
    assert (user.dt, user.radius) == (7.0, 5.0)
    last = user.last("timestep")
    assert last is not None
    assert (last.rest, user.last("fix")) == (("2",), None)


def test_files_that_cannot_be_read_are_no_decks(tmp_path: Path) -> None:
    assert not deck.is_deck(tmp_path / "none")
    (tmp_path / "in.x").write_text("# a comment\n  units si\n")
    assert deck.is_deck(tmp_path / "in.x")
    with pytest.raises(UsageError, match=r"none: the deck cannot be read \(No such file or directory\)"):
        deck.user_deck(tmp_path / "none", PAIR)


@pytest.mark.parametrize(
    ("ours", "theirs", "words"),
    [
        ((1.0,), (1.0 + 1.5e-12,), "1; the scene has 1"),
        ((1.0,), (1.0 + 0.9e-12,), ""),
        ((1e-6,), (1e-6 * (1.0 + 1e-7),), "1.0000001e-06; the scene has 1e-06"),
        ((1e-6 * (1.0 + 1e-7),), (1e-6,), "1e-06; the scene has 1.0000001e-06"),
        ((1.0, 2.0), (1.0, 3.0), "3 at 1; the scene has 2"),
        ((0.0, 2.0), (0.0, 2.0 + 1e-12), ""),
        ((0.0, 0.0), (0.0, 3.0), "3 at 1; the scene has 0"),
        ((1.0, 2.0, 5.0), (1.5, 4.0, 5.0), "4 at 1; the scene has 2"),
        ((), (), ""),
        ((), (1.0,), "1 numbers; the scene has 0"),
        (2.0, 0.0, "0; the scene has 2"),
        (0.0, 0.0, ""),
        (None, None, ""),
        (None, Wall(stiffness=4e9, gap=0.5), "stiffness 4000000000.0, gap 0.5; the scene has none"),
        (Wall(stiffness=4.0), None, "none; the scene has stiffness 4.0, gap 0.0"),
        ((1.0,), None, "none; the scene has (1.0,)"),
        (None, SimpleNamespace(a=None, b=(7.0, 8.0)), "b 7.0; the scene has none"),
        (None, SimpleNamespace(a=None), "namespace(a=None); the scene has none"),
    ],
)
def test_differences_of_values_are_said_to_twelve_digits(ours: object, theirs: object, words: str) -> None:
    assert deck._difference(ours, theirs) == words


def test_differences_of_scenes_are_by_field() -> None:
    other = replace(PAIR, gravity=9.81, mass=(1e-2, 2e-2))
    assert deck.differences(PAIR, other) == {
        "mass": "0.02 at 1; the scene has 0.01",
        "gravity": "9.81; the scene has 0",
    }
    assert deck.differences(PAIR, PAIR) == {}


def test_words_of_a_deck_are_copied_if_they_are_files_of_its_folder(tmp_path: Path) -> None:
    long, exact = "a" * 200, "b" * 199
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "deep").mkdir()
    for name in ("in.x", "data", long, exact, "out/table", "out/deep/table"):
        (tmp_path / name).write_text("")
    user: Any = SimpleNamespace(
        path=tmp_path / "in.x",
        commands=commands(f"read_data data {long} {exact}", "print out/deep/new no/deep/new missing out/table out"),
    )
    assert deck._named_paths(user) == {"in.x", "data", exact, "out/deep/new", "out/table"}


# ---------------------------------------------------------------- the added dump
def dump(*frames: str) -> str:
    heading = "ITEM: UNITS\nsi\nITEM: TIMESTEP\n{0}\nITEM: NUMBER OF ATOMS\n3\nITEM: ATOMS id type x y z vx vy vz\n{1}"
    return "".join(heading.format(number, frame) for number, frame in enumerate(frames))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("mirrored", [False, True])
def test_atoms_of_the_dump_are_sorted_along_the_chain_by_the_first_frame(
    tmp_path: Path, axis: int, mirrored: bool
) -> None:
    def row(number: int, kind: int, place: str, speed: str) -> str:
        places = ["0", "0", "0"]
        places[axis] = place
        return f"{number} {kind} {' '.join(places)} {speed} 1e3 0.5\n"

    path = tmp_path / "dump"
    path.write_text(
        dump(
            row(7, 1, "3.0", "-900") + row(5, 3, "-1.5", "2") + row(6, 2, "1.0", "0"),
            row(6, 2, "9.0", "0") + row(7, 1, "3.0", "-1") + row(5, 3, "-1.5", "2"),
        )
    )
    deck._put_in_order(path, mirrored=mirrored)

    def signed(text: str) -> str:
        if not mirrored:
            return text
        head, *words = text.split()[0:1], *text.split()[2:]
        return " ".join([*head, text.split()[1], *(w[1:] if w.startswith("-") else f"-{w}" for w in words)]) + "\n"

    order = ((5, 3, "-1.5", "2"), (6, 2, "1.0", "0"), (7, 1, "3.0", "-900"))
    later = ((5, 3, "-1.5", "2"), (6, 2, "9.0", "0"), (7, 1, "3.0", "-1"))
    frames = []
    for rows in (order, later):
        chosen = rows[::-1] if mirrored else rows
        frames.append("".join(signed(row(rank, *part[1:])) for rank, part in enumerate(chosen, start=1)))
    assert path.read_text() == dump(*frames)


@contextmanager
def folder_at(path: Path) -> Iterator[Path]:
    path.mkdir()
    yield path


@pytest.mark.parametrize(
    ("log", "written", "problem"),
    [
        ("Loop time of 1 on 1 procs for 0 steps with 2 atoms\nLoop time of 1 on 1 procs for 9 steps with 2 atoms\n"
         "Dangerous builds = 2\nDangerous builds = 3\n", True, False),
        ("", True, False),
        (None, True, False),
        ("Loop time of 1 on 1 procs for 0 steps with 2 atoms\n", True, True),
        ("Loop time of 1 on 1 procs for 9 steps with 2 atoms\n", False, True),
    ],
)  # fmt: skip
def test_a_copy_of_a_deck_runs_with_one_line_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log: str | None, written: bool, problem: bool
) -> None:
    home = tmp_path / "home"
    (home / "sub").mkdir(parents=True)
    (home / "in.x").write_text("units si\nread_data sub/data\ntimestep 1e-6\ninclude more\nrun 20\n")
    (home / "more").write_text("# more\nrun 10\nprint done")
    (home / "sub" / "data").write_text("data")
    monkeypatch.setattr(deck, "workspace", lambda: folder_at(tmp_path / "work"))
    engine: Any = SimpleNamespace(with_variables=lambda values: ("engine", values))
    seen: dict[str, Any] = {}

    def run(folder: Path, name: str, **words: Any) -> Any:
        files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
        seen.update(words, name=name, files=files, lines=(folder / "more").read_text().splitlines())
        if log is not None:
            (folder / "log.lammps").write_text(log)
        if written:
            (folder / "dem_bridge.dump").write_text(dump("1 1 0 0 0 0 0 0\n"))
        return SimpleNamespace(wall=1.5, cpu=2.5, version=20250722)

    monkeypatch.setattr(deck, "run_deck", run)
    if problem:
        with (
            pytest.raises(RunBroken, match=r"in\.x: LAMMPS ended without an error, but it ran no step;"),
            deck.deck_run(home / "in.x", PAIR, engine=engine, time_limit=7.0),
        ):
            pass
        return
    with deck.deck_run(home / "in.x", PAIR, engine=engine, time_limit=7.0, variables={"a": "1"}) as result:
        assert (result.wall, result.cpu, result.version, result.dt) == (1.5, 2.5, 20250722, 1e-6)
        assert result.dangerous == (5 if log else 0)
        assert result.out == tmp_path / "work" / "dem_bridge.dump"
        assert result.out.is_file()
    assert (seen["name"], seen["time_limit"], seen["engine"]) == ("in.x", 7.0, ("engine", {"a": "1"}))
    assert seen["files"] == ["in.x", "more", "sub/data"]
    assert seen["lines"] == [
        "# more",
        'if "$(is_defined(dump,dem_bridge)) == 0" then'
        ' "dump dem_bridge all custom 20 dem_bridge.dump id type x y z vx vy vz"'
        ' "dump_modify dem_bridge sort id units yes time yes format float %.17g"',
        "run 10",
        "print done",
    ]


def test_a_deck_is_read_from_the_end_at_which_it_is_most_like_the_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "in.x"
    path.write_text("units si\nprint here\n")
    plain = deck.user_deck(path, PAIR)
    assert (plain.read, plain.mirrored, len(plain.problems)) == (None, False, 1)
    assert [command.text for command in plain.commands] == ["units si", "print here"]
    monkeypatch.setattr(deck, "read_deck", lambda text, reverse, **words: SimpleNamespace(scene=int(reverse)))
    for counts, mirrored in (((2, 2), False), ((2, 1), True), ((1, 2), False)):
        monkeypatch.setattr(deck, "differences", lambda scene, end, counts=counts: range(counts[end]))
        user: Any = deck.user_deck(path, PAIR)
        assert (user.mirrored, user.read.scene, user.problems) == (mirrored, int(mirrored), ())


@pytest.mark.parametrize(
    ("problems", "message"),
    [
        (("bad", "a variable is missing", "another variable"), "a variable is missing"),
        (("bad",), "in.x: the deck has no run command that can be read; give a deck that runs"),
    ],
)
def test_a_deck_without_a_run_is_refused(
    monkeypatch: pytest.MonkeyPatch, problems: tuple[str, ...], message: str
) -> None:
    monkeypatch.setattr(deck, "user_deck", lambda path, scene, variables: user_deck("units si", problems=problems))
    engine: Any = SimpleNamespace(with_variables=lambda values: None)
    run_it = deck.deck_run(Path("in.x"), PAIR, engine=engine, time_limit=1.0)
    with pytest.raises(UsageError) as refused, run_it:
        pass
    assert str(refused.value) == message


# ---------------------------------------------------------------- what limits a deck
def test_limits_of_known_size_stand_before_unknown_ones_and_those_without_effect() -> None:
    effects = [0.0, NAN, 1.0, 3.0, -0.0]
    places = [limits._place(Limit(what="", found="", effect=effect, advice="")) for effect in effects]
    assert places == [(2, 0.0), (1, 0.0), (0, -1.0), (0, -3.0), (2, 0.0)]


REFERENCE = np.array([[4.0, 1.0], [-1.0, 0.5]])


def file_of(values: Any, time: Any = (0.0, 1e-5)) -> Any:
    """Return the errors of a file with these velocities, m/s, at two times."""
    part = SimpleNamespace(error=values - REFERENCE, columns=(0, 1), scale=4.0)
    record = SimpleNamespace(time=np.array(time), values={"velocity": values})
    return SimpleNamespace(quantities={"velocity": part}, record=record)


def numerics(
    monkeypatch: pytest.MonkeyPatch, radius: float | None, rest: float, **stated: float
) -> dict[str, tuple[str, float]]:
    """Return the rows of a run whose twin is off by 0.2 of 4 m/s, by 0.1 m/s more with its radius, 0.5 by gravity."""
    plain = REFERENCE + np.array([[-0.2, 0.1], [0.0, 0.0]])
    rough = plain + np.array([[-0.1, 0.0], [-0.05, 0.0]])

    def velocity(self: limits.Twins, radius: float | None = None, **changes: float) -> Any:
        assert (self.scene.duration, self.scene.samples, changes) == (1e-5, 1, stated if changes else {})
        return (plain if radius is None else rough) + (0.5 if changes else 0.0)

    monkeypatch.setattr(limits.Twins, "velocity", velocity)
    run: Any = SimpleNamespace(dt=1e-7, deck=SimpleNamespace(radius=radius, stated=lambda scene: stated))
    errors = file_of(plain + (0.5 if stated else 0.0) + np.array([[0.0, 0.0], [0.0, 4.0 * rest]]))
    twins = limits.Twins.of(PAIR, run, errors)
    return {row.what: (row.found, row.effect) for row in limits._of_numerics(twins, run, errors)}


def test_the_step_and_the_radius_are_measured_by_twins(monkeypatch: pytest.MonkeyPatch) -> None:
    assert numerics(monkeypatch, 1e-3, 0.035) == {
        "time step": ("1e-07 s", pytest.approx(0.05)),
        "particle radius": ("0.001 m", pytest.approx(0.025)),
        "neither time step nor radius": ("difference from a twin with this time step", pytest.approx(0.01)),
    }
    assert numerics(monkeypatch, 1e-3, 0.01)["neither time step nor radius"][1] == 0.0
    plain = numerics(monkeypatch, None, 0.035)
    assert [*plain] == ["time step", "neither time step nor radius"]
    assert plain["neither time step nor radius"][1] == pytest.approx(0.035)
    # what the deck states otherwise than the scene is no unexplained rest
    stated = numerics(monkeypatch, None, 0.035, gravity=9.81)
    assert stated["neither time step nor radius nor what the deck states"][1] == pytest.approx(0.035)

    def fail(*arguments: Any, **fields: Any) -> None:
        raise DemBridgeError("no twin")

    monkeypatch.setattr(limits.Twins, "velocity", fail)
    for dt, time, expected in (
        (1e-7, (0.0, 1e-5), ("time step and radius", "no twin")),
        (None, (0.0, 1e-5), ("time step", "several, or none that can be read")),
        (1e-7, (1e-6, 1e-5), ("time step", "samples are not at even times from the start on")),
    ):
        run: Any = SimpleNamespace(dt=dt, deck=SimpleNamespace(radius=None, stated=lambda scene: {}))
        errors = file_of(REFERENCE, time)
        (row,) = limits._of_numerics(limits.Twins.of(PAIR, run, errors), run, errors)
        assert ((row.what, row.found), math.isnan(row.effect)) == (expected, True)


def test_twins_are_runs_of_the_samples_of_the_file_however_long_the_scene_is() -> None:
    time = np.linspace(0.0, 4e-5, 5)
    run: Any = SimpleNamespace(dt=1e-6, deck=None)
    values = np.zeros((5, 2))
    part = SimpleNamespace(error=values, columns=(0, 1), scale=1.0)
    errors: Any = SimpleNamespace(quantities={"velocity": part}, record=SimpleNamespace(time=time))
    short = replace(PAIR, duration=1e-5)
    for scene in (PAIR, short):
        plain = limits.Twins.of(scene, run, errors).plain
        assert plain.shape == (5, 2)
        # before the end of the contact both have moved, and momentum is kept
        assert np.ptp(plain[:, 0]) > 0.1
        np.testing.assert_allclose(plain.sum(axis=1), 1.0, rtol=1e-12)
    assert math.isnan(limits.Twins.of(PAIR, SimpleNamespace(dt=None), errors).effect({"gravity": 9.81}))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("line", "points"),
    [
        ("pair_style table spline 50", "50 points, spline"),
        ("pair_style hybrid granular table linear 20", "20 points, linear"),
        ("pair_style hybrid a table linear 20 b c", "20 points, linear"),
        ("pair_style a table b", None),
        ("pair_style granular", None),
        ("pair_coeff table spline 50", None),
    ],
)
def test_points_of_tables_are_read(line: str, points: str | None) -> None:
    rows = list(limits._of_contacts(run_of(user_deck(line))))
    assert [row.found for row in rows] == ([] if points is None else [points])
    assert all(math.isnan(row.effect) for row in rows)
    (newton,) = limits._of_contacts(run_of(user_deck("newton on off")))
    assert (newton.what, newton.found, newton.effect) == ("newton", "on off", 0.0)


def test_fields_that_differ_have_their_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    def twins(dt: float | None = 1e-6) -> limits.Twins:
        return limits.Twins.of(PAIR, run_of(user_deck(), dt=dt), file_of(REFERENCE))

    for length, shown in ((160, "x" * 160), (161, f"{'x' * 157}...")):
        (row,) = limits._of_scene(twins(), run_of(user_deck(problems=("x" * length,))))
        assert row.found == f"the deck cannot be read as a scene: {shown}"
        assert math.isnan(row.effect)
    (row,) = limits._of_scene(twins(), run_of(user_deck(problems=("a", "b"))))
    assert row.found.endswith("a scene: a; b")

    def velocity(self: limits.Twins, **changes: Any) -> Any:
        # the effects of both cancel
        wall, gravity = "wall_right" in changes, "gravity" in changes
        return np.array([[4.0, -1.0 - 0.5 * wall + 0.5 * gravity]])

    monkeypatch.setattr(limits.Twins, "velocity", velocity)
    other = SimpleNamespace(scene=replace(PAIR, wall_right=Wall(stiffness=1e9)))
    (row,) = limits._of_scene(twins(), run_of(user_deck(read=other)))
    assert (row.what, row.effect) == ("wall right", 0.125)
    (row,) = limits._of_scene(twins(None), run_of(user_deck(read=other)))
    assert math.isnan(row.effect)
    both = SimpleNamespace(scene=replace(other.scene, gravity=9.81))
    rows = {row.what: row.effect for row in limits._of_scene(twins(), run_of(user_deck(read=both)))}
    assert rows == {"wall right": 0.125, "gravity": 0.125, "all differences from the scene together": 0.0}

    def fail(*arguments: Any, **changes: Any) -> None:
        raise DemBridgeError("no twin")

    monkeypatch.setattr(limits.Twins, "velocity", fail)
    assert math.isnan(twins().effect({"gravity": 9.81}))


@pytest.mark.parametrize(
    ("lines", "changes", "largest", "risky"),
    [
        # two bodies at 3 m/s for 100 steps of 1 us: 0.6 mm
        (("neighbor 0.61e-3 bin", "neigh_modify delay 100 every 10"), {}, 3.0, False),
        (("neighbor 0.59e-3 bin", "neigh_modify delay 100 every 10"), {}, 3.0, True),
        (("neighbor 0.59e-3 bin", "neigh_modify every 100"), {}, 3.0, True),
        (("neighbor 0.59e-3 bin", "neigh_modify every v_n delay"), {}, 3.0, False),
        (("neighbor 0.59e-3 bin", "neigh_modify every 100"), {"dt": None}, 3.0, False),
        (("neighbor 1.0 bin", "neigh_modify every 1"), {"dt": 0.5}, 1.0, False),  # exactly the skin
        (("neighbor some bin", "neigh_modify every 9999999"), {}, 3.0, False),
        (("neigh_modify every 9999999",), {}, 3.0, False),
        (("neighbor 1e-3 bin",), {"dt": 1.0}, 3.0, False),
        (("neighbor 1e-3 bin",), {"dangerous": 1}, 3.0, True),
        (("neighbor 1e-3 bin", "neigh_modify exclude group"), {}, 3.0, True),
    ],
)
def test_skins_that_bodies_cross_unseen_are_risky(
    lines: tuple[str, ...], changes: dict[str, Any], largest: float, risky: bool
) -> None:
    (row,) = limits._of_neighbours(run_of(user_deck(*lines), **changes), largest)
    assert (row.what, math.isnan(row.effect)) == ("neighbour list", risky)
    assert risky or row.effect == 0.0
    names = (("neighbor ", "default skin"), ("neigh_modify", "default neigh_modify"))
    texts = [next((line for line in lines if line.startswith(name)), default) for name, default in names]
    assert row.found == f"{texts[0]}, {texts[1]}; dangerous builds: {changes.get('dangerous', 0)}"
    unknown = run_of(user_deck("neighbor 0.9e-3 bin", "neigh_modify every 200", units="unheard"))
    assert math.isnan(next(iter(limits._of_neighbours(unknown, 3.0))).effect)


@pytest.mark.parametrize(
    ("lines", "rows"),
    [
        ((), {"own dump": ("none", NAN)}),
        (("dump 1 all custom 10 f vx",), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f x",), {"columns of own dump 1": ("no velocities", NAN),
                                         "digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom",), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10",), {"columns of own dump 1": ("no velocities", NAN),
                                     "digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all atom 10 f",), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f.bin vx",), {}),
        (("dump 1 all custom 10 f.bin x",), {"columns of own dump 1": ("no velocities", NAN)}),
        (("dump 1 all custom 10 f.txt vx.bin vx",), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.15g"), {}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.14g"), {"digits of own dump 1": ("14", 5e-14)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 sort id format float %20.3e"), {}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %d"), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.17g", "dump_modify 1 format float %.9g"),
         {"digits of own dump 1": ("9", 5e-9)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 format float %.9g", "dump_modify 1 format float %.7g",
          "dump_modify 1 format float %.17g"), {}),
        (("dump 1 all custom 10 f vx", "dump_modify 2 format float %.17g"), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f vx", "dump_modify 1 sort %.17g"), {"digits of own dump 1": ("6", 5e-6)}),
        (("dump 1 all custom 10 f vx", "undump 1 format %.17g"), {"digits of own dump 1": ("6", 5e-6)}),
    ],
)  # fmt: skip
def test_what_the_own_dump_of_a_deck_loses_is_said(lines: tuple[str, ...], rows: dict[str, tuple[str, float]]) -> None:
    actual = {row.what: (row.found, row.effect) for row in limits._of_own_dump(user_deck(*lines))}
    assert actual.keys() == rows.keys()
    for name, (text, effect) in rows.items():
        assert actual[name] == (text, pytest.approx(effect, rel=1e-12, abs=0.0, nan_ok=True))


# ---------------------------------------------------------------- codes beside each other
def test_an_order_is_that_to_the_next_larger_step_of_the_same_code() -> None:
    def run(dt: float, error: float, code: str = "a") -> CodeRun:
        return CodeRun(code=code, dt=dt, error=error, wall=1.0, cpu=1.0)

    runs = [run(4.0, 99.0), run(2.0, 8.0), run(1.0, 1.0), run(1.5, 5.0, "b")]
    assert beside._order_to_next(runs, runs[2]) == pytest.approx(3.0)
    assert math.isnan(beside._order_to_next(runs, runs[0]))
    assert math.isnan(beside._order_to_next(runs, runs[3]))
    assert math.isnan(beside._order_to_next([run(2.0, 0.0), run(1.0, 1.0)], run(1.0, 1.0)))
    assert math.isnan(beside._order_to_next([run(2.0, 1.0), run(1.0, 0.0)], run(1.0, 0.0)))
    assert math.isnan(beside._order_to_next([run(2.0, 1.0), run(1.0, NAN)], run(1.0, NAN)))
    assert beside._order_to_next([run(2.0, 0.5), run(1.0, 0.25)], run(1.0, 0.25)) == pytest.approx(1.0)


def test_costs_are_drawn_where_errors_and_times_are_above_zero() -> None:
    runs = [
        CodeRun(code="mine", dt=2.0, error=0.5, wall=1.0, cpu=0.25),
        CodeRun(code="mine", dt=1.0, error=0.125, wall=1.0, cpu=0.0),
        CodeRun(code="our twin", dt=1.0, error=0.0, wall=1.0, cpu=1.0),
        CodeRun(code="LAMMPS", dt=1.0, error=0.75, wall=1.0, cpu=3.0),
    ]
    figure = beside._figure(runs, "velocity")
    lines = [[(line.label, line.style, line.x.tolist(), line.y.tolist()) for line in p.series] for p in figure.panels]
    lammps = ("LAMMPS", "curve/lammps-granular")
    assert lines == [
        [("mine", "line/1/0", [2.0, 1.0], [0.5, 0.125]), (*lammps, [1.0], [0.75])],
        [("mine", "line/1/0", [0.25], [0.5]), (*lammps, [3.0], [0.75])],
    ]


def errors_of(value: float, scale: float = 2.0) -> QuantityErrors:
    return QuantityErrors(
        quantity="velocity", scale=scale, error=np.array([[0.0, value]]), explained=np.zeros((1, 2)), columns=(0, 1),
        reference_uncertainty=0.0,
    )  # fmt: skip


def fake_judgement(*files: tuple[str, float, float]) -> Any:
    """Return a judgement of files by name, step and error."""
    parts = [
        SimpleNamespace(record=SimpleNamespace(name=name, dt=dt), quantities={"velocity": errors_of(error)})
        for name, dt, error in files
    ]
    return SimpleNamespace(files=parts, scene=PAIR, worst={"velocity": (parts[0], parts[0].quantities["velocity"])})


def test_errors_and_costs_of_a_foreign_code_stand_beside_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    judgement = fake_judgement(("fine", 1e-7, 2e-3), ("coarse", 2e-7, 8e-3))
    runs: Any = [SimpleNamespace(dt=2e-7, wall=1.0, cpu=0.5), SimpleNamespace(dt=1e-7, wall=2.0, cpu=1.5)]

    def own(scene: Scene, code: str, quantity: str, steps: list[float], limit: float) -> list[CodeRun]:
        assert (scene, quantity, steps, limit) == (PAIR, "velocity", [2e-7, 1e-7], 9.0)
        if code != "verlet":
            raise DemBridgeError("no LAMMPS")
        return [CodeRun(code="our twin", dt=dt, error=3e-3, wall=0.25, cpu=0.25) for dt in steps]

    monkeypatch.setattr(beside, "_own_runs", own)
    addition = beside._work_precision(judgement, "mine", runs, 9.0)
    assert addition.lines == (
        ("cost", "mine at dt = 100 ns: error 1.0e-03 in 1.5 s of CPU time; our twin 3.0e-03 in 0.25 s"),
    )
    assert addition.notes[1:] == ("LAMMPS did not run beside it: no LAMMPS",)
    (table,) = addition.tables
    expected = [("mine", 2e-7, 4e-3, NAN, 1.0, 0.5), ("mine", 1e-7, 1e-3, 2.0, 2.0, 1.5),
                ("our twin", 2e-7, 3e-3, NAN, 0.25, 0.25), ("our twin", 1e-7, 3e-3, 0.0, 0.25, 0.25)]  # fmt: skip
    for row, right in zip(table.rows, expected, strict=True):
        assert row[0] == right[0]
        assert row[1:] == pytest.approx(right[1:], nan_ok=True)
    assert [figure.id for figure in addition.figures] == ["work-precision"]


def test_our_codes_run_at_the_steps_of_the_foreign_one_the_first_one_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    cases = []

    class FakeCase:
        def __init__(self, **fields: Any) -> None:
            cases.append(fields)

        def solve(self, chosen: Any) -> Any:
            cost = SimpleNamespace(wall=float(len(cases)), cpu=2.0)
            return SimpleNamespace(velocity=np.array([[1.0, -3.0]]), cost=cost)

    code = SimpleNamespace(availability=lambda: SimpleNamespace(reason=""))
    reference = SimpleNamespace(values={"velocity": np.array([[1.5, -2.0]])}, largest={"velocity": 4.0})
    monkeypatch.setattr(beside, "Case", FakeCase)
    monkeypatch.setattr(beside, "backend", lambda name: code)
    monkeypatch.setattr(beside, "unsupported_reason", lambda chosen, scene: "")
    monkeypatch.setattr(beside, "reference_at", lambda scene, times: reference)
    runs = beside._own_runs(PAIR, "verlet", "velocity", [2e-7, 1e-7], 9.0)
    assert [(run.code, run.dt, run.error, run.wall, run.cpu) for run in runs] == [
        ("our twin", 2e-7, 0.25, 2.0, 2.0),
        ("our twin", 1e-7, 0.25, 3.0, 2.0),
    ]
    assert [fields["resolution"].dt for fields in cases] == [2e-7, 2e-7, 1e-7]
    assert {fields["resolution"].time_limit for fields in cases} == {9.0}
    assert {fields["uncertainty"] for fields in cases} == {False}
    reference.largest["velocity"] = 0.0
    assert math.isnan(beside._own_runs(PAIR, "verlet", "velocity", [1e-7], 9.0)[0].error)
    # what a code does not do, or where it is missing
    code.availability = lambda: SimpleNamespace(reason="no engine")
    with pytest.raises(DemBridgeError, match="no engine"):
        beside._own_runs(PAIR, "verlet", "velocity", [1e-7], 9.0)
    monkeypatch.setattr(beside, "unsupported_reason", lambda chosen, scene: "no glue")
    with pytest.raises(DemBridgeError, match="no glue"):
        beside._own_runs(PAIR, "verlet", "velocity", [1e-7], 9.0)


def test_limits_of_a_deck_are_a_line_and_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        Limit(what="time step", found="1 s", effect=2e-3, advice="a"),
        Limit(what="w", found="f", effect=NAN, advice="b"),
        Limit(what="newton", found="on", effect=0.0, advice="c"),
    ]
    names_of_files = []

    def deck_limits(scene: Scene, run: Any, file: Any) -> list[Limit]:
        names_of_files.append(file.record.name)
        return rows

    monkeypatch.setattr(beside, "deck_limits", deck_limits)
    run: Any = SimpleNamespace(deck=SimpleNamespace(path=Path("a/in.x")))
    addition = beside._limits(fake_judgement(("other", 1.0, 1.0), ("in.x", 1.0, 1.0)), run)
    assert (addition.lines, names_of_files) == ((("limits", "in.x: time step (1 s) 2.0e-03; w (f)"),), ["in.x"])
    (table,) = addition.tables
    assert (table.id, table.title, len(table.rows)) == ("limits-in-x", "What limits in.x", 3)


def nothing_of(name: str, dt: float) -> Record:
    return Record(name=name, time=np.zeros(2), values={}, columns={}, rounding={}, dt=dt)


def test_files_and_decks_are_judged_together_with_the_names_of_their_decks(monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def deck_run(path: Path, scene: Scene, **words: Any) -> Iterator[Any]:
        assert words == {"engine": None, "variables": None, "time_limit": 600.0}
        deck = SimpleNamespace(path=path, stated=lambda scene: {"gravity": 9.81})
        yield SimpleNamespace(out=Path("dump"), deck=deck, dt=1e-6)

    monkeypatch.setattr(beside, "deck_run", deck_run)
    monkeypatch.setattr(beside, "read_record", lambda path, scene, dt: nothing_of(str(path), dt))
    seen = []

    def judge(scene: Scene, records: list[Any], tolerance: float | None) -> Judgement:
        seen.append([(record.name, record.dt) for record in records])
        nothing: Any = ()
        none: Any = None
        return Judgement(scene=scene, files=nothing, convergence=(), diagnosis=none, tolerance=tolerance)

    monkeypatch.setattr(beside, "judge_records", judge)
    monkeypatch.setattr(beside, "_limits", lambda judgement, run: Addition(lines=((str(run.deck.path), "limits"),)))
    judgement = beside.judge_files(PAIR, [(Path("a.csv"), 2e-6)], [Path("b/in.x"), Path("in.y")], tolerance=0.5)
    assert seen == [[("a.csv", 2e-6), ("in.x", 1e-6), ("in.y", 1e-6)]]
    assert judgement.addition.lines == (("b/in.x", "limits"), ("in.y", "limits"))


# ---------------------------------------------------------------- commands and their output
@pytest.mark.parametrize(
    ("words", "name"),
    [(("/a/py", "/b/code.py"), "code.py"), (("/a/py", "-S", "/b/code.py"), "code.py"),
     (("/a/py", "-S", "-x", "/b/code.py"), "py"), (("/a/py",), "py")],
)  # fmt: skip
def test_a_code_has_the_name_of_its_script(words: tuple[str, ...], name: str) -> None:
    assert foreign.Command(words).name == name


def test_words_that_name_files_become_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "code").write_text("")
    (tmp_path / "sub").mkdir()
    (tmp_path / "-x").write_text("")
    (tmp_path / "{dt}").write_text("")
    for word in ("code", "./sub", "sub/"):
        assert foreign._absolute(word) == str(Path(word).absolute())
    for word in ("sub", "-x", "{dt}", "none", "no/ne", "a" * 5000, "a\0b"):
        assert foreign._absolute(word) == word


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", ""), ("\n \n", ""), ("one\ntwo \n\n", "two"), ("a\tb\x07c", "abc"),
        ("x" * 600, "x" * 500), ("a" * 30_000 + "\nlast", "last"), ("y" * 19_999 + "\nz\n", "z"),
    ],
)  # fmt: skip
def test_the_last_line_of_a_program_is_shown_with_500_signs(tmp_path: Path, text: str, line: str) -> None:
    path = tmp_path / "out"
    path.write_text(text)
    assert foreign._last_line(path) == line


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan, True, "1"])
def test_steps_and_limits_of_time_are_numbers_above_zero(value: Any) -> None:
    nothing: Any = None
    with (
        pytest.raises(UsageError, match=r"^dt = .*; allowed: a number above 0 \(s\)$"),
        foreign.foreign_runs(nothing, PAIR, (0.5, value)),
    ):
        pass
    with (
        pytest.raises(UsageError, match=r"^time_limit = "),
        foreign.foreign_runs(nothing, PAIR, (1,), time_limit=value),
    ):
        pass
    with (
        pytest.raises(UsageError, match=r"^dt = \[2, 2\]; allowed: one or more"),
        foreign.foreign_runs(nothing, PAIR, (2, 2)),
    ):
        pass


def test_steps_run_from_the_largest_on_with_their_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foreign, "_run", lambda command, scene, dt, folder, limit: (dt, folder.name, limit))
    code: Any = SimpleNamespace(name="code")
    said: list[str] = []
    with foreign.foreign_runs(code, PAIR, (0.25, 0.5), time_limit=3.0, progress=said.append) as runs:
        assert runs == ((0.5, "run-0", 3.0), (0.25, "run-1", 3.0))
    assert said == ["code at dt = 0.5 s", "code at dt = 0.25 s"]


def run_foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, code: int = 0, files: tuple[str, ...] = ("out",),
                error: str = "", text: str = "") -> Any:  # fmt: skip
    def run_program(words: list[str], work: Path, *, time_limit: float, stdout: Path, stderr: Path) -> Any:
        assert words == ["code", "0.5", str(work.parent / "out")]
        assert time_limit == 3.0
        stdout.write_text(text)
        stderr.write_text(error)
        for name in files:
            (work.parent / name).write_text("")
        return SimpleNamespace(code=code, how=f"with exit code {code}", wall=1.0, cpu=2.0)

    monkeypatch.setattr(foreign, "run_program", run_program)
    return foreign._run(foreign.Command(("code", "{dt}", "{out}")), PAIR, 0.5, tmp_path / "run", 3.0)


def test_the_output_of_a_run_may_have_an_ending(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, (files, out) in enumerate(
        ((("out",), "out"), (("out", "out.1"), "out"), (("out.csv",), "out.csv"), (("out.1", "out.2"), "out*"))
    ):
        folder = tmp_path / str(number)
        run = run_foreign(folder, monkeypatch, files=files)
        assert run.out == folder / "run" / out
        assert (run.name, run.dt, run.wall, run.cpu) == ("code at dt = 0.5 s", 0.5, 1.0, 2.0)
    with pytest.raises(RunBroken) as broken:
        run_foreign(tmp_path / "a", monkeypatch, files=(), text="hello")
    assert str(broken.value) == (
        "code at dt = 0.5 s ended without error but wrote no file {out}; the command must write its samples there (its"
        " last line was: hello)"
    )
    with pytest.raises(RunBroken, match=r"its samples there$"):
        run_foreign(tmp_path / "b", monkeypatch, files=())
    for code in (1, 2):
        with pytest.raises(RunBroken, match=f"^code at dt = 0.5 s ended with exit code {code}: bad$"):
            run_foreign(tmp_path / f"c{code}", monkeypatch, code=code, error="bad", text="fine")
    with pytest.raises(RunBroken, match=r"exit code 1 without a message$"):
        run_foreign(tmp_path / "d", monkeypatch, code=1)


@pytest.mark.parametrize(
    ("command", "problem"),
    [
        (["sh", "{out}", "{dt}", "{out.csv}"], "has 2 names of its output; allowed"),
        (["sh", "{out}"], r"has no {dt}; allowed"),
        (["sh", "{dt}"], r"has no {out}; allowed"),
        (["sh", "{dt}", "{x.out}", "{out}"], "the placeholder {x.out} is unknown"),
        (["none-such", "sh", "{dt}", "{out}"], "there is no program 'none-such' on PATH"),
    ],
)
def test_placeholders_of_a_command_are_checked(command: list[str], problem: str) -> None:
    with pytest.raises(UsageError) as refused:
        foreign.Command.of(command)
    assert problem in str(refused.value)


def test_default_steps_resolve_the_stiffest_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    # an interval of 20 us: 24.5 steps of 0.04 / omega, and four halvings
    for frequency, count in ((24.5 * 0.04 / 2e-5, 25), (1.0, 1)):
        monkeypatch.setattr(foreign, "prescan_hertz", lambda scene, f=frequency: SimpleNamespace(frequency=f))
        steps = [2e-5 / (count * factor) for factor in (1, 2, 4, 8)]
        assert foreign.default_steps(PAIR) == pytest.approx(steps)
    assert foreign.TIME_LIMIT == 600.0
