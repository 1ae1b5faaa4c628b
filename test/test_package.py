# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is built and declared: one version, complete archives, a sample that runs from the wheel.

Tests need no more than package.xml declares: all are collected without the extras.
"""

import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest

import dlo_planner
from dlo_planner.kernels import WANTED

ROOT = Path(__file__).parent.parent
EXTRAS = ('dask', 'distributed', 'domain_coordinator', 'example_robot_data', 'importlinter',
          'mujoco', 'pinocchio', 'playwright', 'rosbags', 'trimesh', 'viser')
COLLECT_WITHOUT_EXTRAS = f"""
import sys
sys.modules.update(dict.fromkeys({EXTRAS!r}))
import pytest
sys.exit(pytest.main(['--collect-only', '-q', '-p', 'no:cacheprovider', *sys.argv[1:]]))
"""


def test_the_version_is_the_same_everywhere():
    version = dlo_planner.__version__
    assert re.fullmatch(r'\d+\.\d+\.\d+', version)
    assert ElementTree.parse(ROOT / 'package.xml').findtext('version') == version
    assert re.search(r'^version: (.+)$', (ROOT / 'CITATION.cff').read_text(), re.M)[1] == version
    newest = re.search(r'^(\d\S+) \((.+)\)$', (ROOT / 'CHANGELOG.rst').read_text(), re.M)
    assert newest[1] == version
    released = re.search(r'^date-released: (.+)$', (ROOT / 'CITATION.cff').read_text(), re.M)
    assert released[1] == newest[2]


def test_the_oldest_versions_are_those_that_setup_allows():
    pinned = dict(re.findall(r'^(\w+)==([\d.]+)$', (ROOT / '.ci' / 'oldest.txt').read_text(), re.M))
    allowed = dict(re.findall(r"'(\w+)>=([\d.]+)[',]", re.search(
        r'install_requires.*(?=    data_files)', (ROOT / 'setup.py').read_text(), re.DOTALL)[0]))
    skipped = {'pin', 'sphinx'}  # needs a newer NumPy; is for the site
    assert pinned.keys() == allowed.keys() - skipped
    assert not [name for name, version in pinned.items() if not version.startswith(allowed[name])]


def test_numba_is_asked_for_as_kernels_know_it():
    for name in ('setup.py', 'README.md', 'docs/start.md', 'package.xml', 'pyproject.toml',
                 'requirements.txt'):
        assert WANTED in (ROOT / name).read_text(), name


def test_addresses_stand_in_one_place():
    package = ElementTree.parse(ROOT / 'package.xml')
    homes = {url.get('type'): url.text for url in package.findall('url')}
    mails = {one.get('email') for one in package.iter() if one.get('email')}
    citation = (ROOT / 'CITATION.cff').read_text()
    assert re.findall(r'^repository-code: (.+)$', citation, re.M) == [
        home for kind, home in homes.items() if kind == 'repository']
    files = [*ROOT.glob('*.md'), *ROOT.glob('*.cff'), ROOT / 'setup.py', ROOT / 'docs' / 'conf.py',
             *(ROOT / 'docs').glob('*.md'), *(ROOT / '.github').rglob('*.m*')]
    text = '\n'.join(path.read_text() for path in files)
    assert set(re.findall(r'[\w.+-]+@[\w-]+\.\w+', text)) <= mails
    for address in [*homes.values(), *mails, text]:  # domains that are somebody's, or examples
        assert not re.search(r'example\.(com|org|net)', address)
    # who clones is told from where, as soon as there is such a place
    assert text.count('git clone') == text.count(
        f'git clone {homes.get("repository", "<this repository>")}')


@pytest.fixture(scope='module')
def archives(tmp_path_factory):
    """Build sdist and, from it, wheel; return their paths."""
    pytest.importorskip('build')
    source = tmp_path_factory.mktemp('source') / 'dlo_planner'
    # a copy of what git would give: a build leaves folders beside the sources
    listed = subprocess.run(['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
                            cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip('not a clone: what belongs to the sources is not known')
    for name in filter(None, listed.stdout.split('\0')):
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
            (source / name).chmod((ROOT / name).stat().st_mode)
    out = tmp_path_factory.mktemp('dist')
    done = subprocess.run([sys.executable, '-m', 'build', '--no-isolation', '--outdir', str(out),
                           str(source)], capture_output=True, text=True, check=False,
                          env={**os.environ, 'DLO_PLANNER_PREBUILD': '0'})  # it takes minutes
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return next(out.glob('*.tar.gz')), next(out.glob('*.whl'))


@pytest.mark.sweep
def test_the_wheel_has_all_modules_and_files(archives):
    names = set(zipfile.ZipFile(archives[1]).namelist())
    modules = {str(path.relative_to(ROOT)) for package in ('dlo_planner', 'msg_helpers')
               for path in (ROOT / package).rglob('*.py')} | {
                   f'{package}/py.typed' for package in ('dlo_planner', 'msg_helpers')}
    assert modules <= names
    shared = {name.split('/data/share/dlo_planner/')[-1] for name in names
              if '/data/share/dlo_planner/' in name}
    wanted = {f'{folder}/{path.name}' for folder in ('config', 'launch')
              for path in (ROOT / folder).glob('*.*')}
    assert wanted | {'package.xml'} <= shared
    assert not [name for name in names if name.startswith(('test', 'benchmarks', 'docs'))]


@pytest.mark.sweep
def test_the_sdist_can_be_tested_and_documented(archives):
    with tarfile.open(archives[0]) as archive:
        names = {name.split('/', 1)[1] for name in archive.getnames() if '/' in name}
    assert {'README.md', 'LICENSE', 'CITATION.cff', 'package.xml', 'pyproject.toml', 'Makefile',
            'rosdoc2.yaml', 'docs/conf.py', 'docs/made_pages.py', 'requirements.lock',
            'test/test_package.py', 'test/data', 'examples/tutorials/predict.py',
            'scripts/planner_node', 'resource/dlo_planner', '.ci/run'} <= names
    assert not [name for name in names if name.endswith(('.pyc', '.nbc', '.nbi'))]


@pytest.mark.sweep
def test_the_sample_of_the_readme_runs_from_the_wheel(archives, tmp_path):
    place = tmp_path / 'installed'
    done = subprocess.run([sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps',
                           '--no-index', '--disable-pip-version-check', '--target', str(place),
                           str(archives[1])], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    sample = re.search(r'```python\n(.*?)```', (ROOT / 'README.md').read_text(), re.DOTALL)[1]
    # kernels that were compiled for these sources serve: their caches go by content
    compiled = ROOT / 'dlo_planner' / 'compiled'  # which a wheel brings along, left out above
    if compiled.is_dir():
        shutil.copytree(compiled, place / 'dlo_planner' / 'compiled')
    ends = 'import dlo_planner; print(dlo_planner.__file__, dlo_planner.__version__)'
    done = subprocess.run([sys.executable, '-c', f'{sample}\n{ends}'], capture_output=True,
                          text=True, check=False, cwd=tmp_path,
                          env={**os.environ, 'PYTHONPATH': str(place)})
    assert done.returncode == 0, done.stderr
    assert str(place) in done.stdout and dlo_planner.__version__ in done.stdout


def test_the_extras_are_declared_where_they_are_asked_for():
    setup = (ROOT / 'setup.py').read_text()
    declared = set(re.findall(r"^        '(\w+)': \[", setup, re.M))
    assert {'figures', 'cell', 'arm', 'view', 'cluster', 'docs', 'test', 'peers'} <= declared
    said = set(re.findall(r"extra `\[?(\w+)\]?`", ''.join(
        path.read_text() for path in (ROOT / 'dlo_planner').rglob('*.py'))))
    assert said and said <= declared


@pytest.mark.parametrize(('prebuild', 'tagged'), [('0', False), (None, True)])
def test_a_wheel_with_compiled_kernels_is_for_one_python(monkeypatch, prebuild, tagged):
    given = {}
    monkeypatch.setattr('setuptools.setup', lambda **options: given.update(options))
    monkeypatch.delenv('DLO_PLANNER_PREBUILD', raising=False)
    if prebuild is not None:
        monkeypatch.setenv('DLO_PLANNER_PREBUILD', prebuild)
    runpy.run_path(str(ROOT / 'setup.py'))
    assert given['distclass']().has_ext_modules() is tagged


@pytest.mark.parametrize('package', ['dlo_planner', 'msg_helpers'])
def test_the_package_says_that_it_is_typed(package):
    assert (ROOT / package / 'py.typed').exists()
    assert 'py.typed' in (ROOT / 'setup.py').read_text()


@pytest.mark.sweep
@pytest.mark.parametrize('files', [
    ['test'], files := ['test/ros/test_state.py', 'test/parallel', 'test/direct/test_held.py'],
    files[::-1]], ids=['all', 'some', 'some, backwards'])
def test_tests_are_collected_in_any_choice_without_extras(files):
    pytest.importorskip('rclpy')
    done = subprocess.run([sys.executable, '-c', COLLECT_WITHOUT_EXTRAS, *files], cwd=ROOT,
                          text=True, capture_output=True, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    assert all(f'{file}' in done.stdout for file in files)
    assert 'error' not in done.stdout.splitlines()[-1]
