"""The types of values on the command line: text becomes a name, numbers, a wall or the executor of a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dem_bridge.backends.catalogue import BACKENDS, backend_names

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Wall

#: the path of a file or a folder
FILE = click.Path(path_type=Path)


def scene_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
    """Return the completions of a scene: names of shipped scenes, or files if no name matches."""
    from click.shell_completion import CompletionItem

    from dem_bridge.scene.shipped import shipped_scenes

    names = sorted(name for name in shipped_scenes("all") if name.startswith(incomplete))
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


class ObservableChoice(click.Choice[str]):
    """The name of a registered observable; the registry is imported when a name is needed, not for ``--help``."""

    def __init__(self) -> None:
        self.case_sensitive = True

    @property
    def choices(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of all registered observables."""
        from dem_bridge.observables.registry import OBSERVABLES

        return tuple(OBSERVABLES)


class BackendChoice(click.Choice[str]):
    """The name of a backend; those of other distributions are looked for when a name is not of this package."""

    def __init__(self) -> None:
        super().__init__(BACKENDS)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name of a backend."""
        if value in self.choices or value in backend_names():
            return str(value)
        return super().convert(value, param, ctx)


class Cluster(click.ParamType[Any]):
    """A Dask scheduler, to which the command is connected until it ends."""

    name = "cluster"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the executor of the cluster."""
        from dem_bridge.runs.campaign.cluster import connected

        return ctx.with_resource(connected(value)) if ctx is not None and isinstance(value, str) else value


def names(value: str) -> list[str]:
    """Return the names of a list with commas."""
    return [name.strip() for name in value.split(",")]


def assignments(value: str) -> dict[str, str] | list[str]:
    """Return the names of a list with commas, or a mapping if each of them is NAME=TEXT."""
    parts = names(value)
    pairs = [name.partition("=") for name in parts]
    return {name.strip(): text.strip() for name, _, text in pairs} if all(sign for _, sign, _ in pairs) else parts


def integers(value: str) -> list[int]:
    """Return the whole numbers of a list with commas."""
    try:
        return [int(number) for number in value.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{error}; allowed: whole numbers separated by commas") from None


def numbers(value: str) -> list[float]:
    """Return the numbers of a list with commas."""
    try:
        return [float(number) for number in value.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{error}; allowed: numbers separated by commas") from None


def variable(value: str) -> tuple[str, str]:
    """Return name and value of a variable NAME=VALUE."""
    name, sign, text = value.partition("=")
    if not sign:
        raise click.BadParameter(f"{value!r}; allowed: NAME=VALUE")
    return name, text


def wall(value: str) -> Wall:
    """Return the wall STIFFNESS[,GAP[,EXPONENT]]."""
    import dem_bridge

    try:
        given = [float(word) for word in value.split(",")]
    except ValueError:
        given = []
    if not 1 <= len(given) <= 3:
        raise click.BadParameter(f"{value!r}; allowed: STIFFNESS[,GAP[,EXPONENT]]")
    return dem_bridge.Wall(**dict(zip(("stiffness", "gap", "exponent"), given, strict=False)))
