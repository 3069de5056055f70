"""The public facade for questions that take many runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import UsageError
from dem_bridge.files import check_folder
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.scene_file import scene_of

if TYPE_CHECKING:
    from dem_bridge.campaign import Progress
    from dem_bridge.studies.study import Study


def study(
    name: str,
    scene: Scene | str | Path | None = None,
    *,
    folder: str | Path | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    store: bool | str | Path = True,
    recompute: bool = False,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
    **settings: Any,
) -> Study:
    """Ask one of the questions that take many runs, such as "stability" or "horizon".

    ``scene``: where the study is of one; some have one of their own, if none is named. ``folder``: where its page
    (``index.html``), tables, figures and JSON are written (None: nowhere). ``jobs``, ``progress``, ``store``,
    ``recompute`` and which LAMMPS as in :func:`dem_bridge.verify`. More settings are the study's own. The answer has
    ``answer`` (sentences), ``tables``, ``figures`` and ``exit_code``. Raises UsageError for an unknown study or
    setting, and what the study raises.
    """
    from dem_bridge.studies.catalogue import study_named, takes

    chosen = study_named(name)
    of_scene, needs_one, own = takes(chosen)
    if needs_one and scene is None:
        raise UsageError(f"study {name!r} is of a scene, and none is named; allowed: a shipped name, a file or a Scene")
    if not of_scene and scene is not None:
        raise UsageError(f"study {name!r} has scenes of its own, and {scene!r} is named; leave it out")
    unknown = [key for key in settings if key not in own]
    if unknown:
        raise UsageError(f"setting {unknown[0]!r} of study {name!r} is unknown; allowed: {', '.join(own) or 'none'}")
    if folder is not None:
        check_folder(Path(folder))
    given: dict[str, Any] = {
        "jobs": jobs,
        "progress": progress,
        "store": Store.opened(store, recompute=recompute),
        **settings,
    }
    given["engine"] = Engine.chosen(lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks)
    if scene is not None:
        given["scene"] = scene_of(scene)
    found = chosen(**given)
    if folder is not None:
        from dem_bridge.report.study import write_study

        write_study(found, Path(folder))
    return found


def minimal(
    scene: Scene | str | Path,
    accuracy: float = 0.01,
    *,
    observables: Sequence[str] = ("arrival", "residence", "peak_velocity", "peak_force"),
    window: str = "passage",
    jobs: int | None = None,
    progress: Progress | None = None,
    store: bool | str | Path = True,
) -> Scene:
    """The least scene that tells the same within ``accuracy``: without what the given one has and does not need.

    What may go: gravity, precompression, walls, damping, drag, gaps, and forces other than Hertz' (n = 5/2 with the
    same force at the largest overlap in their place); nothing is added, and masses, stiffnesses, start velocities and a
    drive stay.
    Each piece must stay within ``accuracy`` alone, and all that go must together, against the scene as given; where an
    error bar straddles the accuracy the piece stays. Runs are the reference's.

    ``observables``: relative changes of the "arrival" at the last body; of the "residence" time and the "peak_velocity"
    of the worst body and the "peak_force" of the worst contact, as the front passes them; and of the "velocity" of any
    body at any sample, until the front is at the end. In ``window`` "passage" nothing that comes back from an end
    counts, nor do the last two bodies, which feel what stands behind them, so that a wall behind a long chain is left
    out; in chains of up to 7 bodies all count, until the scene ends. With "whole" all bodies, the largest forces and
    the whole duration count. ``jobs``, ``progress`` and ``store`` as in :func:`dem_bridge.verify`.

    Answers with the scene itself where nothing can go; else with one named ``NAME.least``, whose description says what
    went. Raises UsageError for another setting, UnsupportedScene where no impulse runs through the chain.

    >>> import dem_bridge as db
    >>> light = db.minimal("decelerating-40-on-base")
    >>> light.name, light.wall_right, light.description.split("; ")[1]
    ('decelerating-40-on-base.least', None, 'without the base, at 1 %')
    """
    from dem_bridge.studies.model_hierarchy.models import least_scene

    scene = scene_of(scene)
    return least_scene(
        scene,
        accuracy=accuracy,
        observables=observables,
        window=window,
        jobs=jobs,
        progress=progress,
        store=Store.opened(store),
    )
