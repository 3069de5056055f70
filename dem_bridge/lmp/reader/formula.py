"""Evaluation of the formulas of a LAMMPS input script whose values are known, by the rules of command *variable*."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping

_OPERATORS: Mapping[type[ast.AST], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: math.fmod,
    ast.Pow: math.pow,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


def _round(value: float) -> float:
    """Return the nearest whole number; halves are rounded away from zero."""
    return math.copysign(math.floor(abs(value) + 0.5), value)


def _ternary(condition: float, if_true: float, if_false: float) -> float:
    """Return the second value if the first is not 0, else the third."""
    return if_true if condition else if_false


_FUNCTIONS: Mapping[str, Callable[..., float]] = {
    "sqrt": math.sqrt, "exp": math.exp, "ln": math.log, "log": math.log10, "abs": abs, "sin": math.sin,
    "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan, "atan2": math.atan2,
    "floor": math.floor, "ceil": math.ceil, "round": _round, "ternary": _ternary,
}  # fmt: skip
ALLOWED = f"numbers, + - * / % ^ ( ), comparisons, && and ||, PI, v_NAME, v_VECTOR[I] and {', '.join(_FUNCTIONS)}"


def _no_element(word: str, index: float) -> float:
    """Raise KeyError, because there are no vectors."""
    raise KeyError(word, index)


def evaluated(
    formula: str, name: Callable[[str], float], element: Callable[[str, float], float] = _no_element
) -> float:
    """Return the value of a formula of words, whose values two functions return, or raise KeyError.

    Parameters
    ----------
    formula : str
        The formula.
    name : callable
        Return the value of a word that is not a number.
    element : callable
        Return the element of a vector, named by a word, with an index; without it there are no vectors.

    Raises
    ------
    ValueError
        If the formula is not a constant.
    """

    def value_of(node: ast.AST) -> float:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return float(node.value)
        if isinstance(node, ast.Name):
            return math.pi if node.id == "PI" else name(node.id)
        # for LAMMPS -2^2 is 4 and 2^3^2 is 64, in contrast to Python
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd) and not _power(node.operand):
            return -value_of(node.operand) if isinstance(node.op, ast.USub) else value_of(node.operand)
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS and not (_power(node) and _power(node.right)):
            return float(_OPERATORS[type(node.op)](value_of(node.left), value_of(node.right)))
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _OPERATORS:
            return float(_OPERATORS[type(node.ops[0])](value_of(node.left), value_of(node.comparators[0])))
        if isinstance(node, ast.BoolOp):
            values = [value_of(part) != 0.0 for part in node.values]
            return float(all(values) if isinstance(node.op, ast.And) else any(values))
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            return element(node.value.id, value_of(node.slice))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return float(_FUNCTIONS[node.func.id](*map(value_of, node.args)))
        raise ValueError

    # a number such as 007 is not one in Python
    text = re.sub(r"(?<![\w.])0+(?=\d)", "", formula.strip())
    for theirs, ours in (("^", "**"), ("&&", " and "), ("||", " or ")):
        text = text.replace(theirs, ours)
    try:
        return value_of(ast.parse(text, mode="eval").body)
    except (SyntaxError, KeyError, TypeError, ArithmeticError, RecursionError, MemoryError):
        raise ValueError(formula) from None


def _power(node: ast.AST) -> bool:
    """Return True for a power."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)


def plain(value: float, within: float) -> float:
    """Return the shortest decimal that differs from ``value`` by at most ``within``.

    Examples
    --------
    >>> plain(0.30000000000000004, 1e-15), plain(1e-19, 1e-16), plain(0.1234, 0.0)
    (0.3, 0.0, 0.1234)
    """
    if abs(value) <= within:
        return 0.0
    for digits in range(16):
        short = float(f"{value:.{digits}e}")
        if abs(short - value) <= within:
            return short
    return value
