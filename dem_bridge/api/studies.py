"""The public facade for questions that take many runs."""

from __future__ import annotations

import inspect
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
    engine: Engine | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
    **settings: Any,
) -> Study:
    """Answer a question that takes many runs, such as "stability" or "scatter".

    Parameters
    ----------
    name : str
        Name of the study, one of :data:`dem_bridge.studies.catalogue.STUDIES`.
    scene : Scene, str or Path, optional
        Scene, name of a shipped scene or path of a scene file. Some studies have scenes of their own.
    folder : str or Path, optional
        Folder for the page (``index.html``), tables, figures and JSON. None: no files are written.
    jobs : int, optional
        Number of runs at a time. None: one for each core.
    progress : callable, optional
        Function that is called with (done, total, label).
    store : bool, str or Path
        Where runs are kept, as in :func:`dem_bridge.verify`.
    recompute : bool
        Whether stored runs are repeated.
    engine, lmp, lmp_args, python, ranks : optional
        Which LAMMPS is used, as in :func:`dem_bridge.solve`.
    **settings
        Settings of the study, such as ``spread`` of "scatter". ``dem-bridge study NAME --help`` lists them.

    Returns
    -------
    Study
        Its ``answer`` (sentences), ``tables``, ``figures``, ``verdicts`` and ``exit_code``.

    Raises
    ------
    UsageError
        For an unknown study or setting, and for a setting that the study does not have.

    Examples
    --------
    >>> import dem_bridge as db
    >>> result = db.study("scatter", "decelerating-40", count=2, store=False)
    >>> result.id, result.exit_code, [table.id for table in result.tables]
    ('scatter', 0, ['scatter', 'along-the-chain'])
    """
    from dem_bridge.studies.catalogue import study_named

    function = study_named(name)
    parameters = inspect.signature(function).parameters
    if scene is None and "scene" in parameters and parameters["scene"].default is inspect.Parameter.empty:
        raise UsageError(f"study {name!r} needs a scene; allowed: the name of a shipped scene, a scene file or a Scene")
    if scene is not None and "scene" not in parameters:
        raise UsageError(f"study {name!r} has scenes of its own, and {scene!r} was given; leave the scene out")
    lammps = Engine.named(engine, lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks)
    given = dict(settings)
    if jobs is not None:
        given["jobs"] = jobs
    if "engine" in parameters or lammps is not None:
        given["engine"] = lammps or Engine.chosen()
    if "store" in parameters or recompute:
        given["store"] = Store.opened(store, recompute=recompute)
    if unknown := [key for key in given if key not in parameters]:
        allowed = ", ".join(key for key in parameters if key not in ("scene", "engine", "store", "progress"))
        raise UsageError(f"study {name!r} has no setting {unknown[0]!r}; allowed: {allowed or 'none'}")
    if folder is not None:
        check_folder(Path(folder))
    if "progress" in parameters:
        given["progress"] = progress
    if scene is not None:
        given["scene"] = scene_of(scene)
    result = function(**given)
    if folder is not None:
        from dem_bridge.report.page import write_study

        write_study(result, Path(folder), given.get("store"))
    return result


def minimal(
    scene: Scene | str | Path,
    accuracy: float = 0.01,
    *,
    observables: Sequence[str] | None = None,
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

    ``observables``: names from :data:`dem_bridge.observables.registry.OBSERVABLES`, whose largest relative changes must
    stay within ``accuracy``; None: "arrival_at_end", "residence_time", "peak_velocity" and "first_peak_force" (window
    "whole": "peak_force"). In ``window`` "passage" nothing that comes back from an end
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
