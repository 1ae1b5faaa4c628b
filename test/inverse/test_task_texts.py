# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A text of a task means the same in Python, in a file, on the terminal and in the node."""

import pytest
from click.testing import CliRunner

from dlo_planner import CutOut, FarEnd, Insert, InvalidTask, Pose, Thread, ThreadTwo
from dlo_planner.cli.main import BAD_INPUT, main
from dlo_planner.inverse.task import Task
from dlo_planner.settings.tasks import close_task, open_task, read_task, task_from_yaml
from dlo_planner.settings.yaml_files import load_yaml
from dlo_planner.tasks import MoveTo

AT = Pose((0.4, 0, 1), (0, 0, 0, 1))
HOLE = CutOut(AT, radius=0.02)


def read(path, text):
    """Return the task that each door reads, by the door's name: a function."""
    path.write_text(text)
    return {'text': lambda: task_from_yaml(text, str(path)), 'file': lambda: read_task(path),
            'dict': lambda: Task.from_dict(load_yaml(text, str(path))),
            'node': lambda: close_task(open_task(text, str(path)), name=str(path))}


DOORS = pytest.mark.parametrize('door', ['text', 'file', 'dict', 'node'])


@DOORS
@pytest.mark.parametrize(('text', 'task'), [
    ('type: Thread\ncutout: {pose: {position: [0.4, 0, 1]}, radius: 0.02}', Thread(HOLE)),
    ('type: Thread\ncutout: {type: CutOut, pose: {position: {x: 0.4, z: 1}}, radius: 0.02}',
     Thread(HOLE)),
    ('type: Thread\ncutout: {pose: [0.4, 0, 1, 1, 0, 0], radius: 2e-2}', Thread(HOLE)),
    ('type: Insert\nbore: {pose: {position: [0.4, 0, 1], orientation: {w: 1}}, radius: 0.02}',
     Insert(HOLE)),
    ('{type: ThreadTwo, first: {pose: [0.4, 0, 1], radius: 0.02}, second: {pose: [0.4, 0, 1]}}',
     ThreadTwo(HOLE, CutOut(AT))),
    ('{type: MoveTo, poses: [[0.4, 0, 1]], far_end: {pose: [0.4, 0, 1], grip: pinned}}',
     MoveTo([AT], FarEnd(AT, 'pinned')))])
def test_every_door_understands_what_another_does(tmp_path, door, text, task):
    assert read(tmp_path / 'task.yaml', text)[door]() == task


@DOORS
@pytest.mark.parametrize(('text', 'said'), [
    ('{type: Thread, cuotut: {pose: [0.4, 0, 1]}}', 'cuotut: expected .* did you mean cutout?'),
    ('{type: Thread, cutout: {pose: [0.4, 0, 1], radus: 1}}', r'cutout.radus: .* mean radius?'),
    ('{type: Thread, cutout: {poes: [0.4, 0, 1]}}', r'cutout.poes: .* did you mean pose?'),
    ('{type: Thread, cutout: {pose: {positon: [0, 0, 1]}}}', r'positon: .* did you mean position?'),
    ('{type: Thread, cutout: {pose: [0.4, 0, 1], radius: 0}}', 'CutOut.radius = 0: .* > 0 m'),
    ('{type: Thread, cutout: {pose: [0.4, 0, 1], width: 0, height: 0}}', 'CutOut.width = 0'),
    ('{type: ThreadSequence, cutouts: [{pose: [0, 0, 1], radius: 0}, {pose: [1, 0, 1]}]}',
     r'cutouts\[0\]: CutOut.radius = 0'),
    ('{type: Minimize, penalties: [{type: PositionAt, s: 1, target: [0, 0, 1], wieght: 2}]}',
     r'penalties\[0\].wieght: .* did you mean weight?'),
    ('{type: Tread}', 'did you mean Thread?'),
    ('{type: Thread, cutout: {pose: [0.4, 0, 1], radius: 010}}', 'a number without a leading 0')])
def test_every_door_names_the_same_key(tmp_path, door, text, said):
    with pytest.raises(InvalidTask, match=said) as refused:
        read(tmp_path / 'task.yaml', text)[door]()
    assert door == 'dict' or str(tmp_path / 'task.yaml') in str(refused.value)


@pytest.mark.parametrize('own', ['', ', radius: null'])
def test_a_radius_that_is_not_said_is_the_one_asked_for_and_0_is_said(own):
    text = f'{{type: Thread, cutout: {{pose: [0.4, 0, 1]{own}}}}}'
    assert close_task(open_task(text), radius=0.02) == Thread(HOLE)
    with pytest.raises(InvalidTask, match='CutOut.radius = 0'):
        close_task({'type': 'Thread', 'cutout': {'pose': [0.4, 0, 1], 'radius': 0}}, radius=0.02)


def run(*arguments):
    return CliRunner().invoke(main, [str(one) for one in arguments])


def test_the_terminal_fills_in_the_radius_as_the_node_does(tmp_path):
    (tmp_path / 'task.yaml').write_text('{type: Thread, cutout: {pose: [0, 0, 1]}, depths: [0]}')
    given = ['plan', 'rubber_hose', tmp_path / 'task.yaml']
    assert 'clearance' in run(*given, '-p', 'cutouts.radius=0.02').output
    narrow = run(*given, '-p', 'cutouts.radius=0.001')
    assert narrow.exit_code != 0 and 'clearance' in narrow.output


@pytest.mark.parametrize(('more', 'said'), [
    (['--radius', '0'], '--radius = 0.0: expected a finite number > 0 m'),
    (['--deadline', '0'], '--deadline = 0.0: expected a finite number > 0 s')])
def test_an_explicit_0_is_no_default(more, said):
    result = run('thread', 'rubber_hose', '--hole', '0,0,1', *more)
    assert result.exit_code == BAD_INPUT and said in result.output
