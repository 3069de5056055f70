"""Decks and foreign codes without running them: what is read, copied, compared, measured and shown, in full."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import RunBroken, UsageError, one_line
from dem_bridge.formats.readers import Record
from dem_bridge.foundation import script_files
from dem_bridge.judging import beside, deck, foreign
from dem_bridge.judging.judgement import Addition, Judgement
from dem_bridge.judging.limits import Limit
from dem_bridge.judging.reference import QuantityErrors
from dem_bridge.judging.stated import differences
from dem_bridge.lmp.reader.script import Command
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.helpers.seams import Seam, plant

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
    assert not script_files.is_deck(tmp_path / "none")
    (tmp_path / "in.x").write_text("# a comment\n  units si\n")
    assert script_files.is_deck(tmp_path / "in.x")
    with pytest.raises(UsageError, match=r"none: the deck cannot be read \(No such file or directory\)"):
        deck.user_deck(tmp_path / "none", PAIR)


def test_a_deck_is_told_from_a_dump_and_from_binary_files(tmp_path: Path) -> None:
    script = "units si\natom_style sphere\npair_style granular\nrun 10\n"
    for text, is_deck in (
        (script, True),
        (f"ITEM: TIMESTEP\n{script}", False),
        (f"{script}\0", False),
        ("1,2\n", False),
    ):
        (tmp_path / "file").write_text(text)
        assert script_files.is_deck(tmp_path / "file") is is_deck


DAMPED = Damping(law="dashpot", coefficient=5.0)


@pytest.mark.parametrize(
    ("name", "ours", "theirs", "words"),
    [
        ("mass", (1.0, 1.0), (1.0, 1.0 + 1.5e-12), "1 at 1; the scene has 1"),
        ("mass", (1.0, 1.0), (1.0, 1.0 + 0.9e-12), ""),  # round-off
        ("mass", (1.0, 2.0), (1.0, 3.0), "3 at 1; the scene has 2"),
        ("mass", (1.0, 2.0), (1.5, 4.0), "4 at 1; the scene has 2"),  # the largest of two
        # a single number has no place; small ones differ relative to their size
        ("stiffness", (1e-6,), (1e-6 * (1.0 + 1e-7),), "1.0000001e-06; the scene has 1e-06"),
        ("stiffness", (1e-6 * (1.0 + 1e-7),), (1e-6,), "1e-06; the scene has 1.0000001e-06"),
        ("velocity", (0.0, 2.0), (0.0, 2.0 + 1e-12), ""),
        ("velocity", (0.0, 0.0), (0.0, 3.0), "3 at 1; the scene has 0"),  # one of them is all 0
        ("velocity", (0.0, 3.0), (0.0, 0.0), "0 at 1; the scene has 3"),
        ("gravity", 2.0, 0.0, "0; the scene has 2"),
        ("gravity", 0.0, 0.0, ""),
        ("wall_right", None, None, ""),
        (
            "wall_right",
            None,
            Wall(stiffness=4e9, gap=0.5),
            "stiffness 4000000000.0, gap 0.5, exponent 2.5; the scene has none",
        ),
        ("wall_right", Wall(stiffness=4.0), None, "none; the scene has stiffness 4.0, gap 0.0, exponent 2.5"),
        ("damping", None, DAMPED, "law dashpot, coefficient 5.0, clip True; the scene has none"),
    ],
)
def test_differences_of_scenes_are_by_field_to_twelve_digits(
    name: str, ours: object, theirs: object, words: str
) -> None:
    scenes = [replace(PAIR, **{name: value}) for value in (ours, theirs)]  # type: ignore[arg-type]
    assert differences(*scenes) == ({name: words} if words else {})


def test_scenes_of_other_numbers_of_bodies_differ_in_their_lengths() -> None:
    alone = Scene(name="a", duration=1e-3, mass=(1e-2,), stiffness=(), velocity=(1.0,), wall_right=Wall(stiffness=4e9))
    wall = replace(PAIR, wall_right=Wall(stiffness=4e9))
    assert differences(wall, alone) == {
        "mass": "1 numbers; the scene has 2",
        "stiffness": "0 numbers; the scene has 1",
        "exponent": "0 numbers; the scene has 1",
        "gap": "0 numbers; the scene has 1",
        "velocity": "1 numbers; the scene has 2",
    }
    assert differences(alone, alone) == {}


# ---------------------------------------------------------------- the added dump
def dump(*frames: str) -> str:
    heading = "ITEM: UNITS\nsi\nITEM: TIMESTEP\n{0}\nITEM: NUMBER OF ATOMS\n3\nITEM: ATOMS id type x y z vx vy vz\n{1}"
    return "".join(heading.format(number, frame) for number, frame in enumerate(frames))


#: a deck whose run is in a file that it includes
LINES = "units si\nread_data sub/data\ntimestep 1e-6\ninclude more\n"
MORE = "# more\nrun 10\nprint done"


def copied(
    home: Path, monkeypatch: pytest.MonkeyPatch, lines: str = LINES, *, log: str | None = None,
    written: str | None = dump("1 1 0 0 0 0 0 0\n"), mirrored: bool | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Run a deck that LAMMPS does not run and return what it was given, and the run; ``mirrored``: a scene was read."""
    (home / "sub").mkdir(parents=True, exist_ok=True)
    for name, text in (("in.x", lines), ("more", MORE), ("sub/data", "data")):
        (home / name).write_text(text)
    if mirrored is not None:
        read: Any = SimpleNamespace(scene=PAIR)
        user = replace(deck.user_deck(home / "in.x", PAIR), read=read, mirrored=mirrored)
        plant(monkeypatch, Seam.USER_DECK, lambda *words: user)
    engine: Any = SimpleNamespace(with_variables=lambda values: ("engine", values))
    seen: dict[str, Any] = {}

    def run(folder: Path, name: str, **words: Any) -> Any:
        parts = {str(path.relative_to(folder)): path for path in folder.rglob("*")}
        texts = {name: path.read_text() for name, path in parts.items() if path.is_file()}
        seen.update(words, name=name, texts=texts, folders={*parts} - {*texts}, beside={*folder.parent.iterdir()})
        if log is not None:
            (folder / "log.lammps").write_text(log)
        if written is not None:
            (folder / "dem_bridge.dump").write_text(written)
        return SimpleNamespace(wall=1.5, cpu=2.5, version=20250722)

    plant(monkeypatch, Seam.RUN_DECK, run)
    with deck.deck_run(home / "in.x", PAIR, engine=engine, time_limit=7.0, variables={"a": "1"}) as result:
        seen.update(run=result, dump=result.out.read_text(), out=result.out.name)
    assert not result.out.exists()
    return seen


