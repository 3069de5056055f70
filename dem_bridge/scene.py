"""What is to be simulated, and nothing of how: bodies, contacts, walls, start velocities, duration.

SI throughout. A Scene checks itself when it is made and cannot change afterwards, so whoever holds one need
not check again. Contact k joins body k and k+1; body 0 is the struck end; positive is away from it.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import SceneError

#: magnitudes between which products and powers of inputs stay within double precision
SMALLEST, LARGEST = 1e-40, 1e40


@dataclass(frozen=True, kw_only=True)
class Wall:
    """A body at rest with infinite mass, ``gap`` metres from the end body (negative: initial overlap)."""

    stiffness: float
    gap: float = 0.0
    exponent: float | None = None
    """None: as the first contact of the chain."""


@dataclass(frozen=True, kw_only=True)
class Contacts:
    """Every contact of a scene as arrays ``(n_contact,)``: the chain's in order, then wall_left, wall_right.

    ``overlap_k = x[left_k] - x[right_k] - gap_k``; the index ``n_body`` stands for a wall, with x = v = 0.
    """

    left: NDArray[np.int64]
    right: NDArray[np.int64]
    stiffness: NDArray[np.float64]
    exponent: NDArray[np.float64]
    gap: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A one-dimensional chain of contacts.

    ``mass`` (kg) and ``velocity`` (m/s) have one entry per body; ``stiffness`` (N/m^(n-1)), ``exponent`` (n, the
    force goes as overlap^(n-1)) and ``gap`` (m; negative = initial overlap) one per contact of the chain; a single
    exponent or gap serves all. ``gravity`` (m/s^2) is positive towards the last body. ``spacing`` (m), where the
    scene has a geometry, is the distance between the centres of neighbouring bodies: a wave speed in m/s needs it.
    Raises :class:`SceneError` for anything else.

    >>> scene = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> scene.n_body, scene.n_contact, scene.exponent, scene.gap
    (2, 1, (2.5,), (0.0,))
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
    samples: int = 500
    spacing: float | None = None
    description: str = ""
    content_hash: str = field(init=False, compare=False)
    """sha256 over all that decides the motion and its samples, without name and description."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", self.name):
            raise SceneError("name", found=self.name, allowed="1 to 100 of A-Z a-z 0-9 . _ -, a letter or digit first")
        if not isinstance(self.description, str) or not self.description.isprintable():
            raise SceneError("description", found=self.description, allowed="one line of printable text")
        bodies = len(_numbers("mass", self.mass, "a number > 0 (kg)", positive=True))
        if bodies < 1:
            raise SceneError("mass", problem="is empty", allowed="at least one body")
        links = bodies - 1
        n_above_1 = "n > 1, one number or one per contact (2.5 for Hertz)"
        exponents = _numbers("exponent", self.exponent, n_above_1, count=links, per="contact", above=1.0)
        checked: dict[str, object] = {
            "mass": _numbers("mass", self.mass, "a number > 0 (kg)", positive=True),
            "velocity": _numbers("velocity", self.velocity, "a finite number (m/s)", count=bodies, per="body"),
            "stiffness": _numbers(
                "stiffness",
                self.stiffness,
                "a number > 0 (N/m^(n-1))",
                count=links,
                per="contact",
                positive=True,
            ),
            "exponent": exponents,
            "gap": _numbers("gap", self.gap, "a finite number (m)", count=links, per="contact"),
            "duration": _number("duration", self.duration, "a number > 0 (s)", above=0.0),
            "gravity": _number("gravity", self.gravity, "a finite number (m/s^2)"),
        }
        if self.spacing is not None:
            checked["spacing"] = _number("spacing", self.spacing, "a number > 0 (m)", above=0.0)
        for side in ("wall_left", "wall_right"):
            wall: Wall | None = getattr(self, side)
            if wall is not None:
                if not isinstance(wall, Wall):
                    raise SceneError(side, found=wall, allowed="a Wall or None")
                exponent = wall.exponent
                if exponent is None:
                    exponent = exponents[0] if links else 2.5
                checked[side] = Wall(
                    stiffness=_number(f"{side}.stiffness", wall.stiffness, "a number > 0", above=0.0),
                    gap=_number(f"{side}.gap", wall.gap, "a finite number (m)"),
                    exponent=_number(f"{side}.exponent", exponent, "n > 1 (2.5 for Hertz)", above=1.0),
                )
        if isinstance(self.samples, bool) or not isinstance(self.samples, int) or self.samples < 1:
            raise SceneError("samples", found=self.samples, allowed="a whole number >= 1")
        for key, value in checked.items():
            object.__setattr__(self, key, value)
        object.__setattr__(self, "content_hash", self._hash())

    @property
    def n_body(self) -> int:
        return len(self.mass)

    @property
    def n_contact(self) -> int:
        """Contacts of the chain and of the walls."""
        return len(self.stiffness) + (self.wall_left is not None) + (self.wall_right is not None)

    @property
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
        return Contacts(
            left=np.array(left, dtype=np.int64),
            right=np.array(right, dtype=np.int64),
            stiffness=np.array(stiffness),
            exponent=np.array(exponent),
            gap=np.array(gap),
        )

    @property
    def _exponents(self) -> tuple[float, ...]:
        assert isinstance(self.exponent, tuple)
        return self.exponent

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
        return hashlib.sha256(repr(parts).encode()).hexdigest()


def _number(key: str, value: object, allowed: str, *, above: float | None = None) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise SceneError(key, found=value, allowed=allowed)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number) or (above is not None and not number > above):
        raise SceneError(key, found=number, allowed=allowed)
    # speeds and gaps may be next to nothing, as ahead of a wave front; masses and stiffnesses may not
    if abs(number) > LARGEST or (above is not None and number < SMALLEST):
        raise SceneError(key, found=number, allowed=f"{allowed} of magnitude {SMALLEST:g} to {LARGEST:g}")
    return number


def _numbers(
    key: str,
    values: Sequence[float] | float,
    allowed: str,
    *,
    count: int | None = None,
    per: str = "",
    positive: bool = False,
    above: float | None = None,
) -> tuple[float, ...]:
    """Checked floats; a single number stands for ``count`` equal ones."""
    above = 0.0 if positive else above
    if isinstance(values, int | float | np.number):
        if count is None:
            raise SceneError(key, found=values, allowed=f"a list; each entry {allowed}")
        return (_number(key, values, allowed, above=above),) * count
    if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray) or np.ndim(values) == 0:
        raise SceneError(key, found=values, allowed=f"a list; each entry {allowed}")
    if count is not None and len(values) != count:
        raise SceneError(key, problem=f"has {len(values)} entries", allowed=f"{count}, one per {per}")
    return tuple(_number(f"{key}[{i}]", value, allowed, above=above) for i, value in enumerate(values))
