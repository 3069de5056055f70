"""Recompute the margins of the claims on Chaunsali, Kim & Yang (2018): each criterion's quantity in several windows.

This script imports nothing of ``dem_bridge``. It solves the chains as ``recompute_claims.py`` beside it does, and reads
off by its own formulas what each claim limits, in the window of the claim and in others. It also solves the chains with
dissipation and with other exponents, by DOP853. ``tests/studies/paper/test_recomputed.py`` compares both.

Run it with ``python reports/independent/recompute_margins.py [FILE]`` (default: ``margins.json`` beside the script); it
takes about two minutes. The exact solitary wave (claim 45) is left out: this integrator is good to 1e-8 there.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from recompute_claims import (
    CROSSINGS,
    CYLINDER_MASS,
    DENSITY,
    GRAVITY,
    RADIUS,
    SPEED,
    STRIKER_MASS,
    YOUNG,
    Chain,
    Floats,
    Number,
    Run,
    angle_of,
    chains_of_40,
    collision_times,
    contact_state,
    front_energy,
    front_velocity,
    integrate,
    largest_force,
    paper_chain,
    passage_width,
    pulses,
    stacked,
    tapered_chain,
    window_energy,
)
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.optimize import brentq, curve_fit
from scipy.signal import find_peaks
from scipy.special import gamma

MAIN = ("decelerating-40", "accelerating-40")
LONG = ("decelerating-200", "accelerating-200")
#: windows of a chain of 40 by their names, cylinders first and last
SPEEDS, PROFILES, QUARTER = (3, 38), (5, 37), (10, 36)
GRADIENTS = tuple(round(0.0025 * i, 4) for i in range(-8, 9))


def named(window: tuple[int, int]) -> str:
    """Return the name of a window."""
    return f"cylinders {window[0]} to {window[1]}"


def residence(run: Run) -> Floats:
    """Return the residence time of cylinder i at i, s."""
    return np.r_[np.nan, np.diff(run.crossing[0])]


def loss(ratio: float) -> float:
    """Return how far a ratio or its inverse is below 1."""
    return 1.0 - min(ratio, 1.0 / ratio)


def of_speeds(runs: dict[str, Run]) -> Iterator[Number]:
    """Yield V_out/V_in, fits of V, amplitudes and deviations of the BCA over windows."""
    for name, claim, sign in ((MAIN[0], "decelerates", -1.0), (MAIN[1], "accelerates", 1.0)):
        for first, last in (SPEEDS, PROFILES, QUARTER):
            time = residence(runs[name])
            yield Number(claim, named((first, last)), sign * (time[first] / time[last] - 1.0), "V_out/V_in less 1")
    for window in (SPEEDS, PROFILES, QUARTER):
        worst = max(residual(runs[name], window) for name in MAIN)
        yield Number("speed-power-law", named(window), worst, "rms of V over (b1 + b2 i)^(2/5), less 1")
    for window in (PROFILES, SPEEDS, QUARTER, (1, 38)):
        at = slice(window[0], window[1] + 1)
        peaks = [front_velocity(runs[name])[at] for name in MAIN]
        spread = max(float(v.max() / v.min() - 1.0) for v in peaks)
        yield Number("amplitude", named(window), spread, "largest peak velocity over smallest, less 1")
    for window in ((20, 20), PROFILES, SPEEDS):
        at = slice(window[0], window[1] + 1)
        off = max(float(np.max(np.abs(0.713 / front_velocity(runs[name])[at] - 1.0))) for name in MAIN)
        yield Number("velocity-by-bca", named(window), off, "0.713 m/s over the peak velocity, less 1")


def residual(run: Run, window: tuple[int, int]) -> float:
    """Return the rms of V_i over its least-squares fit of (b1 + b2 i)^(2/5), less 1."""
    body = np.arange(window[0], window[1] + 1)
    speed = 1.0 / residence(run)[body]
    speed = speed / speed.mean()

    def law(i: Floats, b1: float, b2: float) -> Floats:
        return np.maximum(b1 + b2 * (i - body.mean()), 1e-9) ** 0.4

    guess = np.polyfit(body - body.mean(), speed**2.5, 1)[::-1]
    best, _ = curve_fit(law, body, speed, p0=guess, xtol=1e-13, ftol=1e-13)
    return float(np.sqrt(np.mean((law(body, *best) / speed - 1.0) ** 2)))


def of_theory(runs: dict[str, Run]) -> Iterator[Number]:
    """Yield the largest deviations of arrivals and residence times by the BCA over windows."""

    def worst(
        quantity: Callable[[Floats], Floats], other: Callable[[Floats], Floats], window: tuple[int, int]
    ) -> float:
        at, off = slice(window[0], window[1] + 1), []
        for name in MAIN:
            theory, crossing = np.cumsum(collision_times(runs[name].chain)), runs[name].crossing[0]
            off.append(np.max(np.abs(quantity(theory)[at] / other(crossing)[at] - 1.0)))
        return float(max(off))

    def arrival(times: Floats) -> Floats:
        return np.r_[np.nan, times]

    def since_first(times: Floats) -> Floats:
        return times - times[0]

    def between(times: Floats) -> Floats:
        return np.r_[np.nan, np.diff(times)]

    for window in ((40, 40), PROFILES, SPEEDS, QUARTER):
        yield Number("arrival-by-bca", named(window), worst(arrival, arrival, window), "sum of T_j from 0 over arrival")
    for window in (SPEEDS, PROFILES, QUARTER):
        yield Number("residence-by-bca", named(window), worst(between, between, window), "T_i over residence time")
    for window in ((39, 39), PROFILES):
        value = worst(since_first, lambda times: times, window)
        yield Number("arrival-as-printed", named(window), value, "sum of T_j from 1 over the time since the impact")
    for where, window in (("cylinder 39", (39, 39)), ("cylinders 5 to 37", PROFILES)):
        value = worst(since_first, since_first, window)
        yield Number("arrival-as-printed", f"first crossing as origin, {where}", value, "the same since c_0")


def later_share(run: Run, body: int) -> float:
    """Return the largest later pulse of a body over the first: the lesser of its height and its rise above dips."""
    v, first = run.v[:, body], front_velocity(run)[body]
    # the front has left a body when the contact behind it is at its maximum
    start = int(np.searchsorted(run.time, run.crossing[0][body]))
    rows, found = find_peaks(v, height=1e-6 * first, prominence=1e-6 * first)
    shares = np.minimum(found["peak_heights"], found["prominences"])[rows > start] / first
    return float(shares.max()) if len(shares) else 0.0


def of_trailing(runs: dict[str, Run], long: dict[str, Run]) -> Iterator[Number]:
    """Yield the largest later pulses at cylinders of the claims and at others."""
    chains = {
        "many-fronts": ([runs[MAIN[0]]], min),
        "one-front": ([runs[MAIN[1]]], max),
        "mismatch": ([runs[f"{MAIN[0]}.matched-stiffness"]], max),
        "small-mismatch": ([runs[f"{MAIN[1]}.mismatched-stiffness"]], min),
        "single-front-200": (list(long.values()), max),
    }
    for claim, (of, worst) in chains.items():
        groups = ((50,), (100, 150)) if claim == "single-front-200" else ((10, 20, 30), (6, 14, 18, 26, 34))
        for bodies in groups:
            # shares are looked for from a thousandth on
            value = max(1e-3, worst(later_share(run, body) for run in of for body in bodies))
            yield Number(claim, f"cylinders {', '.join(map(str, bodies))}", value, "later pulse over the first")
    for bodies in ((10, 20, 30), (14, 18, 26)):
        off = []
        for body in bodies:
            first, second = pulses(runs[MAIN[0]], body)[:2]
            off.append(abs(second.duration / first.duration * (second.velocity / first.velocity) ** 0.2 - 1.0))
        yield Number("similar-pulses", f"cylinders {', '.join(map(str, bodies))}", max(off), "scaled duration less 1")


def of_energies(runs: dict[str, Run], long: dict[str, Run]) -> Iterator[Number]:
    """Yield what the fronts keep over windows, and their share of the striker's energy."""
    for first, last in (QUARTER, (20, 36), (5, 36), (3, 36)):
        changes = [loss(window_energy(runs[name], last) / window_energy(runs[name], first)) for name in MAIN]
        changes += [loss(window_energy(long[name], 5 * last) / window_energy(long[name], 5 * first)) for name in LONG]
        yield Number("no-scattering", named((first, last)), max(changes), "energy in a window of five contacts")
    for first, last in (QUARTER, PROFILES, SPEEDS):
        changes = [loss(front_energy(long[name], 5 * last) / front_energy(long[name], 5 * first)) for name in LONG]
        yield Number("kinetic-energy-kept", named((first, last)), max(changes), "m v^2/2 of one cylinder")
    striker = 0.5 * STRIKER_MASS * SPEED**2
    for name in MAIN:
        for contact in (3, 10, 36):
            label = f"share of the striker's energy in the front at contact {contact}, {name}"
            yield Number("no-scattering", label, window_energy(runs[name], contact) / striker, "five contacts")
    alone = front_velocity(runs[f"{MAIN[0]}.matched-stiffness"])[20]
    both = front_velocity(runs[MAIN[0]])[20]
    name = f"factor of the pulse's width, {MAIN[0]}"
    yield Number("velocity-by-bca", name, 0.713 / alone, "0.713 m/s over the peak velocity with beta_0 = beta_1")
    name = f"factor of the second pulse, {MAIN[0]}"
    yield Number("velocity-by-bca", name, alone / both, "peak velocity with beta_0 = beta_1 over that without")


