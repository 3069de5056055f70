"""Twenty bodies between two walls over 1e8 steps of the twin: does its energy drift, and what is known of velocities?

``make bench`` runs this (about a minute); tests/studies/test_horizon.py has the same over fewer steps.
"""

from __future__ import annotations

import sys
import time

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import dem_bridge as db
from dem_bridge.scene import Scene, Wall
from dem_bridge.verification.verdict import Outcome

STEPS = 100_000_000


def between_walls(count: int = 20, *, duration: float = 0.02, gap: float = 0.0) -> Scene:
    """Equal bodies in touch between two walls of the same stiffness, the first one struck."""
    wall = Wall(stiffness=4e9, gap=gap)
    return Scene(
        name=f"between-walls-{count}",
        duration=duration,
        mass=(1e-2,) * count,
        stiffness=(4e9,) * (count - 1),
        velocity=(0.8, *[0.0] * (count - 1)),
        gap=gap,
        wall_left=wall,
        wall_right=wall,
    )


def main(steps: int = STEPS) -> int:
    """Print the answer; 1 where energy drifts, or where single velocities are judged beyond their horizon."""
    began = time.perf_counter()
    with Progress(transient=True) as shown:
        task = shown.add_task("between walls", total=1.0)
        found = db.study(
            "horizon",
            between_walls(),
            steps=steps,
            store=False,
            progress=lambda done, total, label: shown.update(task, completed=done / total, description=label),
        )
    console = Console(width=150)
    for sentence in found.answer:
        console.print(f"* {sentence}", markup=False)
    for one in found.tables:
        table = Table(*one.columns, title=one.title)
        for row in one.rows:
            table.add_row(*(cell if isinstance(cell, str) else f"{cell:.4g}" for cell in row))
        console.print(table)
    console.print(f"{steps:.0e} steps of 20 bodies, and all else: {time.perf_counter() - began:.0f} s")
    rows = found.tables[3].rows
    velocity, others = ({str(row[4]) for row in rows if (row[1] == "velocity") == one} for one in (True, False))
    return int(velocity != {Outcome.UNDECIDED.value} or others != {Outcome.PASS.value})


if __name__ == "__main__":
    sys.exit(main())
