"""Runs of the paper's study that are cheap, made once: what its claims are tried on.

The twin stands in for LAMMPS: same algorithm, no engine. Long chains have no bars of their own (4 s): theirs are those
that the reference gives for them, rounded up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.report.study import Claim
from dem_bridge.runs.campaign import Result, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies import scatter
from dem_bridge.studies.paper.claims_numbers import numbers
from dem_bridge.studies.paper.claims_wave import waves
from dem_bridge.studies.paper.runs import (
    LONG,
    MAIN,
    Runs,
    matched,
    quick,
    steeper_tapers,
    variants,
    with_mass_gradient,
)
from dem_bridge.studies.paper.study import read_paper, with_paper
from dem_bridge.studies.scatter import ScatteredChains
from dem_bridge.trajectory.trajectory import Trajectory, Uncertainty
from dem_bridge.verification.verification import Verification, verification_of
from dem_bridge.verification.verify import DEFAULT_ACCURACY

OTHERS = ("tapered-forward", "tapered-backward", "homogeneous-cylinders")
THEORIES = ("bca", "adiabatic")
#: of figure 6's gradients those that the claims name
GRADIENTS = (-0.02, -0.01, 0.0, 0.01, 0.02)
#: those that only scipy can do take up to 4 s each: all of the decelerating chain, two of the accelerating one
DEAR = (
    *(
        f"{MAIN[0]}.{id}"
        for id in ("dashpot", "strong-dashpot", "kuwabara-kono", "drag", "exponent-1um", "exponent-5um")
    ),
    *(f"{MAIN[1]}.{id}" for id in ("strong-dashpot", "kuwabara-kono", "drag")),
)
#: of the reference on the chains of 200, m, m/s, N, s: 3.9e-11 N, 8.4e-12 m/s
LONG_BARS = Uncertainty(velocity=1e-11, displacement=1e-14, peak_force=1e-10, crossing_time=1e-16)


def cheap_variants() -> list[Case]:
    return [case for case in variants() if case.scene.name not in DEAR]


def few_gradients() -> list[Case]:
    scenes = [with_mass_gradient(db.load_scene(name), gamma) for name in MAIN for gamma in GRADIENTS]
    return quick(scenes, ("reference", "ode45", *THEORIES))


def _case(scene: Scene, backend: str, *, uncertainty: bool = True, dt: float | None = None) -> Case:
    return Case(
        scene=scene,
        backend=backend,
        resolution=Resolution(dt=dt),
        sampling=Sampling(count=scene.samples),
        uncertainty=uncertainty,
    )


def _cases() -> Iterator[Case]:
    for scene in map(db.load_scene, MAIN):
        yield from (_case(scene, name) for name in ("reference", "ode45", *THEORIES))
        yield _case(scene, "verlet", dt=1e-7)
    for scene in map(db.load_scene, LONG):
        yield _case(scene, "reference", uncertainty=False)
        yield from (_case(scene, name) for name in THEORIES)
    for scene in map(db.load_scene, OTHERS):
        yield from (_case(scene, name) for name in ("reference", *THEORIES))
    yield from (*cheap_variants(), *matched(), *few_gradients(), *steeper_tapers())


def _as_found(result: Result) -> Result:
    case, run = result.case, result.trajectory
    assert run is not None, result.failure
    if case.backend == "verlet":
        return replace(result, case=replace(case, backend="lammps-granular"))
    if case.scene.name in LONG and case.backend == "reference":
        return replace(result, trajectory=replace(run, uncertainty=LONG_BARS))
    return result


@pytest.fixture(scope="package")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the runs of these tests are kept, for those that make the whole study."""
    return tmp_path_factory.mktemp("store")


@pytest.fixture(scope="package")
def results(store: Path) -> tuple[Result, ...]:
    return tuple(map(_as_found, run_cases(tuple(_cases()), jobs=1, store=Store(store))))


@pytest.fixture(scope="package")
def runs(results: tuple[Result, ...]) -> Runs:
    return Runs.of(results)


@pytest.fixture(scope="package")
def scattered() -> list[ScatteredChains]:
    return [scatter.solve_seeded(db.load_scene(name), spread=1.0, count=2) for name in MAIN]


@pytest.fixture(scope="package")
def paper(runs: Runs, scattered: list[ScatteredChains]) -> Verification:
    """Return the paper as it is read off the runs, with all claims, tables and figures."""
    verification = verification_of([], accuracy=DEFAULT_ACCURACY, wall=0.0)
    return with_paper(verification, read_paper([], DEFAULT_ACCURACY, runs, scattered))


@pytest.fixture(scope="package")
def claims(runs: Runs) -> tuple[Claim, ...]:
    """Return the claims on numbers and on the wave, read off the runs of the two main chains alone."""
    few = Runs.of(result for (name, _), result in runs.results.items() if name in MAIN)
    return (*numbers(few), *waves(few, []))


def truth_of(runs: Runs, name: str) -> Trajectory:
    found = runs.truth(name)
    assert found is not None
    return found


def planted(runs: Runs, scene: str, backend: str = "reference", **changes: Any) -> Runs:
    """The runs with something changed in one of them."""
    old = runs.results[scene, backend]
    assert old.trajectory is not None
    new = replace(old, trajectory=replace(old.trajectory, **changes))
    return Runs(runs.scenes, {**runs.results, (scene, backend): new})


def without(runs: Runs, *backends: str) -> Runs:
    """The runs that others than these have made."""
    return Runs(runs.scenes, {key: result for key, result in runs.results.items() if key[1] not in backends})


def swapped(runs: Runs) -> Runs:
    """Every run of the decelerating chains under the name of the accelerating ones, and the other way round."""

    def other(name: str) -> str:
        ways = ("decelerating", "accelerating")
        start, stop = ways if name.startswith(ways[0]) else ways[::-1]
        return name.replace(start, stop, 1)

    return Runs(
        {other(name): replace(scene, name=other(name)) for name, scene in runs.scenes.items()},
        {(other(name), backend): result for (name, backend), result in runs.results.items()},
    )


def wide_uncertainty(run: Trajectory, factor: float) -> Uncertainty:
    """Return an uncertainty that is so many times the largest value of each quantity."""
    sizes: dict[str, Any] = {name: factor * float(np.nanmax(np.abs(getattr(run, name)))) for name in run.uncertainty}
    return Uncertainty(**sizes)
