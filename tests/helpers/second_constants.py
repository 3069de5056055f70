"""Compute every constant of `export --table constants` a second time, by methods that share no formula with the first.

``python -m tests.helpers.second_constants`` writes the file that the table reads.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal, getcontext
from functools import cache

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import brentq

from dem_bridge.formats.tables.constants import damped, elastic
from dem_bridge.formats.tables.constants.constant import label
from dem_bridge.formats.tables.constants.table import SECOND_VALUES, all_constants

Values = dict[str, float]
Array = np.ndarray
#: nodes of each panel of half a grain
NODES = 18
TIGHT = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-16}


def _boxes(panels: int) -> tuple[Array, Array, Array]:
    """Return nodes, weights and the integral over a grain around each node, for even functions on half the axis."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    nodes, weights = 0.25 * (x + 1.0), 0.25 * w
    # integral from the left end of a panel to each node, by the Legendre series of its interpolant
    upto = np.empty((NODES, NODES))
    vandermonde = np.linalg.inv(np.polynomial.legendre.legvander(x, NODES - 1))
    for j in range(NODES):
        series = np.polynomial.legendre.legint(vandermonde[:, j], lbnd=-1.0)
        upto[:, j] = 0.25 * np.polynomial.legendre.legval(x, series)
    box = np.zeros((panels, NODES, panels, NODES))

    def add(row: int, column: int, block: Array) -> None:
        if column < 0:  # the function is even: the mirrored panel, with its nodes in reverse
            box[row, :, -1 - column, :] += block[:, ::-1]
        elif column < panels:
            box[row, :, column, :] += block

    for k in range(panels):
        add(k, k - 1, weights - upto)
        add(k, k, np.broadcast_to(weights, upto.shape))
        add(k, k + 1, upto)
    grid = (0.5 * np.arange(panels)[:, None] + nodes).ravel()
    return grid, np.tile(weights, panels), box.reshape(panels * NODES, panels * NODES)


@cache
def wave(n: float) -> Values:
    """Return the solitary wave from Newton's method on panels of half a grain."""
    p, panels = n - 1.0, math.ceil(2.0 * (2.0 + 4.0 / math.sqrt(n - 2.0)))
    grid, weights, box = _boxes(panels)
    tent = box @ box
    r = np.exp(-3.0 * (n - 2.0) / p * grid**2)
    for _ in range(200):
        image = np.maximum(tent @ r**p, 0.0)
        factor = (weights @ r**2) / (weights @ (r * image))
        r = factor ** (p / (p - 1.0)) * image
    for _ in range(6):
        r = np.maximum(r - np.linalg.solve(np.eye(len(r)) - tent * (p * r ** (p - 1.0)), r - tent @ r**p), 0.0)
    force, velocity = r**p, box @ r**p
    one = slice(0, 2 * NODES)  # one grain
    peak = 2.0 * float(weights[one] @ ((1.0 - grid[one]) * force[one]))
    fastest = 2.0 * float(weights[:NODES] @ force[:NODES])
    half = peak * 0.5 ** (1.0 / p)
    panel = int(np.argmax(r < half)) // NODES
    nodes = slice(panel * NODES, (panel + 1) * NODES)
    profile, edge = BarycentricInterpolator(grid[nodes], r[nodes]), 0.5 * panel
    # the root may lie just before the panel, behind the last node of the one before
    width = 2.0 * brentq(lambda x: float(profile(x)) - half, edge - 0.02, edge + 0.5, xtol=1e-15)
    energy = 2.0 * float(weights @ (0.5 * velocity**2 + r**n / n))
    return {
        "speed_by_velocity": fastest ** -((n - 2.0) / n),
        "speed_by_force": peak ** -(0.5 * (n - 2.0)),
        "width": width,
        "peak_force": peak**p / fastest ** (2.0 * p / n),
        "momentum": 2.0 * float(weights @ force) / fastest,
        "energy": energy / fastest**2,
    }


def long_wave(n: float) -> Values:
    """Return Nesterenko's wave from his equation y'' = y^((3-p)/(p+1)) - y, integrated from the peak of y."""
    p = n - 1.0
    top = brentq(lambda y: 0.5 * y**2 - 0.25 * n * y ** (4.0 / n), 1.0, 10.0, xtol=1e-15)
    half = top * 0.5 ** (0.5 * n / p)

    start = [top, 0.0]
    run = solve_ivp(
        lambda _, y: [y[1], y[0] ** ((3.0 - p) / n) - y[0]],
        (0.0, 20.0),
        start,
        events=_Fall(lambda y: float(y[0] - half)),
        **TIGHT,
    )
    overlap = top ** (2.0 / n)  # at c = 1
    return {
        "speed_by_velocity": overlap ** -((n - 2.0) / n),
        "speed_by_force": overlap ** -(0.5 * (n - 2.0)),
        "width": 2.0 * float(run.t_events[0][0]) * math.sqrt(p / (6.0 * n)),
    }


