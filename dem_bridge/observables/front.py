"""The wave front along the chain: arrival, residence time, wave speed and peak velocity, by the paper's crossing.

The paper (section 4a): cylinder i holds the impulse from t_i^i, when its velocity exceeds that of cylinder i-1, to
t_i^f, when that of cylinder i+1 exceeds its own. These are the first maximal compressions of contacts i-1 and i, the
``crossing_time`` of a Trajectory, so the accuracy is that of the run and not of its samples.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.observables.interpolate import FEWER, NODES, acceleration, hermite, root_between, spacing
from dem_bridge.observables.observable import Measured, measured, of_run
from dem_bridge.physics.solitary import solitary_wave
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory


def arrival(scene: Scene | None, trajectory: Trajectory) -> Floats:
    """Return the time at which the impulse reaches each body, s, ``(n_body,)``; nan at body 0 and where it never does.

    ``scene``, the first argument of all observables, is not used here and may be None.
    """
    return _at_bodies(trajectory, trajectory.crossing_time)


def arrival_uncertainty(scene: Scene | None, trajectory: Trajectory) -> Floats:
    """Return the uncertainty of :func:`arrival`, s, ``(n_body,)``."""
    return _at_bodies(trajectory, trajectory.uncertainty["crossing_time"])


def residence_time(scene: Scene | None, trajectory: Trajectory) -> Floats:
    """Return the residence time t_i^f - t_i^i of each body, s, ``(n_body,)``; nan at both ends.

    ``scene`` may be None.

    Examples
    --------
    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> residence = residence_time(scene, db.solve(scene, backend="bca"))
    >>> f"{1e6 * residence[1]:.3f} us, {1e6 * residence[-2]:.3f} us"
    '9.380 us, 28.082 us'

    """
    reached = arrival(None, trajectory)
    return np.append(np.diff(reached), np.nan)


def residence_time_uncertainty(scene: Scene | None, trajectory: Trajectory) -> Floats:
    """Return the uncertainty of :func:`residence_time`, s, ``(n_body,)``: that of both crossings together."""
    reached = arrival_uncertainty(None, trajectory)
    return np.append(reached[1:] + reached[:-1], np.nan)


def front_speed(scene: Scene | None, trajectory: Trajectory) -> Floats:
    """Return the speed of the front at each body in bodies per second, ``(n_body,)``: one over the residence time."""
    return 1.0 / residence_time(None, trajectory)


def front_speed_uncertainty(scene: Scene | None, trajectory: Trajectory) -> Floats:
    """Return the largest change of the inverse of a residence time within its uncertainty, 1/s, ``(n_body,)``."""
    residence, uncertainty = residence_time(None, trajectory), residence_time_uncertainty(None, trajectory)
    least = residence - uncertainty
    relative = np.divide(uncertainty, least, out=np.full(len(least), np.inf), where=least > 0.0)
    return np.asarray(relative / np.abs(residence))


def _at_bodies(trajectory: Trajectory, contacts: Floats) -> Floats:
    """Return values of the chain's contacts at the bodies on their far side; nan at body 0."""
    return np.append(np.nan, contacts[: trajectory.velocity.shape[1] - 1])


def local_stiffness(scene: Scene, position: NDArray[np.int64] | Floats) -> Floats:
    """Return the geometric mean of the stiffnesses on both sides of bodies 1..n_body-2, N/m^(n-1).

    Between bodies its logarithm is interpolated linearly.

    >>> from dem_bridge.scene.scene import Scene
    >>> chain = Scene(name="three", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0, 4.0), velocity=(1.0, 0.0, 0.0))
    >>> local_stiffness(chain, np.array([1]))
    array([2.])
    """
    beta = np.log(scene.contacts.stiffness[: scene.n_body - 1])
    return np.asarray(np.exp(np.interp(position, np.arange(1, len(beta)), 0.5 * (beta[1:] + beta[:-1]))))


@dataclass(frozen=True, kw_only=True, eq=False)
class PeakVelocity:
    """Hold the largest velocity of each body in the leading pulse, ``(n_body,)`` all.

    :func:`peak_velocity_of_front` returns it.
    """

    velocity: Floats
    """m/s; nan where the pulse never arrives."""
    time: Floats
    """s."""
    sampling: Floats
    """Uncertainty due to the distance of samples, m/s; nan where it is unknown."""
    uncertainty: Floats
    """Sum of ``sampling`` and the uncertainty of the run's velocities, m/s."""
    time_uncertainty: Floats
    """Shift of the maximum of a parabola for a velocity error of ``uncertainty``, s; inf without an acceleration."""

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)

    @property
    def largest(self) -> tuple[Floats, Floats]:
        """Return the velocities and their uncertainty, m/s."""
        return self.velocity, self.uncertainty

    @property
    def when(self) -> tuple[Floats, Floats]:
        """Return the times and their uncertainty, s."""
        return self.time, self.time_uncertainty


