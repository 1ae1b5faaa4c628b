# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Qualities of service of the node's topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Sensor data, but one deep: a pose that was overtaken by a newer one is of no use to anybody.
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
REQUEST = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
# None of them may be lost, however fast they come: each changes the scene a little.
CHANGES = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Of one who hears what is latched and wants each message, however late it is taken.
ALL_LATCHED = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE,
                         durability=DurabilityPolicy.TRANSIENT_LOCAL)
