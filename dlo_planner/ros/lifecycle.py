# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A lifecycle node whose topics, services and timers act only while it is active."""

import traceback
from collections import OrderedDict
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial, wraps
from queue import SimpleQueue
from threading import Condition, Event, Thread
from time import sleep
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import ParameterException
from rclpy.executors import MultiThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter_service import ParameterService
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from dlo_planner.errors import DloPlannerError

# Sensor data, but one deep: a pose that was overtaken by a newer one is of no use to anybody.
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
REQUEST = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
# None of them may be lost, however fast they come: each changes the scene a little.
CHANGES = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# Requests to a service: what exceeds the depth is lost, and its caller waits for good.
CALLS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Of one who hears what is latched and wants each message, however late it is taken.
ALL_LATCHED = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE,
                         durability=DurabilityPolicy.TRANSIENT_LOCAL)

MOST_CALLS = 100      # that wait for one thread: more would wait for minutes, and are refused
_PAUSE = 1e-4         # s
_WAIT = 250_000_000   # ns between looks whether a subscription is still there
_LOOK = 0.5           # s between looks whether somebody latches
_REMEMBERED = 4096    # messages; the copy of one comes at most two queues later
_INACTIVE = 'the node is not active: expected its lifecycle state to be active'


class PatientExecutor(MultiThreadedExecutor):
    """A MultiThreadedExecutor that lets a submitted callback start before it looks for the next.

    The original finds it not started again and again: a busy loop that starves the very thread it
    waits for (ros2/rclpy issue 1452). Measured: a plan beside shapes takes 3 s instead of 18 s.
    """

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Submit one callback that is ready, then give it the time to start."""
        super().spin_once(timeout_sec)
        sleep(_PAUSE)

    def wait_for_callbacks(self) -> None:
        """Wait until those that run have ended; nothing may spin any more."""
        self._executor.shutdown(wait=True, cancel_futures=True)


class _Nobodys(MutuallyExclusiveCallbackGroup):
    """Callback group of what no executor takes."""

    def can_execute(self, entity: Any) -> bool:
        """Whether an executor may: never."""
        return False


class Desk:
    """Answers the calls of some services one after the other, in a thread of its own.

    The executor takes requests as they come, in `group`, however long one is worked on. `refuse`
    takes name, request and response of one that is too many, and returns its answer.
    """

    def __init__(self, group: Any, refuse: Callable[[str, Any, Any], Any]) -> None:
        self.group, self._refuse = group, refuse
        self._waiting: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        Thread(target=self._work, name='desk', daemon=True).start()

    def serve(self, service: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """Answer the calls of a service, whose callback hands them on, by another callback."""
        send = service.send_response

        def take(call: tuple[Any, Any], header: Any) -> None:
            crowded = self._waiting.qsize() >= MOST_CALLS
            answer = partial(_answer, send, header, partial(self._refuse, name)
                             if crowded else callback, *call)
            if crowded:
                answer()
            else:
                self._waiting.put(answer)

        service.send_response = take

    def close(self) -> None:
        """End the thread, once it has answered what waits."""
        self._waiting.put(None)

    def _work(self) -> None:
        while (answer := self._waiting.get()) is not None:
            answer()


def _answer(send: Callable[[Any, Any], object], header: Any, callback: Callable[[Any, Any], Any],
            request: Any, response: Any) -> None:
    """Answer a call, unless its service, or who has asked, has gone."""
    rclpy = rclpy_implementation
    with suppress(rclpy.InvalidHandle, rclpy.RCLError):
        send(callback(request, response), header)


def _hand_on(request: Any, response: Any) -> tuple[Any, Any]:
    return request, response


class Once:
    """A callback that lets each message (by sending time and number) through once of two copies."""

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


class Entities:
    """Makes a Node's publishers, subscriptions, services and timers, which act while it is open.

    While it is shut a service refuses: the answer is empty, with the reason where it can have one.
    """

    def __init__(self) -> None:
        self._entities: list[tuple[Callable[[Any], object], Any]] = []
        self._open, self._calls, self._changed = False, 0, Condition()

    def add_publisher(self: Any, kind: Any, topic: str, qos: QoSProfile) -> Any:
        """Return a lifecycle publisher: the node's transitions switch it.

        One that is made while the node is open acts at once.
        """
        made = self._keep(self.destroy_lifecycle_publisher,
                          self.create_lifecycle_publisher(kind, topic, qos))
        if self.is_open:
            made.on_activate(None)
        return made

    def add_subscription(self: Any, kind: Any, topic: str, callback: Callable[..., Any],
                         qos: QoSProfile, group: Any = None, always: bool = False,
                         **options: Any) -> Any:
        """Return a subscription, which acts `always`, or while the node is open."""
        return self._keep(self.destroy_subscription, self.create_subscription(
            kind, topic, self.counted(callback, always), qos, callback_group=group, **options))

    def add_newest(self: Any, kind: Any, topic: str, callback: Callable[[Any], Any],
                   qos: QoSProfile = LATEST) -> None:
        """Subscribe to the newest message, in a thread of its own; with a depth, to some.

        An executor takes ten times as long for it, and a flood would delay all else.
        """
        made = self.add_subscription(kind, topic, callback, qos, _Nobodys())
        Thread(target=self._take, args=(made,), name=topic, daemon=True).start()

    def add_latched(self: Any, kind: Any, topic: str, callback: Callable[..., Any],
                    qos: QoSProfile, group: Any) -> None:
        """Subscribe, always, so that latched and volatile publishers are heard, and none warns.

        A subscription to history makes volatile publishers warn: it waits until one latches.
        """
        node: Any = self
        latched = QoSProfile(depth=qos.depth, reliability=qos.reliability,
                             durability=DurabilityPolicy.TRANSIENT_LOCAL)
        once = Once(callback)
        node.add_subscription(kind, topic, once, qos, group, always=True)

        def look() -> None:
            publishers = node.get_publishers_info_by_topic(topic)
            if any(one.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                   for one in publishers):
                timer.cancel()
                node.add_subscription(  # that a volatile publisher does not suit it is no news
                    kind, topic, once, latched, group, always=True,
                    event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))

        timer = node.add_timer(_LOOK, look, group, always=True)
        look()

    def add_timer(self: Any, period: float, callback: Callable[..., Any], group: Any = None,
                  always: bool = False) -> Any:
        """Return a timer on a steady clock: with simulated time it must not stand still."""
        return self._keep(self.destroy_timer, self.create_timer(
            period, self.counted(callback, always), callback_group=group,
            clock=Clock(clock_type=ClockType.STEADY_TIME)))

    def add_service(self: Any, kind: Any, name: str, callback: Callable[..., Any],
                    at: Any) -> Any:
        """Return a service, in a callback group, or at a Desk: one that takes long."""
        counted = self.counted(callback, refusal=_inactive)
        desk = at if isinstance(at, Desk) else None
        made = self.create_service(kind, name, _hand_on if desk else counted, qos_profile=CALLS,
                                   callback_group=desk.group if desk else at)
        if desk is not None:
            desk.serve(made, name.removeprefix('~/'), counted)
        return self._keep(self.destroy_service, made)

    @property
    def is_open(self) -> bool:
        """Whether everything acts."""
        return self._open

    def open(self) -> None:
        """Let everything act."""
        with self._changed:
            self._open = True

    def shut(self, patience: float) -> bool:
        """Let nothing begin any more; return whether all that runs has ended within patience, s."""
        with self._changed:
            self._open = False
            return self._changed.wait_for(lambda: self._calls == 0, patience)

    def destroy_entities(self) -> None:
        """Destroy all that was made."""
        while self._entities:
            destroy, made = self._entities.pop()
            destroy(made)

    def counted(self, callback: Callable[..., Any], always: bool = False,
                refusal: Callable[..., Any] | None = None) -> Callable[..., Any]:
        """Return a callback that acts while the node is open, or `always`; `shut` waits for it."""
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

    def _keep(self, destroy: Callable[[Any], object], made: Any) -> Any:
        self._entities.append((destroy, made))
        return made

    def _take(self: Any, subscription: Any) -> None:
        """Hand messages to a subscription's callback, until it is destroyed."""
        rclpy = rclpy_implementation
        with suppress(rclpy.InvalidHandle, rclpy.RCLError):  # the node, or the context, has gone
            waiting = rclpy.WaitSet(1, 0, 0, 0, 0, 0, self.context.handle)
            while True:
                with subscription.handle, self.handle:
                    waiting.clear_entities()
                    waiting.add_subscription(subscription.handle)
                    waiting.wait(_WAIT)
                    taken = subscription.handle.take_message(subscription.msg_type, False)
                if taken is not None:
                    subscription.callback(taken[0])


