"""Whether processes have ended; an orphan that nobody has buried yet has."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path


def gone(pids: Iterable[int], within: float = 10.0) -> bool:
    """Whether all of them end within so many seconds: what is killed takes a moment."""
    left, end = list(pids), time.monotonic() + within
    while left := [pid for pid in left if _alive(pid)]:
        if time.monotonic() >= end:
            return False
        time.sleep(0.02)
    return True


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
