# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Values given at the start: taken with their types, and named where they mean nothing."""

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from dlo_planner import InvalidTask
from dlo_planner.ros.node import declare, take_overrides
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
    ({}, 'rod.length, rod.diameter, rod.density'), ({'rod__length': 2.0}, 'rod.diameter'),
    ({'rod__mas_per_length': 0.1}, 'mas_per_length does not exist'),
    ({'rod__section': 'stiffness'}, 'rod.bending_stiffness')])
def test_no_wire_stands_in_for_a_dlo_that_is_described_in_part(context, given, named):
    node = node_with(context, **given)
    with pytest.raises(InvalidTask, match=named):
        declare(node)
    node.destroy_node()
