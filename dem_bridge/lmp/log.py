"""Reading what a LAMMPS binary says of itself: its log and the answer to ``-help``. Text in, values out."""

from __future__ import annotations

import re
from datetime import datetime

from dem_bridge.lmp.engine import STYLES, Build


def build(text: str) -> Build | None:
    """What ``lmp -help`` says; None where this is no LAMMPS.

    >>> found = build('''Large-scale Atomic/Molecular Massively Parallel Simulator - 22 Jul 2025 - Update 4
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
    >>> found.version, found.packages, found.lines
    (20250722, ('GRANULAR', 'OPT'), ('Compiler: GNU C++ 14.2.1 with OpenMP 4.5', 'MPI v5.0: MPICH Version: 5.0.2'))
    >>> [style for style, there in found.styles.items() if there]
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
    """LAMMPS' number of a release from its date; 0 where there is none.

    >>> version("LAMMPS (29 Aug 2024 - Update 3)")
    20240829
    """
    found = re.search(r"\b(\d{1,2} [A-Z][a-z]{2} \d{4})\b", text)
    return int(datetime.strptime(found[1], "%d %b %Y").strftime("%Y%m%d")) if found else 0


def error(log: str) -> str:
    """LAMMPS' last error in a log, with the line of the deck where it says so; '' where there is none.

    >>> error("ERROR: Unknown command: frob (src/input.cpp:1)\\nLast input line: frob 1\\n")
    'ERROR: Unknown command: frob (src/input.cpp:1) Last input line: frob 1'
    """
    # "lost atoms" and the like are said once per rank: the last is the one that ended the run
    found = re.findall(r"^ERROR(?: on proc \d+)?: .*(?:\n(?!ERROR).*)?$", log, flags=re.MULTILINE)
    return " ".join(found[-1].split()) if found else ""


def ranks(log: str) -> int:
    """On how many ranks a log's last run was; 0 where it has none.

    >>> ranks("34.4% CPU use with 2 MPI tasks x 1 OpenMP threads")
    2
    """
    # "Loop time of ... on N procs" counts threads too
    found = re.findall(r"% CPU use with (\d+) MPI tasks", log)
    return int(found[-1]) if found else 0


def loop_time(text: str) -> float:
    """Seconds that the time steps of all runs in a log took; 0 where none came to its end.

    >>> loop_time("Loop time of 0.5 on 1 procs for 100 steps with 3 atoms")
    0.5
    """
    return sum(float(found) for found in re.findall(r"^Loop time of (\S+) on", text, re.MULTILINE))


def potential_energy(text: str) -> dict[int, float]:
    """Step -> potential energy (J) in the columns step, time, pe, ke, etotal of a log.

    >>> potential_energy("      1000  2e-05 0.0014 0.0011 0.0025")
    {1000: 0.0014}
    """
    number = r"[-+]?\d\S*"
    found = re.findall(rf"^ *(\d+) +{number} +({number}) +{number} +{number} *$", text, flags=re.MULTILINE)
    return {int(step): float(energy) for step, energy in found}


def pair_style(text: str) -> str:
    """The pair style that a log's neighbour lists serve, with its suffix if it has one; '' where there is none.

    >>> pair_style("  (1) pair gran/hertz/history/omp, perpetual")
    'gran/hertz/history/omp'
    """
    found = re.findall(r"^ *\(\d+\) pair (\S+?)(?:,|$)", text, flags=re.MULTILINE)
    return found[-1] if found else ""


def _words(text: str, heading: str) -> frozenset[str]:
    """What stands between a heading and the next."""
    found = re.search(rf"^{heading}\s*\n(.*?)(?=^\*|^List of|\Z)", text, flags=re.MULTILINE | re.DOTALL)
    return frozenset(found[1].split()) if found else frozenset()
