"""The command ``dem-bridge plan``: the cheapest settings for a wanted accuracy, and why."""

from __future__ import annotations

import json

import click

import dem_bridge
from dem_bridge.cli import terminal
from dem_bridge.cli.options import scene_argument

#: named again here so that --help needs no numpy; a test holds them together
OBSERVABLES = (
    "velocity",
    "displacement",
    "contact_force",
    "peak_force",
    "crossing_time",
    "arrival",
    "residence",
)


def plan_command(backends: tuple[str, ...]) -> click.Command:
    """The command; ``backends`` that may be named."""

    @click.command()
    @scene_argument
    @click.option("--accuracy", type=float, required=True, metavar="A", help="Wanted, relative, such as 1e-4.")
    @click.option("--backend", type=click.Choice(backends), help="Settings of this one.  [default: the cheapest]")
    @click.option(
        "--observable", type=click.Choice(OBSERVABLES), default="velocity", show_default=True, help="Accuracy of what."
    )
    @click.option("--budget", type=float, metavar="S", help="CPU that the run may take, s.")
    @click.option("--predict-only", is_flag=True, help="By the model alone, without a run to check it.")
    @click.option("--samples", type=int, metavar="N", help="Samples in time (default: the scene's).")
    @click.option("--json", "as_json", is_flag=True, help="JSON on stdout.")
    def plan(
        scene: str,
        accuracy: float,
        backend: str | None,
        observable: str,
        budget: float | None,
        predict_only: bool,
        samples: int | None,
        as_json: bool,
    ) -> None:
        """Say with which backend and settings SCENE is solved to an accuracy at the least cost, and why."""
        with terminal.bar() as progress:
            found = dem_bridge.plan(
                scene,
                accuracy,
                backend,
                observable=observable,
                budget=budget,
                predict_only=predict_only,
                samples=samples,
                progress=progress,
            )
        if as_json:
            click.echo(json.dumps(found.as_json(), indent=1, allow_nan=False))
        else:
            terminal.print_plan(found, scene)

    return plan