def of_validity(runs: dict[str, Run]) -> Iterator[Number]:
    """Yield ellipses, loads and times of contact in the chain."""
    states = {name: [contact_state(runs[name], contact) for contact in range(40)] for name in MAIN}
    longest = max(state["ellipse"] for name in MAIN for state in states[name][1:])
    yield Number("point-contact", "ours", longest, "semi-major axis over half the height")
    weight = 40 * CYLINDER_MASS * GRAVITY
    for first, window in ((1, "ours"), (5, "from contact 5 on")):
        least = min(largest_force(runs[name], contact) for name in MAIN for contact in range(first, 40)) / weight
        yield Number("gravity-load", window, least, "least peak force over 40 m g")
    sound = 2.0 * RADIUS * np.sqrt(DENSITY / YOUNG)
    for name in MAIN:
        loaded = np.array([loaded_time(runs[name], contact) for contact in range(40)]) / sound
        label = f"fewest crossings, in the chain, {name}"
        yield Number("lumped-mass", label, float(loaded.min()), "time above 1 % of the first peak force")
        label = f"contacts below ten crossings, in the chain, {name}"
        yield Number("lumped-mass", label, int(np.sum(loaded < CROSSINGS)), "the same")
        energy = max(vibration(runs[name], contact) for contact in range(40))
        label = f"largest share of energy in vibration (Hunter), {name}"
        yield Number("lumped-mass", label, energy, "1.04 (v/c)^(3/5), v of a collision with the peak force")