#: where polynomials through six and through four samples are compared, in spacings from a peak. At the peak itself they
#: may cross, and beside it a contact may open and close between two samples
_AROUND = np.linspace(-1.0, 1.0, 9)
#: part of the difference of two samples from four that the difference of four from six is where they converge
_CONVERGING = 0.03
#: peak velocities of each trajectory that still exists, from which several observables and claims are read
_peak_velocities: WeakKeyDictionary[Trajectory, tuple[Scene, PeakVelocity]] = WeakKeyDictionary()


def peak_velocity_of_front(scene: Scene, trajectory: Trajectory) -> PeakVelocity:
    """Return the largest velocity of body i up to t_i^f, when it hands the impulse on (last body: up to the end).

    The maximum is found between samples, on the polynomial of degree 11 through six samples of velocity and
    acceleration (:mod:`.interpolate`); ``sampling`` is its distance from that of degree 7 through four. In the solitary
    wave of Hertzian contacts the error is 4e-3 of the peak at 1 sample per residence time, 5e-6 at 2, 2e-9 at 4 and
    5e-13 at 8, where ``sampling`` says 4e-2, 4e-5, 2e-7 and 9e-10: take 2 samples or more. Without contact forces
    (binary collisions) it is the largest sample.

    >>> import dem_bridge as db
    >>> run = db.solve("accelerating-40", backend="reference", samples=2000, uncertainty=False)
    >>> peak = peak_velocity_of_front(db.load_scene("accelerating-40"), run)
    >>> f"{peak.velocity[20]:.6f} m/s at {1e6 * peak.time[20]:.2f} us", bool(peak.sampling[20] < 1e-6)
    ('0.462627 m/s at 348.74 us', True)
    """
    stored_scene, peaks = _peak_velocities.get(trajectory, (None, None))
    if peaks is None or stored_scene != scene:
        peaks = _compute_peak_velocities(scene, trajectory)
        _peak_velocities[trajectory] = scene, peaks
    return peaks


def _compute_peak_velocities(scene: Scene, trajectory: Trajectory) -> PeakVelocity:
    """Compute what :func:`peak_velocity_of_front` returns."""
    n, time, v = scene.n_body, trajectory.time, trajectory.velocity
    a, bodies = acceleration(scene, trajectory), np.arange(n)
    came = arrival(None, trajectory)
    came[0] = 0.0
    until = np.append(came[1:], time[-1])
    until = np.where(np.isnan(until), time[-1], until)
    inside = time[:, None] <= until
    row = np.argmax(np.where(inside, v, -np.inf), axis=0)
    peak, when, sampling, bend = v[row, bodies].copy(), time[row].copy(), np.zeros(n), np.zeros(n)
    late_peak = np.zeros(n, dtype=bool)
    for companion in (-1, 0):  # before the largest sample and behind it; a body in free flight has its peak at a sample
        early = row + companion
        late = np.minimum(early + 1, len(time) - 1)
        ok = (early >= 0) & (late > early)
        early = np.maximum(early, 0)
        turning = np.flatnonzero(ok & (a[early, bodies] > 0.0) & (a[late, bodies] < 0.0))
        if len(turning):
            moved = _maximum(trajectory, v[:, turning], a[:, turning], time[early[turning]], time[late[turning]])
            # after the crossing within this interval the body may still gain velocity, which does not count
            higher = (moved[1] > peak[turning]) & (moved[0] <= until[turning])
            which = turning[higher]
            when[which], peak[which] = moved[0][higher], moved[1][higher]
            fall = (a[early, bodies] - a[late, bodies])[turning] / (time[late] - time[early])[turning]
            bend[which] = fall[higher]
    handed = np.flatnonzero(np.isfinite(came[1:])) if len(came) > 1 else np.zeros(0, dtype=np.int64)
    if len(handed) and not np.any(np.isnan(a)):
        # a body that is still accelerated when it hands the impulse on is fastest then
        at_end = hermite(trajectory, v[:, handed], a[:, handed], until[handed])
        slope = hermite(trajectory, v[:, handed], a[:, handed], until[handed], derivative=1)
        still = (slope > 0.0) & (at_end > peak[handed])
        which = handed[still]
        peak[which], when[which] = at_end[still], until[which]
        sampling[which] = (np.abs(slope) * arrival_uncertainty(None, trajectory)[1:][handed])[still]
        late_peak[which] = True
    if not np.any(np.isnan(a)):
        sampling += difference_of_fewer(trajectory, v, a, when)
    # a pulse that fell between two samples of binary collisions is not known
    missing = np.isnan(came) | ~(peak > 0.0)
    sampling[np.any(np.isnan(a), axis=0)] = np.nan
    for item in (peak, when, sampling):
        item[missing] = np.nan
    uncertainty = sampling + trajectory.uncertainty["velocity"]
    # v - bend t^2/2 with an error of either sign has its maximum where at most twice the uncertainty is missing
    time_uncertainty = np.sqrt(4.0 * np.divide(uncertainty, bend, out=np.full(n, np.inf), where=bend > 0.0))
    handing = np.append(arrival_uncertainty(None, trajectory)[1:], np.inf)
    time_uncertainty[late_peak] = handing[late_peak]
    return PeakVelocity(
        velocity=peak, time=when, sampling=sampling, uncertainty=uncertainty, time_uncertainty=time_uncertainty
    )


