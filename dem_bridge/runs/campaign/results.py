"""The result of one case: a trajectory, or the reason why there is none."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass

from dem_bridge.backends.base import Backend, backend, unsupported_reason
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.trajectory.trajectory import Trajectory

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