def waves() -> Values:
    values: Values = {}
    for n in elastic.WAVE_EXPONENTS:
        exact, theory = wave(n), long_wave(n)
        for key, value in exact.items():
            values[f"solitary_n{label(n)}_{key}"] = value
        for key, value in theory.items():
            values[f"solitary_n{label(n)}_{key}_nesterenko"] = value
            values[f"solitary_n{label(n)}_{key}_nesterenko_error"] = value / exact[key] - 1.0
    return values


def half_time(n: float) -> float:
    """Return the time from touch to the largest overlap, for an overlap and a speed of 1, by quadrature."""

    def rate(u: float) -> float:  # overlap 1 - u^2
        return 2.0 * u / math.sqrt(-math.expm1(n * math.log1p(-u * u))) if u > 0.0 else 2.0 / math.sqrt(n)

    return float(quad(rate, 0.0, 1.0, epsabs=0.0, epsrel=2e-14, limit=200)[0])


def collisions() -> Values:
    values: Values = {}
    for n in elastic.COLLISION_EXPONENTS:
        overlap = brentq(lambda d, n=n: d**n / n - 0.5, 0.1, 10.0, xtol=1e-16, rtol=1e-15)
        time, head = 2.0 * half_time(n), f"collision_n{label(n)}"
        values[f"{head}_overlap"], values[f"{head}_force"] = overlap, overlap ** (n - 1.0)
        values[f"{head}_time"], values[f"{head}_time_by_overlap"] = time * overlap, time
    for ratio in elastic.MASS_RATIOS:
        # striker 1 - ratio w for a target of velocity w: (1 - ratio w)^2 + ratio w^2 = 1
        target = float(max(np.roots([ratio**2 + ratio, -2.0 * ratio, 0.0])))
        head = f"collision_mass_ratio_{label(ratio)}"
        values[f"{head}_striker"], values[f"{head}_target"] = 1.0 - ratio * target, target
    return values


def benchmarks() -> Values:
    getcontext().prec = 40
    pi, time = Decimal("3.14159265358979323846264338327950288419716"), Decimal(2.0 * half_time(2.5))
    values: Values = {}
    for case in elastic.IMPACTS:
        e, nu, rho, r, v = (Decimal(repr(x)) for x in (case.young, case.poisson, case.density, case.radius, case.speed))
        mass, modulus = rho * 4 / 3 * pi * r**3, e / (1 - nu**2)
        if case.partner == "sphere":
            mass, modulus, r = mass / 2, modulus / 2, r / 2
        elif case.partner == "wall":
            modulus = modulus / 2
        beta = Decimal(4) / 3 * modulus * r.sqrt()
        overlap = (Decimal(5) / 4 * mass * v**2 / beta) ** Decimal("0.4")
        results = {"stiffness": beta, "overlap": overlap, "force": beta * overlap * overlap.sqrt()}
        values |= {f"{case.name}_{key}": float(x) for key, x in results.items()}
        values[f"{case.name}_time"] = float(time * overlap / v)
    return values


class _Fall:
    """Event at which a function of the state falls through zero; the integration ends there."""

    terminal, direction = True, -1.0

    def __init__(self, function: Callable[[Array], float]) -> None:
        self.function = function

    def __call__(self, _: float, y: Array) -> float:
        return self.function(y)


def _exit_speed(rate: Callable[[float, Array], list[float]], end: Callable[[Array], float]) -> float:
    """Return the speed of separation at the event, for a motion that starts at overlap 0 with speed 1."""
    run = solve_ivp(rate, (0.0, 1e3), [0.0, 1.0], max_step=0.05, events=_Fall(end), **TIGHT)
    return -float(run.y_events[0][0][1])


@cache
def hertzian(alpha: float, clip: bool) -> float:
    """Return e of d'' = -d^(3/2) - alpha d^(1/4) d', with d = u^4 and dt = u^3 ds."""
    # the net force u^6 + alpha u p has the sign of u + (alpha p)^(1/5), whose root is simple
    end = (lambda y: y[0] + math.copysign(abs(alpha * y[1]) ** 0.2, y[1])) if clip else (lambda y: y[0])
    return _exit_speed(lambda _, y: [0.25 * y[1], -(y[0] ** 9) - alpha * y[0] ** 4 * y[1]], end)


@cache
def dashpot(ratio: float, clip: bool) -> float:
    """Return e of d'' = -d - 2 zeta d'."""
    end = (lambda y: y[0] + 2.0 * ratio * y[1]) if clip else (lambda y: y[0])
    return _exit_speed(lambda _, y: [y[1], -y[0] - 2.0 * ratio * y[1]], end)


