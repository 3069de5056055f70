"""Recognise a text as a LAMMPS input script."""

from __future__ import annotations

import re

_STYLES = "index|loop|string|equal|atom|atomfile|format|internal|delete|universe|world|uloop|getenv|file|vector"
#: a line that begins as a command of LAMMPS, and not as an entry of TOML
_COMMAND = re.compile(
    rf"""^[ \t]*(?!\w+[ \t]*=)(?:
    (?:units|atom_style|pair_style|bond_style|run_style|pair_coeff|read_data|read_restart|create_box|create_atoms
       |timestep|thermo|thermo_style|thermo_modify|neighbor|neigh_modify|comm_modify|newton|dimension|lattice|run|include
       |unfix|dump|compute|reset_timestep|hard_particles|communicate|atom_modify)[ \t]+\S
    |boundary[ \t]+[pfsm]{{1,2}}[ \t] |(?:fix|region|velocity|mass)[ \t]+\S+[ \t]+\S |group[ \t]+\S+[ \t]+[a-z]
    |variable[ \t]+\w+[ \t]+(?:{_STYLES})\b |set[ \t]+(?:atom|type|group|region)\b |jump[ \t]+SELF )""",
    re.MULTILINE | re.VERBOSE,
)


def is_script(text: str) -> bool:
    r"""Return True if a line of a text begins as a command of LAMMPS.

    >>> is_script("# a chain\nunits si"), is_script("velocity = 0.5"), is_script("velocity all set 0.5")
    (True, False, True)
    """
    return _COMMAND.search(text) is not None
