"""A drive in a deck: LAMMPS' formula is the force of the drive, and nothing else of a deck changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.backends.lammps import LammpsGranular, Written
from dem_bridge.lmp.deck import Deck, vector_lines
from dem_bridge.lmp.variants import flat_walls, newton_off, with_restart
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.deck_reader import ReadDeck, read_deck
from tests.helpers.driven_chains import CHIRP, PRESSED, SINE, TABLE, TOUCHING, driven
from tests.helpers.strategies import examples

EPS = float(np.finfo(float).eps)
WALLED = replace(driven(TOUCHING, "table"), wall_left=Wall(stiffness=3e9), wall_right=Wall(stiffness=4e9))


def _deck(scene: Scene, dt: float = 1e-7) -> Deck:
    found = backend("lammps-granular")
    assert isinstance(found, LammpsGranular)
    return found.deck(scene, Resolution(dt=dt), Sampling(count=scene.samples))


def _read(deck: Deck, folder: Path) -> ReadDeck:
    for file, text in deck.files.items():
        (folder / file).write_text(text, encoding="utf-8")
    return read_deck(folder, deck.name)


@pytest.mark.parametrize(
    "drive",
    [
        SINE, replace(SINE, rise=0.0, phase=-30.0), CHIRP, replace(CHIRP, sweep=4e-4, rise=1e-4),
        replace(CHIRP, frequency=8000.0, last_frequency=1000.0, sweep=1e-3), TABLE,
    ],
)  # fmt: skip
def test_the_formula_of_a_deck_is_the_force_of_the_drive_on_body_0(drive: Drive, tmp_path: Path) -> None:
    for scene, atom in ((replace(TOUCHING, drive=drive), 1), (replace(WALLED, drive=drive), 2)):
        read = _read(deck := _deck(scene), tmp_path)
        assert set(read.drives) == {atom}
        steps = range(0, deck.schedule.steps + 1, 25)  # to the last step, where a table has no next value
        found = [read.drives[atom](step) for step in steps]
        # the same operations on the same numbers; libraries may round a sine or its square otherwise
        np.testing.assert_allclose(found, drive.at(np.array(steps) * read.dt), rtol=0.0, atol=4.0 * EPS * drive.peak)


@examples(50)
@given(
    values=st.lists(st.integers(-100, 100), min_size=2, max_size=9), share=st.floats(0.7, 1.0), dt=st.floats(1e-8, 1e-6)
)
def test_a_table_is_never_read_beyond_its_end(
    values: list[int], share: float, dt: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    drive = Drive(shape="table", force=tuple(values), interval=4e-4 / (len(values) - 1) / share)
    scene = replace(TOUCHING, drive=drive, samples=10)
    read = _read(deck := _deck(scene, dt), tmp_path_factory.mktemp("deck"))
    for step in (0, 1, deck.schedule.steps - 1, deck.schedule.steps):
        assert read.drives[1](step) == pytest.approx(float(drive.at(step * read.dt)), abs=4.0 * EPS * drive.peak)


def test_without_its_own_lines_a_driven_deck_is_that_of_the_chain_at_rest() -> None:
    # pressed harder by more than the drive changes overlaps, so that both have the same gauge radius
    for shape in ("sine", "chirp", "table"):
        scene = driven(PRESSED, shape)
        with_it, without = _deck(scene), _deck(replace(scene, drive=None))
        lines = with_it.files[with_it.input_file].splitlines()[1:]
        own = [line for line in lines if "drive" in line or "driven id" in line]
        # the formula, its parts where it has any, the group, and the fix
        assert len(own) == {"sine": 3, "chirp": 3, "table": 7}[shape]
        kept = [line for line in lines if line not in own and "dense " not in line]
        others = without.files[without.input_file].splitlines()[1:]
        assert kept == [line for line in others if "dense " not in line]
        assert set(with_it.files) - set(without.files) == ({f"drive.{scene.name}"} if shape == "table" else set())


def test_all_outer_forces_are_summed_each_at_its_largest() -> None:
    scene = replace(driven(PRESSED, "sine"), gravity=10.0)
    assert scene.summed_outer_force == pytest.approx(sum(np.abs(np.array(PRESSED.mass) * 10.0 + PRESSED.load)) + 2.0)


def test_the_file_of_a_table_has_short_lines_and_every_digit() -> None:
    values = tuple(float(f"1.{i:03d}4567890123e-3") for i in range(101))
    lines = list(vector_lines("drive_force", (*values, values[-1])))
    assert max(map(len, lines)) < 120
    text = "".join(line.removesuffix("&") for line in lines)
    found = [float(word) for word in text.removeprefix("variable drive_force vector [").removesuffix("]").split(",")]
    assert found == [*values, values[-1]]


@pytest.mark.lammps
@pytest.mark.parametrize("variant", ["newton off", "restart", "flat walls"])
def test_other_decks_are_driven_alike(variant: str) -> None:
    change = {"newton off": newton_off, "restart": with_restart, "flat walls": lambda d: flat_walls(d, WALLED)}[variant]
    code = LammpsGranular()
    deck = _deck(WALLED)
    plain, other = (code.run_written(WALLED, Written(deck=one), time_limit=60.0) for one in (deck, change(deck)))
    speed = float(np.max(np.abs(plain.velocity)))
    # a plane's force is that of a sphere to a few last digits of positions, which 4000 steps add up
    allowed = 1e-11 * speed if variant == "flat walls" else 0.0
    assert np.max(np.abs(plain.velocity - other.velocity)) <= allowed
    assert speed > 0.0


@pytest.mark.lammps
def test_a_table_of_a_hundred_thousand_values_runs() -> None:
    time = np.linspace(0.0, 4e-4, 100_001)
    scene = replace(
        TOUCHING,
        drive=Drive(shape="table", force=tuple(SINE.at(time).tolist()), interval=4e-9),
    )
    run = db.solve(scene, backend="lammps-granular", dt=1e-6, uncertainty=False)
    sine = db.solve(TOUCHING, backend="lammps-granular", dt=1e-6, uncertainty=False)
    # between values straight lines miss (omega h)^2 / 8 = 1e-9 of the force; the steps are values themselves
    assert np.max(np.abs(run.velocity - sine.velocity)) < 1e-9 * np.max(np.abs(sine.velocity))
