"""The command ``dem-bridge prove``: prove the motion of a scene, and write the certificate."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import click

import dem_bridge
from dem_bridge.cli import options, waiting
from dem_bridge.cli.parameters import Limits, Option, make_command
from dem_bridge.foundation.files import check_file


@make_command(
    "prove",
    options.SCENE,
    Option(
        "digits",
        "Digits of the largest velocity that are wanted at the end.",
        int,
        metavar="N",
        limits=Limits("a whole number from 1 to 60", at_least=1.0, at_most=60.0),
        value=16,
        default="16",
    ),
    replace(options.OUTPUT, help="Certificate to write, JSON; an unfinished one is continued.", required=True),
    replace(options.FORCE, help="Begin anew if FILE exists."),
)
def prove(scene: str, digits: int, output: Path, force: bool = False) -> None:
    """Prove the motion of SCENE: balls that contain all velocities and displacements, and the order of all touches.

    The certificate is kept at each of some thirty checkpoints. After Ctrl-C the same command goes on.

    The exit code is 0 if the motion is proved up to the end, and 1 if the proof ends before.
    """
    check_file(output)
    known = dem_bridge.load_scene(scene)
    waiting.announce_compiling("proof")
    try:
        with waiting.fraction(f"{scene} is proved"):
            proof = dem_bridge.prove(known, digits, file=output, anew=force)
    except KeyboardInterrupt:
        if output.exists():
            click.echo(f"dem-bridge: interrupted; {output} has what is proved, and the same command goes on", err=True)
        raise
    click.echo(str(proof))
    click.echo(f"written: {output}")
    sys.exit(0 if proof.complete else 1)
