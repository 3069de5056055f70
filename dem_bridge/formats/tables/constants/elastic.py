"""The elastic constants: solitary waves, collisions of two bodies, the impacts of Chung & Ooi, and dispersion."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from dem_bridge.formats.tables.constants.constant import Constant, Family, label
from dem_bridge.physics.dispersion import dispersion
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.solitary import long_wave, solitary_wave
from dem_bridge.scene.contact_numbers import stiffness_against

#: exponents n of the solitary waves; the force exponents n - 1 include 1.5 to 5
WAVE_EXPONENTS = (2.1, 2.2, 2.25, 2.3, 2.4, 2.5, 2.6, 2.75, 3.0, 3.25, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0)
COLLISION_EXPONENTS = (1.5, 2.0, 2.25, 2.5, 2.75, 3.0, 3.5, 4.0, 5.0)
MASS_RATIOS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 10.0)
#: phases per contact, as shares of pi, and the ratios of the masses of a chain of two
WAVE_NUMBERS = (1 / 6, 1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 1.0)
DIMERS = (0.1, 0.25, 0.5, 0.75)


@dataclass(frozen=True, kw_only=True)
class Impact:
    """One of the elastic normal impacts of Chung & Ooi (2011)."""

    name: str
    words: str
    young: float
    poisson: float
    density: float
    radius: float
    speed: float
    """Speed of approach, m/s."""
    partner: str
    """"sphere" for an equal sphere, "rigid-wall", or "wall" of the material of the sphere."""

    @property
    def mass(self) -> float:
        """Mass of a sphere, kg."""
        return self.density * 4.0 / 3.0 * math.pi * self.radius**3


def _impacts() -> tuple[Impact, ...]:
    """Return the impacts of Chung & Ooi, tests 1 to 3, and those on a wall of the material of the sphere."""
    cases = (
        (1, "glass", 48e9, 0.2, 2800.0, 0.01, 20.0, ("sphere",)),
        (1, "limestone", 20e9, 0.25, 2500.0, 0.01, 20.0, ("sphere",)),
        (2, "aluminium", 70e9, 0.3, 2699.0, 0.1, 0.2, ("rigid-wall", "wall")),
        (2, "magnesium", 40e9, 0.35, 1800.0, 0.1, 0.2, ("rigid-wall", "wall")),
        (3, "alumina", 380e9, 0.23, 4000.0, 2.5e-3, 3.9, ("rigid-wall", "wall")),
        (3, "cast_iron", 100e9, 0.25, 7000.0, 2.5e-3, 3.9, ("rigid-wall", "wall")),
    )
    partners = {"sphere": "two spheres", "rigid-wall": "rigid wall", "wall": "wall of the same material"}
    return tuple(
        Impact(
            name=f"chung_ooi_{test}_{material}{'_same_wall' * (partner == 'wall')}",
            words=f"Chung & Ooi test {test}, {material.replace('_', ' ')}, {partners[partner]}",
            young=young,
            poisson=poisson,
            density=density,
            radius=radius,
            speed=speed,
            partner=partner,
        )
        for test, material, young, poisson, density, radius, speed, against in cases
        for partner in against
    )


IMPACTS = _impacts()


_WAVES = Family(
    "solitary wave",
    12,
    "English & Pego (2005), Proc. AMS 133, 1763; Friesecke & Wattis (1994), Commun. Math. Phys. 161, 391",
    "cosine series of the discrete chain's fixed point, Newton's method",
    "Gauss-Legendre panels in space of the same chain, Newton's method",
)
_LONG_WAVES = Family(
    "solitary wave, Nesterenko",
    12,
    "Nesterenko (2001), Dynamics of Heterogeneous Materials, ch. 1: long waves, an approximation",
    "closed form; its error is relative to the discrete chain",
    "Nesterenko's differential equation of a long wave, integrated by DOP853 from its peak",
)
_COLLISIONS = Family(
    "collision of two bodies",
    13,
    "Deresiewicz (1968), Acta Mech. 6, 110",
    "closed form with Gamma functions",
    "adaptive quadrature of the time over the overlap; momentum and energy solved by a quadratic equation",
)
_BENCHMARKS = Family(
    "Chung & Ooi",
    13,
    "Chung & Ooi (2011), Granul. Matter 13, 643; Johnson (1985), Contact Mechanics, section 4.2",
    "Hertz stiffness from curvatures by elliptic integrals, closed form of the collision",
    "Hertz' formula of spheres in decimal arithmetic of 40 digits, quadrature of the time",
)
_DISPERSION = Family(
    "dispersion",
    12,
    "Brillouin (1946), Wave Propagation in Periodic Structures, ch. 3 and 4",
    "closed form",
    "eigenvalues of the dynamical matrix of the periodic chain; speeds by differences of them",
)


def _waves() -> Iterator[Constant]:
    """Yield the solitary waves of the uniform chain by exponent, with the long-wave theory beside them."""
    for n in WAVE_EXPONENTS:
        wave = solitary_wave(mass=1.0, stiffness=1.0, exponent=n, peak_velocity=1.0)
        theory, where = long_wave(n), f"n = {n:g}, force exponent {n - 1.0:g}"
        by_force = wave.speed / wave.peak_force ** (0.5 * (n - 2.0) / (n - 1.0))
        speeds = {
            "speed_by_velocity": ("speed over (beta/m)^(1/n) v_max^((n-2)/n)", wave.speed, theory.speed_by_velocity),
            "speed_by_force": (
                "speed over beta^(1/(2(n-1))) m^(-1/2) F_max^((n-2)/(2(n-1)))",
                by_force,
                theory.speed_by_force,
            ),
            "width": ("full width of the force at half of its peak, in bodies", wave.width, theory.width),
        }
        head = f"solitary_n{label(n)}"
        for key, (words, exact, approximate) in speeds.items():
            yield Constant(f"{head}_{key}", words, where, exact, "", _WAVES)
            yield Constant(f"{head}_{key}_nesterenko", f"{words}, Nesterenko", where, approximate, "", _LONG_WAVES)
            error = approximate / exact - 1.0
            yield Constant(
                f"{head}_{key}_nesterenko_error",
                f"{words}, relative error of Nesterenko's formula",
                where,
                error,
                "",
                # a difference from 1: the digits of the ratio, less those that cancel
                replace(_LONG_WAVES, digits=_LONG_WAVES.digits + math.floor(math.log10(abs(error)))),
            )
        more = {
            "peak_force": ("F_max over beta^(1/n) m^((n-1)/n) v_max^(2(n-1)/n)", wave.peak_force),
            "momentum": ("momentum of the pulse over m v_max", wave.momentum),
            "energy": ("energy of the pulse over m v_max^2", wave.energy),
        }
        for key, (words, value) in more.items():
            yield Constant(f"{head}_{key}", words, where, value, "", _WAVES)


def _collisions() -> Iterator[Constant]:
    """Yield the elastic collision of two bodies by exponent, and the exit velocities by mass ratio."""
    for n in COLLISION_EXPONENTS:
        # reduced mass, stiffness and speed of approach are 1
        hit = two_body_collision(masses=(1.0, math.inf), velocities=(1.0, 0.0), stiffness=1.0, exponent=n)
        head, where = f"collision_n{label(n)}", f"n = {n:g}, mu = reduced mass, v = speed of approach"
        values = {
            "overlap": ("largest overlap over (mu v^2/beta)^(1/n)", hit.peak_overlap),
            "force": ("largest force over beta^(1/n) (mu v^2)^((n-1)/n)", hit.peak_force),
            "time": ("contact time over (mu/beta)^(1/n) v^(2/n-1)", hit.contact_time),
            "time_by_overlap": ("contact time over (largest overlap)/v", hit.contact_time / hit.peak_overlap),
        }
        for key, (words, value) in values.items():
            yield Constant(f"{head}_{key}", words, where, value, "", _COLLISIONS)
    for ratio in MASS_RATIOS:
        hit = two_body_collision(masses=(1.0, ratio), velocities=(1.0, 0.0), stiffness=1.0, exponent=2.5)
        for body, velocity in zip(("striker", "target"), hit.exit_velocity, strict=True):
            words = f"velocity of the {body} after an elastic collision, over that of the striker before"
            where = f"m_target/m_striker = {ratio:g}, any n"
            yield Constant(f"collision_mass_ratio_{label(ratio)}_{body}", words, where, velocity, "", _COLLISIONS)


def _benchmarks() -> Iterator[Constant]:
    """Yield stiffness, overlap, force and time of the impacts of Chung & Ooi."""
    for case in IMPACTS:
        beta = stiffness_against(case.partner, radius=case.radius, young=case.young, poisson=case.poisson)
        masses = (case.mass, case.mass if case.partner == "sphere" else math.inf)
        hit = two_body_collision(masses=masses, velocities=(case.speed, 0.0), stiffness=beta, exponent=2.5)
        where = (
            f"E = {case.young:g} Pa, nu = {case.poisson:g}, rho = {case.density:g} kg/m^3, R = {case.radius:g} m,"
            f" speed of approach {case.speed:g} m/s"
        )
        values = {
            "stiffness": ("stiffness beta", beta, "N/m^1.5"),
            "overlap": ("largest overlap", hit.peak_overlap, "m"),
            "force": ("largest force", hit.peak_force, "N"),
            "time": ("contact time", hit.contact_time, "s"),
        }
        for key, (words, value, unit) in values.items():
            yield Constant(f"{case.name}_{key}", f"{case.words}: {words}", where, value, unit, _BENCHMARKS)


def _dispersions() -> Iterator[Constant]:
    """Yield frequencies, group velocities, band edges and speeds of sound of precompressed chains."""
    chain = dispersion(mass=1.0, stiffness=1.0, exponent=2.0, static_force=1.0)  # K = 1 N/m
    for share in WAVE_NUMBERS:
        k = share * math.pi
        name, where = f"dispersion_k{round(180 * share)}", f"k = {round(180 * share)} degrees per contact"
        words = "angular frequency over sqrt(K/m), equal masses"
        yield Constant(f"{name}_frequency", words, where, chain.frequency(k), "", _DISPERSION)
        if share < 1.0:
            words = "group velocity over sqrt(K/m), contacts, equal masses"
            yield Constant(f"{name}_group_velocity", words, where, chain.group_velocity(k), "", _DISPERSION)
    for ratio in DIMERS:
        pair = dispersion(mass=(1.0, ratio), stiffness=1.0, exponent=2.0, static_force=1.0)
        values = {
            "acoustic_top": ("top of the acoustic branch", pair.band_gap[0]),
            "optical_bottom": ("bottom of the optical branch", pair.band_gap[1]),
            "cutoff": ("largest frequency", pair.cutoff),
            "acoustic_k45": ("acoustic branch at 45 degrees per contact", pair.frequency(0.25 * math.pi)),
            "optical_k45": ("optical branch at 45 degrees per contact", pair.frequency(0.25 * math.pi, optical=True)),
        }
        where = f"m_light/m_heavy = {ratio:g}"
        for key, (words, value) in values.items():
            quantity = f"{words}, angular frequency over sqrt(K/m_heavy), alternating masses"
            yield Constant(f"dispersion_dimer_{label(ratio)}_{key}", quantity, where, value, "", _DISPERSION)
    for n in COLLISION_EXPONENTS:
        speed = dispersion(mass=1.0, stiffness=1.0, exponent=n, static_force=1.0).sound_speed
        words = "speed of sound over beta^(1/(2(n-1))) m^(-1/2) F_0^((n-2)/(2(n-1))), contacts per second"
        yield Constant(f"sound_speed_n{label(n)}", words, f"n = {n:g}, static force F_0", speed, "", _DISPERSION)


def elastic_constants() -> Iterator[Constant]:
    """Yield the elastic constants in the order of the table."""
    for group in (_waves, _collisions, _benchmarks, _dispersions):
        yield from group()
