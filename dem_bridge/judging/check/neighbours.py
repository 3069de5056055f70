"""Up to which time step a neighbour list misses no contact between two of its rebuilds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise, takewhile

from dem_bridge.foundation.wording import number
from dem_bridge.judging.check.edits import Edit
from dem_bridge.judging.deck import UserDeck
from dem_bridge.lmp.reader.evaluation import UNITS

#: a neighbour list that misses no contact
SAFE_COMMAND = "neigh_modify delay 0 every 1 check yes"
#: default skins, in the units of the script (manual, command neighbor)
_DEFAULT_SKIN = {"lj": 0.3, "si": 0.001, "cgs": 0.1, "micro": 0.1, "nano": 0.1}


@dataclass(frozen=True, kw_only=True)
class NeighbourList:
    """Skin and rebuilds of the neighbour list of a script."""

    skin: float
    """Distance beyond contact at which pairs are in the list, m."""
    steps: float
    """Steps between two rebuilds; with 1 every step is looked at."""

    def largest_step(self, speed: float) -> float:
        """Return the longest step, s, in which no contact is missed at a speed, m/s; inf if each step is looked at.

        Between two rebuilds no body may move by more than half of the skin.

        Examples
        --------
        >>> print(f"{NeighbourList(skin=1e-5, steps=10).largest_step(1.0):.3g}")
        5e-07
        >>> NeighbourList(skin=1e-5, steps=1).largest_step(1.0)
        inf
        """
        return 0.5 * self.skin / (speed * self.steps) if self.steps > 1 and speed > 0.0 else math.inf

    @property
    def words(self) -> str:
        """The list in words."""
        rebuilds = f"a rebuild in {self.steps:g} steps" if math.isfinite(self.steps) else "no rebuild"
        return f"{rebuilds}, skin {number(self.skin)} m"


def safe_edits(deck: UserDeck) -> tuple[Edit, ...]:
    """Return :data:`SAFE_COMMAND` in place of each line of a script that sets when the neighbour list is rebuilt."""
    lines = dict.fromkeys((command.file, command.line) for command in deck.commands if command.name == "neigh_modify")
    return tuple(Edit(file=file, line=line, new=SAFE_COMMAND) for file, line in lines)


def neighbour_list(deck: UserDeck) -> NeighbourList | None:
    """Return the neighbour list of the first run of a script; None if its numbers cannot be read."""
    length = UNITS.get(deck.state.units, (1.0, 1.0, 1.0))[0]
    skin, settings = _DEFAULT_SKIN.get(deck.state.units, math.nan), {"delay": "0", "every": "1", "once": "no"}
    for command in takewhile(lambda command: command.name != "run", deck.commands):
        try:
            if command.name == "neighbor":
                skin = float(command.rest[0])
            elif command.name == "neigh_modify":
                settings |= dict(pairwise(command.rest))
        except (IndexError, ValueError):
            return None
    try:
        delay, every = int(settings["delay"]), int(settings["every"])
    except ValueError:
        return None
    if every < 1 or not skin > 0.0:
        return None
    steps = math.inf if settings["once"] == "yes" else every * math.ceil(max(delay, 1) / every)
    return NeighbourList(skin=skin * length, steps=steps)
