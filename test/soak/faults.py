# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What happens to machines, processes and clocks; each returns what was wrong, in words."""

import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep

from planner_process import ROOT, until
from rosgraph_msgs.msg import Clock

from dlo_planner import Pose
from soak.stage import GOAL, GRIPPERS, STEP, Stage, poses, robot, stage
from soak.watching import children, runs

LONG = 300.0    # s, a proof on a busy machine
# A robot's driver, in a process of its own, which is killed.
DRIVER = """
import sys, rclpy
from dlo_planner import Pose
from follower import Follower
rclpy.init()
node = rclpy.create_node('driver')
numbers = [float(one) for one in sys.argv[2:]]
follower = Follower(node, sys.argv[1], Pose(numbers[:3], numbers[3:]))
rclpy.spin(node)
"""


class Driver:
    """A robot's driver in a process of its own, which follows from where it is put."""

    def __init__(self, planner: str):
        self._planner, self.process = planner, None

    def put(self, pose):
        numbers = map(str, (*pose.position, *pose.quaternion))
        self.process = subprocess.Popen(  # `follower` is found where this process finds it
            [sys.executable, '-c', DRIVER, self._planner, *numbers], cwd=ROOT,
            env=os.environ | {'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})

    def kill(self):
        if self.process is not None:
            self.process.kill()
            self.process.wait()


def problems(**right) -> list[str]:
    return ['not so: ' + name.replace('_', ' ') for name, one in right.items() if not one]


def proving_child_killed(made: Stage) -> list[str]:
    """Kill the process that proves plans while it does: the plan is proved all the same."""
    path = made.client.plan_threading(GRIPPERS[1], GOAL)[0]
    until(lambda: children(made.process))
    sleep(0.5)
    for one in children(made.process):
        os.kill(one, signal.SIGKILL)
    held = made.client.proof(path, LONG)['report'] == 'held'
    return problems(the_plan_is_proved=held) + made.differences()


def proving_child_stopped(made: Stage) -> list[str]:
    """Stop the process that proves plans: shapes, plans and refusals go on; then let it go on."""
    client = made.client
    path = client.plan_threading(GRIPPERS[1], GOAL)[0]
    until(lambda: children(made.process))
    stopped = children(made.process)
    for one in stopped:
        os.kill(one, signal.SIGSTOP)
    shape = client.shape_for(GRIPPERS[0])[0]
    answer = client.trigger('execute')
    for one in stopped:
        os.kill(one, signal.SIGCONT)
    held = client.proof(path, LONG)['report'] == 'held'
    return problems(shapes_go_on=shape.poses, execute_is_refused=not answer.success,
                    the_plan_is_proved=held)


def obstacle_publisher_vanished(made: Stage) -> list[str]:
    """Let the publisher of an obstacle leave: the obstacle stays."""
    client = made.client
    from visualization_msgs.msg import Marker, MarkerArray  # noqa: PLC0415

    from dlo_planner.ros.lifecycle import LATCHED  # noqa: PLC0415
    from msg_helpers.poses import pose_msg  # noqa: PLC0415
    box = Marker(ns='gone', id=0, type=Marker.CUBE, action=Marker.ADD)
    box.header.frame_id, box.pose = 'world', pose_msg(Pose((0.8, 0, 0.5), (0, 0, 0, 1)))
    box.scale.x = box.scale.y = box.scale.z = 0.3
    out = client.node.create_publisher(MarkerArray, f'{client.planner}/obstacles', LATCHED)
    free = poses(client.predict_shape(GRIPPERS[1])[0])
    out.publish(MarkerArray(markers=[box]))
    there = until(lambda: poses(client.predict_shape(GRIPPERS[1])[0]) != free)
    client.node.destroy_publisher(out)
    sleep(0.5)
    stays = poses(client.predict_shape(GRIPPERS[1])[0]) != free
    return problems(the_obstacle_counts=there, the_obstacle_stays=stays) + made.differences()


def robot_killed(made: Stage) -> list[str]:
    """Kill the process of the robot's driver while it executes: the motion comes to rest."""
    client = made.client
    driver = Driver(client.planner)
    try:
        regular = made.execution(driver)
        sleep(1.0)
        driver.kill()
        code, _, _ = client.execution_in('stopped', 'succeeded', timeout=LONG)
    finally:
        driver.kill()
    moved = made.longest_step()
    made.restore()
    return problems(no_leap=moved <= STEP * regular, it_stops_for_want_of_poses=code == 409)


def node_stopped(made: Stage) -> list[str]:
    """Stop the node while it executes, for longer than it may pause: it does not leap."""
    client = made.client
    client.set_parameters(execute__longest_pause=0.5)
    with robot(made) as follower:
        regular = made.execution(follower)
        sleep(0.5)
        os.kill(made.process, signal.SIGSTOP)
        sleep(2.0)
        os.kill(made.process, signal.SIGCONT)
        code, _, _ = client.execution_in('stopped', 'succeeded', timeout=LONG)
    moved = made.longest_step()
    return problems(no_leap=moved <= STEP * regular, it_ends_where_it_stands=code == 412
                    ) + made.differences()


def node_killed() -> list[str]:
    """Kill the node while it proves a plan: its child ends; another one gives the same answers."""
    with TemporaryDirectory() as directory:
        with stage(Path(directory)) as made:
            answers = made.answers
            left = children(made.process)
            os.kill(made.process, signal.SIGKILL)
            ended = until(lambda: not any(runs(one) for one in left))
        with stage(Path(directory)) as again:
            return problems(the_child_ends=ended and left,
                            a_new_node_answers_as_before=again.answers == answers)


def clock_runs_wild() -> list[str]:
    """Let /clock stand still, jump, and run backwards: answers, proofs, commands go on."""
    with TemporaryDirectory() as directory, stage(
            Path(directory), '-p', 'use_sim_time:=true', '-p', 'incoming_command_timeout:=0.0',
            '-p', 'execute.horizon:=0.0') as made:  # what is told ahead is due by this clock
        out = made.client.node.create_publisher(Clock, '/clock', 10)
        until(out.get_subscription_count)
        with robot(made) as follower:
            regular = made.execution(follower)  # there is no time at all until now
            for seconds in (100, 105, 45, 45, 10**6, 0, 7):
                msg = Clock()
                msg.clock.sec = seconds
                out.publish(msg)
                sleep(0.3)
            code, _, _ = made.client.execution_in('stopped', 'succeeded', timeout=LONG)
        moved = made.longest_step()
        return problems(no_leap=0 < moved <= STEP * regular, it_is_executed_to_its_end=code == 0
                        ) + made.differences()


def two_nodes() -> list[str]:
    """Run two nodes in two namespaces, one remapped: each is alone; the other one is killed."""
    with ExitStack() as both:
        one, other = (both.enter_context(stage(
            Path(both.enter_context(TemporaryDirectory())), '-r', f'__ns:=/{name}', *extra,
            name=f'/{name}/{node}')) for name, node, extra in (
                ('left', 'dlo_planner', ()),
                ('right', 'hose', ('-r', '__node:=hose', '-p', 'rod.youngs_modulus:=115e9'))))
        differ = one.answers['predict_shape 0'] != other.answers['predict_shape 0']
        one.client.set_parameters(rod__tip_mass=0.02)  # is nobody else's
        alone = other.differences()
        os.kill(one.process, signal.SIGKILL)
        return problems(each_has_its_own_DLO=differ) + alone + other.differences()


WITH_A_NODE = (proving_child_killed, proving_child_stopped, obstacle_publisher_vanished,
               robot_killed, node_stopped)
WITHOUT = (node_killed, clock_runs_wild, two_nodes)
