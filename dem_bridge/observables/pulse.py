"""The pulse as a whole: its width, energy and momentum, what follows it and what runs back.

The leading pulse is evaluated when each contact k of the chain is at its first maximal compression (its
``crossing_time``). It begins at the first body that moves and ends at the first contact behind k where the force has a
minimum: zero, or smaller than in the contact behind it. Before two pulses have separated there may be no such contact
between them, and both count; in a strongly tapered chain, whose pulse has a long tail, the tail counts too. The front,
a window of fixed length, has neither weakness (:func:`front_window`). States between samples are those of
:mod:`.interpolate`. Chains must be struck at rest; gravity and precompression, whose forces and energies are not those
of a pulse, are rejected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.foundation.numbers import check_number
from dem_bridge.observables.fits import inner_bodies
from dem_bridge.observables.front import front_speed, peak_velocity_of_front, residence_time_uncertainty
from dem_bridge.observables.interpolate import acceleration, hermite, require_forces, root_between, state_at
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: smallest maximum of a body's velocity that counts as a further pulse, relative to the first
SECONDARY = 0.05
#: contacts on each side of the one with the peak that belong to the window of a front
REACH = 2
#: times at which the velocity of a body is evaluated for the shape of its pulses
FINE = 30_001


@dataclass(frozen=True, kw_only=True, eq=False)
class PulseWidth:
    """Hold the width of the leading pulse, ``(n_contact of the chain,)``; :func:`pulse_width_by_force` returns it."""

    width: Floats
    """Bodies; nan where one side of the pulse is beyond an end of the chain."""
    by_duration: Floats
    """Bodies: the time above half force over the time that the front takes per contact there; nan at both ends."""
    rise: Floats
    """s: when the force of the contact reaches the share of its first peak, which is half unless another is asked."""
    fall: Floats
    """s: when it is back at it."""


def pulse_width_by_force(scene: Scene, trajectory: Trajectory, *, share: float = 0.5) -> PulseWidth:
    """Return the full width of the leading pulse at half force, in bodies, as each contact of the chain has its peak.

    The front edge is where contacts have just reached half their own first peak, the rear edge where they are back at
    it; both run along the chain, and between contacts their places are those of a cubic spline through (time, contact).
    In a solitary wave that is the full width of the force profile at half its peak, 1.412 bodies for n = 5/2
    (``SolitaryWave.width`` of :mod:`dem_bridge.physics.solitary`), and ``fall - rise`` is its duration. A struck
    uniform chain gives it to 3e-6 with 2 samples per residence time and to 1e-7 with 4, where what is left is the
    spline's. Forces are the elastic ones. With another ``share`` the width is that at this part of the peak.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> found = pulse_width_by_force(scene, db.solve(scene, backend="reference", samples=1500, uncertainty=False))
    >>> f"{found.width[10]:.3f} to {found.width[35]:.3f} bodies"
    '1.576 to 1.449 bodies'
    """
    _struck_at_rest(scene, trajectory, "the width of a pulse")
    c, links, time = scene.contacts, scene.n_body - 1, trajectory.time
    of_chain = np.arange(links)
    crossing = trajectory.crossing_time[:links]
    came = np.isfinite(crossing)
    peak_time = np.where(came, crossing, 0.0)
    x, v = trajectory.displacement, trajectory.velocity
    overlap, closing = x[:, :-1] - x[:, 1:] - c.gap[:links], v[:, :-1] - v[:, 1:]

    def force(when: Floats) -> Floats:
        return c.force(np.maximum(hermite(trajectory, overlap, closing, when), 0.0), of_chain)

    half = share * force(peak_time)
    low = c.force(np.maximum(overlap, 0.0), of_chain) < half
    number = np.arange(len(time))[:, None]
    before = np.max(np.where(low & (time[:, None] < peak_time), number, -1), axis=0)
    after = np.min(np.where(low & (time[:, None] > peak_time), number, len(time)), axis=0)

    def edge(row: NDArray[np.int64], available: NDArray[np.bool_], other: int) -> Floats:
        """Return the time between the sample ``row``, below half, and the one nearer to the peak, or the peak."""
        inside = np.clip(row, 0, len(time) - 1)
        outer, inner = time[inside], time[np.clip(row + other, 0, len(time) - 1)]
        inner = np.minimum(inner, peak_time) if other > 0 else np.maximum(inner, peak_time)
        result = root_between(lambda when: force(when) - half, outer, inner)
        return np.where(available & came, result, np.nan)

    rise, fall = edge(before, before >= 0, 1), edge(after, after < len(time), -1)
    by_duration = np.full(links, np.nan)
    by_duration[1:-1] = (fall - rise)[1:-1] / (0.5 * (crossing[2:] - crossing[:-2]))
    return PulseWidth(
        width=place_of_edge(rise, crossing) - place_of_edge(fall, crossing),
        by_duration=by_duration,
        rise=rise,
        fall=fall,
    )


def place_of_edge(passing: Floats, when: Floats) -> Floats:
    """Return the contact, fractions included, at which an edge is; nan where unknown.

    An edge that is at a contact before it is at the one behind, as in a pulse that still forms, starts anew there.
    """
    from scipy.interpolate import CubicSpline

    result = np.full(len(when), np.nan)
    ahead = np.concatenate([[False], np.diff(passing) > 0.0, [False]])  # nan is not ahead
    for first, last in zip(*(np.flatnonzero(np.diff(ahead.astype(int)) == turn) for turn in (1, -1)), strict=True):
        if last - first >= 3:
            run = np.arange(first, last + 1)
            place = CubicSpline(passing[run], run, extrapolate=False)(when)
            result = np.where(np.isnan(place), result, place)
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontWindow:
    """Hold the energy of the front in a window of fixed length, ``(n_contact of the chain,)``.

    :func:`front_window` returns it. Values are nan where the window is longer than the chain on one side.
    """

    kinetic: Floats
    """J."""
    energy: Floats
    """J: kinetic, and stored in the contacts of the window."""


def front_window(scene: Scene, trajectory: Trajectory, *, reach: int = REACH) -> FrontWindow:
    """Return the energy within ``reach`` contacts of each contact as it has its peak.

    The window of contact k has the contacts k - ``reach`` to k + ``reach`` and the bodies that they join. Its length
    does not depend on the pulse, so that a long tail stays behind it. A solitary wave of Hertz' law spans about five
    contacts (Nesterenko 2001, section 1.3). Raises UsageError as :func:`leading_pulse` does.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> window = front_window(scene, db.solve(scene, backend="reference", samples=1500, uncertainty=False))
    >>> f"{window.energy[36] / window.energy[10]:.3f} of the energy from contact 10 to 36"
    '0.988 of the energy from contact 10 to 36'
    """
    _struck_at_rest(scene, trajectory, "the energy of a front")
    links = scene.n_body - 1
    overlap, v = state_at(scene, trajectory, trajectory.crossing_time[:links])
    kinetic = 0.5 * np.array(scene.mass) * v**2
    stored = scene.contacts.energy(np.nan_to_num(overlap), np.arange(scene.n_contact))
    moving, energy = np.full(links, np.nan), np.full(links, np.nan)
    for k in np.flatnonzero(np.isfinite(trajectory.crossing_time[:links])):
        first, last = k - reach, k + reach
        if first >= 0 and last < links:
            moving[k] = np.sum(kinetic[k, first : last + 2])
            energy[k] = moving[k] + np.sum(stored[k, first : last + 1])
    return FrontWindow(kinetic=moving, energy=energy)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeadingPulse:
    """Hold energy and momentum of the leading pulse as each contact has its peak, ``(n_contact of the chain,)``.

    :func:`leading_pulse` returns it. Values are nan, and ``rear`` is -1, where the pulse never arrives.
    """

    time: Floats
    """s: the crossing time of the contact."""
    rear: NDArray[np.int64]
    """First body of the pulse; 0: all that moves is one pulse still."""
    kinetic: Floats
    """J."""
    energy: Floats
    """J: kinetic, and stored in its contacts."""
    momentum: Floats
    """kg m/s."""
    energy_share: Floats
    """Of the energy of the whole chain at the same time."""
    momentum_share: Floats
    """Of the momentum of the whole chain at the same time; above 1 where what follows runs back. nan: there is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reflected:
    """Hold the motion behind the leading pulse, ``(n_contact of the chain,)`` all; :func:`reflected` returns it."""

    time: Floats
    """s: the crossing time of the contact."""
    energy: Floats
    """J: kinetic and stored."""
    momentum: Floats
    """kg m/s; < 0: on the whole it runs back."""
    backward_energy: Floats
    """J: kinetic, of the bodies that run back."""
    backward_momentum: Floats
    """kg m/s, <= 0: of the bodies that run back."""
    striker_velocity: Floats
    """m/s."""


