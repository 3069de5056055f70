"""Every backend of the catalogue passes the public checks, and each check fails on a backend with its defect."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.base import BACKENDS, Availability, Resolution, Sampling, backend
from dem_bridge.errors import RunBroken
from dem_bridge.scene.features import DRAG, FEATURES, GAPS, GRAVITY, TSUJI
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Condition, Exponents, Support
from dem_bridge.testing import Check, ExactPair, backend_checks, check_backend
from dem_bridge.trajectory.trajectory import Trajectory


def _of_catalogue() -> Iterator[Any]:
    for name in BACKENDS:
        marks = [pytest.mark.lammps] if name.startswith("lammps") else []
        if name == "lammps-table":  # each run takes LAMMPS 0.2 s of CPU; lammps-granular has the same checks
            marks.append(pytest.mark.slow)
        for check in backend_checks(backend(name)):
            if name.startswith("lammps") and check.name == f"solves {TSUJI.label}":
                continue  # see below
            yield pytest.param(check, id=f"{name}-{check}".replace(" ", "-"), marks=marks)


@pytest.mark.parametrize("check", list(_of_catalogue()))
def test_a_backend_of_the_catalogue_passes(check: Check) -> None:
    check()


@pytest.mark.lammps
def test_the_check_of_tsuji_damping_finds_the_factor_that_the_engine_lacks() -> None:
    """LAMMPS 22 Jul 2025 lacks a factor sqrt(2) (lammps#5113); a release that has it passes, and ends this test."""
    [check] = [each for each in backend_checks(backend("lammps-granular")) if each.name == f"solves {TSUJI.label}"]
    with pytest.raises(AssertionError, match="velocity"):
        check()


def test_the_backend_with_closed_forms_passes() -> None:
    check_backend(ExactPair())


@pytest.mark.parametrize("name", BACKENDS)
def test_every_feature_is_solved_or_refused_by_name(name: str) -> None:
    names = [check.name for check in backend_checks(backend(name))]
    assert len(set(names)) == len(names)
    supported = backend(name).supports.features
    for feature in FEATURES:
        assert f"{'solves' if feature in supported else 'refuses'} {feature.label}" in names


# faults: each is found by the checks that are named, and by no other

Change = Callable[[Trajectory, Scene], Trajectory]


class Planted(ExactPair):
    """A backend whose answers are changed."""

    def __init__(self, change: Change) -> None:
        self.change = change

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        return self.change(super().run(scene, resolution, sampling), scene)


def planted(change: Change) -> Planted:
    return Planted(change)


def changed(**values: Any) -> Planted:
    """A backend with a member of another value."""
    found = planted(lambda run, scene: run)
    for name, value in values.items():
        setattr(found, name, value)
    return found


class Untrue(Support):
    """A declaration that refuses nothing."""

    def unsupported_reason(self, scene: Scene) -> str | None:
        return None


class Ignoring(ExactPair):
    """A backend that lists drag and ignores it."""

    supports = Support({*ExactPair.supports.features, DRAG}, exponents=Exponents(values=(2.0,)),
                       conditions=ExactPair.supports.conditions)  # fmt: skip

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        return super().run(replace(scene, drag=0.0), resolution, sampling)


class Theory(Ignoring):
    """... of other equations, so that no other code tells what drag does."""

    equations = "no drag"


class Deaf(ExactPair):
    """A backend that always gives 30 samples."""

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        return super().run(scene, resolution, Sampling(count=30))


class Hasty(ExactPair):
    """A backend that gives one sample more than it is asked for."""

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        return super().run(scene, resolution, Sampling(count=sampling.count + 1))


class Unstable(ExactPair):
    """A backend with a fixed step; ``broken``: what it does where that is too long."""

    def __init__(self, broken: Callable[[], float]) -> None:
        self.broken = broken

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        run = super().run(scene, resolution, sampling)
        stable = resolution.dt is None or resolution.dt < 0.1 * scene.duration
        return run if stable else replace(run, velocity=self.broken() * run.velocity)


class Heavier(ExactPair):
    """A backend that changes its scene."""

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        run = super().run(scene, resolution, sampling)
        object.__setattr__(scene, "mass", tuple(2.0 * mass for mass in scene.mass))
        return run


class Writing(ExactPair):
    """A backend that leaves a file behind."""

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        Path("log.txt").write_text("done")
        return super().run(scene, resolution, sampling)


class Random(ExactPair):
    """A backend whose last digits are chance."""

    generator = np.random.default_rng(1)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        run = super().run(scene, resolution, sampling)
        return replace(run, displacement=run.displacement * (1.0 + 1e-15 * self.generator.random()))


class Refusing(ExactPair):
    """A backend whose conditions exclude what it lists."""

    supports = Support({GAPS}, conditions=(Condition("no contact", lambda scene: "a contact" * scene.n_contact),))


def raises(error: Exception) -> float:
    raise error


def scaled(**factors: float) -> Planted:
    """A backend with quantities in other units."""
    return planted(lambda run, _: replace(run, **{name: f * getattr(run, name) for name, f in factors.items()}))


def first_velocity(run: Trajectory, scene: Scene) -> Trajectory:
    velocity = run.velocity.copy()
    velocity[0] *= 1.0 + 1e-12
    return replace(run, velocity=velocity)


def late(run: Trajectory, scene: Scene) -> Trajectory:
    return replace(run, time=np.linspace(0.0, scene.duration * (1.0 + 1e-12), len(run.time)))


def leaking(run: Trajectory, scene: Scene) -> Trajectory:
    """Momentum that grows by 1e-6 in the run, where there is a contact."""
    growth = 1.0 + 1e-6 * (run.time / scene.duration)[:, None] * (scene.n_contact > 0)
    return replace(run, velocity=growth * run.velocity)


def nan(run: Trajectory, scene: Scene) -> Trajectory:
    return replace(run, crossing_time=np.full_like(run.crossing_time, math.nan))


SOLVES = {"solves gaps", "solves initial overlaps", "solves bodies behind the first that move at the start",
          "solves exponents other than 5/2", "solves gravity"}  # fmt: skip
CONSERVING = SOLVES - {"solves gravity"}
FAULTS: dict[str, tuple[Callable[[], Any], set[str]]] = {
    "no name": (lambda: changed(name=""), {"declaration"}),
    "order 0": (lambda: changed(order=0), {"declaration"}),
    "available with a reason": (lambda: changed(availability=lambda: Availability(True, "why")), {"availability"}),
    "not available": (lambda: changed(availability=lambda: Availability(False, "no engine")), {"availability"}),
    "times to 1e-12": (lambda: planted(late), {"time axis"}),
    "start to 1e-12": (lambda: planted(first_velocity), {"start values"}),
    "another name in provenance": (
        lambda: planted(lambda run, _: replace(run, provenance={**run.provenance, "backend": "other"})),
        {"provenance"},
    ),
    "negative cost": (lambda: planted(lambda run, _: replace(run, cost=replace(run.cost, steps=-1))), {"cost"}),
    "one sample more": (Hasty, {"shapes", "time axis", "sampling", *SOLVES}),
    "fixed samples": (Deaf, {"sampling"}),
    "chance": (Random, {"determinism"}),
    "changes the scene": (Heavier, {"scene unchanged"}),
    "writes a file": (Writing, {"working directory"}),
    "division by zero": (lambda: Unstable(lambda: raises(ZeroDivisionError())), {"coarse resolution"}),
    "nan at a long step": (lambda: Unstable(lambda: math.nan), {"coarse resolution"}),
    "velocity in mm/s": (lambda: scaled(velocity=1e3), {"start values", "free flight", "two bodies", *SOLVES}),
    "displacement in mm": (lambda: scaled(displacement=1e3), {"free flight", *SOLVES}),
    "force in kN": (lambda: scaled(peak_force=1e-3), {"two bodies", *SOLVES}),
    "contact force of the other sign": (lambda: scaled(contact_force=-1.0), SOLVES),
    "crossing 3 % late": (lambda: scaled(crossing_time=1.03), {"two bodies", *SOLVES}),
    "no crossing": (lambda: planted(nan), {"two bodies", *SOLVES}),
    "momentum that grows by 1e-6": (lambda: planted(leaking), {"two bodies", *CONSERVING}),
    "peak 1e-9 off, and certain": (lambda: scaled(peak_force=1.0 + 1e-9), {"two bodies"}),
    "drag ignored": (Ignoring, {"solves drag"}),
    "drag ignored by a theory": (Theory, {"solves drag"}),
    "excludes what it lists": (Refusing, {"solves gaps"}),
}  # fmt: skip


def failures(found: Any) -> set[str]:
    """Names of the checks that fail; other errors are failures of the test."""
    said = {}
    for check in backend_checks(found):
        try:
            check()
        except AssertionError as error:
            said[check.name] = str(error)
    for name, sentence in said.items():
        assert sentence.startswith(f"{name}: ")
        assert "\n" not in sentence
    return set(said)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found_by_its_checks_alone(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # one of them writes where it runs
    made, names = FAULTS[fault]
    assert failures(made()) == names


def test_a_declaration_that_refuses_nothing_is_found() -> None:
    untrue = Untrue(ExactPair.supports.features, exponents=Exponents(values=(2.0,)))
    names = {check.name for check in backend_checks(changed(supports=untrue)) if check.name.startswith("refuses")}
    assert "refuses drag" in names
    for check in backend_checks(changed(supports=untrue)):
        if check.name in names:
            with pytest.raises(AssertionError, match="the scene is not refused"):
                check()


@pytest.mark.parametrize("values", [(-1e-9,), (math.nan,)])
def test_an_uncertainty_that_is_none_is_found(values: tuple[float]) -> None:
    bad = planted(lambda run, _: replace(run, uncertainty=replace(run.uncertainty, peak_force=np.array(values))))
    assert "uncertainty" in failures(bad)


def test_all_failures_are_listed_a_line_each() -> None:
    with pytest.raises(AssertionError) as caught:
        check_backend(changed(name="", availability=lambda: Availability(True, "why")))
    assert [line.split(":")[0] for line in str(caught.value).splitlines()] == ["declaration", "availability"]


def test_a_run_that_breaks_is_listed_with_the_error() -> None:
    class Broken(ExactPair):
        def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
            if GRAVITY in scene.features:
                raise RunBroken("it is too heavy")
            return super().run(scene, resolution, sampling)

    with pytest.raises(AssertionError, match=r"^solves gravity: RunBroken was raised: it is too heavy$"):
        check_backend(Broken())
