# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables, notebooks, plain Python, files: what an answer says of itself."""

import json
from base64 import b64decode

import numpy as np
import pytest
from specimens import values

from dlo_planner import InvalidTask, Limits, Plan, Shape, replay
from dlo_planner.pictured import plain
from dlo_planner.results import Motion, ValidationReport

NAMES = ['Shape', 'Plan', 'Motion', 'ValidationReport']


def rows(text):
    """Return quantity -> rest of the line of a summary."""
    head, *lines = text.splitlines()
    return head, {line[2:].split('  ', 1)[0].strip(): line[2:].split('  ', 1)[1].split()
                  for line in lines}


def test_the_table_of_a_shape_says_what_the_shape_says():
    shape = values()['Shape']
    head, said = rows(shape.summary())
    assert head == ('Shape of a DLO: 1 m, diameter 20 mm, 100 g/m, EI 1 N m^2, GJ 0.7 N m^2, '
                    'w L^3/EI 0.981')
    assert said['status'] == ['converged']
    assert said['length'] == ['1', 'm']
    assert float(said['stability'][0]) == pytest.approx(shape.stability, rel=1e-3)
    assert float(said['sharpest bend, radius'][0]) == pytest.approx(shape.bend_radius.min(),
                                                                    rel=1e-3)
    force = np.linalg.norm(shape.gripper_wrench[:3])
    assert said['gripper bears, force'] == [f'{force:.4g}', 'N']


def test_the_table_of_a_plan_says_the_worst():
    plan = values()['Plan']
    said = rows(plan.summary())[1]
    assert said['clearance'] == [f'{plan.clearance.min():.4g}', 'm']
    assert said['stability'] == [f'{plan.stability.min():.4g}']
    assert said['misalignment'][1] == 'deg'
    assert said['bend margin'] == ['not', 'looked', 'at', '1/m']


def test_the_tables_of_motions_and_reports():
    motion, report = values()['Motion'], values()['ValidationReport']
    said = rows(motion.summary())[1]
    assert said['instants'] == ['3'] and said['duration'] == ['0.02', 's']
    said = rows(report.summary())[1]
    assert said['safe'] == ['no'] and 'in motion' in ' '.join(said['reason'])
    assert said['swing'] == ['not', 'looked', 'at', 'm']


@pytest.mark.parametrize('name', NAMES)
def test_a_notebook_shows_a_line_and_a_thumbnail(name):
    value = values()[name]
    html = value._repr_html_()
    assert repr(value) in html.replace('&#x27;', "'").replace('&gt;', '>').replace('&lt;', '<')
    picture = b64decode(html.split('base64,')[1].split('"')[0])
    assert picture.startswith(b'\x89PNG')
    assert len(html) < 100_000


@pytest.mark.parametrize('name', NAMES)
def test_plain_python_says_all_that_is_public(name):
    value = values()[name]
    known = value.to_dict()
    json.dumps(known)
    assert all(not key.startswith('_') for key in known)
    for key, content in known.items():
        if isinstance(getattr(value, key), np.ndarray):
            array = getattr(value, key)
            if not array.size:  # lists without numbers say nothing of further dimensions
                assert content == array.tolist()
                continue
            np.testing.assert_array_equal(content, array)
            assert isinstance(content, list)


def test_plain_python_of_what_is_inside():
    plan = values()['Plan'].to_dict()
    pose = values()['Plan'].grippers[0]
    assert plan['grippers'][0] == {'position': pose.position.tolist(),
                                   'quaternion': pose.quaternion.tolist()}
    assert plan['status'] == 'complete'
    assert plan['shapes'][0]['gripper'] == plan['grippers'][0]
    assert plain({'a': (np.float64(1.5), None, True)}) == {'a': [1.5, None, True]}
    assert plain(np.cos) == repr(np.cos)


def test_a_motion_is_a_row_of_instants():
    motion = values()['Motion']
    assert len(list(motion)) == len(motion) == 3
    last = motion[-1]
    assert last.time == motion.times[-1] and last.shape is motion.shapes[-1]
    np.testing.assert_array_equal(last.velocities, motion.velocities[-1])
    assert [one.kinetic_energy for one in motion[1:]] == motion.kinetic_energy[1:].tolist()
    with pytest.raises(IndexError):
        motion[3]


@pytest.mark.parametrize('ending', ['npz', 'json'])
def test_a_report_is_saved_with_its_trajectory(tmp_path, ending):
    simulator, plan = values()['DirectSimulator'], values()['Plan']
    for report in (values()['ValidationReport'],
                   replay(simulator, plan, limits=Limits(linear_speed=0.05), tolerance=0.05)):
        report.save(tmp_path / f'report.{ending}')
        again = ValidationReport.load(tmp_path / f'report.{ending}')
        assert again == report
        assert again.safe == report.safe
    times = np.linspace(0, report.trajectory.duration, 7)
    for mine, theirs in zip(report.trajectory.at(times), again.trajectory.at(times), strict=True):
        np.testing.assert_array_equal(np.array([getattr(one, 'matrix', one) for one in mine]),
                                      np.array([getattr(one, 'matrix', one) for one in theirs]))


def rewritten(source, target, **changes):
    """Write an npz file anew; a change to None leaves an array out."""
    with np.load(source) as stored:
        arrays = {**stored, **changes}
    np.savez(target, **{name: one for name, one in arrays.items() if one is not None})


def test_a_file_says_what_it_holds(tmp_path):
    values()['Plan'].save(tmp_path / 'plan.npz')
    for kind in (Shape, Motion, ValidationReport):
        with pytest.raises(InvalidTask, match=f'holds a {kind.__name__}, it holds a Plan'):
            kind.load(tmp_path / 'plan.npz')
    rewritten(tmp_path / 'plan.npz', tmp_path / 'later.npz', format=3)
    with pytest.raises(InvalidTask, match='format 2, it has 3'):
        Plan.load(tmp_path / 'later.npz')
