"""LAMMPS' motion of a scene on given steps, for searches of many short runs: without scene, peaks and provenance."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from dem_bridge.backends.lammps import checked_values, dense_of
from dem_bridge.backends.splitting import Motion
from dem_bridge.lmp.binary_dump import read_binary_dump
from dem_bridge.lmp.deck import DUMP_COLUMNS, Deck, deck_of
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.session import Session, session
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule


@dataclass(frozen=True)
class Granular:
    """Decks of ``pair_style granular`` in one process of the engine."""

    session: Session

    def deck(self, scene: Scene, plan: Schedule, contacts: Contacts, radius: float) -> Deck:
        """Return the deck of a scene on given steps; parameters as in :meth:`motion`."""
        return deck_of(scene, radius=radius, schedule=plan, contacts=contacts)

    def motion(self, scene: Scene, plan: Schedule, contacts: Contacts, radius: float) -> Motion:
        """Return the motion at the samples of a schedule, bit for bit that of a run of LAMMPS alone.

        Parameters
        ----------
        scene : Scene
            The scene; the duration is that of the schedule.
        plan : Schedule
            Time steps and samples.
        contacts : Contacts
            Those of the scene, or with other gaps.
        radius : float
            Radius of the bodies, m.

        Raises
        ------
        BackendUnavailable
            If there is no engine, or it lacks the style.
        RunBroken
            If the run fails, or its dump is not that of the deck.
        """
        deck, folder = self.deck(scene, plan, contacts, radius), self.session.folder
        for file, text in deck.files.items():
            (folder / file).write_text(text, encoding="utf-8")
        (folder / deck.dump_file).unlink(missing_ok=True)  # that of another run of the search
        self.session.run(deck.input_file)
        steps, values = read_binary_dump(folder / deck.dump_file, columns=len(DUMP_COLUMNS))
        checked_values(deck, steps, values)
        dense = dense_of(scene, deck, steps, values)
        keep = slice(None, None, plan.subdivisions)
        time = np.asarray(steps[keep] * plan.step, dtype=np.float64)
        return Motion(time, dense.displacement[keep, :-1], dense.velocity[keep, :-1])


@contextmanager
def granular(engine: Engine, *, time_limit: float = 3600.0) -> Iterator[Granular]:
    """Yield runs of ``pair_style granular`` by an engine; ``time_limit``: for each, s."""
    with session(engine, time_limit=time_limit) as decks:
        yield Granular(decks)
