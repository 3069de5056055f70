"""Presenters are found by the name under which they are declared, and loaded when they are asked for."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import pytest

import dem_bridge as db
from dem_bridge.foundation.presenters import FIGURES_OF_RUNS, declare_presenter, presenter


def test_a_loader_is_called_when_its_presenter_is_asked_for() -> None:
    calls: list[str] = []

    def load() -> Callable[[list[int]], int]:
        calls.append("loaded")
        return len

    declare_presenter("a test", load)
    assert calls == []
    assert presenter("a test")([1, 2]) == 2
    assert calls == ["loaded"]


def test_what_is_not_declared_is_refused_with_what_is() -> None:
    with pytest.raises(db.errors.UsageError, match=rf"'sounds of runs': no loader .* declared: .*'{FIGURES_OF_RUNS}'"):
        presenter("sounds of runs")


def test_the_facade_declares_the_figures_of_runs_and_imports_them_later() -> None:
    assert presenter(FIGURES_OF_RUNS) is db.plot
    code = (
        "import sys, dem_bridge; from dem_bridge.foundation.presenters import FIGURES_OF_RUNS, presenter\n"
        "print('dem_bridge.plot' in sys.modules, presenter(FIGURES_OF_RUNS) is sys.modules['dem_bridge.plot'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
