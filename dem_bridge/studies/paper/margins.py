"""Margins of the claims: over which limits, and in which windows, the outcome of a claim stays.

An outcome that hangs on a limit of ours says little where another limit, within reason, gives the other outcome. Each
criterion therefore stands here once more as a quantity with its limit, read in our window and in others. The limit at
which the outcome changes is the value of the quantity in our window.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Claim, Margin
from dem_bridge.report.texts import fill
from dem_bridge.studies.paper.claims import by
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.studies.paper.texts import CLAIMS

#: another limit is within reason if it is at most this factor from ours
WITHIN_REASON, WITHIN_A_QUARTER = 1.25, "a limit changed by a factor of up to 1.25"
Read = Callable[[Runs], float]


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """Define a criterion as a quantity with a limit, and the quantity in each window, ours first."""

    quantity: str
    limit: float
    readings: Mapping[str, Read]
    least: bool = False
    """True where the claim holds if the quantity is at least the limit; False: at most."""
    form: str = ".3g %"
    reason: tuple[float, float] = (1.0 / WITHIN_REASON, WITHIN_REASON)
    """Factors on our limit within which another one is reasonable."""

    def holds(self, value: float, factor: float = 1.0) -> bool:
        """Return whether the claim holds for a value of the quantity, at a limit ``factor`` times ours."""
        limit = factor * self.limit
        return value >= limit if self.least else value <= limit

    def margin(self, runs: Runs) -> Margin:
        """Return the margin with its sentence."""
        (window, value), *windows = [(name, read(runs)) for name, read in self.readings.items()]
        known = [(name, other) for name, other in windows if math.isfinite(other)]
        outcome = self.holds(value)
        by_limit = any(self.holds(value, factor) != outcome for factor in self.reason)
        by_window = [name for name, other in known if self.holds(other) != outcome]
        side = "up to" if outcome == self.least else "from"
        sentence = (
            f"{self.quantity}: the outcome stays for limits {side} {self._text(value)} (ours: {self._text(self.limit)})"
        )
        if known:
            sentence += "; " + ", ".join(f"{name}: {self._text(other)}" for name, other in known)
        changes = [*([WITHIN_A_QUARTER] if by_limit else []), *by_window]
        return Margin(
            sentence=f"{sentence}.",
            changes="; ".join(changes),
            quantity=self.quantity,
            limit=self.limit,
            changes_at=value,
            window=window,
            windows=tuple(known),
        )

    def _text(self, value: float) -> str:
        return fill(f"{{value:{self.form}}}", value=value)


def with_margins(claims: Iterable[Claim], runs: Runs, criteria: Mapping[str, Criterion]) -> Iterator[Claim]:
    """Yield the claims with their margins; a claim whose runs are missing has none.

    ``criteria`` by the id of their claim. Printed numbers have that of their last digit, and claims without a number
    that could be limited have a sentence among their texts.
    """
    for claim in claims:
        criterion = criteria.get(claim.id) or _of_print(claim)
        if claim.outcome is Outcome.NOT_RUN or criterion is None:
            yield claim
        else:
            margin = criterion.margin(runs)
            changes = "; ".join(filter(None, [margin.changes, CLAIMS[claim.id].get("changes", "")]))
            yield replace(claim, margin=replace(margin, changes=changes))


def _of_print(claim: Claim) -> Criterion | None:
    """Return the criterion of a printed number: a formula's value is within half of its last digit; else None."""
    if not CLAIMS[claim.id].get("printed", {}).get("last_digit"):
        return None
    paper, formula = by(claim.values, "paper"), by(claim.values, "formula")
    off = abs(formula.value - paper.value) / (2.0 * paper.uncertainty)
    return Criterion(
        quantity="difference in units of the last printed digit",
        limit=0.5,
        readings={"": lambda runs: off},
        form=".2g",
        reason=(1.0, 1.0),  # how a number is rounded is no choice
    )
