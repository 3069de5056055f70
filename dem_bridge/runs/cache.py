"""Runs in memory, read from a store where there is one: what the steps of one piece of work share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

from dem_bridge.runs.case import Case
from dem_bridge.runs.digits import planned_fingerprint
from dem_bridge.runs.store import Store
from dem_bridge.trajectory.trajectory import UNKNOWN, Trajectory

Family = TypeVar("Family")


class RunCache:
    """Runs by their case, in memory and from a ``store``; nothing is written to the store.

    Cases that differ in their uncertainty only share a run. ``families`` has families of runs by the case of the twin
    that they belong to. The key of a case is computed once, and what the store does not have is looked for once.
    """

    def __init__(self, store: Store | None = None) -> None:
        self.store = store
        self.runs: dict[Case, Trajectory] = {}
        self.families: dict[Case, Any] = {}
        self.missing: set[Case] = set()
        """Cases whose own entry the store did not have."""
        self._keys: dict[tuple[Case, str], str | None] = {}

    def key(self, case: Case) -> str | None:
        """Return the key of a case at the place where runs are planned to be made; None: it cannot be stored."""
        about = case, planned_fingerprint()
        if about not in self._keys:
            self._keys[about] = case.key
        return self._keys[about]

    def load_stored(self, case: Case) -> Trajectory | None:
        """Return the stored run of a case; None if there is none.

        A run that was stored with its uncertainty is also the run of the case without, whose uncertainty is inf. A run
        that was stored without uncertainty is never that of a case with.
        """
        if self.store is None:
            return None
        for stored in dict.fromkeys((case, replace(case, uncertainty=True))):
            if stored in self.missing or (key := self.key(stored)) is None:
                continue
            if (run := self.store.load(key, case.scene)) is not None:
                return run if case.uncertainty else replace(run, uncertainty=UNKNOWN)
            self.missing.add(stored)
        return None

    def load(self, case: Case) -> Trajectory | None:
        """Return the run of a case, without uncertainty; None if there is none."""
        case = replace(case, uncertainty=False)
        if case not in self.runs and (run := self.load_stored(case)) is not None:
            self.runs[case] = run
        return self.runs.get(case)

    def keep(self, case: Case, run: Trajectory) -> Trajectory:
        """Keep the run of a case, and return it."""
        self.runs[replace(case, uncertainty=False)] = run
        return run

    def load_or_solve(self, case: Case, solve: Callable[[], Trajectory]) -> Trajectory:
        """Return the run of a case, without uncertainty; ``solve`` makes it where there is none, and it is kept."""
        return self.load(case) or self.keep(case, solve())

    def family(self, case: Case, solve: Callable[[Case, RunCache], Family]) -> Family:
        """Return the family of a case, without uncertainty; ``solve`` makes it where there is none, and it is kept."""
        case = replace(case, uncertainty=False)
        if case not in self.families:
            self.families[case] = solve(case, self)
        family: Family = self.families[case]
        return family

    def has_family(self, case: Case) -> bool:
        """Return True if there is the family of a case, or it is known that it has none."""
        return replace(case, uncertainty=False) in self.families

    def adopt(self, other: RunCache) -> None:
        """Keep the runs and families of another cache."""
        self.runs |= other.runs
        self.families |= other.families
