# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The examples of README and docs/library.md run as printed, and do what they say."""

import re
from pathlib import Path

import numpy as np
import pytest

import dlo_planner
from dlo_planner import Motion, Plan, Pose, Shape

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / 'README.md', ROOT / 'docs' / 'library.md']  # one goes on from the other


def run_examples():
    """Run all python blocks one after the other; return their names and what each printed."""
    printed = []

    def note(*values, **_):
        printed.append(values)

    names = {'print': note}
    for page in PAGES:
        for block in re.findall(r'```python\n(.*?)```', page.read_text(), re.DOTALL):
            exec(compile(block, str(page), 'exec'), names)
    return names, printed


def test_the_examples_do_what_they_say():
    # one test: the examples take a while, and run once on whatever worker has them
    names, printed = run_examples()
    check_prints(printed)
    check_shapes_and_plans(names)
    check_first_example(names, printed)
    check_cell(names)


def numbers(value):
    """Yield all numbers in what an example prints."""
    if isinstance(value, Pose):
        yield from (*value.position, *value.quaternion)
    elif isinstance(value, str):
        return
    elif isinstance(value, list | tuple):
        for part in value:
            yield from numbers(part)
    elif hasattr(value, 'force') and hasattr(value, 'normal'):
        yield from (value.s, value.force, *value.normal)
    elif value is not None:
        yield from np.ravel(value).astype(float)


def check_prints(printed):
    assert len(printed) > 10
    for values in printed:
        found = list(numbers(values))
        assert found and np.isfinite(found).all(), values


def check_shapes_and_plans(names):
    seen = []
    for name, value in names.items():
        if isinstance(value, Shape):
            assert value.converged and value.residual < 1e-8, name
            # a round DLO between two ball joints turns freely about itself: it is neutral
            assert abs(value.stability) < 1e-12 if name == 'hung' else value.stability > 0, name
            assert np.isfinite(value.positions).all()
        elif isinstance(value, Plan):
            assert value.fraction == 1 and value.stability.min() > 0, name
            # a contact rolls on its bar by what the mesh leaves open
            most = 1e-4 if value.shapes[0].contacts else 1e-6
            assert value.position_error.max() < most and value.misalignment.max() < most, name
        elif isinstance(value, Motion):
            assert value.converged, name
        else:
            continue
        seen.append(type(value))
    assert seen.count(Shape) >= 2 and seen.count(Plan) >= 2


def check_first_example(names, printed):
    tip, stability, estimate = printed[0]
    assert 0 < tip[0] < 1 and abs(tip[1]) < 1e-9 and 0 < tip[2] < 1  # it hangs, in its plane
    assert 0 < stability < 1 and 0 < estimate <= 1e-5
    first, last, least, room = printed[1]
    assert isinstance(first, Pose) and last > 0 and least > 0
    assert 0.5 * names['hole'].radius < room < names['hole'].radius
    # the DLO goes through the hole, along its normal
    shape = dlo_planner.DirectSimulator(names['wire']).solve(first)
    np.testing.assert_allclose(shape.positions[-1], names['hole'].center, atol=1e-3)
    np.testing.assert_allclose(shape.tangents[-1], names['hole'].normal, atol=1e-3)


def check_cell(names):
    cell, plan = names['cell'], names['plan']
    for gripper in plan.grippers:
        assert (gripper.position > cell.lower).all() and (gripper.position < cell.upper).all()
    behind = (np.array([pose.position for pose in plan.grippers]) - names['hole'].center
              ) @ names['hole'].normal
    assert behind.max() <= -0.1 + 1e-9  # gripper_clearance
    np.testing.assert_allclose(names['way'].grippers[0].matrix, names['now'].matrix, atol=1e-9)
    np.testing.assert_allclose(names['way'].grippers[-1].matrix, plan.grippers[0].matrix,
                               atol=1e-9)


def test_all_that_it_imports_is_public():
    imported = set()
    for page in PAGES:
        for block in re.findall(r'from dlo_planner import (\([^)]*\)|[^\n]*)', page.read_text()):
            imported |= {name.strip() for name in block.strip('()').split(',') if name.strip()}
    assert len(imported) > 15
    assert imported <= set(dlo_planner.__all__)


def test_the_readme_is_short():
    lines = PAGES[0].read_text().splitlines()
    assert len(lines) <= 120
    assert [line for line in lines if len(line) > 100 and not line.startswith('![')] == []


@pytest.mark.parametrize('page', [*ROOT.glob('*.md'), *ROOT.glob('docs/*.md')],
                         ids=lambda page: page.name)
def test_linked_files_exist(page):
    links = re.findall(r'\]\(([^)#:]+)\)', page.read_text())
    made = {f'made/{path.stem}.md' for path in (ROOT / 'examples' / 'tutorials').glob('*.py')}
    made |= {'made/gallery.md', 'made/layers.md', 'made/parameters.md'}
    assert links or page.name != 'README.md'
    assert [link for link in links
            if link.removeprefix('../') not in made and not (page.parent / link).exists()] == []