def _inactive(_: Any, response: Any) -> Any:
    if hasattr(response, 'message'):
        response.message = _INACTIVE
    return response


class LifecycleNode(Entities, LifecycleNodeMixin, Node):
    """Base of a managed node; `configure`, `activate`, `deactivate` and `clean_up` are its own.

    What one of them raises is logged: then the state is the one before (DloPlannerError), or
    unconfigured. Services of parameters and of the lifecycle are there after `show`.
    """

    def __init__(self, name: str, **options: Any) -> None:
        Node.__init__(self, name, start_parameter_services=False,
                      automatically_declare_parameters_from_overrides=True, **options)
        Entities.__init__(self)
        self.lifecycle_state = 'starting'
        self.loading = Event()  # whether kernels of plans may still have to be compiled

    @property
    def known_as(self) -> str:
        """Its name on /diagnostics and in each status, with its namespace: `cell1/dlo_planner`."""
        return str(self.get_fully_qualified_name()).lstrip('/')

    def show(self) -> None:
        """Make the services of parameters and of the lifecycle."""
        self._parameters_shown = ParameterService(self)
        # not with the parameters' services: a transition may take long
        LifecycleNodeMixin.__init__(self, callback_group=MutuallyExclusiveCallbackGroup())
        for service in self.services:
            service.callback = self._surviving(service.callback, service.srv_name)
        self.lifecycle_state = 'unconfigured'

    def start_up(self) -> None:
        """Go on to active; raise DloPlannerError if that is refused."""
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != TransitionCallbackReturn.SUCCESS:
                raise DloPlannerError(self._failure)

    def end(self) -> None:
        """Finalize the node, whatever its state is; return when nothing moves any more."""
        with suppress(rclpy_implementation.RCLError):  # it is final already, or changes just now
            self.trigger_shutdown()

    def destroy_node(self) -> None:
        """Leave, with the lifecycle's publisher, which rclpy leaves to the garbage collector."""
        if self.lifecycle_state != 'starting':
            self._state_machine.destroy_when_not_in_use()
        super().destroy_node()

    def _surviving(self, callback: Callable[..., Any], name: str) -> Callable[..., Any]:
        """Return a callback of one of rclpy's services that cannot end the node.

        They raise for some requests: a transition, or a type of parameter, that does not exist.
        """
        @wraps(callback)
        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                reason = ' '.join(f'{type(error).__name__}: {error}'.split())
                self.get_logger().warning(f'{name} refused: {reason}', throttle_duration_sec=1.0)
                return _refused(request, response, reason)
        return answer

    # ---- what a node does; each may raise -------------------------------------------------------

    def configure(self) -> None:
        """Read parameters, make what is offered; it does not act yet."""

    def activate(self) -> None:
        """Begin to act."""

    def deactivate(self) -> None:
        """Let motion come to rest, cease to act."""

    def clean_up(self) -> None:
        """Take back what `configure` did."""

    # ---- transitions, called by rclpy: publishers are switched on before `activate` --------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure."""
        return self._passed(super().on_configure, state, 'inactive', self.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Switch publishers on, then activate."""
        super().on_activate(state)
        return self._passed(None, state, 'active', self.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate, then switch publishers off."""
        return self._passed(super().on_deactivate, state, 'inactive', self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        return self._passed(super().on_cleanup, state, 'unconfigured', self.clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate and clean up, as far as that is due."""
        due = {'active': (self.deactivate, self.clean_up), 'inactive': (self.clean_up,)}
        return self._passed(super().on_shutdown, state, 'finalized', *due.get(state.label, ()))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Become unconfigured."""
        return self._passed(super().on_error, state, 'unconfigured', self.deactivate,
                            self.clean_up)

    def _passed(self, after: Callable[..., Any] | None, state: LifecycleState, label: str,
                *steps: Callable[[], None]) -> TransitionCallbackReturn:
        """Take the steps of a transition, then what rclpy does `after` them."""
        try:
            for step in steps:
                step()
        except (DloPlannerError, ParameterException) as error:
            self._failure = str(error)
            self.get_logger().error(self._failure)
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self._failure = f'{type(error).__name__}: {error}'
            self.get_logger().error(traceback.format_exc())
            return TransitionCallbackReturn.ERROR
        self.lifecycle_state = label
        return TransitionCallbackReturn.SUCCESS if after is None else after(state)


def _refused(request: Any, response: Any, reason: str) -> Any:
    """Return a response that says so, where it can; what was done before stays answered."""
    refusal = SetParametersResult(successful=False, reason=reason)
    if hasattr(response, 'results'):
        response.results += [refusal] * (len(request.parameters) - len(response.results))
    elif hasattr(response, 'result') and isinstance(response.result, SetParametersResult):
        response.result = refusal
    return response