def every_of(seen: dict[str, Any], file: str) -> int:
    """Return the steps between two frames of the added dump."""
    (line,) = (line for line in seen["texts"][file].splitlines() if "all custom" in line)
    return int(line.partition("all custom ")[2].split()[0])


@pytest.mark.parametrize(
    ("log", "dangerous"),
    [
        ("Loop time of 1 on 1 procs for 0 steps with 2 atoms\nLoop time of 1 on 1 procs for 9 steps with 2 atoms\n"
         "Dangerous builds = 2\nDangerous builds = 3\n", 5),
        ("", 0),
        (None, 0),
    ],
)  # fmt: skip
def test_a_copy_of_a_deck_runs_with_one_line_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log: str | None, dangerous: int
) -> None:
    seen = copied(tmp_path, monkeypatch, log=log)
    run = seen["run"]
    assert (run.wall, run.cpu, run.version, run.dt, run.dangerous) == (1.5, 2.5, 20250722, 1e-6, dangerous)
    assert (seen["name"], seen["time_limit"], seen["engine"]) == ("in.x", 7.0, ("engine", {"a": "1"}))
    texts = seen["texts"]
    assert (texts.keys(), texts["in.x"], texts["sub/data"]) == ({"in.x", "more", "sub/data"}, LINES, "data")
    # before the run, and once also in a loop; the deck itself is as it was
    assert texts["more"].splitlines() == [
        "# more",
        'if "$(is_defined(dump,dem_bridge)) == 0" then'
        ' "dump dem_bridge all custom 20 dem_bridge.dump id type x y z vx vy vz"'
        ' "dump_modify dem_bridge sort id units yes time yes format float %.17g"',
        "run 10",
        "print done",
    ]
    assert (tmp_path / "more").read_text() == MORE


