# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Values given at the start: taken with their types, and named where they mean nothing."""

from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from dlo_planner import InvalidTask, Pose
from dlo_planner.execute.execution import Execution
from dlo_planner.ros.node import declare, take_overrides
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.scene_monitor import SceneMonitor
from dlo_planner.ros.state import State, Store
from dlo_planner.ros.status import Shared
from dlo_planner.settings.build import NEEDED
from dlo_planner.settings.parameters import PARAMETERS, unknown_parameter


def node_with(context, **values):
    """Return a node that was given these values; '__' stands for '.'."""
    return Node('given', context=context, automatically_declare_parameters_from_overrides=True,
                parameter_overrides=[Parameter(name.replace('__', '.'), value=value)
                                     for name, value in values.items()])


@pytest.mark.parametrize(('name', 'meant'), [
    ('rod.lenght', 'rod.length'), ('length', 'rod.length'), ('Rod.Length', 'rod.length'),
    ('rod.young_modulus', 'rod.youngs_modulus'), ('threading.waypoint', 'threading.waypoints'),
    ('rod.dampening', 'rod.damping'), ('simulator.nelements', 'simulator.n_elements')])
def test_a_misspelt_name_is_recognized(name, meant):
    assert unknown_parameter(name, PARAMETERS).endswith(f'did you mean {meant}?')
    assert name in unknown_parameter(name, PARAMETERS)


def test_no_guess_at_what_is_like_nothing():
    text = unknown_parameter('xqzw', PARAMETERS)
    assert 'xqzw' in text and 'did you mean' not in text


def test_all_values_are_taken_and_nothing_of_rclpy(context):
    node = node_with(context, rod__length=2, rod__lenght=3.0, use_sim_time=False)
    assert take_overrides(node) == {'rod.length': 2, 'rod.lenght': 3.0}
    assert not node.has_parameter('rod.lenght')
    assert node.has_parameter('use_sim_time')
    node.destroy_node()


def test_values_are_declared_with_the_types_and_limits_of_the_table(context):
    wire = {f'rod__{name}': PARAMETERS[f'rod.{name}'].default for name in NEEDED['round']}
    node = node_with(context, **wire | {'rod__length': 2}, rod__name='x', gravity=[0, 0, -10],
                     nonsense__entirely=1)
    declare(node)
    assert node.get_parameter('rod.length').value == 2.0
    assert node.get_parameter('rod.length').type_ is Parameter.Type.DOUBLE
    assert list(node.get_parameter('gravity').value) == [0.0, 0.0, -10.0]
    assert node.describe_parameter('rod.length').floating_point_range[0].to_value == 100.0
    assert not node.has_parameter('nonsense.entirely')
    node.destroy_node()


@pytest.mark.parametrize(('given', 'named'), [
    ({'rod__name': 'mine'}, 'rod.length, rod.diameter, rod.density'),
    ({'rod__length': 2.0}, 'rod.diameter'),
    ({'rod__mas_per_length': 0.1}, 'mas_per_length does not exist'),
    ({'rod__section': 'stiffness'}, 'rod.bending_stiffness')])
def test_no_wire_stands_in_for_a_dlo_that_is_described_in_part(context, given, named):
    node = node_with(context, **given)
    with pytest.raises(InvalidTask, match=named):
        declare(node)
    node.destroy_node()


def test_a_node_that_is_told_nothing_of_a_dlo_has_the_launch_files(context):
    node = node_with(context)
    declare(node)
    assert node.get_parameter('rod.length').value == 1.0
    assert node.get_parameter('rod.diameter').value == 1e-3
    node.destroy_node()


VALUES = {name: entry.default for name, entry in PARAMETERS.items()}
FIXED = ('constraints.', 'cutouts.', 'decelerate', 'gravity', 'incoming', 'observe.', 'simulator.',
         'spread.', 'tool.', 'workspace.', 'threading.linear', 'threading.angular',
         'threading.may_yield', 'execute.horizon', 'execute.longest_pause',
         'execute.enable_timeout', 'execute.through', 'cmd_timeout', 'arm.tool_link', 'arm.joints',
         'arm.base.')


def judged(phase, **changed):
    """Return what a node says to parameters while an execution is in a phase."""
    made = []
    node = SimpleNamespace(add_on_set_parameters_callback=made.append,
                           add_post_set_parameters_callback=lambda _: None,
                           add_latched=lambda *_: None)
    execution = Execution(None, Pose.identity(), 'world', phase=phase)
    state = State(Scene.of(VALUES), execution=execution)
    SceneMonitor(Shared(node, Store(state), None, None, None, None), None)
    return made[0]([Parameter(name.replace('__', '.'), value=value)
                    for name, value in changed.items()])


@pytest.mark.parametrize(('changed', 'said'), [
    ({'rod__density': 8.96}, 'density 8.96 kg/m^3'), ({'rod__density': 8000.0}, ''),
    ({'threading__waypoints': 7}, '')])
def test_doubts_about_another_dlo_are_in_the_log(changed, said):
    made, warned = [], []
    node = SimpleNamespace(add_on_set_parameters_callback=lambda _: None,
                           add_post_set_parameters_callback=made.append,
                           add_latched=lambda *_: None,
                           get_logger=lambda: SimpleNamespace(warning=warned.append))
    status = SimpleNamespace(answering=lambda *_, **__: nullcontext(), info=lambda _: None)
    store = Store(State(Scene.of(VALUES)))
    SceneMonitor(Shared(node, store, None, status, None, None), None)
    made[0]([Parameter(name.replace('__', '.'), value=value) for name, value in changed.items()])
    assert len(warned) == bool(said) and all(said in one for one in warned)
    assert store.state.scene['rod.density'] == changed.get('rod__density', VALUES['rod.density'])


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
