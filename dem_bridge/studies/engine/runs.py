"""LAMMPS' runs of many impacts: as many as possible in one process, with its message for each that it does not run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from dem_bridge.errors import BackendUnavailable, RunBroken
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import run_deck, workspace
from dem_bridge.runs.campaign import Jobs, Progress, map_in_threads
from dem_bridge.studies.engine.impacts import Impact, Steps, deck_of
from dem_bridge.studies.engine.motion import Motion

#: impacts of one process; after an error another process continues
BATCH = 60
_BATCH_FILE, _DONE = "in.batch", "done.txt"


@dataclass(frozen=True, kw_only=True, eq=False)
class EngineRun:
    """Hold the result of LAMMPS for one impact."""

    impact: Impact
    deck: str
    motion: Motion | None = None
    """None: the engine did not run it."""
    message: str = ""
    """Error message of the engine, if it did not run the impact."""


def run_impacts(
    impacts: Sequence[Impact],
    steps: Sequence[Steps],
    *,
    engine: Engine,
    jobs: Jobs = None,
    progress: Progress | None = None,
) -> list[EngineRun]:
    """Run impacts by LAMMPS, ``jobs`` processes at a time.

    Parameters
    ----------
    impacts : sequence of Impact
        What is run.
    steps : sequence of Steps
        Time steps of each.
    engine : Engine
        The LAMMPS.
    jobs : int, optional
        Number of processes at a time. Otherwise one for each core.
    progress : callable, optional
        Function that is called with (done, total, label).

    Raises
    ------
    BackendUnavailable
        If there is no engine.
    """
    pairs = list(zip(impacts, steps, strict=True))
    chunks = [pairs[at : at + BATCH] for at in range(0, len(pairs), BATCH)]
    ended: list[int] = []

    def run(chunk: Sequence[tuple[Impact, Steps]]) -> list[EngineRun]:
        results = list(_batch(chunk, engine))
        ended.append(len(results))
        if progress is not None:
            progress(sum(ended), len(pairs), f"{chunk[-1][0].style}")
        return results

    return list(chain.from_iterable(map_in_threads(run, chunks, jobs)))


def _batch(pairs: Sequence[tuple[Impact, Steps]], engine: Engine) -> Iterator[EngineRun]:
    """Yield the results of a part of the impacts; a process ends with the first error and another continues."""
    with workspace() as folder:
        rest = list(pairs)
        decks = {impact.name: deck_of(impact, steps) for impact, steps in rest}
        for name, deck in decks.items():
            (folder / f"in.{name}").write_text(deck, encoding="utf-8")
        while rest:
            lines = [
                f"include in.{impact.name}\nclear\nprint {impact.name} append {_DONE} screen no" for impact, _ in rest
            ]
            (folder / _BATCH_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")
            (folder / _DONE).write_text("", encoding="utf-8")
            error = ""
            try:
                run_deck(folder, _BATCH_FILE, time_limit=300.0, engine=engine)
            except (RunBroken, BackendUnavailable) as failure:
                error = str(failure)
            done = len((folder / _DONE).read_text(encoding="utf-8").split())
            for impact, _ in rest[:done]:
                yield EngineRun(impact=impact, deck=decks[impact.name], motion=_motion(folder, impact))
            if error and done < len(rest):
                impact = rest[done][0]
                yield EngineRun(impact=impact, deck=decks[impact.name], message=error)
                done += 1
            rest = rest[done:]


def _motion(folder: Path, impact: Impact) -> Motion:
    """Return the samples of a dump in the variables of the contact."""
    words = (folder / f"{impact.name}.dump").read_text(encoding="utf-8").split("ITEM: ATOMS id x vx")[1:]
    rows = np.array([[float(word) for word in part.split("ITEM:")[0].split()] for part in words])
    place, speed = (rows.reshape(len(words), -1, 3)[:, :, at] for at in (1, 2))
    if impact.flat:
        overlap, closing = impact.radius - place[:, 0], -speed[:, 0]
    else:
        overlap, closing = 2.0 * impact.radius - (place[:, 0] - place[:, 1]), speed[:, 1] - speed[:, 0]
    return Motion(overlap=overlap, closing=closing, speed=impact.contact.speed)
