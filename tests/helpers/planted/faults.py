"""Plant a fault in the run of a chain, and say which causes are true for it and how many floors its effect has.

The floor of a file is the largest of half a unit of its last digit, the time-step error of a right integrator at the
same step, and round-off; the effect is the largest change that the fault makes, each by runs at fine steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.helpers.planted.chains import FAMILIES, Chain, Floats, contact_time, damping_terms
from tests.helpers.planted.motion import advance, dop853, exact

#: causes of a factor on all stiffnesses; no trajectory tells them apart in one material with equal radii
UNIFORM = frozenset({"stiffness-scale", "modulus"})
SHIFTED = frozenset({"time-shift", "sampling-shift"})
HALF = frozenset({"half-step-velocity", "first-order-integrator"})
#: quantity -> exponents of length and time in its unit
DIMENSIONS = {"displacement": (1, 0), "velocity": (1, -1)}


@dataclass(frozen=True, kw_only=True)
class Setting:
    """How a code runs a chain and what it writes."""

    integrator: str = "verlet"
    """verlet, position-verlet, rk4, dop853, or fine (the exact motion)."""
    stride: int = 20
    """Steps per row of the file."""
    rows: int = 201
    interval: float
    """Time between rows, s."""
    digits: int = 12
    quantities: tuple[str, ...] = ("displacement", "velocity")
    bodies: tuple[int, ...] | None = None
    """Bodies in the file; None: all."""
    dt_stated: bool = True

    @property
    def dt(self) -> float:
        """Time step, s."""
        return self.interval / self.stride


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """Samples as a code holds them before it writes them: times, and quantities of all bodies."""

    time: Floats
    values: Mapping[str, Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class Planted:
    """A file's contents with the causes that are true for it."""

    chain: Chain
    """The chain of the scene, without the fault."""
    setting: Setting
    fault: str
    parameters: Mapping[str, Any]
    truth: frozenset[str]
    """Causes that are true, by the list of faults that no trajectory can tell apart."""
    also: frozenset[str] = frozenset()
    """Further causes that may explain the file to its floor, so that to name them is not wrong."""
    parts: tuple[frozenset[str], ...] = ()
    """Of two faults at once: the causes that are true for each."""
    where: int | None = None
    """Body or contact of the fault."""
    effect: float
    """Largest change by the fault over the floor of the file, the largest of all quantities."""
    floor: Mapping[str, float]
    run: Run


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """What a fault does: to the chain, to the way it is run, and to the samples."""

    chain: Chain
    truth: frozenset[str]
    also: frozenset[str] = frozenset()
    parts: tuple[frozenset[str], ...] = ()
    where: int | None = None
    method: str | None = None
    velocity: str = "same"
    """same, earlier (half a step before) or later."""
    single: float | None = None
    """Distance of bodies in the positions of a single-precision code, m; 0: displacements; None: double precision."""
    samples: Callable[[Run], Run] = field(default=lambda run: run)
    parameters: Mapping[str, Any] = field(default_factory=dict)


def integrate(chain: Chain, setting: Setting, change: Change | None = None) -> Run:
    """Return the samples of a code that runs this chain, in this setting and with this change."""
    method = setting.integrator if change is None or change.method is None else change.method
    if method == "fine":
        x, v = exact(chain, setting.interval, setting.rows)
    elif method == "dop853":
        x, v = dop853(chain, setting.interval * np.arange(float(setting.rows)))
    else:
        single = None if change is None else change.single
        x, v, earlier = advance(
            chain, method, setting.dt, setting.stride, setting.rows, single=single is not None, spacing=single or 0.0
        )
        if change is not None and change.velocity != "same":
            v = earlier if change.velocity == "earlier" else 2.0 * v - earlier
    run = Run(time=setting.interval * np.arange(float(setting.rows)), values={"displacement": x, "velocity": v})
    return run if change is None else change.samples(run)


