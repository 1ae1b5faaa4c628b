# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Every topic and service that the node opens, and odd messages thrown at them."""

from collections import Counter
from functools import partial
from threading import Lock
from time import monotonic, sleep

from geometry_msgs.msg import PoseStamped, WrenchStamped
from lifecycle_msgs.srv import (
    ChangeState,
    GetAvailableStates,
    GetAvailableTransitions,
    GetState,
)
from nav_msgs.msg import Goals
from nav_msgs.srv import GetPlan
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger
from type_description_interfaces.srv import GetTypeDescription
from visualization_msgs.msg import MarkerArray

from dlo_planner.ros.lifecycle import LATCHED, REQUEST
from dlo_planner.settings.parameters import PARAMETERS
from soak.odd_values import INTEGERS, TEXTS, Odd

# topic: type, quality, maker (of an Odd and a number of faults)
TOPICS = {
    '~/gripper_pose': (PoseStamped, qos_profile_sensor_data, Odd.pose_stamped),
    '~/far_end_pose': (PoseStamped, qos_profile_sensor_data, Odd.pose_stamped),
    '~/task': (String, REQUEST, Odd.task),
    '~/task_goal': (PoseStamped, REQUEST, Odd.pose_stamped),
    '~/task_goals': (Goals, REQUEST, Odd.goals),
    '~/obstacles': (MarkerArray, REQUEST, Odd.markers),
    '~/enable': (Bool, qos_profile_sensor_data, lambda odd, faults: Bool(
        data=odd.one_of((True, False)))),
    '~/measured_wrench': (WrenchStamped, qos_profile_sensor_data, Odd.wrench),
    '~/observed_cutout': (PoseStamped, REQUEST, Odd.pose_stamped),
    '~/observed_points': (PointCloud2, qos_profile_sensor_data, Odd.cloud),
    'joint_states': (JointState, qos_profile_sensor_data, Odd.joint_state),
    'robot_description': (String, LATCHED, Odd.text),
    'robot_description_semantic': (String, LATCHED, Odd.text),
}
NOT_A_TRANSITION = (0, 77, 255, 9)  # 'create', and numbers of none
NOT_LABELS = ('configure', 'activate', 'no transition', 'no\nline')  # of an active node
MOST_WAITING = 8     # requests that are not answered yet
PATIENCE = 60.0      # s for an answer


def plain(kind):
    return lambda odd, faults: kind.Request()


def a_plan(odd, faults):
    return GetPlan.Request(start=odd.pose_stamped(faults), goal=odd.pose_stamped(faults),
                           tolerance=odd.one_of((0.0, float('nan'))))


def names_of(kind):
    return lambda odd, _: kind.Request(names=[
        odd.one_of((*PARAMETERS, *TEXTS)) for _ in range(odd.one_of((0, 1, 300)))])


def some_names(odd, _):
    return ListParameters.Request(prefixes=[odd.one_of((*PARAMETERS, *TEXTS))] * odd.one_of((0, 3)),
                                  depth=abs(odd.one_of(INTEGERS[:-1])))


def values_of(kind, most, odd, faults):
    """Return a request to set parameters."""
    return kind.Request(parameters=[odd.parameter(faults) for _ in range(odd.one_of((1, most)))])


def a_transition(odd, _):
    request = ChangeState.Request()
    request.transition.id = odd.one_of(NOT_A_TRANSITION)
    request.transition.label = odd.one_of(('', '', *NOT_LABELS))
    return request


def a_type(odd, _):
    return GetTypeDescription.Request(type_name=odd.one_of((*TEXTS, 'std_msgs/msg/String')),
                                      type_hash=odd.one_of((*TEXTS, 'RIHS01_' + 64 * '0')),
                                      include_type_sources=bool(odd.rng.random() < 0.5))


