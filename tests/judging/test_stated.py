"""What a file states is compared before any fit, and what is wrong in all samples has a name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.formats.readers import read_record
from dem_bridge.judging.records import judge_records
from dem_bridge.judging.stated import statements, variant_of
from dem_bridge.observables.largest_step import StepError
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.judged_records import CHAIN, force, record

Samples = dict[str, Floats]
BOTH = ("velocity", "displacement")


def times(factor: float, *names: str) -> Callable[[Samples], None]:
    """Return a fault that multiplies quantities by a factor."""

    def change(samples: Samples) -> None:
        for name in names:
            samples[name] = factor * samples[name]

    return change


def columns(*order: int) -> Callable[[Samples], None]:
    """Return a fault that writes bodies in another order."""

    def change(samples: Samples) -> None:
        for name in BOTH:
            samples[name] = samples[name][:, list(order)]

    return change


#: fault -> the cause that names it and words of its evidence
FAULTS: dict[str, tuple[Callable[[Samples], None], str, str]] = {
    "all signs": (times(-1.0, *BOTH), "sign", "All velocities and displacements have the other sign"),
    "signs of velocities": (times(-1.0, "velocity"), "sign", "All velocities have the other sign"),
    "all zero": (times(0.0, *BOTH), "start-velocity", "All velocities and displacements of the file are 0."),
    "two swapped": (columns(0, 2, 1, 3, 4), "order-of-bodies", "body 1 of the file is body 2 of the scene"),
    "rotated": (columns(4, 0, 1, 2, 3), "order-of-bodies", "body 0 of the file is body 4 of the scene"),
    "velocities in percent": (times(1.01, "velocity"), "units", "All velocities of the file are 1.01 +- "),
    "feet": (times(1.0 / 0.3048, *BOTH), "units", "All velocities and displacements of the file are 3.2808"),
}


@pytest.mark.parametrize(("dt", "quantities"), [(1e-7, BOTH), (1e-6, ("velocity",))])
@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_in_all_samples_is_named(fault: str, dt: float, quantities: tuple[str, ...]) -> None:
    change, cause, words = FAULTS[fault]
    judgement = judge_records(CHAIN, [record(dt=dt, quantities=quantities, change=change)])
    assert (judgement.cause, judgement.outcome) == (cause, "FAIL")
    assert words in judgement.evidence or quantities == ("velocity",)


@pytest.mark.parametrize("dt", [1e-7, 2.5e-6])
@pytest.mark.parametrize("digits", [1e-17, 1e-6])
def test_another_start_velocity_is_stated_by_the_first_sample(dt: float, digits: float) -> None:
    faster = replace(CHAIN, velocity=(0.816, 0.0, 0.0, 0.0, 0.0))
    judgement = judge_records(CHAIN, [record(faster, dt=dt, quantities=BOTH, rounding=digits)])
    assert (judgement.cause, judgement.where) == ("start-velocity", "body 0")
    assert "Body 0 starts at 0.816 m/s, in the scene 0.8" in judgement.evidence
    # a factor on all velocities of a Hertz chain would leave the times of the contacts as they are
    assert "units" not in judgement.alternative_causes
    later = record(faster, dt=dt, quantities=BOTH, rounding=digits)
    later = replace(later, time=later.time[1:], values={k: v[1:] for k, v in later.values.items()},
                    rounding={k: v[1:] for k, v in later.rounding.items()})  # fmt: skip
    if dt < 1e-6:
        assert judge_records(CHAIN, [later]).cause == "start-velocity"


def test_springs_do_not_tell_a_start_velocity_from_a_factor() -> None:
    springs = Scene(name="springs", duration=2e-4, mass=CHAIN.mass, stiffness=(1e7, 1.2e7, 9e6, 1e7), exponent=2.0,
                    velocity=CHAIN.velocity, samples=40)  # fmt: skip
    run = db.solve(replace(springs, velocity=(0.808, 0.0, 0.0, 0.0, 0.0)), backend="verlet", dt=1e-7, uncertainty=False)
    file = replace(record(), time=run.time, values={"velocity": run.velocity}, columns={"velocity": (0, 1, 2, 3, 4)},
                   rounding={"time": np.zeros(41), "velocity": np.zeros((41, 5))}, dt=None)  # fmt: skip
    assert judge_records(springs, [file]).cause == "start-velocity"


def test_a_start_position_is_stated_by_the_first_sample() -> None:
    run = db.solve(replace(CHAIN, gap=(0.0, 2e-6, 0.0, 0.0)), backend="verlet", dt=1e-7, uncertainty=False)
    start = np.array([-2e-6, -2e-6, 0.0, 0.0, 0.0])
    for displacement, words in (
        (run.displacement + start, "starts at a displacement of -2e-06 m"),
        (db.solve(CHAIN, backend="verlet", dt=1e-7, uncertainty=False).displacement + start, "have another origin"),
    ):
        moved = {"displacement": displacement}
        if "origin" not in words:
            moved["velocity"] = run.velocity
        file = replace(record(), time=run.time, values=moved, columns=dict.fromkeys(moved, (0, 1, 2, 3, 4)), dt=None,
                       rounding={"time": np.zeros(41), **dict.fromkeys(moved, np.full((41, 5), 1e-16))})  # fmt: skip
        judgement = judge_records(CHAIN, [file])
        assert judgement.cause == "start-position"
        assert words in judgement.evidence


@pytest.mark.parametrize("rounding", [0.0, 1e-6])
def test_right_files_state_nothing(rounding: float) -> None:
    assert statements(CHAIN, record(rounding=rounding)) == []
    assert judge_records(CHAIN, [record(dt=2.5e-6, rounding=rounding)]).cause == "none"


# ---------------------------------------------------------------- what a deck states
WALLED = replace(CHAIN, wall_right=Wall(stiffness=4e9), damping=Damping(law="dashpot", coefficient=5.0, clip=True))


@pytest.mark.parametrize(
    ("stated", "causes", "where"),
    [
        ({"mass": tuple(1.03 * mass for mass in CHAIN.mass)}, ["mass"], ""),
        ({"mass": (8e-3, 1e-2, 1.3e-2, 1e-2, 1.1e-2)}, ["mass"], "body 2"),
        ({"velocity": (-0.8, 0.0, 0.0, 0.0, 0.0)}, ["sign"], ""),
        ({"velocity": (0.8, 0.0, 0.1, 0.0, 0.0)}, ["start-velocity"], "body 2"),
        (
            {"stiffness": tuple(1.1 * beta for beta in CHAIN.stiffness), "wall_right": Wall(stiffness=4.4e9)},
            ["stiffness-scale"],
            "",
        ),
        # the wall is as it was
        ({"stiffness": tuple(1.1 * beta for beta in CHAIN.stiffness)}, ["modulus"], ""),
        ({"stiffness": (4e9, 5.5e9, 4.5e9, 6e9)}, ["stiffness"], "contact 1"),
        ({"stiffness": (1.0, 1.0, 1.0, 1.0)}, ["missing-sqrt-radius"], ""),
        ({"gap": (0.0, 1e-6, 0.0, 0.0)}, ["start-position"], "contact 1"),
        ({"wall_right": None}, ["missed-contact"], "wall_right"),
        ({"wall_right": Wall(stiffness=5e9)}, ["stiffness"], "wall_right"),
        ({"wall_right": Wall(stiffness=4e9, gap=1e-6)}, ["start-position"], "wall_right"),
        ({"wall_left": Wall(stiffness=4e9)}, [""], ""),
        ({"exponent": 2.0, "stiffness": (1e6,) * 4}, ["exponent"], ""),
        ({"gravity": 9.81, "drag": 3.0}, ["gravity", ""], ""),
        ({"damping": None}, ["damping"], ""),
        ({"damping": Damping(law="dashpot", coefficient=5.0, clip=False)}, ["clip"], ""),
    ],
)
def test_each_difference_of_a_deck_has_a_cause(stated: dict[str, object], causes: list[str], where: str) -> None:
    # walls have the exponent of their scene
    stated = {
        name: replace(value, exponent=2.5) if isinstance(value, Wall) else value for name, value in stated.items()
    }
    said = statements(WALLED, replace(record(), stated=stated))
    assert ([each.cause for each in said], said[0].where) == (causes, where)
    assert variant_of(WALLED, said) is not None
    assert {name for each in said for name in each.changes} == set(stated)


def test_the_largest_of_several_differences_is_the_cause_and_all_are_said() -> None:
    other = replace(CHAIN, gravity=9.81, velocity=(0.9, 0.0, 0.0, 0.0, 0.0))
    file = record(replace(CHAIN, velocity=other.velocity), dt=1e-6)
    judgement = judge_records(CHAIN, [replace(file, stated={"velocity": other.velocity, "drag": 1e-9})])
    assert judgement.cause == "start-velocity"
    assert "the drag is 1e-09" in judgement.evidence
    # a difference without an effect beside the error of the step is none
    quiet = judge_records(CHAIN, [replace(record(dt=2.5e-6), stated={"mass": (8e-3 * (1 + 1e-7), *CHAIN.mass[1:])})])
    assert (quiet.cause, quiet.outcome) == ("none", "PASS")


@pytest.mark.parametrize("unit", ["%.17g", "%.6g"])
def test_masses_of_a_dump_are_stated(unit: str, tmp_path: Path) -> None:
    heavier = replace(CHAIN, mass=tuple(8100.0 / 7850.0 * mass for mass in CHAIN.mass))
    for scene, cause in ((heavier, "mass"), (CHAIN, "none")):
        run = record(scene, dt=2.5e-6)
        rows = []
        for nth, time in enumerate(run.time):
            rows += ["ITEM: TIME", repr(float(time)), "ITEM: TIMESTEP", str(2 * nth), "ITEM: NUMBER OF ATOMS", "5"]
            rows += ["ITEM: BOX BOUNDS ff pp pp", "-1 1", "-1 1", "-1 1", "ITEM: ATOMS id type mass x y z vx vy vz"]
            x, v = run.values["displacement"][nth], run.values["velocity"][nth]
            rows += [f"{k + 1} 1 {unit % scene.mass[k]} {0.02 * k + x[k]!r} 0 0 {v[k]!r} 0 0" for k in range(5)]
        path = tmp_path / "run.dump"
        path.write_text("\n".join(rows).replace("np.float64(", "").replace(")", "") + "\n")
        judgement = db.judge(path, CHAIN)
        assert judgement.cause == cause
        assert ("has a mass of" in judgement.evidence) is (cause == "mass")


# ---------------------------------------------------------------- two kinds that were unknown
@pytest.mark.parametrize("matched", [1e-6, 2e-5])
def test_an_exponent_whose_force_is_matched_at_one_overlap_is_named(matched: float) -> None:
    softer = replace(CHAIN, exponent=2.4, stiffness=tuple(beta * matched**0.1 for beta in CHAIN.stiffness))
    run = db.solve(softer, backend="verlet", dt=1e-7, uncertainty=False)
    file = replace(record(quantities=("velocity",)), time=run.time, values={"velocity": np.round(run.velocity, 9)},
                   rounding={"time": np.zeros(41), "velocity": np.full((41, 5), 5e-10)}, dt=1e-7)  # fmt: skip
    judgement = judge_records(CHAIN, [file])
    assert (judgement.cause, judgement.alternative_causes) == ("exponent", [])
    assert "The exponent n is 2.4 +- " in judgement.evidence
    # a factor on all stiffnesses is not an exponent
    stiffer = db.solve(replace(CHAIN, stiffness=tuple(1.02 * beta for beta in CHAIN.stiffness)), backend="verlet",
                       dt=1e-7, uncertainty=False)  # fmt: skip
    file = replace(file, values={"velocity": np.round(stiffer.velocity, 9)})
    assert "exponent" not in (judge_records(CHAIN, [file]).cause, *judge_records(CHAIN, [file]).alternative_causes)


def test_half_steps_of_a_coarse_long_table_are_named_by_its_step_numbers(tmp_path: Path) -> None:
    dt, every, rows = 1e-7, 200, 6
    x, v = np.zeros(5), np.array(CHAIN.velocity)
    table = ["iter,t,id,x,vx"]
    for step in range(every * (rows - 1) + 1):
        half = v + 0.5 * dt * force(CHAIN, x)[1] if step else v
        if step % every == 0:
            early = v - 0.5 * dt * force(CHAIN, x)[1] if step else v
            table += [f"{step},{step * dt:.9g},{k + 1},{0.02 * k + x[k]:.12g},{early[k]:.6g}" for k in range(5)]
        half = v + 0.5 * dt * force(CHAIN, x)[1]
        x = x + dt * half
        v = half + 0.5 * dt * force(CHAIN, x)[1]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(table) + "\n")
    file = read_record(path, CHAIN)
    # six times of one digit, which step numbers show to be exact
    assert file.dt == 1e-7
    assert float(np.max(file.rounding["time"])) < 1e-15
    judgement = db.judge(path, CHAIN)
    assert (judgement.cause, judgement.alternative_causes) == ("half-step-velocity", ["first-order-integrator"])


# ---------------------------------------------------------------- the error of the step
def test_the_step_of_an_answer_gives_the_errors_that_it_says() -> None:
    judgement = judge_records(CHAIN, [record(dt=2.5e-6)])
    step = judgement.diagnosis.step
    assert step is not None
    assert (step.dt, step.stated) == (2.5e-6, True)
    assert step.error == pytest.approx(judgement.error["velocity"]["value"] / 0.8, rel=1e-3)
    for target in (1e-2, 1e-3):
        # a step that divides the samples, near the one that is said
        count = round(5e-6 / step.largest_for(target))
        other = record(dt=5e-6 / count)
        error = judge_records(CHAIN, [other]).error["velocity"]
        expected = target * (5e-6 / count / step.largest_for(target)) ** 2
        assert error["value"] / error["scale"] == pytest.approx(expected, rel=0.4)


def test_a_single_step_gives_no_other() -> None:
    assert np.isnan(StepError(dt=1e-6, stated=True, curve=((1e-6, 1e-3),)).largest_for(1e-2))
    assert np.isnan(StepError(dt=1e-6, stated=True, curve=((1e-6, 1e-3), (2e-6, 1e-3))).largest_for(1e-2))
