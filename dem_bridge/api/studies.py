"""The public functions for questions that take many runs: studies, and chains that differ in numbers only."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.api.guests import SCENES, guest_named, study_named
from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import check_report_folder
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.store import Store
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.file.load import measurement_of
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from dem_bridge.ensembles.result import Ensemble
    from dem_bridge.report.study import Study
    from dem_bridge.runs.campaign import Progress

#: parameters of studies that follow from the other arguments of :func:`study`
_NOT_SETTINGS = ("scene", "engine", "store", "progress", "measurement")


def study(
    name: str,
    scene: Scene | str | Path | None = None,
    *,
    folder: str | Path | None = None,
    jobs: int | None = None,
    executor: Executor | None = None,
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
        Name of the study, one of :data:`dem_bridge.api.guests.STUDIES`.
    scene : Scene, str or Path, optional
        Scene, name of a shipped scene or path of a scene file. Some studies have scenes of their own.
    folder : str or Path, optional
        Folder for the page (``index.html``), tables, figures and JSON. None: no files are written.
    jobs : int, optional
        Number of runs at a time. None: one for each core.
    executor : concurrent.futures.Executor, optional
        Where runs are made instead, such as ``dask.distributed.Client(...).get_executor()``. The results do not depend
        on it.
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
    ('scatter', 0, ['scatter', 'along-the-chain', 'tolerances'])
    """
    check_arguments(study, locals())
    from dem_bridge.runs.campaign import jobs_of

    function = study_named(name)
    parameters = inspect.signature(function).parameters
    if scene is None and "scene" in parameters and parameters["scene"].default is inspect.Parameter.empty:
        raise UsageError(f"study {name!r} needs a scene; allowed: the name of a shipped scene, a scene file or a Scene")
    if scene is not None and "scene" not in parameters:
        raise UsageError(f"study {name!r} has scenes of its own, and {scene!r} was given; leave the scene out")
    lammps = Engine.named(engine, lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks)
    options = dict(settings)
    where = jobs_of(jobs, executor)
    if executor is not None and "executor" in parameters:
        options["executor"] = executor
    if where is not None and ("jobs" in parameters or "executor" not in options):
        options["jobs"] = where
    if "engine" in parameters or lammps is not None:
        options["engine"] = lammps or Engine.chosen()
    if "store" in parameters or recompute:
        options["store"] = Store.opened(store, recompute=recompute)
    if unknown := [key for key in options if key not in parameters]:
        allowed = ", ".join(key for key in parameters if key not in _NOT_SETTINGS)
        raise UsageError(f"study {name!r} has no setting {unknown[0]!r}; allowed: {allowed or 'none'}")
    if folder is not None:
        check_report_folder(Path(folder))
    if "progress" in parameters:
        options["progress"] = progress
    if scene is not None:
        options["scene"] = scene_of(scene)
    if "measurement" in parameters:
        options.setdefault("measurement", measurement_of(scene))
    result: Study = function(**options)
    if folder is not None:
        from dem_bridge.report.page import write_study

        write_study(result, Path(folder), options.get("store"))
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
    """Return the scene without the physics that an accuracy does not require.

    Gravity, precompression, walls, damping, drag and gaps may be left out, and forces other than Hertz' may be replaced
    by those with n = 5/2 and the same force at the largest overlap. Nothing is added; masses, stiffnesses, start
    velocities and a drive stay. Each part that is left out must change the observables by at most ``accuracy`` alone,
    and all together must, relative to the full scene; a part whose effect is uncertain stays. The runs are those of the
    reference.

    Parameters
    ----------
    scene : Scene, str or Path
        Scene, name of a shipped scene or path of a scene file.
    accuracy : float
        Largest permissible relative change of the observables.
    observables : sequence of str, optional
        Names from :data:`dem_bridge.observables.registry.OBSERVABLES`. None: "arrival_at_end", "residence_time",
        "peak_velocity" and "first_peak_force" (in the window "whole": "peak_force").
    window : {"passage", "whole"}
        "passage" leaves out reflections from the end and the last two bodies, so that a wall behind a long chain is
        left out; chains of up to 7 bodies count until the scene ends. "whole" is all bodies, the largest forces and the
        whole duration.
    jobs, progress, store
        As in :func:`dem_bridge.verify`.

    Returns
    -------
    Scene
        The scene itself if nothing can be left out; otherwise one named ``NAME.least``, whose description lists what
        was.

    Raises
    ------
    UsageError
        For another setting.
    UnsupportedScene
        If no pulse travels through the chain.

    Examples
    --------
    >>> import dem_bridge as db
    >>> light = db.minimal("decelerating-40-on-base")
    >>> light.name, light.wall_right, light.description.split("; ")[1]
    ('decelerating-40-on-base.least', None, 'without the base, at 1 %')
    """
    check_arguments(minimal, locals())
    least_scene = guest_named(SCENES, "minimal", "dem_bridge.minimal")
    least: Scene = least_scene(
        scene_of(scene),
        accuracy=accuracy,
        observables=observables,
        window=window,
        jobs=jobs,
        progress=progress,
        store=Store.opened(store),
    )
    return least