def leading_pulse(scene: Scene, trajectory: Trajectory) -> LeadingPulse:
    """Return energy and momentum in the leading pulse along the chain, and their shares in those of the chain.

    In a solitary wave: energy 1.0693229458 m v_max^2 and momentum 1.6699712493 m v_max for n = 5/2. Energies stored in
    contacts are rebuilt from their laws. Raises UsageError for gravity, precompression, or runs without contact forces.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> found = leading_pulse(scene, db.solve(scene, backend="reference", samples=1500, uncertainty=False))
    >>> f"{found.energy_share[30]:.3f} of the energy, {found.momentum_share[30]:.3f} of the momentum"
    '0.598 of the energy, 0.963 of the momentum'
    """
    return _split(scene, trajectory)[0]


def reflected(scene: Scene, trajectory: Trajectory) -> Reflected:
    """Return energy and momentum behind the leading pulse along the chain, and the part of both that runs back.

    Raises UsageError as :func:`leading_pulse` does.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> found = reflected(scene, db.solve(scene, backend="reference", samples=1500, uncertainty=False))
    >>> f"{1e3 * found.backward_momentum[35]:.3f} g m/s, {1e6 * found.backward_energy[35]:.1f} uJ"
    '-3.575 g m/s, 113.9 uJ'
    """
    return _split(scene, trajectory)[1]


