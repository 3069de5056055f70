"""Laws fitted along the chain: wave speed (fig. 3c, d), peak force against stiffness (fig. 5c, d), peak velocity.

The residuals of these fits are not random but a slow departure from a power law. A standard error then states how well
a line fits its points, not how well its slope is known. A slope therefore also has a ``spread``, the range of slopes
over other windows, and an ``uncertainty``, its largest change within the uncertainties of the run.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.observables.front import front_speed, peak_velocity_of_front, residence_time_uncertainty
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: shares of the chain at the struck end, where the pulse forms, and at the far end, that a default window leaves out
FORMING, ENDING = 0.1, 0.05
#: sizes of the windows of a spread, in parts of the whole window; each at its start, middle and end
PARTS = (0.9, 0.8, 0.7, 0.6, 0.5)


def inner_bodies(scene: Scene) -> tuple[int, int]:
    """Return the first and last body whose residence time is not affected by the ends: 3 and n_body - 3.

    Residence times of bodies 1 and 2 depend on the striker's contact, which in the paper's decelerating chain is 18
    times softer, so that the speed at body 1 is three times that at body 3. The last one is that before the free end.
    """
    return 3, scene.n_body - 3


def inner_contacts(scene: Scene) -> tuple[int, int]:
    """Return the first and last contact between the ends, both included.

    The first tenth, where the pulse still forms and secondary pulses leave it, and the last twentieth, where it feels
    the end of the chain, are excluded.

    >>> import dem_bridge as db
    >>> inner_contacts(db.load_scene("decelerating-40"))
    (4, 37)
    """
    links = scene.n_body - 1
    return int(np.ceil(FORMING * links)), int(np.floor((1.0 - ENDING) * links)) - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedFit:
    """Hold the fit V_i = (b1 + b2 i)^(1/n), V in m/s; :func:`speed_power_law` returns it."""

    b1: float
    """(m/s)^n."""
    b2: float
    """(m/s)^n per body."""
    covariance: Floats
    """Of (b1, b2), ``(2, 2)``, from the residuals."""
    residual: float
    """Root mean square of fit / V - 1."""
    exponent: float
    """n: that of the scene, not fitted."""
    first: int
    last: int
    """Bodies fitted, both included."""
    uncertainty: tuple[float, float]
    """Largest changes of b1 and b2 by the uncertainties of the run's crossing times."""

    def speed(self, body: NDArray[np.int64] | int) -> Floats:
        """Return the fitted speed at bodies, m/s."""
        return np.asarray((self.b1 + self.b2 * np.asarray(body)) ** (1.0 / self.exponent))


