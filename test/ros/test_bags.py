# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags: what was recorded and is replayed gives the same shapes. `test/soak/bags.py` makes them."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='rosbags is not installed')

from nav_msgs.msg import Path as PathMsg  # noqa: E402  rosbags may be missing
from planner_process import connected_client, running_planner  # noqa: E402
from rclpy.serialization import deserialize_message  # noqa: E402
from soak.bags import recorded, replayed, short_run  # noqa: E402
from soak.stage import arguments, poses  # noqa: E402
from visualization_msgs.msg import Marker  # noqa: E402

BAG = Path(__file__).parents[1] / 'data' / 'short_run'


def positions(data):
    return np.array(poses(deserialize_message(data, PathMsg)))


@pytest.fixture(scope='module')
def client(domain, tmp_path_factory):
    with (running_planner(tmp_path_factory.mktemp('bags'), *arguments()) as planner,
          connected_client(planner) as connected):
        connected.timeout = 60.0
        yield connected


@pytest.fixture
def forgotten(client):
    """Let the node begin as it did when the bag was recorded."""
    client.send_obstacles([Marker(action=Marker.DELETEALL)])
    client.trigger('reset')
    return client


@pytest.mark.sweep
def test_the_small_bag_gives_the_same_shapes(forgotten):
    messages = recorded(BAG)
    shapes = [data for name, data in messages if name == 'predicted_shape']
    assert len(shapes) >= 10 and sum(len(data) for _, data in messages) < 100_000
    again = replayed(forgotten, messages)
    # of another machine: its roundings are others
    for data, other in zip(shapes, again, strict=True):
        np.testing.assert_allclose(positions(other), positions(data), atol=1e-6)
    lying = positions(shapes[8])[-1, 2]  # on the box, which is 0.43 m high; free it would be lower
    assert lying == pytest.approx(0.43 + 0.75e-3, abs=1e-4)


@pytest.mark.sweep
def test_a_run_that_is_recorded_and_replayed_gives_the_same_shapes_bit_for_bit(
        forgotten, tmp_path):
    short_run(forgotten, tmp_path / 'bag', 6)
    messages = recorded(tmp_path / 'bag')
    shapes = [data for name, data in messages if name == 'predicted_shape']
    assert len(shapes) >= 6 and any(name == 'obstacles' for name, _ in messages)
    forgotten.send_obstacles([Marker(action=Marker.DELETEALL)])
    forgotten.trigger('reset')
    assert replayed(forgotten, messages) == shapes
