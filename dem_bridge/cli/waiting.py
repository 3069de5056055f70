"""Show on stderr what a command does while it lasts: kernels that are compiled, a bar of progress, an end in order."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from dem_bridge.foundation.progress import Campaign

#: time between two lines on the progress where stderr is no terminal, s
SECONDS_BETWEEN_LINES = 30.0
#: what a first Ctrl-C prints
_IN_ORDER = (
    b"dem-bridge: interrupted: the runs that have begun are finished and kept, and no other begins;"
    b" press Ctrl-C again to stop at once\n"
)


def announce_compiling(kernel: str = "dem_bridge.", *, silent: bool = False) -> None:
    """Print on stderr that kernels are compiled first; nothing where one is on disk whose name has ``kernel``."""
    from dem_bridge.foundation.kernel_folders import folders_to_read

    if not silent and not any(next(folder.glob(f"*{kernel}*"), None) for folder in folders_to_read()):
        click.echo("dem-bridge: kernels are compiled first, once on this machine: up to a minute", err=True)


class Meter:
    """The progress of a command: the fraction of the work that is done, and the state of the present campaign."""

    def __init__(self, show: Callable[[Meter], None]) -> None:
        self.show, self.fraction, self.label = show, 0.0, ""
        self.state: Campaign | None = None
        self.rate: float | None = None
        """Runs per second that the present campaign has made."""
        self._began = self._campaign_began = time.monotonic()
        self._stored = 0

    def advance(self, done: float, total: int, label: str) -> None:
        """Note the fraction that is done; the callback of a command."""
        self.fraction, self.label = done / total if total else 1.0, label
        self.show(self)

    def watch(self, state: Campaign) -> None:
        """Note the state of a campaign."""
        if state is not self.state:
            self.state, self._stored, self._campaign_began = state, state.done, time.monotonic()
        computed = state.done - self._stored
        self.rate = computed / (time.monotonic() - self._campaign_began) if computed else None
        self.show(self)

    @property
    def text(self) -> str:
        """The state in a line: runs, their rate, failures, and what is running."""
        if self.state is None:
            return self.label
        rate = f", {self.rate:.3g}/s" if self.rate else ""
        words = f"{self.state.done}/{self.state.total} runs{rate}, {self.state.failures} failed"
        return f"{words}: {'; '.join(self.state.running) or self.label}"

    @property
    def elapsed(self) -> str:
        """Minutes and seconds since the start, and the fraction that is done if it is known."""
        minutes, seconds = divmod(round(time.monotonic() - self._began), 60)
        return f"{minutes} min {seconds:02} s" + (f", {100.0 * self.fraction:.0f} %" if self.fraction else "")

    def as_json(self) -> dict[str, Any]:
        """Return the state for a program."""
        seconds, state = time.monotonic() - self._began, self.state
        return {
            "done": state.done if state else None,
            "total": state.total if state else None,
            "fraction": round(self.fraction, 6),
            "rate": self.rate,
            "eta": seconds * (1.0 - self.fraction) / self.fraction if self.fraction else None,
            "failures": state.failures if state else 0,
            "running": list(state.running if state else ()) or [self.label] * bool(self.label),
        }


@contextmanager
def bar(as_json: bool = False, label: str = "") -> Iterator[Callable[[float, int, str], None] | None]:
    """Yield the callback of a progress bar with the remaining time on a terminal; elsewhere print a line each 30 s.

    ``as_json``: a line of JSON on stderr in place of the bar, whenever the state has changed. ``label``: what is shown
    until the first call.
    """
    if as_json:
        with _metered(Meter(_print_state)) as progress:
            yield progress
        return
    if not sys.stderr.isatty():
        meter = Meter(lambda meter: None)
        meter.label = label
        with _metered(meter) as progress, _repeated(meter):
            yield progress
        return
    # the import of rich takes a tenth of a second or two: words are shown before it
    words = (label or "begins")[: shutil.get_terminal_size().columns - 1]
    print(words, end="", file=sys.stderr, flush=True)
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.table import Column

    parts = (
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("ETA"),
        TimeRemainingColumn(),
        TextColumn("{task.description}", table_column=Column(no_wrap=True, overflow="ellipsis")),
    )
    print(f"\r{' ' * len(words)}\r", end="", file=sys.stderr, flush=True)
    with Progress(*parts, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(escape(label), total=1.0)
        bars.refresh()
        meter = Meter(lambda meter: bars.update(task, completed=meter.fraction, description=escape(meter.text)))
        with _metered(meter) as progress:
            yield progress


@contextmanager
def _metered(meter: Meter) -> Iterator[Callable[[float, int, str], None]]:
    """Let a meter watch all campaigns, and yield its callback."""
    from dem_bridge.foundation.progress import watching

    with watching(meter.watch):
        yield meter.advance


@contextmanager
def _repeated(meter: Meter) -> Iterator[None]:
    """Print the state on stderr each 30 s, also while one run lasts longer, so that a log shows what runs."""
    done = threading.Event()

    def repeat() -> None:
        while not done.wait(SECONDS_BETWEEN_LINES):
            print(f"dem-bridge: {meter.elapsed}: {meter.text}", file=sys.stderr, flush=True)

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def _print_state(meter: Meter) -> None:
    """Print the state as a line of JSON on stderr."""
    print(json.dumps(meter.as_json()), file=sys.stderr, flush=True)


@contextmanager
def ending_in_order() -> Iterator[None]:
    """Let a first Ctrl-C end a campaign when the runs that have begun are done; a second stops at once."""
    from dem_bridge.foundation.progress import request_stop, withdraw_stop

    def interrupt(*_: object) -> None:
        if not request_stop():
            raise KeyboardInterrupt
        os.write(2, _IN_ORDER)  # the buffer of stderr may be in use

    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:  # ignored, or somebody else's
        yield
        return
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        withdraw_stop()


@contextmanager
def fraction(label: str) -> Iterator[None]:
    """Show the progress of one run, as :func:`bar`."""
    from dem_bridge.foundation.progress import listening

    with bar(label=label) as progress:
        if progress is None:
            yield
            return
        progress(0.0, 1, label)
        with listening(lambda part: progress(part, 1, label)):
            yield
