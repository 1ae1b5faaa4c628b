# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Hearing latched messages and ordinary ones on one topic."""

from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile

from dlo_planner.ros.gate import Gate

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
                 group: Any) -> None:
    """Subscribe twice, so that latched and volatile publishers are heard.

    A volatile subscription hears no history, and a latched one no volatile publisher.

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
    group : object
        Callback group, mutually exclusive.
    """
    latched = QoSProfile(depth=qos.depth, reliability=qos.reliability,
                         durability=DurabilityPolicy.TRANSIENT_LOCAL)
    once = Once(callback)
    for quality, said in ((qos, True), (latched, False)):
        node.create_subscription(  # that volatile publishers do not suit the second is no news
            kind, topic, once, quality, always=True,
            callback_group=group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=said))
