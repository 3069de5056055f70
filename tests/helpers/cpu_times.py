"""List the tests that take the most CPU time, that of the processes that they start included.

``python -m pytest -n0 -p tests.helpers.cpu_times -m "not slow"`` prints the 20 first and the sum of each folder. What a
fixture costs counts for the test that needs it first.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import pytest

from tests.bench.timing import cpu_seconds

#: tests that are listed
COUNT = 20
_seconds: dict[str, float] = {}


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Keep the CPU time of one test, s."""
    began = cpu_seconds()
    result = yield
    _seconds[item.nodeid] = cpu_seconds() - began
    return result


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the times."""
    folders: dict[str, float] = {}
    for name, seconds in _seconds.items():
        folder = "/".join(name.split("::")[0].split("/")[:2])
        folders[folder] = folders.get(folder, 0.0) + seconds
    terminalreporter.section("CPU time, s")
    for times, count in ((folders, None), (_seconds, COUNT)):
        for name, seconds in sorted(times.items(), key=lambda pair: -pair[1])[:count]:
            terminalreporter.write_line(f"{seconds:8.1f} {name}")
