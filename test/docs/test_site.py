# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The site: it builds without a warning, and nothing public is missing in it."""

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

import dlo_planner
import dlo_planner.arm
import dlo_planner.closed_loop
import dlo_planner.identify
import dlo_planner.parallel
import dlo_planner.penalties
import dlo_planner.results
import dlo_planner.rods
import dlo_planner.tasks
import dlo_planner.view
from dlo_planner.settings.parameters import PARAMETERS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
SHOWN = re.compile(r'^\.\. auto(?:class|function|exception):: (\w+)$', re.MULTILINE)


def shown(module):
    """Return the names that the pages of the API show of a module, in a list."""
    found = []
    for part in (DOCS / 'api' / 'index.rst').read_text().split('.. currentmodule:: ')[1:]:
        if part.splitlines()[0] == module:
            found += SHOWN.findall(part)
    return sorted(found)


@pytest.mark.parametrize('module', [dlo_planner, dlo_planner.arm, dlo_planner.view,
                                    dlo_planner.tasks, dlo_planner.penalties,
                                    dlo_planner.identify, dlo_planner.closed_loop,
                                    dlo_planner.rods,
                                    dlo_planner.results],
                         ids=lambda module: module.__name__)
def test_every_public_name_is_in_the_reference_once(module):
    assert shown(module.__name__) == sorted(module.__all__)


def test_every_public_name_of_parallel_is_in_the_reference_once():
    elsewhere = {'Shapes', 'solve_many'}  # with the direct simulator
    assert elsewhere < {*dlo_planner.__all__, *dlo_planner.results.__all__}
    assert shown('dlo_planner.parallel') == sorted({*dlo_planner.parallel.__all__} - elsewhere)


def test_every_module_of_msg_helpers_is_in_the_reference():
    text = (DOCS / 'api' / 'index.rst').read_text()
    modules = {path.stem for path in (ROOT / 'msg_helpers').glob('[a-z]*.py')}
    assert set(re.findall(r'automodule:: msg_helpers\.(\w+)', text)) == modules


def test_every_tutorial_is_on_a_page_that_is_listed(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    pages = import_module('made_pages').TUTORIALS
    scripts = {path.stem for path in (ROOT / 'examples' / 'tutorials').glob('[a-z]*.py')}
    assert sorted(name for names in pages.values() for name in names) == sorted(scripts)
    assert {f'made/{page}' for page in pages} <= set((DOCS / 'index.md').read_text().split())


def test_every_page_is_listed_once_and_none_is_longer_than_one_reads():
    pages = re.findall(r'^[\w/]+$', (DOCS / 'index.md').read_text(), re.M)
    assert len(pages) == len(set(pages)) <= 38
    written = {path.relative_to(DOCS).with_suffix('').as_posix() for path in DOCS.rglob('*.md')}
    parts = {name for name in written if re.match(r'reproduction/fig\d', name)}  # of one page
    made = {name for name in written if name.startswith('made/')}
    assert written - made - parts - {'index'} == {
        name for name in pages if not name.startswith(('made/', 'api/'))}
    longest = {name: (DOCS / f'{name}.md').stat().st_size for name in written - made
               if name not in ('theory', 'benchmarks')}
    assert not {name: size for name, size in longest.items() if size > 17_000}


def test_every_parameter_of_the_node_is_on_its_page(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = import_module('made_pages').parameters_page()
    assert sorted(re.findall(r'^\| `([\w.]+)` \|', page, re.M)) == sorted(PARAMETERS)
    assert '| `rod.length` | `1.0` | 0.001 to 100 | Length between gripper' in page
    assert {line.count('|') for line in page.splitlines() if line.startswith('|')} == {5}
    text = (DOCS / 'ros_interface.md').read_text()
    groups = {name.split('.')[0] for name in PARAMETERS if '.' in name}
    assert not [group for group in groups if f'`{group}.`' not in text]


def test_equations_are_drawn_without_a_network(monkeypatch):
    pytest.importorskip('latex2mathml')
    monkeypatch.syspath_prepend(DOCS)
    drawn = import_module('mathml').drawn
    text = (DOCS / 'theory.md').read_text()
    for formula in re.findall(r'\$+([^$]+)\$+', text):
        text = drawn(SimpleNamespace(astext=lambda formula=formula: formula), 'inline')
        assert text.startswith('<math') and '\\' not in re.sub('alttext=".*?"', '', text), formula
        assert ('bold' in text) == (r'\mathbf' in formula)


@pytest.mark.sweep
def test_rosdoc2_finds_the_site():
    yaml = pytest.importorskip('yaml')
    package = (ROOT / 'package.xml').read_text()
    name = re.search(r'<rosdoc2>(.*)</rosdoc2>', package).group(1)
    head, settings = yaml.safe_load_all((ROOT / name).read_text())
    assert head == {'type': 'rosdoc2 config', 'version': 1}
    sphinx, = (one['sphinx'] for one in settings['builders'] if 'sphinx' in one)
    assert (ROOT / sphinx['sphinx_sourcedir'] / 'conf.py').exists()


def test_the_site_is_configured_from_the_wrapper_of_rosdoc2(tmp_path):
    pytest.importorskip('sphinx')
    # rosdoc2 copies the folder, and puts in place of conf.py one that executes it
    (tmp_path / 'made_pages.py').write_text('raise ImportError("the copy, far from its sources")')
    (tmp_path / 'conf.py').write_text(f'import sys\nexec(open("{DOCS / "conf.py"}").read())\n'
                                      'import made_pages\nextensions.append("one.more")\n')
    done = subprocess.run(
        [sys.executable, '-c', 'from pathlib import Path\n'
         'from sphinx.config import eval_config_file\n'
         'read = eval_config_file(Path("conf.py").absolute(), None)\n'
         'print(read["extensions"][-1], read["release"], read["ROOT"])'],
        capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.stdout.split() == ['one.more', dlo_planner.__version__, str(ROOT)], done.stderr


@pytest.mark.sweep
def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip('sphinx')
    # pickled and written to a folder of the test: two runs at once do not meet
    done = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-W', '--keep-going', '-q', '-b', 'html',
         '-d', str(tmp_path / 'doctrees'), str(DOCS), str(tmp_path / 'html')],
        capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / 'html' / 'api' / 'index.html').read_text()
    assert 'class="py class"' in page
    # what ArrayLike stands for
    assert '_NestedSequence' not in page and 'gravity' in page and 'ArrayLike' in page
