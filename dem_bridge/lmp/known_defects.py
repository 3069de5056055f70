"""Known defects of LAMMPS releases: results that are wrong without a message. They are in ``known_defects.toml``."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_FILE = Path(__file__).with_name("known_defects.toml")


@dataclass(frozen=True, kw_only=True)
class KnownDefect:
    """One defect of some LAMMPS releases, and what to write in a deck instead."""

    name: str
    first: int
    """Oldest release in which the defect was measured, such as 20250722."""
    last: int
    """Newest release that has the defect; 0 if no release without it was measured."""
    deck: str
    """Regular expression for the lines of a deck that meet the defect."""
    cause: str
    """Cause as the study "engine" finds it; '' for a defect that the study does not see."""
    symptom: str
    size: str
    instead: str
    """Words of a deck that avoid the defect."""
    upstream: str
    """Pull request or issue of LAMMPS; '' if none is known."""
    find: str = ""
    """Regular expression for what to replace in a line that meets the defect; '' if no line can simply be written."""
    write: str = ""
    """What to write in its place, with \\1, \\2 ... for the groups of ``find``."""

    def mended(self, line: str) -> str:
        """Return a line of a deck without the defect; the same line if it does not meet it, or cannot be mended so.

        Examples
        --------
        >>> [tsuji] = defects_of(20250722, "pair_coeff 1 1 hertz 1e9 0.5 tangential none damping tsuji")
        >>> tsuji.mended("pair_coeff 1 1 hertz 1e9 0.5 damping tsuji")
        'pair_coeff 1 1 hertz 1e9 0.5 damping coeff_restitution'
        """
        return re.sub(self.find, self.write, line) if self.find and self.met_by(line) else line

    def affects(self, version: int) -> bool:
        """Return True if a release, such as 20250722, has the defect."""
        return self.first <= version and (self.last == 0 or version <= self.last)

    def met_by(self, deck: str) -> bool:
        """Return True if the deck, without its comments, meets the defect."""
        commands = re.sub(r"&[ \t]*\n", " ", re.sub(r"#.*", "", deck))
        return re.search(self.deck, commands + "\n", re.MULTILINE) is not None

    def __str__(self) -> str:
        see = f"; see {self.upstream}" if self.upstream else ""
        return f"known defect {self.name}: {self.symptom} ({self.size}); write {self.instead}{see}"


@cache
def known_defects() -> tuple[KnownDefect, ...]:
    """Return all known defects, in the order of the file."""
    entries = tomllib.loads(_FILE.read_text(encoding="utf-8"))["defect"]
    return tuple(KnownDefect(**entry) for entry in entries)


def defects_of(version: int, deck: str | None = None) -> tuple[KnownDefect, ...]:
    """Return the known defects of a release, or those of them that a deck meets.

    Parameters
    ----------
    version : int
        Release as LAMMPS counts, such as 20250722.
    deck : str, optional
        Text of a deck. None: all defects of the release.

    Returns
    -------
    tuple of KnownDefect

    Examples
    --------
    >>> [defect.name for defect in defects_of(20250722, "pair_coeff 1 1 hertz 1e9 0.5 tangential none damping tsuji")]
    ['tsuji-prefactor']
    """
    return tuple(item for item in known_defects() if item.affects(version) and (deck is None or item.met_by(deck)))


def defects_between(old: int, new: int) -> str:
    """Return which known defects one release has and the other has not, in a phrase; '' if there are none.

    Examples
    --------
    >>> defects_between(20250722, 20260801)
    'mended: tsuji-prefactor, undamped-classic-wall, grazing-wall-energy'
    """
    was, now = ([defect.name for defect in defects_of(version)] for version in (old, new))
    parts = (("mended", was, now), ("new", now, was))
    listed = ((word, ", ".join(name for name in some if name not in other)) for word, some, other in parts)
    return "; ".join(f"{word}: {names}" for word, names in listed if names)
