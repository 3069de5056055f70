"""Keep a whole study in the store, where its runs are too many, too large or too quick to be kept one by one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import PARTS, Study
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene


class Unfinished(Exception):
    """A study that is not kept, because it was interrupted or one of its runs broke: ``make`` may raise it."""

    def __init__(self, study: Study) -> None:
        self.study = study


def recall_study(
    name: str,
    store: Store | None,
    make: Callable[[], Study],
    scene: Scene | Sequence[Scene],
    engine: Engine | None = None,
    **settings: Any,
) -> Study:
    """Return ``make()``, from the store if the same code made the study before.

    Parameters
    ----------
    name : str
        Name of the study.
    store : Store or None
        None: the study is always made.
    make : callable
        Makes the study. One that was interrupted, or has a verdict BROKEN, is not kept.
    scene : Scene or sequence of Scene
    engine : Engine, optional
        The LAMMPS that the study runs, if any.
    **settings
        Everything else that the study depends on, as JSON.
    """

    def finished() -> tuple[Study, dict[str, str | bytes]]:
        study = make()
        if study.interrupted or any(verdict.outcome is Outcome.BROKEN for verdict in study.verdicts):
            raise Unfinished(study)
        return replace(study, files={}), {file: content() for file, content in study.files.items()}

    kinds, scenes = (Study, *PARTS), [scene] if isinstance(scene, Scene) else scene
    try:
        if store is None:
            return make()
        study, files = recall(
            store, f"study {name}", [], finished, kinds=kinds, scenes=scenes, engine=engine, **settings
        )
    except Unfinished as unfinished:
        return unfinished.study
    return replace(study, files={file: _constant(content) for file, content in files.items()})


def _constant(content: str | bytes) -> Callable[[], str | bytes]:
    return lambda: content
