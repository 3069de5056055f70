"""Files of an integrator that shares nothing with the package: pairs of faults, a column with the other sign, walls."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.judging import search as search_module
from dem_bridge.judging.judgement import Judgement
from dem_bridge.judging.sentences import text_of

DT, EVERY = 1e-6, 4
MASS, STIFFNESS = (8e-3, 6e-3, 9e-3, 7e-3, 5e-3), (4e9, 6e9, 3e9, 5e9)


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of bodies between walls, of which the left one may be absent; the faults are further fields."""

    mass: tuple[float, ...] = MASS
    stiffness: tuple[float, ...] = STIFFNESS
    walls: tuple[float, float] = (0.0, 7e9)
    velocity: tuple[float, ...] = (0.6, 0.0, 0.0, 0.0, 0.0)
    end: float = 6e-4
    half: bool = False
    factor: float = 1.0
    power: float = 1.5
    flipped: tuple[int, ...] = ()
    start: float | None = None

    @property
    def scene(self) -> db.Scene:
        """The scene of the line without faults."""
        walls = {
            f"wall_{side}": db.Wall(stiffness=size)
            for side, size in zip(("left", "right"), self.walls, strict=True)
            if size > 0.0
        }
        fields: dict[str, Any] = {"mass": self.mass, "stiffness": self.stiffness, "velocity": self.velocity, **walls}
        return db.Scene(name="line", duration=self.end, **fields)

    def write(self, path: Path) -> tuple[Path, float]:
        """Write times and velocities by velocity Verlet, and return the file with its step."""
        mass, velocity = self.factor * np.array(self.mass), np.array(self.velocity)
        if self.start is not None:
            velocity[-1] = self.start
        constants = np.array([self.walls[0], *self.stiffness, self.walls[1]])
        place = np.zeros(len(mass))

        def acceleration(x: Any) -> Any:
            line = np.concatenate([[0.0], x, [0.0]])
            force = constants * np.maximum(line[:-1] - line[1:], 0.0) ** self.power
            return (force[:-1] - force[1:]) / mass

        rate, rows = acceleration(place), [(0.0, *velocity)]
        for step in range(1, round(self.end / DT) + 1):
            middle = velocity + 0.5 * DT * rate
            place = place + DT * middle
            rate = acceleration(place)
            velocity = middle + 0.5 * DT * rate
            if step % EVERY == 0:
                rows.append((step * DT, *(middle if self.half else velocity)))
        table = np.array(rows)
        table[:, [1 + body for body in self.flipped]] *= -1.0
        names = ",".join(["time", *(f"v{body}" for body in range(len(mass)))])
        np.savetxt(path, table, delimiter=",", header=names, comments="", fmt="%.17g")
        return path, DT


