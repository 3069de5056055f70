"""Claims: statements of the paper with the values that support or contradict them.

The outcome of a claim follows from the values by the reference and by LAMMPS, each with its uncertainty; the values by
theories and ode45 are listed beside them. A claim that fails is a finding about the paper, not a failed check of a
code.
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

#: backends whose values decide the outcome, as far as they have run
DECIDE = (REFERENCE, "lammps")


def printed(name: str, value: float, unit: str, *, last_digit: float = 0.0) -> ClaimValue:
    """Return a number printed in the paper; its uncertainty is half of its last digit."""
    return ClaimValue(name=name, backend="paper", value=value, uncertainty=0.5 * last_digit, unit=unit)


def exact(name: str, value: float, unit: str) -> ClaimValue:
    """Return a number given by a formula."""
    return ClaimValue(name=name, backend="formula", value=value, uncertainty=0.0, unit=unit)


def heard(runs: Runs, scene: str, measure: Measure) -> tuple[ClaimValue, ...]:
    """Return the values of a measure by all backends that ran the scene."""
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
    """Combine the outcomes of the parts of a claim: it holds only if all parts do."""
    for worst in (Outcome.NOT_RUN, Outcome.BROKEN, Outcome.FAIL, Outcome.UNDECIDED):
        if worst in outcomes:
            return worst
    return Outcome.PASS


def claim(id: str, where: str, statement: str, outcome: Outcome, sentence: str, *values: Any) -> Claim:
    """Return a claim; ``values`` may be ClaimValues or tuples of them.

    The sentence of a claim that is NOT_RUN says that runs are missing.
    """
    flat: list[ClaimValue] = []
    for value in values:
        flat += [value] if isinstance(value, ClaimValue) else list(value)
    if outcome is Outcome.NOT_RUN:
        sentence = "The runs from which this is read are missing."
    return Claim(id=id, where=where, statement=statement, outcome=outcome, sentence=sentence, values=tuple(flat))


def percent(value: float, digits: int = 2) -> str:
    """Format a ratio in per cent.

    >>> percent(0.02345), percent(-0.2)
    ('2.3 %', '-20 %')
    """
    return f"{100.0 * value:.{digits}g} %"
