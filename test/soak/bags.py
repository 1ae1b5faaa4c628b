# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Runs of the node as MCAP bags: recorded, and replayed into a node.

python test/soak/bags.py FILE   makes one of a short run: poses, obstacles, and the shapes that came
"""

import struct
import sys
from pathlib import Path
from threading import Lock
from time import monotonic, sleep

if __name__ == '__main__':
    sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1])]

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMsg
from rclpy.qos import qos_profile_sensor_data
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from visualization_msgs.msg import MarkerArray

from dlo_planner.ros.lifecycle import LATCHED, REQUEST

KINDS = {'gripper_pose': (PoseStamped, qos_profile_sensor_data),
         'obstacles': (MarkerArray, REQUEST), 'predicted_shape': (PathMsg, LATCHED)}
VERSION = 9        # of the bag's metadata, as Jazzy's rosbag2 writes
SHAPE_TAKES = 60.0  # s at most, on a busy machine
LOST_AFTER = 5.0    # s without an answer


def type_of(kind) -> str:
    """Return the name of a message type as bags have it, e.g. nav_msgs/msg/Path."""
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


class Recorder:
    """Writes all messages of a planner's topics (KINDS) to a bag, as they are on the wire.

    Args:
        client: PlannerClient; folder: Path that does not exist yet
    """

    def __init__(self, client, folder: Path):
        self._node, self._lock = client.node, Lock()
        self._writer = Writer(folder, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        types = get_typestore(Stores.ROS2_JAZZY)
        self._heard = []
        for name, (kind, qos) in KINDS.items():
            topic = f'{client.planner}/{name}'
            connection = self._writer.add_connection(topic, type_of(kind), typestore=types)
            self._heard.append(self._node.create_subscription(
                kind, topic, lambda data, one=connection: self._write(one, data), qos, raw=True))

    def _write(self, connection, data):
        with self._lock:
            if self._writer is not None:
                self._writer.write(connection, self._node.get_clock().now().nanoseconds, data)

    def close(self):
        for one in self._heard:
            self._node.destroy_subscription(one)
        with self._lock:
            self._writer.close()
            self._writer = None


def recorded(folder: Path) -> list:
    """Return what is in a bag, in its order, as (name of KINDS, bytes of the message).

    A shape that was latched before the recording began is left out: no pose is there for it.
    """
    with Reader(folder) as reader:
        found = [(connection.topic.rsplit('/', 1)[1], bytes(data))
                 for connection, _, data in reader.messages()]
    known = {stamp_of(data) for name, data in found if name == 'gripper_pose'}
    return [(name, data) for name, data in found
            if name != 'predicted_shape' or stamp_of(data) in known]


def stamp_of(data: bytes) -> tuple:
    """Return the stamp of a message with a header, (s, ns)."""
    return struct.unpack_from('<iI', data, 4)


def replayed(client, messages: list) -> list:
    """Send recorded messages to a node; return the shapes that come, in the order of the bag.

    A pose is sent when the shape of the one before has come: then it does not matter how quick the
    machines are, now and when it was recorded.
    """
    node, came = client.node, {}
    outs = {name: node.create_publisher(kind, f'{client.planner}/{name}', qos)
            for name, (kind, qos) in KINDS.items() if name != 'predicted_shape'}
    heard = node.create_subscription(
        PathMsg, f'{client.planner}/predicted_shape',
        lambda data: came.setdefault(stamp_of(data), bytes(data)), LATCHED, raw=True)
    while not all(out.get_subscription_count() for out in outs.values()):
        sleep(0.01)
    wanted = [stamp_of(data) for name, data in messages if name == 'predicted_shape']
    for name, data in messages:
        if name == 'predicted_shape':
            continue
        outs[name].publish(data)
        if name == 'obstacles':
            sleep(0.5)  # nothing says that they are in force
        elif stamp_of(data) in wanted:
            # best effort: a pose may be lost, e.g. before the node has found this publisher
            end = monotonic() + SHAPE_TAKES
            while not _came(came, stamp_of(data), LOST_AFTER) and monotonic() < end:
                outs[name].publish(data)
    for one in outs.values():
        node.destroy_publisher(one)
    node.destroy_subscription(heard)
    return [came.get(stamp) for stamp in wanted]


def _came(came, stamp, within) -> bool:
    """Return whether the shape of a stamp is there within so many s."""
    end = monotonic() + within
    while stamp not in came and monotonic() < end:
        sleep(0.002)
    return stamp in came


def short_run(client, folder: Path, poses: int = 12):
    """Record a gripper that comes to lie on a box with its DLO, and goes on."""
    import numpy as np  # noqa: PLC0415
    from visualization_msgs.msg import Marker  # noqa: PLC0415

    from dlo_planner import Pose  # noqa: PLC0415
    from msg_helpers.poses import pose_msg  # noqa: PLC0415

    recorder = Recorder(client, folder)
    sleep(1.0)
    box = Marker(ns='cell', id=0, type=Marker.CUBE, action=Marker.ADD)
    box.header.frame_id, box.pose = 'world', pose_msg(Pose((0.8, 0.0, 0.33), (0, 0, 0, 1)))
    box.scale.x = box.scale.y = box.scale.z = 0.2
    for k, height in enumerate(np.linspace(1.0, 0.9, poses)):
        if k == 1:
            client.send_obstacles([box])
            sleep(0.5)
        client.shape_for(Pose((0.0, 0.012 * k, height), (0, 0, 0, 1)))  # never on its edge
    sleep(0.5)
    recorder.close()


def main(folder: str):
    from tempfile import TemporaryDirectory  # noqa: PLC0415

    from soak.stage import stage  # noqa: PLC0415
    with TemporaryDirectory() as directory, stage(Path(directory)) as made:
        short_run(made.client, Path(folder))


if __name__ == '__main__':
    main(sys.argv[1])
