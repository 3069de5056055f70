"""The public facade: solve a scene by name of backend, verify scenes, write a deck, ask what is available."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.accuracy import checked_accuracy
from dem_bridge.backends.base import (
    BACKENDS,
    ENGINE_BACKENDS,
    Availability,
    Backend,
    Resolution,
    Sampling,
    backend,
    unsupported_reason,
)
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.files import check_folder, write_whole
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.case import Case
from dem_bridge.scene import Scene
from dem_bridge.scene_file import scene_of
from dem_bridge.trajectory import Trajectory
from dem_bridge.uncertainty.estimate import solve as solve_case

if TYPE_CHECKING:
    from dem_bridge.campaign import Progress
    from dem_bridge.planning.answer import Plan
    from dem_bridge.runs.store import Store
    from dem_bridge.studies.verify import Verification

_RESOLUTION = tuple(field.name for field in fields(Resolution) if field.name != "bars")
#: settings of solve that are no field of a Resolution
_OTHER = ("samples", "accuracy", "order", "uncertainty")
#: what verify calls all shipped scenes and the claims that are read from them
PAPER = "paper"
#: settings that say which LAMMPS
_ENGINE = ("lmp", "lmp_args", "python", "ranks")


def solve(scene: Scene | str | Path, *, backend: str | None = None, **settings: object) -> Trajectory:
    """Solve a scene (or a shipped name, or the path of a scene file) with one backend; None, where ``accuracy`` is
    given: with the one that :func:`plan` finds the cheapest.

    Settings: ``dt`` (s, an upper bound: the step is interval/ceil(interval/dt)), or ``accuracy`` (of velocity, relative
    to its largest magnitude) instead; ``samples``; ``rtol`` (scipy, ode45) and ``atol`` (ode45; m and m/s);
    ``order="richardson"`` to extrapolate from 2 dt, dt and dt/2 (NotAsymptotic where their order is not clean);
    ``surrogate_radius`` (m), or ``geometry`` ("surrogate", "physical"), and ``types`` ("euler", "per-body") of a deck;
    ``table_style`` ("spline", "linear"), ``table_lines`` and ``table_points`` of its tables; ``time_limit`` (s);
    ``uncertainty=False`` for a run without the further runs that its uncertainty takes. Which LAMMPS: ``lmp`` (a
    binary; the variable ``DEM_BRIDGE_LMP`` names one too) or ``python`` (an interpreter with the ``lammps`` module),
    ``lmp_args`` ("-sf omp") and ``ranks`` (of MPI); None: the module of this environment, on one. Raises UsageError for
    an unknown backend or setting, UnsupportedScene, BackendUnavailable or RunBroken.

    >>> import dem_bridge as db
    >>> run = db.solve("accelerating-40", backend="verlet", dt=1e-7)
    >>> run.velocity.shape, f"{1e3 * run.crossing_time[-1]:.2f} ms", run.uncertainty["velocity"] < 4e-4
    ((501, 41), '0.55 ms', True)
    """
    scene = scene_of(scene)
    if backend is None:
        backend = _planned(scene, settings)
    chosen, resolution, sampling, accuracy = _settings(scene, backend, settings)
    reason = unsupported_reason(chosen, scene)
    if reason:
        raise UnsupportedScene(f"{chosen.name} cannot do {scene.name}: {reason}")
    if accuracy is not None and chosen.order is not None:
        from dem_bridge.planning.bars import resolution_for  # brings the compiler, which not every backend needs

        tables = resolution.tables or chosen.name == "lammps-table"
        own = chosen if chosen.name not in (*ENGINE_BACKENDS, "ase") else None
        resolution = resolution_for(scene, accuracy, replace(resolution, tables=tables), sampling, own)
    uncertainty = bool(settings.get("uncertainty", True))
    if settings.get("order") is None:
        case = Case(scene=scene, backend=backend, resolution=resolution, sampling=sampling, uncertainty=uncertainty)
        run = solve_case(case, chosen)
    else:
        from dem_bridge.extrapolate import extrapolated

        run = extrapolated(chosen, scene, resolution, sampling, uncertainty=uncertainty)
    if accuracy is not None:
        _check_accuracy(chosen, scene, run, accuracy)
    return run


def plan(
    scene: Scene | str | Path,
    accuracy: float,
    backend: str | None = None,
    *,
    observable: str = "velocity",
    budget: float | None = None,
    predict_only: bool = False,
    samples: int | None = None,
    progress: Progress | None = None,
) -> Plan:
    """The cheapest settings with which a scene is solved to ``accuracy``, and why each number is what it is.

    ``accuracy``: relative, the largest error of the ``observable`` over all samples, bodies or contacts. It is one of
    :data:`dem_bridge.observables.registry.OBSERVABLES`, such as "velocity" (relative to the largest), "peak_force" (of
    each contact, relative to its own) or "arrival_at_end", which has its definition and scale. ``backend``: None for
    the cheapest of those in the house; with LAMMPS named, LAMMPS' settings. A model predicts the settings from a coarse
    run, and runs at two and more resolutions check and correct them, unless ``predict_only``. ``budget``: s of CPU that
    the run may take. ``samples``: None for the scene's. ``progress`` is called with (done, total, label).

    Raises UsageError where the accuracy cannot be had, with the floor, or not within the budget, with the accuracy that
    it buys; UnsupportedScene where the backend cannot do the scene.

    >>> import dem_bridge as db
    >>> found = db.plan("accelerating-40", 1e-3, backend="verlet")
    >>> run = db.solve("accelerating-40", backend=found.backend, **found.resolution)
    >>> 5e-4 < found.found_error < 1e-3, found.units["dt"] <= found.resolution["dt"]
    (True, True)
    """
    from dem_bridge.planning.planner import plan_for

    scene = scene_of(scene)
    return plan_for(
        scene,
        accuracy,
        name=backend,
        observable=observable,
        sampling=None if samples is None else Sampling(count=samples),
        budget=budget,
        predict_only=predict_only,
        progress=progress,
    )


def verify(
    scenes: Scene | str | Path | Sequence[Scene | str | Path] | None = None,
    *,
    accuracy: float | None = None,
    folder: str | Path | None = None,
    bundle: str | Path | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
    store: bool | str | Path = True,
    recompute: bool = False,
) -> Verification:
    """Verify scenes through LAMMPS, its twin, the reference and binary collisions; "paper" (or None): the whole paper,
    all shipped scenes through every backend that fits, its claims and its figures.

    ``accuracy``: wanted of velocities, relative to the largest (None: 5e-6); the time step follows from it. ``folder``:
    where ``index.html`` and ``verdicts.json`` are written (None: nowhere). ``bundle``: where all that a reviewer needs
    to run it again is written (None: nowhere). ``jobs``: runs at a time (None: as many as there are cores).
    ``progress`` is called with (done, total, label). ``lmp``, ``lmp_args``, ``python``, ``ranks``: which LAMMPS, as in
    :func:`solve`. ``store``: where runs are kept, so that none is made twice: True for the user's cache, or the folder
    that ``DEM_BRIDGE_STORE`` names (nowhere where that is empty); a folder; or False. ``recompute``: make all runs
    anew, and keep them. The answer has ``verdicts``, ``exit_code`` and ``notes``. Raises SceneError or UsageError; a
    run that breaks is a BROKEN verdict.
    """
    from dem_bridge.runs.store import Store
    from dem_bridge.studies.verify import DEFAULT_ACCURACY, verify_scenes

    if scenes is None:
        scenes = [PAPER]
    elif isinstance(scenes, Scene | str | Path):
        scenes = [scenes]
    if len(scenes) == 0:
        raise UsageError(f"scenes = []; allowed: one or more scenes, or {PAPER!r} (or None) for the whole paper")
    whole = any(isinstance(s, str) and s == PAPER for s in scenes)
    if whole and len(scenes) > 1:
        raise UsageError(f"{PAPER!r} is all shipped scenes together, and others are named beside it; give it alone")
    chosen = [] if whole else [scene_of(one) for one in scenes]
    accuracy = checked_accuracy(DEFAULT_ACCURACY if accuracy is None else accuracy)
    if folder is not None:
        check_folder(Path(folder))
    if bundle is not None:
        from dem_bridge.report.bundle import check_bundle

        check_bundle(Path(bundle))
    engine = Engine.chosen(lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks)
    kept = Store.opened(store, recompute=recompute)
    settings: dict[str, Any] = {
        "accuracy": accuracy,
        "jobs": jobs,
        "progress": progress,
        "engine": engine,
        "store": kept,
    }
    if whole:
        from dem_bridge.studies.paper.study import verify_paper

        found = verify_paper(**settings)
    else:
        found = verify_scenes(chosen, **settings)
    write_found(found, folder=folder, bundle=bundle, engine=engine, store=kept)
    return found


def write_found(
    found: Verification,
    *,
    folder: str | Path | None = None,
    bundle: str | Path | None = None,
    engine: Engine | None = None,
    words: Sequence[str] | None = None,
    store: Store | None = None,
) -> None:
    """Write the report and the bundle of a verification, each where it is wanted; see :func:`verify`.

    ``words``: what ``dem-bridge verify`` is told when the bundle is run again (None: "paper" where it was that, else
    the scenes' files). ``store``: where pictures are kept.
    """
    if folder is None and bundle is None:
        return
    from dem_bridge.report.page import report_files

    report = report_files(found, store)
    if folder is not None:
        write_whole(Path(folder), report)
    if bundle is not None:
        from dem_bridge.report.bundle import write_bundle

        write_bundle(found, Path(bundle), report=report, engine=engine, words=words)


def write_deck(
    scene: Scene | str | Path, folder: str | Path, *, style: str = "granular", **settings: object
) -> tuple[Path, ...]:
    """Write the LAMMPS deck of a scene into ``folder`` (made if need be) and return the files; it runs by
    ``lmp -in in.NAME`` there. ``style``: "granular" or "table"; settings as in :func:`solve`. All files appear or none.
    """
    from dem_bridge.backends.lammps import LammpsGranular
    from dem_bridge.planning.bars import resolution_for

    styles = [name.removeprefix("lammps-") for name in ENGINE_BACKENDS]
    if style not in styles:
        raise UsageError(f"style = {style!r}; allowed: {' or '.join(styles)}")
    for key in _ENGINE:
        if settings.get(key) is not None:
            raise UsageError(f"{key} = {settings[key]!r} says which LAMMPS runs; a deck is only written: leave it out")
    scene = scene_of(scene)
    chosen, resolution, sampling, accuracy = _settings(scene, f"lammps-{style}", settings)
    assert isinstance(chosen, LammpsGranular)
    if accuracy is not None:
        resolution = resolution_for(scene, accuracy, replace(resolution, tables=style == "table"), sampling)
    deck = chosen.deck(scene, resolution, sampling)
    folder = Path(folder)
    write_whole(folder, deck.files)
    return tuple(folder / name for name in deck.files)


def available() -> dict[str, Availability]:
    """Every backend's name with whether it can run here and, if not, why and what to do."""

    def of(name: str) -> Availability:
        try:
            return backend(name).availability()
        except UsageError as error:  # the environment names an engine that cannot be
            return Availability(False, str(error))

    return {name: of(name) for name in BACKENDS}


def _planned(scene: Scene, settings: dict[str, object]) -> str:
    """The backend that is the cheapest for the accuracy among the settings."""
    from dem_bridge.planning.planner import plan_for

    accuracy, samples = settings.get("accuracy"), settings.get("samples")
    if accuracy is None:
        raise UsageError(f"backend = None; allowed: {', '.join(BACKENDS)}, or an accuracy from which one follows")
    return plan_for(scene, checked_accuracy(accuracy), sampling=_sampling(scene, samples)).backend


def _settings(
    scene: Scene, name: str, settings: dict[str, object]
) -> tuple[Backend, Resolution, Sampling, float | None]:
    which = {key: settings[key] for key in _ENGINE if settings.get(key) is not None}
    chosen = backend(name, Engine.chosen(**which) if which else None)  # type: ignore[arg-type]
    known = (*_RESOLUTION, *_OTHER, *_ENGINE)
    unknown = [key for key in settings if key not in known]
    if unknown:
        raise UsageError(f"setting {unknown[0]!r} is unknown; allowed: {', '.join(known)}")
    accuracy = settings.get("accuracy")
    if accuracy is not None:
        accuracy = checked_accuracy(accuracy)
        if settings.get("uncertainty") is False:
            raise UsageError(
                "uncertainty = False with an accuracy, which is compared with the uncertainty; leave one of them out"
            )
        if settings.get("dt") is not None:
            raise UsageError("dt and accuracy are both given; give one: the other follows from it")
    if not isinstance(settings.get("uncertainty", True), bool):
        raise UsageError(f"uncertainty = {settings['uncertainty']!r}; allowed: True or False")
    if settings.get("order") not in (None, "richardson"):
        raise UsageError(f"order = {settings['order']!r}; allowed: 'richardson'")
    sampling = _sampling(scene, settings.get("samples"))
    # of any type so far: a Resolution checks what it is given
    resolution = Resolution(**{key: settings[key] for key in _RESOLUTION if key in settings})  # type: ignore[arg-type]
    return chosen, resolution, sampling, accuracy


def _sampling(scene: Scene, samples: object) -> Sampling:
    """As the scene has it, or of so many samples: of any type so far, for a Sampling checks it."""
    return Sampling(count=scene.samples if samples is None else samples)  # type: ignore[arg-type]


def _check_accuracy(chosen: Backend, scene: Scene, run: Trajectory, accuracy: float) -> None:
    """A run whose own bar is above what was asked is refused with its floor, not handed out."""
    bar, scale = run.uncertainty["velocity"], float(abs(run.velocity).max())
    if bar > accuracy * scale:
        floor = bar / scale if scale > 0.0 else float("inf")
        raise UsageError(
            f"accuracy = {accuracy:g} cannot be promised by {chosen.name} on {scene.name}: its bar is {floor:.2g};"
            " ask for less, or take another backend"
        )
