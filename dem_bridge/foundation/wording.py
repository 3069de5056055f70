"""Words of printed values: a summary of at most 15 lines, counts, and numbers in one style."""

from __future__ import annotations

import math
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


def relative_number(value: float) -> str:
    """Return a relative number with two digits: in per cent from a thousandth on, as a power of ten below.

    Examples
    --------
    >>> relative_number(0.0159), relative_number(1.834), relative_number(4.13e-5), relative_number(float("inf"))
    ('1.6 %', '183 %', '4.1e-5', 'unknown')
    """
    if not math.isfinite(value):
        return "unknown"
    if abs(value) >= 9.95e-4:
        percent = 100.0 * value
        return f"{percent:.0f} %" if abs(percent) >= 99.5 else f"{float(f'{percent:.2g}'):g} %"
    digits, power = f"{value:.1e}".split("e")
    return f"{float(digits):g}e{int(power)}" if value else "0"


def share(value: float) -> str:
    """Return a share of a whole as :func:`relative_number`, or that it is larger than the whole.

    Examples
    --------
    >>> share(0.0159), share(1e-3), share(5e-4), share(4.13e-5), share(0.0), share(7.0), share(float("nan"))
    ('1.6 %', '0.1 %', '5e-4', '4.1e-5', '0', 'more than 100 %', 'unknown')
    """
    return "more than 100 %" if value > 1.0 else relative_number(value)


def number(value: float | None) -> str:
    """Return a number with two digits, or three where it has no more.

    Examples
    --------
    >>> number(1.2512e-6), number(1.25e-6), number(5e-6), number(None)
    ('1.3e-06', '1.25e-06', '5e-06', 'unknown')
    """
    if value is None or not math.isfinite(value):
        return "unknown"
    short = float(f"{value:.2e}")
    return f"{short:g}" if math.isclose(short, value, rel_tol=1e-9) else f"{value:.2g}"


def release(version: int) -> str:
    """Return a version number of LAMMPS as its release.

    Examples
    --------
    >>> release(20250722), release(0)
    ('22 Jul 2025', 'unknown')
    """
    if not version:
        return "unknown"
    months = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
    return f"{version % 100} {months[version // 100 % 100 - 1]} {version // 10000}"
