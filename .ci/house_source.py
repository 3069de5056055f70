"""Read the modules of a checkout, and count their lines; nothing of the checkout is imported or run."""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

_NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
#: decorators of functions that numba compiles
_COMPILERS = {"kernel", "njit", "jit", "vectorize", "guvectorize", "cfunc"}
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Module:
    """One file of Python, by its dotted name."""

    name: str
    file: Path

    @cached_property
    def text(self) -> str:
        return self.file.read_text(encoding="utf-8")

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        return tuple(ast.walk(self.tree))

    @cached_property
    def tokens(self) -> tuple[tokenize.TokenInfo, ...]:
        return tuple(tokenize.generate_tokens(io.StringIO(self.text).readline))

    @cached_property
    def docstrings(self) -> frozenset[int]:
        """Numbers of all lines that belong to docstrings, those under attributes included."""
        return frozenset(
            line
            for node in self.nodes
            for statement in (node.body if isinstance(getattr(node, "body", None), list) else ())  # type: ignore[attr-defined]
            if isinstance(statement, ast.Expr) and _is_text(statement.value)
            for line in range(statement.lineno, (statement.end_lineno or statement.lineno) + 1)
        )

    @cached_property
    def code(self) -> frozenset[int]:
        """Numbers of the lines of code: those that are not blank and hold more than a comment or a docstring."""
        lines: set[int] = set()
        for token in self.tokens:
            if token.type not in _NO_CODE:
                lines |= set(range(token.start[0], token.end[0] + 1))
        return frozenset(lines - self.docstrings)

    @property
    def package(self) -> str:
        """The package that relative imports start from."""
        return self.name if self.file.name == "__init__.py" else self.name.rpartition(".")[0]

    @property
    def statements(self) -> int:
        return sum(isinstance(node, ast.stmt) and not _is_constant(node) for node in self.nodes)

    @property
    def comments(self) -> Iterator[str]:
        return (token.string for token in self.tokens if token.type == tokenize.COMMENT)

    @property
    def functions(self) -> Iterator[Function]:
        return (node for node in self.nodes if isinstance(node, Function))

    @property
    def classes(self) -> Iterator[ast.ClassDef]:
        return (node for node in self.nodes if isinstance(node, ast.ClassDef))

    def size(self, node: Function | ast.ClassDef) -> int:
        """Return the lines of code of a function or class, what is nested in it included, decorators left out."""
        return len(self.code & set(range(node.lineno, (node.end_lineno or node.lineno) + 1)))


def read_modules(folder: Path) -> dict[str, Module]:
    """Return the modules below a folder, by dotted name; the last part of the folder is the first of the name."""
    modules = {}
    for file in sorted(folder.rglob("*.py")):
        name = ".".join(file.relative_to(folder.parent).with_suffix("").parts).removesuffix(".__init__")
        modules[name] = Module(name, file)
    return modules


def is_kernel(function: Function) -> bool:
    """Return whether numba compiles a function: a decorator is named as one of its compilers, called or not."""
    for decorator in function.decorator_list:
        target = decorator.func if isinstance(decorator, ast.Call) else decorator
        name = target.attr if isinstance(target, ast.Attribute) else getattr(target, "id", "")
        if name in _COMPILERS:
            return True
    return False


def is_typed(function: Function) -> bool:
    """Return whether the result and every argument of a function have an annotation."""
    stated = function.args
    every = [*stated.posonlyargs, *stated.args, *stated.kwonlyargs]
    every += [one for one in (stated.vararg, stated.kwarg) if one is not None]
    return function.returns is not None and all(one.annotation is not None for one in every)


def _is_constant(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)
