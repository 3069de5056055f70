"""LAMMPS input scripts and unit tests as files: recognise one, and open the files that a script names.

Nothing of LAMMPS is imported for it, because most files are neither.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Callable
from pathlib import Path

from dem_bridge.foundation.files import MOST_BYTES, named_file, opened, text_of_file

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


#: keys of a unit test of LAMMPS (YAML) without which there is nothing to run, and one at the beginning of a line
KEYS_OF_UNIT_TESTS = ("pre_commands", "pair_style", "run_segments")
_KEYS = re.compile(r"^(pre_commands|run_segments|pair_style)[ \t]*:", re.MULTILINE)
#: commands of which one begins a line of every LAMMPS deck
_DECK = re.compile(r"^[ \t]*(units|atom_style|pair_style|read_data|create_box|include)[ \t]+\S", re.MULTILINE)


def is_unit_test(text: str) -> bool:
    r"""Return True if a text is a unit test of LAMMPS with runs, by its keys.

    Examples
    --------
    >>> is_unit_test("---\npre_commands: |\n  units si\npair_style: granular\nrun_segments: |-\n  10\n")
    True
    >>> is_unit_test("units si\nrun 10\n")
    False
    """
    return {match[1] for match in _KEYS.finditer(text)} >= set(KEYS_OF_UNIT_TESTS)


def is_deck(path: Path) -> bool:
    """Return True if a file is a LAMMPS input script, by its content."""
    head = _head(path)
    return not is_unit_test(head) and "\0" not in head and "ITEM:" not in head and _DECK.search(head) is not None


def is_unit_test_file(path: Path) -> bool:
    """Return True if a file is a unit test of LAMMPS, by its content."""
    return is_unit_test(_head(path))


def _head(path: Path) -> str:
    """Return the beginning of a file; '' if it cannot be read."""
    try:
        with opened(path, MOST_BYTES) as file:
            return (file.read(100_000) or b"").decode(errors="replace")
    except OSError:
        return ""


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
