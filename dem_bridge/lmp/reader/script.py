"""Parsing of a LAMMPS input script to commands: comments, quotes, variables, included files, loops and branches.

Other files are read through a function. Rules: LAMMPS manual, *Parsing rules for input scripts*, *variable*, *jump*,
*next* and *if*. A variable that is not constant (such as a thermo keyword in a formula) is reported where it is used,
not where it is defined. The work is bounded: a script whose loops do not end is refused. All problems of a script are
collected; a problem that only follows from an earlier one is not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from dem_bridge.errors import BlockedScript, SceneError
from dem_bridge.lmp.reader import formula

#: function from the name of a file in the script to its text
Opened = Callable[[str], str]

_QUOTED = r'"""[\s\S]*?"""|"[^"]*"|\'[^\']*\''
_WORD = re.compile(rf"(?:{_QUOTED})|\S+")
_COMMENT = re.compile(rf"({_QUOTED})|#.*")
_DOLLAR = re.compile(rf"(?P<quoted>{_QUOTED})|\$\{{(?P<name>\w+)\}}|\$(?P<letter>\w)|\$\((?P<formula>)")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_REFERENCE = re.compile(r"v_(\w+)")
_COMPARISON = re.compile(r"([^\s=!<>&|()]+)\s*(==|!=)\s*([^\s=!<>&|()]+)")
_FORMULA_WORD = re.compile(r"[-+*/^%.\deE]+|v_\w+|PI")
#: styles of variables with several values; some of them are for several partitions, of which there is one here
_LISTS, _LOOPS = ("index", "universe", "world"), ("loop", "uloop")
_FORMAT = re.compile(r"%\d{0,2}(\.\d{1,2})?[efg]")
#: largest depth of nested files and of nested variables
_DEEPEST = 20
#: bound of the work for a script, of which a command takes 10, and of the characters of a command
MOST_WORK, _LONGEST = 1_000_000, 20_000
#: work that a command that cannot be read counts as, so that an endless loop of such commands ends soon
_WORK_OF_ERROR = 200
#: problem of a command that follows from the problem of an earlier one
_FOLLOWS = "uses a variable whose definition cannot be read"
#: a command that is refused -> commands whose problems may only follow from it
_ATOMS = ("set", "velocity", "group")
_FOLLOWERS = {
    **dict.fromkeys(("create_box", "read_data", "read_restart"), ("create_atoms", "pair_coeff", *_ATOMS)),
    "create_atoms": _ATOMS,
    "pair_style": ("pair_coeff",),
}


@dataclass(frozen=True)
class Command:
    """One command with the values of variables inserted, and its location."""

    file: str
    line: int
    words: tuple[str, ...]

    @property
    def name(self) -> str:
        """First word of the command."""
        return self.words[0]

    @property
    def rest(self) -> tuple[str, ...]:
        """Words after the first."""
        return self.words[1:]

    @property
    def text(self) -> str:
        """The command as one line."""
        return " ".join(self.words)

    def error(self, problem: str, allowed: str, advice: str = "") -> SceneError:
        """Return the error for this command, with file, line, problem and allowed values."""
        shown = self.text if len(self.text) <= 80 else f"{self.text[:77]}..."
        key = f"`{shown}`" if shown.isprintable() else repr(shown)
        where = f"{self.file}, line {self.line}"
        return SceneError(key, problem=problem, allowed=allowed, advice=advice, where=where)

    def fail_if(self, condition: bool, problem: str, allowed: str) -> None:
        """Raise the error of :meth:`error` if the condition is true."""
        if condition:
            raise self.error(problem, allowed)


@dataclass
class Script:
    """Parser of a script, with the variables that are defined so far."""

    opened: Opened
    variables: dict[str, tuple[str, tuple[str, ...]]] = field(default_factory=dict)
    """Name -> style and arguments of each variable."""
    keywords: dict[str, float] = field(default_factory=dict)
    """Values of thermo keywords that are known before a run."""
    blockers: dict[str, SceneError] = field(default_factory=dict)
    """Message -> error of each command that cannot be read."""
    refused: set[str] = field(default_factory=set)
    """First words of the commands that cannot be read."""
    unread: set[str] = field(default_factory=set)
    """Names that refused commands define, and commands that depend on them."""
    silent: frozenset[str] = frozenset()
    """Commands without effect on the motion, whose variables need not be known."""
    _vectors: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """Elements of the vectors that have been used."""
    _work: int = 0
    _depth: int = 0
    _skip_jump: bool = False
    _files: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    """Name -> numbered lines of each file that is read."""
    _labels: dict[str, dict[str, int]] = field(default_factory=dict)
    """Name -> index of the line behind each label of the file."""

    def commands(self, file: str, text: str | None = None, at: Command | None = None) -> Iterator[Command]:
        """Yield all commands except those that steer the script, such as ``variable`` and ``jump``.

        The text is read if it is not given; ``at`` is the command that names the file.
        """
        lines, place, pending = self.lines_of(file, text, at), 0, list[tuple[int, str]]()
        while pending or place < len(lines):
            if pending:
                number, line = pending.pop(0)
            else:
                number, line = lines[place]
                place += 1
            bare = _COMMENT.sub(lambda match: match[1] or "", line)
            command = Command(file, number, tuple(_words(bare)))
            if not command.words:
                continue
            try:
                self.count(command, 10 + len(bare) // 100)
                command.fail_if(
                    len(bare) > _LONGEST, f"has more than {_LONGEST} characters", f"at most {_LONGEST} characters"
                )
                command = Command(file, number, tuple(_words(self._filled(bare, command))))
                if command.name == "variable":
                    self._define(command)
                elif command.name == "next":
                    self._next(command)
                elif command.name == "if":
                    pending[:0] = [(number, branch) for branch in self._branch(command)]
                elif command.name == "jump":
                    command.fail_if(not 1 <= len(command.rest) <= 2, "is not supported", "jump SELF|FILE [LABEL]")
                    if not self._skip_jump:
                        file = file if command.rest[0] == "SELF" else command.rest[0]
                        lines = self.lines_of(file, None, command)
                        place = self._after_label(command, file)
                        self.count(command, place)
                    self._skip_jump = False
                elif command.name == "include":
                    allowed = f"one file, nested at most {_DEEPEST} times"
                    if self._depth >= _DEEPEST or len(command.rest) != 1:
                        raise command.error("names several files, or is nested too deeply", allowed)
                    self._depth += 1
                    yield from self.commands(command.rest[0], at=command)
                    self._depth -= 1
                elif command.name != "label":
                    yield command
            except SceneError as error:
                self._work += _WORK_OF_ERROR
                if command.name not in self.silent:
                    self.refuse(command, error)

    def lines_of(self, file: str, text: str | None, at: Command | None) -> list[tuple[int, str]]:
        """Return the numbered lines of a file, which is read once."""
        if file not in self._files:
            if text is None:
                assert at is not None  # only the first file has no command that names it
                text = self.read(at, file)
            else:
                self._count_text(Command(file, 1, ("(the whole file)",)), text)
            self._files[file] = [(number, line[: _LONGEST + 1]) for number, line in logical_lines(text)]
            starts = [line.split(maxsplit=2) for _, line in self._files[file]]
            labels = [(words[1], at) for at, words in enumerate(starts, 1) if words[:1] == ["label"] and words[1:]]
            self._labels[file] = dict(reversed(labels))  # the first of several counts
        return self._files[file]

    def _after_label(self, command: Command, file: str) -> int:
        """Return the index of the line behind the label of a ``jump``, or that of the first line without one."""
        if len(command.rest) < 2:
            return 0
        if (at := self._labels[file].get(command.rest[1])) is None:
            raise command.error(
                f"jumps to the label {command.rest[1]}, which is not in the file", "the name of a label"
            )
        return at

    def read(self, command: Command, name: str) -> str:
        """Return the text of a file that a command names."""
        try:
            text = self.opened(name)
        except (OSError, KeyError, UnicodeDecodeError, ValueError) as error:
            why = (
                error.strerror
                if isinstance(error, OSError)
                else "missing"
                if isinstance(error, KeyError)
                else "not text"
            )
            raise command.error(
                f"names the file {name}, which cannot be read ({why})", "a text file next to the script"
            ) from None
        self._count_text(command, text)
        return text

    def _count_text(self, command: Command, text: str) -> None:
        """Add to the work the reading of a text."""
        self.count(command, len(text) // 100 + text.count("\n") // 10)

    def count(self, command: Command, lines: int = 10) -> None:
        """Add to the work for the script; raise SceneError if it is too much, because a loop does not end."""
        self._work += lines
        if self._work > MOST_WORK:
            # a loop whose end cannot be read does not end
            error = command.error("is in a loop that does not end, or takes too long", f"{MOST_WORK // 10} commands")
            raise BlockedScript(self.blockers.values() or [error])

    def refuse(self, command: Command, error: SceneError) -> None:
        """Record an error, unless an earlier refused command may be its cause."""
        if isinstance(error, BlockedScript):
            raise error
        if not {*command.words} & self.unread and error.problem != _FOLLOWS:
            self.blockers.setdefault(str(error), error)
        self.refused.add(command.name)
        self.unread.update(_FOLLOWERS.get(command.name, ()))
        if command.name in ("variable", "region", "group"):
            prefix = "v_" if command.name == "variable" else ""
            self.unread.update(f"{prefix}{name}" for name in command.rest[:1])

    def number(self, command: Command, word: str) -> float:
        """Return a number as LAMMPS reads it, or the value of ``v_NAME``."""
        if match := _REFERENCE.fullmatch(word):
            word = self.value(command, match[1])
        if not _NUMBER.fullmatch(word) or not math.isfinite(float(word)):
            raise command.error(f"has {word!r} where a number is required", "a finite number")
        return float(word)

    def whole(self, command: Command, word: str) -> int:
        """Return a whole number, or raise SceneError."""
        number = self.number(command, word)
        command.fail_if(number != int(number), f"has {word!r} where a whole number is required", "a whole number")
        return int(number)

    def value(self, command: Command, name: str, depth: int = 0) -> str:
        """Return the text of ``${name}``; a formula has the 15 digits that LAMMPS inserts."""
        self.count(command)
        if f"v_{name}" in self.unread:
            raise command.error(_FOLLOWS, "a variable that can be read")
        if name not in self.variables:
            problem = f"uses the variable {name}, which is not defined"
            raise command.error(problem, "a variable that is defined before, or by --var NAME=VALUE")
        style, words = self.variables[name]
        if style in (*_LISTS, *_LOOPS, "string", "internal") and words:
            return words[0]
        if style == "equal" and words:
            return f"{self.evaluated(command, ' '.join(words), depth):.15g}"
        if style == "format" and len(words) == 2 and _FORMAT.fullmatch(words[1]) and depth < _DEEPEST:
            return words[1] % self.number(command, self.value(command, words[0], depth + 1))
        raise command.error(
            f"uses the variable {name} of style {style}, whose value is known during a run only",
            "styles index, loop, string, format and equal",
        )

    def vector(self, command: Command, name: str) -> tuple[float, ...]:
        """Return the elements of a variable of style vector that lists numbers."""
        style, words = self.variables.get(name, ("", ()))
        if name not in self._vectors:
            text = "".join(words)
            self.count(command, len(text) // 5)
            listed = style == "vector" and text[:1] == "[" and text[-1:] == "]"
            command.fail_if(not listed, f"uses {name}, which is no list of numbers", "variable NAME vector [x,y,...]")
            self._vectors[name] = tuple(self.number(command, word) for word in text[1:-1].split(","))
        return self._vectors[name]

    def evaluated(self, command: Command, text: str, depth: int = 0) -> float:
        """Return the value of a formula of constants."""
        self.count(command, len(text) // 5)

        def name(word: str) -> float:
            if word.startswith("v_") and depth < _DEEPEST:
                return self.number(command, self.value(command, word[2:], depth + 1))  # also truncated to 15 digits
            return self.keywords[word]

        def element(word: str, index: float) -> float:
            return self.vector(command, word.removeprefix("v_"))[int(index) - 1]  # LAMMPS counts from 1

        try:
            return formula.evaluated(text, name, element)
        except SceneError:
            raise
        except ValueError:
            problem = f"has the formula {text.strip()[:60]!r}, which is not a constant"
            raise command.error(problem, ", ".join((formula.ALLOWED, *self.keywords))) from None

    def _filled(self, line: str, at: Command) -> str:
        """Return the line with the values of variables inserted, except within quotes."""
        out, place = [], 0
        while match := _DOLLAR.search(line, place):
            out.append(line[place : match.start()])
            place = match.end()
            if match["quoted"] is not None:
                out.append(match["quoted"])
            elif match["formula"] is not None:
                text, place = self._bracketed(line, place, at)
                digits = "%.20g"
                if (form := re.fullmatch(rf"(.*):({_FORMAT.pattern})", text, re.ASCII)) is not None:
                    text, digits = form[1], form[2]
                out.append(digits % self.evaluated(at, text))
            else:
                out.append(self.value(at, match["name"] or match["letter"]))
        text = "".join((*out, line[place:]))
        at.fail_if(len(text) > _LONGEST, f"is {len(text)} characters long", f"at most {_LONGEST} characters")
        return text

    @staticmethod
    def _bracketed(line: str, start: int, at: Command) -> tuple[str, int]:
        """Return the text between the bracket before ``start`` and the matching one, and the place after it."""
        depth = 1
        for place in range(start, len(line)):
            depth += {"(": 1, ")": -1}.get(line[place], 0)
            if depth == 0:
                return line[start:place], place + 1
        raise at.error("has $( without its )", "$(formula)")

    def _define(self, command: Command) -> None:
        """Execute a ``variable`` command."""
        command.fail_if(len(command.rest) < 2, "is incomplete", "variable NAME STYLE VALUE")
        name, style, *words = command.rest
        self._vectors.pop(name, None)
        if style == "delete":
            self.variables.pop(name, None)
        elif not (style in (*_LISTS, *_LOOPS) and name in self.variables):  # the first definition counts, as with -var
            if style in _LOOPS:
                width = len(words[-2]) if words[-1:] == ["pad"] and len(words) > 1 else 0
                ends = [self.whole(command, word) for word in words if word != "pad"]
                if not 1 <= len(ends) <= 2 or ends[-1] < ends[0] > 1 or ends[-1] < 1:
                    raise command.error("is not a loop", "variable NAME loop N, or N1 N2 with N1 <= N2")
                words = [f"{[1, *ends][-2]:0{width}d}", f"{ends[-1]}"]
            self.variables[name] = (style, tuple(words))

    def _next(self, command: Command) -> None:
        """Execute a ``next`` command; after the last value the variables are deleted and the next jump is skipped."""
        styles = {self.variables[name][0] for name in command.rest if name in self.variables} - {"uloop"}
        command.fail_if(len(styles) > 1, "names variables of several styles", "variables of one style")
        for name in command.rest:
            style, words = self.variables.get(name, ("", ()))
            if style not in (*_LISTS, *_LOOPS):
                raise command.error(f"names {name}, which has no further values", "variables of style index or loop")
            if style in _LOOPS:
                following = int(words[0]) + 1
                words = (f"{following:0{len(words[0])}d}", words[1]) if following <= int(words[1]) else ()
            else:
                words = words[1:]
            self.variables[name] = (style, words)
            if not words:
                del self.variables[name]
                self._skip_jump = True

    def _branch(self, command: Command) -> tuple[str, ...]:
        """Return the commands that an ``if`` command executes."""
        allowed = 'if "CONDITION" then "COMMAND" ... [elif "CONDITION" "COMMAND" ...] [else "COMMAND" ...]'
        command.fail_if(len(command.rest) < 3 or command.rest[1] != "then", "is not supported", allowed)
        condition, body = command.rest[0], command.rest[2:]
        while True:
            end = next((at for at, word in enumerate(body) if word in ("elif", "else")), len(body))
            if self._holds(command, self._filled(condition, command)):
                return body[:end]
            if body[end : end + 1] != ("elif",):
                return body[end + 1 :]
            command.fail_if(len(body) < end + 3, "is incomplete", allowed)
            condition, body = body[end + 1], body[end + 2 :]

    def _holds(self, command: Command, condition: str) -> bool:
        """Return the truth of a condition: a formula, which may contain comparisons of texts."""

        def compared(match: re.Match[str]) -> str:
            if _FORMULA_WORD.fullmatch(match[1]) and _FORMULA_WORD.fullmatch(match[3]):
                return match[0]
            return f"{int((match[1] == match[3]) == (match[2] == '=='))}"

        return self.evaluated(command, _COMPARISON.sub(compared, condition)) != 0.0


def given_variables(values: Mapping[str, str] | None) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return variables as LAMMPS defines them by its argument ``-var``, for :class:`Script`."""
    return {name: ("index", (value,)) for name, value in (values or {}).items()}


def logical_lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines of a script with the number of their first line, continued ones joined."""
    begun, first = "", 0
    for number, line in enumerate(text.splitlines(), start=1):
        first = first if begun else number
        joined = begun + line
        if len(joined) > _LONGEST:  # refused where it is evaluated
            yield first, joined
            begun = ""
        elif joined.count('"""') % 2:
            begun = joined + "\n"
        elif joined.rstrip().endswith("&"):  # also within a comment
            begun = joined.rstrip()[:-1] + " "
        else:
            if joined.strip():
                yield first, joined
            begun = ""
    if begun.strip():
        yield first, begun


def _words(line: str) -> Iterator[str]:
    """Yield the words of a line without their quotes."""
    for word in _WORD.findall(line):
        quote = next((mark for mark in ('"""', '"', "'") if word.startswith(mark) and len(word) > len(mark)), "")
        yield word[len(quote) : len(word) - len(quote)] if quote and word.endswith(quote) else word
