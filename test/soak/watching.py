# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What comes out of the node, and how much memory it takes."""

import math
from collections import Counter
from contextlib import suppress
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.msg import Path as PathMsg
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory
from visualization_msgs.msg import MarkerArray

from dlo_planner.ros.lifecycle import LATCHED, LATEST, REQUEST

OUTPUTS = {
    '~/predicted_shape': (PathMsg, LATCHED), '~/gripper_trajectory': (PathMsg, LATCHED),
    '~/gripper_trajectory_timed': (MultiDOFJointTrajectory, LATCHED),
    '~/joint_trajectory': (JointTrajectory, LATCHED),
    '~/joint_commands_ahead': (JointTrajectory, REQUEST), '~/markers': (MarkerArray, LATCHED),
    '~/holds': (MarkerArray, LATCHED),
    '~/status': (DiagnosticStatus, LATCHED), '~/execution': (DiagnosticStatus, LATCHED),
    '~/gripper_command': (PoseStamped, REQUEST),
    '~/gripper_command_wrench': (WrenchStamped, REQUEST),
    **{f'~/{name}_wrench': (WrenchStamped, LATEST) for name in ('gripper', 'far_end')},
    '~/gripper_commands_ahead': (MultiDOFJointTrajectory, REQUEST),
    '/diagnostics': (DiagnosticArray, REQUEST)}
MEGABYTE = 1024.0  # kB


def not_finite(value, name: str = '') -> str:
    """Return the name of the first float in a message that is not finite, '' if there is none."""
    if isinstance(value, float):
        return '' if math.isfinite(value) else name
    if hasattr(value, 'get_fields_and_field_types'):
        parts = ((f'{name}.{one}', getattr(value, one))
                 for one in value.get_fields_and_field_types())
    elif isinstance(value, str | bytes | int) or not hasattr(value, '__iter__'):
        return ''
    else:
        parts = ((f'{name}[{k}]', one) for k, one in enumerate(value))
    return next(filter(None, (not_finite(one, path) for path, one in parts)), '')


class Watch:
    """Counts what comes on each topic, and keeps the names of numbers that are not finite.

    Args:
        client: PlannerClient
    """

    def __init__(self, client):
        self._node, self.came, self.odd = client.node, Counter(), []
        self._subscriptions = [
            self._node.create_subscription(kind, name.replace('~', client.planner, 1),
                                           lambda msg, name=name: self._look(name, msg), qos)
            for name, (kind, qos) in OUTPUTS.items()]

    def _look(self, name, msg):
        self.came[name] += 1
        found = not_finite(msg, name)
        if found:
            self.odd.append(found)

    def close(self):
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)


def resident(number: int) -> float:
    """Return the resident memory of a process, MB; nan: it is not there."""
    with suppress(OSError):
        for line in Path(f'/proc/{number}/status').read_text().splitlines():
            if line.startswith('VmRSS:'):
                return int(line.split()[1]) / MEGABYTE
    return math.nan


def children(number: int) -> list[int]:
    """Return the numbers of the processes that a process has started and that run."""
    found = []
    with suppress(OSError):
        for task in Path(f'/proc/{number}/task').iterdir():
            with suppress(OSError):
                found += [int(one) for one in (task / 'children').read_text().split()]
    return [one for one in found if runs(one)]


def runs(number: int) -> bool:
    """Return whether a process is there, and not only waiting to be counted."""
    try:
        text = Path(f'/proc/{number}/stat').read_text()
    except OSError:
        return False
    return text.rsplit(')', 1)[1].split()[0] != 'Z'


def opened_files(number: int) -> int:
    """Return how many descriptors a process has open."""
    with suppress(OSError):
        return len(list(Path(f'/proc/{number}/fd').iterdir()))
    return 0


def threads(number: int) -> int:
    """Return how many threads a process has."""
    with suppress(OSError):
        return len(list(Path(f'/proc/{number}/task').iterdir()))
    return 0
