"""Claims of section 4a, figures 2 and 3: the speed of the wave front, and its prediction by binary collisions.

Residence times, arrivals and V_out/V_in by binary collisions are compared with those of the simulated front.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from dem_bridge.observables.fits import inner_bodies, speed_power_law
from dem_bridge.observables.pulse import speed_ratio
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.report.study import Claim, ClaimValue
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.claims import PRINTED, Limits, claim, exact, heard, printed, sentence_numbers, together
from dem_bridge.studies.paper.claims_pulses import NO_SCATTERING, WELL, followers, striker_shares
from dem_bridge.studies.paper.effects import ANCHORS, AS_IS, STRONG
from dem_bridge.studies.paper.measures import FIRST, LAST, Measure, at_body, deviation, profiled
from dem_bridge.studies.paper.runs import ACCELERATING, DECELERATING, MAIN, Runs
from dem_bridge.studies.scatter import ScatteredChains
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.reference_choice import REFERENCE

#: cylinders of V_in and V_out, first and last, that a reader could choose: between both ends and including them
INNER_ENDS, ALL_ENDS = ((2, 6), (35, 38)), ((1, 6), (35, 39))

#: contacts of cylinders 3 to 38, as for V_out/V_in
_WIDE = slice(2, 38)


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
    number = printed(**PRINTED["residence-definition"])
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
                "wide": np.max(np.abs(theory.crossing_time[_WIDE] / truth.crossing_time[_WIDE] - 1.0)),
            }
        )
        outcomes.append(_judge(judged))
    wide = max((float(part["wide"]) for part in each), default=math.nan)
    beside = "beyond it" if wide >= WELL else "within it"
    return claim(id, together(*outcomes), *values, each=each, tolerance=WELL, wide=wide, beside=beside)


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
            ranges[ends] = extremes
            for extreme, value in extremes.items():
                label = f"{extreme} V_out/V_in, {where}, {name}"
                values.append(ClaimValue(name=label, backend=REFERENCE, value=float(value)))
        each.append({"chain": name, **ranges, "value": speed_ratio(scene, truth).ratio})
    return claim("speed-ratio-sensitivity", Outcome.UNDECIDED if each else Outcome.NOT_RUN, values, each=each)


#: a ratio of the largest to the smallest velocity above this is a large variation
LARGE = 1.5
#: rms residual up to which speeds follow a power law
RESIDUAL = 0.02
#: claims on effects that the paper conjectures to slow the measured waves, with the variants that have them
SUSPECTS = {
    "slower-by-dissipation": ("dashpot", "kuwabara-kono", "drag", STRONG.id),
    "slower-by-exponent": tuple(ANCHORS),
}
#: names of these variants in a row of the table of claims
TERMS = {
    "dashpot": "dashpot of 1 N s/m", "kuwabara-kono": "viscoelastic", "drag": "drag",
    STRONG.id: "dashpot of 300 N s/m",
    **dict(zip(ANCHORS, ("matched at 1 µm", "matched at 5 µm"), strict=True)),
}  # fmt: skip
#: ending of the sentence where the sign depends on a value that the paper does not give
WHY_UNDECIDED = (
    ". The sign depends on the overlap at which the modified and Hertzian forces are matched, here 1 and 5 um"
)


def waves(runs: Runs, scattered: list[ScatteredChains]) -> Iterator[Claim]:
    """Yield the claims on the wave front in the order of the paper."""
    for limits in FIRST_CLAIMS:
        yield limits.judge(runs)
    yield _no_scattering(runs)
    yield _amplitude(runs)
    yield from arrivals(runs)
    yield from followers(runs)
    yield from residences(runs)
    yield POWER_LAW.judge(runs)
    yield _scatter(scattered)
    for id, variants in SUSPECTS.items():
        yield _slower(runs, id, variants)


def _peak_velocities(scene: Scene, run: Trajectory, bodies: slice) -> float:
    """Return the ratio of the largest peak velocity of some bodies to the smallest."""
    values = OBSERVABLES["peak_velocity"].value(scene, run)[bodies]
    return float(np.max(values) / np.min(values))


SPEED_RATIO = Measure(
    name="V_out/V_in",
    of=lambda scene, run: speed_ratio(scene, run).ratio,
    uncertainty=lambda scene, run: speed_ratio(scene, run).uncertainty,
)
FIRST_CLAIMS = (
    Limits(id="decelerates", measure=SPEED_RATIO, chains=(DECELERATING,), high=0.9),
    Limits(id="accelerates", measure=SPEED_RATIO, chains=(ACCELERATING,), low=1.1),
)
AMPLITUDE = Limits(
    id="amplitude",
    measure=Measure(
        name="largest over smallest peak velocity",
        of=lambda scene, run: _peak_velocities(scene, run, profiled(scene)),
        made_of=("velocity",),
    ),
    chains=MAIN,
    high=LARGE,
)
POWER_LAW = Limits(
    id="speed-power-law",
    measure=Measure(name="rms of V over its fit", of=lambda scene, run: speed_power_law(scene, run).residual),
    chains=MAIN,
    high=RESIDUAL,
)


def _no_scattering(runs: Runs) -> Claim:
    truths = [(runs.scenes[name], truth) for name in MAIN if (truth := runs.truth(name)) is not None]
    if len(truths) < len(MAIN):
        return NO_SCATTERING.judge(runs)
    slow, fast = (striker_shares(scene, truth) for scene, truth in truths)
    values = [
        ClaimValue(
            name=f"share of the striker's energy in the front at contact {at}, {name}", backend=REFERENCE, value=share
        )
        for name, shares in zip(MAIN, (slow, fast), strict=True)
        for at, share in zip((3, 10, 36), shares.values(), strict=True)
    ]
    return NO_SCATTERING.judge(runs, *values, more={"slow": slow, "fast": fast, "never": 1.0 - slow["late"]})


def _amplitude(runs: Runs) -> Claim:
    truths = {name: truth for name in MAIN if (truth := runs.truth(name)) is not None}
    ratios = [_peak_velocities(runs.scenes[name], truth, slice(1, -2)) for name, truth in truths.items()]
    return AMPLITUDE.judge(runs, early=" and ".join(f"{ratio:.2f}" for ratio in ratios))


def _scatter(scattered: list[ScatteredChains]) -> Claim:
    values, each = [], []
    for item in scattered:
        name, typical = item.scene.name, float(np.nanmedian(item.residence_spread))
        shift, spread = item.arrival_shift
        stderr = spread / math.sqrt(2.0 * (item.count - 1))
        values.append(ClaimValue(name=f"deviation of the residence time, {name}", backend=item.solver, value=typical))
        of_arrival = f"deviation of the arrival at the end, with its standard error, {name}"
        values.append(ClaimValue(name=of_arrival, backend=item.solver, value=spread, uncertainty=stderr))
        way = "later" if shift > 0.0 else "earlier"
        each.append(
            {"chain": name, "typical": typical, "deviation": spread, "stderr": stderr, "shift": abs(shift), "way": way}
        )
    settings: dict[str, Any] = {"spread": scattered[0].spread, "count": scattered[0].count} if scattered else {}
    return claim("scatter", Outcome.UNDECIDED if scattered else Outcome.NOT_RUN, values, each=each, **settings)


def _slower(runs: Runs, id: str, variants: tuple[str, ...]) -> Claim:
    """Return the claim that effects which the paper conjectures slow the measured waves."""
    values, each = [], []
    residence = OBSERVABLES["residence_time"].value
    for name in MAIN:
        base = runs.truth(f"{name}.{AS_IS}")
        for variant in variants:
            run = runs.truth(f"{name}.{variant}")
            if base is None or run is None:
                continue
            scene = runs.scenes[name]
            speed = float(residence(scene, base)[20] / residence(scene, run)[20])
            values.append(ClaimValue(name=f"speed at cylinder 20, {variant}, {name}", backend=REFERENCE, value=speed))
            each.append({"term": variant, "change": 100.0 * (speed - 1.0), "chain": name})
    signs = frozenset(value.value < 1.0 for value in values)
    # where the sign depends on a value that the paper does not give, the claim is undecided
    outcome = {frozenset([True]): Outcome.PASS, frozenset([False]): Outcome.FAIL, frozenset(): Outcome.NOT_RUN}
    undecided = WHY_UNDECIDED if len(signs) > 1 else ""
    changes = {variant: [part["change"] for part in each if part["term"] == variant] for variant in variants}
    terms = [f"{TERMS[name]} {' and '.join(f'{x:+.2g}' for x in both)} %" for name, both in changes.items() if both]
    numbers: dict[str, Any] = {"undecided": undecided, "terms": ", ".join(terms)}
    return claim(id, outcome.get(signs, Outcome.UNDECIDED), values, each=each, **numbers)
