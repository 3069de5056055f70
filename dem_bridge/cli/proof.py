"""The command ``dem-bridge prove``: prove the motion of a scene and write its certificate, or check a certificate."""

from __future__ import annotations

import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

import dem_bridge
from dem_bridge.cli import options, waiting
from dem_bridge.cli.parameters import FILE, Limits, Option, make_command, print_json
from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import check_file

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Scene


@make_command(
    "prove",
    replace(options.SCENE, required=False),
    Option(
        "digits",
        "Digits of the largest velocity that are wanted at the end.",
        int,
        metavar="N",
        limits=Limits("a whole number from 1 to 60", at_least=1.0, at_most=60.0),
        value=16,
        default="16",
    ),
    replace(options.OUTPUT, help="Certificate to write, JSON; an unfinished one is continued."),
    replace(options.FORCE, help="Begin anew if FILE exists."),
    Option("certificate", "Check a certificate, in place of a proof.", FILE, metavar="FILE", flags=("--check",)),
    options.JOBS,
    options.AS_JSON,
)
def prove(
    digits: int,
    force: bool,
    as_json: bool,
    scene: str | None = None,
    output: Path | None = None,
    certificate: Path | None = None,
    jobs: int = 2,
) -> None:
    """Prove the motion of SCENE: balls that contain all velocities and displacements, and the order of all touches.

    The largest force of each contact and the time of its first maximal compression are enclosed, too. The certificate
    is kept at each of some thirty checkpoints. After Ctrl-C the same command goes on. With --check, a certificate is
    proved by a program that shares nothing with the one that made it; SCENE is then the scene that it must be about.

    The exit code is 0 if the motion is proved up to the end, and 1 if it is not.
    """
    if certificate is not None:
        if output is not None:
            raise click.UsageError("'-o' and '--check' exclude each other: a check writes nothing.")
        _check(certificate, None if scene is None else dem_bridge.load_scene(scene), jobs, as_json)
    if scene is None or output is None:
        raise click.UsageError("Missing SCENE and '-o FILE', or '--check FILE'.")
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
    if as_json:
        print_json(proof.as_json())
    else:
        click.echo(str(proof))
        click.echo(f"written: {output}")
    sys.exit(0 if proof.complete else 1)


def _check(certificate: Path, scene: Scene | None, jobs: int, as_json: bool) -> NoReturn:
    """Check a certificate, print the result, and end with its exit code."""
    from dem_bridge.proof.balls import library  # an extra

    library()
    from dem_bridge.proof.checker import check_proof

    try:
        check = check_proof(certificate, scene, jobs)
    except OSError as error:
        raise UsageError(f"{certificate}: the certificate cannot be read ({error.strerror})") from error
    if as_json:
        print_json(asdict(check))
    else:
        click.echo(f"{certificate}: {check.sentence}")
    sys.exit(0 if check.proved else 1)
