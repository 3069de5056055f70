"""The command line ``dem-bridge``."""

from __future__ import annotations

import gc
import signal
from typing import Any

__all__ = ["command", "main"]


def command() -> None:
    """Run the command line as a program; Ctrl-C ends it without a traceback while its modules are imported, too.

    The search for garbage begins after half a million objects. A command that is done within a second makes fewer, and
    one search among them takes 0.04 s.
    """
    gc.set_threshold(500_000)
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from dem_bridge.cli.group import command as begin

    signal.signal(signal.SIGINT, handler)
    begin()


def __getattr__(name: str) -> Any:
    if name != "main":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from dem_bridge.cli.group import main

    return main