def loaded_time(run: Run, contact: int, share: float = 0.01) -> float:
    """Return how long the force of a contact stays above a share of its first peak, s."""
    times, forces = run.crossing
    overlap, rate = run.overlap[:, contact], run.v[:, contact] - run.v[:, contact + 1]
    level = (share * forces[contact] / run.chain.stiffness[contact]) ** (2.0 / 3.0)
    peak, above = int(np.searchsorted(run.time, times[contact])), overlap > level

    def at(row: int) -> float:
        pick = slice(row, row + 2)
        return float(brentq(CubicHermiteSpline(run.time[pick], overlap[pick] - level, rate[pick]), *run.time[pick]))

    rise, fall = np.flatnonzero(~above[:peak])[-1], peak + np.flatnonzero(~above[peak:])[0] - 1
    return at(int(fall)) - at(int(rise))


def vibration(run: Run, contact: int) -> float:
    """Return 1.04 (v/c)^(3/5) for two bodies that collide with the peak force of a contact (exact Hertz law)."""
    crossings = contact_state(run, contact)["crossings"]
    force, mu = largest_force(run, contact), 1.0 / np.sum(1.0 / run.chain.mass[contact : contact + 2])
    # t = 2.9432... d/v and v^2 = 0.8 F d/mu: v = 0.8 F t/(2.9432... mu)
    shape = 2.0 * np.sqrt(np.pi) * gamma(1.4) / gamma(0.9)
    time = crossings * 2.0 * RADIUS * np.sqrt(DENSITY / YOUNG)
    return float(1.04 * (0.8 * force * time / (shape * mu) / np.sqrt(YOUNG / DENSITY)) ** 0.6)


