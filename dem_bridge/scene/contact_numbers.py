"""The numbers of one contact of spheres by which users choose a time step and a coefficient of restitution.

In units of the effective mass m, the stiffness beta and the speed of approach v the impact with the damping force
``alpha sqrt(m beta) d^(1/4) d'`` depends on its restitution e alone, and so do the errors of a time step that is a
share of the contact time. They are measured here by the impact itself, integrated as LAMMPS does: velocity-Verlet whose
damping force takes the velocity of the half step.

The page docs/howto/contact.md computes the same in a browser.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, Literal, get_args

from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.numbers import check_number
from dem_bridge.physics.damped_impact import (
    RestitutionLaw,
    alpha_of_restitution,
    restitution_obtained,
    restitution_to_write,
)
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.hertz import sphere_on_plane, sphere_on_sphere
from dem_bridge.scene.timescales import rayleigh_time

SCHEMA = "dem-bridge/contact/1"
Partner = Literal["sphere", "wall", "rigid-wall"]
#: steps per contact at which errors are measured, and the places of the touch within a step, as shares of it; with each
#: of the last, the contact lasts a little longer than the steps, so that it opens at other places
_STEPS, _PHASES = tuple(8 << j for j in range(8)), tuple(i / 8 for i in range(8))
_LONGER = tuple(i / 4 for i in range(4))
#: alpha and the contact time are rounded to this before steps are made: then every machine, and a browser, makes the
#: same steps to the last bit, because only sums, products and square roots follow
_GRID = 2.0**32
#: smallest restitution: below it a contact that is damped by half-step velocities hardly opens at 8 steps
LEAST_RESTITUTION = 0.05
#: step and reach of the tanh-sinh quadrature; the rest is below 1e-16
_SPACING, _REACH = 1.0 / 16.0, 64
#: damping laws as the codes name them
LAWS: dict[str, RestitutionLaw] = {
    "LAMMPS coeff_restitution": "coeff_restitution",
    "LIGGGHTS coefficientRestitution": "coeff_restitution",  # the same force, by its source; not run with damping here
    "LAMMPS tsuji, until July 2026": "tsuji_without_sqrt2",
    "LAMMPS tsuji, from August 2026": "tsuji",
}


@dataclass(frozen=True, kw_only=True)
class Written:
    """What to write for the wanted restitution in one code; None where nothing gives it."""

    code: str
    clip: bool
    """True with ``limit_damping`` (LAMMPS) or ``limitForce on`` (LIGGGHTS): the net force is never negative."""
    write: float | None
    """Coefficient to write."""
    obtained: float
    """Restitution that results if the wanted one is written."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """Time steps for one permissible error."""

    error: float
    """Error of the restitution (absolute), and of positions (relative to the largest overlap)."""
    restitution: float
    """Largest time step for the restitution, s."""
    position: float
    """Largest time step for positions at the end of the contact, s."""
    restitution_steps: float
    """Number of steps per contact of the first step."""
    position_steps: float
    """Number of steps per contact of the second step."""


@dataclass(frozen=True, kw_only=True)
class ContactNumbers:
    """Numbers of one contact. :func:`contact_numbers` computes them."""

    stiffness: float
    """Stiffness beta, N/m^1.5."""
    mass: float
    """Effective mass, kg."""
    peak_overlap: float
    """Largest overlap of the elastic impact, m."""
    peak_force: float
    """Largest force of the elastic impact, N."""
    contact_time: float
    """Duration of the elastic impact, s."""
    restitution: float
    """Wanted restitution."""
    alpha: float
    """Factor alpha of the damping force."""
    damping: float
    """Coefficient ``alpha sqrt(m beta)`` of ``d^(1/4) d'``, for codes in which the force is written, N s/m^(5/4)."""
    damped_contact_time: float
    """Duration of the impact with this restitution, not clipped, s."""
    rayleigh_time: float
    """Rayleigh time of the sphere, s."""
    steps: tuple[Step, ...]
    written: tuple[Written, ...]

    @property
    def rayleigh_share(self) -> float:
        """Rayleigh time over the duration of the elastic impact."""
        return self.rayleigh_time / self.contact_time

    def as_json(self) -> dict[str, Any]:
        """Return the numbers as a JSON document."""
        return {"schema": SCHEMA, **asdict(self), "rayleigh_share": self.rayleigh_share}


