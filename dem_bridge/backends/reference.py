"""The reference: Taylor series through located openings and closings, compiled; see :mod:`.taylor`.

Against quadruple-precision solutions it is good to 1e-13 of v0 on the paper's chains. Where the series do not fit (an
exponent n whose 2(n-1) is no whole number up to 8, a law that is a function, damping, drag, a drive) it answers through
:mod:`.scipy_dop853` and says so in ``provenance``. A piston of constant velocity is a wall in its own frame.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import AlwaysAvailable, Resolution, Sampling, run_provenance
from dem_bridge.backends.scales import (
    before_wall,
    behind_piston,
    in_common_frame,
    in_rest_frame,
    natural_scales,
    pair_overlap,
    resting_acceleration,
)
from dem_bridge.backends.scipy_dop853 import ScipyDop853
from dem_bridge.backends.taylor import integrate
from dem_bridge.backends.taylor_series import BODY, COMPONENT, CONTACT, Table
from dem_bridge.errors import RunBroken
from dem_bridge.foundation.compiled import interruptible, side_by_side
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.scene.support import Condition, Exponents, Support
from dem_bridge.trajectory.trajectory import Cost, Trajectory

#: order of the series and what its last coefficients may contribute; 28 and 1e-16 are the fastest of 20..28 and
#: 1e-16..1e-18 that reach 1e-13 on the paper's chains
ORDER, ACCURACY = 28, 1e-16
#: order of the second run, for the bars
SECOND_ORDER = 22
#: overlap, relative to what the energy at hand could make, whose force is not felt, and the force that is not; by a
#: body lighter than those that move it would be, see :func:`_unfelt`. At n = 2 the force of this overlap is 1e-12: it
#: cost all runs alike 1.4e-14 of peak forces and 9e-15 of a crossing time, up to 1.4 uncertainties
TOUCH, FORCE = 1e-12, 1e-18
#: factor on those overlaps in the runs for the uncertainty: what the run misses, they miss twice, and the difference is
#: its error. Where a body of 1e6 kg handed on a force 1e7 times smaller than that on itself, all runs missed 2e-11 of
#: an overlap alike, and a crossing was 27 uncertainties from the truth
SECOND_UNFELT = 2.0
#: runs for the bars: each one more realisation of round-off
REALISATIONS = 6
MOST_STEPS = 50_000_000
#: power of two whose 28th power is far from the largest double
_MOST_POWER = 30.0


def _pressed_by_piston(scene: Scene) -> str | None:
    """Return a description of a precompressed chain that a piston moves, or None."""
    return "a piston moves a precompressed chain" if scene.piston and scene.precompression > 0.0 else None


#: what the series can do themselves: they need 2 (n - 1) to be a whole number up to 8
SERIES = Support(
    {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING, features.CONSTANT_PISTON}
    | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION},
    exponents=Exponents(values=(2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)),
    conditions=(Condition("no precompression of a chain that a piston moves", _pressed_by_piston),),
)


class Reference(AlwaysAvailable):
    """Taylor series with desingularised contacts."""

    name = "reference"
    #: scipy answers where the series do not fit
    supports = ScipyDop853.supports

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve by Taylor series, or through scipy where they do not fit."""
        if not SERIES.covers(scene):
            answer = ScipyDop853().run(scene, resolution, sampling)
            provenance = {**answer.provenance, "backend": self.name, "answered_by": ScipyDop853.name}
            return replace(answer, provenance=provenance)
        return self.solve_series(scene, sampling)

    def replicas(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> list[Trajectory]:
        """Return runs of another order that miss more force at touch, with every input moved by its last digit."""
        if scene.piston is not None:
            return [behind_piston(run, scene) for run in self.replicas(before_wall(scene), resolution, sampling)]
        directions, (frame, velocity) = np.random.default_rng(20180305), in_common_frame(scene)

        def replica(perturbed: Scene) -> Trajectory:
            run = self.solve_series(perturbed, sampling, order=SECOND_ORDER, unfelt=SECOND_UNFELT)
            return in_rest_frame(run, velocity, scene.drag)

        return side_by_side(replica, [_perturbed(frame, directions) for _ in range(REALISATIONS)])

    def solve_series(
        self,
        scene: Scene,
        sampling: Sampling,
        *,
        order: int = ORDER,
        accuracy: float = ACCURACY,
        unfelt: float = 1.0,
    ) -> Trajectory:
        """Return a run by Taylor series whose last coefficients contribute ``accuracy`` of speeds and overlaps.

        ``unfelt`` is a factor on the overlaps below which forces are not felt.
        """
        if scene.piston is not None:
            wall = self.solve_series(before_wall(scene), sampling, order=order, accuracy=accuracy, unfelt=unfelt)
            own = run_provenance(self, scene, wall.provenance["settings"])
            return replace(behind_piston(wall, scene), provenance={**wall.provenance, **own})
        watch = Stopwatch()
        original, (scene, frame) = scene, in_common_frame(scene)
        c, times = scene.contacts, sampling.times(scene.duration)
        speed, depth = natural_scales(scene)
        touch = unfelt * _unfelt(scene, speed, depth)
        # the usual unit, and where coefficients are beyond doubles in it one in which those of faint contacts are not
        for unit in dict.fromkeys((time_unit(scene, speed, depth), time_unit(scene, speed, depth, touch))):
            bodies, contacts, components, place = chain_tables(scene, unit, touch)
            unit_speed = speed * unit if speed > 0.0 else 1.0
            x, v, force, steps, openings, closings = interruptible(
                integrate, bodies, contacts, components, times / unit, order, accuracy, unit_speed, MOST_STEPS
            )
            if np.all(np.isfinite(v)):
                break
        else:
            raise RunBroken(
                f"reference on {scene.name}: no end after {steps} steps and {openings} openings; take backend='scipy'"
            )
        settings = {"order": order, "samples": sampling.count}
        run = Trajectory(
            time=times,
            displacement=x,
            velocity=v / unit,
            contact_force=force / unit**2,
            peak_force=c.stiffness * contacts["deepest"][place] ** (c.exponent - 1.0),
            crossing_time=contacts["crossing"][place] * unit,
            cost=Cost.since(watch, steps=steps, force_evaluations=steps * (order + 1)),
            provenance=run_provenance(self, original, settings) | {"openings": openings, "closings": closings},
        )
        return in_rest_frame(run, frame, scene.drag)


def chain_tables(
    scene: Scene, unit: float, touch: NDArray[np.float64]
) -> tuple[Table, Table, Table, NDArray[np.int64]]:
    """Return bodies, contacts and room for components, with times in ``unit`` s, and the places of the contacts.

    They are in the order of the chain, from the left wall to the right wall, whether these are there or not.
    """
    c, n = scene.contacts, scene.n_body
    bodies, contacts = np.zeros(n + 2, BODY), np.zeros(n + 1, CONTACT)
    bodies["v"][1:-1], bodies["inverse"][1:-1] = np.array(scene.velocity) * unit, 1.0 / np.array(scene.mass)
    bodies["weight"][1:-1], bodies["owner"] = scene.free_acceleration * unit**2, -1
    place = np.where(c.left < n, c.left + 1, 0)
    contacts["column"], contacts["crossing"] = -1, np.nan
    of = {
        "stiffness": c.stiffness * unit**2, "exponent": c.exponent, "touch": touch, "s": -c.gap, "shut": -c.gap > touch,
        "resting": resting_acceleration(scene) * unit**2, "deepest": np.maximum(-c.gap, 0.0),
        "column": np.arange(scene.n_contact),
    }  # fmt: skip
    for name, values in of.items():
        contacts[name][place] = values
    return bodies, contacts, np.zeros(n + 1, COMPONENT), place


def _unfelt(scene: Scene, speed: float, depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Overlap of each contact, m, ``(n_contact,)``, below which its force moves neither body by 1e-18 of ``speed``.

    The force falls with the mass of the lighter body, as far as it is lighter than what carries the energy at hand.
    """
    c, mass = scene.contacts, np.append(np.array(scene.mass), np.inf)
    carrier = 2.0 * c.stiffness * depth**c.exponent / c.exponent / speed**2 if speed > 0.0 else 0.0
    lighter = np.minimum(mass[c.left], mass[c.right])
    felt = np.divide(lighter, carrier, out=np.ones_like(lighter), where=lighter < carrier)
    touch = np.minimum(TOUCH, FORCE ** (1.0 / (c.exponent - 1.0)))
    return np.asarray(touch * depth * felt ** (1.0 / (c.exponent - 1.0)))


def time_unit(scene: Scene, speed: float, depth: NDArray[np.float64], *faint: NDArray[np.float64]) -> float:
    """Return the unit of time, s, in which coefficients of the series are numbers: a power of two, 1 if that serves.

    The series of a contact that is ``d`` deep and lasts ``t`` go in powers of ``sqrt(d)/t``. A body that is light
    enough makes that large, and so does a contact that has just reached a ``faint`` overlap while another one closes.
    """
    if speed == 0.0 or not scene.n_contact:
        return 1.0
    depths = np.concatenate([depth, np.minimum(depth, pair_overlap(scene, speed)), *faint])
    powers = np.log2(np.sqrt(depths) / speed)
    low, high = float(np.min(powers)), float(np.max(powers))
    return 1.0 if low > -_MOST_POWER and high < _MOST_POWER else 2.0 ** round(0.5 * (low + high))


def _perturbed(scene: Scene, directions: np.random.Generator) -> Scene:
    """Return the scene with each number moved by one unit in its last place, up or down."""

    def moved(value: Any) -> Any:
        if value is None:
            return None
        if isinstance(value, Wall):
            return replace(value, stiffness=moved(value.stiffness), gap=moved(value.gap))
        numbers = np.array(value, dtype=np.float64)
        # what is exactly 0 stays: a body at rest is at rest
        moving = numbers != 0.0
        ends = directions.choice((-math.inf, math.inf), int(np.sum(moving)))
        numbers[moving] = np.nextafter(numbers[moving], ends)
        return tuple(numbers.tolist()) if isinstance(value, tuple) else numbers.item()

    names = ("mass", "velocity", "stiffness", "gap", "gravity", "precompression", "wall_left", "wall_right")
    return replace(scene, **{name: moved(getattr(scene, name)) for name in names})
