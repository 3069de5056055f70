"""The result of one case, a trajectory or the reason why there is none, and the results of many as one long table."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dem_bridge.backends.base import Backend, backend, unsupported_reason
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.observables.differences import Reading, read, reduced, relative_to
from dem_bridge.observables.observable import Observable
from dem_bridge.observables.registry import observable_named
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

#: reasons why a case has no trajectory
Failure = UnsupportedScene | BackendUnavailable | RunBroken | UsageError


@dataclass(frozen=True, kw_only=True)
class Result:
    """A case with its trajectory, or with the reason why there is none."""

    case: Case
    trajectory: Trajectory | None = None
    failure: Failure | None = None
    key: str | None = None
    """What decides the result: the key of the run in the store, and the failure; None: nothing that could be told."""


class Crashed(RunBroken):
    """A backend raised what none should, or the process of the case died or hung; ``log`` has what is known."""


#: done, total, what is being done
Progress = Callable[[float, int, str], None]


def run_case(
    case: Case, *, everything: bool = False, by: Backend | None = None, cache: RunCache | None = None
) -> Result:
    """Run one case; an unsupported scene, a missing engine or a broken run is a result.

    ``everything``: wrong settings and crashes are results, too. ``by``: a backend in place of the one that the case
    names. ``cache``: where runs and families are looked for and kept.
    """
    try:
        chosen = by or backend(case.backend, case.engine)
        reason = unsupported_reason(chosen, case.scene)
        if reason:
            return Result(case=case, failure=UnsupportedScene(reason))
        return Result(case=case, trajectory=solve(case, cache, chosen if by else None))
    except (UnsupportedScene, BackendUnavailable, RunBroken) as error:
        return Result(case=case, failure=error)
    except Exception as error:
        if not everything:
            raise
        if isinstance(error, UsageError):
            return Result(case=case, failure=error)
        # as text: not every exception can travel from another process
        return Result(case=case, failure=Crashed(f"{type(error).__name__}: {error}", log=traceback.format_exc()))


#: columns of the table; relative ones are over the scale that the observable has in the reference
COLUMNS = (
    "case", "scene", "backend", "dt", "observable", "place", "value", "reference_value", "error", "uncertainty",
    "reference_uncertainty", "wall", "cpu", "steps", "force_evaluations", "failure",
)  # fmt: skip


def table_of(
    results: Sequence[Result],
    references: Sequence[Result | None],
    observables: Sequence[str | Observable],
    *,
    places: bool = False,
) -> pd.DataFrame:
    """Return the table of results, each compared with the result of its reference.

    Parameters
    ----------
    results : sequence of Result
        Results of the cases.
    references : sequence of Result or None
        Result that each of them is compared with. None: errors are nan.
    observables : sequence of str or Observable
        Registered observables by name, or others.
    places : bool
        Whether observables of bodies and of contacts have a row for each of them.

    Returns
    -------
    pandas.DataFrame
        ``case`` is the number of the result and ``place`` that of the body or contact, -1 for all of them together.
        ``value`` and ``reference_value`` are in the unit of the observable (of all places the largest magnitude),
        ``error``, ``uncertainty`` and ``reference_uncertainty`` relative (of all places the largest, else with its
        sign), ``dt``, ``wall`` and ``cpu`` in s. Numbers are nan where there is no run; ``failure`` says why.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from dem_bridge.backends.base import Resolution, Sampling
    >>> from dem_bridge.runs.campaign import run_cases
    >>> from dem_bridge.runs.case import Case
    >>> from dem_bridge.scene.file import load_scene
    >>> scene = load_scene("accelerating-40")
    >>> exact = Case(
    ...     scene=scene, backend="reference", resolution=Resolution(), sampling=Sampling(count=9), uncertainty=False
    ... )
    >>> steps = [Resolution(dt=dt) for dt in (2e-7, 1e-7)]
    >>> cases = [replace(exact, backend="verlet", resolution=step) for step in steps]
    >>> reference, *results = run_cases([exact, *cases])
    >>> coarse, fine = table_of(results, [reference] * 2, ["velocity"]).error
    >>> f"{coarse / fine:.1f}"
    '4.0'
    """
    import pandas as pd

    chosen = [observable_named(name) if isinstance(name, str) else name for name in observables]
    readings: dict[tuple[int, str], Reading] = {}  # most cases share their reference

    def reading(result: Result | None, observable: Observable) -> Reading | None:
        if result is None or result.trajectory is None:
            return None
        key = (id(result.trajectory), observable.name)
        if key not in readings:
            readings[key] = read(observable, result.case.scene, result.trajectory)
        return readings[key]

    rows = [
        (*_case(number, result)[:4], observable.name, *numbers, *_case(number, result)[4:])
        for number, (result, reference) in enumerate(zip(results, references, strict=True))
        for observable in chosen
        for numbers in _numbers(reading(result, observable), reading(reference, observable), places)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def _case(number: int, result: Result) -> tuple[Any, ...]:
    """Return the columns that do not depend on the observable."""
    case, run = result.case, result.trajectory
    if run is None:
        return (number, case.scene.name, case.backend, math.nan, *(math.nan,) * 4, str(result.failure))
    cost = (run.cost.wall, run.cost.cpu, run.cost.steps, run.cost.force_evaluations)
    return (number, case.scene.name, case.backend, run.provenance["settings"].get("dt", math.nan), *cost, "")


def _numbers(reading: Reading | None, reference: Reading | None, places: bool) -> Iterator[tuple[float, ...]]:
    """Yield place, values, error and uncertainties of one reading."""
    if reading is None:
        yield (-1, *(math.nan,) * 5)
        return
    base = reading if reference is None else reference
    errors = relative_to(base, reading)
    columns = [reading.values, base.values, errors.values, errors.uncertainty, errors.reference_uncertainty]
    if reference is None:
        columns[1:3] = [base.values + math.nan] * 2
    if reading.observable.axis == ():
        yield (-1, *map(float, columns))
    elif places and "time" not in reading.observable.axis:
        yield from ((place, *map(float, numbers)) for place, numbers in enumerate(zip(*columns, strict=True)))
    else:
        yield (-1, *map(reduced, columns))
