"""Run a command of the package and count calls while it runs: what ``house_runs.py`` starts in another checkout.

``python house_probe.py RESULT.json COUNTED(0|1) WORDS...`` writes one JSON object. Functions are found by the qualified
name of their code, wherever they are defined. Calls from compiled kernels and from other processes are not seen.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import threading
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType
from typing import Any


class Calls:
    """Counts of the calls of functions of the package, by module and qualified name."""

    def __init__(self, root: str) -> None:
        self.root = root
        self.by_name: Counter[str] = Counter()
        self.keys: Counter[str] = Counter()
        self.misses = 0
        self.methods = self.carried = self.modules = self.rooms = 0
        self._known: dict[CodeType, tuple[str, str] | None] = {}

    def place(self, code: CodeType) -> tuple[str, str] | None:
        """Return the module and the qualified name of code of the package; None for others."""
        if code not in self._known:
            inside = code.co_filename.startswith(self.root) and code.co_name != "<module>"
            module = code.co_filename[len(self.root) :].removesuffix(".py").replace(os.sep, ".")
            self._known[code] = (module, code.co_qualname) if inside else None
        return self._known[code]

    def __call__(self, frame: FrameType, event: str, value: Any) -> None:
        """Take note of one event of ``sys.setprofile``."""
        if event not in ("call", "return") or (found := self.place(frame.f_code)) is None:
            return
        module, name = found
        if event == "return":
            if name == "run_key":
                self.keys[str(value)] += 1
            elif name in ("Store.load", "Store.load_arrays"):
                self.misses += value is None
            return
        self.by_name[f"{module}:{name}"] += 1
        code = frame.f_code
        if (
            name == "<genexpr>"
            or "<locals>" in name
            or "comp>" in name
            or not code.co_argcount + code.co_kwonlyargcount
        ):
            return
        arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        values = frame.f_locals
        self.methods += type(values.get("self")).__name__ == "Scene"
        if any(type(values.get(one)).__name__ == "Scene" for one in arguments if one != "self"):
            self.carried += 1
            back = frame.f_back
            while back is not None and self.place(back.f_code) is None:
                back = back.f_back
            before = self.place(back.f_code) if back is not None else None
            if before is not None and before[0] != module:
                self.modules += 1
                self.rooms += before[0].split(".")[0] != module.split(".")[0]

    def result(self) -> dict[str, Any]:
        distinct = len(self.keys)
        called = {"run_key": sum(self.keys.values()), "distinct": distinct, "misses": self.misses}
        changes = {"methods": self.methods, "carried": self.carried, "modules": self.modules, "rooms": self.rooms}
        return {**called, **changes, "by_name": dict(self.by_name.most_common())}


def main() -> None:
    """Run the command, and write what was counted, also where it ends by an exit code."""
    target, counted, words = sys.argv[1], sys.argv[2] == "1", sys.argv[3:]
    import numba  # noqa: F401  # otherwise small kernels are interpreted, and their calls are counted

    import dem_bridge
    from dem_bridge.cli import command

    calls = Calls(str(Path(dem_bridge.__file__).parent) + os.sep)
    sys.argv = ["dem-bridge", *words]
    if counted:
        threading.setprofile(calls)
        sys.setprofile(calls)
    try:
        command()
    except SystemExit as end:
        code = end.code
    else:
        code = 0
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cpu = sum(one.ru_utime + one.ru_stime for one in used)
    Path(target).write_text(json.dumps({**calls.result(), "exit": code, "cpu": cpu}), encoding="utf-8")


if __name__ == "__main__":
    main()
