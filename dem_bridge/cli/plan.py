"""The command ``dem-bridge plan``, which finds the cheapest settings for an accuracy."""

from __future__ import annotations

import json

import click

import dem_bridge
from dem_bridge.cli import terminal
from dem_bridge.cli.options import ObservableChoice, json_option, samples_option, scene_argument


def plan_command(backends: tuple[str, ...]) -> click.Command:
    """Return the command ``plan``; ``backends`` are the allowed names of --backend."""

    @click.command()
    @scene_argument
    @click.option(
        "--accuracy", type=float, required=True, metavar="A", help="Required relative accuracy, such as 1e-4."
    )
    @click.option("--backend", type=click.Choice(backends), help="Backend to plan for.  [default: the cheapest]")
    @click.option(
        "--observable",
        type=ObservableChoice(),
        default="velocity",
        show_default=True,
        help="Observable that must have the accuracy.",
    )
    @click.option("--budget", type=float, metavar="S", help="Largest CPU time of the run, s.  [default: no limit]")
    @click.option("--predict-only", is_flag=True, help="Use the error model only, without a run to check it.")
    @samples_option
    @json_option
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
        """Find the cheapest settings for an accuracy.

        The settings are those of the cheapest backend, or of one backend. Runs check them.
        """
        with terminal.bar() as progress:
            answer = dem_bridge.plan(
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
            click.echo(json.dumps(answer.as_json(), indent=1, allow_nan=False))
        else:
            terminal.print_plan(answer, scene)

    return plan
