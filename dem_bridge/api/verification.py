"""The public facade for verifications: run, judge, and write what was found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.api.guests import VERIFICATIONS, guest_named
from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import check_report_folder, write_whole
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.accuracy import checked_accuracy
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from dem_bridge.runs.campaign import Progress
    from dem_bridge.runs.store import Store
    from dem_bridge.verification.verification import Verification

#: the name of all shipped scenes together with the claims that are read from them
PAPER = "paper"


def verify(
    scenes: Scene | str | Path | Sequence[Scene | str | Path] | None = None,
    *,
    accuracy: float | None = None,
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
        Scenes, names of shipped scenes or paths of scene files. "paper" or None: all shipped scenes by every backend
        that supports them, with the claims and figures of the paper.
    accuracy : float, optional
        Tolerance of velocity errors, relative to the largest velocity; the time step follows from it. None: 5e-6.
    folder : str or Path, optional
        Folder for ``index.html`` and ``verdicts.json``. None: no files are written.
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
    from dem_bridge.runs.campaign import jobs_of
    from dem_bridge.runs.store import Store
    from dem_bridge.verification.verify import DEFAULT_ACCURACY, verify_scenes

    if scenes is None:
        scenes = [PAPER]
    elif isinstance(scenes, Scene | str | Path):
        scenes = [scenes]
    if len(scenes) == 0:
        raise UsageError(f"scenes = []; allowed: one or more scenes, or {PAPER!r} (or None) for the whole paper")
    whole = any(isinstance(s, str) and s == PAPER for s in scenes)
    if whole and len(scenes) > 1:
        raise UsageError(f"{PAPER!r} stands for all shipped scenes, and other scenes are named as well; give it alone")
    chosen = [] if whole else [scene_of(scene) for scene in scenes]
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
    if whole:
        verification: Verification = guest_named(VERIFICATIONS, PAPER, f"verify {PAPER}")(**settings)
    else:
        verification = verify_scenes(chosen, **settings)
    write_found(verification, folder=folder, bundle=bundle, engine=lammps, store=kept)
    return verification


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