# service: type, maker
SERVICES = {
    **{f'~/{name}': (Trigger, plain(Trigger)) for name in ('cancel', 'execute', 'identify',
                                                           'next_stage', 'replan', 'reset')},
    **{f'~/{name}': (GetPlan, a_plan) for name in (
        'plan', 'plan_threading', 'plan_insertion', 'plan_hold_contact', 'plan_slide_contact',
        'plan_sequence', 'plan_two_cutouts', 'predict_shape', 'execute_plan')},
    '~/change_state': (ChangeState, a_transition),
    '~/get_state': (GetState, plain(GetState)),
    '~/get_available_states': (GetAvailableStates, plain(GetAvailableStates)),
    '~/get_available_transitions': (GetAvailableTransitions, plain(GetAvailableTransitions)),
    '~/get_transition_graph': (GetAvailableTransitions, plain(GetAvailableTransitions)),
    '~/describe_parameters': (DescribeParameters, names_of(DescribeParameters)),
    '~/get_parameter_types': (GetParameterTypes, names_of(GetParameterTypes)),
    '~/get_parameters': (GetParameters, names_of(GetParameters)),
    '~/list_parameters': (ListParameters, some_names),
    '~/set_parameters': (SetParameters, partial(values_of, SetParameters, 5)),
    '~/set_parameters_atomically': (SetParametersAtomically,
                                    partial(values_of, SetParametersAtomically, 5)),
    '~/get_type_description': (GetTypeDescription, a_type),
}
# What an execution must not mind, with faults in each message; the other services act.
HARMLESS = tuple(name for name in (*TOPICS, *SERVICES) if name not in (
    '~/cancel', '~/replan', '~/reset'))


class Fuzzer:
    """Throws messages; counts them, and the answers of services.

    Args:
        client: PlannerClient; rng: numpy Generator
    """

    def __init__(self, client, rng):
        self._node, self._planner = client.node, client.planner
        self.odd = Odd(rng, lambda: self._node.get_clock().now().to_msg())
        self.sent, self.answered = Counter(), Counter()
        self._lock = Lock()
        self._topics = {name: self._node.create_publisher(kind, self._full(name), qos)
                        for name, (kind, qos, _) in TOPICS.items()}
        self._services = {name: self._node.create_client(kind, self._full(name))
                          for name, (kind, _) in SERVICES.items()}

    def _full(self, name):
        """Return a name as the node opens it."""
        namespace = self._planner.rsplit('/', 1)[0]
        return name.replace('~', self._planner, 1) if '~' in name else f'{namespace}/{name}'

    def throw(self, name: str, faults: int, garbage: bool = False):
        """Send one message to a topic or service.

        Args:
            name: of TOPICS or SERVICES
            faults: in it
            garbage: whether bytes are sent, on a topic, that are no message of its type
        """
        self.sent[name] += 1
        if name in TOPICS:
            msg = TOPICS[name][2](self.odd, faults)
            self._topics[name].publish(self._torn(msg) if garbage else msg)
            return
        self._wait(MOST_WAITING - 1)
        future = self._services[name].call_async(SERVICES[name][1](self.odd, faults))
        future.add_done_callback(lambda _: self._count(name))

    def _torn(self, msg):
        """Return the bytes of a message, of which some are missing or others."""
        data = bytearray(serialize_message(msg))
        if self.odd.rng.random() < 0.5:
            return bytes(data[:int(self.odd.rng.integers(4, len(data)))])
        for _ in range(4):
            data[int(self.odd.rng.integers(4, len(data)))] = int(self.odd.rng.integers(256))
        return bytes(data)

    def _count(self, name):
        with self._lock:
            self.answered[name] += 1

    @property
    def unanswered(self) -> dict:
        """The number of requests, by service, that wait for an answer."""
        with self._lock:
            waiting = {name: self.sent[name] - self.answered[name] for name in SERVICES}
        return {name: number for name, number in waiting.items() if number}

    def _wait(self, most=0):
        """Wait until no more than so many requests are not answered; return whether they are."""
        end = monotonic() + PATIENCE
        while sum(self.unanswered.values()) > most:
            if monotonic() > end:
                return False
            sleep(0.001)
        return True

    def all_answered(self) -> bool:
        return self._wait()

    def close(self):
        for publisher in self._topics.values():
            self._node.destroy_publisher(publisher)
        for client in self._services.values():
            self._node.destroy_client(client)
