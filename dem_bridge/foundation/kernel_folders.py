"""Find the folders of compiled kernels, and keep them safe: nothing is loaded that another user could have written.

Kernels are machine code with pickled objects, so whoever can write one can run code as the user who loads it. They are
therefore kept in a folder of each user, ``kernels-UID``, which that user owns and no other user can write. The folders
of this user and of root, who could have installed the package with its kernels, are read.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from dem_bridge.foundation.files import opened
from dem_bridge.foundation.leftovers import owned, sweep, sweep_temporary

#: names the folder that is tried first, as it does for numba
VARIABLE = "NUMBA_CACHE_DIR"
#: ends of the names of a kernel, and of one that was set aside
SUFFIX, DAMAGED = ".nbc", ".damaged"
#: largest size of a file of a kernel
MOST_BYTES = 2**28
#: files that a folder may have: those that were not used for the longest time are removed
MOST_FILES = 1_000
ADVICE = f"set {VARIABLE} to a folder that you can write"
PACKAGE = Path(__file__).parents[1]
#: bits of a mode that let another user write
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def roots() -> tuple[Path, ...]:
    """Return the folders in which kernels may be kept, in the order in which they are tried."""
    named = os.environ.get(VARIABLE, "")
    cache_home = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not cache_home.is_absolute():
        cache_home = Path(os.path.expanduser("~/.cache"))
    places = [*([Path(os.path.abspath(named))] if named else []), PACKAGE / "__pycache__", cache_home / "dem-bridge"]
    return tuple(place for place in places if place.is_absolute())  # a user without a home has none


def folder_in(root: Path, user: int | None = None) -> Path:
    """Return the folder of the kernels of a user, by default of this one."""
    return root / f"kernels-{os.geteuid() if user is None else user}"


def lasting_folder() -> tuple[Path | None, str]:
    """Return the folder in which kernels last, None if there is none, and why each root before it cannot be used."""
    faults: list[str] = []
    for root in roots():
        if not (fault := write_fault(folder_in(root))):
            return folder_in(root), "; ".join(faults)
        faults.append(f"{root} ({fault})")
    return None, "; ".join(faults)


@cache
def folder_to_write() -> Path | None:
    """Return the folder to which kernels are written; None: they are not kept.

    If none of the :func:`roots` can be written, it is a temporary folder that is removed when this process ends, and a
    line on stderr says so. Processes that this one starts use the same folder.
    """
    folder, faults = lasting_folder()
    if folder is not None:
        return folder
    say(f"compiled kernels are not kept, because no folder for them can be written: {faults}; {ADVICE}")
    try:
        sweep_temporary()
        temporary = Path(tempfile.mkdtemp(prefix=owned("dem-bridge-kernels")))
        folder_in(temporary).mkdir(mode=0o700)
    except OSError:
        return None
    atexit.register(remove_own, temporary, os.getpid())
    os.environ[VARIABLE] = str(temporary)
    return folder_in(temporary)


def existing_folders() -> tuple[Path, ...]:
    """Return the safe folders with kernels of this user and of root, up to the first root that can be written.

    Those before it may only be read, such as the folder of a package that root has installed with its kernels.
    """
    lasting, _ = lasting_folder()
    folders = list[Path]()
    for root in roots():
        folders += [folder_in(root, user) for user in (os.geteuid(), 0)]
        if lasting == folder_in(root):
            break
    return tuple(dict.fromkeys(folder for folder in folders if is_safe(folder)))


@cache
def folders_to_read() -> tuple[Path, ...]:
    """Return the folders from which kernels are loaded, in the order in which they are searched."""
    own = folder_to_write()
    return tuple(dict.fromkeys([*([own] if own else []), *existing_folders()]))


def is_safe(path: Path | int) -> bool:
    """Return True for a file or folder that this user or root owns, and that no other user can write."""
    try:
        about = os.stat(path)
    except OSError:
        return False
    return about.st_uid in (os.geteuid(), 0) and not about.st_mode & _OTHERS_WRITE


def say(text: str) -> None:
    """Print a line on stderr."""
    with suppress(AttributeError, OSError, ValueError):  # there is no stderr, or nobody reads it any more
        print(f"dem-bridge: {' '.join(text.split())}", file=sys.stderr, flush=True)


def write_fault(folder: Path) -> str:
    """Create a folder; return why it cannot be used, '' if it can."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o755, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return error.strerror or type(error).__name__
    return "" if is_safe(folder) else "another user can write to it"


def remove_own(folder: Path, process: int) -> None:
    """Remove a temporary folder, unless this process is a copy of the one that made it."""
    if os.getpid() == process:  # a copy of this process still uses it
        shutil.rmtree(folder, ignore_errors=True)


def checksum(name: str, content: bytes) -> bytes:
    """Return the first line of a file: the sha256 of its name and content."""
    return hashlib.sha256(name.encode() + b"\n" + content).hexdigest().encode() + b"\n"


def checked(name: str, whole: bytes) -> bytes:
    """Return the content of a file; ValueError unless it is as it was written, and under this name."""
    line, _, content = whole.partition(b"\n")
    if line + b"\n" != checksum(name, content):
        raise ValueError("its checksum does not fit")
    return content


def kept_content(path: Path) -> bytes:
    """Return the content of a file of code; OSError or ValueError unless it is there, safe and undamaged."""
    with opened(path, MOST_BYTES) as file:
        if not is_safe(file.fileno()):
            raise ValueError("another user can write to it")
        return checked(path.name, file.read())


def write_kept(path: Path, content: bytes) -> None:
    """Write a file of code as a whole, and remove files of its folder beyond the permitted number; OSError if not."""
    sweep(path.parent)
    part = path.with_name(f"{owned('part')}{os.urandom(4).hex()}")
    try:
        with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644), "wb") as file:
            file.write(checksum(path.name, content) + content)
        part.replace(path)
        _prune(path.parent)
    except OSError:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def _prune(folder: Path) -> None:
    """Remove the files beyond the permitted number that were not used for the longest time."""
    files = []
    for entry in os.scandir(folder):
        with suppress(FileNotFoundError):  # another process was here
            files.append((entry.stat(follow_symlinks=False).st_mtime_ns, entry.path))
    for _, path in sorted(files)[: max(0, len(files) - MOST_FILES)]:
        with suppress(OSError):
            os.unlink(path)


def damaged_files(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the names of files in a folder of kernels that were set aside or are damaged, each with the reason."""
    for path in sorted(folder.glob("*")):
        if path.name.endswith(DAMAGED):
            yield path.name, "set aside"
        elif path.suffix == SUFFIX:
            try:
                with opened(path, MOST_BYTES) as file:
                    checked(path.name, file.read())
                if not is_safe(path):
                    yield path.name, "another user can write to it"
            except OSError as error:
                yield path.name, error.strerror or type(error).__name__
            except ValueError as error:
                yield path.name, str(error)
