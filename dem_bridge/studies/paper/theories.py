"""Deviations of binary collisions and of the adiabatic wave from the reference, in per cent.

The paper sets binary collisions beside ode45. Their difference has two parts, and the table tells them apart: what the
theory misses (BCA minus reference) and what ode45 at MATLAB's default tolerances errs by (ode45 minus reference).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from dem_bridge.observables.front import peak_velocity_of_front, residence_by_crossing
from dem_bridge.scene import Scene
from dem_bridge.studies.paper.effects import OBSERVABLES, Effect
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.studies.study import Table
from dem_bridge.trajectory import Trajectory

Floats = NDArray[np.float64]
#: bodies from here on: the first ones still form the pulse
FIRST = 5
#: bodies from the free end, where the last one flies off, that are left out
LAST = 3
#: theories, and the paper's own method
NAMES = {"bca": "BCA", "adiabatic": "adiabatic wave", "ode45": "ode45"}


#: what is compared -> along the chain, a value for each body or contact
PROFILES: Mapping[str, Callable[[Scene, Trajectory], Floats]] = {
    "arrival": lambda scene, run: run.crossing_time[FIRST : scene.n_body - LAST],
    "residence time": lambda scene, run: residence_by_crossing(scene, run)[FIRST - 1 : scene.n_body - LAST - 1],
    "peak velocity": lambda scene, run: peak_velocity_of_front(scene, run).velocity[FIRST : scene.n_body - LAST],
    "peak force": lambda scene, run: run.peak_force[FIRST : scene.n_body - LAST],
}


def deviation(what: str, scene: Scene, run: Trajectory, truth: Trajectory) -> Floats:
    """Relative deviation of a run from the truth, body by body, in one of :data:`PROFILES`."""
    return PROFILES[what](scene, run) / PROFILES[what](scene, truth) - 1.0


def theories_table(runs: Runs, scenes: Iterable[str]) -> Table:
    """Median and worst deviation for each scene and theory."""
    rows: list[tuple[str | float, ...]] = []
    for name in scenes:
        truth = runs.truth(name)
        if truth is None:
            continue
        scene = runs.scenes[name]
        if scene.n_body < FIRST + LAST + 3 or scene.gravity or scene.precompression:
            continue
        true = {what: profile(scene, truth) for what, profile in PROFILES.items()}
        for key, label in NAMES.items():
            run = runs.run(name, key)
            if run is None:
                continue
            numbers: list[float] = []
            for what, profile in PROFILES.items():
                item = profile(scene, run) / true[what] - 1.0
                available = item[np.isfinite(item)]
                worst = available[np.argmax(np.abs(available))] if available.size else np.nan
                numbers += [100.0 * float(np.median(available)) if available.size else np.nan, 100.0 * float(worst)]
            rows.append((name, label, *numbers))
    return Table(
        id="theories",
        title="Theories beside the reference",
        caption=(
            f"Deviation from the reference in per cent, median and worst over bodies {FIRST} to N-{LAST} (the pulse is"
            " formed by then, and the free end is not felt). Binary collisions know times; the adiabatic wave knows"
            " times, velocities and forces. ode45 is no theory: it is the paper's numerical method at MATLAB's default"
            " tolerances, and what it is off by is its own error. Without scenes that are compressed before the impact:"
            " there contacts cross in the noise ahead of the wave."
        ),
        columns=("scene", "by", *(f"{item}, {which} (%)" for item in PROFILES for which in ("median", "worst"))),
        rows=tuple(rows),
    )


def split_table(effects: Iterable[Effect]) -> Table:
    """Return the table that splits the difference of binary collisions and ode45 into the deviation of each."""
    known_values = {(effect.scene, effect.id): effect.changes for effect in effects}
    scenes = [scene for scene, id in known_values if id == "bca" and (scene, "ode45") in known_values]
    return Table(
        id="split",
        title="Binary collisions beside ode45: theory and numerics apart",
        caption=(
            "In per cent of the reference. The difference that the paper could see (BCA - ode45) is what the theory"
            " misses (BCA - reference) and what ode45 errs by with its sign turned (reference - ode45)."
        ),
        columns=("chain", "quantity", "BCA - ode45 (%)", "of it the theory's (%)", "of it ode45's own (%)"),
        rows=tuple(
            (scene, name, 100.0 * (theory[name] - code[name]), 100.0 * theory[name], -100.0 * code[name])
            for scene in scenes
            for theory, code in [(known_values[scene, "bca"], known_values[scene, "ode45"])]
            for name in OBSERVABLES
        ),
    )