RIGHT = Line()
#: faults, and the causes that are named, each once
FAULTS: dict[str, tuple[Line, tuple[str, ...]]] = {
    "right": (RIGHT, ()),
    "half step and mass": (replace(RIGHT, half=True, factor=1.03), ("half-step-velocity", "stiffness-scale")),
    "exponent and mass": (replace(RIGHT, power=1.4, factor=1.03), ("exponent", "stiffness-scale")),
    "half step and exponent": (replace(RIGHT, half=True, power=1.4), ("exponent", "half-step-velocity")),
    "half step and no wall": (replace(RIGHT, half=True, walls=(0.0, 0.0)), ("half-step-velocity", "missed-contact")),
    "a column": (replace(RIGHT, flipped=(3,)), ("sign",)),
    "a column and mass": (replace(RIGHT, flipped=(2,), factor=1.03), ("sign", "stiffness-scale")),
    "half step and start": (replace(RIGHT, half=True, start=-0.2), ("half-step-velocity", "start-velocity")),
}


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the judgement of a line with faults, made once."""
    folder, known = tmp_path_factory.mktemp("held-out"), dict[str, Judgement]()

    def judge(name: str) -> Judgement:
        if name not in known:
            known[name] = db.judge(FAULTS[name][0].write(folder / f"{name}.csv"), RIGHT.scene)
        return known[name]

    return judge


@pytest.mark.parametrize("name", FAULTS)
def test_every_planted_fault_is_named(judged: Any, name: str) -> None:
    judgement = judged(name)
    assert sorted(fault["cause"] for fault in judgement.faults) == sorted(FAULTS[name][1])
    assert judgement.outcome == ("FAIL" if FAULTS[name][1] else "PASS")


def test_sentences_have_the_size_of_both_faults(judged: Any) -> None:
    text = " ".join(str(judged("exponent and mass")).split())
    assert "The exponent n is 2.4 +- " in text
    assert "in place of 2.5, and stiffness over mass is 0.970874 +- " in text
    both = " ".join(str(judged("half step and exponent")).split())
    assert "The exponent n is 2.4 +- " in both
    assert "stiffness over mass" not in both.split("alternatives")[0]


def test_the_wall_and_the_column_are_named(judged: Any) -> None:
    text = " ".join(str(judged("half step and no wall")).split())
    assert "The contact with wall_right never acts." in text
    assert "Is the wall in the code?" in text
    assert judged("a column").where == "body 3"
    assert "The velocities of body 3 have the other sign." in judged("a column").evidence


def test_the_first_divergence_is_where_the_fault_begins(judged: Any, tmp_path: Path) -> None:
    without = replace(RIGHT, walls=(0.0, 0.0))
    first = db.judge(without.write(tmp_path / "no-wall.csv"), RIGHT.scene)
    with_wall = np.loadtxt(RIGHT.write(tmp_path / "wall.csv")[0], delimiter=",", skiprows=1)
    no_wall = np.loadtxt(tmp_path / "no-wall.csv", delimiter=",", skiprows=1)
    row = int(np.flatnonzero(np.any(np.abs(with_wall - no_wall) > 1e-9 * 0.6, axis=1))[0])
    assert first.first_divergence == {"time": with_wall[row, 0], "body": 4, "quantity": "velocity"}
    # the error of the step is seen long before
    errors = first.judged[0].first_divergence(RIGHT.scene)
    assert errors is not None
    assert errors["time"] < 0.5 * with_wall[row, 0]
    assert "first error beyond time step and digits" in " ".join(text_of(first, every=True).split())
    assert judged("right").first_divergence is None


def test_a_right_file_is_told_the_error_of_its_step_first(judged: Any) -> None:
    judgement = judged("right")
    line = " ".join(str(judgement).split("next")[0].split())
    error, step = 100.0 * judgement.step["error"], judgement.step["largest_for"]["1e-3"]
    assert line.startswith(f"outcome PASS: the code is right; its step of 1 µs makes an error of {error:.2g} % of")
    assert line.endswith(f"({1e9 * step:.0f} ns gives 0.1 %).")
    assert "Nothing is to be mended" not in str(judgement)


def test_a_file_of_another_scene_is_asked_for_its_scene_without_a_search_for_pairs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    scene = db.Scene(
        name="long", duration=6e-4, mass=tuple(np.linspace(6e-3, 9e-3, 12)), stiffness=(4e9,) * 11,
        velocity=(0.8,) + (0.0,) * 11,
    )  # fmt: skip
    fits = []
    own = search_module.Search.fits

    def counted(search: search_module.Search) -> Any:
        fits.append(search)
        return own(search)

    monkeypatch.setattr(search_module.Search, "fits", counted)
    judgement = db.judge(replace(RIGHT, walls=(9e9, 7e9)).write(tmp_path / "other.csv"), scene)
    assert (judgement.outcome, judgement.exit_code) == ("UNDECIDED", 4)
    outcome = " ".join(str(judgement).split("next")[0].split())
    assert outcome.startswith("outcome UNDECIDED: Is it this scene, long? The file has 5 of its 12 bodies.")
    # once with the start velocities of the scene, and once with those of the first sample
    assert [search.foreign for search in fits] == [True, True]
