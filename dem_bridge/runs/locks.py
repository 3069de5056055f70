"""Locks: marks in a store which say that a process is at a run, so that no other makes the same run.

A lock is advice. One that cannot be made, that is ignored or that is taken over costs a run that is made twice, and no
result. It is a symbolic link whose target names the process: the file system makes it as a whole or not at all, also on
a network, and no file is locked.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dem_bridge.foundation.leftovers import LOCK, is_left_behind, owned

#: a lock counts for this time, s, and this factor times the expected time of its run
_MARGIN, _FACTOR = 60.0, 10.0
#: s between two looks at a lock that is waited for
_POLL = 0.05


@contextmanager
def locked(folder: Path, key: str, expected: float) -> Iterator[bool]:
    """Lock the run of a key within this context; yield False if another process is at it.

    Parameters
    ----------
    folder : Path
        Folder of the store.
    key : str
        Key of the run.
    expected : float
        Time that the run is expected to take, s.
    """
    path, owner = folder / f"{key}{LOCK}", f"{owned('lock')}{os.urandom(4).hex()}"
    free = _link(owner, path)
    if not free and (free := not is_held(path, expected)):
        # two that take the lock over at the same moment make the same run
        part = path.with_name(f"{owner}.part")
        if _link(owner, part):
            with suppress(OSError):
                part.replace(path)
    try:
        yield free
    finally:
        with suppress(OSError):
            if free and os.readlink(path) == owner:
                path.unlink()


def is_held(path: Path, expected: float) -> bool:
    """Return True if a lock is that of a living process, as far as this machine can know, and no older than its time.

    A lock from the future is old: the clock was set back, or another machine has another time.
    """
    try:
        age = abs(time.time() - path.lstat().st_mtime)
        return age < _MARGIN + _FACTOR * expected and not is_left_behind(os.readlink(path))
    except OSError:  # it has been released
        return False


def wait_for_release(folder: Path, key: str, expected: float, at_most: float) -> None:
    """Wait until the run of a key is no longer locked, ``at_most`` so many s."""
    end = time.monotonic() + at_most
    while is_held(folder / f"{key}{LOCK}", expected) and time.monotonic() < end:
        time.sleep(_POLL)


def _link(owner: str, path: Path) -> bool:
    """Make a link; False if there is a file of this name; True, too, where links cannot be made."""
    try:
        path.symlink_to(owner)
    except FileExistsError:
        return False
    except OSError:
        pass
    return True