def of_weight(runs: dict[str, Run], factor: float) -> Iterator[Number]:
    """Yield the largest effects of weight on single cylinders from 5 to 37."""
    stacks = [stacked(runs[name].chain, weight=weight) for name in MAIN for weight in (False, True)]
    made = integrate(stacks, 1.2e-3, factor * 1e-7, round(4 / factor))
    for row, name in enumerate(MAIN):
        without, heavy = made[2 * row], made[2 * row + 1]
        at = slice(5, 38)
        before, after = residence(without)[at], residence(heavy)[at]
        label = "largest change of"
        ratios = {"front speed": before / after, "residence time": after / before}
        ratios["peak velocity"] = front_velocity(heavy)[at] / front_velocity(without)[at]
        for quantity, ratio in ratios.items():
            change = 1.0 + float(np.max(np.abs(ratio - 1.0)))
            yield Number("gravity-neglected", f"{label} {quantity}, {name}", change, "with the weight over without it")


def of_long(long: dict[str, Run]) -> Iterator[Number]:
    """Yield exponents over smaller windows, spectra and widths in the chains of 200."""
    for name in LONG:
        claim = f"force-exponent-{name.split('-')[0]}"
        yield Number(claim, "ours", exponents(long[name], (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)), "slope over 2/5, less 1")
        for part in (0.25, 0.1):
            label = f"windows of {100 * part:.0f} % of the range"
            yield Number(claim, label, exponents(long[name], (part,), beside=True), "the same")
    in_time = {name: spectrum_in_time(long[name]) for name in LONG}
    along = {name: spectrum_along(long[name]) for name in LONG}
    for claim, spectra in (("frequencies-cascade", {LONG[0]: in_time[LONG[0]]}), ("wavenumbers-do-not", along)):
        shifts = [
            [end_over_start(at, centre, share) for share in (0.1, 0.05, 0.2)] for at, centre, _ in spectra.values()
        ]
        folded = [[max(ratio, 1.0 / ratio) - 1.0 for ratio in row] for row in shifts]
        yield Number(claim, "ours", max(row[0] for row in folded), "shift of the centroid over a tenth of the way")
        yield Number(
            claim, "over other shares of the way at least", max(min(row) for row in folded), "a twentieth, a fifth"
        )
        yield Number(claim, "at most", max(max(row) for row in folded), "the same")
    _, _, width = in_time[LONG[1]]
    for share in (0.1, 0.05, 0.2):
        count = int(share * len(width))
        growth = float(np.exp(np.mean(np.log(width[-count:])) - np.mean(np.log(width[:count])))) - 1.0
        yield Number(
            "frequencies-spread", f"over {share:g} of the way", growth, "width at the end over the start, less 1"
        )
    widths = {name: widths_in_cylinders(long[name]) for name in LONG}
    for first, last in ((2, 9), (3, 9), (2, 8)):
        means = [[np.nanmean(w[20 * (tenth - 1) : 20 * tenth]) for tenth in (first, last)] for w in widths.values()]
        value = max(loss(float(late / early)) for early, late in means)
        yield Number(
            "width-kept", f"tenths {first} and {last} of the chain", value, "width at half force, in cylinders"
        )


