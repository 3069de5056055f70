"""Criteria of the claims as quantities with limits, each read in our window and in others.

Quantities are changes and deviations, so that a factor on a limit means the same everywhere. Windows of a chain of 40
are those of the claims: cylinders 3 to 38 for speeds and residence times, 5 to 37 for profiles of velocities and
arrivals, 10 to 36 (a quarter to nine tenths) for what a front keeps, because the second pulse must have left it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from dem_bridge.observables.fits import force_exponent, inner_contacts, log_velocity_slope, speed_power_law
from dem_bridge.observables.pulse import front_window, pulse_width_by_force, secondary_fronts, speed_ratio
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.spectrum import Spectrum, cascade, frequency_spectrum, wavenumber_spectrum
from dem_bridge.physics.exact import solitary_wave
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper import claims_force, claims_numbers, claims_pulses, claims_wave
from dem_bridge.studies.paper.claims import Criterion, Read
from dem_bridge.studies.paper.runs import ACCELERATING, DECELERATING, GRADIENTS, LONG, MAIN, MISMATCHED, TAPERS, Runs
from dem_bridge.studies.paper.validity import contact_validity
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: windows of a chain of 40: cylinders of V_in and V_out, of profiles, and from a quarter to nine tenths
SPEEDS, PROFILES, QUARTER = (3, 38), (5, 37), (10, 36)
#: cylinders at which further pulses are counted, and others
COUNTED, OTHERS = claims_pulses.COUNTED_AT, (6, 14, 18, 26, 34)
#: sizes of further windows of an exponent, in parts of the whole range: those of the claim are half of it and more
SMALLER = (0.25, 0.1)
#: shares of the first pulse below which a later one is not looked for
LEAST_SHARE = 1e-3

Window = tuple[int, int]


def _over(chains: Sequence[str], read: Callable[[Runs, str], float], worst: Callable[..., float] = max) -> Read:
    """Return the worst of a number over chains whose runs are there; nan where none is."""
    return lambda runs: worst((read(runs, name) for name in chains if runs.has(name)), default=math.nan)


def _truth(runs: Runs, name: str) -> tuple[Scene, Trajectory]:
    truth = runs.truth(name)
    assert truth is not None  # see _over
    return runs.scenes[name], truth


def _loss(ratio: float) -> float:
    """Return how far a ratio is from 1, the same for a ratio and its inverse."""
    return 1.0 - min(ratio, 1.0 / ratio)


# --- quantities of a chain in a window


def _speed_ratio(window: Window, runs: Runs, name: str) -> float:
    return speed_ratio(*_truth(runs, name), first=window[0], last=window[1]).ratio


def _slowing(window: Window, runs: Runs, name: str) -> float:
    return 1.0 - _speed_ratio(window, runs, name)


def _speeding(window: Window, runs: Runs, name: str) -> float:
    return _speed_ratio(window, runs, name) - 1.0


def _to_scale(window: Window, scene: Scene) -> Window:
    """Return the window of a longer chain that has the place of a window of a chain of 40."""
    first, last = (round(place * (scene.n_body - 1) / 40) for place in window)
    return first, last


def _energy_change(window: Window, runs: Runs, name: str) -> float:
    scene, truth = _truth(runs, name)
    early, late = _to_scale(window, scene)
    energy = front_window(scene, truth).energy
    return _loss(float(energy[late] / energy[early]))


def _kinetic_fall(window: Window, runs: Runs, name: str) -> float:
    scene, truth = _truth(runs, name)
    early, late = _to_scale(window, scene)
    velocity = OBSERVABLES["peak_velocity"].value(scene, truth)
    return 1.0 - float(scene.mass[late] * velocity[late] ** 2 / (scene.mass[early] * velocity[early] ** 2))


def _kinetic_change(window: Window, runs: Runs, name: str) -> float:
    return _loss(1.0 - _kinetic_fall(window, runs, name))


def _peak_velocities(window: Window, runs: Runs, name: str) -> Floats:
    return OBSERVABLES["peak_velocity"].value(*_truth(runs, name))[window[0] : window[1] + 1]


def _variation(window: Window, runs: Runs, name: str) -> float:
    velocity = _peak_velocities(window, runs, name)
    return float(np.max(velocity) / np.min(velocity) - 1.0)


def _velocity_by_bca(window: Window, runs: Runs, name: str) -> float:
    return float(np.max(np.abs(claims_numbers.BCA_VELOCITY / _peak_velocities(window, runs, name) - 1.0)))


def _by_bca(part: Callable[[Floats], Floats], window: Window, runs: Runs, name: str) -> float:
    """Return the largest deviation of times by the BCA at cylinders of a window; ``part`` makes them of crossings."""
    theory, (_, truth) = runs.run(name, "bca"), _truth(runs, name)
    return math.nan if theory is None else _off(part(theory.crossing_time), part(truth.crossing_time), window)


def _without_striker(window: Window, runs: Runs, name: str) -> float:
    """Return the largest deviation of eq. 3.7 as printed, without T_0, from times counted from the impact."""
    theory, (_, truth) = runs.run(name, "bca"), _truth(runs, name)
    return math.nan if theory is None else _off(_since_first(theory.crossing_time), truth.crossing_time, window)


def _off(values: Floats, truth: Floats, window: Window) -> float:
    """Return the largest relative deviation of values by cylinder in a window."""
    at = slice(window[0], window[1] + 1)
    return float(np.max(np.abs(values[at] / truth[at] - 1.0)))


def _arrival(crossing: Floats) -> Floats:
    """Return when the front arrives at each cylinder: at i with the crossing of contact i - 1."""
    return np.concatenate([[np.nan], crossing])


def _residence(crossing: Floats) -> Floats:
    return np.asarray(np.diff(crossing, prepend=np.nan))


def _since_first(crossing: Floats) -> Floats:
    """Return when the front has passed each cylinder, with the crossing of contact i, from the first crossing on."""
    return np.asarray(crossing - crossing[0])


def _residual(window: Window, runs: Runs, name: str) -> float:
    return speed_power_law(*_truth(runs, name), first=window[0], last=window[1]).residual


def _later(bodies: Sequence[int], worst: Callable[..., float], runs: Runs, name: str) -> float:
    """Return the largest share of the first pulse up to which a later one counts, at the worst of some bodies."""
    scene, truth = _truth(runs, name)

    def largest(body: int) -> float:
        low, high = LEAST_SHARE, 0.999
        for _ in range(12):  # to 0.2 % of the share
            middle = math.sqrt(low * high)
            counts = secondary_fronts(scene, truth, body, share=middle).count > 0
            low, high = (middle, high) if counts else (low, middle)
        return low

    return worst(largest(body) for body in bodies)


def _duration(bodies: Sequence[int], runs: Runs, name: str) -> float:
    return max(abs(claims_pulses.scaled_duration(body).of(*_truth(runs, name)) - 1.0) for body in bodies)


def _exponents(part: float, runs: Runs, name: str) -> float:
    """Return the largest relative deviation from 2/5 over windows of a part of the range, each half beside the next."""
    scene, truth = _truth(runs, name)
    first, last = inner_contacts(scene)
    size = round(part * (last - first + 1))
    windows = [(start, start + size - 1) for start in range(first, last - size + 2, size // 2)]
    slopes = [force_exponent(scene, truth, window=window).slope for window in windows]
    return max(abs(slope / 0.4 - 1.0) for slope in slopes)


def _claimed_exponents(runs: Runs, name: str) -> float:
    return max(abs(slope / 0.4 - 1.0) for slope in force_exponent(*_truth(runs, name)).spread)


def _gradients(runs: Runs, chain: str) -> list[str]:
    return [name for gamma in GRADIENTS if runs.has(name := f"{chain}.gamma{gamma:g}")]


def _least_fall(window: Window, runs: Runs, chain: str) -> float:
    """Return the smallest relative fall of V_out/V_in from one mass gradient to the next."""
    values = np.array([_speed_ratio(window, runs, name) for name in _gradients(runs, chain)])
    return float(np.min(1.0 - values[1:] / values[:-1])) if len(values) > 1 else math.nan


def _gradient_by_bca(window: Window, runs: Runs, chain: str) -> float:
    """Return the largest deviation of V_out/V_in by the BCA over mass gradients."""
    theories = {name: runs.run(name, "bca") for name in _gradients(runs, chain)}
    first, last = window
    ratios = [
        speed_ratio(runs.scenes[name], theory, first=first, last=last).ratio / _speed_ratio(window, runs, name)
        for name, theory in theories.items()
        if theory is not None
    ]
    return max((abs(ratio - 1.0) for ratio in ratios), default=math.nan)


def _shift(spectrum: Callable[[Scene, Trajectory], Spectrum], place: int, runs: Runs, name: str) -> float:
    """Return the shift of the centroid: 0 over a tenth of the way; 1 and 2 the least and largest over other shares."""
    result = cascade(spectrum(*_truth(runs, name)))
    shifts = sorted(max(ratio, 1.0 / ratio) - 1.0 for ratio in result.spread)
    return (max(result.ratio, 1.0 / result.ratio) - 1.0, *shifts)[place]


def _spectral_growth(share: float, runs: Runs, name: str) -> float:
    return claims_pulses.growth_of_width(*_truth(runs, name), share=share) - 1.0


def _width_change(first: int, last: int, runs: Runs, name: str) -> float:
    return _loss(claims_pulses.width_kept(*_truth(runs, name), tenths=(first, last)))


def _extra_width(contact: int, runs: Runs, name: str) -> float:
    uniform = solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_velocity=1.0).width
    return float(pulse_width_by_force(*_truth(runs, name)).by_duration[contact]) / uniform - 1.0


def _tapered_slope(window: Window, runs: Runs, name: str) -> float:
    return abs(log_velocity_slope(*_truth(runs, name), *window).slope)


def _from_wave(body: int, runs: Runs, name: str) -> float:
    return claims_force.deviation_from_wave(*_truth(runs, name), settled=body)


def _least_load(first: int, runs: Runs, name: str) -> float:
    scene, truth = _truth(runs, name)
    return float(np.min(truth.peak_force[first : scene.n_body - 1])) / claims_numbers.weight_of(scene)


def _ellipse(runs: Runs, name: str) -> float:
    scene, truth = _truth(runs, name)
    return max(contact_validity(scene, truth, k).over_half_height for k in range(1, scene.n_body - 1))


# --- the criteria


def _over_windows(
    chains: Sequence[str], read: Callable[..., float], *windows: Window, worst: Callable[..., float] = max
) -> dict[str, Read]:
    """Return the worst of a number over chains in each window, ours first."""
    return {
        f"cylinders {first} to {last}": _over(chains, partial(read, (first, last)), worst) for first, last in windows
    }


def _by_theory(read: Callable[..., float], *windows: Window, quantity: str = "Largest deviation") -> Criterion:
    return Criterion(quantity=quantity, limit=claims_pulses.WELL, readings=_over_windows(MAIN, read, *windows))


def _change(
    quantity: str, limit: float, chains: Sequence[str], read: Callable[..., float], *windows: Window
) -> Criterion:
    """Return the criterion that something changes by at least a limit."""
    readings = _over_windows(chains, read, *windows, worst=min)
    return Criterion(quantity=quantity, limit=limit, readings=readings, least=True)


def _kept(
    quantity: str, limit: float, chains: Sequence[str], read: Callable[..., float], *windows: Window
) -> Criterion:
    """Return the criterion that something changes by at most a limit."""
    return Criterion(quantity=quantity, limit=limit, readings=_over_windows(chains, read, *windows))


def _further(chain: Sequence[str], bodies: Sequence[int], others: Sequence[int], *, least: bool) -> Criterion:
    worst = min if least else max
    readings = {
        f"cylinders {', '.join(map(str, places))}": _over(chain, partial(_later, places, worst), worst)
        for places in (bodies, others)
    }
    quantity = "Peak velocity of a later pulse over the first"
    return Criterion(quantity=quantity, limit=claims_pulses.SHARE, readings=readings, least=least)


def _exponent(chain: str) -> Criterion:
    readings = {"": _over([chain], _claimed_exponents)} | {
        f"windows of {100.0 * part:.0f} % of the range": _over([chain], partial(_exponents, part)) for part in SMALLER
    }
    return Criterion(quantity="Largest deviation from 2/5", limit=claims_force.REMARKABLE, readings=readings)


def _centroids(chains: Sequence[str], read: Callable[[int, Runs, str], float], *, least: bool) -> Criterion:
    """Return the criterion of a cascade over a tenth of the way, and over a twentieth and a fifth."""
    places = {"": 0, "over other shares of the way at least": 1, "at most": 2}
    readings = {name: _over(chains, partial(read, place)) for name, place in places.items()}
    limit = claims_pulses.CASCADES - 1.0
    return Criterion(quantity="Shift of the centroid", limit=limit, readings=readings, least=least)


_STEEP = [name for name in TAPERS if name != "tapered-forward"]
_CHANGED, _LATER = 1.0 - claims_pulses.KEPT, "first crossing as origin"
CRITERIA: Mapping[str, Criterion] = {
    "point-contact": Criterion(
        quantity="Longest ellipse over half-height",
        limit=1.0,
        readings={"": _over(MAIN, _ellipse)},
        form=".3g",
    ),
    "gravity-load": Criterion(
        quantity="Least peak force over the weight",
        limit=claims_numbers.TWO_ORDERS,
        readings={
            "": _over(MAIN, partial(_least_load, 1), min),
            "from contact 5 on": _over(MAIN, partial(_least_load, 5), min),
        },
        least=True,
        form=".3g",
    ),
    "velocity-by-bca": _by_theory(_velocity_by_bca, (20, 20), PROFILES, SPEEDS),
    "decelerates": _change("Fall of the speed", _CHANGED, [DECELERATING], _slowing, SPEEDS, PROFILES, QUARTER),
    "accelerates": _change("Rise of the speed", _CHANGED, [ACCELERATING], _speeding, SPEEDS, PROFILES, QUARTER),
    "no-scattering": _kept(
        "Change of the energy (contacts of a chain of 40)",
        _CHANGED,
        (*MAIN, *LONG),
        _energy_change,
        QUARTER,
        (20, 36),
        (5, 36),
        (3, 36),
    ),
    "amplitude": _kept("Variation", claims_wave.LARGE - 1.0, MAIN, _variation, PROFILES, SPEEDS, QUARTER, (1, 38)),
    "arrival-by-bca": _by_theory(partial(_by_bca, _arrival), (40, 40), PROFILES, SPEEDS, QUARTER),
    "arrival-as-printed": Criterion(
        quantity="Largest deviation",
        limit=claims_pulses.WELL,
        readings={
            **_over_windows(MAIN, _without_striker, (39, 39), PROFILES),
            f"{_LATER}, cylinder 39": _over(MAIN, partial(_by_bca, _since_first, (39, 39))),
            f"{_LATER}, cylinders 5 to 37": _over(MAIN, partial(_by_bca, _since_first, PROFILES)),
        },
    ),
    "many-fronts": _further([DECELERATING], COUNTED, OTHERS, least=True),
    "similar-pulses": Criterion(
        quantity="Largest deviation of the scaled duration from 1",
        limit=claims_pulses.WELL,
        readings={
            f"cylinders {', '.join(map(str, bodies))}": _over([DECELERATING], partial(_duration, bodies))
            for bodies in (COUNTED, (14, 18, 26))
        },
    ),
    "one-front": _further([ACCELERATING], COUNTED, OTHERS, least=False),
    "mismatch": _further([f"{DECELERATING}.matched-stiffness"], COUNTED, OTHERS, least=False),
    "small-mismatch": _further([f"{ACCELERATING}.{MISMATCHED}"], COUNTED, OTHERS, least=True),
    "residence-by-bca": _by_theory(partial(_by_bca, _residence), SPEEDS, PROFILES, QUARTER),
    "speed-power-law": _kept("Rms residual", claims_wave.RESIDUAL, MAIN, _residual, SPEEDS, PROFILES, QUARTER),
    "single-front-200": _further(LONG, (50,), (100, 150), least=False),
    "frequencies-cascade": _centroids(LONG[:1], partial(_shift, frequency_spectrum), least=True),
    "frequencies-spread": Criterion(
        quantity="Growth of the width",
        limit=claims_pulses.CASCADES - 1.0,
        readings={
            f"over {share:g} of the way": _over(LONG[1:], partial(_spectral_growth, share))
            for share in (0.1, 0.05, 0.2)
        },
        least=True,
    ),
    "wavenumbers-do-not": _centroids(LONG, partial(_shift, wavenumber_spectrum), least=False),
    "width-kept": Criterion(
        quantity="Change of the width",
        limit=_CHANGED,
        readings={
            f"tenths {first} and {last} of the chain": _over(LONG, partial(_width_change, first, last))
            for first, last in ((2, 9), (3, 9), (2, 8))
        },
    ),
    "kinetic-energy-kept": _kept(
        "Change of the kinetic energy (cylinders of a chain of 40)",
        _CHANGED,
        LONG,
        _kinetic_change,
        QUARTER,
        PROFILES,
        SPEEDS,
    ),
    "tapered": _change("Fall at 5 and 10 %", _CHANGED, _STEEP, _kinetic_fall, QUARTER, (5, 36), (10, 30)),
    "tapered-width": Criterion(
        quantity="Width beyond the uniform one",
        limit=claims_pulses.WELL,
        readings={
            f"contact {contact}": _over([*TAPERS], partial(_extra_width, contact), min) for contact in (20, 15, 25)
        },
        least=True,
    ),
    "force-exponent-decelerating": _exponent(LONG[0]),
    "force-exponent-accelerating": _exponent(LONG[1]),
    "mass-decelerates": _change("Least fall at a step", 0.0, [DECELERATING], _least_fall, SPEEDS, PROFILES, QUARTER),
    "mass-accelerates": _change("Least fall at a step", 0.0, [ACCELERATING], _least_fall, SPEEDS, PROFILES, QUARTER),
    "mass-gradient-by-bca": _by_theory(_gradient_by_bca, SPEEDS, PROFILES, QUARTER),
    "solitary": Criterion(
        quantity="Largest deviation of the reference",
        limit=claims_force.EXACT,
        readings={
            f"from cylinder {body} on": _over([claims_force.UNIFORM], partial(_from_wave, body))
            for body in (claims_force.SETTLED, 50)
        },
        form=".1e",
    ),
    "tapered-velocity": _change(
        "Least change of ln(velocity) per sphere",
        0.01,
        [*claims_force.TAPERED],
        _tapered_slope,
        (15, 35),
        PROFILES,
        QUARTER,
    ),
}
