"""Claims on what a front keeps (energy, width), on what follows it (further pulses), on its spectra, and on the causes.

Those of section 4b and figure 4 refer to the chains of 200 cylinders, struck by a body like a cylinder through a
contact like the first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from dem_bridge.observables.pulse import front_window, pulse_shapes, pulse_width_by_force, secondary_fronts
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.spectrum import cascade, frequency_spectrum, wavenumber_spectrum
from dem_bridge.physics.exact import solitary_wave
from dem_bridge.report.study import Claim, ClaimValue
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.claims import Limits, by, claim, decided, exact, heard, together
from dem_bridge.studies.paper.measures import Measure
from dem_bridge.studies.paper.runs import ACCELERATING, DECELERATING, LONG, MAIN, MATCHED, MISMATCHED, TAPERS, Runs
from dem_bridge.trajectory.trajectory import Trajectory

#: a front keeps its energy, kinetic energy or width if it changes by at most a tenth, in whatever chain
KEPT = 0.9
#: share of the first pulse from which a later one counts, and of the dips beside it
SHARE = 0.05
#: relative deviation up to which a shape, a width or a theory agrees well
WELL = 0.05
#: bodies at which later pulses are counted
COUNTED_AT = (10, 20, 30)
#: contact of a tapered chain at which the width of the front is read: it is constant from there on
SETTLED = 20


def window_kept(property: str) -> Measure:
    """Return the ratio of a property of :func:`front_window` at nine tenths of the chain to that at a quarter."""

    def of(scene: Scene, run: Trajectory) -> float:
        values = getattr(front_window(scene, run), property)
        early, late = _quarter_and_end(scene)
        return float(values[late] / values[early])

    name = {"kinetic": "kinetic energy"}.get(property, property)
    return Measure(name=f"{name} in a window kept", of=of, made_of=("velocity",))


def _quarter_and_end(scene: Scene) -> tuple[int, int]:
    """Return the body, or contact, at a quarter of the chain and that at nine tenths."""
    links = scene.n_body - 1
    return round(0.25 * links), round(0.9 * links)


def _body_kept(scene: Scene, run: Trajectory) -> float:
    early, late = _quarter_and_end(scene)
    velocity = OBSERVABLES["peak_velocity"].value(scene, run)
    return float(scene.mass[late] * velocity[late] ** 2 / (scene.mass[early] * velocity[early] ** 2))


def _width(scene: Scene, run: Trajectory) -> float:
    return float(pulse_width_by_force(scene, run).by_duration[SETTLED])


def further_pulses(body: int) -> Measure:
    """Return the number of pulses behind the first one at a body."""
    return Measure(
        name=f"further pulses at cylinder {body}",
        of=lambda scene, run: float(secondary_fronts(scene, run, body, share=SHARE).count),
        made_of=(),
    )


def _amplitude(body: int) -> Measure:
    def of(scene: Scene, run: Trajectory) -> float:
        velocity = pulse_shapes(scene, run, body).velocity
        return float(velocity[1] / velocity[0]) if len(velocity) > 1 else math.nan

    return Measure(name=f"amplitude of the second pulse at cylinder {body}", of=of, made_of=("velocity",))


def scaled_duration(body: int) -> Measure:
    """Return the duration of the second pulse over that of the first, times (amplitude)^(1/5)."""

    def of(scene: Scene, run: Trajectory) -> float:
        shapes = pulse_shapes(scene, run, body)
        if len(shapes.velocity) < 2:
            return math.nan
        height, duration = shapes.velocity[1] / shapes.velocity[0], shapes.duration[1] / shapes.duration[0]
        return float(duration * height**0.2)

    return Measure(name=f"scaled duration of the second pulse at cylinder {body}", of=of, made_of=("velocity",))


BODY_KEPT = Measure(name="kinetic energy of one body kept", of=_body_kept, made_of=("velocity",))
WIDTH = Measure(name="width at half force", of=_width, made_of=("velocity",))


def striker_shares(scene: Scene, run: Trajectory) -> dict[str, float]:
    """Return the parts of the striker's energy in the front at contacts 3 and 10 and at nine tenths of the chain."""
    energy = front_window(scene, run).energy / (0.5 * scene.mass[0] * scene.velocity[0] ** 2)
    _, late = _quarter_and_end(scene)
    return {"early": float(energy[3]), "quarter": float(energy[10]), "late": float(energy[late])}


NO_SCATTERING = Limits(
    id="no-scattering", measure=window_kept("energy"), chains=(*MAIN, *LONG), low=KEPT, high=1.0 / KEPT
)
KINETIC = Limits(id="kinetic-energy-kept", measure=BODY_KEPT, chains=LONG, low=KEPT, high=1.0 / KEPT)
SINGLE = Limits(id="single-front-200", measure=further_pulses(50), chains=LONG, high=0.0)


