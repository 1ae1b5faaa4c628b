# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Annotations: mypy is content with the package and with what users write, and finds mistakes."""

import ast
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
MISTAKE = re.compile(r'# E: ([\w-]+)')
FOUND = re.compile(r'mistakes\.py:(\d+): error: .*\[([\w-]+)\]$')


def functions(tree, inside=()):
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
    return any(isinstance(node, ast.Name) and node.id in ('kernel', 'njit', 'overload', 'makes')
               for decorator in function.decorator_list for node in ast.walk(decorator))


def mypy(*targets):
    """Return the exit code of mypy and the lines that it prints."""
    pytest.importorskip('mypy')
    done = subprocess.run([sys.executable, '-m', 'mypy', *map(str, targets)],
                          capture_output=True, text=True, cwd=ROOT, check=False)
    return done.returncode, (done.stdout + done.stderr).splitlines()


def test_the_package_and_what_a_user_writes_have_no_errors():
    code, lines = mypy('dlo_planner', 'msg_helpers', HERE / 'user.py')
    assert code == 0, lines


def unannotated(text):
    """Return the names of a text's functions that lack an annotation and are no kernels."""
    return [name for name, function in functions(ast.parse(text)) if not is_kernel(function)
            and (function.returns is None and function.name != '__init__'
                 or any(one.annotation is None and one.arg not in ('self', 'cls')
                        for one in (*function.args.posonlyargs, *function.args.args,
                                    *function.args.kwonlyargs)))]


def test_all_functions_but_kernels_are_annotated():
    """Rooms with kernels do not oblige mypy to look for annotations: this does."""
    lacking = {str(path.relative_to(ROOT)): unannotated(path.read_text(encoding='utf-8'))
               for path in sorted((ROOT / 'dlo_planner').rglob('*.py'))}
    assert not {name: those for name, those in lacking.items() if those}


def test_a_lack_of_annotations_is_seen():
    assert unannotated('@kernel\ndef f(x):\n    return x\n') == []
    inner = 'class A:\n    def f(self) -> int:\n        def g(x): return x\n'
    assert unannotated(inner) == ['A.f.g']
    assert unannotated('def f(x: int): pass') == unannotated('def f(x) -> int: pass') == ['f']


def test_mistakes_are_found_each_in_its_line():
    code, lines = mypy(HERE / 'mistakes.py')
    stated = {(number, kind) for number, line in enumerate(
        (HERE / 'mistakes.py').read_text().splitlines(), start=1) for kind in MISTAKE.findall(line)}
    found = {(int(match[1]), match[2]) for match in map(FOUND.search, lines) if match}
    assert code == 1 and found == stated


def test_what_a_user_writes_runs(capsys):
    runpy.run_path(str(HERE / 'user.py'), run_name='__main__')
    printed = capsys.readouterr().out
    assert printed and 'nan' not in printed.splitlines()[0]


@pytest.mark.parametrize('package', ['dlo_planner', 'msg_helpers'])
def test_the_package_says_that_it_is_typed(package):
    assert (ROOT / package / 'py.typed').exists()
    assert 'py.typed' in (ROOT / 'setup.py').read_text()
