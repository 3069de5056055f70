"""The public function that checks an input script or a scene: its law, its time step, and what to write."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.lmp.engine import Engine
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from dem_bridge.judging.check.answer import Check


def check(
    file: str | Path | Scene,
    *,
    accuracy: float = 1e-3,
    dt: float | None = None,
    variables: Mapping[str, str] | None = None,
    engine: Engine | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
    time_limit: float = 600.0,
    progress: Callable[[float, int, str], None] | None = None,
    announce: Callable[[float | None], None] | None = None,
) -> Check:
    """Check a LAMMPS input script, or the deck of a scene: is its law right, is its step right, and what to write.

    A copy of the script runs with one more dump. The law is right if LAMMPS differs from our code at the same step by
    round-off only. The step is right if velocities are within ``accuracy`` of the reference solution. What cannot be
    read as a scene is named with its line; the step is then judged by LAMMPS at finer steps alone.

    Parameters
    ----------
    file : str, Path or Scene
        LAMMPS input script, scene file (.toml), name of a shipped scene, or Scene.
    accuracy : float
        Permissible error of velocities, relative to the largest velocity of all bodies and samples.
    dt : float, optional
        Time step of the deck of a scene, s; the default is a fiftieth of the shortest contact time.
    variables : mapping of str to str, optional
        Values of variables of a script, as LAMMPS accepts them by ``-var``.
    engine : Engine, optional
        Which LAMMPS, in place of ``lmp``, ``lmp_args``, ``python`` and ``ranks``, which are as in :func:`solve`.
    time_limit : float
        Time limit of each run of LAMMPS, s.
    progress : callable, optional
        Callback with the part that is done, 1, and what runs.
    announce : callable, optional
        Callback with the expected time of the check in s, before it begins; None where it cannot be known.

    Returns
    -------
    Check
        A mapping with outcome ("PASS", "FAIL", "UNDECIDED" or "BROKEN"), law, step, engine, plausibility and advice,
        the lines to write. ``print`` shows them in eight lines; :meth:`save` writes a page.

    Raises
    ------
    SceneError
        If a file is neither an input script nor a scene.
    UsageError
        If a setting does not fit.
    BackendUnavailable
        If there is no LAMMPS or it lacks a style.

    Examples
    --------
    >>> import dem_bridge as db
    >>> pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> answer = db.check(pair, dt=4e-6)
    >>> answer.outcome, answer.law["outcome"], answer.step["outcome"]
    ('FAIL', 'PASS', 'FAIL')
    """
    check_arguments(check, locals())
    from dem_bridge.judging.check.checked import check_file

    return check_file(
        file,
        accuracy=accuracy,
        dt=dt,
        variables=variables,
        engine=Engine.named(engine, lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks),
        time_limit=time_limit,
        progress=progress,
        announce=announce,
    )
