"""The physical problem: bodies, contacts, walls, start velocities and duration, without any numerical settings.

All quantities are in SI. A Scene is checked when it is created and cannot change afterwards, so its users need no
further checks. Contact k joins body k and k+1; body 0 is the struck end; positive is away from it.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import (
    LARGEST,
    MOST_BODIES,
    SMALLEST,
    Numbers,
    check_fields,
    checked_numbers,
    is_within,
)
from dem_bridge.physics.contact_law import ContactLaw, Law, completed, reach_of, stored
from dem_bridge.physics.statics import static_forces, static_overlap
from dem_bridge.scene.adhesion import ADHESION_LAWS as ADHESION_LAWS
from dem_bridge.scene.adhesion import Adhesion as Adhesion
from dem_bridge.scene.adhesion import checked_adhesion, refuse_beside_adhesion
from dem_bridge.scene.contacts import Contacts, Floats
from dem_bridge.scene.damping import BY_RESTITUTION as BY_RESTITUTION
from dem_bridge.scene.damping import DAMPING_LAWS as DAMPING_LAWS
from dem_bridge.scene.damping import DASHPOTS as DASHPOTS
from dem_bridge.scene.damping import Damping as Damping
from dem_bridge.scene.damping import checked_damping, damping_factors
from dem_bridge.scene.drive import KEYS, Drive
from dem_bridge.scene.features import FEATURES, Feature
from dem_bridge.scene.geometry import Geometry
from dem_bridge.scene.piston import PISTON_KEYS, Piston, check_place

#: contact laws are checked up to this multiple of the scene's energy, because time stepping can add energy
ENERGY_MARGIN = 1.05
_POSITIVE, _NOT_NEGATIVE = {"above": 0.0}, {"at_least": 0.0}
#: fields of a Scene that hold numbers, in addition to the masses, and of a Wall
_NUMBERS = {
    "exponent": Numbers("n > 1, one number or one per contact (2.5 for Hertz)", {"above": 1.0}, "contact"),
    "velocity": Numbers("a finite number (m/s)", per="body"),
    "stiffness": Numbers("a number > 0 (N/m^(n-1))", _POSITIVE, "contact"),
    "gap": Numbers("a finite number (m)", per="contact"),
    "duration": Numbers("a number > 0 (s)", _POSITIVE),
    "gravity": Numbers("a finite number (m/s^2)"),
    "precompression": Numbers("a number >= 0 (N)", _NOT_NEGATIVE),
    "drag": Numbers("a number >= 0 (1/s)", _NOT_NEGATIVE),
    "spacing": Numbers("a number > 0 (m)", _POSITIVE),
}
_WALL = {
    "stiffness": Numbers("a number > 0", _POSITIVE),
    "gap": Numbers("a finite number (m)"),
    "exponent": Numbers("n > 1 (2.5 for Hertz)", {"above": 1.0}),
}
_LAW = (
    "a ContactLaw, or its force (N) as array function of the overlap (m); finite, >= 0, never falling, 0 at touch, up"
    " to the largest overlap that the energy of the scene allows"
)


@dataclass(frozen=True, kw_only=True)
class Wall:
    """A body at rest with infinite mass at a distance from the end body.

    ``gap`` is the distance, m; a negative gap is an initial overlap.
    """

    stiffness: float
    gap: float = 0.0
    exponent: float | None = None
    """Exponent n; None means that of the first contact of the chain."""


#: fields of a Scene that are objects or None
_PARTS = {
    "wall_left": (Wall,),
    "wall_right": (Wall,),
    "damping": (Damping,),
    "adhesion": (Adhesion,),
    "drive": (Drive, Piston),
    "geometry": (Geometry,),
}


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A one-dimensional chain of contacts.

    ``mass`` (kg) and ``velocity`` (m/s) have one entry per body; ``stiffness`` (N/m^(n-1)), ``exponent`` (n of the
    force overlap^(n-1)) and ``gap`` (m; negative = initial overlap) have one per contact of the chain; a single
    exponent or gap holds for all. ``gravity`` (m/s^2) is positive towards the last body. ``spacing`` (m) is the
    distance between the centres of neighbouring bodies, which a wave speed in m/s requires; scenes with a geometry have
    it.

    ``precompression`` (N) above 0 starts the chain in equilibrium under this force, which is exerted by its walls or,
    at an end without a wall, by a constant load on the end body (see :attr:`load`). A wall in the direction of gravity
    carries the weight as well; without such a wall the chain falls freely. The gaps must be 0; they become minus the
    static overlaps. With a precompression of 0 no contact is compressed initially, not even by the weight. ``damping``
    and ``adhesion``: see :class:`Damping` and :class:`Adhesion`. Adhesive contacts that touch at the start must close.
    ``drag`` b (1/s) is a force ``-b m v`` on each body. ``drive`` is a time-dependent force on body 0, a
    :class:`~dem_bridge.scene.drive.Drive`, or its prescribed velocity, a :class:`~dem_bridge.scene.piston.Piston`; then
    the start velocity of body 0 is 0 or that of the piston, which it becomes.

    ``law`` is for forces that are not a power of the overlap: a :class:`.ContactLaw`, or its
    force (N) alone as array function of the overlap (m), one for all or one per contact, walls included. The force must
    not decrease with the overlap. If its slope jumps, a ContactLaw with the ``kinks`` is required (``law_of`` computes
    the energy of a force). ``stiffness`` and ``exponent`` then describe only a power law of similar strength. A law
    cannot be combined with precompression or with damping other than dashpots, whose formulas hold for powers. Scene
    files cannot contain functions, so a law is available in Python only.

    Raises
    ------
    SceneError
        If an entry is invalid.

    Examples
    --------
    >>> scene = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> scene.n_body, scene.n_contact, scene.exponent, scene.gap
    (2, 1, (2.5,), (0.0,))
    >>> from dataclasses import replace
    >>> pressed = replace(scene, precompression=32.0)
    >>> pressed.contacts.gap, pressed.load
    (array([-4.e-06]), array([ 32., -32.]))
    >>> glued = replace(scene, law=lambda overlap: 4e9 * overlap**1.5 + 2e6 * overlap)
    >>> import dem_bridge as db
    >>> [round(float(db.solve(pair, backend="scipy").peak_force[0])) for pair in (scene, glued)]
    [236, 244]
    """

    name: str
    duration: float
    mass: tuple[float, ...]
    stiffness: tuple[float, ...]
    velocity: tuple[float, ...]
    exponent: tuple[float, ...] | float = 2.5
    gap: tuple[float, ...] | float = 0.0
    wall_left: Wall | None = None
    wall_right: Wall | None = None
    gravity: float = 0.0
    precompression: float = 0.0
    damping: Damping | None = None
    adhesion: Adhesion | None = None
    drag: float = 0.0
    drive: Drive | Piston | None = None
    law: Law | tuple[Law, ...] | None = None
    samples: int = 500
    spacing: float | None = None
    description: str = ""
    geometry: Geometry | None = field(default=None, compare=False, repr=False)
    """Shapes and materials of the bodies, if they are known; the motion does not depend on them."""
    content_hash: str = field(init=False, compare=False)
    """sha256 of everything that determines the motion and its samples, without name, description and geometry."""
    _static_overlap: tuple[float, ...] = field(init=False, default=(), compare=False, repr=False)
    """Static overlap of each contact, m; empty without precompression."""
    _reach: tuple[float, ...] = field(init=False, default=(), compare=False, repr=False)
    """Largest overlap of each distinct law, m."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", self.name):
            raise SceneError("name", value=self.name, allowed="1 to 100 of A-Z a-z 0-9 . _ -, a letter or digit first")
        if not isinstance(self.description, str) or not self.description.isprintable():
            raise SceneError("description", value=self.description, allowed="one line of printable text")
        mass = checked_numbers("mass", self.mass, "a number > 0 (kg)", above=0.0)
        object.__setattr__(self, "mass", mass)
        if not 1 <= len(mass) <= MOST_BODIES:
            problem = f"has {len(mass)} entries" if mass else "is empty"
            raise SceneError("mass", problem=problem, allowed=f"at least one body, and at most {MOST_BODIES}")
        check_fields(self, _NUMBERS, sizes={"body": len(mass), "contact": len(mass) - 1})
        for name, kinds in _PARTS.items():
            if not isinstance(part := getattr(self, name), (*kinds, type(None))):
                words = " or ".join(f"a {kind.__name__}" for kind in kinds)
                raise SceneError(name, value=part, allowed=f"{words} or None")
        for side in ("wall_left", "wall_right"):
            if (wall := getattr(self, side)) is None:
                continue
            wall = replace(wall, exponent=np.append(self.exponent, 2.5)[0] if wall.exponent is None else wall.exponent)
            check_fields(wall, _WALL, f"{side}.")
            object.__setattr__(self, side, wall)
        if not is_within(self.samples, whole=True, at_least=1):
            raise SceneError("samples", value=self.samples, allowed="a whole number >= 1")
        object.__setattr__(self, "samples", int(self.samples))
        if self.geometry is not None and len(self.geometry.bodies) != len(mass):
            problem = f"has {len(self.geometry.bodies)} bodies"
            raise SceneError("geometry", problem=problem, allowed=f"{len(mass)}, one per mass, or None")
        if self.damping is not None:
            damping = checked_damping(self.damping, self._joined("exponent"), adhesion=self.adhesion is not None)
            object.__setattr__(self, "damping", damping)
        self._check_drive()
        if self.adhesion is not None:
            # first, because contacts need a law that has been checked
            refuse_beside_adhesion({"precompression": self.precompression > 0.0, "law": self.law is not None})
            adhesion = checked_adhesion(self.adhesion, self.contacts, self.velocity)
            object.__setattr__(self, "adhesion", adhesion)
        object.__setattr__(self, "law", self._checked_law())
        object.__setattr__(self, "_static_overlap", self._checked_statics())
        object.__setattr__(self, "_reach", self._checked_reach())
        self.__dict__.pop("contacts", None)  # computed above without static overlaps and laws
        object.__setattr__(self, "content_hash", self._hash())

    def _check_drive(self) -> None:
        """Raise SceneError unless the drive lasts as long as the scene; give body 0 the start velocity of a piston."""
        # the last value may lie at the end of the run, up to two roundings
        if (drive := self.drive) is not None and drive.end < self.duration * (1.0 - 1e-9):
            problem = f"ends at {drive.end:.9g} s ({drive.words})"
            allowed = f"values up to the duration, {self.duration:.9g} s"
            raise SceneError("drive.velocity" if self.piston else "drive.force", problem=problem, allowed=allowed)
        if self.piston is not None:
            walls = (self.wall_left is not None, self.wall_right is not None)
            check_place(self.n_body, walls, powers=self.law is None)
            object.__setattr__(self, "velocity", (self.piston.start(self.velocity[0]), *self.velocity[1:]))

    def _checked_statics(self) -> tuple[float, ...]:
        """Return the static overlaps of a precompressed chain, m, or an empty tuple."""
        if self.precompression == 0.0:
            return ()
        c = self.contacts
        if np.any(c.gap != 0.0):
            problem = f"= {self.precompression!r}, but contact {int(np.flatnonzero(c.gap)[0])} has a gap"
            allowed = "gaps of 0, since the initial overlaps of a precompressed chain follow from the force"
            raise SceneError("precompression", problem=problem, allowed=allowed)
        forces = self._static_forces
        # each contact carries the force in front of the body on its right; the right wall's carries the last force
        carried = [forces[right] for right in c.right.tolist()]
        contacts = zip(carried, c.stiffness.tolist(), c.exponent.tolist(), strict=True)
        overlaps = [static_overlap(force, beta, n) for force, beta, n in contacts]
        for k, overlap in enumerate(overlaps):
            if not SMALLEST < overlap < LARGEST:
                problem = f"= {self.precompression!r} gives contact {k} an overlap of {overlap:g} m"
                raise SceneError("precompression", problem=problem, allowed=f"{SMALLEST:g} to {LARGEST:g} m")
        return tuple(overlaps)

    def _checked_law(self) -> tuple[Law, ...] | None:
        """Return one law per contact, or None."""
        laws = self.law
        if laws is None:
            return None
        if isinstance(laws, ContactLaw) or callable(laws):
            laws = (laws,) * self.n_contact
        if isinstance(laws, str) or not isinstance(laws, Sequence):
            raise SceneError("law", value=laws, allowed=f"{_LAW}; or a list of these, or None")
        if len(laws) != self.n_contact:
            allowed = f"{self.n_contact}, one per contact, walls included"
            raise SceneError("law", problem=f"has {len(laws)} entries", allowed=allowed)
        for k, law in enumerate(laws):
            if not (isinstance(law, ContactLaw) or callable(law)):
                raise SceneError(f"law[{k}]", value=law, allowed=_LAW)
        if self.precompression > 0.0:
            problem = f"= {self.precompression!r}, but contacts have laws"
            allowed = "0, since static overlaps are computed for powers only"
            raise SceneError("precompression", problem=problem, allowed=allowed)
        if self.damping is not None and self.damping.law not in DASHPOTS:
            problem = f"= {self.damping.law!r}, but contacts have laws"
            allowed = f"{' or '.join(DASHPOTS)}; the others are defined for powers only"
            raise SceneError("damping.law", problem=problem, allowed=allowed)
        return tuple(laws) or None

    @property
    def _distinct_laws(self) -> tuple[tuple[Law, ...], tuple[int, ...]]:
        """Laws that are different objects, and for each contact the index of its law among them."""
        assert self.law is None or isinstance(self.law, tuple)  # set in __post_init__
        number: dict[int, int] = {}
        where = tuple(number.setdefault(id(law), len(number)) for law in self.law or ())
        return tuple((self.law or ())[where.index(nth)] for nth in range(len(number))), where

    def _checked_reach(self) -> tuple[float, ...]:
        """Return the overlap of each distinct law that the energy of the scene cannot exceed, m.

        The laws are checked up to this overlap.
        """
        distinct, where = self._distinct_laws
        if not distinct:
            return ()
        c, mass, v = self.contacts, np.array(self.mass), np.array(self.velocity)
        # as the piston sees it, for which it is a wall whose acceleration is a weight
        mass, v = (mass, v) if self.piston is None else (mass[1:], v[1:] - v[0])
        at, energy = 0, 0.5 * float(np.sum(mass * v**2))
        try:
            for k, nth in enumerate(where):
                at, energy = k, energy + stored(distinct[nth], max(-float(c.gap[k]), 0.0))
            # power of the weight: at most g sqrt(2 M energy); of a drive: at most peak sqrt(2 energy / m)
            gained = abs(self.gravity) * self.duration
            gained += 0.0 if self.piston is None else self.piston.variation(self.duration)
            drawn, push = gained * math.sqrt(0.5 * float(np.sum(mass))), self.driving_force
            drawn += 0.0 if push is None else push.peak * self.duration * math.sqrt(0.5 / self.mass[0])
            energy = (math.sqrt(energy) + drawn) ** 2
            reach = []
            for nth, law in enumerate(distinct):
                at = where.index(nth)
                beta, n = float(c.stiffness[at]), float(c.exponent[at])
                near = (n * energy / beta) ** (1.0 / n) or 1e-6  # a scene at rest has no scale
                reach.append(reach_of(law, ENERGY_MARGIN * energy, near=near))
        except ValueError as error:
            raise SceneError(f"law[{at}]", problem=str(error), allowed=_LAW) from None
        return tuple(reach)

    @cached_property
    def _static_forces(self) -> tuple[float, ...]:
        """Static forces from the left end to the right, N, ``(n_body + 1,)``."""
        return static_forces(
            self.mass,
            force=self.precompression,
            gravity=self.gravity,
            wall_left=self.wall_left is not None,
            wall_right=self.wall_right is not None,
        )

    def __str__(self) -> str:
        """Return ten lines: bodies, contacts, physics and duration."""
        from dem_bridge.foundation.notebook import scene_text  # not needed for a run

        return scene_text(self)

    def _repr_html_(self) -> str:
        from dem_bridge.foundation.notebook import scene_html  # only notebooks need it

        return scene_html(self)

    @property
    def n_body(self) -> int:
        """Number of bodies."""
        return len(self.mass)

    @property
    def n_contact(self) -> int:
        """Number of contacts of the chain and of the walls."""
        return len(self.stiffness) + (self.wall_left is not None) + (self.wall_right is not None)

    @property
    def piston(self) -> Piston | None:
        """The prescribed motion of body 0; None where forces move it."""
        return self.drive if isinstance(self.drive, Piston) else None

    @property
    def driving_force(self) -> Drive | None:
        """The time-dependent force on body 0; None without one."""
        return self.drive if isinstance(self.drive, Drive) else None

    @cached_property
    def mobility(self) -> Floats:
        """Acceleration of each body by a unit force, 1/kg, ``(n_body + 1,)``; 0 for a piston and, last, for walls."""
        mobility = np.append(1.0 / np.array(self.mass), 0.0)
        if self.piston is not None:
            mobility[0] = 0.0
        return mobility

    @property
    def load(self) -> Floats:
        """Constant outer force on each body in addition to its weight, N, ``(n_body,)``; it presses free ends."""
        load = np.zeros(self.n_body)
        forces = self._static_forces
        load[0] += 0.0 if self.wall_left else forces[0]
        load[-1] -= 0.0 if self.wall_right else forces[-1]
        return load

    @property
    def steady_force(self) -> Floats:
        """Weight and load of each body, N, ``(n_body,)``."""
        return np.asarray(np.array(self.mass) * self.gravity + self.load)

    @property
    def summed_outer_force(self) -> float:
        """Sum over all bodies of the largest magnitudes of weight, load and drive, N."""
        push = self.driving_force
        return float(np.sum(np.abs(self.steady_force))) + (0.0 if push is None else push.peak)

    @property
    def free_acceleration(self) -> Floats:
        """Acceleration of each body without contacts, drag and drive, m/s^2, ``(n_body,)``: gravity and load.

        It is 0 for a piston, whose motion no force changes.
        """
        return np.asarray((self.gravity + self.load / np.array(self.mass)) * (self.mobility[:-1] > 0.0))

    @property
    def damped(self) -> bool:
        """True if any contact dissipates energy."""
        return self.damping is not None and bool(np.any(self.contacts.damping > 0.0))

    @property
    def adhesive(self) -> bool:
        """True if any contact is attractive."""
        return bool(np.any(self.contacts.pull_off > 0.0))

    @cached_property
    def features(self) -> frozenset[Feature]:
        """Set of features beyond masses, power-law contacts and a struck first body."""
        return frozenset(feature for feature in FEATURES if feature.present(self))

    @property
    def dissipates(self) -> bool:
        """True if energy is dissipated in contacts or by drag."""
        return any(feature.dissipates for feature in self.features)

    @property
    def conserves_energy(self) -> bool:
        """True if the energy of bodies, contacts, weight and load is constant.

        Such a scene has no dissipation, and no drive that does work.
        """
        return not any(feature.dissipates or feature.does_work for feature in self.features)

    @property
    def conserves_momentum(self) -> bool:
        """True if the total momentum is constant. Without walls the loads on both ends cancel."""
        return not any(feature.changes_momentum for feature in self.features)

    @cached_property
    def contacts(self) -> Contacts:
        """All contacts as arrays, in the order of the columns of a Trajectory."""
        links, n_body = np.arange(len(self.stiffness)), self.n_body
        ends = [(n_body, 0)] * (self.wall_left is not None) + [(n_body - 1, n_body)] * (self.wall_right is not None)
        # numba compiles a kernel again for arrays that are not contiguous
        left, right = np.array([*zip(links, links + 1, strict=True), *ends], dtype=np.int64).reshape(-1, 2).T.copy()
        beta, n, gap = (self._joined(name) for name in ("stiffness", "exponent", "gap"))
        if self._static_overlap:
            gap = -np.array(self._static_overlap)
        damping, power = np.zeros(self.n_contact), np.zeros(self.n_contact)
        if self.damping is not None:
            mobility = np.append(1.0 / np.array(self.mass), 0.0)
            damping, power = damping_factors(self.damping, 1.0 / (mobility[left] + mobility[right]), beta, n)
        distinct, where = self._distinct_laws
        # empty until __post_init__ has computed the reach
        checked_laws = zip(distinct, self._reach, strict=True) if self._reach else ()
        return Contacts(
            left=left,
            right=right,
            stiffness=beta,
            exponent=n,
            gap=gap,
            damping=damping,
            damping_power=power,
            clip=self.adhesion is None and (self.damping is None or bool(self.damping.clip)),
            pull_off=np.zeros(self.n_contact) + (0.0 if self.adhesion is None else self.adhesion.pull_off),
            laws=tuple(completed(law, reach=reach) for law, reach in checked_laws),
            law=np.array(where, dtype=np.int64) if distinct else np.full(self.n_contact, -1),
            reach=np.array(self._reach),
        )

    def _joined(self, name: str) -> Floats:
        """Return a number of the contacts of the chain, then of the walls."""
        walls = [getattr(wall, name) for wall in (self.wall_left, self.wall_right) if wall is not None]
        return np.array([*getattr(self, name), *walls], dtype=np.float64)

    def __getstate__(self) -> dict[str, object]:
        """Return the state without what is derived from it, which is not sent to other processes."""
        return {key: value for key, value in self.__dict__.items() if key in self.__dataclass_fields__}

    def _hash(self) -> str:
        numbers = ("duration", "mass", "stiffness", "exponent", "gap", "velocity")
        parts: list[object] = [getattr(self, name) for name in numbers]
        for wall in (self.wall_left, self.wall_right):
            parts.append(None if wall is None else (wall.stiffness, wall.gap, wall.exponent))
        parts += [self.gravity, self.samples]
        # physics that a scene does not have adds nothing, so that hashes stay the same when the package gains features
        if self.precompression > 0.0:
            parts.append(("precompression", self.precompression))
        if self.damping is not None and self.damped:
            unclipped = () if self.damping.clip else ("not clipped",)
            parts.append(("damping", self.damping.law, self.damping.coefficient, *unclipped))
        if self.adhesive and self.adhesion is not None:
            parts.append(("adhesion", self.adhesion.law, self.adhesion.pull_off))
        if self.drag > 0.0:
            parts.append(("drag", self.drag))
        if (push := self.driving_force) is not None:
            values = (getattr(push, key) for key in KEYS[push.shape])
            parts.append(("drive", push.shape, push.force, *values))
        if (piston := self.piston) is not None:
            values = (getattr(piston, key) for key in PISTON_KEYS[piston.shape])
            parts.append(("piston", piston.shape, piston.velocity, *values))
        if self._reach:
            parts.append(("law", self.contacts.law.tolist(), *self._law_values()))
        return hashlib.sha256(repr(parts).encode()).hexdigest()

    def _law_values(self) -> Iterator[object]:
        """Yield the values that identify the laws: forces at three overlaps per octave, down to 1e-6 of the deepest.

        They have 12 digits, because the last ones of a power or a sine depend on the library.
        """
        for law, reach in zip(self.contacts.laws, self._reach, strict=True):
            force = law.force(reach * 2.0 ** (-np.arange(61) / 3.0))
            yield reach, law.kinks, [f"{value:.12g}" for value in force.tolist()]
