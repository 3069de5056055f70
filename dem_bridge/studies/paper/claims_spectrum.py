"""Claims of section 4b and figure 4: frequency and wavenumber spectra, width and energy of the front along the chain.

They refer to the chains of 200 cylinders, struck by a body like a cylinder through a contact like the first.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dem_bridge.observables.pulse import pulse_width_by_force
from dem_bridge.observables.spectrum import cascade, frequency_spectrum, wavenumber_spectrum
from dem_bridge.report.study import Claim
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.claims import Limits, by, claim, decided, heard
from dem_bridge.studies.paper.claims_pulses import KEPT, KINETIC, SINGLE, tapered
from dem_bridge.studies.paper.measures import Measure
from dem_bridge.studies.paper.runs import LONG, Runs
from dem_bridge.trajectory.trajectory import Trajectory

#: ratio of the centroid at the end to that at the start from which on the shift counts as a cascade
CASCADES = 1.2


def spectra(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on spectra, width and energy in the order of the paper."""
    yield SINGLE.judge(runs)
    yield _frequencies_fall(runs)
    yield _frequencies_rise(runs)
    yield WAVENUMBERS.judge(runs)
    yield WIDTH.judge(runs, change=1.0 - KEPT)
    yield KINETIC.judge(runs)
    yield from tapered(runs)


def growth_of_width(scene: Scene, run: Trajectory, *, share: float = 0.1) -> float:
    """Return the width of the frequency spectrum over the last share of the way, over that over the first."""
    width = frequency_spectrum(scene, run).width
    count = max(int(share * len(width)), 1)
    return float(np.exp(np.mean(np.log(width[-count:])) - np.mean(np.log(width[:count]))))


def width_kept(scene: Scene, run: Trajectory, *, tenths: tuple[int, int] = (2, 9)) -> float:
    """Return the width of the front in one tenth of the chain, counted from 1, over that in an earlier one."""
    width, links = pulse_width_by_force(scene, run).width, scene.n_body - 1
    early, late = (
        float(np.nanmean(width[round(0.1 * (tenth - 1) * links) : round(0.1 * tenth * links)])) for tenth in tenths
    )
    return late / early


CENTROID = Measure(
    name="frequency centroid, end over start",
    of=lambda scene, run: cascade(frequency_spectrum(scene, run)).ratio,
    made_of=("velocity",),
)
FREQUENCIES = Limits(id="frequencies-cascade", measure=CENTROID, chains=LONG[:1], high=1.0 / CASCADES)
WAVENUMBERS = Limits(
    id="wavenumbers-do-not",
    measure=Measure(
        name="wavenumber centroid, end over start",
        of=lambda scene, run: cascade(wavenumber_spectrum(scene, run)).ratio,
        made_of=("velocity",),
    ),
    chains=LONG,
    low=1.0 / CASCADES,
    high=CASCADES,
)
WIDTH = Limits(
    id="width-kept",
    measure=Measure(name="width of the pulse, end over start", of=width_kept, made_of=("velocity",)),
    chains=LONG,
    low=KEPT,
    high=1.0 / KEPT,
)


def _frequencies_fall(runs: Runs) -> Claim:
    truth, parseval = runs.truth(LONG[0]), ""
    if truth is not None:
        parseval = f" (Parseval's sum to {frequency_spectrum(runs.scenes[LONG[0]], truth).parseval:.0e})"
    return FREQUENCIES.judge(runs, parseval=parseval, cascades=CASCADES)


def _frequencies_rise(runs: Runs) -> Claim:
    of_width = Measure(name="width of the spectrum, end over start", of=growth_of_width, made_of=("velocity",))
    width, centroid = (heard(runs, LONG[1], measure) for measure in (of_width, CENTROID))
    outcome = decided(width, low=CASCADES)
    factors = [by(values).value for values in (width, centroid)]
    return claim(
        "frequencies-spread", outcome, width, centroid, width=factors[0], centroid=factors[1], cascades=CASCADES
    )
