"""Plant faults in decks, so that LAMMPS itself commits them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from dem_bridge.backends import lammps
from dem_bridge.lmp.deck import Deck, deck_of
from dem_bridge.runs.campaign import Result, run_case
from dem_bridge.runs.case import Case

#: a deck -> the files that are run in its place
Change = Callable[[Deck], dict[str, str]]


def substituted(
    pattern: str, new: str | Callable[[re.Match[str]], str], *, places: int = 1, data: bool = False
) -> Change:
    """Return a change of the places in the deck (or its data file) where the pattern fits."""

    def change(deck: Deck) -> dict[str, str]:
        file = f"data.{deck.name}" if data else deck.input_file
        text, count = re.subn(pattern, new, deck.files[file], flags=re.MULTILINE)
        assert count == places, f"{pattern!r} fits {count} places"
        return {**deck.files, file: text}

    return change


def both(first: Change, second: Change) -> Change:
    """Return both changes, one after the other."""
    return lambda deck: second(replace(deck, files=first(deck)))


def times(factor: float) -> Callable[[re.Match[str]], str]:
    """Return a replacement that multiplies the first group of a match, a number, by ``factor``."""
    return lambda match: match[0].replace(match[1], repr(float(match[1]) * factor))


def run_with(change: Change, case: Case, *, surrogate_radius: float | None = None) -> Result:
    """Run LAMMPS on the changed deck; ``surrogate_radius`` in m, None: that of the case."""

    def planted(sound: Callable[..., Deck]) -> Callable[..., Deck]:
        def deck(*of: Any, **how: Any) -> Deck:
            written = sound(*of, **how)
            return replace(written, files=change(written))

        return deck

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lammps, "deck_of", planted(deck_of))
        return run_case(replace(case, resolution=replace(case.resolution, surrogate_radius=surrogate_radius)))
