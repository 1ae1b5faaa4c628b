# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rules of the sources: no rings, nothing private of others, annotations, headers, clean files.

Layers are judged by `make imports`, types by `make types`. There is no limit on the size of a file,
a function or a list of parameters: such limits made fragments.
"""

import ast
import re
import runpy
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import pytest

from dlo_planner import DirectSimulator, Pose, Rod, Sphere
from dlo_planner.kernels import COMPILED

ROOT = Path(__file__).parent.parent
PACKAGES = ('dlo_planner', 'msg_helpers')
# Rings that are still there: so many files of a room import each other. Fewer is better, none is
# right; a ring through two rooms is never allowed.
RINGS = {'dlo_planner.plan': 2}
OF_NAMED_TUPLES = ('_replace', '_asdict', '_fields', '_make', '_field_defaults')  # are public
# what numba and the standard library keep private, and there is no other way to; it only shrinks
KNOWN = {
    'dlo_planner/kernels/dispatcher.py:_final_module': 1,
    'dlo_planner/kernels/dispatcher.py:_rebuild': 1,
    'dlo_planner/kernels/dispatcher.py:_reduce': 1,
    'dlo_planner/kernels/references.py:_getvalue': 1,  # numba's
    'dlo_planner/kernels/dispatcher.py:_code': 1,
    'dlo_planner/kernels/fingerprint.py:_overload_func': 1,
    'dlo_planner/ros/main.py:_exit': 1,
    'dlo_planner/ros/worker.py:_exit': 1,
}
KERNEL_DECORATORS = ('kernel', 'njit', 'overload', 'makes')
COPYRIGHT, FILES = (runpy.run_path(str(ROOT / '.ci' / name)) for name in ('copyright.py',
                                                                          'files.py'))


@cache
def package():
    """Return the syntax trees of all files of the packages, by their paths from ROOT."""
    return {path.relative_to(ROOT): ast.parse(path.read_text(encoding='utf-8'))
            for name in PACKAGES for path in sorted((ROOT / name).rglob('*.py'))}


# ---- imports --------------------------------------------------------------------------------


def imported(tree, modules):
    """Return what of `modules` a file imports: annotations and local imports included."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            whole = {f'{node.module}.{one.name}' for one in node.names}
            found |= whole & modules or {node.module}
    return found & modules


def reached(graph, start):
    """Return all modules that a module imports, directly or not."""
    seen, waiting = set(), [start]
    while waiting:
        for other in graph[waiting.pop()] - seen:
            seen.add(other)
            waiting.append(other)
    return seen


def rings(graph):
    """Return the sets of modules that import each other."""
    there = {start: reached(graph, start) for start in graph}
    return {frozenset(other for other in seen if one in there[other])
            for one, seen in there.items() if one in seen}


@cache
def graph():
    """Return what of the packages each of their modules imports, by names."""
    trees = {'.'.join(path.with_suffix('').parts).removesuffix('.__init__'): tree
             for path, tree in package().items()}
    return {name: imported(tree, set(trees)) - {name} for name, tree in trees.items()}


def test_no_modules_import_each_other():
    counts = Counter()
    for ring in rings(graph()):
        rooms = {'.'.join(name.split('.')[:2]) for name in ring}
        assert len(rooms) == 1, f'a ring through rooms: {sorted(ring)}'
        counts[rooms.pop()] += len(ring)
    assert {room: count for room, count in counts.items() if count > RINGS.get(room, 0)} == {}


