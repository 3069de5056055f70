"""Claims of section 4a, figures 2 and 3: the speed of the wave front, and its prediction by binary collisions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from dem_bridge.observables.fits import speed_power_law
from dem_bridge.observables.pulse import speed_ratio
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Claim, ClaimValue
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.claims import Limits, claim
from dem_bridge.studies.paper.claims_collisions import arrivals, residences
from dem_bridge.studies.paper.claims_pulses import NO_SCATTERING, followers, striker_shares
from dem_bridge.studies.paper.effects import ANCHORS, AS_IS, STRONG
from dem_bridge.studies.paper.measures import Measure
from dem_bridge.studies.paper.runs import ACCELERATING, DECELERATING, MAIN, Runs
from dem_bridge.studies.paper.theories import profiled
from dem_bridge.studies.scatter import ScatteredChains
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.roles import REFERENCE

#: a ratio of the largest to the smallest velocity above this is a large variation
LARGE = 1.5
#: rms residual up to which speeds follow a power law
RESIDUAL = 0.02
#: claims on effects that the paper conjectures to slow the measured waves, with the variants that have them
SUSPECTS = {
    "slower-by-dissipation": ("dashpot", "kuwabara-kono", "drag", STRONG.id),
    "slower-by-exponent": tuple(ANCHORS),
}
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
        values.append(ClaimValue(name=f"deviation of the residence time, {name}", backend=REFERENCE, value=typical))
        of_arrival = f"deviation of the arrival at the end, with its standard error, {name}"
        values.append(ClaimValue(name=of_arrival, backend=REFERENCE, value=spread, uncertainty=stderr))
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
    return claim(id, outcome.get(signs, Outcome.UNDECIDED), values, each=each, undecided=undecided)
