"""Short cases of every kind, and laws that end, kill or hold up the process that they arrive in."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from tests.helpers.processes import happens
from tests.helpers.three_bodies import THREE

SHORT = replace(THREE, samples=4, spacing=None)


def short_case(scene: Scene = SHORT, backend: str = "verlet", *, uncertainty: bool = False, **settings: Any) -> Case:
    resolution = Resolution(**settings or {"dt": 1e-6})
    return Case(
        scene=scene, backend=backend, resolution=resolution, sampling=Sampling(count=4), uncertainty=uncertainty
    )


def mixed_cases(count: int = 8) -> list[Case]:
    """Return cases alone and with uncertainty, with parts that others share, equal ones and a refused one."""
    heavy = replace(SHORT, name="heavy", gravity=9.81)
    return [
        *(short_case(dt=1e-6 / k) for k in range(1, count + 1)),
        short_case(uncertainty=True),  # has the first in its family
        short_case(backend="ase", uncertainty=True),  # ... and this one needs that family
        short_case(backend="blanes-moan", uncertainty=True),
        short_case(backend="scipy", uncertainty=True, rtol=1e-10),
        short_case(backend="bca"),
        short_case(heavy),
        short_case(heavy, backend="bca"),  # refused
        short_case(replace(SHORT, name="twice"), dt=5e-7),
    ]


def text_of(results: Sequence[Result]) -> str:
    """Return all that results hold apart from cost and date, every digit of it."""
    lines = []
    for result in results:
        run = result.trajectory
        lines.append(f"{result.case.label}, {result.case.scene.name}, {result.failure}, {result.key}")
        if run is not None:
            arrays = {entry.name: getattr(run, entry.name) for entry in fields(run)}
            numbers = [value for value in arrays.values() if isinstance(value, np.ndarray)]
            lines += [value.tobytes().hex() for value in (*numbers, *map(np.asarray, run.uncertainty.values()))]
            provenance = {name: value for name, value in run.provenance.items() if name != "stored"}
            lines.append(repr(sorted(provenance)) + repr(provenance["scene"]) + repr(provenance["settings"]))
    return "\n".join(lines)


@dataclass(frozen=True)
class OnArrival:
    """A law that does something in each process that it arrives in, and then is the ordinary one."""

    action: Callable[..., None]
    arguments: tuple[Any, ...] = ()

    def __call__(self, overlap: Any) -> Any:
        return 4e9 * overlap**1.5

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return _arrive, (self.action, self.arguments)


def with_action(action: Callable[..., None], *arguments: Any) -> Case:
    return short_case(replace(SHORT, law=OnArrival(action, arguments)))


def _arrive(action: Callable[..., None], arguments: tuple[Any, ...]) -> OnArrival:
    action(*arguments)
    return OnArrival(action, arguments)


def die(code: int = 9) -> None:
    os._exit(code)


def die_once(marker: Path) -> None:
    """End the first process that comes here."""
    try:
        marker.touch(exist_ok=False)
    except FileExistsError:
        return
    os._exit(9)


def wait_for(announcement: Path, release: Path) -> None:
    """Announce the process, and wait until it is released."""
    announcement.write_text(str(os.getpid()))
    happens(release.exists)


def hang() -> None:
    signal.pause()
