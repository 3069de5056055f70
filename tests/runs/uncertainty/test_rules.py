"""The rules for runs with a fixed step: each part by hand, and the fault in the rules that it catches."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.runs.uncertainty import fixed_step, grazes
from dem_bridge.runs.uncertainty import from_replicas as replicas
from dem_bridge.runs.uncertainty.fixed_step import (
    TwinFamily,
    fixed_step_uncertainty,
    roundoff_part,
    sampled_uncertainty,
    summation_part,
)
from dem_bridge.runs.uncertainty.moments import Moments
from dem_bridge.runs.uncertainty.run_differences import absolute_differences
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import QUANTITIES
from tests.helpers.twin_families import OWN, PLAN, changed, family, moment, there

EPS = float(np.finfo(float).eps)
#: 1e9 steps, so that their sums show
LONG = Schedule(step=1e-9, per_sample=250_000_000, subdivisions=10, samples=4)


BASE = family()
#: the first contact has no force, and never crosses
NEVER = replace(OWN, peak_force=np.array([0.0, 20.0]), crossing_time=np.array([math.nan, 0.2]))


@dataclass(frozen=True)
class Part:
    """A family, and by how much its uncertainty exceeds that of runs that agree in everything."""

    family: TwinFamily
    velocity: float = 0.0
    displacement: float = 0.0
    peak_force: Any = (0.0, 0.0)
    crossing_time: Any = (0.0, 0.0)
    summed: float | None = None
    base: TwinFamily = BASE


#: factors between differences and uncertainties by the step: 3/(4 - 1), 3/(1 - 1/9); of first order 3/(2 - 1),
#: 3/(1 - 1/3)
PARTS: dict[str, Part] = {
    "time step, by the coarser run": Part(
        family(others={2.0: changed(velocity=0.3, displacement=0.5), 1 / 3: changed(velocity=0.08)}),
        velocity=0.3, displacement=0.5,
    ),
    "time step, by the finer run": Part(
        family(others={2.0: changed(velocity=0.3), 1 / 3: changed(velocity=0.16)}), velocity=27 / 8 * 0.16
    ),
    "time step, of first order": Part(
        family(order=1, others={2.0: changed(velocity=0.1), 1 / 3: changed(velocity=0.06)}), velocity=0.3
    ),
    # of its own force the first contact differs by nothing, the second by 0.2: their median is 0.1
    "time step, of forces that agree by chance": Part(
        family(others={2.0: changed(peak_force=np.array([0.0, 4.0])), 1 / 3: OWN}), peak_force=(1.0, 4.0)
    ),
    "time step, of times that agree by chance": Part(
        family(others={2.0: changed(crossing_time=np.array([0.0, 0.02])), 1 / 3: OWN}), crossing_time=(0.01, 0.02)
    ),
    "time step, of runs that scatter": Part(
        family(scatter=6.0, order=4, others={1 / 2: changed(velocity=0.01), 1 / 3: changed(velocity=0.02)}),
        velocity=3.0 / (1.0 - 3.0**-4) * 0.02 + 6.0 * 0.01,
    ),
    "round-off": Part(
        family(positional=changed(velocity=1e-3, peak_force=0.1, crossing_time=1e-3)),
        velocity=3e-3, peak_force=(0.3, 0.3), crossing_time=(3e-3, 3e-3),
    ),
    "round-off, with tables": Part(
        family(tabled=changed(velocity=0.01), positional=changed(velocity=0.012)), velocity=2 * 0.01 + 3 * 0.002
    ),
    "tables": Part(
        family(tabled=changed(velocity=0.01, peak_force=1.0), positional=changed(velocity=0.01, peak_force=1.0)),
        velocity=0.02, peak_force=(2.0, 2.0),
    ),
    "laws that are functions": Part(family(halved=changed(velocity=0.01)), velocity=0.02),
    "summation over steps": Part(
        family(plan=LONG), velocity=0.5e9 * EPS * 3.0, displacement=0.5e9 * EPS * 3.0,
    ),
    "summation over contacts": Part(family(), summed=1e9, peak_force=(EPS * 1e9, EPS * 1e9)),
    "thinning": Part(
        family(thinned=(OWN.peak_force + np.array([1.0, 0.0]), OWN.crossing_time + np.array([0.0, 0.01]))),
        peak_force=(0.5, 0.0), crossing_time=(0.0, 0.005),
    ),
    "secondary peak force": Part(family(secondary=(15.0, 5.0)), peak_force=(5.0, 0.0)),
    "secondary peak force, where velocities are uncertain": Part(
        family(secondary=(15.0, 5.0), others={2.0: changed(velocity=0.3), 1 / 3: OWN}),
        velocity=0.3, peak_force=(15.0 * 1.1 - 10.0, 0.0),
    ),
    "unresolved contact": Part(family(unresolved=(True, False)), crossing_time=(math.inf, 0.0)),
    # it turned 1 mm before touch, and the runs at other steps turned 1 mm and 0.8 mm nearer or farther: 3 mm too deep
    # at most, less the 1 mm: 100 N/m times 1.7 mm. Bodies of 2 and 4 kg meet for the root of 8 * 1.7 mm over 3.4 m/s^2
    "undetected graze": Part(
        family(
            others={2.0: changed(displacement=0.01), 1 / 3: OWN},
            moments=moment(0, 0.05, overlap=-1e-3, bend=3.4),
            elsewhere={2.0: there(-2e-3), 1 / 3: there(-1.8e-3)},
        ),
        displacement=0.01 + 0.17 * math.sqrt(8 * 1.7e-3 / 3.4) / 2.0,
        velocity=0.17 * math.sqrt(8 * 1.7e-3 / 3.4) / 2.0,
        peak_force=(0.17, 0.0),
        crossing_time=(math.inf, 0.0),
    ),
    "graze after the first compression": Part(
        family(
            others={2.0: changed(displacement=0.01), 1 / 3: OWN},
            moments=moment(0, 0.15, overlap=-1e-3, bend=3.4),
            elsewhere={2.0: there(-2e-3), 1 / 3: there(-1.8e-3)},
        ),
        displacement=0.01 + 0.17 * math.sqrt(8 * 1.7e-3 / 3.4) / 2.0,
        velocity=0.17 * math.sqrt(8 * 1.7e-3 / 3.4) / 2.0,
        peak_force=(0.17, 0.0),
    ),
    "turn too far from touch": Part(
        family(
            others={2.0: changed(displacement=1e-4), 1 / 3: OWN},
            moments=moment(0, 0.05, overlap=-1e-3, bend=3.4),
            elsewhere={2.0: there(-1.1e-3), 1 / 3: there(-1e-3)},
        ),
        displacement=1e-4,
    ),
    # it comes to rest 1 mm before touch when the run ends; 1.7 mm deep at 0.3 m/s at most, since 0.1 s
    "end of the run near touch": Part(
        family(
            main=NEVER, positional=NEVER, others={2.0: NEVER, 1 / 3: NEVER},
            moments=moment(0, 1.0, overlap=-1e-3, bend=0.0, last=True, speed=0.3, lasting=0.1),
            elsewhere={2.0: there(-2e-3), 1 / 3: there(-1.8e-3)},
        ),
        velocity=0.17 * 0.1 / 2.0, displacement=0.17 * 0.1 / 2.0 * 0.1,
        peak_force=(0.17, 0.0), crossing_time=(math.inf, 0.0),
        base=family(main=NEVER, positional=NEVER, others={2.0: NEVER, 1 / 3: NEVER}),
    ),
    # a closing rate of 0.1 m/s that is uncertain by as much and more may fall to zero, one of 0.5 m/s may not
    "first maximum that may be earlier": Part(
        family(moments=moment(0, 0.05, overlap=0.1, rate=0.1, bend=-1.0, touches=False, felt=True, stops=True),
               elsewhere={2.0: there(0.1, 0.22), 1 / 3: there(0.1, 0.1)}),
        crossing_time=(math.inf, 0.0),
    ),
    # a touch of 12 N where the run has one, and a peak force of 10 N: 2 N more, and an impulse that its runs differ by
    "touch that may be deeper": Part(
        family(
            moments=moment(0, 0.15, overlap=0.06, bend=10.0, felt=True, speed=4.0),
            elsewhere={2.0: there(0.0), 1 / 3: there(0.06)},
        ),
        peak_force=(2.0, 0.0),
    ),
    "contact at rest": Part(
        family(
            moments=moment(
                0, 0.05, overlap=0.1, rate=0.1, bend=-1.0, touches=False, felt=True, stops=True, fastest=0.11
            ),
            elsewhere={2.0: there(0.1, 0.22), 1 / 3: there(0.1, 0.1)},
        ),
    ),
    "bodies that fly in touch": Part(
        family(
            moments=moment(0, 0.05, overlap=-1e-3, bend=3.4, speed=1e-15),
            elsewhere={2.0: there(-2e-3), 1 / 3: there(-1.8e-3)},
        ),
    ),
    "closing that goes on": Part(
        family(moments=moment(0, 0.05, overlap=0.1, rate=0.5, bend=-1.0, touches=False, felt=True, stops=True),
               elsewhere={2.0: there(0.1, 0.62), 1 / 3: there(0.1, 0.5)}),
    ),
    # crossings at 0.1 and 0.2 s that are uncertain by 0.45 and 0.9 s, in a run of 1 s
    "first maximum that may be after the end": Part(
        family(others={2.0: changed(crossing_time=np.array([0.0, 0.9])), 1 / 3: OWN}), crossing_time=(0.45, math.inf)
    ),
}  # fmt: skip


def _misses(part: Part) -> dict[str, Any]:
    """Quantities whose uncertainty is not that by hand."""
    found, base = fixed_step_uncertainty(part.family, part.summed), fixed_step_uncertainty(part.base)
    misses = {}
    for name in QUANTITIES:
        wanted = base[name] + np.asarray(getattr(part, name))
        # last digits of 400 steps, and 1e-10 of a peak force, are below this
        if not np.allclose(found[name], wanted, rtol=1e-6, atol=1e-8):
            misses[name] = (found[name], wanted)
    return misses


@pytest.mark.parametrize("name", PARTS)
def test_a_part_is_as_by_hand(name: str) -> None:
    assert _misses(PARTS[name]) == {}


@pytest.mark.parametrize(("summed", "forces"), [(None, 20.0), (0.0, 80.0), (5.0, 85.0)])
def test_running_sums_of_forces_lose_the_last_digits_of_all_their_terms(summed: float | None, forces: float) -> None:
    found = summation_part(family(), summed)
    # the largest force of 20 N, four times in a sum of net forces; half a digit at each of 400 steps of 3 m/s and 3 m
    lost = {"velocity": 600.0 * EPS, "displacement": 600.0 * EPS, "peak_force": EPS * forces, "crossing_time": 0.0}
    assert found == pytest.approx(lost, rel=1e-12, abs=0.0)
    displacement = sampled_uncertainty(family())["displacement"]
    assert displacement == pytest.approx((60.0 + 200.0) * EPS * 3.0, rel=1e-9, abs=0.0)


def test_round_off_counts_thrice_with_a_walk_of_its_last_digit() -> None:
    found = roundoff_part(family(), dict.fromkeys(QUANTITIES, 0.0))
    # 400 steps walk by 20 digits: of 3 m/s and 3 m, and of each contact's own force and time
    assert (found["velocity"], found["displacement"]) == pytest.approx((180.0 * EPS, 180.0 * EPS), rel=1e-12, abs=0.0)
    assert found["peak_force"] == pytest.approx([600.0 * EPS, 1200.0 * EPS], rel=1e-12, abs=0.0)
    assert found["crossing_time"] == pytest.approx([6.0 * EPS, 12.0 * EPS], rel=1e-12, abs=0.0)


def test_runs_that_agree_leave_last_digits_and_the_error_of_reading() -> None:
    found = fixed_step_uncertainty(family())
    # three random walks of 400 last digits, and half a last digit at each of them
    assert found["velocity"] == found["displacement"] == pytest.approx((3 * 20 + 200) * EPS * 3.0, rel=1e-9, abs=0.0)
    assert found["peak_force"] == pytest.approx([1e-9 + 620 * EPS, 2e-9 + 1220 * EPS], rel=1e-9, abs=0.0)
    assert found["crossing_time"] == pytest.approx([2.5e-5 * 0.025] * 2, rel=1e-6)
    assert found.parts["last_digit"] == 20 * EPS
    assert found.roundoff_floor == 0.0


def test_the_parts_of_the_velocity_are_relative_to_the_largest_and_add_up() -> None:
    found = fixed_step_uncertainty(
        family(
            others={2.0: changed(velocity=0.3), 1 / 3: OWN},
            tabled=changed(velocity=0.03),
            halved=changed(velocity=0.06),
            positional=changed(velocity=0.06),
        )
    )
    assert found.parts["time_step"] == pytest.approx(0.1)
    assert found.parts["table"] == pytest.approx(2 * (0.01 + 0.02))
    assert found.parts["round_off"] == pytest.approx(3 * 0.01)
    assert found.roundoff_floor == pytest.approx(0.01)
    total = sum(found.parts[name] for name in ("time_step", "round_off", "table", "summation"))
    assert found["velocity"] == pytest.approx(3.0 * total)


def test_the_part_by_thinning_is_relative_to_the_scale_of_each_contact() -> None:
    found = fixed_step_uncertainty(
        family(thinned=(OWN.peak_force + np.array([1.0, 0.0]), OWN.crossing_time + np.array([0.0, 0.01])))
    )
    assert dict(found.sampling) == pytest.approx(
        {"velocity": 0.0, "displacement": 0.0, "peak_force": 0.05, "crossing_time": 0.025}
    )


def test_where_dense_samples_are_too_few_nothing_between_them_is_known() -> None:
    found = fixed_step_uncertainty(family(plan=replace(PLAN, resolved=False)))
    assert np.all(np.isinf(found["peak_force"]))
    assert np.all(np.isinf(found["crossing_time"]))
    assert math.isfinite(found["velocity"])


def test_the_uncertainty_that_decides_what_is_undecided_is_that_of_samples() -> None:
    for part in PARTS.values():
        if part.family.readings.moments is None:
            found = fixed_step_uncertainty(part.family)
            assert sampled_uncertainty(part.family) == {name: found[name] for name in ("velocity", "displacement")}


def test_a_scene_at_rest_has_no_relative_parts() -> None:
    rest = replace(OWN, velocity=0.0 * OWN.velocity, displacement=0.0 * OWN.displacement)
    still = family(main=rest, others={2.0: rest, 1 / 3: rest}, positional=rest)
    found = fixed_step_uncertainty(still)
    assert found["velocity"] == 0.0
    assert found.parts["time_step"] == found.parts["round_off"] == found.parts["last_digit"] == 0.0


def _without_tables(family: TwinFamily) -> Any:
    return absolute_differences(family.main, family.positional)


def _of_second_order(family: TwinFamily) -> dict[float, float]:
    return {ratio: 3.0 / abs(ratio**2 - 1.0) for ratio in family.others}


def _without_doubt(family: TwinFamily) -> grazes.Doubt:
    none = np.zeros(len(family.readings.moments or ()))
    return grazes.Doubt(none, none)


def _without_rest(total: Any, scene: Scene, run: Any, moments: Moments, *about: Any) -> Any:
    lively = replace(moments, speed=np.maximum(moments.speed, 0.2), fastest=moments.fastest + 1.0)
    return WIDEN(total, scene, run, lively, *about)


WIDEN = grazes.widen_for_moments
NO_TOUCH = grazes._Touch(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1, dtype=bool))
TIME_STEP = {name for name in PARTS if name.startswith("time step")}
GRAZES = {
    "undetected graze",
    "graze after the first compression",
    "end of the run near touch",
    "touch that may be deeper",
}
MOMENTS = GRAZES | {"first maximum that may be earlier"}
LATE = "first maximum that may be after the end"
#: what is planted in the rules -> where, and the parts that must miss; all others must be as they are
FAULTS: dict[str, tuple[Any, str, Any, set[str]]] = {
    "an error of the step is taken as it is": (
        fixed_step, "STEP_SAFETY", 1.0,
        TIME_STEP | MOMENTS | {"secondary peak force, where velocities are uncertain", "turn too far from touch", LATE},
    ),
    "all runs are of second order": (
        fixed_step, "step_safety", _of_second_order,
        {"time step, of first order", "time step, of runs that scatter"},
    ),
    "two runs that agree by chance are believed": (
        fixed_step, "at_least_the_median", lambda values, scale: values,
        {"time step, of forces that agree by chance", "time step, of times that agree by chance", LATE},
    ),
    "one realisation of round-off stands for all": (
        fixed_step, "REALISATIONS", 1.0, {"round-off", "round-off, with tables"},
    ),
    "round-off is told from the laws where there are tables": (
        fixed_step, "roundoff_differences", _without_tables, {"round-off, with tables", "tables"},
    ),
    "tables err by what the twins differ, once": (
        fixed_step, "TABLE_SAFETY", 1.0, {"round-off, with tables", "tables", "laws that are functions"},
    ),
    "sums are exact": (
        fixed_step, "_EPSILON", 0.0, {"summation over steps", "summation over contacts"},
    ),
    "the largest collision is believed": (
        fixed_step, "secondary_peak_part", lambda family, velocity: 0.0,
        {"secondary peak force", "secondary peak force, where velocities are uncertain"},
    ),
    "reading loses nothing": (
        fixed_step, "reading_part",
        lambda family: (dict.fromkeys(QUANTITIES, 0.0), {"peak_force": np.zeros(2), "crossing_time": np.zeros(2)}),
        {"thinning"},
    ),
    "all moments are decided": (fixed_step, "widen_for_moments", lambda total, *about: total, MOMENTS),
    "the runs at other steps have the same at a moment": (fixed_step, "doubt_at_moments", _without_doubt, MOMENTS),
    "all moments are as unsure as the largest error": (
        fixed_step, "doubt_at_moments", lambda family: grazes.Doubt(np.ones(1), np.ones(1)),
        MOMENTS - {"first maximum that may be earlier"} | {"turn too far from touch", "closing that goes on"},
    ),
    "all that is undecided counts": (
        fixed_step, "widen_for_moments", _without_rest, {"contact at rest", "bodies that fly in touch"},
    ),
    "no touch is felt": (grazes, "_touches", lambda *about: NO_TOUCH, GRAZES),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_a_rule_is_caught_by_its_part_and_by_no_other(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, name, planted, caught = FAULTS[fault]
    bases = {each: fixed_step_uncertainty(part.base) for each, part in PARTS.items()}
    monkeypatch.setattr(module, name, planted)
    missed = set()
    for each, part in PARTS.items():
        found = fixed_step_uncertainty(part.family, part.summed)
        for quantity in QUANTITIES:
            wanted = bases[each][quantity] + np.asarray(getattr(part, quantity))
            if not np.allclose(found[quantity], wanted, rtol=1e-6, atol=1e-6 * (quantity == "crossing_time") + 1e-8):
                missed.add(each)
    assert missed == caught


def test_every_part_is_caught_by_a_fault() -> None:
    caught: set[str] = set().union(*(parts for *_, parts in FAULTS.values()))
    assert set(PARTS) - caught == {"unresolved contact"}  # tests/runs/uncertainty/test_grazes.py


@pytest.mark.parametrize("mass", [(2.0, 4.0), (4.0, 2.0)])
def test_a_graze_moves_the_lighter_body(mass: tuple[float, float]) -> None:
    base = BASE.scene.mass[2:]
    scene = replace(BASE.scene, mass=(*mass, *base))
    turn, doubt = moment(0, 0.05, overlap=-1e-3, bend=3.4), grazes.Doubt(np.array([1.2e-3]), np.zeros(1))
    found = grazes.widen_for_moments(dict.fromkeys(QUANTITIES, 0.0), scene, BASE.main, turn, doubt)
    deepest = 1.2e-3 - 1e-3
    force = float(scene.contacts.force(np.array([deepest]), np.array([0]))[0])
    assert found["peak_force"] == pytest.approx([force, 0.0], rel=1e-12)
    kick = force * math.sqrt(8 * deepest / 3.4) / 2.0
    assert found["velocity"] == pytest.approx(kick, rel=1e-12)
    assert found["displacement"] == pytest.approx(kick * scene.duration, rel=1e-12)


def test_a_crossing_by_round_off_alone_has_no_finite_uncertainty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bodies that move alike in a precompressed chain never turn, and round-off turns them."""
    scene = Scene(
        name="alike", samples=4, duration=2.91229e-4, mass=(0.0237488, 0.0276718, 0.039186, 0.0596081, 0.123612),
        stiffness=(1.26511e10, 1.8233e11, 1.20263e10, 1.43625e11), velocity=(11815.0,) * 5, precompression=0.137008,
        drag=7319.86,
    )  # fmt: skip
    still = db.solve(scene, backend="scipy")
    # in the frame that they share they rest, and nothing turns them
    assert np.all(np.isnan(still.crossing_time))
    assert np.all(np.isfinite(still.uncertainty["crossing_time"]))
    # planted: the frame at rest, which walls would fix
    for module in ("backends.scipy_dop853", "runs.uncertainty.from_replicas"):
        monkeypatch.setattr(f"dem_bridge.{module}.in_common_frame", lambda scene: (scene, 0.0))
    run = db.solve(scene, backend="scipy")
    assert np.all(np.isinf(run.uncertainty["crossing_time"]))
    assert run.uncertainty["velocity"] < 1e-9 * 11815.0
    # two rules say so: the crossings scatter, and the velocities agree to the last digits
    for limit in ("UNSURE", "UNSURE_OF_ITSELF"):
        monkeypatch.setattr(replicas, limit, np.inf)
    assert np.all(np.isinf(db.solve(scene, backend="scipy").uncertainty["crossing_time"]))
    assert np.all(replicas.unresolved_crossings(scene))
    monkeypatch.setattr(replicas, "COMMON", 0.0)
    assert not np.any(replicas.unresolved_crossings(scene))


def test_an_overlap_is_as_uncertain_as_the_last_digits_of_all_steps() -> None:
    at_rest = {2.0: there(0.0), 1.0 / 3.0: there(0.0)}
    doubt = fixed_step.doubt_at_moments(family(moments=moment(0, 0.5, bend=1.0), elsewhere=at_rest))
    # two bodies, 400 steps, the last digit of 3 m and 3 m/s: a random walk, three times, and half a unit of each step
    expected = 2.0 * (3.0 * math.sqrt(400.0) + 0.5 * 400.0) * 2.0**-52 * 3.0
    assert doubt.overlap == pytest.approx([expected], rel=1e-9)
    assert doubt.rate == pytest.approx([expected], rel=1e-9)