def _split(scene: Scene, trajectory: Trajectory) -> tuple[LeadingPulse, Reflected]:
    _struck_at_rest(scene, trajectory, "a leading pulse")
    links, mass = scene.n_body - 1, np.array(scene.mass)
    time = trajectory.crossing_time[:links]
    overlap, v = state_at(scene, trajectory, time)
    every = np.arange(scene.n_contact)
    stored = scene.contacts.energy(np.nan_to_num(overlap), every)
    force = scene.contacts.force(np.nan_to_num(overlap), every)[:, :links]
    kinetic, momentum = 0.5 * mass * v**2, mass * v
    rear = np.array([rear_of_pulse(force[k], k) if np.isfinite(time[k]) else -1 for k in range(links)])
    leads = np.arange(scene.n_body) >= rear[:, None]
    # contact j, before body j + 1, is in the pulse if body j is; a wall's is not
    in_pulse = np.zeros((links, scene.n_contact), dtype=bool)
    in_pulse[:, :links] = leads[:, :links]
    backward = ~leads & (v < 0.0)

    def total(values: Floats, which: NDArray[np.bool_] | None = None) -> Floats:
        counted = values if which is None else np.where(which, values, 0.0)
        return np.where(np.isfinite(time), np.sum(counted, axis=1), np.nan)

    def share(part: Floats, all_of_it: Floats) -> Floats:
        return np.asarray(np.divide(part, all_of_it, out=np.full(links, np.nan), where=all_of_it != 0.0))

    energy = total(kinetic, leads) + total(stored, in_pulse)
    whole = total(kinetic) + total(stored)
    carried, all_momentum = total(momentum, leads), total(momentum)
    pulse = LeadingPulse(
        time=time,
        rear=rear,
        kinetic=total(kinetic, leads),
        energy=energy,
        momentum=carried,
        energy_share=share(energy, whole),
        momentum_share=share(carried, all_momentum),
    )
    behind = Reflected(
        time=time,
        energy=whole - energy,
        momentum=all_momentum - carried,
        backward_energy=total(kinetic, backward),
        backward_momentum=total(momentum, backward),
        striker_velocity=v[:, 0],
    )
    return pulse, behind


