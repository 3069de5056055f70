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
    FILE_ERRORS = "dem_bridge.judging.records.file_errors"
    DIAGNOSE = "dem_bridge.judging.records.diagnose"
    CONVERGENCE = "dem_bridge.judging.records.convergence"
    MOST_VALUES = "dem_bridge.judging.records.MOST_VALUES_OF_QUANTITY"
    # judging: the steps from a file to its cause
    SEARCH = "dem_bridge.judging.cause.Search"
    NAME_CAUSE = "dem_bridge.judging.cause.name_cause"
    OTHER_MASSES = "dem_bridge.judging.cause.other_masses"
    SHIPPED_SCENE = "dem_bridge.judging.cause.shipped_scene"
    NAME_PAIR = "dem_bridge.judging.cause.name_pair"
    ON_SINGLE_GRID = "dem_bridge.judging.cause.on_single_grid"
    STATEMENTS = "dem_bridge.judging.cause.statements"
    STEP_ERROR = "dem_bridge.judging.cause.step_error"
    # judging: runs that are made to be judged, and the decks and codes behind them
    TWIN_VELOCITY = "dem_bridge.judging.limits.Twins.velocity"
    FOREIGN_RUNS = "dem_bridge.judging.beside.foreign_runs"
    DECK_RUN = "dem_bridge.judging.beside.deck_run"
    DECK_LIMITS = "dem_bridge.judging.beside.deck_limits"
    READ_RECORD = "dem_bridge.judging.beside.read_record"
    JUDGE_RECORDS = "dem_bridge.judging.beside.judge_records"
    OWN_CODES = "dem_bridge.judging.beside.BESIDE"
    OWN_CASE = "dem_bridge.judging.beside.Case"
    OWN_BACKEND = "dem_bridge.judging.beside.backend"
    OWN_UNSUPPORTED = "dem_bridge.judging.beside.unsupported_reason"
    OWN_REFERENCE = "dem_bridge.judging.beside.reference_at"
    USER_DECK = "dem_bridge.judging.deck.user_deck"
    READ_DECK = "dem_bridge.judging.deck.read_deck"
    DECK_DIFFERENCES = "dem_bridge.judging.deck.differences"
    RUN_DECK = "dem_bridge.judging.deck.run_deck"
    RUN_PROGRAM = "dem_bridge.judging.foreign.run_program"
    PRESCAN = "dem_bridge.judging.foreign.prescan_hertz"
    # verification: what the modules of a backend import
    IMPORTED_MODULES = "dem_bridge.verification.independence.imported_modules"


def plant(monkeypatch: pytest.MonkeyPatch, seam: Seam, value: object) -> None:
    """Replace what is at a seam for the rest of a test; AttributeError if nothing is there any more."""
    monkeypatch.setattr(str(seam), value)
