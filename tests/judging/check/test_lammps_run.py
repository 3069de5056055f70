"""What a check reads of the dump of a run: parsed once, with a scene or without one, whatever the velocities are."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from dem_bridge.errors import RunBroken
from dem_bridge.formats.readers.dumps import Frames, read_dump
from dem_bridge.judging.check import lammps_run
from dem_bridge.judging.check.lammps_run import change_of_atoms, samples_of
from dem_bridge.scene.scene import Scene

PAIR = Scene(name="pair", duration=2e-6, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))


def dump(*frames: str) -> str:
    """Return the dump of frames, each with its rows of atoms: id type x y z vx vy vz."""
    parts = []
    for step, rows in enumerate(frames):
        count, units = len(rows.splitlines()), "" if step else "ITEM: UNITS\nsi\n"
        parts.append(
            f"{units}ITEM: TIME\n{step * 1e-6:.17g}\nITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{count}\n"
            "ITEM: BOX BOUNDS mm mm mm\n0 1\n0 1\n0 1\nITEM: ATOMS id type x y z vx vy vz\n" + rows + "\n"
        )
    return "".join(parts)


FIRST = "2 1 0.5 0 0 0 0 0\n1 1 0 0 0 0.8 0 0"
SECOND = "1 1 8e-7 0 0 0.7 0.5 0\n2 1 0.5 0 0 0.1 0 -0.25"


def test_velocities_are_sorted_by_ids_whatever_their_order_in_a_frame() -> None:
    alone = samples_of(dump(FIRST, SECOND), None, dt=1e-6, unit=2.0)
    assert alone.velocity.tolist() == [[0.8, 0, 0, 0, 0, 0], [0.7, 0.5, 0, 0.1, 0, -0.25]]
    assert (alone.time.tolist(), alone.bodies, alone.of_scene) == ([0.0, 2e-6], (0, 1), False)
    of_scene = samples_of(dump(FIRST, SECOND), PAIR, dt=1e-6, unit=1.0)
    assert of_scene.velocity.tolist() == [[0.8, 0.0], [0.7, 0.1]]
    assert (of_scene.time.tolist(), of_scene.bodies, of_scene.of_scene) == ([0.0, 1e-6], (0, 1), True)


@pytest.mark.parametrize("word", ["nan", "-nan", "inf", "-inf"])
def test_velocities_that_are_no_numbers_are_kept_and_no_record_of_the_scene_is_made(word: str) -> None:
    samples = samples_of(dump(FIRST, SECOND.replace("0.7", word)), PAIR, dt=1e-6, unit=1.0)
    assert not np.isfinite(samples.velocity[1, 0])
    assert np.isfinite(samples.velocity[1, 1:]).all()
    assert not samples.of_scene


@pytest.mark.parametrize("scene", [None, PAIR])
def test_a_number_of_atoms_that_changes_is_a_message(scene: Scene | None) -> None:
    with pytest.raises(RunBroken, match=r"atom 2 is removed between the times 0 and 1e-06$"):
        samples_of(dump(FIRST, SECOND.splitlines()[0]), scene, dt=1e-6, unit=1.0)


def test_an_atom_that_leaves_or_appears_is_named_with_face_and_time() -> None:
    fast = FIRST.replace("2 1 0.5 0 0 0 0 0", "2 1 0.5 0 0 0 -1e6 0")
    left = "atom 2 leaves the box through its face ylo = 0 between the times 0 and 1e-06, and the run goes on without"
    assert change_of_atoms(dump(fast, SECOND.splitlines()[0])).startswith(left)
    assert change_of_atoms(dump(FIRST.splitlines()[1], FIRST)) == "atom 2 appears between the times 0 and 1e-06"
    assert change_of_atoms(dump(FIRST, SECOND)) == ""


def test_a_dump_is_parsed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    parsed: list[int] = []

    def counted(texts: Iterable[str]) -> Frames:
        parsed.append(1)
        return read_dump(texts)

    monkeypatch.setattr(lammps_run, "read_dump", counted)
    samples_of(dump(FIRST, SECOND), PAIR, dt=1e-6, unit=1.0)
    assert parsed == [1]
