# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whole threadings in a closed loop, in real time: the node and the cell as processes, over DDS.

`python test/threadings_over_dds.py [--cases nominal slip ...] [--seeds 0:4] [--clock]` prints what
came of each. The node's parameters say how uncertain everything is, not how it is; what happens is
drawn by `dlo_planner.cell.cases`, as in `benchmarks.cell_trust`. With --clock time is that of the
cell, which a slow machine only stretches; without it a run in which the cell came to be late says
so, and is of no meaning. In both the node computes in real time.
"""

import argparse
import os
import queue
import sys
import tempfile
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

import numpy as np  # noqa: E402
from diagnostic_msgs.msg import DiagnosticStatus  # noqa: E402
from domain_coordinator import domain_id  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from planner_process import connected_client, drain, newest, options, running_planner  # noqa: E402
from rclpy.qos import qos_profile_sensor_data  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402

from benchmarks.cell.run import RAM  # noqa: E402
from demo.child import child  # noqa: E402
from dlo_planner.cell.camera import BAD  # noqa: E402
from dlo_planner.cell.cases import CASES, NOMINAL  # noqa: E402
from dlo_planner.cell.plant import Plant  # noqa: E402
from dlo_planner.cell.tasks import draw_task  # noqa: E402
from dlo_planner.cell.truth import VERY_UNCERTAIN  # noqa: E402
from dlo_planner.execute.causes import Cause  # noqa: E402
from dlo_planner.execute.execution import ACTIVE  # noqa: E402
from dlo_planner.ros.lifecycle import ALL_LATCHED, CHANGES, LATCHED  # noqa: E402
from msg_helpers.poses import pose_from_msg  # noqa: E402

DLO, RADIUS = 'wire 1.5', 5e-3
PROVING, LONGEST = 300.0, 600.0  # s
_ASKED = 5  # times
DAMPING = 0.005


def parameters():
    """Return the parameters of a node that knows standard deviations, as `cell.closed` has them."""
    task, unknowns = draw_task(0, DLO, RADIUS), VERY_UNCERTAIN
    bent, *varying = map(float, unknowns.natural_curvature)
    lag = Plant(task.rod, task.start, damping=DAMPING).lag
    return {'rod.length': task.rod.length, 'rod.diameter': float(2 * task.rod.radius),
            'rod.damping': [0.0, float(lag)], 'cutouts.radius': RADIUS, 'diagnostics_period': 0.2,
            'threading.standoff': 0.05 * task.rod.length, 'threading.deepest': 0.7,
            'threading.deadline': PROVING, 'incoming_command_timeout': 0.5,
            'spread.bending_stiffness': unknowns.stiffness,
            'spread.torsional_stiffness': unknowns.stiffness, 'spread.mass': unknowns.mass,
            'spread.mass_gradient': unknowns.mass_gradient,
            'spread.length': unknowns.length, 'spread.natural_curvature': bent,
            'spread.curvature_variation': float(max(varying)),
            'spread.gripper_position': unknowns.gripper_position,
            'spread.gripper_rotation': float(unknowns.gripper_rotation),
            'observe.noise': BAD.noise, 'observe.bias': BAD.bias, 'observe.outliers': BAD.outliers,
            'observe.cutout': unknowns.hole_position, 'observe.stamps': BAD.stamp_error,
            'observe.robot_position': NOMINAL.robot_position,
            'observe.robot_rotation': NOMINAL.robot_rotation}


@dataclass
class Came:
    """What came of a run; lengths in m, times in s.

    Attributes
    ----------
    how : str
        'clean', 'refused', 'touched', 'rammed' or 'missed'.
    reason : str
        Why it was refused.
    miss, promised, force : float
        The largest there were, m, m, N.
    lasted : float
        From the request to the end, of the clock on the wall.
    gap : float
        The longest between two single commands of a motion.
    lost : float
        By how much the cell fell behind its clock.
    struck : bool
        Whether something happened in the hole, or just before: then it touches or misses.
    tries : int
    phases : list of str
        Phases of the loop, and when they began.
    """

    how: str
    reason: str = ''
    miss: float = np.nan
    promised: float = np.nan
    force: float = np.nan
    lasted: float = np.nan
    gap: float = 0.0
    lost: float = 0.0
    struck: bool = False
    tries: int = 0
    phases: tuple = ()


class Newest(queue.Queue):
    """What came last, at most 20: clouds of an hour are gigabytes."""

    def __init__(self):
        super().__init__(20)

    def take(self, one):
        """Put one, in place of the oldest if there are enough."""
        while True:
            try:
                return self.put_nowait(one)
            except queue.Full:
                with suppress(queue.Empty):
                    self.get_nowait()


class Ears:
    """What came on some topics of a client's node."""

    def __init__(self, client):
        self.node, self.planner = client.node, client.planner
        self.heard = {name: Newest() for name in ('cutout', 'outcome', 'pose', 'cloud')}
        self.last, self.gap, self.phases, self.begun = None, 0.0, [], monotonic()
        planner = client.planner
        self._made = [client.node.create_subscription(kind, topic, take, qos)
                      for kind, topic, take, qos in (
            (PoseStamped, '/dlo_cell/cutout', self.heard['cutout'].take, LATCHED),
            (DiagnosticStatus, '/dlo_cell/outcome', self.heard['outcome'].take, LATCHED),
            (PoseStamped, f'{planner}/gripper_pose', self.heard['pose'].take,
             qos_profile_sensor_data),
            (PointCloud2, f'{planner}/observed_points', self.heard['cloud'].take,
             qos_profile_sensor_data),
            (PoseStamped, f'{planner}/gripper_command', self._command, CHANGES),
            (DiagnosticStatus, f'{planner}/execution', self._execution, ALL_LATCHED))]

    def _command(self, _):
        now = monotonic()
        if self.last is not None:
            self.gap = max(self.gap, now - self.last)
        self.last = now

    def _execution(self, msg):
        values = {item.key: item.value for item in msg.values}
        if values['state'] not in ('running', 'settling', 'stopping'):
            self.last = None  # it stands, and nothing is commanded
        said = values.get('loop', '-')
        if not self.phases or not self.phases[-1].endswith(said):
            self.phases.append(f'{monotonic() - self.begun:.0f} {said}')

    def begin(self):
        self.last, self.gap, self.phases, self.begun = None, 0.0, [], monotonic()

    def outcome(self):
        """Return what the cell says next, name -> text."""
        drain(self.heard['outcome'])
        return {item.key: item.value for item in newest(self.heard['outcome']).values}

    def close(self):
        for one in self._made:
            self.node.destroy_subscription(one)


