# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The house: imports go one way down, kernels are compiled once."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# Rings that are still there: so many files of a room import each other. Fewer is better, none is
# right; a ring through two rooms is never allowed.
RINGS = {'dlo_planner.direct': 7, 'dlo_planner.plan': 8, 'dlo_planner.inverse': 6,
         'dlo_planner.execute': 2, 'dlo_planner.verify': 2, 'dlo_planner.ros': 2}


def _imports(source, modules):
    """Return what of `modules` a source imports: annotations and local imports included."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            whole = {f'{node.module}.{one.name}' for one in node.names}
            found |= whole & modules or {node.module}
    return found & modules


def _rings(graph):
    """Return the sets of modules that import each other."""
    reached = {}
    for start in graph:
        seen, waiting = set(), [start]
        while waiting:
            for other in graph[waiting.pop()] - seen:
                seen.add(other)
                waiting.append(other)
        reached[start] = seen
    return {frozenset(other for other in seen if one in reached[other])
            for one, seen in reached.items() if one in seen}


def _package(folder):
    paths = [path for name in ('dlo_planner', 'msg_helpers')
             for path in (folder / name).rglob('*.py')]
    sources = {'.'.join(path.relative_to(folder).with_suffix('').parts).removesuffix('.__init__'):
               path.read_text() for path in paths}
    return {name: _imports(source, set(sources)) - {name} for name, source in sources.items()}


def test_no_modules_import_each_other():
    counts = {}
    for ring in _rings(_package(ROOT)):
        rooms = {'.'.join(name.split('.')[:2]) for name in ring}
        assert len(rooms) == 1, f'a ring through rooms: {sorted(ring)}'
        room = rooms.pop()
        counts[room] = counts.get(room, 0) + len(ring)
    assert {room: count for room, count in counts.items() if count > RINGS.get(room, 0)} == {}


def test_a_ring_is_seen_wherever_its_imports_stand(tmp_path):
    graph = {'a': 'import b', 'b': 'def f():\n    from c import d', 'e': 'import a',
             'c.d': 'if TYPE_CHECKING:\n    from a import A'}
    imports = {name: _imports(source, set(graph)) for name, source in graph.items()}
    assert _rings(imports) == {frozenset({'a', 'b', 'c.d'})}


def test_imports_go_down_the_layers():
    linter = pytest.importorskip('importlinter.cli', reason='import-linter is not installed')
    assert linter.lint_imports(config_filename=str(ROOT / 'pyproject.toml'), no_cache=True) == 0


def test_core_does_not_import_ros():
    code = 'import dlo_planner, sys; sys.exit(any(m.startswith("rclpy") for m in sys.modules))'
    assert subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=False).returncode == 0
