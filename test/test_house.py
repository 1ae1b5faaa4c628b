# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The house: files and functions that fit a screen, few parameters, nothing private of others."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = ('view', 'cli', 'settings', 'parallel', 'arm', 'cell', 'cosserat', 'ros')
FILES = [path for room in ROOMS for path in sorted((ROOT / 'dlo_planner' / room).glob('*.py'))] + [
    *sorted((ROOT / 'msg_helpers').glob('*.py'))]
LINES, SCREEN, PARAMETERS, RESULTS = 300, 65, 6, 3
NO_OTHER_WAY = {'os._exit'}  # the only name of what it does
# A command has as many parameters as options.
COMMANDS = ('click.', 'described', 'written')
# Entries whose options after the fourth parameter are given by name alone.
OPTIONS = {'speculative', 'capability_map', 'bench', 'run', 'Plant.__init__'}


def functions(node, within=''):
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) == 'TYPE_CHECKING':
            continue
        named = isinstance(child, ast.FunctionDef | ast.ClassDef)
        if isinstance(child, ast.FunctionDef):
            yield within + child.name, child
        yield from functions(child, f'{within}{child.name}.' if named else within)


def own_returns(function):
    inside = {id(part) for child in ast.walk(function) if child is not function
              and isinstance(child, ast.FunctionDef | ast.Lambda) for part in ast.walk(child)}
    return [part.value for part in ast.walk(function)
            if isinstance(part, ast.Return) and id(part) not in inside]


@pytest.mark.parametrize('path', FILES, ids=lambda path: f'{path.parent.name}/{path.name}')
def test_the_house(path):
    text = path.read_text(encoding='utf-8')
    assert text.count('\n') <= LINES
    tree = ast.parse(text)
    for name, function in functions(tree):
        assert function.end_lineno - function.lineno < SCREEN, name
        given = function.args
        named = [one for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)
                 if one.arg not in {'self', 'cls'}]
        everything = [*named, *(one for one in (given.vararg, given.kwarg) if one)]
        assert function.returns is not None, name
        assert all(one.annotation is not None for one in everything), name
        command = any(ast.unparse(one).startswith(COMMANDS) for one in function.decorator_list)
        listed = name in OPTIONS and len(given.args) <= PARAMETERS
        assert command or listed or len(named) <= PARAMETERS, name
        assert all(not isinstance(value, ast.Tuple) or len(value.elts) <= RESULTS
                   for value in own_returns(function)), name


@pytest.mark.parametrize('path', FILES, ids=lambda path: f'{path.parent.name}/{path.name}')
def test_nothing_private_of_others_is_used(path):
    for part in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if not isinstance(part, ast.Attribute) or not part.attr.startswith('_') or (
                part.attr.startswith('__')):
            continue
        owner = ast.unparse(part.value)
        assert owner in {'self', 'cls', 'super()'} or ast.unparse(part) in NO_OTHER_WAY, (
            ast.unparse(part))