def right_run(chain: Chain, time: Floats) -> tuple[NDArray[np.bool_], Run]:
    """Return the exact motion of a chain at the times of a file, and the rows for which it is computed.

    Rows later than three durations are left out, since a wrong unit of time would make the run long.
    """
    rows = time <= 3.0 * chain.duration
    begin, interval = float(time[0]), float(time[1] - time[0])
    if rows.sum() < 2:
        rows = np.zeros(len(time), dtype=bool)
        rows[0] = True
    if abs(begin) < 1e-9 * interval:
        x, v = exact(chain, min(interval, chain.duration), int(rows.sum()))
    else:
        x, v = (values[1:] for values in dop853(chain, np.append(0.0, time[rows]), rtol=1e-12, compiled=True))
    return rows, Run(time=time[rows], values={"displacement": x, "velocity": v})


def half_unit(values: Floats, digits: int) -> float:
    """Return half a unit of the last digit of the largest value, in a file of so many significant digits."""
    largest = float(np.max(np.abs(values)))
    return 0.0 if largest == 0.0 else 0.5 * 10.0 ** (np.floor(np.log10(largest)) + 1 - digits)


def _shown(run: Run, setting: Setting) -> Run:
    columns = list(range(run.values["velocity"].shape[1])) if setting.bodies is None else list(setting.bodies)
    return Run(time=run.time, values={name: run.values[name][:, columns] for name in setting.quantities})


def _rows(run: Run, rows: NDArray[np.bool_]) -> Run:
    return Run(time=run.time[rows], values={name: values[rows] for name, values in run.values.items()})


def plant(chain: Chain, fault: str, setting: Setting, size: float, rng: np.random.Generator) -> Planted:
    """Return the file of a code with a fault.

    ``size`` is the size of the fault in its own measure: 0.01 is 1 % for a factor, and a share of a whole for others.
    """
    change = FAULTS[fault](chain, setting, size, rng)
    ideal = replace(setting, integrator="fine")
    # nothing in a file says that its code is better than velocity Verlet at its step
    as_verlet = change.method or change.velocity != "same" or (setting.integrator == "rk4" and setting.dt_stated)
    right_step = replace(setting, integrator="verlet") if as_verlet else setting
    run = _shown(integrate(change.chain, setting, change), setting)
    stepped = _shown(integrate(change.chain, right_step), setting)
    smooth = _shown(integrate(change.chain, ideal), setting)
    by_method = change.method is not None or change.velocity != "same" or change.single is not None
    # the fault alone, without the error of a right integrator
    faulty = run if by_method else _shown(integrate(change.chain, ideal, change), setting)
    started = run.time >= -1e-12 * chain.duration
    run, faulty = (_rows(samples, started) for samples in (run, faulty))
    if change.single is not None and change.chain is chain:
        rows, right = np.ones(len(run.time), dtype=bool), stepped
    else:
        rows, right = right_run(chain, run.time)
        right = _shown(right, setting)
    if setting.integrator in ("fine", "dop853"):
        # the error of both is at most about their difference
        other = "dop853" if setting.integrator == "fine" else "fine"
        smooth = _shown(integrate(change.chain, replace(setting, integrator=other)), setting)
    floor, effect, relative = {}, 0.0, 0.0
    for name, values in right.values.items():
        largest = float(np.max(np.abs(smooth.values[name])))
        scale = max(1.0, float(np.max(np.abs(faulty.values[name]))) / (largest or 1.0))
        error = float(np.max(np.abs(stepped.values[name] - smooth.values[name]))) * scale
        floor[name] = max(half_unit(faulty.values[name], setting.digits), error, 1e-14 * largest * scale, 1e-300)
        difference = float(np.max(np.abs(faulty.values[name][rows] - values)))
        # in a wrong unit of time nearly all rows are later than the exact motion is computed
        relative = max(relative, difference / (largest or 1.0))
        effect = max(effect, (difference if rows.sum() > 0.1 * len(rows) else largest) / floor[name])
    return Planted(
        chain=chain,
        setting=setting,
        fault=fault,
        parameters=change.parameters,
        truth=change.truth,
        # an adaptive code of an unknown tolerance errs by 1e-8 of the largest value
        also=change.also | ({"none"} if relative < 1e-8 and not setting.dt_stated else frozenset()),
        parts=change.parts,
        where=change.where,
        effect=effect,
        floor=floor,
        run=run,
    )


