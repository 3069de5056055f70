"""Extremes of the numerics: tables that are too short, steps at the limit of stability and beyond."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dem_bridge.backends.base import Resolution
from dem_bridge.backends.lammps import LammpsTable
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.tabled import tables_for
from dem_bridge.lmp.pairing import TableSet
from dem_bridge.scene import Scene, Wall
from dem_bridge.scene_file import load_scene
from dem_bridge.studies.extremes.entry import (
    BETA,
    FIXED_STEP,
    MASS,
    SPEED,
    VERLET,
    Entry,
    chain,
    entry,
    refused,
    theories_refuse,
)
from dem_bridge.studies.extremes.judge import Expected, Word


class ShortTable(LammpsTable):
    """Tables that end where the deepest overlap is foreseen, a line short of it."""

    def _tables(self, scene: Scene, resolution: Resolution, prescan: Prescan) -> TableSet | None:
        result = tables_for(scene, resolution, prescan)
        deepest = float(np.max(prescan.peak_overlap))
        cut = {}
        for law, table in result.tables.items():
            kept = table.distance > table.distance[-1] - deepest
            cut[law] = replace(table, distance=table.distance[kept], energy=table.energy[kept], force=table.force[kept])
        return replace(result, tables=cut)


def tables() -> Iterator[Entry]:
    """Yield tables that are as short as they may be, and shorter."""
    for name, asks, settings, expected in (
        ("table-7-lines", "a table one line shorter than any may be", {"table_lines": 7}, refused("table_lines = 7")),
        ("table-8-lines", "the shortest table", {"table_lines": 8}, None),
        ("table-2-points", "a table of two points", {"table_points": 2}, None),
    ):
        outcomes = {} if expected is None else {"lammps-table": expected}
        yield entry(chain(name), asks, settings={"lammps-table": settings}, expected=outcomes)
    asks = "a table that ends a line short of the deepest overlap"
    expected = refused("table inner cutoff")
    yield entry(
        chain("table-ends-a-line-short"),
        asks,
        instead={"lammps-table": ShortTable},
        expected={"lammps-table": expected},
    )


def steps() -> Iterator[Entry]:
    """Yield time steps at the limit of stability and beyond."""
    # linear springs between walls, pressed so that none opens: the limit is 2 over the highest frequency
    bodies, spring = 8, BETA * 1e-5**0.5
    highest = 2.0 * math.sqrt(spring / MASS) * math.cos(0.5 * math.pi / (bodies + 1))
    wall = Wall(stiffness=spring, exponent=2.0)
    # the twins at twice the step are unstable, and so are those at 1.01; then bodies may pass through others
    unstable = Expected(Word.NO_BAR, otherwise=Word.REFUSED)
    for share, name in ((0.99, "below"), (1.01, "above")):
        dt = share * 2.0 / highest
        scene = chain(f"step-just-{name}-the-limit", bodies=bodies, exponent=2.0, stiffness=spring,
                      wall_left=wall, wall_right=wall, precompression=100.0 * SPEED * math.sqrt(MASS * spring),
                      duration=400 * dt)  # fmt: skip
        expected = theories_refuse("has walls and precompression", **{VERLET: unstable})
        yield entry(scene, f"a step of {share:g} of the limit of velocity-Verlet", dt=dt, expected=expected)
    asks = "a step of 4e-6 s on the paper's chain, where momentum and final energy look right and velocities are not"
    yield entry(replace(load_scene("decelerating-40"), name="step-in-the-trap", samples=60), asks, dt=4e-6)
    over = chain("step-over-contacts", samples=3, times=12.0)
    yield entry(over, "a step of four contact times", dt=over.duration / 3, expected={FIXED_STEP: unstable})