@pytest.mark.parametrize(
    ("log", "written"),
    [
        ("Loop time of 1 on 1 procs for 0 steps with 2 atoms\n", dump("1 1 0 0 0 0 0 0\n")),
        ("Loop time of 1 on 1 procs for 9 steps with 2 atoms\n", None),
    ],
)
def test_a_deck_that_ran_no_step_is_broken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log: str, written: str | None
) -> None:
    with pytest.raises(RunBroken, match=r"in\.x: LAMMPS ended without an error, but it ran no step;"):
        copied(tmp_path, monkeypatch, log=log, written=written)


@pytest.mark.parametrize(
    ("lines", "every"),
    [
        ("timestep 1e-6\nrun 7777\n", 20),  # 1 ms / 50 samples = 20 us, whatever the deck runs
        ("timestep 1e-3\nrun 7777\n", 1),  # a step longer than a sample: every step
        ("timestep 1e-6\nrun 4000\ntimestep 2e-6\nrun 3777\n", 155),  # two steps: 50 frames of what the deck runs
        ("timestep 1e-6\nrun 4\ntimestep 2e-6\nrun 6\n", 1),
    ],
)
def test_frames_of_the_added_dump_are_those_of_the_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: str, every: int
) -> None:
    assert every_of(copied(tmp_path, monkeypatch, f"units si\n{lines}"), "in.x") == every


def test_what_a_deck_names_in_its_folder_is_copied_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, long, exact = tmp_path / "home", "a" * 200, "b" * 199
    (home / "out" / "deep").mkdir(parents=True)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    for name in ("data", long, exact, "out/table", "out/deep/table", "unnamed", "../beside"):
        (home / name).write_text("")
    words = f"data {home / 'data'} {long} {exact} out/deep/new no/deep/new missing out/table out ../beside"
    seen = copied(home, monkeypatch, f"units si\ntimestep 1e-6\nlog none.log\nprint {words}\nrun 10\n")
    assert seen["texts"].keys() == {"in.x", "data", exact, "out/table"}
    # a file that the deck may write has its folder
    assert seen["folders"] == {"out", "out/deep"}
    assert len(seen["beside"]) == 1


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("mirrored", [False, True])
def test_atoms_of_the_dump_are_sorted_along_the_chain_by_the_first_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, axis: int, mirrored: bool
) -> None:
    def row(number: int, kind: int, place: str, speed: str) -> str:
        places = ["0", "0", "0"]
        places[axis] = place
        return f"{number} {kind} {' '.join(places)} {speed} 1e3 0.5\n"

    written = dump(
        row(7, 1, "3.0", "-900") + row(5, 3, "-1.5", "2") + row(6, 2, "1.0", "0"),
        row(6, 2, "9.0", "0") + row(7, 1, "3.0", "-1") + row(5, 3, "-1.5", "2"),
    )

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
    assert copied(tmp_path, monkeypatch, written=written, mirrored=mirrored)["dump"] == dump(*frames)


def test_atoms_of_a_deck_that_is_no_scene_stay_in_their_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = dump("7 1 3.0 0 0 0 0 0\n5 1 1.0 0 0 0 0 0\n")
    assert copied(tmp_path, monkeypatch, written=written)["dump"] == written


def _read_from_an_end(text: str, reverse: bool, **words: Any) -> SimpleNamespace:
    return SimpleNamespace(scene=int(reverse), line=SimpleNamespace(sign=-1.0 if reverse else 1.0))


