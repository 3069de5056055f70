"""Planted faults are named, right files are not, and what is outside the list stays unknown."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.formats.readers.record import Record
from dem_bridge.judging.cause import diagnose
from dem_bridge.judging.diagnosis import CAUSES, PRIORITY
from dem_bridge.judging.fitting import Stepping
from dem_bridge.judging.kernels import RK4, VERLET
from dem_bridge.judging.model import Model, system_of
from dem_bridge.judging.records import judge_records
from dem_bridge.judging.samples import half_steps
from dem_bridge.judging.search import Search
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.scene import Damping, Scene, Wall

SCENE = Scene(
    name="five",
    duration=2.5e-4,
    mass=(8e-3, 1e-2, 1.1e-2, 9e-3, 1e-2),
    stiffness=(4e9, 5e9, 6e9, 5e9),
    velocity=(0.8, 0.0, 0.0, 0.0, 0.0),
    wall_right=Wall(stiffness=4e9),
)
ROWS, STEPS = 101, 25


def accelerations(x: np.ndarray, v: np.ndarray, numbers: dict[str, np.ndarray]) -> np.ndarray:
    """Return the accelerations of a chain with a wall on its right: a writing of its own, in plain numpy."""
    overlap = x - np.append(x[1:], 0.0)
    closed = np.maximum(overlap, 0.0)
    force = numbers["stiffness"] * closed ** numbers["power"] + numbers["dashpot"] * (v - np.append(v[1:], 0.0)) * (
        overlap > 0.0
    )
    force = np.maximum(force, 0.0)
    return np.asarray((np.append(0.0, force[:-1]) - force) / numbers["mass"] + numbers["gravity"])


def record_of(
    *, digits: int = 9, dt_stated: bool = True, half: bool = False, single: bool = False, **changes: object
) -> Record:
    """Return the file of a velocity-Verlet code that runs SCENE with changed numbers, perhaps in single precision."""
    numbers = {
        "mass": np.array(SCENE.mass),
        "stiffness": np.array([*SCENE.stiffness, 4e9]),
        "power": np.full(5, 1.5),
        "dashpot": np.zeros(5),
        "gravity": np.zeros(5),
        **{name: np.asarray(value, dtype=float) for name, value in changes.items()},
    }
    time = np.linspace(0.0, SCENE.duration, ROWS)
    dt = SCENE.duration / (ROWS - 1) / STEPS
    # the first body starts at the origin
    origin = np.float32(0.018 * np.arange(5)).astype(float)
    x, v = np.zeros(5), np.array(SCENE.velocity)
    a, out = accelerations(x, v, numbers), [(x.copy(), v.copy())]
    for _ in range(ROWS - 1):
        for _ in range(STEPS):
            v = v + 0.5 * dt * a
            x, early = x + dt * v, v
            a = accelerations(x, v, numbers)
            v = v + 0.5 * dt * a
            if single:
                x, v = np.float32(x + origin) - origin, np.float32(v).astype(float)
        out.append((x.copy(), (early if half else v).copy()))
    values = {
        name: np.array(part) for name, part in zip(("displacement", "velocity"), zip(*out, strict=True), strict=True)
    }
    rounding = {"time": np.zeros(ROWS)}
    for name, data in values.items():
        unit = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(data), 1e-300))) + 1 - digits)
        values[name], rounding[name] = np.rint(data / unit) * unit, 0.5 * unit
    columns = dict.fromkeys(values, tuple(range(5)))
    return Record(
        name="file", time=time, values=values, columns=columns, rounding=rounding, dt=dt if dt_stated else None
    )


def changed(values: tuple[float, ...], index: int, factor: float) -> list[float]:
    """Return the values with a factor on one."""
    return [factor * value if i == index else value for i, value in enumerate(values)]


STIFFNESS = (*SCENE.stiffness, 4e9)


def test_the_model_is_the_twin_at_each_step_and_the_reference_without() -> None:
    for scene in (SCENE, Scene(**{**FIELDS, "damping": Damping(law="dashpot", coefficient=5.0)})):
        model, time = Model(scene), np.linspace(0.0, scene.duration, 51)
        backend = "reference" if scene.damping is None else "scipy"
        run = db.solve(scene, backend=backend, samples=50, uncertainty=False)
        motion = model.exact(model.system, time, 1e-13)
        # straight through the contacts; a dashpot's force jumps at touch
        assert np.max(np.abs(motion.velocity - run.velocity)) < 1e-8
        assert np.max(np.abs(motion.displacement - run.displacement)) < 1e-12
        # at the start bodies touch without an overlap, and whether a dashpot acts there is a convention
        assert np.max(np.abs(motion.force[1:, 1:] - run.contact_force[1:])) < 1e-4
        twin = db.solve(scene, backend="verlet", dt=1e-7, samples=50, uncertainty=False)
        steps = np.arange(51) * 50
        stepped = model.stepped(model.system, steps, scene.duration / 2500, VERLET)
        assert np.max(np.abs(stepped.velocity - twin.velocity)) < 1e-12
        # forces of some hundred newtons; those of a dashpot are of the velocities half a step before
        assert np.max(np.abs(stepped.force[1:, 1:] - twin.contact_force[1:])) < 1e-8


FIELDS = {name: getattr(SCENE, name) for name in ("name", "duration", "mass", "stiffness", "velocity", "wall_right")}


def test_between_steps_the_motion_is_interpolated() -> None:
    model, time = Model(SCENE), np.linspace(0.0, SCENE.duration, 51)
    exact = model.exact(system_of(SCENE), time, 1e-13)
    between = model.stepped_at(model.system, time, SCENE.duration / 2345.6, RK4)
    # Hermite's error at a 300th of a contact time; RK4 at a kink
    assert np.max(np.abs(between.velocity - exact.velocity)) < 1e-6
    assert np.max(np.abs(between.displacement - exact.displacement)) < 1e-12


def test_every_cause_has_a_priority() -> None:
    assert set(PRIORITY) == set(CAUSES) - {"unknown", "single-precision", "wrong-scene"}


@pytest.mark.parametrize("dt_stated", [True, False])
def test_a_right_file_has_no_cause(dt_stated: bool) -> None:
    record = record_of(dt_stated=dt_stated)
    assert diagnose(SCENE, [record]).cause == "none"
    # the method and its step are found from the error: it is far above the digits
    search = Search(SCENE, record, {})
    assert float(np.max(search.errors)) > 5e-6


FAULTS = {
    "mass": ({"mass": changed(SCENE.mass, 2, 1.02)}, "body 2"),
    "stiffness": ({"stiffness": changed(STIFFNESS, 1, 0.97)}, "contact 1"),
    "missed-contact": ({"stiffness": changed(STIFFNESS, 2, 0.0)}, "contact 2"),
    "stiffness-scale": ({"stiffness": 1.03 * np.array(STIFFNESS)}, ""),
    "exponent": ({"power": np.full(5, 1.49)}, ""),
    "damping": ({"dashpot": np.full(5, 2.0)}, ""),
    "gravity": ({"gravity": np.full(5, 9.81)}, ""),
    "half-step-velocity": ({"half": True}, ""),
}


@pytest.mark.parametrize("cause", FAULTS)
def test_a_planted_fault_is_named_with_its_place(cause: str) -> None:
    changes, where = FAULTS[cause]
    diagnosis = diagnose(SCENE, [record_of(**changes)])  # type: ignore[arg-type]
    assert diagnosis.cause == cause
    assert diagnosis.where == where
    if cause == "missed-contact":
        assert "stiffness" in diagnosis.alternatives
    if cause == "stiffness-scale":
        assert {"mass", "modulus"} <= set(diagnosis.alternatives)
        assert "missing-sqrt-radius" not in diagnosis.alternatives  # the scene has no radii
    if cause == "mass":
        value, deviation = diagnosis.parameters["value"]
        assert abs(value - 1.02) < max(5.0 * deviation, 1e-7)
        assert "The mass of body 2 is 1.02" in diagnosis.evidence


def test_samples_of_other_times_units_and_orders_are_named() -> None:
    record = record_of()
    fields = {name: getattr(record, name) for name in ("name", "time", "values", "columns", "rounding", "dt")}

    def with_values(factor: float = 1.0, step: int = 1, late: int = 0) -> Record:
        values = {name: factor * np.roll(data[:, ::step], late, axis=0)[late:] for name, data in record.values.items()}
        rounding = {name: np.abs(factor) * data[late:] for name, data in record.rounding.items()}
        return Record(**{**fields, "values": values, "rounding": rounding, "time": record.time[late:]})

    assert diagnose(SCENE, [with_values(1e3)]).cause == "units"
    assert diagnose(SCENE, [with_values(step=-1)]).cause == "order-of-bodies"
    late = diagnose(SCENE, [with_values(late=1)])
    assert late.cause == "sampling-shift"
    assert "time-shift" in late.alternatives


def test_a_step_that_is_stated_in_another_unit_than_the_times_is_believed() -> None:
    record = record_of(digits=15)
    scaled = replace(record, time=1.3279 * record.time)
    assert diagnose(SCENE, [scaled]).cause == "time-scale"


@pytest.mark.parametrize("quantities", [("displacement", "velocity"), ("velocity",)])
def test_single_precision_is_seen_by_the_grid_of_the_values(quantities: tuple[str, ...]) -> None:
    def partial(record: Record) -> Record:
        return replace(record, values={name: record.values[name] for name in quantities})

    assert diagnose(SCENE, [partial(record_of(digits=12, single=True))]).cause == "single-precision"
    # faults in double precision are on no grid
    two = {"mass": changed(SCENE.mass, 1, 1.02), "stiffness": changed(STIFFNESS, 3, 0.97)}
    assert diagnose(SCENE, [partial(record_of(digits=12, **two))]).cause == "mass"  # type: ignore[arg-type]


def test_values_of_an_unstable_step_have_no_cause() -> None:
    record = record_of()
    grown = {name: data * 10.0 ** np.linspace(0.0, 40.0, ROWS)[:, None] for name, data in record.values.items()}
    diagnosis = diagnose(SCENE, [replace(record, values=grown)])
    assert diagnosis.cause == "unknown"
    assert "unstable step" in diagnosis.evidence


def test_two_faults_are_told_and_a_small_one_has_no_wrong_name() -> None:
    two = {"mass": changed(SCENE.mass, 1, 1.02), "stiffness": changed(STIFFNESS, 3, 0.97)}
    both = diagnose(SCENE, [record_of(**two)])  # type: ignore[arg-type]
    assert {(fault.cause, fault.where) for fault in both.faults} == {("mass", "body 1"), ("stiffness", "contact 3")}
    assert (both.cause, both.where) == (both.faults[0].cause, both.faults[0].where)
    assert "The mass of body 1 is 1.02 +-" in both.evidence
    assert "The stiffness of contact 3 is 0.97 +-" in both.evidence
    small = {"mass": changed(SCENE.mass, 2, 1.0 + 2e-5)}
    assert diagnose(SCENE, [record_of(digits=6, **small)]).cause in ("mass", "unknown", "none")  # type: ignore[arg-type]


def test_a_method_of_another_step_does_not_explain() -> None:
    search = Search(SCENE, record_of(), {})
    right = Stepping(VERLET, float(search.data.dt or 0.0))
    residuals = [
        float(np.sqrt(np.mean(search.data.residual(search.data.predict(search.base, ROWS, 1e-13, stepping)) ** 2)))
        for stepping in (right, Stepping(VERLET, 1.01 * right.dt))
    ]
    assert residuals[0] < 1.2
    assert residuals[1] > 50.0


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (1.0 - 0.2**2, "modulus"),  # E in place of E/(1 - nu^2)
        (math.sqrt(1.0 / 0.01), "missing-sqrt-radius"),  # the effective radius, 10 mm
        (1.3, "stiffness-scale"),
    ],
)
def test_a_factor_on_the_stiffness_has_the_name_of_what_makes_it(factor: float, cause: str) -> None:
    text = """
