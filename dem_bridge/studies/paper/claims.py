"""Claims: statements of the paper with the values that support or contradict them.

The outcome of a claim follows from the values by the reference and by LAMMPS, each with its uncertainty; the values by
theories and ode45 are listed beside them. A claim that fails is a finding about the paper, not a failed check of a
code. The texts of all claims are in ``claims.toml``.

An outcome that hangs on a limit of ours says little where another limit, within reason, gives the other outcome. The
criterion of a claim is therefore also a quantity with its limit, read in our window and in others: the limit at which
the outcome changes is the value of the quantity in our window, and the margin of the claim.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Claim, ClaimValue, Margin
from dem_bridge.report.texts import fill
from dem_bridge.studies.paper import CLAIMS
from dem_bridge.studies.paper.measures import Measure, inside, measured
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.verification.reference_choice import REFERENCE

#: backends whose values decide the outcome, as far as they have run
DECIDE = (REFERENCE, "lammps")
#: how the page counts claims that do not fail; one that fails is counted by its cause ("print", "theory", "limit")
KINDS = {
    Outcome.PASS: "holds",
    Outcome.MODEL_DIFFERENCE: "theory",
    Outcome.UNDECIDED: "undecided",
    Outcome.NOT_RUN: "not run",
}
#: numbers in print, by the id of their claim; ``last_digit``: one unit of it, 0 for a number without rounding
PRINTED: Mapping[str, dict[str, Any]] = {
    "striker-mass": {"name": "mass of the striker", "value": 8.1e-3, "unit": "kg", "last_digit": 1e-4},
    "stiffness-2-degrees": {"name": "stiffness at 2 degrees", "value": 7.27e10, "unit": "N/m^1.5", "last_digit": 1e8},
    "stiffness-90-degrees": {"name": "stiffness at 90 degrees", "value": 4.68e9, "unit": "N/m^1.5", "last_digit": 1e7},
    "striker-stiffness": {"name": "beta_0", "value": 3.98e9, "unit": "N/m^1.5", "last_digit": 1e7},
    "weight": {"name": "load at the bottom", "value": 1.6, "unit": "N", "last_digit": 0.1},
    "residence-definition": {
        "name": "share of the momentum transferred at T",
        "value": 1.0,
        "unit": "",
        "last_digit": 0.0,
    },
    "force-exponent-decelerating": {"name": "exponent", "value": 0.4, "unit": "", "last_digit": 0.0},
    "force-exponent-accelerating": {"name": "exponent", "value": 0.4, "unit": "", "last_digit": 0.0},
}
#: formulas that the numbers follow from
FORMULAS = {
    "striker-mass": "4/3 pi r^3 rho, crystalline quartz",
    "stiffness-2-degrees": "eq. 3.1",
    "stiffness-90-degrees": "eq. 3.1",
    "striker-stiffness": "sphere on cylinder, exact",
    "weight": "m g times 40",
}
#: why a claim fails that is not about a number in print ("print") or beyond a limit of ours ("limit")
WHY_FAILED = {
    "stiffness-90-degrees": "print",
    "weight": "print",
    "velocity-by-bca": "theory",
    "arrival-as-printed": "theory",
    "residence-definition": "print",
    "compression": "print",
}
#: backends whose values stand in sentences beside those that decide
BESIDE = ("ode45", "bca", "adiabatic")


def printed(name: str, value: float, unit: str, *, last_digit: float = 0.0) -> ClaimValue:
    """Return a number printed in the paper; its uncertainty is half of its last digit."""
    return ClaimValue(name=name, backend="paper", value=value, uncertainty=0.5 * last_digit, unit=unit)


def exact(name: str, value: float, unit: str) -> ClaimValue:
    """Return a number given by a formula."""
    return ClaimValue(name=name, backend="formula", value=value, uncertainty=0.0, unit=unit)


def heard(runs: Runs, scene: str, measure: Measure) -> tuple[ClaimValue, ...]:
    """Return the values of a measure by all backends that ran the scene; their name has that of the scene."""
    measure = replace(measure, name=f"{measure.name}, {scene}")
    return tuple(measured(measure, runs.scenes[scene], run, name) for name, run in runs.judges(scene))


def by(values: Iterable[ClaimValue], *backends: str) -> ClaimValue:
    """Return the value by the first of ``backends`` that has one (default: :data:`DECIDE`); nan where none has."""
    names, known_values = backends or DECIDE, {value.backend: value for value in reversed(list(values))}
    missing = ClaimValue(name="", backend=names[0], value=math.nan)
    return next((known_values[name] for name in names if name in known_values), missing)


def decided(values: Sequence[ClaimValue], low: float = -math.inf, high: float = math.inf) -> Outcome:
    """Judge whether the deciding values lie between the limits; where they differ the outcome is UNDECIDED."""
    outcomes = {inside(value, low, high) for value in values if value.backend in DECIDE}
    if not outcomes:
        return Outcome.NOT_RUN
    return outcomes.pop() if len(outcomes) == 1 else Outcome.UNDECIDED


def together(*outcomes: Outcome) -> Outcome:
    """Combine the outcomes of the parts of a claim: it holds only if all parts do; NOT_RUN without any."""
    for worst in (Outcome.NOT_RUN, Outcome.BROKEN, Outcome.FAIL, Outcome.UNDECIDED):
        if worst in outcomes:
            return worst
    return Outcome.PASS if outcomes else Outcome.NOT_RUN


def claim(
    id: str,
    outcome: Outcome,
    *values: ClaimValue | Iterable[ClaimValue],
    each: Iterable[Mapping[str, Any]] = (),
    more: Mapping[str, Any] | None = None,
    **numbers: Any,
) -> Claim:
    """Return a claim with its texts.

    Parameters
    ----------
    id : str
        Key of :data:`~dem_bridge.studies.paper.CLAIMS`.
    outcome : Outcome
        With NOT_RUN, the sentence says that runs are missing.
    values : ClaimValue or iterables of them
    each : iterable of mappings
        Numbers of the text ``each``, once for every part of the claim.
    more : mapping, optional
        Numbers of the text ``more``, which follows the sentence; None where runs for it are missing.
    numbers
        Numbers of the sentence.

    """
    text, sentence, short = CLAIMS[id], "The runs from which this is read are missing.", ""
    margin = None
    if outcome is not Outcome.NOT_RUN:
        parts, join = list(each), text.get("join", " and ")

        def filled(key: str) -> list[str]:
            return [fill(text.get(key, ""), **part) for part in parts]

        sentence = fill(text["sentence"], each=join.join(filled("each")), **numbers)
        if more is not None:
            sentence += " " + fill(text["more"], **more)
        *most, last = filled("short_each") or [""]
        short = fill(text["short"], each=" and ".join(filter(None, [", ".join(most), last])), **numbers)
        if "margin" in text:
            words = fill(text["margin"], each=join.join(filled("margin_each")), **numbers)
            margin = Margin(sentence=words, changes=text.get("changes", ""))
    flat = [item for value in values for item in ([value] if isinstance(value, ClaimValue) else value)]
    return Claim(
        id=id,
        where=text["where"],
        statement=text["statement"],
        outcome=outcome,
        sentence=sentence,
        short=short,
        kind=KINDS.get(outcome) or WHY_FAILED.get(id, "print" if id in PRINTED else "limit"),
        margin=margin,
        values=tuple(flat),
    )


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Define the claim that one number lies between two limits in each of some chains."""

    id: str
    measure: Measure
    chains: tuple[str, ...]
    low: float = -math.inf
    high: float = math.inf

    def judge(self, runs: Runs, *others: ClaimValue, **numbers: Any) -> Claim:
        """Return the claim with its values and ``others``; ``numbers`` are further ones of its sentence."""
        values = {chain: heard(runs, chain, self.measure) for chain in self.chains}
        each = [{"chain": chain, **sentence_numbers(of_chain)} for chain, of_chain in values.items()]
        return claim(
            self.id,
            together(*(decided(of_chain, self.low, self.high) for of_chain in values.values())),
            *values.values(),
            *others,
            each=each,
            first=SimpleNamespace(**each[0]),
            low=self.low,
            high=self.high,
            **numbers,
        )


def sentence_numbers(values: Sequence[ClaimValue]) -> dict[str, float]:
    """Return the deciding value, those :data:`BESIDE` it, and how far they are from theories."""
    value, others = by(values).value, {name: by(values, name).value for name in BESIDE}
    excess = others["bca"] / value - 1.0 if value else math.nan
    return {"value": value, **others, "excess": excess, "less_adiabatic": value - others["adiabatic"]}


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
    if not PRINTED.get(claim.id, {}).get("last_digit"):
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