def contact_numbers(
    *,
    youngs_modulus: float,
    poissons_ratio: float,
    density: float,
    radius: float,
    speed: float,
    restitution: float = 1.0,
    partner: str = "sphere",
    errors: Sequence[float] = (1e-2, 1e-3, 1e-4),
) -> ContactNumbers:
    """Return the numbers of a normal impact of a sphere by which a time step and a restitution are chosen.

    Parameters
    ----------
    youngs_modulus : float
        Young's modulus, Pa.
    poissons_ratio : float
        Poisson's ratio.
    density : float
        Density, kg/m^3.
    radius : float
        Radius of the sphere, m.
    speed : float
        Speed of approach, m/s.
    restitution : float
        Wanted coefficient of restitution, from 0.05 to 1.
    partner : {"sphere", "wall", "rigid-wall"}
        What the sphere hits: an equal sphere, a plane of its material, or a rigid plane.
    errors : sequence of float
        Permissible errors of the restitution and of positions for which steps are computed, from 1e-8 to 0.1.

    Returns
    -------
    ContactNumbers
        The steps are those of velocity-Verlet as LAMMPS does it, at the worst places of touch and opening within a
        step. Between the measured numbers of steps errors may be 1.13 times as large.

    Raises
    ------
    UsageError
        If a parameter is outside its range.

    Examples
    --------
    >>> glass = dict(youngs_modulus=48e9, poissons_ratio=0.2, density=2800.0, radius=0.01, speed=20.0)
    >>> numbers = contact_numbers(**glass, restitution=0.5)
    >>> f"{1e6 * numbers.contact_time:.6f} us, {numbers.peak_force:.5f} N, Rayleigh {numbers.rayleigh_share:.3f}"
    '40.339456 us, 10696.88898 N, Rayleigh 0.320'
    >>> [f"{row.code}: {row.write:.4f}" for row in numbers.written if not row.clip][::2]
    ['LAMMPS coeff_restitution: 0.5000', 'LAMMPS tsuji, until July 2026: 0.3667']
    """
    check_arguments(contact_numbers, locals())
    check_number("speed", speed, "a number above 0 (m/s)", above=0.0)
    wanted = f"a number from {LEAST_RESTITUTION:g} to 1"
    check_number("restitution", restitution, wanted, at_least=LEAST_RESTITUTION, at_most=1.0)
    for error in errors:
        check_number("errors", error, "numbers from 1e-8 to 0.1", at_least=1e-8, at_most=0.1)
    if partner not in get_args(Partner):
        raise UsageError(f"partner = {partner!r}; allowed: {', '.join(get_args(Partner))}")
    try:
        shear = youngs_modulus / (2.0 * (1.0 + poissons_ratio)) if poissons_ratio != -1.0 else math.nan
        rayleigh = rayleigh_time(radius=radius, density=density, modulus=shear, poisson=poissons_ratio)
        beta = stiffness_against(partner, radius=radius, young=youngs_modulus, poisson=poissons_ratio)
    except (TypeError, ValueError) as problem:
        raise UsageError(str(problem)) from None
    ball = density * 4.0 / 3.0 * math.pi * radius**3
    mass = 0.5 * ball if partner == "sphere" else ball
    hit = two_body_collision(masses=(mass, math.inf), velocities=(speed, 0.0), stiffness=beta, exponent=2.5)
    alpha = alpha_of_restitution(restitution)
    duration = _duration(restitution) * (mass * speed**2 / beta) ** 0.4 / speed
    of_e, of_x = step_errors(restitution)
    steps = []
    for error in errors:
        counts = steps_for(of_e, error), steps_for(of_x, error)
        step = Step(
            error=error,
            restitution=duration / counts[0],
            position=duration / counts[1],
            restitution_steps=counts[0],
            position_steps=counts[1],
        )
        steps.append(step)
    return ContactNumbers(
        stiffness=beta,
        mass=mass,
        peak_overlap=hit.peak_overlap,
        peak_force=hit.peak_force,
        contact_time=hit.contact_time,
        restitution=restitution,
        alpha=alpha,
        damping=alpha * math.sqrt(mass * beta),
        damped_contact_time=duration,
        rayleigh_time=rayleigh,
        steps=tuple(steps),
        written=tuple(_written(code, law, clip, restitution) for code, law in LAWS.items() for clip in (False, True)),
    )


def stiffness_against(partner: str, *, radius: float, young: float, poisson: float) -> float:
    """Return the Hertz stiffness (N/m^1.5) of a sphere against what it hits; ValueError for impossible numbers.

    Examples
    --------
    >>> f"{stiffness_against('rigid-wall', radius=0.1, young=7e10, poisson=0.3):.6g}"
    '3.24336e+10'
    """
    if partner == "sphere":
        return sphere_on_sphere(radius=radius, young=young, poisson=poisson).stiffness
    young2 = math.inf if partner == "rigid-wall" else None
    return sphere_on_plane(radius=radius, young=young, poisson=poisson, young2=young2).stiffness