name = "glass-pair"
[impact]
radius = [0.02, 0.02]
youngs_modulus = 48e9
poissons_ratio = 0.20
density = 2800.0
speed = 2.0
[sampling]
count = 60
"""
    scene = parse_scene(text)
    wrong = replace(scene, stiffness=tuple(factor * beta for beta in scene.stiffness), geometry=None)
    run = db.solve(wrong, backend="reference", uncertainty=False)
    nothing = {"time": np.zeros(61), "velocity": np.full((61, 2), 1e-15)}
    columns = {"velocity": (0, 1)}
    record = Record(name="f", time=run.time, values={"velocity": run.velocity}, columns=columns, rounding=nothing)
    assert judge_records(scene, [record]).cause == cause


def test_a_law_that_is_a_function_has_no_hypotheses() -> None:
    scene = Scene(name="law", duration=1e-4, mass=(1.0, 1.0), stiffness=(1e9,), velocity=(1.0, 0.0),
                  law=lambda overlap: 1e9 * overlap**1.5)  # fmt: skip
    found = diagnose(scene, [])
    assert (found.cause, found.evidence) == (
        "unknown", "Hypotheses are not available for contact laws that are functions.",
    )  # fmt: skip


def test_steps_beyond_all_counting_are_no_hypotheses() -> None:
    data: Any = SimpleNamespace(model=SimpleNamespace(system=None), dt=1e-30, interval=1e-6, time=np.array([0.0, 1e-3]))
    assert list(half_steps(data, 1e-7)) == []