@cache
def viscoelastic(strength: float, clip: bool) -> float:
    """Return e of d'' = -d^(3/2) - s d^(1/2) d', with d = u^2 and dt = u dtau."""
    # the net force u^3 + s u p has the sign of u + (s p)^(1/2)
    end = (lambda y: y[0] + math.copysign(math.sqrt(abs(strength * y[1])), y[1])) if clip else (lambda y: y[0])
    return _exit_speed(lambda _, y: [0.5 * y[1], -(y[0] ** 4) - strength * y[0] ** 2 * y[1]], end)


def root(function: Callable[[float], float], target: float, low: float, high: float) -> float:
    return float(brentq(lambda x: function(x) - target, low, high, xtol=1e-15, rtol=1e-14))


def marshall(e: float) -> float:
    """Return Marshall's polynomial (2009, eq. 53)."""
    return float(np.polyval([4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728], e))


def restitution(name: str) -> float:
    """Return the constant of a law of restitution by its name, such as "restitution_tsuji_clipped_e0_5"."""
    law = next(law for law in sorted(damped.LAWS, key=len, reverse=True) if name.startswith(f"restitution_{law}_"))
    rest = name.removeprefix(f"restitution_{law}_")
    clip, back = not rest.startswith("not_"), "_write_for_" in rest
    e = float(rest.rpartition("_e")[2].replace("_", "."))
    if law == "coeff_restitution":  # its alpha is defined by what results without a clip
        alpha = root(lambda a: hertzian(a, clip if back else False), e, 0.0, 2.0)
        return hertzian(alpha, False if back else clip)
    prefactor = 1.0 if law == "tsuji_without_sqrt2" else math.sqrt(2.0)
    if back:
        return root(lambda w: hertzian(prefactor * marshall(w), clip), e, 1e-9, 1.0)
    return hertzian(prefactor * marshall(e), clip)


def other_damping(name: str) -> float:
    """Return a constant of a dashpot or of viscoelastic spheres by its name."""
    clip = "_not_clipped_" not in name
    function, most = (dashpot, 0.999 if not clip else 1.0) if "_dashpot_" in name else (viscoelastic, 2.0)
    number = float(
        name.rpartition("_e" if "_for_e" in name else "zeta" if "dashpot" in name else "_s")[2].replace("_", ".")
    )
    return root(lambda x: function(x, clip), number, 0.0, most) if "_for_e" in name else function(number, clip)


def ring(masses: list[float], cells: int, spring: float = 1.0) -> Array:
    """Return the angular frequencies of a ring of cells, ascending."""
    m = np.array(masses * cells)
    matrix = spring * (2.0 * np.eye(len(m)) - np.roll(np.eye(len(m)), 1, 0) - np.roll(np.eye(len(m)), -1, 0))
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(matrix / np.sqrt(np.outer(m, m))), 0.0)))


def dispersions() -> Values:
    values: Values = {}
    frequencies = ring([1.0], 72)
    for share in elastic.WAVE_NUMBERS:
        mode, name = round(36 * share), f"dispersion_k{round(180 * share)}"
        omega = float(frequencies[2 * mode - 1])
        values[f"{name}_frequency"] = omega
        if share < 1.0:  # flux of energy through a spring over the energy of a body and a spring
            here, there = np.exp(1j * math.pi * share * np.arange(2))
            flux = 0.5 * ((here - there) * np.conj(-1j * omega * there)).real
            values[f"{name}_group_velocity"] = abs(flux) / (0.25 * omega**2 + 0.25 * abs(here - there) ** 2)
    for ratio in elastic.DIMERS:
        low = ring([1.0, ratio], 8)
        places = {"acoustic_k45": 3, "acoustic_top": 7, "optical_bottom": 8, "optical_k45": 12, "cutoff": 15}
        values |= {f"dispersion_dimer_{label(ratio)}_{key}": float(low[place]) for key, place in places.items()}
    for n in elastic.COLLISION_EXPONENTS:
        spring = ((1.0 + 1e-20j) ** (n - 1.0)).imag / 1e-20
        values[f"sound_speed_n{label(n)}"] = float(ring([1.0], 72, spring)[1]) / (2.0 * math.sin(math.pi / 72))
    return values


def second_values(names: set[str] | None = None) -> Values:
    """Return the second values of all constants, or of those with these names, in the order of the table."""
    fixed = waves() | collisions() | benchmarks() | dispersions()
    values: Values = {}
    for constant in all_constants():
        name = constant.name
        if names is None or name in names:
            damping = other_damping if "_dashpot_" in name or "_viscoelastic_" in name else restitution
            values[name] = fixed[name] if name in fixed else damping(name)
    return values


if __name__ == "__main__":
    head = "# Second values of the constants, written by: python -m tests.helpers.second_constants\n"
    lines = [f"{name} = {float(value)!r}\n" for name, value in second_values().items()]
    SECOND_VALUES.write_text(head + "".join(lines), encoding="utf-8")
