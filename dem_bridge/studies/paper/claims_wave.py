"""Claims of section 4a, figures 2 and 3: the speed of the wave front, and its prediction by binary collisions."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dem_bridge.observables.fits import speed_power_law
from dem_bridge.observables.pulse import leading_pulse, secondary_fronts, speed_ratio
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.scene import Scene
from dem_bridge.studies.paper.claims import Limits, by, claim, decided, heard, sentence_numbers, together
from dem_bridge.studies.paper.effects import ANCHORS, AS_IS
from dem_bridge.studies.paper.measures import Measure, at_body
from dem_bridge.studies.paper.runs import ACCELERATING, DECELERATING, LONG, MAIN, MATCHED, Runs
from dem_bridge.studies.paper.theories import deviation, inner_bodies
from dem_bridge.studies.scatter import ScatteredChains
from dem_bridge.studies.study import Claim, ClaimValue
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.roles import REFERENCE
from dem_bridge.verification.verdict import Outcome

#: a front counts as unscattered if it keeps at least this share of its energy
KEPT = 0.9
#: a ratio of the largest to the smallest velocity above this is a large variation
LARGE = 1.5
#: relative deviation of arrival and residence times up to which a theory agrees well
WELL = 0.05
#: bodies at which later pulses are counted
COUNTED_AT = (10, 20, 30)
#: claims on effects that the paper conjectures to slow the measured waves, with the variants that have them
SUSPECTS = {"slower-by-dissipation": ("dashpot", "kuwabara-kono", "drag"), "slower-by-exponent": tuple(ANCHORS)}
#: ending of the sentence where the sign depends on a value that the paper does not give
WHY_UNDECIDED = (
    ". The sign depends on the overlap at which the modified and Hertzian forces are matched, here 1 and 5 um"
)


def waves(runs: Runs, scattered: list[ScatteredChains]) -> Iterator[Claim]:
    """Yield the claims on the wave front in the order of the paper."""
    for limits in FIRST_CLAIMS:
        yield limits.judge(runs)
    yield _amplitude(runs)
    yield _arrival(runs)
    yield _further_fronts(runs, "many-fronts", DECELERATING, low=1.0)
    yield _further_fronts(runs, "one-front", ACCELERATING, high=0.0)
    yield _mismatch(runs)
    yield _residence(runs)
    yield POWER_LAW.judge(runs)
    yield _scatter(scattered)
    for id, variants in SUSPECTS.items():
        yield _slower(runs, id, variants)


def kept(property: str, first: float = 0.25, last: float = 0.9) -> Measure:
    """Return the ratio of a property of the leading pulse late in the chain to that early in it.

    ``property`` is "energy", "kinetic" or "momentum". Both are means over a tenth of the chain, because they oscillate
    as the pulse passes from body to body.
    """

    def of(scene: Scene, run: Trajectory) -> float:
        carried, links = getattr(leading_pulse(scene, run), property), scene.n_body - 1
        half = max(links // 20, 1)
        early, late = round(first * links), round(last * links)
        return float(np.mean(carried[late - half : late + half]) / np.mean(carried[early - half : early + half]))

    name = {"kinetic": "kinetic energy"}.get(property, property)
    return Measure(name=f"{name} kept", of=of, made_of=("velocity",))


def further_pulses(body: int) -> Measure:
    """Return the number of pulses behind the first one at a body."""
    return Measure(
        name=f"further pulses at cylinder {body}",
        of=lambda scene, run: float(secondary_fronts(scene, run, body).count),
        made_of=(),
    )


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
    Limits(id="no-scattering", measure=kept("energy"), chains=(*MAIN, *LONG), low=KEPT, high=1.0 / KEPT),
)
AMPLITUDE = Limits(
    id="amplitude",
    measure=Measure(
        name="largest over smallest peak velocity",
        of=lambda scene, run: _peak_velocities(scene, run, inner_bodies(scene)),
        made_of=("velocity",),
    ),
    chains=MAIN,
    high=LARGE,
)
POWER_LAW = Limits(
    id="speed-power-law",
    measure=Measure(name="rms of V over its fit", of=lambda scene, run: speed_power_law(scene, run).residual),
    chains=MAIN,
    high=0.02,
)


def _amplitude(runs: Runs) -> Claim:
    truths = {name: truth for name in MAIN if (truth := runs.truth(name)) is not None}
    ratios = [_peak_velocities(runs.scenes[name], truth, slice(1, -2)) for name, truth in truths.items()]
    return AMPLITUDE.judge(runs, early=" and ".join(f"{ratio:.2f}" for ratio in ratios))


def _arrival(runs: Runs) -> Claim:
    """Compare the BCA arrival with the reference, and ode45, with which the paper compared it, with the reference."""
    values, each, outcomes = [], [], []
    for name in MAIN:
        runs_of_chain = [runs.run(name, code) for code in (REFERENCE, "bca", "ode45")]
        truth, theory, _ = runs_of_chain
        if truth is None or theory is None or None in runs_of_chain:
            outcomes.append(Outcome.NOT_RUN)
            continue
        values.append(heard(runs, name, at_body("arrival_at_end", None, "arrival at the last cylinder")))
        numbers = sentence_numbers(values[-1])
        late = numbers["excess"]
        each.append(
            {
                "chain": name,
                "late": abs(late),
                "way": "late" if late > 0.0 else "early",
                "worst": np.max(np.abs(deviation("arrival", runs.scenes[name], theory, truth))),
                "ode45": numbers["ode45"] / numbers["value"] - 1.0,
            }
        )
        outcomes.append(Outcome.PASS if abs(late) < WELL else Outcome.FAIL)
    return claim("arrival-by-bca", together(*outcomes), *values, each=each, tolerance=WELL)


def _further_fronts(runs: Runs, id: str, chain: str, low: float = 0.0, high: float = math.inf) -> Claim:
    values = [heard(runs, chain, further_pulses(body)) for body in COUNTED_AT]
    each = [{"count": by(value).value, "body": body} for value, body in zip(values, COUNTED_AT, strict=True)]
    truth, shares = runs.truth(chain), ""
    if truth is not None:
        second = secondary_fronts(runs.scenes[chain], truth, COUNTED_AT[0])
        shares = ", ".join(f"{share:.2f}" for share in second.amplitude)
    outcome = together(*(decided(value, low=low, high=high) for value in values))
    return claim(id, outcome, *values, each=each, shares=shares)


def _mismatch(runs: Runs) -> Claim:
    """Test the stated cause by removing it."""
    values = [heard(runs, f"{DECELERATING}.{key}", further_pulses(10)) for key in MATCHED]
    both, mass, stiffness = (by(value).value for value in values)
    cause = decided(values[2], high=0.0)  # the stiffness alone, as the paper says
    return claim("mismatch", cause, *values, both=both, mass=mass, stiffness=stiffness)


def _residence(runs: Runs) -> Claim:
    values, each, outcomes = [], [], []
    for name in MAIN:
        scene = runs.scenes[name]
        truth, theory, other = (runs.run(name, code) for code in (REFERENCE, "bca", "ode45"))
        if truth is None or theory is None or other is None:
            outcomes.append(Outcome.NOT_RUN)
            continue
        values.append(heard(runs, name, at_body("residence_time", 20, "residence time of cylinder 20")))
        worst, of_code = (
            float(np.max(np.abs(deviation("residence time", scene, run, truth)))) for run in (theory, other)
        )
        first = [OBSERVABLES["residence_time"].value(scene, run)[1] for run in (theory, truth)]
        each.append({"chain": name, "worst": worst, "first": first[0] / first[1], "ode45": of_code})
        outcomes.append(Outcome.PASS if worst < WELL else Outcome.FAIL)
    return claim("residence-by-bca", together(*outcomes), *values, each=each, tolerance=WELL)


def _scatter(scattered: list[ScatteredChains]) -> Claim:
    values, each = [], []
    for item in scattered:
        name, typical = item.scene.name, float(np.nanmedian(item.residence_spread))
        shift, spread = item.arrival_shift
        values.append(ClaimValue(name=f"deviation of the residence time, {name}", backend=REFERENCE, value=typical))
        way = "later" if shift > 0.0 else "earlier"
        each.append({"chain": name, "typical": typical, "deviation": spread, "shift": abs(shift), "way": way})
    settings = {"spread": scattered[0].spread, "count": scattered[0].count} if scattered else {}
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
