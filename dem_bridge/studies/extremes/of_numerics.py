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
    refused,
    theories_refuse,
)
from dem_bridge.studies.extremes.judge import Expected, Word
from dem_bridge.studies.extremes.truths import by_others


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
    scene = chain("table-7-lines")
    yield Entry(
        name=scene.name, asks="a table one line shorter than any may be", scene=scene, truths=(by_others(scene),),
        settings={"lammps-table": {"table_lines": 7}}, expected={"lammps-table": refused("table_lines = 7")},
    )  # fmt: skip
    scene = chain("table-8-lines")
    yield Entry(
        name=scene.name, asks="the shortest table", scene=scene, truths=(by_others(scene),),
        settings={"lammps-table": {"table_lines": 8}},
    )  # fmt: skip
    scene = chain("table-2-points")
    yield Entry(
        name=scene.name, asks="a table of two points", scene=scene, truths=(by_others(scene),),
        settings={"lammps-table": {"table_points": 2}},
    )  # fmt: skip
    scene = chain("table-ends-a-line-short")
    yield Entry(
        name=scene.name, asks="a table that ends a line short of the deepest overlap", scene=scene,
        truths=(by_others(scene),), instead={"lammps-table": ShortTable},
        expected={"lammps-table": refused("table inner cutoff")},
    )  # fmt: skip


def steps() -> Iterator[Entry]:
    # linear springs between walls, pressed so that none opens: the limit is 2 over the highest frequency
    bodies, spring = 8, BETA * 1e-5**0.5
    highest = 2.0 * math.sqrt(spring / MASS) * math.cos(0.5 * math.pi / (bodies + 1))
    wall = Wall(stiffness=spring, exponent=2.0)
    for share, name in ((0.99, "below"), (1.01, "above")):
        dt = share * 2.0 / highest
        scene = chain(f"step-just-{name}-the-limit", bodies=bodies, exponent=2.0, stiffness=spring,
                      wall_left=wall, wall_right=wall, precompression=100.0 * SPEED * math.sqrt(MASS * spring),
                      duration=400 * dt)  # fmt: skip
        yield Entry(
            name=scene.name,
            asks=f"a step of {share:g} of the limit of velocity-Verlet",
            scene=scene,
            truths=(by_others(scene),),
            dt=dt,
            # the twins at twice the step are unstable, and so are those at 1.01; then bodies may pass through others
            expected=theories_refuse(
                "has walls and precompression", **{VERLET: Expected(Word.NO_BAR, otherwise=Word.REFUSED)}
            ),
        )
    trap = replace(load_scene("decelerating-40"), name="step-in-the-trap", samples=60)
    yield Entry(
        name=trap.name,
        asks="a step of 4e-6 s on the paper's chain, where momentum and final energy look right and velocities are not",
        scene=trap,
        truths=(by_others(trap),),
        dt=4e-6,
    )
    over = chain("step-over-contacts", samples=3, times=12.0)
    yield Entry(
        name=over.name,
        asks="a step of four contact times",
        scene=over,
        truths=(by_others(over),),
        dt=over.duration / 3,
        expected={FIXED_STEP: Expected(Word.NO_BAR, otherwise=Word.REFUSED)},
    )