def followers(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on pulses behind the front and on their cause."""
    yield _further_fronts(runs, "many-fronts", DECELERATING, low=1.0)
    yield _similar(runs)
    yield _further_fronts(runs, "one-front", ACCELERATING, high=0.0)
    yield _mismatch(runs)
    yield _small_mismatch(runs)


def tapered(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on kinetic energy and width of the front in chains of spheres whose radii fall."""
    energies = {name: heard(runs, name, BODY_KEPT) for name in TAPERS if runs.has(name)}
    windows = {name: heard(runs, name, window_kept("kinetic")) for name in energies}
    # a small taper must have the sign alone, which decides nothing about the size
    limits = [1.0 if name == "tapered-forward" else KEPT for name in energies]
    yield claim(
        "tapered",
        together(*(decided(value, high=limit) for value, limit in zip(energies.values(), limits, strict=True))),
        *energies.values(),
        *windows.values(),
        each=[
            {"fall": 1.0 - by(energies[name]).value, "window": 1.0 - by(windows[name]).value, "taper": TAPERS[name]}
            for name in energies
        ],
        change=1.0 - KEPT,
    )
    wave = solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_velocity=1.0)
    widths = {name: heard(runs, name, WIDTH) for name in TAPERS if runs.has(name)}
    yield claim(
        "tapered-width",
        together(*(decided(value, low=(1.0 + WELL) * wave.width) for value in widths.values())),
        exact("width at half force, uniform spheres", wave.width, ""),
        *widths.values(),
        each=[{"value": by(value).value, "taper": TAPERS[name]} for name, value in widths.items()],
        uniform=wave.width,
        contact=SETTLED,
        tolerance=WELL,
    )


def _further_fronts(runs: Runs, id: str, chain: str, low: float = 0.0, high: float = math.inf) -> Claim:
    values = [heard(runs, chain, further_pulses(body)) for body in COUNTED_AT]
    each = [{"count": by(value).value, "body": body} for value, body in zip(values, COUNTED_AT, strict=True)]
    truth, shares = runs.truth(chain), ""
    if truth is not None:
        velocity = pulse_shapes(runs.scenes[chain], truth, COUNTED_AT[0]).velocity
        shares = ", ".join(f"{share:.2f}" for share in velocity[1:] / velocity[0])
    outcome = together(*(decided(value, low=low, high=high) for value in values))
    return claim(id, outcome, *values, each=each, shares=shares)


def _similar(runs: Runs) -> Claim:
    """Compare the second pulse with the first: a wave of the same shape has a scaled duration of 1."""
    heights = [heard(runs, DECELERATING, _amplitude(body)) for body in COUNTED_AT]
    durations = [heard(runs, DECELERATING, scaled_duration(body)) for body in COUNTED_AT]
    outcome = together(*(decided(value, low=1.0 - WELL, high=1.0 + WELL) for value in durations))
    each = [
        {"duration": by(duration).value, "height": by(height).value, "body": body}
        for duration, height, body in zip(durations, heights, COUNTED_AT, strict=True)
    ]
    return claim("similar-pulses", outcome, *heights, *durations, each=each, tolerance=WELL)


def _mismatch(runs: Runs) -> Claim:
    """Test the stated cause of further fronts by removing it."""
    values = {
        key: [heard(runs, f"{DECELERATING}.{key}", further_pulses(body)) for body in COUNTED_AT] for key in MATCHED
    }
    # the stiffness alone, as the paper says
    outcome = together(*(decided(value, high=0.0) for value in values["matched-stiffness"]))
    return claim(
        "mismatch",
        outcome,
        *(value for of_key in values.values() for value in of_key),
        matched=_words(values["matched"]),
        matched_mass=_words(values["matched-mass"]),
        matched_stiffness=_words(values["matched-stiffness"]),
    )


def _small_mismatch(runs: Runs) -> Claim:
    """Test the stated cause of a single front by putting the large mismatch of the other chain in its place."""
    name = f"{ACCELERATING}.{MISMATCHED}"
    values = [heard(runs, name, further_pulses(body)) for body in COUNTED_AT]
    outcome = together(*(decided(value, low=1.0) for value in values))
    return claim("small-mismatch", outcome, *values, counts=_words(values))


def _words(values: Sequence[Sequence[ClaimValue]]) -> str:
    """Return the deciding values as text."""
    return ", ".join(f"{by(value).value:.0f}" for value in values)


#: ratio of the centroid at the end to that at the start from which on the shift counts as a cascade
CASCADES = 1.2


def spectra(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on spectra, width and energy in the order of the paper."""
    yield SINGLE.judge(runs)
    yield _frequencies_fall(runs)
    yield _frequencies_rise(runs)
    yield WAVENUMBERS.judge(runs)
    yield SPECTRAL_WIDTH.judge(runs, change=1.0 - KEPT)
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
SPECTRAL_WIDTH = Limits(
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
