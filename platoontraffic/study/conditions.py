"""Conditions on the points of a study: "platoon.size > 5 and not run.laps == 1"."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Sequence
from typing import Any

from platoontraffic.errors import InputError, did_you_mean

_ALLOWED = (
    *(ast.Expression, ast.BoolOp, ast.And, ast.Or, ast.UnaryOp, ast.Not, ast.USub, ast.Compare, ast.cmpop),
    *(ast.BinOp, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Name, ast.Load, ast.Constant, ast.List, ast.Tuple),
)


_NUMERIC = (ast.BinOp, ast.UnaryOp, ast.Name, ast.Constant)


Condition = Callable[[Sequence[Any]], bool]  # of the values of a point


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _is_condition(node: ast.expr) -> bool:
    """It holds or does not, other than a number or a text."""
    if isinstance(node, ast.BoolOp):
        return all(map(_is_condition, node.values))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return _is_condition(node.operand)
    return isinstance(node, ast.Compare)


def condition(text: str, keys: Sequence[str], place: str) -> Condition:
    """A condition as a function of the values of a point.

    keys  : varied keys of the study; a point has one value for each
    place : of the condition, for faults: `file:line: key`

    raises: InputError if the text is not such a condition
    """
    where = f"{place}: {text!r}"
    names = {key: f"_{i}" for i, key in enumerate(keys)}
    # Keys become names before parsing, because platoon.0.size is not Python. Quoted text is kept.
    number = r"(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
    words = re.compile(rf"\"[^\"]*\"|'[^']*'|{number}|[A-Za-z_][\w-]*(?:\.[\w-]+)+|[A-Za-z_]\w*")
    known = {"and", "or", "not", "in", "True", "False"}

    def replaced(match: re.Match) -> str:
        word = match[0]
        if word[0] in "\"'.0123456789" or word in known:
            return word
        if word not in names:
            raise InputError(f"{where}: {word}: not a varied key of the study{did_you_mean(word, keys)}")
        return names[word]

    python = words.sub(replaced, text).strip()
    try:
        tree = ast.parse(python, mode="eval")
    except SyntaxError as error:
        raise InputError(f"{where}: {error.msg}; must be a comparison, such as 'platoon.size > 5'") from None
    except (MemoryError, RecursionError, ValueError):  # of Python's parser
        raise InputError(f"{where}: cannot be read; must be a comparison, such as 'platoon.size > 5'") from None
    if wrong := next((node for node in ast.walk(tree) if not isinstance(node, _ALLOWED)), None):
        raise InputError(f"{where}: {type(wrong).__name__}: must consist of comparisons, + - * /, and, or, not, in")
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and node.id not in names.values():  # letters beyond ASCII
            raise InputError(f"{where}: {node.id}: not a varied key of the study{did_you_mean(node.id, keys)}")
    if not _is_condition(tree.body):
        raise InputError(f"{where}: must be a comparison, such as 'platoon.size > 5'")
    calculated = [side for node in ast.walk(tree) if isinstance(node, ast.BinOp) for side in (node.left, node.right)]
    if not all(isinstance(side, _NUMERIC) and _is_number(getattr(side, "value", 0)) for side in calculated):
        raise InputError(f"{where}: + - * / are for numbers")  # Python also multiplies texts, without a limit
    numeric = {side.id for side in calculated if isinstance(side, ast.Name)}
    try:
        code = compile(tree, "leave_out", "eval")
    except (MemoryError, RecursionError):
        raise InputError(f"{where}: is nested too deeply") from None

    def holds(values: Sequence[Any]) -> bool:
        given = dict(zip(names.values(), values, strict=True))
        try:
            if not all(_is_number(given[name]) for name in numeric):
                raise TypeError("+ - * / are for numbers")
            return bool(eval(code, {"__builtins__": {}}, given))
        except (TypeError, ArithmeticError) as error:
            at = ", ".join(f"{key} = {value!r}" for key, value in zip(keys, values, strict=True))
            raise InputError(f"{where}: {error}; at {at}") from None

    return holds
