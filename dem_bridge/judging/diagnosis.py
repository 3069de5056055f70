"""The diagnosis of files: a cause of their errors, what it rests on, and what explains the files as well."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from dem_bridge.judging.fitting import Stepping
from dem_bridge.judging.step import StepError

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
    "start-velocity",
    "start-position",
    "sign",
    "wrong-scene",
)


#: which of several causes that fit equally well is named; where nothing collides, it is a missed contact
PRIORITY = (
    *("none", "missed-contact", "units", "order-of-bodies", "sign", "sampling-shift", "half-step-velocity"),
    *("first-order-integrator", "clip", "tension", "gravity", "missing-sqrt-radius", "modulus", "stiffness-scale"),
    *("stiffness", "mass", "exponent", "damping", "start-velocity", "time-shift", "start-position", "time-scale"),
)


@dataclass(frozen=True)
class Fault:
    """One of two faults at once: its cause, its body or contact, and a sentence with the fitted value."""

    cause: str
    where: str
    sentence: str


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
    step : StepError, optional
        Error of the time step of the code, if step and method are known.
    """

    cause: str
    evidence: str
    alternatives: tuple[str, ...] = ()
    where: str = ""
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    step: StepError | None = None
    faults: tuple[Fault, ...] = ()
    """Both faults, the larger one first, where two at once explain the files."""
    sentences: tuple[str, ...] = ()
    """What explains the files as well, with numbers: "or: all masses are 0.971 +- 2e-9 of the scene's (mass)"."""
    stepping: Stepping | None = None
    """Method and step of the code, where a cause was fitted with them."""
    headline: str = ""
    """What is known of an unknown cause, in a sentence for the first line."""
    needed: str = ""
    """Which files would tell the cause from the alternatives, in a sentence; empty if none would."""
