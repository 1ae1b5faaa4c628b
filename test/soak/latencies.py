# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How long it takes from a gripper pose to its shape, alone and beside what else the node does."""

import struct
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event, Thread
from time import monotonic, sleep

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from visualization_msgs.msg import MarkerArray

from dlo_planner import Pose
from msg_helpers.poses import pose_stamped_msg
from soak.odd_values import Odd
from soak.stage import GOAL, GRIPPERS, Stage

_DEEP = 1000
_LAST = 2.0      # s that the last shape may take
_STAMP = '<iI'   # of the header, in the bytes of a message after its first four
_RADIUS, _TURN = 0.1, 0.5  # m, rad/s: the gripper goes round in a circle
_OBSTACLES = 10.0  # messages in a second


@dataclass(frozen=True)
class Latency:
    """How long shapes took at one rate.

    Attributes:
        beside: what else was done; rate: poses in a second
        sent, answered: poses; the others were overtaken by newer ones
        median, late: ms, 50 and 99 % of the answered ones are quicker
    """

    beside: str
    rate: float
    sent: int
    answered: int
    median: float
    late: float


def latency(stage: Stage, rate: float, seconds: float, beside: str = 'alone') -> Latency:
    """Send poses of a gripper that moves; return the Latency.

    Shapes are heard as bytes, of which only the stamp is read: what is measured is the node, and
    not the Python of whoever listens.

    Args:
        rate: poses in a second; seconds: for how long
        beside: a key of BESIDE
    """
    node, name = stage.client.node, stage.client.planner
    sent, took = {}, []

    def came(data):
        when = sent.get(struct.unpack_from(_STAMP, data, 4))
        if when is not None:
            took.append(monotonic() - when)

    out = node.create_publisher(PoseStamped, f'{name}/gripper_pose', qos_profile_sensor_data)
    heard = node.create_subscription(Path, f'{name}/predicted_shape', came, QoSProfile(
        depth=_DEEP), raw=True)
    while not (out.get_subscription_count() and heard.get_publisher_count()):
        sleep(0.01)
    with BESIDE[beside](stage):
        _send(out, sent, rate, seconds)
    end = monotonic() + _LAST
    while len(took) < len(sent) and monotonic() < end:
        sleep(0.01)
    node.destroy_publisher(out)
    node.destroy_subscription(heard)
    shown = np.percentile(took, (50, 99)) if took else (np.nan, np.nan)
    return Latency(beside, rate, len(sent), len(took), *(1e3 * float(one) for one in shown))


def _send(out, sent, rate, seconds):
    begun, gripper = monotonic(), GRIPPERS[1]
    for k in range(int(rate * seconds)):
        sleep(max(begun + k / rate - monotonic(), 0.0))
        angle = _TURN * k / rate
        pose = Pose(gripper.position + _RADIUS * np.array([0.0, np.sin(angle), np.cos(angle)]),
                    gripper.quaternion)
        stamp = 1 + k // 10**6, 1 + k  # any that tells them apart
        msg = pose_stamped_msg(pose, 'world', Time(sec=stamp[0], nanosec=stamp[1]))
        sent[stamp] = monotonic()
        out.publish(msg)


@contextmanager
def _beside(work):
    """Let `work` be done again and again meanwhile."""
    over = Event()

    def go_on():
        while not over.is_set():
            work(over)

    thread = Thread(target=go_on)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def plans(stage):
    """Return what asks for plans, one after the other; each ends the proof of the one before."""
    return _beside(lambda _: stage.client.plan_threading(GRIPPERS[1], GOAL))


def proofs(stage):
    """Return what asks for a plan, and for the next one when it is proved."""
    def prove(over):
        path = stage.client.plan_threading(GRIPPERS[1], GOAL)[0]
        while not over.is_set():
            try:
                stage.client.proof(path, timeout=0.5)
                return
            except TimeoutError:
                continue
    return _beside(prove)


@contextmanager
def obstacles(stage):
    """Change obstacles all the time."""
    odd = Odd(np.random.default_rng(3), stage.client.node.get_clock().now().to_msg)

    def change(over):
        stage.client._obstacles_out.publish(MarkerArray(markers=[odd.marker()]))
        over.wait(1 / _OBSTACLES)

    with _beside(change):
        yield
    stage.restore()


@contextmanager
def alone(_):
    """Do nothing else."""
    yield


BESIDE = {'alone': alone, 'plans': plans, 'proofs': proofs, 'obstacles': obstacles}
RATES = (30.0, 100.0, 500.0)
