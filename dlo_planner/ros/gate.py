# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a managed node offers: entities that act only while the node is active."""

from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from threading import Condition, Thread
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.lifecycle import LifecycleNodeMixin

from dlo_planner.ros.qos import LATEST

_INACTIVE = 'the node is not active: expected its lifecycle state to be active'

_WAIT = 250_000_000  # ns between looks whether a subscription is still there


class _Nobodys(CallbackGroup):
    """Callback group of what no executor takes."""

    def can_execute(self, entity: Any) -> bool:
        """Whether an executor may: never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Whether an executor may begin: never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Note that an executor has ended: it never does."""


class Gate:
    """Makes publishers, subscriptions, services and timers, and shuts them all at once.

    While it is shut nothing is published, subscriptions and timers do nothing, and a service
    refuses: the answer is empty, with the reason where it has a `message`. The parts of the node
    take a Gate for their node.

    Parameters
    ----------
    node : LifecycleNodeMixin
        LifecycleNodeMixin and Node.
    """

    def __init__(self, node: LifecycleNodeMixin) -> None:
        self._node = node
        self._entities: list[tuple[Callable[[Any], object], Any]] = []
        self._open, self._calls, self._changed = False, 0, Condition()

    def __getattr__(self, name: str) -> Any:
        """Return what else a Node has."""
        return getattr(self._node, name)

    def create_publisher(self, kind: Any, topic: str, qos: Any, **options: Any) -> Any:
        """Return a lifecycle publisher: the node's transitions switch it."""
        made = self._node.create_lifecycle_publisher(kind, topic, qos, **options)
        return self._keep(self._node.destroy_lifecycle_publisher, made)

    def create_subscription(self, kind: Any, topic: str, callback: Callable[..., Any], qos: Any, *,
                            always: bool = False, **options: Any) -> Any:
        """Return a subscription.

        Parameters
        ----------
        kind : object
            As for a Node.
        topic : str
            As for a Node.
        callback : callable
            As for a Node.
        qos, options : object
            As for a Node.
        always : bool, optional
            Whether it acts while the Gate is shut as well.
        """
        made = self._node.create_subscription(
            kind, topic, self.counted(callback, always), qos, **options)
        return self._keep(self._node.destroy_subscription, made)

    def hear_newest(self, kind: Any, topic: str, callback: Callable[[Any], Any]) -> Any:
        """Return a subscription to the newest message, which is heard in a thread of its own.

        An executor looks at all that a node has for each message of it, which takes ten times as
        long as the message.
        """
        made = self.create_subscription(kind, topic, callback, LATEST, callback_group=_Nobodys())
        Thread(target=self._take, args=(made,), name=topic, daemon=True).start()
        return made

    def _take(self, subscription: Any) -> None:
        """Hand messages to a subscription's callback, until it is destroyed."""
        with suppress(_rclpy.InvalidHandle, _rclpy.RCLError):  # the node, or the context, has gone
            waiting = _rclpy.WaitSet(1, 0, 0, 0, 0, 0, self._node.context.handle)
            while True:
                with subscription.handle, self._node.handle:
                    waiting.clear_entities()
                    waiting.add_subscription(subscription.handle)
                    waiting.wait(_WAIT)
                    taken = subscription.handle.take_message(subscription.msg_type, False)
                if taken is not None:
                    subscription.callback(taken[0])

    def create_timer(self, period: float, callback: Callable[..., Any], *, always: bool = False,
                     **options: Any) -> Any:
        """Return a timer; `always` as for a subscription."""
        made = self._node.create_timer(period, self.counted(callback, always), **options)
        return self._keep(self._node.destroy_timer, made)

    def create_service(self, kind: Any, name: str, callback: Callable[..., Any],
                       **options: Any) -> Any:
        """Return a service."""
        made = self._node.create_service(
            kind, name, self.counted(callback, refusal=_refused), **options)
        return self._keep(self._node.destroy_service, made)

    def open(self) -> None:
        """Let everything act."""
        with self._changed:
            self._open = True

    @property
    def is_open(self) -> bool:
        """Whether everything acts."""
        return self._open

    def shut(self, patience: float) -> bool:
        """Let nothing begin any more; return whether all that runs has ended.

        Parameters
        ----------
        patience : float
            s to wait for that.
        """
        with self._changed:
            self._open = False
            return self._changed.wait_for(lambda: self._calls == 0, patience)

    def destroy(self) -> None:
        """Destroy all that was made."""
        while self._entities:
            destroy, made = self._entities.pop()
            destroy(made)

    def _keep(self, destroy: Callable[[Any], object], made: Any) -> Any:
        self._entities.append((destroy, made))
        return made

    def counted(self, callback: Callable[..., Any], always: bool = False,
                refusal: Callable[..., Any] | None = None) -> Callable[..., Any]:
        """Return a callback that acts while the Gate is open, or `always`, and counts as a call."""
        @wraps(callback)  # rclpy looks at the signature
        def call(*args: Any) -> Any:
            with self._changed:
                if not self._open and not always:
                    return refusal and refusal(*args)
                self._calls += 1
            try:
                return callback(*args)
            finally:
                with self._changed:
                    self._calls -= 1
                    self._changed.notify_all()
        return call


def _refused(_: Any, response: Any) -> Any:
    if hasattr(response, 'message'):
        response.message = _INACTIVE
    return response
