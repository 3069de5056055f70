"""Seams: the places of the package at which tests plant a fault or imitate a machine, each with one name and address.

A test names a seam, and not the module in which a name happens to be looked up: when a module moves, its line here
follows.
"""

from __future__ import annotations

from enum import StrEnum

import pytest


class Seam(StrEnum):
    """Names of seams; the value is the address of what a test replaces."""

    # judging: the steps from records to a judgement
    FILE_ERRORS = "dem_bridge.judging.judgement.file_errors"
    DIAGNOSE = "dem_bridge.judging.judgement.diagnose"
    CONVERGENCE = "dem_bridge.judging.judgement.convergence"
    MOST_VALUES = "dem_bridge.judging.judgement.MOST_VALUES"


def plant(monkeypatch: pytest.MonkeyPatch, seam: Seam, value: object) -> None:
    """Replace what is at a seam for the rest of a test; AttributeError if nothing is there any more."""
    monkeypatch.setattr(str(seam), value)