def exponents(run: Run, parts: Sequence[float], *, beside: bool = False) -> float:
    """Return the largest deviation from 2/5 of the slope of ln F over ln beta in windows of contacts 20 to 189."""
    x, y = np.log(run.chain.stiffness[20:190]), np.log(run.crossing[1][20:190])
    slopes = []
    for part in parts:
        size = round(part * len(x))
        rest = len(x) - size
        starts = range(0, rest + 1, size // 2) if beside else (0, rest // 2, rest)
        slopes += [np.polyfit(x[a : a + size] - x[a], y[a : a + size], 1)[0] for a in starts]
    return float(np.max(np.abs(np.array(slopes) / 0.4 - 1.0)))


def spectrum_in_time(run: Run) -> tuple[Floats, Floats, Floats]:
    """Return cylinders, centroid and width of the spectrum of their velocity until the wave is at the last cylinder."""
    bodies, step = np.arange(20, 190), run.time[1]
    rows = int(np.searchsorted(run.time, run.crossing[0][-1], side="right"))
    power = np.abs(np.fft.rfft(run.v[:rows, bodies], axis=0)) ** 2
    power[1:] *= 2.0
    return (bodies.astype(float), *moments(np.fft.rfftfreq(rows, step), power))


def spectrum_along(run: Run) -> tuple[Floats, Floats, Floats]:
    """Return places of the front, and centroid and width of the spectrum of all velocities at these times."""
    bodies = np.arange(20, 190)
    arrival = run.crossing[0][bodies - 1]
    rows = np.flatnonzero((run.time >= arrival[0]) & (run.time <= arrival[-1]))
    power = np.abs(np.fft.rfft(run.v[rows, 1:].T, axis=0)) ** 2
    power[1:-1] *= 2.0
    return (np.interp(run.time[rows], arrival, bodies), *moments(np.fft.rfftfreq(run.v.shape[1] - 1), power))


def moments(frequency: Floats, power: Floats) -> tuple[Floats, Floats]:
    """Return the mean and the standard deviation of the frequency, weighted by the power, of each column."""
    weight = power / power.sum(axis=0)
    mean = frequency @ weight
    return mean, np.sqrt(np.maximum(frequency**2 @ weight - mean**2, 0.0))


def end_over_start(place: Floats, centre: Floats, share: float) -> float:
    """Return the geometric mean of centroids over the last share of the way over that over the first."""
    reach = share * (place[-1] - place[0])
    early, late = (np.mean(np.log(centre[end])) for end in (place <= place[0] + reach, place >= place[-1] - reach))
    return float(np.exp(late - early))


def widths_in_cylinders(run: Run) -> Floats:
    """Return the width of the front at half force as each contact has its peak: between the places of both edges."""
    times, forces = run.crossing
    overlap, rate = run.overlap, run.v[:, :-1] - run.v[:, 1:]
    edges = np.full((2, len(times)), np.nan)
    for contact in range(len(times)):
        level = (0.5 * forces[contact] / run.chain.stiffness[contact]) ** (2.0 / 3.0)
        peak, above = int(np.searchsorted(run.time, times[contact])), overlap[:, contact] > level
        before, after = np.flatnonzero(~above[:peak]), np.flatnonzero(~above[peak:])
        for edge, rows in ((0, before[-1:]), (1, peak + after[:1] - 1)):
            for row in rows:
                pick = slice(row, row + 2)
                curve = CubicHermiteSpline(run.time[pick], overlap[pick, contact] - level, rate[pick, contact])
                if curve(run.time[row]) * curve(run.time[row + 1]) < 0.0:
                    edges[edge, contact] = brentq(curve, *run.time[pick], xtol=1e-18)
    inner = slice(5, 196)
    places = [CubicSpline(edge[inner], np.arange(5, 196), extrapolate=False)(times) for edge in edges]
    return np.asarray(places[0] - places[1])


def of_tapers(factor: float) -> Iterator[Number]:
    """Yield kinetic energies, widths and slopes of tapered chains over windows."""
    settings = {0.98: (1e-7, 1.0e-3), 0.95: (5e-8, 6e-4), 0.9: (1e-8, 3e-4)}
    runs = {
        ratio: integrate([tapered_chain(ratio)], duration, factor * step, round(4 / factor))[0]
        for ratio, (step, duration) in settings.items()
    }
    for first, last in (QUARTER, (5, 36), (10, 30)):
        fall = min(1.0 - front_energy(runs[ratio], last) / front_energy(runs[ratio], first) for ratio in (0.95, 0.9))
        yield Number("tapered", named((first, last)), fall, "fall of m v^2/2 of one sphere at tapers of 5 and 10 %")
    uniform = integrate([tapered_chain(1.0)], 1.2e-3, factor * 1e-7, round(4 / factor))[0]
    for contact in (20, 15, 25):
        # the pulse of a uniform chain has settled at contact 30
        wider = min(passage_width(run, contact) for run in runs.values()) / passage_width(uniform, 30) - 1.0
        yield Number("tapered-width", f"contact {contact}", wider, "width over the uniform one, less 1")
    rising = integrate([tapered_chain(1.0 / 0.98, radius=4e-3)], 1.2e-3, factor * 1e-7, round(4 / factor))[0]
    for first, last in ((15, 35), PROFILES, QUARTER):
        at = np.arange(first, last + 1)
        slopes = [np.polyfit(at, np.log(front_velocity(run)[at]), 1)[0] for run in (runs[0.98], rising)]
        yield Number(
            "tapered-velocity", named((first, last)), min(abs(s) for s in slopes), "slope of ln(peak velocity)"
        )


def of_gradients(factor: float) -> Iterator[Number]:
    """Yield V_out/V_in over mass gradients, simulated and by the BCA, over windows."""
    off: dict[tuple[int, int], list[float]] = {}
    for claim, rising in (("mass-decelerates", False), ("mass-accelerates", True)):
        chains = [paper_chain(rising=rising, gradient=gamma) for gamma in GRADIENTS]
        runs = integrate(chains, 1.6e-3, factor * 1e-7, round(4 / factor))
        theories = [np.r_[np.nan, collision_times(chain)[1:]] for chain in chains]
        for window in (SPEEDS, PROFILES, QUARTER):
            ratios = np.array([residence(run)[window[0]] / residence(run)[window[1]] for run in runs])
            by_theory = np.array([theory[window[0]] / theory[window[1]] for theory in theories])
            off.setdefault(window, []).append(float(np.max(np.abs(by_theory / ratios - 1.0))))
            yield Number(claim, named(window), float(np.min(1.0 - ratios[1:] / ratios[:-1])), "least fall at a step")
    for window, values in off.items():
        yield Number("mass-gradient-by-bca", named(window), max(values), "V_out/V_in by BCA over simulated, less 1")


# ----------------------------------------------------------------------------------------------------------------------
# chains with dissipation and other exponents, by DOP853


def dissipative(chain: Chain, *, dashpot: float = 0.0, viscous: float = 0.0, drag: float = 0.0,
                exponent: Floats | None = None) -> float:  # fmt: skip
    """Return the residence time of cylinder 20, s.

    The force of a contact is beta d^(n-1) + c d' + gamma beta sqrt(d) d', and 0 where that pulls; drag is -m b v.
    """
    count, n = len(chain.mass), np.full(len(chain.stiffness), 2.5) if exponent is None else exponent

    def rate(_: float, state: Floats) -> Floats:
        x, v = state[:count], state[count:]
        depth, closing = np.maximum(x[:-1] - x[1:], 0.0), v[:-1] - v[1:]
        force = chain.stiffness * depth ** (n - 1.0)
        force = np.where(
            depth > 0.0, force + dashpot * closing + viscous * chain.stiffness * np.sqrt(depth) * closing, 0
        )
        force = np.maximum(force, 0.0)
        return np.r_[v, (np.r_[0.0, force] - np.r_[force, 0.0]) / chain.mass - drag * v]

    end = 1.2 * float(np.sum(collision_times(chain)[:21])) * (2.0 if dashpot > 10.0 else 1.0)
    start = np.r_[np.zeros(count), chain.velocity]
    run = solve_ivp(rate, (0.0, end), start, "DOP853", rtol=1e-9, atol=1e-15, dense_output=True)
    times = [first_maximum(run.sol, contact, count, end) for contact in (19, 20)]
    return times[1] - times[0]


def first_maximum(solution: Callable[[float], Floats], contact: int, count: int, end: float) -> float:
    """Return the first time at which the closing rate of a contact falls through zero, after a large overlap."""
    grid = np.linspace(0.0, end, 4000)
    states = np.array([solution(t) for t in grid])
    rate = states[:, count + contact] - states[:, count + contact + 1]
    overlap = states[:, contact] - states[:, contact + 1]
    row = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0) & (overlap[1:] > 0.05 * overlap.max()))[0]

    def closing(t: float) -> float:
        state = solution(t)
        return float(state[count + contact] - state[count + contact + 1])

    return float(brentq(closing, grid[row], grid[row + 1], xtol=1e-16))


