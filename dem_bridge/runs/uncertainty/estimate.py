"""Solve a case with its uncertainty: which further runs each backend takes for it, and the rule that applies to them.

===================================  ==================================================================================
LAMMPS, ASE, the twin                a family of twins on the same steps (:mod:`.from_twins`)
Blanes and Moan's method             its own runs at two finer steps (:mod:`.from_own_steps`)
the reference, ode45                 replicas that the backend makes (:mod:`.from_replicas`)
scipy, and the reference through it  ordinary runs at looser tolerances (:mod:`.from_looser_runs`)
theories, and any other backend      none: the uncertainty is that which the run states, inf unless it is exact
===================================  ==================================================================================
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, cast

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Backend, Replicating, Resolution, backend
from dem_bridge.backends.catalogue import backend_names, entry_of
from dem_bridge.foundation import progress
from dem_bridge.foundation.compiled import started
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.trajectory.trajectory import UNKNOWN, Trajectory, Uncertainty

if TYPE_CHECKING:
    from dem_bridge.runs.uncertainty.fixed_step import TwinFamily

TWIN = "verlet"
#: backends that keep momenta: a velocity is rounded by its mass, so that bodies which fall alike drift apart
DRIFTING = ("ase",)
#: backends that take their uncertainty from a family of twins, from their own steps, and from replicas or looser runs
TWINS, OWN_STEPS, REPLICAS = (
    tuple(name for name, entry in BACKENDS.items() if entry.uncertainty in rules)
    for rules in (("twins",), ("own_steps",), ("replicas", "looser_runs"))
)


def solve(case: Case, cache: RunCache | None = None, code: Backend | None = None) -> Trajectory:
    """Return the run of a case, with its uncertainty unless the case is without.

    Parameters
    ----------
    case : Case
    cache : RunCache, optional
        Where runs are looked for and kept, so that others need not repeat them.
    code : Backend, optional
        A backend in place of the one that the case names; its run is not kept.
    """
    cache = cache or RunCache()
    if not case.uncertainty:
        return _run(case, cache, code)
    if case.backend in ENGINE_BACKENDS:
        # the twins need nothing of the engine, which runs in a process of its own
        wait_for_family = started(_family, case, cache)
        run = _run(case, cache, code)
        wait_for_family()
    else:
        if case.backend in OWN_STEPS or case.backend == TWIN:
            _family(case, cache)  # the run is one of its family, which the cache keeps
        looser = looser_cases(case)
        # replicas need nothing of the run, and more cores than one have more to do
        wait_for_replicas = started(_replicas, case) if case.backend in REPLICAS and not looser else None
        with progress.share(0.0, 1.0 / (1 + len(looser))):
            run = _run(case, cache, code)
        if wait_for_replicas is not None:
            return replace(run, uncertainty=_from_replicas(case, run, wait_for_replicas()))
    return replace(run, uncertainty=estimate_uncertainty(case, run, cache))


def estimate_uncertainty(case: Case, run: Trajectory, cache: RunCache | None = None) -> Uncertainty:
    """Return the uncertainty of the run of a case.

    Parameters
    ----------
    case : Case
    run : Trajectory
        Used for adaptive codes; the uncertainty of a code with a fixed step follows from its settings alone.
    cache : RunCache, optional
        Where further runs and families are looked for and kept.
    """
    cache = cache or RunCache()
    if _takes_twins(case.backend) or case.backend in OWN_STEPS:
        family = _family(case, cache)
        if family is None:
            return UNKNOWN
        from dem_bridge.runs.uncertainty.fixed_step import fixed_step_uncertainty

        # LAMMPS' contact forces are running sums of its net forces
        summed = case.scene.summed_outer_force if case.backend in ENGINE_BACKENDS else None
        return fixed_step_uncertainty(family, summed, drifts=case.backend in DRIFTING)
    if case.backend not in REPLICAS:
        return run.uncertainty
    looser = looser_cases(case)
    if not looser:
        return _from_replicas(case, run, _replicas(case))
    from dem_bridge.backends.scipy_dop853 import ScipyDop853
    from dem_bridge.runs.uncertainty.from_looser_runs import looser_uncertainty

    runs, scipy = [], ScipyDop853(largest_rtol=math.inf)  # a looser run need not be as good as a reference
    for number, other in enumerate(looser, start=1):
        with progress.share(number / (1 + len(looser)), 1.0 / (1 + len(looser))):
            runs.append(cache.load_or_solve(other, partial(other.solve, scipy)))
    return looser_uncertainty(case.scene, run, runs)


def _replicas(case: Case) -> list[Trajectory]:
    """Return the replicas of a case that its backend makes."""
    return cast(Replicating, backend(case.backend)).replicas(case.scene, case.resolution, case.sampling)


def _from_replicas(case: Case, run: Trajectory, replicas: list[Trajectory]) -> Uncertainty:
    """Return the uncertainty of the run of a case from its replicas."""
    from dem_bridge.runs.uncertainty.from_replicas import replica_uncertainty, rule_of, widen_for_the_end

    uncertainty = replica_uncertainty(run, replicas, rule_of(case.backend, case.scene))
    return widen_for_the_end(uncertainty, case.scene, run)


def needs_of(case: Case) -> tuple[Case, ...]:
    """Return the cases from which :func:`solve` puts a case together, which others may share; none: it has no parts.

    A case of LAMMPS or ASE takes the family of the twin on the same steps, which is made for the uncertainty of that.
    """
    if not case.uncertainty or case.backend == TWIN:
        return ()
    alone = replace(case, uncertainty=False)
    if _takes_twins(case.backend):
        from dem_bridge.runs.uncertainty.from_twins import twin_resolution

        twin = Case(scene=case.scene, backend=TWIN, resolution=twin_resolution(case), sampling=case.sampling)
        return alone, twin
    from dem_bridge.backends.scipy_dop853 import LARGEST_RTOL

    looser = looser_cases(case)
    if not looser or any((other.resolution.rtol or 0.0) > LARGEST_RTOL for other in looser):
        return ()
    return alone, *looser


def looser_cases(case: Case) -> tuple[Case, ...]:
    """Return the ordinary cases from which the uncertainty follows where scipy solves; none for other solvers."""
    if case.backend not in ("reference", "scipy"):
        return ()
    from dem_bridge.backends.reference import SERIES
    from dem_bridge.backends.scipy_dop853 import DEFAULT_RTOL
    from dem_bridge.runs.uncertainty.from_replicas import LOOSER, moved_by_a_digit

    if case.backend == "reference" and SERIES.covers(case.scene):
        return ()
    rtol = case.resolution.rtol if case.resolution.rtol is not None else DEFAULT_RTOL
    looser = replace(case, backend="scipy", uncertainty=False)
    first, *others = (replace(looser, resolution=Resolution(rtol=factor * rtol)) for factor in LOOSER)
    return replace(first, scene=moved_by_a_digit(case.scene)), *others


def _takes_twins(name: str) -> bool:
    """Return True if the uncertainty of a backend of any distribution is that of a family of twins."""
    is_guest = name not in BACKENDS and name in backend_names()
    return name in TWINS or (is_guest and entry_of(name).uncertainty == "twins")


def _family(case: Case, cache: RunCache) -> TwinFamily | None:
    if case.backend in OWN_STEPS:
        from dem_bridge.runs.uncertainty.from_own_steps import blanes_moan_family

        return blanes_moan_family(case, cache)
    from dem_bridge.runs.uncertainty.from_twins import twin_family, twin_resolution

    return twin_family(case.scene, twin_resolution(case), case.sampling, cache)


def _run(case: Case, cache: RunCache, code: Backend | None) -> Trajectory:
    return cache.load_or_solve(case, case.solve) if code is None else case.solve(code)
