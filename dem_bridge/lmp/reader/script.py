"""A LAMMPS input script as commands: comments, continued lines, quotes, variables and included files done with.

Pure: other files come through a function. Rules: LAMMPS manual, *Parsing rules for input scripts* and *variable*. What
is no constant (a thermo keyword in a formula, a loop) is refused where it is used, not where it is defined.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from dem_bridge.errors import SceneError

#: name of a file, as the script says it -> its text
Opened = Callable[[str], str]

_QUOTED = r'"""[\s\S]*?"""|"[^"]*"|\'[^\']*\''
_WORD = re.compile(rf"(?:{_QUOTED})|\S+")
_COMMENT = re.compile(rf"({_QUOTED})|#.*")
_DOLLAR = re.compile(rf"(?P<quoted>{_QUOTED})|\$\{{(?P<name>\w+)\}}|\$(?P<letter>\w)|\$\((?P<formula>)")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_REFERENCE = re.compile(r"v_(\w+)")
#: files within files, and variables within variables, at most
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
    """One command, with variables put in, and where it stands."""

    file: str
    line: int
    words: tuple[str, ...]

    @property
    def name(self) -> str:
        return self.words[0]

    @property
    def rest(self) -> tuple[str, ...]:
        return self.words[1:]

    @property
    def text(self) -> str:
        return " ".join(self.words)

    def refused(self, problem: str, allowed: str, advice: str = "") -> SceneError:
        """What to raise: the file, the line, the command, what is wrong and what is allowed."""
        shown = self.text if len(self.text) <= 80 else f"{self.text[:77]}..."
        key = f"`{shown}`" if shown.isprintable() else repr(shown)
        where = f"{self.file}, line {self.line}"
        return SceneError(key, problem=problem, allowed=allowed, advice=advice, where=where)


@dataclass
class Script:
    """Text to commands, one after the other, because variables change on the way."""

    opened: Opened
    variables: dict[str, tuple[str, tuple[str, ...]]] = field(default_factory=dict)
    """Name -> style and what stands behind it."""

    def commands(self, text: str, file: str, depth: int = 0) -> Iterator[Command]:
        """All commands but ``variable`` and ``include``, which are carried out here."""
        for number, line in _lines(text):
            bare = _COMMENT.sub(lambda found: found[1] or "", line)
            raw = Command(file, number, tuple(_words(bare)))
            if not raw.words:
                continue
            command = Command(file, number, tuple(_words(self._filled(bare, raw))))
            if command.name == "variable":
                self._define(command)
            elif command.name == "include":
                if depth >= _DEEPEST or len(command.rest) != 1:
                    raise command.refused("cannot be followed", f"one file, {_DEEPEST} within each other at most")
                yield from self.commands(read(self.opened, command, command.rest[0]), command.rest[0], depth + 1)
            else:
                yield command

    def number(self, command: Command, word: str) -> float:
        """A number as LAMMPS reads it, or ``v_NAME`` of a variable that is one."""
        if found := _REFERENCE.fullmatch(word):
            word = self.value(command, found[1])
        if not _NUMBER.fullmatch(word) or not math.isfinite(float(word)):
            raise command.refused(f"has {word!r} where a number is needed", "a finite number")
        return float(word)

    def whole(self, command: Command, word: str) -> int:
        number = self.number(command, word)
        if number != int(number):
            raise command.refused(f"has {word!r} where a whole number is needed", "a whole number")
        return int(number)

    def value(self, command: Command, name: str, depth: int = 0) -> str:
        """What ``${name}`` stands for; of a formula the 15 digits that LAMMPS puts there."""
        if name not in self.variables:
            raise command.refused(f"uses the variable {name}, which is not defined", "a variable defined above")
        style, words = self.variables[name]
        if style in ("index", "string") and words:
            return words[0]
        if style == "equal" and words:
            return f"{self.evaluated(command, ' '.join(words), depth):.15g}"
        raise command.refused(
            f"uses the variable {name} of style {style}, whose value only a run has", "index, string or equal"
        )

    def evaluated(self, command: Command, formula: str, depth: int = 0) -> float:
        """A formula of constants."""

        def reduced(node: ast.AST) -> float:
            if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
                return float(node.value)
            if isinstance(node, ast.Name) and node.id == "PI":
                return math.pi
            if isinstance(node, ast.Name) and node.id.startswith("v_") and depth < _DEEPEST:
                return self.number(command, self.value(command, node.id[2:], depth + 1))  # cut to 15 digits, too
            # -2^2 is 4 and 2^3^2 is 64 to LAMMPS, and not to Python
            if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd) and not _power(node.operand):
                return -reduced(node.operand) if isinstance(node.op, ast.USub) else reduced(node.operand)
            if (
                isinstance(node, ast.BinOp)
                and type(node.op) in _OPERATORS
                and not (_power(node) and _power(node.right))
            ):
                return float(_OPERATORS[type(node.op)](reduced(node.left), reduced(node.right)))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1:
                return float(_FUNCTIONS[node.func.id](reduced(node.args[0])))
            raise ValueError

        try:
            return reduced(ast.parse(formula.strip().replace("^", "**"), mode="eval").body)
        except SceneError:
            raise
        except (SyntaxError, ValueError, KeyError, ArithmeticError, RecursionError, MemoryError):
            raise command.refused(f"has the formula {formula.strip()!r}, which is no constant", _FORMULA) from None

    def _filled(self, line: str, at: Command) -> str:
        """With the values of variables, but not within quotes."""
        out, place = [], 0
        while found := _DOLLAR.search(line, place):
            out.append(line[place : found.start()])
            place = found.end()
            if found["quoted"] is not None:
                out.append(found["quoted"])
            elif found["formula"] is not None:
                formula, place = self._bracketed(line, place, at)
                digits = "%.20g"
                if (form := re.fullmatch(r"(.*):(%\d*\.?\d*[efg])", formula)) is not None:
                    formula, digits = form[1], form[2]
                out.append(digits % self.evaluated(at, formula))
            else:
                out.append(self.value(at, found["name"] or found["letter"]))
        return "".join((*out, line[place:]))

    @staticmethod
    def _bracketed(line: str, start: int, at: Command) -> tuple[str, int]:
        """What stands between the bracket before ``start`` and its other one, and where that ends."""
        depth = 1
        for place in range(start, len(line)):
            depth += {"(": 1, ")": -1}.get(line[place], 0)
            if depth == 0:
                return line[start:place], place + 1
        raise at.refused("has $( without its )", "$(formula)")

    def _define(self, command: Command) -> None:
        if len(command.rest) < 2:
            raise command.refused("is no definition", "variable NAME STYLE VALUE")
        name, style, *words = command.rest
        if style == "delete":
            self.variables.pop(name, None)
        elif not (style == "index" and name in self.variables):  # the first definition holds, as does -var
            self.variables[name] = (style, tuple(words))


def read(opened: Opened, command: Command, name: str) -> str:
    """The text of a file that a command names."""
    try:
        return opened(name)
    except (OSError, KeyError, UnicodeDecodeError) as error:
        why = (
            error.strerror if isinstance(error, OSError) else "not there" if isinstance(error, KeyError) else "no text"
        )
        raise command.refused(
            f"names the file {name}, which cannot be read ({why})", "a text file beside the script"
        ) from None


def _power(node: ast.AST) -> bool:
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines with the number of their first, continued ones joined."""
    begun, first = "", 0
    for number, line in enumerate(text.splitlines(), start=1):
        first = first if begun else number
        joined = begun + line
        if joined.count('"""') % 2:
            begun = joined + "\n"
        elif joined.rstrip().endswith("&"):  # in a comment, too
            begun = joined.rstrip()[:-1] + " "
        else:
            yield first, joined
            begun = ""
    if begun.strip():
        yield first, begun


def _words(line: str) -> Iterator[str]:
    for found in _WORD.findall(line):
        quote = next((mark for mark in ('"""', '"', "'") if found.startswith(mark) and len(found) > len(mark)), "")
        yield found[len(quote) : len(found) - len(quote)] if quote and found.endswith(quote) else found
