"""Name temporary files after the process that writes them, and remove those whose process is dead.

A process that is killed cannot remove its own files. The next one on the same machine does it when it begins.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import gettempdir

#: machine and its space of process ids, process id, and time of its start in ticks, in hexadecimal digits
_OWNER = re.compile(r"-([0-9a-f]{8})-([0-9a-f]+)-([0-9a-f]+)-")

#: suffix of a link that names its process by its target
LOCK = ".lock"
#: s
_JUST_MADE = 1.0
#: folder of shared memory on Linux
SHARED_MEMORY = Path("/dev/shm")


def owned(prefix: str) -> str:
    """Return the beginning of a name that says which process the file belongs to.

    >>> is_left_behind(owned("part") + "x")
    False
    """
    return f"{prefix}-{_machine()}-{os.getpid():x}-{started(os.getpid()):x}-"


def is_left_behind(name: str) -> bool:
    """Return True for a name of :func:`owned` whose process has ended; False for others and other machines."""
    owner = _OWNER.search(name)
    return owner is not None and owner[1] == _machine() and started(int(owner[2], 16)) != int(owner[3], 16)


@cache
def sweep(folder: Path) -> None:
    """Remove the files and folders in ``folder`` that dead processes left behind, once in the life of this process."""
    names = []
    with suppress(OSError):
        names = os.listdir(folder)
    for path in (folder / name for name in names):
        with suppress(OSError):  # another process was here, or it is of another user
            if not is_left_behind(os.readlink(path) if path.suffix == LOCK else path.name):
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


@cache
def sweep_temporary() -> None:
    """Remove temporary folders and shared memory of MPICH that dead processes left behind, once in a process."""
    with suppress(FileNotFoundError):  # no folder for temporary files can be written
        sweep(Path(gettempdir()))
    remove_unmapped(SHARED_MEMORY, "mpich_shm_*")


def remove_unmapped(folder: Path, pattern: str) -> None:
    """Remove files of this user that no process maps; those of the last second stay, for they may be mapped soon."""
    files = []
    for path in folder.glob(pattern):
        with suppress(OSError):  # another process was here
            about = path.stat()
            # a file from the future is old: the clock was set back
            if about.st_uid == os.geteuid() and abs(time.time() - about.st_mtime) > _JUST_MADE:
                files.append(path)
    if files:
        mapped = set[str]()
        for maps in Path("/proc").glob("[0-9]*/maps"):
            with suppress(OSError):  # a process that has ended, or of another user
                mapped |= {line.split()[-1] for line in maps.read_text().splitlines() if str(folder) in line}
        for path in files:
            if str(path) not in mapped:
                with suppress(OSError):
                    path.unlink()


def started(pid: int) -> int:
    """Return when a process was started, in ticks since the machine was; 0 if it has ended."""
    try:
        state, *fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    return 0 if state == "Z" else int(fields[18])


@cache
def _machine() -> str:
    """Return eight digits for the machine and the space in which its process ids count, such as a container."""
    space = os.stat("/proc/self/ns/pid").st_ino
    return hashlib.sha256(f"{platform.node()} {space}".encode()).hexdigest()[:8]
