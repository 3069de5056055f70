"""Become another program that ends with the parent: ``python leash.py COMMAND ...``. A script of its own, standard
library alone: what it asks of the kernel outlives the change of program, and asking from within a fork of a process
with threads would not be safe.
"""

import ctypes
import os
import signal
import sys


def main() -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    os.execv(sys.argv[1], sys.argv[1:])


if __name__ == "__main__":
    main()