def _uniform_truth(chain: Chain, setting: Setting) -> tuple[frozenset[str], frozenset[str]]:
    truth = UNIFORM | ({"missing-sqrt-radius"} if chain.equal_radii else frozenset())
    if chain.n_body == 2:
        truth |= {"stiffness"}
    if setting.quantities == ("velocity",) and chain.scale_free:
        truth |= {"time-scale"}
    # all masses by the inverse factor: forces are not in these files
    return truth, frozenset({"mass"})


def _struck(chain: Chain, rng: np.random.Generator, count: int) -> int:
    """Return a body or contact in the part of the chain that the pulse has passed well before the end."""
    return int(rng.integers(0, max(1, round(0.6 * count))))


def _factor(values: Floats, factor: float | Floats, where: Any = slice(None)) -> Floats:
    values = values.copy()
    values[where] *= factor
    return values


def half_step_velocity(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    side = "earlier" if rng.random() < 0.8 else "later"
    truth = HALF if chain.starts_at_rest else frozenset({"half-step-velocity"})
    also = SHIFTED if setting.quantities == ("velocity",) else frozenset()
    return Change(chain=chain, truth=truth, also=also, method="verlet", velocity=side, parameters={"velocity": side})


def first_order_integrator(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    method = str(rng.choice(["kick-drift", "kick-drift", "drift-kick", "euler"]))
    truth = HALF if chain.starts_at_rest and method != "euler" else frozenset({"first-order-integrator"})
    also = SHIFTED if setting.quantities == ("velocity",) else frozenset()
    return Change(chain=chain, truth=truth, also=also, method=method, parameters={"method": method})


def exponent(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    change = -0.1 * size
    damping_power = np.where(chain.damping_power > 0.0, chain.damping_power + change, 0.0)
    bent = replace(chain, power=chain.power + change, damping_power=damping_power)
    return Change(chain=bent, truth=frozenset({"exponent"}), parameters={"change": change})


def missing_sqrt_radius(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    # without shapes in the scene file: the uniform factor of 9 mm spheres
    radius = np.full(len(chain.stiffness), 4.5e-3) if chain.radius is None else chain.radius
    factor = np.where(np.isfinite(radius), 1.0 / np.sqrt(radius), 1.0)
    truth, also = frozenset({"missing-sqrt-radius"}), frozenset[str]()
    if np.ptp(factor) < 1e-12 * factor[0]:
        truth, also = _uniform_truth(chain, setting)
        truth |= {"missing-sqrt-radius"}
    return Change(chain=chain.with_stiffness(factor), truth=truth, also=also)


def modulus(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    ratio = np.full(len(chain.stiffness), 2 * (1 - 0.3**2)) if chain.modulus_ratio is None else chain.modulus_ratio
    kind = str(rng.choice(["E for E*", "no Poisson's ratio"]))
    factor = np.where(np.isfinite(ratio), ratio if kind == "E for E*" else 0.5 * ratio, 1.0)
    truth, also = frozenset({"modulus"}), UNIFORM
    if np.ptp(factor) < 1e-12 * factor[0]:
        truth, also = _uniform_truth(chain, setting)
    changed = chain.with_stiffness(factor)
    return Change(chain=changed, truth=truth, also=also, parameters={"kind": kind, "factor": float(factor[0])})


def stiffness_scale(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    truth, also = _uniform_truth(chain, setting)
    changed = chain.with_stiffness(1.0 + size)
    return Change(chain=changed, truth=truth, also=also, parameters={"factor": 1.0 + size})


def mass(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    body = _struck(chain, rng, chain.n_body)
    changed = replace(chain, mass=_factor(chain.mass, 1.0 + size, body))
    return Change(chain=changed, truth=frozenset({"mass"}), where=body, parameters={"body": body, "factor": 1.0 + size})


def stiffness(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    contact = _struck(chain, rng, len(chain.stiffness))
    changed = chain.with_stiffness(_factor(np.ones(len(chain.stiffness)), 1.0 + size, contact))
    truth = frozenset({"stiffness"}) if chain.n_body > 2 else _uniform_truth(chain, setting)[0]
    return Change(chain=changed, truth=truth, where=contact, parameters={"contact": contact, "factor": 1.0 + size})


def missed_contact(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    contact = _struck(chain, rng, len(chain.stiffness))
    changed = replace(
        chain, stiffness=_factor(chain.stiffness, 0.0, contact), damping=_factor(chain.damping, 0.0, contact)
    )
    truth = frozenset({"missed-contact", "stiffness"})
    return Change(chain=changed, truth=truth, where=contact, parameters={"contact": contact})


def damping(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    if chain.damping.any():
        # the scene's own damping with another coefficient, or none
        changed = replace(chain, damping=chain.damping * (1.0 + size))
        return Change(chain=changed, truth=frozenset({"damping"}), parameters={"factor": 1.0 + size})
    inverse = np.append(1.0 / chain.mass, 0.0)
    effective = 1.0 / (inverse[chain.left] + inverse[chain.right])
    speed = float(np.max(np.abs(chain.velocity)))
    laws = ["dashpot", "mass_velocity", "kuwabara-kono", "coeff_restitution"]
    law = str(rng.choice(laws if np.all(chain.power == 1.5) else laws[:2]))
    # a contact that another fault removed has the stiffness 0
    stiffness = chain.stiffness[np.isfinite(chain.stiffness) & (chain.stiffness > 0.0)]
    if stiffness.size and np.all(chain.power == 1.5):
        duration = contact_time(float(np.median(chain.mass)), float(np.median(stiffness)), speed)
    else:
        duration = chain.duration / chain.n_body
    # coefficients that take about a share ``size`` of the speed of an impact
    value = {
        "dashpot": size * float(np.median(effective)) / duration,
        "mass_velocity": size / duration,
        "kuwabara-kono": 0.2 * size * duration,
        "coeff_restitution": 1.0 - size / (1.0 + size),
    }[law]
    factor, power = damping_terms((law, value), effective, chain.stiffness, float(chain.power[0]))
    clipped = bool(rng.random() < 0.7)
    changed = replace(chain, damping=factor, damping_power=power, clipped=clipped)
    return Change(
        chain=changed, truth=frozenset({"damping"}), parameters={"law": law, "coefficient": value, "clipped": clipped}
    )


def clip(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    return Change(chain=replace(chain, clipped=not chain.clipped), truth=frozenset({"clip"}))


def gravity(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    value = chain.gravity + 9.81 * size
    if chain.gravity:
        value = float(rng.choice([0.0, -chain.gravity]))
    changed = replace(chain, gravity=value)
    return Change(chain=changed, truth=frozenset({"gravity"}), parameters={"gravity": value})


def tension(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    return Change(chain=replace(chain, tension=True, clipped=False), truth=frozenset({"tension"}))


def _later(shift: float) -> Callable[[Run], Run]:
    return lambda run: Run(time=run.time + shift, values=run.values)


def time_shift(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    shift = float(rng.choice([-1.0, 1.0])) * size * setting.interval * 0.37
    also = HALF if setting.quantities == ("velocity",) and not setting.dt_stated else frozenset()
    return Change(
        chain=chain, truth=frozenset({"time-shift"}), also=also, samples=_later(shift), parameters={"shift": shift}
    )


def one_step_late(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    shift = setting.dt
    also = HALF if setting.quantities == ("velocity",) and not setting.dt_stated else frozenset()
    return Change(chain=chain, truth=SHIFTED, also=also, samples=_later(shift), parameters={"shift": shift})


def sampling_shift(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    shift = float(rng.choice([-1.0, 1.0])) * setting.interval
    return Change(chain=chain, truth=SHIFTED, samples=_later(shift), parameters={"shift": shift})


def time_scale(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    factor = 1.0 + size
    truth = frozenset({"time-scale"})
    also = frozenset[str]()
    if setting.quantities == ("velocity",) and chain.scale_free:
        uniform, also = _uniform_truth(chain, setting)
        truth |= uniform
    return Change(
        chain=chain,
        truth=truth,
        also=also,
        samples=lambda run: Run(time=run.time * factor, values=run.values),
        parameters={"factor": factor},
    )


def units(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    length, time = [(1e3, 1.0), (1e6, 1.0), (1e2, 1.0), (1.0, 1e3), (1e3, 1e3), (1.0, 1e6)][int(rng.integers(6))]
    only = str(rng.choice(["all", "displacement", "velocity"])) if time == 1.0 else "all"
    if only not in setting.quantities:
        only = "all"

    def scaled(run: Run) -> Run:
        values = {
            name: data * (length ** DIMENSIONS[name][0] * time ** DIMENSIONS[name][1] if only in ("all", name) else 1.0)
            for name, data in run.values.items()
        }
        return Run(time=run.time * time, values=values)

    parameters = {"length": length, "time": time, "only": only}
    truth = frozenset({"units"}) | ({"time-scale"} if time != 1.0 and length == time else frozenset())
    if time != 1.0 and setting.quantities == ("displacement",) and length == 1.0:
        truth |= {"time-scale"}
    return Change(chain=chain, truth=truth, samples=scaled, parameters=parameters)


def start_velocity(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    changed = replace(chain, velocity=chain.velocity * (1.0 + size))
    # springs that begin closed move in proportion to the start speed, so that all values are scaled
    also = frozenset({"units"}) if chain.family == "springs" else frozenset[str]()
    return Change(chain=changed, truth=frozenset({"start-velocity"}), also=also, parameters={"factor": 1.0 + size})


def sign(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    def turned(run: Run) -> Run:
        return Run(time=run.time, values={name: -data for name, data in run.values.items()})

    return Change(chain=chain, truth=frozenset({"sign"}), samples=turned)


def two_swapped(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    """The columns of two bodies that the pulse reaches are swapped."""
    first = int(rng.integers(1, max(2, chain.n_body // 2)))
    order = list(range(chain.n_body))
    order[first], order[first - 1] = order[first - 1], order[first]

    def permuted(run: Run) -> Run:
        return Run(time=run.time, values={name: data[:, order] for name, data in run.values.items()})

    return Change(
        chain=chain, truth=frozenset({"order-of-bodies"}), samples=permuted, parameters={"bodies": [first - 1, first]}
    )


def order_of_bodies(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    def turned(run: Run) -> Run:
        return Run(time=run.time, values={name: data[:, ::-1] for name, data in run.values.items()})

    return Change(chain=chain, truth=frozenset({"order-of-bodies"}), samples=turned)


def single_precision(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    spacing = float(rng.choice([0.0, 0.018]))
    method = setting.integrator if setting.integrator in ("verlet", "position-verlet", "rk4") else "verlet"
    return Change(
        chain=chain,
        truth=frozenset({"single-precision"}),
        single=spacing,
        method=method,
        parameters={"spacing": spacing},
    )


def none(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    return Change(chain=chain, truth=frozenset({"none"}))


# outside the list: no cause of the contract explains these files


def one_gap(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    contact = _struck(chain, rng, len(chain.stiffness))
    changed = replace(chain, gap=chain.gap.copy())
    changed.gap[contact] += 2e-6 * size
    # all bodies but the first see a later impact
    also = SHIFTED if contact == 0 and setting.bodies is not None and 0 not in setting.bodies else frozenset()
    return Change(
        chain=changed, truth=frozenset({"unknown"}), also=also, where=contact, parameters={"contact": contact}
    )


def drag(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    changed = replace(chain, drag=size / chain.duration)
    return Change(chain=changed, truth=frozenset({"unknown"}), also=frozenset({"damping"}))


def two_masses(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    bodies = [1, max(2, chain.n_body // 2)]
    changed = replace(chain, mass=_factor(chain.mass, np.array([1.0 + size, 1.0 - 0.7 * size]), bodies))
    return Change(chain=changed, truth=frozenset({"unknown"}), parameters={"bodies": bodies})


def noise(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    seed = int(rng.integers(1 << 30))

    def noisy(run: Run) -> Run:
        draw = np.random.default_rng(seed)
        return Run(
            time=run.time,
            values={
                k: v + 0.1 * size * np.max(np.abs(v)) * draw.standard_normal(v.shape) for k, v in run.values.items()
            },
        )

    return Change(chain=chain, truth=frozenset({"unknown"}), samples=noisy)


def offset(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    def moved(run: Run) -> Run:
        return Run(time=run.time, values={k: v + 0.1 * size * np.max(np.abs(v)) for k, v in run.values.items()})

    return Change(chain=chain, truth=frozenset({"unknown"}), samples=moved)


def softening(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    """One contact has another exponent."""
    contact = _struck(chain, rng, len(chain.stiffness))
    changed = replace(chain, power=chain.power.copy())
    changed.power[contact] -= 0.1 * size
    # in few digits one collision at one overlap hardly tells the exponent from the stiffness
    also = frozenset({"exponent"}) | ({"stiffness"} if setting.digits <= 8 else frozenset())
    return Change(chain=changed, truth=frozenset({"unknown"}), also=also, where=contact)


def swapped(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
    """Columns are in the order of strings (0, 1, 10, 11, 2, ...)."""
    order = sorted(range(chain.n_body), key=str)

    def permuted(run: Run) -> Run:
        return Run(time=run.time, values={name: data[:, order] for name, data in run.values.items()})

    return Change(chain=chain, truth=frozenset({"order-of-bodies"}), samples=permuted)


def both(first: str, second: str) -> Callable[[Chain, Setting, float, np.random.Generator], Change]:
    """Return a fault that is two faults at once."""

    def planted(chain: Chain, setting: Setting, size: float, rng: np.random.Generator) -> Change:
        seeds = rng.integers(1 << 30, size=2)
        a = FAULTS[first](chain, setting, size, np.random.default_rng(seeds[0]))
        b = FAULTS[second](a.chain, setting, size, np.random.default_rng(seeds[1]))
        return replace(
            b,
            truth=frozenset({"unknown"}),
            also=frozenset(),
            parts=(a.truth | a.also, b.truth | b.also),
            where=None,
            method=a.method or b.method,
            velocity=a.velocity if a.velocity != "same" else b.velocity,
            samples=lambda run: b.samples(a.samples(run)),
            parameters={first: dict(a.parameters), second: dict(b.parameters)},
        )

    return planted


#: the causes of the contract, and one step late
LISTED: dict[str, Callable[[Chain, Setting, float, np.random.Generator], Change]] = {
    "half-step-velocity": half_step_velocity,
    "first-order-integrator": first_order_integrator,
    "exponent": exponent,
    "missing-sqrt-radius": missing_sqrt_radius,
    "modulus": modulus,
    "mass": mass,
    "stiffness": stiffness,
    "stiffness-scale": stiffness_scale,
    "damping": damping,
    "clip": clip,
    "time-shift": time_shift,
    "one-step-late": one_step_late,
    "time-scale": time_scale,
    "units": units,
    "order-of-bodies": order_of_bodies,
    "gravity": gravity,
    "tension": tension,
    "missed-contact": missed_contact,
    "single-precision": single_precision,
    "sampling-shift": sampling_shift,
    "start-velocity": start_velocity,
    "sign": sign,
    "two-swapped": two_swapped,
    "swapped": swapped,
}
PAIRS = (
    ("mass", "stiffness"),
    ("exponent", "gravity"),
    ("damping", "mass"),
    ("half-step-velocity", "stiffness"),
    ("gravity", "stiffness"),
    ("time-shift", "exponent"),
    ("order-of-bodies", "stiffness-scale"),
    ("units", "stiffness"),
    ("missed-contact", "damping"),
)
OUTSIDE: dict[str, Callable[[Chain, Setting, float, np.random.Generator], Change]] = {
    "one-gap": one_gap,
    "drag": drag,
    "two-masses": two_masses,
    "noise": noise,
    "offset": offset,
    "softening": softening,
}
FAULTS = {"none": none, **LISTED, **OUTSIDE}
FAULTS |= {f"{first}+{second}": both(first, second) for first, second in PAIRS}
#: faults whose size is free; the others are as large as they are
SIZED = (
    *("exponent", "mass", "stiffness", "stiffness-scale", "damping", "time-shift", "time-scale", "gravity"),
    *("start-velocity", "one-gap", "drag", "two-masses", "noise", "offset", "softening"),
)
#: faults that need a kind of chain
ONLY = {
    "clip": ("damped",),
    "missing-sqrt-radius": ("spheres", "tapered", "dimer", "graded"),
    "modulus": ("spheres", "tapered", "dimer", "graded"),
    "damping": tuple(name for name in FAMILIES if name != "precompressed"),
    "tension": ("spheres", "graded", "scattered", "gaps", "falling", "springs", "dimer"),
}