def _written(code: str, law: RestitutionLaw, clip: bool, e: float) -> Written:
    """Return what to write for the restitution e, and what results if e is written."""
    write: float | None
    try:
        write = restitution_to_write(e, clip=clip, law=law)
    except ValueError:  # no coefficient gives this restitution
        write = None
    return Written(code=code, clip=clip, write=write, obtained=restitution_obtained(e, clip=clip, law=law))


def _decay(e: float) -> tuple[float, float]:
    """Return the end of the contact and the decay up to it, in the variable s with ds = d^(1/4) dt.

    With ``y = d^(5/4)`` the impact is the damped oscillator ``y'' = -(5/4) y - alpha y'``.
    """
    alpha = alpha_of_restitution(e)
    end = math.pi / math.sqrt(1.25 - 0.25 * alpha * alpha)
    return end, 0.5 * alpha * end


@lru_cache(maxsize=64)
def _duration(e: float) -> float:
    """Return the duration of the impact, not clipped, in units of (m v^2/beta)^(2/5)/v: the integral of y^(-1/5)."""
    end, decay = _decay(e)
    total = 0.0
    for j in range(-_REACH, _REACH + 1):
        u = j * _SPACING
        near, far = (1.0 / (1.0 + math.exp(sign * math.pi * math.sinh(u))) for sign in (-1.0, 1.0))
        y = 1.25 * end / math.pi * math.exp(-decay * near) * math.sin(math.pi * min(near, far))
        if y > 0.0:
            total += math.pi * math.cosh(u) * near * far * y**-0.2
    return _SPACING * end * total


def _peak_overlap(e: float) -> float:
    """Return the largest overlap of the impact in units of (m v^2/beta)^(2/5)."""
    alpha = alpha_of_restitution(e)
    rate = math.sqrt(1.25 - 0.25 * alpha * alpha)
    at = math.atan2(rate, 0.5 * alpha) / rate
    return float((1.25 / rate * math.exp(-0.5 * alpha * at) * math.sin(rate * at)) ** 0.8)


@lru_cache(maxsize=64)
def step_errors(e: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the errors of the restitution and of positions at 8, 16, ... 1024 steps per contact.

    Each is the largest over eight places of the touch and four of the opening within a step. The error of the
    restitution is absolute; that of the position is at the end of the contact, relative to the largest overlap.
    """
    alpha = round(alpha_of_restitution(e) * _GRID) / _GRID
    duration = round(_duration(e) * _GRID) / _GRID
    top = _peak_overlap(e)
    of_e, of_x = [], []
    for count in _STEPS:
        ends = [_impact(alpha, duration, phase, count + longer) for phase in _PHASES for longer in _LONGER]
        of_e.append(max(abs(speed - e) for speed, _ in ends))
        of_x.append(max(abs(overlap) for _, overlap in ends) / top)
    return tuple(of_e), tuple(of_x)


def _impact(alpha: float, duration: float, phase: float, count: float) -> tuple[float, float]:
    """Return the exit speed of an impact by velocity-Verlet, and its overlap when the exact contact ends.

    The exit speed is 0 where the contact has not opened in four times its duration.
    """
    dt, end = duration / count, math.floor(phase + count)
    overlap, speed, acceleration = -phase * dt, 1.0, 0.0
    at_end, touched = 0.0, False
    for step in range(4 * end):
        half = speed + 0.5 * dt * acceleration
        if step == end:  # positions move with the velocity of the half step
            at_end = overlap + (phase + count - end) * dt * half
        overlap += dt * half
        if overlap > 0.0:
            root = math.sqrt(overlap)
            acceleration, touched = -overlap * root - alpha * math.sqrt(root) * half, True
        else:
            acceleration = 0.0
        speed = half + 0.5 * dt * acceleration
        if touched and overlap <= 0.0 and step >= end:
            return -speed, at_end
    return 0.0, at_end


def steps_for(errors: Sequence[float], wanted: float) -> float:
    """Return the number of steps per contact from which on errors at 8, 16, ... steps are at most ``wanted``.

    Between two numbers the error is a power of the number of steps, and beyond the last one it goes on with the order
    of the last two, which is limited to 1 to 2.5, the orders of the method at a damped and an elastic touch.

    Examples
    --------
    >>> round(steps_for([8.0**-k for k in range(8)], 0.25), 12), steps_for([1e-9] * 8, 1e-2)
    (12.699208415746, 8.0)
    """
    last = max((j for j, error in enumerate(errors) if error > wanted), default=-1)
    if last < 0:
        return float(_STEPS[0])
    if last == len(errors) - 1:
        order = min(max(math.log2(errors[-2] / errors[-1]), 1.0), 2.5)
        return float(_STEPS[-1] * (errors[-1] / wanted) ** (1.0 / order))
    ratio = math.log(errors[last] / wanted) / math.log(errors[last] / errors[last + 1])
    return float(_STEPS[last] * 2.0**ratio)
