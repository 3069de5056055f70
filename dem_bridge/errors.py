"""The exceptions of the package, each with the exit code of the command line.

::

    DemBridgeError
    ├── UsageError           wrong use: unknown name, keyword or setting            exit 2
    ├── SceneError           a scene or scene file that is invalid                  exit 2
    │   └── BlockedScript    an input script that cannot be read as a scene         exit 2
    ├── UnsupportedScene     the scene is valid, but not supported by this backend  NOT_RUN
    ├── BackendUnavailable   the backend's engine is missing on this machine        NOT_RUN
    ├── NotAsymptotic        results that do not allow an extrapolation             exit 2
    └── RunBroken            a run that started and failed                          exit 3

Every message is one line of at most 500 printable characters that says what was asked, what was found, what is allowed
and what to do; that of an input script has such a line for each command that cannot be read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

#: exceptions that damaged data cause in code that parses them; a reader of files turns each into a UsageError
OF_DAMAGED_DATA = (ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError, ValueError)
#: largest number of commands that the error of an input script lists
MOST_BLOCKERS = 50
#: largest number of characters of a message, and of those at its end that a longer one keeps
MOST_CHARACTERS, _AT_END = 500, 160


def one_line(text: str) -> str:
    r"""Return a text as one line of at most 500 printable characters; a longer one loses its middle.

    >>> one_line("a\x1b[31m\nb"), len(one_line("long " * 1000))
    ('a\\x1b[31m b', 500)
    """
    line = re.sub(r"\s*[\n\r\t\v\f]+\s*", " ", text[: 100 * MOST_CHARACTERS]).strip()
    if not line.isprintable():
        line = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in line)
    if len(line) <= MOST_CHARACTERS:
        return line
    return f"{line[: MOST_CHARACTERS - _AT_END - 5]} ... {line[-_AT_END:]}"


def meant(name: str, names: Iterable[str]) -> str:
    """Return the question whether the most similar of ``names`` was meant; "" if none is similar.

    >>> meant("gaps", ["mass", "gap"]), meant("x", ["mass"])
    ("did you mean 'gap'?", '')
    """
    from difflib import get_close_matches

    return "".join(f"did you mean {likely!r}?" for likely in get_close_matches(name, list(names), n=1))


class DemBridgeError(Exception):
    """Base class of all errors that dem_bridge raises on purpose."""

    exit_code = 2

    def __init__(self, message: str = "") -> None:
        super().__init__(one_line(str(message)))


class UsageError(DemBridgeError, ValueError):
    """A name, keyword or setting does not exist or does not fit."""


def shown(value: object) -> str:
    """Return a value as text; a number with thousands of digits or a deeply nested list only by its type."""
    try:
        return repr(value)
    except (ValueError, RecursionError):
        return f"a {type(value).__name__} that is too long to be shown"


class SceneError(DemBridgeError, ValueError):
    """A scene is invalid; ``key`` and ``where`` name the entry and the file.

    Parameters
    ----------
    key : str
        Entry of the scene, such as "chain.mass[1]".
    allowed : str
        Values that are allowed.
    value : object
        Value of the entry.
    problem : str
        Description of the problem, where the value alone does not show it.
    advice : str
        Further hint.
    where : str
        File, or "scene".

    Examples
    --------
    >>> print(SceneError("chain.mass[1]", value=-0.01, allowed="a number > 0 (kg)", where="bad.toml"))
    bad.toml: chain.mass[1] = -0.01; allowed: a number > 0 (kg)
    """

    def __init__(
        self,
        key: str,
        *,
        allowed: str,
        value: object = None,
        problem: str = "",
        advice: str = "",
        where: str = "scene",
    ) -> None:
        self.key, self.value, self.problem, self.allowed = key, value, problem, allowed
        self.advice, self.where = advice, where
        text = problem or f"= {shown(value)}"
        parts = [f"{where}: {key} {text}" if key else f"{where}: {text}", f"allowed: {allowed}"]
        super().__init__("; ".join(parts + ([advice] if advice else [])))

    def at(self, where: str, key: str) -> SceneError:
        """Return the same error with the file and the key of a scene file."""
        return SceneError(
            key, allowed=self.allowed, value=self.value, problem=self.problem, advice=self.advice, where=where
        )


class BlockedScript(SceneError):
    """An input script that cannot be read; ``blockers`` are the errors of its commands, one line each."""

    def __init__(self, blockers: Iterable[SceneError]) -> None:
        self.blockers = tuple(blockers)
        first = self.blockers[0]
        advice = first.advice
        super().__init__(first.key, allowed=first.allowed, problem=first.problem, advice=advice, where=first.where)
        lines = list(map(str, self.blockers[:MOST_BLOCKERS]))
        if (more := len(self.blockers) - MOST_BLOCKERS) > 0:
            lines.append(f"{first.where}: {more} more commands cannot be read; allowed: what the lines above say")
        self.args = ("\n".join(lines),)


class UnsupportedScene(DemBridgeError):
    """The scene has physics that the backend does not support."""


class BackendUnavailable(DemBridgeError):
    """A backend cannot run on this machine; the message gives the reason and what to install."""


class NotAsymptotic(DemBridgeError, ValueError):
    """The resolutions show no clean order of convergence, so that no extrapolation is allowed."""


class RunBroken(DemBridgeError):
    """A run started but gave no result; ``log`` holds the last output of the engine."""

    exit_code = 3

    def __init__(self, message: str, *, log: str = "") -> None:
        self.log = log
        super().__init__(message)
