"""Claims on binary collisions beside the simulated front: residence times, arrivals and V_out/V_in (section 4a)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from dem_bridge.observables.fits import inner_bodies
from dem_bridge.observables.pulse import speed_ratio
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.report.study import Claim, ClaimValue
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.claims import claim, exact, heard, printed, sentence_numbers, together
from dem_bridge.studies.paper.claims_pulses import WELL
from dem_bridge.studies.paper.measures import at_body
from dem_bridge.studies.paper.runs import DECELERATING, MAIN, Runs
from dem_bridge.studies.paper.texts import CLAIMS
from dem_bridge.studies.paper.theories import FIRST, LAST, deviation
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.roles import REFERENCE

#: cylinders of V_in and V_out, first and last, that a reader could choose: between both ends and including them
INNER_ENDS, ALL_ENDS = ((2, 6), (35, 38)), ((1, 6), (35, 39))


def residences(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on eq. 3.3 and on V_out/V_in."""
    yield _residence_definition(runs.scenes[DECELERATING])
    yield _residence(runs)
    yield _speed_ratio(runs)


def arrivals(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on eq. 3.7."""
    yield _arrival(runs, "arrival-by-bca", with_striker=True)
    yield _arrival(runs, "arrival-as-printed", with_striker=False)


def _with_theories(runs: Runs) -> Iterable[tuple[str, Scene, Trajectory, Trajectory, Trajectory] | None]:
    """Yield each main chain with its runs by the reference, binary collisions and ode45; None where one is missing."""
    for name in MAIN:
        truth, theory, other = (runs.run(name, code) for code in (REFERENCE, "bca", "ode45"))
        missing = truth is None or theory is None or other is None
        yield None if missing else (name, runs.scenes[name], truth, theory, other)  # type: ignore[misc]


def _by_theory(name: str, value: float) -> ClaimValue:
    return ClaimValue(name=name, backend="bca", value=value)


def _judge(off: float) -> Outcome:
    return Outcome.PASS if abs(off) < WELL else Outcome.FAIL


def _residence_definition(scene: Scene) -> Claim:
    """Compare eq. 3.3 with the duration of a collision of two cylinders."""
    hit = two_body_collision(
        masses=(scene.mass[1], scene.mass[2]), velocities=(1.0, 0.0), stiffness=scene.stiffness[1], exponent=2.5
    )
    # of two bodies with one velocity, at the time of eq. 3.3, the second has this share of what it will have
    together_at_half = scene.mass[1] / (scene.mass[1] + scene.mass[2])
    number = printed(**CLAIMS["residence-definition"]["printed"])
    share = exact("share at T, masses 1 : 1", together_at_half / hit.exit_velocity[1], "")
    whole = hit.contact_time / hit.half_time
    return claim("residence-definition", Outcome.FAIL, number, share, share=share.value, whole=whole)


def _residence(runs: Runs) -> Claim:
    values, each, outcomes = [], [], []
    for item in _with_theories(runs):
        if item is None:
            outcomes.append(Outcome.NOT_RUN)
            continue
        name, scene, truth, theory, other = item
        values.append(heard(runs, name, at_body("residence_time", 20, "residence time of cylinder 20")))
        read = OBSERVABLES["residence_time"].value
        off, of_code = (read(scene, run) / read(scene, truth) - 1.0 for run in (theory, other))
        first, last = inner_bodies(scene)
        inner = off[first : last + 1]
        largest, end = float(inner[np.argmax(np.abs(inner))]), last + 1
        values.append((_by_theory(f"largest deviation of T_i, {name}", largest),
                       _by_theory(f"deviation of T_{end}, {name}", float(off[end]))))  # fmt: skip
        numbers = {"worst": abs(largest), "after": float(off[end]), "first": 1.0 + float(off[1])}
        each.append({"chain": name, **numbers, "ode45": float(np.max(np.abs(of_code[first : last + 1])))})
        outcomes.append(_judge(largest))
    return claim("residence-by-bca", together(*outcomes), *values, each=each, tolerance=WELL)


def _arrival(runs: Runs, id: str, *, with_striker: bool) -> Claim:
    """Compare the sum of T_j with the arrival at the last cylinder; eq. 3.7 as printed has no T_0."""
    values, each, outcomes = [], [], []
    for item in _with_theories(runs):
        if item is None:
            outcomes.append(Outcome.NOT_RUN)
            continue
        name, scene, truth, theory, _ = item
        values.append(heard(runs, name, at_body("arrival_at_end", None, "arrival at the last cylinder")))
        numbers = sentence_numbers(values[-1])
        start, end = (float(theory.crossing_time[k]) for k in (0, scene.n_body - 2))
        begin, arrival = (float(truth.crossing_time[k]) for k in (0, scene.n_body - 2))
        off = {"with T_0": end / arrival - 1.0} if with_striker else {
            "as printed": (end - start) / arrival - 1.0,
            "from the first crossing": (end - start) / (arrival - begin) - 1.0,
        }  # fmt: skip
        values.append(tuple(_by_theory(f"{key}, {name}", value) for key, value in off.items()))
        # the wave has passed cylinder i at the crossing of contact i
        along = slice(FIRST, scene.n_body - LAST)
        sums, passed = theory.crossing_time[along] - start, truth.crossing_time[along]
        from_impact, from_first = sums / passed - 1.0, sums / (passed - begin) - 1.0
        judged, *others = off.values()
        each.append(
            {
                "chain": name,
                "late": abs(judged),
                "way": "late" if judged > 0.0 else "early",
                "other": others[0] if others else np.nan,
                "worst": np.max(np.abs(deviation("arrival", scene, theory, truth))),
                "ode45": numbers["ode45"] / numbers["value"] - 1.0,
                "least": np.min(from_impact),
                "most": np.max(from_impact),
                "least_first": np.min(from_first),
                "most_first": np.max(from_first),
            }
        )
        outcomes.append(_judge(judged))
    return claim(id, together(*outcomes), *values, each=each, tolerance=WELL)


def _speed_ratio(runs: Runs) -> Claim:
    """Return the ranges of V_out/V_in over the cylinders that a reader could choose, which the paper does not name."""
    values, each = [], []
    for name in MAIN:
        truth, scene = runs.truth(name), runs.scenes[name]
        if truth is None:
            continue
        residence, ranges = OBSERVABLES["residence_time"].value(scene, truth), {}
        for ends, ((low, high), (early, late)) in {"inner": INNER_ENDS, "all": ALL_ENDS}.items():
            inputs, outputs = residence[low : high + 1], residence[early : late + 1]
            extremes = {"least": inputs.min() / outputs.max(), "largest": inputs.max() / outputs.min()}
            where = f"inputs {low} to {high}, outputs {early} to {late}"
            for extreme, value in extremes.items():
                ranges[f"{ends}_{extreme}"] = float(value)
                label = f"{extreme} V_out/V_in, {where}, {name}"
                values.append(ClaimValue(name=label, backend=REFERENCE, value=float(value)))
        each.append({"chain": name, **ranges, "value": speed_ratio(scene, truth).ratio})
    return claim("speed-ratio-sensitivity", Outcome.UNDECIDED if each else Outcome.NOT_RUN, values, each=each)