def ensemble(
    scene: Scene | str | Path,
    vary: Mapping[str, float],
    n: int = 10_000,
    seed: int = 0,
    *,
    accuracy: float = 1e-4,
    samples: int | None = None,
    sampler: str = "random",
    checks: int = 4,
    executor: Executor | None = None,
    progress: Progress | None = None,
    store: bool | str | Path = True,
) -> Ensemble:
    """Solve many chains that differ from a scene in numbers only, drawn at random.

    The chains are solved side by side in compiled batches on all cores, by the order-4 method of "blanes-moan", with
    damping by the classical Runge-Kutta method, with corrected touches and the fewest steps for the accuracy. A seeded
    sample of them is also solved by the reference and by LAMMPS.

    Parameters
    ----------
    scene : Scene, str or Path
        Intended chain: a scene, the name of a shipped scene or the path of a scene file.
    vary : mapping
        What varies, each by normal deviates: "angle" (standard deviation of each angle between cylinders, degrees),
        "mass", "stiffness", "velocity" (relative standard deviations) and "gap" (standard deviation of what is added
        to each gap, m; only its magnitude counts).
    n : int
        Number of chains. The memory in use does not grow with it: large results are files in a temporary folder.
    seed : int
        Seed. The first chains of a larger ensemble with the same seed are the same.
    accuracy : float
        Accuracy of arrival, crossing and residence times, peak velocities and peak forces, each relative to its own
        value; with ``samples`` also of velocities, relative to the largest of the chain.
    samples : int, optional
        Number of equal intervals at whose ends the velocities of all chains are kept. None: none are kept.
    sampler : {"random", "sobol"}
        Independent draws, or the scrambled Sobol' sequence (Owen 1998, *J. Complexity* 14, 466).
    checks : int
        Number of chains that the reference and LAMMPS solve, too.
    executor : concurrent.futures.Executor, optional
        Where blocks of chains are solved. None: threads on all cores. The results do not depend on it.
    progress : callable, optional
        Function that is called with (done, total, label).
    store : bool, str or Path
        Where runs of the sample are kept, as in :func:`dem_bridge.verify`.

    Returns
    -------
    Ensemble
        ``table`` (a pandas frame, a row for each chain), ``long_table``, ``to_xarray()``, ``quantiles(observable)``
        and ``checked``, the agreement of the sample.

    Raises
    ------
    UsageError
        For a setting out of its range.
    UnsupportedScene
        For a scene with adhesion, a drive or a law of its own; for "angle" in a scene without angles.
    RunBroken
        If a velocity is not finite.

    References
    ----------
    Blanes & Moan (2002), *J. Comput. Appl. Math.* 142, 313.

    Examples
    --------
    >>> import dem_bridge as db
    >>> chains = db.ensemble("decelerating-40", vary={"angle": 0.5}, n=16, checks=0)
    >>> chains.table.shape, chains.quantiles("arrival_at_end").shape
    ((16, 163), (3,))
    """
    check_arguments(ensemble, locals())
    from dem_bridge.ensembles.draw import Variation
    from dem_bridge.ensembles.run import run_ensemble

    variation = Variation(scene=scene_of(scene), vary=dict(vary), seed=seed, sampler=sampler)
    return run_ensemble(
        variation,
        n,
        accuracy=accuracy,
        samples=samples,
        checks=checks,
        executor=executor,
        store=Store.opened(store),
        progress=progress,
    )
