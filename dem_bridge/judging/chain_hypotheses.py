"""The hypotheses that concern a whole chain: factors, exponents, moduli and radii, damping, gravity."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.hypotheses import (
    DEVIATIONS_FROM_ZERO,
    LOG_STARTS,
    WIDE_STARTS,
    Changes,
    Hypothesis,
    Variant,
    effective,
    factor_of,
)
from dem_bridge.judging.model import Model, system_of
from dem_bridge.scene.scene import Scene

Floats = NDArray[np.float64]

DAMPING_NAMES = ("dashpot", "mass_velocity", "kuwabara-kono", "coeff_restitution")


def global_hypotheses(scene: Scene, model: Model) -> Iterator[Hypothesis]:
    """Yield the hypotheses that concern the whole chain and are fitted by continuous parameters, or have none."""
    change = Changes(scene, model)
    base = model.system
    yield Hypothesis(
        "stiffness-scale",
        lambda p: Variant(change.with_factors(stiffness=factor_of(p[0]))),
        "All stiffnesses are {0:.6g} +- {1:.2g} of the scene's.",
        WIDE_STARTS,
        value=factor_of,
        family="factor",
    )
    yield Hypothesis(
        "mass",
        lambda p: Variant(change.with_factors(mass=factor_of(p[0]))),
        "All masses are {0:.6g} +- {1:.2g} of the scene's.",
        WIDE_STARTS,
        value=factor_of,
        family="factor",
    )
    yield from _exponents(change)
    yield from _patterns(scene, change)
    yield from _damping(scene, change)
    yield from _gravity(scene, change)
    yield Hypothesis("tension", lambda p: Variant(base.changed(pulls=True)), "Open contacts pull.")
    yield Hypothesis(
        "time-scale",
        lambda p: Variant(base, scale=factor_of(p[0])),
        "Times of the file are to be multiplied by {0:.8g} +- {1:.2g}.",
        ((0.0,), (0.3,), (-0.3,)),
        value=factor_of,
    )
    yield Hypothesis(
        "start-velocity",
        lambda p: Variant(base.changed(velocity=base.velocity * factor_of(p[0]))),
        "All start velocities are {0:.6g} +- {1:.2g} of the scene's.",
        LOG_STARTS,
        value=factor_of,
    )
    yield Hypothesis(
        "drag",
        lambda p: Variant(base._replace(drag=base.drag + p[0] / scene.duration)),
        "Every body is dragged.",
        ((0.0,), (0.1,)),
        nameable=False,
    )


def _exponents(change: Changes) -> Iterator[Hypothesis]:
    """Yield another exponent, with the stiffnesses of the scene as numbers and with others."""
    own = np.unique(change.base.exponent)
    if len(own) == 1:
        start, words = float(own[0]), f"The exponent n is {{0:.6g}} +- {{1:.2g}} in place of {own[0]:g}"
    else:
        start, words = 0.0, "The exponents n differ from the scene's by {0:.6g} +- {1:.2g}"

    def numbers(p: Floats, deviation: Floats) -> tuple[float, ...]:
        # the factor on the forces at the depth of the impact is fitted, which the exponent does not change
        depth = math.log(max(change.model.depth, 1e-12))
        factor = math.exp(float(p[1]) - float(p[0]) * depth)
        uncertain = factor * float(deviation[1] + deviation[0] * abs(depth))
        return start + float(p[0]), float(deviation[0]), factor, uncertain

    yield Hypothesis(
        "exponent",
        lambda p: Variant(change.bent(p[0])),
        f"{words}.",
        ((0.0,), (0.25,), (-0.25,), (0.5,), (-0.5,)),
        value=lambda p: start + p,
        bounds=(-1.4, 3.0),
    )
    yield Hypothesis(
        "exponent",
        lambda p: Variant(change.bent(p[0], factor=factor_of(p[1]))),
        f"{words}, and stiffness over mass is {{2:.6g}} +- {{3:.2g}} times the number of the scene.",
        ((0.0, 0.0), (0.25, 0.0), (-0.25, 0.0), (0.5, 0.0), (-0.5, 0.0)),
        numbers=numbers,
        bounds=(-1.4, 3.0),
        together=("exponent", "stiffness-scale"),
        least=DEVIATIONS_FROM_ZERO,
    )


def common_factor(scene: Scene, model: Model) -> Hypothesis:
    """Return one factor on all masses and stiffnesses, which changes contact forces and mostly nothing else."""
    change = Changes(scene, model)
    return Hypothesis(
        "stiffness-scale",
        lambda p: Variant(change.with_factors(mass=factor_of(p[0]), stiffness=factor_of(p[0]))),
        "All masses and all stiffnesses are {0:.6g} +- {1:.2g} of the scene's.",
        LOG_STARTS,
        value=factor_of,
        family="common",
        together=("stiffness-scale", "mass"),
    )


def lacking_radius(scene: Scene, factor: float, within: float) -> float | None:
    """Return the radius, m, whose root all stiffnesses lack if they have one ``factor``; None if it is none of them.

    All effective radii are equal then, or the walls have them all; ``within`` is relative. A scene of numbers alone has
    no radii.
    """
    if scene.geometry is None:
        return None
    radii = np.array([body.radius for body in scene.geometry.bodies])
    reduced = effective(radii)[1:-1]
    equal = [values[0] for values in (reduced, radii, 0.5 * radii) if len(values) and np.ptp(values) < 1e-9 * values[0]]
    return next((float(radius) for radius in equal if abs(factor * math.sqrt(radius) - 1.0) < within), None)


def uniform_name(scene: Scene, factor: float, within: float) -> str:
    """Return the cause that the value of a factor on all stiffnesses suggests; ``within`` is relative."""
    if scene.geometry is None:
        return "stiffness-scale"
    body = scene.geometry.bodies[0]
    loss = 1.0 - body.material.poissons_ratio**2
    if lacking_radius(scene, factor, within) is not None:
        return "missing-sqrt-radius"
    if any(abs(factor / ratio - 1.0) < within for ratio in (2.0 * loss, loss, 2.0, 1.0 / loss, 0.5)):
        return "modulus"
    return "stiffness-scale"


def stiffness_patterns(scene: Scene) -> Iterator[tuple[str, Floats]]:
    """Yield causes with the factors on the stiffnesses of the contacts between bodies that they make.

    Factors are relative to their geometric mean. Stiffnesses of walls are numbers of a scene, in which neither a radius
    nor a modulus enters.
    """
    base = system_of(scene)
    inner, walls = base.stiffness[1:-1], base.stiffness[[0, -1]]
    moduli, radii = [np.ones(len(inner))], [np.cbrt(base.mass)]
    if scene.geometry is not None:
        radii = [np.array([body.radius for body in scene.geometry.bodies]), *radii]
        young = np.array([body.material.youngs_modulus for body in scene.geometry.bodies])
        loss = np.array([1.0 - body.material.poissons_ratio**2 for body in scene.geometry.bodies])
        plain = effective(young / loss)[1:-1]
        moduli = [young[:-1] / plain, young[1:] / plain, effective(young)[1:-1] / plain]
    patterns = [("modulus", pattern) for pattern in moduli]
    patterns += [("missing-sqrt-radius", effective(radius)[1:-1] ** -0.5) for radius in radii]
    patterns.append(("missing-sqrt-radius", inner**-1.0))
    seen: list[Floats] = []
    for cause, pattern in patterns if len(inner) else ():
        relative = pattern / np.exp(np.mean(np.log(pattern)))
        if np.ptp(relative) < 1e-9 and (cause != "modulus" or not np.any(walls > 0.0)):
            continue
        if any(np.max(np.abs(relative - other)) < 1e-9 for other in seen):
            continue
        seen.append(relative)
        yield cause, relative


def _patterns(scene: Scene, change: Changes) -> Iterator[Hypothesis]:
    """Yield factors on stiffnesses that differ between contacts: moduli, and a missing sqrt(R*)."""
    for cause, relative in stiffness_patterns(scene):
        words = "Stiffnesses lack sqrt(R*)" if cause != "modulus" else "Stiffnesses have another modulus"
        yield Hypothesis(
            cause,
            lambda p, relative=relative: Variant(  # type: ignore[misc]
                change.with_factors(stiffness=np.concatenate([[1.0], relative * factor_of(p[0]), [1.0]]))
            ),
            f"{words} in the contacts between bodies (mean factor {{0:.6g}} +- {{1:.2g}}).",
            WIDE_STARTS,
            value=factor_of,
            probe=1e-3 if np.ptp(relative) < 1e-9 else None,
        )


def _damping(scene: Scene, change: Changes) -> Iterator[Hypothesis]:
    """Yield other damping, and another clip."""
    base = change.base
    if base.damped:
        yield Hypothesis(
            "clip",
            lambda p: Variant(base._replace(clipped=not base.clipped)),
            "The net contact force is {}clipped at zero.".format("not " if base.clipped else ""),
        )
        yield Hypothesis(
            "damping",
            lambda p: Variant(base.changed(damping=base.damping * factor_of(p[0]))),
            "The damping is {0:.6g} +- {1:.2g} of the scene's.",
            LOG_STARTS,
            value=factor_of,
        )
        yield Hypothesis(
            "damping", lambda p: Variant(base.changed(damping=0.0 * base.damping)), "Contacts are not damped."
        )
    for law, name in enumerate(DAMPING_NAMES):
        for clipped in (True, False):
            make, unit = change.damping(law, clipped)
            yield Hypothesis(
                "damping",
                make,
                f"Contacts are damped ({name}, {'clipped' if clipped else 'not clipped'}, constant {{0:.6g}}"
                " +- {1:.2g}).",
                ((0.0,), (1.0,), (0.1,), (10.0,)),
                value=partial(operator.mul, unit),
                probe=None if base.damped else 1e-2,
                reach=100.0,
                bounds=(0.0, 400.0),
                family=f"damping {law}",
            )


def _gravity(scene: Scene, change: Changes) -> Iterator[Hypothesis]:
    base, g = change.base, scene.gravity
    unit = change.model.speed / scene.duration
    starts = tuple({(-g / unit,): None, (9.81 / unit,): None, (-9.81 / unit,): None, (0.0,): None})
    sentence = "The acceleration by gravity differs from the scene's by {0:.6g} +- {1:.2g} m/s^2."
    yield Hypothesis(
        "gravity",
        lambda p: Variant(base._replace(free=base.free + p[0] * unit)),
        sentence,
        starts,
        value=lambda p: p * unit,
        reach=1e6,
    )
    if scene.precompression > 0.0 and g != 0.0:
        yield Hypothesis(
            "gravity",
            lambda p: Variant(system_of(replace(scene, gravity=g + p[0] * unit))),
            sentence,
            starts,
            value=lambda p: p * unit,
            reach=1e6,
        )
