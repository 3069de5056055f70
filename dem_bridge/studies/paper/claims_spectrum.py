"""Claims of section 4b and figure 4: frequency and wavenumber spectra, width and energy of the front along the chain.

They refer to the chains of 200 cylinders, struck by a body like a cylinder through a contact like the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from dem_bridge.observables.pulse import pulse_width_by_force, secondary_fronts
from dem_bridge.observables.spectrum import cascade, frequency_spectrum, wavenumber_spectrum
from dem_bridge.scene import Scene
from dem_bridge.studies.paper.claims import by, claim, decided, heard, percent, together
from dem_bridge.studies.paper.claims_wave import KEPT, kept
from dem_bridge.studies.paper.measures import Measure
from dem_bridge.studies.paper.runs import LONG, STEEPER, Runs
from dem_bridge.studies.study import Claim, ClaimValue
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.verdict import Outcome

#: ratio of the centroid at the end to that at the start from which on the shift counts as a cascade
CASCADES = 1.2
TAPERED = ("tapered-forward", "tapered-backward")


def spectra(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on spectra, width and energy in the order of the paper."""
    yield _single(runs)
    yield _frequencies_fall(runs)
    yield _frequencies_rise(runs)
    yield _wavenumbers(runs)
    yield _width(runs)
    yield _kinetic(runs)
    yield _tapered(runs)


def _single(runs: Runs) -> Claim:
    values = _in_both(runs, "further pulses at cylinder 50", _further_pulses, made_of=())
    return claim(
        "single-front-200",
        "section 4b",
        "With a striker as heavy as a cylinder and beta_0 = beta_1 there are no multiple waves.",
        together(*(decided(value, high=0.0) for value in values)),
        f"Further maxima of more than 5 % of the first at cylinder 50:"
        f" {' and '.join(f'{by(v).value:.0f}' for v in values)}.",
        *values,
    )


def _in_both(
    runs: Runs, what: str, of: Callable[[Scene, Trajectory], float], made_of: tuple[str, ...] = ("velocity",)
) -> list[tuple[ClaimValue, ...]]:
    """Return the values of a measure in each of the two long chains."""
    return [heard(runs, name, Measure(name=f"{what}, {name}", of=of, made_of=made_of)) for name in LONG]


def _further_pulses(scene: Scene, run: Trajectory) -> float:
    return float(secondary_fronts(scene, run, 50).count)


def _of_frequency(scene: Scene, run: Trajectory) -> float:
    return cascade(frequency_spectrum(scene, run)).ratio


def _of_wavenumber(scene: Scene, run: Trajectory) -> float:
    return cascade(wavenumber_spectrum(scene, run)).ratio


def _centroid(name: str) -> Measure:
    return Measure(name=f"frequency centroid, end over start, {name}", of=_of_frequency, made_of=("velocity",))


def _parseval(runs: Runs, name: str) -> str:
    truth = runs.truth(name)
    if truth is None:
        return ""
    result = frequency_spectrum(runs.scenes[name], truth)
    return f" (Parseval's sum to {result.parseval:.0e})"


def _frequencies_fall(runs: Runs) -> Claim:
    result = heard(runs, LONG[0], _centroid(LONG[0]))
    return claim(
        "frequencies-cascade",
        "section 4b, figure 4b",
        "Where the stiffness falls, spectral energy shifts to lower frequencies along the chain.",
        decided(result, high=1.0 / CASCADES),
        f"The centroid of the velocity's spectrum falls to {by(result).value:.3f} of its value"
        f"{_parseval(runs, LONG[0])}. Acceptance criterion (ours): below 1/{CASCADES:g}.",
        result,
    )


