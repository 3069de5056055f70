"""The public facade for runs: solve a scene, plan its settings, write its deck, list the backends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from dem_bridge.backends.catalogue import backend_names
from dem_bridge.backends.prescan import interpretable
from dem_bridge.errors import UnsupportedScene, UsageError, shown
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import write_whole
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.convergence import checked_accuracy
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve as solve_case
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from dem_bridge.runs.campaign import Progress
    from dem_bridge.runs.planning.answer import Plan

#: the function ``backend`` has the name of a parameter of the facade
_backend = backend


def solve(
    scene: Scene | str | Path,
    *,
    backend: str | None = None,
    dt: float | None = None,
    accuracy: float | None = None,
    order: str | None = None,
    samples: int | None = None,
    uncertainty: bool = True,
    rtol: float | None = None,
    atol: float | None = None,
    surrogate_radius: float | None = None,
    geometry: str = "surrogate",
    types: str = "euler",
    table_style: str = "spline",
    table_lines: int | None = None,
    table_points: int | None = None,
    tables: bool = False,
    time_limit: float = 3600.0,
    engine: Engine | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
    **unknown: object,
) -> Trajectory:
    """Solve a scene with one backend.

    Parameters
    ----------
    scene : Scene, str or Path
        Scene, name of a shipped scene or path of a scene file.
    backend : str, optional
        Name of a backend, see :func:`available`. None: the cheapest for the ``accuracy``, see :func:`plan`.
    dt : float, optional
        Upper bound of the time step, s. The step is interval / ceil(interval / dt), so that samples fall on steps.
    accuracy : float, optional
        Largest permissible uncertainty of velocities, relative to the largest velocity; the step follows from it.
    order : {"richardson"}, optional
        Extrapolate from runs with 2 dt, dt and dt/2.
    samples : int, optional
        Number of equal sampling intervals. None: the scene's.
    uncertainty : bool
        Whether the uncertainty is estimated, by further runs. Otherwise it is inf.
    rtol : float, optional
        Relative local tolerance of scipy and ode45. It is not the error.
    atol : float, optional
        Absolute local tolerance of ode45, m and m/s alike.
    surrogate_radius : float, optional
        Radius of the bodies in a deck, m. None: the smallest that serves. The twin keeps absolute positions with it.
    geometry : {"surrogate", "physical"}
        Radius in a deck where ``surrogate_radius`` is None: the smallest that serves, or half the scene's spacing.
    types : {"euler", "per-body"}
        Atom types of a deck: as few as possible, or one for each body.
    table_style : {"spline", "linear"}
        How LAMMPS interpolates tables.
    table_lines, table_points : int, optional
        Lines of a table file, and points of LAMMPS' internal table.
    tables : bool
        Whether the twin takes forces from LAMMPS' tables.
    time_limit : float
        Wall time after which LAMMPS is stopped, s.
    engine : Engine, optional
        Which LAMMPS, in place of the next four parameters.
    lmp : str or Path, optional
        A LAMMPS binary; the variable ``DEM_BRIDGE_LMP`` names one as well.
    lmp_args : str, optional
        Further command-line arguments of LAMMPS, such as "-sf omp".
    python : str or Path, optional
        Python interpreter of another environment with a ``lammps`` module.
    ranks : int, optional
        Number of MPI processes.

    Returns
    -------
    Trajectory

    Raises
    ------
    UsageError
        For an unknown backend or setting, for a setting out of its range, and for an accuracy that is not reached.
    UnsupportedScene
        If the backend does not support the scene.
    BackendUnavailable
        If the backend cannot run on this machine.
    NotAsymptotic
        If ``order`` is given and the observed order is not that of the method.
    RunBroken
        If the run fails.

    Examples
    --------
    >>> import dem_bridge as db
    >>> run = db.solve("accelerating-40", backend="verlet", dt=1e-7)
    >>> run.velocity.shape, f"{1e3 * run.crossing_time[-1]:.2f} ms", run.uncertainty["velocity"] < 4e-4
    ((501, 41), '0.55 ms', True)
    """
    resolution = _resolution(locals())
    _check_settings(dt, accuracy, order, uncertainty)
    check_arguments(solve, locals())
    scene = scene_of(scene)
    _refuse_unknown(solve, unknown)
    sampling = _sampling(scene, samples)
    if backend is None:
        backend = _cheapest(scene, accuracy, sampling)
    lammps = Engine.named(engine, lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks)
    solver = _backend_for(scene, backend, lammps)
    if backend in ENGINE_BACKENDS and not interpretable(scene):
        # with a stored prescan the engine starts before the compiler is loaded, which only the uncertainty needs
        from dem_bridge.runs.recall import recall_prescan
        from dem_bridge.runs.store import Store

        recall_prescan(Store.opened(), scene)
    cache = RunCache()
    if accuracy is not None:
        resolution = _resolution_for(scene, solver, accuracy, resolution, sampling, cache)
    case = Case(
        scene=scene, backend=backend, resolution=resolution, sampling=sampling, engine=lammps, uncertainty=uncertainty
    )
    if order is None:
        run = solve_case(case, cache)
    else:
        from dem_bridge.runs.uncertainty.extrapolate import extrapolate

        run = extrapolate(case)
    if accuracy is not None:
        _check_accuracy(solver, scene, run, accuracy)
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
    """Find the cheapest settings for an accuracy, with the reason for each number.

    A model predicts the settings from a coarse run, and runs at two and more resolutions check and correct them. A step
    or a tolerance is accepted only if the finer ones, down to a quarter of it, have the accuracy too.

    Parameters
    ----------
    scene : Scene, str or Path
        Scene, name of a shipped scene or path of a scene file.
    accuracy : float
        Largest permissible error of the observable over all samples, bodies or contacts, relative to its scale.
    backend : str, optional
        Find the settings of this backend. None: the cheapest of the backends in this package, without LAMMPS.
    observable : str
        One of :data:`dem_bridge.observables.registry.OBSERVABLES`, which has its definition and scale, such as
        "velocity" (relative to the largest) or "peak_force" (of each contact, relative to its own).
    budget : float, optional
        CPU time that the run may take, s.
    predict_only : bool
        Whether the prediction is the answer, without runs that check it.
    samples : int, optional
        Number of equal sampling intervals. None: the scene's.
    progress : callable, optional
        Called with (done, total, label).

    Returns
    -------
    Plan

    Raises
    ------
    UsageError
        If the accuracy cannot be reached, with the smallest error, or not within the budget, with the accuracy that the
        budget buys.
    UnsupportedScene
        If the backend does not support the scene.

    Examples
    --------
    >>> import dem_bridge as db
    >>> found = db.plan("accelerating-40", 1e-3, backend="verlet")
    >>> run = db.solve("accelerating-40", backend=found.backend, **found.resolution)
    >>> 5e-4 < found.found_error < 1e-3, found.units["dt"] <= found.resolution["dt"]
    (True, True)
    """
    check_arguments(plan, locals())
    from dem_bridge.runs.planning.planner import plan_for

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


def write_deck(
    scene: Scene | str | Path,
    folder: str | Path,
    *,
    style: str = "granular",
    dt: float | None = None,
    accuracy: float | None = None,
    samples: int | None = None,
    surrogate_radius: float | None = None,
    geometry: str = "surrogate",
    types: str = "euler",
    table_style: str = "spline",
    table_lines: int | None = None,
    table_points: int | None = None,
    replace: bool = True,
    **unknown: object,
) -> tuple[Path, ...]:
    """Write the LAMMPS deck of a scene; it runs by ``lmp -in in.NAME`` in its folder.

    Parameters
    ----------
    scene : Scene, str or Path
        Scene, name of a shipped scene or path of a scene file.
    folder : str or Path
        Folder for the files, created if need be. All files appear or none.
    style : {"granular", "table"}
        The pair style.
    dt, accuracy, samples, surrogate_radius, geometry, types, table_style, table_lines, table_points : optional
        Settings as in :func:`solve`.
    replace : bool
        Whether files that exist are replaced; False: they are an error.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    UsageError
        For an unknown style or setting, or a file that exists and may not be replaced.
    UnsupportedScene
        If LAMMPS cannot express the scene by this style.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     print(*(path.name for path in db.write_deck("decelerating-40", folder, dt=1e-7)))
    in.decelerating-40 data.decelerating-40
    """
    resolution = _resolution(locals())
    _check_settings(dt, accuracy)
    check_arguments(write_deck, locals())
    from dem_bridge.backends.lammps import LammpsGranular

    styles = [name.removeprefix("lammps-") for name in ENGINE_BACKENDS]
    if style not in styles:
        raise UsageError(f"style = {style!r}; allowed: {' or '.join(styles)}")
    _refuse_unknown(write_deck, unknown)
    scene = scene_of(scene)
    writer, sampling = _backend(f"lammps-{style}"), _sampling(scene, samples)
    assert isinstance(writer, LammpsGranular)
    if accuracy is not None:
        resolution = _resolution_for(scene, writer, accuracy, resolution, sampling)
    deck = writer.deck(scene, resolution, sampling)
    folder = Path(folder)
    write_whole(folder, deck.files, replace=replace)
    return tuple(folder / name for name in deck.files)


def available() -> dict[str, Availability]:
    """Return for every backend whether it can run on this machine and, if not, why and what to do.

    Returns
    -------
    dict of str to Availability

    Examples
    --------
    >>> import dem_bridge as db
    >>> db.available()["reference"]
    Availability(available=True, reason='')
    """

    def availability(name: str) -> Availability:
        try:
            return _backend(name).availability()
        except UsageError as error:  # an engine that does not exist, or a faulty distribution
            return Availability(False, str(error))

    return {name: availability(name) for name in backend_names()}


def refuse_settings(scene: Scene, backend: str | None, settings: Mapping[str, Any]) -> None:
    """Raise the error with which :func:`solve` refuses a backend or settings of it, before anything is computed."""
    _resolution({**settings, "scene": scene})
    _check_settings(settings.get("dt"), settings.get("accuracy"))
    if backend is not None:
        keys = ("engine", "lmp", "lmp_args", "python", "ranks")
        _backend_for(scene, backend, Engine.named(**{key: settings.get(key) for key in keys}))


def _backend_for(scene: Scene, name: str, engine: Engine | None) -> Backend:
    """Return a backend that solves a scene; raise UnsupportedScene if it cannot."""
    solver = _backend(name, engine)
    if reason := unsupported_reason(solver, scene):
        raise UnsupportedScene(f"{solver.name} cannot do {scene.name}: {reason}")
    return solver


def _cheapest(scene: Scene, accuracy: object, sampling: Sampling) -> str:
    """Return the cheapest backend for an accuracy, of those whose uncertainty can be brought within it."""
    from dem_bridge.runs.planning.planner import plan_for

    if accuracy is None:
        raise UsageError(f"backend = None; allowed: {', '.join(BACKENDS)}, or an accuracy from which one follows")
    left_out = {"ode45": "no tolerances of it are chosen from its uncertainty"}
    return plan_for(scene, checked_accuracy(accuracy), sampling=sampling, left_out=left_out).backend


def _resolution_for(
    scene: Scene,
    solver: Backend,
    accuracy: float,
    resolution: Resolution,
    sampling: Sampling,
    cache: RunCache | None = None,
) -> Resolution:
    """Return the resolution with the step for an accuracy; as it is for backends without a fixed step."""
    if solver.order is None:
        return resolution
    # it loads the compiler, which not every backend needs
    from dem_bridge.runs.uncertainty.step_choice import step_for_accuracy

    resolution = replace(resolution, tables=resolution.tables or solver.name == "lammps-table")
    by = "verlet" if solver.name in (*ENGINE_BACKENDS, "ase") else solver.name
    return step_for_accuracy(scene, accuracy, resolution, sampling, by=by, cache=cache)


def _resolution(arguments: Mapping[str, Any]) -> Resolution:
    """Return the resolution whose settings are among the arguments of a function.

    The error of a time step that is none says which one is usual for the scene.
    """
    settings = {item.name: arguments[item.name] for item in fields(Resolution) if item.name in arguments}
    try:
        return Resolution(**settings)
    except UsageError as error:
        from dem_bridge.scene.timescales import contact_time_of

        if not str(error).startswith("dt = ") or (shortest := contact_time_of(scene_of(arguments["scene"]))) is None:
            raise
        raise UsageError(f"{error}; a usual step for this scene is {shortest / 1000.0:.0e} s") from None


def _sampling(scene: Scene, samples: int | None) -> Sampling:
    return Sampling(count=scene.samples if samples is None else samples)


def _refuse_unknown(function: Any, unknown: dict[str, object]) -> None:
    """Raise UsageError for keywords that a function of the facade does not have."""
    if unknown:
        import inspect

        keywords = [
            name
            for name, parameter in inspect.signature(function).parameters.items()
            if parameter.kind is inspect.Parameter.KEYWORD_ONLY
        ]
        raise UsageError(f"setting {next(iter(unknown))!r} is unknown; allowed: {', '.join(keywords)}")


def _check_settings(dt: object, accuracy: object, order: object = None, uncertainty: object = True) -> None:
    """Raise UsageError for settings that contradict each other or are none of the allowed ones."""
    if not isinstance(uncertainty, bool):
        raise UsageError(f"uncertainty = {shown(uncertainty)}; allowed: True or False")
    if accuracy is not None:
        checked_accuracy(accuracy)
        if not uncertainty:
            raise UsageError(
                "uncertainty = False with an accuracy, which is compared with the uncertainty; leave one of them out"
            )
        if dt is not None:
            raise UsageError("dt and accuracy are both given; give one: the other follows from it")
    if order is not None and not (isinstance(order, str) and order == "richardson"):
        raise UsageError(f"order = {shown(order)}; allowed: 'richardson'")


def _check_accuracy(solver: Backend, scene: Scene, run: Trajectory, accuracy: float) -> None:
    """Raise UsageError where the uncertainty of a run is above the accuracy."""
    velocity, scale = run.uncertainty["velocity"], float(abs(run.velocity).max())
    if velocity > accuracy * scale:
        floor = relative_size(velocity, scale)
        raise UsageError(
            f"accuracy = {accuracy:g} is not reached by {solver.name} on {scene.name}: its uncertainty is {floor:.2g};"
            " ask for less, or take another backend"
        )
