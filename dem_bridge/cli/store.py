"""The commands ``dem-bridge store list|why|verify|prune``, which look into the store of runs."""

from __future__ import annotations

import sys
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import click

from dem_bridge.cli.options import AS_JSON, SCENE
from dem_bridge.cli.parameters import NOT_NEGATIVE, Option, make_command, print_json
from dem_bridge.errors import UsageError

if TYPE_CHECKING:
    from dem_bridge.runs.inspect import Entry
    from dem_bridge.runs.store import Store


def _opened() -> Store:
    """Return the default store; UsageError if there is none."""
    from dem_bridge.runs.store import VARIABLE, Store

    store = Store.opened()
    if store is None:
        raise UsageError(f"there is no store, because {VARIABLE} is empty; set it to a folder, or unset it")
    return store


def _line(entry: Entry) -> str:
    used = datetime.fromtimestamp(entry.used, UTC).strftime("%Y-%m-%d %H:%M")
    return f"{entry.key[:12]}  {entry.size / 1e6:8.2f} MB  used {used}  {entry.what}"


@make_command("list", replace(SCENE, metavar="[SCENE]", required=False), AS_JSON)
def list_(as_json: bool, scene: str | None = None) -> None:
    """List the entries of the store, the latest used first.

    With the name of a SCENE only its runs are listed.
    """
    from dem_bridge.runs.inspect import entries

    store = _opened()
    chosen = [entry for entry in entries(store) if scene is None or entry.scene == scene]
    if as_json:
        fields = ("key", "size", "made", "used", "what", "scene")
        print_json([{name: getattr(entry, name) for name in fields} for entry in chosen])
        return
    for entry in chosen:
        click.echo(_line(entry))
    click.echo(f"{len(chosen)} entries, {sum(entry.size for entry in chosen) / 1e6:.1f} MB, in {store.folder}")


@make_command("why", SCENE, AS_JSON)
def why(scene: str, as_json: bool) -> None:
    """Say of each stored run of SCENE whether it is used again, and if not, what has changed since."""
    import dem_bridge
    from dem_bridge.runs import inspect

    answers = inspect.why(_opened(), dem_bridge.load_scene(scene))
    if as_json:
        print_json([{"key": entry.key, "what": entry.what, "made": entry.made, "why": text} for entry, text in answers])
        return
    for entry, text in answers:
        click.echo(f"{entry.key[:12]}  {entry.what}: {text}")
    if not answers:
        click.echo(f"The store has no run of {scene}: every run is made.")


@make_command("verify", AS_JSON)
def verify(as_json: bool) -> None:
    """Check every entry against its checksum.

    Damaged entries are set aside and computed again when they are needed. The exit code is then 1.
    """
    from dem_bridge.runs.inspect import check

    count, damaged = check(_opened())
    if as_json:
        print_json({"entries": count, "damaged": damaged})
    else:
        for line in damaged:
            click.echo(line)
        click.echo(f"{count} entries, {len(damaged)} damaged")
    sys.exit(1 if damaged else 0)


@make_command(
    "prune",
    Option("days", "Remove entries that were not used for D days.", float, metavar="D", limits=NOT_NEGATIVE),
    Option(
        "megabytes",
        "Remove the entries that were not used for the longest time, until M megabytes are left.",
        float,
        metavar="M",
        limits=NOT_NEGATIVE,
    ),
)
def prune(days: float | None = None, megabytes: float | None = None) -> None:
    """Remove entries by age or down to a size."""
    from dem_bridge.runs.inspect import prune as remove

    removed, freed = remove(_opened(), days=days, megabytes=megabytes)
    click.echo(f"{removed} entries removed, {freed / 1e6:.1f} MB")


store_group = click.Group("store", [list_, why, verify, prune], help="Look into the store of runs.")
