"""Parsing of a LAMMPS input script to commands: comments, continued lines, quotes, variables and included files.

Other files are read through a function. Rules: LAMMPS manual, *Parsing rules for input scripts* and *variable*. A
variable that is not constant (a thermo keyword in a formula, a loop) is reported where it is used, not where it is
defined.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from dem_bridge.errors import SceneError

#: function from the name of a file in the script to its text
Opened = Callable[[str], str]

_QUOTED = r'"""[\s\S]*?"""|"[^"]*"|\'[^\']*\''
_WORD = re.compile(rf"(?:{_QUOTED})|\S+")
_COMMENT = re.compile(rf"({_QUOTED})|#.*")
_DOLLAR = re.compile(rf"(?P<quoted>{_QUOTED})|\$\{{(?P<name>\w+)\}}|\$(?P<letter>\w)|\$\((?P<formula>)")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_REFERENCE = re.compile(r"v_(\w+)")
#: largest depth of nested files and of nested variables
_DEEPEST = 20

_OPERATORS: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: math.fmod,
    ast.Pow: math.pow,
}
_FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "sqrt": math.sqrt, "exp": math.exp, "ln": math.log, "log": math.log10, "abs": abs, "sin": math.sin,
    "cos": math.cos, "tan": math.tan, "floor": math.floor, "ceil": math.ceil,
}  # fmt: skip
_FORMULA = f"numbers, + - * / % ^ ( ), PI, v_NAME and {', '.join(_FUNCTIONS)}"


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

    def commands(self, text: str, file: str, depth: int = 0) -> Iterator[Command]:
        """Yield all commands except ``variable`` and ``include``, which are executed here."""
        for number, line in _lines(text):
            bare = _COMMENT.sub(lambda match: match[1] or "", line)
            raw = Command(file, number, tuple(_words(bare)))
            if not raw.words:
                continue
            command = Command(file, number, tuple(_words(self._filled(bare, raw))))
            if command.name == "variable":
                self._define(command)
            elif command.name == "include":
                if depth >= _DEEPEST or len(command.rest) != 1:
                    raise command.error(
                        "names several files, or is nested too deeply", f"one file, nested at most {_DEEPEST} times"
                    )
                yield from self.commands(read(self.opened, command, command.rest[0]), command.rest[0], depth + 1)
            else:
                yield command

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
        if name not in self.variables:
            raise command.error(f"uses the variable {name}, which is not defined", "a variable that is defined before")
        style, words = self.variables[name]
        if style in ("index", "string") and words:
            return words[0]
        if style == "equal" and words:
            return f"{self.evaluated(command, ' '.join(words), depth):.15g}"
        raise command.error(
            f"uses the variable {name} of style {style}, whose value is known during a run only",
            "styles index, string and equal",
        )

    def evaluated(self, command: Command, formula: str, depth: int = 0) -> float:
        """Return the value of a formula of constants."""

        def value_of(node: ast.AST) -> float:
            if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
                return float(node.value)
            if isinstance(node, ast.Name) and node.id == "PI":
                return math.pi
            if isinstance(node, ast.Name) and node.id.startswith("v_") and depth < _DEEPEST:
                return self.number(command, self.value(command, node.id[2:], depth + 1))  # also truncated to 15 digits
            # for LAMMPS -2^2 is 4 and 2^3^2 is 64, in contrast to Python
            if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd) and not _power(node.operand):
                return -value_of(node.operand) if isinstance(node.op, ast.USub) else value_of(node.operand)
            if (
                isinstance(node, ast.BinOp)
                and type(node.op) in _OPERATORS
                and not (_power(node) and _power(node.right))
            ):
                return float(_OPERATORS[type(node.op)](value_of(node.left), value_of(node.right)))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1:
                return float(_FUNCTIONS[node.func.id](value_of(node.args[0])))
            raise ValueError

        try:
            return value_of(ast.parse(formula.strip().replace("^", "**"), mode="eval").body)
        except SceneError:
            raise
        except (SyntaxError, ValueError, KeyError, ArithmeticError, RecursionError, MemoryError):
            raise command.error(f"has the formula {formula.strip()!r}, which is not a constant", _FORMULA) from None

    def _filled(self, line: str, at: Command) -> str:
        """Return the line with the values of variables inserted, except within quotes."""
        out, place = [], 0
        while match := _DOLLAR.search(line, place):
            out.append(line[place : match.start()])
            place = match.end()
            if match["quoted"] is not None:
                out.append(match["quoted"])
            elif match["formula"] is not None:
                formula, place = self._bracketed(line, place, at)
                digits = "%.20g"
                if (form := re.fullmatch(r"(.*):(%\d*\.?\d*[efg])", formula)) is not None:
                    formula, digits = form[1], form[2]
                out.append(digits % self.evaluated(at, formula))
            else:
                out.append(self.value(at, match["name"] or match["letter"]))
        return "".join((*out, line[place:]))

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
        if style == "delete":
            self.variables.pop(name, None)
        elif not (style == "index" and name in self.variables):  # the first definition counts, as with -var
            self.variables[name] = (style, tuple(words))


def read(opened: Opened, command: Command, name: str) -> str:
    """Return the text of a file that a command names."""
    try:
        return opened(name)
    except (OSError, KeyError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "missing" if isinstance(error, KeyError) else "not text"
        raise command.error(
            f"names the file {name}, which cannot be read ({why})", "a text file next to the script"
        ) from None


def _power(node: ast.AST) -> bool:
    """Return True for a power."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield lines with the number of their first line, continued ones joined."""
    begun, first = "", 0
    for number, line in enumerate(text.splitlines(), start=1):
        first = first if begun else number
        joined = begun + line
        if joined.count('"""') % 2:
            begun = joined + "\n"
        elif joined.rstrip().endswith("&"):  # also within a comment
            begun = joined.rstrip()[:-1] + " "
        else:
            yield first, joined
            begun = ""
    if begun.strip():
        yield first, begun


def _words(line: str) -> Iterator[str]:
    """Yield the words of a line without their quotes."""
    for word in _WORD.findall(line):
        quote = next((mark for mark in ('"""', '"', "'") if word.startswith(mark) and len(word) > len(mark)), "")
        yield word[len(quote) : len(word) - len(quote)] if quote and word.endswith(quote) else word
