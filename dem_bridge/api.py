"""The public facade: solve a scene by name of backend, write its deck, ask what is available."""

from __future__ import annotations

import shutil
from dataclasses import fields, replace
from pathlib import Path

from dem_bridge.backends.base import BACKENDS, Availability, Backend, Resolution, Sampling, backend
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.scene import Scene
from dem_bridge.scene_file import load_scene
from dem_bridge.trajectory import Trajectory

_RESOLUTION = tuple(field.name for field in fields(Resolution))
#: settings of solve that are no field of a Resolution
_OTHER = ("samples", "accuracy")
#: fixed-step runs longer than this are not chosen by accuracy
MOST_STEPS = 50_000_000


def solve(scene: Scene | str | Path, *, backend: str, **settings: object) -> Trajectory:
    """Solve a scene (or a shipped name, or the path of a scene file) with one backend.

    Settings: ``dt`` (s, an upper bound: the step is interval/ceil(interval/dt)), or ``accuracy`` (of velocity, relative
    to its largest magnitude) instead; ``samples``; ``rtol``; ``gauge_radius`` (m); ``time_limit`` (s); ``bars=False``
    for no error bars. Raises UsageError for an unknown backend or setting, UnsupportedScene, BackendUnavailable
    or RunBroken.

    >>> import dem_bridge as db
    >>> run = db.solve("accelerating-40", backend="verlet", dt=1e-7)
    >>> run.velocity.shape, f"{1e3 * run.crossing_time[-1]:.2f} ms", run.uncertainty["velocity"] < 4e-4
    ((501, 41), '0.55 ms', True)
    """
    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    chosen, resolution, sampling, accuracy = _settings(scene, backend, settings)
    reason = chosen.refusal(scene)
    if reason:
        raise UnsupportedScene(f"{chosen.name} cannot do {scene.name}: {reason}")
    if accuracy is not None and chosen.order is not None:
        resolution = resolution_for(scene, accuracy, resolution, sampling)
    run = chosen.run(scene, resolution, sampling)
    if accuracy is not None:
        _check_accuracy(chosen, scene, run, accuracy)
    return run


def write_deck(
    scene: Scene | str | Path, folder: str | Path, *, style: str = "granular", **settings: object
) -> tuple[Path, ...]:
    """Write the LAMMPS deck of a scene into ``folder`` (made if need be) and return the files; it runs by
    ``lmp -in in.NAME`` there. ``dt``, ``samples`` and ``gauge_radius`` as in :func:`solve`. All files appear or none.
    """
    from dem_bridge.backends.lammps import LammpsGranular

    if style != "granular":
        raise UsageError(f"style = {style!r}; allowed: granular")
    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    _, resolution, sampling, accuracy = _settings(scene, "lammps-granular", settings)
    if accuracy is not None:
        resolution = resolution_for(scene, accuracy, resolution, sampling)
    deck = LammpsGranular().deck(scene, resolution, sampling)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(folder).free
    if free < 2 * sum(len(text) for text in deck.files.values()):
        raise UsageError(f"{folder}: {free} bytes free are too few for the deck; give another folder")
    for name, text in deck.files.items():
        (folder / f"{name}.part").write_text(text)
    for name in deck.files:
        (folder / f"{name}.part").replace(folder / name)
    return tuple(folder / name for name in deck.files)


def available() -> dict[str, Availability]:
    """Every backend's name with whether it can run here and, if not, why and what to do."""
    return {name: backend(name).availability() for name in BACKENDS}


def resolution_for(scene: Scene, accuracy: float, resolution: Resolution, sampling: Sampling) -> Resolution:
    """``resolution`` with the largest step of the 1-2-5 series whose velocity bar, by twins, is within ``accuracy``.

    Raises UsageError where that would take more than 5e7 steps.
    """
    from dem_bridge.backends.survey import survey
    from dem_bridge.backends.verlet import Verlet, default_step, round_step

    accuracy = _checked_accuracy(accuracy)
    dt = 10.0 * default_step(scene, sampling, survey(scene))
    while scene.duration / dt <= MOST_STEPS:
        run = Verlet().run(scene, replace(resolution, dt=dt, bars=True), sampling)
        scale = float(abs(run.velocity).max())
        bar = run.uncertainty["velocity"] / scale if scale > 0.0 else 0.0
        if bar <= accuracy:
            return replace(resolution, dt=dt)
        # second order: the bar goes as dt^2
        dt = round_step(dt * min(0.7, (accuracy / bar) ** 0.5))
    raise UsageError(
        f"accuracy = {accuracy:g} on {scene.name} needs a step below {dt:.2g} s, more than {MOST_STEPS:.0e} steps;"
        " ask for less, or take backend='scipy'"
    )


def _settings(
    scene: Scene, name: str, settings: dict[str, object]
) -> tuple[Backend, Resolution, Sampling, float | None]:
    chosen = backend(name)
    unknown = [key for key in settings if key not in (*_RESOLUTION, *_OTHER)]
    if unknown:
        raise UsageError(f"setting {unknown[0]!r} is unknown; allowed: {', '.join((*_RESOLUTION, *_OTHER))}")
    accuracy = settings.get("accuracy")
    if accuracy is not None:
        accuracy = _checked_accuracy(accuracy)
        if settings.get("dt") is not None:
            raise UsageError("dt and accuracy are both given; give one: the other follows from it")
    samples = settings.get("samples")
    sampling = Sampling(count=scene.samples if samples is None else samples)  # type: ignore[arg-type]
    resolution = Resolution(**{key: settings[key] for key in _RESOLUTION if key in settings})  # type: ignore[arg-type]
    return chosen, resolution, sampling, accuracy


def _checked_accuracy(accuracy: object) -> float:
    if isinstance(accuracy, bool) or not isinstance(accuracy, int | float) or not 0.0 < accuracy < 1.0:
        raise UsageError(f"accuracy = {accuracy!r}; allowed: a number between 0 and 1, as 1e-6")
    return float(accuracy)


def _check_accuracy(chosen: Backend, scene: Scene, run: Trajectory, accuracy: float) -> None:
    """A run whose own bar is above what was asked is refused with its floor, not handed out."""
    bar, scale = run.uncertainty["velocity"], float(abs(run.velocity).max())
    if bar > accuracy * scale:
        floor = bar / scale if scale > 0.0 else float("inf")
        raise UsageError(
            f"accuracy = {accuracy:g} cannot be promised by {chosen.name} on {scene.name}: its bar is {floor:.2g};"
            " ask for less, or take another backend"
        )