def test_a_deck_is_read_from_the_end_at_which_it_is_most_like_the_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "in.x"
    path.write_text("units si\nprint here\n")
    plain = deck.user_deck(path, PAIR)
    assert (plain.read, plain.mirrored, len(plain.problems)) == (None, False, 1)
    assert [command.text for command in plain.commands] == ["units si", "print here"]
    plant(monkeypatch, Seam.READ_DECK, _read_from_an_end)
    for counts, mirrored in (((2, 2), False), ((2, 1), True), ((1, 2), False)):
        plant(monkeypatch, Seam.DECK_DIFFERENCES, lambda scene, end, counts=counts: range(counts[end]))
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
    user = user_deck("units si", problems=problems)
    plant(monkeypatch, Seam.USER_DECK, lambda *words: user)
    engine: Any = SimpleNamespace(with_variables=lambda values: None)
    run_it = deck.deck_run(Path("in.x"), PAIR, engine=engine, time_limit=1.0)
    with pytest.raises(UsageError) as refused, run_it:
        pass
    assert str(refused.value) == message


# ---------------------------------------------------------------- codes beside each other
def errors_of(value: float, scale: float = 2.0) -> QuantityErrors:
    return QuantityErrors(
        quantity="velocity", scale=scale, error=np.array([[0.0, value]]), explained=np.zeros((1, 2)), columns=(0, 1),
        reference_uncertainty=0.0,
    )  # fmt: skip


def judgement_of(*files: tuple[str, float, float], tolerance: float | None = None) -> Judgement:
    """Return a judgement of files by name, step and error of 2 m/s."""
    parts: Any = [
        SimpleNamespace(record=SimpleNamespace(name=name, dt=dt), quantities={"velocity": errors_of(error)})
        for name, dt, error in files
    ]
    none: Any = None
    return Judgement(scene=PAIR, files=tuple(parts), convergence=(), diagnosis=none, tolerance=tolerance)


class Own:
    """Imitate our codes: their velocities and costs, and why they do not run."""

    def __init__(self) -> None:
        self.cases: list[Any] = []
        self.velocity = {"verlet": [1.0, -3.0], "lammps-granular": [1.5, -2.0]}
        self.cpu = {"verlet": 0.25, "lammps-granular": 3.0}
        self.missing = {"verlet": "", "lammps-granular": "no LAMMPS"}
        self.unsupported = {"verlet": "", "lammps-granular": ""}
        self.largest = 4.0

    def case(self, **fields: Any) -> Any:
        self.cases.append(fields)

        def solve(chosen: Any) -> Any:
            assert chosen.name == fields["backend"]
            half = 0.5 if fields["resolution"].dt == 2e-7 else 1.0
            cost = SimpleNamespace(wall=float(len(self.cases)), cpu=half * self.cpu[chosen.name])
            return SimpleNamespace(velocity=np.array([self.velocity[chosen.name]]), cost=cost)

        return SimpleNamespace(solve=solve)

    def backend(self, name: str) -> Any:
        return SimpleNamespace(name=name, availability=lambda: SimpleNamespace(reason=self.missing[name]))

    def reference(self, scene: Any, times: Any) -> Any:
        return SimpleNamespace(values={"velocity": np.array([[1.5, -2.0]])}, largest={"velocity": self.largest})


def beside_mine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *runs: tuple[float, float, float], own: Own | None = None
) -> Addition:
    """Return what stands beside a code "mine" with runs by step, relative error and CPU time; each takes 2 s."""
    plant(monkeypatch, Seam.FOREIGN_RUNS, given_runs(runs))
    plant(monkeypatch, Seam.READ_RECORD, lambda path, scene, dt: nothing_of("mine", dt))
    plant(monkeypatch, Seam.JUDGE_RECORDS, lambda scene, records, tolerance: judgement_of(
        *(("mine", dt, 2.0 * error) for dt, error, _ in runs)))  # fmt: skip
    if own is None:
        plant(monkeypatch, Seam.OWN_CODES, {})
    else:
        plant(monkeypatch, Seam.OWN_CASE, own.case)
        plant(monkeypatch, Seam.OWN_BACKEND, own.backend)
        plant(monkeypatch, Seam.OWN_UNSUPPORTED, lambda chosen, scene: own.unsupported[chosen.name])
        plant(monkeypatch, Seam.OWN_REFERENCE, own.reference)
    words = ["sh", str(tmp_path / "mine"), "{dt}", "{out}"]
    return beside.judge_command(PAIR, words, [dt for dt, *_ in runs], time_limit=9.0).addition