def calls_between_modules(run):
    """Return (caller, called) of all calls from one module of the package to another, in `run`.

    Compiled functions count where Python calls them.
    """
    calls, stack = [], ['']

    def note(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event in ('call', 'return') and ROOT / 'dlo_planner' in path.parents:
            if event == 'return':
                stack.pop()
                return
            stack.append('.'.join(path.relative_to(ROOT).with_suffix('').parts))
            if stack[-1] != stack[-2]:
                calls.append((stack[-2], stack[-1]))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(before)
    return calls


# What a reader has to open who follows one step on a sphere: files; climbs, calls to a file that
# imports the caller's; returns, calls to a file that was entered before. It only shrinks.
@pytest.mark.skipif(not COMPILED, reason='all kernels would be counted')
@pytest.mark.parametrize(('options', 'limits'), [
    ({'n_elements': 40}, (10, 0, 15)), ({}, (12, 0, 21))], ids=['mesh', 'accuracy'])
def test_a_warm_solve_walks_through_few_files(options, limits):
    wire = Rod.circular(0.6, 2e-3, 8960.0, 110e9, 0.34)
    simulator = DirectSimulator(wire, obstacles=[Sphere((0.3, 0, 0.16), 0.06)], **options)
    shape = None
    for height in (0.22, 0.219, 0.218):
        gripper = Pose.looking_along((0, 0, height), (1, 0, 0))
        before, shape = shape, simulator.solve(gripper, shape)
    assert shape.contacts
    calls = calls_between_modules(lambda: simulator.solve(gripper, before))
    entered = [called for _, called in calls]
    climbs = [call for call in calls if call[0] in reached(graph(), call[1])]
    assert len(set(entered)) <= limits[0], sorted(set(entered))
    assert len(climbs) <= limits[1], climbs
    assert len(entered) - len(set(entered)) <= limits[2]


@cache
def packages_of(path):
    """Return the names of the packages and modules that a file imports, wherever it does."""
    return set(re.findall(r'^ *(?:from|import) (\w+)', path.read_text(), re.MULTILINE))


def test_ros_packages_are_declared():
    manifest = ElementTree.parse(ROOT / 'package.xml')
    declared = {one.text for kind in ('exec_depend', 'test_depend') for one in manifest.iter(kind)}
    names = set().union(*(packages_of(path) for folder in (*PACKAGES, 'launch', 'test')
                          for path in (ROOT / folder).rglob('*.py')))
    ros = {name for name in names if name.endswith(('_msgs', '_srvs', '_interfaces'))}
    ros |= names & {'rclpy', 'launch', 'launch_ros', 'domain_coordinator', 'ament_index_python'}
    assert {'rclpy', 'nav_msgs', 'launch_ros'} <= ros <= declared, ros - declared


def test_test_files_go_together_in_any_choice_and_order():
    paths = [*(ROOT / 'test').rglob('*.py')]
    names = Counter(path.name for path in paths)
    assert [name for name, number in names.items() if number > 1
            and name not in ('conftest.py', '__init__.py', '__main__.py')] == []
    # a conftest is the one of whichever folder came first
    assert [path for path in paths if 'conftest' in packages_of(path)] == []


# ---- names ----------------------------------------------------------------------------------


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
    found = Counter(f'{path}:{attribute}' for path, tree in package().items()
                    for attribute in underscores(tree))
    assert dict(found) == KNOWN


# ---- annotations ----------------------------------------------------------------------------


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
    return any(isinstance(node, ast.Name) and node.id in KERNEL_DECORATORS
               for decorator in function.decorator_list for node in ast.walk(decorator))


def unannotated(tree):
    """Return the names of functions that lack an annotation and are no kernels."""
    return [name for name, function in functions(tree) if not is_kernel(function)
            and (function.returns is None and function.name != '__init__'
                 or any(one.annotation is None and one.arg not in ('self', 'cls')
                        for one in (*function.args.posonlyargs, *function.args.args,
                                    *function.args.kwonlyargs)))]


def test_all_functions_but_kernels_are_annotated():
    """Rooms with kernels do not oblige mypy to look for annotations: this does."""
    lacking = {str(path): unannotated(tree) for path, tree in package().items()}
    assert not {name: those for name, those in lacking.items() if those}


def test_no_kernel_passes_more_than_thirty_arguments():
    # Python passes them as a tuple, of which numba 0.62 does not see the names (`replaced`)
    long = [f'{path}:{call.lineno}' for path, tree in package().items() for made in ast.walk(tree)
            if isinstance(made, ast.FunctionDef)
            and any(ast.unparse(mark).startswith('kernel') for mark in made.decorator_list)
            for call in ast.walk(made) if isinstance(call, ast.Call)
            and len(call.args) + 2 * len(call.keywords) > 30]
    assert long == []


# ---- headers and clean files -----------------------------------------------------------------


def test_every_source_file_has_its_header():
    try:
        paths = COPYRIGHT['sources']()
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('not a clone: what belongs to the sources is not known')
    assert len(paths) > 300
    assert [str(path.relative_to(ROOT)) for path in paths
            if not COPYRIGHT['has_header'](path.read_text())] == []
    assert 'Apache License' in (ROOT / 'LICENSE').read_text()
    assert '>Apache-2.0</license>' in (ROOT / 'package.xml').read_text()


@pytest.mark.parametrize(('first', 'rest'), [
    ('', '"""Doc."""\n'), ('#!/usr/bin/env python3\n', '"""Doc."""\n'),
    ('', '# Copyright 2026 somebody\nx = 1\n')])
def test_headers_are_added_once_below_the_interpreter(first, rest):
    after = first + COPYRIGHT['HEADER'] + rest
    assert not COPYRIGHT['has_header'](first + rest)
    assert COPYRIGHT['with_header'](first + rest) == COPYRIGHT['with_header'](after) == after


@pytest.mark.parametrize(('name', 'text', 'fault'), [
    ('a.py', 'x = 1 \n', 'line 1: blanks'), ('a.md', 'text', 'one line feed'),
    ('a.md', 'text\n\n', 'one line feed'), ('a.yaml', 'a: [1\n', 'expected'),
    ('a.toml', 'a = \n', 'Invalid'), ('a.txt', 'x\n' * 600_000, 'larger')])
def test_files_that_are_not_clean_are_found(tmp_path, name, text, fault):
    path = tmp_path / name
    path.write_text(text)
    assert [found for found in FILES['faults'](path) if fault in found]
    path.write_text('')
    assert FILES['faults'](path) == []


def test_hooks_need_no_network_and_name_what_is_there():
    yaml = pytest.importorskip('yaml')
    hooks = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text())['repos']
    assert [repo['repo'] for repo in hooks] == ['local']
    entries = [hook['entry'].split() for repo in hooks for hook in repo['hooks']]
    named = {word for entry in entries for word in entry if word.endswith('.py')}
    assert {'.ci/copyright.py', '.ci/files.py'} <= named
    assert not [name for name in named if not (ROOT / name).exists()]
