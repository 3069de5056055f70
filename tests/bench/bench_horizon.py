"""Follow twenty bodies between two walls over many steps of the twin: drift of energy, and the horizon of velocities.

``make bench`` runs 2e7 steps, ``python -m tests.bench.bench_horizon 1e8`` those of :doc:`docs/costs.md`;
tests/studies/horizon has the same over fewer.
"""

from __future__ import annotations

import sys
import time

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import dem_bridge as db
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.scene import Scene, Wall
from tests.bench.timing import cpu_seconds, record

STEPS, TINY_STEPS = 20_000_000, 20_000


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


def main(*, tiny: bool = False, steps: int = STEPS) -> int:
    """Print the answer; 1 where energy drifts, or where single velocities are judged beyond their horizon."""
    steps = TINY_STEPS if tiny else steps
    began, cpu = time.perf_counter(), cpu_seconds()
    with Progress(transient=True) as shown:
        task = shown.add_task("between walls", total=1.0)
        study = db.study(
            "horizon",
            between_walls(10, duration=0.01) if tiny else between_walls(),
            steps=steps,
            store=False,
            progress=lambda done, total, label: shown.update(task, completed=done / total, description=label),
        )
    record("study horizon between walls", [cpu_seconds() - cpu])
    console = Console(width=150)
    for sentence in study.answer:
        console.print(f"* {sentence}", markup=False)
    for content in study.tables:
        table = Table(*content.columns, title=content.title)
        for row in content.rows:
            table.add_row(*(cell if isinstance(cell, str) else f"{cell:.4g}" for cell in row))
        console.print(table)
    console.print(f"{steps:.0e} steps, and all else: {time.perf_counter() - began:.0f} s")
    velocity = {verdict.outcome for verdict in study.verdicts if verdict.quantity == "velocity"}
    others = {verdict.outcome for verdict in study.verdicts if verdict.quantity != "velocity"}
    return int(velocity != {Outcome.UNDECIDED} or others != {Outcome.PASS})


if __name__ == "__main__":
    sys.exit(main(steps=int(float(sys.argv[1])) if len(sys.argv) > 1 else STEPS))
