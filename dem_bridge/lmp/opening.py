"""Open the files that a LAMMPS script names: below one folder only, of bounded size, and of the right kind."""

from __future__ import annotations

import errno
import re
from collections.abc import Callable
from pathlib import Path

from dem_bridge.foundation.files import named_file, text_of_file
from dem_bridge.foundation.scripts import is_script

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
