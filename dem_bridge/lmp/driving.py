"""A drive as LAMMPS variables: the force on body 0 is a formula of the step, which LAMMPS evaluates in each step.

LAMMPS (2025-07-22) needs some microseconds per step for it: 6 for a sine, 11 for a table of any length, 17 for a chirp
that rises and ends. A table is in a file of its own, as one command. 5,000,000 values were read in 9 s; the only limit
is memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from dem_bridge.scene.drive import Drive

#: time, s, as a formula
_TIME = "(step*v_dt)"
#: values per line of a table
_ON_A_LINE = 4


def drive_variables(drive: Drive, file: str, duration: float) -> Iterator[str]:
    """Yield the lines that define ``v_drive`` as the force (N) at each step of ``v_dt`` s.

    ``file`` contains the values of a table. The force is one formula, except for the cells of a table: LAMMPS passes
    the value of a variable within another with 15 digits, which would limit the accuracy of a phase of many turns.
    """
    if drive.shape == "table":
        yield f"include {file}  # defines the variable drive_force, N"
        yield f"variable drive_cell  equal floor({_TIME}/{drive.interval!r})  # interval of {drive.interval!r} s"
        yield "variable drive_this  equal v_drive_cell+1  # LAMMPS counts from 1"
        yield "variable drive_next  equal v_drive_cell+2"
        fraction = f"({_TIME}/{drive.interval!r}-v_drive_cell)"
        difference = f"(v_drive_force[v_drive_next]-v_drive_force[v_drive_this])*{fraction}"
        yield f"variable drive       equal v_drive_force[v_drive_this]+{difference}  # N: {drive.words}"
        return
    assert drive.frequency is not None
    first, phase = 2.0 * math.pi * drive.frequency, math.radians(drive.phase)
    angle = f"{first!r}*{_TIME}"
    if drive.shape == "chirp":
        assert drive.last_frequency is not None
        assert drive.sweep is not None
        last = 2.0 * math.pi * drive.last_frequency
        swept = _TIME if drive.sweep >= duration else _at_most(drive.sweep)
        angle = f"({first!r}+({0.5 * (last - first) / drive.sweep!r})*{swept})*{swept}"
        if drive.sweep < duration:
            angle += f"+{last!r}*({_TIME}-{swept})"
    envelope = f"*sin({0.5 * math.pi / drive.rise!r}*{_at_most(drive.rise)})^2" if drive.rise > 0.0 else ""
    offset = f"+({phase!r})" if phase != 0.0 else ""
    yield f"variable drive       equal {drive.force!r}{envelope}*sin({angle}{offset})  # N: {drive.words}"


def _at_most(time: float) -> str:
    """Return a formula for the minimum of the current time and ``time`` (s), exact; LAMMPS has no minimum function."""
    return f"(({_TIME}<{time!r})*{_TIME}+({_TIME}>={time!r})*{time!r})"


def drive_file(drive: Drive) -> Iterator[str]:
    """Yield the lines of a table's file, one command over many lines.

    The last value is repeated, because LAMMPS reads one value beyond it at the end.
    """
    assert isinstance(drive.force, tuple)  # set in Drive.__post_init__
    words = [repr(value) for value in (*drive.force, drive.force[-1])]
    rows = [",".join(words[at : at + _ON_A_LINE]) for at in range(0, len(words), _ON_A_LINE)]
    yield "variable drive_force vector [&"
    yield from (f"{row},&" for row in rows[:-1])
    yield f"{rows[-1]}]"
