"""The maps of the damping laws: which coefficient of restitution results from which number, and back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from dem_bridge.formats.tables.constants.constant import Constant, Family, label
from dem_bridge.physics.damped_impact import RestitutionLaw, linear_restitution
from dem_bridge.physics.damped_impact import restitution_obtained as obtained
from dem_bridge.physics.damped_impact import restitution_to_write as to_write
from dem_bridge.physics.viscoelastic import LARGEST_STRENGTH, viscoelastic_impact

#: coefficients of restitution that are written or wanted
RESTITUTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
DAMPING_RATIOS = (0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0, 1.5)
STRENGTHS = (0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
#: largest damping ratio of the way back: the restitution of the clipped contact is exp(-2) there
MOST_DAMPED = 1.0

_LAWS = Family(
    "restitution",
    12,
    "Antypov & Elliott (2011), EPL 94, 50004; Schwager & Poeschel (2007), Granul. Matter 9, 465; Marshall (2009),"
    " J. Comput. Phys. 228, 1541",
    "closed form of the damped oscillator in overlap^(n/2); the way back by its root",
    "integration of the motion by DOP853 in the fourth root of the overlap; the way back by its root",
)
_DASHPOTS = replace(
    _LAWS,
    group="restitution, dashpot",
    source="Schwager & Poeschel (2007), Granul. Matter 9, 465",
    method="closed form of the damped oscillator",
    second_method="integration of the motion of a damped spring by DOP853",
)
_VISCOELASTIC = replace(
    _LAWS,
    group="restitution, viscoelastic",
    source="Schwager & Poeschel (2008), Phys. Rev. E 78, 051304; Ramirez et al. (1999), Phys. Rev. E 60, 4465",
    method="Chebyshev series with a bound of its remainder",
    second_method="integration of the motion by DOP853 in the square root of the overlap",
)
#: the laws of restitution, and which contacts they are exact for
LAWS: Mapping[RestitutionLaw, str] = {
    "coeff_restitution": "any n",
    "tsuji": "n = 2.5",
    "tsuji_without_sqrt2": "n = 2.5; LAMMPS' tsuji until July 2026 and codes that copied it",
}
CLIPS = {"not_clipped": False, "clipped": True}


def _restitutions() -> Iterator[Constant]:
    """Yield the maps of the laws of restitution in both directions; what no coefficient gives is left out."""
    for law, where in LAWS.items():
        for key, clip in CLIPS.items():
            words = f"damping {law}, {key.replace('_', ' ')}"
            for e in RESTITUTIONS:
                name, parameters = f"restitution_{law}_{key}", f"e = {e:g}, {where}"
                value = obtained(e, clip=clip, law=law)
                yield Constant(f"{name}_e{label(e)}", f"e that results, {words}", parameters, value, "", _LAWS)
                try:
                    value = to_write(e, clip=clip, law=law)
                except ValueError:
                    continue
                yield Constant(f"{name}_write_for_e{label(e)}", f"e to write, {words}", parameters, value, "", _LAWS)


def _other_dampings() -> Iterator[Constant]:
    """Yield the maps of dashpots (n = 2) and viscoelastic spheres (n = 5/2) in both directions."""
    for key, clip in CLIPS.items():
        words = key.replace("_", " ")
        for ratio in DAMPING_RATIOS:
            # a contact that may pull does not open from zeta = 1 on
            if clip or ratio < 1.0:
                name, where = f"restitution_dashpot_{key}_zeta{label(ratio)}", f"zeta = {ratio:g}, n = 2"
                quantity = f"e that results, damping dashpot (zeta = c/(2 sqrt(beta mu)), c = eta mu), {words}"
                value = _dashpot(ratio, clip)
                yield Constant(name, quantity, where, value, "", _DASHPOTS)
        for strength in STRENGTHS:
            name = f"restitution_viscoelastic_{key}_s{label(strength)}"
            quantity = f"e that results, damping viscoelastic (s = gamma (beta/mu)^(2/5) v^(1/5)), {words}"
            value = _viscoelastic(strength, clip)
            yield Constant(name, quantity, f"s = {strength:g}, n = 2.5", value, "", _VISCOELASTIC)
        for e in RESTITUTIONS:
            where, back = f"e = {e:g}", f"for_e{label(e)}"
            if not clip or e > _dashpot(MOST_DAMPED, clip):
                quantity = f"damping ratio zeta that gives e, damping dashpot, {words}"
                value = _root(_dashpot, clip, e, MOST_DAMPED)
                name = f"restitution_dashpot_{key}_zeta_{back}"
                yield Constant(name, quantity, f"{where}, n = 2", value, "", _DASHPOTS)
            if e > _viscoelastic(LARGEST_STRENGTH, clip):
                quantity = f"strength s that gives e, damping viscoelastic, {words}"
                value = _root(_viscoelastic, clip, e, LARGEST_STRENGTH)
                name = f"restitution_viscoelastic_{key}_s_{back}"
                yield Constant(name, quantity, f"{where}, n = 2.5", value, "", _VISCOELASTIC)


def _dashpot(ratio: float, clip: bool) -> float:
    """Return the restitution of a spring and a dashpot of a damping ratio."""
    return linear_restitution(damping_ratio=ratio, clip=clip)


def _viscoelastic(strength: float, clip: bool) -> float:
    """Return the restitution of viscoelastic spheres of a strength."""
    return viscoelastic_impact(mass=1.0, speed=1.0, stiffness=1.0, viscosity=strength, clip=clip).restitution


def _root(restitution: Callable[[float, bool], float], clip: bool, e: float, most: float) -> float:
    """Return the argument from 0 to ``most`` at which a falling restitution is e."""
    from scipy.optimize import brentq

    return float(brentq(lambda value: restitution(value, clip) - e, 0.0, most, xtol=1e-16, rtol=1e-15))


def damped_constants() -> Iterator[Constant]:
    """Yield the constants of damped impacts in the order of the table."""
    yield from _restitutions()
    yield from _other_dampings()
