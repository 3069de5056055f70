"""The errors that the time step makes: in the files of a judgement, and in the scene by the method of their code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dem_bridge.judging.decision import METHODS_OF_RIGHT_CODES
from dem_bridge.judging.diagnosis import Diagnosis
from dem_bridge.judging.error import FileErrors
from dem_bridge.judging.fitting import MOST_STEPS_OF_METHOD, TOLERANCE_OF_DECISION, Stepping
from dem_bridge.judging.kernels import VERLET
from dem_bridge.judging.model import Model, Motion
from dem_bridge.judging.step import StepError, predict_step_error
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats


def step_curve(
    scene: Scene, diagnosis: Diagnosis, file: FileErrors, name: str, accuracies: Sequence[float]
) -> StepError | None:
    """Return the errors of a quantity by the time step: by the method that a fit has found, or by Verlet."""
    if diagnosis.step is not None and diagnosis.cause == "none":
        return diagnosis.step
    method, dt = diagnosis.stepping or (VERLET, file.record.dt)
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
    model, time = Model(scene), np.maximum(file.record.time, 0.0)
    exact = _quantities(scene, model.exact(model.system, time, TOLERANCE_OF_DECISION))
    best: tuple[float, dict[str, Floats]] | None = None
    for method, step in steppings:
        if time[-1] / step > MOST_STEPS_OF_METHOD:
            continue
        with np.errstate(all="ignore"):
            stepped = _quantities(scene, model.stepped_at(model.system, time, step, method))
        by_step = {name: (stepped[name] - exact[name])[:, list(part.columns)] for name, part in file.quantities.items()}
        first = file.first_divergence(scene, by_step)
        when = math.inf if first is None else float(first["time"])
        if best is None or when > best[0]:
            best = when, by_step
        if when > float(unexplained["time"]):
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
