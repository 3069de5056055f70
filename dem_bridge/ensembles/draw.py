"""The chains of an ensemble: numbers of a scene, drawn at random around those that it has.

Chains are drawn block by block from a seed and the number of the block, so that no chain depends on how many others
there are or on who draws them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.foundation.numbers import check_number
from dem_bridge.physics.contact_law import Floats
from dem_bridge.scene.geometry import Body, Geometry
from dem_bridge.scene.scene import Scene

#: chains that are drawn and solved together
BLOCK = 512
#: what may vary: the meaning of its number, and the largest number that is allowed
VARIED: Mapping[str, tuple[str, float]] = {
    "angle": ("standard deviation of each angle between cylinders, degrees", 45.0),
    "mass": ("relative standard deviation of each mass", 0.15),
    "stiffness": ("relative standard deviation of each stiffness, walls included", 0.15),
    "velocity": ("relative standard deviation of each start velocity", 0.15),
    "gap": ("standard deviation of what is added to each gap, m; only its magnitude counts", math.inf),
}
#: ways to draw
SAMPLERS = ("random", "sobol")
#: smallest angle between neighbours, degrees: at 0 the contact is a line
LEAST_ANGLE = 0.05
#: relative error of the polynomials that stand for the stiffness of crossed cylinders, and their largest degree
_STIFFNESS_WITHIN, _MOST_DEGREE = 1e-11, 200


@dataclass(frozen=True, kw_only=True, eq=False)
class Chains:
    """Numbers of several chains, one row for each: everything else they share with a scene."""

    mass: Floats
    """kg, ``(n_chain, n_body)``."""
    velocity: Floats
    """m/s at the start, ``(n_chain, n_body)``."""
    stiffness: Floats
    """N/m^(n-1), ``(n_chain, n_contact)``, walls last."""
    gap: Floats
    """m, ``(n_chain, n_contact)``, without the overlaps of a precompression."""

    @classmethod
    def of(cls, scenes: Sequence[Scene]) -> Chains:
        """Return the chains of scenes that differ in these numbers only."""
        walled = [
            np.append(np.array(scene.gap), [getattr(scene, side).gap for side in _walls(scene)]) for scene in scenes
        ]
        return cls(
            mass=np.array([scene.mass for scene in scenes]),
            velocity=np.array([scene.velocity for scene in scenes]),
            stiffness=np.array([scene.contacts.stiffness for scene in scenes]),
            gap=np.array(walled),
        )

    def __len__(self) -> int:
        return len(self.mass)

    def rows(self, which: NDArray[np.int64]) -> Chains:
        """Return some of the chains."""
        return Chains(**{field.name: getattr(self, field.name)[which] for field in fields(self)})

    def scene(self, scene: Scene, nth: int) -> Scene:
        """Return the scene of the ``nth`` chain."""
        links = len(scene.stiffness)
        numbers: dict[str, Any] = {key: tuple(getattr(self, key)[nth].tolist()) for key in ("mass", "velocity")}
        numbers |= {key: tuple(getattr(self, key)[nth, :links].tolist()) for key in ("stiffness", "gap")}
        for place, side in enumerate(_walls(scene), start=links):
            stiffness, gap = float(self.stiffness[nth, place]), float(self.gap[nth, place])
            numbers[side] = replace(getattr(scene, side), stiffness=stiffness, gap=gap)
        return replace(scene, name=f"{scene.name}.chain-{nth}", geometry=None, spacing=None, **numbers)


def _walls(scene: Scene) -> list[str]:
    return [side for side in ("wall_left", "wall_right") if getattr(scene, side) is not None]


@dataclass(frozen=True, kw_only=True)
class Variation:
    """Variation of a scene: what varies, by how much, and how it is drawn.

    Parameters
    ----------
    scene : Scene
        The intended chain.
    vary : mapping
        Keys of :data:`VARIED`, with their numbers.
    seed : int
        Seed, from 0 on.
    sampler : {"random", "sobol"}
        Independent draws, or the scrambled Sobol' sequence (Owen 1998), which fills the space more evenly.

    Raises
    ------
    UsageError
        For another key, a number outside its range, or a sampler that does not exist.
    UnsupportedScene
        For angles of a scene that has none.
    """

    scene: Scene
    vary: Mapping[str, float]
    seed: int = 0
    sampler: str = "random"

    def __post_init__(self) -> None:
        if not isinstance(self.vary, Mapping) or not self.vary:
            raise UsageError(f"vary = {self.vary!r}; allowed: a mapping of some of {', '.join(VARIED)} to numbers")
        for key, value in self.vary.items():
            if key not in VARIED:
                raise UsageError(f"vary has the key {key!r}; allowed: {', '.join(VARIED)}")
            meaning, most = VARIED[key]
            upper = "" if most == math.inf else f" and at most {most:g}"
            allowed = f"a number >= 0{upper} ({meaning})"
            check_number(f"vary[{key!r}]", value, allowed, at_least=0.0, at_most=most)
        seed = check_number("seed", self.seed, "a whole number >= 0", whole=True, at_least=0)
        object.__setattr__(self, "seed", seed)
        if self.sampler not in SAMPLERS:
            raise UsageError(f"sampler = {self.sampler!r}; allowed: {', '.join(SAMPLERS)}")
        geometry = self.scene.geometry
        if "angle" in self.vary and (geometry is None or all(angle is None for angle in geometry.angle)):
            raise UnsupportedScene(
                f"{self.scene.name} has no contact angles that could vary; allowed: a scene in physical form with"
                " cylinders"
            )

    @cached_property
    def columns(self) -> tuple[tuple[str, int], ...]:
        """The numbers that vary: the key and the index of its angle, body or contact, one for each dimension."""
        scene, indices = self.scene, {}
        if "angle" in self.vary and scene.geometry is not None:
            indices["angle"] = [k for k, angle in enumerate(scene.geometry.angle) if angle is not None]
        indices["mass"] = list(range(scene.n_body))
        indices["stiffness"] = indices["gap"] = list(range(scene.n_contact))
        indices["velocity"] = [i for i, velocity in enumerate(scene.velocity) if velocity != 0.0]
        return tuple((key, place) for key in VARIED if key in self.vary for place in indices[key])

    def block(self, nth: int, count: int = BLOCK) -> Chains:
        """Return the first ``count`` chains of the ``nth`` block."""
        return self.chains(self._uniform(nth)[:count])

    def _uniform(self, nth: int) -> Floats:
        """Return the block's numbers between 0 and 1, ``(BLOCK, n_column)``."""
        if self.sampler == "sobol":
            from scipy.stats import qmc

            sequence = qmc.Sobol(len(self.columns), scramble=True, rng=np.random.default_rng(self.seed))
            if nth:
                sequence.fast_forward(nth * BLOCK)
            return np.asarray(sequence.random(BLOCK))
        return np.random.default_rng([self.seed, nth]).random((BLOCK, len(self.columns)))

    def chains(self, uniform: Floats) -> Chains:
        """Return the chains of numbers between 0 and 1, ``(n_chain, n_column)``: parts of normal distributions."""
        from scipy.special import ndtri

        tiny = np.finfo(float).tiny
        deviate = ndtri(np.clip(uniform, tiny, 1.0 - np.finfo(float).epsneg))
        drawn = vars(Chains.of([self.scene]).rows(np.zeros(len(deviate), np.int64)))
        for column, (key, place) in enumerate(self.columns):
            off = self.vary[key] * deviate[:, column]
            if key == "angle":
                drawn["stiffness"][:, place] *= self._stiffness_ratio(place, off)
            elif key == "gap":
                drawn[key][:, place] += np.abs(off)
            else:
                drawn[key][:, place] *= 1.0 + off
        return Chains(**drawn)

    def _stiffness_ratio(self, contact: int, off: Floats) -> Floats:
        """Return the stiffness at the contact's angle plus ``off`` (degrees) over that at its angle.

        Angles are reflected at 90 degrees and at 0.
        """
        angle = self._angle(contact)
        turned = np.abs((angle + off + 90.0) % 180.0 - 90.0)
        law = self._laws[self._law_of[contact]]
        intended = law(_place(np.array(max(angle, LEAST_ANGLE))))
        return np.asarray(np.exp(law(_place(np.maximum(turned, LEAST_ANGLE))) - intended))

    def _angle(self, contact: int) -> float:
        geometry = self.scene.geometry
        angle = None if geometry is None else geometry.angle[contact]
        assert angle is not None
        return angle

    @cached_property
    def _law_of(self) -> dict[int, tuple[Body, Body]]:
        """The bodies of each contact with an angle: contacts of equal bodies have one law."""
        geometry = self.scene.geometry
        assert geometry is not None
        return {k: (geometry.bodies[k], geometry.bodies[k + 1]) for key, k in self.columns if key == "angle"}

    @cached_property
    def _laws(self) -> dict[tuple[Body, Body], Chebyshev]:
        """The logarithm of the stiffness of crossed cylinders as a polynomial of :func:`_place`, for each two bodies.

        The law itself is that of :mod:`dem_bridge.physics.hertz`. It is even about 90 degrees in that variable and has
        no singularity near the real axis, so that the error falls geometrically with the degree.
        """
        geometry = self.scene.geometry
        assert geometry is not None
        return {pair: _fitted(pair, geometry.law) for pair in set(self._law_of.values())}


def _place(angle: Floats) -> Floats:
    """Return the variable of the polynomials of an angle (degrees): log(tan(angle/2))."""
    return np.asarray(np.log(np.tan(np.radians(0.5 * angle))))


def _fitted(bodies: tuple[Body, Body], law: Literal["paper", "exact"]) -> Chebyshev:
    """Return the polynomial of two bodies, of a degree that is exact enough between its nodes."""

    def logarithm(place: Floats) -> Floats:
        angles = np.minimum(np.degrees(2.0 * np.arctan(np.exp(place))), 90.0)
        pairs = (Geometry(bodies=bodies, law=law, angles=(angle,)) for angle in angles.tolist())
        return np.array([math.log(pair.contact(0, law).stiffness) for pair in pairs])

    least = float(_place(np.array(LEAST_ANGLE)))
    degree = 12
    while True:
        polynomial = Chebyshev.interpolate(logarithm, degree, domain=[least, 0.0])
        between = np.linspace(least, 0.0, 2 * degree + 5)
        if degree >= _MOST_DEGREE or np.max(np.abs(polynomial(between) - logarithm(between))) < _STIFFNESS_WITHIN:
            return polynomial
        degree = 2 * degree
