# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The example of the README runs as printed, and does what it says."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import dlo_planner
from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose
from dlo_planner.cli.main import main
from dlo_planner.settings.build import rod_of
from dlo_planner.settings.yaml_files import read_values

ROOT = Path(__file__).parent.parent
README = (ROOT / 'README.md').read_text()


def test_the_example_does_what_it_says():
    printed, block = [], re.search(r'```python\n(.*?)```', README, re.DOTALL)[1]
    assert len(block.splitlines()) <= 9
    names = {'print': lambda *values: printed.append(values)}
    exec(compile(block, 'README.md', 'exec'), names)
    (tip, stability, estimate), (first, last, least, room) = printed
    assert 0 < tip[0] < 1 and abs(tip[1]) < 1e-9 and 0 < tip[2] < 1  # it hangs, in its plane
    assert 0 < stability < 1 and 0 < estimate <= 1e-5
    plan = names['plan']
    assert plan.fraction == 1 and plan.position_error.max() < 1e-6
    assert last > 0 and least > 0 and 0.5 * names['hole'].radius < room < names['hole'].radius
    # the DLO goes through the hole, along its normal
    shape = dlo_planner.DirectSimulator(names['wire']).solve(first)
    np.testing.assert_allclose(shape.positions[-1], names['hole'].center, atol=1e-3)
    np.testing.assert_allclose(shape.tangents[-1], names['hole'].normal, atol=1e-3)


@pytest.mark.sweep
def test_its_commands_say_what_it_says(tmp_path, monkeypatch):
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    planned, refused = re.findall(r'^    dlo-planner (thread .*)$', README, re.M)
    planned = planned.replace(' -o hose.gif', '')  # other tests make films
    done = CliRunner().invoke(main, shlex.split(planned))
    assert done.exit_code == 0 and re.search('safe +yes', done.output), done.output
    assert {path.name for path in tmp_path.iterdir()} == {'motion.csv'}
    done = CliRunner().invoke(main, shlex.split(refused))
    assert done.exit_code == 3 and '(clearance, by 0.0005 m)' in done.output


def test_its_service_call_names_what_there_is():
    service, kind = re.search(r'ros2 service call /dlo_planner/(\w+) nav_msgs/srv/(\w+)', README
                              ).groups()
    assert kind == 'GetPlan' and f'~/{service}' in (ROOT / 'docs' / 'ros_interface.md').read_text()
    asked = yaml.safe_load(re.search(r'"(\{\s+start.*?)"', README, re.DOTALL)[1])
    (start, goal), hose = (Pose([one['pose']['position'].get(key, 0) for key in 'xyz'],
                                [0, 0, 0, 1]) for one in asked.values()), rod_of(
                                    read_values('rubber_hose')[0])
    assert np.linalg.norm(start.position - goal.position) <= hose.length
    assert InverseSimulator(DirectSimulator(hose)).thread(CutOut(goal)).fraction == 1


def test_the_readme_is_short():
    lines = README.splitlines()
    assert len(lines) <= 80
    assert [line for line in lines if len(line) > 100 and not line.startswith('![')] == []


WRITTEN = sorted(path for folder in (ROOT, ROOT / 'docs', ROOT / 'examples', ROOT / '.github')
                 for path in folder.glob('*.md' if folder == ROOT else '**/*.md')
                 if 'made' not in path.parts)


def anchors(page):
    """Return what links may name on a page: its headings in small letters, with hyphens."""
    headings = re.findall(r'^#+ (.*)$', page.read_text(), re.M)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


@pytest.mark.parametrize('page', WRITTEN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_linked_files_and_headings_exist(page):
    made = set(re.findall(r'^made/\w+$', (ROOT / 'docs' / 'index.md').read_text(), re.M))
    made = {ROOT / 'docs' / f'{name}.md' for name in made}
    links = re.findall(r'\]\(([^)\s]+)\)', re.sub(r'```.*?```', '', page.read_text(), flags=re.S))
    assert links or page.name != 'README.md' or page.parent != ROOT
    for link in links:
        if re.match('https?:|mailto:', link):
            continue
        name, _, heading = link.partition('#')
        linked = (page.parent / name).resolve() if name else page
        assert linked in made or linked.exists(), link
        assert not heading or linked in made or heading in anchors(linked), link


def test_pages_that_sources_name_exist():
    sources = [path for folder in ('dlo_planner', 'msg_helpers', 'benchmarks', 'test', 'examples',
                                   'config', 'launch', 'demo', 'scripts')
               for path in (ROOT / folder).rglob('*')
               if path.suffix in ('.py', '.toml', '.xml', '.yaml', '.md', '')
               and path.is_file() and 'compiled' not in path.parts]
    named = {(name, path.relative_to(ROOT).as_posix())
             for path in [*sources, *ROOT.glob('*.[a-z]*'), ROOT / 'Makefile'] if path.is_file()
             for name in re.findall(r'\bdocs/[\w/]+\.(?:md|rst|png|gif)', path.read_text())}
    assert len(named) > 20
    assert [one for one in sorted(named)
            if '/made/' not in one[0] and not (ROOT / one[0]).exists()] == []
