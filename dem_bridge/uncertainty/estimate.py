"""Solve a case, with its uncertainty."""

from __future__ import annotations

from dataclasses import replace

from dem_bridge.backends.base import Backend, backend
from dem_bridge.runs.case import Case
from dem_bridge.trajectory import Trajectory


def solve(case: Case, code: Backend | None = None) -> Trajectory:
    """Return the run of a case, with its uncertainty unless the case has none.

    ``code``: a backend in place of the one that the case names.
    """
    code = code or backend(case.backend, case.engine)
    return code.run(case.scene, replace(case.resolution, bars=case.uncertainty), case.sampling)