def given_runs(runs: Sequence[tuple[float, float, float]]) -> Any:
    @contextmanager
    def foreign_runs(command: Any, scene: Scene, steps: Any, *, time_limit: float) -> Iterator[Any]:
        assert (command.name, scene, time_limit) == ("mine", PAIR, 9.0)
        yield [SimpleNamespace(name="mine", dt=dt, out=Path("out"), wall=2.0, cpu=cpu) for dt, _, cpu in runs]

    return foreign_runs


def test_errors_and_costs_of_a_foreign_code_stand_beside_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = Own()
    addition = beside_mine(tmp_path, monkeypatch, (2e-7, 4e-3, 0.5), (1e-7, 1e-3, 1.5), own=own)
    assert addition.lines == (
        ("cost", "mine at dt = 100 ns: error 1.0e-03 in 1.5 s of CPU time; our twin 2.5e-01 in 0.25 s"),
    )
    assert addition.notes[1:] == ("LAMMPS did not run beside it: no LAMMPS",)
    (table,) = addition.tables
    # 1 m/s of 4 m/s; the first step runs twice, because it may compile, and the second time counts
    expected = [("mine", 2e-7, 4e-3, NAN, 2.0, 0.5), ("mine", 1e-7, 1e-3, 2.0, 2.0, 1.5),
                ("our twin", 2e-7, 0.25, NAN, 2.0, 0.125), ("our twin", 1e-7, 0.25, 0.0, 3.0, 0.25)]  # fmt: skip
    for row, right in zip(table.rows, expected, strict=True):
        assert row[0] == right[0]
        assert row[1:] == pytest.approx(right[1:], nan_ok=True)
    assert [figure.id for figure in addition.figures] == ["work-precision"]
    assert [fields["resolution"].dt for fields in own.cases] == [2e-7, 2e-7, 1e-7]
    assert {fields["resolution"].time_limit for fields in own.cases} == {9.0}
    assert {fields["uncertainty"] for fields in own.cases} == {False}


def test_what_our_codes_do_not_do_is_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = Own()
    own.unsupported, own.largest = {"verlet": "", "lammps-granular": "no glue"}, 0.0
    addition = beside_mine(tmp_path, monkeypatch, (1e-7, 1e-3, 1.5), own=own)
    assert addition.notes[1:] == ("LAMMPS did not run beside it: no glue",)
    # where nothing moves, any error is infinitely large
    assert [row[2] for row in addition.tables[0].rows] == [pytest.approx(1e-3), math.inf]


@pytest.mark.parametrize(
    ("runs", "orders"),
    [
        ([(4.0, 99.0), (2.0, 8.0), (1.0, 1.0)], [NAN, math.log2(99.0 / 8.0), 3.0]),
        ([(4.0, 0.5), (2.0, 0.25)], [NAN, 1.0]),
        ([(2.0, 0.0), (1.0, 1.0)], [NAN, NAN]),
        ([(2.0, 1.0), (1.0, 0.0)], [NAN, NAN]),
        ([(2.0, 1.0), (1.0, NAN)], [NAN, NAN]),
    ],
)
def test_an_order_is_that_to_the_next_larger_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runs: list[tuple[float, float]], orders: list[float]
) -> None:
    addition = beside_mine(tmp_path, monkeypatch, *((dt, error, 1.0) for dt, error in runs))
    assert [row[3] for row in addition.tables[0].rows] == pytest.approx(orders, nan_ok=True)


