"""Parameter values given at the start (`-p`, a YAML file); those that mean nothing are named."""

from collections.abc import Iterable
from difflib import get_close_matches

from rclpy.node import Node

# Each node has these anyway.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')


def take_overrides(node: Node) -> dict[str, object]:
    """Return the values given at the start, name -> value, and undeclare them.

    Args:
        node: made with `automatically_declare_parameters_from_overrides=True`, which is the public
            way to the names of all of them; nothing else has been declared yet

    Raises:
        rclpy.exceptions.ParameterException: a value was given as null
    """
    names = [name for name in node.list_parameters([], 0).names if name not in _OF_RCLPY]
    values = {name: node.get_parameter(name).value for name in names}
    for name in names:
        node.undeclare_parameter(name)
    return values


def unknown_override(name: str, known: Iterable[str]) -> str:
    """Return the warning about a value for a parameter that does not exist.

    Args:
        name: as it was given
        known: names of the parameters that exist
    """
    by_lower = {one.lower(): one for one in known}
    ends = {one.rsplit('.', 1)[-1]: one for one in by_lower}
    given = name.lower()
    near = get_close_matches(given, by_lower, 1) or [
        ends[end] for end in get_close_matches(given.rsplit('.', 1)[-1], ends, 1)]
    hint = f': did you mean {by_lower[near[0]]}?' if near else ''
    return f'parameter {name} does not exist, its value has no effect{hint}'
