"""Deviations of binary collisions and of the adiabatic wave from the reference, in per cent.

The paper sets binary collisions beside ode45. Their difference has two parts, which the second table separates: the
error of the theory (BCA - reference) and that of ode45 at MATLAB's default tolerances (ode45 - reference).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from dem_bridge.observables.registry import OBSERVABLES as REGISTERED
from dem_bridge.report.study import Table
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.effects import OBSERVABLES, Effect
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.studies.paper.texts import PAPER
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: bodies from here on: the first ones still form the pulse
FIRST = 5
#: bodies from the free end, where the last one flies off, that are left out
LAST = 3
#: theories, and the paper's own method
NAMES = {"bca": "BCA", "adiabatic": "adiabatic wave", "ode45": "ode45"}
#: name in tables -> registered observable of bodies or contacts
PROFILES: Mapping[str, str] = {
    name: name.replace(" ", "_") for name in ("arrival", "residence time", "peak velocity", "peak force")
}


def profiled(scene: Scene) -> slice:
    """Return the bodies, and contacts, that are compared: without both ends of the chain."""
    return slice(FIRST, scene.n_body - LAST)


def profile(what: str, scene: Scene, run: Trajectory) -> Floats:
    """Return one of :data:`PROFILES` of a run at :func:`profiled`."""
    return REGISTERED[PROFILES[what]].value(scene, run)[profiled(scene)]


def deviation(what: str, scene: Scene, run: Trajectory, truth: Trajectory) -> Floats:
    """Return the relative deviation of one of :data:`PROFILES` of a run from the reference, body by body."""
    return profile(what, scene, run) / profile(what, scene, truth) - 1.0


def theories_table(runs: Runs, scenes: Iterable[str]) -> Table:
    """Return the median and the worst deviation for each scene and theory."""
    rows: list[tuple[str | float, ...]] = []
    for name in scenes:
        truth = runs.truth(name)
        if truth is None:
            continue
        scene = runs.scenes[name]
        if scene.n_body < FIRST + LAST + 3 or scene.gravity or scene.precompression:
            continue
        for key, label in NAMES.items():
            run = runs.run(name, key)
            if run is None:
                continue
            numbers: list[float] = []
            for what in PROFILES:
                values = deviation(what, scene, run, truth)
                values = 100.0 * values[np.isfinite(values)]
                values = values if values.size else np.array([np.nan])
                numbers += [float(np.median(values)), float(values[np.argmax(np.abs(values))])]
            rows.append((name, label, *numbers))
    columns = ("scene", "by", *(f"{item}, {which} (%)" for item in PROFILES for which in ("median", "worst")))
    return PAPER.table("theories", rows, columns=columns, first=FIRST, last=LAST)


def split_table(effects: Iterable[Effect]) -> Table:
    """Return the table that splits the difference of binary collisions and ode45 into the deviation of each."""
    known_values = {(effect.scene, effect.id): effect.changes for effect in effects}
    scenes = [scene for scene, id in known_values if id == "bca" and (scene, "ode45") in known_values]
    rows = [
        (scene, name, 100.0 * (theory[name] - code[name]), 100.0 * theory[name], -100.0 * code[name])
        for scene in scenes
        for theory, code in [(known_values[scene, "bca"], known_values[scene, "ode45"])]
        for name in OBSERVABLES
    ]
    return PAPER.table("split", rows)