def threaded(client, case, seed, clock=False):
    """Return what Came of one case and seed, by a planner that stands and is connected."""
    arguments = {'task': seed, 'seed': seed, 'radius': RADIUS, 'unknown': 'more', 'case': case,
                 'damping': DAMPING, 'clock': str(clock).lower()}
    ears = Ears(client)
    try:
        with child('dlo_planner.cell.node', '--ros-args', *options(arguments), env=os.environ):
            return _executed(client, ears, clock)
    finally:
        if clock:
            client.set_parameters(use_sim_time=False)
        ears.close()


def _executed(client, ears, clock):
    goal = pose_from_msg(newest(ears.heard['cutout']).pose)
    if clock:
        client.set_parameters(use_sim_time=True)
    start = pose_from_msg(newest(ears.heard['pose']).pose)
    client.trigger('reset')
    path, _ = client.plan_threading(start, goal)
    if not path.poses:
        return Came('refused', client.status_of('plan_threading')[1])
    proof = client.proof(path, PROVING)
    if proof['report'] != 'held':
        return Came('refused', proof['report reason'])
    for _ in range(10):
        ears.heard['cloud'].get(timeout=30.0)
    drain(client.executions)
    ears.begin()
    for _ in range(_ASKED):
        code, message, _ = client.execute(path)
        if code != Cause.OLD_GRIPPER_POSE:  # as on a machine that is late
            break
    if code:
        return Came('refused', message)
    values, end = {'state': 'running'}, monotonic() + LONGEST
    while values['state'] in ACTIVE and monotonic() < end:
        with suppress(TimeoutError):
            _, message, values = client.execution_in(*ACTIVE, 'succeeded', 'stopped', timeout=1.0)
    lasted = monotonic() - ears.begun
    sleep(1.0)
    cell = ears.outcome()
    force, miss = float(cell['largest force [N]']), float(cell['largest miss [m]'])
    done = values['state'] == 'succeeded'
    how = ('rammed' if force > RAM else 'touched' if cell['touched'] == 'True' else
           'refused' if not done else 'clean' if cell['threaded'] == 'True' else 'missed')
    return Came(how, '' if done else f'{values["cause"]}: {message}', miss,
                float(values.get('expected miss [m]', 'nan')), force, lasted, ears.gap,
                float(cell['lost [s]']), cell['struck inside'] == 'True',
                int(values.get('tries', 0)), tuple(ears.phases))


def summary(case, found):
    """Return in a line what came of the runs of a case that mean something."""
    counted = [came for came in found if not came.lost]
    struck = sum(came.struck for came in counted)
    judged = [came.miss <= came.promised for came in counted
              if not came.struck and np.isfinite(came.miss + came.promised)]
    ends = ', '.join(f'{count} {how}' for how, count in Counter(
        came.how for came in counted).items())
    return (f'{case}: {ends or "none"} of {len(counted)} (and {len(found) - len(counted)} of no '
            f'meaning); the bound covered {sum(judged)} of {len(judged)}'
            + (f', {struck} struck inside' if struck else ''))


def main(arguments=None):
    """Print what came of each; return 1 if anything was rammed, or touched where nothing is wrong.

    What bumps into a DLO in the hole, or lets it slip just before, makes it touch.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', nargs='+', choices=list(CASES), metavar='CASE',
                        default=['nominal', 'slip', 'bump', 'wandering', 'hidden'])
    parser.add_argument('--seeds', default='0:4', help='from:to')
    parser.add_argument('--clock', action='store_true', help='in the time of the cell')
    parser.add_argument('--log', type=Path, help='folder of planner.log')
    asked = parser.parse_args(arguments)
    found = {case: [] for case in asked.cases}
    with domain_id() as domain, tempfile.TemporaryDirectory() as folder:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        with running_planner(asked.log or Path(folder), *options(parameters())) as planner, \
                connected_client(planner) as client:
            for case in asked.cases:
                for seed in range(*map(int, asked.seeds.split(':'))):
                    came = threaded(client, case, seed, asked.clock)
                    found[case].append(came)
                    print(f'{case} {seed}: {came.how}, miss {1e3 * came.miss:.2f} of '
                          f'{1e3 * came.promised:.2f} mm promised, {came.force:.2f} N, '
                          f'{came.lasted:.1f} s, {came.tries} tries, longest gap between commands '
                          f'{1e3 * came.gap:.0f} ms'
                          + (', struck inside' if came.struck else '')
                          + (f', of no meaning: the cell was late by {came.lost:.1f} s'
                             if came.lost else '')
                          + f'; load {os.getloadavg()[0]:.1f}; {", ".join(came.phases)} '
                          + came.reason, flush=True)
                print(summary(case, found[case]), flush=True)
    return int(any(came.how == 'rammed' or (case == 'nominal' and came.how == 'touched')
                   for case, some in found.items() for came in some))


if __name__ == '__main__':
    sys.exit(main())