def test_costs_are_drawn_where_errors_and_times_are_above_zero(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = Own()
    own.velocity, own.missing = {"verlet": [1.5, -2.0], "lammps-granular": [1.5, -5.0]}, dict.fromkeys(own.missing, "")
    (figure,) = beside_mine(tmp_path, monkeypatch, (2.0, 0.5, 0.25), (1.0, 0.125, 0.0), own=own).figures
    lines = [[(line.label, line.style, line.x.tolist(), line.y.tolist()) for line in p.series] for p in figure.panels]
    lammps = ("LAMMPS", "curve/lammps-granular")
    # our twin is without an error, and the finer run of the other code without a cost
    assert lines == [
        [("mine", "line/1/0", [2.0, 1.0], [0.5, 0.125]), (*lammps, [2.0, 1.0], [0.75, 0.75])],
        [("mine", "line/1/0", [0.25], [0.5]), (*lammps, [3.0, 3.0], [0.75, 0.75])],
    ]


def nothing_of(name: str, dt: float) -> Record:
    return Record(name=name, time=np.zeros(2), values={}, columns={}, rounding={}, dt=dt)


def test_files_and_decks_are_judged_together_and_decks_have_their_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def deck_run(path: Path, scene: Scene, **words: Any) -> Iterator[Any]:
        assert words == {"engine": None, "variables": None, "time_limit": 600.0}
        deck = SimpleNamespace(path=path, stated=lambda scene: {"gravity": 9.81})
        yield SimpleNamespace(out=Path("dump"), deck=deck, dt=1e-6)

    seen = []

    def judge(scene: Scene, records: list[Any], tolerance: float | None) -> Judgement:
        seen.append([(record.name, record.dt, dict(record.stated)) for record in records])
        return judgement_of(*((record.name, record.dt, 1.0) for record in records), tolerance=tolerance)

    def deck_limits(scene: Scene, run: Any, file: Any) -> list[Limit]:
        assert file.record.name == run.deck.path.name
        rows = [("time step", "1 s", 2e-3), ("w", "f", NAN), ("newton", "on", 0.0)]
        return [Limit(what=what, found=found, effect=effect, advice="a") for what, found, effect in rows]

    plant(monkeypatch, Seam.DECK_RUN, deck_run)
    plant(monkeypatch, Seam.DECK_LIMITS, deck_limits)
    plant(monkeypatch, Seam.READ_RECORD, lambda path, scene, dt: nothing_of(str(path), dt))
    plant(monkeypatch, Seam.JUDGE_RECORDS, judge)
    judgement = beside.judge_decks(PAIR, [(Path("a.csv"), 2e-6)], [Path("b/in.x"), Path("in.y")], tolerance=0.5)
    stated = {"gravity": 9.81}
    assert seen == [[("a.csv", 2e-6, {}), ("in.x", 1e-6, stated), ("in.y", 1e-6, stated)]]
    assert judgement.tolerance == 0.5
    # what has no effect is in the table alone
    assert judgement.addition.lines == (
        ("limits", "in.x: time step (1 s) 0.2 %; w (f)"), ("limits", "in.y: time step (1 s) 0.2 %; w (f)"),
    )  # fmt: skip
    tables = judgement.addition.tables
    assert [(table.id, table.title) for table in tables] == [
        ("limits-in-x", "What limits in.x"), ("limits-in-y", "What limits in.y"),
    ]  # fmt: skip
    assert [row[0] for row in tables[0].rows] == ["time step", "w", "newton"]


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
    files = ("code", "./sub", "sub/")
    others = ("sub", "-x", "none", "no/ne", "a" * 5000, "a\0b", "{dt}", "{out}")
    words = foreign.Command.of(["sh", *files, *others]).words
    assert words[1:] == (*(str(Path(word).absolute()) for word in files), *others)


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


class Program:
    """Imitate the program of a code: what it prints, the files that it writes, and how it ends."""

    def __init__(self, files: Sequence[str] = ("out",), *, code: int = 0, error: str = "", text: str = "") -> None:
        self.files, self.code, self.error, self.text = files, code, error, text
        self.steps: list[float] = []

    def run(self, words: list[str], work: Path, *, time_limit: float, stdout: Path, stderr: Path) -> Any:
        assert (words[0], words[2], time_limit) == ("code", str(work.parent / "out"), 3.0)
        self.steps.append(float(words[1]))
        stdout.write_text(self.text)
        stderr.write_text(self.error)
        for name in self.files:
            (work.parent / name).write_text("")
        return SimpleNamespace(code=self.code, how=f"with exit code {self.code}", wall=1.0, cpu=2.0)

    def runs(self, monkeypatch: pytest.MonkeyPatch, *steps: float, said: list[str] | None = None) -> list[Any]:
        """Return the runs at these steps."""
        plant(monkeypatch, Seam.RUN_PROGRAM, self.run)
        command, say = foreign.Command(("code", "{dt}", "{out}")), None if said is None else said.append
        with foreign.foreign_runs(command, PAIR, steps, time_limit=3.0, progress=say) as runs:
            return [*runs]


def test_steps_run_from_the_largest_on_with_their_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    program, said = Program(), list[str]()
    runs = program.runs(monkeypatch, 0.25, 0.5, said=said)
    assert program.steps == [run.dt for run in runs] == [0.5, 0.25]
    assert [(run.name, run.wall, run.cpu) for run in runs] == [
        ("code at dt = 0.5 s", 1.0, 2.0), ("code at dt = 0.25 s", 1.0, 2.0),
    ]  # fmt: skip
    # each has a folder of its own
    assert len({run.out.parent for run in runs}) == 2
    assert said == ["code at dt = 0.5 s", "code at dt = 0.25 s"]


@pytest.mark.parametrize(
    ("files", "out"),
    [(("out",), "out"), (("out", "out.1"), "out"), (("out.csv",), "out.csv"), (("out.1", "out.2"), "out*")],
)
def test_the_output_of_a_run_may_have_an_ending(
    monkeypatch: pytest.MonkeyPatch, files: tuple[str, ...], out: str
) -> None:
    assert [run.out.name for run in Program(files).runs(monkeypatch, 0.5)] == [out]


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (Program((), text="hello"),
         "code at dt = 0.5 s ended without error but wrote no file {out}; the command must write its samples there (its"
         " last line was: hello)"),
        (Program(()), "code at dt = 0.5 s ended without error but wrote no file {out}; the command must write its"
         " samples there"),
        (Program(code=1, error="bad", text="fine"), "code at dt = 0.5 s ended with exit code 1: bad"),
        (Program(code=2, text="fine"), "code at dt = 0.5 s ended with exit code 2: fine"),
        (Program(code=1), "code at dt = 0.5 s ended with exit code 1 without a message"),
    ],
)  # fmt: skip
def test_a_failed_run_ends_with_what_it_said(monkeypatch: pytest.MonkeyPatch, program: Program, message: str) -> None:
    with pytest.raises(RunBroken) as broken:
        program.runs(monkeypatch, 0.5)
    assert str(broken.value) == message


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("\n \n", " without a message"), ("one\ntwo \n\n", ": two"), ("a\tb\x07c", ": abc"),
        ("y" * 450 + "z" * 150, f": {'y' * 450}{'z' * 50}"), ("a" * 30_000 + "\nlast", ": last"),
        ("y" * 19_999 + "\nz\n", ": z"),
    ],
)  # fmt: skip
def test_the_last_line_of_a_program_is_shown_with_500_signs(
    monkeypatch: pytest.MonkeyPatch, text: str, line: str
) -> None:
    with pytest.raises(RunBroken) as broken:
        Program(code=1, error=text).runs(monkeypatch, 0.5)
    # a message is shortened in its middle
    assert str(broken.value) == one_line(f"code at dt = 0.5 s ended with exit code 1{line}")


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
        plant(monkeypatch, Seam.PRESCAN, lambda scene, f=frequency: SimpleNamespace(frequency=f))
        steps = [2e-5 / (count * factor) for factor in (1, 2, 4, 8)]
        assert foreign.default_steps(PAIR) == pytest.approx(steps)
    assert foreign.TIME_LIMIT_S == 600.0
