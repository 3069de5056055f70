"""Families of the twin, from which the uncertainty of every code that integrates by velocity-Verlet follows.

LAMMPS, ASE and the twin on the same steps share one family: it is a function of scene, steps, radius and tables.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling
from dem_bridge.backends.curves import CELLS
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.splitting import EXACT, Tables
from dem_bridge.backends.steps import fixed_step_plan, order_on
from dem_bridge.backends.surrogate_radius import radius_of
from dem_bridge.backends.tabled import in_kernel, tables_for
from dem_bridge.backends.twin import TWIN, solve_dense, solve_plan
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.fixed_step import TwinFamily
from dem_bridge.runs.uncertainty.readings import complete_family, finer_ratio, read_dense, runs_at_other_steps
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import MOST_STEPS, Schedule
from dem_bridge.trajectory.trajectory import Trajectory

#: ratios of the steps of the other runs to that of the family
RATIOS = (2.0, 1.0 / 3.0)
#: ... where one step per sample leaves no coarser step that falls on the samples
FINER_RATIOS = (0.5, 1.0 / 3.0)
#: ... for damped contacts, the golden ratio and 1 over its square: the force of a dashpot begins with the step after
#: touch, and with a common multiple of the steps all runs may be late by the same
DAMPED_RATIOS = (1.618, 0.382)
#: largest step of the finer run, of 1/omega of the stiffest contact: four default steps
RESOLVED = 0.01
#: part of the change by thinning that all dense samples may still miss: of order 7/2 (a neighbour that opens between
#: two of them) the change is ten times the error
THINNING = 0.5


def twin_resolution(case: Case) -> Resolution:
    """Return the settings of the twin that integrates as the backend of a case does: steps, radius and tables."""
    how = case.resolution
    if case.backend not in (*ENGINE_BACKENDS, TWIN.name):
        # displacements are smaller than absolute positions, so that these bound their round-off
        return Resolution(dt=how.dt)
    twin = Resolution(dt=how.dt, surrogate_radius=how.surrogate_radius, geometry=how.geometry)
    if case.backend == "lammps-table" or (case.backend == TWIN.name and how.tables):
        style, lines, points = how.table_style, how.table_lines, how.table_points
        twin = replace(twin, tables=True, types=how.types, table_style=style, table_lines=lines, table_points=points)
    return twin


def twin_family(
    scene: Scene, resolution: Resolution, sampling: Sampling, cache: RunCache | None = None
) -> TwinFamily | None:
    """Return the family of the twin; None if the finer run would have more steps than can be counted.

    Parameters
    ----------
    scene : Scene
    resolution : Resolution
        Steps, radius and tables, see :func:`twin_resolution`.
    sampling : Sampling
    cache : RunCache, optional
        Where runs are looked for and kept, so that others need not repeat them.
    """
    case = Case(scene=scene, backend=TWIN.name, resolution=resolution, sampling=sampling)
    return (cache or RunCache()).family(case, _solve_family)


def _solve_family(case: Case, cache: RunCache) -> TwinFamily | None:
    watch, scene, resolution, sampling = Stopwatch(), case.scene, case.resolution, case.sampling
    prescan = prescan_scene(scene)
    plan = fixed_step_plan(scene, resolution, sampling, prescan)
    ratios = RATIOS if plan.per_sample > 1 else FINER_RATIOS
    if (scene.damped or scene.adhesive) and plan.per_sample > 2:
        ratios = DAMPED_RATIOS
    ratios = (ratios[0], finer_ratio(ratios[1], scene, plan, prescan, RESOLVED))
    if plan.steps > min(ratios) * MOST_STEPS:
        return None
    radius = radius_of(scene, resolution, prescan)
    tables = in_kernel(scene, tables_for(scene, resolution, prescan), radius) if resolution.tables else EXACT
    # without tables and a radius of its own the twin is in overlap variables
    plain = replace(case, resolution=Resolution(dt=resolution.dt))
    at_radius = replace(case, resolution=replace(resolution, surrogate_radius=radius, geometry="surrogate"))

    main = cache.load_or_solve(plain, partial(solve_plan, scene, plan))
    sampled = partial(solve_dense, scene, radius=0.0)
    others = runs_at_other_steps(plain, plan, ratios, prescan, cache, alone=partial(solve_plan, scene), sampled=sampled)
    positional, dense = solve_dense(scene, plan, radius, tables)
    cache.keep(at_radius, positional)
    family = TwinFamily(
        scene=scene,
        plan=plan,
        order=order_on(scene),
        main=main,
        others=others.runs,
        positional=positional,
        tabled=_tabled(case, plan, tables, cache) if resolution.tables else None,
        halved=solve_plan(scene, plan, cells=CELLS // 2) if scene.law is not None else None,
        readings=read_dense(scene, plan, dense, positional),
        thinning=THINNING,
    )
    return complete_family(family, watch, dense, others, sampled)


def _tabled(case: Case, plan: Schedule, tables: Tables, cache: RunCache) -> Trajectory:
    """Return the twin with tables in overlap variables, which is a case unless the radius is given."""
    if case.resolution.surrogate_radius is not None:
        return solve_plan(case.scene, plan, tables=tables)
    return cache.load_or_solve(case, partial(solve_plan, case.scene, plan, tables=tables))
