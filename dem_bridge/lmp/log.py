"""Reading of a LAMMPS log and of the answer to ``-help``: text to values."""

from __future__ import annotations

import re
from datetime import datetime

from dem_bridge.lmp.engine import STYLES, Build


def build(text: str) -> Build | None:
    """Return what ``lmp -help`` reports, or None if the text is not from LAMMPS.

    Examples
    --------
    >>> lammps = build('''Large-scale Atomic/Molecular Massively Parallel Simulator - 22 Jul 2025 - Update 4
    ...
    ... Compiler: GNU C++ 14.2.1 with OpenMP 4.5
    ... MPI v5.0: MPICH Version: 5.0.2
    ... Installed packages:
    ...
    ... GRANULAR
    ... OPT
    ...
    ... * Pair styles:
    ...
    ... granular        table
    ...
    ... ''')
    >>> lammps.version, lammps.packages, lammps.lines
    (20250722, ('GRANULAR', 'OPT'), ('Compiler: GNU C++ 14.2.1 with OpenMP 4.5', 'MPI v5.0: MPICH Version: 5.0.2'))
    >>> [style for style, available in lammps.styles.items() if available]
    ['pair granular', 'pair table']
    """
    first = re.search(r"Massively Parallel Simulator - (.+)", text)
    number = first and version(first[1])
    if not number:
        return None
    lines = re.findall(r"^(?:Compiler|MPI v).*\S", text, flags=re.MULTILINE)
    listed = {kind: _words(text, rf"\* {kind.capitalize()} styles:?") for kind in ("pair", "fix")}
    return Build(
        version=number,
        packages=tuple(sorted(_words(text, "Installed packages:"))),
        lines=tuple(" ".join(line.split()) for line in lines),
        styles={style: style.split()[1] in listed[style.split()[0]] for style in STYLES},
    )


def version(text: str) -> int:
    """Return LAMMPS' version number from the date of a release; 0 if there is none.

    Examples
    --------
    >>> version("LAMMPS (29 Aug 2024 - Update 3)")
    20240829
    """
    date = re.search(r"\b(\d{1,2} [A-Z][a-z]{2} \d{4})\b", text)
    return int(datetime.strptime(date[1], "%d %b %Y").strftime("%Y%m%d")) if date else 0


def error(log: str) -> str:
    r"""Return LAMMPS' last error in a log, with the line of the deck if it is stated; '' if there is none.

    Examples
    --------
    >>> error("ERROR: Unknown command: frob (src/input.cpp:1)\nLast input line: frob 1\n")
    'ERROR: Unknown command: frob (src/input.cpp:1) Last input line: frob 1'
    """
    # errors such as "lost atoms" appear once per rank: the last one ended the run
    errors = re.findall(r"^ERROR(?: on proc \d+)?: .*(?:\n(?!ERROR).*)?$", log, flags=re.MULTILINE)
    return " ".join(errors[-1].split()) if errors else ""


def ranks(log: str) -> int:
    """Return the number of ranks of a log's last run; 0 if there is no run.

    Examples
    --------
    >>> ranks("34.4% CPU use with 2 MPI tasks x 1 OpenMP threads")
    2
    """
    # the N of "Loop time of ... on N procs" includes threads
    counts = re.findall(r"% CPU use with (\d+) MPI tasks", log)
    return int(counts[-1]) if counts else 0


def loop_time(text: str) -> float:
    """Return the time that the time steps of all runs in a log took, s; 0 if no run finished.

    Examples
    --------
    >>> loop_time("Loop time of 0.5 on 1 procs for 100 steps with 3 atoms")
    0.5
    """
    return sum(float(seconds) for seconds in re.findall(r"^Loop time of (\S+) on", text, re.MULTILINE))


def energies(text: str) -> dict[int, tuple[float, float]]:
    """Return step -> potential and kinetic energy (J) from the columns step, time, pe, ke, etotal of a log.

    Examples
    --------
    >>> energies("      1000  2e-05 0.0014 0.0011 0.0025")
    {1000: (0.0014, 0.0011)}
    """
    number = r"[-+]?\d\S*"
    rows = re.findall(rf"^ *(\d+) +{number} +({number}) +({number}) +{number} *$", text, flags=re.MULTILINE)
    return {int(step): (float(potential), float(kinetic)) for step, potential, kinetic in rows}


def pair_style(text: str) -> str:
    """Return the pair style of a log's neighbour lists, with its suffix if it has one; '' if there is none.

    Examples
    --------
    >>> pair_style("  (1) pair gran/hertz/history/omp, perpetual")
    'gran/hertz/history/omp'
    """
    styles = re.findall(r"^ *\(\d+\) pair (\S+?)(?:,|$)", text, flags=re.MULTILINE)
    return styles[-1] if styles else ""


def _words(text: str, heading: str) -> frozenset[str]:
    """Return the words between a heading and the next one."""
    section = re.search(rf"^{heading}\s*\n(.*?)(?=^\*|^List of|\Z)", text, flags=re.MULTILINE | re.DOTALL)
    return frozenset(section[1].split()) if section else frozenset()
