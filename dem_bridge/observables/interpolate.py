"""Between the samples of a trajectory: values with known slopes, by Hermite polynomials through six samples.

Displacement has the velocity as its slope, velocity the acceleration that follows from the contact forces, so six
samples carry a polynomial of degree 11. Its error is 2.6e-8 (omega h)^12 of an amplitude, with h between samples; a
pulse that stays ``T`` on a body has omega of about 2.2 / T. Where a contact opens between them the motion is less
smooth and the order lower; so errors are estimated, by the polynomial through four of the six.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.scene import features
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Floats, Trajectory

Bracketed = Callable[[Floats], Floats]

#: features whose forces and energies observables derive from a trajectory; of others they know nothing
KNOWN_FORCES = Support(
    {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
    | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
    | {features.DASHPOT, features.MASS_VELOCITY, features.KUWABARA_KONO, features.COEFF_RESTITUTION, features.TSUJI}
    | {features.CONTACT_FUNCTIONS, features.NOT_CLIPPED, features.DMT, features.DRAG}
    | {features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE}
    | {features.CONSTANT_PISTON, features.SINE_PISTON, features.TABLE_PISTON}
)
#: samples that carry a polynomial, and those that carry the coarser one
NODES, FEWER = 6, 4
#: halvings that leave one double between two
_MOST_STEPS = 54


def acceleration(scene: Scene, trajectory: Trajectory) -> Floats:
    """Return the acceleration of each body at each sample, m/s^2, ``(n_t, n_body)``.

    It is the sum of contact forces, gravity, load, drag and drive over the mass, for a piston that of its motion; nan
    where a trajectory has no contact forces (binary collisions).
    """
    require_known_forces(scene, "the accelerations of bodies")
    c, force = scene.contacts, trajectory.contact_force
    total = np.zeros((len(trajectory.time), scene.n_body + 1))  # the last column is that of walls
    total[:, c.right] += force  # no body has two contacts on one side
    total[:, c.left] -= force
    result = total[:, :-1] / np.array(scene.mass) + scene.free_acceleration - scene.drag * trajectory.velocity
    if scene.driving_force is not None:
        result[:, 0] += scene.driving_force.at(trajectory.time) / scene.mass[0]
    if scene.piston is not None:
        result[:, 0] = scene.piston.acceleration(trajectory.time)
    return np.asarray(result)


def spacing(trajectory: Trajectory) -> float:
    """Return the time between samples, s; UsageError where they are not evenly spaced."""
    return _spacing(trajectory.time.tobytes())


@functools.lru_cache(maxsize=64)
def _spacing(times: bytes) -> float:
    steps = np.diff(np.frombuffer(times))
    # times are multiples of the spacing, each rounded once
    if not np.all(np.abs(steps - steps[0]) <= 1e-9 * steps[0]):
        raise UsageError("the trajectory's samples are not evenly spaced; this observable needs Sampling's even times")
    return float(steps[0])


def require_known_forces(scene: Scene, what: str) -> None:
    """Raise UnsupportedScene for a scene with forces that observables do not know."""
    if reason := KNOWN_FORCES.unsupported_reason(scene):
        raise UnsupportedScene(f"{what} in {scene.name} cannot be computed: {reason}")


def require_forces(trajectory: Trajectory, what: str) -> None:
    """Raise UsageError for a trajectory without contact forces."""
    if np.any(np.isnan(trajectory.contact_force)):
        backend = trajectory.provenance.get("backend", "?")
        raise UsageError(
            f"{what}: backend {backend!r} gives no contact forces; take one that solves the chain's motion"
        )


def hermite(
    trajectory: Trajectory, value: Floats, slope: Floats, when: Floats, *, nodes: int = NODES, derivative: int = 0
) -> Floats:
    """Interpolate ``value`` with its ``slope`` in time, ``(n_t, n)`` both, to one time per column, or for all columns.

    ``when (n,)``, s: one time per column, answer ``(n,)``; ``when (n_when, 1)`` or ``(n_when, n)``: answer
    ``(n_when, n)``. Nan stays nan.
    ``derivative=1``: the polynomial's own slope.
    """
    h = spacing(trajectory)
    nodes = min(nodes, len(trajectory.time))
    available = np.where(np.isfinite(when), when, 0.0)
    first = np.floor((available - trajectory.time[0]) / h).astype(np.int64) - (nodes // 2 - 1)
    first = np.clip(first, 0, len(trajectory.time) - nodes)
    place = (available - trajectory.time[first]) / h - 0.5 * (nodes - 1)
    columns = np.arange(value.shape[1])
    result = np.zeros(np.broadcast_shapes(available.shape, columns.shape))
    of_value, of_slope = polyval(place, _basis(nodes, derivative))
    for node in range(nodes):
        rows = first + node
        result += of_value[node] * value[rows, columns] + of_slope[node] * h * slope[rows, columns]
    return np.asarray(np.where(np.isfinite(when), result / h**derivative, np.nan))


@functools.lru_cache
def _basis(nodes: int, derivative: int) -> Floats:
    """Return the polynomials by which value and slope of each sample contribute at a place between the samples.

    Places are in spacings from the middle. The coefficients, the lowest first, are ``(degree + 1, 2, nodes)``.
    """
    places = np.arange(nodes) - 0.5 * (nodes - 1)
    results = []
    for j, place in enumerate(places):
        others = np.delete(places, j)
        lagrange = Polynomial.fromroots(others) / np.prod(place - others)
        away = Polynomial([-place, 1.0])
        of_value = (1.0 - 2.0 * float(np.sum(1.0 / (place - others))) * away) * lagrange**2
        both = (item.deriv(derivative).coef for item in (of_value, away * lagrange**2))
        # in the middle of an odd number the highest power is not there
        results.append([np.pad(item, (0, 2 * nodes - derivative - len(item))) for item in both])
    return np.asarray(results).transpose(2, 1, 0)


def integrals(
    trajectory: Trajectory, rate: Callable[[Floats, int], Floats], breaks: Floats | tuple[float, ...] = ()
) -> tuple[Floats, Floats]:
    """Return the integrals of rates from the start until each sample, ``(n_t, n)``, and their uncertainties, ``(n,)``.

    ``rate(when, nodes)`` returns the rates ``(n_when, n)`` at the times ``when (n_when, 1)`` from a polynomial through
    ``nodes`` samples. Gauss' rule is used between samples and ``breaks`` (s), at which the rates may jump. The
    uncertainty is the difference from the cubic through two samples, added up: where forces bend, more samples do not
    help, and polynomials through four and six have the same error.
    """
    time = trajectory.time
    edges = np.union1d(time, np.clip(np.asarray(breaks, dtype=np.float64), time[0], time[-1]))
    place, weight = np.polynomial.legendre.leggauss(NODES)
    half = 0.5 * np.diff(edges)
    when = (edges[:-1] + half)[:, None] + half[:, None] * place

    def parts(nodes: int) -> Floats:
        values = rate(when.reshape(-1, 1), nodes).reshape(*when.shape, -1)
        return np.asarray(np.moveaxis(values, 1, -1) @ weight * half[:, None])

    result = parts(NODES)
    done = np.concatenate([np.zeros((1, result.shape[1])), np.cumsum(result, axis=0)])
    return done[np.searchsorted(edges, time)], np.abs(result - parts(2)).sum(axis=0)


class Moving(Protocol):
    """Displacements (m) and velocities (m/s) at samples, ``(n_t, n_body)``: a trajectory, or the motion alone."""

    @property
    def displacement(self) -> Floats:
        """Displacements."""
        ...

    @property
    def velocity(self) -> Floats:
        """Velocities."""
        ...


def contact_motion(scene: Scene, trajectory: Moving, contacts: Contacts | None = None) -> tuple[Floats, Floats]:
    """Return overlaps (m; < 0: a gap) and closing velocities (m/s) at samples, ``(n_t, n_contact)`` both."""
    c = contacts or scene.contacts
    x, v = with_wall(trajectory.displacement), with_wall(trajectory.velocity)
    return x[:, c.left] - x[:, c.right] - c.gap, v[:, c.left] - v[:, c.right]


def with_wall(motion: Floats) -> Floats:
    """Return displacements or velocities ``(n, n_body)`` with a column for walls, which are at rest."""
    result = np.zeros((len(motion), motion.shape[1] + 1))  # np.pad takes ten times as long for a short run
    result[:, :-1] = motion
    return result


def piston_contact(scene: Scene, trajectory: Trajectory, when: Floats, *, nodes: int = NODES) -> tuple[Floats, Floats]:
    """Return overlap (m; < 0: a gap) and closing velocity (m/s) of a piston and body 1 at times ``(n_when, 1)`` (s).

    The motion of the piston is given; at the bends of a table no polynomial through samples has it.
    """
    assert scene.piston is not None  # for scenes with a piston only
    x, v = trajectory.displacement[:, 1:2], trajectory.velocity[:, 1:2]
    slope = acceleration(scene, trajectory)[:, 1:2]
    overlap = scene.piston.displacement(when) - hermite(trajectory, x, v, when, nodes=nodes) - scene.contacts.gap[0]
    return overlap, scene.piston.at(when) - hermite(trajectory, v, slope, when, nodes=nodes)


def state_at(scene: Scene, trajectory: Trajectory, when: Floats) -> tuple[Floats, Floats]:
    """Return overlaps >= 0 (m, ``(n_when, n_contact)``) and velocities (m/s, ``(n_when, n_body)``) at some times."""
    at = when[:, None]
    x = hermite(trajectory, trajectory.displacement, trajectory.velocity, at)
    v = hermite(trajectory, trajectory.velocity, acceleration(scene, trajectory), at)
    c, x = scene.contacts, with_wall(x)
    return np.maximum(x[:, c.left] - x[:, c.right] - c.gap, 0.0), v


def root_between(function: Bracketed, low: Floats, high: Floats) -> Floats:
    """Return where each ``function(when)`` changes its sign from that at ``low``, to the last digit; ``(n,)`` all.

    By Ridders' method (1979, *IEEE Trans. Circuits Syst.* 26, 979), all roots at once: a fifth of the calls that
    bisection takes. Where ``function`` has one sign on both sides it ends at ``high``.
    """
    at_low, at_high = function(low), function(high)
    start, guess = at_low > 0.0, low
    for _ in range(_MOST_STEPS):
        middle = 0.5 * (low + high)
        at_middle = function(middle)
        # the root of the exponential through three points; between the ends wherever these have opposite signs
        inside = at_middle**2 - at_low * at_high
        part = np.where(start, at_middle, -at_middle) / np.sqrt(np.where(inside > 0.0, inside, np.inf))
        before, guess = guess, np.clip(middle + (middle - low) * part, np.minimum(low, high), np.maximum(low, high))
        for place, value in ((middle, at_middle), (guess, function(guess))):
            # a place beyond an end that has moved meanwhile says nothing new
            between = (place - low) * (place - high) <= 0.0
            same = (value > 0.0) == start
            low, at_low = np.where(between & same, place, low), np.where(between & same, value, at_low)
            high, at_high = np.where(between & ~same, place, high), np.where(between & ~same, value, at_high)
        if np.all(np.abs(guess - before) <= 2.0 * np.spacing(np.abs(guess))):
            break
    return guess


def touch_times(trajectory: Trajectory, overlap: Floats, closing: Floats) -> Floats:
    """Return the times at which any contact opens or closes, and times that approach them in powers of 2, s.

    The force of a dashpot jumps there, and that of a law by restitution has an infinite slope.
    """
    closed = overlap > 0.0
    row, column = np.nonzero(closed[1:] != closed[:-1])
    if not row.size:
        return np.zeros(0)

    def between(when: Floats) -> Floats:
        return hermite(trajectory, overlap[:, column], closing[:, column], when)

    roots = root_between(between, trajectory.time[row], trajectory.time[row + 1])
    approaching = 0.5 ** np.arange(12) * (trajectory.time[1] - trajectory.time[0])
    return np.concatenate(
        [roots, np.add.outer(roots, approaching).ravel(), np.subtract.outer(roots, approaching).ravel()]
    )
