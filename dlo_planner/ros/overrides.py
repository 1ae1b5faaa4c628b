# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameter values given at the start (`-p`, a YAML file)."""

from rclpy.node import Node

# Each node has these anyway.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')


def take_overrides(node: Node) -> dict[str, object]:
    """Return the values given at the start, name -> value, and undeclare them.

    Parameters
    ----------
    node : Node
        Made with `automatically_declare_parameters_from_overrides=True`, which is the public way to
        the names of all of them; nothing else has been declared yet.

    Raises
    ------
    rclpy.exceptions.ParameterException
        A value was given as null.
    """
    names = [name for name in node.list_parameters([], 0).names if name not in _OF_RCLPY]
    values = {name: node.get_parameter(name).value for name in names}
    for name in names:
        node.undeclare_parameter(name)
    return values
