"""How a statement of the paper becomes a claim: who is asked, and who decides.

The reference and LAMMPS decide, each with its whole bar; theories and ode45 are heard. A claim that fails is a finding
about the paper, and no failed check of a code.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from dem_bridge.studies.paper.measures import Measure, inside, measured
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.studies.study import Claim, ClaimValue
from dem_bridge.verification.roles import REFERENCE
from dem_bridge.verification.verdict import Outcome

#: who decides, where both have run
DECIDE = (REFERENCE, "lammps")


def printed(name: str, value: float, unit: str, *, last_digit: float = 0.0) -> ClaimValue:
    """What stands in the paper; a printed number is good to half of its last digit."""
    return ClaimValue(name=name, backend="paper", value=value, uncertainty=0.5 * last_digit, unit=unit)


def exact(name: str, value: float, unit: str) -> ClaimValue:
    """What a formula gives."""
    return ClaimValue(name=name, backend="formula", value=value, uncertainty=0.0, unit=unit)


def heard(runs: Runs, scene: str, measure: Measure) -> tuple[ClaimValue, ...]:
    """The measure by everyone who has run the scene."""
    return tuple(measured(measure, runs.scenes[scene], run, name) for name, run in runs.judges(scene))


def by(values: Iterable[ClaimValue], *backends: str) -> ClaimValue:
    """The value of the first of ``backends`` that said something (none named: of those who decide); else nan."""
    asked, said = backends or DECIDE, {one.backend: one for one in reversed(list(values))}
    nothing = ClaimValue(name="", backend=asked[0], value=math.nan)
    return next((said[name] for name in asked if name in said), nothing)


def decided(values: Sequence[ClaimValue], low: float = -math.inf, high: float = math.inf) -> Outcome:
    """Whether those who decide find the value between the limits; where they differ, UNDECIDED."""
    outcomes = {inside(one, low, high) for one in values if one.backend in DECIDE}
    if not outcomes:
        return Outcome.NOT_RUN
    return outcomes.pop() if len(outcomes) == 1 else Outcome.UNDECIDED


def together(*outcomes: Outcome) -> Outcome:
    """Of several parts of one claim: it holds where all do."""
    for worst in (Outcome.NOT_RUN, Outcome.BROKEN, Outcome.FAIL, Outcome.UNDECIDED):
        if worst in outcomes:
            return worst
    return Outcome.PASS


def claim(id: str, where: str, statement: str, outcome: Outcome, sentence: str, *values: Any) -> Claim:
    """A claim; ``values`` may be ClaimValues or tuples of them. Where nothing was run it says so."""
    flat: list[ClaimValue] = []
    for one in values:
        flat += [one] if isinstance(one, ClaimValue) else list(one)
    if outcome is Outcome.NOT_RUN:
        sentence = "Runs that this is read from are missing."
    return Claim(id=id, where=where, statement=statement, outcome=outcome, sentence=sentence, values=tuple(flat))


def percent(value: float, digits: int = 2) -> str:
    """A share as a person reads it.

    >>> percent(0.02345), percent(-0.2)
    ('2.3 %', '-20 %')
    """
    return f"{100.0 * value:.{digits}g} %"
