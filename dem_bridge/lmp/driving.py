"""A drive as variables of LAMMPS: the force on body 0 as a formula of the step, which LAMMPS reads anew in each.

LAMMPS (2025-07-22) takes some microseconds for that in a step: 14 with a table, whose length costs nothing. Tables
stand in a file of their own, as one command; 100,000 values were run, and LAMMPS has no limit but memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from dem_bridge.drive import Drive

#: s
_TIME = "(step*v_dt)"
#: values on a line of a table
_ON_A_LINE = 4


def drive_variables(drive: Drive, file: str, duration: float) -> Iterator[str]:
    """Lines that make ``v_drive`` the force (N) at each step of ``v_dt`` s; ``file``: of a table's values.

    In one formula but for the cells of a table: a variable within another has 15 digits, which is no round-off of a
    phase of many turns.
    """
    if drive.shape == "table":
        yield f"include {file}  # variable drive_force, N"
        yield f"variable drive_cell  equal floor({_TIME}/{drive.interval!r})  # of {drive.interval!r} s"
        yield "variable drive_this  equal v_drive_cell+1  # LAMMPS counts from 1"
        yield "variable drive_next  equal v_drive_cell+2"
        inside = f"({_TIME}/{drive.interval!r}-v_drive_cell)"
        difference = f"(v_drive_force[v_drive_next]-v_drive_force[v_drive_this])*{inside}"
        yield f"variable drive       equal v_drive_force[v_drive_this]+{difference}  # N: {drive.words}"
        return
    assert drive.frequency is not None
    first, phase = 2.0 * math.pi * drive.frequency, math.radians(drive.phase)
    turned = f"{first!r}*{_TIME}"
    if drive.shape == "chirp":
        assert drive.last_frequency is not None
        assert drive.sweep is not None
        last = 2.0 * math.pi * drive.last_frequency
        until = _TIME if drive.sweep >= duration else _at_most(drive.sweep)
        turned = f"({first!r}+({0.5 * (last - first) / drive.sweep!r})*{until})*{until}"
        if drive.sweep < duration:
            turned += f"+{last!r}*({_TIME}-{until})"
    grown = f"*sin({0.5 * math.pi / drive.rise!r}*{_at_most(drive.rise)})^2" if drive.rise > 0.0 else ""
    behind = f"+({phase!r})" if phase != 0.0 else ""
    yield f"variable drive       equal {drive.force!r}{grown}*sin({turned}{behind})  # N: {drive.words}"


def _at_most(time: float) -> str:
    """The time until then, s; an exact minimum, which LAMMPS has not."""
    return f"(({_TIME}<{time!r})*{_TIME}+({_TIME}>={time!r})*{time!r})"


def drive_file(drive: Drive) -> Iterator[str]:
    """Lines of the file of a table: one command over many lines. The last value stands twice: at the end it is beside
    itself."""
    assert isinstance(drive.force, tuple)  # set when the drive was made
    words = [repr(value) for value in (*drive.force, drive.force[-1])]
    rows = [",".join(words[at : at + _ON_A_LINE]) for at in range(0, len(words), _ON_A_LINE)]
    yield "variable drive_force vector [&"
    yield from (f"{row},&" for row in rows[:-1])
    yield f"{rows[-1]}]"
