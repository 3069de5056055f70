"""What is to be simulated, and nothing of how: bodies, contacts, walls, start velocities, duration.

SI throughout. A Scene checks itself when it is made and cannot change afterwards, so whoever holds one need
not check again. Contact k joins body k and k+1; body 0 is the struck end; positive is away from it.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dem_bridge.checked import LARGEST, SMALLEST, checked_number, checked_numbers
from dem_bridge.contacts import Contacts
from dem_bridge.drive import KEYS, Drive
from dem_bridge.errors import SceneError
from dem_bridge.geometry import Geometry
from dem_bridge.physics.law import ContactLaw, Law, completed, reach_of, stored
from dem_bridge.physics.statics import static_forces, static_overlap

#: how a contact may lose energy, and the unit of the law's coefficient
DAMPING_LAWS = {"dashpot": "N s/m", "kuwabara-kono": "s"}
#: laws of contacts are good for this much more than the energy at hand: time steps make some
ENERGY_MARGIN = 1.05
_LAW = (
    "a ContactLaw, or its force (N) as array function of the overlap (m); finite, >= 0, never falling, 0 at touch, as"
    " deep as the energy at hand can press"
)


@dataclass(frozen=True, kw_only=True)
class Wall:
    """A body at rest with infinite mass, ``gap`` metres from the end body (negative: initial overlap)."""

    stiffness: float
    gap: float = 0.0
    exponent: float | None = None
    """None: as the first contact of the chain."""


@dataclass(frozen=True, kw_only=True)
class Damping:
    """Energy lost in contacts, by a force beside the elastic one while the overlap is > 0.

    ``law``: "dashpot", ``c overlap'``, or "kuwabara-kono", ``gamma beta overlap^(n-2) overlap'`` (n >= 2; Kuwabara &
    Kono 1987, *Jpn. J. Appl. Phys.* 26, 1230, for n = 5/2). ``coefficient``: c (N s/m) or gamma (s), >= 0, one for
    all or one per contact, walls included. Elastic force and damping together never pull: their sum is clipped at 0.
    """

    law: str
    coefficient: tuple[float, ...] | float


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A one-dimensional chain of contacts.

    ``mass`` (kg) and ``velocity`` (m/s) have one entry per body; ``stiffness`` (N/m^(n-1)), ``exponent`` (n, the
    force goes as overlap^(n-1)) and ``gap`` (m; negative = initial overlap) one per contact of the chain; a single
    exponent or gap serves all. ``gravity`` (m/s^2) is positive towards the last body. ``spacing`` (m), where the
    scene has a geometry, is the distance between the centres of neighbouring bodies: a wave speed in m/s needs it.

    ``precompression`` (N) above 0 starts the chain in equilibrium: pressed with this force by its walls, or where
    there is none by a constant load on the end body (see :attr:`load`). A wall that gravity points to bears the
    weight as well; without such a wall the chain falls freely. The gaps, which must be 0, then are minus the static
    overlaps. At 0 nothing is pressed, by weight neither. ``damping``: see :class:`Damping`. ``drag`` b (1/s) is a
    force ``-b m v`` on each body. ``drive`` is a force on body 0 that goes with time: see
    :class:`~dem_bridge.drive.Drive`.

    ``law``, where the force is no power of the overlap: a :class:`~dem_bridge.physics.law.ContactLaw`, or its force (N)
    alone as array function of the overlap (m), one for all or one per contact, walls included. It must not fall with
    the overlap, and where its slope jumps it needs a ContactLaw with the ``kinks`` (``law_of`` finds the energy of a
    force). ``stiffness`` and ``exponent`` then only say what power is near it. Not with precompression or the damping
    "kuwabara-kono", whose formulas are those of powers; in Python alone, for scene files have no functions.

    Raises :class:`SceneError` for anything else.

    >>> scene = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> scene.n_body, scene.n_contact, scene.exponent, scene.gap
    (2, 1, (2.5,), (0.0,))
    >>> from dataclasses import replace
    >>> pressed = replace(scene, precompression=32.0)
    >>> pressed.contacts.gap, pressed.load
    (array([-4.e-06]), array([ 32., -32.]))
    >>> glued = replace(scene, law=lambda overlap: 4e9 * overlap**1.5 + 2e6 * overlap)
    >>> import dem_bridge as db
    >>> [round(float(db.solve(one, backend="scipy").peak_force[0])) for one in (scene, glued)]
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
    drag: float = 0.0
    drive: Drive | None = None
    law: Law | tuple[Law, ...] | None = None
    samples: int = 500
    spacing: float | None = None
    description: str = ""
    geometry: Geometry | None = field(default=None, compare=False, repr=False)
    """What the bodies are, where that is known; the motion does not depend on it."""
    content_hash: str = field(init=False, compare=False)
    """sha256 over all that decides the motion and its samples, without name, description and geometry."""
    _static_overlap: tuple[float, ...] = field(init=False, default=(), compare=False, repr=False)
    """Of every contact, m; empty without precompression."""
    _reach: tuple[float, ...] = field(init=False, default=(), compare=False, repr=False)
    """Of every distinct law, m."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", self.name):
            raise SceneError("name", found=self.name, allowed="1 to 100 of A-Z a-z 0-9 . _ -, a letter or digit first")
        if not isinstance(self.description, str) or not self.description.isprintable():
            raise SceneError("description", found=self.description, allowed="one line of printable text")
        bodies = len(checked_numbers("mass", self.mass, "a number > 0 (kg)", positive=True))
        if bodies < 1:
            raise SceneError("mass", problem="is empty", allowed="at least one body")
        links = bodies - 1
        n_above_1 = "n > 1, one number or one per contact (2.5 for Hertz)"
        exponents = checked_numbers("exponent", self.exponent, n_above_1, count=links, per="contact", above=1.0)
        checked: dict[str, object] = {
            "mass": checked_numbers("mass", self.mass, "a number > 0 (kg)", positive=True),
            "velocity": checked_numbers("velocity", self.velocity, "a finite number (m/s)", count=bodies, per="body"),
            "stiffness": checked_numbers(
                "stiffness",
                self.stiffness,
                "a number > 0 (N/m^(n-1))",
                count=links,
                per="contact",
                positive=True,
            ),
            "exponent": exponents,
            "gap": checked_numbers("gap", self.gap, "a finite number (m)", count=links, per="contact"),
            "duration": checked_number("duration", self.duration, "a number > 0 (s)", above=0.0),
            "gravity": checked_number("gravity", self.gravity, "a finite number (m/s^2)"),
            "precompression": checked_number("precompression", self.precompression, "a number >= 0 (N)", at_least=0.0),
            "drag": checked_number("drag", self.drag, "a number >= 0 (1/s)", at_least=0.0),
        }
        if self.spacing is not None:
            checked["spacing"] = checked_number("spacing", self.spacing, "a number > 0 (m)", above=0.0)
        for side in ("wall_left", "wall_right"):
            wall: Wall | None = getattr(self, side)
            if wall is not None:
                if not isinstance(wall, Wall):
                    raise SceneError(side, found=wall, allowed="a Wall or None")
                exponent = wall.exponent
                if exponent is None:
                    exponent = exponents[0] if links else 2.5
                checked[side] = Wall(
                    stiffness=checked_number(f"{side}.stiffness", wall.stiffness, "a number > 0", above=0.0),
                    gap=checked_number(f"{side}.gap", wall.gap, "a finite number (m)"),
                    exponent=checked_number(f"{side}.exponent", exponent, "n > 1 (2.5 for Hertz)", above=1.0),
                )
        if isinstance(self.samples, bool) or not isinstance(self.samples, int) or self.samples < 1:
            raise SceneError("samples", found=self.samples, allowed="a whole number >= 1")
        if self.geometry is not None:
            if not isinstance(self.geometry, Geometry):
                raise SceneError("geometry", found=self.geometry, allowed="a Geometry or None")
            if len(self.geometry.bodies) != bodies:
                problem = f"has {len(self.geometry.bodies)} bodies"
                raise SceneError("geometry", problem=problem, allowed=f"{bodies}, one per mass, or None")
        for key, value in checked.items():
            object.__setattr__(self, key, value)
        object.__setattr__(self, "damping", self._checked_damping())
        self._check_drive()
        object.__setattr__(self, "law", self._checked_law())
        object.__setattr__(self, "_static_overlap", self._checked_statics())
        object.__setattr__(self, "_reach", self._checked_reach())
        self.__dict__.pop("contacts", None)  # looked at before the static overlaps and laws were known
        object.__setattr__(self, "content_hash", self._hash())

    def _checked_damping(self) -> Damping | None:
        given = self.damping
        if given is None:
            return None
        if not isinstance(given, Damping):
            raise SceneError("damping", found=given, allowed="a Damping or None")
        if given.law not in DAMPING_LAWS:
            raise SceneError("damping.law", found=given.law, allowed=" or ".join(DAMPING_LAWS))
        allowed = f"a number >= 0 ({DAMPING_LAWS[given.law]})"
        key, per = "damping.coefficient", "contact, walls included"
        coefficient = checked_numbers(key, given.coefficient, allowed, count=self.n_contact, per=per, at_least=0.0)
        if given.law == "kuwabara-kono":
            for k, (gamma, n) in enumerate(zip(coefficient, self._all_exponents, strict=True)):
                if gamma > 0.0 and n < 2.0:
                    problem = f"has the law kuwabara-kono on contact {k}, whose exponent n is {n!r}"
                    raise SceneError("damping", problem=problem, allowed="n >= 2: below, it is infinite at touch")
        return Damping(law=given.law, coefficient=coefficient)

    def _check_drive(self) -> None:
        given = self.drive
        if given is None:
            return
        if not isinstance(given, Drive):
            raise SceneError("drive", found=given, allowed="a Drive or None")
        # the last value is due at the end, which two roundings may part
        if given.end < self.duration * (1.0 - 1e-9):
            problem = f"ends at {given.end:.9g} s: a {given.words}"
            raise SceneError(
                "drive.force", problem=problem, allowed=f"values up to the duration, {self.duration:.9g} s"
            )

    def _checked_statics(self) -> tuple[float, ...]:
        if self.precompression == 0.0:
            return ()
        c = self.contacts
        if np.any(c.gap != 0.0):
            problem = f"= {self.precompression!r}, and contact {int(np.flatnonzero(c.gap)[0])} has a gap"
            allowed = "gaps of 0: in a precompressed chain the initial overlaps follow from the force"
            raise SceneError("precompression", problem=problem, allowed=allowed)
        forces = self._static_forces
        # a contact stands in front of the body on its right; that of the right wall stands behind the last body
        carried = [forces[right] for right in c.right.tolist()]
        found = [static_overlap(*one) for one in zip(carried, c.stiffness.tolist(), c.exponent.tolist(), strict=True)]
        for k, overlap in enumerate(found):
            if not SMALLEST < overlap < LARGEST:
                problem = f"= {self.precompression!r} gives contact {k} an overlap of {overlap:g} m"
                raise SceneError("precompression", problem=problem, allowed=f"{SMALLEST:g} to {LARGEST:g} m")
        return tuple(found)

    def _checked_law(self) -> tuple[Law, ...] | None:
        given = self.law
        if given is None:
            return None
        if isinstance(given, ContactLaw) or callable(given):
            given = (given,) * self.n_contact
        if isinstance(given, str) or not isinstance(given, Sequence):
            raise SceneError("law", found=given, allowed=f"{_LAW}; or a list of these, or None")
        if len(given) != self.n_contact:
            allowed = f"{self.n_contact}, one per contact, walls included"
            raise SceneError("law", problem=f"has {len(given)} entries", allowed=allowed)
        for k, one in enumerate(given):
            if not (isinstance(one, ContactLaw) or callable(one)):
                raise SceneError(f"law[{k}]", found=one, allowed=_LAW)
        if self.precompression > 0.0:
            problem = f"= {self.precompression!r}, and contacts have laws of their own"
            raise SceneError("precompression", problem=problem, allowed="0: static overlaps are known for powers only")
        if self.damping is not None and self.damping.law != "dashpot":
            problem = f"= {self.damping.law!r}, and contacts have laws of their own"
            raise SceneError("damping.law", problem=problem, allowed="dashpot: the other is known for powers only")
        return tuple(given) or None

    @property
    def _distinct_laws(self) -> tuple[tuple[Law, ...], tuple[int, ...]]:
        """Laws that are not the same object, and the number among them of each contact's."""
        assert self.law is None or isinstance(self.law, tuple)  # set when the scene was made
        number: dict[int, int] = {}
        where = tuple(number.setdefault(id(one), len(number)) for one in self.law or ())
        return tuple((self.law or ())[where.index(nth)] for nth in range(len(number))), where

    def _checked_reach(self) -> tuple[float, ...]:
        """Overlaps that no energy at hand exceeds; SceneError for what is no law up to there."""
        distinct, where = self._distinct_laws
        if not distinct:
            return ()
        c, v = self.contacts, np.array(self.velocity)
        at, energy = 0, 0.5 * float(np.sum(np.array(self.mass) * v**2))
        try:
            for k, nth in enumerate(where):
                at, energy = k, energy + stored(distinct[nth], max(-float(c.gap[k]), 0.0))
            # the weight does work at a rate of at most g sqrt(2 M energy), a drive of peak sqrt(2 energy / m)
            drawn = abs(self.gravity) * self.duration * math.sqrt(0.5 * sum(self.mass))
            drawn += self.drive.peak * self.duration * math.sqrt(0.5 / self.mass[0]) if self.drive is not None else 0.0
            energy = (math.sqrt(energy) + drawn) ** 2
            found = []
            for nth, law in enumerate(distinct):
                at = where.index(nth)
                beta, n = float(c.stiffness[at]), float(c.exponent[at])
                near = (n * energy / beta) ** (1.0 / n) or 1e-6  # a scene at rest has no scale
                found.append(reach_of(law, ENERGY_MARGIN * energy, near=near))
        except ValueError as error:
            raise SceneError(f"law[{at}]", problem=str(error), allowed=_LAW) from None
        return tuple(found)

    @property
    def _static_forces(self) -> tuple[float, ...]:
        """From the left end to the right, N, ``(n_body + 1,)``."""
        return static_forces(
            self.mass,
            force=self.precompression,
            gravity=self.gravity,
            wall_left=self.wall_left is not None,
            wall_right=self.wall_right is not None,
        )

    def _repr_html_(self) -> str:
        from dem_bridge.notebook import scene_html  # text for notebooks alone

        return scene_html(self)

    @property
    def n_body(self) -> int:
        return len(self.mass)

    @property
    def n_contact(self) -> int:
        """Contacts of the chain and of the walls."""
        return len(self.stiffness) + (self.wall_left is not None) + (self.wall_right is not None)

    @property
    def load(self) -> NDArray[np.float64]:
        """Constant outer force on each body beside its weight, N, ``(n_body,)``: what presses an end without wall."""
        load = np.zeros(self.n_body)
        forces = self._static_forces
        load[0] += 0.0 if self.wall_left else forces[0]
        load[-1] -= 0.0 if self.wall_right else forces[-1]
        return load

    @property
    def steady_force(self) -> NDArray[np.float64]:
        """Weight and load of each body, N, ``(n_body,)``."""
        return np.asarray(np.array(self.mass) * self.gravity + self.load)

    @property
    def summed_outer_force(self) -> float:
        """Of all bodies together, N: weight, load and drive, each at its largest and whatever its direction."""
        return float(np.sum(np.abs(self.steady_force))) + (0.0 if self.drive is None else self.drive.peak)

    @property
    def free_acceleration(self) -> NDArray[np.float64]:
        """Of each body that touches nothing, m/s^2, ``(n_body,)``: gravity and load, without drag and drive."""
        return np.asarray(self.gravity + self.load / np.array(self.mass))

    @property
    def damped(self) -> bool:
        """Whether any contact loses energy."""
        return self.damping is not None and any(self._damping_coefficients)

    @property
    def dissipates(self) -> bool:
        """Whether energy is lost anywhere: in contacts or by drag."""
        return self.damped or self.drag > 0.0

    @property
    def conserves_energy(self) -> bool:
        """Whether the energy of bodies, contacts, weight and load stays: nothing is lost, and no drive does work."""
        return not self.dissipates and self.drive is None

    @property
    def conserves_momentum(self) -> bool:
        """Whether the momentum of all bodies stays. Without walls the loads on both ends cancel."""
        free = self.wall_left is None and self.wall_right is None and self.gravity == 0.0
        return free and self.drag == 0.0 and self.drive is None

    @cached_property
    def contacts(self) -> Contacts:
        """All contacts as arrays, in the order of the columns of a Trajectory."""
        links = len(self.stiffness)
        left, right = list(range(links)), list(range(1, links + 1))
        stiffness, exponent, gap = list(self.stiffness), list(self._exponents), list(self._gaps)
        for wall, ends in (
            (self.wall_left, (self.n_body, 0)),
            (self.wall_right, (self.n_body - 1, self.n_body)),
        ):
            if wall is not None:
                assert wall.exponent is not None  # set when the scene was made
                left.append(ends[0])
                right.append(ends[1])
                stiffness.append(wall.stiffness)
                exponent.append(wall.exponent)
                gap.append(wall.gap)
        if self._static_overlap:
            gap = [-overlap for overlap in self._static_overlap]
        beta, n = np.array(stiffness), np.array(exponent)
        damping, power = np.zeros(self.n_contact), np.zeros(self.n_contact)
        if self.damping is not None:
            damping = np.array(self._damping_coefficients)
            if self.damping.law == "kuwabara-kono":
                # an elastic contact has no such force, whatever its n
                damping, power = damping * beta, np.maximum(n - 2.0, 0.0)
        distinct, where = self._distinct_laws
        # not known yet while the scene is made
        known = zip(distinct, self._reach, strict=True) if self._reach else ()
        return Contacts(
            left=np.array(left, dtype=np.int64),
            right=np.array(right, dtype=np.int64),
            stiffness=beta,
            exponent=n,
            gap=np.array(gap),
            damping=damping,
            damping_power=power,
            laws=tuple(completed(law, reach=reach) for law, reach in known),
            law=np.array(where, dtype=np.int64) if distinct else np.full(self.n_contact, -1),
            reach=np.array(self._reach),
        )

    def __getstate__(self) -> dict[str, object]:
        """What is found again travels to no other process."""
        return {key: value for key, value in self.__dict__.items() if key != "contacts"}

    @property
    def _exponents(self) -> tuple[float, ...]:
        assert isinstance(self.exponent, tuple)
        return self.exponent

    @property
    def _all_exponents(self) -> tuple[float, ...]:
        """Of the chain, then of the walls."""
        walls = (wall.exponent for wall in (self.wall_left, self.wall_right) if wall is not None)
        return (*self._exponents, *(n for n in walls if n is not None))

    @property
    def _damping_coefficients(self) -> tuple[float, ...]:
        assert self.damping is not None
        assert isinstance(self.damping.coefficient, tuple)  # set when the scene was made
        return self.damping.coefficient

    @property
    def _gaps(self) -> tuple[float, ...]:
        assert isinstance(self.gap, tuple)
        return self.gap

    def _hash(self) -> str:
        parts: list[object] = [
            self.duration,
            self.mass,
            self.stiffness,
            self.exponent,
            self.gap,
            self.velocity,
        ]
        for wall in (self.wall_left, self.wall_right):
            parts.append(None if wall is None else (wall.stiffness, wall.gap, wall.exponent))
        parts += [self.gravity, self.samples]
        # what is not there leaves no trace: a scene keeps its hash when more physics become possible
        if self.precompression > 0.0:
            parts.append(("precompression", self.precompression))
        if self.damping is not None and self.damped:
            parts.append(("damping", self.damping.law, self.damping.coefficient))
        if self.drag > 0.0:
            parts.append(("drag", self.drag))
        if self.drive is not None:
            told = (getattr(self.drive, key) for key in KEYS[self.drive.shape])
            parts.append(("drive", self.drive.shape, self.drive.force, *told))
        if self._reach:
            parts.append(("law", self.contacts.law.tolist(), *self._law_values()))
        return hashlib.sha256(repr(parts).encode()).hexdigest()

    def _law_values(self) -> Iterator[object]:
        """What laws are known by: forces at three overlaps per octave, down to 1e-6 of the deepest.

        To 12 digits: the last ones of a power or a sine are those of a library.
        """
        for law, reach in zip(self.contacts.laws, self._reach, strict=True):
            force = law.force(reach * 2.0 ** (-np.arange(61) / 3.0))
            yield reach, law.kinks, [f"{value:.12g}" for value in force.tolist()]
