# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whose underscore is whose: no file reads what is private to the objects of another.

Layers and rings are judged in `test_layers.py`. There is no limit on the size of a file, a function
or a list of parameters: such limits made fragments.
"""

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ('dlo_planner', 'msg_helpers')
OF_NAMED_TUPLES = ('_replace', '_asdict', '_fields', '_make', '_field_defaults')  # are public
# what numba and the standard library keep private, and there is no other way to; it only shrinks
KNOWN = {
    'dlo_planner/kernels/cache.py:_final_module': 1,
    'dlo_planner/kernels/cache.py:_rebuild': 1,
    'dlo_planner/kernels/cache.py:_reduce': 1,
    'dlo_planner/kernels/dispatcher.py:_code': 1,
    'dlo_planner/kernels/fingerprint.py:_overload_func': 1,
    'dlo_planner/ros/main.py:_exit': 1,
    'dlo_planner/ros/worker.py:_exit': 1,
}


def own_names(tree):
    """Return the names with an underscore that a file defines: of its classes and modules."""
    names = {node.name for node in ast.walk(tree)
             if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and (
                node.value.id in ('self', 'cls')):
            names.add(node.attr)
        elif isinstance(node, ast.keyword) and node.arg:
            names.add(node.arg)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
    return names


def underscores(tree):
    """Yield the attributes of other objects that begin with an underscore, as they are read."""
    own = own_names(tree)
    for node in ast.walk(tree):
        if (isinstance(node, ast.Attribute) and node.attr.startswith('_')
                and not node.attr.startswith('__') and node.attr not in OF_NAMED_TUPLES
                and node.attr not in own):
            yield node.attr


def test_nothing_private_of_others_is_read():
    found = Counter()
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob('*.py')):
        name = path.relative_to(ROOT)
        found.update(f'{name}:{attribute}'
                     for attribute in underscores(ast.parse(path.read_text(encoding='utf-8'))))
    assert dict(found) == KNOWN


def test_the_rule_sees_what_is_beyond_it():
    tree = ast.parse('class A:\n    def g(self, *rest):\n'
                     '        return other._secret, self._own, other._own\n')
    assert list(underscores(tree)) == ['_secret']
