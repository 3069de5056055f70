"""Script of the child process of :mod:`.isolated`: ``python isolated_child.py SYS_PATH_AS_JSON BYTES_OF_MEMORY``.

Each line of its input is a list in JSON: module, function, path, settings and seconds of CPU time. The answer is a
pickle after its length in 8 bytes: True and the result, or False and a sentence. It imports nothing from dem_bridge.
"""

from __future__ import annotations

import importlib
import json
import os
import pickle
import resource
import signal
import sys
from typing import Any


def answer(module: str, function: str, path: str, settings: dict[str, Any]) -> tuple[bool, Any]:
    """Return the result of a function, or the reason why there is none."""
    from pathlib import Path

    try:
        return True, getattr(importlib.import_module(module), function)(Path(path), **settings)
    except MemoryError:
        return False, "the file needs too much memory; write fewer samples"
    except Exception as error:  # libraries raise exceptions of many types for damaged files
        if type(error).__name__ == "UsageError":
            return False, str(error)
        return False, f"the file is damaged or of another kind ({' '.join(str(error).split())[:120]}); write it again"


def main() -> None:
    """Answer questions until the parent ends."""
    sys.path[:] = json.loads(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # what libraries print is no answer
        for line in sys.stdin:
            module, function, path, settings, seconds = json.loads(line)
            signal.setitimer(signal.ITIMER_PROF, seconds)  # ends this process, also within a library
            reply = answer(module, function, path, settings)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            try:
                data = pickle.dumps(reply, protocol=5)
            except MemoryError:
                data = pickle.dumps((False, "the file needs too much memory; write fewer samples"))
            out.write(len(data).to_bytes(8, "little") + data)
            out.flush()


if __name__ == "__main__":
    main()
