"""The tables of a scene: for the deck as files, for the twin as what LAMMPS makes of them.

Both come from the same set, so that the twin errs where LAMMPS does, and the difference to the twin with the laws
themselves is the error of the tables, apart from that of the time step.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np

from dem_bridge.backends.base import Resolution
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.splitting import Tables
from dem_bridge.backends.steps import Dense
from dem_bridge.backends.surrogate_radius import radius_of
from dem_bridge.lmp.force_table import LINES, Style
from dem_bridge.lmp.interpolation import interpolated, interpolation_error
from dem_bridge.lmp.pair_coefficients import MARGIN, TableSet, body_types, laws, line_order, pairs, table_set
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule


def tables_for(scene: Scene, resolution: Resolution, prescan: Prescan) -> TableSet:
    """Return the tables of a deck of this resolution."""
    contact_laws = laws(scene)
    types = body_types(contact_laws.where, resolution.types)
    return table_set(
        contact_laws,
        radius=radius_of(scene, resolution, prescan),
        peak_overlap=prescan.peak_overlap[line_order(scene)],
        pairs=sum(1 for _ in pairs(types)),
        style=cast(Style, resolution.table_style),
        lines=resolution.table_lines,
        points=resolution.table_points,
    )


def in_kernel(scene: Scene, tables: TableSet, radius: float) -> Tables:
    """Return tables for the kernel of the twin; ``radius`` in m."""
    contact_laws = laws(scene)
    internal = {law: interpolated(t, style=tables.style, points=tables.points) for law, t in tables.tables.items()}
    row = np.full(len(contact_laws.stiffness), -1)
    row[list(internal)] = np.arange(len(internal))
    places = np.empty(scene.n_contact, dtype=np.int64)
    places[line_order(scene)] = row[contact_laws.where]
    frame = np.zeros((len(internal), 4))
    value = np.zeros((len(internal), tables.points))
    second = np.zeros((len(internal), tables.points if tables.style == "spline" else 0))
    for at, interpolation in enumerate(internal.values()):
        *frame[at], value[at], second[at] = interpolation.arguments
    return Tables(2.0 * radius, places, frame, value, second)


def predicted_error(scene: Scene, tables: TableSet) -> float:
    """Largest error of a force for want of points, relative to the largest force that its contact was foreseen to have.

    Of all overlaps that a table has: LAMMPS stops beyond.
    """
    contact_laws = laws(scene)
    errors = [
        interpolation_error(
            contact_laws.law(law),
            interpolated(table, style=tables.style, points=tables.points),
            reach=float(table.distance[-1] - table.distance[0]),
        )
        for law, table in tables.tables.items()
    ]
    return max(errors, default=0.0)


def predicted_energy_error(tables: TableSet) -> float:
    """Bound of the error of stored energies, relative to the largest that a contact was foreseen to store.

    Straight lines between points miss overlap^n by n (n - 1) / 8 of a cell squared, 2.5 at n = 5, and splines less. The
    lines of a file are 3 / lines of its reach apart at most, where a cubic spline misses (3 / lines)^4 / 384 of the
    fourth derivative, 120 at n = 5; 40 and not 25 for the ends, where slopes are taken from lines, too.
    """
    lines = min((len(table.distance) for table in tables.tables.values()), default=LINES)
    return 3.0 / tables.points**2 + 40.0 / lines**4


def measured(
    scene: Scene, tables: TableSet, dense: Dense, plan: Schedule, energies: Mapping[int, float]
) -> dict[str, float]:
    """Measure the interpolation error of the tables at the overlaps of a run on the steps of ``plan``.

    ``measured_error``: as :func:`predicted_error`; ``round_off``: the error of the measurement, on the same scale;
    ``measured_energy_error``: of the energies (J) that LAMMPS has by step, relative to the largest that the tabled
    contacts stored (absent where they stored none at those steps); ``pull``: largest tension in a contact with damping
    beside its table, N.
    """
    contact_laws, order, c = laws(scene), line_order(scene), scene.contacts
    # damping goes with the velocity of the half step, and at the start with that of the start
    half = dense.velocity - np.where(plan.dense_steps > 0, 0.5 * plan.step, 0.0)[:, None] * dense.acceleration
    if scene.piston is not None:  # its velocity is that of the end of the step
        half[:, 0] = dense.velocity[:, 0]
    elastic = dense.force - np.where(dense.overlap > 0.0, c.damping * (half[:, c.left] - half[:, c.right]), 0.0)
    # forces are running sums of net forces. An atom's is two contacts' and its weight (one sum each), and is taken from
    # the weight and added up (one each): half an ulp of at most both forces, four times, and of the weight, twice
    slowed = scene.drag * np.abs(half[:, :-1]) @ np.array(scene.mass)
    summed = np.empty_like(elastic)
    summed[:, order] = (
        4.0 * np.cumsum(np.abs(dense.force[:, order]), axis=1) + (scene.summed_outer_force + 4.0 * slowed)[:, None]
    )
    # four roundings of a velocity in each rate
    summed += 4.0 * c.damping * float(np.max(np.abs(dense.velocity)))
    worst = rounding = pull = 0.0
    stored = np.zeros(len(elastic))
    for law, table in tables.tables.items():
        tabled, force_of = order[contact_laws.where == law], contact_laws.law(law).force
        foreseen = float(table.distance[-1] - table.distance[0]) / MARGIN
        largest = float(force_of(np.array(foreseen)))
        closed = np.maximum(dense.overlap[:, tabled], 0.0)
        stored += np.sum(contact_laws.law(law).energy(closed), axis=1)
        away = np.abs(elastic[:, tabled] - force_of(closed))
        worst = max(worst, float(np.max(away, initial=0.0)) / largest)
        # r^2 has four roundings of half an ulp from distance to cell, which move a force by its slope; the spline in a
        # cell, and the law, have at most eight of the force
        slope = float(np.max(np.abs(np.diff(table.force) / np.diff(table.distance))))
        place = 2.0 * slope * float(table.distance[-1]) / largest
        rounding = max(rounding, float(np.max(summed[:, tabled], initial=0.0)) / largest + place + 8.0)
        if contact_laws.eta[law] > 0.0 and c.clip:
            pull = max(pull, -float(np.min(dense.force[:, tabled], initial=0.0)))
    rows = {step: row for row, step in enumerate(plan.dense_steps.tolist())}
    both = [(energy, float(stored[rows[step]])) for step, energy in energies.items() if step in rows]
    errors = {"measured_error": worst, "round_off": float(np.finfo(float).eps) * rounding, "pull": pull}
    if any(theirs or ours for theirs, ours in both):
        errors["measured_energy_error"] = max(abs(theirs - ours) for theirs, ours in both) / max(
            float(np.max(stored)), 1e-300
        )
    return errors
