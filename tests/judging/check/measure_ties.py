"""Plant ties into scripts and count those that are found, and those that are found where none is.

    python -m tests.judging.check.measure_ties 1000

Half of the scripts have a planted tie. The table has a line for each kind of moment.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

from dem_bridge.judging.check.ties import Tie, ties_of
from dem_bridge.judging.deck import user_deck
from tests.judging.check.tie_decks import KINDS, TieDeck, tie_deck

#: names of planted moments that the answer calls otherwise
_NAMES = {"wall touch": "touch", "later touch": "touch"}


def ties_found(deck: TieDeck) -> tuple[Tie, ...]:
    """Return the ties of a script that a check finds."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "in.tie")
        path.write_text(deck.text)
        ties, why = ties_of(user_deck(path))
    if why:
        raise ValueError(f"{why}\n{deck.text}")
    return ties


def is_found(deck: TieDeck, ties: tuple[Tie, ...]) -> bool:
    """Return True if the planted tie is among those that were found, at its step."""
    kind = _NAMES.get(deck.kind, deck.kind)
    return any(
        tie.kind == kind and abs(tie.step - deck.step) <= (1 if kind in ("graze", "simultaneous touches") else 0)
        for tie in ties
    )


def measure(count: int) -> tuple[Counter[str], Counter[str], list[str]]:
    """Return the numbers of found ties by kind, of ties where none is, and the scripts with wrong answers."""
    found, false, wrong = Counter[str](), Counter[str](), list[str]()
    for number in range(count // 2):
        for planted in (True, False):
            deck = tie_deck(number, planted=planted)
            ties = ties_found(deck)
            if planted:
                found[deck.kind] += is_found(deck, ties)
            else:
                false[deck.kind] += bool(ties)
            if planted != (is_found(deck, ties) if planted else bool(ties)):
                wrong.append(
                    f"{number} {deck.kind} planted={planted} step={deck.step}: {[(t.kind, t.step) for t in ties]}"
                )
    return found, false, wrong


if __name__ == "__main__":
    many = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    hits, misses, scripts = measure(many)
    tried = Counter(KINDS[number % len(KINDS)] for number in range(many // 2))
    for name in KINDS:
        print(
            f"{name:22s} planted {tried[name]:4d} found {hits[name]:4d};"
            f" without {tried[name]:4d} found {misses[name]:4d}"
        )
    print(f"planted {many // 2}, found {sum(hits.values())}; without {many // 2}, found {sum(misses.values())}")
    print(*scripts, sep="\n")
