"""Script that becomes another program which ends with its parent: ``python parent_death_guard.py COMMAND ...``.

It is a separate script that uses the standard library alone. Its request to the kernel remains valid when the process
executes the other program. To make the request in a fork of a process with threads would not be safe.
"""

import ctypes
import os
import signal
import sys


def main() -> None:
    """Request to be killed when the parent ends, and execute the command."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    os.execv(sys.argv[1], sys.argv[1:])


if __name__ == "__main__":
    main()