def _width_of_spectrum(scene: Scene, run: Trajectory) -> float:
    width = frequency_spectrum(scene, run).width
    tenth = max(len(width) // 10, 1)
    return float(np.exp(np.mean(np.log(width[-tenth:])) - np.mean(np.log(width[:tenth]))))


def _frequencies_rise(runs: Runs) -> Claim:
    centroid = heard(runs, LONG[1], _centroid(LONG[1]))
    name = f"width of the spectrum, end over start, {LONG[1]}"
    width = heard(runs, LONG[1], Measure(name=name, of=_width_of_spectrum, made_of=("velocity",)))
    return claim(
        "frequencies-spread",
        "section 4b, figure 4e",
        "Where the stiffness rises, the energy spreads to a broader spectrum of frequencies.",
        decided(width, low=CASCADES),
        f"The width of the spectrum grows by a factor of {by(width).value:.3f} and its centroid by"
        f" {by(centroid).value:.3f}: the spectrum shifts to higher frequency at nearly constant relative bandwidth."
        f" Acceptance criterion (ours): a width factor above {CASCADES:g}.",
        width,
        centroid,
    )


def _wavenumbers(runs: Runs) -> Claim:
    values = _in_both(runs, "wavenumber centroid, end over start", _of_wavenumber)
    return claim(
        "wavenumbers-do-not",
        "section 4b, figures 4c and 4f",
        "There is no such cascading of wavenumbers: the wave front is localised in space.",
        together(*(decided(value, low=1.0 / CASCADES, high=CASCADES) for value in values)),
        f"The centroid of the spectrum along the chain changes to {' and '.join(f'{by(v).value:.3f}' for v in values)}"
        f" of its value. Acceptance criterion (ours): within a factor of {CASCADES:g}.",
        *values,
    )


def _width_kept(scene: Scene, run: Trajectory) -> float:
    width, links = pulse_width_by_force(scene, run).width, scene.n_body - 1
    early, late = (float(np.nanmean(width[round(at * links) : round((at + 0.1) * links)])) for at in (0.15, 0.8))
    return late / early


def _width(runs: Runs) -> Claim:
    values = _in_both(runs, "width of the pulse, end over start", _width_kept)
    return claim(
        "width-kept",
        "sections 4b and 5",
        "The wave front keeps its spatial width.",
        together(*(decided(value, low=KEPT, high=1.0 / KEPT) for value in values)),
        f"Its width at half force, in cylinders, changes to {' and '.join(f'{by(v).value:.4f}' for v in values)} of its"
        " value from the second tenth of the chain to the ninth. Acceptance criterion (ours): within"
        f" {percent(1.0 - KEPT)}.",
        *values,
    )


def _kinetic(runs: Runs) -> Claim:
    values = _in_both(runs, "kinetic energy kept", kept("kinetic"))
    return claim(
        "kinetic-energy-kept",
        "section 4b",
        "The wave front keeps its kinetic energy.",
        together(*(decided(value, low=KEPT, high=1.0 / KEPT) for value in values)),
        "From a quarter to nine tenths of the chain the leading pulse keeps "
        f"{' and '.join(percent(by(v).value, 3) for v in values)} of its kinetic energy. Acceptance criterion (ours):"
        " at"
        f" least {percent(KEPT)}.",
        *values,
    )


def _tapered(runs: Runs) -> Claim:
    """Judge the statement on tapered chains, which names no taper, on the shipped scenes and on steeper tapers."""
    steeper = {f"{TAPERED[0]}.{100.0 * (1.0 - q):.3g}-percent": f"{100.0 * (1.0 - q):.3g} %" for q in STEEPER}
    values = {
        name: heard(runs, name, Measure(name=f"kinetic energy kept, {name}", of=kept("kinetic"), made_of=("velocity",)))
        for name in (*TAPERED, *steeper)
        if runs.has(name)
    }
    shipped = ", ".join(percent(by(values[name]).value, 3) for name in TAPERED if name in values)
    more = " and ".join(
        f"{percent(by(values[name]).value, 3)} where they fall by {by_how_much}"
        for name, by_how_much in steeper.items()
        if name in values
    )
    keeps = together(*(decided(value, low=KEPT, high=1.0 / KEPT) for value in values.values()))
    turned = {Outcome.PASS: Outcome.FAIL, Outcome.FAIL: Outcome.PASS}
    return claim(
        "tapered",
        "sections 1 and 4b, on Sen et al. 2001",
        "In a tapered chain of spheres the kinetic energy of the wave front changes along the chain.",
        turned.get(keeps, keeps) if values else Outcome.NOT_RUN,
        f"From a quarter to nine tenths of the chain it keeps {shipped} of its kinetic energy (radii falling, and"
        " rising, by"
        f" 2 % per sphere), {more}. The paper names no taper. Acceptance criterion (ours): a change of more than"
        f" {percent(1.0 - KEPT)} at any of these tapers.",
        *values.values(),
    )
