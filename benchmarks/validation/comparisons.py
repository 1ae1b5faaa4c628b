# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a passed assertion has compared, out of pytest's words for it.

`error < 0.5 * room` comes as '1.2e-07 < (0.5 * np.float64(2e-06))', an approximation as
'0.1234 == 0.1233 ± 1.0e-05'. Only upper bounds of what is not negative count: they say how much of
a limit is used.
"""

import ast
import math
import operator
import re

_OPERATORS = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
              ast.Div: operator.truediv, ast.Pow: operator.pow}
_NUMPY = re.compile(r'np\.(?:float|int|uint)\d+\(')


def comparison(source: str, explained: str) -> tuple[str, float, float] | None:
    """Return (what, measured, limit) of a passed assertion, None if it has no upper bound."""
    line = _NUMPY.sub('(', explained.split('\n', maxsplit=1)[0])
    if ' ± ' in line:
        return _approximation(source, line)
    try:
        tree = ast.parse(line, mode='eval').body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    if not isinstance(tree, ast.Compare) or len(tree.ops) != 1:
        return None
    if not isinstance(tree.ops[0], ast.Lt | ast.LtE):
        return None
    measured, limit = _value(tree.left), _value(tree.comparators[0])
    if measured is None or limit is None or not 0 <= measured <= limit or limit == 0:
        return None
    if _is_number(source):
        return None  # `0.1 < size` is a lower bound
    return ' '.join(source.split('#', maxsplit=1)[0].split()), measured, limit


def _approximation(source: str, line: str) -> tuple[str, float, float] | None:
    found = re.fullmatch(r'(.+) == (\S+) ± (\S+)', line)
    if not found:
        return None
    values: list[float] = []
    for text in found.groups():
        try:
            value = _value(ast.parse(text, mode='eval').body)
        except SyntaxError:
            return None
        if value is None:
            return None
        values.append(value)
    measured, true, allowed = values
    if not allowed > 0:
        return None
    return ' '.join(source.split()), abs(measured - true), allowed


def _is_number(source: str) -> bool:
    """Return whether the left side of a comparison is a number written in the test."""
    try:
        tree = ast.parse(source.strip(), mode='eval').body
    except SyntaxError:
        return False
    return (isinstance(tree, ast.Compare) and len(tree.ops) == 1
            and _value(tree.left) is not None)


def _value(node: ast.AST) -> float | None:
    """Return the value of an expression of numbers, None if it is none."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value) if math.isfinite(node.value) else None
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = _value(node.operand)
        return None if value is None else -value
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        left, right = _value(node.left), _value(node.right)
        if left is None or right is None:
            return None
        try:
            value = _OPERATORS[type(node.op)](left, right)
        except (ZeroDivisionError, OverflowError):
            return None
        return value if isinstance(value, float) and math.isfinite(value) else None
    return None