def rear_of_pulse(force: Floats, k: int) -> int:
    """Return the first body of the pulse whose peak is in contact k: that behind the contact with the least force."""
    for j in range(k - 1, -1, -1):
        if force[j] == 0.0 or (j > 0 and force[j - 1] > force[j]):
            return j + 1
    return 0


@dataclass(frozen=True, kw_only=True, eq=False)
class SecondaryFronts:
    """Hold the further pulses at a body in order of time, ``(n_pulse,)``; :func:`secondary_fronts` returns it."""

    body: int
    first: float
    """m/s: peak velocity in the leading pulse."""
    velocity: Floats
    """m/s: of each further pulse."""
    lag: Floats
    """s: behind the leading pulse, from peak to peak."""

    @property
    def count(self) -> int:
        """Return the number of further pulses."""
        return len(self.velocity)

    @property
    def amplitude(self) -> Floats:
        """Return the peak velocities over that of the leading pulse."""
        return self.velocity / self.first


def secondary_fronts(
    scene: Scene, trajectory: Trajectory, body: int, *, share: float = SECONDARY, until: float | None = None
) -> SecondaryFronts:
    """Return the pulses that follow the leading one (paper, section 4a): later maxima of the velocity of ``body``.

    A maximum counts if it is at least ``share`` of the leading peak, and rises by as much above the dips beside it,
    after the body has handed on the leading pulse and before ``until``, s (None: the end of the run). Peaks are largest
    samples, good to (omega h)^2/8. Raises UsageError for a body that the pulse never reached.

    >>> import dem_bridge as db
    >>> counts = {}
    >>> for name in ("decelerating-40", "accelerating-40"):
    ...     run = db.solve(name, backend="reference", samples=1500, uncertainty=False)
    ...     counts[name] = secondary_fronts(db.load_scene(name), run, 10).count
    >>> counts
    {'decelerating-40': 2, 'accelerating-40': 0}
    """
    from scipy.signal import find_peaks

    if not 0 <= body < scene.n_body:
        raise UsageError(f"body {body}; allowed: 0 to {scene.n_body - 1}")
    check_number("share", share, "a number between 0 and 1", above=0.0, below=1.0)
    peak = peak_velocity_of_front(scene, trajectory)
    first, start = float(peak.velocity[body]), float(peak.time[body])
    if not first > 0.0:
        raise UsageError(f"the pulse never came to body {body}; take a longer run, or a nearer body")
    handed = trajectory.crossing_time[body] if body < scene.n_body - 1 else trajectory.time[-1]
    v, time = trajectory.velocity[:, body], trajectory.time
    rows, _ = find_peaks(v, height=share * first, prominence=share * first)
    rows = rows[(time[rows] > handed) & (time[rows] <= (time[-1] if until is None else until))]
    return SecondaryFronts(body=body, first=first, velocity=v[rows], lag=time[rows] - start)


@dataclass(frozen=True, kw_only=True, eq=False)
class PulseShapes:
    """Hold the velocity pulses of a body in order of time, ``(n_pulse,)``; :func:`pulse_shapes` returns it."""

    velocity: Floats
    """m/s: peak velocity of each pulse; the leading one is the first."""
    duration: Floats
    """s: time above half the peak velocity; nan where the velocity does not fall below it on both sides."""