def _maximum(trajectory: Trajectory, v: Floats, a: Floats, early: Floats, late: Floats) -> tuple[Floats, Floats]:
    """Return time and value of each velocity's maximum."""
    when = root_between(lambda when: hermite(trajectory, v, a, when, derivative=1), early, late)
    return when, hermite(trajectory, v, a, when)


def difference_of_fewer(trajectory: Trajectory, v: Floats, a: Floats, when: Floats) -> Floats:
    """Return the largest difference of polynomials through fewer samples around each velocity's own time.

    It is that of four samples from six where it is far smaller than that of two from four; elsewhere the samples are
    too far apart for the motion, and both differences count.
    """
    time = trajectory.time
    around = np.clip(when + _AROUND[:, None] * spacing(trajectory), time[0], time[-1])
    six, four, two = (hermite(trajectory, v, a, around, nodes=nodes) for nodes in (NODES, FEWER, 2))
    fine, coarse = np.max(np.abs(six - four), axis=0), np.max(np.abs(four - two), axis=0)
    return np.asarray(np.where(fine < _CONVERGING * coarse, fine, 2.0 * (fine + coarse)))


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedConstant:
    """Hold the speed constant of the front at body i = 1..n_body-2; :func:`local_speed_constant` returns it."""

    body: NDArray[np.int64]
    by_velocity: Floats
    """c / ((beta/m)^(1/n) v_max^((n-2)/n)), from the largest velocity of the body."""
    by_velocity_uncertainty: Floats
    by_force: Floats
    """The same constant from the peak forces beside the body, which stand for the v_max of their solitary wave."""
    by_force_uncertainty: Floats
    solitary: float
    """What it is in a solitary wave: 0.907470078412 for n = 5/2."""


