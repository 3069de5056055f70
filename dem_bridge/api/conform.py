"""The public function that grades a code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments

if TYPE_CHECKING:
    from dem_bridge.judging.conformance.answer import Conformance


def conform(
    command: str | Sequence[str] | Callable[..., Any] | None = None,
    *,
    features: str | Sequence[str] = ("hertz",),
    scenes: int = 10,
    seed: int = 0,
    folder: str | Path | None = None,
    time_limit: float = 60.0,
    check: str | Path | None = None,
    progress: Callable[[float, int, str], None] | None = None,
) -> Conformance:
    """Grade a code on twelve frozen scenes, and on unseen ones that are drawn from a seed; LAMMPS is not needed.

    Each scene runs at three time steps. Its limit for a vanishing step is compared with the reference, so that a
    question about physics has the same answer for every method of integration; order, times, digits, momentum and
    energy follow from the files alone. A run that fails costs its scene only.

    Parameters
    ----------
    command : str, sequence of str or callable
        The code, such as "mycode {scene} {dt} {out.csv}", with the placeholders of :func:`judge`; or a function
        ``code(scene, dt, path)`` that writes the samples of a Scene at the time step dt (s) into the file ``path``.
    features : str or sequence of str
        What the code has: hertz, hooke, walls, gaps, gravity, precompression, several-moving, polydisperse, dashpot,
        mass_velocity, kuwabara-kono, tsuji, coeff_restitution. Scenes with anything else are not run.
    scenes : int
        Number of unseen scenes.
    seed : int
        Seed of the unseen scenes; the same seed and features give the same scenes.
    folder : str or Path, optional
        New folder for the files of the code and the grade, which ``check`` grades again.
    time_limit : float
        Time limit of each run, s. A function is not stopped.
    check : str or Path, optional
        Folder of an earlier grade whose files are graded again, in place of ``command``.
    progress : callable, optional
        Callback with the part that is done, the number of scenes, and what runs.

    Returns
    -------
    Conformance
        A mapping with schema, set, score, items, command, features, seed, scenes, runs, files and changed;
        ``answers`` has the items as objects. ``print`` shows the score card.

    Raises
    ------
    UsageError
        If a setting does not fit, the program does not exist, or stored files are not those that were recorded.

    Examples
    --------
    >>> import dem_bridge as db
    >>> def twin(scene, dt, path):
    ...     db.write_trajectory(db.solve(scene, backend="verlet", dt=dt, uncertainty=False), scene, path, layout="wide")
    >>> grade = db.conform(twin, scenes=1)
    >>> grade.score["failed"], [item.outcome.value for item in grade.answers if item.name in ("law", "order")]
    (0, ['PASS', 'PASS'])
    """
    check_arguments(conform, locals())
    from dem_bridge.judging.conformance.conform import conform_code, conform_stored

    if check is not None:
        if command is not None:
            raise UsageError("command and check were given; give one or the other")
        return conform_stored(Path(check))
    if command is None:
        raise UsageError("no code was given; give a command, a function, or check, the folder of an earlier grade")
    return conform_code(
        command,
        features=features,
        scenes=scenes,
        seed=seed,
        folder=None if folder is None else Path(folder),
        time_limit=time_limit,
        progress=progress,
    )