def pulse_shapes(scene: Scene, trajectory: Trajectory, body: int, *, share: float = SECONDARY) -> PulseShapes:
    """Return height and duration of the pulses at a body, which count as in :func:`secondary_fronts`.

    Between samples velocities are those of :mod:`.interpolate`, at :data:`FINE` times of the run. A wave of one shape
    has durations that go as its velocity to the power -1/5 (n = 5/2), whatever its height. Raises UsageError for runs
    without contact forces.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> shapes = pulse_shapes(scene, db.solve(scene, backend="reference", uncertainty=False), 20)
    >>> [f"{1e6 * duration:.1f} us" for duration in shapes.duration[:2]]
    ['19.0 us', '21.5 us']
    """
    from scipy.signal import find_peaks, peak_widths

    require_forces(trajectory, "the shape of pulses")
    first = float(peak_velocity_of_front(scene, trajectory).velocity[body])
    fine = np.linspace(0.0, trajectory.time[-1], FINE)
    column = trajectory.velocity[:, [body]], acceleration(scene, trajectory)[:, [body]]
    v = hermite(trajectory, *column, fine[:, None])[:, 0]
    rows, _ = find_peaks(v, height=share * first, prominence=share * first)
    # heights are measured from rest, not from the dips beside a pulse
    from_rest = v[rows], np.zeros(len(rows), np.int64), np.full(len(rows), FINE - 1)
    widths, _, left, right = peak_widths(v, rows, rel_height=0.5, prominence_data=from_rest)
    whole = (left > 0.0) & (right < FINE - 1)
    # the vertex of the parabola through the largest value and its neighbours
    before, top, after = v[rows - 1], v[rows], v[rows + 1]
    height = top + (after - before) ** 2 / (8.0 * (2.0 * top - before - after))
    return PulseShapes(velocity=height, duration=np.where(whole, widths * fine[1], np.nan))


@dataclass(frozen=True, kw_only=True)
class SpeedRatio:
    """Hold V_out / V_in; :func:`speed_ratio` returns it."""

    ratio: float
    uncertainty: float
    """From the run's uncertainties of crossing times."""
    speed_in: float
    speed_out: float
    """m/s, or bodies per second where the scene has no spacing."""
    first: int
    last: int
    """The bodies of V_in and V_out."""


def speed_ratio(
    scene: Scene, trajectory: Trajectory, *, first: int | None = None, last: int | None = None
) -> SpeedRatio:
    """Return the wave speed at the output over that at the input (paper, appendix A, fig. 6c, f).

    At bodies ``first`` and ``last`` (None: 3 and n_body - 3, see :func:`~dem_bridge.observables.fits.inner_bodies`; the
    paper does not name its own). Raises UsageError where the pulse never came to one of them.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> found = speed_ratio(scene, db.solve(scene, backend="reference", uncertainty=False))
    >>> f"{found.ratio:.3f} from body {found.first} to {found.last}"
    '0.394 from body 3 to 38'
    """
    low, high = inner_bodies(scene)
    low, high = low if first is None else first, high if last is None else last
    for body in (low, high):
        if not 1 <= body <= scene.n_body - 2:
            raise UsageError(f"body {body} has no residence time; allowed: 1 to {scene.n_body - 2}")
    rate = front_speed(scene, trajectory)[[low, high]]
    speed = rate if scene.spacing is None else scene.spacing * rate
    if not np.all(np.isfinite(speed)):
        raise UsageError(f"the pulse did not pass bodies {low} and {high}; take a longer run, or other bodies")
    relative = residence_time_uncertainty(scene, trajectory)[[low, high]] * rate
    ratio = float(speed[1] / speed[0])
    return SpeedRatio(
        ratio=ratio,
        uncertainty=ratio * float(np.sum(relative)),
        speed_in=float(speed[0]),
        speed_out=float(speed[1]),
        first=low,
        last=high,
    )


def _struck_at_rest(scene: Scene, trajectory: Trajectory, what: str) -> None:
    if scene.gravity != 0.0 or scene.precompression > 0.0:
        pressed = "gravity" if scene.gravity != 0.0 else "precompression"
        raise UsageError(f"{scene.name} has {pressed}; {what} is told from what is at rest in a chain without it only")
    require_forces(trajectory, what)
