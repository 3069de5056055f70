"""The likely cause of the difference between a file and its scene: hypotheses are fitted, compared and named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dem_bridge.scene import Scene

Floats = NDArray[np.float64]

#: all causes that a diagnosis can name
CAUSES = (
    "none",
    "unknown",
    "half-step-velocity",
    "first-order-integrator",
    "exponent",
    "missing-sqrt-radius",
    "modulus",
    "mass",
    "stiffness",
    "stiffness-scale",
    "damping",
    "clip",
    "time-shift",
    "time-scale",
    "units",
    "order-of-bodies",
    "gravity",
    "tension",
    "missed-contact",
    "single-precision",
    "sampling-shift",
)


class Record(Protocol):
    """What a file holds, in SI: see :class:`dem_bridge.readers.Record`."""

    @property
    def name(self) -> str:
        """The file as it was named."""

    @property
    def time(self) -> Floats:
        """Times, s, increasing."""

    @property
    def values(self) -> Mapping[str, Floats]:
        """Samples of each quantity, ``(n_t, n_columns)``."""

    @property
    def columns(self) -> Mapping[str, tuple[int, ...]]:
        """Body or contact of each column."""

    @property
    def rounding(self) -> Mapping[str, Floats]:
        """Largest rounding error of each value, and of each "time"."""

    @property
    def dt(self) -> float | None:
        """Time step of the code, s, if it is known."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The likely cause of the difference between files and their scene.

    Parameters
    ----------
    cause : str
        One of :data:`CAUSES`. "none": the time step and the digits of the files explain the difference; "unknown": no
        hypothesis explains it, or it is below 50 floors.
    alternatives : tuple of str
        Causes that the data cannot tell from ``cause``.
    where : str
        Body or contact of the cause, "body 3" or "contact 7"; empty if it concerns the whole chain.
    evidence : str
        One sentence with the fitted value and the residuals.
    parameters : mapping
        Fitted parameters of the cause, each with its standard deviation.
    """

    cause: str
    evidence: str
    alternatives: tuple[str, ...] = ()
    where: str = ""
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def diagnose(scene: Scene, records: Sequence[Record], floor: Mapping[str, float] | None = None) -> Diagnosis:
    """Return the likely cause of the difference between the ``records`` and the exact motion of their ``scene``.

    ``floor`` is the round-off floor of each quantity in its unit, in addition to the digits of the files.
    """
    return Diagnosis(cause="unknown", evidence="No hypothesis has been tested.")
