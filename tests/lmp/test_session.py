"""Many decks in one process of the engine: each as if it ran alone, and a failure ends with its own message."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.backends.lammps_motion import granular
from dem_bridge.errors import RunBroken
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.session import Session, session
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.dense import Schedule

pytestmark = pytest.mark.lammps
SCENE = Scene(name="three", duration=1e-4, mass=(1e-2,) * 3, stiffness=(4e9,) * 2, velocity=(1.0, 0.0, 0.0),
              gap=(1e-6, 0.0), wall_right=Wall(stiffness=4e9))  # fmt: skip
RADIUS, STEPS = 2.0**-15, 400
PLAN = Schedule(step=SCENE.duration / STEPS, per_sample=4, subdivisions=1, samples=100)


@pytest.fixture
def decks() -> Iterator[Session]:
    with session(Engine(), time_limit=60.0) as running:
        yield running


def _write(running: Session, name: str, *lines: str) -> str:
    (running.folder / name).write_text("\n".join(lines) + "\n")
    return name


def test_each_motion_is_that_of_a_run_alone_bit_for_bit() -> None:
    resolution = Resolution(dt=PLAN.step, surrogate_radius=RADIUS)
    alone = backend("lammps-granular").run(SCENE, resolution, Sampling(count=PLAN.samples))
    with granular(Engine()) as lammps:
        # the second has the state of the first behind it
        runs = [lammps.motion(SCENE, PLAN, SCENE.contacts, RADIUS) for _ in range(2)]
    for run in runs:
        assert run.velocity.tobytes() == alone.velocity.tobytes()
        assert run.displacement.tobytes() == alone.displacement.tobytes()
        np.testing.assert_allclose(run.time, alone.time, rtol=1e-15)


def test_decks_run_in_one_process_and_another_after_an_error(decks: Session) -> None:
    for deck in ("in.a", "in.b"):
        decks.run(_write(decks, deck, "shell 'echo $PPID >> parents'", "variable x index 1", "print ${x}"))
    first, second = (decks.folder / "parents").read_text().split()
    assert first == second
    with pytest.raises(RunBroken, match=r"LAMMPS: .*Unknown command: nonsense") as failure:
        decks.run(_write(decks, "in.c", "nonsense"))
    assert "nonsense" in failure.value.log
    decks.run(_write(decks, "in.d", "shell 'echo $PPID >> parents'"))
    assert (decks.folder / "parents").read_text().split()[-1] != first


def test_a_variable_of_one_deck_is_not_there_in_the_next(decks: Session) -> None:
    for value in ("1", "2"):
        decks.run(_write(decks, "in.x", f"variable x index {value}", "print ${x} file told screen no"))
        assert (decks.folder / "told").read_text().strip() == value


def test_a_process_that_dies_is_replaced(decks: Session) -> None:
    decks.run(_write(decks, "in.a", "print fine"))
    with pytest.raises(RunBroken, match="SIGKILL while running the deck"):
        decks.run(_write(decks, "in.dies", "shell 'kill -9 $PPID'"))
    decks.run(_write(decks, "in.b", "print fine file told screen no"))
    assert (decks.folder / "told").read_text().strip() == "fine"


def test_a_deck_that_hangs_is_stopped() -> None:
    with (
        session(Engine(), time_limit=1.0) as running,
        pytest.raises(RunBroken, match="did not finish within the time limit of 1 s"),
    ):
        running.run(_write(running, "in.hangs", "shell 'sleep 60'"))


def test_a_deck_with_other_gaps_is_that_of_the_scene_with_them() -> None:
    from dataclasses import replace

    wider = replace(SCENE, gap=(2e-6, 3e-6))
    with granular(Engine()) as lammps:
        texts = [
            {
                name: text.split("\n", 1)[1]
                for name, text in lammps.deck(scene, PLAN, wider.contacts, RADIUS).files.items()
            }
            for scene in (SCENE, wider)
        ]
    # but for the first line, which has the hash of the scene
    assert texts[0] == texts[1]
