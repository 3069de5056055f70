"""Errors of a time step by runs of the method of a code, the largest step for an accuracy, and the largest stable one.

Errors are the largest differences from the exact motion, relative to the largest value; :func:`predict_step_error`
answers for a scene, :func:`step_error` for a file whose method a fit has found.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np

from dem_bridge.errors import UnsupportedScene
from dem_bridge.judging import kernels
from dem_bridge.judging.decision import METHODS_OF_RIGHT_CODES, Decision
from dem_bridge.judging.diagnosis import Diagnosis
from dem_bridge.judging.fitting import MOST_STEPS_OF_METHOD, TOLERANCE_OF_DECISION, Fit, Stepping
from dem_bridge.judging.model import Model, Motion, model_of, resolving_step
from dem_bridge.judging.reference import FileErrors
from dem_bridge.observables.largest_step import ACCURACIES, StepError, measure_steps
from dem_bridge.observables.modes import highest_mode
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: kinetic energy, relative to the largest of the reference, above which a run is unstable
_LARGEST_ENERGY_GAIN = 2.0
#: part of a step that is tried next, how many steps are tried, and how many in a row must be stable
_RATIO_OF_STEPS_TRIED, _MOST_STEPS_TRIED, _STABLE_IN_A_ROW = 0.95, 12, 2
#: samples times bodies of a run that are looked at, at most
_MOST_VALUES_KEPT = 1_000_000


def predict_step_error(
    scene: Scene,
    dt: float | None = None,
    *,
    accuracies: Iterable[float] = ACCURACIES,
    times: Floats | None = None,
    method: int = kernels.VERLET,
    quantity: str = "velocity",
    stated: bool = True,
) -> StepError | None:
    """Return the error of velocities that a time step makes in a scene, with the largest steps for some accuracies.

    Each of these steps was tried: a run with it, on the times of the samples, is within its accuracy.

    Parameters
    ----------
    scene : Scene
        Any scene whose contact law is a power of the overlap; None is returned for others.
    dt : float, optional
        Time step, s; None: only the largest steps are of interest.
    accuracies : iterable of float
        Permissible errors relative to the largest velocity.
    times : ndarray, optional
        Times of the samples, s, increasing from 0 on; those of the scene by default.
    method : int
        Method of :mod:`.kernels`, velocity Verlet as in LAMMPS by default: damping forces are those at the velocities
        of half a step before.
    quantity : {"velocity", "displacement", "contact_force"}
        Quantity whose errors are told, relative to its largest value.
    stated : bool
        False if the step was found from errors of a file.

    Examples
    --------
    >>> scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> step = predict_step_error(scene, 1e-6)
    >>> f"{step.error:.1e}", f"{step.largest_for(1e-4):.1e} s"
    ('2.0e-04', '7.0e-07 s')
    """
    if scene.law is not None:
        return None
    model = model_of(scene)
    times = np.linspace(0.0, scene.duration, scene.samples + 1) if times is None else times
    name = quantity.rsplit("_", maxsplit=1)[-1]
    exact = getattr(model.exact(model.system, times, TOLERANCE_OF_DECISION), name)
    scale, end = float(np.max(np.abs(exact))), float(times[-1])
    if not scale > 0.0:
        return None

    def error_at(step: float) -> float:
        with np.errstate(all="ignore"):
            stepped = getattr(model.stepped_at(model.system, times, step, method), name)
            error = float(np.max(np.abs(stepped - exact))) / scale
        return error if math.isfinite(error) else math.inf

    known = {} if dt is None else {dt: error_at(dt)}
    return measure_steps(
        error_at,
        known or {resolving_step(model, end, MOST_STEPS_OF_METHOD): math.nan},
        accuracies,
        shortest=end / MOST_STEPS_OF_METHOD,
        longest=end,
        dt=dt,
        stated=stated,
    )


def step_error(decision: Decision, fit: Fit, accuracies: Iterable[float] = ACCURACIES) -> StepError | None:
    """Return the error of the step of a fit that explains a file; None if it was explained without a step."""
    if fit.stepping is None:
        return None
    method, dt = fit.stepping
    data = decision.data
    # the step explains the errors of the file, which need no run of the method
    known = {dt: data.largest(decision.exact, [block.values for block in data.blocks])[0] / data.blocks[0].scale}

    def error_at(step: float) -> float:
        variant = fit.hypothesis.make(fit.parameters)
        with np.errstate(all="ignore"):
            stepped = data.predict(variant, decision.rows, TOLERANCE_OF_DECISION, Stepping(method, step))
        error = data.largest(stepped, decision.exact)[0] / data.blocks[0].scale
        return error if math.isfinite(error) else math.inf

    end = float(data.time[-1])
    return measure_steps(
        error_at,
        known,
        accuracies,
        shortest=end / MOST_STEPS_OF_METHOD,
        longest=end,
        dt=dt,
        stated=data.dt is not None,
    )


def step_curve(
    scene: Scene, diagnosis: Diagnosis, file: FileErrors, name: str, accuracies: Sequence[float]
) -> StepError | None:
    """Return the errors of a quantity by the time step: by the method that a fit has found, or by Verlet."""
    if diagnosis.step is not None and diagnosis.cause == "none":
        return diagnosis.step
    method, dt = diagnosis.stepping or (kernels.VERLET, file.record.dt)
    times = file.record.time if file.record.time[0] == 0.0 else np.append(0.0, file.record.time)
    return predict_step_error(
        scene, dt, accuracies=accuracies, times=times, method=method, quantity=name,
        stated=file.record.dt is not None,
    )  # fmt: skip


def errors_by_step(scene: Scene, diagnosis: Diagnosis, file: FileErrors) -> dict[str, Floats] | None:
    """Return the errors of the code's method and step in the scene at the samples of a wrong file, if both are known.

    Of the methods that a right code may have, the one counts with which the file agrees longest.
    """
    dt = file.record.dt
    if diagnosis.cause == "none" or scene.law is not None:
        return None
    known = diagnosis.stepping
    steppings = (
        [known] if known is not None else [Stepping(method, dt) for method in METHODS_OF_RIGHT_CODES if dt is not None]
    )
    unexplained = file.first_divergence(scene)
    if unexplained is None or not steppings:
        return None
    model, time = model_of(scene), np.maximum(file.record.time, 0.0)
    exact = _quantities(scene, model.exact(model.system, time, TOLERANCE_OF_DECISION))

    def by(stepping: Stepping, rows: int) -> tuple[float, dict[str, Floats]]:
        """Return when the first ``rows`` samples of the file leave a method, and the errors of the method at them."""
        method, step = stepping
        with np.errstate(all="ignore"):
            stepped = _quantities(scene, model.stepped_at(model.system, time, step, method, rows))
        by_step = {
            name: (stepped[name] - exact[name][:rows])[:, list(part.columns)] for name, part in file.quantities.items()
        }
        first = file.until(rows).first_divergence(scene, by_step)
        return math.inf if first is None else float(first["time"]), by_step

    best: tuple[float, dict[str, Floats]] | None = None
    for stepping in steppings:
        if time[-1] / stepping.dt > MOST_STEPS_OF_METHOD:
            continue
        # a method that the file leaves no later than another one need not be followed to the end
        if best is None or by(stepping, int(np.searchsorted(time, best[0], side="right")))[0] > best[0]:
            candidate = by(stepping, len(time))
            best = candidate if best is None or candidate[0] > best[0] else best
        if best[0] > float(unexplained["time"]):
            break
    return None if best is None else best[1]


def observed_curve(files: Sequence[FileErrors], name: str) -> StepError | None:
    """Return the largest errors of right files against their steps; None unless they fall with the step."""
    having = [file for file in files if name in file.quantities and file.record.dt is not None]
    curve = sorted((float(f.record.dt or 0.0), f.quantities[name].relative(f.quantities[name].value)) for f in having)
    falling = len(curve) > 1 and all(0.0 < fine[1] < coarse[1] for fine, coarse in pairwise(curve))
    return StepError(dt=curve[0][0], stated=True, curve=tuple(curve)) if falling else None


def _quantities(scene: Scene, motion: Motion) -> dict[str, Floats]:
    """Return the quantities of a file, of which forces are in the order of the contacts."""
    contacts = scene.contacts
    places = np.where(contacts.left == scene.n_body, 0, contacts.left + 1)
    return {"velocity": motion.velocity, "displacement": motion.displacement, "contact_force": motion.force[:, places]}


def stability_limit(scene: Scene, displacement: Floats, velocity: Floats, end: float, frequency: float) -> float:
    """Return the largest time step, s, that is stable on a chain; nan if no contact closes.

    On a linear chain velocity Verlet is stable up to 2/omega of its highest mode, in which a body between two contacts
    has the stiffness of both. A chain of contacts that open and close may be unstable at steps that are a little
    shorter: from this limit on, steps are tried on our code until the kinetic energy does not grow.

    Parameters
    ----------
    scene : Scene
        The chain.
    displacement, velocity : ndarray
        Samples of the reference, m and m/s, ``(n_t, n_body)``, at which contacts are pressed the most.
    end : float
        Time, s, after which no force acts.
    frequency : float
        Highest frequency of a contact alone, or rate of a damping, rad/s.

    Examples
    --------
    >>> scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> still = np.zeros((1, 2))
    >>> f"{stability_limit(scene, still, still + 0.8, 1e-4, 1e5):.2g} s"
    '2e-05 s'
    """
    with suppress(UnsupportedScene):  # the frequency of the contacts alone is known
        frequency = max(frequency, highest_mode(scene, displacement))
    if not frequency > 0.0:
        return math.nan
    step = 2.0 / frequency
    if scene.law is not None:
        return step
    model, energy = Model(scene), float(np.max(velocity**2 @ np.array(scene.mass)))
    stable: list[float] = []
    for _ in range(_MOST_STEPS_TRIED):
        stable = [*stable, step] if _is_stable(model, step, end, _LARGEST_ENERGY_GAIN * energy) else []
        if len(stable) == _STABLE_IN_A_ROW:
            break
        step *= _RATIO_OF_STEPS_TRIED
    return stable[0] if stable else step


def _is_stable(model: Model, step: float, end: float, most: float) -> bool:
    """Return True if the kinetic energy of all bodies, times two, stays below ``most`` (J)."""
    count = max(1, math.ceil(end / step))
    mass = np.array(model.scene.mass)
    rows = np.unique(np.linspace(0, count, min(count, max(2, _MOST_VALUES_KEPT // len(mass))) + 1).astype(np.int64))
    with np.errstate(all="ignore"):
        energy = model.stepped(model.system, rows, step).velocity ** 2 @ mass
    return bool(np.all(energy <= most))