def of_dissipation() -> Iterator[Number]:
    """Yield the speed at cylinder 20 with dissipation, or another exponent, over that without."""
    for name, rising in zip(MAIN, (False, True), strict=True):
        chain = paper_chain(rising=rising)
        base = dissipative(chain)
        changes = {
            "dashpot": {"dashpot": 1.0},
            "strong-dashpot": {"dashpot": 300.0},
            "kuwabara-kono": {"viscous": 1e-8},
            "drag": {"drag": 10.0},
        }
        for term, settings in changes.items():
            label = f"speed at cylinder 20, {term}, {name}"
            yield Number("slower-by-dissipation", label, base / dissipative(chain, **settings), "over the elastic one")
        angles = np.r_[90.0, [angle_of(beta) for beta in chain.stiffness[1:]]]
        n = 2.2 + 0.3 * (angles - 2.0) / 88.0
        for term, depth in (("exponent-1um", 1e-6), ("exponent-5um", 5e-6)):
            other = replace(chain, stiffness=chain.stiffness * depth ** (2.5 - n))
            label = f"speed at cylinder 20, {term}, {name}"
            yield Number("slower-by-exponent", label, base / dissipative(other, exponent=n), "over Hertz'")


def numbers(factor: float = 1.0) -> list[Number]:
    """Return all numbers, at steps of ``factor`` times the usual ones."""
    chains = chains_of_40()
    runs = dict(zip(chains, integrate(list(chains.values()), 3.0e-3, factor * 1e-7, round(4 / factor)), strict=True))
    long_chains = [paper_chain(rising=rising, count=200, like_first=True) for rising in (False, True)]
    long = dict(zip(LONG, integrate(long_chains, 3.0e-3, factor * 2e-7, round(4 / factor)), strict=True))
    return [
        *of_speeds(runs),
        *of_theory(runs),
        *of_trailing(runs, long),
        *of_energies(runs, long),
        *of_validity(runs),
        *of_weight(runs, factor),
        *of_long(long),
        *of_tapers(factor),
        *of_gradients(factor),
    ]


def main(file: Path) -> None:
    """Print all numbers and write them to a file."""
    fine, coarse = numbers(), numbers(2.0)
    items = [
        asdict(a) | {"change at twice the step": abs(float(b.value) - float(a.value))}
        for a, b in zip(fine, coarse, strict=True)
    ]
    items += [asdict(number) for number in of_dissipation()]
    for item in items:
        item["value"] = float(item["value"])
        print(f"{item['claim']}: {item['name']}: {item['value']:.6g}; {item['definition']}")
    result = {"schema": "recomputed-margins/1", "numbers": items}
    file.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("margins.json"))
