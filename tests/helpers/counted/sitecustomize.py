"""Imported by every process that has this folder on its path: write a line for each run as it begins and ends.

``DEM_BRIDGE_COUNT`` names the file. A line is short, so that it is written as a whole, whichever process writes it.
When as many runs have ended as the file ``DEM_BRIDGE_HALT`` says, no other begins: a campaign cannot end before it is
killed.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import os
import sys
import time
from collections.abc import Sequence
from types import ModuleType
from typing import Any

#: backends whose runs are counted, by their modules
BACKENDS = {"dem_bridge.backends.verlet": "Verlet", "dem_bridge.backends.lammps": "LammpsGranular"}


def _say(word: str, name: str) -> None:
    file = os.open(os.environ["DEM_BRIDGE_COUNT"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(file, f"{word} {name}\n".encode())
    os.close(file)


def _wait() -> None:
    said = False
    while True:
        with open(os.environ["DEM_BRIDGE_HALT"]) as file:
            halt = int(file.read())
        with open(os.environ["DEM_BRIDGE_COUNT"], "a+") as file:
            file.seek(0)
            if sum(line.startswith("end") for line in file) < halt:
                return
        if not said:
            _say("wait", "")
            said = True
        time.sleep(0.01)


class _Counting(importlib.abc.MetaPathFinder):
    """Let backends count their runs once their modules are imported."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        spec = importlib.machinery.PathFinder.find_spec(fullname, path) if fullname in BACKENDS else None
        if spec is None or spec.loader is None:
            return None
        load = spec.loader.exec_module

        def counting(module: ModuleType) -> None:
            load(module)
            backend = getattr(module, BACKENDS[fullname])
            run = backend.run

            def counted(self: Any, scene: Any, *settings: Any) -> Any:
                _wait()
                _say("begin", scene.name)
                result = run(self, scene, *settings)
                _say("end", scene.name)
                return result

            backend.run = counted

        spec.loader.exec_module = counting  # type: ignore[method-assign]
        return spec


if "DEM_BRIDGE_COUNT" in os.environ:
    sys.meta_path.insert(0, _Counting())
