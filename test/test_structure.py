# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The size of things: parameters, results, files, functions, and whose underscore is whose.

What is older than a rule is listed in `structure_exceptions.py`. The lists only shrink: what keeps
a rule must not stand there any longer, and what is listed must not grow.
`python test/test_structure.py` writes them as they are today; look at what has grown.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from structure_exceptions import EXCEPTIONS

ROOT = Path(__file__).parent.parent
PACKAGES = ('dlo_planner', 'msg_helpers')
PARAMETERS, RESULTS, LINES, LONGEST = 6, 3, 300, 60
OF_NAMED_TUPLES = ('_replace', '_asdict', '_fields', '_make', '_field_defaults')  # are public
KERNELS = ('kernel', 'njit', 'overload', 'makes')
RULES = ('parameters', 'results', 'file', 'function', 'underscore')


def functions(tree, inside=()) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield (name within the file, definition) of all functions."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield '.'.join([*inside, node.name]), node
            yield from functions(node, [*inside, node.name])
        elif isinstance(node, ast.ClassDef):
            yield from functions(node, [*inside, node.name])
        elif isinstance(node, ast.If) and ast.unparse(node.test) == 'TYPE_CHECKING':
            continue  # what a dataclass may be given: its fields, once more
        else:
            yield from functions(node, inside)


def is_kernel(function):
    """Whether a function is compiled: arrays and numbers are all that it can take and return."""
    return any(isinstance(node, ast.Name) and node.id in KERNELS
               for decorator in function.decorator_list for node in ast.walk(decorator))


def parameters(function):
    """Return how many parameters a function has besides self or cls."""
    given = function.args
    names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    names += [one.arg for one in (given.vararg, given.kwarg) if one is not None]
    return len(names) - (names[:1] in (['self'], ['cls']))


def results(function):
    """Return the size of the largest tuple that a function itself returns or yields."""
    largest, left = 0, list(function.body)
    while left:
        node = left.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda):
            continue
        if isinstance(node, ast.Return | ast.Yield) and isinstance(node.value, ast.Tuple):
            starred = any(isinstance(one, ast.Starred) for one in node.value.elts)
            largest = max(largest, 0 if starred else len(node.value.elts))
        left += ast.iter_child_nodes(node)
    return largest


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


def up(lines):
    """Return a number of lines in full tens: not every edit is to change the lists."""
    return -(-lines // 10) * 10


def found():
    """Return {rule: {what: by how much}} of all that is beyond the rules today."""
    beyond = {rule: {} for rule in RULES}
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob('*.py')):
        text, name = path.read_text(encoding='utf-8'), str(path.relative_to(ROOT))
        tree, lines = ast.parse(text), len(text.splitlines())
        if lines > LINES:
            beyond['file'][name] = up(lines)
        for attribute in underscores(tree):
            key = f'{name}:{attribute}'
            beyond['underscore'][key] = beyond['underscore'].get(key, 0) + 1
        for inside, function in functions(tree):
            sizes = {'function': (up(function.end_lineno - function.lineno + 1), LONGEST)}
            if not is_kernel(function):
                sizes |= {'parameters': (parameters(function), PARAMETERS),
                          'results': (results(function), RESULTS)}
            for rule, (size, most) in sizes.items():
                if size > most:
                    beyond[rule][f'{name}:{inside}'] = size
    return beyond


@pytest.fixture(scope='module')
def today():
    return found()


@pytest.mark.parametrize('rule', RULES)
def test_nothing_is_larger_than_the_rule(rule, today):
    known = EXCEPTIONS[rule]
    grown = {what: size for what, size in today[rule].items() if size > known.get(what, 0)}
    assert not grown, f'{rule}: make it smaller, see CONTRIBUTING.md: {grown}'


@pytest.mark.parametrize('rule', RULES)
def test_no_exception_is_out_of_date(rule, today):
    stale = {what: today[rule].get(what) for what, size in EXCEPTIONS[rule].items()
             if today[rule].get(what) != size}
    assert not [what for what, size in stale.items() if size is None], (
        f'{rule}: it keeps the rule now, take it from the list: {stale}')
    assert not stale, f'{rule}: it has changed, write its size today: {stale}'


def test_the_rules_see_what_is_beyond_them():
    tree = ast.parse('def f(a, b, c, d, e, f, g):\n    return 1, 2, 3, 4\n'
                     'class A:\n    def g(self, *rest):\n        return other._secret, self._own\n'
                     '    if TYPE_CHECKING:\n        def h(self, a, b, c, d, e, f, g): ...\n'
                     '@kernel\ndef k(a, b, c, d, e, f, g):\n    return 1, 2, 3, 4\n')
    named = dict(functions(tree))
    assert list(named) == ['f', 'A.g', 'k']
    assert [parameters(one) for one in named.values()] == [7, 1, 7]
    assert [results(one) for one in named.values()] == [4, 2, 4]
    assert [is_kernel(one) for one in named.values()] == [False, False, True]
    assert list(underscores(tree)) == ['_secret']


def write(beyond):
    """Write the lists anew."""
    path = Path(__file__).parent / 'structure_exceptions.py'
    head = path.read_text(encoding='utf-8').partition('EXCEPTIONS = {')[0]
    rules = ''.join(f"    '{rule}': {{\n" + ''.join(
        f"        '{what}': {size},\n" for what, size in beyond[rule].items()) + '    },\n'
        for rule in RULES)
    path.write_text(f'{head}EXCEPTIONS = {{\n{rules}}}\n', encoding='utf-8')


if __name__ == '__main__':
    write(found())
