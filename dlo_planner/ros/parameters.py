# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: declared, as their values are typed."""

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from dlo_planner.errors import InvalidTask
from dlo_planner.settings.build import check_described, idle_warnings
from dlo_planner.settings.parameters import ENTRIES, Entry, unknown_parameter
from dlo_planner.settings.parameters import as_declared as typed

# Each node has these anyway.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')


def take_overrides(node: Node) -> dict[str, object]:
    """Return the values given at the start, name -> value, and undeclare them."""
    names = [name for name in node.list_parameters([], 0).names if name not in _OF_RCLPY]
    values = {name: node.get_parameter(name).value for name in names}
    for name in names:
        node.undeclare_parameter(name)
    return values


def descriptor(entry: Entry) -> ParameterDescriptor:
    """Return the rcl_interfaces/ParameterDescriptor of an Entry."""
    made = ParameterDescriptor(description=entry.description, read_only=entry.read_only)
    if entry.lowest is None or entry.highest is None:
        return made
    if isinstance(entry.default, float):
        made.floating_point_range = [FloatingPointRange(
            from_value=float(entry.lowest), to_value=float(entry.highest), step=0.0)]
    else:
        made.integer_range = [IntegerRange(
            from_value=int(entry.lowest), to_value=int(entry.highest), step=1)]
    return made


def declare(node: Any) -> None:
    """Declare all parameters with the values given at the start; warn of those that do not exist.

    A DLO that is described in part is refused. Whole numbers in YAML are taken for doubles where
    doubles are due.
    """
    given = take_overrides(node)
    section = str(given.get('rod.section', ENTRIES['rod.section'].default))
    check_described(given, section)
    for warning in idle_warnings(given, section):
        node.get_logger().warning(warning)
    for name, entry in ENTRIES.items():
        value = typed(name, given.pop(name, entry.default), entry.default)
        node.declare_parameter(name, value, descriptor(entry), ignore_override=True)
    for name in given:
        node.get_logger().warning(unknown_parameter(name, ENTRIES))


def as_declared(parameters: list[Parameter]) -> list[Parameter]:
    """Return Parameters with whole numbers made floats where floats are declared.

    A pre-set callback: `ros2 param set dlo_planner rod.length 1` sends an integer. What cannot be
    made what is declared stays as it is, and is refused by rclpy.
    """
    result = []
    for parameter in parameters:
        entry = ENTRIES.get(parameter.name)
        try:
            value = parameter.value if entry is None else typed(
                parameter.name, parameter.value, entry.default)
        except InvalidTask:
            value = parameter.value
        result.append(parameter if value is parameter.value or entry is None
                      else Parameter(parameter.name, value=value))
    return result
