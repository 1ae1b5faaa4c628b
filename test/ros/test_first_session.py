# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""docs/first_session.md, line by line in its order, as the launch file starts the node.

`ros2` itself is not on each machine: what its commands do is done by rclpy, what the launch file
starts by the stand-ins of `launching`, in this process. The robot is a process, as on the page.
"""

import re
import shlex
import subprocess
import sys
from contextlib import ExitStack

import pytest
from launching import command_line, started
from node_inside import Alive, state
from planner_here import context_of_its_own, planner_here
from planner_process import ENDS_WITH_US, PATIENCE, ROOM, ROOT, connected_client, options, until
from ros2_commands import commands_of, run_inside

from dlo_planner.execute.causes import Cause
from dlo_planner.settings.parameters import PARAMETERS

PAGE = (ROOT / 'docs' / 'first_session.md').read_text()
LINES = re.findall(r'^    (\S.*)$', PAGE, re.M)


def ready(node, line):
    """Wait until what a line speaks of is over, as its reader does."""
    proof = state(node).proof
    if proof is not None and re.search(r'/(execute|status)\b', line):
        assert until(lambda: state(node).proof.done, 10 * PATIENCE)
    if '/execute ' in line or 'far_end.hold free' in line:
        assert until(lambda: not state(node).executing)
    if '/cancel' in line:
        assert until(lambda: state(node).execution.done > 0.5)


@pytest.mark.sweep
def test_every_line_does_what_the_page_says(own_domain, monkeypatch):
    monkeypatch.setattr('planner_here.WIRE', ())
    with ExitStack() as stack:
        node = client = None
        for line in LINES:
            if line.startswith('ros2 launch dlo_planner '):
                (planner, values), = started(ROOT / 'launch' / line.split()[3])
                context = stack.enter_context(context_of_its_own())
                node = stack.enter_context(planner_here(
                    monkeypatch, context, *command_line(planner, values), *options(ROOM),
                    '-p', 'incoming_command_timeout:=0.5'))
                client = stack.enter_context(connected_client(Alive()))
                continue
            ready(node, line)
            if line.startswith('python3 '):
                robot = stack.enter_context(subprocess.Popen(
                    [*ENDS_WITH_US, sys.executable, *shlex.split(line)[1:]], cwd=ROOT))
                stack.callback(robot.terminate)
                heard = 'far_end' if 'far_end' in line else 'feedback'
                assert until(lambda node=node, heard=heard: getattr(state(node), heard) is not None)
                continue
            refused = re.search(r' +# refused: (\d+)$', line)
            command, = commands_of('    ' + line[:refused.start() if refused else None])
            said = run_inside(client, node, *command)
            assert said.startswith(f'{refused[1]}: ') if refused else not said, (line, said)
        assert state(node).execution.cause == Cause.DONE  # both arms came to their ends
        assert [one.name for one in state(node).execution.arms] == ['gripper', 'far_end']


def test_the_page_says_of_each_refusal_what_to_do():
    rows = re.findall(r'^\| ([\d, ]+) \| (.+) \|$', PAGE, re.M)
    numbers = [int(one) for row, _ in rows for one in row.split(',')]
    assert sorted(numbers) == sorted(int(cause) for cause in Cause if cause)
    for name in re.findall(r'`([a-z_]+\.[a-z_.]+)`', ' '.join(text for _, text in rows)):
        assert name in PARAMETERS, name