def local_speed_constant(scene: Scene, trajectory: Trajectory) -> SpeedConstant:
    """Return the speed constant of the front, its speed over that of its size, ``(n_body - 2,)``.

    In the solitary wave of a uniform chain c = K (beta/m)^(1/n) v_max^((n-2)/n) bodies per second (Nesterenko 2001,
    ch. 1, whose long-wave K is 1.2 % off; the chain's own: :mod:`dem_bridge.physics.solitary`). Here c is one over
    the residence time of body i, m its mass, beta and the peak force the geometric means of those of the contacts on
    both sides. A struck uniform Hertzian chain comes to K like 0.56^i: to 1.5e-4 at body 10, 4e-7 at 20, 1.3e-9 at 30,
    4e-12 at 40 and 2e-14 at 60; the last two bodies with a residence time feel the free end. Bars: of the run's
    crossing times, peak forces and velocities, and of the samples (:func:`peak_velocity_of_front`).

    Raises UsageError for contacts whose exponents differ or are not above 2, or that have laws of their own.

    >>> import dem_bridge as db
    >>> from dem_bridge.scene.scene import Scene
    >>> chain = Scene(name="uniform", duration=1e-3, mass=(0.01,) * 60, stiffness=(2e10,) * 59,
    ...               velocity=(0.8,) + (0.0,) * 59)
    >>> found = local_speed_constant(chain, db.solve(chain, backend="reference", uncertainty=False))
    >>> f"{found.solitary:.9f} {found.by_force[39]:.9f} {found.by_velocity[39]:.9f}"
    '0.907470078 0.907470078 0.907470078'
    """
    links = scene.n_body - 1
    c = scene.contacts
    exponents = set(c.exponent[:links].tolist())
    if len(exponents) != 1 or not min(exponents) > 2.0 or scene.law is not None:
        result = "laws of their own" if scene.law is not None else f"exponents {sorted(exponents)}"
        raise UsageError(f"{scene.name} has contacts with {result}; a solitary wave needs one exponent above 2 for all")
    n = exponents.pop()
    wave = solitary_wave(mass=1.0, stiffness=1.0, exponent=n, peak_velocity=1.0)

    speed = front_speed(None, trajectory)[1:-1]
    of_speed = residence_time_uncertainty(None, trajectory)[1:-1] * speed
    mass, beta = np.array(scene.mass)[1:-1], local_stiffness(scene, np.arange(1, links))
    power = (n - 2.0) / n
    peak = peak_velocity_of_front(scene, trajectory)
    by_velocity = speed / ((beta / mass) ** (1.0 / n) * peak.velocity[1:-1] ** power)
    # at m = beta = 1 a wave with v = 1 has the force F_1, and v^(1/n) goes as F^(1/(2 (n-1)))
    force = trajectory.peak_force[:links]
    of_force = np.asarray(trajectory.uncertainty["peak_force"])[:links] / force
    half = 0.5 * power * n / (n - 1.0)
    unit = beta ** (0.5 / (n - 1.0)) / np.sqrt(mass)
    by_force = speed / (unit * (np.sqrt(force[:-1] * force[1:]) / wave.peak_force) ** half)
    return SpeedConstant(
        body=np.arange(1, links),
        by_velocity=by_velocity,
        by_velocity_uncertainty=by_velocity * (of_speed + power * peak.uncertainty[1:-1] / peak.velocity[1:-1]),
        by_force=by_force,
        by_force_uncertainty=by_force * (of_speed + half * 0.5 * (of_force[1:] + of_force[:-1])),
        solitary=wave.speed,
    )


def _wave_speed(scene: Scene, run: Trajectory) -> Measured:
    """Return the front speed times the spacing of the bodies; nan for a scene without one."""
    spacing_of_bodies = np.nan if scene.spacing is None else scene.spacing
    return Measured(spacing_of_bodies * front_speed(None, run), spacing_of_bodies * front_speed_uncertainty(None, run))


DECLARED = (
    measured(
        of_run(arrival, arrival_uncertainty),
        name="arrival",
        definition="Time at which the impulse reaches the body: the first maximal compression of the contact on its"
        " struck side (Chaunsali, Kim & Yang 2018, section 4a).",
        unit="s",
        axis=("body",),
        follows="crossing_time",
    ),
    measured(
        of_run(
            lambda scene, run: arrival(None, run)[-1],
            lambda scene, run: arrival_uncertainty(None, run)[-1],
        ),
        name="arrival_at_end",
        definition="Arrival of the impulse at the last body of the chain.",
        unit="s",
        axis=(),
        follows="crossing_time",
    ),
    measured(
        of_run(residence_time, residence_time_uncertainty),
        name="residence_time",
        definition="Time between the first maximal compressions of the two contacts of the body, during which it holds"
        " the impulse (Chaunsali, Kim & Yang 2018, section 4a).",
        unit="s",
        axis=("body",),
    ),
    measured(
        of_run(front_speed, front_speed_uncertainty),
        name="front_speed",
        definition="Speed of the wave front at the body in bodies per second: the inverse of the residence time.",
        unit="1/s",
        axis=("body",),
        follows="residence_time",
    ),
    measured(
        _wave_speed,
        name="wave_speed",
        definition="Speed of the wave front at the body: the spacing of the bodies over the residence time (Chaunsali,"
        " Kim & Yang 2018, eq. 3.6).",
        unit="m/s",
        axis=("body",),
        follows="residence_time",
    ),
    measured(
        lambda scene, run: Measured(*peak_velocity_of_front(scene, run).largest),
        name="peak_velocity",
        definition="Largest velocity of the body until it hands the impulse on.",
        unit="m/s",
        axis=("body",),
        follows="velocity",
    ),
    measured(
        lambda scene, run: Measured(*peak_velocity_of_front(scene, run).when),
        name="peak_velocity_time",
        definition="Time at which the body has its largest velocity before it hands the impulse on.",
        unit="s",
        axis=("body",),
        follows="velocity",
    ),
)
