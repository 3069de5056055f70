"""LAMMPS input scripts as files: recognise one, and open the files that it names, of the right kind and size."""

from __future__ import annotations

import errno
import re
from collections.abc import Callable
from pathlib import Path

from dem_bridge.foundation.files import named_file, text_of_file

_STYLES = "index|loop|string|equal|atom|atomfile|format|internal|delete|universe|world|uloop|getenv|file|vector"
#: a line that begins as a command of LAMMPS, and not as an entry of TOML
_COMMAND = re.compile(
    rf"""^[ \t]*(?!\w+[ \t]*=)(?:
    (?:units|atom_style|pair_style|bond_style|run_style|pair_coeff|read_data|read_restart|create_box|create_atoms
       |timestep|thermo|thermo_style|thermo_modify|neighbor|neigh_modify|comm_modify|newton|dimension|lattice|run|include
       |unfix|dump|compute|reset_timestep|hard_particles|communicate|atom_modify)[ \t]+\S
    |boundary[ \t]+[pfsm]{{1,2}}[ \t] |(?:fix|region|velocity|mass)[ \t]+\S+[ \t]+\S |group[ \t]+\S+[ \t]+[a-z]
    |print[ \t]+["'$] |if[ \t]+["'] |(?:label|next|jump)[ \t]+\w+[ \t]*$
    |variable[ \t]+\w+[ \t]+(?:{_STYLES})\b |set[ \t]+(?:atom|type|group|region)\b |jump[ \t]+SELF )""",
    re.MULTILINE | re.VERBOSE,
)


def is_script(text: str) -> bool:
    r"""Return True if a line of a text begins as a command of LAMMPS.

    >>> is_script("# a chain\nunits si"), is_script("velocity = 0.5"), is_script("velocity all set 0.5")
    (True, False, True)
    """
    return _COMMAND.search(text) is not None


#: the number of atoms that a data file declares
_DATA = re.compile(r"^[ \t]*\d+[ \t]+atoms\b", re.MULTILINE)
#: a line of numbers without its comment
_NUMBERS = re.compile(r"[-+.\deE \t]*")


def files_of(folder: Path, files_below: str | Path | None = None) -> Callable[[str], str]:
    """Return a function that returns the text of a file by its name in a script of a folder.

    The function raises OSError, with the reason as ``strerror``, for a file that is not below ``files_below`` (as in
    :func:`dem_bridge.foundation.files.named_file`), and for one that is neither a script nor data nor numbers, so that
    no message quotes its lines.
    """

    def text_of(name: str) -> str:
        text = text_of_file(named_file(folder, name, files_below))
        numbers = all(_NUMBERS.fullmatch(line.partition("#")[0]) for line in text.splitlines())
        if not (numbers or is_script(text) or _DATA.search(text)):
            raise OSError(errno.EILSEQ, "it is neither a LAMMPS script nor a data file nor a file of numbers")
        return text

    return text_of
