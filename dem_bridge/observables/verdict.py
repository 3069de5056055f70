"""Verdicts: one outcome of a closed set from a difference, its uncertainties and a tolerance.

Policy and nothing else: no numbers are computed here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dem_bridge.observables.differences import Difference


class Outcome(StrEnum):
    """The closed set. Numerical verdicts are PASS, FAIL or UNDECIDED; the others say why there is none."""

    PASS = "PASS"
    FAIL = "FAIL"
    UNDECIDED = "UNDECIDED"
    """An uncertainty straddles the tolerance, or the tolerance is itself an uncertainty of 100 % or more."""
    MODEL_DIFFERENCE = "MODEL_DIFFERENCE"
    """Other equations: a number, never pass or fail."""
    NOT_RUN = "NOT_RUN"
    BROKEN = "BROKEN"


def plain(value: object) -> object:
    """Return a value as JSON has it: a number that is not finite becomes null.

    >>> plain(1e-9), plain(math.inf), plain("velocity")
    (1e-09, None, 'velocity')
    """
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One line of a report. ``difference``, bars and ``tolerance`` are relative to ``scale`` (in ``unit``)."""

    scene: str
    quantity: str
    backend: str
    reference: str
    outcome: Outcome
    sentence: str
    difference: float = math.nan
    scale: float = math.nan
    unit: str = ""
    scale_name: str = ""
    uncertainty: float = math.nan
    reference_uncertainty: float = math.nan
    tolerance: float = math.nan
    first_divergence: tuple[float, int] | None = None
    """(time in s, body) where velocities first differ by more than the tolerance."""
    meaning: str = ""
    """What the difference consists of: round-off, time step, model, ..."""
    known_defect: str = ""
    """Names of the known defects of the LAMMPS release that explain a failure; '' if there is none."""

    @classmethod
    def of(cls, compared: Difference, **fields: Any) -> Verdict:
        """Return the verdict on a difference, which gives value, scale and uncertainties where ``fields`` do not."""
        shared = ("quantity", "scale", "unit", "scale_name", "uncertainty", "reference_uncertainty")
        return cls(difference=compared.value, **{name: getattr(compared, name) for name in shared} | fields)

    def __str__(self) -> str:
        """Return outcome and sentence."""
        return f"{self.outcome.value}: {self.sentence}"

    def as_json(self) -> dict[str, Any]:
        """JSON-able, see :func:`plain`; ``known_defect`` is left out where it is empty."""
        return {key: plain(value) for key, value in asdict(self).items() if key != "known_defect" or value}


def judge(difference: float, bar: float, tolerance: float) -> Outcome:
    """PASS or FAIL where the bar leaves no doubt, UNDECIDED where it straddles the tolerance.

    >>> [judge(1e-7, bar, 1e-6).value for bar in (0.0, 1e-5)], judge(1e-5, 1e-7, 1e-6).value
    (['PASS', 'UNDECIDED'], 'FAIL')
    >>> judge(float("nan"), 0.0, 1e-6).value
    'UNDECIDED'
    """
    if difference + bar <= tolerance:
        return Outcome.PASS
    if difference - bar > tolerance:
        return Outcome.FAIL
    return Outcome.UNDECIDED


def judge_relative(difference: float, bar: float, tolerance: float) -> Outcome:
    """Judge a difference relative to the scale of its quantity: a tolerance of 100 % and more decides nothing.

    No accuracy is that large: such a tolerance is an uncertainty, and it would pass any value.

    >>> [judge_relative(0.5, 0.0, tolerance).value for tolerance in (0.9, 1.0, float("inf"))]
    ['PASS', 'UNDECIDED', 'UNDECIDED']
    """
    return judge(difference, bar, tolerance) if tolerance < 1.0 else Outcome.UNDECIDED


#: exit code of the command line, in the order in which they win
_EXIT = ((Outcome.BROKEN, 3), (Outcome.FAIL, 1), (Outcome.UNDECIDED, 4))


def exit_code(outcomes: Iterable[Outcome]) -> int:
    """3 a run broke, 1 a check failed, 4 undecided, 0 otherwise; the first of 3, 1, 4 that occurs."""
    seen = set(outcomes)
    return next((code for outcome, code in _EXIT if outcome in seen), 0)


def numerical_verdict(
    compared: Difference,
    *,
    scene: str,
    backend: str,
    reference: str,
    tolerance: float,
    meaning: str,
    first_divergence: tuple[float, int] | None = None,
) -> Verdict:
    """Return the verdict on an error against a reference.

    The uncertainty that counts is the reference's: the difference itself is known exactly.
    """
    uncertainty = compared.reference_uncertainty
    outcome = judge_relative(compared.value, uncertainty, tolerance)
    relation = {
        Outcome.PASS: "this is within the tolerance of",
        Outcome.FAIL: "this exceeds the tolerance of",
        Outcome.UNDECIDED: "this cannot be told from the tolerance of",
    }[outcome]
    if not tolerance < 1.0:
        relation = "nothing follows from it, because the tolerance is an uncertainty of 100 % or more:"
    when = f" at t = {1e3 * compared.time:.4g} ms" if math.isfinite(compared.time) else ""
    return Verdict.of(
        compared,
        scene=scene,
        backend=backend,
        reference=reference,
        outcome=outcome,
        sentence=(
            f"{compared.quantity} of {backend} differs from {reference} by {compared.value:.2e} of"
            f" {compared.scale_name} ({compared.place}{when}), +- {uncertainty:.1e}; {relation} {tolerance:.1e}."
        ),
        tolerance=tolerance,
        first_divergence=first_divergence,
        meaning=meaning,
    )
