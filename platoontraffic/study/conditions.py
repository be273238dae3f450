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


def condition(text: str, keys: Sequence[str], place: str) -> Callable[[Sequence[Any]], bool]:
    """A condition as a function of the values of a point.

    keys  : varied keys of the study; a point has one value for each
    place : of the condition, for faults: `file:line: key`

    raises: InputError if the text is not such a condition
    """
    where = f"{place}: {text!r}"
    names = {key: f"_{i}" for i, key in enumerate(keys)}
    # Keys become names before parsing, because platoon.0.size is not Python. Quoted text is kept.
    words = re.compile(r"\"[^\"]*\"|'[^']*'|[A-Za-z_][\w-]*(?:\.[\w-]+)+|[A-Za-z_]\w*")
    known = {"and", "or", "not", "in", "True", "False"}

    def replaced(match: re.Match) -> str:
        word = match[0]
        if word[0] in "\"'" or word in known:
            return word
        if word not in names:
            raise InputError(f"{where}: {word}: not a varied key of the study{did_you_mean(word, keys)}")
        return names[word]

    try:
        tree = ast.parse(words.sub(replaced, text).strip(), mode="eval")
    except SyntaxError as error:
        raise InputError(f"{where}: {error.msg}; must be a comparison, such as 'platoon.size > 5'") from None
    if wrong := next((node for node in ast.walk(tree) if not isinstance(node, _ALLOWED)), None):
        raise InputError(f"{where}: {type(wrong).__name__}: must consist of comparisons, + - * /, and, or, not, in")
    code = compile(tree, "leave_out", "eval")

    def holds(values: Sequence[Any]) -> bool:
        try:
            return bool(eval(code, {"__builtins__": {}}, dict(zip(names.values(), values, strict=True))))
        except (TypeError, ZeroDivisionError) as error:
            at = ", ".join(f"{key} = {value!r}" for key, value in zip(keys, values, strict=True))
            raise InputError(f"{where}: {error}; at {at}") from None

    return holds
