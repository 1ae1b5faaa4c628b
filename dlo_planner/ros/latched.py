# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Hearing latched messages and ordinary ones on one topic."""

from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile

from dlo_planner.ros.gate import Gate

_LOOK = 0.5  # s between looks whether somebody latches
_REMEMBERED = 4096  # messages; the copy of one comes at most two queues later


class Once:
    """A callback that lets each message through once, though two subscriptions hear it.

    The copies of a message have the time at which it was sent in common, and its number.

    Parameters
    ----------
    callback : callable
        Called with the message.
    """

    def __init__(self, callback: Callable[..., Any]) -> None:
        self._callback = callback
        self._seen: OrderedDict[tuple[int, Any], None] = OrderedDict()

    def __call__(self, msg: Any, info: Mapping[str, Any]) -> None:
        """Take a message and what rclpy says of it."""
        key = info['source_timestamp'], info.get('publication_sequence_number')
        if key[0] and key in self._seen:
            return
        self._seen[key] = None
        if len(self._seen) > _REMEMBERED:
            self._seen.popitem(last=False)
        self._callback(msg)


def hear_latched(node: Gate, kind: Any, topic: str, callback: Callable[..., Any], qos: QoSProfile,
                 clock: Any, group: Any) -> None:
    """Subscribe so that latched and volatile publishers are heard, and no publisher warns.

    A volatile subscription hears no history, and one that asks for it no volatile publisher, which
    then warns. So the second one is made when a publisher that latches is there, and stays.

    Parameters
    ----------
    node : Gate
        Gate; its subscriptions act always: what is missed of a latched topic is lost.
    kind : object
        Kind of the messages; each comes once.
    topic : str
        Topic of the messages; each comes once.
    callback : callable
        Callback of the messages; each comes once.
    qos : QoSProfile
        Reliable and volatile.
    clock : object
        Steady Clock.
    group : object
        Callback group, mutually exclusive.
    """
    latched = QoSProfile(depth=qos.depth, reliability=qos.reliability,
                         durability=DurabilityPolicy.TRANSIENT_LOCAL)
    once = Once(callback)
    node.create_subscription(kind, topic, once, qos, always=True, callback_group=group)

    def look() -> None:
        if any(info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
               for info in node.get_publishers_info_by_topic(topic)):
            timer.cancel()
            node.create_subscription(  # that a volatile publisher does not suit it is no news
                kind, topic, once, latched, always=True, callback_group=group,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))

    timer = node.create_timer(_LOOK, look, always=True, clock=clock, callback_group=group)
    look()
