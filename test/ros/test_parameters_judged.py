# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Which parameters may change while a plan is executed; without a node."""

from types import SimpleNamespace

import pytest
from rclpy.parameter import Parameter

from dlo_planner import Pose
from dlo_planner.execute.execution import Execution
from dlo_planner.ros.scene import build_scene
from dlo_planner.ros.scene_monitor import SceneMonitor
from dlo_planner.ros.state import State, Store
from dlo_planner.ros.status import Shared
from dlo_planner.settings.parameters import PARAMETERS

VALUES = {name: entry.default for name, entry in PARAMETERS.items()}
FIXED = ('constraints.', 'cutouts.', 'decelerate', 'gravity', 'incoming', 'observe.', 'simulator.',
         'spread.', 'tool.', 'workspace.', 'threading.linear', 'threading.angular',
         'threading.may_yield', 'execute.horizon', 'execute.longest_pause',
         'execute.enable_timeout', 'cmd_timeout')


def judged(phase, **changed):
    """Return what a node says to parameters while an execution is in a phase."""
    made = []
    node = SimpleNamespace(add_on_set_parameters_callback=made.append,
                           add_post_set_parameters_callback=lambda _: None,
                           add_latched=lambda *_: None)
    execution = Execution(None, Pose.identity(), 'world', phase=phase)
    state = State(build_scene(VALUES), VALUES, execution=execution)
    SceneMonitor(Shared(node, Store(state), None, None, None, None), None)
    return made[0]([Parameter(name.replace('__', '.'), value=value)
                    for name, value in changed.items()])


@pytest.mark.parametrize('phase', ['running', 'waiting', 'settling', 'stopping'])
def test_limits_guards_and_tool_do_not_change_while_a_plan_is_executed(phase):
    for changed in ({'threading__linear_speed': 10.0}, {'constraints__path__shape': 0.0},
                    {'tool__position': [0.0, 0.0, 0.1]}, {'rod__name': 'w', 'rod__length': 2.0}):
        said = judged(phase, **changed)
        assert not said.successful
        assert f'{list(changed)[-1].replace("__", ".")}: a plan is being executed' in said.reason
        assert judged('stopped', **changed).successful
    assert judged(phase, threading__linear_speed=VALUES['threading.linear_speed'],
                  threading__waypoints=7, rod__name='w').successful


def test_nothing_that_an_execution_depends_on_is_free():
    free = [name for name, entry in PARAMETERS.items() if entry.while_executing]
    assert [name for name in free if name.startswith(FIXED)] == []
    assert [name for name in free if name.startswith('rod.')] == ['rod.name']