def speed_power_law(
    scene: Scene, trajectory: Trajectory, *, first: int | None = None, last: int | None = None
) -> SpeedFit:
    """Fit the power law of the wave speed along a chain whose stiffness is linear in i (paper, section 4a, fig. 3c, d).

    Least squares in V, the wave speed by crossing, over bodies ``first`` to ``last``, both included (None: those of
    :func:`inner_bodies`). The exponent 1/n is that of the scene's contacts, as in the paper. Raises UsageError for a
    scene without spacing, with exponents that differ or contacts with laws, or a window of fewer than 3 bodies.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> fit = speed_power_law(scene, db.solve(scene, backend="reference", uncertainty=False))
    >>> fit.first, fit.last, f"{fit.speed(3):.0f} to {fit.speed(38):.0f} m/s, rms {fit.residual:.1%}"
    (3, 38, '1817 to 717 m/s, rms 0.7%')
    """
    from scipy.optimize import curve_fit

    n = _one_exponent(scene)
    low, high = inner_bodies(scene)
    low, high = low if first is None else first, high if last is None else last
    _check_window("bodies", low, high, 1, scene.n_body - 2, least=3)
    body = np.arange(low, high + 1)
    if scene.spacing is None:
        raise UsageError(f"{scene.name} has no spacing; a wave speed in m/s needs [chain] spacing = ... (m)")
    rate = front_speed(scene, trajectory)[body]
    speed = scene.spacing * rate
    _check_finite("the wave speed", speed, body)
    scale, middle = float(np.mean(speed)), float(np.mean(body))
    x = (body - middle) / len(body)

    def law(x: Floats, a: float, b: float) -> Floats:
        return np.asarray(np.maximum(a + b * x, 1e-12) ** (1.0 / n))

    def slope(x: Floats, a: float, b: float) -> Floats:
        return np.asarray(np.stack([np.ones_like(x), x], axis=1) * (law(x, a, b) ** (1.0 - n) / n)[:, None])

    # V^n is linear in i: where the least squares in V start from
    rise, level = np.polyfit(x, (speed / scale) ** n, 1)
    tight = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    (a, b), spread = curve_fit(law, x, speed / scale, p0=(level, rise), jac=slope, **tight)
    # (a, b) -> (b1, b2)
    unit = scale**n
    turn = unit * np.array([[1.0, -middle / len(body)], [0.0, 1.0 / len(body)]])
    b1, b2 = turn @ (a, b)
    # how each speed moves both, to first order
    moved = np.abs(turn @ np.linalg.pinv(slope(x, a, b)))
    relative = residence_time_uncertainty(scene, trajectory)[body] * rate
    uncertainties = moved @ (relative * speed / scale)
    return SpeedFit(
        b1=float(b1),
        b2=float(b2),
        covariance=turn @ spread @ turn.T,
        residual=float(np.sqrt(np.mean((law(x, a, b) * scale / speed - 1.0) ** 2))),
        exponent=n,
        first=low,
        last=high,
        uncertainty=(float(uncertainties[0]), float(uncertainties[1])),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Slope:
    """Hold the slope of a straight line through points along the chain, and its uncertainties."""

    slope: float
    stderr: float
    """Standard error of the slope, as if the residuals were scatter."""
    spread: tuple[float, float]
    """Least and largest slope over ``windows``."""
    uncertainty: float
    """Largest change of the slope by the run's uncertainties."""
    first: int
    last: int
    """Contacts or bodies fitted, both included."""
    windows: tuple[tuple[int, int], ...] = field(repr=False)
    """Other windows: 0.9 to 0.5 of the whole one, at its start, in its middle and at its end; and the whole."""
    slopes: Floats = field(repr=False)
    """Slope in each of them."""


def force_exponent(scene: Scene, trajectory: Trajectory, *, window: tuple[int, int] | None = None) -> Slope:
    """Fit the exponent of the peak contact force in the stiffness, F_max ~ beta^slope (section 4c, fig. 5c, d: 1/n).

    ``window``: first and last contact, both included (None: :func:`inner_contacts`). The paper's chains of 200 give
    0.3950 (decelerating; spread 0.3934 to 0.3974) and 0.4053 (accelerating; 0.4027 to 0.4073); in those of 40 the pulse
    is still forming. Raises UsageError for a window of
    fewer than 4 contacts, or where their stiffnesses are all the same.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> fit = force_exponent(scene, db.solve(scene, backend="reference", uncertainty=False))
    >>> f"{fit.slope:.3f}, over windows {fit.spread[0]:.3f} to {fit.spread[1]:.3f}", fit.first, fit.last
    ('0.435, over windows 0.419 to 0.439', 4, 37)
    """
    first, last = inner_contacts(scene) if window is None else window
    links = scene.n_body - 1
    _check_window("contacts", first, last, 0, links - 1, least=4)
    pick = slice(first, last + 1)
    stiffness, force = scene.contacts.stiffness[pick], trajectory.peak_force[pick]
    _check_finite("the peak force", force, np.arange(first, last + 1))
    if np.ptp(np.log(stiffness)) < 1e-6:
        raise UsageError(f"{scene.name} has one stiffness in contacts {first}..{last}; an exponent needs a gradient")
    uncertainty = np.asarray(trajectory.uncertainty["peak_force"])[pick] / force
    return straight_line(np.log(stiffness), np.log(force), uncertainty, first)


def log_velocity_slope(scene: Scene, trajectory: Trajectory, first: int, last: int) -> Slope:
    """Fit the slope of ln(peak velocity in the leading pulse) per body, from body ``first`` to ``last``, both included.

    In chains of spheres whose radius changes by a constant factor the binary collision approximation gives a constant
    slope (Wu 2002, *Physica A* 315, 194; Doney & Sen 2005, *Phys. Rev. E* 72, 041304). Peak velocities by
    :func:`~dem_bridge.observables.front.peak_velocity_of_front`; take 4 samples or more per residence time. Raises
    UsageError for fewer than 3 bodies.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> found = log_velocity_slope(scene, db.solve(scene, backend="bca"), 10, 30)
    >>> abs(found.slope) < 1e-12  # binary collisions of equal bodies hand all on
    True
    """
    _check_window("bodies", first, last, 0, scene.n_body - 1, least=3)
    peak, pick = peak_velocity_of_front(scene, trajectory), slice(first, last + 1)
    body, velocity = np.arange(first, last + 1), peak.velocity[pick]
    _check_finite("the peak velocity", velocity, body)
    return straight_line(body.astype(float), np.log(velocity), peak.uncertainty[pick] / velocity, first)


def straight_line(x: Floats, y: Floats, uncertainty: Floats, first: int) -> Slope:
    """Return the slope of y against x; point j is that of contact or body ``first + j``."""
    slope, stderr, weight = _least_squares(x, y)
    windows = [(0, len(x))]
    for part in PARTS:
        size = round(part * len(x))
        rest = len(x) - size
        windows += [(start, start + size) for start in (0, rest // 2, rest)]
    windows = sorted({(a, b) for a, b in windows if b - a >= 3 and np.ptp(x[a:b]) > 0.0})
    slopes = np.array([_least_squares(x[a:b], y[a:b])[0] for a, b in windows])
    return Slope(
        slope=slope,
        stderr=stderr,
        spread=(float(np.min(slopes)), float(np.max(slopes))),
        uncertainty=float(
            np.abs(weight[weight != 0.0]) @ uncertainty[weight != 0.0]
        ),  # an unknown uncertainty in the middle does not matter
        first=first,
        last=first + len(x) - 1,
        windows=tuple((first + a, first + b - 1) for a, b in windows),
        slopes=slopes,
    )


def _least_squares(x: Floats, y: Floats) -> tuple[float, float, Floats]:
    """Return the slope, its standard error, and the weight of each y in it."""
    away = x - np.mean(x)
    weight = away / np.sum(away**2)
    above = y - np.mean(y)  # of a small gradient the mean would leave its rounding
    slope = float(weight @ above)
    residual = above - slope * away
    return slope, float(np.sqrt(np.sum(residual**2) / (len(x) - 2) / np.sum(away**2))), weight


def _one_exponent(scene: Scene) -> float:
    exponents = set(scene.contacts.exponent[: scene.n_body - 1].tolist())
    if len(exponents) != 1 or scene.law is not None:
        raise UsageError(f"{scene.name} has no one exponent for all its contacts; the power law V_i needs one")
    return float(exponents.pop())


def _check_window(what: str, first: int, last: int, lowest: int, highest: int, *, least: int) -> None:
    if not (lowest <= first and last <= highest and last - first + 1 >= least):
        raise UsageError(
            f"{what} {first}..{last}; allowed: {least} or more of {lowest}..{highest}, first and last included"
        )


def _check_finite(what: str, values: Floats, number: NDArray[np.int64]) -> None:
    bad = number[~(np.isfinite(values) & (values > 0.0))]
    if len(bad):
        raise UsageError(
            f"{what} at {bad[0]} is not known: the pulse never came; take a longer run, or a narrower window"
        )
