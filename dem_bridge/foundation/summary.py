"""Print the values that public functions return: at most 15 lines, the answer first."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Sequence

#: largest number of lines of a value, and the width at which sentences are wrapped
MOST_LINES, WIDTH = 15, 88


def summary(answer: Iterable[str], facts: Sequence[str] = (), *, title: str = "") -> str:
    """Return at most 15 lines: a title, sentences as far as there is room, and all facts.

    Parameters
    ----------
    answer : iterable of str
        Sentences, the most important first; they are wrapped, and cut where there is no room for more.
    facts : sequence of str
        Short lines that stand below in any case, such as where the rest is.
    title : str
        First line.

    Examples
    --------
    >>> print(summary(["The error is 1e-6."], ["2 PASS"], title="A chain"))
    A chain
      The error is 1e-6.
      2 PASS
    >>> len(summary(["word " * 1000], ["tables: a"]).splitlines())
    15
    """
    lines = [title] if title else []
    below = [f"  {fact}" if len(fact) <= WIDTH - 2 else f"  {fact[: WIDTH - 6]} ..." for fact in facts]
    room = MOST_LINES - len(lines) - len(below)
    wrapped = [
        line for text in answer for line in textwrap.wrap(text, WIDTH, initial_indent="  ", subsequent_indent="  ")
    ]
    if len(wrapped) > room:
        wrapped[room - 1 :] = [f"{wrapped[room - 1][: WIDTH - 4]} ..."]
    return "\n".join([*lines, *wrapped, *below])


def counted(words: Iterable[str]) -> str:
    """Return how often each word occurs, the most frequent first.

    >>> counted(["PASS", "FAIL", "PASS"])
    '2 PASS, 1 FAIL'
    """
    return ", ".join(f"{count} {word}" for word, count in Counter(words).most_common())
